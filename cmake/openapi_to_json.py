#!/usr/bin/env python3
"""Turns api/openapi.yaml into one JSON document: openapi_to_json.py INPUT.yaml OUTPUT.json

Examples that the YAML points to with `externalValue` are put in as `value`, for the daemon serves no files.
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


def with_examples(value, folder):
    if isinstance(value, dict):
        value = {key: with_examples(member, folder) for key, member in value.items()}
        if "externalValue" in value:
            value["value"] = json.loads((folder / value.pop("externalValue")).read_text(encoding="utf-8"))
        return value
    if isinstance(value, list):
        return [with_examples(element, folder) for element in value]
    return value


def main():
    source, target = Path(sys.argv[1]), Path(sys.argv[2])
    document = yaml.load(source.read_text(encoding="utf-8"), Loader)
    text = json.dumps(with_examples(document, source.parent), ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    target.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
