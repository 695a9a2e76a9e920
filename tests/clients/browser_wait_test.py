# SPDX-License-Identifier: Apache-2.0
"""The viewer page in a real browser: a large mesh that takes time, and a daemon that is gone."""
import time

from page import FINGERPRINT, SETTLED, PageTest, main


class BrowserWaitTest(PageTest):
    def test_a_mesh_of_two_million_triangles_says_how_long_it_takes_and_stays_quick(self):
        browser = self.open_page()
        large = self.sample("sphere-large.ply", "--detail", "317")
        browser.choose("#build", "kd-binned")
        browser.run("""window.words = [];
            const uploads = document.querySelector('#uploads');
            new MutationObserver(() => words.push(uploads.textContent))
                .observe(uploads, {childList: true, subtree: true, characterData: true});""")
        browser.type("#file", large)
        self.wait_name("sphere-large.ply", seconds=60)
        words = browser.run("return window.words")
        self.assertTrue(any("sending" in text and "%" in text for text in words), words)
        building = [text for text in words if "building" in text]
        self.assertTrue(any("s left" in text for text in building), building)
        browser.wait(SETTLED, seconds=30)
        # While the mesh is turned there are rough pictures, and a click is answered in between.
        browser.drag("#canvas", (0, 0), (120, 30))
        started = time.monotonic()
        browser.press("#canvas", (10, 10))
        self.wait_text("#hit-facts", "Triangle")
        self.assertLess(time.monotonic() - started, 2)
        browser.wait(SETTLED, seconds=30)
        self.assertEqual(browser.errors(), [])

    def test_an_upload_can_be_stopped(self):
        browser = self.open_page()
        # Two files: the second one waits for its turn.
        browser.type("#file", "\n".join([self.sample("terrain-a.ply", "--detail", "700"),
                                         self.sample("terrain-b.ply", "--detail", "701")]))
        browser.wait("return document.querySelectorAll('#uploads li').length === 2")
        browser.click("#uploads li:last-child button")
        browser.click("#uploads li:first-child button")
        browser.wait("return document.querySelectorAll('#uploads li').length === 0")
        self.assertNotEqual(self.text("#tree-name"), "terrain-b.ply")

    def test_an_upload_outlives_the_daemon_that_it_was_sent_to(self):
        browser = self.open_page()
        browser.type("#file", self.sample("sphere-middle.ply", "--detail", "400"))
        self.wait_text("#uploads", "building")
        self.daemon.stop()
        try:
            self.wait_text("#uploads", "waiting for the server")
        finally:
            self.daemon.start()
        self.wait_name("sphere-middle.ply", seconds=60)
        self.assertEqual(self.count("#uploads li"), 0)

    def test_the_page_survives_a_daemon_that_is_gone_and_comes_back(self):
        browser = self.open_tree()
        picture = browser.run(FINGERPRINT)
        self.daemon.stop()
        try:
            browser.drag("#canvas", (0, 0), (60, 20))
            self.wait_shown("#lost")
            self.assertFalse(self.is_shown("#problem"))
        finally:
            self.daemon.start()
        browser.wait("return !document.querySelector('#lost').checkVisibility()")
        browser.wait(SETTLED)
        self.assertNotEqual(browser.run(FINGERPRINT), picture)
        self.shoot((0, 0))

    def test_a_page_that_finds_no_service_starts_when_there_is_one(self):
        tree = self.kdray("upload", self.teapot)
        self.browser.block("*/v1*", "*/readyz")
        self.browser.open(f"{self.daemon.url}/#tree={tree}")
        self.wait_shown("#lost")
        self.browser.block()
        self.browser.wait(SETTLED)
        self.assertFalse(self.is_shown("#lost"))


if __name__ == "__main__":
    main()
