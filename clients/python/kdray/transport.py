# SPDX-License-Identifier: Apache-2.0
"""HTTP to one server: connections are kept alive, and requests are repeated where that is safe.

Every request of the contract is safe to repeat: queries and pictures change nothing, an upload and
a measurement join what is there, and a deletion that was done already is seen as done.
"""
from __future__ import annotations

import base64
import http.client
import os
import random
import re
import secrets
import ssl
import threading
import time
from dataclasses import dataclass
from typing import Any, Callable, Dict, Iterable, List, Mapping, Optional, Set, Tuple, Union
from urllib.parse import quote, urlencode, urlsplit

from .errors import ConnectionFailed, Error, Problem
from .version import VERSION

Buffer = Union[bytes, bytearray, memoryview]
Parameter = Union[None, bool, int, float, str]

CONNECT_S = 10.0
TraceLike = Union[None, str, Callable[[], Optional[str]]]

MAX_BROKEN = 4  # connections that break in a row, for one request
MAX_IDLE = 16  # connections kept
FIRST_PAUSE_S = 0.1
TRACEPARENT = re.compile(r"00-(?!0{32})[0-9a-f]{32}-(?!0{16})[0-9a-f]{16}-[0-9a-f]{2}")


@dataclass(frozen=True)
class Body:
    """What a request sends. `pieces` is called again when the request is repeated.

    sha256: hexadecimal, sent as Content-Digest (RFC 9530). A proxy before several servers finds the
    server of a mesh by it.
    """

    size: int
    content_type: str
    pieces: Callable[[], Iterable[Buffer]]
    sha256: Optional[str] = None

    @staticmethod
    def of(content: bytes, content_type: str) -> "Body":
        return Body(len(content), content_type, lambda: [content])


@dataclass(frozen=True)
class Answer:
    """A success. content is the caller's own, so arrays over it can be written."""

    status: int
    headers: Mapping[str, str]
    content: bytearray


class Aborted(Error):
    """The requests of a `Flight` were given up."""


