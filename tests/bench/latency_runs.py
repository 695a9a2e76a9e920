# SPDX-License-Identifier: Apache-2.0
"""Runs wrk against kdrayd and nginx in turn: latency_runs.py BIN SECONDS

Prints a row for each measurement: server, connections, load (full, or half of what 8 connections reach), round,
requests a second, and latencies in microseconds.
"""
import csv
import json
import os
import random
import re
import subprocess
import sys
import tempfile
import time
import urllib.request

BIN, SECONDS = sys.argv[1], sys.argv[2]
ROUNDS = 5
RAYS = 64

# wrk's own output has no machine-readable form. A think time of 0 sends the next request at once.
SCRIPT = """
wrk.method = os.getenv("BENCH_METHOD")
wrk.headers["Content-Type"] = "application/json"
local file = io.open(os.getenv("BENCH_BODY"), "rb")
if wrk.method == "POST" then wrk.body = file:read("*a") end
file:close()
local think = tonumber(os.getenv("BENCH_THINK_MS"))
if think > 0 then
  function delay() return math.random(0, 2 * think) end
end
function done(summary, latency, requests)
  local failed = summary.errors.connect + summary.errors.read + summary.errors.write
               + summary.errors.status + summary.errors.timeout
  print(string.format("RESULT %f %f %f %d", summary.requests / summary.duration * 1e6,
                      latency:percentile(50), latency:percentile(99), failed))
end
"""

NGINX = """
worker_processes auto;
daemon off;
pid {folder}/nginx.pid;
error_log {folder}/error.log;
events {{ worker_connections 1024; }}
http {{
  access_log {folder}/access.log;
  client_body_temp_path {folder}/body;
  proxy_temp_path {folder}/proxy;
  fastcgi_temp_path {folder}/fastcgi;
  uwsgi_temp_path {folder}/uwsgi;
  scgi_temp_path {folder}/scgi;
  keepalive_requests 100000000;
  sendfile on;
  tcp_nodelay on;
  server {{ listen 127.0.0.1:{port}; root {folder}/files; }}
}}
"""


def free_port():
    import socket
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


def wrk(folder, url, method, connections, think_ms=0):
    """(requests a second, p50, p99 in microseconds)"""
    environment = {**os.environ, "BENCH_METHOD": method, "BENCH_BODY": folder + "/rays.json",
                   "BENCH_THINK_MS": str(think_ms)}
    text = subprocess.run(["wrk", "-t1", f"-c{connections}", f"-d{SECONDS}s", "-s", folder + "/wrk.lua", url],
                          check=True, capture_output=True, text=True, env=environment).stdout
    per_second, p50, p99, failed = map(float, re.search(r"RESULT (.*)", text)[1].split())
    if failed:
        sys.exit(f"latency: {failed:.0f} requests to {url} failed")
    return per_second, p50, p99


def main():
    folder = tempfile.mkdtemp(prefix="kdray-latency-")
    environment = {name: value for name, value in os.environ.items() if not name.startswith("KDRAY_")}
    daemon = subprocess.Popen([BIN + "/kdrayd", "--port", "0", "--data-dir", folder + "/data"], text=True,
                              stdout=subprocess.PIPE, stderr=open(folder + "/log", "w"), env=environment)
    nginx = None
    try:
        kdray = re.search(r"http://\S+", daemon.stdout.readline())[0]
        mesh = folder + "/teapot.obj"
        subprocess.run([BIN + "/kdray", "-q", "sample", "teapot", "-o", mesh], check=True)
        with open(mesh, "rb") as file:
            tree = json.load(urllib.request.urlopen(kdray + "/v1/trees", file.read()))["id"]
        rays = f"{kdray}/v1/trees/{tree}/rays/closest"
        numbers = random.Random(1)
        body = json.dumps({"rays": [[round(numbers.uniform(-9, 9), 3) for _ in range(6)] for _ in range(RAYS)]})
        answer = urllib.request.urlopen(rays, body.encode()).read()
        with open(folder + "/rays.json", "w") as file:
            file.write(body)
        os.makedirs(folder + "/files")
        with open(folder + "/files/answer", "wb") as file:
            file.write(answer)
        with open(folder + "/wrk.lua", "w") as file:
            file.write(SCRIPT)
        port = free_port()
        with open(folder + "/nginx.conf", "w") as file:
            file.write(NGINX.format(folder=folder, port=port))
        # Its workers must read what root has written.
        subprocess.run(["chmod", "-R", "a+rX", folder], check=True)
        nginx = subprocess.Popen(["nginx", "-c", folder + "/nginx.conf"])
        time.sleep(1)
        servers = {"kdrayd": (rays, "POST"), "nginx": (f"http://127.0.0.1:{port}/answer", "GET")}
        for url, method in servers.values():
            wrk(folder, url, method, 8)  # warm
        rows = csv.writer(sys.stdout)
        rows.writerow(["server", "connections", "load", "round", "per_second", "p50_us", "p99_us", "request_bytes",
                       "answer_bytes"])
        for number in range(ROUNDS):
            for server, (url, method) in servers.items():
                for connections in (1, 8, 64):
                    result = wrk(folder, url, method, connections)
                    rows.writerow([server, connections, "full", number, *result, len(body), len(answer)])
                    if connections == 8:
                        most = result[0]
                # As many connections as make the mean think time 8 ms at half of that rate.
                thinking = max(1, round(most / 2 * 0.008))
                rows.writerow([server, thinking, "half", number, *wrk(folder, url, method, thinking, 8),
                               len(body), len(answer)])
                sys.stdout.flush()
    finally:
        for process in (nginx, daemon):
            if process is not None:
                process.terminate()
                process.wait()
        subprocess.run(["rm", "-rf", folder])


if __name__ == "__main__":
    main()
