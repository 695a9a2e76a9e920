# SPDX-License-Identifier: Apache-2.0
"""A kdrayd with `--store`, meshes for it, and faults of stores."""
import hashlib
import http.client
import json
import os
import re
import shutil
import struct
import subprocess
import tempfile
import threading
import time


def environment(**more):
    clean = {name: value for name, value in os.environ.items()
             if not name.startswith(("KDRAY_", "AWS_")) and not name.lower().endswith("_proxy")}
    return dict(clean, HOME="/nonexistent", **more)


class Replica:
    """A kdrayd with `--store url`, and these variables of the environment."""

    def __init__(self, kdrayd, url, **variables):
        self.folder = tempfile.mkdtemp(prefix="kdray-store-")
        self._command = [kdrayd, "--port", "0", "--threads", "1", "--data-dir",
                         os.path.join(self.folder, "data"), "--store", url]
        self._environment = environment(**variables)
        self._process = None
        self.start()

    def start(self):
        self._log = open(os.path.join(self.folder, "log"), "a+")
        self._process = subprocess.Popen(self._command, text=True, stdout=subprocess.PIPE,
                                         stderr=self._log, env=self._environment)
        line = self._process.stdout.readline()
        found = re.match(r"kdrayd listening on http://(\S+)", line)
        if not found:
            log = self.log()
            self.close()
            raise RuntimeError(f"kdrayd did not start: {log}")
        self.address = found[1]

    def log(self):
        with open(os.path.join(self.folder, "log")) as file:
            return file.read()

    def stop(self):
        self._process.terminate()
        self._process.wait(timeout=60)
        self._process.stdout.close()
        self._log.close()

    def kill(self):
        """SIGKILL; start() goes on with the same data directory."""
        self._process.kill()
        self._process.wait(timeout=60)
        self._process.stdout.close()
        self._log.close()

    def close(self):
        self.stop()
        shutil.rmtree(self.folder, ignore_errors=True)

    def ask(self, method, path, body=None):
        """(status, headers, body)"""
        connection = http.client.HTTPConnection(self.address, timeout=120)
        try:
            connection.request(method, path, body)
            answer = connection.getresponse()
            return answer.status, answer.headers, answer.read()
        finally:
            connection.close()

    def upload(self, mesh, build="auto"):
        status, _, body = self.ask("POST", f"/v1/trees?wait_ms=60000&build={build}", mesh)
        return status, json.loads(body)

    def trace(self, tree):
        rays = {"rays": [[0.2 + 0.1 * i, 0.3, -5, 0, 0, 1] for i in range(6)]}
        status, _, body = self.ask("POST", f"/v1/trees/{tree}/rays/closest", json.dumps(rays))
        return status, json.loads(body)

    def hits(self, tree):
        status, answer = self.trace(tree)
        assert status == 200, answer
        return answer["hits"] if "hits" in answer else answer

    def metric(self, name):
        _, _, body = self.ask("GET", "/metrics")
        return float(re.search(rf"^{name} (\S+)$", body.decode(), re.M)[1])


def mesh(number, size=12):
    """A bumpy sheet: OBJ text of a size, different for each number."""
    lines = [f"v {x} {y} {((x * 7 + y * 5 + number) % 11) / 10}"
             for y in range(size) for x in range(size)]
    for y in range(size - 1):
        for x in range(size - 1):
            a = y * size + x + 1
            lines.append(f"f {a} {a + 1} {a + size + 1} {a + size}")
    return "\n".join([f"# {number}", *lines]).encode()


def large_mesh(triangles):
    """Binary STL."""
    record = struct.Struct("<12fH")
    body = b"".join(
        record.pack(0, 0, 0, i % 1000, i // 1000, 0, i % 1000 + 0.9, i // 1000, 0,
                    i % 1000, i // 1000 + 0.9, 1, 0) for i in range(triangles))
    return b"\0" * 80 + struct.pack("<I", triangles) + body


def within(seconds, condition):
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.05)
    return True


FAULTS = [("status", 500), ("status", 503), ("slow", 0.3), ("truncate", 0), ("alter", 0),
          ("drop", 0), ("lose", 0)]


def no_fault(method, key, query):
    return None


def every_second(fault):
    """Each different request has the fault, and its repetition has not."""
    counts, lock = {}, threading.Lock()

    def decide(method, key, query):
        with lock:
            # Altered lists are not what a checksum protects.
            if fault[0] == "alter" and key == "":
                return None
            name = (method, key, query.get("prefix"), query.get("partNumber"))
            counts[name] = counts.get(name, 0) + 1
            return fault if counts[name] % 2 == 1 else None
    return decide


def trace_again(server, tree):
    """As trace. Requests of the other server for the same object may put the faults of this one's
    first request and of its repetition side by side: it says 503 and is asked again."""
    for _ in range(5):
        status, answer = server.trace(tree)
        if status != 503:
            break
        time.sleep(0.2)
    return status, answer


def check_answers(test, first, second, bytes_of_mesh):
    """One replica takes a mesh, the other answers and deletes it."""
    status, tree = first.upload(bytes_of_mesh)
    test.assertEqual(status, 201, tree)
    test.assertEqual(tree["id"][:64], hashlib.sha256(bytes_of_mesh).hexdigest())
    status, answer = trace_again(second, tree["id"])
    test.assertEqual(status, 200, answer)
    test.assertEqual(answer, trace_again(first, tree["id"])[1])
    status, _, body = second.ask("GET", f"/v1/trees/{tree['id']}/mesh")
    test.assertEqual(body, bytes_of_mesh)
    test.assertEqual(second.ask("DELETE", f"/v1/trees/{tree['id']}")[0], 204)
    test.assertEqual(second.trace(tree["id"])[0], 404)
