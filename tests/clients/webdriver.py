# SPDX-License-Identifier: Apache-2.0
"""A headless Chromium, driven over the WebDriver protocol with the standard library alone.

Source: W3C Recommendation "WebDriver"; chromedriver speaks it on a local port.
"""
import base64
import json
import re
import shutil
import subprocess
import tempfile
import time
import urllib.error
import urllib.request

ELEMENT = "element-6066-11e4-a52e-4f735466cecf"  # the protocol's own name for "a reference to an element"

# Quiet and alone: no sandbox (tests run as root in containers), no traffic of its own, a new profile.
FLAGS = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
         "--disable-background-networking", "--disable-component-update", "--disable-sync",
         "--disable-dev-shm-usage", "--force-device-scale-factor=1", "--hide-scrollbars"]


class Browser:
    """Context manager: one window of `width` x `height` pixels."""

    def __init__(self, width=1280, height=800, flags=()):
        self._profile = tempfile.mkdtemp(prefix="kdray-chromium-")
        self._driver = subprocess.Popen(["chromedriver", "--port=0"], stdout=subprocess.PIPE,
                                        stderr=subprocess.DEVNULL, text=True)
        self._session = None
        try:
            self._url = f"http://127.0.0.1:{self._port()}"
            options = {"args": [*FLAGS, *flags, f"--window-size={width},{height}",
                                f"--user-data-dir={self._profile}"]}
            capabilities = {"browserName": "chrome", "goog:chromeOptions": options,
                            "goog:loggingPrefs": {"browser": "ALL"}}
            answer = self._call("POST", "/session", {"capabilities": {"alwaysMatch": capabilities}})
            self._session = answer["sessionId"]
            self.command("POST", "/timeouts", {"script": 30000, "pageLoad": 30000})
        except BaseException:
            self.close()
            raise

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        try:
            if self._session:
                self.command("DELETE", "")
        finally:
            self._driver.terminate()
            self._driver.wait()
            self._driver.stdout.close()
            shutil.rmtree(self._profile, ignore_errors=True)

    def _port(self):
        for line in self._driver.stdout:
            if found := re.search(r"started successfully on port (\d+)", line):
                return int(found.group(1))
        raise RuntimeError("chromedriver did not start")

    def _call(self, method, path, body=None):
        data = None if method in ("GET", "DELETE") else json.dumps(body or {}).encode()
        request = urllib.request.Request(self._url + path, data, {"Content-Type": "application/json"},
                                         method=method)
        try:
            with urllib.request.urlopen(request, timeout=60) as answer:
                return json.load(answer)["value"]
        except urllib.error.HTTPError as error:
            problem = json.load(error)["value"]
            raise RuntimeError(f"{problem['error']}: {problem['message']}") from None

    def command(self, method, path, body=None):
        return self._call(method, f"/session/{self._session}{path}", body)

    def open(self, url):
        self.command("POST", "/url", {"url": url})

    def run(self, script, *arguments):
        """The value that the function body `script` returns; promises are awaited."""
        return self.command("POST", "/execute/sync", {"script": script, "args": list(arguments)})

    def wait(self, script, *arguments, seconds=20):
        """Runs `script` until what it returns is true; gives that back."""
        deadline = time.monotonic() + seconds
        while not (value := self.run(script, *arguments)):
            if time.monotonic() > deadline:
                raise AssertionError(f"still not true after {seconds} s: {script}")
            time.sleep(0.05)
        return value

    def find(self, selector):
        return self.command("POST", "/element", {"using": "css selector", "value": selector})

    def click(self, selector):
        self.command("POST", f"/element/{self.find(selector)[ELEMENT]}/click")

    def type(self, selector, text):
        """Keys into an element; for a file input the paths of the files."""
        self.command("POST", f"/element/{self.find(selector)[ELEMENT]}/value", {"text": text})

    def choose(self, selector, value):
        """As a person choosing from a <select> or moving a slider."""
        self.run("""const field = document.querySelector(arguments[0]);
                    field.value = arguments[1];
                    field.dispatchEvent(new Event('input', {bubbles: true}));
                    field.dispatchEvent(new Event('change', {bubbles: true}));""", selector, value)

    def drag(self, selector, start, end, button=0, steps=8):
        """Presses at `start` and lets go at `end`, both in pixels from the element's middle."""
        origin = self.find(selector)

        def move(place, duration):
            return {"type": "pointerMove", "origin": origin, "x": round(place[0]),
                    "y": round(place[1]), "duration": duration}

        path = [move([start[i] + (end[i] - start[i]) * step / steps for i in (0, 1)], 20)
                for step in range(1, steps + 1)]
        actions = [move(start, 0), {"type": "pointerDown", "button": button}, *path,
                   {"type": "pointerUp", "button": button}]
        self._act("pointer", actions, {"pointerType": "mouse"})

    def press(self, selector, place, button=0, times=1, pointer="mouse"):
        """Clicks at `place`, in pixels from the element's middle."""
        origin = self.find(selector)
        self._act(pointer, [{"type": "pointerMove", "origin": origin, "x": round(place[0]),
                             "y": round(place[1]), "duration": 0},
                            *times * [{"type": "pointerDown", "button": button},
                                      {"type": "pointerUp", "button": button}]], {"pointerType": pointer})

    def pinch(self, selector, start, end, steps=6):
        """Two fingers, left and right of the element's middle, go from `start` to `end` pixels off it."""
        origin = self.find(selector)

        def finger(side):
            def move(distance, duration):
                return {"type": "pointerMove", "origin": origin, "x": round(side * distance), "y": 0,
                        "duration": duration}

            path = [move(start + (end - start) * step / steps, 20) for step in range(1, steps + 1)]
            return {"type": "pointer", "id": f"finger {side}", "parameters": {"pointerType": "touch"},
                    "actions": [move(start, 0), {"type": "pointerDown", "button": 0}, *path,
                                {"type": "pointerUp", "button": 0}]}

        self.command("POST", "/actions", {"actions": [finger(-1), finger(1)]})

    def wheel(self, selector, pixels, place=(0, 0)):
        self._act("wheel", [{"type": "scroll", "origin": self.find(selector), "x": round(place[0]),
                             "y": round(place[1]), "deltaX": 0, "deltaY": pixels, "duration": 0}])

    def key(self, key):
        self._act("key", [{"type": "keyDown", "value": key}, {"type": "keyUp", "value": key}])

    def _act(self, kind, actions, parameters=None):
        source = {"type": "pointer" if parameters else kind, "id": kind, "actions": actions}
        if parameters:
            source["parameters"] = parameters
        self.command("POST", "/actions", {"actions": [source]})

    def screenshot(self, path):
        with open(path, "wb") as file:
            file.write(base64.b64decode(self.command("GET", "/screenshot")))

    def label(self, element):
        """The accessible name of an element of find_all()."""
        return self.command("GET", f"/element/{element[ELEMENT]}/computedlabel")

    def find_all(self, selector):
        return self.command("POST", "/elements", {"using": "css selector", "value": selector})

    def back(self):
        self.command("POST", "/back")

    def forward(self):
        self.command("POST", "/forward")

    def size(self, width, height, phone=False):
        """Gives the page this many pixels; as a telephone also fingers and twice the density."""
        self._devtools("Emulation.setDeviceMetricsOverride", width=width, height=height, mobile=phone,
                       deviceScaleFactor=2 if phone else 1)
        self._devtools("Emulation.setTouchEmulationEnabled", enabled=phone)

    def prefer(self, scheme):
        """`light` or `dark`, as the system's setting."""
        feature = {"name": "prefers-color-scheme", "value": scheme}
        self._devtools("Emulation.setEmulatedMedia", features=[feature])

    def block(self, *patterns):
        """Requests of these URLs fail as without a network; * stands for any text."""
        self._devtools("Network.enable")
        self._devtools("Network.setBlockedURLs", urls=patterns)

    def _devtools(self, command, **parameters):
        self.command("POST", "/goog/cdp/execute", {"cmd": command, "params": parameters})

    def errors(self):
        """What a person sees in red in the console, since the last call."""
        return [entry["message"] for entry in self.console() if entry["level"] == "SEVERE"]

    def console(self):
        """Messages of the page and of the browser about it, since the last call."""
        return self.command("POST", "/se/log", {"type": "browser"})
