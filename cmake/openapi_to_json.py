#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Turns api/openapi.yaml into one JSON document: openapi_to_json.py INPUT.yaml OUTPUT.json

Examples that the YAML points to with `externalValue` are put in as `value`, for the daemon serves no files. A
reference in an example stands for what it leads to in the document, so that lists of names are written once.
"""
import json
import sys
from pathlib import Path

import yaml


class Loader(yaml.SafeLoader):
    """Rejects repeated keys, of which YAML would use the last."""

    def construct_mapping(self, node, deep=False):
        seen = set()
        for key, _ in node.value:
            if key.tag != "tag:yaml.org,2002:merge" and key.value in seen:
                raise yaml.constructor.ConstructorError(None, None, f"the key {key.value!r} is repeated", key.start_mark)
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def look_up(document, reference):
    for step in reference.removeprefix("#/").split("/"):
        document = document[step]
    return document


def with_references(value, document):
    if isinstance(value, dict):
        if value.keys() == {"$ref"}:
            return look_up(document, value["$ref"])
        return {key: with_references(member, document) for key, member in value.items()}
    if isinstance(value, list):
        return [with_references(element, document) for element in value]
    return value


def with_examples(value, folder, document):
    if isinstance(value, dict):
        value = {key: with_examples(member, folder, document) for key, member in value.items()}
        if "externalValue" in value:
            example = json.loads((folder / value.pop("externalValue")).read_text(encoding="utf-8"))
            value["value"] = with_references(example, document)
        return value
    if isinstance(value, list):
        return [with_examples(element, folder, document) for element in value]
    return value


def load(source):
    """The whole document; `source` is the path of the YAML."""
    document = yaml.load(source.read_text(encoding="utf-8"), Loader)
    return with_examples(document, source.parent, document)


def main():
    source, target = Path(sys.argv[1]), Path(sys.argv[2])
    text = json.dumps(load(source), ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    target.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
