# SPDX-License-Identifier: Apache-2.0
"""Photographs the viewer page in each of its states: page_pictures.py KDRAYD KDRAY FOLDER

For people who change the page, and for the README: docs/page.png is `ray.png` of these.
"""
import os
import sys

from page import SETTLED, PageTest

FOLDER = sys.argv[3]
DESKTOP = (1360, 850)
PHONE = (390, 844)


class Photographer(PageTest):
    SIZE = DESKTOP

    def photograph(self, name):
        self.browser.wait("return !document.querySelector('#toast').checkVisibility()")
        self.browser.wait(SETTLED)
        self.browser.screenshot(os.path.join(FOLDER, f"{name}.png"))

    def choose(self, *fields):
        for field, value in fields:
            self.change(lambda: self.browser.choose(field, value))

    def full_page(self, name):
        """All of a page that scrolls."""
        width, height = self.browser.run(
            "return [innerWidth, document.documentElement.scrollHeight]")
        self.browser.size(width, height, phone=True)
        self.browser.run("document.querySelector('.stage').style.height = '520px'")
        self.photograph(name)
        self.browser.size(*PHONE, phone=True)

    def test_empty(self):
        self.open_page()
        self.browser.screenshot(os.path.join(FOLDER, "empty.png"))

    def test_troubles(self):
        browser = self.open_tree()
        broken = os.path.join(self.daemon.folder, "broken.obj")
        with open(broken, "w") as file:
            file.write("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")
        browser.type("#file", "\n".join([broken, self.sample("sphere-2M.ply", "--detail", "317")]))
        browser.wait("return document.querySelector('#uploads').textContent.includes('left')")
        browser.screenshot(os.path.join(FOLDER, "uploads.png"))
        browser.run("location.hash = arguments[0]", "#tree=" + "0" * 64 + "-auto")
        self.wait_shown("#problem")
        browser.screenshot(os.path.join(FOLDER, "problem.png"))
        browser.prefer("dark")
        browser.run("document.querySelector('#drop').hidden = false")
        browser.screenshot(os.path.join(FOLDER, "drop-dark.png"))
        browser.run("document.querySelector('#drop').hidden = true")
        browser.run("document.querySelector('#token-dialog').showModal()")
        browser.screenshot(os.path.join(FOLDER, "token-dark.png"))
        browser.run("document.querySelector('#token-dialog').remove()")
        self.daemon.stop()
        browser.drag("#canvas", (0, 0), (40, 10))
        self.wait_shown("#lost")
        browser.screenshot(os.path.join(FOLDER, "lost-dark.png"))
        self.daemon.start()

    def test_states(self):
        browser = self.open_page()
        shapes = ("torus.ply", "terrain.stl", "cube.obj", "sphere.ply")
        browser.choose("#build", "kd-sah")  # whose cells the pictures show
        browser.type("#file", "\n".join([*map(self.sample, shapes), self.teapot]))
        browser.wait("return document.querySelector('#tree-name').textContent === 'teapot.ply'")
        browser.wait(SETTLED)
        for scheme in ("light", "dark"):
            browser.prefer(scheme)
            self.states("" if scheme == "light" else "-dark")
        browser.prefer("light")

    def states(self, suffix):
        browser = self.browser
        browser.click("#tab-mesh")
        self.choose(("#mode", "normal"), ("#mode", "shaded"))
        self.photograph("mesh" + suffix)
        browser.click("#tab-tree")
        self.choose(("#mode", "cost"))
        self.photograph("cost" + suffix)
        self.choose(("#mode", "shaded"), ("#cells", "6"))
        self.photograph("cells" + suffix)
        self.choose(("#cells", "8"))
        self.shoot((-30, -60))
        self.change(lambda: browser.drag("#canvas", (0, 0), (-170, 60)))
        self.photograph("ray" + suffix)
        self.choose(("#cells", "-1"), ("#light", "sun"))
        self.change(lambda: browser.run("document.querySelector('#shadows').click()"))
        browser.run("document.querySelector('.menu').open = true")
        self.photograph("light" + suffix)
        browser.run("document.querySelector('.menu').open = false")
        self.change(lambda: browser.run("document.querySelector('#shadows').click()"))
        browser.click("#tab-tradeoff")
        if not suffix:
            browser.click("#measure")
            browser.wait("return document.querySelector('#tradeoff-bar').value > 0.3", seconds=60)
            self.photograph("measuring")
        self.wait_shown("#tradeoff-result", seconds=120)
        self.photograph("tradeoff" + suffix)
        browser.click("#help")
        self.photograph("help" + suffix)
        browser.click("#help-dialog button")
        self.choose(("#light", "headlight"))
        browser.size(*PHONE, phone=True)
        browser.wait(SETTLED)
        self.photograph("phone" + suffix)
        for panel in ("mesh", "tree", "ray", "tradeoff"):
            browser.click(f"#tab-{panel}")
            self.full_page(f"phone-{panel}{suffix}")
        browser.size(*DESKTOP)


if __name__ == "__main__":
    import unittest
    os.makedirs(FOLDER, exist_ok=True)
    unittest.main(argv=sys.argv[:1], verbosity=2)
