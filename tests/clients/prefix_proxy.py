# SPDX-License-Identifier: Apache-2.0
"""A reverse proxy that puts a service under a path, as sites with several services do."""
import http.server
import select
import threading
import urllib.error
import urllib.request

PER_CONNECTION = {"connection", "content-length", "host", "keep-alive", "transfer-encoding"}


class PrefixProxy:
    """Context manager; `url` is where it listens, the prefix included.

    `delay` gives the seconds that a request waits, by its path with the query. `dropped` has the
    paths of those whose client left while they waited; `waiting` counts those that wait.
    """

    def __init__(self, target, prefix, delay=lambda path: 0):
        dropped = self.dropped = []
        self.waiting = 0
        proxy = self

        class Handler(http.server.BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def forward(self):
                body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
                if not self.path.startswith(prefix + "/"):
                    self.send_error(404)
                    return
                if not self.client_waits(delay(self.path)):
                    dropped.append(self.path)
                    self.close_connection = True
                    return
                request = urllib.request.Request(
                    target + self.path[len(prefix):], body if self.command == "POST" else None,
                    kept(self.headers), method=self.command)
                try:
                    answer = urllib.request.urlopen(request)
                except urllib.error.HTTPError as error:
                    answer = error
                with answer:
                    self.answer(answer.status, kept(answer.headers), answer.read())

            def client_waits(self, seconds):
                """Sleeps; False as soon as the client has closed its connection."""
                if seconds == 0:
                    return True
                proxy.waiting += 1
                # Clients of this proxy send nothing before the answer: what can be read is the end.
                readable, _, _ = select.select([self.connection], [], [], seconds)
                proxy.waiting -= 1
                return not readable

            def answer(self, status, headers, body):
                self.send_response(status)
                for name, value in {**headers, "Content-Length": len(body)}.items():
                    self.send_header(name, value)
                self.end_headers()
                try:
                    self.wfile.write(body)
                except OSError:
                    pass  # the browser has dropped a stale picture

            def log_message(self, *_):
                pass

            do_GET = do_POST = do_DELETE = forward

        self._server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._thread = threading.Thread(target=self._server.serve_forever)
        self._thread.start()
        self.url = f"http://127.0.0.1:{self._server.server_address[1]}{prefix}"

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()


def kept(headers):
    return {name: value for name, value in headers.items() if name.lower() not in PER_CONNECTION}
