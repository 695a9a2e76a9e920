"""The viewer page in a real browser against the real daemon: browser_test.py KDRAYD KDRAY [SCREENSHOT.png]"""
import json
import os
import shutil
import subprocess
import sys
import unittest
import urllib.parse
import urllib.request

import numpy as np

from daemon import Daemon
from prefix_proxy import PrefixProxy
from webdriver import Browser

if not shutil.which("chromedriver"):
    print("chromium-driver is not installed: the page is not tested")
    sys.exit(77)
KDRAYD, KDRAY = sys.argv[1:3]
SCREENSHOT = sys.argv[3] if len(sys.argv) > 3 else None

SETTLED = "return document.querySelector('#canvas').dataset.quality === 'fine'"
# Sum and number of the canvas's opaque pixels: two pictures that look different give different ones.
FINGERPRINT = """
    const canvas = document.querySelector('#canvas');
    const pixels = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
    let sum = 0, opaque = 0;
    for (let i = 0; i < pixels.length; i += 4) {
      if (pixels[i + 3] > 127) ++opaque;
      sum = (sum * 31 + pixels[i] + pixels[i + 1] * 3 + pixels[i + 2] * 7 + pixels[i + 3]) % 1000003;
    }
    return [sum, opaque, canvas.width * canvas.height];"""


class PageTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.daemon = Daemon(KDRAYD)
        cls.addClassCleanup(cls.daemon.close)
        cls.teapot = os.path.join(cls.daemon.folder, "teapot.ply")
        subprocess.run([KDRAY, "-q", "sample", "teapot", "-o", cls.teapot], check=True)
        cls.shared = Browser(1000, 700)
        cls.addClassCleanup(cls.shared.close)

    def browser(self, width=None, height=None):
        """The one browser of these tests with an empty page, or one of its own for another size."""
        if width is None:
            self.shared.open("about:blank")
            return self.shared
        browser = Browser(width, height)
        self.addCleanup(browser.close)
        return browser

    def kdray(self, *arguments):
        return subprocess.run([KDRAY, "-q", "--server", self.daemon.url, *arguments], check=True,
                              capture_output=True, text=True).stdout.strip()

    def open_with_teapot(self, **options):
        tree = self.kdray("upload", self.teapot)
        browser = self.browser(**options)
        browser.console()  # what earlier pages said
        browser.open(f"{self.daemon.url}/#tree={tree}")
        browser.wait(SETTLED)
        return browser

    def change(self, browser, action):
        """Does it, waits for the new picture, and gives the fingerprints before and after."""
        before = browser.run(FINGERPRINT)
        browser.run("delete document.querySelector('#canvas').dataset.quality")
        action()
        browser.wait(SETTLED)
        return before, browser.run(FINGERPRINT)

    def test_a_chosen_file_becomes_a_picture(self):
        browser = self.browser()
        browser.open(self.daemon.url + "/")
        browser.wait("return document.querySelector('#version').textContent !== ''")
        unique = os.path.join(self.daemon.folder, "ring <b>.ply")
        subprocess.run([KDRAY, "-q", "sample", "torus", "-o", unique], check=True)
        browser.type("#file", unique)
        # The name is shown as it is: a file name is no markup.
        browser.wait("return document.querySelector('#tree-name').textContent === 'ring <b>.ply'")
        browser.wait(SETTLED)
        _, opaque, pixels = browser.run(FINGERPRINT)
        self.assertTrue(0.1 < opaque / pixels < 0.9, (opaque, pixels))
        self.assertIn("closed", browser.run("return document.querySelector('#health-facts').textContent"))
        self.assertEqual(browser.run("return document.querySelectorAll('#uploads li').length"), 0)

    def test_it_offers_what_the_server_has(self):
        browser = self.browser()
        browser.open(self.daemon.url + "/")
        browser.wait("return document.querySelector('#version').textContent !== ''")
        with urllib.request.urlopen(self.daemon.url + "/v1") as answer:
            capabilities = json.load(answer)
        with urllib.request.urlopen(self.daemon.url + "/openapi.json") as answer:
            fields = json.load(answer)["components"]["schemas"]["RenderRequest"]["properties"]
        formats = capabilities["formats"]
        self.assertEqual(browser.run("return document.querySelector('#file').accept").split(","),
                         [f".{name}" for name in formats])
        self.assertIn(", ".join(formats).upper(), browser.run("return document.querySelector('#empty').textContent"))
        modes = [name for name in fields["mode"]["enum"] if name != "position"]  # which has no picture
        # The page turns a mesh in front of a camera; a panorama has none in front.
        projections = [name for name in fields["projection"]["enum"] if name != "spherical"]
        for select, names in (("#mode", modes), ("#projection", projections),
                              ("#precision", capabilities["precisions"]), ("#build", capabilities["builds"])):
            self.assertEqual(browser.run(f"return [...document.querySelector('{select}').options].map((o) => o.value)"),
                             names)

    def test_a_dropped_file_is_uploaded(self):
        browser = self.browser()
        browser.open(self.daemon.url + "/")
        browser.wait("return document.querySelector('#version').textContent !== ''")
        browser.run("""const data = new DataTransfer();
            data.items.add(new File(['v 0 0 0\\nv 1 0 0\\nv 0 1 0\\nf 1 2 3\\n'], 'dropped.obj'));
            dispatchEvent(new DragEvent('drop', {dataTransfer: data, cancelable: true}));""")
        browser.wait("return document.querySelector('#tree-name').textContent === 'dropped.obj'")
        browser.wait(SETTLED)

    def test_a_broken_file_is_shown_with_its_reason(self):
        broken = os.path.join(self.daemon.folder, "broken.obj")
        with open(broken, "w") as file:
            file.write("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")
        browser = self.browser()
        browser.open(self.daemon.url + "/")
        browser.wait("return document.querySelector('#version').textContent !== ''")
        browser.type("#file", broken)
        card = browser.wait("return document.querySelector('#uploads .failed')?.textContent")
        self.assertIn("invalid_mesh", card)
        self.assertIn("line 4", card)

    def test_the_mouse_turns_moves_and_zooms(self):
        browser = self.open_with_teapot()
        for name, action in (("turn", lambda: browser.drag("#canvas", (0, 0), (150, 40))),
                             ("pan", lambda: browser.drag("#canvas", (0, 0), (80, 0), button=2)),
                             ("zoom", lambda: browser.wheel("#canvas", -300))):
            with self.subTest(name):
                before, after = self.change(browser, action)
                self.assertNotEqual(before, after)
        before, after = self.change(browser, lambda: browser.wheel("#canvas", 500))
        self.assertLess(after[1], before[1])  # farther away: fewer pixels

    def test_two_fingers_zoom(self):
        browser = self.open_with_teapot()
        before, after = self.change(browser, lambda: browser.pinch("#canvas", 120, 60))
        self.assertLess(after[1], 0.5 * before[1])  # half the size: a quarter of the pixels

    def test_keys_turn_and_home_brings_the_view_back(self):
        browser = self.open_with_teapot()
        start = browser.run(FINGERPRINT)
        browser.run("document.querySelector('#canvas').focus()")
        arrow_left, home = "\ue012", "\ue011"
        _, turned = self.change(browser, lambda: browser.key(arrow_left))
        self.assertNotEqual(start, turned)
        _, back = self.change(browser, lambda: browser.key(home))
        self.assertEqual(start, back)

    def test_modes_projection_and_cells_change_the_picture(self):
        browser = self.open_with_teapot()
        for field, value in (("#mode", "normal"), ("#mode", "shaded"), ("#cells", "5"),
                             ("#projection", "orthographic"), ("#up", "z")):
            with self.subTest(field=field, value=value):
                before, after = self.change(browser, lambda: browser.choose(field, value))
                self.assertNotEqual(before, after)
        for mode in ("depth", "triangle"):  # never refined: these take one sample a pixel
            browser.choose("#mode", mode)
            browser.wait("return document.querySelector('#canvas').dataset.quality === 'full'")

    def test_a_click_shoots_a_ray_and_marks_the_hit_where_it_was_clicked(self):
        browser = self.open_with_teapot()
        browser.press("#canvas", (20, 30))
        browser.wait("return document.querySelector('#hit-facts').textContent.includes('Triangle')")
        marker, clicked = browser.run("""
            const box = document.querySelector('#marker').getBoundingClientRect();
            const stage = document.querySelector('#canvas').getBoundingClientRect();
            return [[box.x + box.width / 2, box.y + box.height / 2],
                    [stage.x + stage.width / 2 + 20, stage.y + stage.height / 2 + 30]];""")
        for got, expected in zip(marker, clicked):
            self.assertAlmostEqual(got, expected, delta=1.5)
        corner = browser.run("""const canvas = document.querySelector('#canvas');
            return [-canvas.clientWidth / 2 + 5, -canvas.clientHeight / 2 + 5]""")
        browser.press("#canvas", corner)
        browser.wait("return document.querySelector('#hit-facts').textContent.includes('nothing')")

    def test_the_pages_camera_is_the_servers(self):
        # The triangle that a click hits is the one that the server draws at that pixel.
        browser = self.open_with_teapot()
        for projection in ("perspective", "orthographic"):
            with self.subTest(projection):
                browser.choose("#projection", projection)
                self.change(browser, lambda: browser.drag("#canvas", (0, 0), (70, -25)))
                browser.run("document.querySelector('#hit').hidden = true")
                browser.press("#canvas", (31, 17))
                browser.wait("return !document.querySelector('#hit').hidden")
                triangle, width, height = browser.run("""
                    const canvas = document.querySelector('#canvas');
                    const shown = document.querySelector('#hit-facts dd').textContent;
                    return [Number(shown.replaceAll(',', '')), canvas.width, canvas.height];""")
                x, y = width // 2 + 31, height // 2 + 17
                around = self.triangles(browser, width, height)[y - 1:y + 2, x - 1:x + 2]
                self.assertIsNotNone(triangle)  # NaN: the ray met nothing
                self.assertIn(triangle, around)

    def triangles(self, browser, width, height):
        """The server's triangle image with the camera of the page's address."""
        fragment = browser.run("return location.hash.slice(1)")
        view = dict(urllib.parse.parse_qsl(fragment))
        tree = view.pop("tree")
        view.update(mode="triangle", width=width, height=height)
        image = os.path.join(self.daemon.folder, "triangles.npy")
        self.kdray("render", tree, "-o", image,
                   *[f"--{name.replace('_', '-')}={value}" for name, value in view.items()])
        return np.load(image)

    def test_a_link_brings_the_same_picture_back(self):
        browser = self.open_with_teapot()
        _, turned = self.change(browser, lambda: browser.drag("#canvas", (0, 0), (-90, 60)))
        fragment = browser.run("return location.hash")
        self.assertIn("eye=", fragment)
        other = self.browser()
        other.open(self.daemon.url + "/" + fragment)
        other.wait(SETTLED)
        self.assertEqual(other.run(FINGERPRINT), turned)

    def test_the_copied_command_renders_the_picture(self):
        if not shutil.which("curl"):
            self.skipTest("curl is not installed")
        browser = self.open_with_teapot()
        browser.run("""window.copied = '';
            navigator.clipboard.writeText = async (text) => { window.copied = text; };""")
        browser.click("#curl")
        command = browser.wait("return window.copied")
        subprocess.run(["sh", "-c", command], cwd=self.daemon.folder, check=True)
        with open(os.path.join(self.daemon.folder, "kdray.png"), "rb") as file:
            self.assertEqual(file.read(8), b"\x89PNG\r\n\x1a\n")

    def test_another_build_and_deleting(self):
        browser = self.open_with_teapot()
        _, _ = self.change(browser, lambda: browser.choose("#rebuild", "bvh"))
        tree = browser.run("return document.querySelector('#tree-id').textContent")
        self.assertTrue(tree.endswith("-bvh"), tree)
        browser.run("window.confirm = () => true")
        browser.click("#delete")
        browser.wait("return document.querySelector('#tree').hidden")
        self.assertNotIn(tree, self.kdray("list", "--full"))

    def test_a_token_is_asked_for_once(self):
        token_file = os.path.join(self.daemon.folder, "token")
        with open(token_file, "w") as file:
            file.write("sesame-open-please-0123456789abcdef\n")
        os.chmod(token_file, 0o600)
        with Daemon(KDRAYD, "--token-file", token_file) as guarded:
            browser = self.browser()
            browser.open(guarded.url + "/")
            browser.wait("return document.querySelector('#token-dialog').open")
            browser.type("#token", "sesame-open-please-0123456789abcdef\n")
            browser.wait("return document.querySelector('#version').textContent !== ''")
            browser.type("#file", self.teapot)
            browser.wait(SETTLED)
            self.assertFalse(browser.run("return document.querySelector('#token-dialog').open"))

    def test_nothing_is_loaded_from_elsewhere_and_no_policy_is_broken(self):
        browser = self.open_with_teapot()
        hosts = browser.run("""return [...new Set(performance.getEntriesByType('resource')
            .map((entry) => new URL(entry.name).origin))]""")
        self.assertEqual(hosts, [self.daemon.url])
        for entry in browser.console():
            self.assertNotIn("Content Security Policy", entry["message"])
            self.assertNotEqual(entry["source"], "javascript", entry["message"])

    def test_it_works_under_a_path_of_a_proxy(self):
        tree = self.kdray("upload", self.teapot)
        with PrefixProxy(self.daemon.url, "/tools/rays") as proxy:
            browser = self.browser()
            browser.open(f"{proxy.url}/#tree={tree}")
            browser.wait(SETTLED)
            paths = browser.run("""return performance.getEntriesByType('resource')
                .map((entry) => new URL(entry.name).pathname)""")
            for path in paths:
                self.assertTrue(path.startswith("/tools/rays/"), path)

    def test_it_fits_a_telephone(self):
        browser = self.open_with_teapot(width=500, height=900)
        wide = browser.run("return document.documentElement.scrollWidth - innerWidth")
        self.assertLessEqual(wide, 0)

    def test_a_screenshot_for_people(self):
        if not SCREENSHOT:
            self.skipTest("no file named for it")
        browser = self.open_with_teapot(width=1360, height=900)
        self.change(browser, lambda: browser.choose("#cells", "7"))
        browser.press("#canvas", (20, 30))
        browser.wait("return !document.querySelector('#marker').hidden")
        browser.screenshot(SCREENSHOT)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
