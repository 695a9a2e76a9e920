# SPDX-License-Identifier: Apache-2.0
"""What the tests of the viewer page share: a daemon, a browser, meshes, waiting for pictures."""
import json
import os
import shutil
import subprocess
import sys
import time
import unittest
import urllib.parse
import urllib.request

from daemon import Daemon
from webdriver import Browser

if not shutil.which("chromedriver"):
    print("chromium-driver is not installed: the page is not tested")
    sys.exit(77)
KDRAYD, KDRAY = sys.argv[1:3]

SETTLED = "return document.querySelector('#canvas').dataset.settled === 'true'"
STARTED = "return document.querySelector('#version').textContent !== ''"
# Sum and number of the canvas's opaque pixels: different for pictures that look different.
FINGERPRINT = """
    const canvas = document.querySelector('#canvas');
    const pixels = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
    let sum = 0, opaque = 0;
    for (let i = 0; i < pixels.length; i += 4) {
      if (pixels[i + 3] > 127) ++opaque;
      sum = (sum * 31 + pixels[i] + pixels[i + 1] * 3 + pixels[i + 2] * 7 + pixels[i + 3])
          % 1000003;
    }
    return [sum, opaque, canvas.width * canvas.height];"""


class PageTest(unittest.TestCase):
    """Each class has a daemon and a browser; each test begins with an empty page."""
    SIZE = (1000, 700)

    @classmethod
    def setUpClass(cls):
        cls.daemon = Daemon(KDRAYD)
        cls.addClassCleanup(cls.daemon.close)
        cls.teapot = cls.sample("teapot.ply")
        cls.browser = Browser(*cls.SIZE)
        cls.addClassCleanup(cls.browser.close)

    def setUp(self):
        self.browser.open("about:blank")
        self.browser.size(*self.SIZE)
        self.browser.prefer("light")
        self.browser.console()  # what earlier pages said

    @classmethod
    def sample(cls, name, *options):
        """The path of a mesh file; its shape is the name up to a dash or the dot."""
        path = os.path.join(cls.daemon.folder, name)
        shape = os.path.splitext(name)[0].split("-")[0]
        subprocess.run([KDRAY, "-q", "sample", shape, "-o", path, *options], check=True)
        return path

    def kdray(self, *arguments):
        return subprocess.run([KDRAY, "-q", "--server", self.daemon.url, *arguments], check=True,
                              capture_output=True, text=True).stdout.strip()

    def ask(self, path, body=None):
        """The daemon's JSON answer; `body` makes it a POST."""
        request = urllib.request.Request(self.daemon.url + path, body and json.dumps(body).encode())
        with urllib.request.urlopen(request) as answer:
            return json.load(answer)

    def open_page(self, fragment="", url=None):
        self.browser.open("about:blank")  # another fragment alone would not load the page again
        self.browser.open(f"{url or self.daemon.url}/{fragment}")
        self.browser.wait(STARTED)
        return self.browser

    def open_tree(self, mesh=None, fragment="", url=None):
        """The page with a mesh in it, when its picture is complete."""
        self.tree = self.kdray("upload", mesh or self.teapot)
        self.open_page(f"#tree={self.tree}{fragment}", url)
        self.browser.wait(SETTLED)
        return self.browser

    def change(self, action):
        """Does it, waits for the new picture, and gives the fingerprints before and after."""
        before = self.browser.run(FINGERPRINT)
        self.browser.run("delete document.querySelector('#canvas').dataset.settled")
        action()
        self.browser.wait(SETTLED)
        return before, self.browser.run(FINGERPRINT)

    def wait_for(self, condition, seconds=10):
        """Until a function of the test returns true."""
        deadline = time.monotonic() + seconds
        while not condition():
            self.assertLess(time.monotonic(), deadline, f"still not true after {seconds} s")
            time.sleep(0.02)

    def text(self, selector):
        return self.browser.run(f"return document.querySelector('{selector}').textContent")

    def is_shown(self, selector):
        return self.browser.run(f"return document.querySelector('{selector}').checkVisibility()")

    def wait_text(self, selector, part):
        """Until an element's text contains this."""
        self.browser.wait("""return document.querySelector(arguments[0])?.textContent
            .includes(arguments[1])""", selector, part)

    def click_now(self, selector):
        """Clicks also what a menu hides."""
        self.browser.run("document.querySelector(arguments[0]).click()", selector)

    def texts(self, selector):
        return self.browser.run("""return [...document.querySelectorAll(arguments[0])]
            .map((element) => element.textContent)""", selector)

    def count(self, selector):
        return self.browser.run("return document.querySelectorAll(arguments[0]).length", selector)

    def wait_shown(self, selector, seconds=20):
        script = f"return document.querySelector('{selector}').checkVisibility()"
        self.browser.wait(script, seconds=seconds)

    def link(self):
        """The values of the page's address."""
        return dict(urllib.parse.parse_qsl(self.browser.run("return location.hash.slice(1)")))

    def shoot(self, place=(20, 30)):
        """Clicks the picture and waits for all that the page finds out."""
        self.click_now("#clear-ray")  # what is shown afterwards is of this ray
        self.browser.press("#canvas", place)
        self.browser.wait("""return document.querySelector('#ray-cells').checkVisibility() &&
            document.querySelector('#precisions').checkVisibility() &&
            document.querySelector('#crossings').textContent !== '…'""")

    def wait_name(self, name, seconds=20):
        """Until the tree in the page has this name."""
        self.browser.wait("return document.querySelector('#tree-name').textContent === arguments[0]",
                          name, seconds=seconds)

    def facts(self, selector):
        """A list of facts as a dictionary."""
        return dict(self.browser.run(f"""return [...document.querySelectorAll('{selector} dt')]
            .map((name) => [name.textContent, name.nextElementSibling.textContent])"""))

    def table(self, selector):
        """The texts of a table's rows, without its head."""
        return self.browser.run(f"""return [...document.querySelectorAll('{selector} tbody tr')]
            .map((row) => [...row.cells].map((cell) => cell.textContent))""")


def main():
    unittest.main(argv=sys.argv[:1], verbosity=2)
