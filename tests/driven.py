"""A browser without a screen that is driven as by a person: real clicks and keys, through Chromium's own driver."""

import base64
import json
import re
import shutil
import subprocess
import time
import urllib.request
from contextlib import contextmanager

import pytest

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
DRIVER = shutil.which("chromedriver")
needs_driver = pytest.mark.skipif(
    BROWSER is None or DRIVER is None, reason="no Chromium with its driver here (Debian: apt install chromium-driver)"
)  # fmt: skip
ELEMENT = "element-6066-11e4-a52e-4f735466cecf"
"""Key of a reference to an element in the W3C's WebDriver protocol."""

CONTROL = "\ue009"


class Browser:
    """A window of Chromium, by the W3C's WebDriver protocol."""

    def __init__(self, port, profile, width=1366, height=768):
        self._root = f"http://127.0.0.1:{port}"
        arguments = [
            "--headless=new", "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader", "--use-angle=swiftshader",
            f"--user-data-dir={profile}", f"--window-size={width},{height}", "--proxy-server=127.0.0.1:9",
            "--proxy-bypass-list=127.0.0.1", "--force-device-scale-factor=1",
        ]  # fmt: skip
        options = {"args": arguments, "binary": BROWSER}
        always = {"goog:chromeOptions": options, "goog:loggingPrefs": {"browser": "ALL"}}
        made = self._ask("POST", "/session", {"capabilities": {"alwaysMatch": always}})
        self._session = f"/session/{made['sessionId']}"

    def _ask(self, method, path, content=None):
        body = None if content is None else json.dumps(content).encode()
        asked = urllib.request.Request(
            self._root + path, body, {"Content-Type": "application/json"}, method=method
        )
        with urllib.request.urlopen(asked, timeout=120) as answer:
            return json.load(answer)["value"]

    def open(self, address):
        self._ask("POST", f"{self._session}/url", {"url": address})

    def run(self, script, *arguments):
        """What a script returns."""
        return self._ask("POST", f"{self._session}/execute/sync", {"script": script, "args": list(arguments)})

    def until(self, condition, seconds=120):
        """Wait until an expression of the page is true; its value."""
        end = time.monotonic() + seconds
        while not (value := self.run(f"return {condition}")):
            assert time.monotonic() < end, (
                f"{condition} did not come true; {self.run('return document.body.innerText')}"
            )
            time.sleep(0.2)
        return value

    def click(self, selector):
        (found,) = self._ask(
            "POST", f"{self._session}/elements", {"using": "css selector", "value": selector}
        )[:1]
        self._ask("POST", f"{self._session}/element/{found[ELEMENT]}/click", {})

    def click_at(self, x, y):
        """Press and release the mouse at a place of the window, in pixels."""
        move = {"type": "pointerMove", "duration": 0, "x": round(x), "y": round(y)}
        steps = [move, {"type": "pointerDown", "button": 0}, {"type": "pointerUp", "button": 0}]
        self._act({"type": "pointer", "id": "mouse", "actions": steps})

    def drag(self, start, end):
        moves = [
            {"type": "pointerMove", "duration": 60, "x": round(x), "y": round(y)} for x, y in (start, end)
        ]
        press, release = ({"type": kind, "button": 0} for kind in ("pointerDown", "pointerUp"))
        self._act({"type": "pointer", "id": "mouse", "actions": [moves[0], press, moves[1], release]})

    def keys(self, *keys, held=None):
        steps = [{"type": kind, "value": key} for key in keys for kind in ("keyDown", "keyUp")]
        if held:
            steps = [{"type": "keyDown", "value": held}, *steps, {"type": "keyUp", "value": held}]
        self._act({"type": "key", "id": "keyboard", "actions": steps})

    def _act(self, device):
        self._ask("POST", f"{self._session}/actions", {"actions": [device]})

    def complaints(self):
        """What the page's scripts complained of since the last call."""
        result = self._ask("POST", f"{self._session}/se/log", {"type": "browser"})
        return [entry["message"] for entry in result if entry["level"] in ("SEVERE", "WARNING")]

    def picture(self, path):
        """Write what the window shows as PNG."""
        path.write_bytes(base64.b64decode(self._ask("GET", f"{self._session}/screenshot")))

    def close(self):
        self._ask("DELETE", self._session)


@contextmanager
def browsing(profile, **size):
    driver = subprocess.Popen(
        [DRIVER, "--port=0"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    try:
        port = next(found[1] for line in driver.stdout if (found := re.search(r"on port (\d+)\.", line)))
        browser = Browser(port, profile, **size)
        try:
            yield browser
        finally:
            browser.close()
    finally:
        driver.terminate()
        driver.communicate()
