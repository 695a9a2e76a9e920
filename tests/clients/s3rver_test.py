# SPDX-License-Identifier: Apache-2.0
"""Replicas that share a bucket of s3rver, through a proxy with faults: s3rver_test.py KDRAYD KDRAY
FOLDER

s3rver is an S3 for tests by others. npm installs it into FOLDER. Exits with 77 (skipped) without
npm or its registry.
"""
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import unittest
from pathlib import Path

from fault_proxy import FaultProxy
from store_replica import FAULTS, Replica, check_answers, every_second, large_mesh, mesh, no_fault

KDRAYD, FOLDER = sys.argv[1], os.path.abspath(sys.argv[3])
PACKAGES = {"s3rver": "3.7.1"}


def skip(reason):
    print(f"{reason}; nothing is tried with s3rver")
    sys.exit(77)


def install():
    if not shutil.which("npm") or not shutil.which("node"):
        skip("npm is not installed")
    os.makedirs(FOLDER, exist_ok=True)
    manifest = json.dumps({"private": True, "dependencies": PACKAGES})
    mark = Path(FOLDER, "installed.json")
    if mark.exists() and mark.read_text() == manifest:
        return
    Path(FOLDER, "package.json").write_text(manifest)
    ended = subprocess.run(["npm", "install", "--no-audit", "--no-fund", "--ignore-scripts",
                            "--no-package-lock", "--fetch-retries", "0"],
                           cwd=FOLDER, capture_output=True, text=True)
    if ended.returncode:
        print(ended.stderr[-1000:])
        skip("npm could not install s3rver")
    mark.write_text(manifest)


class S3rverTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.mkdtemp(prefix="kdray-s3rver-")
        cls.addClassCleanup(shutil.rmtree, folder, ignore_errors=True)
        cls.server = subprocess.Popen(
            [os.path.join(FOLDER, "node_modules/.bin/s3rver"), "--directory", folder, "--address",
             "127.0.0.1", "--port", "0", "--configure-bucket", "meshes"],
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
            # The tokens of its lists are encrypted by a method that newer OpenSSL has aside.
            env=dict(os.environ, NODE_OPTIONS="--openssl-legacy-provider"))
        cls.addClassCleanup(cls.server.wait)
        cls.addClassCleanup(cls.server.terminate)
        port = None
        while port is None:
            line = cls.server.stdout.readline()
            if not line:
                raise RuntimeError("s3rver did not start")
            port = re.search(r"listening on .*:(\d+)", line)
        # Whatever it logs is read, so it never waits for its reader.
        threading.Thread(target=cls.server.stdout.read, daemon=True).start()
        cls.proxy = FaultProxy(int(port[1]))
        cls.addClassCleanup(cls.proxy.__exit__)
        cls.replicas = []
        for _ in range(2):
            cls.replicas.append(Replica(
                KDRAYD, "s3://meshes/a/prefix", AWS_ACCESS_KEY_ID="S3RVER",
                AWS_SECRET_ACCESS_KEY="S3RVER", AWS_ENDPOINT_URL=cls.proxy.url))
            cls.addClassCleanup(cls.replicas[-1].close)

    def test_uploads_queries_lists_and_deletions(self):
        first, second = self.replicas
        ids = [first.upload(mesh(i))[1]["id"] for i in range(3)]
        for tree in ids:
            self.assertEqual(second.hits(tree), first.hits(tree))
        listed, after = [], ""
        while after is not None:
            status, _, body = second.ask("GET", f"/v1/trees?limit=1{after}")
            page = json.loads(body)
            self.assertEqual(status, 200, page)
            listed += [tree["id"] for tree in page["trees"]]
            after = f"&after={page['next']}" if page.get("next") else None
        self.assertEqual([tree for tree in listed if tree in ids], ids[::-1])
        self.assertEqual(first.ask("DELETE", f"/v1/trees/{ids[0]}")[0], 204)
        self.assertEqual(first.trace(ids[0])[0], 404)

    def test_no_fault_makes_an_answer_wrong(self):
        try:
            for i, fault in enumerate(FAULTS):
                with self.subTest(fault=fault):
                    self.proxy.fault = every_second(fault)
                    check_answers(self, *self.replicas, mesh(100 + i))
        finally:
            self.proxy.fault = no_fault

    def test_a_mesh_in_parts(self):
        body = large_mesh(400_000)
        status, tree = self.replicas[0].upload(body, "box")
        self.assertEqual(status, 201, tree)
        status, _, answer = self.replicas[1].ask("GET", f"/v1/trees/{tree['id']}/mesh")
        self.assertEqual((status, hashlib.sha256(answer).hexdigest()),
                         (200, hashlib.sha256(body).hexdigest()))


if __name__ == "__main__":
    install()
    unittest.main(argv=sys.argv[:1])
