# SPDX-License-Identifier: Apache-2.0
"""What the tests of the Python package share: a daemon, meshes and rays.

A test that imports this has the arguments KDRAYD KDRAY.
"""
import os
import subprocess
import sys
import unittest
from pathlib import Path

import numpy as np

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


class PythonCase(unittest.TestCase):
    """A daemon with a sphere: `client`, `tree`, and the arrays that it was made of."""

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
