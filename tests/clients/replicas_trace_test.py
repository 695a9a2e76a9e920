# SPDX-License-Identifier: Apache-2.0
"""One request's id and trace in the logs of HAProxy and of the daemons:
replicas_trace_test.py KDRAYD KDRAY

Exits with 77 (skipped) if HAProxy is not installed.
"""
import hashlib
import json
import os
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import time
import unittest
from pathlib import Path

from replicas import BACK_S, HAPROXY, RAYS, ROOT, Replicas, mesh, request

sys.path.insert(0, str(ROOT / "clients/python"))
import kdray  # noqa: E402
import numpy as np  # noqa: E402

KDRAYD, KDRAY = sys.argv[1:3]
PROXY = "haproxy"


def new_trace():
    return f"00-{secrets.token_hex(16)}-{secrets.token_hex(8)}-01"


class Logs:
    """The logs of HAProxy and all replicas; every line that is not the proxy's notice is JSON."""

    def __init__(self, replicas):
        self._folder = Path(replicas.folder)
        self._names = [PROXY, *replicas.addresses]

    def lines(self, name):
        # HAProxy's log also has its notices of servers, which are no objects.
        text = (self._folder / f"{name}.log").read_text()
        return [json.loads(line) for line in text.splitlines() if line.startswith("{")]

    def of(self, count, **wanted):
        """(log, line) of requests with these fields, when there are `count` of them."""
        deadline = time.monotonic() + BACK_S
        while True:
            found = [(name, line) for name in self._names for line in self.lines(name)
                     if line["event"] == "request"
                     and all(line.get(key) == value for key, value in wanted.items())]
            if len(found) >= count or time.monotonic() > deadline:
                return found
            time.sleep(0.02)


class TraceTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.replicas = Replicas(KDRAYD)
        cls.addClassCleanup(cls.replicas.__exit__)
        cls.logs = Logs(cls.replicas)
        with kdray.Client(cls.replicas.url) as client:
            cls.mesh = client.upload(mesh(1))
        cls.rays = f"/v1/trees/{cls.mesh.id}/rays/closest"

    def check_trace(self, trace, requests):
        """HAProxy and the replicas have logged the same requests of a trace, each with its id."""
        _, trace_id, parent_id, _ = trace.split("-")
        found = self.logs.of(2 * requests, trace_id=trace_id)
        self.assertEqual({line["parent_id"] for _, line in found}, {parent_id})
        of_proxy = sorted(line["request_id"] for name, line in found if name == PROXY)
        of_replicas = sorted(line["request_id"] for name, line in found if name != PROXY)
        self.assertEqual(len(set(of_proxy)), requests)
        self.assertEqual(of_proxy, of_replicas)
        return of_proxy

    def test_the_python_package_keeps_the_trace_and_all_parts_of_a_batch_are_of_it(self):
        trace = new_trace()
        with kdray.Client(self.replicas.url, traceparent=trace) as client:
            tree = client.tree(self.mesh.id)
            tree.closest(np.tile([0.1, 0, 9, 0, 0, -1], (600_000, 1)).astype("<f4"))
        ids = self.check_trace(trace, 1 + 1 + 3)  # the tree, the limits, three parts
        self.assertTrue(all(text.startswith("kdray-") for text in ids))

    def test_the_command_keeps_the_trace_of_its_environment(self):
        trace = new_trace()
        done = subprocess.run([KDRAY, "--server", self.replicas.url, "list"], capture_output=True,
                              env=dict(os.environ, TRACEPARENT=trace))
        self.assertEqual(done.returncode, 0, done.stderr)
        self.check_trace(trace, 1)

    @unittest.skipUnless(shutil.which("node"), "node is not installed")
    def test_the_javascript_package_keeps_the_trace(self):
        trace = new_trace()
        script = f"""
            import {{ Client }} from '{ROOT}/clients/js/src/index.js';
            const client = new Client('{self.replicas.url}', {{ traceparent: '{trace}' }});
            const tree = await client.tree('{self.mesh.id}');
            await tree.any([[0, 0, 9, 0, 0, -1]]);
        """
        subprocess.run(["node", "--input-type=module", "-e", script], check=True, text=True)
        self.check_trace(trace, 3)  # the tree, the limits, the rays

    def test_a_request_without_an_id_gets_one_from_haproxy(self):
        _, headers, _ = request(self.replicas.port, "POST", self.rays, RAYS)
        found = self.logs.of(2, request_id=headers["x-request-id"])
        self.assertEqual([name for name, _ in found], [PROXY, headers["kdray-replica"]])
        proxy, daemon = (line for _, line in found)
        self.assertEqual(proxy["replica"], headers["kdray-replica"])
        self.assertEqual((proxy["method"], proxy["path"], proxy["status"], proxy["trace_id"]),
                         ("POST", self.rays, 200, "-"))
        self.assertEqual((daemon["path"], daemon["status"]), (self.rays, 200))
        self.assertGreaterEqual(proxy["ms"] + 1, daemon["ms"])
        self.assertGreater(proxy["bytes_out"], 0)

    def test_an_id_that_a_daemon_would_not_take_is_replaced_for_all(self):
        for given in ("a" * 65, "with space", 'quote"', "", "ä"):
            _, headers, _ = request(self.replicas.port, "GET", "/v1",
                                    headers={"X-Request-Id": given.encode()})
            self.assertNotEqual(headers["x-request-id"], given)
            self.assertEqual(len(self.logs.of(2, request_id=headers["x-request-id"])), 2, given)
        _, headers, _ = request(self.replicas.port, "GET", "/v1", headers={"X-Request-Id": "a.B_9-"})
        self.assertEqual(headers["x-request-id"], "a.B_9-")
        with socket.create_connection(("127.0.0.1", self.replicas.port)) as twice:
            twice.sendall(b"GET /v1 HTTP/1.1\r\nHost: x\r\nX-Request-Id: one\r\nX-Request-Id: two\r\n"
                          b"Connection: close\r\n\r\n")
            answer = twice.makefile("rb").read().decode().lower()
        given = answer.split("x-request-id: ")[1].split("\r\n")[0]
        self.assertEqual(answer.count("x-request-id"), 1)
        self.assertEqual(len(self.logs.of(2, request_id=given)), 2)

    def test_a_request_that_is_repeated_has_one_id_in_every_log(self):
        unknown = hashlib.sha256(b"unknown").hexdigest()
        status, headers, content = request(self.replicas.port, "GET", f"/v1/trees/{unknown}-auto",
                                           headers={"X-Request-Id": "asked-thrice"})
        self.assertEqual((status, json.loads(content)["request_id"]), (404, "asked-thrice"))
        found = self.logs.of(4, request_id="asked-thrice")
        self.assertEqual([name for name, _ in found].count(PROXY), 1)
        self.assertEqual(len(found), 4)
        self.assertEqual(found[0][1]["retries"].lstrip("+"), "2")

    def test_the_logs_of_haproxy_hold_no_secrets_and_stay_json(self):
        trace = new_trace()
        with socket.create_connection(("127.0.0.1", self.replicas.port)) as raw:
            raw.sendall(b'GET /v1/%22\\"x"?token=hush HTTP/1.1\r\nHost: x\r\nX-Request-Id: odd\r\n'
                        b'Authorization: Bearer hush\r\ntraceparent: ' + trace.encode() +
                        b'\r\nConnection: close\r\n\r\n')
            raw.makefile("rb").read()
        found = self.logs.of(2, request_id="odd")
        self.assertEqual(found[0][1]["path"], '/v1/%22\\"x"')
        self.assertNotIn("hush", (Path(self.replicas.folder) / "haproxy.log").read_text())

    def test_a_traceparent_that_is_invalid_is_logged_by_nobody(self):
        def traces(name, *given):
            with socket.create_connection(("127.0.0.1", self.replicas.port)) as raw:
                raw.sendall("\r\n".join([
                    "GET /v1 HTTP/1.1", "Host: x", f"X-Request-Id: {name}",
                    *(f"traceparent: {text}" for text in given), "Connection: close", "", ""
                ]).encode())
                raw.makefile("rb").read()
            return [line.get("trace_id") for _, line in self.logs.of(2, request_id=name)]

        trace = new_trace()
        for number, given in enumerate((
                "00-1-2-3", trace.upper(), trace[3:], trace + "0", trace + "-more", "ff" + trace[2:],
                f"00-{'0' * 32}-{'1' * 16}-01", f"00-{'1' * 32}-{'0' * 16}-01")):
            self.assertEqual(traces(f"bad-{number}", given), ["-", None], given)
        self.assertEqual(traces("two", trace, trace), ["-", None])
        later = "01" + trace[2:] + "-more"  # later versions may append to it
        self.assertEqual(traces("later", later), [trace.split("-")[1]] * 2)


