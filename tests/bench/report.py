# SPDX-License-Identifier: Apache-2.0
"""Turns the benchmarks' results into tables and plots.

  report.py tradeoff|images|mismatches|latency|hits|pictures|auto CSV COMMAND
  report.py trace|build|points|http FOLDER COMMAND

Writes the section of that name in tests/bench/README.md, between its two marks, and the plots into
docs/.
"""
import csv
import os
import sys
from collections import defaultdict
from statistics import median

from report_auto import auto
from report_common import BUILDS, BUILD_COLORS, COLORS, LARGE, PRECISIONS, conditions, geometric_mean, plt, rate, save, table, write_section
from report_requests import hits, http, latency, pictures, points


def tradeoff(rows, command):
    for row in rows:
        for key in row:
            if key not in ("mesh", "build", "precision", "leaks"):
                row[key] = float(row[key])
        row["leaks"] = int(row["leaks"]) if row["leaks"] else None
    sah = [row for row in rows if row["build"] == "kd-sah"]

    by_precision = []
    for precision in PRECISIONS:
        mine = [row for row in sah if row["precision"] == precision]
        closed = [row for row in mine if row["leaks"] is not None]
        total = lambda key, of=mine: int(sum(row[key] for row in of))  # noqa: E731
        by_precision.append([
            precision,
            f"{geometric_mean(row['random_rays_per_s'] for row in mine) / 1e6:.2f}",
            f"{geometric_mean(row['aimed_rays_per_s'] for row in mine) / 1e6:.2f}",
            rate(total("leaks", closed), total("rays", closed)),
            rate(total("wrong"), total("rays")),
            rate(total("unconnected"), total("rays")),
            rate(total("folds"), total("rays")),
            rate(total("missed"), total("rays")),
            rate(total("extra"), total("rays")),
            f"{max(row['t_p999'] for row in mine):.1e}",
            f"{max(row['t_max'] for row in mine):.1e}",
        ])
    least = min(LARGE, max(row["triangles"] for row in rows))
    by_build = []
    for build in BUILDS:
        mine = [row for row in rows if row["build"] == build and row["precision"] == "watertight"]
        large = [row for row in mine if row["triangles"] >= least]
        by_build.append([
            build,
            f"{geometric_mean(row['build_ms'] / row['triangles'] * 1e6 for row in large):.0f}",
            f"{geometric_mean(row['bytes'] / row['triangles'] for row in large):.0f}",
            f"{geometric_mean(max(row['random_nodes'], 1e-3) for row in large):.1f}",
            f"{geometric_mean(max(row['random_triangles'], 1e-3) for row in large):.1f}",
            f"{geometric_mean(row['random_rays_per_s'] for row in large) / 1e6:.3g}",
            f"{geometric_mean(row['aimed_rays_per_s'] for row in large) / 1e6:.3g}",
        ])

    inside = [row for row in sah if row["precision"] != "fast" and row["leaks"] is not None]
    lost = sum(int(row["missed"] + row["extra"]) for row in inside)

    throughput_plot(sah)
    quality_plot(rows)
    closed = len({row["mesh"] for row in sah if row["leaks"] is not None})
    meshes = len({row["mesh"] for row in rows})
    differences = int(sum(row["differences"] for row in rows))
    write_section("tradeoff", f"""
{conditions(command)} {meshes} meshes, {closed} of them closed with a point inside; {len(rows)} rows, each the median of several runs.
Answers that differed between builds: {differences}. Missed and extra hits from inside closed meshes, except in `fast`: {lost}. All other
missed and extra hits are of rays at outlines and open borders, which touch the mesh or pass it within rounding.

Each precision on `kd-sah`, over all meshes. Speeds are million rays a second (geometric mean). Shares are of aimed rays; leaks are
shares of aimed rays from inside closed meshes. A zero is followed by its 95% bound, 3/N. Errors of t are scaled like their bound (1e-6 for `watertight`, 1e-14 for `double`;
`GET /docs` has the formula). For every mesh, 99.9% of the rays have at most the first error, all have at most the second. `exact` is the reference.

{table(['', 'random Mrays/s', 'aimed Mrays/s', 'leaks', 'other triangle', 'not even a neighbour', 'folds', 'missed', 'extra', 't error 99.9%', 'max'], by_precision)}

![Throughput against leaks and errors of t](../../docs/tradeoff-precision.svg)

Each build in `watertight`, over meshes of {least:,.0f} triangles and more (geometric means).

{table(['', 'build ns a triangle', 'bytes a triangle', 'nodes a ray', 'triangles a ray', 'random Mrays/s', 'aimed Mrays/s'], by_build)}

![Build seconds against steps and SAH cost, and SAH cost against steps](../../docs/tradeoff-build.svg)
""")


