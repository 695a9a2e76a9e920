# SPDX-License-Identifier: Apache-2.0
"""The kdray command against the real daemon: command_test.py KDRAYD KDRAY"""
import hashlib
import io
import json
import os
import pty
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
import unittest
import urllib.request

import numpy as np

from brute_force import closest_hits
from daemon import Daemon
from prefix_proxy import PrefixProxy

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

    def test_upload_takes_a_directory_a_pattern_and_standard_input(self):
        folder = self.path("many")
        os.makedirs(os.path.join(folder, "inner"))
        for name in ("a.ply", "inner/b.obj"):
            self.ok("sample", "cube", "-o", os.path.join(folder, name))
        done = self.ok("upload", folder)
        lines = [line.split("  ") for line in done.stdout.splitlines()]
        self.assertEqual([path for _, path in lines], [os.path.join(folder, "a.ply"), os.path.join(folder, "inner/b.obj")])
        for tree, path in lines:
            with open(path, "rb") as file:
                self.assertEqual(tree, hashlib.sha256(file.read()).hexdigest() + "-auto")
        self.assertEqual(self.ok("upload", os.path.join(folder, "*.p?y")).stdout.split()[0], lines[0][0])
        with open(os.path.join(folder, "a.ply"), "rb") as file:
            content = file.read()
        for stdin in (open(os.path.join(folder, "a.ply"), "rb"), None):  # a file, then a pipe
            done = subprocess.run([KDRAY, "--server", self.daemon.url, "upload", "-"], stdin=stdin,
                                  input=None if stdin else content, capture_output=True, timeout=60)
            self.assertEqual(done.stdout.decode(), lines[0][0] + "\n", done.stderr)
            if stdin:
                stdin.close()

    def test_rays_pass_through_pipes(self):
        tree = self.ok("upload", self.teapot).stdout.strip()
        command = f"'{KDRAY}' sample-rays -o - | '{KDRAY}' rays {tree} - -o -"
        done = subprocess.run(["bash", "-o", "pipefail", "-c", command], capture_output=True, timeout=60,
                              env=dict(os.environ, KDRAY_SERVER=self.daemon.url))
        self.assertEqual(done.returncode, 0, done.stderr)
        hits = np.load(io.BytesIO(done.stdout))
        self.assertEqual(hits.shape, (100_000,))
        self.assertTrue(0.2 < (hits["triangle"] >= 0).mean() < 1)
        command = f"'{KDRAY}' sample teapot --detail 8 -o - | '{KDRAY}' render - -o - --size 32x24"
        done = subprocess.run(["bash", "-o", "pipefail", "-c", command], capture_output=True, timeout=60,
                              env=dict(os.environ, KDRAY_SERVER=self.daemon.url))
        self.assertEqual(done.stdout[:8], b"\x89PNG\r\n\x1a\n")

    def test_a_batch_in_parts_has_the_answer_of_the_whole(self):
        tree = self.ok("upload", self.teapot).stdout.strip()
        rays, hits = self.path("many.npy"), self.path("parts.npy")
        self.ok("sample-rays", "--tree", tree, "-n", "150000", "-o", rays)
        shaped = np.load(rays).astype("f8").reshape(3, 50_000, 6)
        shaped[1, 7] = 0  # an invalid row in the middle
        np.save(rays, shaped)
        for query in ("closest", "any", "count", "all"):
            flags = [] if query == "closest" else ["--" + query]
            done = self.ok("rays", tree, rays, "-o", hits, *flags)
            self.assertIn("150,000 rays", done.stderr)
            self.assertIn("1 invalid row", done.stderr)
            with open(rays, "rb") as body:
                request = urllib.request.Request(f"{self.daemon.url}/v1/trees/{tree}/rays/{query}", body.read())
            whole = np.load(io.BytesIO(urllib.request.urlopen(request).read()))
            parts = np.load(hits)
            self.assertEqual((parts.shape, parts.dtype), (whole.shape, whole.dtype), query)
            self.assertEqual(parts.tobytes(), whole.tobytes(), query)

    def test_a_batch_may_be_larger_than_the_server_takes_at_once(self):
        with Daemon(KDRAYD, "--max-rays", "700", "--max-pixels", "900") as narrow:
            rays, hits = self.path("large.npy"), self.path("large-hits.npy")
            self.ok("sample-rays", "-n", "2000", "-o", rays)
            for arguments in (["rays", self.teapot, rays, "-o", hits], ["rays", self.teapot, rays, "-o", hits, "--all"],
                              ["scan", self.teapot, "-o", self.path("s.npy"), "--size", "60x40"],
                              ["scan", self.teapot, "-o", self.path("s.npy"), "--size", "600x1", "--elevations", "0,1,2"]):
                done = self.kdray(*arguments, server=narrow.url)
                self.assertEqual(done.returncode, 0, done.stderr)
            self.kdray("rays", self.teapot, rays, "-o", hits, server=narrow.url)
            self.ok("rays", self.teapot, rays, "-o", self.path("whole.npy"))
            np.testing.assert_array_equal(np.load(hits), np.load(self.path("whole.npy")))

    def test_visibility_of_two_sets_is_that_of_the_segments(self):
        sphere, seen = self.path("visible.stl"), self.path("seen.npy")
        self.ok("sample", "sphere", "--detail", "4", "-o", sphere)
        triangles = read_stl(sphere)
        random = np.random.default_rng(2)
        low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
        start, end = (random.uniform(low - 1, high + 1, (count, 3)) for count in (30, 20))
        np.save(self.path("from.npy"), start)
        np.save(self.path("to.npy"), end)
        self.ok("visibility", sphere, self.path("from.npy"), self.path("to.npy"), "-o", seen, "--precision", "double")
        rays = np.array([np.concatenate([a, b - a]) for a in start for b in end])
        blocked = closest_hits(triangles, rays) <= 1
        np.testing.assert_array_equal(np.load(seen), ~blocked.reshape(30, 20))
        self.assertTrue(0.1 < blocked.mean() < 0.9)
        self.ok("visibility", sphere, self.path("from.npy"), self.path("to.npy"), "-o", self.path("bits.npy"), "--bits",
                "--precision", "double")
        np.testing.assert_array_equal(np.load(self.path("bits.npy")), np.packbits(np.load(seen), axis=1))

    def test_a_scan_from_inside_a_sphere_lies_on_it(self):
        sphere, points = self.path("scanned.stl"), self.path("points.npy")
        self.ok("sample", "sphere", "--detail", "16", "-o", sphere)
        corners = read_stl(sphere).reshape(-1, 3)
        center, radius = (corners.min(axis=0) + corners.max(axis=0)) / 2, np.ptp(corners[:, 0]) / 2
        self.ok("scan", sphere, "-o", points, "--size", "200x150")
        scan = np.load(points)
        self.assertEqual(scan.shape, (30_000, 3))
        np.testing.assert_allclose(np.linalg.norm(scan - center, axis=1), radius, rtol=0.02)
        # Beams: the elevation of every point is that of its beam.
        self.ok("scan", sphere, "-o", points, "--size", "100x1", "--elevations=-30,0,45")
        scan = (np.load(points) - center).reshape(3, 100, 3)
        elevation = np.degrees(np.arcsin(scan[..., 1] / np.linalg.norm(scan, axis=2)))
        np.testing.assert_allclose(elevation, np.repeat([[-30], [0], [45]], 100, axis=1), atol=1e-6)
        # From outside most beams miss, and a point cloud has only the hits.
        cloud = self.path("cloud.ply")
        done = self.ok("scan", sphere, "-o", cloud, "--eye", "0,0,9", "--target", "0,0,0", "--size", "100x50")
        with open(cloud, "rb") as file:
            head, _, body = file.read().partition(b"end_header\n")
        count = int(re.search(rb"element vertex (\d+)", head)[1])
        self.assertTrue(0 < count < 2500)
        self.assertEqual(len(body), count * 24)
        self.assertIn(f"{count:,} points of 5,000 rays", done.stderr)

    def test_a_turntable_is_a_circle_of_pictures(self):
        tree = self.ok("upload", self.teapot).stdout.strip()
        self.ok("render", tree, "-o", self.path("turn.npy"), "--turntable", "3", "--size", "40x30", "--mode", "depth")
        depths = [np.load(self.path(f"turn-{i}.npy")) for i in range(3)]
        for depth in depths:  # the whole mesh, with room around it
            self.assertTrue(np.isfinite(depth).any())
            for edge in (depth[0], depth[-1], depth[:, 0], depth[:, -1]):
                self.assertFalse(np.isfinite(edge).any())
        self.assertFalse(np.array_equal(depths[0], depths[1]))
        done = self.ok("render", tree, "-o", self.path("turn.png"), "--turntable", "2", "--size", "8x6", "--json")
        self.assertEqual([os.path.basename(p["file"]) for p in json.loads(done.stdout)["pictures"]],
                         ["turn-0.png", "turn-1.png"])

    def test_bench_measures_every_kind_of_request(self):
        tree = self.ok("upload", self.teapot).stdout.strip()
        done = self.ok("bench", tree, "--seconds", "0", "--rays", "1000", "--json")
        results = json.loads(done.stdout)["results"]
        self.assertEqual(len(results), 5)
        for result in results:
            self.assertGreater(result["requests"], 0)
            self.assertLessEqual(result["median_ms"], result["p99_ms"])

    def test_a_closed_pipe_ends_it_without_a_word(self):
        tree = self.ok("upload", self.teapot).stdout.strip()
        for arguments in (["sample-rays", "-n", "200000", "-o", "-"], ["cells", tree, "--depth", "20"], ["man"],
                          ["mesh", tree, "-o", "-"]):
            read_end, write_end = os.pipe()
            os.close(read_end)
            process = subprocess.Popen([KDRAY, "-q", "--server", self.daemon.url, *arguments], stdout=write_end,
                                       stderr=subprocess.PIPE)
            os.close(write_end)
            _, said = process.communicate(timeout=60)
            self.assertEqual((process.returncode, said), (-signal.SIGPIPE, b""), arguments)

    def test_a_wait_of_more_than_a_second_shows_its_rate_and_the_time_left(self):
        tree = self.ok("upload", self.teapot).stdout.strip()
        rays = self.path("long.npy")
        self.ok("sample-rays", "--tree", tree, "-n", "100000", "-o", rays)
        # The wait is the proxy's, so it is long on a fast machine too.
        slow = PrefixProxy(self.daemon.url, "/slow", lambda path: 0.8 if "/rays/" in path or "/render" in path else 0)
        self.enterContext(slow)
        wide = dict(os.environ, KDRAY_SERVER=slow.url)
        long_render = ["render", tree, "-o", self.path("long.png"), "--size", "640x480", "--samples", "4"]
        for arguments, unit in ((["rays", tree, rays, "-o", self.path("h.npy"), "--count"], "rays"), (long_render, "pixels")):
            main_end, terminal = pty.openpty()
            process = subprocess.Popen([KDRAY, *arguments], stderr=terminal, env=wide)
            os.close(terminal)
            shown = b""
            while True:
                try:
                    piece = os.read(main_end, 4096)
                except OSError:  # the other end is closed
                    break
                if not piece:
                    break
                shown += piece
            os.close(main_end)
            self.assertEqual(process.wait(timeout=60), 0, shown)
            self.assertRegex(shown.decode(), rf"(rendering|casting)  (\[#*\.*\] )?\d+%  [\d.,M ]+ of [\d.,M ]+ {unit}, [\d.]+ ?[kM]? {unit}/s, "
                                             r"(about )?\d+ s left")
            self.assertNotIn("e+0", shown.decode())

    def test_completions_offer_commands_options_and_values(self):
        script = self.ok("completion", "bash").stdout

        def offered(*words):
            quoted = " ".join(f"'{word}'" for word in words)
            program = (f"{script}\nCOMP_WORDS=({quoted}); COMP_CWORD={len(words) - 1}; compopt() {{ echo FILES; }}; _kdray\n"
                       "printf '%s\\n' \"${COMPREPLY[@]}\"")
            return subprocess.run(["bash", "-c", program], check=True, capture_output=True, text=True).stdout.split()

        self.assertEqual(offered("kdray", "re"), ["render"])
        self.assertEqual(set(offered("kdray", "--server", "x", "sam")), {"sample", "sample-rays"})
        self.assertEqual(offered("kdray", "render", "x", "--widt"), ["--width"])
        self.assertEqual(offered("kdray", "render", "x", "--mode", "sha"), ["shaded"])
        self.assertEqual(offered("kdray", "sample", "tea"), ["teapot"])
        self.assertEqual(offered("kdray", "upload", ""), ["FILES"])
        for shell in ("zsh", "fish"):
            script = self.ok("completion", shell).stdout
            for word in ("sample-rays", "turntable", "ambient-occlusion"):
                self.assertIn(word, script)
            if shutil.which(shell):
                done = subprocess.run([shell, "-n"], input=script, capture_output=True, text=True)
                self.assertEqual((done.returncode, done.stderr), (0, ""))

    def test_the_manual_page_has_every_command_and_option(self):
        page = self.ok("man").stdout
        help_text = self.ok("--help").stdout
        commands = re.findall(r"^  ([a-z-]+) {2,}\S", help_text[help_text.index("Subcommands:"):], re.MULTILINE)
        self.assertGreater(len(commands), 15)
        plain = page.replace("\\-", "-")
        for command in commands:
            self.assertIn(f".SS \\fBkdray {command}\\fR", plain)
            for option in re.findall(r"(--[a-z-]+)", self.ok(command, "--help").stdout):
                self.assertIn(f"\\fB{option}\\fR", plain, command)
        if shutil.which("man"):
            done = subprocess.run(["man", "--warnings=w", "-l", "-"], input=page, capture_output=True, text=True,
                                  env=dict(os.environ, LC_ALL="C.UTF-8", MANWIDTH="100"))
            self.assertEqual((done.returncode, done.stderr), (0, ""))

    def test_tradeoff_measures_once_and_forgets(self):
        cube = self.path("cube.ply")
        self.ok("sample", "cube", "-o", cube)
        first = self.ok("tradeoff", cube)
        for word in ("LEAKS", "kd-sah", "box", "exact", "triangles, closed"):
            self.assertIn(word, first.stdout)
        plot = self.path("plot.png")
        self.assertEqual(self.ok("tradeoff", cube, "--plot", plot).stdout, first.stdout)
        with open(plot, "rb") as file:
            self.assertEqual(file.read(8), b"\x89PNG\r\n\x1a\n")
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
