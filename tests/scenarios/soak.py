# SPDX-License-Identifier: Apache-2.0
"""Mixed load with random faults for a long time: soak.py BUILD_FOLDER [--minutes N] [--seed N] (tests/soak)

S18 of the scenarios in tests/README.md. Clients ask, upload, delete, leave, drip and send nonsense,
while allocations and starts of threads fail. Every answer with success must be right. Now and then
all clients pause; memory, descriptors and threads of these moments must not grow.
"""
import argparse
import csv
import hashlib
import http.client
import json
import os
import random
import signal
import socket
import statistics
import sys
import threading
import time

from service import Service, bumpy, rays, tetrahedron

WORKERS = 8
PAUSE_EVERY_S = 15
KEPT_MESHES = 5
# What a failed allocation, a departure or a full house may bring.
REFUSALS = {400, 404, 408, 409, 413, 500, 503, 504, 507}


class Failure(Exception):
    """An answer that is wrong."""


class Worker(threading.Thread):
    def __init__(self, soak, number, seed):
        super().__init__(daemon=True)
        self.soak, self.service = soak, soak.service
        self.random = random.Random(seed * 1000 + number)
        self.number, self.made, self.mine = number, 0, {}
        self.connection = self.service.connect()
        self.actions = [(self.question, 60), (self.upload, 6), (self.delete, 6), (self.mesh, 4),
                        (self.leave_in_body, 4), (self.leave_before_answer, 4), (self.drip, 2),
                        (self.nonsense, 4), (self.too_large, 2), (self.fail_allocation, 4),
                        (self.fail_thread, 1), (self.reload, 1), (self.metrics, 2)]

    def run(self):
        actions, weights = zip(*self.actions)
        while not self.soak.ended.is_set():
            with self.soak.may_work:
                while self.soak.paused and not self.soak.ended.is_set():
                    self.connection.close()
                    self.soak.may_work.wait(0.5)
                self.soak.working += 1
            action = self.random.choices(actions, weights)[0]
            try:
                action()
            except Failure as failure:
                self.soak.wrong.append(f"worker {self.number}: {failure}")
            except (http.client.HTTPException, OSError) as error:
                self.connection.close()
                self.soak.count("cut: " + type(error).__name__)
            finally:
                with self.soak.may_work:
                    self.soak.working -= 1
            self.soak.count(action.__name__)

    def ask(self, method, path, body=None, headers=None):
        return self.service.ask(method, path, body, headers, self.connection)

    def check(self, status, expected, what):
        if status not in expected and status not in REFUSALS:
            raise Failure(f"{what}: status {status}")

    def question(self):
        question, right = self.random.choice(self.soak.questions)
        status, body = self.ask(*question)
        self.check(status, {200}, question[1])
        if status == 200 and hashlib.sha256(body).digest() != right:
            raise Failure(f"{question[1]}: other bytes")

    def upload(self):
        while len(self.mine) >= KEPT_MESHES:  # otherwise the daemon's memory would rightly grow
            self.delete()
        self.made += 1
        mesh = tetrahedron(self.number * 1_000_000 + self.made)
        tree = hashlib.sha256(mesh).hexdigest() + "-auto"
        status, body = self.ask("POST", "/v1/trees", mesh)
        self.check(status, {200, 201, 202}, "an upload")
        if status in (200, 201, 202):
            if json.loads(body)["id"] != tree:
                raise Failure("an upload has another id")
            self.mine[tree] = mesh

    def mesh(self):
        if self.mine:
            tree = self.random.choice(sorted(self.mine))
            status, body = self.ask("GET", f"/v1/trees/{tree}/mesh")
            if status == 404 or (status == 200 and body != self.mine[tree]):
                raise Failure(f"the mesh of an acknowledged upload: status {status}")

    def delete(self):
        if self.mine:
            tree = self.random.choice(sorted(self.mine))
            # Forgotten first: a connection that ends may have deleted it.
            del self.mine[tree]
            self.check(self.ask("DELETE", f"/v1/trees/{tree}")[0], {204}, "a deletion")

    def leave_in_body(self):
        with self.service.socket() as client:
            client.sendall(b"POST /v1/trees HTTP/1.1\r\nHost: h\r\nContent-Length: 100000\r\n\r\n" + bytes(1000))

    def leave_before_answer(self):
        tree = self.soak.service.tree
        with self.service.socket() as client:
            client.sendall(f"GET {tree}/render.png?width=800&height=600&samples=16 HTTP/1.1\r\n"
                           "Host: h\r\n\r\n".encode())
            time.sleep(self.random.uniform(0, 0.1))
            if self.random.random() < 0.5:
                client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")

    def drip(self):
        with self.service.socket() as client:
            for byte in b"GET /v1 HTTP/1.1\r\nHost: h\r\nX: " + b"y" * self.random.randrange(20):
                client.send(bytes([byte]))
                time.sleep(0.005)

    def nonsense(self):
        with self.service.socket() as client:
            client.sendall(self.random.randbytes(self.random.randrange(1, 2000)) + b"\r\n\r\n")
            client.recv(4096)

    def too_large(self):
        status, _ = self.ask("POST", "/v1/trees", b"x" * (3 << 20))
        self.connection.close()
        self.check(status, {413}, "a mesh beyond --max-upload")

    def fail_allocation(self):
        self.service.faults.set(allocations=self.random.randrange(200))

    def fail_thread(self):
        self.service.faults.set(threads=0)

    def reload(self):
        self.service.process.send_signal(signal.SIGHUP)

    def metrics(self):
        self.check(self.ask("GET", "/metrics")[0], {200}, "/metrics")


