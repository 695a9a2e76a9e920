# SPDX-License-Identifier: Apache-2.0
"""The Python package kdray against the real daemon: python_test.py KDRAYD KDRAY"""
import hashlib
import inspect
import json
import multiprocessing
import os
import pickle
import subprocess
import sys
import tempfile
import threading
import unittest
import warnings
from pathlib import Path

import numpy as np

from brute_force import closest_hits, crossings, distances, winding_numbers
from daemon import Daemon

ROOT = Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(ROOT / "clients/python"))
import kdray  # noqa: E402

KDRAYD, KDRAY = sys.argv[1:3]


def sphere(n=6, radius=1.0):
    """A closed mesh of 2 n (2 n - 1) * 2 triangles around the origin: (vertices, faces)."""
    rings, around = n * 2, n * 4
    polar = np.linspace(0, np.pi, rings + 1)[1:-1]
    azimuth = np.arange(around) * 2 * np.pi / around
    p, a = np.meshgrid(polar, azimuth, indexing="ij")
    inner = np.stack([np.sin(p) * np.cos(a), np.cos(p), np.sin(p) * np.sin(a)], -1).reshape(-1, 3)
    # Turned, so no ray or point of a test lies in a plane of symmetry.
    turn = np.linalg.qr(np.array([[3.0, 1, 2], [1, 4, 1], [-2, 1, 5]]))[0]
    vertices = radius * np.concatenate([[[0, 1, 0]], inner, [[0, -1, 0]]]) @ turn
    last = len(vertices) - 1
    faces = []
    for j in range(around):
        k = (j + 1) % around
        faces.append([0, 1 + k, 1 + j])
        faces.append([last, last - around + j, last - around + k])
        for i in range(rings - 2):
            a0, b0 = 1 + i * around + j, 1 + i * around + k
            faces += [[a0, b0, a0 + around], [b0, b0 + around, a0 + around]]
    return vertices, np.array(faces)


def random_rays(count, seed=1):
    """Rays from a sphere of radius 3 at points near the origin; about half hit the unit sphere."""
    generator = np.random.default_rng(seed)
    origins = generator.normal(size=(count, 3))
    origins *= 3 / np.linalg.norm(origins, axis=1, keepdims=True)
    return np.hstack([origins, generator.uniform(-1.2, 1.2, (count, 3)) - origins])


class PythonTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.daemon = Daemon(KDRAYD)
        cls.addClassCleanup(cls.daemon.close)
        cls.client = kdray.Client(cls.daemon.url)
        cls.addClassCleanup(cls.client.close)
        cls.vertices, cls.faces = sphere()
        cls.triangles = cls.vertices[cls.faces]
        cls.tree = cls.client.upload((cls.vertices, cls.faces))

    def path(self, name):
        return os.path.join(self.daemon.folder, name)

    def sample(self, shape, *options):
        path = self.path(f"{shape}.ply")
        subprocess.run([KDRAY, "-q", "sample", shape, *options, "-o", path], check=True)
        return path

    # Uploads

    def test_a_file_its_bytes_and_its_path_are_one_tree(self):
        path = self.sample("torus", "--detail", "8")
        content = Path(path).read_bytes()
        tree = self.client.upload(path)
        self.assertEqual(tree.id, hashlib.sha256(content).hexdigest() + "-auto")
        for same in (Path(path), content, bytearray(content), memoryview(content)):
            self.assertEqual(self.client.upload(same), tree)
        self.assertEqual(tree.mesh_bytes(), content)
        self.assertEqual(self.client.tree(tree.id).triangles, 4 * 8 * 8)

    def test_arrays_are_stored_exactly_and_keep_their_numbers(self):
        self.assertEqual(self.tree.triangles, len(self.faces))
        np.testing.assert_array_equal(
            self.tree.bounds, [self.vertices.min(0), self.vertices.max(0)]
        )
        self.assertTrue(self.tree.is_closed)
        centers = self.triangles.mean(axis=1)
        rays = kdray.rays(2 * centers, -centers)
        np.testing.assert_array_equal(
            self.tree.closest(rays, "triangle"), np.arange(len(self.faces))
        )
        single = self.client.upload((self.vertices.astype("f4"), self.faces.astype("u2")))
        np.testing.assert_array_equal(
            single.bounds, [self.vertices.astype("f4").min(0), self.vertices.astype("f4").max(0)]
        )
        square = self.client.upload(([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]]))
        self.assertEqual(square.triangles, 2)

        class Mesh:
            vertices, faces = self.vertices, self.faces

        self.assertEqual(self.client.upload(Mesh()), self.tree)

    def test_what_is_no_mesh_is_refused_before_it_is_sent(self):
        points = np.zeros((3, 3))
        for mesh, error in (
            (points, TypeError),
            (7, TypeError),
            ((points, [[0, 1, 3]]), ValueError),
            ((points, [[0, 1, -1]]), ValueError),
            ((points, [[0, 1]]), ValueError),
            ((points, [[0.0, 1.0, 2.0]]), TypeError),
            ((points[:, :2], [[0, 1, 2]]), ValueError),
            ((points > 0, [[0, 1, 2]]), TypeError),
        ):
            with self.assertRaises(error):
                self.client.upload(mesh)
        with self.assertRaisesRegex(ValueError, r"faces\[1\] is \[0, 1, 3\]; there are 3 vertices"):
            self.client.upload((points, [[0, 1, 2], [0, 1, 3]]))
        with self.assertRaises(FileNotFoundError):
            self.client.upload("no such file.ply")

    def test_progress_grows_to_the_end_and_a_known_mesh_is_not_sent(self):
        path = self.sample("sphere", "--detail", "60")
        reports = []
        tree = self.client.upload(path, progress=reports.append)
        sent = [report for report in reports if report.stage == "upload"]
        self.assertEqual(
            sent[-1], kdray.Progress("upload", os.path.getsize(path), os.path.getsize(path))
        )
        self.assertGreater(len(sent), 1)
        for stage in ("upload", "build"):
            done = [report.done for report in reports if report.stage == stage]
            self.assertEqual(done, sorted(set(done)))
        self.assertEqual(reports[-1], kdray.Progress("build", 1.0, 1.0))
        del reports[:]
        self.assertEqual(self.client.upload(path, progress=reports.append), tree)
        tree.rebuild("bvh")
        self.assertEqual({report.stage for report in reports}, {"build"})

    def test_bars_go_to_standard_error_without_tqdm(self):
        program = (
            "import sys, time; sys.modules['tqdm'] = sys.modules['tqdm.auto'] = None\n"
            "import kdray.progress as p; p._Bar.FIRST_S = p._Bar.EVERY_S = 0\n"
            "with p.Reporter(True, 'rays', 4) as report:\n"
            "    for i in range(4): report(i)\n"
        )
        done = subprocess.run(
            [sys.executable, "-c", program],
            capture_output=True,
            check=True,
            env=dict(os.environ, PYTHONPATH=str(ROOT / "clients/python")),
        )
        self.assertEqual(done.stdout, b"")
        self.assertEqual(done.stderr, b"\rrays   0%\rrays  25%\rrays  50%\rrays  75%\rrays 100%\n")

    def test_trees_are_listed_built_again_and_deleted(self):
        tree = self.client.upload(([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
        other = tree.rebuild("kd-median")
        self.assertEqual((tree.build, other.build), ("box", "kd-median"))
        listed = list(self.client.trees(tree.mesh["sha256"]))
        self.assertEqual({t.id for t in listed}, {tree.id, other.id})
        self.assertIn(self.tree, list(self.client.trees()))
        self.assertEqual(other.cells(0)["triangles"].tolist(), [1])
        np.testing.assert_array_equal(other.cells(0)["max"], [[1, 1, 0]])
        other.delete()
        with self.assertRaises(kdray.Problem) as refused:
            other.refresh()
        self.assertEqual(
            (refused.exception.status, refused.exception.code), (404, "tree_not_found")
        )
        for id in ("", "abc", "../" + tree.id, tree.id.upper(), tree.id + "/mesh"):
            with self.assertRaises(ValueError):
                self.client.tree(id)

    # Ray queries

    def test_closest_any_and_count_equal_brute_force(self):
        rays = random_rays(3000)
        t, u, v = crossings(self.triangles, rays)
        expected, triangle = t.min(axis=1), t.argmin(axis=1)
        hit = np.isfinite(expected)
        self.assertTrue(0.2 < hit.mean() < 0.9)
        for precision in ("watertight", "double", "exact"):
            hits = self.tree.closest(rays, precision=precision)
            self.assertEqual(hits.dtype.names, ("t", "triangle", "u", "v"))
            np.testing.assert_allclose(
                hits["t"], expected, rtol=1e-5 if precision == "watertight" else 1e-12
            )
            np.testing.assert_array_equal(hits["triangle"], np.where(hit, triangle, -1))
        rows = np.flatnonzero(hit)
        np.testing.assert_allclose(hits["u"][rows], u[rows, triangle[rows]], atol=1e-12)
        np.testing.assert_allclose(hits["v"][rows], v[rows, triangle[rows]], atol=1e-12)
        np.testing.assert_array_equal(self.tree.any(rays), hit)
        np.testing.assert_array_equal(self.tree.count(rays), np.isfinite(t).sum(axis=1))

    def test_all_hits_equal_brute_force(self):
        rays = random_rays(500)
        t, _, _ = crossings(self.triangles, rays)
        hits = self.tree.all(rays, "t,triangle")
        self.assertEqual(hits.dtype.names, ("ray", "t", "triangle"))
        ray, triangle = np.nonzero(np.isfinite(t))
        order = np.lexsort((t[ray, triangle], ray))
        np.testing.assert_array_equal(hits["ray"], ray[order])
        np.testing.assert_array_equal(hits["triangle"], triangle[order])
        np.testing.assert_allclose(hits["t"], t[ray, triangle][order], rtol=1e-12)

    def test_intervals_culling_and_starts_on_the_surface(self):
        rays = random_rays(800)
        limited = kdray.rays(rays[:, :3], rays[:, 3:], 0.7, np.linspace(0.8, 1.5, len(rays)))
        self.assertEqual(limited.shape, (800, 8))
        np.testing.assert_allclose(
            self.tree.closest(limited, "t", precision="exact"),
            closest_hits(self.triangles, limited),
            rtol=1e-12,
        )
        np.testing.assert_array_equal(
            self.tree.any(rays, t_min=0.7, t_max=0.9),
            self.tree.any(kdray.rays(rays[:, :3], rays[:, 3:], 0.7, 0.9)),
        )
        hits = self.tree.closest(rays, "point,side", cull="back")
        outside = hits["side"] == 1
        self.assertTrue(outside.any() and not (hits["side"] == -1).any())
        points, outward = hits["point"][outside], hits["point"][outside]
        info = kdray.BatchInfo()
        self.assertFalse(self.tree.any(kdray.rays(points, outward), t_min="auto", info=info).any())
        self.assertGreaterEqual(info.offset, 0)
        self.assertTrue(self.tree.any(kdray.rays(points, -outward), t_min="auto").all())

    def test_shapes_and_types_of_the_answers_follow_the_rays(self):
        rays = random_rays(24)
        expected = self.tree.closest(rays)
        grid = self.tree.closest(rays.reshape(2, 3, 4, 6))
        np.testing.assert_array_equal(grid.reshape(-1), expected)
        self.assertEqual(
            (expected["t"].dtype, expected["triangle"].dtype), (np.dtype("f8"), np.dtype("i8"))
        )
        single = self.tree.closest(rays.astype("f4"))
        self.assertEqual(
            (single["t"].dtype, single["triangle"].dtype), (np.dtype("f4"), np.dtype("i4"))
        )
        self.assertEqual(
            self.tree.closest(rays.astype("f4"), "t", dtype="f8").dtype, np.dtype("f8")
        )
        for kind in (np.float32, "float32", np.dtype("<f4"), "f4"):
            self.assertEqual(self.tree.closest(rays, "t", dtype=kind).dtype, np.float32)
        for kind in ("f2", int, "U1"):
            with self.assertRaisesRegex(ValueError, "dtype must be float32 or float64"):
                self.tree.closest(rays, "t", dtype=kind)
        scalars = dict(t_min=np.float64(0.1), t_max=np.float32(2.5), deadline_ms=np.int64(30000))
        limited = self.tree.closest(rays, **scalars)
        np.testing.assert_array_equal(limited, self.tree.closest(rays, t_min=0.1, t_max=2.5))
        with self.assertRaises(TypeError):
            self.tree.closest(rays, t_max=[1, 2])
        one = self.tree.closest(rays[0])
        self.assertEqual((one.shape, float(one["t"])), ((), expected["t"][0]))
        for same in (
            rays.tolist(),
            rays.astype(">f8"),
            np.asfortranarray(rays),
            rays[::1],
            np.repeat(rays, 2, 0)[::2],
        ):
            np.testing.assert_array_equal(self.tree.closest(same), expected)
        points = self.tree.closest(rays.reshape(4, 6, 6), ["point", "t"])["point"]
        self.assertEqual(points.shape, (4, 6, 3))
        self.assertEqual(self.tree.closest(rays.reshape(4, 6, 6), "normal").shape, (4, 6, 3))
        whole = np.array([[0, 5, 0, 0, -1, 0]])  # integers
        np.testing.assert_allclose(self.tree.closest(whole, "t"), 4, atol=0.05)
        expected["t"] = 0  # answers can be written

    def test_an_empty_batch_has_an_empty_answer(self):
        for empty in ([], np.zeros((0, 6)), np.zeros((0, 8), "f4"), np.zeros((3, 0, 6))):
            shape = np.shape(empty)[:-1] or (0,)
            self.assertEqual(self.tree.closest(empty).shape, shape)
            self.assertEqual(self.tree.any(empty).shape, shape)
            self.assertEqual(self.tree.all(empty).shape, (0,))
        self.assertEqual(self.tree.inside([]).shape, (0,))
        self.assertEqual(self.tree.visibility(np.zeros((0, 3)), np.zeros((4, 3))).shape, (0, 4))
        self.assertEqual(self.tree.visibility(np.zeros((4, 3)), np.zeros((0, 3))).shape, (4, 0))

    def test_invalid_rows_are_misses_and_are_counted(self):
        rays = random_rays(5)
        expected = self.tree.closest(rays, "triangle")
        rays[1, 2], rays[3, 3:] = np.nan, 0
        info = kdray.BatchInfo()
        hits = self.tree.closest(rays, info=info)
        self.assertEqual(info.invalid, 2)
        self.assertEqual(info.precision, "double")  # auto, for vertices that are no floats
        self.assertTrue(np.isnan(hits["t"][[1, 3]]).all())
        np.testing.assert_array_equal(hits["triangle"], np.where([0, 1, 0, 1, 0], -1, expected))
        self.tree.any(rays[:1], info=info)
        self.assertEqual(info.invalid, 0)

    def test_hits_that_are_cut_off_are_told(self):
        stack = np.tile(np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], float), (100, 1, 1))
        stack[:, :, 2] = np.arange(100)[:, None]
        tree = self.client.upload((stack.reshape(-1, 3), np.arange(300).reshape(-1, 3)))
        ray = [[0.25, 0.25, -1, 0, 0, 1]]
        with self.assertWarnsRegex(UserWarning, "1 rays have more than 64 hits.*max_hits"):
            self.assertEqual(len(tree.all(ray)), 64)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            self.assertEqual(tree.all(ray, max_hits=100)["triangle"].tolist(), list(range(100)))
            info = kdray.BatchInfo()
            self.assertEqual(len(tree.all(ray, max_hits=10, info=info)), 10)
        self.assertEqual(info.truncated, 1)

    def test_rows_that_are_no_rays_are_refused_with_what_is_allowed(self):
        for rays in (np.zeros((4, 7)), np.zeros(3), 5.0):
            with self.assertRaisesRegex(
                ValueError, r"rays must have the shape \(…, 6\) or \(…, 8\), not"
            ):
                self.tree.closest(rays)
        with self.assertRaisesRegex(ValueError, r"points must have the shape \(…, 3\)"):
            self.tree.inside(np.zeros((2, 6)))
        for rays in (np.zeros((2, 6), complex), np.array([["a"] * 6])):
            with self.assertRaises(TypeError):
                self.tree.any(rays)
        with self.assertRaisesRegex(ValueError, "directions must have the shape"):
            kdray.rays([0, 0, 0], [1, 2])

    def test_rays_are_broadcast_and_stay_single_if_all_are(self):
        many = kdray.rays([0, 0, 5], np.zeros((2, 4, 3)) - 1.0)
        self.assertEqual((many.shape, many.dtype), ((2, 4, 6), np.float64))
        single = kdray.rays(np.zeros(3, "f4"), np.ones((5, 3), "f4"), t_max=2.0)
        self.assertEqual((single.shape, single.dtype), ((5, 8), np.float32))
        np.testing.assert_array_equal(single[0], [0, 0, 0, 1, 1, 1, 0, 2])

    def test_the_attributes_of_a_file_are_fields(self):
        tree = self.client.upload(
            b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nvn 0 0.6 0.8\n"
            b"o door\nf 1/1/1 2/2/1 3/3/1\nv 5 0 0\nv 6 0 0\nv 5 1 0\no wall\nf 4 5 6\n"
        )
        self.assertEqual(tree.groups, ["door", "wall"])
        (listed,) = self.client.trees(tree.mesh["sha256"])
        self.assertEqual(listed.groups, tree.groups)
        rays = kdray.rays([[0.25, 0.5, 1], [5.25, 0.5, 1], [9, 9, 1]], [0, 0, -1])
        fields = ["group", "uv", "shading_normal", "triangle"]
        for kind in ("f4", "f8"):
            hits = tree.closest(rays, fields, dtype=kind)
            self.assertEqual(hits.dtype.names, tuple(fields))
            self.assertEqual(hits["group"].tolist(), [0, 1, -1])
            np.testing.assert_allclose(hits["uv"], [[0.25, 0.5], [np.nan] * 2, [np.nan] * 2])
            normals = [[0, 0.6, 0.8], [np.nan] * 3, [np.nan] * 3]
            np.testing.assert_allclose(hits["shading_normal"], normals, rtol=1e-6)
        self.assertEqual(tree.all(rays, "uv,group")["group"].tolist(), [0, 1])
        self.assertEqual(tree.closest(rays.reshape(3, 1, 6), "uv").shape, (3, 1, 2))

    # Points

    def test_point_queries_equal_brute_force(self):
        points = np.random.default_rng(2).uniform(-1.5, 1.5, (1500, 3))
        expected = distances(self.triangles, points)
        inside = winding_numbers(self.triangles, points) != 0
        found = self.tree.closest_points(points)
        np.testing.assert_allclose(found["distance"], expected, atol=1e-12)
        np.testing.assert_allclose(
            np.linalg.norm(found["point"] - points, axis=1), expected, atol=1e-12
        )
        corners = self.triangles[found["triangle"]]
        weights = np.stack([1 - found["u"] - found["v"], found["u"], found["v"]], -1)
        np.testing.assert_allclose(
            (weights[..., None] * corners).sum(1), found["point"], atol=1e-12
        )
        self.assertTrue(0.05 < inside.mean() < 0.95)
        np.testing.assert_array_equal(self.tree.inside(points) == 1, inside)
        np.testing.assert_allclose(
            self.tree.signed_distance(points), np.where(inside, -expected, expected), atol=1e-12
        )
        self.assertEqual(self.tree.inside(points.reshape(3, 500, 3)).shape, (3, 500))

    def test_visibility_equals_brute_force(self):
        generator = np.random.default_rng(3)
        sources, targets = (generator.uniform(-2, 2, (count, 3)) for count in (21, 50))
        segments = kdray.rays(sources[:, None], targets[None] - sources[:, None], 0, 1).reshape(
            -1, 8
        )
        expected = ~np.isfinite(closest_hits(self.triangles, segments)).reshape(21, 50)
        seen = self.tree.visibility(sources, targets)
        np.testing.assert_array_equal(seen, expected)
        self.assertEqual(seen.dtype, bool)
        np.testing.assert_array_equal(
            self.tree.visibility(sources, targets, bits=True), np.packbits(expected, axis=1)
        )
        rays = kdray.rays(sources[:, None], targets[None])
        np.testing.assert_array_equal(
            self.tree.visibility(sources, targets, to_directions=True), ~self.tree.any(rays)
        )
        self.assertEqual(self.tree.visibility([0, 9, 0], [0, 8, 0]).tolist(), [[True]])
        lines = self.tree.visibility(sources, targets, to_directions=np.bool_(False))
        np.testing.assert_array_equal(lines, expected)
        with self.assertRaises(ValueError):
            self.tree.visibility(np.zeros((2, 2, 3)), targets)

    # Batches

    def test_a_batch_in_many_parts_has_the_same_answer(self):
        rays = random_rays(5003)
        rays[77] = np.nan
        points = rays[:, :3] / 2
        with Daemon(KDRAYD, "--max-rays", "700") as small:
            client = kdray.Client(small.url, parallel=3)
            tree = client.upload((self.vertices, self.faces))
            for ask in (
                lambda t, **o: t.closest(rays, "t,triangle,point", **o),
                lambda t, **o: t.any(rays, **o),
                lambda t, **o: t.count(rays, **o),
                lambda t, **o: t.all(rays, **o),
                lambda t, **o: t.closest(rays.reshape(5003, 1, 6), "normal", **o),
                lambda t, **o: t.closest_points(points, **o),
                lambda t, **o: t.signed_distance(points, **o),
                lambda t, **o: t.inside(points, **o),
            ):
                reports, info, whole_info = [], kdray.BatchInfo(), kdray.BatchInfo()
                answer = ask(tree, progress=reports.append, info=info)
                whole = ask(self.tree, info=whole_info)
                self.assertEqual(
                    (answer.dtype, answer.shape, answer.tobytes()),
                    (whole.dtype, whole.shape, whole.tobytes()),
                )
                self.assertEqual(info, whole_info)
                self.assertEqual(info.invalid, 1)
                self.assertEqual((reports[-1].done, reports[-1].total), (5003, 5003))
                self.assertGreaterEqual(len(reports), 8)
            for sources, targets in (
                (points[:300], points[100:110]),
                (points[:3], points[:2001]),
                (points[:60], points[:60]),
            ):
                for options in ({}, {"to_directions": True}):
                    info, whole_info = kdray.BatchInfo(), kdray.BatchInfo()
                    np.testing.assert_array_equal(
                        tree.visibility(sources, targets, info=info, **options),
                        self.tree.visibility(sources, targets, info=whole_info, **options),
                    )
                    self.assertEqual(info, whole_info)
            self.assertEqual(info.invalid, 0)
            targets = np.zeros((1500, 3))
            targets[::500], targets[1] = np.nan, 1
            for options, invalid in (({}, 4), ({"to_directions": True}, 4 + 1496)):
                for asked in (tree, self.tree):
                    asked.visibility(points[76:79], targets, info=info, **options)
                    self.assertEqual(info.invalid, invalid)
            # A server that takes less than it said is asked in smaller parts.
            client._info["limits"].update(max_rays=100_000, max_answer_hits=1_600_000)
            self.assertEqual(tree.closest(rays).tobytes(), self.tree.closest(rays).tobytes())
            client.close()

    def test_a_failure_within_a_batch_ends_it(self):
        rays = random_rays(4000)
        with Daemon(KDRAYD, "--max-rays", "500") as small:
            client = kdray.Client(small.url)
            tree = client.upload((self.vertices, self.faces))

            def stop(report):
                if report.done:
                    raise KeyboardInterrupt

            with self.assertRaises(KeyboardInterrupt):
                tree.closest(rays, progress=stop)
            self.assertFalse([t for t in threading.enumerate() if t.name.startswith("kdray-batch")])
            with self.assertRaises(kdray.Problem) as refused:
                tree.closest(rays, "t,colour")
            self.assertEqual(refused.exception.parameter, "fields")
            np.testing.assert_array_equal(tree.any(rays), self.tree.any(rays))
            client.close()

    def test_one_client_serves_many_threads_and_processes(self):
        rays = random_rays(2000)
        expected = self.tree.closest(rays)
        answers = [None] * 8

        def ask(i):
            answers[i] = self.tree.closest(rays)

        threads = [threading.Thread(target=ask, args=(i,)) for i in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for answer in answers:
            np.testing.assert_array_equal(answer, expected)
        fork = multiprocessing.get_context("fork")
        results = fork.SimpleQueue()
        # The children inherit the parent's connections.
        children = [
            fork.Process(target=lambda: results.put(self.tree.closest(rays))) for _ in range(2)
        ]
        for child in children:
            child.start()
        for child in children:
            np.testing.assert_array_equal(results.get(), expected)
            np.testing.assert_array_equal(self.tree.closest(rays), expected)
        for child in children:
            child.join()
        again = pickle.loads(pickle.dumps(self.tree))
        np.testing.assert_array_equal(again.closest(rays), expected)

    # Problems

    def test_a_problem_keeps_the_servers_reason(self):
        with self.assertRaises(kdray.Problem) as refused:
            self.client.upload(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")
        problem = refused.exception
        self.assertEqual((problem.status, problem.code, problem.line), (422, "invalid_mesh", 4))
        self.assertRegex(str(problem), r"^invalid_mesh: .+ \(HTTP 422, line 4, request \S+\)$")
        with self.assertRaises(kdray.Problem) as refused:
            self.tree.render(samples=5000)
        problem = refused.exception
        self.assertEqual(
            (problem.code, problem.parameter, problem.limit, problem.actual),
            ("invalid_parameter", "/samples", 1024, 5000),
        )
        again = pickle.loads(pickle.dumps(problem))
        self.assertEqual((str(again), again.fields), (str(problem), problem.fields))
        with self.assertRaises(kdray.Problem) as refused:
            self.client.upload(b"")
        self.assertEqual(refused.exception.code, "empty_mesh")
        with self.assertRaises(kdray.Problem) as refused:
            self.tree.closest(random_rays(1), t_min=2.0, t_max=1.0)
        self.assertEqual(refused.exception.status, 400)

    def test_a_mesh_beyond_the_limit_is_not_sent(self):
        with Daemon(KDRAYD, "--max-upload", "2KiB") as small:
            reports = []
            with self.assertRaises(kdray.Problem) as refused:
                kdray.Client(small.url).upload((self.vertices, self.faces), progress=reports.append)
            self.assertEqual(
                (refused.exception.code, refused.exception.limit), ("mesh_too_large", 2048)
            )
            self.assertEqual(reports, [])

    def test_a_token_is_sent_and_never_shown(self):
        token = "sesame-open-please-0123456789abcdef"
        with tempfile.NamedTemporaryFile("w", suffix=".token") as file:
            file.write(token + "\n")
            file.flush()
            with Daemon(KDRAYD, "--token-file", file.name) as guarded:
                with self.assertRaises(kdray.Problem) as refused:
                    kdray.Client(guarded.url).info
                self.assertEqual(refused.exception.code, "unauthorized")
                client = kdray.Client(guarded.url, token=token)
                self.assertEqual(client.info["name"], "kdray")
                self.assertNotIn(token, repr(client))
                self.assertNotIn(token, repr(client.upload((self.vertices, self.faces))))
                client.close()

    # Pictures

    def test_a_picture_is_shown_by_a_notebook_and_is_an_array(self):
        picture = self.tree.render(width=64, height=48, background=(0, 0, 1))
        self.assertEqual(picture._repr_png_()[:8], b"\x89PNG\r\n\x1a\n")
        self.assertEqual(picture.size, (64, 48))
        pixels = np.asarray(picture)
        self.assertEqual((pixels.shape, pixels.dtype), ((48, 64, 3), np.uint8))
        self.assertEqual(pixels[0, 0].tolist(), [0, 0, 255])
        self.assertNotEqual(pixels[24, 32].tolist(), [0, 0, 255])
        self.assertEqual(
            (picture.precision, picture.stopped, picture.samples), ("watertight", "done", 16)
        )
        self.assertEqual(picture.save(self.path("sphere.png")), picture)
        self.assertEqual(Path(self.path("sphere.png")).read_bytes(), picture.data)
        depth = self.tree.render(mode="depth", width=32, height=32, eye=[0, 0, 5])
        self.assertAlmostEqual(depth.depth_range[0], 4, places=1)
        self.assertEqual(
            self.tree.render(
                mode="depth", width=8, height=8, eye=[0, 0, 5], depth_range=(1, 9)
            ).depth_range,
            (1, 9),
        )

    def test_every_kind_of_field_reaches_the_server(self):
        eye = np.array([0, 0, 5], "f4")
        plain = self.tree.render_array(
            "depth",
            width=20,
            height=10,
            eye=eye,
            target=(0, 0, 0),
            up=[0, 1, 0],
            fov_deg=np.float32(30),
        )
        focal = 5 / np.tan(np.radians(15))
        intrinsic = np.array([[focal, 0, 10], [0, focal, 5], [0, 0, 1]])
        extrinsic = np.array([[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 5], [0, 0, 0, 1]], float)
        for form in (np.array, np.ndarray.tolist):
            image = self.tree.render_array(
                "depth", width=20, height=10, intrinsic=form(intrinsic), extrinsic=form(extrinsic)
            )
            np.testing.assert_allclose(image, plain, rtol=1e-6)
        image = self.tree.render_array(
            "depth", width=20, height=10, intrinsic=(focal, focal, 10, 5), extrinsic=extrinsic
        )
        np.testing.assert_allclose(image, plain, rtol=1e-6)
        lit = self.tree.render_array(
            "shaded",
            width=20,
            height=10,
            eye=eye,
            lights=[{"direction": np.array([0, 0, -1]), "intensity": 0.5}],
        )
        dark = self.tree.render_array("shaded", width=20, height=10, eye=eye, lights=[])
        self.assertEqual((lit.shape, lit.dtype), ((10, 20, 4), np.float32))
        self.assertGreater(lit[5, 10, 0], dark[5, 10, 0])
        self.assertEqual(
            self.tree.render(background="transparent", width=8, height=8).array().shape, (8, 8, 4)
        )
        for field in ({"eye": (0, 0, np.nan)}, {"ao_radius": np.inf}):
            with self.assertRaisesRegex(ValueError, "finite"):
                self.tree.render(**field)
        with self.assertRaises(TypeError):
            self.tree.render(colour=(1, 0, 0))

    def test_render_arrays_are_the_hits_of_rays_through_pixels(self):
        depth = self.tree.render_array("depth", width=24, height=16, eye=(0, 0, 4), fov_deg=40)
        x, y = np.meshgrid((np.arange(24) + 0.5 - 12) / 8, (8 - np.arange(16) - 0.5) / 8)
        directions = np.stack(
            [x * np.tan(np.radians(20)), y * np.tan(np.radians(20)), -np.ones_like(x)], -1
        )
        expected = closest_hits(
            self.triangles, kdray.rays((0, 0, 4), directions).reshape(-1, 6)
        ).reshape(16, 24)
        np.testing.assert_allclose(depth, expected, rtol=1e-4)
        for mode, shape, dtype in (
            ("triangle", (16, 24), "i4"),
            ("normal", (16, 24, 3), "f4"),
            ("position", (16, 24, 3), "f8"),
            ("cost", (16, 24, 2), "i4"),
            ("ambient-occlusion", (16, 24), "f4"),
        ):
            image = self.tree.render_array(mode, width=24, height=16)
            self.assertEqual((image.shape, image.dtype), (shape, np.dtype(dtype)))

    def test_pictures_of_arrays_come_back(self):
        generator = np.random.default_rng(4)
        for shape in ((5, 7), (5, 7, 1), (1, 1, 2), (9, 4, 3), (3, 200, 4)):
            array = generator.integers(0, 256, shape, np.uint8)
            picture = kdray.Picture.of(array)
            np.testing.assert_array_equal(
                picture.array(), array if array.ndim == 3 else array[:, :, None]
            )
            self.assertEqual(picture.size, (shape[1], shape[0]))
        self.assertEqual(
            kdray.Picture.of([[0.0, 1.0, 2.0, np.nan, -np.inf, 0.5]]).array()[0, :, 0].tolist(),
            [0, 255, 255, 0, 0, 128],
        )
        self.assertEqual(
            kdray.Picture.of(np.array([[True, False]])).array()[0, :, 0].tolist(), [255, 0]
        )
        for wrong in (np.zeros(3), np.zeros((2, 2, 5)), np.zeros((0, 4)), np.zeros((1, 2, 3, 3))):
            with self.assertRaises(ValueError):
                kdray.Picture.of(wrong)
        for text in (b"", b"GIF89a", b"\x89PNG"):
            with self.assertRaises(ValueError):
                kdray.Picture(text).array()

    def test_every_parameter_of_the_contract_is_an_argument(self):
        contract = json.loads(self.client.request("GET", "/openapi.json").content)

        def resolved(part):
            while "$ref" in part:
                target = contract
                for name in part["$ref"].lstrip("#/").split("/"):
                    target = target[name]
                part = target
            return part

        def arguments(method, *others):
            return set(inspect.signature(method).parameters) - {"self", *others}

        fields = set(resolved(contract["components"]["schemas"]["RenderRequest"])["properties"])
        self.assertEqual(arguments(kdray.Tree.render), fields)
        only_png = {"background", "depth_range"}
        self.assertEqual(arguments(kdray.Tree.render_array), fields - only_png)
        for path, method, left_out in (
            ("rays/closest", kdray.Tree.closest, set()),
            ("rays/any", kdray.Tree.any, {"dtype"}),
            ("rays/count", kdray.Tree.count, set()),
            ("rays/all", kdray.Tree.all, set()),
            ("points/closest", kdray.Tree.closest_points, set()),
            ("points/signed-distance", kdray.Tree.signed_distance, set()),
            ("points/inside", kdray.Tree.inside, {"dtype"}),
            ("visibility", kdray.Tree.visibility, {"from_count"}),
        ):
            operation = contract["paths"]["/v1/trees/{id}/" + path]["post"]
            named = {resolved(part)["name"] for part in operation["parameters"]}
            own = {"rays", "points", "from_points", "to", "progress", "info"}
            self.assertEqual(arguments(method, *own), named - left_out, path)

    # Scans, trade-off

    def test_a_scan_is_the_points_around_the_eye(self):
        points = self.tree.scan(eye=(0, 0, 0), width=36, height=18)
        self.assertEqual((points.shape, points.dtype), ((36 * 18, 3), np.float64))
        a = ((np.arange(36) + 0.5) / 36 - 0.5) * 2 * np.pi
        e = (0.5 - (np.arange(18) + 0.5) / 18) * np.pi
        a, e = np.meshgrid(a, e)
        # The view is along -z, so right is +x.
        directions = np.stack(
            [np.cos(e) * np.sin(a), np.sin(e), -np.cos(e) * np.cos(a)], -1
        ).reshape(-1, 3)
        seen = self.tree.scan(
            eye=(0, 0, 0),
            target=(0, 0, -1),
            up=(0, 1, 0),
            h_fov_deg=360,
            v_fov_deg=180,
            width=36,
            height=18,
        )
        t = closest_hits(self.triangles, kdray.rays((0, 0, 0), directions))
        np.testing.assert_allclose(seen, directions * t[:, None], atol=1e-5)
        above = self.tree.scan(eye=(0, 3, 0), target=(0, 3, -1), width=36, height=18)
        self.assertTrue(0 < len(above) < 36 * 18 and np.isfinite(above).all())

    def test_beams_go_where_their_angles_say(self):
        scan = self.tree.scan_beams(
            (0, 0, 0), [-15, 0, 30], 8, forward=(0, 0, -1), up=(0, 1, 0), precision="exact"
        )
        self.assertEqual(scan.points.shape, (24, 3))
        self.assertEqual(scan.beams.tolist(), [0, 1, 2] * 8)
        self.assertEqual(scan.azimuths_deg.tolist(), np.repeat(np.arange(8) * 45.0, 3).tolist())
        unit = scan.points / scan.ranges[:, None]
        np.testing.assert_allclose(
            np.degrees(np.arcsin(unit[:, 1])), np.tile([-15, 0, 30], 8), atol=1e-9
        )
        np.testing.assert_allclose(unit[7], [1, 0, 0], atol=1e-12)  # 90 degrees to the right
        np.testing.assert_allclose(
            scan.ranges, closest_hits(self.triangles, kdray.rays((0, 0, 0), unit)), rtol=1e-9
        )
        outside = self.tree.scan_beams((0, 0, 3), [0, 80], [-10, 0, 10, 180], max_range=2.5)
        self.assertEqual(
            (outside.beams.tolist(), outside.azimuths_deg.tolist()), ([0, 0, 0], [-10, 0, 10])
        )
        self.assertEqual(len(self.tree.scan_beams((0, 0, 3), [0], [0], max_range=1.5).points), 0)
        upright = self.tree.scan_beams((0, 0, 0), [0], [90], up=(0, 0, 1), forward=(0, 1, 0))
        np.testing.assert_allclose(upright.points[0] / upright.ranges[0], [1, 0, 0], atol=1e-12)
        for wrong in ({"up": (0, 0, 0)}, {"up": (0, 1, 0), "forward": (0, 2, 0)}):
            with self.assertRaises(ValueError):
                self.tree.scan_beams((0, 0, 0), [0], 4, **wrong)
        with self.assertRaises(ValueError):
            self.tree.scan_beams((0, 0, 0), [0], 0)

    def test_the_tradeoff_is_measured_once_and_prints_a_table(self):
        tree = self.client.upload(self.sample("cube"))
        reports = []
        measured = tree.tradeoff(progress=reports.append)
        self.assertEqual(reports[-1], kdray.Progress("measure", 1.0, 1.0))
        self.assertEqual(len(measured.rows), 24)
        lines = str(measured).splitlines()
        self.assertEqual(len(lines), 26)
        self.assertRegex(lines[0], r"^build +precision .* leaks +t error$")
        self.assertRegex(lines[-1], r"^12 triangles, closed; \d+ threads")
        self.assertEqual(measured.row("bvh", "exact")["leaks"]["count"], 0)
        with self.assertRaises(KeyError):
            measured.row("bvh", "sharp")
        self.assertEqual(measured._repr_html_().count("<tr>"), 25)
        self.assertEqual(tree.tradeoff().data["measured_at"], measured.data["measured_at"])
        tree.forget_tradeoff()
        with self.assertRaises(kdray.Problem) as refused:
            tree.forget_tradeoff()
        self.assertEqual(refused.exception.code, "not_measured")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
