#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the manual page kdrayd(8) from what `kdrayd --help` prints: manual_of_help.py KDRAYD OUTPUT"""
import os
import re
import subprocess
import sys
from pathlib import Path

EXPLANATION = """.SH ENVIRONMENT
Every option may also be set in the environment: \\fB\\-\\-data\\-dir\\fR as \\fBKDRAY_DATA_DIR\\fR. The
command line takes precedence. The service of systemd reads \\fI/etc/default/kdrayd\\fR.
.SH SIGNALS
.TP
\\fBSIGTERM\\fR, \\fBSIGINT\\fR
Finish the requests in work, refuse others, and exit with 0.
.TP
\\fBSIGHUP\\fR
Read the token file again. An invalid file changes nothing.
.SH EXIT STATUS
.TP
\\fB0\\fR
after a signal
.TP
\\fB1\\fR
the daemon could not start; one line on standard error says why
.TP
\\fB2\\fR
an invalid option
.SH FILES
.TP
\\fI/var/lib/kdray\\fR
meshes and trees of the service of systemd
.SH SEE ALSO
\\fBkdray\\fR(1). The running daemon serves its contract at \\fI/docs\\fR.
"""


def roff(text):
    text = text.replace("\\", "\\e").replace("-", "\\-")
    return re.sub(r"^([.'])", r"\\&\1", text, flags=re.MULTILINE)


def options(help_text):
    """(names, value, description) of every option."""
    found = []
    for line in help_text.splitlines():
        if match := re.match(r"  (-\S+)(?: (.*?))?(?: {2,}(.*))?$", line):
            found.append([match[1], match[2] or "", match[3] or ""])
        elif found and re.match(r" {10,}\S", line):
            found[-1][2] += " " + line.strip()
    return found


def main():
    program, output = sys.argv[1:]
    # Neither the machine's variables nor its number of processors belong into the page.
    environment = {name: value for name, value in os.environ.items() if not name.startswith("KDRAY_")}
    text = subprocess.run([program, "--help"], check=True, capture_output=True, text=True, env=environment).stdout
    version = subprocess.run([program, "--version"], check=True, capture_output=True, text=True).stdout.split()[-1]
    page = (f'.TH KDRAYD 8 "" "kdray {version}" "System Administration"\n'
            ".SH NAME\nkdrayd \\- ray queries and renders over triangle meshes, by HTTP\n"
            ".SH SYNOPSIS\n\\fBkdrayd\\fR [\\fIOPTION\\fR...]\n"
            ".SH DESCRIPTION\n"
            "kdrayd listens on one address and answers ray and point queries over meshes that clients\n"
            "upload, and renders them. When it serves, it prints one line on standard output:\n"
            "\\fIkdrayd listening on http://HOST:PORT\\fR. Logs go to standard error, one JSON object a line.\n"
            ".SH OPTIONS\n")
    listed = options(text)
    if len(listed) < 10:
        sys.exit("manual_of_help.py: the help of kdrayd has another form")
    for names, value, description in listed:
        value = re.sub(r"\s*\(Env:\w+\)", "", value).strip()
        if names == "--threads":
            value = re.sub(r"=.*|\[.*", "", value).strip()
        default = re.fullmatch(r"(\S+?)(?:=(.+)| \[(.+)\])", value)
        if default:
            value = default[1]
            description += f" (default {default[2] or default[3]})"
        head = ", ".join(f"\\fB{roff(name)}\\fR" for name in names.split(","))
        page += f".TP\n{head} \\fI{roff(value)}\\fR\n{roff(description.strip())}\n"
    Path(output).write_text(page + EXPLANATION, encoding="utf-8")


if __name__ == "__main__":
    main()
