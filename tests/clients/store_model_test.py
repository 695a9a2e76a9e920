# SPDX-License-Identifier: Apache-2.0
"""Two daemons on one store get the same uploads, deletions and queries in random order, while the
store fails at times and daemons are killed: store_model_test.py KDRAYD KDRAY

Every answer is compared with a model of what was acknowledged. KDRAY_SEED chooses the order,
KDRAY_STEPS the length (200). tests/unit/core/library/shared_model_test.cc does the same within one
process, where no time passes.
"""
import collections
import json
import os
import random
import sys
import time
import unittest

import fake_s3
from store_replica import FAULTS, Replica, every_second, mesh, no_fault, within

KDRAYD = sys.argv[1]
SEED = int(os.environ.get("KDRAY_SEED") or 4711)
STEPS = int(os.environ.get("KDRAY_STEPS") or 200)
# A deletion holds on the other replica after 10 s (docs/replicas.md); something for a busy machine.
STALE_S = 11
MESHES, BUILDS = 4, ("auto", "bvh")
ABSENT, THERE, UNKNOWN = "absent", "there", "unknown"


class StoreModelTest(unittest.TestCase):
    def setUp(self):
        print(f"KDRAY_SEED={SEED} KDRAY_STEPS={STEPS}")
        self.random = random.Random(SEED)
        self.store = fake_s3.FakeS3()
        self.store.start()
        self.addCleanup(self.store.stop)
        variables = {"AWS_ACCESS_KEY_ID": fake_s3.KEY_ID, "AWS_SECRET_ACCESS_KEY": fake_s3.SECRET,
                     "AWS_ENDPOINT_URL": self.store.url}
        self.replicas = [Replica(KDRAYD, f"s3://{fake_s3.BUCKET}/model", **variables)
                         for _ in range(2)]
        for replica in self.replicas:
            self.addCleanup(replica.close)
        self.meshes = [mesh(number, size=5) for number in range(MESHES)]
        self.is_faulty = False
        self.counts = collections.Counter()
        # By id: its state, and until when each replica may still answer for it.
        self.state, self.stale, self.mesh_of, self.hits = {}, {}, {}, {}
        for bytes_of_mesh in self.meshes:
            for build in BUILDS:
                status, tree = self.replicas[0].upload(bytes_of_mesh, build)
                self.assertEqual(status, 201, tree)
                self.mesh_of[tree["id"]] = bytes_of_mesh
                self.hits[tree["id"]] = self.replicas[0].hits(tree["id"])
                self.state[tree["id"]], self.stale[tree["id"]] = THERE, [0, 0]
        self.ids = list(self.state)

    def note(self, what, status):
        self.counts[what, status] += 1

    def failed(self, tree, status, answer):
        """A write that failed may have been carried out."""
        self.assertIn(status, (503, 507), answer)
        self.assertTrue(self.is_faulty, answer)
        self.state[tree] = UNKNOWN

    def upload(self, at, tree):
        status, answer = self.replicas[at].upload(self.mesh_of[tree], tree[65:])
        self.note("upload", status)
        if status not in (200, 201):
            return self.failed(tree, status, answer)
        self.assertEqual(answer["id"], tree)
        if self.state[tree] != UNKNOWN and not self.is_faulty:
            self.assertEqual(status, 200 if self.state[tree] == THERE else 201)
        self.state[tree] = THERE

    def build(self, at, tree):
        others = [self.state[other] for other in self.ids if other[:64] == tree[:64]]
        status, _, body = self.replicas[at].ask(
            "POST", f"/v1/trees?mesh={tree[:64]}&build={tree[65:]}&wait_ms=60000")
        self.note("build", status)
        if status in (200, 201):
            self.assertNotEqual(set(others), {ABSENT})
            self.state[tree] = THERE
        elif status == 404:
            self.assertNotIn(THERE, others, "an acknowledged mesh is lost")
        else:
            self.failed(tree, status, body)

    def delete(self, at, tree):
        status, _, body = self.replicas[at].ask("DELETE", f"/v1/trees/{tree}")
        self.note("delete", status)
        if status == 204:
            self.assertNotEqual(self.state[tree], ABSENT)
        elif status == 404:
            # Of a deletion whose answers were lost, the repetition may find nothing.
            self.assertTrue(self.state[tree] != THERE or self.is_faulty)
        else:
            return self.failed(tree, status, body)
        if self.state[tree] != ABSENT:
            self.stale[tree] = [time.monotonic() + STALE_S] * 2
        self.stale[tree][at] = 0
        self.state[tree] = ABSENT

    def query(self, at, tree):
        asked = time.monotonic()
        status, answer = self.replicas[at].trace(tree)
        self.note("query", status)
        if status == 200:
            self.assertTrue(self.state[tree] != ABSENT or asked < self.stale[tree][at]
                            or self.is_faulty, "deleted, and still answered")
            self.assertEqual(answer.get("hits", answer), self.hits[tree])
        elif status == 404:
            self.assertNotEqual(self.state[tree], THERE, "an acknowledged mesh is lost")
        else:
            self.assertTrue(self.is_faulty, answer)

    def read_mesh(self, at, tree):
        asked = time.monotonic()
        status, _, body = self.replicas[at].ask("GET", f"/v1/trees/{tree}/mesh")
        self.note("mesh", status)
        if status == 200:
            self.assertEqual(body, self.mesh_of[tree])
            self.assertTrue(self.state[tree] != ABSENT or asked < self.stale[tree][at]
                            or self.is_faulty)
        elif status == 404:
            self.assertNotEqual(self.state[tree], THERE)
        else:
            self.assertTrue(self.is_faulty, body)

    def list(self, at, _):
        status, _, body = self.replicas[at].ask("GET", "/v1/trees?limit=100")
        self.note("list", status)
        if status != 200:
            return self.assertTrue(self.is_faulty, body)
        listed = [tree["id"] for tree in json.loads(body)["trees"]]
        self.assertEqual(len(set(listed)), len(listed))
        for tree, state in self.state.items():
            if state != UNKNOWN:
                self.assertEqual(tree in listed, state == THERE, tree)

    def step(self):
        at, tree = self.random.randrange(2), self.random.choice(self.ids)
        kind = self.random.random()
        if kind < 0.005:
            self.replicas[at].kill()
            self.replicas[at].start()
        elif kind < 0.04:  # nothing answers, so this replica takes the store for away
            self.is_faulty, self.store.fault = True, lambda method, key, query: ("drop", 0)
        elif kind < 0.25:
            self.is_faulty, self.store.fault = True, every_second(self.random.choice(FAULTS))
        names = ("upload", "build", "delete", "query", "read_mesh", "list")
        name, = self.random.choices(names, (3, 1, 3, 6, 1, 1))
        getattr(self, name)(at, tree)
        if self.is_faulty:
            self.store.fault = no_fault
            for replica in self.replicas:
                self.assertTrue(within(15, lambda: replica.ask("GET", "/v1/trees?limit=1")[0] == 200))
            self.is_faulty = False

    def test_no_answer_is_wrong_and_no_acknowledged_mesh_is_lost(self):
        start = time.monotonic()
        for number in range(STEPS):
            try:
                self.step()
            except AssertionError as error:
                raise AssertionError(f"step {number}: {error}") from error
        for at in (0, 1):
            self.list(at, None)
            for tree in self.ids:
                self.query(at, tree)
                self.read_mesh(at, tree)
        self.assertEqual(self.store.problems, [])
        print(f"{STEPS} steps in {time.monotonic() - start:.0f} s:", ", ".join(
            f"{name} {status}: {count}" for (name, status), count in sorted(self.counts.items())))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
