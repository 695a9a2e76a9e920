# SPDX-License-Identifier: Apache-2.0
"""Replicas that share a store: store_test.py KDRAYD KDRAY

Two daemons with `--store` on an S3 in this process (fake_s3.py) get uploads, queries and deletions,
while the store is slow, fails, loses answers, alters bytes, has another time, or is gone.
"""
import datetime
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import unittest
import urllib.parse

import fake_s3
from store_replica import (FAULTS, Replica, check_answers, environment, every_second, large_mesh,
                           mesh, no_fault, within)

KDRAYD = sys.argv[1]
# What the contract states (docs/replicas.md), and something for a busy machine.
DELETION_S = 10
RECOVERY_S = 15


def replica_on(store, prefix="some/prefix", **variables):
    return Replica(KDRAYD, f"s3://{fake_s3.BUCKET}/{prefix}", **{
        "AWS_ACCESS_KEY_ID": fake_s3.KEY_ID, "AWS_SECRET_ACCESS_KEY": fake_s3.SECRET,
        "AWS_ENDPOINT_URL": store.url, **variables})


class StoreTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.store = fake_s3.FakeS3()
        cls.store.start()
        cls.addClassCleanup(cls.store.stop)
        cls.first, cls.second = replica_on(cls.store), replica_on(cls.store)
        for replica in (cls.first, cls.second):
            cls.addClassCleanup(replica.close)
        cls.number = 0

    def setUp(self):
        self.store.fault = no_fault
        type(self).number += 1
        self.mesh = mesh(self.number)
        self.sha = hashlib.sha256(self.mesh).hexdigest()

    def tearDown(self):
        self.assertEqual(self.store.problems, [])

    def keys(self, part):
        return [name for name in self.store.names() if part in name]

    def wait_for_tree(self, sha):
        self.assertTrue(within(20, lambda: self.keys(f"trees/") and any(
            sha in name for name in self.keys("trees/"))))

    def test_what_one_replica_took_the_other_answers_without_a_build(self):
        status, tree = self.first.upload(self.mesh)
        self.assertEqual(status, 201)
        self.assertTrue(self.keys(f"meshes/{self.sha}"), "answered before it is in the bucket")
        self.wait_for_tree(self.sha)
        builds = self.second.metric("kdray_tree_builds_total")
        self.assertEqual(self.second.hits(tree["id"]), self.first.hits(tree["id"]))
        self.assertEqual(self.second.metric("kdray_tree_builds_total"), builds)
        status, _, body = self.second.ask("GET", f"/v1/trees/{tree['id']}/mesh")
        self.assertEqual((status, body), (200, self.mesh))
        status, again = self.second.upload(self.mesh)
        self.assertEqual((status, again["created_at"]), (200, tree["created_at"]))
        status, _, body = self.second.ask("POST", f"/v1/trees?mesh={self.sha}&build=box&wait_ms=60000")
        self.assertEqual(status, 201, body)
        self.assertEqual(self.first.hits(self.sha + "-box"), self.first.hits(tree["id"]))

    def test_a_deletion_holds_everywhere_within_the_stated_time(self):
        _, tree = self.first.upload(self.mesh)
        self.second.hits(tree["id"])
        status, _, _ = self.first.ask("DELETE", f"/v1/trees/{tree['id']}")
        self.assertEqual(status, 204)
        deleted = time.monotonic()
        self.assertEqual(self.first.trace(tree["id"])[0], 404)
        self.assertEqual(self.first.ask("DELETE", f"/v1/trees/{tree['id']}")[0], 404)
        listed = json.loads(self.second.ask("GET", "/v1/trees?mesh=" + self.sha)[2])["trees"]
        self.assertEqual(listed, [], "a list asks the store")
        while time.monotonic() < deleted + DELETION_S:
            self.second.trace(tree["id"])
            time.sleep(0.2)
        self.assertEqual(self.second.trace(tree["id"])[1]["code"], "tree_not_found")
        self.assertEqual(self.keys(f"meshes/{self.sha}"), [])

    def test_lists_page_through_the_trees_of_all_replicas(self):
        ids = []
        for i in range(5):
            status, tree = (self.first, self.second)[i % 2].upload(mesh(1000 + i))
            ids.insert(0, tree["id"])
            time.sleep(0.002)
        for replica in (self.first, self.second):
            listed, after = [], ""
            while after is not None:
                _, _, body = replica.ask("GET", f"/v1/trees?limit=2{after}")
                page = json.loads(body)
                listed += [tree["id"] for tree in page["trees"]]
                after = "&after=" + urllib.parse.quote(page["next"]) if page.get("next") else None
            self.assertEqual([i for i in listed if i in ids], ids)
            self.assertEqual(len(set(listed)), len(listed))

    def test_cached_trees_go_on_while_the_store_is_stopped_and_all_else_recovers(self):
        _, known = self.first.upload(self.mesh)
        _, unknown = self.second.upload(mesh(2000))
        expected = self.first.hits(known["id"])
        self.store.stop()
        wrong, answered = [], 0
        end = time.monotonic() + DELETION_S + 3  # longer than a confirmation lasts
        while time.monotonic() < end:
            start = time.monotonic()
            if self.first.hits(known["id"]) != expected:
                wrong.append(start)
            self.assertLess(time.monotonic() - start, 2.5)
            answered += 1
            time.sleep(0.1)
        self.assertEqual(wrong, [])
        self.assertGreater(answered, 20)
        for method, path, body in (("POST", "/v1/trees", mesh(2001)),
                                   ("GET", f"/v1/trees/{unknown['id']}", None),
                                   ("DELETE", f"/v1/trees/{known['id']}", None),
                                   ("GET", "/v1/trees", None)):
            status, headers, answer = self.first.ask(method, path, body)
            self.assertEqual((status, json.loads(answer)["code"]), (503, "overloaded"), method + path)
            self.assertIn("Retry-After", headers)
            self.assertIn("store", json.loads(answer)["detail"])
        self.assertEqual(self.first.ask("GET", "/readyz")[0], 200)
        self.assertIn("store_away", self.first.log())
        self.store.start()
        self.assertTrue(within(RECOVERY_S, lambda: self.first.trace(unknown["id"])[0] == 200))
        self.assertEqual(self.first.upload(mesh(2001))[0], 201)
        self.assertIn("store_back", self.first.log())
        self.assertEqual(self.first.ask("DELETE", f"/v1/trees/{known['id']}")[0], 204)

    def test_no_fault_of_the_store_makes_an_answer_wrong(self):
        for i, fault in enumerate(FAULTS):
            with self.subTest(fault=fault):
                self.store.fault = every_second(fault)
                check_answers(self, self.first, self.second, mesh(3000 + i))

    def test_a_large_mesh_goes_in_parts(self):
        body = large_mesh(400_000)
        self.assertGreater(len(body), 2 * (8 << 20))
        self.store.fault = every_second(("lose", 0))
        status, tree = self.first.upload(body, "box")
        self.assertEqual(status, 201, tree)
        self.store.fault = no_fault
        sha = hashlib.sha256(body).hexdigest()
        key, = self.keys(f"meshes/{sha}")
        self.assertEqual(self.store.objects[key][0], body)
        parts = {query["partNumber"] for _, name, query in self.store.requests
                 if name == key and "partNumber" in query}
        self.assertEqual(parts, {"1", "2", "3"})
        status, _, answer = self.second.ask("GET", f"/v1/trees/{tree['id']}/mesh")
        self.assertEqual((status, hashlib.sha256(answer).hexdigest()), (200, sha))

    def test_a_clock_that_is_off_is_corrected_by_the_stores(self):
        replica = replica_on(self.store, prefix="clock")
        self.addCleanup(replica.close)

        def refused():
            return sum(code == "RequestTimeTooSkewed" and (key or query["prefix"]).startswith("clock/")
                       for _, key, query, code in self.store.refusals)
        try:
            for number, offset_s in enumerate((3600, -3600, 40 * 86400, 0)):
                with self.subTest(offset_s=offset_s):
                    self.store.clock_offset_s = offset_s
                    before = refused()
                    status, tree = replica.upload(mesh(4000 + number))
                    self.assertEqual(status, 201, tree)
                    # Once for each request that was under way, also beside the upload.
                    self.assertIn(refused() - before, range(1, 5))
                    created = datetime.datetime.fromisoformat(
                        tree["created_at"].replace("Z", "+00:00")).timestamp()
                    self.assertLess(abs(created - time.time() - offset_s), 60, "the store's time")
                    self.assertEqual(replica.ask("DELETE", f"/v1/trees/{tree['id']}")[0], 204)
                    self.assertEqual(replica.trace(tree["id"])[0], 404)
            # An answer to HEAD names no error.
            self.assertEqual(replica.upload(self.mesh)[0], 201)
            self.store.is_strict = lambda method: method == "HEAD"
            self.store.clock_offset_s = -7200
            before = refused()
            self.assertEqual(replica.upload(self.mesh)[0], 200)
            self.assertIn(refused() - before, range(1, 5))
        finally:
            self.store.clock_offset_s = 0
            self.store.is_strict = lambda method: True
        self.assertNotIn("store_away", replica.log())

    def test_a_clock_that_the_store_does_not_tell_is_an_error(self):
        replica = replica_on(self.store)
        self.addCleanup(replica.close)
        _, tree = replica.upload(self.mesh)
        self.store.clock_offset_s, self.store.date_offset_s = 3600, -3600
        try:
            before = len(self.store.requests)
            status, answer = replica.upload(mesh(4100))
            self.assertEqual(status, 503)
            self.assertIn("RequestTimeTooSkewed", answer["detail"])
            self.assertLess(len(self.store.requests), before + 10)
            self.assertEqual(replica.trace(tree["id"])[0], 200)
        finally:
            self.store.clock_offset_s = self.store.date_offset_s = 0
        self.assertTrue(within(RECOVERY_S, lambda: replica.upload(mesh(4100))[0] == 201))

    def test_a_store_without_conditional_writes_is_used_without_them(self):
        self.store.has_conditional_writes = False
        try:
            replica = replica_on(self.store)
            try:
                self.assertEqual(replica.upload(self.mesh, "bvh")[0], 201)
                self.wait_for_tree(self.sha)
            finally:
                replica.close()
        finally:
            self.store.has_conditional_writes = True
        self.first.hits(self.sha + "-bvh")

    def test_a_restart_without_the_store_serves_what_is_cached(self):
        replica = replica_on(self.store, prefix="restart")
        try:
            _, tree = replica.upload(self.mesh)
            expected = replica.hits(tree["id"])
            replica.stop()
            self.store.stop()
            replica.start()
            self.assertEqual(replica.hits(tree["id"]), expected)
            self.store.start()
            self.assertTrue(within(RECOVERY_S, lambda: replica.upload(mesh(5000))[0] == 201))
        finally:
            if self.store._server is None:
                self.store.start()
            replica.close()

    def test_credentials_come_from_the_files_of_aws_and_are_read_again(self):
        folder = tempfile.mkdtemp(prefix="kdray-aws-")
        self.addCleanup(shutil.rmtree, folder)
        credentials = os.path.join(folder, "credentials")
        config = os.path.join(folder, "config")

        def write(token):
            with open(credentials, "w") as file:
                file.write("# a comment\n[default]\naws_access_key_id = wrong\n"
                           "aws_secret_access_key = wrong\n[work]\n"
                           f"aws_access_key_id = {fake_s3.KEY_ID}\n"
                           f"aws_secret_access_key={fake_s3.SECRET}\naws_session_token = {token}\n")
        write("old token")
        with open(config, "w") as file:
            file.write("[profile work]\nregion = eu-central-1\ns3 =\n  max_bandwidth = 1\n"
                       f"endpoint_url = {self.store.url}\n")
        self.store.region, self.store.session_token = "eu-central-1", "old token"
        try:
            replica = replica_on(self.store, AWS_ACCESS_KEY_ID="", AWS_ENDPOINT_URL="",
                              AWS_PROFILE="work", AWS_CONFIG_FILE=config,
                              AWS_SHARED_CREDENTIALS_FILE=credentials)
            self.addCleanup(replica.close)
            self.assertEqual(replica.upload(self.mesh)[0], 201)
            self.store.session_token = "new token"
            self.assertEqual(replica.upload(mesh(6000))[0], 507, "nobody has renewed it")
            write("new token")
            self.assertEqual(replica.upload(mesh(6000))[0], 201)
            self.store.is_strict = lambda method: method == "HEAD"  # which names no error
            self.store.session_token = "third token"
            write("third token")
            self.assertEqual(replica.upload(mesh(6000))[0], 200)
        finally:
            self.store.region, self.store.session_token = "us-east-1", None
            self.store.is_strict = lambda method: True

    def test_a_store_over_tls_is_used_if_its_certificate_is_trusted(self):
        folder = tempfile.mkdtemp(prefix="kdray-tls-")
        self.addCleanup(shutil.rmtree, folder)
        names = [os.path.join(folder, name) for name in ("certificate.pem", "key.pem", "both.pem")]
        subprocess.run(["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2",
                        "-subj", "/CN=127.0.0.1", "-addext", "subjectAltName=IP:127.0.0.1",
                        "-out", names[0], "-keyout", names[1]], check=True, capture_output=True)
        with open(names[2], "w") as both:
            for name in names[:2]:
                with open(name) as file:
                    both.write(file.read())
        with fake_s3.FakeS3() as store:
            store.stop()
            store.certificate = names[2]
            store.start()
            replica = replica_on(store, AWS_CA_BUNDLE=names[0])
            self.addCleanup(replica.close)
            self.assertEqual(replica.upload(self.mesh)[0], 201)
            with self.assertRaisesRegex(RuntimeError, "certificate"):
                replica_on(store)

    def test_a_wrong_start_ends_with_one_line(self):
        def run(*options, **variables):
            folder = tempfile.mkdtemp(prefix="kdray-store-")
            self.addCleanup(shutil.rmtree, folder)
            return subprocess.run(
                [KDRAYD, "--port", "0", "--data-dir", os.path.join(folder, "data"), *options],
                env=environment(**variables), capture_output=True, text=True, timeout=60)
        right = dict(AWS_ACCESS_KEY_ID=fake_s3.KEY_ID, AWS_SECRET_ACCESS_KEY=fake_s3.SECRET,
                     AWS_ENDPOINT_URL=self.store.url)
        for url in ("meshes", "s3://", "s3://AB/x", "s3://meshes//x", "s3://meshes/../x",
                    "http://meshes/x"):
            ended = run("--store", url, **right)
            self.assertEqual(ended.returncode, 2, url)
            self.assertIn("s3://BUCKET", ended.stderr)
        for changes, words in (
                (dict(AWS_SECRET_ACCESS_KEY="wrong"), "SignatureDoesNotMatch"),
                (dict(AWS_ACCESS_KEY_ID="wrong"), "InvalidAccessKeyId"),
                (dict(AWS_ACCESS_KEY_ID=""), "AWS_ACCESS_KEY_ID"),
                (dict(AWS_ENDPOINT_URL="ftp://x"), "endpoint")):
            ended = run("--store", "s3://meshes/x", **{**right, **changes})
            self.assertEqual(ended.returncode, 1, changes)
            self.assertIn(words, ended.stderr)
            self.assertNotIn(fake_s3.SECRET, ended.stderr)
            self.assertEqual(ended.stderr.count("\n"), 1)
        ended = run("--store", "s3://other/x", **right)
        self.assertEqual(ended.returncode, 1)
        self.assertIn("NoSuchBucket", ended.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1] + sys.argv[3:])
