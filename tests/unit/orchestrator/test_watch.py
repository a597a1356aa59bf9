"""A run in a browser: what the page is told, who may ask, how it is opened, and that nothing in the run changes."""

import hashlib
import http.client
import json
import os
import signal
import subprocess
import sys
import threading
from datetime import UTC, datetime, timedelta

import pytest
from driven import browsing, needs_driver
from small_campaigns import planned_in
from waiting import wait_until

from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.orchestrator.run_folder import prepare
from toppling.orchestrator.task import lost_row, versions
from toppling.orchestrator.verbs.watch import watching
from toppling.results.store import write_part
from toppling.workers.job import Assets, run_job

STRANGE = "<img src=x onerror=document.title='owned'>"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run of 12 jobs, of which 7 are stored: 6 with an answer, one that failed with a strange message."""
    folder = tmp_path_factory.mktemp("watched")
    planned = planned_in(folder, (0.6, 1.6), pga_m_s2=[1, 4, 8], preset="fast")
    assets = Assets(Scene.load(folder / "scene"), Ensemble.load(folder / "ensemble"))
    prepare(folder / "run", planned, dict(versions()))
    now = datetime.now(UTC)
    rows = [
        run_job(planned.spec(job), assets) | {"attempt": 1, "finished_at": now + timedelta(seconds=job)}
        for job in range(6)
    ]
    failed = lost_row(planned.spec(6), "failed", STRANGE) | {"attempt": 1, "finished_at": now}
    write_part(folder / "run", [*rows, failed])
    return folder / "run"


def content(run):
    files = [path for path in sorted(run.rglob("*")) if path.is_file() and path.name != ".lock"]
    return {str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.fixture(scope="module")
def server(run, tmp_path_factory):
    before = content(run)
    with watching(run, tmp_path_factory.mktemp("replays")) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield server
        server.shutdown()
        server.replays.end()
    assert content(run) == before, "watching has written into the run"


def asked(server, path="", timeout_s=30):
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=timeout_s)
    connection.request("GET", path)
    answer = connection.getresponse()
    return answer.status, answer.read().decode()


def state(server):
    return json.loads(asked(server, f"/{server.secret}/state.json")[1])


def test_the_page_shows_progress_failures_cells_and_the_latest_topplings(server):
    state_now = state(server)
    assert (state_now["jobs"], state_now["stored"], state_now["state"]) == (12, 7, "interrupted")
    assert [(failure["jobs"], failure["message"]) for failure in state_now["failures"]] == [(1, STRANGE)]
    (shown,) = state_now["maps"]
    assert sum(cell["jobs"] for cell in shown["cells"]) == 6
    assert shown["rows"] == ["1", "4", "8"]
    assert sum(cell["toppled"] for cell in shown["cells"]) == len(state_now["latest"]) > 0
    assert state_now["latest"][0]["topple_time_s"] > 0


@pytest.mark.parametrize(
    "path", ["run.json", "../run.json", "replay/", "replay/../x", "replay/ABCDEFGH", "replay/--help12"]
)
def test_nothing_but_the_page_its_state_and_replays_is_there(server, path):
    assert asked(server, f"/{server.secret}/{path}")[0] == 404


@pytest.mark.thorough
def test_a_toppling_is_replayed_on_a_click(server):
    job = state(server)["latest"][0]["job_id"]
    page = asked(server, f"/{server.secret}/replay/{job}", timeout_s=120)[1]
    assert "toppled</title>" in page
    assert "<canvas" in page or "view" in page


@needs_driver
def test_a_browser_draws_the_map_and_runs_no_script_from_a_run(server, tmp_path):
    with browsing(tmp_path) as browser:
        browser.open(server.address)
        browser.until("document.querySelectorAll('#latest button').length")
        document, complaints = browser.run("return document.documentElement.outerHTML"), browser.complaints()
    state_now = state(server)
    assert document.count('class="cell"') == len(state_now["maps"][0]["cells"])
    assert document.count(">replay</button>") == len(state_now["latest"])
    assert "&lt;img src=x" in document
    assert "owned</title>" not in document
    assert not complaints


PROGRAM = """
from toppling.orchestrator.loopback import Answers, Loopback
from toppling.orchestrator.verbs.shared_options import served
server = Loopback(Answers)
print(server.secret, flush=True)
served(server, "page", True, "ended")
"""
PRETENDED = """#!{python}
import json, os, pathlib, stat, sys, urllib.request
page = pathlib.Path(urllib.request.url2pathname(sys.argv[-1].removeprefix("file://")))
seen = {{"argv": sys.argv, "page": str(page), "text": page.read_text()}}
seen["modes"] = [stat.S_IMODE(path.stat().st_mode) for path in (page, page.parent)]
told = pathlib.Path(__file__).with_name("seen.json")
told.with_suffix(".tmp").write_text(json.dumps(seen))
told.with_suffix(".tmp").replace(told)
"""


def test_no_argument_of_the_browser_holds_the_secret_and_only_this_account_reads_the_page(tmp_path):
    browser, seen = tmp_path / "browser", tmp_path / "seen.json"
    browser.write_text(PRETENDED.format(python=sys.executable))
    browser.chmod(0o755)
    began = subprocess.Popen(
        [sys.executable, "-c", PROGRAM], env=os.environ | {"BROWSER": str(browser)},
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    secret = began.stdout.readline().strip()
    wait_until(seen.exists)
    found = json.loads(seen.read_text())
    assert len(secret) > 16
    assert secret not in " ".join(found["argv"])
    assert secret in found["text"]
    assert found["modes"] == [0o600, 0o700]
    began.send_signal(signal.SIGINT)
    began.communicate(timeout=60.0)
    assert not os.path.exists(found["page"])  # noqa: PTH110
