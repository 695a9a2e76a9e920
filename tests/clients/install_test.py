# SPDX-License-Identifier: Apache-2.0
"""What `cmake --install` and cpack make: install_test.py KDRAYD KDRAY BUILD_FOLDER

The programs, documents, service and library of an installed tree; a project outside that uses the library; the Debian
packages. A machine without systemd runs the unit's own commands.
"""
import gzip
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import unittest
import urllib.error
import urllib.request
from pathlib import Path

from daemon import Daemon

KDRAYD, KDRAY, BUILD = sys.argv[1:4]
ROOT = Path(__file__).resolve().parent.parent.parent
VERSION = re.search(r"project\(kdray VERSION (\S+)", (ROOT / "CMakeLists.txt").read_text())[1]


def run(*arguments, **options):
    done = subprocess.run([str(a) for a in arguments], capture_output=True, text=True, timeout=500, **options)
    if done.returncode:
        raise AssertionError(f"{arguments}\n{done.stdout}{done.stderr}")
    return done.stdout


class UnitProcess:
    """The service as its unit starts it, but with a state directory and a port of its own."""

    def __init__(self, unit, state):
        self.settings = re.findall(r"^(\w+)=(.*)$", unit, re.MULTILINE)
        settings = dict(self.settings)
        environment = {name: value for name, value in os.environ.items() if not name.startswith("KDRAY_")}
        for name, value in self.settings:
            if name == "Environment":
                key, _, text = value.partition("=")
                environment[key] = text.replace("%S", str(state))
        Path(environment["KDRAY_DATA_DIR"]).mkdir(mode=0o700, parents=True, exist_ok=True)
        defaults = Path(settings["EnvironmentFile"].removeprefix("-"))
        if defaults.exists():
            for line in defaults.read_text().splitlines():
                if line and not line.startswith("#"):
                    key, _, text = line.partition("=")
                    environment[key] = text
        environment["KDRAY_PORT"] = "0"
        self.process = subprocess.Popen(settings["ExecStart"].split(), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                                        text=True, env=environment)
        self.url = re.match(r"kdrayd listening on (http://\S+)", self.process.stdout.readline())[1]

    def reload(self):
        command = dict(self.settings)["ExecReload"].replace("$MAINPID", str(self.process.pid))
        subprocess.run(shlex.split(command), check=True)

    def stop(self):
        self.process.send_signal(signal.SIGTERM)
        code = self.process.wait(timeout=30)
        self.process.stdout.close()
        return code


class InstallTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = Path(tempfile.mkdtemp(prefix="kdray-install-"))
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        cls.prefix = cls.folder / "usr"
        run("cmake", "--install", BUILD, "--prefix", cls.prefix)

    def files(self):
        return {path.relative_to(self.prefix).as_posix() for path in self.prefix.rglob("*") if path.is_file()}

    def test_everything_is_where_its_readers_look(self):
        files = self.files()
        for name in ("bin/kdrayd", "bin/kdray", "lib/systemd/system/kdrayd.service", "lib/sysusers.d/kdray.conf",
                     "etc/default/kdrayd", "share/man/man1/kdray.1.gz", "share/man/man8/kdrayd.8.gz",
                     "share/bash-completion/completions/kdray", "share/zsh/vendor-completions/_kdray",
                     "share/fish/vendor_completions.d/kdray.fish", "share/doc/kdray/examples/haproxy.cfg",
                     "share/doc/kdray/copyright", "include/kdray/client.h", "include/kdray/batches.h"):
            self.assertIn(name, files)
        self.assertTrue(any(name.endswith("cmake/kdray/kdray-config.cmake") for name in files))
        self.assertTrue(any(name.endswith("/libkdray_client.a") for name in files))
        self.assertIn(VERSION, run(self.prefix / "bin/kdray", "--version"))

    def test_public_headers_include_only_what_is_installed(self):
        for header in (self.prefix / "include/kdray").iterdir():
            for included in re.findall(r'#include "(.*)"', header.read_text()):
                self.assertTrue((self.prefix / "include" / included).exists(), f"{header.name}: {included}")
            self.assertNotIn("nlohmann", header.read_text())

    def test_the_manual_of_the_daemon_has_every_option(self):
        with gzip.open(self.prefix / "share/man/man8/kdrayd.8.gz", "rt") as file:
            page = file.read().replace("\\-", "-")
        listed = re.findall(r"^ +(?:-\w,)?(--[\w-]+)", run(KDRAYD, "--help"), re.MULTILINE)
        self.assertGreater(len(listed), 10)
        for option in listed:
            self.assertIn(f"{option}\\fR", page)
        if shutil.which("man"):
            done = subprocess.run(["man", "--warnings=w", "-l", self.prefix / "share/man/man8/kdrayd.8.gz"],
                                  capture_output=True, text=True, env=dict(os.environ, LC_ALL="C.UTF-8", MANWIDTH="100"))
            self.assertEqual((done.returncode, done.stderr), (0, ""))

    def test_a_project_outside_builds_with_the_library_and_gets_answers(self):
        build = self.folder / "outside"
        (build / "readme").mkdir(parents=True)
        readme = (ROOT / "clients/README.md").read_text()
        for language, name in (("cmake", "CMakeLists.txt"), ("cpp", "hits.cc")):
            block = re.search(rf"```{language}\n(.*?)```", readme, re.DOTALL)[1]
            (build / "readme" / name).write_text(block)
        run("cmake", "-S", ROOT / "tests/clients/outside", "-B", build, f"-DCMAKE_PREFIX_PATH={self.prefix}",
            "-DCMAKE_CXX_FLAGS=-Wall -Wextra -Werror")
        run("cmake", "--build", build, "-j2")
        cube = self.folder / "cube.ply"
        run(KDRAY, "-q", "sample", "cube", "-o", cube)
        with Daemon(KDRAYD) as daemon:
            answers = run(build / "answers", daemon.url, cube).splitlines()
            top = json_bounds(daemon.url, cube)
            self.assertEqual(answers, [
                f"hit 1 {5 - top:g}", "hit 0 inf", "hit 0 nan", "any 1", "any 0", "any 0", "count 2", "count 0", "count 0",
                f"distance {5 - top:g} at y {top:g}", answers[10], f"signed {5 - top:g}", answers[12], "inside 0", "inside 1",
                f"many {5 - top:g}", "refused 400 precision"])
            self.assertTrue(answers[12].startswith("signed -"))
            hits = run(build / "readme_build/hits", daemon.url, cube, cwd=self.folder)
            self.assertRegex(hits, r"^[\d.]+ \d+\n$")
            self.assertEqual((self.folder / "picture.png").read_bytes()[:8], b"\x89PNG\r\n\x1a\n")
            wrong = subprocess.run([build / "readme_build/hits", daemon.url, self.folder / "none.ply"], capture_output=True, text=True)
            self.assertEqual(wrong.returncode, 1)
            self.assertIn("none.ply: No such file", wrong.stderr)

    def test_the_units_commands_start_answer_and_restart(self):
        unit = (self.prefix / "lib/systemd/system/kdrayd.service").read_text()
        self.assertIn(f"ExecStart={self.prefix}/bin/kdrayd\n", unit)
        state = self.folder / "state"
        cube = self.folder / "unit.ply"
        run(KDRAY, "-q", "sample", "cube", "-o", cube)
        service = UnitProcess(unit, state)
        self.assertEqual(urllib.request.urlopen(service.url + "/readyz").status, 200)
        tree = run(KDRAY, "-q", "--server", service.url, "upload", cube).strip()
        self.assertEqual(service.stop(), 0)
        self.assertTrue((state / "kdray").is_dir())
        service = UnitProcess(unit, state)
        service.reload()
        self.assertIn(tree[:12], run(KDRAY, "--server", service.url, "list"))
        self.assertEqual(service.stop(), 0)

    def test_the_unit_is_valid_and_hardened(self):
        unit = self.prefix / "lib/systemd/system/kdrayd.service"
        text = unit.read_text()
        for setting in ("User=kdray", "StateDirectory=kdray", "ProtectSystem=strict", "NoNewPrivileges=yes"):
            self.assertIn(setting + "\n", text)
        if not shutil.which("systemd-analyze"):
            self.skipTest("no systemd-analyze")
        run("systemd-analyze", "verify", "--man=no", unit)
        # systemd's own measure: 10 is unsafe, and a service without any setting has 9.6.
        report = run("systemd-analyze", "security", "--offline=true", "--no-pager", unit)
        exposure = float(re.search(r"Overall exposure level for kdrayd.service: ([\d.]+)", report)[1])
        self.assertLess(exposure, 2.0, report)


