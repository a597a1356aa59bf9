"""`toppling watch`: a run in a browser, by a server on the loopback interface that only reads the run.

The address contains a secret, so that no other user of the machine and no other page of the browser has access.
"""

import json
import re
import secrets
import subprocess
import sys
import threading
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import click

from toppling.models.errors import InputError
from toppling.models.files.documents import MOST_SHOWN
from toppling.orchestrator.loopback import HTML, TEXT, Answers, Loopback
from toppling.orchestrator.status import state_of
from toppling.orchestrator.terminal import duration, pace
from toppling.orchestrator.verbs import shared_options as shared
from toppling.orchestrator.verbs.shared_options import browsing_options, served
from toppling.results.analysis import HEADLINE_MEASURE
from toppling.results.reader import Run, open_run

if TYPE_CHECKING:
    import pandas as pd

_JOB = re.compile(r"[0-9a-f]{8,64}")
_STRICT = "default-src 'none'; connect-src 'self'; frame-src 'self'; style-src 'unsafe-inline'; script-src 'nonce-{}'"
_OF_A_REPLAY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval'; style-src 'unsafe-inline'; "
    "img-src data: blob:; worker-src blob:; frame-ancestors 'self'"
)


def shown(run: Path) -> dict[str, Any]:
    """State of a run for the page, for JSON; InputError if the folder is not a run, or a file is damaged."""
    from toppling.results.analysis.fragility import by_contact

    state = state_of(run)
    opened = open_run(run)
    frame = opened.frame()
    counts = ", ".join(f"{name} {count}" for name, count in state["status"].items())
    state_shown = {name: state[name] for name in ("state", "jobs", "stored", "failures")}
    return state_shown | {
        "name": opened.name,
        "sentence": _sentence(state),
        "counts": f"{state['toppled']} toppled, {state['failed']} without an answer"
        + (f" ({counts})" if counts else ""),
        "maps": [
            {"says": _headline(opened, jobs, frame), **_map(name, jobs)}
            for name, jobs in (by_contact(opened.weighted(frame)).items() if len(frame) else ())
        ],
        "latest": _latest(frame),
    }


def _sentence(state: dict[str, Any]) -> str:
    parts = [f"{state['state']}: {state['unfinished'] or 'all {:,} jobs have run'.format(state['jobs'])}"]
    if state["rate_per_s"]:
        parts.append(f"{pace(state['rate_per_s'])}, {duration(state['left_s'])} left")
    if state["workers"] is not None:
        parts.append(f"{state['workers']} workers")
    return ", ".join(parts)


def _headline(run: Run, jobs: "pd.DataFrame", among: "pd.DataFrame") -> str:
    """First sentence of the report for a contact; empty while there are too few topplings."""
    from toppling.results.analysis.fits import curve_over
    from toppling.results.analysis.fragility import contact_words
    from toppling.results.analysis.resampling import narrowed_by
    from toppling.results.drawing.sentences import what_topples

    if (curve := curve_over(jobs, HEADLINE_MEASURE)) is None:
        return ""
    first = what_topples(curve, contact_words(jobs, among), run.on_single_base(jobs))
    return f"{first} {narrowed_by(curve.interval_parts, run.scene_report())}"


def _map(name: str, jobs: "pd.DataFrame") -> dict[str, Any]:
    """Map of PGA and PGV/PGA of a contact, with cells by grid position."""
    from toppling.results.analysis.fragility import cells, planes_of

    table = cells(jobs, planes_of(jobs)["pga_pgv_pga"])
    pulses = sorted(set(zip(table["pgv_pga_s_low"], table["pgv_pga_s_high"], strict=True)))
    levels = sorted(table["level_pga_m_s2"].unique())
    placed = [
        {
            "column": pulses.index((row["pgv_pga_s_low"], row["pgv_pga_s_high"])),
            "row": levels.index(row["level_pga_m_s2"]),
            "jobs": int(row["jobs"]),
            "thin": bool(row["thin"]),
            "toppled": int(row["toppled"]),
            "probability": float(row["probability"]) if row["jobs"] else None,
        }
        for row in table.to_dict("records")
    ]
    columns = [f"{low:.3g} to {high:.3g}" for low, high in pulses]
    return {"name": name, "columns": columns, "rows": [f"{level:g}" for level in levels], "cells": placed}


