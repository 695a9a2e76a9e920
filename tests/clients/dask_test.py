# SPDX-License-Identifier: Apache-2.0
"""kdray.dask over three daemons and two workers: dask_test.py KDRAYD KDRAY

Exits with 77 (skipped) if python3-distributed is not installed. The oracle is one daemon, asked
without Dask.
"""
import contextlib
import json
import os
import sys
import tempfile
import threading
import time
import unittest
from pathlib import Path

import numpy as np

from daemon import Daemon

ROOT = Path(__file__).resolve().parent.parent.parent
PACKAGE = str(ROOT / "clients/python")
sys.path.insert(0, PACKAGE)
# The workers are processes of their own, which must find the package too.
os.environ["PYTHONPATH"] = os.pathsep.join(
    filter(None, [PACKAGE, os.environ.get("PYTHONPATH", "")]))
import kdray  # noqa: E402
import kdray.dask  # noqa: E402

KDRAYD, KDRAY = sys.argv[1:3]


def terrain(n=60):
    """A surface of waves over [-1, 1]^2, which rays from below and above hit."""
    x, y = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n), indexing="ij")
    z = 0.2 * np.sin(5 * x) * np.cos(4 * y)
    corner = np.arange(n * n).reshape(n, n)[:-1, :-1].ravel()
    faces = np.concatenate([np.stack([corner, corner + n, corner + 1], -1),
                            np.stack([corner + 1, corner + n, corner + n + 1], -1)])
    return np.stack([x.ravel(), y.ravel(), z.ravel()], -1), faces


def some_rays(count, seed=1):
    random = np.random.default_rng(seed)
    origins = random.uniform(-1.5, 1.5, (count, 3)).astype("f4")
    return kdray.rays(origins, random.normal(size=(count, 3)).astype("f4"))


class DaskTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        import distributed
        stack = contextlib.ExitStack()
        cls.addClassCleanup(stack.close)
        cls.folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="kdray-dask-")))
        cls.daemons = [stack.enter_context(Daemon(KDRAYD, "--threads", "1")) for _ in range(3)]
        cls.local = stack.enter_context(distributed.LocalCluster(
            n_workers=2, threads_per_worker=2, processes=True, dashboard_address=None,
            silence_logs=60, local_directory=str(cls.folder)))
        cls.cluster = stack.enter_context(distributed.Client(cls.local))
        cls.cluster.wait_for_workers(2)
        cls.servers = kdray.dask.Servers(cls.cluster, [daemon.url for daemon in cls.daemons],
                                         chunk_rows=3000, tile_px=64)
        cls.tree = cls.servers.upload(terrain())
        cls.one = kdray.Client(cls.daemons[0].url).tree(cls.tree.id)

    def same(self, found, expected):
        self.assertEqual((found.dtype, found.shape), (expected.dtype, expected.shape))
        self.assertEqual(found.tobytes(), expected.tobytes())

    def test_a_batch_has_the_same_bytes_as_on_one_server(self):
        rays = some_rays(20000)
        rays[[5, 7000], 3:] = 0  # invalid
        info, expected_info = kdray.BatchInfo(), kdray.BatchInfo()
        self.same(self.tree.closest(rays, info=info),
                  self.one.closest(rays, info=expected_info))
        self.assertEqual(info, expected_info)
        self.assertEqual(info.invalid, 2)
        self.same(self.tree.closest(rays.astype(float).reshape(100, 200, 6), fields="t,point"),
                  self.one.closest(rays.astype(float).reshape(100, 200, 6), fields="t,point"))
        self.same(self.tree.any(rays), self.one.any(rays))
        self.same(self.tree.count(rays), self.one.count(rays))
        self.same(self.tree.all(rays), self.one.all(rays))
        points = rays[:, :3]
        self.same(self.tree.closest_points(points), self.one.closest_points(points))
        self.same(self.tree.signed_distance(points), self.one.signed_distance(points))
        self.same(self.tree.inside(points), self.one.inside(points))
        self.same(self.tree.closest(rays[:0]), self.one.closest(rays[:0]))

    def test_a_batch_on_all_servers_is_of_one_trace(self):
        trace = "00-5bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01"
        servers = kdray.dask.Servers(self.cluster, self.servers.urls, chunk_rows=1000,
                                     traceparent=trace)
        servers.tree(self.tree.id).any(some_rays(12000))
        self.tree.any(some_rays(12000))  # on the same workers, of no trace

        def traced(daemon):
            lines = map(json.loads, Path(daemon.folder, "log").read_text().splitlines())
            return [line for line in lines if line.get("trace_id") == trace.split("-")[1]]

        deadline = time.monotonic() + 10
        while sum(len(traced(daemon)) for daemon in self.daemons) < 12:
            self.assertLess(time.monotonic(), deadline)
            time.sleep(0.05)
        rays = [line for daemon in self.daemons for line in traced(daemon)
                if line["path"].endswith("/rays/any")]
        self.assertEqual(len(rays), 12)
        self.assertTrue(all(traced(daemon) for daemon in self.daemons))

    def test_from_file_to_file_it_is_the_same_and_tells_its_progress(self):
        rays = some_rays(10000).reshape(10, 1000, 6)
        np.save(self.folder / "rays.npy", rays)
        reports = []
        for query in ("closest", "all"):
            out = self.folder / f"{query}.npy"
            answer = getattr(self.tree, query)(
                self.folder / "rays.npy", out=out, progress=reports.append)
            self.assertIsNone(answer)
            self.same(np.load(out), getattr(self.one, query)(rays))
            self.assertEqual((reports[-1].done, reports[-1].total), (10000, 10000))
        self.assertEqual(list(self.folder.glob("*.part")), [])

    def test_a_picture_of_regions_has_the_same_bytes_as_a_whole_one(self):
        view = dict(width=150, height=130, view="iso")
        for mode in ("depth", "normal", "shaded"):
            self.same(self.tree.render_array(mode, **view), self.one.render_array(mode, **view))
        self.tree.render_array("position", out=self.folder / "position.npy", **view)
        self.same(np.load(self.folder / "position.npy"), self.one.render_array("position", **view))
        for fields in ({}, {"mode": "depth"}, {"background": "transparent", "edges": True}):
            self.same(self.tree.render(**view, **fields).array(),
                      self.one.render(**view, **fields).array())

    def test_a_tree_that_one_server_has_is_found_there(self):
        mesh = terrain(5)
        tree = kdray.Client(self.daemons[2].url).upload(mesh)
        rays = some_rays(9000)
        self.same(self.servers.tree(tree.id).closest(rays), tree.closest(rays))
        tree.delete()
        with self.assertRaises(kdray.Problem) as raised:
            self.servers.tree(tree.id).closest(rays)
        self.assertEqual(raised.exception.code, "tree_not_found")

    def test_a_refusal_is_raised_and_leaves_no_file(self):
        out = self.folder / "refused.npy"
        with self.assertRaises(kdray.Problem) as raised:
            self.tree.closest(some_rays(9000), out=out, precision="rough")
        self.assertEqual(raised.exception.parameter, "precision")
        self.assertEqual(list(self.folder.glob("refused*")), [])
        for wrong in (dict(budget_ms=10), dict(width=0), dict(region=[0, 0, 1, 1])):
            with self.assertRaises(ValueError):
                self.tree.render(**wrong)
        with self.assertRaises(ValueError):
            self.tree.closest(np.zeros((4, 5)))

    def test_a_server_that_is_lost_in_the_middle_changes_nothing(self):
        rays = some_rays(120000)
        expected = self.one.closest(rays)
        with Daemon(KDRAYD, "--threads", "1") as lost:
            servers = kdray.dask.Servers(
                self.cluster, [lost.url, *self.servers.urls], chunk_rows=1500)
            tree = servers.upload(terrain())

            def lose(report):
                if report.done > 20000:
                    lost._process.kill()

            self.same(tree.closest(rays, progress=lose), expected)
            self.assertIsNotNone(lost._process.poll())

    def test_a_worker_that_is_lost_in_the_middle_changes_nothing(self):
        rays = some_rays(120000)
        expected = self.one.closest(rays)
        servers = kdray.dask.Servers(self.cluster, self.servers.urls, chunk_rows=1500)
        pids = self.cluster.run(os.getpid)
        victim = list(pids.values())[0]
        done = threading.Event()

        def lose(report):
            if report.done > 20000 and not done.is_set():
                done.set()
                os.kill(victim, 9)

        self.same(servers.tree(self.tree.id).closest(rays, progress=lose), expected)
        self.assertTrue(done.is_set())
        deadline = time.monotonic() + 30
        while time.monotonic() < deadline and len(self.cluster.nthreads()) < 2:
            time.sleep(0.1)  # the cluster starts another worker


if __name__ == "__main__":
    try:
        import distributed  # noqa: F401
    except ImportError:
        print("python3-distributed is not installed; kdray.dask is not tested")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1], verbosity=2)
