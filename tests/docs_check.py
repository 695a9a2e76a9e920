#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Documentation that names what is not there misleads: this finds it.

Checked in every Markdown file: relative links; paths in `backticks` (with * and {a,b}) that begin
with a folder of ours or are files of the top level; and shell lines ("$ command") in code blocks:
scripts must exist and be executable, presets must be defined. A source file in backticks without
its folder (`ray_order.h`) must exist in some folder. Checked in every source file: a Markdown file
that a comment points to must exist, a test of the catalogue (N01 and so on) must stand in
tests/README.md, and a file that begins with #! must be executable.
"""
import itertools
import json
import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SOURCE_NAME = r"[\w-]+\.(h|cc|inc|cmake|py|sh|js|css)"
BUILT = ("build/", "out/", ".git/")  # made by the tools, not part of the repository


def tracked_files():
    listed = subprocess.run(["git", "ls-files", "--cached", "--others", "--exclude-standard"], cwd=ROOT,
                            capture_output=True, text=True)
    if listed.returncode == 0:
        return sorted(ROOT / line for line in listed.stdout.splitlines() if (ROOT / line).is_file())
    return sorted(p for p in ROOT.rglob("*") if p.is_file() and not p.relative_to(ROOT).as_posix().startswith(BUILT))


def expand_braces(text):
    parts = re.split(r"\{([^{}]*)\}", text)
    choices = [[part] if i % 2 == 0 else part.split(",") for i, part in enumerate(parts)]
    return ["".join(choice) for choice in itertools.product(*choices)]


def exists(path):
    path = path.removeprefix("./")
    return any(ROOT.glob(path.rstrip("/"))) if "*" in path else (ROOT / path).exists()


class Checker:
    def __init__(self):
        self.faults = []
        self.checked = 0
        self.top = {p.name for p in ROOT.iterdir() if p.name not in (".git", "build", "out")}
        presets = json.loads((ROOT / "CMakePresets.json").read_text())
        self.catalogue = set(re.findall(r"^\| (N\d\d) ", (ROOT / "tests/README.md").read_text(), re.MULTILINE))
        self.source_names = {p.name for p in tracked_files() if re.fullmatch(SOURCE_NAME, p.name)}
        self.presets = {p["name"] for p in presets["configurePresets"] if not p.get("hidden")}

    def expect(self, condition, place, text):
        self.checked += 1
        if not condition:
            self.faults.append(f"{place}: {text}")

    def path_in_backticks(self, token, place):
        if not re.fullmatch(r"[\w./*{},-]+", token) or token.startswith(("/", "..")) or token.startswith(BUILT):
            return
        first = token.removeprefix("./").split("/")[0]
        is_ours = "/" in token and first in self.top
        is_top_level = "/" not in token and re.search(r"\.(md|txt|json)$|^Dockerfile$", token)
        if is_ours or is_top_level:
            for path in expand_braces(token):
                self.expect(exists(path), place, f"`{token}`: there is no {path}")
        elif re.fullmatch(SOURCE_NAME, token) and "NAME" not in token:
            self.expect(token in self.source_names, place, f"there is no source file {token}")

    def shell_line(self, line, place):
        for preset in re.findall(r"--preset[ =](\S+)", line):
            self.expect(preset in self.presets, place, f"no preset {preset}")
        for word in line.split():
            word = word.strip("'\"")
            if word.startswith(BUILT) or "/" not in word or word.split("/")[0] not in self.top:
                continue
            self.expect(exists(word), place, f"no {word}")
            if word == line.split()[0]:
                self.expect(os.access(ROOT / word, os.X_OK), place, f"{word} cannot be executed")

    def markdown(self, path):
        in_block = False
        for number, line in enumerate(path.read_text().splitlines(), 1):
            place = f"{path.relative_to(ROOT)}:{number}"
            if line.startswith("```"):
                in_block = not in_block
            elif in_block:
                if line.startswith("$ "):
                    self.shell_line(line[2:], place)
            else:
                for token in re.findall(r"`([^`]+)`", line):
                    self.path_in_backticks(token, place)
                for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", line):
                    if not re.match(r"\w+:", target):
                        self.expect((path.parent / target).exists(), place, f"link to {target}, which is not there")

    def source(self, path):
        try:
            text = path.read_text()
        except UnicodeDecodeError:
            return
        if text.startswith("#!"):
            self.expect(os.access(path, os.X_OK), path.relative_to(ROOT), "a command that cannot be executed")
        for number, line in enumerate(text.splitlines(), 1):
            place = f"{path.relative_to(ROOT)}:{number}"
            for name in re.findall(r"\b[A-Z]{3,}\.md\b", line):
                self.expect((ROOT / name).exists() or (path.parent / name).exists(), place, f"there is no {name}")
            if path.parent.is_relative_to(ROOT / "tests"):
                for name in re.findall(r"\bN\d\d(?![a-z0-9])", line):
                    self.expect(name in self.catalogue, place, f"{name} is not in the catalogue of tests/README.md")

    def versions(self):
        """The programs, both packages and the changelog's last release have one version."""
        version = re.search(r"project\(kdray VERSION ([\d.]+)", (ROOT / "CMakeLists.txt").read_text())[1]
        for place, pattern in {"clients/python/kdray/version.py": r'VERSION = "(.*)"',
                               "clients/js/package.json": r'"version": "(.*)"',
                               "CHANGELOG.md": r"## (\d\S*)"}.items():
            found = re.search(pattern, (ROOT / place).read_text())
            self.expect(found and found[1] == version, place, f"the version is not {version}, that of CMakeLists.txt")


def main():
    checker = Checker()
    checker.versions()
    for path in tracked_files():
        if path.suffix == ".md":
            checker.markdown(path)
        elif path != Path(__file__).resolve():
            checker.source(path)
    for fault in checker.faults:
        print(fault)
    print(f"{checker.checked} references checked, {len(checker.faults)} lead nowhere")
    return 1 if checker.faults or not checker.checked else 0


if __name__ == "__main__":
    sys.exit(main())
