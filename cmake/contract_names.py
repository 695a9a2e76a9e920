#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes a C++ header with the names that api/openapi.yaml lists:

    contract_names.py enums|help INPUT.yaml OUTPUT.h NAMESPACE ENUM=POINTER...

POINTER leads to a schema with `enum` as a JSON pointer does, but to an element of a list by its `name`. `enums` makes an enumeration of each, with its names on the wire;
`help` makes the text that offers them to the user of a command, and their list.
"""
import re
import sys
from pathlib import Path

import yaml


def look_up(document, pointer):
    for step in pointer.strip("/").split("/"):
        step = step.replace("~1", "/").replace("~0", "~")
        if isinstance(document, list):
            document = next(element for element in document if element.get("name") == step)
        else:
            document = document[step]
    return document


def enumerator(name):
    return "k" + "".join(part[:1].upper() + part[1:] for part in re.split("[-_]", name))


def enumeration(enum, schema):
    names = schema["enum"]
    return f"""
enum class {enum} : std::uint8_t {{ {", ".join(map(enumerator, names))} }};
inline constexpr std::array<std::string_view, {len(names)}> k{enum}Names = {{
    {", ".join(f'"{name}"' for name in names)}}};
constexpr std::string_view Name({enum} value) {{
  return k{enum}Names[static_cast<std::size_t>(value)];
}}
"""


def help_text(enum, schema):
    *names, last = schema["enum"]
    text = f"{', '.join(names)} or {last}"
    if "default" in schema:
        text += f": {schema['default']} when left out"
    return f"""
inline constexpr char k{enum}Help[] = "{text}";
inline constexpr char k{enum}Values[] = "{",".join(schema["enum"])}";
"""


def main():
    form, source, target, namespace, *enums = sys.argv[1:]
    document = yaml.safe_load(Path(source).read_text(encoding="utf-8"))
    write = {"enums": enumeration, "help": help_text}[form]
    parts = [write(enum, look_up(document, pointer)) for enum, pointer in (pair.split("=", 1) for pair in enums)]
    text = f"""// Made by cmake/contract_names.py of api/openapi.yaml. Do not edit.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace {namespace} {{
{"".join(parts)}
}}  // namespace {namespace}
"""
    # An unchanged file is not written, so nothing is compiled again.
    target = Path(target)
    if not target.exists() or target.read_text(encoding="utf-8") != text:
        target.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
