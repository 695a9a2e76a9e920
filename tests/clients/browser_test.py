# SPDX-License-Identifier: Apache-2.0
"""The viewer page in a real browser against the real daemon: files, tokens, proxies, devices.

browser_test.py KDRAYD KDRAY. Its neighbours: browser_picture_test.py (cameras and pictures),
browser_inspect_test.py (trees, rays, the trade-off), browser_link_test.py (addresses) and
browser_wait_test.py (what takes long, and a daemon that is gone).
"""
import base64
import hashlib
import os
import shutil
import subprocess

from daemon import Daemon
from page import FINGERPRINT, KDRAYD, SETTLED, PageTest, main
from prefix_proxy import PrefixProxy

TOKEN = "sesame-open-please-0123456789abcdef"


class BrowserTest(PageTest):
    def test_a_chosen_file_becomes_a_picture_and_nothing_is_red_in_the_console(self):
        browser = self.open_page()
        browser.run("""window.sent = {};
            const set = XMLHttpRequest.prototype.setRequestHeader;
            XMLHttpRequest.prototype.setRequestHeader = function (name, value) {
              sent[name] = value;
              set.call(this, name, value);
            };""")
        unique = self.sample("torus.ply")
        os.rename(unique, unique := os.path.join(self.daemon.folder, "ring <b>.ply"))
        browser.type("#file", unique)
        # The name is shown as it is: a file name is no markup.
        self.wait_name("ring <b>.ply")
        browser.wait(SETTLED)
        _, opaque, pixels = browser.run(FINGERPRINT)
        self.assertTrue(0.1 < opaque / pixels < 0.9, (opaque, pixels))
        self.assertEqual(self.facts("#health-facts")["Surface"], "closed")
        self.assertEqual(self.count("#uploads li"), 0)
        self.assertEqual(browser.errors(), [])
        # A proxy before several servers finds the mesh's server by it (docs/replicas.md).
        with open(unique, "rb") as file:
            digest = base64.b64encode(hashlib.sha256(file.read()).digest()).decode()
        self.assertEqual(browser.run("return sent['Content-Digest']"), f"sha-256=:{digest}:")

    def test_it_offers_what_the_server_has(self):
        browser = self.open_page()
        capabilities = self.ask("/v1")
        fields = self.ask("/openapi.json")["components"]["schemas"]["RenderRequest"]["properties"]
        formats = capabilities["formats"]
        self.assertEqual(browser.run("return document.querySelector('#file').accept").split(","),
                         [f".{name}" for name in formats])
        self.assertIn(", ".join(formats).upper(), self.text("#formats"))
        modes = [name for name in fields["mode"]["enum"] if name != "position"]  # has no picture
        # The page turns a mesh in front of a camera; a panorama has none in front.
        projections = [name for name in fields["projection"]["enum"] if name != "spherical"]
        views = ["", *fields["view"]["enum"]]
        for select, names in (("#mode", modes), ("#projection", projections), ("#side", views),
                              ("#precision", capabilities["precisions"]),
                              ("#build", capabilities["builds"])):
            offered = browser.run("""return [...document.querySelector(arguments[0]).options]
                .map((option) => option.value)""", select)
            self.assertEqual(offered, names)

    def test_a_dropped_file_is_uploaded(self):
        browser = self.open_page()
        browser.run("""const data = new DataTransfer();
            data.items.add(new File(['v 0 0 0\\nv 1 0 0\\nv 0 1 0\\nf 1 2 3\\n'], 'dropped.obj'));
            dispatchEvent(new DragEvent('drop', {dataTransfer: data, cancelable: true}));""")
        self.wait_name("dropped.obj")
        browser.wait(SETTLED)

    def test_a_broken_file_is_shown_with_its_reason(self):
        broken = os.path.join(self.daemon.folder, "broken.obj")
        with open(broken, "w") as file:
            file.write("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")
        browser = self.open_page()
        browser.type("#file", broken)
        card = browser.wait("return document.querySelector('#uploads .failed')?.textContent")
        self.assertIn("invalid_mesh", card)
        self.assertIn("line 4", card)
        self.assertNotIn("again", card)  # what is wrong with the file stays wrong
        browser.click("#uploads .failed button")
        self.assertEqual(self.count("#uploads li"), 0)

    def test_a_file_above_the_servers_limit_is_not_sent(self):
        with Daemon(KDRAYD, "--max-upload", "600KiB") as small:
            browser = self.open_page(url=small.url)
            browser.type("#file", self.teapot)  # 688 KiB
            card = browser.wait("return document.querySelector('#uploads .failed')?.textContent")
            self.assertIn("mesh_too_large", card)
            self.assertIn("614400", card)
            self.assertEqual(browser.errors(), [])

    def test_the_list_shows_a_small_picture_of_each_tree(self):
        self.kdray("upload", self.sample("cube.ply"))
        browser = self.open_tree()
        sizes = browser.wait("""
            const images = [...document.querySelectorAll('#trees .preview img')];
            const isThere = (image) => image.complete && image.naturalWidth;
            return images.length > 1 && images.every(isThere) &&
                images.map((image) => [image.naturalWidth, image.naturalHeight])""")
        self.assertEqual(set(map(tuple, sizes)), {(96, 72)})
        self.assertEqual(browser.errors(), [])

    def test_another_build_and_deleting(self):
        browser = self.open_tree()
        before, after = self.change(lambda: browser.choose("#rebuild", "bvh"))
        self.assertEqual(before, after)  # the build changes no answer
        tree = self.text("#tree-id")
        self.assertTrue(tree.endswith("-bvh"), tree)
        self.assertEqual(self.facts("#tree-facts")["Build"], "bvh")
        browser.run("window.confirm = () => true")
        browser.click("#delete")
        browser.wait("return !document.querySelector('#about').checkVisibility()")
        self.assertNotIn(tree, self.kdray("list", "--full"))

    def test_a_token_is_asked_for_once(self):
        token_file = os.path.join(self.daemon.folder, "token")
        with open(token_file, "w") as file:
            file.write(TOKEN + "\n")
        os.chmod(token_file, 0o600)
        with Daemon(KDRAYD, "--token-file", token_file) as guarded:
            browser = self.browser
            browser.open(guarded.url + "/")
            browser.wait("return document.querySelector('#token-dialog').open")
            browser.type("#token", TOKEN + "\n")
            browser.wait("return document.querySelector('#version').textContent !== ''")
            browser.type("#file", self.teapot)
            browser.wait(SETTLED)
            self.shoot()
            # Pictures of the list are fetched with the token, which a plain <img> could not send.
            browser.wait("return document.querySelector('#trees .preview img').naturalWidth > 0")
            self.assertFalse(browser.run("return document.querySelector('#token-dialog').open"))

    def test_the_copied_command_renders_the_picture(self):
        if not shutil.which("curl"):
            self.skipTest("curl is not installed")
        browser = self.open_tree()
        browser.run("""window.copied = '';
            navigator.clipboard.writeText = async (text) => { window.copied = text; };""")
        browser.click("#curl")
        command = browser.wait("return window.copied")
        subprocess.run(["sh", "-c", command], cwd=self.daemon.folder, check=True)
        with open(os.path.join(self.daemon.folder, "kdray.png"), "rb") as file:
            self.assertEqual(file.read(8), b"\x89PNG\r\n\x1a\n")

    def test_nothing_is_loaded_from_elsewhere_and_no_policy_is_broken(self):
        browser = self.open_tree()
        hosts = browser.run("""return [...new Set(performance.getEntriesByType('resource')
            .filter((entry) => !entry.name.startsWith('blob:'))
            .map((entry) => new URL(entry.name).origin))]""")
        self.assertEqual(hosts, [self.daemon.url])
        self.assertEqual(browser.console(), [])

    def test_it_works_under_a_path_of_a_proxy(self):
        with PrefixProxy(self.daemon.url, "/tools/rays") as proxy:
            browser = self.open_tree(url=proxy.url)
            self.shoot()
            paths = browser.run("""return performance.getEntriesByType('resource')
                .filter((entry) => !entry.name.startsWith('blob:'))
                .map((entry) => new URL(entry.name).pathname)""")
            for path in paths:
                self.assertTrue(path.startswith("/tools/rays/"), path)

    def test_it_fits_a_telephone_and_its_hints_are_for_fingers(self):
        self.browser.size(390, 844, phone=True)
        browser = self.open_tree()
        for panel in ("mesh", "tree", "ray", "tradeoff"):
            browser.click(f"#tab-{panel}")
            wide = browser.run("return document.documentElement.scrollWidth - innerWidth")
            self.assertLessEqual(wide, 0, panel)
        self.assertTrue(self.is_shown("#hint-touch"))
        self.assertFalse(self.is_shown("#hint-mouse"))

    def test_every_control_has_a_name_and_tabs_follow_the_arrows(self):
        browser = self.open_tree()
        self.shoot()
        browser.run("for (const menu of document.querySelectorAll('details')) menu.open = true;")
        for panel in ("mesh", "tree", "ray", "tradeoff"):
            browser.click(f"#tab-{panel}")
            kinds = "button, select, input, a, summary, progress, svg[role=img]"
            for control in browser.find_all(kinds):
                html, is_shown = browser.run(
                    "return [arguments[0].outerHTML, arguments[0].checkVisibility()]", control)
                if is_shown:
                    self.assertNotEqual(browser.label(control).strip(), "", html)
        browser.key("\ue014")  # the right arrow on the last tab
        self.assertEqual(browser.run("return document.activeElement.id"), "tab-mesh")
        self.assertTrue(self.is_shown("#panel-mesh"))
        self.assertFalse(self.is_shown("#panel-tradeoff"))

    def test_it_is_dark_where_the_system_is(self):
        browser = self.open_tree()
        luminance = """return Number(getComputedStyle(document.body).backgroundColor
            .match(/\\d+/)[0])"""
        self.assertGreater(browser.run(luminance), 200)
        browser.prefer("dark")
        self.assertLess(browser.run(luminance), 60)


if __name__ == "__main__":
    main()
