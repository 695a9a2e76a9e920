# SPDX-License-Identifier: Apache-2.0
"""The contract as a page: docs_test.py KDRAYD KDRAY

Every example of a request is run by a shell against the real daemon. The page, and its form with a
token, are looked at in a headless browser, as wide as a desktop and as narrow as a phone.
"""
import json
import os
import shutil
import subprocess
import sys
import tempfile
import unittest
import urllib.request

from daemon import Daemon
from webdriver import Browser

KDRAYD, KDRAY = sys.argv[1:3]
TOKEN = "sesame-open-please-0123456789abcdef"
needs_browser = unittest.skipUnless(shutil.which("chromedriver"), "chromium-driver is not installed")
# Each after those that it needs; the rest in any order.
LAST = ["postTradeoff", "getTradeoff", "deleteTradeoff", "deleteTree"]


def upload(url, path, headers=()):
    with open(path, "rb") as file:
        request = urllib.request.Request(url + "/v1/trees", file.read(), dict(headers))
    with urllib.request.urlopen(request) as answer:
        return json.load(answer)["id"]


class DocsTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="kdray-docs-")
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        cls.mesh = os.path.join(cls.folder, "teapot.obj")
        subprocess.run([KDRAY, "-q", "sample", "teapot", "-o", cls.mesh], check=True)
        cls.daemon = Daemon(KDRAYD)
        cls.addClassCleanup(cls.daemon.close)

    def operations(self):
        with urllib.request.urlopen(self.daemon.url + "/openapi.json") as answer:
            paths = json.load(answer)["paths"]
        return {operation["operationId"]: operation for item in paths.values()
                for operation in item.values() if "operationId" in operation}

    def test_every_example_of_a_request_succeeds_as_it_is_written(self):
        operations = self.operations()
        names = sorted(operations, key=lambda name: LAST.index(name) if name in LAST else -1)
        environment = {**os.environ, "KDRAY": self.daemon.url, "TREE": upload(self.daemon.url, self.mesh)}
        for name in names:
            for sample in operations[name]["x-codeSamples"]:
                with self.subTest(operation=name, lang=sample["lang"]):
                    if sample["lang"] == "Python":
                        command = ["/usr/bin/python3", "-c", sample["source"]]
                    else:  # a refusal is a failure
                        command = ["bash", "-c", sample["source"].replace("curl ", "curl -fsS ", 1)]
                    ended = subprocess.run(command, cwd=self.folder, env=environment, capture_output=True, text=True)
                    self.assertEqual(ended.returncode, 0, ended.stderr)
                    if operations[name]["responses"].get("200", {}).get("content", {}).keys() & {"application/json"}:
                        if "-o " not in sample["source"] and sample["lang"] == "Shell":
                            json.loads(ended.stdout)

    def check_layout(self, browser):
        """Nothing is wider than the window, and each entry of the contents leads to its heading."""
        wide = browser.run("""const width = document.documentElement.clientWidth;
            return [...document.querySelectorAll('body *')].filter(e => !e.closest('pre') && e.checkVisibility()
                && e.getBoundingClientRect().right > width + 1).map(e => e.outerHTML.slice(0, 200));""")
        self.assertEqual(wide[:3], [])
        self.assertEqual(browser.run("""return [...document.querySelectorAll('nav a')]
            .filter(a => !document.querySelector(a.getAttribute('href'))).map(a => a.href);"""), [])
        self.assertGreater(browser.run("return document.querySelectorAll('nav a').length"), 50)

    @staticmethod
    def resize(browser, width, height):
        """A window cannot be as narrow as a phone, but the browser can pretend that its screen is."""
        browser.command("POST", "/goog/cdp/execute", {"cmd": "Emulation.setDeviceMetricsOverride", "params": {
            "width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}})

    def check_console(self, browser):
        self.assertEqual([line["message"] for line in browser.console()], [])

    @needs_browser
    def test_the_page_fits_a_desktop_and_a_phone(self):
        for width, height in ((1440, 900), (800, 900), (390, 844)):
            with self.subTest(width=width), Browser(width, height) as browser:
                self.resize(browser, width, height)
                browser.open(self.daemon.url + "/docs#raysClosest")
                self.check_layout(browser)
                top = browser.run("return document.getElementById('raysClosest').getBoundingClientRect().top")
                self.assertTrue(0 <= top < 100, top)
                self.check_console(browser)
                if folder := os.environ.get("KDRAY_SCREENSHOTS"):
                    browser.screenshot(f"{folder}/docs-{width}.png")

    @needs_browser
    def test_a_browser_reads_it_with_a_token_and_sends_its_examples(self):
        token_file = os.path.join(self.folder, "token")
        with open(token_file, "w") as file:
            file.write(TOKEN + "\n")
        with Daemon(KDRAYD, "--token-file", token_file) as guarded, Browser(1440, 900) as browser:
            upload(guarded.url, self.mesh, {"Authorization": "Bearer " + TOKEN})
            browser.open(guarded.url + "/docs.html#pointsInside")
            browser.wait("return document.getElementById('token-dialog').open")
            browser.type("#token", TOKEN + "\n")
            browser.wait("return document.querySelectorAll('.try').length > 10")
            self.check_layout(browser)
            browser.wait("return Math.abs(document.getElementById('pointsInside').getBoundingClientRect().top) < 100")
            section = "#pointsInside ~ .try"
            for action in ("summary", "button"):
                browser.run(f"document.querySelector('{section} {action}').click()")
            answer = f"document.querySelector('{section} .answer').textContent"
            browser.wait(f"return {answer}.includes('results')")
            self.assertIn("200 OK", browser.run(f"return {answer}"))
            image = "#getRenderPng ~ .try"
            browser.run(f"document.querySelector('{image} button').click()")
            browser.wait(f"return document.querySelector('{image} img')?.naturalWidth === 800")
            self.resize(browser, 390, 844)
            self.check_layout(browser)
            # The one refusal is that of the page's first request, which has no token yet.
            refused = [line["message"] for line in browser.console() if "401" not in line["message"]]
            self.assertEqual(refused, [])
            if folder := os.environ.get("KDRAY_SCREENSHOTS"):
                browser.screenshot(f"{folder}/docs-token.png")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
