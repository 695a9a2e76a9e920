# SPDX-License-Identifier: Apache-2.0
"""Uploads, trees and problems of the Python package against the real daemon: python_test.py KDRAYD KDRAY"""
import hashlib
import multiprocessing
import os
import pickle
import subprocess
import sys
import tempfile
import threading
import unittest
from pathlib import Path

import numpy as np

from daemon import Daemon
from python_case import KDRAYD, ROOT, PythonCase, kdray, random_rays


class PythonTest(PythonCase):
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

    # Threads and processes

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


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
