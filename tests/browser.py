"""A real browser without a screen, for pages that claim to need nothing but themselves."""

import shutil
import subprocess

import pytest

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
needs_browser = pytest.mark.skipif(BROWSER is None, reason="no Chromium here (Debian: apt install chromium)")


def shown(address, profile):
    """A page's document once its scripts have run, and what it complained of."""
    finished = subprocess.run(
        [
            BROWSER, "--headless=new", "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader",
            "--use-angle=swiftshader", f"--user-data-dir={profile}", "--enable-logging=stderr", "--dump-dom",
            "--proxy-server=127.0.0.1:9", "--virtual-time-budget=4000", address,
        ],
        capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip
    return finished.stdout, [line for line in finished.stderr.splitlines() if "CONSOLE" in line]
