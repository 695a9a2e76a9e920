#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""No function that the whole program may share was compiled for more than the baseline.

An inline function of a shared header that the compiler leaves out of line in isa_avx2.cc or isa_avx512.cc becomes a weak
symbol, and the linker may keep that copy for the whole program: an illegal instruction on older processors. Usage: isa_symbols_test.py ARCHIVE
"""
import re
import shutil
import subprocess
import sys

SKIP = 77


def main(archive):
    if shutil.which("objdump") is None:
        print("objdump is not there")
        return SKIP
    listing = subprocess.run(["objdump", "-d", "-C", "--no-show-raw-insn", archive], check=True, capture_output=True,
                             text=True).stdout
    member = function = ""
    seen, bad = set(), set()
    for line in listing.splitlines():
        if match := re.match(r"(\S+\.o):\s+file format", line):
            member = match[1]
        elif match := re.match(r"[0-9a-f]+ <(.*)>:$", line):
            function = match[1]
        elif member.startswith(("isa_avx2", "isa_avx512")):
            if match := re.match(r"\s+[0-9a-f]+:\s+(v\w+)\s", line):
                seen.add(member)
                # Functions of the instruction set's own namespace, and templates over its types.
                if "::isa_avx" not in function:
                    bad.add(f"{member}: {function}: {match[1]}")
    if not seen and "isa_avx2" in listing:
        bad.add("no vector instruction was found at all: the test looks at the wrong thing")
    for line in sorted(bad):
        print(line)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
