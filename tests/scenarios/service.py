# SPDX-License-Identifier: Apache-2.0
"""A daemon under test for the scenarios, and clients that behave well or badly."""
import http.client
import json
import mmap
import os
import re
import resource
import selectors
import shutil
import signal
import socket
import struct
import subprocess
import tempfile
import threading
import time

MEMORY_FOLDER = "/dev/shm" if os.path.isdir("/dev/shm") else None  # fsync costs nothing there


def tetrahedron(number=0):
    """A closed OFF mesh; each number gives other bytes."""
    return (f"OFF\n4 4 0\n0 0 {-number}\n1 0 0\n0 1 0\n0 0 1\n"
            "3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n").encode()


def bumpy(rows=40):
    """A closed OFF mesh of some 4 * rows^2 triangles."""
    columns = 2 * rows
    points = [(0, 0, 1), (0, 0, -1)]
    from math import cos, pi, sin
    for row in range(1, rows):
        for column in range(columns):
            up, around = pi * row / rows, 2 * pi * column / columns
            radius = 1 + 0.2 * sin(5 * up) * sin(6 * around)
            points.append((radius * sin(up) * cos(around), radius * sin(up) * sin(around),
                           radius * cos(up)))

    def at(row, column):
        return 2 + (row - 1) * columns + column % columns
    faces = []
    for column in range(columns):
        faces.append((0, at(1, column), at(1, column + 1)))
        faces.append((1, at(rows - 1, column + 1), at(rows - 1, column)))
        for row in range(1, rows - 1):
            a, b = at(row, column), at(row + 1, column)
            c, d = at(row + 1, column + 1), at(row, column + 1)
            faces += [(a, b, c), (a, c, d)]
    lines = [f"OFF\n{len(points)} {len(faces)} 0"]
    lines += ["%.9g %.9g %.9g" % point for point in points]
    lines += ["3 %d %d %d" % face for face in faces]
    return ("\n".join(lines) + "\n").encode()


def rays(count=64, seed=1):
    """A JSON batch; each seed gives other rays."""
    import random
    numbers = random.Random(seed)
    return json.dumps({"rays": [[numbers.uniform(-2, 2) for _ in range(6)]
                                for _ in range(count)]}).encode()


class Countdowns:
    """Which allocation and which start of a thread fails in the daemon: see
    tests/preload/failing_calls.cc."""

    def __init__(self, folder):
        self.path = os.path.join(folder, "faults")
        with open(self.path, "wb") as file:
            file.write(struct.pack("qq", -1, -1))
        self._file = open(self.path, "r+b")
        self._map = mmap.mmap(self._file.fileno(), 16)

    def set(self, allocations=-1, threads=-1):
        self._map[:] = struct.pack("qq", allocations, threads)

    def get(self):
        """(allocations, threads) that are left before one fails; negative if one has failed."""
        return struct.unpack("qq", self._map[:])

    def close(self):
        self._map.close()
        self._file.close()


