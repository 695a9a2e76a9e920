# SPDX-License-Identifier: Apache-2.0
"""What all reports of benchmarks share: conditions, tables, plots, sections of README.md."""
import os
import re
import subprocess
import sys
from math import exp, log

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import yaml  # noqa: E402

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
with open(os.path.join(ROOT, "api", "openapi.yaml"), encoding="utf-8") as contract:
    SCHEMAS = yaml.safe_load(contract)["components"]["schemas"]
PRECISIONS = SCHEMAS["Precision"]["enum"][1:]  # all but auto
LARGE = 10000  # triangles of a mesh on which builds are compared
BUILDS = SCHEMAS["Build"]["enum"][1:]
COLORS = dict(zip(PRECISIONS, ["#d1495b", "#00798c", "#edae49", "#30638e"]))
BUILD_COLORS = dict(zip(BUILDS, ["#00798c", "#30638e", "#edae49", "#d1495b", "#6a4c93", "#8d99ae"]))

plt.rcParams.update({"font.size": 9, "axes.grid": True, "grid.alpha": 0.3, "svg.hashsalt": "kdray",
                     "axes.spines.top": False, "axes.spines.right": False})


def conditions(command):
    """The conditions of the measurement: machine, command, commit."""
    with open("/proc/cpuinfo") as file:
        model = re.search(r"model name\s*:\s*(.*)", file.read())
    def git(*args):
        return subprocess.run(["git", *args], cwd=ROOT, capture_output=True, text=True)
    commit = git("rev-parse", "--short=12", "HEAD").stdout.strip() or "unknown"
    # The reports' own output does not count as a change.
    changed = git("diff", "--quiet", "HEAD", "--", ".", ":!docs", ":!tests/bench/README.md").returncode != 0
    load = os.getloadavg()
    return (f"`{command}`, at commit {commit}{' with changes' if changed else ''}; {model[1] if model else 'unknown processor'}, "
            f"{os.cpu_count()} threads; load average at the end {load[0]:.1f} (one minute), {load[2]:.1f} (fifteen).")


def save(figure, name):
    figure.tight_layout()
    figure.savefig(os.path.join(ROOT, "docs", name), metadata={"Date": None})
    plt.close(figure)


def wrap(text, columns=100):
    """Markdown with its prose broken at `columns`; tables, images and headings stay as they are."""
    wrapped = []
    for paragraph in text.strip().split("\n\n"):
        if paragraph.startswith(("|", "!", "#")):
            wrapped.append(paragraph)
            continue
        lines = [""]
        for word in re.findall(r"(?:`[^`]*`|[^\s`])+", paragraph):
            if lines[-1] and len(lines[-1]) + 1 + len(word) > columns:
                lines.append("")
            lines[-1] += (" " if lines[-1] else "") + word
        wrapped.append("\n".join(lines))
    return "\n\n".join(wrapped)


def write_section(name, text):
    path = os.path.join(ROOT, "tests", "bench", "README.md")
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    with open(path) as file:
        old = file.read()
    if begin not in old:
        sys.exit(f"report.py: {path} has no place for {name}")
    head, rest = old.split(begin, 1)
    tail = rest.split(end, 1)[1]
    with open(path, "w") as file:
        file.write(f"{head}{begin}\n{wrap(text)}\n{end}{tail}")


def write_page(name, sections):
    """Replaces what stands between the marks of these sections in a page of docs."""
    path = os.path.join(ROOT, "docs", name)
    with open(path) as file:
        text = file.read()
    for section, body in sections.items():
        begin, end = f"<!-- {section}: begin -->", f"<!-- {section}: end -->"
        if begin not in text:
            sys.exit(f"{path} has no place for {section}")
        head, rest = text.split(begin, 1)
        text = f"{head}{begin}\n{body}\n{end}{rest.split(end, 1)[1]}"
    with open(path, "w") as file:
        file.write(text)


def table(header, rows):
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def geometric_mean(values):
    values = list(values)
    return exp(sum(map(log, values)) / len(values)) if values else float("nan")


def rate(count, rays):
    """A share; for a count of 0, its 95% bound."""
    if rays == 0:
        return "–"
    return f"{count / rays:.2g}" if count else f"0 (< {3 / rays:.1g})"


# ---- The trade-off ----
