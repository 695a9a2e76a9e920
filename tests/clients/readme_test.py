# SPDX-License-Identifier: Apache-2.0
"""The examples of the READMEs, run as they stand: readme_test.py KDRAYD KDRAY

Commands ("$ …") of a file run in one shell, against a daemon of their own, and must print what stands below them: `…` in a
line stands for anything, and a line that is nothing else stands for any lines. Blocks of Python run too; comments at their
end are what they print. The picture of README.md is rendered by the request below it.
"""
import os
import re
import struct
import subprocess
import sys
import tempfile
import unittest
import urllib.request
import zlib
from pathlib import Path

import numpy as np

from daemon import Daemon

ROOT = Path(__file__).resolve().parent.parent.parent
KDRAYD, KDRAY = sys.argv[1:3]
USUAL_URL = "http://127.0.0.1:8080"

# Commands that build everything or need Docker; and the start of the daemon, which runs here already.
NOT_RUN = {"server/run --demo", "server/run", "docker build -t kdray .",
           "docker run -p 8080:8080 -v kdray:/var/lib/kdray kdray",
           # install_test.py makes the packages of the programs that are built already.
           "server/dependencies.sh build package", "sudo apt install ./build/package/kdray_*.deb",
           "cmake --preset package && cmake --build --preset package && cpack --preset package",
           "systemctl status kdrayd",
           # python_package_test.py installs the package.
           "pip install ./clients/python", "python3 -m venv --system-site-packages venv",
           "venv/bin/pip install --no-build-isolation ./clients/python"}
DOCUMENTS = ("README.md", "clients/README.md", "clients/python/README.md")


def blocks(document):
    """(language, lines) of every fenced block."""
    return [(language, body.splitlines()) for language, body in
            re.findall(r"^```(\w*)\n(.*?)^```$", (ROOT / document).read_text(), re.MULTILINE | re.DOTALL)]


def commands(document):
    """[command, printed lines] of every "$ …"."""
    found = []
    for _, lines in blocks(document):
        is_command = False
        for line in lines:
            if line.startswith("$ "):
                found.append([line[2:], []])
                is_command = True
            elif is_command:
                found[-1][1].append(line)
    return found


def pattern_of(lines):
    def of_line(line):
        if line == "…":
            return "(?:.*\n)*?"
        return ".*?".join(re.escape(part) for part in line.split("…")) + "\n"

    return re.compile("".join(map(of_line, lines)) + r"\Z")


class Place:
    """A folder with links to what the examples name, and the daemon that they talk to."""

    def __init__(self):
        self.daemon = Daemon(KDRAYD)
        self.folder = Path(self.daemon.folder) / "place"
        programs = self.folder / "build/release/bin"
        programs.mkdir(parents=True)
        (programs / "kdray").symlink_to(KDRAY)
        (programs / "python3").symlink_to(sys.executable)  # the one that has NumPy
        (self.folder / "clients").symlink_to(ROOT / "clients")
        (self.folder / ".curlrc").write_text("no-progress-meter\n")  # as where curl writes to a terminal
        environment = {name: value for name, value in os.environ.items() if not name.startswith("KDRAY_")}
        self.environment = dict(environment, PATH=f"{programs}:{environment['PATH']}", CURL_HOME=str(self.folder),
                                KDRAY_SERVER=self.daemon.url, PYTHONPATH=str(ROOT / "clients/python"))

    def close(self):
        self.daemon.close()

    def here(self, text):
        return text.replace(USUAL_URL, self.daemon.url)

    def usual(self, text):
        return text.replace(self.daemon.url, USUAL_URL)

    def run(self, *arguments, **options):
        return subprocess.run(arguments, cwd=self.folder, env=self.environment, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, text=True, timeout=120, **options)