class Soak:
    def __init__(self, folder, minutes, seed):
        self.csv, self.svg = os.path.join(folder, "soak.csv"), os.path.join(folder, "soak.svg")
        self.minutes, self.seed = minutes, seed
        self.service = Service(os.path.join(folder, "bin/kdrayd"), "--threads", "2", "--memory-limit", "128MiB",
                               "--max-upload", "2MiB", "--max-connections", "64",
                               preload=find_library(folder))
        self.ended, self.may_work = threading.Event(), threading.Condition()
        self.paused, self.working = False, 0
        self.wrong, self.counts, self.quiet = [], {}, []

    def count(self, what):
        self.counts[what] = self.counts.get(what, 0) + 1

    def prepare(self):
        tree = self.service.upload(bumpy(30))
        asked = [("POST", tree + "/rays/closest", rays(64, seed)) for seed in range(20)]
        asked += [("POST", tree + "/rays/closest", rays(5000, 99)), ("POST", tree + "/rays/count", rays(100, 7)),
                  ("GET", tree + "/render.npy?mode=depth&width=200&height=150"),
                  ("GET", tree + "/render.png?width=100&height=80"), ("GET", tree + "/cells?depth=4"),
                  ("GET", tree + "/mesh")]
        self.questions = [(question, hashlib.sha256(self.service.ask(*question)[1]).digest())
                          for question in asked]

    def pause(self):
        """Lets all clients finish, and notes the daemon's figures."""
        with self.may_work:
            self.paused = True
        deadline = time.monotonic() + 30
        while self.working and time.monotonic() < deadline:
            time.sleep(0.01)
        self.service.faults.set()
        self.delete_lost_trees()
        time.sleep(1)  # real time: connections that were left linger for a moment
        self.quiet.append((time.monotonic() - self.start, *self.service.process_figures()))
        with self.may_work:
            self.paused = False
            self.may_work.notify_all()

    def delete_lost_trees(self):
        """Trees whose uploads or deletions were cut: no worker knows them, and they would add up."""
        known = {self.service.tree.rpartition("/")[2]}.union(*(worker.mine for worker in self.workers))
        trees, page = [], "/v1/trees?limit=1000"
        while page:
            listed = json.loads(self.service.ask("GET", page)[1])
            trees += [tree["id"] for tree in listed["trees"]]
            page = listed["next"] and f"/v1/trees?limit=1000&after={listed['next']}"
        for tree in trees:
            if tree not in known:
                self.service.ask("DELETE", "/v1/trees/" + tree)
                self.count("deleted trees that were lost")

    def run(self):
        self.prepare()
        self.start = time.monotonic()
        self.workers = [Worker(self, number, self.seed) for number in range(WORKERS)]
        for worker in self.workers:
            worker.start()
        samples, next_pause = [], PAUSE_EVERY_S
        while (now := time.monotonic() - self.start) < self.minutes * 60 and self.service.process.poll() is None:
            if now >= next_pause:
                self.pause()
                next_pause = now + PAUSE_EVERY_S
            samples.append((now, *self.service.process_figures()))
            time.sleep(1)
        if self.service.process.poll() is None:
            self.pause()
        self.ended.set()
        for worker in self.workers:
            worker.join(30)
        code = self.service.stop() if self.service.process.poll() is None else self.service.process.returncode
        if code != 0:
            self.wrong.append(f"the daemon ended with {code}")
        self.write(samples)
        self.service.close()
        return self.report()

    def growth(self, column):
        """The median of the last third of the quiet moments, as a multiple of that of the second third."""
        values = [moment[column] for moment in self.quiet]
        third = max(1, len(values) // 3)
        return statistics.median(values[-third:]) / statistics.median(values[third:2 * third] or values)

    def report(self):
        print("done:", ", ".join(f"{name} {count}" for name, count in sorted(self.counts.items())))
        for column, name in enumerate(("MiB", "descriptors", "threads"), 1):
            values = [moment[column] for moment in self.quiet]
            print(f"{name} in quiet moments: first {values[0]:.0f}, last {values[-1]:.0f}, "
                  f"last third / second third {self.growth(column):.3f}")
            # One MiB, descriptor or thread is no growth; in the first minutes memory still settles.
            most = 1.01 if self.minutes >= 10 else 1.05
            if self.growth(column) > most and values[-1] > values[len(values) // 2] + 1:
                self.wrong.append(f"{name} grew: {values}")
        for wrong in self.wrong[:20]:
            print("wrong:", wrong)
        print(f"seed {self.seed}: {len(self.wrong)} wrong")
        return 1 if self.wrong else 0

    def write(self, samples):
        with open(self.csv, "w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file)
            rows.writerow(["seconds", "mib", "descriptors", "threads", "quiet"])
            rows.writerows([*(f"{value:.1f}" for value in row), 0] for row in samples)
            rows.writerows([*(f"{value:.1f}" for value in row), 1] for row in self.quiet)
        with open(self.svg, "w", encoding="utf-8") as file:
            file.write(curves(samples, self.quiet))


def curves(samples, quiet):
    """An SVG of memory, descriptors and threads over time, with dots at the quiet moments."""
    width, height, left = 900, 160, 60
    end = max(row[0] for row in samples + quiet)
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width + left + 20}" height="{3 * (height + 40)}" '
             'font-family="sans-serif" font-size="12"><rect width="100%" height="100%" fill="white"/>']
    for column, (name, color) in enumerate((("MiB resident", "#1f77b4"), ("descriptors", "#d62728"),
                                            ("threads", "#2ca02c")), 1):
        top = (column - 1) * (height + 40) + 25
        most = max(row[column] for row in samples + quiet) * 1.1 or 1

        def at(row, column=column, top=top, most=most):
            return f"{left + width * row[0] / end:.1f},{top + height * (1 - row[column] / most):.1f}"
        parts.append(f'<text x="{left}" y="{top - 8}">{name}, over {end / 60:.1f} minutes; '
                     'dots: while all clients pause</text>'
                     f'<text x="5" y="{top + 10}">{most:.0f}</text><text x="5" y="{top + height}">0</text>'
                     f'<path d="M{left},{top} V{top + height} H{left + width}" stroke="#888" fill="none"/>'
                     f'<polyline points="{" ".join(map(at, samples))}" fill="none" stroke="{color}"/>')
        for row in quiet:
            x, y = at(row).split(",")
            parts.append(f'<circle cx="{x}" cy="{y}" r="3" fill="{color}"/>')
    return "\n".join(parts) + "</svg>\n"


def find_library(folder):
    for root, _, names in os.walk(folder):
        for name in names:
            if name == "libfailing_calls.so":
                return os.path.join(root, name)
    raise FileNotFoundError("libfailing_calls.so")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("build")
    parser.add_argument("--minutes", type=float, default=20)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    sys.exit(Soak(arguments.build, arguments.minutes, arguments.seed).run())
