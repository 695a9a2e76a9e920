#!/usr/bin/python3
"""Draws what tests/bench/trace measured: plot_trace.py FOLDER reads trace.csv there, writes trace.svg."""
import csv
import sys
from pathlib import Path

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt

PAIRS = [("fast", "kdray fast", lambda mode: mode.startswith("embree") and "robust" not in mode, "#5aa9e6"),
         ("watertight", "kdray watertight", lambda mode: mode.startswith("embree robust"), "#1b6ca8")]


def main(folder):
    speed, meshes, classes, threads = {}, {}, {}, {}
    with (folder / "trace.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            speed[row["mesh"], row["class"], row["mode"]] = float(row["mrays_median"])
            meshes[row["mesh"]] = classes[row["class"]] = threads[row["threads"]] = None
    figure, axes = plt.subplots(1, len(classes), figsize=(2.6 * len(classes), 2.9), sharey=True, layout="constrained")
    for axis, rays in zip(axes, classes):
        for i, (label, ours, is_rival, color) in enumerate(PAIRS):
            ratios = []
            for mesh in meshes:
                rivals = [s for (m, c, mode), s in speed.items() if (m, c) == (mesh, rays) and is_rival(mode)]
                ratios.append(speed[mesh, rays, ours] / max(rivals))
            places = [k + 0.4 * (i - 0.5) for k in range(len(meshes))]
            axis.bar(places, ratios, 0.38, label=label, color=color)
        axis.axhline(1, color="#c0561e", linewidth=0.9)
        axis.set_title(rays, fontsize=9)
        axis.set_xticks(range(len(meshes)), list(meshes), rotation=60, ha="right", fontsize=7)
    axes[0].set_ylabel("kdray / best mode of Embree", fontsize=8)
    axes[0].legend(fontsize=7)
    figure.suptitle(f"Rays a second, {' and '.join(threads)} thread(s); the line is Embree", fontsize=9)
    figure.savefig(folder / "trace.svg", metadata={"Date": None})


if __name__ == "__main__":
    main(Path(sys.argv[1]))
