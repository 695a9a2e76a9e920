# SPDX-License-Identifier: Apache-2.0
"""The JavaScript client in a page of another origin, in a real browser: js_browser_test.py KDRAYD KDRAY

The page has no build step: it imports clients/js/src/index.js. Once it comes from a name without
HTTPS, where browsers have no SHA-256, once from the machine itself.
"""
import functools
import http.server
import shutil
import sys
import threading
import unittest
from pathlib import Path

from daemon import Daemon
from webdriver import Browser

if not shutil.which("chromedriver"):
    print("chromium-driver is not installed: the JavaScript client is not tested in a browser")
    sys.exit(77)
KDRAYD = sys.argv[1]
PACKAGE = Path(__file__).resolve().parent.parent.parent / "clients" / "js"

# A grid of 2 x 400 x 400 triangles in the plane z = 0, as File of an OBJ, large enough for several reports.
SETUP = """
    const { Client, KdrayError } = await import('/src/index.js');
    const client = new Client(arguments[0]);
    const lines = [];
    for (let j = 0; j <= 400; ++j) for (let i = 0; i <= 400; ++i) lines.push(`v ${i / 400} ${j / 400} 0`);
    for (let j = 0; j < 400; ++j) for (let i = 0; i < 400; ++i) {
        const a = j * 401 + i + 1;
        lines.push(`f ${a} ${a + 1} ${a + 402}`, `f ${a} ${a + 402} ${a + 401}`);
    }
    const file = new File([lines.join('\\n')], 'grid.obj');
"""
WALK = SETUP + """
    const seen = [];
    const tree = await client.upload(file, { onProgress: (progress) => seen.push(progress) });
    const rays = new Float32Array(6 * 2000);
    for (let i = 0; i < 2000; ++i) rays.set([i / 1000, 0.3, 5, 0, 0, -1], i * 6);
    const hits = await tree.closest(rays, { batchRows: 150 });
    const image = await createImageBitmap((await tree.render({ width: 90, height: 60 })).blob());
    const depth = await tree.renderArray({ width: 8, height: 6, mode: 'depth' });
    return { secure: isSecureContext, size: file.size, seen, offset: hits.offset,
        hits: hits.triangle.filter((triangle) => triangle >= 0).length, near: Math.max(...hits.t.subarray(0, 900)),
        image: [image.width, image.height], shape: depth.shape, precision: hits.precision };"""
REFUSALS = SETUP + """
    const reason = async (promise) => promise.then(() => 'nothing', (error) =>
        error instanceof KdrayError ? `${error.status} ${error.code} ${error.line}` : error.name);
    const broken = new Blob(['v 0 0 0\\nv 1 0 0\\nv 0 1 0\\nf 1 2 9\\n']);
    const silent = new Client('http://127.0.0.1:1', { retries: 1 });
    return [await reason(client.upload(broken)), await reason(client.upload(broken, { onProgress() {} })),
        await reason(client.upload('mesh.obj')), await reason(silent.capabilities()),
        await reason(client.upload(new File([file, ' '], 'f'), { onProgress() {}, signal: AbortSignal.timeout(1) })),
        await reason(client.upload(new Blob(), { onProgress() {} }))];"""


class Quiet(http.server.SimpleHTTPRequestHandler):
    extensions_map = {".js": "text/javascript", ".html": "text/html", "": "application/octet-stream"}

    def do_GET(self):
        if self.path == "/":
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(b"<!DOCTYPE html><link rel=icon href=data:,><title>page</title>")
        else:
            super().do_GET()

    def log_message(self, *_):
        pass


class JsBrowserTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        handler = functools.partial(Quiet, directory=str(PACKAGE))
        cls.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
        threading.Thread(target=cls.server.serve_forever, daemon=True).start()
        cls.addClassCleanup(cls.server.server_close)
        cls.addClassCleanup(cls.server.shutdown)
        port = cls.server.server_address[1]
        cls.origins = [f"http://page.test:{port}", f"http://127.0.0.1:{port}"]
        cls.daemon = Daemon(KDRAYD, "--allow-origin", ",".join(cls.origins))
        cls.addClassCleanup(cls.daemon.close)
        # The name is not local, so the browser would first ask whether such a page may reach this machine.
        flags = ["--host-resolver-rules=MAP page.test 127.0.0.1",
                 "--disable-features=BlockInsecurePrivateNetworkRequests,LocalNetworkAccessChecks"]
        cls.browser = Browser(flags=flags)
        cls.addClassCleanup(cls.browser.close)

    def test_a_page_uploads_with_progress_and_queries_and_renders(self):
        for origin in self.origins:
            with self.subTest(origin=origin):
                self.browser.open(origin)
                walk = self.browser.run(WALK, self.daemon.url)
                self.assertEqual(walk["secure"], "page.test" not in origin)
                self.assertEqual(walk["hits"], 1001)  # x from 0 to 1, both ends included
                self.assertEqual((walk["near"], walk["image"], walk["shape"]), (5, [90, 60], [6, 8]))
                uploads = [seen for seen in walk["seen"] if seen["phase"] == "upload"]
                self.assertEqual(uploads[-1]["loaded"], walk["size"])
                self.assertEqual(walk["seen"][-1], {"phase": "build", "fraction": 1})
                self.assertEqual(self.browser.console(), [])

    def test_refusals_and_failures_have_their_reasons(self):
        self.browser.open(self.origins[1])
        self.assertEqual(self.browser.run(REFUSALS, self.daemon.url), [
            "422 invalid_mesh 4", "422 invalid_mesh 4", "TypeError", "ConnectionError", "TimeoutError",
            "422 empty_mesh undefined"])
        self.browser.console()


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
