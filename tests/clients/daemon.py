# SPDX-License-Identifier: Apache-2.0
"""The real kdrayd on a free port with a data directory of its own, for the tests of the clients."""
import os
import re
import shutil
import subprocess
import tempfile


class Daemon:
    """Context manager; `url` is where it listens, `folder` a place for a test's files."""

    def __init__(self, kdrayd, *options):
        self.folder = tempfile.mkdtemp(prefix="kdray-clients-")
        self._log = open(os.path.join(self.folder, "log"), "w+")
        self._command = [kdrayd, "--data-dir", os.path.join(self.folder, "data"), *options]
        self.start(port=0)

    def start(self, port=None):
        """Starts it again after stop(), at the same address."""
        port = self.url.rsplit(":", 1)[1] if port is None else port
        # Options of the person who runs the tests must not reach the daemon under test.
        environment = {name: value for name, value in os.environ.items()
                       if not name.startswith("KDRAY_")}
        self._process = subprocess.Popen([*self._command, "--port", str(port)], text=True,
                                         stdout=subprocess.PIPE, stderr=self._log, env=environment)
        line = self._process.stdout.readline()
        found = re.match(r"kdrayd listening on (http://\S+)", line)
        if not found:
            self.close()
            raise RuntimeError(f"kdrayd did not start; it said: {line!r}")
        self.url = found.group(1)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def stop(self):
        self._process.terminate()
        self._process.wait(timeout=30)
        self._process.stdout.close()

    def close(self):
        self.stop()
        self._log.close()
        shutil.rmtree(self.folder, ignore_errors=True)
