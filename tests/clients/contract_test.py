# SPDX-License-Identifier: Apache-2.0
"""The contract against the running daemon, the command and the examples: contract_test.py KDRAYD KDRAY

What the contract documents is what the daemon sends (status codes, headers, types, bodies), the examples hold their
schemas, and the help of both programs offers what the contract has, with its defaults.
"""
import hashlib
import http.client
import io
import json
import re
import subprocess
import sys
import unittest
import urllib.parse
from pathlib import Path

import jsonschema
import numpy as np

from daemon import Daemon

KDRAYD, KDRAY = sys.argv[1:3]
ROOT = Path(__file__).resolve().parent.parent.parent
TOKEN = "sesame-open-please-0123456789abcdef"

# Headers of the connection, and those that OpenAPI describes elsewhere (Content-Type).
TRANSPORT = {"content-type", "content-length", "date", "connection", "keep-alive", "transfer-encoding"}
# Documented answers that a short test cannot bring about: they need a full disk, a full queue, a build that takes long.
NOT_PROVOKED = {"409", "503", "504", "507", "default"}

TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
CUBE = b"""v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1
f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n"""
POINTS = json.dumps({"points": [[0.2, 0.2, 5], [9, 9, 9], [0, 0, 0]]}).encode()
SETS = json.dumps({"from": [[0.2, 0.2, 5], [9, 9, 9]], "to": [[0, 0, 1], [0.1, 0.1, 0]]}).encode()
RAYS = json.dumps({"rays": [[0.2, 0.2, 5, 0, 0, -1], [9, 9, 9, 0, 0, 1], [0, 0, 0, 0, 0, 0]]}).encode()


class Answer:
    def __init__(self, response):
        self.status = str(response.status)
        self.headers = {name.lower(): value for name, value in response.getheaders()}
        self.body = response.read()
        self.type = self.headers.get("content-type", "").split(";")[0]

    def json(self):
        return json.loads(self.body)


def ask(url, method, path, body=None, headers=()):
    connection = http.client.HTTPConnection(urllib.parse.urlsplit(url).netloc, timeout=60)
    try:
        connection.request(method, path, body, dict(headers))
        return Answer(connection.getresponse())
    finally:
        connection.close()


class Contract:
    def __init__(self, document):
        self.document = document

    def resolve(self, value):
        while isinstance(value, dict) and "$ref" in value:
            target = self.document
            for step in value["$ref"].removeprefix("#/").split("/"):
                target = target[step.replace("~1", "/").replace("~0", "~")]
            value = target
        return value

    def operations(self):
        for path, item in self.document["paths"].items():
            for method in ("get", "post", "delete"):
                if method in item:
                    yield path, method, item[method]

    def responses(self, operation):
        return {status: self.resolve(response) for status, response in operation["responses"].items()}

    def validate(self, schema, value):
        """Raises jsonschema.ValidationError. References lead into the whole document."""
        resolver = jsonschema.RefResolver("", self.document)
        jsonschema.Draft202012Validator(schema, resolver=resolver).validate(value)


class ContractTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.daemon = Daemon(KDRAYD)
        cls.addClassCleanup(cls.daemon.close)
        cls.contract = Contract(cls.get("/openapi.json").json())
        cls.capabilities = cls.get("/v1").json()

    @classmethod
    def get(cls, path):
        return ask(cls.daemon.url, "GET", path)


