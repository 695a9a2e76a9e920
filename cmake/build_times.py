#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Processor seconds of the objects of a build, the most expensive ones first.

    cmake/build_times.py [--build build/release] [--most 20] [PATTERN...]

Runs the commands of compile_commands.json one by one, without ccache and without touching the
build's own objects. The build folder must have been built once, for its generated headers. PATTERN
is a regular expression searched in the source's path: `clients/`, `tests/.*_test`. Without one,
everything is compiled, header checks excepted: minutes.
"""

import argparse
import collections
import json
import os
import pathlib
import re
import shlex
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent


def compile_arguments(entry, output):
    """The arguments of a compile command, with another output and no compiler launcher."""
    arguments = shlex.split(entry["command"])
    if pathlib.Path(arguments[0]).name == "ccache":
        arguments = arguments[1:]
    arguments[arguments.index("-o") + 1] = output
    return arguments


def processor_seconds(entry, output):
    """User and system time of one compilation. Raises CalledProcessError if it fails."""
    arguments = compile_arguments(entry, output)
    process = subprocess.Popen(arguments, cwd=entry["directory"])
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise subprocess.CalledProcessError(process.returncode, arguments)
    return usage.ru_utime + usage.ru_stime


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build/release")
    parser.add_argument("--most", type=int, default=20, help="how many objects are printed")
    parser.add_argument("patterns", nargs="*", metavar="PATTERN")
    options = parser.parse_args()

    with open(options.build / "compile_commands.json", encoding="utf-8") as file:
        entries = json.load(file)
    seconds = []  # (seconds, source); a source that two targets compile is there twice
    with tempfile.TemporaryDirectory() as folder:
        for entry in entries:
            source = os.path.relpath(entry["file"], ROOT)
            wanted = [re.search(pattern, source) for pattern in options.patterns]
            if "check_headers" in source or (wanted and not any(wanted)):
                continue
            seconds.append((processor_seconds(entry, os.path.join(folder, "object.o")), source))
            if sys.stderr.isatty():
                print(f"\r{len(seconds)} objects", end="", file=sys.stderr)
    if not seconds:
        sys.exit("no source matches")

    by_folder = collections.Counter()
    for spent, source in seconds:
        by_folder["/".join(source.split("/")[:2])] += spent
    for spent, source in sorted(seconds, reverse=True)[: options.most]:
        print(f"{spent:8.1f} s  {source}")
    print()
    for folder, spent in by_folder.most_common():
        print(f"{spent:8.1f} s  {folder}/")
    print(f"{sum(by_folder.values()):8.1f} s  all {len(seconds)} objects")


if __name__ == "__main__":
    main()
