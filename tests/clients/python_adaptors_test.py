# SPDX-License-Identifier: Apache-2.0
"""kdray.trimesh and kdray.open3d answer as the real ones: python_adaptors_test.py KDRAYD KDRAY

The answers of the real libraries come from the installed ones, else from recorded/
(adaptor_cases.py tells how they were made).
"""
import importlib.util
import sys
import unittest
from pathlib import Path

import numpy as np

import adaptor_cases
from daemon import Daemon

sys.path.insert(0, str(Path(__file__).resolve().parent.parent.parent / "clients/python"))
import kdray  # noqa: E402
import kdray.open3d  # noqa: E402
import kdray.trimesh  # noqa: E402

KDRAYD, KDRAY = sys.argv[1:3]


class PythonAdaptorsTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.daemon = Daemon(KDRAYD)
        cls.addClassCleanup(cls.daemon.close)
        cls.client = kdray.Client(cls.daemon.url)
        cls.addClassCleanup(cls.client.close)

    def expected(self, name, real):
        """Of the installed library and of the recording."""
        yield adaptor_cases.from_text(name)
        if importlib.util.find_spec(name):
            yield real()

    def intersector(self, vertices, faces):
        return kdray.trimesh.RayMeshIntersector(
            adaptor_cases.Mesh(vertices, faces), client=self.client
        )

    def scene(self):
        return kdray.open3d.RaycastingScene(client=self.client)

    def test_trimesh(self):
        ours = adaptor_cases.trimesh_answers(self.intersector)
        for origin, theirs in self.expected("trimesh", adaptor_cases.real_trimesh):
            self.assertEqual(ours.keys(), theirs.keys())
            # The hits of trimesh are in no order; ours by ray, then distance.
            origins, directions = adaptor_cases.some_rays(40, 1)
            for name, array in ours.items():
                with self.subTest(origin=origin, answer=name):
                    other = theirs[name]
                    self.assertEqual(array.dtype, other.dtype)
                    if name.endswith(("missed location.0", "missed id locations.2")):
                        self.assertEqual((array.shape, other.size), ((0, 3), 0))
                        continue
                    self.assertEqual(array.shape, other.shape)
                    if "location" in name or " id" in name:
                        query = name.rsplit(".", 1)[0]
                        array, other = (
                            self.sorted_hits(part, query, name) for part in (ours, theirs)
                        )
                    np.testing.assert_allclose(array, other, atol=1e-9)

    def sorted_hits(self, answers, query, name):
        is_location = "location" in query and " id" not in query
        rays = answers[f"{query}.1"]
        triangles = answers[f"{query}.{2 if is_location else 0}"]
        return answers[name][np.lexsort((triangles, rays))]

    def test_trimesh_sees_an_edited_mesh_and_refuses_what_does_not_match(self):
        class Editable(adaptor_cases.Mesh):
            def __hash__(self):
                return hash(self.vertices.tobytes())

        mesh = Editable(*adaptor_cases.icosphere())
        ray = kdray.trimesh.RayMeshIntersector(mesh, client=self.client)
        down = [[0.1, 5, 0.1]], [[0, -1, 0]]
        before = ray.intersects_location(*down)[0][:, 1].max()
        mesh.vertices = mesh.vertices * 2
        self.assertGreater(ray.intersects_location(*down)[0][:, 1].max(), before + 0.9)
        for origins, directions in (
            ([[0, 0, 0]], [[0, 0, 1], [0, 1, 0]]),
            ([0, 0, 0], [0, 0, 1]),
            (np.zeros((2, 2)), np.zeros((2, 2))),
        ):
            with self.assertRaises(ValueError):
                ray.intersects_first(origins, directions)
        with self.assertRaises(ValueError):
            ray.contains_points([0, 0, 0])
        nothing = np.zeros((0, 3))
        self.assertEqual(
            [part.shape for part in ray.intersects_location(nothing, nothing)], [(0, 3), (0,), (0,)]
        )
        self.assertEqual(ray.intersects_first(nothing, nothing).shape, (0,))

    @unittest.skipUnless(importlib.util.find_spec("trimesh"), "trimesh is not installed")
    def test_trimesh_uses_the_adaptor_by_itself(self):
        import trimesh

        mesh = trimesh.Trimesh(*adaptor_cases.icosphere(), process=False)
        points = adaptor_cases.some_points(200, 2)
        before = mesh.contains(points)
        mesh.ray = kdray.trimesh.RayMeshIntersector(mesh, client=self.client)
        np.testing.assert_array_equal(mesh.contains(points), before)
        mesh.apply_translation([10, 0, 0])
        np.testing.assert_array_equal(mesh.contains(points + [10, 0, 0]), before)

    def test_open3d(self):
        ours = adaptor_cases.open3d_answers(self.scene, lambda array: array)
        for origin, theirs in self.expected("open3d", adaptor_cases.real_open3d):
            casts = not origin.startswith("Open3D 0.16")  # that of Debian 12 misses every ray
            self.assertTrue(theirs.keys() == ours.keys() if casts else theirs.keys() <= ours.keys())
            for name in theirs:
                array = ours[name]
                with self.subTest(origin=origin, answer=name):
                    other = theirs[name]
                    self.assertEqual(array.dtype, other.dtype)
                    if not casts and not name.startswith(
                        ("closest", "distance", "pinhole", "id", "invalid")
                    ):
                        continue
                    self.assertEqual(array.shape, other.shape)
                    # Their hits of a ray are in no order.
                    if name.startswith("list") and name != "list.ray_splits":
                        array, other = (part[name][self.order(part)] for part in (ours, theirs))
                    # Of several closest triangles, they take any.
                    if name.startswith("closest.primitive"):
                        inner = self.is_inner(ours) & self.is_inner(theirs)
                        self.assertGreater(inner.mean(), 0.3)
                        array, other = array[inner], other[inner]
                    np.testing.assert_allclose(array, other, rtol=1e-4, atol=1e-5)

    def order(self, answers):
        return np.lexsort((answers["list.t_hit"], answers["list.ray_ids"]))

    def is_inner(self, answers):
        """Where the closest point lies within a triangle, not on its border."""
        uv = answers["closest.primitive_uvs"]
        return np.minimum(uv.min(axis=-1), 1 - uv.sum(axis=-1)) > 1e-4

    def test_open3d_takes_meshes_tensors_and_more_than_one_geometry(self):
        class Wrapped:
            def __init__(self, array):
                self.array = array

            def cpu(self):
                return self

            def numpy(self):
                return self.array

        class TensorMesh:
            vertices, faces = adaptor_cases.box()
            vertex = {"positions": Wrapped(vertices.astype("f4"))}
            triangle = {"indices": Wrapped(faces.astype("i4"))}

        class LegacyMesh:
            vertices, triangles = adaptor_cases.icosphere()

        scene = self.scene()
        rays = np.hstack(adaptor_cases.some_rays(30, 5)).astype("f4")
        empty = scene.cast_rays(Wrapped(rays))
        self.assertTrue(
            np.isinf(empty["t_hit"].numpy()).all()
            and (empty["geometry_ids"] == scene.INVALID_ID).all()
        )
        self.assertEqual(len(scene.list_intersections(rays)["t_hit"]), 0)
        self.assertFalse(scene.test_occlusions(rays).any() or scene.count_intersections(rays).any())
        with self.assertRaises(RuntimeError):
            scene.compute_distance(np.zeros((1, 3)))
        self.assertEqual(scene.add_triangles(TensorMesh()), 0)
        alone = scene.cast_rays(Wrapped(rays))
        self.assertEqual(scene.add_triangles(np.zeros((0, 3), "f4"), np.zeros((0, 3), "u4")), 1)
        self.assertEqual(scene.add_triangles(LegacyMesh()), 2)
        both = scene.cast_rays(rays)
        self.assertEqual(set(np.unique(both["geometry_ids"])), {0, 2, scene.INVALID_ID})
        first = both["geometry_ids"] == 0
        self.assertTrue(first.any())
        np.testing.assert_array_equal(both["primitive_ids"][first], alone["primitive_ids"][first])
        self.assertLess(
            both["primitive_ids"][both["geometry_ids"] == 2].max(), len(LegacyMesh.triangles)
        )
        self.assertEqual(type(both["t_hit"].numpy()), np.ndarray)
        invalid = rays.copy()
        invalid[0, 0] = np.nan
        self.assertEqual(float(scene.cast_rays(invalid)["t_hit"][0]), np.inf)

    def test_open3d_refuses_what_does_not_fit(self):
        scene = self.scene()
        floats, whole = np.zeros((3, 3), "f4"), np.array([[0, 1, 2]], "u4")
        for mesh in (
            (floats, whole + 1),
            (whole, whole),
            (floats, floats),
            (floats[:, :2], whole),
            (floats, whole[:, :2]),
        ):
            with self.assertRaises(ValueError):
                scene.add_triangles(*mesh)
        with self.assertRaises(TypeError):
            scene.add_triangles(7)
        for rays in (np.zeros(6, "f4"), np.zeros((2, 5), "f4")):
            with self.assertRaises(ValueError):
                scene.cast_rays(rays)
        with self.assertRaises(ValueError):
            scene.create_rays_pinhole(60, [0, 1, 0], [0, 0, 0], [0, 1, 0], 4, 4)

    def test_hits_that_are_cut_off_are_told(self):
        stack = np.tile(np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], "f4"), (1030, 1, 1))
        stack[:, :, 2] = np.arange(1030)[:, None]
        vertices, faces = stack.reshape(-1, 3), np.arange(3090).reshape(-1, 3)
        scene, ray = self.scene(), self.intersector(vertices, faces)
        scene.add_triangles(vertices, faces)
        with self.assertWarnsRegex(UserWarning, "1 rays have more than 1024 hits") as warning:
            hits = scene.list_intersections([[0.25, 0.25, -1, 0, 0, 1]])
        self.assertEqual(len(hits["t_hit"]), 1024)
        self.assertEqual(warning.filename, __file__)
        with self.assertWarnsRegex(UserWarning, "1 rays have more than 1024 hits"):
            ray.intersects_location([[0.25, 0.25, -1]], [[0, 0, 1]])
        triangles, _ = ray.intersects_id([[0.25, 0.25, -1]], [[0, 0, 1]], max_hits=10)
        self.assertEqual(triangles.tolist(), list(range(10)))

    def test_an_open_mesh_has_no_inside(self):
        scene = self.scene()
        vertices, faces = adaptor_cases.icosphere()
        scene.add_triangles(vertices, faces[:-1])
        points = np.random.default_rng(1).uniform(-0.9, 0.9, (50, 3))
        signed = scene.compute_signed_distance(points)
        self.assertFalse(np.isnan(signed).any())
        np.testing.assert_allclose(np.abs(signed), scene.compute_distance(points), rtol=1e-6)
        self.assertTrue(set(scene.compute_occupancy(points)) <= {0.0, 1.0})


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
