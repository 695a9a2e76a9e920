#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A client of the standard library that pauses between two requests of a connection until the server has closed it.

Usage: keep_alive_client.py URL PAUSE_S. For each kind of request before the pause, the next request ends at once:
answered, or refused because the connection is closed, and answered on a new one. Prints what did not, and fails.
"""
import http.client
import json
import struct
import sys
import time
import urllib.parse

PATIENCE_S = 2
RAYS = b'{"rays":[[0.2,0.2,1,0,0,-1]]}'
MESH = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def npy_rays():
    header = b"{'descr': '<f4', 'fortran_order': False, 'shape': (1, 6), }"
    header += b" " * (-(len(header) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + struct.pack("<6f", 0.2, 0.2, 1, 0, 0, -1)


def connect(url):
    return http.client.HTTPConnection(url.hostname, url.port, timeout=PATIENCE_S)


def ask(connection, method, path, body=None):
    connection.request(method, path, body)
    answer = connection.getresponse()
    return answer.status, answer.read()


def kinds(tree):
    yield "closest", "POST", tree + "/rays/closest", RAYS, 200
    yield "closest, npy", "POST", tree + "/rays/closest", npy_rays(), 200
    yield "any", "POST", tree + "/rays/any", RAYS, 200
    yield "render.png", "GET", tree + "/render.png?width=32&height=32", None, 200
    yield "render.npy", "GET", tree + "/render.npy?width=32&height=32&mode=depth", None, 200
    yield "render.png, POST", "POST", tree + "/render.png", b'{"width":32,"height":32}', 200
    yield "cells", "GET", tree + "/cells?depth=1", None, 200
    yield "describe", "GET", tree, None, 200
    yield "describe, waiting", "GET", tree + "?wait_ms=1000", None, 200
    yield "mesh", "GET", tree + "/mesh", None, 200
    yield "upload", "POST", "/v1/trees", MESH + b"# another\n", 201
    yield "upload, known", "POST", "/v1/trees", MESH, 200
    yield "upload, not waiting", "POST", "/v1/trees?wait_ms=0", MESH + b"# one more\n", (200, 201, 202)
    yield "tradeoff, begun", "POST", tree + "/tradeoff?wait_ms=1", None, (200, 202)
    yield "tradeoff", "GET", tree + "/tradeoff?wait_ms=1", None, (200, 202)
    yield "list", "GET", "/v1/trees", None, 200
    yield "capabilities", "GET", "/v1", None, 200
    yield "contract", "GET", "/openapi.json", None, 200
    yield "contract's page", "GET", "/docs", None, 200
    yield "page", "GET", "/", None, 200
    yield "health", "GET", "/healthz", None, 200
    yield "readiness", "GET", "/readyz", None, 200
    yield "tradeoff, deleted", "DELETE", tree + "/tradeoff", None, 204
    yield "tree, deleted", "DELETE", tree, None, 204


def fault_of(url, pause_s, kind):
    name, method, path, body, expected = kind
    connection = connect(url)
    status, _ = ask(connection, method, path, body)
    if status not in (expected if isinstance(expected, tuple) else (expected,)):
        return f"{name}: status {status}"
    time.sleep(pause_s)
    start = time.monotonic()
    try:
        status, _ = ask(connection, "GET", "/healthz")
    except (http.client.RemoteDisconnected, ConnectionError):
        connection.close()
        status, _ = ask(connection, "GET", "/healthz")
    except OSError as error:
        return f"{name}: the next request: {error} after {time.monotonic() - start:.1f} s"
    return None if status == 200 else f"{name}: the next request: status {status}"


def main():
    url = urllib.parse.urlparse(sys.argv[1])
    pause_s = float(sys.argv[2])
    status, answer = ask(connect(url), "POST", "/v1/trees", MESH)
    if status not in (200, 201):
        sys.exit(f"the upload was answered with {status}")
    tree = "/v1/trees/" + json.loads(answer)["id"]
    # One after the other: requests under way on other connections have hidden the fault.
    faults = [fault for kind in kinds(tree) if (fault := fault_of(url, pause_s, kind))]
    print("\n".join(faults))
    sys.exit(1 if faults else 0)


main()