def throughput_plot(rows):
    figure, (leaks, errors) = plt.subplots(1, 2, figsize=(10, 4))
    for precision in PRECISIONS:
        mine = [row for row in rows if row["precision"] == precision]
        closed = [row for row in mine if row["leaks"] is not None]
        seen = [row for row in closed if row["leaks"] > 0]
        unseen = [row for row in closed if row["leaks"] == 0]
        leaks.scatter([row["aimed_rays_per_s"] / 1e6 for row in seen], [row["leaks"] / row["rays"] for row in seen],
                      s=14, color=COLORS[precision], label=precision if seen else None)
        leaks.scatter([row["aimed_rays_per_s"] / 1e6 for row in unseen], [3 / row["rays"] for row in unseen], s=14,
                      marker="v", facecolors="none", edgecolors=COLORS[precision],
                      label=None if seen else f"{precision} (none seen)")
        if precision != "exact":
            judged = [row for row in mine if row["t_rays"] > 0]
            errors.scatter([row["aimed_rays_per_s"] / 1e6 for row in judged],
                           [max(row["t_p999"], 1e-18) for row in judged], s=14, color=COLORS[precision],
                           label=precision)
    for bound, precision in ((1e-6, "watertight"), (1e-14, "double")):
        errors.axhline(bound, color=COLORS[precision], linestyle="--", linewidth=0.8)
    leaks.set(xscale="log", yscale="log", xlabel="aimed rays, millions a second",
              ylabel="leaks of rays from inside (open marks: none, 3/N)", title="Speed against leaks")
    errors.set(xscale="log", yscale="log", xlabel="aimed rays, millions a second",
               ylabel="scaled error of t, 99.9% (dashed: promised)", title="Speed against errors of t")
    for axes in (leaks, errors):
        axes.legend(fontsize=8)
    save(figure, "tradeoff-precision.svg")


def quality_plot(rows):
    figure, (steps, cost, predicts) = plt.subplots(1, 3, figsize=(12, 4))
    for build in BUILDS:
        mine = [row for row in rows if row["build"] == build and row["precision"] == "watertight"
                and row["triangles"] >= 1000 and row["random_nodes"] > 0]
        work = [row["random_nodes"] + row["random_triangles"] for row in mine]
        style = {"s": 14, "color": BUILD_COLORS[build], "label": build}
        steps.scatter([row["build_ms"] / 1e3 for row in mine], work, **style)
        cost.scatter([row["build_ms"] / 1e3 for row in mine], [row["sah_cost"] for row in mine], **style)
        predicts.scatter([row["sah_cost"] for row in mine], work, **style)
    steps.set(xlabel="build seconds", ylabel="nodes and triangles of a random ray", title="What building longer saves")
    cost.set(xlabel="build seconds", ylabel="SAH cost", title="What the model says it saves")
    predicts.set(xlabel="SAH cost", ylabel="nodes and triangles of a random ray", title="How well the model predicts")
    low, high = predicts.get_xlim()
    predicts.plot([max(low, 1), high], [max(low, 1), high], color="grey", linewidth=0.8)
    for axes in (steps, cost, predicts):
        axes.set(xscale="log", yscale="log")
    predicts.legend(fontsize=8)
    save(figure, "tradeoff-build.svg")


# ---- Images ----


def images(rows, command):
    series = defaultdict(list)
    for row in rows:
        series[row["series"]].append({k: v if k == "series" else float(v) for k, v in row.items()})
    figure, (rmse, flip) = plt.subplots(1, 2, figsize=(10, 4))
    for name, places in series.items():
        style = {"color": COLORS.get(name, "black"), "marker": "o", "markersize": 3, "linewidth": 1, "label": name}
        if name not in COLORS:
            style["linestyle"] = "--"
        rmse.plot([p["seconds"] for p in places], [p["rmse"] for p in places], **style)
        flip.plot([p["seconds"] for p in places], [p["flip"] for p in places], **style)
    rmse.set(xscale="log", yscale="log", xlabel="seconds", ylabel="RMSE, linear light",
             title="Error over time against many samples in exact")
    flip.set(xscale="log", yscale="log", xlabel="seconds", ylabel="mean FLIP", title="As people see it")
    rmse.legend(fontsize=8)
    save(figure, "images-error.svg")
    chosen = [p for places in series.values() for p in places if p["series"] not in COLORS or p["samples"] in (4, 16, 64, 256)]
    write_section("images", f"""
{conditions(command)} 200 x 150 pixels, shaded, `kd-sah`, compared with a reference in `exact` (4096 samples, unless the command says otherwise). A crack
is a pixel that shows the background although the mesh covers it and its neighbours in the reference.

{table(['', 'samples', 'seconds', 'RMSE', 'mean FLIP', 'cracks'],
       [[p['series'], f"{p['samples']:.4g}", f"{p['seconds']:.3g}", f"{p['rmse']:.2e}", f"{p['flip']:.2e}", f"{p['cracks']:.0f}"] for p in chosen])}

![Error over time, by precision](../../docs/images-error.svg)
""")


