# SPDX-License-Identifier: Apache-2.0
"""Each allocation, and each start of a thread, fails once: allocation_test.py KDRAYD LIBRARY [TEST]

S14 and S15 of the scenarios in tests/README.md. A failure may cost the request that meets it, by an
error or by the end of its connection. Nothing ends the daemon or blocks it, and afterwards every
answer is right.
"""
import http.client
import json
import os
import sys
import time
import unittest

from service import Service, bumpy, rays, tetrahedron

KDRAYD, LIBRARY = sys.argv[1:3]
# Sweeps take each of the first allocations; later ones, which repeat themselves, in growing steps.
EVERY = int(os.environ.get("KDRAY_ALLOCATIONS", "60"))

POINTS = json.dumps({"points": [[0.1, 0.2, 0.3], [2, 2, 2]]}).encode()
POINT_SETS = json.dumps({"from": [[0, 0, 5], [5, 0, 0]], "to": [[0, 0, -5]]}).encode()
NPY = (b"\x93NUMPY\x01\x00" + (118).to_bytes(2, "little")
       + b"{'descr': '<f4', 'fortran_order': False, 'shape': (2, 6), }".ljust(117) + b"\n" + bytes(48))


class AllocationTest(unittest.TestCase):
    def start(self, *options):
        service = Service(KDRAYD, "--threads", "2", *options, preload=LIBRARY)
        self.addCleanup(service.close)
        service.upload(bumpy(8))
        return service

    def ask(self, service, method, path, body=None, headers=None):
        """(status, body), or None if the connection ended."""
        connection = service.connect(timeout=20)
        try:
            return service.ask(method, path, body, headers, connection)
        except (http.client.HTTPException, ConnectionError):
            return None
        finally:
            connection.close()

    def check_lives(self, service, what):
        self.assertIsNone(service.process.poll(), what)
        answer = self.ask(service, "GET", "/healthz")
        self.assertEqual(answer and answer[0], 200, what)

    def sweep(self, service, kind, work, what):
        """Calls work(n) with each call of the kind failing once, until it makes fewer. The number of calls."""
        n = number = 0
        while True:
            service.faults.set(**{kind: n})
            work(number)
            # Work in the background may still come to it.
            deadline = time.monotonic() + 0.05
            index = 0 if kind == "allocations" else 1
            while service.faults.get()[index] >= 0 and time.monotonic() < deadline:
                time.sleep(0.002)
            reached = service.faults.get()[index] < 0
            service.faults.set()
            self.check_lives(service, f"{what}: {kind} {n}")
            if not reached:
                return n
            n += 1 if n < EVERY else n // 4
            number += 1

    def operations(self, service):
        tree = service.tree
        other = service.ask("POST", "/v1/trees", tetrahedron(1))
        measured = "/v1/trees/" + json.loads(other[1])["id"]
        return {
            "health": ("GET", "/healthz"), "metrics": ("GET", "/metrics"), "docs": ("GET", "/docs"),
            "contract": ("GET", "/openapi.json"), "page": ("GET", "/"), "capabilities": ("GET", "/v1"),
            "list": ("GET", "/v1/trees"), "describe": ("GET", tree), "unknown": ("GET", "/none"),
            "mesh": ("GET", tree + "/mesh"), "cells": ("GET", tree + "/cells?depth=2"),
            "closest": ("POST", tree + "/rays/closest", rays(5)),
            "closest npy": ("POST", tree + "/rays/closest", NPY),
            "all": ("POST", tree + "/rays/all", rays(5)), "count": ("POST", tree + "/rays/count", rays(5)),
            "points": ("POST", tree + "/points/closest", POINTS),
            "distances": ("POST", tree + "/points/signed-distance", POINTS),
            "visibility": ("POST", tree + "/visibility", POINT_SETS),
            "picture": ("GET", tree + "/render.png?width=40&height=30"),
            "array": ("GET", tree + "/render.npy?mode=depth&width=40&height=30"),
            "measured": ("GET", measured + "/tradeoff"),
        }

    def test_S14_no_failed_allocation_of_a_request_ends_the_daemon(self):
        service = self.start()
        operations = self.operations(service)
        skipped = ("metrics", "list", "describe")  # they tell of times
        before = {name: service.ask(*operations[name]) for name in operations if name not in skipped}
        # Problems have the id of their request.
        before = {name: answer for name, answer in before.items() if answer[0] == 200}
        points = {}
        for name, operation in operations.items():
            points[name] = self.sweep(service, "allocations",
                                      lambda _, operation=operation: self.ask(service, *operation), name)
        print("allocations of each request:", points)
        for name, answer in before.items():
            self.assertEqual(service.ask(*operations[name]), answer, name)
        self.assertEqual(service.stop(), 0)

    def test_S14_no_failed_allocation_of_an_upload_a_build_or_a_deletion_ends_the_daemon(self):
        service = self.start()

        def build(number):
            answer = self.ask(service, "POST", "/v1/trees", tetrahedron(number + 10))
            self.assertTrue(answer is None or answer[0] in (201, 500, 503), answer)

        def build_again(number):
            self.ask(service, "POST", f"/v1/trees?build=bvh&mesh={self.mesh_of(service)}")
            return self.ask(service, "DELETE", f"/v1/trees/{self.mesh_of(service)}-bvh")

        def measure(_):
            self.ask(service, "POST", service.tree + "/tradeoff?wait_ms=1")
            self.ask(service, "DELETE", service.tree + "/tradeoff")

        points = {"upload": self.sweep(service, "allocations", build, "upload"),
                  "another build, deletion": self.sweep(service, "allocations", build_again, "build"),
                  "measuring": self.sweep(service, "allocations", measure, "measuring")}
        print("allocations:", points)
        for number in range(20):
            self.assertIn(service.ask("POST", "/v1/trees", tetrahedron(number + 10))[0], (200, 201))
        self.assertEqual(service.stop(), 0)

    @staticmethod
    def mesh_of(service):
        return service.tree.rsplit("/", 1)[1].split("-")[0]

    def test_S15_no_refused_thread_ends_the_daemon(self):
        service = self.start()
        batch = rays(20_000)
        expected = service.ask("POST", service.tree + "/rays/closest", batch)

        def work(number):
            self.ask(service, "GET", "/v1")
            self.ask(service, "POST", service.tree + "/rays/closest", batch)
            self.ask(service, "POST", "/v1/trees", bumpy(9 + number))
            self.ask(service, "GET", service.tree + "/render.png?width=300&height=300")

        print("threads:", self.sweep(service, "threads", work, "requests"))
        self.assertEqual(service.ask("POST", service.tree + "/rays/closest", batch), expected)
        self.assertEqual(service.stop(), 0)

    def test_S14_S15_a_start_that_fails_ends_at_once_and_the_others_serve(self):
        for kind in ("threads", "allocations"):
            n, codes = 0, set()
            while True:
                try:
                    service = Failing(kind, n)
                except RuntimeError as error:
                    codes.add(str(error))
                    n += 1 if n < EVERY else n // 4
                    continue
                reached = service.faults.get()[0 if kind == "allocations" else 1] < 0
                service.faults.set()
                self.check_lives(service, f"start: {kind} {n}")
                service.close()
                if not reached:
                    break
                n += 1 if n < EVERY else n // 4
            print(f"starts with a failure of {kind}: {n}")
            # -6: before main(), while the static objects of libraries are made.
            self.assertLessEqual(codes, {"exit code 1", "exit code -6"})


class Failing(Service):
    """A daemon whose n-th call of a kind fails from its first instruction on."""

    def __init__(self, kind, n):
        self.kind, self.n = kind, n
        super().__init__(KDRAYD, "--threads", "2", preload=LIBRARY)

    def prepare(self):
        self.faults.set(**{self.kind: self.n})

    def fail_to_start(self, line):
        code = self.process.wait(30)
        self.close()
        raise RuntimeError(f"exit code {code}")


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[3:]])
