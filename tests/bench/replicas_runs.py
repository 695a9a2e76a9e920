# SPDX-License-Identifier: Apache-2.0
"""Measures replicas behind HAProxy: replicas_runs.py BIN RESULTS SHARE SECONDS ROUNDS

- Throughput of 1, 2, 4 and 8 replicas, each with --threads 1 and a fixed share of a processor.
- One of three replicas killed under load: times at the client, and what Prometheus recorded.
- The first query of a cold replica, with a tree on its disk.
Writes one JSON file, of which replicas_report.py makes tables and plots.
"""
import io
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent / "clients"), str(HERE.parent.parent / "clients/python")]
import closed_loop  # noqa: E402
import cold_start  # noqa: E402
import kdray  # noqa: E402
import replica_loss  # noqa: E402
from cpu_share import CpuShares, children, name_of  # noqa: E402
from replicas import Replicas, request  # noqa: E402

BIN, RESULTS = sys.argv[1:3]
SHARE, SECONDS, ROUNDS = float(sys.argv[3]) / 100, float(sys.argv[4]), int(sys.argv[5])
NUMBERS = (1, 2, 4, 8)
MESHES = 6  # of each replica, on average
RAYS = 2000
WARM_S = 1.5


def rays_body(random):
    """A batch of incoherent rays through the teapot, as .npy of <f4."""
    origins = random.normal(size=(RAYS, 3))
    origins *= 9 / np.linalg.norm(origins, axis=1, keepdims=True)
    rows = np.hstack([origins, random.normal(scale=1.5, size=(RAYS, 3)) - origins])
    content = io.BytesIO()
    np.save(content, rows.astype("<f4"))
    return content.getvalue()


def kinds(random):
    """(name, request of a tree)"""
    body = rays_body(random)
    picture = "width=96&height=72&mode=ambient-occlusion&samples=4"
    return {
        "query": lambda tree: closed_loop.http_request(
            "POST", f"/v1/trees/{tree}/rays/closest?fields=t,triangle", body),
        "picture": lambda tree: closed_loop.http_request(
            "GET", f"/v1/trees/{tree}/render.png?{picture}"),
    }


def upload_all(url, count):
    """Trees of meshes that differ in a comment, so each has its own place on the ring."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "teapot.obj")
        subprocess.run([f"{BIN}/kdray", "-q", "sample", "teapot", "-o", path], check=True)
        teapot = path.read_bytes()
    with kdray.Client(url) as client:
        return [client.upload(teapot + b"# copy %d\n" % i).id for i in range(count)]


def measure(number, requests):
    """Rows of one number of replicas: each kind's rate, and the processor time behind it."""
    rows = []
    with Replicas(f"{BIN}/kdrayd", number) as replicas, CpuShares() as shares:
        trees = upload_all(replicas.url, MESHES * number)
        homes = {tree: request(replicas.port, "GET", f"/v1/trees/{tree}")[1]["kdray-replica"]
                 for tree in trees}
        daemons = list(replicas.processes.values())
        proxy, = [p for p in children(replicas.process_id) if name_of(p) == "haproxy"]
        for process in daemons:
            shares.put(process, SHARE)
        shares.put(proxy)
        shares.put(os.getpid())
        for kind, of_tree in requests.items():
            clients = [closed_loop.Client(replicas.port, of_tree(tree)) for tree in trees]
            closed_loop.run(clients, WARM_S)
            measured = (*daemons, proxy, os.getpid())
            before = [shares.seconds(p) for p in measured]
            start = time.time()
            answers = closed_loop.run(clients, SECONDS)
            took = time.time() - start
            used = [shares.seconds(p) - b for p, b in zip(measured, before)]
            failed = sum(status != 200 for _, _, status in answers)
            if failed:
                sys.exit(f"tests/bench/replicas: {failed} of {len(answers)} requests failed")
            rows.append({
                "replicas": number, "kind": kind, "rate": len(answers) / took,
                "share_used": [u / took for u in used[:number]],
                "proxy_share": used[-2] / took, "client_share": used[-1] / took,
                "median_ms": 1000 * float(np.median([t for _, t, _ in answers])),
                "homes": sorted(list(homes.values()).count(r) for r in replicas.addresses),
                "load": os.getloadavg()[0], "cgroup": shares.version})
            print(f"{number} replicas, {kind}: {rows[-1]['rate']:.1f}/s, load "
                  f"{rows[-1]['load']:.1f}", file=sys.stderr, flush=True)
    return rows


def main():
    requests = kinds(np.random.default_rng(1))
    throughput = [row for _ in range(ROUNDS) for number in NUMBERS
                  for row in measure(number, requests)]
    results = {"share": SHARE, "seconds": SECONDS, "rounds": ROUNDS, "rays": RAYS,
               "meshes": MESHES, "throughput": throughput,
               "loss": replica_loss.measure(BIN), "cold": cold_start.measure(BIN)}
    Path(RESULTS).write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # so that groups are removed
    main()