# ---- Rays a second ----

RIVALS = [("fast", "kdray fast", lambda mode: mode.startswith("embree") and "robust" not in mode, "#5aa9e6"),
          ("watertight", "kdray watertight", lambda mode: mode.startswith("embree robust"), "#1b6ca8")]


def trace(folder, command):
    speed, meshes, classes = {}, {}, {}
    with open(os.path.join(folder, "trace.csv"), newline="") as file:
        for row in csv.DictReader(file):
            speed[row["mesh"], row["class"], row["mode"]] = float(row["mrays_median"])
            meshes[row["mesh"]] = classes[row["class"]] = None
    figure, axes = plt.subplots(1, len(classes), figsize=(2.6 * len(classes), 3.2), sharey=True, squeeze=False)
    for axis, rays in zip(axes[0], classes):
        for i, (label, ours, is_rival, color) in enumerate(RIVALS):
            ratios = []
            for mesh in meshes:
                rivals = [s for (m, c, mode), s in speed.items() if (m, c) == (mesh, rays) and is_rival(mode)]
                ratios.append(speed[mesh, rays, ours] / max(rivals))
            axis.bar([k + 0.4 * (i - 0.5) for k in range(len(meshes))], ratios, 0.38, label=label, color=color)
        axis.axhline(1, color="#c0561e", linewidth=0.9)
        axis.set_title(rays, fontsize=9)
        axis.set_xticks(range(len(meshes)), list(meshes), rotation=60, ha="right", fontsize=7)
    axes[0][0].set_ylabel("kdray / best mode of Embree (line)", fontsize=8)
    axes[0][0].legend(fontsize=7)
    save(figure, "trace.svg")
    tables = []
    for name in ["trace.md", "trace2.md"]:
        with open(os.path.join(folder, name)) as file:
            tables.append(file.read().strip().replace("\n### ", "\n#### "))
    write_section("trace", f"""
{conditions(command)}

![Rays a second as a multiple of the best mode of Embree](../../docs/trace.svg)

{tables[0]}

Two threads, Embree's MEDIUM only:

{tables[1]}
""")


# ---- Builds ----

SAH_TARGET, BINNED_TARGET, SPEED_UP_TARGET = 1.3, 3.0, 1.7
EMBREE_COLORS = {"Embree HIGH": "#5c677d", "Embree MEDIUM": "#adb5bd"}


def grouped_bars(axes, groups, series, colors, lines):
    """series: a value for each group, by name. lines: heights and their colours."""
    width = 0.8 / len(series)
    for i, (name, values) in enumerate(series.items()):
        places = [k + (i - len(series) / 2 + 0.5) * width for k in range(len(groups))]
        bars = axes.bar(places, values, width * 0.92, label=name, color=colors[i])
        axes.bar_label(bars, [f"{value:.2f}" for value in values], fontsize=6, padding=1)
    axes.set_xticks(range(len(groups)), groups, fontsize=8)
    axes.grid(axis="x", visible=False)
    for height, color in lines:
        axes.axhline(height, color=color, linestyle="--", linewidth=0.9)
    axes.set_ylim(0, 1.25 * axes.get_ylim()[1])  # room for the legend


