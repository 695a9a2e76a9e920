# SPDX-License-Identifier: Apache-2.0
"""Writes what replicas_runs.py measured into docs/scale.md: replicas_report.py RESULTS COMMAND"""
import json
import sys
from statistics import median

import report_common as common
from report_common import plt

COLORS = {"query": "#00798c", "picture": "#d1495b"}
REPLICA_COLORS = ("#00798c", "#edae49", "#30638e")


def of(rows, **wanted):
    return [row for row in rows if all(row[key] == value for key, value in wanted.items())]


def middle(rows, key):
    return median(row[key] for row in rows)


def throughput(results, command):
    rows, lines = results["throughput"], []
    for kind in COLORS:
        one = middle(of(rows, kind=kind, replicas=1), "rate")
        for number in sorted({row["replicas"] for row in rows}):
            some = of(rows, kind=kind, replicas=number)
            rates = [row["rate"] for row in some]
            used = [share for row in some for share in row["share_used"]]
            lines.append([
                kind, str(number), f"{median(rates):.1f}", f"{min(rates):.1f} to {max(rates):.1f}",
                f"{median(rates) / one / number:.2f}", f"{min(used):.1%} to {max(used):.1%}",
                f"{middle(some, 'proxy_share'):.1%}", f"{middle(some, 'client_share'):.1%}"])
    loads = [row["load"] for row in rows]
    text = common.table(
        ["Request", "Replicas", "Requests a second, median", "of all rounds", "of linear",
         "Processor of each replica", "of HAProxy", "of the clients"], lines)
    note = (f"{common.conditions(command)} {results['rounds']} rounds of {results['seconds']:.0f} s, "
            f"beside a load of {min(loads):.0f} to {max(loads):.0f}; control groups of version "
            f"{rows[0]['cgroup']}.")
    return text + "\n\n" + common.wrap(note)


def plot_throughput(results):
    figure, axes = plt.subplots(1, 2, figsize=(8, 3))
    rows = results["throughput"]
    numbers = sorted({row["replicas"] for row in rows})
    for axis, kind in zip(axes, COLORS):
        one = middle(of(rows, kind=kind, replicas=1), "rate")
        axis.plot(numbers, [one * n for n in numbers], color="grey", lw=0.8, label="linear")
        axis.plot(numbers, [0.9 * one * n for n in numbers], ":", color="grey", label="0.9 of it")
        for number in numbers:
            rates = [row["rate"] for row in of(rows, kind=kind, replicas=number)]
            axis.plot([number] * len(rates), rates, "o", color=COLORS[kind], ms=4)
        axis.set(xlabel="replicas", ylabel="requests a second", ylim=(0, None),
                 title={"query": f"{results['rays']:,} rays", "picture": "96 x 72 pixels"}[kind])
        axis.set_xticks(numbers)
        axis.legend(frameon=False)
    common.save(figure, "replicas-throughput.svg")


def loss(results):
    found = results["loss"]
    counts = [count for _, _, count in found["windows"]]
    return common.table(
        ["Requests", "Failed", "p99 before", "p99 in the first 2 s after", "p99 from 2 s after on",
         "Slowest request"],
        [[f"{found['requests']:,}", str(found["failed"]), f"{found['p99_before_ms']:.0f} ms",
          f"{found['p99_first_2s_ms']:.0f} ms", f"{found['p99_after_2s_ms']:.0f} ms",
          f"{found['worst_ms']:.0f} ms"]]) + "\n\n" + common.wrap(
              f"Beside a load of {found['load']:.0f}; windows of half a second have "
              f"{min(counts)} to {max(counts)} requests.")


def lines_of(recorded, label):
    """(name, times, values) for each line that Prometheus answered."""
    for labels, values in sorted(recorded, key=lambda row: sorted(row[0].items())):
        yield labels.get(label, ""), [t for t, _ in values], [v for _, v in values]


def plot_loss(results):
    found = results["loss"]
    recorded = found["recorded"]
    figure, axes = plt.subplots(2, 2, figsize=(9, 5.2), sharex=True)
    for color, (name, times, values) in zip(
            REPLICA_COLORS, lines_of(recorded["requests"], "replica")):
        victim = " (killed)" if name == found["victim"] else ""
        axes[0][0].plot(times, values, color=color, label=name + victim)
    axes[0][0].set(ylabel="requests a second", title="requests of each replica")
    for name, key, axis in (("replicas in use", "in_use", axes[0][1]),
                            ("sent to another replica by HAProxy, a second", "moved", axes[1][0])):
        for _, times, values in lines_of(recorded[key], ""):
            axis.plot(times, values, color="#00798c")
        axis.set(title=name)
    axes[0][1].set_yticks([0, 1, 2, 3])
    windows = [(at, ms) for at, ms, _ in found["windows"] if ms is not None]
    axes[1][1].plot(*zip(*windows), "o-", ms=3, color="#d1495b", label="at the clients, 0.5 s")
    for _, times, values in lines_of(recorded["p99"], ""):
        axes[1][1].plot(times, [1000 * v for v in values], color="#00798c",
                        label="in the replicas (Prometheus)")
    axes[1][1].set(title="p99 of queries, ms")
    for axis in axes.flat:
        axis.axvline(0, color="grey", lw=0.8)
        axis.axvspan(0, 2, color="grey", alpha=0.1, lw=0)
        axis.set_ylim(0, 1.35 * axis.get_ylim()[1])  # room for a legend
        if axis.get_legend_handles_labels()[0]:
            axis.legend(frameon=False, loc="upper right", ncol=3 if axis is axes[0][0] else 1)
    for axis in axes[1]:
        axis.set_xlabel("seconds after the kill")
    common.save(figure, "replicas-loss.svg")


def cold(results):
    found, lines = results["cold"], []
    for cached, name in ((True, "in the page cache"), (False, "on disk only")):
        rows = of(found["rows"], cached=cached)
        lines.append([name] + [f"{middle(rows, key):.0f} ms" for key in (
            "start_ms", "read_and_hash_ms", "first_ms")] + [f"{middle(rows, 'later_ms'):.1f} ms"])
    return common.table(
        ["Tree file", "Start of the daemon", "Reading and hashing the files, by Python",
         "First query", "Later queries"], lines) + "\n\n" + common.wrap(
             f"{found['triangles']:,} triangles; parsed mesh and tree are {found['bytes'] / 1e6:.0f} "
             f"MB. Upload and build took {found['upload_and_build_ms'] / 1000:.1f} s. Medians of "
             f"{len(found['rows']) // 2}, beside a load of {found['load']:.0f}.")


def main():
    with open(sys.argv[1]) as file:
        results = json.load(file)
    plot_throughput(results)
    plot_loss(results)
    common.write_page("scale.md", {
        "throughput": throughput(results, sys.argv[2]), "kill": loss(results),
        "cold": cold(results)})


if __name__ == "__main__":
    main()
