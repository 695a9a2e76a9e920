# SPDX-License-Identifier: Apache-2.0
"""Clients that public generators make of the contract: generated_test.py KDRAYD KDRAY FOLDER OPENAPI.json

npm installs the generators into FOLDER. The clients that they make of the contract are compiled by
tsc with its strictest rules, and upload, query and render against the real daemon. The types of
the JavaScript package are checked on the way, by the same tsc. Exits with 77 (skipped) without npm
or its registry; nothing else of kdray needs them.
"""
import json
import os
import shutil
import subprocess
import sys
import unittest
from pathlib import Path

from daemon import Daemon

KDRAYD, KDRAY, FOLDER, DOCUMENT = map(os.path.abspath, sys.argv[1:5])
SOURCES = Path(__file__).resolve().parent / "generated"
ROOT = SOURCES.parent.parent.parent
# Versions that run on Node 18 and later.
PACKAGES = {"openapi-typescript": "7.13.0", "openapi-fetch": "0.17.0", "@hey-api/openapi-ts": "0.85.2",
            "typescript": "5.9.3", "@types/node": "18.19.0"}
STRICT = ["--strict", "--skipLibCheck", "--target", "es2022", "--lib", "es2022,dom,dom.iterable,dom.asynciterable"]


def skip(reason):
    print(f"{reason}; no client is generated")
    sys.exit(77)


def install():
    """The packages, once for each list of versions."""
    if not shutil.which("npm") or not shutil.which("node"):
        skip("npm is not installed")
    os.makedirs(FOLDER, exist_ok=True)
    manifest = json.dumps({"private": True, "dependencies": PACKAGES})
    mark = Path(FOLDER, "installed.json")
    if mark.exists() and mark.read_text() == manifest:
        return
    Path(FOLDER, "package.json").write_text(manifest)
    ended = subprocess.run(["npm", "install", "--no-audit", "--no-fund", "--ignore-scripts", "--no-package-lock",
                            "--fetch-retries", "0"],
                           cwd=FOLDER, capture_output=True, text=True)
    if ended.returncode:
        print(ended.stderr[-1000:])
        skip("npm could not install the generators")
    mark.write_text(manifest)


class GeneratedTest(unittest.TestCase):
    def run_in_folder(self, *command):
        ended = subprocess.run(command, cwd=FOLDER, capture_output=True, text=True)
        self.assertEqual(ended.returncode, 0, ended.stdout + ended.stderr)

    def test_generated_clients_compile_and_upload_query_and_render(self):
        work = Path(FOLDER, "work")
        shutil.rmtree(work, ignore_errors=True)
        work.mkdir()
        for source in ("checks.ts", "openapi_fetch.ts", "hey_api.ts"):
            shutil.copy(SOURCES / source, work)
        self.run_in_folder("node", str(SOURCES / "generate.mjs"), DOCUMENT, str(work))
        self.run_in_folder("node_modules/.bin/tsc", *STRICT, "--noUncheckedIndexedAccess", "--module", "commonjs",
                           "--moduleResolution", "node10", "--esModuleInterop", "--outDir", "built", "work/openapi_fetch.ts", "work/hey_api.ts")
        cube = work / "cube.ply"
        subprocess.run([KDRAY, "-q", "sample", "cube", "-o", cube], check=True)
        with Daemon(KDRAYD) as daemon:
            for program in ("openapi_fetch", "hey_api"):
                with self.subTest(client=program):
                    self.run_in_folder("node", f"built/{program}.js", daemon.url, str(cube))

    def test_the_package_has_the_types_that_it_declares(self):
        self.run_in_folder("node_modules/.bin/tsc", *STRICT, "--module", "nodenext", "--allowJs", "--checkJs", "--noEmit",
                           str(SOURCES / "types_of_the_package.ts"))

    def test_the_package_is_installed_and_imported_by_its_name(self):
        user = Path(FOLDER, "user")
        shutil.rmtree(user, ignore_errors=True)
        user.mkdir()
        self.run_in_folder("npm", "pack", "--silent", "--pack-destination", str(user), str(ROOT / "clients" / "js"))
        (user / "package.json").write_text('{"private": true, "type": "module"}')
        package, = user.glob("kdray-*.tgz")
        self.run_in_folder("npm", "install", "--offline", "--no-audit", "--no-fund", "--prefix", str(user), str(package))
        (user / "use.ts").write_text(
            "import { Client, KdrayError, type Tree } from 'kdray';\n"
            "const id = async (tree: Tree): Promise<string> => (await tree.refresh()).id;\n"
            "if (!(new KdrayError(400, {}, null) instanceof Error) || !new Client() || !id) throw new Error();\n")
        self.run_in_folder("node_modules/.bin/tsc", *STRICT, "--module", "nodenext", str(user / "use.ts"))
        self.run_in_folder("node", str(user / "use.js"))


if __name__ == "__main__":
    install()
    unittest.main(argv=sys.argv[:1], verbosity=2)