class Walk(ContractTest):
    """Every operation is asked for every answer that can be had, and each is held against the contract."""

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.seen = {}  # (operationId, status): names of headers
        token_file = cls.daemon.folder + "/token"
        with open(token_file, "w") as file:
            file.write(TOKEN + "\n")
        cls.narrow = Daemon(KDRAYD, "--max-upload", "400B", "--max-rays", "2", "--max-pixels", "1000")
        cls.addClassCleanup(cls.narrow.close)
        cls.guarded = Daemon(KDRAYD, "--token-file", token_file)
        cls.addClassCleanup(cls.guarded.close)

    def check(self, operation, answer):
        """Holds an answer against what the operation documents."""
        place = f"{operation['operationId']} {answer.status}"
        responses = self.contract.responses(operation)
        if answer.status not in responses:
            self.assertGreaterEqual(int(answer.status), 400, place + " is not documented")
        documented = responses.get(answer.status, responses["default"])
        headers = {name.lower(): self.contract.resolve(header)
                   for name, header in documented.get("headers", {}).items()}
        sent = set(answer.headers) - TRANSPORT
        self.assertEqual(sent - set(headers), set(), place + ": sent, not documented")
        required = {name for name, header in headers.items() if header.get("required")}
        self.assertEqual(required - sent, set(), place + ": documented as required, not sent")
        for name in sent:
            value = answer.headers[name]
            schema = self.contract.resolve(headers[name]["schema"])
            if schema["type"] in ("integer", "number"):
                value = json.loads(value)
            self.contract.validate(schema, value)
        content = documented.get("content", {})
        if answer.body:
            self.assertIn(answer.type, content, place)
            schema = content[answer.type]["schema"]
            self.contract.validate(schema, answer.json() if answer.type.endswith("json") else answer.body.decode("latin-1"))
        else:
            self.assertEqual(content, {}, place)
        self.seen.setdefault((operation["operationId"], answer.status), set()).update(sent)

    def walk(self, path, method, requests):
        """requests: (expected status, query or path values, body, headers, daemon)."""
        operation = self.contract.document["paths"][path][method]
        for status, target, *rest in requests:
            body = rest[0] if rest else None
            headers = rest[1] if len(rest) > 1 else {}
            daemon = rest[2] if len(rest) > 2 else self.daemon
            with self.subTest(operation=operation["operationId"], status=status, target=target):
                answer = ask(daemon.url, method.upper(), target, body, headers)
                self.assertEqual(answer.status, str(status), answer.body[:300])
                self.check(operation, answer)

    def test_every_operation_answers_as_the_contract_documents(self):
        tree = ask(self.daemon.url, "POST", "/v1/trees", CUBE).json()["id"]
        narrow = ask(self.narrow.url, "POST", "/v1/trees", TRIANGLE).json()["id"]
        large = self.daemon.folder + "/large.stl"
        subprocess.run([KDRAY, "-q", "sample", "sphere", "--detail", "200", "-o", large], check=True)
        with open(large, "rb") as file:
            large = file.read()
        trees, at, small = "/v1/trees", f"/v1/trees/{tree}", f"/v1/trees/{narrow}"
        nowhere = "/v1/trees/" + "0" * 64 + "-auto"
        text = {"Content-Type": "text/plain"}
        array = io.BytesIO()
        np.save(array, np.array([[0.2, 0.2, 5, 0, 0, -1]], "f4"))

        # Measuring takes some seconds, during which the rest is asked.
        self.walk("/v1/trees/{id}/tradeoff", "post", [
            (202, at + "/tradeoff?wait_ms=0"), (400, at + "/tradeoff?wait=0"), (404, nowhere + "/tradeoff")])
        self.walk("/v1/trees/{id}/tradeoff", "get", [
            (202, at + "/tradeoff"), (400, at + "/tradeoff?wait=0"), (404, small + "/tradeoff", None, {}, self.narrow)])

        for path in ("/v1", "/healthz", "/readyz", "/metrics", "/openapi.json", "/docs"):
            self.walk(path, "get", [(200, path), (400, path + "?x=1"), (415, path, None, {"Content-Encoding": "gzip"})])
        page = self.get("/")
        self.walk("/", "get", [(200, "/"), (304, "/", None, {"If-None-Match": page.headers["etag"]}),
                               (400, "/", b"no body belongs here")])
        self.walk("/problems/{code}", "get", [
            (200, "/problems/invalid_mesh"), (404, "/problems/none"), (400, "/problems/invalid_mesh?x=1")])
        self.walk(trees, "post", [
            (201, trees, TRIANGLE), (200, trees, TRIANGLE), (202, trees + "?wait_ms=0", large),
            (201, f"{trees}?mesh={tree[:64]}&build=bvh"), (404, f"{trees}?mesh={'0' * 64}"),
            (400, trees + "?biuld=box", TRIANGLE), (413, trees, CUBE * 4, {}, self.narrow),
            (415, trees, b"certainly no mesh"), (415, trees, TRIANGLE, {"Content-Encoding": "br"}),
            (422, trees, b"v 0 0 0\n"), (401, trees, TRIANGLE, {}, self.guarded)])
        self.walk(trees, "get", [(200, trees), (400, trees + "?limit=0"), (401, trees, None, {}, self.guarded)])
        self.walk(trees + "/{id}", "get", [(200, at), (400, at + "?wait=1"), (404, nowhere), (422, self.failed())])
        self.walk(trees + "/{id}/mesh", "get", [
            (200, at + "/mesh"), (304, at + "/mesh", None, {"If-None-Match": f'"{tree[:64]}"'}), (404, nowhere + "/mesh"),
            (400, at + "/mesh?x=1")])

        for query in ("closest", "any", "count", "all"):
            rays = at + "/rays/" + query
            self.walk(f"/v1/trees/{{id}}/rays/{query}", "post", [
                (200, rays, RAYS), (200, rays, array.getvalue()), (200, rays + "?t_min=-1e+3", RAYS),
                (200, rays + "?t_min=auto&t_max=auto&cull=back", RAYS),
                (400, rays, b"{"), (400, rays + "?x=1", RAYS),
                (404, f"{nowhere}/rays/{query}", RAYS), (406, rays, RAYS, {"Accept": "text/html"}),
                (413, f"{small}/rays/{query}", RAYS, {}, self.narrow), (415, rays, RAYS, text)])

        np.save(array := io.BytesIO(), np.array([[0.2, 0.2, 5]], "f4"))
        for query in ("closest", "signed-distance", "inside"):
            points = at + "/points/" + query
            self.walk(f"/v1/trees/{{id}}/points/{query}", "post", [
                (200, points, POINTS), (200, points, array.getvalue()), (200, points + "?precision=exact", POINTS),
                (400, points, RAYS), (400, points + "?precision=fast", POINTS),
                (404, f"{nowhere}/points/{query}", POINTS), (406, points, POINTS, {"Accept": "text/html"}),
                (413, f"{small}/points/{query}", POINTS, {}, self.narrow), (415, points, POINTS, text)])

        sight = at + "/visibility"
        self.walk("/v1/trees/{id}/visibility", "post", [
            (200, sight, SETS), (200, sight + "?from_count=1", array.getvalue()), (400, sight, array.getvalue()),
            (200, sight + "?t_min=0&t_max=1", SETS), (400, sight + "?t_max=2", SETS),
            (404, nowhere + "/visibility", SETS), (406, sight, SETS, {"Accept": "text/html"}),
            (413, small + "/visibility", SETS, {}, self.narrow), (415, sight, SETS, text)])

        for kind in ("png", "npy"):
            image = f"/render.{kind}"
            url = f"{at}{image}?width=16&height=12"
            etag = self.get(url).headers["etag"]
            self.walk("/v1/trees/{id}" + image, "get", [
                (200, url), (200, url + "&mode=depth"), (200, url + "&max_noise=0.5"), (200, url + "&budget_ms=1&max_noise=1e-9"),
                (304, url, None, {"If-None-Match": etag}), (400, url + "&samples=0"), (404, nowhere + image),
                (400, url + "&projection=orthographic&fov_deg=20"), (400, url + "&eye=0,9,0&target=0,0,0&up=0,1,0"),
                (413, small + image, None, {}, self.narrow)])
            self.walk("/v1/trees/{id}" + image, "post", [
                (200, at + image, b'{"width": 16, "height": 12}'), (200, at + image, b'{"mode": "depth"}'),
                (200, at + image, b'{"width": 8, "max_noise": 0.5}'),
                (400, at + image, b'{"width": 0}'), (400, at + image, b"["), (404, nowhere + image, b"{}"),
                (413, small + image, b"{}", {}, self.narrow), (415, at + image, b"{}", text)])

        cells = at + "/cells?depth=1"
        self.walk("/v1/trees/{id}/cells", "get", [
            (200, cells), (304, cells, None, {"If-None-Match": self.get(cells).headers["etag"]}),
            (400, at + "/cells"), (404, nowhere + "/cells?depth=1")])

        self.walk("/v1/trees/{id}/tradeoff", "get", [(200, at + "/tradeoff?wait_ms=60000")])
        self.walk("/v1/trees/{id}/tradeoff", "post", [(202, at + "/tradeoff?wait_ms=0")])
        self.walk("/v1/trees/{id}/tradeoff", "delete", [
            (400, at + "/tradeoff?x=1"), (204, at + "/tradeoff"), (404, at + "/tradeoff")])
        self.walk("/v1/trees/{id}", "delete", [(400, at + "?x=1"), (204, at), (404, at)])

        wrong_method = ask(self.daemon.url, "DELETE", trees)
        self.assertEqual(wrong_method.status, "405")
        self.check(self.contract.document["paths"][trees]["post"], wrong_method)
        self.everything_documented_was_seen()

    def failed(self):
        """The path of a tree whose build failed a moment ago."""
        broken = TRIANGLE.replace(b"3", b"9")
        self.assertEqual(ask(self.daemon.url, "POST", "/v1/trees", broken).status, "422")
        return f"/v1/trees/{hashlib.sha256(broken).hexdigest()}-auto"

    def everything_documented_was_seen(self):
        for path, method, operation in self.contract.operations():
            for status, response in self.contract.responses(operation).items():
                if status in NOT_PROVOKED or (operation["operationId"], status) == ("getCells", "413"):
                    continue
                place = (operation["operationId"], status)
                if place == ("postTradeoff", "200"):  # 202 is answered, and GET waits
                    continue
                with self.subTest(operation=place[0], status=status):
                    self.assertTrue(place in self.seen, "documented, and no request of this test brings it about")
                    names = {name.lower() for name in response.get("headers", {})}
                    self.assertEqual(names - self.seen[place], set(), "documented, and never sent")