class Flight:
    """Requests that are given up together; closing connections stops the server's work."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._connections: Set[http.client.HTTPConnection] = set()
        self._aborted = threading.Event()

    def add(self, connection: http.client.HTTPConnection) -> None:
        with self._lock:
            if self._aborted.is_set():
                raise Aborted("the batch was given up")
            self._connections.add(connection)

    def remove(self, connection: http.client.HTTPConnection) -> None:
        with self._lock:
            self._connections.discard(connection)

    def abort(self) -> None:
        with self._lock:
            self._aborted.set()
            for connection in self._connections:
                if connection.sock is not None:
                    try:
                        connection.sock.shutdown(2)  # wakes the thread that waits for bytes
                    except OSError:
                        pass

    def pause(self, seconds: float) -> None:
        if self._aborted.wait(seconds):
            raise Aborted("the batch was given up")

    @property
    def is_aborted(self) -> bool:
        return self._aborted.is_set()


def parameter_text(value: Any) -> str:
    """A parameter as the contract writes it. NumPy's scalars are taken as Python's."""
    if hasattr(value, "item") and getattr(value, "ndim", None) == 0:
        value = value.item()
    if isinstance(value, bool):
        return "true" if value else "false"
    if not isinstance(value, (int, float, str)):
        raise TypeError(f"a parameter is a number, a text or a bool, not {type(value).__name__}")
    return repr(value) if isinstance(value, float) else str(value)


def trace_of(given: TraceLike) -> Callable[[], Optional[str]]:
    """A function for the `traceparent` (W3C Trace Context) of a request; None sends none.

    Only a text that was given as an argument is an error if it is invalid: tracing fails no
    request.
    """
    if isinstance(given, str):
        if TRACEPARENT.fullmatch(given) is None:
            raise ValueError(
                f"the traceparent {given!r} is invalid; it has the form 00-TRACE-SPAN-FLAGS with "
                "32, 16 and 2 lower-case hexadecimal digits"
            )
        text: str = given
        return lambda: text
    source = given if given is not None else lambda: os.environ.get("TRACEPARENT")

    def checked() -> Optional[str]:
        found = source()
        return found if found and TRACEPARENT.fullmatch(found) else None

    return checked


class Transport:
    """Requests to the server at `url`. Safe from many threads at once, and after a fork.

    Each request has an id of its own (X-Request-Id), which its repetitions keep.
    """

    def __init__(
        self,
        url: str,
        token: Optional[str],
        context: Optional[ssl.SSLContext],
        stall_s: float,
        retry_s: float,
        traceparent: TraceLike = None,
    ) -> None:
        self._trace = trace_of(traceparent)
        parts = urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise ValueError(f"the server {url!r} is not of the form http://HOST:PORT")
        if parts.query or parts.fragment or parts.username is not None:
            raise ValueError(f"the server {url!r} may have only a scheme, host, port and path")
        if token is not None and not all("!" <= c <= "~" for c in token):
            raise ValueError("a token consists of visible ASCII characters")
        self.url = url.rstrip("/")
        self._parts = parts
        self._prefix = parts.path.rstrip("/")
        self._port = parts.port or (443 if parts.scheme == "https" else 80)
        self._context = context
        if parts.scheme == "https" and context is None:
            self._context = ssl.create_default_context()
        self._headers = {"User-Agent": f"kdray-python/{VERSION}", "Accept-Encoding": "identity"}
        if token is not None:
            self._headers["Authorization"] = f"Bearer {token}"
        self._stall_s = stall_s
        self._retry_s = retry_s
        self._lock = threading.Lock()
        self._idle: List[http.client.HTTPConnection] = []
        self._pid = os.getpid()
        self._was_reached = False

    def request(
        self,
        method: str,
        path: str,
        parameters: Optional[Mapping[str, Parameter]] = None,
        body: Optional[Body] = None,
        *,
        work_s: float = 0,
        on_sent: Optional[Callable[[int], None]] = None,
        flight: Optional[Flight] = None,
    ) -> Answer:
        """The answer; a refusal is raised as a Problem.

        work_s is how long the server may work before its first byte. 503 and 409 are repeated after
        the time that the server names, for at most retry_s. Raises ConnectionFailed if connections
        break repeatedly, or no byte comes in work_s and the client's patience.
        """
        query = {
            name: parameter_text(value)
            for name, value in (parameters or {}).items()
            if value is not None
        }
        target = self._prefix + path
        if query:
            target += "?" + urlencode(query, quote_via=quote, safe=",")
        request_id = f"kdray-{secrets.token_hex(6)}"
        headers = {**self._headers, "X-Request-Id": request_id}
        trace = self._trace()
        if trace is not None:
            headers["traceparent"] = trace
        give_up = time.monotonic() + self._retry_s
        broken = refused = 0
        was_lost = False  # the server may have done what was asked
        while True:
            connection, is_reused = self._take()
            try:
                if flight is not None:
                    flight.add(connection)
                try:
                    answer, is_kept = self._exchange(
                        connection, method, target, headers, body, work_s, on_sent, flight
                    )
                finally:
                    if flight is not None:
                        flight.remove(connection)
            except TimeoutError:
                connection.close()
                raise ConnectionFailed(
                    f"{self.url} was silent for too long ({method} {path}, request {request_id})"
                ) from None
            except (OSError, http.client.HTTPException) as error:
                connection.close()
                if flight is not None and flight.is_aborted:
                    raise Aborted("the batch was given up") from None
                was_lost = True
                if is_reused:  # the server had closed it before the request came
                    self.close()
                    continue
                broken += 1
                if broken >= MAX_BROKEN or not self._may_come_back(error):
                    raise ConnectionFailed(
                        f"cannot reach {self.url} ({method} {path}, request {request_id}): "
                        f"{error or type(error).__name__}"
                    ) from error
                pause(FIRST_PAUSE_S * 2 ** (broken - 1), flight)
                continue
            except BaseException:
                connection.close()
                raise
            self._was_reached = True
            if is_kept:
                self._give(connection)
            else:
                connection.close()
            if answer.status < 400:
                return answer
            problem = Problem.of_answer(answer.status, answer.content)
            if method == "DELETE" and was_lost and problem.status == 404:
                return answer
            wait_s = wait_before_repeat(answer, refused)
            if wait_s is None or time.monotonic() + wait_s > give_up:
                raise problem
            refused += 1
            pause(wait_s, flight)

    def close(self) -> None:
        """Closes the idle connections; later requests open new ones."""
        with self._lock:
            idle, self._idle = self._idle, []
        for connection in idle:
            connection.close()

    def _may_come_back(self, error: BaseException) -> bool:
        """Whether trying again is sensible: a wrong URL or certificate stays wrong."""
        if self._retry_s == 0 or isinstance(error, ssl.SSLCertVerificationError):
            return False
        return (
            self._was_reached
            or not isinstance(error, OSError)
            or isinstance(error, (ConnectionResetError, ConnectionAbortedError, BrokenPipeError))
        )

    def _take(self) -> Tuple[http.client.HTTPConnection, bool]:
        with self._lock:
            if self._pid != os.getpid():  # after a fork the connections are the parent's
                for connection in self._idle:
                    connection.close()  # closes this process's copy only
                self._idle, self._pid = [], os.getpid()
            if self._idle:
                return self._idle.pop(), True
        host = self._parts.hostname or ""
        if self._parts.scheme == "https":
            return (
                http.client.HTTPSConnection(
                    host, self._port, timeout=CONNECT_S, context=self._context
                ),
                False,
            )
        return http.client.HTTPConnection(host, self._port, timeout=CONNECT_S), False

    def _give(self, connection: http.client.HTTPConnection) -> None:
        with self._lock:
            if self._pid == os.getpid() and len(self._idle) < MAX_IDLE:
                self._idle.append(connection)
                return
        connection.close()

    def _exchange(
        self,
        connection: http.client.HTTPConnection,
        method: str,
        target: str,
        request_headers: Mapping[str, str],
        body: Optional[Body],
        work_s: float,
        on_sent: Optional[Callable[[int], None]],
        flight: Optional[Flight],
    ) -> Tuple[Answer, bool]:
        """The answer, and whether the connection may be used again."""
        if connection.sock is None:
            connection.connect()
        if flight is not None and flight.is_aborted:  # while it had no socket to be shut down
            raise Aborted("the batch was given up")
        if connection.sock is not None:
            connection.sock.settimeout(work_s + self._stall_s)
        connection.putrequest(method, target, skip_accept_encoding=True)
        for name, value in request_headers.items():
            connection.putheader(name, value)
        if body is not None:
            connection.putheader("Content-Type", body.content_type)
            if body.sha256 is not None:
                digest = base64.b64encode(bytes.fromhex(body.sha256)).decode()
                connection.putheader("Content-Digest", f"sha-256=:{digest}:")
        if method == "POST":
            connection.putheader("Content-Length", str(body.size if body is not None else 0))
        is_whole = True
        try:
            connection.endheaders()
            if body is not None:
                send_pieces(connection, body, on_sent)
        except (BrokenPipeError, ConnectionResetError):
            is_whole = False  # a server that refuses early closes; its reason may have arrived
        response = connection.getresponse()
        content = read_content(response)
        headers = {name.lower(): value for name, value in response.getheaders()}
        if not is_whole and response.status < 400:
            raise http.client.HTTPException("answered before it had the whole request")
        return Answer(response.status, headers, content), is_whole and not response.will_close


def send_pieces(
    connection: http.client.HTTPConnection, body: Body, on_sent: Optional[Callable[[int], None]]
) -> None:
    sent = 0
    for piece in body.pieces():
        connection.send(piece)
        sent += len(piece)
        if sent > body.size:
            break
        if on_sent is not None:
            on_sent(sent)
    if sent != body.size:
        raise ValueError(f"the body changed while it was sent: {sent} bytes instead of {body.size}")


def read_content(response: http.client.HTTPResponse) -> bytearray:
    if response.length is None:
        return bytearray(response.read())
    content = bytearray(response.length)
    rest = memoryview(content)
    while len(rest):
        count = response.readinto(rest)
        if not count:
            raise http.client.IncompleteRead(bytes(content[: len(content) - len(rest)]), len(rest))
        rest = rest[count:]
    response.read()  # ends the response, so the connection is free again
    return content


def wait_before_repeat(answer: Answer, refused: int) -> Optional[float]:
    """Seconds; None if a repetition would be refused as well."""
    if answer.status not in (409, 429, 502, 503):
        return None
    try:
        wait_s = float(answer.headers["retry-after"])
    except (KeyError, ValueError):
        if answer.status == 409:
            return None
        wait_s = 0.25 * 2.0 ** min(refused, 6)
    # Clients that were refused together do not return together.
    return max(wait_s, 0.05) * random.uniform(1, 1.25)


def pause(seconds: float, flight: Optional[Flight]) -> None:
    if flight is not None:
        flight.pause(seconds)
    else:
        time.sleep(seconds)