def build(folder, command):
    with open(os.path.join(folder, "build.csv"), newline="") as file:
        rows = list(csv.DictReader(file))
    with open(os.path.join(folder, "growth.csv"), newline="") as file:
        growth = list(csv.DictReader(file))
    tables = []
    for name in ("build.md", "growth.md"):
        with open(os.path.join(folder, name)) as file:
            tables.append(file.read().split("\n", 1)[1].strip())  # the first line names the machine, as conditions() does

    taken = defaultdict(list)
    for row in rows:
        taken[row["mesh"], row["builder"], int(row["threads"])].append(float(row["seconds"]))
    meshes = list(dict.fromkeys(row["mesh"] for row in rows))
    threads = sorted({int(row["threads"]) for row in rows})

    def ratio(mesh, above, below):
        return median(taken[mesh, *above]) / median(taken[mesh, *below])

    figure, ((beside, speed_up), (building, tracing)) = plt.subplots(2, 2, figsize=(11, 7.5))
    sah, binned = BUILD_COLORS["kd-sah"], BUILD_COLORS["kd-binned"]
    least, most = threads[0], threads[-1]
    grouped_bars(beside, meshes, {
        "kd-sah to Embree HIGH": [ratio(mesh, ("kd-sah", least), ("Embree HIGH", least)) for mesh in meshes],
        "kd-binned to Embree MEDIUM": [ratio(mesh, ("kd-binned", least), ("Embree MEDIUM", least)) for mesh in meshes],
    }, (sah, binned), [(SAH_TARGET, sah), (BINNED_TARGET, binned)])
    beside.set(title=f"Build time beside Embree's, threads: {least}", ylabel="ratio (dashed: at most)")
    beside.legend(fontsize=8, loc="upper center", ncols=2)
    grouped_bars(speed_up, meshes, {
        builder: [ratio(mesh, (builder, least), (builder, most)) for mesh in meshes]
        for builder in ("kd-sah", "kd-binned", "Embree HIGH", "Embree MEDIUM")
    }, (sah, binned, *EMBREE_COLORS.values()), [(SPEED_UP_TARGET, "black")])
    speed_up.set(title=f"Times as fast with threads: {most}", ylabel="speed-up (dashed: at least)")
    speed_up.legend(fontsize=8, loc="upper center", ncols=4)

    for builder in BUILDS:
        mine = [row for row in growth if row["build"] == builder]
        triangles = [int(row["triangles"]) for row in mine]
        style = {"color": BUILD_COLORS[builder], "marker": "o", "markersize": 3, "linewidth": 1.2, "label": builder}
        building.plot(triangles, [float(row["build_seconds"]) * 1e9 / int(row["triangles"]) for row in mine], **style)
        tracing.plot(triangles, [float(row["ray_seconds"]) * 1e9 for row in mine], **style)
    building.set(xscale="log", yscale="log", xlabel="triangles", ylabel="nanoseconds a triangle",
                 title="How builds grow (1 thread)")
    tracing.set(xscale="log", yscale="log", xlabel="triangles", ylabel="nanoseconds a random ray",
                title="How rays get slower (1 thread)")
    tracing.legend(fontsize=8, ncols=2, loc="upper left")
    save(figure, "build.svg")
    write_section("build", f"""
{conditions(command)} Times include the collapse to the wide tree.

![Build time beside Embree's, speed-up, growth of builds and of rays](../../docs/build.svg)

{tables[0]}

{tables[1]}
""")


# ---- Mismatches ----

KINDS = {
    ("kdray", "lost", "inner"): "kdray lets the ray through between two triangles; Embree and `exact` hit one of them",
    ("kdray", "extra", "outline"): "kdray hits a triangle that the ray passes by at an outline",
    ("kdray", "lost", "outline"): "kdray passes by a triangle that the ray hits at an outline",
    ("Embree", "lost", "inner"): "Embree lets the ray through between two triangles; kdray and `exact` hit one of them",
    ("Embree", "extra", "outline"): "Embree hits a triangle that the ray passes by at an outline; kdray misses it, as `exact` does",
    ("Embree", "lost", "outline"): "Embree passes by a triangle that the ray hits at an outline; kdray hits it, as `exact` does",
}


def mismatches(rows, command):
    groups = defaultdict(list)
    for row in rows:
        kind = row["wrong"], row["what"], row["edge"]
        groups[KINDS.get(kind, ", ".join(kind)), row["mesh"], row["rays"], row["of"], row["precision"]].append(float(row["ulps"]))
    lines = [[mesh, rays, precision, f"{len(ulps)} of {int(of):,}", kind, f"{max(ulps):.2g}"]
             for (kind, mesh, rays, of, precision), ulps in groups.items()]
    write_section("mismatches", f"""
{conditions(command)} The last column is the largest distance of the ray from the nearest edge of the triangle in question, in
ulps of a float at the mesh's largest coordinate.

{table(['mesh', 'rays', 'precision', 'differ', 'how', 'ulps from the edge'], lines)}
""")


if __name__ == "__main__":
    what, path, said = sys.argv[1:]
    of_folders = {"trace": trace, "build": build, "points": points, "http": http}
    if what in of_folders:
        of_folders[what](path, said)
        sys.exit()
    of_rows = {"tradeoff": tradeoff, "images": images, "mismatches": mismatches, "latency": latency, "hits": hits,
               "pictures": pictures, "auto": auto}
    with open(path, newline="") as source:
        of_rows[what](list(csv.DictReader(source)), said)
