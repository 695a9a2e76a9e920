# SPDX-License-Identifier: Apache-2.0
"""A page of another origin against the daemon, in a real browser: cors_test.py KDRAYD KDRAY"""
import http.server
import os
import shutil
import sys
import threading
import unittest

from daemon import Daemon
from webdriver import Browser

if not shutil.which("chromedriver"):
    print("chromium-driver is not installed: pages of other origins are not tested")
    sys.exit(77)
KDRAYD = sys.argv[1]
TOKEN = "sesame-open-please-0123456789abcdef"

MESH = "v 0 0 0\\nv 1 0 0\\nv 0 1 0\\nf 1 2 3\\n"
UPLOAD = """const upload = async (url, headers = {}) => {
    const answer = await fetch(url + '/v1/trees', {method: 'POST', body: '%s',
        headers: {'Content-Type': 'application/octet-stream', ...headers}});
    return [answer, await answer.json()];
};""" % MESH
# A query of one ray as .npy: the header is padded to 128 bytes.
QUERY = UPLOAD + """
    const [uploaded, tree] = await upload(arguments[0]);
    const header = "\\x93NUMPY\\x01\\x00v\\x00{'descr': '<f8', 'fortran_order': False, 'shape': (1, 6), }";
    const body = new Uint8Array(128 + 48).fill(32);
    for (let i = 0; i < header.length; ++i) body[i] = header.charCodeAt(i);
    body[127] = 10;
    body.set(new Uint8Array(new Float64Array([0.2, 0.2, 5, 0, 0, -1]).buffer), 128);
    const answer = await fetch(`${arguments[0]}/v1/trees/${tree.id}/rays/closest?fields=t`,
        {method: 'POST', body, headers: {'Content-Type': 'application/x-npy'}});
    const t = new DataView(await answer.arrayBuffer());
    return [uploaded.status, uploaded.headers.get('Location'), answer.headers.get('Kdray-Precision'),
            answer.headers.get('Server-Timing'), t.getFloat64(t.byteLength - 8, true)];"""
PICTURE = UPLOAD + """
    const [, tree] = await upload(arguments[0]);
    const url = `${arguments[0]}/v1/trees/${tree.id}/render.png?width=40&height=30`;
    const image = new Image();
    image.crossOrigin = 'anonymous';
    image.src = url;
    await image.decode();
    const canvas = document.createElement('canvas');
    [canvas.width, canvas.height] = [image.width, image.height];
    const context = canvas.getContext('2d');
    context.drawImage(image, 0, 0);
    const pixels = context.getImageData(0, 0, image.width, image.height).data;
    const fetched = await fetch(url);
    return [pixels.length, (await fetched.blob()).type, fetched.headers.get('ETag') !== null];"""
DELETE = UPLOAD + """
    const [, tree] = await upload(arguments[0]);
    return (await fetch(`${arguments[0]}/v1/trees/${tree.id}`, {method: 'DELETE'})).status;"""
STATUS = """try {
        const answer = await fetch(arguments[0], arguments[1]);
        return [answer.status, (await answer.json()).code, answer.headers.get('X-Request-Id') !== null];
    } catch (error) { return error.name; }"""


class Page(http.server.BaseHTTPRequestHandler):
    def do_GET(self):
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(b"<!doctype html><title>another origin</title>")

    def log_message(self, *_):
        pass


class CorsTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.pages = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Page)
        threading.Thread(target=cls.pages.serve_forever, daemon=True).start()
        cls.addClassCleanup(cls.pages.server_close)
        cls.addClassCleanup(cls.pages.shutdown)
        cls.origin = f"http://127.0.0.1:{cls.pages.server_port}"
        cls.browser = Browser(400, 300)
        cls.addClassCleanup(cls.browser.close)

    def daemon(self, *options):
        daemon = Daemon(KDRAYD, *options)
        self.addCleanup(daemon.close)
        return daemon

    def run_in_page(self, script, *arguments):
        self.browser.open(self.origin + "/")
        return self.browser.run(f"return (async function() {{ {script} }}).apply(null, arguments)", *arguments)

    def test_a_page_of_an_allowed_origin_uploads_queries_renders_and_deletes(self):
        for allowed in (self.origin, "*", f"https://example.org,{self.origin}"):
            with self.subTest(allowed):
                url = self.daemon("--allow-origin", allowed).url
                status, location, precision, timing, t = self.run_in_page(QUERY, url)
                self.assertEqual(status, 201)
                self.assertRegex(location, "^/v1/trees/[0-9a-f]{64}-auto$")
                self.assertEqual(precision, "watertight")
                self.assertIn("trace;dur=", timing)
                self.assertEqual(t, 5)
                self.assertEqual(self.run_in_page(PICTURE, url), [40 * 30 * 4, "image/png", True])
                self.assertEqual(self.run_in_page(DELETE, url), 204)

    def test_a_page_reads_why_it_was_refused(self):
        token_file = os.path.join(self.daemon().folder, "token")
        with open(token_file, "w") as file:
            file.write(TOKEN + "\n")
        os.chmod(token_file, 0o600)
        url = self.daemon("--allow-origin", self.origin, "--token-file", token_file, "--max-upload", "100B").url
        token = {"Authorization": "Bearer " + TOKEN}
        refused = [([401, "unauthorized", True], "/v1", {}),
                   ([404, "not_found", True], "/nowhere", {"headers": token}),
                   ([413, "mesh_too_large", True], "/v1/trees", {"method": "POST", "body": "x" * 200, "headers": token}),
                   ([414, "uri_too_long", True], "/" + "x" * 9000, {})]
        for expected, path, init in refused:
            with self.subTest(path[:20]):
                self.assertEqual(self.run_in_page(STATUS, url + path, init), expected)

    def test_a_page_of_another_origin_reads_nothing(self):
        for options in ((), ("--allow-origin", "https://example.org")):
            with self.subTest(options):
                url = self.daemon(*options).url
                for path, init in (("/v1", {}), ("/v1/trees", {"method": "POST", "body": "x"}),
                                   ("/v1/trees/x", {"method": "DELETE"})):
                    self.assertEqual(self.run_in_page(STATUS, url + path, init), "TypeError")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
