"""The kdray command against the real daemon: command_test.py KDRAYD KDRAY"""
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import unittest

import numpy as np

from brute_force import closest_hits
from daemon import Daemon

KDRAYD, KDRAY = sys.argv[1:3]


class CommandTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.daemon = Daemon(KDRAYD)
        cls.addClassCleanup(cls.daemon.close)
        cls.teapot = os.path.join(cls.daemon.folder, "teapot.ply")
        subprocess.run([KDRAY, "-q", "sample", "teapot", "--detail", "8", "-o", cls.teapot], check=True)

    def kdray(self, *arguments, server=None):
        return subprocess.run([KDRAY, "--server", server or self.daemon.url, *arguments],
                              capture_output=True, text=True, timeout=60)

    def ok(self, *arguments):
        done = self.kdray(*arguments)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done

    def path(self, name):
        return os.path.join(self.daemon.folder, name)

    def test_upload_prints_the_same_id_twice_and_sends_once(self):
        first = self.ok("upload", self.teapot)
        self.assertRegex(first.stdout, r"^[0-9a-f]{64}-auto\n$")
        again = self.ok("upload", self.teapot)
        self.assertEqual(again.stdout, first.stdout)
        self.assertIn("already has this tree", again.stderr)

    def test_tradeoff_measures_once_and_forgets(self):
        cube = self.path("cube.ply")
        self.ok("sample", "cube", "-o", cube)
        first = self.ok("tradeoff", cube)
        self.assertIn("measuring", first.stderr)
        for word in ("LEAKS", "kd-sah", "box", "exact", "triangles, closed"):
            self.assertIn(word, first.stdout)
        self.assertEqual(self.ok("tradeoff", cube).stdout, first.stdout)
        measured = json.loads(self.ok("tradeoff", cube, "--json").stdout)
        self.assertEqual(len(measured["results"]), 24)
        self.ok("tradeoff", cube, "--forget")
        again = self.kdray("tradeoff", cube, "--forget")
        self.assertEqual(again.returncode, 1)
        self.assertIn("not_measured", again.stderr)

    def test_every_build_of_a_sample_is_closed_and_listed(self):
        for build in ("kd-sah", "kd-median", "bvh", "box"):
            tree = self.ok("upload", self.teapot, "--build", build).stdout.strip()
            description = json.loads(self.ok("show", tree, "--json").stdout)
            self.assertEqual(description["tree"]["build"], build)
            self.assertTrue(description["mesh"]["health"]["closed"])
            self.assertIn(f"{tree[:12]}-{build}", self.ok("list").stdout)

    def test_a_picture_of_the_teapot_shows_something(self):
        picture = self.path("teapot.png")
        self.ok("render", self.teapot, "-o", picture, "--width", "64", "--height", "48")
        with open(picture, "rb") as file:
            self.assertEqual(file.read(8), b"\x89PNG\r\n\x1a\n")
        depth = self.path("depth.npy")
        self.ok("render", self.teapot, "-o", depth, "--width", "64", "--height", "48", "--mode", "depth")
        image = np.load(depth)
        self.assertEqual((image.shape, image.dtype), ((48, 64), np.dtype("f4")))
        self.assertTrue(0.1 < np.isfinite(image).mean() < 0.9)

    def test_rays_give_the_same_hits_as_a_plain_loop_over_all_triangles(self):
        sphere, rays, hits = self.path("sphere.stl"), self.path("rays.npy"), self.path("hits.npy")
        self.ok("sample", "sphere", "--detail", "4", "-o", sphere)
        self.ok("sample-rays", "--tree", sphere, "-n", "2000", "--seed", "3", "-o", rays)
        self.ok("rays", sphere, rays, "-o", hits, "--precision", "double")
        got, expected = np.load(hits), closest_hits(read_stl(sphere), np.load(rays).astype(float))
        self.assertTrue(0.1 < np.isfinite(expected).mean() < 1)
        np.testing.assert_allclose(got["t"], expected, rtol=1e-5)
        self.ok("rays", sphere, rays, "-o", self.path("any.npy"), "--any", "--precision", "double")
        np.testing.assert_array_equal(np.load(self.path("any.npy")), np.isfinite(expected))

    def test_points_have_their_distances_from_a_sphere(self):
        sphere, points, found = self.path("sphere.stl"), self.path("points.npy"), self.path("found.npy")
        self.ok("sample", "sphere", "--detail", "4", "-o", sphere)
        corners = read_stl(sphere).reshape(-1, 3).astype(float)
        low, high = corners.min(axis=0), corners.max(axis=0)
        center, radius = (low + high) / 2, (high - low).max() / 2
        sent = center + np.random.default_rng(1).uniform(-2, 2, (500, 3)) * radius
        np.save(points, sent)
        expected = np.linalg.norm(sent - center, axis=1) - radius
        self.ok("points", sphere, points, "-o", found, "--fields", "distance,triangle")
        np.testing.assert_allclose(np.load(found)["distance"], np.abs(expected), atol=0.05 * radius)
        self.ok("points", sphere, points, "-o", found, "--signed-distance", "--precision", "exact")
        np.testing.assert_allclose(np.load(found), expected, atol=0.05 * radius)
        self.ok("points", sphere, points, "-o", found, "--inside")
        far = np.abs(expected) > 0.05 * radius
        np.testing.assert_array_equal(np.load(found)[far] == 1, expected[far] < 0)

    def test_json_goes_in_and_out(self):
        with open(self.path("rays.json"), "w") as file:
            json.dump({"rays": [[0, 9, 0, 0, -1, 0], [0, 9, 0, 0, 1, 0]]}, file)
        self.ok("rays", self.teapot, self.path("rays.json"), "-o", self.path("hits.json"))
        with open(self.path("hits.json")) as file:
            hit, miss = json.load(file)["results"]
        self.assertAlmostEqual(hit["t"], 9 - 3.15, places=5)  # the knob's top
        self.assertIsNone(miss)

    def test_the_mesh_comes_back_byte_for_byte(self):
        tree = self.ok("upload", self.teapot).stdout.strip()
        self.ok("mesh", tree[:10] + "-auto", "-o", self.path("back.ply"))
        with open(self.teapot, "rb") as sent, open(self.path("back.ply"), "rb") as back:
            self.assertEqual(sent.read(), back.read())

    def test_cells_at_depth_zero_are_the_root(self):
        tree = self.ok("upload", self.teapot, "--build", "kd-sah").stdout.strip()
        cells = json.loads(self.ok("cells", tree, "--depth", "0", "--json").stdout)["cells"]
        self.assertEqual(len(cells), 1)
        self.assertAlmostEqual(cells[0]["max"][1], 3.15, places=5)

    def test_a_deleted_tree_is_gone(self):
        cube = self.path("cube.obj")
        self.ok("sample", "cube", "-o", cube)
        tree = self.ok("upload", cube).stdout.strip()
        self.ok("delete", tree)
        done = self.kdray("show", tree)
        self.assertEqual(done.returncode, 1)
        self.assertRegex(done.stderr, r"kdray: tree_not_found: .*\n  HTTP 404, .*request ")

    def test_a_broken_mesh_is_refused_with_its_line(self):
        broken = self.path("broken.obj")
        with open(broken, "w") as file:
            file.write("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")
        done = self.kdray("upload", broken)
        self.assertEqual((done.returncode, done.stdout), (1, ""))
        self.assertRegex(done.stderr, r"invalid_mesh: .*\n  HTTP 422, line 4")

    def test_a_wrong_value_is_refused_with_its_parameter(self):
        done = self.kdray("render", self.teapot, "-o", self.path("no.png"), "--mode", "sepia")
        self.assertEqual(done.returncode, 1)
        self.assertRegex(done.stderr, r"invalid_parameter: .*\n  HTTP 400, parameter mode")
        self.assertFalse(os.path.exists(self.path("no.png")))

    def test_nobody_listening_is_exit_code_three(self):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            url = "http://127.0.0.1:%d" % free.getsockname()[1]
            done = self.kdray("list", server=url)
        self.assertEqual(done.returncode, 3)
        self.assertIn("cannot connect", done.stderr)

    def test_a_server_that_hangs_up_is_exit_code_three(self):
        large = self.path("large.stl")
        self.ok("sample", "sphere", "--detail", "200", "-o", large)
        with socket.create_server(("127.0.0.1", 0)) as listener:
            def hang_up():
                for _ in range(2):
                    listener.accept()[0].close()
            thread = threading.Thread(target=hang_up)
            thread.start()
            done = self.kdray("upload", large, server="http://127.0.0.1:%d" % listener.getsockname()[1])
            socket.create_connection(listener.getsockname()).close()
            thread.join()
        self.assertEqual(done.returncode, 3)
        self.assertIn("the connection to http://127.0.0.1", done.stderr)

    def test_an_interrupt_leaves_no_file_behind(self):
        with socket.create_server(("127.0.0.1", 0)) as silent:  # accepts and says nothing
            url = "http://127.0.0.1:%d" % silent.getsockname()[1]
            folder = self.path("interrupted")
            os.mkdir(folder)
            process = subprocess.Popen([KDRAY, "--server", url, "mesh", "a" * 64 + "-auto", "-o",
                                        os.path.join(folder, "mesh.ply")], stderr=subprocess.PIPE)
            deadline = time.monotonic() + 20
            while not os.listdir(folder) and time.monotonic() < deadline:
                time.sleep(0.02)
            self.assertEqual(len(os.listdir(folder)), 1)
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=20)
        self.assertEqual(process.returncode, -signal.SIGINT)
        self.assertEqual(os.listdir(folder), [])

    def test_a_token_is_taken_from_the_environment(self):
        token_file = self.path("token")
        with open(token_file, "w") as file:
            file.write("sesame-open-please-0123456789abcdef\n")
        os.chmod(token_file, 0o600)
        with Daemon(KDRAYD, "--token-file", token_file) as guarded:
            self.assertEqual(self.kdray("list", server=guarded.url).returncode, 1)
            environment = dict(os.environ, KDRAY_SERVER=guarded.url,
                               KDRAY_TOKEN="sesame-open-please-0123456789abcdef")
            done = subprocess.run([KDRAY, "upload", self.teapot], env=environment, capture_output=True)
            self.assertEqual(done.returncode, 0, done.stderr)


def read_stl(path):
    triangle = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    return np.fromfile(path, triangle, offset=84)["corners"].astype(float)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