class Examples(ContractTest):
    def test_every_example_holds_its_schema(self):
        checked = 0

        def visit(value):
            nonlocal checked
            if isinstance(value, dict):
                for example in value["examples"].values() if "schema" in value and "examples" in value else ():
                    self.contract.validate(value["schema"], example["value"])
                    checked += 1
                for member in value.values():
                    visit(member)
            elif isinstance(value, list):
                for element in value:
                    visit(element)

        visit(self.contract.document)
        self.assertGreater(checked, 10)

    def test_schemas_refuse_what_is_no_example(self):
        render = self.contract.document["components"]["schemas"]["RenderRequest"]
        for wrong in ({"widht": 1}, {"width": 0}, {"eye": [0, 0]}, {"mode": "wireframe"}, {"background": "blue"}):
            with self.assertRaises(jsonschema.ValidationError):
                self.contract.validate(render, wrong)


class Help(ContractTest):
    """The help names what the contract has, no more and no less, and the same defaults."""

    def options(self, *command):
        """Name of each option to its description."""
        text = subprocess.run([*command, "--help"], check=True, capture_output=True, text=True).stdout
        text = re.sub(r"\n {20,}", " ", text)
        return {found[1].replace("-", "_"): found[2] for found in
                re.finditer(r"^ +(?:-\w,)?--([\w-]+)(.*)$", text, re.MULTILINE)}

    def check_field(self, name, description, schema):
        with self.subTest(option=name):
            default = schema.get("default")
            told = re.search(r"(\S+) when left out$", description)
            if default is not None:
                self.assertIsNotNone(told, f"does not tell the default {default}")
                default = ",".join(map(str, default)) if isinstance(default, list) else str(default)
                default = default.lower() if default in ("True", "False") else default
                self.assertEqual(told[1], default)
            names = schema.get("enum") or schema.get("items", {}).get("enum")
            if names:
                self.assertEqual(self.listed(description, names), set(names))

    def listed(self, description, names):
        """The words of the first list with "or" in it: "a, b or c"."""
        found = re.search(r"((?:[\w-]+, )*[\w-]+ or [\w-]+)", description)
        self.assertIsNotNone(found, f"names none of {names}")
        return set(re.split(r", | or ", found[1]))

    def test_the_command_renders_what_the_contract_renders(self):
        parameters = self.contract.document["paths"]["/v1/trees/{id}/render.png"]["get"]["parameters"]
        fields = {field["name"]: field.get("schema") or field["content"]["application/json"]["schema"]
                  for field in parameters}
        options = self.options(KDRAY, "render")
        general = set(self.options(KDRAY)) | {"output", "help", "size", "turntable"}
        self.assertEqual(set(options) - general, set(fields))
        for name, schema in fields.items():
            self.check_field(name, options[name], self.contract.resolve(schema))

    def test_the_command_asks_rays_as_the_contract_does(self):
        fields, queries = {}, set()
        for path, item in self.contract.document["paths"].items():
            if "/rays/" in path:
                queries.add(path.rsplit("/", 1)[1])
                for field in map(self.contract.resolve, item["post"]["parameters"]):
                    fields[field["name"]] = self.contract.resolve(field["schema"])
        options = self.options(KDRAY, "rays")
        general = set(self.options(KDRAY)) | {"output", "help"} | queries - {"closest"}
        self.assertEqual(set(options) - general, set(fields))
        for name, schema in fields.items():
            self.check_field(name, options[name], schema)

    def test_the_command_asks_points_as_the_contract_does(self):
        operation = self.contract.document["paths"]["/v1/trees/{id}/points/closest"]["post"]
        fields = {field["name"]: self.contract.resolve(field["schema"])
                  for field in map(self.contract.resolve, operation["parameters"])}
        options = self.options(KDRAY, "points")
        general = set(self.options(KDRAY)) | {"output", "help", "signed_distance", "inside"}
        self.assertEqual(set(options) - general, set(fields))
        for name, schema in fields.items():
            self.check_field(name, options[name], schema)

    def test_the_command_asks_visibility_as_the_contract_does(self):
        operation = self.contract.document["paths"]["/v1/trees/{id}/visibility"]["post"]
        fields = {field["name"]: self.contract.resolve(field["schema"])
                  for field in map(self.contract.resolve, operation["parameters"])}
        options = self.options(KDRAY, "visibility")
        general = set(self.options(KDRAY)) | {"output", "help"}
        # The command counts the points itself.
        self.assertEqual(set(options) - general, set(fields) - {"from_count"})

    def test_the_command_uploads_what_the_daemon_reads(self):
        text = subprocess.run([KDRAY, "upload", "--help"], check=True, capture_output=True, text=True).stdout
        formats = re.search(r"Mesh: ([\w, ]+)", text)[1]
        self.assertEqual(formats.lower().split(", "), self.capabilities["formats"])
        self.assertEqual(self.listed(self.options(KDRAY, "upload")["build"], ()), set(self.capabilities["builds"]))
        text = subprocess.run([KDRAY, "sample", "--help"], check=True, capture_output=True, text=True).stdout
        for ending in re.findall(r"\.(\w+)", re.search(r"Mesh to write: ([^(]+)", text)[1]):
            self.assertIn(ending, self.capabilities["formats"])

    def test_the_contract_names_what_the_daemon_has(self):
        schemas = self.contract.document["components"]["schemas"]
        mesh = schemas["TreeDescription"]["properties"]["mesh"]["properties"]
        self.assertEqual(mesh["format"]["enum"], self.capabilities["formats"])
        self.assertEqual(schemas["Build"]["enum"], self.capabilities["builds"])
        self.assertEqual(schemas["Precision"]["enum"], self.capabilities["precisions"])
        body = self.contract.document["paths"]["/v1/trees"]["post"]["requestBody"]["description"]
        named = re.search(r"The bytes of an? ([\w, ]+) file", body)[1]
        self.assertEqual(re.split(r", | or ", named.lower()), self.capabilities["formats"])

    def test_the_readme_names_what_the_daemon_has(self):
        readme = (ROOT / "README.md").read_text()
        for name in ("build", "precision"):
            table = re.search(rf"^\| `{name}` \|.*\n\|[-|]+\|\n((?:\|.*\n)*)", readme, re.MULTILINE)[1]
            self.assertEqual(re.findall(r"^\| `([\w-]+)`", table, re.MULTILINE), self.capabilities[name + "s"])
        formats = re.search(r"a mesh \(([\w, ]+);", readme)[1]
        self.assertEqual(formats.lower().split(", "), self.capabilities["formats"])

    def test_the_packages_name_what_the_contract_has(self):
        schemas = self.contract.document["components"]["schemas"]
        python = (ROOT / "clients/python/kdray/words.py").read_text()
        typescript = (ROOT / "clients/js/kdray.d.ts").read_text()
        page = (ROOT / "clients/page/tradeoff_plot.js").read_text()

        def names(text, pattern):
            return re.findall(r"['\"]([\w-]+)['\"]", re.search(pattern, text, re.DOTALL)[1])

        for word in ("Build", "Precision"):
            self.assertEqual(names(python, rf"\n{word} = Literal\[(.*?)\]"), schemas[word]["enum"])
            self.assertEqual(names(typescript, rf"export type {word} = (.*?);"), schemas[word]["enum"])
        self.assertEqual(["auto", *names(page, r"const PRECISIONS = \[(.*?)\]")], schemas["Precision"]["enum"])

    def test_the_daemons_help_tells_its_defaults(self):
        options = self.options(KDRAYD)
        limits = self.capabilities["limits"]
        units = {"KiB": 2**10, "MiB": 2**20, "GiB": 2**30}

        def default_of(name):
            found = (re.search(r"default (\d+)([KMG]iB)\)", options[name])
                     or re.search(r"=(\d+)() ", options[name]) or re.search(r"\[(\d+)()\]", options[name]))
            return int(found[1]) * units.get(found[2], 1)

        for option, limit in (("max_upload", "max_upload_bytes"), ("max_rays", "max_rays"), ("max_pixels", "max_pixels")):
            self.assertEqual(default_of(option), limits[limit], option)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
