"""The page of `toppling scan --pick` in a real browser: clicks become hints, and the saved scan repeats without it."""

import json
import re
import signal
import subprocess
import sys
from contextlib import contextmanager

import numpy as np
import pytest
from driven import CONTROL, browsing, needs_driver
from virtual_rocks import stump_on_a_slope

from toppling.models.scan import virtual

pytestmark = pytest.mark.thorough

COMMAND = [sys.executable, "-P", "-m", "toppling", "scan"]
OUTLINED = "document.getElementById('view').stage.outline.length"
IDLE = "!document.getElementById('stage').classList.contains('busy') && document.body.dataset.current"


@pytest.fixture(scope="module")
def cloud(tmp_path_factory):
    """A boulder of 2 m on a slope, from five stations."""
    truth = stump_on_a_slope()
    scans = virtual.scan_around(truth, seed=1, stations=5, resolution_per_height=0.02)
    cloud, _ = virtual.cloud_of(scans, virtual.DEMO_ORIGIN_M)
    path = tmp_path_factory.mktemp("picked") / "cloud.xyz"
    np.savetxt(path, cloud.points_m + cloud.origin_m, fmt="%.5f")
    return path


@contextmanager
def opened(folder, *words):
    """The page of a scan, once it is up to date, and the command that serves it."""
    command = subprocess.Popen(
        [*COMMAND, *map(str, words), "--pick", "--no-open"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        address = re.search(r"http://\S+", command.stdout.readline())[0]
        with browsing(folder / "profile") as browser:
            browser.open(address)
            browser.until(f"{IDLE} == 'true'")
            yield browser, command
    finally:
        if command.poll() is None:
            command.send_signal(signal.SIGINT)
        command.communicate(timeout=120)


@pytest.fixture(scope="module")
def page(cloud):
    with opened(cloud.parent, cloud, "--out", cloud.parent / "rock") as page:
        yield page


def scene(folder):
    return json.loads((folder / "scene.json").read_text())


def click_outline(browser):
    """Click where the rock's outline on its pedestal is nearest to the eye, once there is one."""
    browser.until(OUTLINED)
    x, y = browser.run("""
        const stage = document.getElementById("view").stage, box = stage.view.getBoundingClientRect();
        const seen = stage.outline.map(place => stage.project(place)).sort((a, b) => a.depth - b.depth);
        return [box.left + seen[0].x, box.top + seen[0].y];
    """)
    browser.click_at(x, y)


@needs_driver
def test_what_a_click_gets_wrong_is_reported_with_its_remedy_and_taken_back(page, cloud):
    browser, _ = page
    browser.click("[data-mode=daylight]")
    browser.click_at(60, 560)  # the ground in front, far from the rock
    browser.until("document.getElementById('error').innerText.includes('What to do')")
    assert browser.run("return document.getElementById('save').disabled")
    assert "error above" in browser.run("return document.getElementById('why').innerText")
    browser.keys("z", held=CONTROL)
    browser.until(f"{IDLE} == 'true'")
    assert browser.run("return document.getElementById('error').hidden")
    assert not browser.run("return document.querySelectorAll('#hints li .daylight').length")
    assert not (cloud.parent / "rock").exists()


@needs_driver
def test_what_narrows_most_is_named_and_a_click_goes_there_and_a_false_pull_is_reported(page):
    browser, _ = page
    first = "document.querySelector('#next button')"
    named = browser.run(f"return {first}.textContent")
    assert re.fullmatch(r"a pull toward \w+", named)
    browser.run(f"{first}.click()")
    assert browser.run("return document.getElementById('pull').azimuth.value") == named.split()[-1]
    text = "document.getElementById('warnings').innerText"
    assert browser.run(f"return {text}") == ""
    browser.run("""
        const form = document.getElementById("pull");
        form.azimuth.value = " compass:40"; form.ratio.value = 2; form.requestSubmit();
    """)
    browser.until(f"{IDLE} == 'true' && {text}.includes('the pull of 2 of the weight toward N40E')")
    assert "--" not in browser.run(f"return {text}")  # the page's words, not the command's options
    browser.keys("z", held=CONTROL)
    browser.until(f"{IDLE} == 'true' && {text} == ''")


@needs_driver
def test_the_plane_is_a_handle_and_a_drag_is_a_hint(page):
    browser, _ = page
    browser.click("[data-mode=plane]")
    height = "return +document.getElementById('plane').z.value"
    before = browser.run(height)
    x, y = browser.run("""
        const box = document.querySelector(".knob.lift").getBoundingClientRect();
        return [box.x + box.width / 2, box.y + box.height / 2];
    """)
    browser.drag((x, y), (x, y - 30))
    browser.until("document.getElementById('hints').innerText.includes('plane: ')")
    assert (
        before + 0.02 < browser.run(height) < before + 0.5
    )  # metres; the rock is 2 m high on some 400 pixels
    browser.keys("z", held=CONTROL)
    browser.until(f"{IDLE} == 'true'")
    assert browser.run("return document.getElementById('hints').innerText") == "none yet"


@needs_driver
def test_the_base_is_stated_by_its_controls_and_touches_alone_once_there_are_three(page):
    browser, _ = page
    least, text = (f"return document.getElementById('{name}').innerText" for name in ("least", "hints"))
    before = browser.run(least)
    assert "90 %" in browser.run("return document.getElementById('numbers').innerText")
    assert "by its rim" in browser.run("return document.getElementById('notes').textContent")
    browser.click("#base option:nth-child(2)")
    browser.until(f"{IDLE} == 'true' && {text[7:]}.includes('base: flat')")
    assert browser.run(least) != before
    assert browser.run("return document.getElementById('base').only.disabled")
    browser.keys("z", held=CONTROL)
    browser.until(f"{IDLE} == 'true' && {text[7:]} == 'none yet' && {OUTLINED}")
    browser.click("[data-mode=touch]")
    for count in (1, 2, 3):
        click_outline(browser)
        browser.until(f"document.querySelectorAll('#hints li .touch').length == {count}")
        browser.run("document.getElementById('view').stage.turn(2.1, 0)")
        browser.until(f"{IDLE} == 'true' && {OUTLINED}")
    touching = browser.run(least)
    browser.click("#base input")
    browser.until(f"{IDLE} == 'true' && {text[7:]}.includes('there and nowhere else')")
    assert browser.run("return document.getElementById('error').hidden")
    assert browser.run(least) != touching
    for _ in range(4):
        browser.keys("z", held=CONTROL)
    browser.until(f"{IDLE} == 'true' && {text[7:]} == 'none yet'")


@needs_driver
def test_clicks_become_hints_by_which_the_scan_repeats(page, cloud):
    browser, command = page
    before = browser.run("return document.getElementById('least').textContent")
    assert browser.run("return document.getElementById('rivals').hidden")  # nothing else stands there
    browser.click("#base option:nth-child(3)")
    browser.click("[data-mode=touch]")
    click_outline(browser)
    browser.until("document.querySelectorAll('#hints li .touch').length == 1")
    browser.until(f"{IDLE} == 'true'")
    assert browser.run("return document.getElementById('error').hidden")
    assert browser.run("return document.getElementById('least').textContent") != before
    assert browser.run("return document.querySelectorAll('#plot path[stroke-dasharray]').length") == 2
    browser.click("#save")
    browser.until("document.body.dataset.saved == '1'")
    assert not [complaint for complaint in browser.complaints() if "GPU stall" not in complaint]
    browser.click("#end")
    output, complained = command.communicate(timeout=120)
    assert command.returncode == 0, complained
    assert "rock of" in output
    again = [*COMMAND, str(cloud), "--out", str(cloud.parent / "again")]
    done = subprocess.run(
        [*again, "--hints", str(cloud.parent / "rock" / "hints.toml")], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    first, other = scene(cloud.parent / "rock"), scene(cloud.parent / "again")
    assert first["id"] == other["id"]
    assert first["report"] == other["report"]
    # Of a scene that is drawn again, whose clouds are not read, no hint on these is asked for.
    with opened(cloud.parent / "drawn", "--again", cloud.parent / "rock") as (browser, _):
        assert browser.run("return document.getElementById('modes').innerText").split() == [
            "LookL",
            "TouchT",
            "DaylightD",
        ]
        browser.keys("p")
        assert browser.run("return document.querySelector('[aria-checked=true]').dataset.mode") == "look"
