# SPDX-License-Identifier: Apache-2.0
"""A share of a processor for each process, by control groups of version 1 or 2."""
import os
import sys
from pathlib import Path

ROOT = Path("/sys/fs/cgroup")
PERIOD_US = 100_000
WEIGHT = 64  # times that of other processes, so that a share is not lost to them


class CpuShares:
    """Context manager of control groups below one of its own, which it removes at the end."""

    def __init__(self):
        self._is_v2 = (ROOT / "cgroup.controllers").exists()
        self._groups = []
        # Version 1 limits and counts in two hierarchies.
        self._bases = [ROOT] if self._is_v2 else [ROOT / "cpu", ROOT / "cpuacct"]
        try:
            if self._is_v2:
                (ROOT / "cgroup.subtree_control").write_text("+cpu")
            self._weigh(self._make(""))
            if self._is_v2:
                (self._path(ROOT, "") / "cgroup.subtree_control").write_text("+cpu")
        except OSError as error:
            sys.exit(f"tests/bench/replicas: control groups cannot be made ({error}); it needs root")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for base in self._bases:
            for name in [*self._groups[1:], ""]:
                group = self._path(base, name)
                for process in (group / "cgroup.procs").read_text().split():
                    try:
                        (base / "cgroup.procs").write_text(process)
                    except OSError:
                        pass  # it has ended
                group.rmdir()

    @staticmethod
    def _path(base, name):
        return base / f"kdray-bench-{os.getpid()}" / name

    def _make(self, name):
        for base in self._bases:
            self._path(base, name).mkdir()
        self._groups.append(name)
        return self._path(self._bases[0], name)

    def _weigh(self, group):
        if self._is_v2:
            (group / "cpu.weight").write_text(str(min(100 * WEIGHT, 10_000)))
        else:
            (group / "cpu.shares").write_text(str(1024 * WEIGHT))

    def put(self, process, share=None):
        """Moves a process into a group of its own; share: of one processor, None for any."""
        name = str(process)
        group = self._make(name)
        self._weigh(group)
        if share is not None:
            quota = round(share * PERIOD_US)
            if self._is_v2:
                (group / "cpu.max").write_text(f"{quota} {PERIOD_US}")
            else:
                (group / "cpu.cfs_period_us").write_text(str(PERIOD_US))
                (group / "cpu.cfs_quota_us").write_text(str(quota))
        for base in self._bases:
            (self._path(base, name) / "cgroup.procs").write_text(name)

    def seconds(self, process):
        """Processor time since `put`, of threads that have ended too."""
        if self._is_v2:
            text = (self._path(ROOT, str(process)) / "cpu.stat").read_text()
            return int(text.split("usage_usec ")[1].split()[0]) / 1e6
        return int((self._path(ROOT / "cpuacct", str(process)) / "cpuacct.usage").read_text()) / 1e9

    @property
    def version(self):
        return 2 if self._is_v2 else 1


def children(process):
    """The processes that a process has started."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rsplit(")", 1)[1].split()
        except (OSError, IndexError):
            continue
        if int(fields[1]) == process:
            found.append(int(path.parent.name))
    return found


def name_of(process):
    return Path(f"/proc/{process}/comm").read_text().strip()
