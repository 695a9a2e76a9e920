# SPDX-License-Identifier: Apache-2.0
"""Clients that each send a request and wait for its answer, on kept connections, in one thread."""
import selectors
import socket
import time


class Client:
    """One connection with its own request. It does no work between the bytes and their times."""

    def __init__(self, port, request):
        self._address = ("127.0.0.1", port)
        self._request = request
        self.socket = None
        self.started = None
        self.due = 0.0

    def connect(self):
        self.socket = socket.create_connection(self._address, timeout=20)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.socket.setblocking(True)
        self._rest, self._head = None, b""

    def send(self):
        self.started = time.time()
        self.socket.sendall(self._request)

    def receive(self):
        """The status when the answer is complete, else None. 0: the connection broke."""
        try:
            piece = self.socket.recv(1 << 20)
        except OSError:
            piece = b""
        if not piece:
            return 0
        if self._rest is None:
            self._head += piece
            end = self._head.find(b"\r\n\r\n")
            if end < 0:
                return None
            head = self._head[:end].lower()
            length = int(head.split(b"content-length:", 1)[1].split(b"\r\n", 1)[0])
            self._rest = end + 4 + length - len(self._head)
        else:
            self._rest -= len(piece)
        if self._rest > 0:
            return None
        status = int(self._head[9:12])
        self._rest, self._head = None, b""
        return status


def http_request(method, path, body=b"", content_type="application/x-npy"):
    """The bytes of a request."""
    head = f"{method} {path} HTTP/1.1\r\nHost: bench\r\n"
    if body:
        head += f"Content-Type: {content_type}\r\nContent-Length: {len(body)}\r\n"
    return head.encode() + b"\r\n" + body


def run(clients, seconds, pause_s=0.0, during=lambda now: None):
    """[(start, seconds, status)] of all requests that ended within `seconds`.

    Each client sends its next request `pause_s` after an answer. `during` is called all the time.
    """
    selector = selectors.DefaultSelector()
    for number, client in enumerate(clients):
        client.connect()
        selector.register(client.socket, selectors.EVENT_READ, client)
        client.started, client.due = None, time.time() + pause_s * number / len(clients)
    found = []
    end = time.time() + seconds
    while (now := time.time()) < end:
        during(now)
        wait = 0.02
        for client in clients:
            if client.started is None:
                if client.due <= now:
                    client.send()
                else:
                    wait = min(wait, client.due - now)
        for key, _ in selector.select(wait):
            client = key.data
            status = client.receive()
            if status is None:
                continue
            now = time.time()
            found.append((client.started, now - client.started, status))
            client.started, client.due = None, now + pause_s
            if status == 0:
                selector.unregister(client.socket)
                client.socket.close()
                client.connect()
                selector.register(client.socket, selectors.EVENT_READ, client)
    for client in clients:
        client.socket.close()
    return found
