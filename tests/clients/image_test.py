# SPDX-License-Identifier: Apache-2.0
"""What the Dockerfile promises: image_test.py KDRAYD KDRAY

The image itself is built elsewhere; here the daemon runs with the image's environment.
"""
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
import unittest
import urllib.error
import urllib.request
from pathlib import Path

from daemon import Daemon

KDRAYD, KDRAY = sys.argv[1:3]
ROOT = Path(__file__).resolve().parent.parent.parent
DOCKERFILE = (ROOT / "Dockerfile").read_text().replace("\\\n", " ")


def pairs(instruction):
    return dict(re.findall(r'([\w.]+)=(?:"([^"]*)"|(?=\S))', " ".join(
        line for line in DOCKERFILE.splitlines() if line.startswith(instruction + " "))))


class ImageTest(unittest.TestCase):
    def test_labels_say_what_it_is(self):
        labels = pairs("LABEL")
        version = re.search(r"project\(kdray VERSION (\S+)", (ROOT / "CMakeLists.txt").read_text())[1]
        self.assertEqual(labels["org.opencontainers.image.version"], version)
        self.assertRegex((ROOT / "CHANGELOG.md").read_text(), rf"(?m)^## {re.escape(version)} \(\d{{4}}-\d\d-\d\d\)$")
        self.assertEqual(labels["org.opencontainers.image.licenses"], "Apache-2.0")
        for name in ("title", "description"):
            self.assertTrue(labels["org.opencontainers.image." + name])

    def test_its_stages_name_the_base_itself(self):
        # The buildah of Debian 12 does not find a stage that an argument names.
        bases = re.findall(r"^FROM (\S+)", DOCKERFILE, re.MULTILINE)
        self.assertEqual(set(bases), {"${BASE:-debian:bookworm-slim}"})

    def test_its_health_check_asks_the_daemon(self):
        command = json.loads(re.search(r"^HEALTHCHECK .*? CMD +(\[.*\])$", DOCKERFILE, re.MULTILINE)[1])

        def check(port):
            return subprocess.run(command, env=dict(os.environ, KDRAY_PORT=port), stderr=subprocess.DEVNULL).returncode

        with Daemon(KDRAYD) as daemon:
            port = daemon.url.rpartition(":")[2]
            self.assertEqual(check(port), 0)
        self.assertNotEqual(check(port), 0)

    def test_docker_stop_is_soon_enough_during_a_long_render(self):
        environment = dict(re.findall(r"(KDRAY_\w+)=(\S+)", re.search(r"^ENV (.*)$", DOCKERFILE, re.MULTILINE)[1]))
        self.assertIn("KDRAY_DRAIN_TIMEOUT_MS", environment)
        # `docker stop` waits 10 s and then kills.
        with Daemon(KDRAYD, "--drain-timeout-ms", environment["KDRAY_DRAIN_TIMEOUT_MS"]) as daemon:
            mesh = os.path.join(daemon.folder, "terrain.ply")
            subprocess.run([KDRAY, "-q", "sample", "terrain", "-o", mesh], check=True)
            tree = subprocess.run([KDRAY, "-q", "--server", daemon.url, "upload", mesh], check=True, capture_output=True,
                                  text=True).stdout.strip()
            ended = []

            def render():
                try:
                    urllib.request.urlopen(f"{daemon.url}/v1/trees/{tree}/render.png?width=8192&height=8192"
                                           "&mode=ambient-occlusion&samples=1024&deadline_ms=60000").read()
                except (OSError, urllib.error.URLError) as error:
                    ended.append(error)

            thread = threading.Thread(target=render)
            thread.start()
            time.sleep(1)
            begin = time.monotonic()
            daemon._process.send_signal(signal.SIGTERM)
            self.assertEqual(daemon._process.wait(timeout=30), 0)
            took = time.monotonic() - begin
            thread.join()
            self.assertTrue(ended)
            self.assertNotEqual(getattr(ended[0], "code", 0), 400, "the render was to be long")
            self.assertLess(took, 9)
            self.assertGreater(took, 3, "there was nothing to wait for")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
