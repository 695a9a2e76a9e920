# SPDX-License-Identifier: Apache-2.0
"""Two daemons under load, whose store is gone for a while: store_outage_test.py KDRAYD KDRAY

The store (fake_s3.py) refuses connections, or takes requests and answers none, each for
KDRAY_OUTAGE_S seconds (5). Cached trees must be answered, rightly and soon; all else rightly, or
with 503 or 507; and all must go on by itself. Prints what it counted and measured.
"""
import collections
import json
import os
import sys
import threading
import time
import unittest

import fake_s3
from store_replica import Replica, mesh, within

KDRAYD = sys.argv[1]
OUTAGE_S = float(os.environ.get("KDRAY_OUTAGE_S") or 5)
CACHED = 4
# What the documentation states, and something for a busy machine.
SOON_S, RECOVERY_S = 2.5, 15


class Load:
    """Threads that ask both replicas, each in a loop: what they got, by phase."""

    def __init__(self, replicas, cached, hits):
        self.replicas, self.cached, self.hits = replicas, cached, hits
        self.phase = "before"
        self.counts = collections.Counter()  # (phase, kind, status)
        self.seconds = collections.defaultdict(list)  # of queries of cached trees, by phase
        self.wrong = []
        self.there, self.deleted = {}, set()  # id -> mesh; what was acknowledged
        self.first = {}  # (phase, kind, replica) -> the time of the first success
        self._number = 10_000
        self._lock = threading.Lock()
        self._end = threading.Event()
        self._threads = [threading.Thread(target=self._run, args=(work, at)) for at in (0, 1)
                         for work in (self._query, self._query, self._change, self._look)]
        for thread in self._threads:
            thread.start()

    def stop(self):
        self._end.set()
        for thread in self._threads:
            thread.join()

    def _run(self, work, at):
        step = 0
        while not self._end.is_set():
            try:
                work(at, step)
            except Exception as error:  # a connection that broke is a wrong answer as well
                self._note_wrong(repr(error))
            step += 1

    def _note_wrong(self, what):
        with self._lock:
            self.wrong.append(f"{self.phase}: {what}")

    def _note(self, phase, kind, at, status, headers, body, right):
        with self._lock:
            self.counts[phase, kind, status] += 1
            if status in right:
                self.first.setdefault((phase, kind, at), time.monotonic())
        if status in right:
            return True
        refused = status in (503, 507)
        if not refused or (status == 503 and "Retry-After" not in headers):
            self._note_wrong(f"{kind} {status} {body[:200]}")
        return False

    def _query(self, at, step):
        tree = self.cached[step % CACHED]
        phase, start = self.phase, time.monotonic()
        status, answer = self.replicas[at].trace(tree)
        with self._lock:
            self.seconds[phase].append(time.monotonic() - start)
            self.counts[phase, "cached", status] += 1
        if status != 200 or answer.get("hits", answer) != self.hits[tree]:
            self._note_wrong(f"cached {status} {str(answer)[:200]}")
        time.sleep(0.01)

    def _change(self, at, step):
        """Uploads, and deletes what this thread has uploaded."""
        with self._lock:
            self._number += 1
            bytes_of_mesh = mesh(self._number, size=5)
        phase = self.phase
        status, headers, body = self.replicas[at].ask(
            "POST", "/v1/trees?wait_ms=60000", bytes_of_mesh)
        if self._note(phase, "upload", at, status, headers, body, (200, 201)):
            tree = json.loads(body)["id"]
            with self._lock:
                self.there[tree] = bytes_of_mesh
            if step % 2:
                phase = self.phase
                with self._lock:
                    del self.there[tree]  # a deletion that is not answered may be carried out
                status, headers, body = self.replicas[at].ask("DELETE", f"/v1/trees/{tree}")
                if self._note(phase, "delete", at, status, headers, body, (204,)):
                    with self._lock:
                        self.deleted.add(tree)
        time.sleep(0.02)

    def _look(self, at, step):
        """Lists, and asks for trees of the other replica and for one that no replica has."""
        with self._lock:
            others = list(self.there)
        phase = self.phase
        if step % 3 == 0:
            status, headers, body = self.replicas[at].ask("GET", "/v1/trees?limit=3")
            self._note(phase, "list", at, status, headers, body, (200,))
        elif step % 3 == 1:
            unknown = f"{self._number * 7919 + step:064x}-auto"
            status, headers, body = self.replicas[at].ask("GET", f"/v1/trees/{unknown}")
            self._note(phase, "unknown", at, status, headers, body, (404,))
        elif others:
            tree = others[step % len(others)]
            status, headers, body = self.replicas[at].ask("GET", f"/v1/trees/{tree}")
            # It may be deleted meanwhile.
            if status == 404 and tree not in self.there:
                return
            self._note(phase, "other's", at, status, headers, body, (200,))
        time.sleep(0.02)


