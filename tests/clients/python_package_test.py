# SPDX-License-Identifier: Apache-2.0
"""The Python package as its users get it: python_package_test.py KDRAYD KDRAY

pip installs it into a virtual environment without a network, where it uploads, casts rays and shows
a picture; and mypy, if it is installed, finds no fault in its types or in a program that uses them.
"""
import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
import unittest
import zipfile
from pathlib import Path

from daemon import Daemon

ROOT = Path(__file__).resolve().parent.parent.parent
SOURCE = ROOT / "clients/python"
KDRAYD, KDRAY = sys.argv[1:3]

PROGRAM = """
import kdray, numpy as np
tree = kdray.Client().upload("teapot.ply")
rays = kdray.rays(np.random.default_rng(1).uniform(-3, 3, (100_000, 3)), tree.bounds.mean(axis=0))
print(np.isfinite(tree.closest(rays)["t"]).sum() > 1000, tree.render().size, kdray.__file__)
"""

TYPED = """
import kdray
import numpy as np

client = kdray.Client("http://127.0.0.1:8080", progress=lambda report: print(report.stage))
tree = client.upload((np.zeros((3, 3)), np.array([[0, 1, 2]])), build="bvh")
reveal_type(tree.render(mode="depth").data)
reveal_type(tree.scan_beams((0, 0, 0), [0.0]).ranges)
tree.render(mode="sepia")
tree.closest([[0, 0, 0, 0, 0, 1]], cull=True)
client.uplaod("x")
"""


def without_settings():
    return {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("KDRAY_", "PYTHON", "PIP_"))
    }


class PythonPackageTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="kdray-package-")
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def run_in(self, *arguments, **environment):
        done = subprocess.run(
            [str(part) for part in arguments],
            cwd=self.folder,
            capture_output=True,
            text=True,
            env=dict(without_settings(), **environment),
            timeout=300,
        )
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        return done.stdout

    def copy_of_the_source(self):
        """pip builds in the folder that it is given, and leaves files in it."""
        return shutil.copytree(
            SOURCE, self.folder / "source", ignore=shutil.ignore_patterns("__pycache__")
        )

    @unittest.skipUnless(
        importlib.util.find_spec("ensurepip") and importlib.util.find_spec("setuptools"),
        "python3-venv or python3-setuptools is not installed",
    )
    def test_pip_installs_it_offline_and_it_works(self):
        source = self.copy_of_the_source()
        self.run_in(
            sys.executable, "-m", "venv", "--system-site-packages", "--without-pip", "place"
        )
        python = self.folder / "place/bin/python"
        self.run_in(
            sys.executable,
            "-m",
            "pip",
            "--python",
            python,
            "install",
            "--no-build-isolation",
            "--no-index",
            source,
        )
        with Daemon(KDRAYD) as daemon:
            self.run_in(KDRAY, "-q", "sample", "teapot", "--detail", "8", "-o", "teapot.ply")
            printed = self.run_in(python, "-c", PROGRAM, KDRAY_SERVER=daemon.url)
        self.assertRegex(
            printed,
            rf"^True \(640, 480\) {self.folder}/place/.*/site-packages/kdray/__init__.py\n$",
        )
        built = self.run_in(
            python,
            "-c",
            "import importlib.metadata as m; print(m.version('kdray'), m.requires('kdray'))",
        )
        version = self.run_in(python, "-c", "import kdray; print(kdray.__version__)").strip()
        self.assertTrue(built.startswith(version + " ['numpy"), built)

    @unittest.skipUnless(
        importlib.util.find_spec("setuptools"), "python3-setuptools is not installed"
    )
    def test_the_wheel_has_every_module_and_says_that_it_is_typed(self):
        self.run_in(
            sys.executable,
            "-m",
            "pip",
            "wheel",
            "--no-build-isolation",
            "--no-index",
            "--no-deps",
            self.copy_of_the_source(),
        )
        (wheel,) = self.folder.glob("*.whl")
        names = {name for name in zipfile.ZipFile(wheel).namelist() if name.startswith("kdray/")}
        self.assertEqual(
            names, {f"kdray/{path.name}" for path in (SOURCE / "kdray").iterdir() if path.is_file()}
        )
        self.assertIn("kdray/py.typed", names)

    @unittest.skipUnless(importlib.util.find_spec("mypy"), "mypy is not installed")
    def test_mypy_finds_no_fault_in_the_package_and_those_of_a_program(self):
        self.run_in(
            sys.executable,
            "-m",
            "mypy",
            "--strict",
            "--cache-dir",
            self.folder / "cache",
            SOURCE / "kdray",
        )
        (self.folder / "program.py").write_text(TYPED)
        done = subprocess.run(
            [
                sys.executable,
                "-m",
                "mypy",
                "--strict",
                "--cache-dir",
                self.folder / "cache",
                "program.py",
            ],
            cwd=self.folder,
            capture_output=True,
            text=True,
            env=dict(without_settings(), MYPYPATH=str(SOURCE)),
        )
        lines = [
            line.split(":", 2)
            for line in done.stdout.splitlines()
            if ": error:" in line or ": note: Revealed" in line
        ]
        self.assertEqual([int(line[1]) for line in lines], [7, 8, 9, 10, 11], done.stdout)
        self.assertIn('"builtins.bytes"', lines[0][2])
        self.assertIn("ndarray", lines[1][2])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
