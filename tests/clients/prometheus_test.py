# SPDX-License-Identifier: Apache-2.0
"""The dashboard, the rules and the settings of server/deploy/prometheus, in Debian's Prometheus over
three replicas that share a store: prometheus_test.py KDRAYD KDRAY

The test sends requests of every kind and counts them itself; the store counts those it gets. Exits with 77 (skipped) if HAProxy or
Prometheus is not installed.
"""
import collections
import json
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

import yaml

import fake_s3
from prometheus import DEPLOY, PROMETHEUS, PROMTOOL, Prometheus, filled, queries
from replicas import HAPROXY, ROOT, Replicas, mesh, request

sys.path.insert(0, str(ROOT / "clients/python"))
import kdray  # noqa: E402

KDRAYD, KDRAY = sys.argv[1:3]
MEMORY_BYTES = 1 << 30
UNKNOWN = "0" * 64 + "-auto"
RAY = [0.1, 0, 9, 0, 0, -1]
SIDE = 16  # of pictures, in pixels
QUIET_S = 2.5


class Counts(collections.Counter):
    """What was sent, by kind; each request through HAProxy, never repeated by the client."""

    def __init__(self, port):
        super().__init__()
        self._port = port

    def send(self, route, tree, parameters="", rows=None, times=1, method="POST"):
        """Requests of a route's template. `rows` are (field, list)."""
        body = None if rows is None else json.dumps(rows).encode()
        path = route.replace("{id}", tree) + parameters
        for _ in range(times):
            status, headers, _ = request(self._port, method, path, body)
            tries = 3 if status == 404 else 1  # HAProxy asks two replicas, one of them twice
            self["request", route, str(status)] += tries
            self["proxy", f"{status // 100}xx"] += 1
            self["repeated"] += tries - 1
            self["all"] += tries
            self["5xx"] += status >= 500
            self["bytes"] += tries * len(body or b"")
            if tries == 1:
                self["replica", headers["kdray-replica"]] += 1

    def send_all(self, trees, times):
        """Every kind of request, to each tree."""
        rays = "/v1/trees/{id}/rays/"
        for number, tree in enumerate(trees):
            for query in ("closest", "any", "count", "all"):
                rows = number + 2
                self.send(rays + query, tree, rows={"rays": [RAY] * rows}, times=times)
                self["rays", query] += rows * times
            for query in ("closest", "signed-distance", "inside"):
                self.send(f"/v1/trees/{{id}}/points/{query}", tree, rows={"points": [RAY[:3]] * 5},
                          times=times)
                self["points", query] += 5 * times
            self.send("/v1/trees/{id}/visibility", tree,
                      rows={"from": [RAY[:3]] * 2, "to": [[0, 0, -9]] * 3}, times=times)
            self["pairs"] += 6 * times
            self.send("/v1/trees", tree, f"?mesh={tree[:64]}", times=times)
            size = f"width={SIDE}&height={SIDE}"
            self.send("/v1/trees/{id}/render.png", tree, f"?mode=normal&samples=1&{size}",
                      times=times, method="GET")
            self["camera"] += SIDE * SIDE * times
            self.send("/v1/trees/{id}", tree, times=times, method="GET")
            self.send("/v1/trees/{id}", tree, "?no=thing", times=times, method="GET")  # 400
            self.send("/v1/trees/{id}/render.png", tree, method="GET", times=times,
                      parameters="?mode=ambient-occlusion&width=4000&height=4000&deadline_ms=1")
            self["deadline"] += times
        self.send("/v1/trees/{id}", UNKNOWN, times=times, method="GET")  # 404 of every replica


class DashboardTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.store = fake_s3.FakeS3()
        cls.store.start()
        cls.addClassCleanup(cls.store.stop)
        cls.replicas = Replicas(
            KDRAYD, options=("--threads", "1", "--memory-limit", f"{MEMORY_BYTES >> 20}MiB",
                             "--store", f"s3://{fake_s3.BUCKET}/metrics"),
            AWS_ACCESS_KEY_ID=fake_s3.KEY_ID, AWS_SECRET_ACCESS_KEY=fake_s3.SECRET,
            AWS_ENDPOINT_URL=cls.store.url)
        cls.addClassCleanup(cls.replicas.__exit__)
        cls.prometheus = Prometheus(cls.replicas)
        cls.addClassCleanup(cls.prometheus.__exit__)
        homes = {}
        uploads = 0
        with kdray.Client(cls.replicas.url) as client:
            while len(homes) < 3:
                tree = client.upload(mesh(uploads)).id
                _, headers, _ = request(cls.replicas.port, "GET", f"/v1/trees/{tree}")
                homes[headers["kdray-replica"]] = tree
                uploads += 1
        trees = list(homes.values())
        # Series begin with their first request, and rates see only what follows.
        Counts(cls.replicas.port).send_all(trees, 1)
        cls.prometheus.wait_for_scrape()
        start = time.time()
        time.sleep(QUIET_S)  # samples before the load and after it are within the window
        cls.prometheus.wait_for_scrape()
        cls.sent = Counts(cls.replicas.port)
        cls.sent.send_all(trees, 5)
        cls.prometheus.wait_for_scrape()
        time.sleep(QUIET_S)
        cls.window_s = math.floor(time.time() - start)
        cls.at = start + cls.window_s
        # From the first to the last sample, of the target that has the fewest.
        cls.sampled_s = min(times[-1] - times[0] for times in
                            cls.prometheus.sample_times("up", cls.window_s, cls.at))
        cls.trees = uploads
        cls.store_requests = list(cls.store.requests)
        cls.values = {}  # by (title, legend): [(labels, value)]
        for title, legend, expression in queries():
            cls.values[title, legend] = cls.prometheus.query(
                filled(expression, f"{cls.window_s}s"), cls.at)

    def by(self, title, legend, label):
        return {labels[label]: value for labels, value in self.values[title, legend]}

    def single(self, title, legend=""):
        (_, value), = self.values[title, legend]
        return value

    def check_rate(self, rate, count, what):
        """Prometheus extrapolates from the first and last sample to the ends of the window."""
        self.assertGreaterEqual(rate * self.window_s, count * 0.999, what)
        self.assertLessEqual(rate * self.window_s, count * self.window_s / self.sampled_s * 1.001,
                             what)

    def test_every_query_has_an_answer_of_finite_numbers(self):
        self.assertGreater(len(self.values), 40)
        for (title, legend), rows in self.values.items():
            self.assertTrue(rows, (title, legend))
            for labels, value in rows:
                self.assertTrue(math.isfinite(value) and value >= 0, (title, legend, labels, value))

    def test_legends_name_labels_that_the_answers_have(self):
        for (title, legend), rows in self.values.items():
            for label in re.findall(r"{{(\w+)}}", legend):
                for labels, _ in rows:
                    self.assertIn(label, labels, (title, legend))
            self.assertEqual(len({tuple(labels[name] for name in re.findall(r"{{(\w+)}}", legend))
                                  for labels, _ in rows}), len(rows), (title, "lines of one name"))

    def test_counters_are_exactly_what_was_sent(self):
        def increase(expression):
            """Between the samples before and after the load, without extrapolation."""
            before = {tuple(labels.items()): value for labels, value
                      in self.prometheus.query(expression, self.at - self.window_s)}
            return {tuple(labels.values()): round(value - before.get(tuple(labels.items()), 0))
                    for labels, value in self.prometheus.query(expression, self.at)}

        requests = increase('sum by (route, status) (kdray_http_requests_total{route=~"/v1/.*"})')
        sent = {key[1:]: count for key, count in self.sent.items() if key[0] == "request"}
        self.assertEqual({key: requests[key] for key in sent}, sent)
        self.assertEqual({key: count for key, count in requests.items() if key not in sent and count},
                         {})
        for kind, metric in (("rays", "kdray_rays_total"), ("points", "kdray_points_total")):
            found = increase(f"sum by (query) ({metric})")
            self.assertEqual({key: count for (key,), count in found.items() if count},
                             {key[1]: n for key, n in self.sent.items() if key[0] == kind})

    def test_requests_are_those_that_were_sent(self):
        self.check_rate(self.single("Requests"), self.sent["all"], "all")
        for replica, rate in self.by("Requests of each replica", "{{replica}}", "replica").items():
            # Of the requests with 404, nobody says which replicas were asked.
            count = self.sent["replica", replica]
            self.assertGreaterEqual(rate * self.window_s, count * 0.999)
            self.check_rate(max(rate - 15 / self.window_s, count / self.window_s), count, replica)
        found = {(labels["route"], labels["status"]): value for labels, value
                 in self.values["Requests by route and status", "{{route}} {{status}}"]}
        for key, count in self.sent.items():
            if key[0] == "request":
                self.check_rate(found[key[1:]], count, key)
        codes = self.by("Answers of HAProxy", "{{code}}", "code")
        for code in ("2xx", "4xx", "5xx"):
            self.check_rate(codes[code], self.sent["proxy", code], code)
        self.assertAlmostEqual(self.single("Errors"), self.sent["5xx"] / self.sent["all"], delta=0.02)
        self.check_rate(self.by("Cancelled", "{{reason}}", "reason")["deadline"],
                        self.sent["deadline"], "deadline")
        self.check_rate(self.single("Repeated by HAProxy", "repeated"), self.sent["repeated"],
                        "repeated")
        self.check_rate(self.single("Bytes", "received"), self.sent["bytes"], "bytes")

    def test_work_is_what_was_asked_for(self):
        for title, kind in (("Rays of queries", "rays"), ("Points and pairs", "points")):
            found = self.by(title, "{{query}}", "query")
            wanted = {key[1]: count for key, count in self.sent.items() if key[0] == kind}
            for query, count in wanted.items():
                self.check_rate(found[query], count, query)
        pairs = self.by("Points and pairs", "{{query}} of pairs", "query")
        self.check_rate(pairs["visibility"], self.sent["pairs"], "pairs")
        camera = self.by("Rays of pictures", "{{kind}}", "kind")["camera"]
        self.check_rate(camera, self.sent["camera"], "camera")
        self.assertGreater(self.single("Where trees came from", "memory"), 0)
        self.assertEqual(self.single("Trees"), self.trees)

    def test_states_and_resources_are_plausible(self):
        self.assertEqual((self.single("Replicas with metrics"), self.single("Replicas in use")),
                         (3, 3))
        self.assertEqual(self.by("Replicas as HAProxy sees them", "{{server}}", "server"),
                         {f"replica{i}": 1 for i in (1, 2, 3)})
        self.assertEqual(self.single("Memory", "limit"), MEMORY_BYTES)
        for replica, value in self.by("Memory", "{{replica}} process", "replica").items():
            self.assertTrue(4 << 20 < value < MEMORY_BYTES, (replica, value))
        for replica, value in self.by("Processors", "{{replica}}", "replica").items():
            self.assertTrue(0 < value <= os.cpu_count(), (replica, value))
        free = shutil.disk_usage(self.replicas.folder).free
        for value in self.by("Disk", "{{replica}} free", "replica").values():
            self.assertAlmostEqual(value, free, delta=0.2 * free)
        for value in self.by("Disk", "{{replica}} store", "replica").values():
            self.assertGreater(value, 100)
        for value in self.by("Connections", "{{replica}} descriptors", "replica").values():
            self.assertGreater(value, 5)
        for legend in ("{{class}} median", "{{class}} p99"):
            times = self.by("Time of requests", legend, "class")
            self.assertEqual(set(times), {"query", "render", "upload"})
            self.assertTrue(0 < times["query"] < 10 and 0 < times["render"] < 10, times)
        for legend in ("log lines", "connections", "accept", "files"):
            self.assertEqual(set(self.by("Trouble", f"{{{{replica}}}} {legend}", "replica").values()),
                             {0})

    def test_requests_to_the_store_are_those_that_it_got(self):
        operations = {"GET": "get", "HEAD": "head", "PUT": "put", "POST": "put", "DELETE": "delete"}
        got = collections.Counter("list" if method == "GET" and key == "" else operations[method]
                                  for method, key, _ in self.store_requests)
        told = {labels["operation"]: value for labels, value in self.prometheus.query(
            'sum by (operation) (kdray_shared_store_requests_total{outcome="answered"})', self.at)}
        self.assertEqual({name: value for name, value in told.items() if value}, dict(got))
        (_, failed), = self.prometheus.query(
            'sum(kdray_shared_store_requests_total{outcome="failed"})', self.at)
        self.assertEqual(failed, 0)
        self.assertEqual(set(self.by("Store away", "{{replica}}", "replica").values()), {0})
        (_, sent), = self.prometheus.query("sum(kdray_shared_store_sent_bytes_total)", self.at)
        self.assertGreaterEqual(sent, sum(len(body) for body, _ in self.store.objects.values()))
        self.assertTrue(0 < self.single("Time of requests to the store", "p99") < 5)

    def test_every_rule_is_evaluated_without_an_error(self):
        self.prometheus.wait_until(
            lambda: all(rule["health"] == "ok" for group in self.prometheus.get("rules")["groups"]
                        for rule in group["rules"]), "a rule is not evaluated")
        names = {rule["name"] for group in self.prometheus.get("rules")["groups"]
                 for rule in group["rules"]}
        self.assertGreater(len(names), 12)
        for metric in names:
            if ":" in metric:
                self.assertTrue(self.prometheus.query(metric), metric)