class StoreOutageTest(unittest.TestCase):
    def setUp(self):
        self.store = fake_s3.FakeS3()
        self.store.start()
        self.addCleanup(self.store.stop)
        variables = {"AWS_ACCESS_KEY_ID": fake_s3.KEY_ID, "AWS_SECRET_ACCESS_KEY": fake_s3.SECRET,
                     "AWS_ENDPOINT_URL": self.store.url}
        self.replicas = [Replica(KDRAYD, f"s3://{fake_s3.BUCKET}/outage", **variables)
                         for _ in range(2)]
        for replica in self.replicas:
            self.addCleanup(replica.close)
        cached = [self.replicas[0].upload(mesh(i))[1]["id"] for i in range(CACHED)]
        hits = {tree: self.replicas[0].hits(tree) for tree in cached}
        self.assertEqual(hits, {tree: self.replicas[1].hits(tree) for tree in cached})
        self.load = Load(self.replicas, cached, hits)
        self.addCleanup(self.load.stop)

    def run_outage(self, name, begin, end):
        load, kinds = self.load, ("upload", "delete", "list", "unknown", "other's")
        time.sleep(1)
        begin()
        load.phase = "outage"
        time.sleep(OUTAGE_S)
        away = [replica.metric("kdray_shared_store_away") for replica in self.replicas]
        end()
        back = time.monotonic()
        load.phase = "after"
        recovered = within(RECOVERY_S, lambda: all(
            ("after", kind, at) in load.first for kind in kinds for at in (0, 1)))
        time.sleep(0.5)
        load.stop()
        self.report(name, back)
        self.assertEqual(load.wrong, [])
        self.assertTrue(recovered, load.first)
        for phase in ("before", "outage", "after"):
            self.assertGreater(len(load.seconds[phase]), 20)
            self.assertLess(max(load.seconds[phase]), SOON_S)
        for tree, bytes_of_mesh in load.there.items():
            for replica in self.replicas:
                status, _, body = replica.ask("GET", f"/v1/trees/{tree}/mesh")
                self.assertEqual((status, body), (200, bytes_of_mesh), "an acknowledged mesh")
        listed = {tree["id"] for tree in
                  json.loads(self.replicas[0].ask("GET", "/v1/trees?limit=1000")[2])["trees"]}
        self.assertFalse(listed & load.deleted)
        self.assertEqual([replica.metric("kdray_shared_store_away") for replica in self.replicas],
                         [0, 0])
        return away

    def report(self, name, back):
        load = self.load
        print(f"{name} for {OUTAGE_S:g} s; wrong answers: {len(load.wrong)}")
        for phase in ("before", "outage", "after"):
            times = sorted(load.seconds[phase])
            print(f"  {phase}: {len(times)} queries of cached trees, p50"
                  f" {times[len(times) // 2] * 1e3:.1f} ms, p99 {times[len(times) * 99 // 100] * 1e3:.1f}"
                  f" ms, at most {times[-1] * 1e3:.0f} ms;",
                  ", ".join(f"{kind} {status}: {count}" for (p, kind, status), count
                            in sorted(load.counts.items()) if p == phase and kind != "cached"))
        print("  first success after the return:", ", ".join(
            f"{kind} {moment - back:.1f} s" for kind, moment in sorted(
                (kind, max(m for (p, k, _), m in load.first.items() if p == "after" and k == kind))
                for kind in {k for p, k, _ in load.first if p == "after"})))

    def test_a_store_that_is_stopped(self):
        away = self.run_outage("stopped", self.store.stop, self.store.start)
        self.assertEqual(away, [1, 1])
        # Those whose last request to the store was just answered.
        self.assertLessEqual(self.load.counts["outage", "upload", 201], 2)

    def test_a_store_that_takes_requests_and_answers_none(self):
        # What it has read it carries out when it goes on, long after it was given up.
        self.run_outage("silent", self.store.answers.clear, self.store.answers.set)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