class Service:
    """The real kdrayd on a free port with a data directory of its own; a context manager."""

    def __init__(self, kdrayd, *options, preload=None, descriptors=None):
        self.folder = tempfile.mkdtemp(prefix="kdray-scenario-", dir=MEMORY_FOLDER)
        environment = {name: value for name, value in os.environ.items()
                       if not name.startswith("KDRAY_")}
        self.faults = None
        if preload:
            self.faults = Countdowns(self.folder)
            environment.update(LD_PRELOAD=preload, KDRAY_FAULTS=self.faults.path)

        def limit():
            if descriptors:
                resource.setrlimit(resource.RLIMIT_NOFILE, descriptors)
        self.prepare()
        self.log_path = os.path.join(self.folder, "log")
        with open(self.log_path, "wb") as log:
            self.process = subprocess.Popen(
                [kdrayd, "--port", "0", "--data-dir", os.path.join(self.folder, "data"), *options],
                stdout=subprocess.PIPE, stderr=log, env=environment, preexec_fn=limit)
        line = self.process.stdout.readline().decode()
        found = re.match(r"kdrayd listening on http://127.0.0.1:(\d+)", line)
        if not found:
            self.fail_to_start(line)
        self.port = int(found[1])
        self.tree = None

    def prepare(self):
        """Called before the daemon is started."""

    def fail_to_start(self, line):
        self.close()
        raise RuntimeError(f"kdrayd did not start; it said: {line!r}")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self.process.stdout.close()
        if self.faults:
            self.faults.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    def stop(self, timeout=40):
        """The exit code after SIGTERM."""
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(timeout)

    def log(self):
        with open(self.log_path, encoding="utf-8") as file:
            return [json.loads(line) for line in file]

    def connect(self, timeout=30):
        return http.client.HTTPConnection("127.0.0.1", self.port, timeout=timeout)

    def socket(self, timeout=30):
        return socket.create_connection(("127.0.0.1", self.port), timeout)

    def ask(self, method, path, body=None, headers=None, connection=None):
        """(status, body) on a new connection, or on the given one."""
        used = connection or self.connect()
        try:
            used.request(method, path, body, headers or {})
            answer = used.getresponse()
            return answer.status, answer.read()
        finally:
            if connection is None:
                used.close()

    def upload(self, mesh):
        status, body = self.ask("POST", "/v1/trees", mesh)
        if status not in (200, 201):
            raise RuntimeError(f"the upload was answered with {status}: {body[:300]}")
        self.tree = "/v1/trees/" + json.loads(body)["id"]
        return self.tree

    def metric(self, name):
        """The value of the line of /metrics that begins with `name` and a blank."""
        for line in self.ask("GET", "/metrics")[1].decode().splitlines():
            if line.startswith(name + " "):
                return float(line.rsplit(" ", 1)[1])
        return None

    def process_figures(self):
        """(resident MiB, descriptors, threads)"""
        folder = f"/proc/{self.process.pid}"
        with open(folder + "/status", encoding="utf-8") as file:
            status = dict(line.split(":", 1) for line in file if ":" in line)
        return (int(status["VmRSS"].split()[0]) / 1024, len(os.listdir(folder + "/fd")),
                int(status["Threads"]))


class SlowClients(threading.Thread):
    """Connections that send `start` and then, if it is given, `step` after each pause. They begin
    again when they are closed. With `receive_buffer` they read nothing. One thread holds them all."""

    def __init__(self, port, count, start, step=None, pause=0.02, receive_buffer=None):
        super().__init__(daemon=True)
        self.port, self.count, self.start_bytes, self.step = port, count, start, step
        self.pause, self.receive_buffer = pause, receive_buffer
        self.opened = 0
        self._ended = threading.Event()

    def __enter__(self):
        self.start()
        deadline = time.monotonic() + 20
        while self.opened < self.count and time.monotonic() < deadline:
            time.sleep(0.01)
        return self

    def __exit__(self, *_):
        self._ended.set()
        self.join()

    def _open(self, selector):
        client = socket.socket()
        if self.receive_buffer:
            client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, self.receive_buffer)
        try:
            client.connect(("127.0.0.1", self.port))
            client.setblocking(False)
            client.send(self.start_bytes)
        except OSError:
            client.close()
            return
        selector.register(client, selectors.EVENT_READ)
        self.opened += 1

    def run(self):
        with selectors.DefaultSelector() as selector:
            while not self._ended.is_set():
                for _ in range(min(self.count - len(selector.get_map()), 200)):
                    self._open(selector)
                clients = {key.fileobj for key in selector.get_map().values()}
                if self.receive_buffer is None:  # otherwise answers stay unread
                    for key, _ in selector.select(0):
                        try:
                            ended = not key.fileobj.recv(4096)
                        except OSError:
                            ended = True
                        if ended:
                            selector.unregister(key.fileobj)
                            key.fileobj.close()
                            clients.discard(key.fileobj)
                if self.step:
                    for client in clients:
                        try:
                            client.send(self.step)
                        except OSError:
                            pass
                self._ended.wait(self.pause)
            for key in list(selector.get_map().values()):
                key.fileobj.close()


def percentile(values, share):
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]
