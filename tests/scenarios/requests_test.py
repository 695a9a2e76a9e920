# SPDX-License-Identifier: Apache-2.0
"""Requests that lie, leave or look for a way in: requests_test.py KDRAYD [TEST]

S06, S09 and S16 of the scenarios in tests/README.md. The clients write bytes to a socket, because a
library would refuse to send them.
"""
import json
import os
import struct
import sys
import tempfile
import time
import unittest

from service import Service, bumpy, rays, tetrahedron

KDRAYD = sys.argv[1]
MIB = 2**20
SANITIZED = bool(os.environ.get("KDRAY_SANITIZE"))  # with memory of the sanitizer's own
TOKEN = "a-token-of-this-test"


def head(method, path, *fields):
    return "\r\n".join((f"{method} {path} HTTP/1.1", "Host: kdray", *fields, "", "")).encode()


def exchange(service, request):
    """The status of the answer, and the answer; (0, b"") if the connection ends without one."""
    with service.socket() as client:
        client.sendall(request)
        answer = b""
        while b"\r\n\r\n" not in answer:
            piece = client.recv(65536)
            if not piece:
                return 0, answer
            answer += piece
        before, _, body = answer.partition(b"\r\n\r\n")
        length = next((int(line.split(b":")[1]) for line in before.lower().split(b"\r\n")
                       if line.startswith(b"content-length:")), 0)
        while len(body) < length:
            piece = client.recv(65536)
            if not piece:
                break
            body += piece
        return int(answer.split()[1]), body


def peak_mib(service):
    with open(f"/proc/{service.process.pid}/status", encoding="utf-8") as file:
        return next(int(line.split()[1]) for line in file if line.startswith("VmHWM")) / 1024


def lying_meshes():
    """(name, bytes): each claims 2^31 or more elements and has none or few of them."""
    many = 2**31
    ply = f"ply\nformat {{}} 1.0\nelement vertex {many}\nproperty float x\nproperty float y\n" \
          f"property float z\nelement face {many}\nproperty list uchar int vertex_indices\nend_header\n"
    yield "ply ascii", ply.format("ascii").encode() + b"0 0 0\n"
    yield "ply binary", ply.format("binary_little_endian").encode() + bytes(12)
    yield "stl", bytes(80) + struct.pack("<I", many) + bytes(50)
    yield "off", f"OFF\n{many} {many} 0\n0 0 0\n".encode()
    yield "off face", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n4000000000 0 1 2\n"
    yield "obj index", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 2147483647\n"
    document = json.dumps({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": many}],
        "bufferViews": [{"buffer": 0, "byteLength": 12 * many}], "buffers": [{"byteLength": 12 * many}],
    }).encode()
    document += b" " * (-len(document) % 4)
    chunks = struct.pack("<II", len(document), 0x4E4F534A) + document + struct.pack("<II", 12, 0x004E4942) + bytes(12)
    yield "glb", struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks
    yield "gltf", document


