# SPDX-License-Identifier: Apache-2.0
"""A small S3 in memory, for tests: lists, ranges, parts, conditional writes, and faults.

It checks every signature by its own reading of AWS Signature Version 4, the hash of every body, and
the time of every request against its own clock.
"""
import datetime
import hashlib
import hmac
import re
import ssl
import threading
import time
import urllib.parse
from email.utils import formatdate
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from xml.etree import ElementTree
from xml.sax.saxutils import escape

KEY_ID = "AKIDEXAMPLE"
SECRET = "wJalrXUtnFEMI/K7MDENG+bPxRfiCYEXAMPLEKEY"
BUCKET = "meshes"


def encoded(text, safe=""):
    return urllib.parse.quote(text, safe=safe + "-._~")


def hashed(key, text):
    return hmac.new(key, text.encode(), hashlib.sha256).digest()


class Refusal(Exception):
    def __init__(self, status, code):
        super().__init__(code)
        self.status, self.code = status, code


class FakeS3:
    """Context manager; `url` is the endpoint. The attributes may be changed at any time."""

    def __init__(self):
        self.objects = {}  # key -> (bytes, time)
        self.uploads = {}  # name -> {number: bytes}
        self.lock = threading.RLock()
        self.region = "us-east-1"
        self.keys = {KEY_ID: SECRET}
        self.session_token = None
        self.clock_offset_s = 0
        self.date_offset_s = 0  # of the header Date from that clock
        self.is_strict = lambda method: True  # whether it looks at the time and the token
        self.has_conditional_writes = True
        self.page = 1000
        # fault(method, key, query) -> None, or (kind, value): ("status", 503), ("slow", seconds),
        # ("truncate", 0), ("alter", 0), ("drop", 0) before and ("lose", 0) after the request is
        # carried out.
        self.fault = lambda method, key, query: None
        self.answers = threading.Event()  # while it is clear, requests are read and wait
        self.answers.set()
        self.certificate = None  # a PEM file with its key, for https; before start()
        self.requests = []  # (method, key, query)
        self.refusals = []  # (method, key, query, code)
        self.problems = []  # what a correct client does not send
        self._server = None
        self.port = 0

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        self.stop()

    @property
    def url(self):
        return f"http{'s' if self.certificate else ''}://127.0.0.1:{self.port}"

    def start(self):
        class Server(ThreadingHTTPServer):
            daemon_threads = True
            allow_reuse_address = True
            store = self
            connections = set()

            def handle_error(self, request, client_address):
                pass  # a client that left, or one that a fault dropped

        self._server = Server(("127.0.0.1", self.port), Handler)
        self.port = self._server.server_address[1]
        if self.certificate:
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            context.load_cert_chain(self.certificate)
            self._server.socket = context.wrap_socket(self._server.socket, server_side=True)
        threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True).start()

    def stop(self):
        """As if the process had ended: connections break. start() goes on with the same objects."""
        if self._server is None:
            return
        self._server.shutdown()
        self._server.server_close()
        for connection in list(self._server.connections):
            try:
                connection.shutdown(2)
            except OSError:
                pass
        self._server = None

    def names(self, prefix=""):
        with self.lock:
            return sorted(key for key in self.objects if key.startswith(prefix))


class Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True

    def setup(self):
        super().setup()
        self.server.connections.add(self.connection)

    def finish(self):
        self.server.connections.discard(self.connection)
        super().finish()

    def log_message(self, *_):
        pass

    def date_time_string(self, timestamp=None):
        store = self.server.store
        return formatdate(time.time() + store.clock_offset_s + store.date_offset_s, usegmt=True)

    def do(self):
        store = self.server.store
        length = int(self.headers.get("Content-Length") or 0)
        body = self.rfile.read(length) if length else b""
        path, _, raw_query = self.path.partition("?")
        self.query = dict(urllib.parse.parse_qsl(raw_query, keep_blank_values=True))
        parts = urllib.parse.unquote(path).split("/", 2)
        bucket, self.key = parts[1], parts[2] if len(parts) > 2 else ""
        with store.lock:
            store.requests.append((self.command, self.key, self.query))
        store.answers.wait()
        kind, value = store.fault(self.command, self.key, self.query) or (None, None)
        if kind == "drop":
            self.close_connection = True
            return
        if kind == "slow":
            time.sleep(value)
        try:
            if kind == "status":
                raise Refusal(value, {500: "InternalError", 503: "SlowDown"}.get(value, "Odd"))
            self.check_signature(path, raw_query, body)
            if bucket != BUCKET:
                raise Refusal(404, "NoSuchBucket")
            with store.lock:
                status, headers, answer = getattr(self, "s3_" + self.command.lower())(body)
        except Refusal as refusal:
            store.refusals.append((self.command, self.key, self.query, refusal.code))
            answer = f"<?xml version='1.0'?><Error><Code>{refusal.code}</Code></Error>".encode()
            status, headers = refusal.status, {"Content-Type": "application/xml"}
        if kind == "lose":
            self.close_connection = True
            return
        self.send_response(status)
        for name, text in headers.items():
            self.send_header(name, text)
        if "Content-Length" not in headers:
            self.send_header("Content-Length", str(len(answer)))
        self.end_headers()
        if self.command == "HEAD":
            return
        if kind == "truncate" and len(answer) > 1:
            self.wfile.write(answer[:len(answer) // 2])
            self.close_connection = True
            return
        if kind == "alter" and answer:
            answer = bytearray(answer)
            answer[len(answer) // 2] ^= 1
        self.wfile.write(answer)

    do_GET = do_HEAD = do_PUT = do_POST = do_DELETE = do

    def check_signature(self, path, raw_query, body):
        store = self.server.store
        match = re.fullmatch(
            r"AWS4-HMAC-SHA256 Credential=([^/]+)/(\d{8})/([^/]+)/s3/aws4_request, ?"
            r"SignedHeaders=([^,]+), ?Signature=([0-9a-f]{64})", self.headers.get("Authorization", ""))
        if not match:
            raise Refusal(403, "AccessDenied")
        key_id, day, region, signed, signature = match.groups()
        if key_id not in store.keys:
            raise Refusal(403, "InvalidAccessKeyId")
        token = self.headers.get("x-amz-security-token")
        if store.session_token not in (None, token) and store.is_strict(self.command):
            raise Refusal(403, "ExpiredToken")
        date = self.headers.get("x-amz-date", "")
        sent = datetime.datetime.strptime(date, "%Y%m%dT%H%M%SZ").replace(
            tzinfo=datetime.timezone.utc).timestamp()
        late_s = abs(sent - time.time() - store.clock_offset_s)
        if late_s > 900 and store.is_strict(self.command):
            raise Refusal(403, "RequestTimeTooSkewed")
        names = signed.split(";")
        for name in names:
            if len(self.headers.get_all(name, [])) != 1:
                store.problems.append(f"{name} is not sent once")
        for name in ["host", "x-amz-date", "x-amz-content-sha256"]:
            if name not in names:
                store.problems.append(f"{name} is not signed")
        content = self.headers.get("x-amz-content-sha256", "")
        if content != hashlib.sha256(body).hexdigest():
            raise Refusal(400, "XAmzContentSHA256Mismatch")
        pairs = urllib.parse.parse_qsl(raw_query, keep_blank_values=True)
        query = "&".join(f"{encoded(name)}={encoded(value)}" for name, value in sorted(pairs))
        canonical = "\n".join([
            self.command, encoded(urllib.parse.unquote(path), "/"), query,
            *(f"{name}:{' '.join(self.headers.get(name, '').split())}" for name in names), "",
            signed, content])
        scope = f"{day}/{region}/s3/aws4_request"
        text = "\n".join(["AWS4-HMAC-SHA256", date, scope,
                          hashlib.sha256(canonical.encode()).hexdigest()])
        key = ("AWS4" + store.keys[key_id]).encode()
        for part in (day, region, "s3", "aws4_request"):
            key = hashed(key, part)
        if not hmac.compare_digest(hashed(key, text).hex(), signature):
            raise Refusal(403, "SignatureDoesNotMatch")
        if region != store.region:
            raise Refusal(400, "AuthorizationHeaderMalformed")

    def put_object(self, body):
        store = self.server.store
        if "If-None-Match" in self.headers:
            if not store.has_conditional_writes:
                raise Refusal(501, "NotImplemented")
            if self.headers["If-None-Match"] != "*":
                store.problems.append("If-None-Match other than *")
            if self.key in store.objects:
                raise Refusal(412, "PreconditionFailed")
        store.objects[self.key] = (body, time.time() + store.clock_offset_s)

    def s3_put(self, body):
        store = self.server.store
        tag = '"' + hashlib.md5(body).hexdigest() + '"'
        if "uploadId" in self.query:
            upload = store.uploads.get(self.query["uploadId"])
            if upload is None:
                raise Refusal(404, "NoSuchUpload")
            upload[int(self.query["partNumber"])] = body
        else:
            self.put_object(body)
        return 200, {"ETag": tag}, b""

    def s3_post(self, body):
        store = self.server.store
        if "uploads" in self.query:
            name = f"upload {len(store.requests)} &<>"  # odd on purpose
            store.uploads[name] = {}
            return 200, {}, (f"<InitiateMultipartUploadResult><UploadId>{escape(name)}</UploadId>"
                             "</InitiateMultipartUploadResult>").encode()
        upload = store.uploads.get(self.query.get("uploadId"))
        if upload is None:
            raise Refusal(404, "NoSuchUpload")
        parts = ElementTree.fromstring(body).findall("Part")
        numbers = [int(part.findtext("PartNumber")) for part in parts]
        for number, part in zip(numbers, parts):
            if part.findtext("ETag") != '"' + hashlib.md5(upload[number]).hexdigest() + '"':
                raise Refusal(400, "InvalidPart")
        if any(len(upload[number]) < 5 << 20 for number in numbers[:-1]):
            raise Refusal(400, "EntityTooSmall")
        self.put_object(b"".join(upload[number] for number in numbers))
        del store.uploads[self.query["uploadId"]]
        return 200, {}, b"<CompleteMultipartUploadResult></CompleteMultipartUploadResult>"

    def s3_delete(self, _):
        store = self.server.store
        if "uploadId" in self.query:
            if store.uploads.pop(self.query["uploadId"], None) is None:
                raise Refusal(404, "NoSuchUpload")
        else:
            store.objects.pop(self.key, None)
        return 204, {}, b""

    def s3_head(self, _):
        body, modified = self.find()
        return 200, {"Content-Length": str(len(body)),
                     "Last-Modified": formatdate(modified, usegmt=True)}, b""

    def s3_get(self, _):
        if self.key == "":
            return self.list()
        body, _ = self.find()
        wanted = re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers.get("Range", ""))
        if not wanted:
            return 200, {}, body
        first, last = int(wanted[1]), int(wanted[2])
        if first >= len(body):
            raise Refusal(416, "InvalidRange")
        return 206, {}, body[first:last + 1]

    def find(self):
        store = self.server.store
        if self.key not in store.objects:
            raise Refusal(404, "NoSuchKey")
        return store.objects[self.key]

    def list(self):
        store = self.server.store
        if self.query.get("list-type") != "2":
            store.problems.append("a list of version 1")
        after = self.query.get("continuation-token", self.query.get("start-after", ""))
        names = [name for name in store.names(self.query.get("prefix", "")) if name > after]
        page = names[:min(store.page, int(self.query.get("max-keys", 1000)))]
        contents = "".join(
            f"<Contents><Key>{escape(name)}</Key><LastModified>"
            + datetime.datetime.fromtimestamp(
                store.objects[name][1], datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%S.000Z")
            + f"</LastModified><Size>{len(store.objects[name][0])}</Size></Contents>"
            for name in page)
        more = "true" if len(page) < len(names) else "false"
        token = f"<NextContinuationToken>{escape(page[-1])}</NextContinuationToken>" if page else ""
        return 200, {"Content-Type": "application/xml"}, (
            '<?xml version="1.0"?><ListBucketResult xmlns="http://s3.amazonaws.com/doc/2006-03-01/">'
            f"<IsTruncated>{more}</IsTruncated>{contents}{token}</ListBucketResult>").encode()
