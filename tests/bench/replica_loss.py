# SPDX-License-Identifier: Apache-2.0
"""One of three replicas killed under load, seen by the clients and by Prometheus."""
import json
import os
import signal
import time

import numpy as np

import closed_loop
import kdray
from prometheus import Prometheus, filled
from replicas import Replicas, mesh, request

CLIENTS = 12
PAUSE_S = 0.1  # of each client between an answer and its next request, so nothing is at its limit
BEFORE_S, AFTER_S = 10.0, 20.0
WARM_S = 5.0  # series begin, and fill the range of the queries
MESHES = 12
WINDOW_S = 0.5
RANGE = "3s"
QUERIES = {
    "requests": 'sum by (replica) (rate(kdray_http_requests_total{route=~"/v1/.*"}[RANGE]))',
    "in_use": 'haproxy_backend_active_servers{proxy="kdray"}',
    "moved": 'sum(rate(haproxy_backend_redispatch_warnings_total{proxy="kdray"}[RANGE]))',
    "p99": 'histogram_quantile(0.99, sum by (class, le) (rate('
           'kdray_http_request_duration_seconds_bucket{class="query"}[RANGE])))',
}


def p99_ms(seconds):
    return 1000 * float(np.percentile(seconds, 99)) if len(seconds) else None


def measure(bin_folder):
    with Replicas(f"{bin_folder}/kdrayd", 3) as replicas, Prometheus(replicas) as prometheus:
        for url in replicas.addresses.values():  # every tree is on every replica
            with kdray.Client(url) as client:
                trees = [client.upload(mesh(number)).id for number in range(MESHES)]
        body = json.dumps({"rays": [[0.1 * i, 0.2, 9, 0, 0, -1] for i in range(9)]}).encode()
        clients = [closed_loop.Client(replicas.port, closed_loop.http_request(
            "POST", f"/v1/trees/{trees[i % MESHES]}/rays/closest", body, "application/json"))
            for i in range(CLIENTS)]
        _, headers, _ = request(replicas.port, "GET", f"/v1/trees/{trees[0]}")
        victim = headers["kdray-replica"]
        closed_loop.run(clients, WARM_S, PAUSE_S)
        start = time.time()
        killed = []

        def during(now):
            if not killed and now > start + BEFORE_S:
                killed.append(time.time())
                replicas.stop(victim, signal.SIGKILL)

        answers = closed_loop.run(clients, BEFORE_S + AFTER_S, PAUSE_S, during)
        end = time.time()
        prometheus.wait_for_scrape()
        recorded = {name: [[labels, [[t - killed[0], v] for t, v in values]]
                           for labels, values in prometheus.query_range(
                               filled(query.replace("RANGE", RANGE), RANGE), start, end, 0.5)]
                    for name, query in QUERIES.items()}
    times = np.array([(begun - killed[0], took) for begun, took, _ in answers])
    windows = []
    for left in np.arange(-BEFORE_S, AFTER_S, WINDOW_S):
        inside = times[(times[:, 0] >= left) & (times[:, 0] < left + WINDOW_S), 1]
        windows.append([left + WINDOW_S / 2, p99_ms(inside), len(inside)])
    return {"victim": victim, "requests": len(answers),
            "failed": sum(status != 200 for _, _, status in answers),
            "p99_before_ms": p99_ms(times[times[:, 0] < 0, 1]),
            "p99_first_2s_ms": p99_ms(times[(times[:, 0] >= 0) & (times[:, 0] < 2), 1]),
            "p99_after_2s_ms": p99_ms(times[times[:, 0] >= 2, 1]),
            "worst_ms": 1000 * float(times[:, 1].max()), "windows": windows,
            "recorded": recorded, "load": os.getloadavg()[0]}
