#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Every source file names its licence in its first three lines. REUSE.toml names it for the rest."""
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LICENCE = "SPDX-License-Identifier: Apache-2.0"
# Formats without comments, pages of text, and the files of the licence itself.
EXEMPT_ENDINGS = {".md", ".json", ".png", ".svg", ".typed"}
# Bytes that a fuzzer found: they stay as they are.
EXEMPT_FOLDERS = ("tests/fuzz/corpus/",)
EXEMPT = {"LICENSE", "REUSE.toml", "package/copyright", "package/deb/conffiles"}


def files():
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode != 0:
        sys.exit(77)  # no checkout: skipped
    return [f for f in listed.stdout.splitlines() if (ROOT / f).is_file()]


def main():
    faults = 0
    for name in files():
        if name in EXEMPT or name.startswith(EXEMPT_FOLDERS) or Path(name).suffix in EXEMPT_ENDINGS:
            continue
        head = (ROOT / name).read_text(encoding="utf-8").splitlines()[:3]
        if not any(LICENCE in line for line in head):
            print(f"{name}: its first three lines do not say {LICENCE!r}")
            faults += 1
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
