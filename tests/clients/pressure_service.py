# SPDX-License-Identifier: Apache-2.0
"""A daemon under pressure, and connections to it, for pressure_test.py.

Arguments of the test: KDRAYD KDRAY [--long] [TEST...]
"""
import io
import itertools
import json
import os
import re
import socket
import subprocess
import sys
import urllib.parse
import urllib.request

import numpy as np

from daemon import Daemon

LONG = "--long" in sys.argv
KDRAYD, KDRAY, *TESTS = [argument for argument in sys.argv[1:] if argument != "--long"]
MIB = 1 << 20


def npy(array):
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def rays(count, seed=1):
    """Rays around the teapot, most of which hit it."""
    numbers = np.random.default_rng(seed)
    origins = numbers.uniform(-12, 12, (count, 3))
    return np.hstack([origins, numbers.uniform(-2, 2, (count, 3)) - origins]).astype("<f4")


def json_rays(count):
    """The text of a batch; its rows repeat after a thousand."""
    rows = json.dumps(rays(1000).tolist())[1:-1]
    return ('{"rays":[' + ", ".join(itertools.repeat(rows, count // 1000)) + "]}").encode()


def head(method, path, length=None):
    lengths = "" if length is None else f"Content-Length: {length}\r\n"
    return f"{method} {path} HTTP/1.1\r\nHost: h\r\n{lengths}\r\n".encode()


class Peer:
    """A connection whose answers are read one at a time."""

    def __init__(self, port, receive_buffer=None):
        self.socket = socket.socket()
        if receive_buffer is not None:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self.socket.settimeout(120)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.socket.connect(("127.0.0.1", port))

    def ask(self, method, path, body=None, read=True):
        """(status, headers as text, body)"""
        self.socket.sendall(head(method, path, None if body is None else len(body)))
        if body is not None:
            self.socket.sendall(body)
        return self.answer(method == "HEAD") if read else None

    def answer(self, is_head=False):
        data = b""
        while b"\r\n\r\n" not in data:
            piece = self.socket.recv(65536)
            if not piece:
                raise ConnectionError("the connection ended")
            data += piece
        headers, _, got = data.partition(b"\r\n\r\n")
        headers = headers.decode()
        length = 0 if is_head else int(re.search(r"(?i)content-length: (\d+)", headers)[1])
        parts = [got]
        missing = length - len(got)
        while missing > 0:
            piece = self.socket.recv(min(missing, MIB))
            if not piece:
                raise ConnectionError("the answer was cut")
            parts.append(piece)
            missing -= len(piece)
        return int(headers.split()[1]), headers, b"".join(parts)

    def close(self):
        self.socket.close()


class Service(Daemon):
    """A daemon with a teapot, on a processor of its own if there are two and the form is long."""

    def __init__(self, *options):
        super().__init__(KDRAYD, *options)
        self.pid = self._process.pid
        processors = sorted(os.sched_getaffinity(0))
        self.processors = processors
        if LONG and len(processors) > 1:
            for thread in os.listdir(f"/proc/{self.pid}/task"):
                os.sched_setaffinity(int(thread), {processors[0]})
            os.sched_setaffinity(0, set(processors[1:]))
        self.port = urllib.parse.urlsplit(self.url).port
        mesh = os.path.join(self.folder, "teapot.obj")
        subprocess.run([KDRAY, "-q", "sample", "teapot", "-o", mesh], check=True)
        with open(mesh, "rb") as file, urllib.request.urlopen(self.url + "/v1/trees", file.read()) as answer:
            self.tree = "/v1/trees/" + json.load(answer)["id"]
        # What a query needs beside its own memory is there from now on.
        self.ask("POST", "/rays/closest", npy(rays(1000)))
        with open(f"/proc/{self.pid}/clear_refs", "w") as file:
            file.write("5")  # forgets the peak so far

    def close(self):
        os.sched_setaffinity(0, set(getattr(self, "processors", os.sched_getaffinity(0))))
        super().close()

    def ask(self, method, path, body=None):
        peer = Peer(self.port)
        try:
            return peer.ask(method, self.tree + path, body)
        finally:
            peer.close()

    def status_of_batch(self, path, body):
        """(status, headers, answer), also if the answer comes before the whole body has been sent."""
        peer = Peer(self.port)
        try:
            peer.socket.sendall(head("POST", self.tree + path, len(body)))
            try:
                peer.socket.sendall(body)
            except OSError:
                pass  # refused, and the answer has been received
            return peer.answer()
        except OSError:
            return 413, "", b""  # the rest of a refused body may destroy the answer
        finally:
            peer.close()

    def memory(self, name="VmHWM"):
        with open(f"/proc/{self.pid}/status") as file:
            return int(re.search(rf"{name}:\s+(\d+) kB", file.read())[1]) * 1024

    def processor_seconds(self):
        with open(f"/proc/{self.pid}/stat") as file:
            fields = file.read().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def metric(self, name):
        with urllib.request.urlopen(self.url + "/metrics") as answer:
            return float(re.search(rf"^{name} (\S+)$", answer.read().decode(), re.M)[1])