class FilesTest(unittest.TestCase):
    def check(self, *arguments):
        done = subprocess.run([PROMTOOL, *map(str, arguments)], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)

    def test_promtool_accepts_the_settings_and_the_rules(self):
        self.check("check", "rules", DEPLOY / "alerts.yml")
        with tempfile.TemporaryDirectory() as folder:
            # Debian's Prometheus is built without the discovery of Kubernetes; the rest it knows.
            settings = yaml.safe_load((DEPLOY / "kubernetes.yml").read_text())
            del settings["rule_files"], settings["scrape_configs"][0]["kubernetes_sd_configs"]
            Path(folder, "kubernetes.yml").write_text(yaml.safe_dump(settings))
            self.check("check", "config", Path(folder, "kubernetes.yml"))
            for name in ("prometheus.yml", "alerts.yml"):
                shutil.copy(DEPLOY / name, folder)
            Path(folder, "targets.json").write_text('[{"targets": ["127.0.0.1:8080"]}]')
            self.check("check", "config", Path(folder, "prometheus.yml"))

    def test_each_alert_fires_when_it_should_and_only_then(self):
        self.check("test", "rules", ROOT / "tests/alerts_test.yml")
        rules = re.findall(r"alert: (\w+)", (DEPLOY / "alerts.yml").read_text())
        cases = (ROOT / "tests/alerts_test.yml").read_text()
        for name in rules:
            self.assertRegex(cases, rf"alertname: {name}\b")

    def test_the_dashboard_is_whole(self):
        dashboard = json.loads((DEPLOY / "dashboard.json").read_text())
        panels = dashboard["panels"]
        self.assertEqual(len({panel["id"] for panel in panels}), len(panels))
        cells = set()
        for panel in panels:
            at = panel["gridPos"]
            self.assertLessEqual(at["x"] + at["w"], 24)
            own = {(x, y) for x in range(at["x"], at["x"] + at["w"])
                   for y in range(at["y"], at["y"] + at["h"])}
            self.assertFalse(cells & own, panel["title"])
            cells |= own
            if panel["type"] != "row":
                self.assertTrue(panel["description"] and panel["targets"], panel["title"])
        names = [(title, legend) for title, legend, _ in queries()]
        self.assertEqual(len(names), len(set(names)))


if __name__ == "__main__":
    if HAPROXY is None or PROMETHEUS is None or PROMTOOL is None:
        print("HAProxy or Prometheus is not installed; the dashboard is not tested")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1], verbosity=2)
