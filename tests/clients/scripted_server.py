# SPDX-License-Identifier: Apache-2.0
"""A server that misbehaves as a test says: for each request it does one step of its script."""
import json
import socket
import threading


def answer(status, content=b"", headers=(), declared=None):
    """The bytes of an answer; declared is the Content-Length, if it is to be wrong."""
    if not isinstance(content, bytes):
        content = json.dumps(content).encode()
    lines = [
        f"HTTP/1.1 {status} Scripted",
        f"Content-Length: {len(content) if declared is None else declared}",
        *headers,
        "",
        "",
    ]
    return "\r\n".join(lines).encode() + content


class ScriptedServer:
    """Context manager. A step is a function of the connection, and returns whether to keep it.

    `requests` are the heads that were read.
    """

    def __init__(self, *steps, tls=None):
        self._tls = tls  # an ssl.SSLContext
        self._steps = list(steps)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._connections = []
        self.requests = []
        self.connections = 0
        scheme = "https" if tls else "http"
        self.url = f"{scheme}://127.0.0.1:{self._listener.getsockname()[1]}"
        self._thread = threading.Thread(target=self._accept, daemon=True)
        self._thread.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._listener.close()
        for connection in self._connections:
            connection.close()

    def _accept(self):
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            self.connections += 1
            self._connections.append(connection)
            threading.Thread(target=self._serve, args=(connection,), daemon=True).start()

    def _serve(self, connection):
        try:
            if self._tls:
                connection = self._tls.wrap_socket(connection, server_side=True)
            while self._steps and self._read_head(connection):
                if not self._steps.pop(0)(connection):
                    break
        except OSError:
            pass
        connection.close()

    def _read_head(self, connection):
        """Reads a head, and its body unless the next step reads it itself."""
        head = b""
        while not head.endswith(b"\r\n\r\n"):
            byte = connection.recv(1)
            if not byte:
                return False
            head += byte
        self.requests.append(head.decode())
        length = next(
            (
                int(line.split(b":")[1])
                for line in head.lower().split(b"\r\n")
                if line.startswith(b"content-length:")
            ),
            0,
        )
        while length and not getattr(self._steps[0], "leaves_body", False):
            length -= len(connection.recv(min(length, 1 << 16)))
        return True


def say(*arguments, keep=True, **named):
    def step(connection):
        connection.sendall(answer(*arguments, **named))
        return keep

    return step


def hang_up(connection):
    """Closes without an answer."""


def say_before_the_body_and_close(*arguments, **named):
    def step(connection):
        connection.sendall(answer(*arguments, **named))
        connection.shutdown(socket.SHUT_WR)
        connection.settimeout(0.2)
        return False

    step.leaves_body = True
    return step
