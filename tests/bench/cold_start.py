# SPDX-License-Identifier: Apache-2.0
"""The first query of a daemon that has just started, with a large tree on its disk."""
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

import numpy as np

import kdray

SIDE = 500  # of the grid of points: 2 x 499 x 499 triangles
ROUNDS = 5
RAY = json.dumps({"rays": [[0.31, 0.47, 9, 0, 0, -1]]}).encode()


def terrain():
    """A surface of hills over a grid."""
    x, y = np.meshgrid(np.linspace(0, 1, SIDE), np.linspace(0, 1, SIDE))
    z = 0.1 * np.sin(13 * x) * np.cos(11 * y) + 0.02 * np.sin(170 * x + 90 * y)
    corner = (np.arange(SIDE - 1)[:, None] * SIDE + np.arange(SIDE - 1)).ravel()
    faces = np.vstack([np.stack([corner, corner + 1, corner + SIDE], 1),
                       np.stack([corner + 1, corner + SIDE + 1, corner + SIDE], 1)])
    return np.stack([x.ravel(), y.ravel(), z.ravel()], 1), faces


def ask(url, tree):
    start = time.perf_counter()
    urllib.request.urlopen(urllib.request.Request(
        f"{url}/v1/trees/{tree}/rays/closest", RAY, {"Content-Type": "application/json"})).read()
    return 1000 * (time.perf_counter() - start)


def derived_files(folder):
    """The two files that a load reads, parsed mesh and tree; they are written after the build."""
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        found = [path for part in ("parsed", "trees") for path in Path(folder, part).glob("[!.]*")]
        if len(found) == 2:
            return found
        time.sleep(0.1)
    sys.exit("tests/bench/replicas: the tree was not written")


def drop_from_page_cache(files):
    for path in files:
        with open(path, "rb") as file:
            os.fsync(file.fileno())
            os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def read_and_hash(files):
    """Milliseconds to read the files and hash them, which a load does too."""
    start = time.perf_counter()
    for path in files:
        hashlib.sha256(path.read_bytes()).digest()
    return 1000 * (time.perf_counter() - start)


def start(kdrayd, folder):
    begun = time.perf_counter()
    process = subprocess.Popen(
        [kdrayd, "--port", "0", "--data-dir", folder, "--threads", "1"], stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL, text=True)
    url = re.search(r"http://\S+", process.stdout.readline())[0]
    return process, url, 1000 * (time.perf_counter() - begun)


def measure(bin_folder):
    kdrayd = f"{bin_folder}/kdrayd"
    rows = []
    with tempfile.TemporaryDirectory(prefix="kdray-cold-") as folder:
        process, url, _ = start(kdrayd, folder)
        try:
            begun = time.perf_counter()
            with kdray.Client(url) as client:
                tree = client.upload(terrain()).id
            upload_ms = 1000 * (time.perf_counter() - begun)
            files = derived_files(folder)
        finally:
            process.terminate()
            process.wait()
        size = sum(path.stat().st_size for path in files)
        for cached in [True, False] * ROUNDS:
            read_and_hash(files)  # fills the page cache
            read_ms = read_and_hash(files)
            if not cached:
                drop_from_page_cache(files)
                read_ms = read_and_hash(files)
                drop_from_page_cache(files)
            process, url, start_ms = start(kdrayd, folder)
            try:
                first_ms = ask(url, tree)
                later_ms = min(ask(url, tree) for _ in range(20))
                metrics = urllib.request.urlopen(f"{url}/metrics").read().decode()
            finally:
                process.terminate()
                process.wait()
            assert "\nkdray_tree_loads_total 1\n" in metrics, "the tree was not loaded"
            assert "\nkdray_tree_builds_total 0\n" in metrics, "the tree was built"
            rows.append({"cached": cached, "start_ms": start_ms, "first_ms": first_ms,
                         "later_ms": later_ms, "read_and_hash_ms": read_ms})
            print(f"cold start: {rows[-1]}", file=sys.stderr, flush=True)
    return {"triangles": 2 * (SIDE - 1) ** 2, "bytes": size,
            "upload_and_build_ms": upload_ms, "rows": rows, "load": os.getloadavg()[0]}
