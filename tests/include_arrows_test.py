#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Includes follow the arrows that HACKING.md draws ("Layers"), and libraries stay in the files that it names.

The folder of a file is the longest row of the table that its path begins with, as a folder or as a file
(`tree.h` stands for its .cc as well). Prints, with --counts, how often each folder includes each other.
"""
import collections
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LAYERS = ("core", "api", "server", "clients")
# Headers that are installed are included by the names that they have then.
INSTALLED = {"kdray/": "clients/cpp/client/include/kdray/"}
LIBRARIES = {
    "oneTBB": r"oneapi/tbb|tbb/",
    "OpenSSL": r"openssl/",
    "GMP": r"gmp",
    "stb": r"stb/",
    "libdeflate": r"libdeflate",
    "zlib": r"zlib",
    "libzstd": r"zstd",
    "meshoptimizer": r"meshoptimizer",
    "nlohmann-json": r"nlohmann/",
    "cpp-httplib": r"httplib",
    "cairo": r"cairo",
    "libcurl": r"curl/",
    "pugixml": r"pugixml",
    "CLI11": r"CLI/",
    "prometheus-cpp": r"prometheus/",
    "spdlog": r"spdlog/",
    "an oracle of tests": r"embree|CGAL/|gtest/|gmock/",
}


def names(cell):
    """The paths in backticks, without endings."""
    return [re.sub(r"\.h$", "", name) for name in re.findall(r"`([^`]+)`", cell)]


def tables():
    """The rows of HACKING.md's two tables: folder -> folders, library -> places."""
    text = (ROOT / "HACKING.md").read_text()
    section = text[text.index("## Layers"):]
    section = section[:section.index("\n## ")]
    arrows, places = {}, {}
    rows = arrows
    for line in section.splitlines():
        if line.startswith("| Library"):
            rows = places
        cells = [cell.strip() for cell in line.strip("|").split("|")] if line.startswith("|") else []
        if len(cells) != 2 or cells[0] in ("Folder", "Library") or cells[0].startswith("-"):
            continue
        for name in re.sub("`", "", cells[0]).split(", "):
            rows[re.sub(r"\.h$", "", name)] = cells[1]
    folders = {}
    for folder, cell in arrows.items():
        named = names(cell)
        if match := re.match(r"all of `core` except ([^;]*);", cell):
            named = [f for f in arrows if f.startswith("core/") and f not in names(match[1])] + names(cell[match.end():])
        folders[folder] = set(named)
    return folders, {library: re.findall(r"`([^`]+)`", cell) for library, cell in places.items()}


def folder_of(path, folders):
    stem = re.sub(r"(-inl)?\.(h|cc)$", "", path)
    fitting = [f for f in folders if stem == f or path.startswith(f + "/")]
    return max(fitting, key=len, default=None)


def circle(folders):
    """A circle among the folders' arrows, or None."""
    state = {}

    def walk(folder, way):
        state[folder] = "open"
        for to in sorted(folders[folder]):
            if state.get(to) == "open":
                return way[way.index(to):] + [to]
            if to not in state and (found := walk(to, way + [to])):
                return found
        state[folder] = "done"
        return None

    for folder in folders:
        if folder not in state and (found := walk(folder, [folder])):
            return found
    return None


def main():
    folders, places = tables()
    faults = [f"HACKING.md: {f} may include {to}, which has no row" for f in folders for to in folders[f] - set(folders)]
    if not faults and (round_trip := circle(folders)):
        faults.append("HACKING.md: the arrows go in a circle: " + " -> ".join(round_trip))
    faults += [f"HACKING.md: {library} is a library this test does not know" for library in set(places) - set(LIBRARIES)]
    counts = collections.Counter()
    for layer in LAYERS:
        for path in sorted((ROOT / layer).rglob("*")):
            if path.suffix not in (".h", ".cc"):
                continue
            name = path.relative_to(ROOT).as_posix()
            own = folder_of(name, folders)
            for number, line in enumerate(path.read_text().splitlines(), 1):
                if not (match := re.match(r'\s*#\s*include ([<"])([^">]+)[">]', line)):
                    continue
                place, header = f"{name}:{number}", match[2]
                for installed, folder in INSTALLED.items():
                    if header.startswith(installed):
                        header = folder + header.removeprefix(installed)
                if match[1] == '"' and header.split("/")[0] in LAYERS:
                    to = folder_of(header, folders)
                    counts[own, to] += own != to
                    if to is None or (own != to and to not in folders.get(own, set())):
                        faults.append(f"{place}: {own} may not include {to} ({header})")
                for library, pattern in LIBRARIES.items():
                    if re.match(pattern, header) and not any(name == p or (p.endswith("/") and name.startswith(p))
                                                             for p in places.get(library, [])):
                        faults.append(f"{place}: {library} is not for this file ({header})")
    if "--counts" in sys.argv:
        for (own, to), count in sorted(counts.items()):
            if count:
                print(f"{own} -> {to}: {count}")
    for fault in faults:
        print(fault)
    print(f"{sum(counts.values())} includes between folders, {len(faults)} against HACKING.md")
    return 1 if faults or not counts else 0


if __name__ == "__main__":
    sys.exit(main())
