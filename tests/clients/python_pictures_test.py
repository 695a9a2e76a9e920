# SPDX-License-Identifier: Apache-2.0
"""Pictures, scans and the trade-off of the Python package: python_pictures_test.py KDRAYD KDRAY"""
import inspect
import json
import sys
import unittest
from pathlib import Path

import numpy as np

from brute_force import closest_hits
from python_case import PythonCase, kdray


class PythonPicturesTest(PythonCase):
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
