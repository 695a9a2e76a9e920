# SPDX-License-Identifier: Apache-2.0
"""Uploads as clients send them, chunked and compressed: uploads_test.py KDRAYD KDRAY

Python's standard library, requests, curl and Node each send one mesh in their own way, and must get the tree id that
follows from its bytes. What is not installed is left out.
"""
import gzip
import hashlib
import http.client
import importlib.util
import json
import os
import shutil
import subprocess
import sys
import unittest
import urllib.error
import urllib.parse
import urllib.request

from daemon import Daemon

KDRAYD, KDRAY = sys.argv[1:3]

NODE = """
const fs = require('fs');
fetch(process.argv[1], {method: 'POST', body: fs.createReadStream(process.argv[2]), duplex: 'half'})
    .then((answer) => answer.text()).then((text) => console.log(text));
"""


def needs(program):
    return unittest.skipUnless(shutil.which(program), f"{program} is not installed")


class UploadsTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.daemon = Daemon(KDRAYD)
        cls.addClassCleanup(cls.daemon.close)
        cls.url = cls.daemon.url + "/v1/trees"
        cls.mesh = os.path.join(cls.daemon.folder, "teapot.obj")
        subprocess.run([KDRAY, "-q", "sample", "teapot", "-o", cls.mesh], check=True)
        with open(cls.mesh, "rb") as file:
            cls.bytes = file.read()
        cls.id = hashlib.sha256(cls.bytes).hexdigest() + "-auto"

    def check(self, answer):
        self.assertEqual(json.loads(answer)["id"], self.id)

    def pieces(self, size=5000):
        for start in range(0, len(self.bytes), size):
            yield self.bytes[start:start + size]

    def post(self, body, headers=None):
        """(status, answer) of http.client, which sends chunks for an iterable."""
        connection = http.client.HTTPConnection(urllib.parse.urlsplit(self.url).netloc, timeout=60)
        try:
            connection.request("POST", "/v1/trees", body, headers or {})
            answer = connection.getresponse()
            return answer.status, json.loads(answer.read())
        finally:
            connection.close()

    def test_urlopen_sends_an_open_file(self):
        with open(self.mesh, "rb") as file, urllib.request.urlopen(self.url, file) as answer:
            self.check(answer.read())

    def test_http_client_sends_a_generator_and_keeps_the_connection(self):
        connection = http.client.HTTPConnection(urllib.parse.urlsplit(self.url).netloc, timeout=60)
        for size in (100_000, 5000, 37):
            connection.request("POST", "/v1/trees", self.pieces(size))
            self.check(connection.getresponse().read())
        connection.request("GET", "/v1")
        self.assertEqual(connection.getresponse().status, 200)
        connection.close()

    @unittest.skipUnless(importlib.util.find_spec("requests"), "requests is not installed")
    def test_requests_sends_a_generator(self):
        import requests
        self.check(requests.post(self.url, data=self.pieces(), timeout=60).text)

    @needs("node")
    def test_node_sends_a_stream(self):
        done = subprocess.run(["node", "-e", NODE, self.url, self.mesh], capture_output=True, text=True, timeout=60)
        self.check(done.stdout)

    @needs("curl")
    def test_curl_sends_what_it_reads(self):
        with open(self.mesh, "rb") as file:
            done = subprocess.run(["curl", "-s", "-X", "POST", "-T", "-", self.url], stdin=file, check=True,
                                  capture_output=True, text=True, timeout=60)
        self.check(done.stdout)

    def test_a_batch_may_be_chunked_too(self):
        self.post(self.bytes)
        rays = b'{"rays": [[0, 10, 0, 0, -1, 0]]}'
        url = f"{self.url}/{self.id}/rays/closest"
        with urllib.request.urlopen(url, rays) as plain:
            expected = plain.read()
        chunked = urllib.request.Request(url, iter([rays[:7], rays[7:]]), {"Content-Type": "application/json"})
        with urllib.request.urlopen(chunked) as answer:
            self.assertEqual(answer.read(), expected)

    def test_gzip_is_undone(self):
        compressed = gzip.compress(self.bytes)
        for body in (compressed, gzip.compress(self.bytes[:1000]) + gzip.compress(self.bytes[1000:]),
                     iter([compressed[:1], compressed[1:5000], compressed[5000:]])):
            status, answer = self.post(body, {"Content-Encoding": "gzip"})
            self.assertIn(status, (200, 201))
            self.assertEqual(answer["id"], self.id)
            self.assertEqual(answer["mesh"]["bytes"], len(self.bytes))
        with urllib.request.urlopen(f"{self.url}/{self.id}/mesh") as mesh:
            self.assertEqual(mesh.read(), self.bytes)

    @needs("zstd")
    def test_zstd_is_undone(self):
        for options in (["-1"], ["-19"], ["-3", "--check"]):
            body = subprocess.run(["zstd", "-q", "-c", *options, self.mesh], check=True, capture_output=True).stdout
            status, answer = self.post(body, {"Content-Encoding": "zstd"})
            self.assertEqual((status in (200, 201), answer["id"]), (True, self.id))
        wide = subprocess.run(["zstd", "-q", "-c", "--long=27", "-"], input=self.bytes, check=True,
                              capture_output=True).stdout
        status, answer = self.post(wide, {"Content-Encoding": "zstd"})
        self.assertEqual((status, answer["code"]), (415, "unsupported_encoding"))

    def test_damage_and_bombs_are_refused(self):
        whole = gzip.compress(self.bytes)
        for body, status, code in ((whole[:-9], 400, "malformed_request"), (whole + b"x", 400, "malformed_request"),
                                   (self.bytes, 400, "malformed_request"),
                                   (gzip.compress(bytes(64 << 20)), 413, "mesh_too_large")):
            refused = self.post(body, {"Content-Encoding": "gzip"})
            self.assertEqual((refused[0], refused[1]["code"]), (status, code))
        status, problem = self.post(whole, {"Content-Encoding": "br"})
        self.assertEqual((status, problem["code"]), (415, "unsupported_encoding"))
        self.assertIn("gzip and zstd", problem["detail"])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
