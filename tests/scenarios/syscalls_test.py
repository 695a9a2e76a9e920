# SPDX-License-Identifier: Apache-2.0
"""System calls of the daemon fail, by strace's fault injection: syscalls_test.py KDRAYD [TEST]

S11, S13 and S02 of the scenarios in tests/README.md. While calls fail, an answer may be an error or a
connection may end, but no answer is wrong. Afterwards everything works, and what was acknowledged is
there after a restart.
"""
import http.client
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import unittest

from service import Service, bumpy, rays, tetrahedron

KDRAYD = sys.argv[1]

# What fails, and how: strace's expressions. `when=2+3` is the second call, and every third one after it.
FAULTS = [
    "write:error=ENOSPC:when=1+2", "write:error=EIO:when=2+3", "write:error=EINTR:when=1+2",
    "fsync:error=EIO:when=1+2", "fsync:error=ENOSPC:when=2+2", "fsync:error=EINTR:when=1+2",
    "openat:error=EMFILE:when=1+2", "openat:error=ENOSPC:when=2+3", "openat:error=EIO:when=1+3",
    "openat:error=EINTR:when=1+2",
    "rename,renameat,renameat2:error=EIO:when=1+2", "rename,renameat,renameat2:error=ENOSPC:when=2+2",
    "unlink,unlinkat:error=EIO:when=1+2", "pread64:error=EIO:when=1+2", "pread64:error=EINTR:when=1+2",
    "accept4:error=EMFILE:when=1+3", "accept4:error=ENFILE:when=1+2", "accept4:error=ECONNABORTED:when=1+3",
    "accept4:error=EINTR:when=1+2", "accept4:error=ENOMEM:when=2+3",
    "recvfrom:error=EINTR:when=1+2", "recvfrom:error=ECONNRESET:when=2+5", "recvfrom:error=ENOMEM:when=3+5",
    "sendto:error=EINTR:when=1+2", "sendto:error=EPIPE:when=2+4", "sendto:error=ENOBUFS:when=2+4",
    "poll:error=EINTR:when=1+2", "poll:error=ENOMEM:when=2+3", "epoll_wait:error=EINTR:when=1+2",
    "epoll_ctl:error=ENOMEM:when=1+2", "clone3,clone:error=EAGAIN:when=1+2", "mmap:error=ENOMEM:when=1+2",
    "setsockopt:error=ENOBUFS:when=1+2", "shutdown:error=ENOTCONN:when=1+2", "fcntl:error=EMFILE:when=1+2",
]
if os.environ.get("KDRAY_SANITIZE"):  # a sanitizer's own allocator ends the process then
    FAULTS = [fault for fault in FAULTS if not fault.startswith("mmap:")]


class Injection:
    """Faults in a running daemon, as long as the context lasts."""

    def __init__(self, service, *faults):
        self.command = ["strace", "-f", "-qq", "-o", "/dev/null", "-p", str(service.process.pid)]
        for fault in faults:
            self.command += ["-e", "inject=" + fault]
        self.threads = service

    def __enter__(self):
        self.strace = subprocess.Popen(self.command, stderr=subprocess.PIPE)
        deadline = time.monotonic() + 10
        folder = f"/proc/{self.threads.process.pid}/task"
        while time.monotonic() < deadline:
            if self.strace.poll() is not None:
                message = self.strace.stderr.read().decode()
                if "not permitted" in message or "ptrace" in message:
                    raise unittest.SkipTest("strace may not attach here")
                raise RuntimeError(message)
            if all(is_traced(f"{folder}/{thread}/status") for thread in os.listdir(folder)):
                return self
            time.sleep(0.005)
        raise RuntimeError("strace did not attach in time")

    def __exit__(self, *_):
        self.strace.send_signal(signal.SIGINT)
        self.strace.wait(20)
        self.strace.stderr.close()


def is_traced(path):
    try:
        with open(path, encoding="utf-8") as file:
            return "TracerPid:\t0\n" not in file.read()
    except OSError:
        return True  # the thread has ended


@unittest.skipUnless(shutil.which("strace"), "strace is not installed")
class SystemCallsTest(unittest.TestCase):
    def attempt(self, service, method, path, body=None):
        """(status, answer), or None if the connection ended."""
        connection = service.connect(timeout=20)
        answer = None
        try:
            answer = service.ask(method, path, body, connection=connection)
            return answer
        except (http.client.HTTPException, ConnectionError):
            return None
        finally:
            self.failed += answer is None or answer[0] >= 400
            connection.close()

    def expect_refusal(self, answer, also):
        # To the server, a connection that fails while it is read is a body that ends early.
        if answer[0] == 400 and b"the body ended early" in answer[1]:
            return
        self.assertIn(answer[0], (also, 500, 503, 507), answer)

    def work(self, service, number, expected, stored):
        """A bit of everything. Answers with success must be the expected ones."""
        mesh = tetrahedron(number)
        answer = self.attempt(service, "POST", "/v1/trees", mesh)
        if answer and answer[0] in (200, 201, 202):
            stored[json.loads(answer[1])["id"]] = mesh
        elif answer:
            self.expect_refusal(answer, 409)
        for (method, path, body), right in expected.items():
            answer = self.attempt(service, method, path, body)
            if answer and answer[0] == 200:
                self.assertEqual(answer[1], right, path)
            elif answer:
                self.expect_refusal(answer, 408)
        for tree in list(stored)[:1]:
            answer = self.attempt(service, "GET", f"/v1/trees/{tree}/mesh")
            if answer and answer[0] == 200:
                self.assertEqual(answer[1], stored[tree])

    def test_S11_S13_no_failing_system_call_gives_a_wrong_answer_or_ends_the_daemon(self):
        with Service(KDRAYD, "--memory-limit", "64MiB") as service:
            service.upload(bumpy(8))
            tree = service.tree
            questions = [("POST", tree + "/rays/closest", rays(20)), ("GET", tree + "/cells?depth=3", None),
                         ("GET", tree + "/render.npy?mode=depth&width=50&height=40", None),
                         ("GET", tree + "/mesh", None)]
            expected = {question: service.ask(*question)[1] for question in questions}
            stored = {}
            self.failed = 0
            for number, fault in enumerate(FAULTS):
                with self.subTest(fault):
                    with Injection(service, fault):
                        for step in range(STEPS):
                            self.work(service, 1000 * number + step, expected, stored)
                    self.assertIsNone(service.process.poll())
                    for question, right in expected.items():
                        self.assertEqual(service.ask(*question)[1], right)
                    self.assertEqual(service.ask("POST", "/v1/trees", tetrahedron(1000 * number + 999))[0],
                                     201)
            print(f"{self.failed} requests failed, {len(stored)} uploads were acknowledged")
            self.assertGreater(self.failed, len(FAULTS) // 2)
            self.assertEqual(service.stop(), 0)
            self.check_after_a_restart(service, stored)

    def check_after_a_restart(self, service, stored):
        """What was acknowledged is there."""
        restarted = subprocess.Popen([KDRAYD, "--port", "0", "--data-dir", service.folder + "/data"],
                                     stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        try:
            port = int(restarted.stdout.readline().rsplit(":", 1)[1])
            for tree, mesh in stored.items():
                connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
                connection.request("GET", f"/v1/trees/{tree}/mesh")
                answer = connection.getresponse()
                self.assertEqual((answer.status, answer.read()), (200, mesh))
                connection.close()
        finally:
            restarted.terminate()
            restarted.wait()
            restarted.stdout.close()


STEPS = int(os.environ.get("KDRAY_STEPS", "2"))

if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[2:]])
