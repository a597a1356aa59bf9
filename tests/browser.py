"""A real browser without a screen, for pages that claim to need nothing but themselves."""

import html
import json
import re
import shutil
import subprocess

import pytest

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
needs_browser = pytest.mark.skipif(BROWSER is None, reason="no Chromium here (Debian: apt install chromium)")


def shown(page, profile, wait_ms=4000):
    """The page's document once its scripts have run, and what it complained of."""
    finished = subprocess.run(
        [
            BROWSER, "--headless=new", "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader",
            "--use-angle=swiftshader", f"--user-data-dir={profile}", "--enable-logging=stderr", "--dump-dom",
            "--proxy-server=127.0.0.1:9", f"--virtual-time-budget={wait_ms}", page.as_uri(),
        ],
        capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip
    return finished.stdout, [line for line in finished.stderr.splitlines() if "CONSOLE" in line]


MEASURE = """
<!doctype html><body><iframe id="frame" style="border:0" width="{width}" height="900"></iframe><script>
const frame = document.getElementById("frame");
frame.onload = () => setTimeout(() => {{
  const inner = frame.contentDocument, edge = inner.documentElement.clientWidth, bad = [];
  for (const element of inner.querySelectorAll("body *")) {{
    if (element.closest("svg") && element.tagName.toLowerCase() !== "svg") continue;
    const box = element.getBoundingClientRect();
    if (!box.width || !box.height) continue;
    const name = element.tagName + " " + (element.textContent || "").slice(0, 40);
    if (box.right > edge + 1 || box.left < -1) bad.push("outside: " + name);
    const scrolls = getComputedStyle(element).overflowX !== "visible";
    if (scrolls && element.clientWidth && element.scrollWidth > element.clientWidth + 1) bad.push("clipped: " + name);
  }}
  document.body.dataset.found = JSON.stringify({{edge, across: inner.documentElement.scrollWidth, bad}});
}}, 1500);
frame.srcdoc = {text};
</script></body>
"""


def overflow(text, width_px, folder):
    """Elements of a page that stick out of a screen of so many pixels, or are cut off inside their box."""
    wrapper = folder / f"at_{width_px}.html"
    inside = json.dumps(text).replace("</", "<\\/")
    wrapper.write_text(MEASURE.format(width=width_px, text=inside))
    document, _ = shown(wrapper, folder / f"profile_{width_px}", wait_ms=8000)
    found = json.loads(html.unescape(re.search(r'data-found="([^"]*)"', document).group(1)))
    assert found["edge"] in (width_px, width_px - 15)  # without and with a scroll bar
    return found["bad"] + ["page scrolls sideways"] * (found["across"] > found["edge"])