def _latest(frame: "pd.DataFrame") -> list[dict[str, Any]]:
    """Most recently stored topplings, newest first."""
    toppled = frame[frame["toppled"].fillna(value=False).astype(bool)]
    newest = toppled.sort_values(["finished_at", "job_id"], ascending=False, na_position="last").head(
        MOST_SHOWN
    )
    names = ["job_id", "record_id", "level_pga_m_s2", "azimuth_deg", "falls_toward_deg", "topple_time_s"]
    rounded = newest[names].round({"falls_toward_deg": 0, "topple_time_s": 2})
    return json.loads(rounded.to_json(orient="records"))


class _Replays:
    """Replays of topplings, one at a time, by 'toppling replay' in a subprocess; written to `folder`."""

    def __init__(self, run: Path, folder: Path) -> None:
        self._run, self._folder = run, folder
        self._lock = threading.Lock()
        self._process: subprocess.Popen[str] | None = None

    def page(self, job: str) -> tuple[str, str]:
        """Page of a replay, after it is made, and its kind; text with the reason if that fails."""
        drawn = self._folder / job / "replay.html"
        with self._lock:
            if not drawn.exists():
                words = [sys.executable, "-P", "-m", "toppling", "replay", str(self._run), job]
                self._process = subprocess.Popen(
                    [*words, "--out", str(self._folder / job)],
                    stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
                )  # fmt: skip
                _, errors = self._process.communicate()
                if not drawn.exists():
                    return f"the replay failed: {errors.strip()}", TEXT
            return drawn.read_text(encoding="utf-8"), HTML

    def end(self) -> None:
        """Stop the current replay."""
        if self._process:
            self._process.kill()


class _Watching(Loopback):
    """Server for one run; port 0 for any free port."""

    def __init__(self, run: Path, replays: _Replays, port: int = 0) -> None:
        self.run, self.replays = run, replays
        super().__init__(_Answers, port)


class _Answers(Answers):
    """Handler of GET requests."""

    server: _Watching

    def do_GET(self) -> None:  # noqa: N802  (the library's name)
        """Answer with the page, the state or a replay."""
        asked = self.asked()
        if asked == "":
            from toppling.results.drawing.templates import rendered

            nonce = secrets.token_urlsafe(12)
            page = rendered("watch.html", title="toppling", nonce=nonce)
            self.send(page.encode(), policy=_STRICT.format(nonce))
        elif asked == "state.json":
            try:
                state = shown(self.server.run)
            except (InputError, OSError) as error:
                state = {"error": str(error)}
            self.send(json.dumps(state).encode(), "application/json")
        elif asked is not None and _JOB.fullmatch(job := asked.removeprefix("replay/")) and asked != job:
            page, kind = self.server.replays.page(job)
            self.send(page.encode(), kind, _OF_A_REPLAY)
        else:
            self.refuse()


def watching(run: Path, folder: Path, port: int = 0) -> _Watching:
    """Create the server for a run, with a folder for replays; InputError if it is not a run."""
    state_of(run)
    return _Watching(run, _Replays(run.resolve(), folder), port)


@click.command()
@shared.run_argument
@browsing_options
def watch(run: Path, port: int, opens: bool | None) -> None:
    """Show RUN in a browser while it runs: progress, failures and the map as it fills.

    The page also shows the rate, the time left and the latest topplings, which a click replays. It only
    reads the run, so it may be started and ended (Ctrl-C) at any time. It listens on this machine only, at an address
    that contains a secret. From another machine forward the port: ssh -L PORT:127.0.0.1:PORT HOST.

    \b
    toppling watch runs/first
    """
    # Replays are deleted with the server.
    with TemporaryDirectory(prefix="toppling-watch-") as folder, watching(run, Path(folder), port) as server:
        try:
            served(server, str(run), opens, "ended; a run in progress continues")
        finally:
            server.replays.end()