class RequestsTest(unittest.TestCase):
    def test_S06_files_that_claim_billions_of_elements_are_refused_and_take_no_memory(self):
        with Service(KDRAYD) as service:
            service.upload(tetrahedron())
            before = peak_mib(service)
            for name, mesh in lying_meshes():
                status, answer = service.ask("POST", "/v1/trees?wait_ms=10000", mesh)
                answer = json.loads(answer)
                if status in (201, 202):  # the reader's verdict comes with the description
                    status, answer = service.ask("GET", f"/v1/trees/{answer['id']}?wait_ms=10000")
                    answer = json.loads(answer)
                self.assertIn(status, (400, 413, 422), (name, answer))
                self.assertTrue(answer["detail"], name)
            if not SANITIZED:
                self.assertLess(peak_mib(service) - before, 16)
            self.assertEqual(service.ask("GET", "/v1/trees")[1].count(b'"id"'), 1)

    def test_S06_json_that_is_deep_or_long_is_refused_within_four_times_its_bytes(self):
        with Service(KDRAYD) as service:
            service.upload(tetrahedron())
            path = service.tree + "/rays/closest"
            service.ask("POST", path, rays())
            for name, body in (("a deep array", b'{"rays":' + b"[" * 10**6),
                               ("a deep object", b'{"rays":' + b'{"a":' * 10**6),
                               ("many numbers", b'{"rays":[' + b"0," * 10**7 + b"0]}"),
                               ("many empty rows", b'{"rays":[' + b"[]," * 5 * 10**6 + b"[]]}"),
                               ("many unknown fields", b"{" + b'"a":1,' * 10**6 + b'"rays":[]}')):
                before = peak_mib(service)
                start = time.monotonic()
                status, answer = service.ask("POST", path, body)
                self.assertIn(status, (400, 413), (name, answer[:200]))
                if not SANITIZED:
                    self.assertLess(peak_mib(service) - before, 4 * len(body) / MIB + 16, name)
                self.assertLess(time.monotonic() - start, 10, name)

    def await_idle(self, service, seconds):
        """Whether nothing computes within this time; the memory of requests is back as well."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            if (service.metric("kdray_running_requests") == 0
                    and service.metric("kdray_request_memory_bytes") == 0):
                return True
            time.sleep(0.005)
        return False

    def test_S09_whoever_leaves_stops_the_work_and_a_build_goes_on(self):
        with Service(KDRAYD) as service:
            service.upload(bumpy(60))
            picture = head("GET", service.tree + "/render.png?width=3000&height=3000"
                           "&mode=ambient-occlusion&samples=64&deadline_ms=60000")
            batch = rays(200_000)
            exact = head("POST", service.tree + "/rays/all?precision=exact&deadline_ms=60000",
                         f"Content-Length: {len(batch)}") + batch
            for request in (picture, exact):
                client = service.socket()
                client.sendall(request)
                deadline = time.monotonic() + 20
                while service.metric("kdray_running_requests") == 0 and time.monotonic() < deadline:
                    time.sleep(0.002)
                client.close()
                # 250 ms, and what a busy machine adds.
                self.assertTrue(self.await_idle(service, 2), request[:60])
            # Half an upload leaves nothing.
            mesh = bumpy(80)
            client = service.socket()
            client.sendall(head("POST", "/v1/trees", f"Content-Length: {len(mesh)}") + mesh[:len(mesh) // 2])
            client.close()
            self.assertTrue(self.await_idle(service, 2))
            self.assertEqual(service.ask("GET", "/v1/trees")[1].count(b'"id"'), 1)
            # A whole upload whose client does not wait for the answer is built.
            client = service.socket()
            client.sendall(head("POST", "/v1/trees?wait_ms=30000", f"Content-Length: {len(mesh)}") + mesh)
            time.sleep(0.05)
            client.close()
            deadline = time.monotonic() + 30
            states = []
            while time.monotonic() < deadline:
                trees = json.loads(service.ask("GET", "/v1/trees")[1])["trees"]
                states = sorted(tree["state"] for tree in trees)
                if states == ["ready", "ready"]:
                    break
                time.sleep(0.02)
            self.assertEqual(states, ["ready", "ready"])

    def test_S16_paths_that_look_for_files_find_none(self):
        with Service(KDRAYD) as service:
            service.upload(tetrahedron())
            digest = service.tree.split("/")[-1]
            names = ["..", "../..", "%2e%2e", "%2e%2e%2f", "..%2fcatalog", "%00", digest + "%00", digest + "%2f..",
                     digest.upper(), digest[:-1], digest + "x", "a" * 5000, "%ff%fe", "%", "%zz", ".", "", "*",
                     "~", "con", "-auto", digest.replace("-", "--")]
            for name in names:
                for suffix in ("", "/mesh", "/cells", "/render.png"):
                    for method in ("GET", "DELETE", "HEAD"):
                        status, answer = exchange(service, head(method, f"/v1/trees/{name}{suffix}",
                                                                "Connection: close"))
                        is_list = suffix == "" and name in ("", ".") and method != "DELETE"
                        self.assertTrue(status in (400, 404, 405, 414) or is_list, (method, name, suffix, answer))
                        self.assertNotIn(b"OFF", answer)
            for target in ("/../../etc/passwd", "/..%2f..%2fetc/passwd", "//etc/passwd", "/v1/../../etc/passwd",
                           "/docs/../../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "/v1/trees/%2e%2e/%2e%2e/data/lock"):
                status, answer = exchange(service, head("GET", target, "Connection: close"))
                self.assertIn(status, (400, 404), target)
                self.assertNotIn(b"root:", answer)
            self.assertEqual(service.ask("GET", service.tree)[0], 200)
            self.assertEqual(os.listdir(os.path.join(service.folder, "data", "meshes")), [digest.split("-")[0]])

    def test_S16_a_token_counts_only_when_it_is_sent_once_and_whole(self):
        handle, tokens = tempfile.mkstemp()
        self.addCleanup(os.unlink, tokens)
        os.write(handle, TOKEN.encode() + b"\n")
        os.close(handle)
        with Service(KDRAYD, "--token-file", tokens) as service:
            right = f"Authorization: Bearer {TOKEN}"
            self.assertEqual(exchange(service, head("GET", "/v1/trees", right))[0], 200)
            self.assertEqual(exchange(service, head("GET", "/v1/trees", f"AUTHORIZATION: bearer {TOKEN}"))[0], 200)
            for fields in ((), (right, right), (right, "Authorization: Bearer wrong"), ("Authorization: Bearer wrong", right),
                           (f"Authorization: Bearer {TOKEN[:-1]}",), (f"Authorization: Bearer {TOKEN}x",),
                           (f"Authorization: Bearer {TOKEN}, Bearer {TOKEN}",), (f"Authorization: Basic {TOKEN}",),
                           (f"Authorization: {TOKEN}",), ("Authorization:",), (f"Authorization: Bearer {TOKEN}\0",),
                           (f"Proxy-Authorization: Bearer {TOKEN}",), (f"Authorization : Bearer {TOKEN}",)):
                for method in ("GET", "DELETE"):
                    status, _ = exchange(service, head(method, "/v1/trees/" + "0" * 64 + "-auto", *fields,
                                                       "Connection: close"))
                    self.assertIn(status, (400, 401), fields)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[2:]])
