# SPDX-License-Identifier: Apache-2.0
"""Load of a daemon in a closed loop, whose clients wait for answers, and in an open one, whose clients do not."""
import re
import selectors
import socket
import threading
import time

from pressure_service import MIB, Peer


def closed_loop(port, request, connections, seconds):
    """Answers a second, each connection sending its next request when it has its answer."""
    counts = []

    def run():
        peer, count = Peer(port), 0
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            peer.socket.sendall(request)
            if peer.answer()[0] != 200:
                raise RuntimeError("a request of the closed loop was refused")
            count += 1
        counts.append(count)
        peer.close()

    threads = [threading.Thread(target=run) for _ in range(connections)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return sum(counts) / seconds


# A server may close a connection that was idle as the next request is on its way. Clients therefore use
# only what was idle for a short time (and repeat what fails); these loops repeat nothing.
IDLE_S = 5.0


class Flight:
    """A kept connection of the open loop, with at most one request."""

    def __init__(self, port):
        self.socket = socket.create_connection(("127.0.0.1", port))
        self.socket.setblocking(False)
        self.is_idle, self.idle_since = True, time.perf_counter()

    def begin(self, request):
        self.unsent, self.data, self.length, self.status = memoryview(request), b"", None, None
        self.start, self.is_idle = time.perf_counter(), False
        self.send()

    def send(self):
        try:
            while self.unsent:
                self.unsent = self.unsent[self.socket.send(self.unsent):]
        except BlockingIOError:
            pass

    def receive(self):
        """True when the answer is complete; raises if it is cut."""
        while True:
            try:
                piece = self.socket.recv(MIB)
            except BlockingIOError:
                break
            if not piece:
                raise ConnectionError
            self.data += piece
            if self.length is None and b"\r\n\r\n" in self.data:
                headers, _, rest = self.data.partition(b"\r\n\r\n")
                self.status = int(headers.split()[1])
                self.seen = time.perf_counter()
                self.length = len(headers) + 4 + int(re.search(rb"(?i)content-length: (\d+)", headers)[1])
        # The next request begins after this one has been sent.
        return self.length is not None and len(self.data) >= self.length and not self.unsent


def open_loop(port, request, per_second, seconds):
    """Requests at a fixed rate, whether or not answers come: (answers a second with status 200, seconds to each 503,
    requests without an answer)."""
    selector, idle = selectors.DefaultSelector(), []
    good, refused, cut, sent = 0, [], 0, 0
    start = time.perf_counter()
    while (now := time.perf_counter()) < start + seconds:
        while sent < (now - start) * per_second:
            sent += 1
            # The last is the one that was idle for the shortest time.
            flight = idle.pop() if idle and now - idle[-1].idle_since < IDLE_S else None
            if flight is None:
                if len(selector.get_map()) >= 900:
                    continue  # the client's own limit
                flight = Flight(port)
                selector.register(flight.socket, selectors.EVENT_READ, flight)
            flight.begin(request)
            if flight.unsent:
                selector.modify(flight.socket, selectors.EVENT_READ | selectors.EVENT_WRITE, flight)
        for key, events in selector.select(0.001):
            flight = key.data
            try:
                if events & selectors.EVENT_WRITE:
                    flight.send()
                    if not flight.unsent:
                        selector.modify(flight.socket, selectors.EVENT_READ, flight)
                if flight.is_idle or not flight.receive():
                    continue
            except OSError:
                if not flight.is_idle:
                    cut += 1
                selector.unregister(flight.socket)
                flight.socket.close()
                if flight in idle:
                    idle.remove(flight)
                continue
            flight.is_idle, flight.idle_since = True, time.perf_counter()
            idle.append(flight)
            if flight.status == 200:
                good += 1
            elif flight.status == 503:
                refused.append(flight.seen - flight.start)
    for key in list(selector.get_map().values()):
        key.data.socket.close()
    return good / seconds, refused, cut