def json_bounds(url, mesh):
    """The largest y of the mesh."""
    return float(re.search(r'"max": \[\s*\S+\s+([\d.]+)', run(KDRAY, "-q", "--server", url, "--json", "upload", mesh))[1])


class DebianPackageTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        if not all(map(shutil.which, ("cpack", "dpkg-deb", "dpkg-shlibdeps", "file"))):
            raise unittest.SkipTest("cpack, dpkg-dev and file make Debian packages")
        cls.folder = Path(tempfile.mkdtemp(prefix="kdray-deb-"))
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        run("cpack", "--config", Path(BUILD) / "CPackConfig.cmake", "-G", "DEB", "-B", cls.folder)
        cls.packages = {path.name.split("_")[0]: path for path in cls.folder.glob("*.deb")}

    def test_there_is_one_for_the_service_and_one_for_the_library(self):
        self.assertEqual(set(self.packages), {"kdray", "libkdray-dev"})
        service = run("dpkg-deb", "--field", self.packages["kdray"])
        self.assertRegex(service, rf"(?m)^Version: {re.escape(VERSION)}-1\+deb\d+$")
        for library in ("libc6", "libtbb12", "libcpp-httplib", "libssl3", "libcairo2", "libstdc++6"):
            self.assertIn(library, service)
        self.assertNotIn("-dev,", re.search(r"Depends: (.*)", service)[1] + ",")
        self.assertIn("libcpp-httplib-dev", run("dpkg-deb", "--field", self.packages["libkdray-dev"], "Depends"))

    def test_paths_are_those_of_debian(self):
        listed = run("dpkg-deb", "--contents", self.packages["kdray"])
        for path in ("./usr/bin/kdrayd", "./usr/lib/systemd/system/kdrayd.service", "./etc/default/kdrayd",
                     "./usr/lib/sysusers.d/kdray.conf"):
            self.assertRegex(listed, rf"(?m)^-\S+ root/root .* {re.escape(path)}$")
        self.assertNotIn(str(ROOT), listed)
        place = self.folder / "place"
        run("dpkg-deb", "--extract", self.packages["kdray"], place)
        unit = (place / "usr/lib/systemd/system/kdrayd.service").read_text()
        self.assertIn("ExecStart=/usr/bin/kdrayd\n", unit)
        self.assertIn("EnvironmentFile=-/etc/default/kdrayd\n", unit)
        self.assertIn(VERSION, run(place / "usr/bin/kdrayd", "--version"))

    def test_scripts_of_the_package_are_plain_shell(self):
        control = self.folder / "control"
        run("dpkg-deb", "--control", self.packages["kdray"], control)
        for script in ("postinst", "prerm", "postrm"):
            run("sh", "-n", control / script)
            self.assertTrue(os.access(control / script, os.X_OK))
        self.assertEqual((control / "conffiles").read_text(), "/etc/default/kdrayd\n")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
