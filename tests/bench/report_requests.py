# SPDX-License-Identifier: Apache-2.0
"""Reports of benchmarks of single queries, pictures and requests over HTTP."""
import csv
import os
from collections import defaultdict
from statistics import median

from report_common import PRECISIONS, conditions, plt, save, table, write_section

# ---- Closest points ----


def points(folder, command):
    with open(os.path.join(folder, "points.md")) as file:
        measured = file.read().strip()
    write_section("points", f"""
{conditions(command)}

{measured}
""")


# ---- Small requests ----


def latency(rows, command):
    def middle(server, connections, load, key):
        return median(float(row[key]) for row in rows if (row["server"], row["load"]) == (server, load)
                      and connections in (None, int(row["connections"])))

    lines = []
    for label, connections, load in (("1 connection", 1, "full"), ("8 connections", 8, "full"),
                                     ("64 connections", 64, "full"), ("half of what 8 reach", None, "half")):
        line = [label]
        for server in ("kdrayd", "nginx"):
            line += [f"{middle(server, connections, load, key):,.0f}" for key in ("per_second", "p50_us", "p99_us")]
        line.append(f"{middle('kdrayd', connections, load, 'p50_us') / middle('nginx', connections, load, 'p50_us'):.1f}")
        lines.append(line)
    many = middle("kdrayd", 64, "full", "per_second") / middle("kdrayd", 8, "full", "per_second")
    tail = middle("kdrayd", None, "half", "p99_us") / middle("kdrayd", None, "half", "p50_us")
    rounds = len({row["round"] for row in rows})
    write_section("latency", f"""
{conditions(command)} Medians of {rounds} rounds. Requests of {rows[0]['request_bytes']} bytes, answers of {rows[0]['answer_bytes']} bytes.
With 64 connections kdrayd answers {many:.2f} times as many requests a second as with 8. At half load its p99 is {tail:.1f} times its p50.

{table(['', 'kdrayd, requests/s', 'p50 us', 'p99 us', 'nginx, requests/s', 'p50 us', 'p99 us', 'ratio of p50'], lines)}
""")


# ---- All hits ----


def hits(rows, command):
    speeds = defaultdict(dict)
    parities = []
    for row in rows:
        if row["query"] == "parity":
            parities.append([row["mesh"], f"{int(row['hits']):,}", row["mrays_median"]])
        else:
            speeds[row["mesh"], row["query"]][row["mode"]] = row
    lines = []
    for (mesh, query), modes in speeds.items():
        speed = {mode: float(row["mrays_median"]) for mode, row in modes.items()}
        best = max((mode for mode in speed if mode.startswith("embree")), key=speed.get)
        ours = [f"{speed['kdray ' + precision]:.2f} (**{speed['kdray ' + precision] / speed[best]:.2f}**)"
                for precision in PRECISIONS]
        lines.append([mesh, query, best.removeprefix("embree "), f"{speed[best]:.2f}", *ours])
    write_section("hits", f"""
{conditions(command)} Millions of random rays a second; in brackets as a multiple of the faster of Embree's two ways.

{table(['mesh', 'query', "Embree's faster way", 'Mrays/s', *PRECISIONS], lines)}

Parities of counts in `exact`, on closed meshes:

{table(['mesh', 'rays', 'wrong parities'], parities)}
""")


# ---- Pictures and the kernels ----


def pictures(rows, command):
    lines = [[row["mesh"], row["samples"], f"{float(row['picture_s']) * 1e3:.0f}", f"{float(row['kernels_s']) * 1e3:.0f}",
              f"**{float(row['ratio']):.2f}**", f"{float(row['encoding_s']) * 1e3:.1f}"] for row in rows]
    write_section("pictures", f"""
{conditions(command)} Milliseconds of one thread.

{table(['mesh', 'samples', 'picture', "its rays in the kernels", 'ratio', 'encoding of the PNG'], lines)}
""")


# ---- HTTP ----

PARTS = {"trace": "#00798c", "parse": "#edae49", "encode": "#d1495b", "queue": "#8d99ae", "socket": "#adb5bd"}
OVERHEAD = {"npy": ("echo", 1.5), "json": ("python", 0.2), "picture": ("python", 1.0)}
MEMORY = {"npy": 2, "json": 3}


def http(folder, command):
    def read(name):
        with open(os.path.join(folder, name), newline="") as file:
            return list(csv.DictReader(file))

    parts = defaultdict(list)
    for row in read("http.csv"):
        parts[row["case"], int(row["threads"]), row["part"]].append(float(row["value"]))
    at = {key: median(values) for key, values in parts.items()}
    inside = {(row["what"], int(row["threads"])): float(row["ms"]) for row in read("in_process.csv")}
    peak = {(row["case"], int(row["threads"])): (float(row["peak"]), float(row["body"])) for row in read("memory.csv")}
    keys = list(dict.fromkeys((case, threads) for case, threads, _ in at))

    lines, bars = [], defaultdict(list)
    for case, threads in keys:
        of = lambda part: at.get((case, threads, part), 0.0)  # noqa: E731
        over = of("total") - of("trace")
        shares = {part: of(part) for part in PARTS if part != "socket"}
        shares["socket"] = max(0.0, of("total") - sum(shares.values()))
        for part, value in shares.items():
            bars[part].append(value)
        measure, most = OVERHEAD[case.split()[0]]
        used, body = peak[case, threads]
        lines.append([
            case, str(threads), f"{inside[case, threads]:.1f}",
            *(f"{value:.1f}" for value in (of("first"), of("total"), of("trace"), of("parse"), of("encode"), shares["socket"])),
            f"{over:.1f}", f"{of(measure):.1f} ({measure})", f"**{over / of(measure):.2f}** (at most {most})",
            f"{used / 1e6:.0f} of {body / 1e6:.0f} MB, **{used / body:.2f}** (at most {MEMORY[case.split()[0]]})" if body > 1000 else "–"])

    figure, axes = plt.subplots(figsize=(9, 0.42 * len(keys) + 1.4))
    left = [0.0] * len(keys)
    for part, color in PARTS.items():
        axes.barh(range(len(keys)), bars[part], left=left, color=color, label=part)
        left = [a + b for a, b in zip(left, bars[part])]
    for i, (case, threads) in enumerate(keys):
        axes.plot([inside[case, threads]] * 2, [i - 0.45, i + 0.45], color="black", linewidth=1.4,
                  label="in process" if i == 0 else None)
    axes.set_yticks(range(len(keys)), [f"{case}, {threads} thread{'s' * (threads > 1)}" for case, threads in keys], fontsize=8)
    axes.invert_yaxis()
    axes.set(xlabel="milliseconds", title="1,000,000 rays and 1024 x 1024 pixels over HTTP")
    axes.legend(fontsize=8)
    save(figure, "http.svg")

    size = at["picture", keys[0][1], "size"], at["picture", keys[0][1], "size_zlib6"]
    write_section("http", f"""
{conditions(command)} Medians, in milliseconds. The picture's PNG has {size[0]:,.0f} bytes, {size[0] / size[1]:.2f} of what
`zlib.compress(filtered rows, 6)` gives.

{table(['', 'threads', 'in process', 'first', 'total', 'trace', 'parse', 'encode', 'rest', 'overhead', 'measure', 'ratio', 'memory'], lines)}

![Where the time of a request goes](../../docs/http.svg)
""")
