# SPDX-License-Identifier: Apache-2.0
"""The viewer page in a real browser: the camera, what moves it, and the pictures it asks for."""
import os
import time
import urllib.parse

import numpy as np

from page import SETTLED, PageTest, main
from prefix_proxy import PrefixProxy

# Widths of the pictures that the page has asked for, without those of its list.
WIDTHS = """return performance.getEntriesByType('resource')
    .map((entry) => new URL(entry.name)).filter((url) => url.pathname.endsWith('render.png'))
    .map((url) => Number(url.searchParams.get('width'))).filter((width) => width > 96)"""


class BrowserPictureTest(PageTest):
    def test_the_mouse_turns_moves_and_zooms(self):
        browser = self.open_tree()
        for name, action in (("turn", lambda: browser.drag("#canvas", (0, 0), (150, 40))),
                             ("pan", lambda: browser.drag("#canvas", (0, 0), (80, 0), button=2)),
                             ("zoom", lambda: browser.wheel("#canvas", -300))):
            with self.subTest(name):
                before, after = self.change(action)
                self.assertNotEqual(before, after)
        before, after = self.change(lambda: browser.wheel("#canvas", 500))
        self.assertLess(after[1], before[1])  # farther away: fewer pixels

    def test_the_wheel_zooms_to_the_cursor(self):
        browser = self.open_tree()
        for projection in ("perspective", "orthographic"):
            with self.subTest(projection):
                browser.choose("#projection", projection)
                browser.wait(SETTLED)
                place = (40, 30)
                self.shoot(place)
                before = self.marker()
                self.change(lambda: browser.wheel("#canvas", -400, place))
                for got, expected in zip(self.marker(), before):
                    self.assertAlmostEqual(got, expected, delta=12)
                self.assertLess(self.view_height(), 0.7 * self.start_height)

    def view_height(self):
        """Of the view at its target, in mesh units."""
        view = self.link()
        eye, target = (np.array(view[name].split(","), float) for name in ("eye", "target"))
        if view["projection"] == "orthographic":
            return float(view["view_height"])
        return 2 * np.linalg.norm(eye - target) * np.tan(np.radians(float(view["fov_deg"])) / 2)

    def open_tree(self, *arguments, **named):
        browser = super().open_tree(*arguments, **named)
        self.start_height = self.view_height()
        return browser

    def marker(self):
        """The middle of the hit's mark, in pixels of the window."""
        return self.middle("#marker")

    def middle(self, selector="#canvas"):
        return self.browser.run("""
            const box = document.querySelector(arguments[0]).getBoundingClientRect();
            return [box.x + box.width / 2, box.y + box.height / 2]""", selector)

    def test_two_fingers_zoom(self):
        browser = self.open_tree()
        before, after = self.change(lambda: browser.pinch("#canvas", 120, 60))
        self.assertLess(after[1], 0.5 * before[1])  # half the size: a quarter of the pixels

    def test_a_double_click_sets_the_pivot(self):
        for pointer in ("mouse", "touch"):
            with self.subTest(pointer):
                browser = self.open_tree()
                self.change(lambda: browser.press("#canvas", (50, -20), times=2, pointer=pointer))
                hit = np.array(self.facts("#hit-facts")["Point"].split(", "), float)
                target = np.array(self.link()["target"].split(","), float)
                np.testing.assert_allclose(target, hit, rtol=1e-5, atol=1e-5)
                for got, expected in zip(self.marker(), self.middle()):
                    self.assertAlmostEqual(got, expected, delta=1)
                # Turning leaves it there.
                self.change(lambda: browser.drag("#canvas", (0, 0), (60, 30)))
                for got, expected in zip(self.marker(), self.middle()):
                    self.assertAlmostEqual(got, expected, delta=1)

    def test_keys_turn_and_home_brings_the_view_back(self):
        browser = self.open_tree()
        browser.run("document.querySelector('#canvas').focus()")
        arrow_left, home, enter = "\ue012", "\ue011", "\ue007"
        start, turned = self.change(lambda: browser.key(arrow_left))
        self.assertNotEqual(start, turned)
        _, back = self.change(lambda: browser.key(home))
        self.assertEqual(start, back)
        _, cells = self.change(lambda: browser.key("]"))
        self.assertNotEqual(back, cells)
        self.assertEqual(self.link()["cells_depth"], "0")
        browser.key(enter)
        self.wait_text("#hit-facts", "Triangle")

    def test_modes_projection_lights_and_cells_change_the_picture(self):
        browser = self.open_tree()
        for field, value in (("#mode", "normal"), ("#mode", "shaded"), ("#cells", "5"),
                             ("#projection", "orthographic"), ("#light", "studio"),
                             ("#light", "sun"), ("#sun-azimuth", "60"), ("#mode", "cost"),
                             ("#mode", "ambient-occlusion"), ("#mode", "depth"),
                             ("#mode", "triangle"), ("#side", "front")):
            with self.subTest(field=field, value=value):
                before, after = self.change(lambda: browser.choose(field, value))
                self.assertNotEqual(before, after)
        for name in ("up-z", "edges"):
            with self.subTest(name):
                before, after = self.change(lambda: self.click_now(f"#{name}"))
                self.assertNotEqual(before, after)
        self.assertEqual(browser.errors(), [])

    def test_shadows_need_a_light_that_casts_them(self):
        browser = self.open_tree()
        self.assertTrue(browser.run("return document.querySelector('#shadows').disabled"))
        self.change(lambda: browser.choose("#light", "sun"))
        before, after = self.change(lambda: self.click_now("#shadows"))
        self.assertNotEqual(before, after)
        before, after = self.change(lambda: browser.choose("#mode", "normal"))
        self.assertTrue(browser.run("return document.querySelector('#shadows').disabled"))
        self.assertEqual(browser.errors(), [])

    def test_the_up_axis_is_guessed_from_format_and_box(self):
        browser = self.open_tree()
        box = {"min": [-1, -1, -1], "max": [1, 1, 1]}
        terrain = {"min": [0, 0, -3], "max": [100, 90, 5]}
        shallow = {"min": [0, 0, 0], "max": [100, 5, 90]}
        standing = {"min": [-1, -2, 0], "max": [1, 2, 4]}
        cases = [("stl", box, "z"), ("obj", box, "y"), ("ply", box, "y"), ("off", box, "y"),
                 ("glb", box, "y"), ("gltf", terrain, "y"), ("obj", terrain, "z"),
                 ("stl", shallow, "y"), ("ply", standing, "z"), ("stl", None, "z")]
        guesses = browser.run("""const { guessUpAxis } = await import('./up_axis.js');
            return arguments[0].map(([format, bounds]) => guessUpAxis({format, bounds}))""",
                              [case[:2] for case in cases])
        self.assertEqual(guesses, [case[2] for case in cases])
        self.open_tree(self.sample("terrain-small.stl", "--detail", "32"))
        self.assertIn(self.link()["up"], ("0,1,0", "0,0,1"))
        other = "z" if self.link()["up"] == "0,1,0" else "y"
        self.change(lambda: browser.run(f"document.querySelector('#up-{other}').click()"))
        self.assertEqual(self.link()["up"], {"y": "0,1,0", "z": "0,0,1"}[other])

    def test_the_pages_camera_is_the_servers(self):
        # The triangle that a click hits is the one that the server draws at that pixel.
        browser = self.open_tree()
        for projection in ("perspective", "orthographic"):
            with self.subTest(projection):
                browser.choose("#projection", projection)
                self.change(lambda: browser.drag("#canvas", (0, 0), (70, -25)))
                self.shoot((31, 17))
                triangle = int(self.facts("#hit-facts")["Triangle"].replace(",", ""))
                width, height = browser.run("""const canvas = document.querySelector('#canvas');
                    return [canvas.width, canvas.height]""")
                x, y = width // 2 + 31, height // 2 + 17
                self.assertIn(triangle, self.triangles(width, height)[y - 1:y + 2, x - 1:x + 2])

    def triangles(self, width, height):
        """The server's triangle image with the camera of the page's address."""
        link = self.link()
        camera = ("eye", "target", "up", "projection", "fov_deg", "view_height")
        view = {name: link[name] for name in camera if name in link}
        view.update(mode="triangle", width=width, height=height)
        image = os.path.join(self.daemon.folder, "triangles.npy")
        self.kdray("render", self.tree, "-o", image,
                   *[f"--{name.replace('_', '-')}={value}" for name, value in view.items()])
        return np.load(image)

    def test_a_click_marks_the_hit_where_it_was_clicked(self):
        browser = self.open_tree()
        self.shoot((20, 30))
        middle = self.middle()
        for got, expected in zip(self.marker(), (middle[0] + 20, middle[1] + 30)):
            self.assertAlmostEqual(got, expected, delta=1.5)
        corner = browser.run("""const canvas = document.querySelector('#canvas');
            return [-canvas.clientWidth / 2 + 5, -canvas.clientHeight / 2 + 5]""")
        browser.press("#canvas", corner)
        self.wait_text("#hit-facts", "nothing")
        self.assertFalse(self.is_shown("#marker"))

    def test_moving_pictures_are_rough_but_no_stamps(self):
        browser = self.open_tree()
        browser.run("performance.clearResourceTimings()")
        self.change(lambda: browser.drag("#canvas", (0, 0), (150, 40), steps=20))
        css_width, width = browser.run("""const canvas = document.querySelector('#canvas');
            return [canvas.clientWidth, canvas.width]""")
        widths = browser.run(WIDTHS)
        rough = [w for w in widths if w < width]
        # The quicker the machine, the sooner the moving pictures are whole ones.
        self.assertGreater(len(rough), 0, widths)
        self.assertGreaterEqual(min(rough), 0.49 * css_width)
        self.assertEqual(widths[-1], width)

    def test_a_click_is_answered_before_the_pages_own_pictures_which_are_cancelled(self):
        def delay(path):
            query = dict(urllib.parse.parse_qsl(path.partition("?")[2]))
            return 15 if "render.png" in path and int(query["width"]) >= 450 else 0

        with PrefixProxy(self.daemon.url, "/slow", delay) as proxy:
            tree = self.kdray("upload", self.teapot)
            browser = self.open_page(f"#tree={tree}", proxy.url)
            browser.wait("return document.querySelector('#canvas').dataset.stage === 'rough'")
            browser.wait("return document.querySelector('#busy').checkVisibility()")
            self.assertEqual(proxy.dropped, [])
            started = time.monotonic()
            browser.press("#canvas", (20, 30))
            self.wait_text("#hit-facts", "Triangle")
            self.assertLess(time.monotonic() - started, 3)
            self.wait_for(lambda: len(proxy.dropped) == 1)
            # It is asked for again after the answer, and cancelled again when the camera moves.
            self.wait_for(lambda: proxy.waiting == 1)
            browser.drag("#canvas", (0, 0), (40, 10))
            self.wait_for(lambda: len(proxy.dropped) >= 2)  # more if the drag pauses
            browser.open("about:blank")  # ends the last request

    def test_pans_and_zooms_are_seen_before_the_next_picture(self):
        # The shift that the page draws at once is that of the true camera.
        browser = self.open_tree()
        moved = browser.run("""const { OrbitCamera } = await import('./camera.js');
            const camera = new OrbitCamera();
            camera.frame([-1, -2, -3], [3, 2, 1], 1.5);
            const seen = camera.clone();
            camera.pan(0.1, -0.05);
            camera.zoom(0.8, {x: 0.3, y: 0.6}, 1.5);
            const { x, y, zoom } = camera.shiftFrom(seen, 1.5);
            // A point of the old target's plane, in the old picture and in the new one.
            const { right, up } = seen.axes;
            const point = seen.target.map((t, i) => t + 0.3 * right[i] + 0.2 * up[i]);
            const old = seen.projector(1.5)(point), now = camera.projector(1.5)(point);
            return [x + (old[0] - 0.5) * zoom - now[0], y + (old[1] - 0.5) * zoom - now[1]]""")
        np.testing.assert_allclose(moved, [0, 0], atol=1e-9)

    def test_a_camera_far_from_the_origin_survives_its_link(self):
        browser = self.open_page()
        off = browser.run("""const { OrbitCamera } = await import('./camera.js');
            const camera = new OrbitCamera(), restored = new OrbitCamera();
            camera.frame([4e8, 5e7, -3], [4e8 + 2, 5e7 + 1, 0]);
            camera.orbit(0.3, 0.1);
            restored.restore(camera.parameters());
            return ['eye', 'target'].map((name) =>
                Math.hypot(...camera[name].map((x, axis) => x - restored[name][axis])))""")
        self.assertLess(max(off), 1e-6)  # doubles are 6e-8 apart there

    def test_the_picture_is_saved_and_fills_the_screen(self):
        browser = self.open_tree()
        browser.run("""window.blobs = [];
            const create = URL.createObjectURL;
            URL.createObjectURL = (blob) => { blobs.push(blob); return create.call(URL, blob); };
            HTMLAnchorElement.prototype.click = function () {
              blobs.at(-1).slice(0, 8).arrayBuffer()
                  .then((bytes) => { window.saved = [this.download, ...new Uint8Array(bytes)]; });
            };""")
        browser.click("#save")
        name, *magic = browser.wait("return window.saved")
        self.assertEqual(bytes(magic), b"\x89PNG\r\n\x1a\n")
        self.assertTrue(name.endswith("-shaded.png"), name)
        browser.click("#full")
        browser.wait("return document.fullscreenElement?.id === 'view'")
        browser.run("return document.exitFullscreen()")


if __name__ == "__main__":
    main()
