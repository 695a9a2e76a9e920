# SPDX-License-Identifier: Apache-2.0
"""The Python package kdray against servers that misbehave: python_transport_test.py"""
import contextvars
import io
import os
import re
import shutil
import socket
import ssl
import subprocess
import sys
import tempfile
import threading
import time
import unittest
from pathlib import Path
from unittest import mock

import numpy as np

from scripted_server import ScriptedServer, answer, hang_up, say, say_before_the_body_and_close

sys.path.insert(0, str(Path(__file__).resolve().parent.parent.parent / "clients/python"))
import kdray  # noqa: E402

ID = "a" * 64 + "-auto"
TRACE = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01"
TREE = {"id": ID, "state": "ready", "progress": 1, "mesh": {"sha256": "a" * 64, "bytes": 1}}
INFO = {
    "name": "kdray",
    "limits": {"max_rays": 10, "max_answer_hits": 160, "max_upload_bytes": 1 << 40},
}
BUSY = {"code": "overloaded", "detail": "too much work"}


def hits(count):
    """An answer of `count` numbers."""
    content = io.BytesIO()
    np.save(content, np.zeros(count))
    return content.getvalue()


class PythonTransportTest(unittest.TestCase):
    def ask(self, *steps, **options):
        server = ScriptedServer(*steps)
        self.addCleanup(server.__exit__)
        client = kdray.Client(server.url, **options)
        self.addCleanup(client.close)
        return server, client

    def test_requests_share_one_connection(self):
        server, client = self.ask(*[say(200, TREE)] * 5)
        for _ in range(5):
            self.assertEqual(client.tree(ID).id, ID)
        self.assertEqual(server.connections, 1)
        self.assertIn("User-Agent: kdray-python/", server.requests[0])

    def test_a_connection_that_the_server_closed_meanwhile_is_replaced(self):
        server, client = self.ask(
            say(200, TREE, keep=False), say(200, TREE, keep=False), say(200, TREE)
        )
        for _ in range(3):
            self.assertEqual(client.tree(ID).id, ID)
            time.sleep(0.02)
        self.assertEqual((server.connections, len(server.requests)), (3, 3))

    def test_an_answer_that_ends_the_connection_is_heeded(self):
        server, client = self.ask(say(200, TREE, headers=["Connection: close"]), say(200, TREE))
        client.tree(ID)
        client.tree(ID)
        self.assertEqual(server.connections, 2)

    def test_a_broken_connection_repeats_the_request_a_few_times(self):
        server, client = self.ask(
            hang_up, say(200, TREE, declared=5000, keep=False), say(200, TREE)
        )
        self.assertEqual(client.tree(ID).id, ID)
        self.assertEqual(len(server.requests), 3)
        server, client = self.ask(*[hang_up] * 10)
        with self.assertRaisesRegex(kdray.ConnectionFailed, f"cannot reach {server.url}"):
            client.tree(ID)
        self.assertEqual(len(server.requests), 4)
        server, client = self.ask(hang_up, say(200, TREE), retry_s=0)
        with self.assertRaises(kdray.ConnectionFailed):
            client.tree(ID)
        self.assertEqual(len(server.requests), 1)

    def test_a_wrong_address_fails_at_once(self):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            url = "http://127.0.0.1:%d" % free.getsockname()[1]
            began = time.monotonic()
            with self.assertRaisesRegex(kdray.ConnectionFailed, "Connection refused"):
                kdray.Client(url).info
            self.assertLess(time.monotonic() - began, 1)
            with self.assertRaises(ConnectionError):  # what Python's users catch
                kdray.Client(url).info
        for url in ("127.0.0.1:8080", "ftp://host", "http://", "http://h?x=1", "http://u:p@h"):
            with self.assertRaises(ValueError):
                kdray.Client(url)
        for options in (
            {"parallel": 0},
            {"retry_s": -1},
            {"stall_s": 0},
            {"token": "a b"},
            {"token": "a\nb"},
        ):
            with self.assertRaises(ValueError):
                kdray.Client("http://127.0.0.1", **options)

    def test_a_busy_server_is_asked_again_when_it_says(self):
        server, client = self.ask(
            say(503, BUSY, headers=["Retry-After: 0"]),
            say(503, b"<html>", headers=["Retry-After: 0"]),
            say(409, {"code": "tree_building"}, headers=["Retry-After: 0"]),
            say(200, TREE),
        )
        self.assertEqual(client.tree(ID).id, ID)
        self.assertEqual((server.connections, len(server.requests)), (1, 4))
        server, client = self.ask(say(503, BUSY, headers=["Retry-After: 5"]), retry_s=1)
        with self.assertRaises(kdray.Problem) as refused:
            client.tree(ID)
        self.assertEqual((refused.exception.status, refused.exception.code), (503, "overloaded"))

    def test_a_refusal_is_not_repeated(self):
        for status in (400, 401, 404, 413, 422, 500, 504, 507):
            server, client = self.ask(
                say(status, {"code": "a_new_code", "detail": "no"}), say(200, TREE)
            )
            with self.assertRaises(kdray.Problem) as refused:
                client.tree(ID)
            self.assertEqual(
                (refused.exception.status, refused.exception.code), (status, "a_new_code")
            )
            self.assertEqual(len(server.requests), 1)

    def test_another_servers_page_is_a_problem_too(self):
        for content in (b"<h1>Bad\n gateway</h1>", b"", b"[1]", b"\xff\xfe"):
            _, client = self.ask(say(403, content))
            with self.assertRaises(kdray.Problem) as refused:
                client.tree(ID)
            self.assertEqual((refused.exception.status, refused.exception.code), (403, "unknown"))
            self.assertTrue(refused.exception.detail)

    def test_a_reason_that_comes_before_the_body_was_sent_is_read(self):
        early = say_before_the_body_and_close(413, {"code": "mesh_too_large", "detail": "too much"})
        _, client = self.ask(say(404, {}), say(404, {}), say(200, INFO), early)
        with self.assertRaises(kdray.Problem) as refused:
            client.upload(bytes(30 << 20))
        self.assertEqual(refused.exception.code, "mesh_too_large")

    def test_a_silent_server_is_given_up(self):
        release = threading.Event()
        self.addCleanup(release.set)
        server, client = self.ask(lambda connection: release.wait(20), stall_s=0.2)
        with self.assertRaisesRegex(kdray.ConnectionFailed, "silent for too long"):
            client.tree(ID)
        self.assertEqual(len(server.requests), 1)

    def test_a_deletion_whose_answer_was_lost_is_done(self):
        gone = say(404, {"code": "tree_not_found"})
        for lost in ([hang_up], [hang_up, hang_up]):  # on a kept connection, and on a new one
            server, client = self.ask(say(200, TREE), *lost, gone, gone)
            tree = client.tree(ID)
            tree.delete()
            with self.assertRaises(kdray.Problem):
                tree.delete()

    def test_a_part_of_a_batch_is_repeated_alone_and_keeps_its_place(self):
        # One request at a time: the second part's connection breaks, the third meets a busy server.
        server, client = self.ask(
            say(200, TREE),
            say(200, INFO),
            say(200, hits(8)),
            hang_up,
            say(200, hits(8)),
            say(503, BUSY, headers=["Retry-After: 0"]),
            say(200, hits(8)),
            parallel=1,
        )
        answer = client.tree(ID).closest(np.ones((24, 6)), "t")
        self.assertEqual(answer.shape, (24,))
        self.assertEqual(len(server.requests), 7)

    def test_a_batch_that_is_given_up_closes_its_connections(self):
        closed = threading.Event()

        def work(connection):
            connection.settimeout(20)
            if not connection.recv(1):
                closed.set()

        _, client = self.ask(
            say(200, TREE), say(200, INFO), work, say(400, {"code": "invalid_array"}), parallel=2
        )
        began = time.monotonic()
        with self.assertRaises(kdray.Problem):
            client.tree(ID).closest(np.ones((20, 6)), "t")
        self.assertTrue(closed.wait(5))
        self.assertLess(time.monotonic() - began, 5)

    @unittest.skipUnless(shutil.which("openssl"), "openssl is not installed")
    def headers_of(self, server, name):
        """The values of a header in the requests, in order; None where it is absent."""
        found = (re.search(rf"^{name}: (.*?)\r$", head, re.MULTILINE | re.IGNORECASE)
                 for head in server.requests)
        return [match and match[1] for match in found]

    def test_repetitions_keep_the_id_of_their_request_and_errors_name_it(self):
        busy = say(503, BUSY, headers=["Retry-After: 0"])
        server, client = self.ask(say(200, TREE), hang_up, busy, say(200, TREE), say(200, TREE))
        client.tree(ID)
        client.tree(ID)
        client.tree(ID)
        ids = self.headers_of(server, "X-Request-Id")
        self.assertRegex(ids[0], "^kdray-[0-9a-f]{12}$")
        self.assertEqual(len(ids), 5)
        self.assertEqual(ids[1:4], [ids[1]] * 3)
        self.assertEqual(len(set(ids)), 3)
        server, client = self.ask(*[hang_up] * 5, retry_s=0)
        with self.assertRaisesRegex(kdray.ConnectionFailed, "request kdray-[0-9a-f]{12}") as failed:
            client.tree(ID)
        self.assertIn(self.headers_of(server, "X-Request-Id")[0], str(failed.exception))

    def test_the_trace_of_the_caller_goes_with_every_request(self):
        def traces(count, **options):
            server, client = self.ask(*[say(200, TREE)] * count, **options)
            for _ in range(count):
                client.tree(ID)
            return self.headers_of(server, "traceparent")

        with mock.patch.dict(os.environ):
            os.environ.pop("TRACEPARENT", None)
            self.assertEqual(traces(1), [None])
            self.assertEqual(traces(2, traceparent=TRACE), [TRACE] * 2)
            given = iter([TRACE, None, "what is no trace\r\nX-Evil: 1"])
            self.assertEqual(traces(3, traceparent=lambda: next(given)), [TRACE, None, None])
            for wrong in ("", "00-1-2-3", TRACE + "\n", TRACE.replace("4bf", "4BF"),
                          f"00-{'0' * 32}-{'1' * 16}-01", f"00-{'1' * 32}-{'0' * 16}-01"):
                with self.assertRaisesRegex(ValueError, "traceparent"):
                    kdray.Client("http://127.0.0.1", traceparent=wrong)
            os.environ["TRACEPARENT"] = TRACE
            self.assertEqual(traces(1), [TRACE])
            self.assertEqual(traces(1, traceparent=lambda: None), [None])
            os.environ["TRACEPARENT"] = "another program's"
            self.assertEqual(traces(1), [None])

    def test_the_parts_of_a_batch_are_of_the_callers_trace(self):
        present = contextvars.ContextVar("present", default=None)
        server, client = self.ask(
            say(200, TREE), say(200, INFO), *[say(200, hits(8))] * 3,
            traceparent=lambda: present.get(),
        )
        tree = client.tree(ID)
        present.set(TRACE)
        tree.closest(np.ones((24, 6)), "t")
        self.assertEqual(self.headers_of(server, "traceparent"), [None] + [TRACE] * 4)
        self.assertEqual(len(set(self.headers_of(server, "X-Request-Id"))), 5)

    def test_https_checks_the_certificate(self):
        with tempfile.TemporaryDirectory() as folder:
            key, certificate = f"{folder}/key.pem", f"{folder}/certificate.pem"
            subprocess.run(
                ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "1"]
                + ["-subj", "/CN=127.0.0.1", "-addext", "subjectAltName=IP:127.0.0.1"]
                + ["-keyout", key, "-out", certificate],
                check=True,
                capture_output=True,
            )
            tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            tls.load_cert_chain(certificate, key)
            trusting = ssl.create_default_context(cafile=certificate)
        with ScriptedServer(say(200, TREE), say(200, TREE), tls=tls) as server:
            with self.assertRaisesRegex(kdray.ConnectionFailed, "CERTIFICATE_VERIFY_FAILED"):
                kdray.Client(server.url).tree(ID)
            with kdray.Client(server.url, ssl_context=trusting) as client:
                self.assertEqual([client.tree(ID).id for _ in range(2)], [ID, ID])
            self.assertEqual(server.connections, 2)

    def test_a_path_in_the_address_stands_before_every_request(self):
        server, client = self.ask(say(200, TREE))
        prefixed = kdray.Client(server.url + "/rays/", token="sesame")
        self.addCleanup(prefixed.close)
        prefixed.tree(ID)
        self.assertTrue(server.requests[0].startswith(f"GET /rays/v1/trees/{ID} HTTP/1.1\r\n"))
        self.assertIn("Authorization: Bearer sesame\r\n", server.requests[0])
        self.assertEqual(answer(204), b"HTTP/1.1 204 Scripted\r\nContent-Length: 0\r\n\r\n")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
