# SPDX-License-Identifier: Apache-2.0
"""The pages of docs/cookbook, run as they stand: cookbook_test.py KDRAYD KDRAY [PAGE...]

The commands of a page, then its Python, run in an empty folder against a daemon. The picture that
the page shows must come out; comments at the end of the Python are what it prints. Pictures that
differ are kept, to be looked at and committed if they are right.
"""
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

from daemon import Daemon

ROOT = Path(__file__).resolve().parent.parent.parent
BOOK = ROOT / "docs/cookbook"
sys.path.insert(0, str(ROOT / "clients/python"))
import kdray  # noqa: E402

KDRAYD, KDRAY = sys.argv[1:3]


def pages():
    return sorted(path for path in BOOK.glob("*.md") if path.name != "README.md")


class CookbookTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.daemon = Daemon(KDRAYD)
        cls.addClassCleanup(cls.daemon.close)
        cls.programs = Path(cls.daemon.folder) / "bin"
        cls.programs.mkdir()
        (cls.programs / "kdray").symlink_to(KDRAY)

    def run_page(self, page):
        place = Path(self.daemon.folder) / page.stem
        place.mkdir()
        environment = {
            name: value for name, value in os.environ.items() if not name.startswith("KDRAY_")
        }
        environment.update(
            PATH=f"{self.programs}:{environment['PATH']}",
            PYTHONPATH=str(ROOT / "clients/python"),
            KDRAY_SERVER=self.daemon.url,
        )

        def run(*arguments):
            done = subprocess.run(
                arguments, cwd=place, env=environment, capture_output=True, text=True, timeout=120
            )
            self.assertEqual((done.returncode, "Traceback" in done.stderr), (0, False), done.stderr)
            return done.stdout

        text = page.read_text()
        for language, block in re.findall(r"^```(\w*)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL):
            lines = block.splitlines()
            if language == "python":
                expected = []
                while lines[-1].startswith("# "):
                    expected.insert(0, lines.pop()[2:])
                printed = run(sys.executable, "-c", "\n".join(lines)).splitlines()
                print(f"{page.stem}: {'; '.join(printed)}", file=sys.stderr)
                if expected:
                    self.assertEqual(printed, expected)
                elif "print(" not in block:
                    self.assertEqual(printed, [])
            else:
                self.assertTrue(all(line.startswith("$ ") for line in lines), block)
                for line in lines:
                    run("bash", "-c", line[2:])
        pictures = re.findall(r"!\[.+?\]\((.+?)\)", text)
        self.assertEqual(pictures, [page.stem + ".png"])
        self.compare(place / pictures[0], BOOK / pictures[0])

    def compare(self, made, committed):
        """Equal, except where the last bits of a sine differ: one pixel in a hundred may."""
        if committed.exists():
            pixels, expected = (
                kdray.Picture(path.read_bytes()).array().astype(int) for path in (made, committed)
            )
            if (
                pixels.shape == expected.shape
                and (np.abs(pixels - expected).max(axis=-1) > 4).mean() <= 0.01
            ):
                return
        kept = Path(tempfile.gettempdir()) / f"kdray-cookbook-{made.name}"
        shutil.copy(made, kept)
        self.fail(
            f"{committed.name} is not the picture that its page makes. Look at {kept}: "
            "if it is right, commit it."
        )

    def test_every_page_is_in_the_table_and_tested(self):
        links = re.findall(r"\]\((\S+\.md)\)", (BOOK / "README.md").read_text())
        self.assertEqual(sorted(links), [page.name for page in pages()])
        self.assertEqual(
            sorted(path.stem for path in BOOK.glob("*.png")), [page.stem for page in pages()]
        )


for page in pages():
    setattr(
        CookbookTest,
        "test_the_page_" + page.stem.replace("-", "_"),
        lambda self, page=page: self.run_page(page),
    )

if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1] + sys.argv[3:], verbosity=2)
