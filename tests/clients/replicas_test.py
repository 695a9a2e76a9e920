# SPDX-License-Identifier: Apache-2.0
"""HAProxy before three daemons, as server/deploy/local starts them: replicas_test.py KDRAYD KDRAY

Exits with 77 (skipped) if HAProxy is not installed. Raw connections send the load, so no client
hides a failure by repeating it.
"""
import hashlib
import http.client
import json
import shutil
import signal
import socket
import ssl
import subprocess
import sys
import tempfile
import threading
import time
import unittest
from pathlib import Path

from replicas import BACK_S, HAPROXY, RAYS, ROOT, Replicas, mesh, request

sys.path.insert(0, str(ROOT / "clients/python"))
import kdray  # noqa: E402
import numpy as np  # noqa: E402

KDRAYD, KDRAY = sys.argv[1:3]


class Load(threading.Thread):
    """Queries of some trees in turn, on a kept connection, until `end`."""

    def __init__(self, port, trees, expected):
        super().__init__()
        self._port, self._trees, self._expected = port, trees, expected
        self.failures, self.times, self._end = [], [], threading.Event()
        self.start()

    def run(self):
        connection = http.client.HTTPConnection("127.0.0.1", self._port, timeout=20)
        while not self._end.is_set():
            for tree in self._trees:
                start = time.monotonic()
                try:
                    status, headers, content = request(
                        self._port, "POST", f"/v1/trees/{tree}/rays/closest", RAYS, connection)
                except (OSError, http.client.HTTPException) as error:
                    self.failures.append(repr(error))
                    connection.close()
                    continue
                self.times.append((start, time.monotonic() - start))
                if status != 200 or content != self._expected[tree]:
                    self.failures.append((status, headers.get("kdray-replica"), content[:200]))
        connection.close()

    def end(self):
        self._end.set()
        self.join()


class ReplicasTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.replicas = Replicas(KDRAYD)
        cls.addClassCleanup(cls.replicas.__exit__)
        cls.client = kdray.Client(cls.replicas.url)
        cls.direct = {name: kdray.Client(url, retry_s=0)
                      for name, url in cls.replicas.addresses.items()}

    def holders(self, tree_id):
        """The replicas that have a tree."""
        return [name for name, client in self.direct.items()
                if client.find("GET", f"/v1/trees/{tree_id}") is not None]

    def home(self, tree_id):
        """The replica that answers for a tree."""
        return request(self.replicas.port, "GET", f"/v1/trees/{tree_id}")[1]["kdray-replica"]

    def load(self, trees, seconds, at_start):
        """Runs at_start under load; returns the load's threads when `seconds` have passed."""
        expected = {tree: request(self.replicas.port, "POST", f"/v1/trees/{tree}/rays/closest",
                                  RAYS)[2] for tree in trees}
        threads = [Load(self.replicas.port, trees, expected) for _ in range(3)]
        time.sleep(0.3)
        at_start()
        time.sleep(seconds)
        for thread in threads:
            thread.end()
        return threads

    def test_an_upload_goes_to_the_replica_that_answers_for_it(self):
        homes = set()
        for number in range(12):
            tree = self.client.upload(mesh(number))
            self.assertEqual(self.holders(tree.id), [self.home(tree.id)])
            homes.add(self.home(tree.id))
            built = tree.rebuild("bvh")  # sends no mesh, so it needs the replica that has it
            self.assertEqual(self.home(built.id), self.home(tree.id))
        self.assertEqual(homes, set(self.direct))

    def test_an_upload_without_a_digest_is_found_on_any_replica_next_to_its_own(self):
        tree = self.client.upload(mesh(20))
        home = self.home(tree.id)
        content = tree.mesh_bytes()
        tree.delete()
        self.assertEqual(self.holders(tree.id), [])
        found = set()
        for name, client in self.direct.items():
            if name != home:
                client.upload(content)
                found.add(self.client.find("GET", f"/v1/trees/{tree.id}") is not None)
                client.tree(tree.id).delete()
        self.assertIn(True, found)

    def test_a_tree_that_no_replica_has_is_not_found(self):
        unknown = hashlib.sha256(b"unknown").hexdigest()
        status, _, content = request(self.replicas.port, "GET", f"/v1/trees/{unknown}-auto")
        self.assertEqual((status, json.loads(content)["code"]), (404, "tree_not_found"))

    def test_a_replica_that_is_killed_fails_no_request_of_trees_that_all_have(self):
        trees = [self.client.upload(mesh(number)).id for number in range(30, 36)]
        for client in self.direct.values():
            for number in range(30, 36):
                client.upload(mesh(number))
        victim = self.home(trees[0])
        batch = kdray.rays(np.random.default_rng(1).normal(size=(20000, 3)), [0.1, -0.2, 0.3])
        whole = self.client.tree(trees[0]).closest(batch)
        batches = []
        package = threading.Thread(target=lambda: batches.extend(
            self.client.tree(trees[0]).closest(batch) for _ in range(12)))
        package.start()  # larger than HAProxy's buffer, so the package repeats what breaks
        killed = []
        threads = self.load(trees, 3.0, lambda: killed.append(
            (time.monotonic(), self.replicas.stop(victim, signal.SIGKILL))))
        self.assertEqual([failure for thread in threads for failure in thread.failures], [])
        package.join()
        self.assertEqual([bytes(answer) == bytes(whole) for answer in batches], [True] * 12)
        at, old = killed[0]
        before, after = ([took for thread in threads for start, took in thread.times
                          if is_of(start)] for is_of in (lambda s: s < at, lambda s: s > at + 2))
        self.assertGreater(len(after), 20)
        self.assertLess(p99(after), 3 * p99(before) + 100, "not back within 2 s")
        print(f"killed under load: {sum(len(t.times) for t in threads)} requests, none failed; "
              f"p99 {p99(before):.1f} ms before, {p99(after):.1f} ms from 2 s after", flush=True)
        self.replicas.wait_for_return(victim, old)

    def test_a_replica_that_drains_fails_no_request(self):
        trees = [self.client.upload(mesh(number)).id for number in range(40, 46)]
        for client in self.direct.values():
            for number in range(40, 46):
                client.upload(mesh(number))
        victim = self.home(trees[0])
        old = []
        threads = self.load(trees, 2.0,
                            lambda: old.append(self.replicas.stop(victim, signal.SIGTERM)))
        self.assertEqual([failure for thread in threads for failure in thread.failures], [])
        self.replicas.wait_for_return(victim, old[0])

    def test_a_tree_of_a_lost_replica_is_uploaded_again_to_its_successor(self):
        tree = self.client.upload(mesh(50))
        home = self.home(tree.id)
        old = self.replicas.stop(home, signal.SIGKILL)
        again = self.client.upload(mesh(50))
        self.assertEqual(again.id, tree.id)
        self.replicas.wait_for_return(home, old)
        self.assertEqual(len(self.holders(tree.id)), 2)
        self.assertEqual(self.home(tree.id), home)