def wait_until_down(replicas):
    """Until HAProxy, by its own metrics, has no replica in use."""
    targets = json.loads(Path(replicas.folder, "targets.json").read_text())
    address, = (entry["targets"][0] for entry in targets if entry["labels"]["job"] == "haproxy")
    deadline = time.monotonic() + 2 * BACK_S
    while time.monotonic() < deadline:
        _, _, content = request(int(address.split(":")[1]), "GET", "/metrics")
        if b'haproxy_backend_active_servers{proxy="kdray"} 0' in content:
            return
        time.sleep(0.1)
    raise RuntimeError("HAProxy goes on using the replica")


class ProblemsTest(unittest.TestCase):
    def test_without_a_replica_haproxy_answers_with_a_problem(self):
        with Replicas(KDRAYD, 1) as replicas:
            logs = Logs(replicas)
            replicas.stop("replica1", signal.SIGSTOP)
            try:
                wait_until_down(replicas)
                status, headers, content = request(replicas.port, "GET", "/v1",
                                                   headers={"X-Request-Id": "nobody"})
            finally:
                replicas.stop("replica1", signal.SIGCONT)
            self.assertEqual((status, headers["content-type"], headers["retry-after"]),
                             (503, "application/problem+json", "1"))
            problem = json.loads(content)
            self.assertEqual((problem["status"], problem["code"], problem["request_id"],
                              headers["x-request-id"]), (503, "no_replica", "nobody", "nobody"))
            self.assertEqual(logs.of(1, request_id="nobody")[0][1]["replica"], "<NOSRV>")

    def test_only_problems_are_logged_if_it_is_wanted(self):
        with Replicas(KDRAYD, 1, KDRAY_LOG="problems") as replicas:
            logs = Logs(replicas)
            request(replicas.port, "GET", "/v1", headers={"X-Request-Id": "good"})
            with socket.create_connection(("127.0.0.1", replicas.port)) as raw:
                raw.sendall(b"NO HTTP\r\n\r\n")
                answer = raw.makefile("rb").read()
            self.assertIn(b"400", answer.split(b"\r\n")[0])
            self.assertEqual(len(logs.of(1, status=400)), 1)
            self.assertEqual([name for name, _ in logs.of(1, request_id="good")], ["replica1"])


if __name__ == "__main__":
    if HAPROXY is None:
        print("HAProxy is not installed; replicas are not tested")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1], verbosity=2)
