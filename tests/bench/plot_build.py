#!/usr/bin/python3
"""Draws what tests/bench/build measured: plot_build.py FOLDER reads build.csv and growth.csv there, writes build.svg."""
import csv
import statistics
import sys
from collections import defaultdict
from pathlib import Path

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt

COLORS = {
    "kd-sah": "#1b6ca8",
    "kd-binned": "#5aa9e6",
    "kd-cyclic": "#8f5db7",
    "kd-median": "#c39bd3",
    "bvh": "#3d8b57",
    "box": "#999999",
    "Embree MEDIUM": "#e0a030",
    "Embree HIGH": "#c0561e",
}


def draw_builds(axes, path):
    """Medians on one thread, as multiples of Embree HIGH."""
    seconds = defaultdict(list)
    meshes = {}
    with path.open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            if row["threads"] == "1" and row["builder"] != "box":
                seconds[row["mesh"], row["builder"]].append(float(row["seconds"]))
                meshes[row["mesh"]] = None
    builders = [name for name in COLORS if any((mesh, name) in seconds for mesh in meshes)]
    width = 0.8 / len(builders)
    for i, builder in enumerate(builders):
        ratios = [
            statistics.median(seconds[mesh, builder]) / statistics.median(seconds[mesh, "Embree HIGH"]) for mesh in meshes
        ]
        places = [k + (i - len(builders) / 2 + 0.5) * width for k in range(len(meshes))]
        axes.bar(places, ratios, width, label=builder, color=COLORS[builder])
    axes.set_xticks(range(len(meshes)), list(meshes))
    axes.set_ylabel("build time / Embree HIGH")
    axes.legend(fontsize=7, ncols=2)


def draw_growth(axes, path, column, label, scale=1.0):
    points = defaultdict(list)
    with path.open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            points[row["build"]].append((int(row["triangles"]), float(row[column]) * scale))
    for name, values in points.items():
        axes.plot(*zip(*values), "o-", markersize=3, label=name, color=COLORS[name])
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("triangles")
    axes.set_ylabel(label)
    axes.grid(True, which="major", color="#dddddd", linewidth=0.5)


def main():
    folder = Path(sys.argv[1])
    figure, (builds, growth, rays) = plt.subplots(1, 3, figsize=(15, 4.5), layout="constrained")
    draw_builds(builds, folder / "build.csv")
    draw_growth(growth, folder / "growth.csv", "build_seconds", "build, seconds (one thread)")
    draw_growth(rays, folder / "growth.csv", "ray_seconds", "random ray, nanoseconds (one thread)", 1e9)
    growth.legend(fontsize=7)
    figure.savefig(folder / "build.svg")


if __name__ == "__main__":
    main()
