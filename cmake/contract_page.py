#!/usr/bin/env python3
"""Writes what people read of the contract, as HTML: contract_page.py OPENAPI.yaml OUTPUT.html

Every path and method of the document with its parameters, body and answers: the part of the page /docs that
server/pages/contract_page.cc puts before the table of problems.
"""
import html
import json
import sys
from pathlib import Path

import yaml

METHODS = ("get", "post", "delete")


def escape(text):
    return html.escape(text).replace("&#x27;", "&#39;")


def code(text):
    return f"<code>{escape(text)}</code>"


def text_of(value):
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False, separators=(",", ":"))


def paragraphs(text):
    """Blank lines separate paragraphs; nothing else is marked up."""
    return "".join(f"<p>{escape(part.strip(chr(10)))}</p>\n" for part in text.split("\n\n") if part.strip("\n"))


def table(head, rows):
    """The cells are HTML already."""
    if not rows:
        return ""
    lines = ["".join(f"<td>{cell}</td>" for cell in row) for row in rows]
    head = "".join(f"<th>{name}</th>" for name in head)
    return f"<table>\n<tr>{head}</tr>\n" + "".join(f"<tr>{line}</tr>\n" for line in lines) + "</table>\n"


class Page:
    def __init__(self, document):
        self.document = document

    def resolve(self, value):
        if "$ref" not in value:
            return value
        found = self.document
        for step in value["$ref"].removeprefix("#/").split("/"):
            found = found[step]
        return found

    def make(self):
        info = self.document["info"]
        parts = [f"<h1>{escape(info['title'])} {escape(info['version'])}</h1>\n", paragraphs(info["description"]),
                 '<p>For programs: <a href="/openapi.json">/openapi.json</a></p>\n']
        for path, item in self.document["paths"].items():
            parts += [self.operation(method, path, item) for method in METHODS if method in item]
        return "".join(parts)

    def operation(self, method, path, item):
        operation = item[method]
        parameters = item.get("parameters", []) + operation.get("parameters", [])
        answers = operation.get("responses", {})
        return "".join([
            f"<h2>{code(f'{method.upper()} {path}')}</h2>\n",
            f"<p><strong>{escape(operation.get('summary', ''))}</strong></p>\n",
            paragraphs(operation.get("description", "")),
            table(("parameter", "in", "value", "meaning"), [self.parameter(self.resolve(p)) for p in parameters]),
            self.body(operation),
            table(("status", "answer"),
                  [(code(status), escape(self.resolve(answer).get("description", "")))
                   for status, answer in answers.items()])])

    def parameter(self, parameter):
        schema = self.resolve(parameter.get("schema", {}))
        meaning = " ".join(filter(None, (parameter.get("description"), schema.get("description"))))
        return code(parameter["name"]), parameter["in"], escape(self.values(schema)), escape(meaning)

    @staticmethod
    def values(schema):
        kind = ", ".join(map(text_of, schema["enum"])) if "enum" in schema else text_of(schema.get("type", ""))
        for key, label in (("minimum", "from"), ("maximum", "to"), ("default", "default")):
            if key in schema:
                kind += f"; {label} {text_of(schema[key])}"
        return kind

    def body(self, operation):
        if "requestBody" not in operation:
            return ""
        body = self.resolve(operation["requestBody"])
        types = ", ".join(map(code, body.get("content", {})))
        return f"<p>Body: {escape(body.get('description', ''))}{f' ({types})' if types else ''}</p>\n"


def main():
    source, target = map(Path, sys.argv[1:])
    target.write_text(Page(yaml.safe_load(source.read_text(encoding="utf-8"))).make(), encoding="utf-8")


if __name__ == "__main__":
    main()
