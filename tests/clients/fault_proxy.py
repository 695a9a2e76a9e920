# SPDX-License-Identifier: Apache-2.0
"""A proxy before an S3 server, which makes the faults that the server itself does not have."""
import http.client
import threading
import time
import urllib.parse
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


class FaultProxy:
    """Context manager; `url` is the endpoint. `fault` as that of fake_s3.FakeS3."""

    def __init__(self, port):
        self.fault = lambda method, key, query: None
        self.target = port

        class Server(ThreadingHTTPServer):
            daemon_threads = True
            proxy = self

            def handle_error(self, request, client_address):
                pass  # a client that left, or one that a fault dropped

        self._server = Server(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self._server.server_address[1]}"
        threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True).start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._server.shutdown()
        self._server.server_close()


class Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True

    def log_message(self, *_):
        pass

    def do(self):
        proxy = self.server.proxy
        body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
        path, _, query = self.path.partition("?")
        key = urllib.parse.unquote(path).split("/", 2)[2:]
        kind, value = proxy.fault(self.command, key[0] if key else "",
                                  dict(urllib.parse.parse_qsl(query))) or (None, None)
        if kind == "drop":
            self.close_connection = True
            return
        if kind == "slow":
            time.sleep(value)
        if kind == "status":
            code = {500: "InternalError", 503: "SlowDown"}[value]
            self.answer(value, [], f"<Error><Code>{code}</Code></Error>".encode())
            return
        # The host is signed, so it stays.
        server = http.client.HTTPConnection("127.0.0.1", proxy.target, timeout=60)
        server.putrequest(self.command, self.path, skip_host=True, skip_accept_encoding=True)
        for name, text in self.headers.items():
            if name.lower() not in ("expect", "connection"):
                server.putheader(name, text)
        server.endheaders(body)
        answer = server.getresponse()
        content = bytearray(answer.read())
        server.close()
        if kind == "lose":
            self.close_connection = True
            return
        if kind == "alter" and content:
            content[len(content) // 2] ^= 1
        self.answer(answer.status, answer.getheaders(), bytes(content), cut=kind == "truncate")

    do_GET = do_HEAD = do_PUT = do_POST = do_DELETE = do

    def answer(self, status, headers, content, cut=False):
        own = dict(headers)
        self.send_response_only(status)
        for name, text in headers:
            if name.lower() not in ("content-length", "transfer-encoding", "connection"):
                self.send_header(name, text)
        length = own.get("Content-Length", "0") if self.command == "HEAD" else str(len(content))
        if status != 204:
            self.send_header("Content-Length", length)
        self.end_headers()
        if self.command == "HEAD":
            return
        self.wfile.write(content[:len(content) // 2] if cut else content)
        if cut and len(content) > 1:
            self.close_connection = True