class JoiningTest(unittest.TestCase):
    def test_a_replica_that_joins_with_the_stores_of_the_others_loses_no_tree(self):
        with tempfile.TemporaryDirectory(prefix="kdray-joining-") as folder:
            with Replicas(KDRAYD, 2, folder) as replicas:
                client = kdray.Client(replicas.url)
                trees = [client.upload(mesh(number)).id for number in range(60, 76)]
            for name in ("replica1", "replica2"):
                shutil.copytree(Path(folder, name), Path(folder, "replica3"), dirs_exist_ok=True)
            with Replicas(KDRAYD, 3, folder) as replicas:
                client = kdray.Client(replicas.url, retry_s=0)
                homes = set()
                for tree in trees:
                    status, headers, _ = request(
                        replicas.port, "POST", f"/v1/trees/{tree}/rays/closest", RAYS)
                    self.assertEqual(status, 200)
                    homes.add(headers["kdray-replica"])
                self.assertEqual(homes, {"replica1", "replica2", "replica3"})

    def test_without_them_its_trees_are_found_again_by_an_upload(self):
        with tempfile.TemporaryDirectory(prefix="kdray-joining-") as folder:
            with Replicas(KDRAYD, 2, folder) as replicas:
                client = kdray.Client(replicas.url)
                for number in range(80, 96):
                    client.upload(mesh(number))
            with Replicas(KDRAYD, 3, folder) as replicas:
                client = kdray.Client(replicas.url, retry_s=0)
                for number in range(80, 96):
                    tree = client.upload(mesh(number))
                    self.assertEqual(tree.count([[0.1, 0, 9, 0, 0, -1]]).tolist(), [2])


class SettingsTest(unittest.TestCase):
    @unittest.skipUnless(shutil.which("openssl"), "openssl is not installed")
    def test_with_a_certificate_it_speaks_tls(self):
        with tempfile.TemporaryDirectory(prefix="kdray-tls-") as folder:
            pem = Path(folder, "both.pem")
            subprocess.run(
                ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj",
                 "/CN=localhost", "-addext", "subjectAltName=IP:127.0.0.1", "-keyout",
                 f"{folder}/key", "-out", f"{folder}/cert"], check=True, capture_output=True)
            pem.write_text(Path(folder, "cert").read_text() + Path(folder, "key").read_text())
            with Replicas(KDRAYD, 1, KDRAY_CERTIFICATE=str(pem)) as replicas:
                client = kdray.Client(f"https://127.0.0.1:{replicas.port}",
                                      ssl_context=ssl.create_default_context(cafile=str(pem)))
                self.assertEqual(client.upload(mesh(1)).triangles, 4)

    def test_one_address_has_a_limit_of_connections(self):
        with Replicas(KDRAYD, 1, KDRAY_CLIENT_CONNECTIONS="4") as replicas:
            held = [socket.create_connection(("127.0.0.1", replicas.port)) for _ in range(5)]
            headers, content = self.answer_of_status(429, replicas.port)
            self.assertEqual((headers["retry-after"], headers["content-type"]),
                             ("1", "application/problem+json"))
            problem = json.loads(content)
            self.assertEqual((problem["code"], problem["request_id"]),
                             ("too_many_requests", headers["x-request-id"]))
            for connection in held:
                connection.close()
            self.answer_of_status(200, replicas.port)

    def test_one_address_has_a_limit_of_requests(self):
        with Replicas(KDRAYD, 1, KDRAY_CLIENT_REQUESTS="300") as replicas:
            statuses = []
            while len(statuses) < 3000 and 429 not in statuses:
                statuses.append(request(replicas.port, "GET", "/v1")[0])
            self.assertEqual(statuses, [200] * (len(statuses) - 1) + [429])

    def answer_of_status(self, wanted, port):
        """HAProxy counts connections when it accepts and closes them, which may take a moment."""
        deadline = time.monotonic() + BACK_S
        while True:
            status, headers, content = request(port, "GET", "/v1")
            if status == wanted:
                return headers, content
            self.assertLess(time.monotonic(), deadline, f"the status stays {status}")
            time.sleep(0.05)


def p99(seconds):
    return float(np.percentile(seconds, 99)) * 1000 if seconds else float("nan")


if __name__ == "__main__":
    if HAPROXY is None:
        print("HAProxy is not installed; replicas are not tested")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1], verbosity=2)
