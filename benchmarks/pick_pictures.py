"""The pictures of the pick page in the guide, by a real browser: `python benchmarks/pick_pictures.py [DEMO]`.

Draws pick_rock.webp and pick_crevice.webp into docs/figures.
The clicks are true: the base of the demo's virtual rock is flush with its pedestal wherever the pictures show it.
"""

import re
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from driven import Browser, browsing

FIGURES = Path(__file__).parents[1] / "docs" / "figures"
SIZE = {"width": 1220, "height": 900}
IDLE = (
    "!document.getElementById('stage').classList.contains('busy') && document.body.dataset.current == 'true'"
)
TOUCHES_DEG = (-115.0, -40.0, 25.0)
"""Azimuths at which the base touches; the eye stands in their middle."""
LOOK_DEG = -45.0

TURN = """
    const stage = document.getElementById("view").stage, a = arguments[0] * Math.PI / 180;
    const middle = [0, 1, 2].map(k => stage.outline.reduce((sum, place) => sum + place[k], 0) / stage.outline.length);
    stage.frame([Math.cos(a), Math.sin(a), arguments[1]]);
    if (arguments[2] < 1) { stage.look(middle); stage.nearer(arguments[2]); }
"""
PLACE = """
    const stage = document.getElementById("view").stage, box = stage.view.getBoundingClientRect();
    const middle = [0, 1].map(k => stage.outline.reduce((sum, place) => sum + place[k], 0) / stage.outline.length);
    const along = place => Math.atan2(place[1] - middle[1], place[0] - middle[0]) * 180 / Math.PI;
    const off = place => Math.abs((along(place) - arguments[0] + 540) % 360 - 180);
    const seen = stage.project(stage.outline.reduce((best, place) => off(place) < off(best) ? place : best));
    return [box.left + seen.x, box.top + seen.y];
"""


def picture(browser: Browser, name: str) -> None:
    """What the window shows, once it has nothing more to fetch."""
    browser.until(IDLE)
    browser.run("return new Promise(done => setTimeout(done, 3000))")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "shot.png"
        browser.picture(path)
        with Image.open(path) as shot:
            shot.convert("RGB").save(FIGURES / name, quality=82, method=6)


def main() -> None:
    demo = Path(sys.argv[1] if len(sys.argv) > 1 else "demo")
    with tempfile.TemporaryDirectory() as folder:
        words = [*map(str, sorted((demo / "scan").glob("station*.ply"))), "--out", f"{folder}/rock"]
        command = subprocess.Popen(
            [sys.executable, "-P", "-m", "toppling", "scan", *words, "--pick", "--no-open"],
            stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        try:
            assert command.stdout is not None
            address = re.search(r"http://\S+", command.stdout.readline())
            assert address, "the page's address is the first line"
            with browsing(Path(folder) / "profile", **SIZE) as browser:
                browser.open(address[0])
                browser.until(IDLE, 600)
                picture(browser, "pick_rock.webp")
                browser.click("[data-mode=touch]")
                browser.run(TURN, LOOK_DEG, 0.25, 0.35)
                for count, azimuth_deg in enumerate(TOUCHES_DEG, 1):
                    browser.click_at(*browser.run(PLACE, azimuth_deg))
                    browser.until(f"document.querySelectorAll('#hints li .touch').length == {count}")
                picture(browser, "pick_crevice.webp")
        finally:
            command.send_signal(signal.SIGINT)
            command.communicate(timeout=120)


if __name__ == "__main__":
    main()
