# SPDX-License-Identifier: Apache-2.0
"""HAProxy with TLS before kdrayd, by the example package/haproxy.cfg: haproxy_test.py KDRAYD KDRAY"""
import http.client
import json
import os
import shutil
import socket
import ssl
import subprocess
import sys
import time
import unittest
import warnings
from pathlib import Path

from daemon import Daemon

KDRAYD, KDRAY = sys.argv[1:3]
EXAMPLE = Path(__file__).resolve().parent.parent.parent / "package/haproxy.cfg"
HAPROXY = shutil.which("haproxy", path=os.environ["PATH"] + ":/usr/sbin")


def free_port():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


class HaproxyTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.daemon = Daemon(KDRAYD)
        cls.addClassCleanup(cls.daemon.close)
        cls.folder = Path(cls.daemon.folder)
        cls.certificate = cls.folder / "certificate.pem"
        subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes",
                        "-days", "2", "-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost",
                        "-keyout", cls.folder / "key.pem", "-out", cls.certificate], check=True, capture_output=True)
        both = cls.folder / "kdray.pem"
        both.write_text(cls.certificate.read_text() + (cls.folder / "key.pem").read_text())
        cls.https, cls.http = free_port(), free_port()
        text = EXAMPLE.read_text()
        for old, new in (("bind :443 ssl crt /etc/haproxy/kdray.pem", f"bind 127.0.0.1:{cls.https} ssl crt {both}"),
                         ("bind :80", f"bind 127.0.0.1:{cls.http}"),
                         # HAProxy 3.0 does not start without two descriptors for each; a container may have 1024.
                         ("maxconn 4096", "maxconn 400"), ("127.0.0.1:8080", cls.daemon.url.split("//")[1])):
            assert text.count(old) >= 1, old
            text = text.replace(old, new)
        config = cls.folder / "haproxy.cfg"
        config.write_text(text)
        checked = subprocess.run([HAPROXY, "-c", "-f", config], capture_output=True, text=True)
        assert checked.returncode == 0 and "WARNING" not in checked.stdout + checked.stderr, checked
        cls.log = open(cls.folder / "haproxy.log", "w+")
        cls.addClassCleanup(cls.log.close)
        cls.proxy = subprocess.Popen([HAPROXY, "-db", "-f", config], stdout=cls.log, stderr=subprocess.DEVNULL)
        cls.addClassCleanup(cls.stop)
        deadline = time.monotonic() + 20
        while True:
            try:
                if cls.get("/readyz").status == 200:
                    break
            except OSError:
                pass
            assert time.monotonic() < deadline, "haproxy does not serve"
            time.sleep(0.05)

    @classmethod
    def stop(cls):
        cls.proxy.terminate()
        cls.proxy.wait(timeout=20)

    @classmethod
    def get(cls, path, context=None):
        context = context or ssl.create_default_context(cafile=cls.certificate)
        connection = http.client.HTTPSConnection("localhost", cls.https, context=context, timeout=30)
        connection.request("GET", path)
        answer = connection.getresponse()
        answer.body = answer.read()
        connection.close()
        return answer

    def kdray(self, *arguments, trusted=True):
        environment = dict(os.environ, KDRAY_SERVER=f"https://localhost:{self.https}")
        if trusted:
            environment["SSL_CERT_FILE"] = str(self.certificate)
        return subprocess.run([KDRAY, *map(str, arguments)], capture_output=True, text=True, timeout=60, env=environment)

    def test_the_command_uploads_and_asks_over_tls(self):
        mesh, rays, hits = (self.folder / name for name in ("teapot.ply", "rays.npy", "hits.npy"))
        self.kdray("sample", "teapot", "-o", mesh)
        self.kdray("sample-rays", "-n", "100000", "-o", rays)
        for arguments in (("upload", mesh), ("rays", mesh, rays, "-o", hits), ("render", mesh, "-o", self.folder / "a.png")):
            done = self.kdray(*arguments)
            self.assertEqual(done.returncode, 0, done.stderr)
        plain = self.folder / "plain.npy"
        done = subprocess.run([KDRAY, "--server", self.daemon.url, "rays", mesh, rays, "-o", plain], capture_output=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(hits.read_bytes(), plain.read_bytes())

    def test_a_certificate_of_an_unknown_authority_is_refused(self):
        done = self.kdray("list", trusted=False)
        self.assertEqual(done.returncode, 3)
        self.assertIn("cannot connect to https://localhost", done.stderr)

    def test_answers_say_that_tls_is_wanted_and_plain_http_is_sent_there(self):
        answer = self.get("/v1")
        self.assertEqual(answer.status, 200)
        self.assertIn("max-age", answer.headers["Strict-Transport-Security"])
        self.assertIsNotNone(answer.headers["X-Request-Id"])
        connection = http.client.HTTPConnection("127.0.0.1", self.http, timeout=30)
        connection.request("GET", "/v1", headers={"Host": "localhost"})
        moved = connection.getresponse()
        self.assertEqual((moved.status, moved.headers["Location"]), (308, "https://localhost/v1"))
        connection.close()

    def test_old_tls_is_refused(self):
        context = ssl.create_default_context(cafile=self.certificate)
        context.set_ciphers("ALL:@SECLEVEL=0")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            context.minimum_version = ssl.TLSVersion.TLSv1
            context.maximum_version = ssl.TLSVersion.TLSv1_1
        with self.assertRaises(OSError):
            self.get("/v1", context)

    def test_a_request_has_the_same_id_and_trace_in_both_logs(self):
        trace = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01"
        done = self.kdray("--traceparent", trace, "list")
        self.assertEqual(done.returncode, 0, done.stderr)
        logs = [self.folder / "haproxy.log", self.folder / "log"]
        deadline = time.monotonic() + 20
        while True:
            lines = [map(json.loads, filter(lambda line: line.startswith("{"), path.read_text().splitlines()))
                     for path in logs]  # HAProxy's notices are no objects
            found = [[line for line in of_one if line.get("trace_id") == trace.split("-")[1]] for of_one in lines]
            if all(found):
                break
            self.assertLess(time.monotonic(), deadline, "a log lacks the trace")
            time.sleep(0.05)
        for key in ("request_id", "parent_id", "method", "path", "status"):
            self.assertEqual(*(lines[0][key] for lines in found))
        answer = self.get("/v1")
        self.assertRegex(answer.headers["X-Request-Id"], "^[0-9a-f-]{36}$")

    def test_errors_of_the_service_pass_unchanged(self):
        answer = self.get("/v1/trees/" + "0" * 64 + "-auto")
        self.assertEqual((answer.status, answer.headers["Content-Type"]), (404, "application/problem+json"))
        self.assertIn(b"tree_not_found", answer.body)


if __name__ == "__main__":
    if HAPROXY is None:
        print("haproxy is not installed")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1], verbosity=2)
