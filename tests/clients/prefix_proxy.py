"""A reverse proxy that puts a service under a path of its own, as sites with several services do."""
import http.server
import threading
import urllib.error
import urllib.request

PER_CONNECTION = {"connection", "content-length", "host", "keep-alive", "transfer-encoding"}


class PrefixProxy:
    """Context manager; `url` is where it listens, the prefix included."""

    def __init__(self, target, prefix):
        class Handler(http.server.BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def forward(self):
                body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
                if not self.path.startswith(prefix + "/"):
                    self.send_error(404)
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