class ExamplesTest(unittest.TestCase):
    def place(self):
        place = Place()
        self.addCleanup(place.close)
        return place

    def run_commands(self, document, place):
        examples = [example for example in commands(document) if example[0] not in NOT_RUN]
        self.assertGreater(len(examples), 4)
        mark = "---- done with status"
        script = "".join(f"{place.here(command)}\necho \"{mark} $?\"\n" for command, _ in examples)
        printed = place.run("bash", input=script).stdout
        answers = re.findall("(.*?)" + mark + r" (\d+)\n", printed, re.DOTALL)
        self.assertEqual(len(answers), len(examples), printed)
        for (command, lines), (answer, status) in zip(examples, answers):
            with self.subTest(document=document, command=command):
                self.assertEqual(status, "0", answer)
                answer = place.usual(answer)
                if answer and not answer.endswith("\n"):
                    answer += "\n"
                if not pattern_of(lines).match(answer):
                    self.fail("printed\n" + answer + "instead of\n" + "\n".join(lines))

    def run_python(self, document, place):
        programs = [lines for language, lines in blocks(document) if language == "python"]
        for lines in programs:
            printed = []
            while lines[-1].startswith("# "):
                printed.insert(0, lines.pop()[2:])
            answer = place.run(sys.executable, "-c", place.here("\n".join(lines))).stdout
            with self.subTest(document=document, program=lines[0]):
                self.assertTrue(printed, "a block of Python ends with what it prints")
                self.assertRegex(answer, pattern_of(printed))

    def test_the_readme_prints_what_it_says(self):
        place = self.place()
        self.run_commands("README.md", place)
        self.run_python("README.md", place)

    def test_the_readme_of_the_clients_prints_what_it_says(self):
        place = self.place()
        self.run_commands("clients/README.md", place)
        self.run_python("clients/README.md", place)

    def test_the_readme_of_the_python_package_prints_what_it_says(self):
        place = self.place()
        place.run("kdray", "sample", "teapot", "-o", "teapot.ply")
        self.run_python("clients/python/README.md", place)

    def test_no_command_is_passed_over_for_nothing(self):
        shown = {command for document in DOCUMENTS for command, _ in commands(document)}
        self.assertEqual(NOT_RUN - shown, set())
        for document in DOCUMENTS:
            for language, lines in blocks(document):
                self.assertIn(language, ("", "python", "cmake", "cpp"), f"{document}: a block that no test runs: {lines[0]}")

    def test_a_difference_is_seen(self):
        self.assertTrue(pattern_of(["a…b", "…", "z"]).match("a1b\n2\n3\nz\n"))
        for printed in ("a1c\nz\n", "a1b\n", "a1b\nz\nmore\n", "more\na1b\nz\n"):
            self.assertFalse(pattern_of(["a…b", "…", "z"]).match(printed), printed)


def decode_png(data):
    """Rows of a PNG of 8 bits a channel that is not interlaced, as (height, width, channels)."""
    header, packed, at = None, b"", 8
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at:at + 8])
        body = data[at + 8:at + 8 + size]
        at += 12 + size
        if kind == b"IHDR":
            header = struct.unpack(">IIBBBBB", body)
        elif kind == b"IDAT":
            packed += body
    width, height, depth, colour, *_, interlaced = header
    channels = {0: 1, 2: 3, 4: 2, 6: 4}[colour]
    assert depth == 8 and not interlaced
    rows = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(height, 1 + width * channels)
    image = np.zeros((height + 1, width + 1, channels), int)  # a row above and a pixel before, of zeros
    for y in range(height):
        kind, row = rows[y, 0], rows[y, 1:].reshape(width, channels).astype(int)
        above = image[y]
        for x in range(width) if kind in (1, 3, 4) else ():
            left, up, corner = image[y + 1, x], above[x + 1], above[x]
            if kind == 1:
                guess = left
            elif kind == 3:
                guess = (left + up) // 2
            else:
                base = left + up - corner
                distances = np.abs(np.stack([base - left, base - up, base - corner]))
                guess = np.choose(np.argmin(distances, 0), [left, up, corner])
            image[y + 1, x + 1] = (row[x] + guess) % 256
        if kind in (0, 2):
            image[y + 1, 1:] = (row + (above[1:] if kind == 2 else 0)) % 256
    return image[1:, 1:]


class PictureTest(unittest.TestCase):
    def test_the_readmes_picture_is_made_by_the_request_below_it(self):
        meshes = Path(os.environ.get("KDRAY_MESHES") or ROOT.parent / "shared/meshes")
        bunny = meshes / "stanford_bunny_69k_ascii.ply"
        if not bunny.exists():
            self.skipTest(f"{bunny} is not there")
        query = re.search(r"^GET …/(render\.png\?.*(?:\n +&.*)*)$", (ROOT / "README.md").read_text(), re.MULTILINE)[1]
        query = "".join(query.split())  # of several lines
        with Daemon(KDRAYD) as daemon:
            trees = daemon.url + "/v1/trees?build=kd-sah"
            tree = urllib.request.urlopen(trees, bunny.read_bytes()).headers["Location"]
            # The deadline changes nothing of a picture; sanitizers take their time.
            picture = urllib.request.urlopen(f"{daemon.url}{tree}/{query}&deadline_ms=600000").read()
        committed = (ROOT / "docs/bunny-kdtree.png").read_bytes()
        if picture == committed:
            return
        # The compression belongs to a library. The pixels are the same on every machine; one in a thousand may change with the
        # last bits of vertices, as when `auto` picks another precision. Other cuts of the tree change one in ten.
        rendered, expected = decode_png(picture), decode_png(committed)
        if rendered.shape == expected.shape and (rendered != expected).any(-1).mean() <= 0.001:
            return
        kept = Path(tempfile.gettempdir()) / "kdray-bunny-kdtree.png"
        kept.write_bytes(picture)
        self.fail(f"docs/bunny-kdtree.png is not what the request in README.md renders. Look at {kept}: if it is right, commit it.")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
