#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Documentation that is easy to read: decisions are short, and lines fit 100 columns.

Checked: each decision of DESIGN.md has at most 300 words, its context, choice, rejected alternatives
and consequence, in this order; decisions are numbered without gaps; and no line of a Markdown
file, prose or code, is longer than 100 columns. Exempt are tables and lines with a link.
"""
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MAX_WORDS = 300
MAX_COLUMNS = 100
PARTS = ["Context", "Choice", "Rejected", "Consequence"]


def markdown_files():
    listed = subprocess.run(["git", "ls-files", "--cached", "--others", "--exclude-standard", "*.md"],
                            cwd=ROOT, capture_output=True, text=True)
    if listed.returncode == 0:
        return [ROOT / line for line in listed.stdout.splitlines() if (ROOT / line).is_file()]
    outside = {"build", "out", ".git"}
    return [p for p in ROOT.rglob("*.md") if p.relative_to(ROOT).parts[0] not in outside]


def decision_faults(text):
    """Faults of DESIGN.md's text, one line each."""
    faults = []
    decisions = re.split(r"^## ", text, flags=re.MULTILINE)[1:]
    for number, decision in enumerate(decisions, 1):
        title, body = decision.split("\n", 1)
        if not title.startswith(f"{number}. "):
            faults.append(f"decision {number} is called {title!r}")
        words = len(body.split())
        if words > MAX_WORDS:
            faults.append(f"decision {title!r} has {words} words; at most {MAX_WORDS} are allowed")
        if re.findall(r"^\*\*(\w+)\.\*\*", body, re.MULTILINE) != PARTS:
            faults.append(f"decision {title!r} does not consist of {', '.join(PARTS)}")
    return faults if decisions else ["there is no decision"]


def line_faults(text):
    """Faults of a Markdown file's lines: pairs of a line number and a text."""
    faults = []
    in_block = False
    for number, line in enumerate(text.splitlines(), 1):
        if line.lstrip().startswith("```"):
            in_block = not in_block
        has_link = not in_block and ("](" in line or "://" in line)
        exempt = has_link or line.lstrip().startswith("|")
        if not exempt and len(line) > MAX_COLUMNS:
            faults.append((number, f"{len(line)} columns; at most {MAX_COLUMNS} are allowed"))
    return faults


def self_test():
    """The checks find what they look for."""
    good = "## 1. A\n" + "".join(f"**{part}.** Words.\n" for part in PARTS)
    assert not decision_faults(good)
    assert decision_faults(good + "word " * MAX_WORDS)
    assert decision_faults(good.replace("**Rejected.**", ""))
    assert decision_faults(good.replace("1.", "2."))
    assert decision_faults("")
    long_line = "x" * MAX_COLUMNS
    assert not line_faults(f"{long_line}\n| {long_line} |\n[{long_line}](y)\n```\n{long_line}\n```\n")
    for fault in (f"```\n```\n{long_line}x", f"\n```\n{long_line}x\n```"):
        assert line_faults(fault) == [(3, "101 columns; at most 100 are allowed")]


def main():
    self_test()
    files = markdown_files()
    faults = [f"DESIGN.md: {fault}" for fault in decision_faults((ROOT / "DESIGN.md").read_text())]
    for path in files:
        name = path.relative_to(ROOT)
        faults += [f"{name}:{line}: {fault}" for line, fault in line_faults(path.read_text())]
    for fault in faults:
        print(fault)
    print(f"{len(files)} Markdown files checked, {len(faults)} faults")
    return 1 if faults or not files else 0


if __name__ == "__main__":
    sys.exit(main())
