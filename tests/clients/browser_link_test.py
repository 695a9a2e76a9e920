# SPDX-License-Identifier: Apache-2.0
"""The viewer page in a real browser: links that restore all that is shown, Back and Forward."""
from page import FINGERPRINT, SETTLED, PageTest, main


class BrowserLinkTest(PageTest):
    def settle(self, action):
        """Does it and waits for its picture; gives the picture's fingerprint."""
        return self.change(action)[1]

    def click_box(self, name):
        self.browser.run(f"document.querySelector('#{name}').click()")

    def test_a_link_brings_everything_back(self):
        browser = self.open_page()
        browser.type("#file", self.teapot)
        browser.wait(SETTLED)
        for action in (lambda: browser.drag("#canvas", (0, 0), (-90, 60)),
                       lambda: browser.drag("#canvas", (0, 0), (30, 10), button=2),
                       lambda: browser.choose("#light", "sun"),
                       lambda: browser.choose("#sun-azimuth", "70"),
                       lambda: self.click_box("shadows"),
                       lambda: self.click_box("edges"),
                       lambda: browser.choose("#cells", "3"),
                       lambda: browser.choose("#precision", "double"),
                       lambda: self.click_box("up-z"),
                       lambda: browser.wheel("#canvas", -200),
                       lambda: browser.choose("#projection", "orthographic")):
            picture = self.settle(action)
        self.shoot()
        facts, cells = self.facts("#hit-facts"), self.text("#ray-cells-words")
        fragment = browser.run("const {hash} = location; localStorage.clear(); return hash")
        self.open_page(fragment)
        browser.wait(SETTLED)
        browser.wait("return document.querySelector('#ray-cells').checkVisibility()")
        browser.wait("return document.querySelector('#crossings').textContent !== '…'")
        self.assertEqual(browser.run(FINGERPRINT), picture)
        self.assertEqual(self.facts("#hit-facts"), facts)
        self.assertEqual(self.text("#ray-cells-words"), cells)
        self.assertTrue(self.is_shown("#marker"))
        self.assertTrue(self.is_shown("#panel-ray"))
        # The service knows no names: the link does.
        self.assertEqual(self.text("#tree-name"), "teapot.ply")
        self.assertEqual(browser.run("return location.hash"), fragment)

    def test_a_reload_changes_nothing(self):
        browser = self.open_tree()
        picture = self.settle(lambda: browser.drag("#canvas", (0, 0), (70, -20)))
        browser.command("POST", "/refresh")
        browser.wait(SETTLED)
        self.assertEqual(browser.run(FINGERPRINT), picture)

    def test_back_and_forward_go_through_trees_and_choices(self):
        other = self.kdray("upload", self.sample("torus.ply"))
        browser = self.open_tree()
        steps = [browser.run(FINGERPRINT)]
        steps.append(self.settle(lambda: browser.choose("#mode", "normal")))
        # Movements are no steps: Back returns to the last camera before the choice.
        steps[1] = self.settle(lambda: browser.drag("#canvas", (0, 0), (50, 10)))
        steps.append(self.settle(lambda: browser.click(f"[data-tree='{other}']")))
        self.assertEqual(len(set(map(tuple, steps))), 3)
        for direction, expected in ((browser.back, 1), (browser.back, 0),
                                    (browser.forward, 1), (browser.forward, 2)):
            self.assertEqual(self.settle(direction), steps[expected])
        self.assertEqual(self.text("#tree-id"), other)
        self.assertEqual(browser.run("return document.querySelector('#mode').value"), "normal")

    def test_what_a_link_says_wrongly_is_ignored(self):
        wrong = "&mode=position&cells_depth=-7&sun=a,b&eye=1,2&ray=1,2,3&panel=x&light=x"
        browser = self.open_tree(fragment=wrong)
        self.assertEqual(browser.run("return document.querySelector('#mode').value"), "shaded")
        self.assertEqual(self.text("#cells-depth"), "off")
        self.assertEqual(browser.errors(), [])

    def test_a_link_to_a_tree_that_is_gone_says_so_and_shows_another(self):
        self.kdray("upload", self.teapot)
        gone = "0" * 64 + "-auto"
        browser = self.open_page(f"#tree={gone}")
        self.wait_text("#problem-code", "tree_not_found")
        browser.wait(SETTLED)
        self.assertNotEqual(self.link()["tree"], gone)

    def test_the_copied_link_is_the_address(self):
        browser = self.open_tree()
        browser.run("""window.copied = '';
            navigator.clipboard.writeText = async (text) => { window.copied = text; };""")
        browser.click("#share")
        self.assertEqual(browser.wait("return window.copied"), browser.run("return location.href"))


if __name__ == "__main__":
    main()
