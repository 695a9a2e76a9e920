# SPDX-License-Identifier: Apache-2.0
"""Daemons behind HAProxy as server/deploy/local starts them, for tests and benchmarks."""
import http.client
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import urllib.parse
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent.parent
HAPROXY = shutil.which("haproxy", path=os.environ.get("PATH", "") + ":/usr/sbin")
RAYS = json.dumps({"rays": [[0.2, 0.1 * i, 9, 0, 0, -1] for i in range(-4, 5)]}).encode()
BACK_S = 10.0


def mesh(number):
    """A tetrahedron; each number has other bytes, so another place on the ring."""
    height = 1 + number / 100
    vertices = np.array([[-1, -1, 0], [1, -1, 0], [0, 1, 0], [0, 0, height]])
    return vertices, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


class Replicas:
    """Context manager: server/deploy/local on a free port.

    folder: the data directory, default a temporary one; it has the logs and targets.json.
    environment: of HAProxy. A test is one client and sends all its load from one address, so the
    limit of requests is out of its way unless the test sets it.
    """

    def __init__(self, kdrayd, number=3, folder=None, options=("--threads", "1"), **environment):
        self._own_folder = folder is None
        self.folder = folder or tempfile.mkdtemp(prefix="kdray-replicas-")
        inherited = {name: value for name, value in os.environ.items()
                     if not name.startswith("KDRAY_")}
        self._process = subprocess.Popen(
            [sys.executable, str(ROOT / "server/deploy/local"), "--replicas", str(number), "--port",
             "0", "--data-dir", self.folder, "--kdrayd", kdrayd, "--", *options],
            stdout=subprocess.PIPE, text=True,
            env={**inherited, "KDRAY_CLIENT_REQUESTS": "1000000000", **environment})
        self.processes, self.addresses, self.url = {}, {}, None
        while self.url is None:
            line = self._process.stdout.readline()
            if not line:
                raise RuntimeError(f"server/deploy/local ended; its logs are in {self.folder}")
            self._read(line)
        self.process_id = self._process.pid  # the parent of HAProxy and the daemons
        self._reader = threading.Thread(target=self._read_all)
        self._reader.start()
        self.port = urllib.parse.urlsplit(self.url).port
        if "KDRAY_CERTIFICATE" not in environment:
            self._await(self.port)

    def _read(self, line):
        replica = re.match(r"(replica\d+) (http://\S+) process (\d+)", line)
        served = re.match(r"kdray listening on (http://\S+)", line)
        if replica:
            self.addresses[replica[1]] = replica[2]
            self.processes[replica[1]] = int(replica[3])
        if served:
            self.url = served[1]

    def _read_all(self):
        for line in self._process.stdout:
            self._read(line)

    @staticmethod
    def _await(port):
        deadline = time.monotonic() + BACK_S
        while time.monotonic() < deadline:
            try:
                if request(port, "GET", "/readyz")[0] == 200:
                    return
            except OSError:
                pass
            time.sleep(0.05)
        raise RuntimeError("HAProxy does not answer")

    def stop(self, replica, how):
        """Sends the signal; returns the process that ends."""
        old = self.processes[replica]
        os.kill(old, how)
        return old

    def wait_for_return(self, replica, old):
        """Until the replica runs again and HAProxy sends it requests."""
        port = urllib.parse.urlsplit(self.addresses[replica]).port
        deadline = time.monotonic() + BACK_S
        while self.processes[replica] == old and time.monotonic() < deadline:
            time.sleep(0.02)
        self._await(port)
        seen = set()
        while replica not in seen and time.monotonic() < deadline:
            # Without a mesh in the path, the replicas take turns. HAProxy's own answers name none.
            seen.add(request(self.port, "GET", "/v1")[1].get("kdray-replica"))
            time.sleep(0.01)
        if replica not in seen:
            raise RuntimeError(f"{replica} did not come back")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._process.terminate()
        self._process.wait(timeout=60)
        self._reader.join()
        self._process.stdout.close()
        if self._own_folder:
            shutil.rmtree(self.folder, ignore_errors=True)


def request(port, method, path, body=None, connection=None, headers=()):
    """One request, never repeated: status, headers, content."""
    own = connection or http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    own.request(method, path, body,
                {**({"Content-Type": "application/json"} if body else {}), **dict(headers)})
    answer = own.getresponse()
    content = answer.read()
    if connection is None:
        own.close()
    return answer.status, {k.lower(): v for k, v in answer.getheaders()}, content
