# SPDX-License-Identifier: Apache-2.0
"""The client of tests/bench/http: http_client.py KDRAYD FOLDER RUNS

Asks a daemon over a loopback socket for the batches and the picture of bench_http, in turn with the
measures that they are compared with, and writes http.csv and memory.csv into the folder:

  total     from the first byte sent to the last byte received
  first     the same of a request just before, after a pause of some seconds
  queue, parse, trace, encode   Server-Timing of the same requests
  echo      a plain server that takes the body and sends as many bytes as the answer has
  python    json.loads(body) and json.dumps(answer); zlib.compress(pixels, 1) for the picture
  size      bytes of the answer; size_zlib6: zlib.compress(filtered rows, 6) of the picture
"""
import csv
import io
import json
import os
import re
import socket
import struct
import sys
import time
import urllib.parse
import urllib.request
import zlib
from multiprocessing import Process, Queue
from pathlib import Path
from statistics import median

import numpy as np
from matplotlib.image import imread

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "clients"))
from daemon import Daemon  # noqa: E402

SIDE = 1024
ROOM = 256 << 20  # for a body or an answer


class Client:
    """Does no work of its own between the bytes and their times."""

    def __init__(self, port):
        self.port = port
        self.buffer = bytearray(ROOM)

    def ask(self, path, body=b""):
        """(milliseconds, head, answer) on a new connection; the answer is valid until the next call."""
        length = f"Content-Length: {len(body)}\r\n" if body else ""
        head = f"{'POST' if body else 'GET'} {path} HTTP/1.1\r\nHost: x\r\n{length}\r\n".encode()
        view = memoryview(self.buffer)
        self.socket = socket.create_connection(("127.0.0.1", self.port))
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        start = time.perf_counter()
        self.socket.sendall(head)
        if body:
            self.socket.sendall(body)
        got, end = 0, -1
        while end < 0:
            got += self.receive(view[got:])
            end = self.buffer.find(b"\r\n\r\n", 0, got)
        text = bytes(view[:end]).decode()
        length = int(re.search(r"(?i)content-length: (\d+)", text)[1])
        while got < end + 4 + length:
            got += self.receive(view[got:])
        ms = 1e3 * (time.perf_counter() - start)
        self.socket.close()
        if not text.startswith("HTTP/1.1 200"):
            raise RuntimeError(text + bytes(view[end:got]).decode()[:500])
        return ms, text, view[end + 4:got]

    def receive(self, view):
        count = self.socket.recv_into(view)
        if count == 0:
            raise RuntimeError("the server closed the connection")
        return count


def serve_echo(ports):
    """A connection sends a body's length and an answer's length (8 bytes each), the body, and gets the answer."""
    listener = socket.create_server(("127.0.0.1", 0))
    ports.put(listener.getsockname()[1])
    body, answer = bytearray(ROOM), bytes(ROOM)
    while True:
        peer, _ = listener.accept()
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        while head := peer.recv(16, socket.MSG_WAITALL):
            count, wanted = struct.unpack("<QQ", head)
            view, got = memoryview(body), 0
            while got < count:
                got += peer.recv_into(view[got:count])
            peer.sendall(memoryview(answer)[:wanted])


class Echo:
    def __init__(self):
        ports = Queue()
        self.process = Process(target=serve_echo, args=(ports,), daemon=True)
        self.process.start()
        self.socket = socket.create_connection(("127.0.0.1", ports.get()))
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.buffer = bytearray(ROOM)

    def measure(self, body, wanted):
        view, got = memoryview(self.buffer), 0
        start = time.perf_counter()
        self.socket.sendall(struct.pack("<QQ", len(body), wanted))
        self.socket.sendall(body)
        while got < wanted:
            got += self.socket.recv_into(view[got:wanted])
        return 1e3 * (time.perf_counter() - start)


def timings(head):
    found = re.search(r"(?i)server-timing: (.*)", head)[1]
    return {name: float(ms) for name, ms in re.findall(r"(\w+);dur=([\d.]+)", found)}


def timed(work):
    start = time.perf_counter()
    work()
    return 1e3 * (time.perf_counter() - start)


def memory(pid, name):
    with open(f"/proc/{pid}/status") as file:
        return int(re.search(rf"{name}:\s+(\d+) kB", file.read())[1]) * 1024


def pixels_of(png):
    """The bytes of a PNG's pixels, and of its filtered rows, which its IDAT chunks hold."""
    at, data = 8, b""
    while at < len(png):
        length, kind = struct.unpack(">I4s", png[at:at + 8])
        if kind == b"IDAT":
            data += png[at + 8:at + 8 + length]
        at += 12 + length
    pixels = np.rint(imread(io.BytesIO(png)) * 255).astype(np.uint8)
    return pixels.tobytes(), zlib.decompress(data)


def main():
    kdrayd, folder, runs = sys.argv[1], Path(sys.argv[2]), int(sys.argv[3])
    npy = (folder / "rays.npy").read_bytes()
    text = json.dumps({"rays": np.load(folder / "rays.npy").tolist()}).encode()
    mesh = (Path(os.environ["KDRAY_MESHES"]) / "igea_268k.ply").read_bytes()
    echo = Echo()
    rows, peaks = [], []
    for threads in dict.fromkeys((1, os.cpu_count())):
        with Daemon(kdrayd, "--threads", str(threads)) as daemon:
            pid = daemon._process.pid
            port = urllib.parse.urlsplit(daemon.url).port
            with urllib.request.urlopen(daemon.url + "/v1/trees", mesh) as answer:
                tree = "/v1/trees/" + json.load(answer)["id"]
            client = Client(port)
            cases = {f"{form} {query}": (f"{tree}/rays/{query}", body)
                     for form, body in (("npy", npy), ("json", text)) for query in ("closest", "any")}
            cases["picture"] = (f"{tree}/render.png?width={SIDE}&height={SIDE}&samples=1", b"")
            for name, (path, body) in cases.items():
                time.sleep(6)  # until the daemon has given back the blocks that it keeps for a while
                before = memory(pid, "VmRSS")
                with open(f"/proc/{pid}/clear_refs", "w") as file:
                    file.write("5")  # forgets the peak so far
                client.ask(path, body)
                peaks.append({"case": name, "threads": threads, "body": len(body),
                              "peak": memory(pid, "VmHWM") - before})
            seen = {}
            for run in range(runs):
                for name, (path, body) in cases.items():
                    first, _, _ = client.ask(path, body)  # after a pause, in which the measures below were taken
                    ms, head, answer = client.ask(path, body)
                    parts = {"total": ms, "first": first, **timings(head)}
                    parts["echo"] = echo.measure(body or b"x", len(answer))
                    if name.startswith("json") and run < 3:
                        value = json.loads(bytes(answer))
                        parts["python"] = timed(lambda: json.loads(body)) + timed(lambda: json.dumps(value))
                    if name == "picture":
                        if "pixels" not in seen:
                            seen["pixels"], filtered = pixels_of(bytes(answer))
                            seen["size_zlib6"] = len(zlib.compress(filtered, 6))
                        parts["python"] = timed(lambda: zlib.compress(seen["pixels"], 1))
                        parts["size_zlib6"] = seen["size_zlib6"]
                    parts["size"] = len(answer)
                    rows += [{"case": name, "threads": threads, "part": part, "value": value}
                             for part, value in parts.items()]
    for name, table in (("http.csv", rows), ("memory.csv", peaks)):
        with open(folder / name, "w", newline="") as file:
            writer = csv.DictWriter(file, table[0].keys())
            writer.writeheader()
            writer.writerows(table)


if __name__ == "__main__":
    main()
