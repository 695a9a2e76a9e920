# SPDX-License-Identifier: Apache-2.0
"""Debian's Prometheus over running replicas, with the files of server/deploy/prometheus."""
import json
import shutil
import socket
import subprocess
import time
import urllib.parse
import urllib.request
from pathlib import Path

from replicas import BACK_S, ROOT

DEPLOY = ROOT / "server/deploy/prometheus"
PROMETHEUS, PROMTOOL = (shutil.which(name) for name in ("prometheus", "promtool"))
SCRAPE_S = 0.5


def queries(dashboard=DEPLOY / "dashboard.json"):
    """(title of the panel, legend, expression) of every query of the dashboard, as Grafana has it."""
    return [(panel["title"], target["legendFormat"], target["expr"])
            for panel in json.loads(dashboard.read_text())["panels"]
            for target in panel.get("targets", [])]


def filled(expression, rate_interval):
    """With values in the place of Grafana's variables: all replicas."""
    text = expression.replace("$__rate_interval", rate_interval).replace("$replica", ".*")
    assert "$" not in text, text
    return text


class Prometheus:
    """Context manager: scrapes the replicas of a `replicas.Replicas` every half second."""

    def __init__(self, replicas):
        folder = Path(replicas.folder, "prometheus")
        folder.mkdir()
        shutil.copy(Path(replicas.folder, "targets.json"), folder)
        shutil.copy(DEPLOY / "alerts.yml", folder)
        text = (DEPLOY / "prometheus.yml").read_text()
        for key in ("scrape_interval", "evaluation_interval"):
            assert f"{key}: 15s" in text
            text = text.replace(f"{key}: 15s", f"{key}: {SCRAPE_S * 1000:.0f}ms")
        (folder / "prometheus.yml").write_text(text)
        with socket.socket() as free:  # its port 0 would be told in its log only
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self._url = f"http://127.0.0.1:{port}/api/v1/"
        self._log = open(folder / "log", "w")
        self._process = subprocess.Popen(
            [PROMETHEUS, f"--config.file={folder}/prometheus.yml",
             f"--storage.tsdb.path={folder}/data", f"--web.listen-address=127.0.0.1:{port}"],
            stdout=self._log, stderr=self._log)
        wanted = len(replicas.addresses) + 1
        self.wait_until(lambda: sum(float(v) for _, v in self.query("sum(up)")) == wanted,
                        f"it does not reach {wanted} targets; see {folder}/log")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._process.terminate()
        self._process.wait(timeout=30)
        self._log.close()

    def get(self, path, **parameters):
        """The data of an answer of its HTTP API."""
        url = self._url + path + "?" + urllib.parse.urlencode(parameters)
        with urllib.request.urlopen(url, timeout=20) as answer:
            found = json.load(answer)
        assert found["status"] == "success", found
        return found["data"]

    def query(self, expression, at=None):
        """[(labels, value)] at a time in seconds since 1970, by default now."""
        found = self.get("query", query=expression, **({} if at is None else {"time": at}))
        return [(row["metric"], float(row["value"][1])) for row in found["result"]]

    def sample_times(self, selector, seconds, at):
        """The times of the samples of each series, of the last `seconds` before a time."""
        found = self.get("query", query=f"{selector}[{seconds}s]", time=at)
        return [[float(t) for t, _ in row["values"]] for row in found["result"]]

    def query_range(self, expression, start, end, step):
        """[(labels, [(time, value)])]"""
        found = self.get("query_range", query=expression, start=start, end=end, step=step)
        return [(row["metric"], [(float(t), float(v)) for t, v in row["values"]])
                for row in found["result"]]

    def wait_for_scrape(self):
        """Until every target has been scraped after now."""
        start = time.time()
        self.wait_until(
            lambda: min(v for _, v in self.query("timestamp(up)")) > start,
            "targets are not scraped any more")

    @staticmethod
    def wait_until(is_so, problem):
        deadline = time.monotonic() + 3 * BACK_S
        while True:
            try:
                if is_so():
                    return
            except (OSError, ValueError):
                pass
            if time.monotonic() > deadline:
                raise RuntimeError(f"Prometheus: {problem}")
            time.sleep(0.1)
