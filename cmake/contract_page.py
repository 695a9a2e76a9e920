#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes what people read of the contract, as HTML: contract_page.py OPENAPI.yaml OUTPUT.html

A table of contents; every operation with an example, its parameters, its body and its answers with
all their fields; the schemas and headers that these refer to. server/pages/contract_page.cc puts
the table of problems after it. Every heading has an anchor.
"""
import html
import json
import re
import sys
from pathlib import Path

import openapi_to_json

METHODS = ("get", "post", "delete")


def escape(text):
    return html.escape(text).replace("&#x27;", "&#39;")


def code(text):
    return f"<code>{escape(text)}</code>"


def marked(text):
    """The inline markup of the descriptions: `code`."""
    return re.sub(r"`([^`]+)`", lambda found: f"<code>{found[1]}</code>", escape(text))


def text_of(value):
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False, separators=(",", ":"))


def paragraphs(text):
    """Blank lines separate paragraphs."""
    return "".join(f"<p>{marked(part.strip(chr(10)))}</p>\n" for part in text.split("\n\n") if part.strip("\n"))


def heading(level, anchor, inner):
    """`inner` is HTML. The link to itself makes the anchor copyable."""
    return f'<h{level} id="{anchor}"><a href="#{anchor}">{inner}</a></h{level}>\n'


def table(head, rows):
    """The cells are HTML already. `data-label` names the column where a narrow page stacks the cells."""
    if not rows:
        return ""
    lines = ["".join(f'<td data-label="{name}">{cell}</td>' for name, cell in zip(head, row)) for row in rows]
    head = "".join(f"<th>{name}</th>" for name in head)
    return f"<table>\n<tr>{head}</tr>\n" + "".join(f"<tr>{line}</tr>\n" for line in lines) + "</table>\n"


def pretty(value, indent=""):
    """JSON with short lists and objects in one line."""
    line = json.dumps(value, ensure_ascii=False)
    if len(indent) + len(line) <= 76 or not isinstance(value, (dict, list)) or not value:
        return line
    deeper = indent + "  "
    if isinstance(value, dict):
        parts = [f"{json.dumps(key)}: {pretty(member, deeper)}" for key, member in value.items()]
        return "{\n" + ",\n".join(deeper + part for part in parts) + f"\n{indent}}}"
    return "[\n" + ",\n".join(deeper + pretty(element, deeper) for element in value) + f"\n{indent}]"


def target_of(sample):
    """Attributes with which a script repeats a curl command; none for those that need a local file, or delete."""
    if "@" in sample or "DELETE" in sample or not (url := re.search(r"\$KDRAY(/[^\s\"]*)", sample)):
        return ""
    body = re.search(r"-d '([^']*)'", sample)
    method = re.search(r"-X (\w+)", sample)
    method = method[1] if method else "POST" if body else "GET"
    attributes = f' data-method="{method}" data-url="{escape(url[1])}"'
    return attributes + (f' data-body="{escape(body[1])}"' if body else "")


class Page:
    def __init__(self, document):
        self.document = document
        self.schemas = document["components"]["schemas"]
        self.headers = document["components"]["headers"]
        self.long_lists = {}  # of parameters, to the operation that shows them
        shared = [set(answer.get("headers", {})) for answer in self.answers()]
        self.common = set.intersection(*shared)  # headers of every answer

    def resolve(self, value):
        """What a reference leads to, with the reference's own description."""
        if "$ref" not in value:
            return value
        found = self.document
        for step in value["$ref"].removeprefix("#/").split("/"):
            found = found[step.replace("~1", "/").replace("~0", "~")]
        own = {key: member for key, member in value.items() if key != "$ref"}
        return {**self.resolve(found), **own}

    def operations(self):
        for path, item in self.document["paths"].items():
            for method in METHODS:
                if method in item:
                    yield path, method, item, item[method]

    def answers(self):
        for *_, operation in self.operations():
            yield from map(self.resolve, operation["responses"].values())

    # ---- The page ----

    def make(self):
        info = self.document["info"]
        title = f"<h1>{escape(info['title'])} {escape(info['version'])}</h1>\n"
        # The main element ends after the problems.
        return (f"<header>\n{title}</header>\n{self.contents()}<main>\n{self.about(info)}{self.groups()}"
                f"{self.schema_list()}{self.header_list()}")

    def contents(self):
        lists = [("About", "about", self.sections())]
        for tag in self.document["tags"]:
            entries = [(operation["operationId"], code(f"{method.upper()} {path}"))
                       for path, method, _, operation in self.operations() if tag["name"] in operation["tags"]]
            lists.append((tag["name"].capitalize(), f"tag-{tag['name']}", entries))
        lists.append(("Schemas", "schemas", [(f"schema-{name}", escape(name)) for name in self.listed()]))
        lists += [("Headers", "headers", []), ("Problems", "problems", [])]
        lines = []
        for name, anchor, entries in lists:
            inner = "".join(f'<li><a href="#{to}">{label}</a></li>\n' for to, label in entries)
            lines.append(f'<li><a href="#{anchor}">{name}</a>{f"<ul>{chr(10)}{inner}</ul>" if inner else ""}</li>\n')
        return f'<nav aria-label="Contents">\n<ul>\n{"".join(lines)}</ul>\n</nav>\n'

    def sections(self):
        names = re.findall(r"^## (.*)$", self.document["info"]["description"], re.MULTILINE)
        return [(self.section_anchor(name), escape(name)) for name in names]

    @staticmethod
    def section_anchor(name):
        return "about-" + name.lower().replace(" ", "-")

    def about(self, info):
        first, *sections = re.split(r"^## ", info["description"], flags=re.MULTILINE)
        parts = [heading(2, "about", "About"), paragraphs(first),
                 '<p>For programs: <a href="openapi.json">/openapi.json</a></p>\n']
        for section in sections:
            name, _, text = section.partition("\n")
            parts += [heading(3, self.section_anchor(name), escape(name)), paragraphs(text)]
        return "".join(parts)

    def groups(self):
        parts = []
        for tag in self.document["tags"]:
            parts += [heading(2, f"tag-{tag['name']}", tag["name"].capitalize()), paragraphs(tag["description"])]
            parts += [self.operation(path, method, item, operation)
                      for path, method, item, operation in self.operations() if tag["name"] in operation["tags"]]
        return "".join(parts)

    def operation(self, path, method, item, operation):
        parameters = [self.resolve(one) for one in item.get("parameters", []) + operation.get("parameters", [])]
        return "".join([
            "<section>\n",
            heading(3, operation["operationId"], code(f"{method.upper()} {path}")),
            f"<p><strong>{escape(operation['summary'])}</strong></p>\n",
            paragraphs(operation.get("description", "")),
            self.samples(operation),
            self.parameters(operation, f"{method.upper()} {path}", parameters),
            self.body(operation),
            "<h4>Answers</h4>\n",
            table(("status", "answer"), [(code(status), self.answer(answer))
                                         for status, answer in operation["responses"].items()]),
            self.answer_bodies(operation),
            "</section>\n"])

    @staticmethod
    def samples(operation):
        return "".join(f'<pre class="sample"{target_of(sample["source"])}>{escape(sample["source"])}</pre>\n'
                       for sample in operation["x-codeSamples"])

    # ---- Parameters and bodies ----

    def parameters(self, operation, name, parameters):
        """A long list that an earlier operation has too is not repeated."""
        rows = [self.parameter(one) for one in parameters]
        anchor, first = self.long_lists.setdefault(str(rows), (operation["operationId"], name))
        if len(rows) > 12 and anchor != operation["operationId"]:
            return f'<p>Parameters: those of <a href="#{anchor}">{code(first)}</a>.</p>\n'
        return table(("parameter", "in", "value", "meaning"), rows)

    def parameter(self, parameter):
        schema = parameter.get("schema") or parameter["content"]["application/json"]["schema"]
        resolved = self.resolve(schema)
        required = "; required" if parameter.get("required") else ""
        meaning = " ".join(filter(None, (parameter.get("description"), resolved.get("description"))))
        return code(parameter["name"]), parameter["in"], self.values(resolved) + required, marked(meaning)

    def body(self, operation):
        if "requestBody" not in operation:
            return ""
        body = self.resolve(operation["requestBody"])
        types = ", ".join(map(code, body["content"]))
        parts = [f"<h4>Body</h4>\n<p>{marked(body['description'])} ({types})</p>\n"]
        for media in body["content"].values():
            parts.append(self.media(media))
        return "".join(parts)

    def media(self, media):
        """The fields of a body, and its examples."""
        schema = media.get("schema", {})
        parts = []
        if "$ref" in schema:
            parts.append(f"<p>Fields: {self.link(schema)}</p>\n")
        elif schema.get("properties"):
            parts.append(self.field_table(schema))
        for example in media.get("examples", {}).values():
            parts.append(f"<pre>{escape(pretty(example['value']))}</pre>\n")
        return "".join(parts)

    # ---- Answers ----

    def answer(self, answer):
        answer = self.resolve(answer)
        types = ", ".join(map(code, answer.get("content", {})))
        names = [name for name in answer.get("headers", {}) if name not in self.common]
        headers = ", ".join(f'<a href="#header-{name}">{name}</a>' for name in names)
        return (marked(answer["description"]) + (f" ({types})" if types else "")
                + (f"<br>Headers: {headers}" if headers else ""))

    def answer_bodies(self, operation):
        """Of the answers that succeed; problems are alike everywhere."""
        parts = []
        for status, answer in operation["responses"].items():
            for name, media in self.resolve(answer).get("content", {}).items():
                if name == "application/json" and (text := self.media(media)):
                    parts.append(f"<p>Answer {code(status)}:</p>\n{text}")
        return "".join(parts)

    # ---- Schemas ----

    def listed(self):
        """Schemas with fields; the others are shown where they are used."""
        return [name for name, schema in self.schemas.items() if "properties" in schema]

    def schema_list(self):
        parts = [heading(2, "schemas", "Schemas")]
        for name in self.listed():
            schema = self.schemas[name]
            parts += [heading(3, f"schema-{name}", escape(name)), paragraphs(schema.get("description", "")),
                      self.field_table(schema)]
        return "".join(parts)

    def field_table(self, schema):
        return table(("field", "value", "meaning"), self.fields(schema, ""))

    def fields(self, schema, prefix):
        rows = []
        required = schema.get("required", [])
        for name, field in schema["properties"].items():
            resolved = self.resolve(field)
            always = "; always" if name in required else ""
            rows.append((code(prefix + name), self.values(field) + always, marked(resolved.get("description", ""))))
            if "$ref" not in field and "properties" in field:
                rows += self.fields(field, f"{prefix}{name}.")
        return rows

    def link(self, reference):
        name = reference["$ref"].rsplit("/", 1)[1]
        return f'<a href="#schema-{name}">{escape(name)}</a>'

    def values(self, schema):
        """What a value may be, as HTML."""
        if "$ref" in schema:
            name = schema["$ref"].rsplit("/", 1)[1]
            if schema["$ref"].startswith("#/components/schemas/") and name in self.listed():
                return self.link(schema)
            schema = self.resolve(schema)
        kind = self.kind(schema)
        for key, label in (("minimum", "from"), ("exclusiveMinimum", "above"), ("maximum", "to"),
                           ("exclusiveMaximum", "below"), ("pattern", "pattern"), ("default", "default")):
            if key in schema:
                kind += f"; {label} {escape(text_of(schema[key]))}"
        return kind

    def kind(self, schema):
        if "enum" in schema:
            return escape(", ".join(map(text_of, schema["enum"])))
        if "allOf" in schema:
            return self.values({key: value for key, value in self.resolve(schema["allOf"][0]).items()
                                if key != "default"})
        if "oneOf" in schema and "type" not in schema:
            return " or ".join(map(self.values, schema["oneOf"]))
        types = schema.get("type", "object")
        names = [self.list_of(schema) if name == "array" else name
                 for name in (types if isinstance(types, list) else [types])]
        return " or ".join(names)

    def list_of(self, schema):
        items = self.values(schema.get("items", {}))
        if schema.get("minItems") == schema.get("maxItems") is not None:
            return f"list of {schema['minItems']}: {items}"
        return f"list: {items}"

    def header_list(self):
        rows = [(f'<span id="header-{name}">{code(name)}</span>', self.values(header["schema"]),
                 marked(header["description"])) for name, header in self.headers.items()]
        every = ", ".join(map(code, (name for name in self.headers if name in self.common)))
        return (heading(2, "headers", "Headers") + f"<p>Every answer has {every}.</p>\n"
                + table(("header", "value", "meaning"), rows))


def main():
    source, target = map(Path, sys.argv[1:])
    target.write_text(Page(openapi_to_json.load(source)).make(), encoding="utf-8")


if __name__ == "__main__":
    main()
