# SPDX-License-Identifier: Apache-2.0
"""Queries of the Python package, compared with brute force: python_queries_test.py KDRAYD KDRAY"""
import sys
import threading
import unittest
import warnings

import numpy as np

from brute_force import closest_hits, crossings, distances, winding_numbers
from daemon import Daemon
from python_case import KDRAYD, PythonCase, kdray, random_rays


class PythonQueriesTest(PythonCase):
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


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
