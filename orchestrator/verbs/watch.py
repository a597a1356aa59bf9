"""`toppling watch`: a run in a browser, by a server on the loopback interface that reads what `query` reads.

It writes nothing into the run. The address holds a secret, so that no other user of the machine and no other page of
the browser can ask.
"""

import json
import re
import secrets
import subprocess
import sys
import threading
import time
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click
import pandas as pd

from toppling.models.errors import InputError
from toppling.orchestrator.loopback import TEXT, Answers, Loopback
from toppling.orchestrator.progress import duration, pace
from toppling.orchestrator.status import state_of
from toppling.orchestrator.verbs import shared_options as shared
from toppling.orchestrator.verbs.shared_options import browsing_options, served
from toppling.results.analysis.fits import FEW_TOPPLED, HEADLINE_MEASURE, curve_over
from toppling.results.analysis.fragility import by_contact, cells, contact_words, planes_of
from toppling.results.drawing.sentences import what_topples
from toppling.results.drawing.watch_page import PAGE, WAITING
from toppling.results.reader import Run, open_run

_LATEST = 12
"""Topplings that are listed."""

_KEPT_S = 1.5
"""An answer serves all who ask within this time."""

_JOB = re.compile(r"[0-9a-f]{8,64}")
_STRICT = "default-src 'none'; connect-src 'self'; frame-src 'self'; style-src 'unsafe-inline'; script-src 'nonce-{}'"
_OF_A_REPLAY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval'; style-src 'unsafe-inline'; "
    "img-src data: blob:; worker-src blob:; frame-ancestors 'self'"
)


def shown(run: Path) -> dict[str, Any]:
    """What the page shows of a run, in plain values.

    Raises InputError if the folder is no run, or a file of it is damaged.
    """
    state = state_of(run)
    opened = open_run(run)
    frame = opened.frame()
    state_shown = {name: state[name] for name in ("state", "jobs", "stored", "failures")}
    return state_shown | {
        "name": opened.name,
        "sentence": _sentence(state),
        "counts": _counts(state),
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


def _counts(state: dict[str, Any]) -> str:
    counts = ", ".join(f"{name} {count}" for name, count in state["status"].items())
    return f"{state['toppled']} toppled, {state['failed']} without an answer" + (
        f" ({counts})" if counts else ""
    )


def _headline(run: Run, jobs: pd.DataFrame, among: pd.DataFrame) -> str:
    """The report's first sentence of one contact; empty while too few topple."""
    if (jobs["toppled"].fillna(value=False)).sum() < FEW_TOPPLED:
        return ""
    curve = curve_over(jobs, HEADLINE_MEASURE)
    return what_topples(curve, contact_words(jobs, among), run.on_one_base(jobs)) if curve else ""


def _map(name: str, jobs: pd.DataFrame) -> dict[str, Any]:
    """Cells of PGA and PGV/PGA of one contact, as places in a grid."""
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


def _latest(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """The topplings that were stored last, newest first."""
    toppled = frame[frame["toppled"].fillna(value=False).astype(bool)]
    newest = toppled.sort_values(["finished_at", "job_id"], ascending=False, na_position="last").head(_LATEST)
    names = ["job_id", "record_id", "level_pga_m_s2", "azimuth_deg", "falls_toward_deg", "topple_time_s"]
    rounded = newest[names].round({"falls_toward_deg": 0, "topple_time_s": 2})
    return json.loads(rounded.to_json(orient="records"))


class _Replays:
    """Topplings that are replayed, one at a time, by 'toppling replay' in a process of its own, elsewhere than the run.

    folder: where they are written to.
    """

    def __init__(self, run: Path, folder: Path) -> None:
        self._run, self._folder = run, folder
        self._lock = threading.Lock()
        self._process: subprocess.Popen[str] | None = None
        self._job = ""
        self._failed: dict[str, str] = {}

    def page(self, job: str) -> str | None:
        """The replay's page once it is there; until then it is being made, and None is returned.

        Raises InputError if the job cannot be replayed.
        """
        drawn = self._folder / job / "replay.html"
        with self._lock:
            if drawn.exists():
                return drawn.read_text(encoding="utf-8")
            if self._process and self._process.poll() is not None:
                _, said = self._process.communicate()
                if not (self._folder / self._job / "replay.html").exists():
                    self._failed[self._job] = said.strip() or "it ended without a page"
                self._process = None
            if job in self._failed:
                raise InputError(
                    "replay.failed",
                    f"the replay failed: {self._failed.pop(job)}",
                    where=f"job {job}",
                    expected="a job of this run",
                    remedy=f"try it outside: toppling replay {self._run} {job}",
                )
            if self._process is None and not drawn.exists():
                words = [sys.executable, "-P", "-m", "toppling", "replay", str(self._run), job]
                self._process = subprocess.Popen(
                    [*words, "--out", str(self._folder / job)],
                    stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
                )  # fmt: skip
                self._job = job
        return None

    def end(self) -> None:
        """Stop what is being made."""
        if self._process and self._process.poll() is None:
            self._process.kill()
            self._process.communicate()


class _Watching(Loopback):
    """The server of one run.

    port: 0 for any that is free.
    """

    def __init__(self, run: Path, replays: _Replays, port: int = 0) -> None:
        self.run, self.replays = run, replays
        self._answered = -_KEPT_S
        self._answer = b""
        self._lock = threading.Lock()
        super().__init__(_Answers, port)

    def state(self) -> bytes:
        """State of the run as JSON; a run that cannot be read gives an error in its place."""
        with self._lock:
            if time.monotonic() - self._answered > _KEPT_S:
                try:
                    state_shown = shown(self.run)
                except (InputError, OSError) as error:
                    state_shown = {"error": str(error)}
                self._answer = json.dumps(state_shown).encode()
                self._answered = time.monotonic()
            return self._answer


class _Answers(Answers):
    """Answers to GET; nothing else is understood."""

    server: _Watching

    def do_GET(self) -> None:  # noqa: N802  (the library's name)
        """Answer with the page, the state or a replay."""
        asked = self.asked()
        if asked == "":
            nonce = secrets.token_urlsafe(12)
            self.send(PAGE.replace("NONCE", nonce).encode(), policy=_STRICT.format(nonce))
        elif asked == "state.json":
            self.send(self.server.state(), "application/json")
        elif asked is not None and _JOB.fullmatch(job := asked.removeprefix("replay/")) and asked != job:
            self._replay(job)
        else:
            self.refuse()

    def _replay(self, job: str) -> None:
        try:
            page = self.server.replays.page(job)
        except InputError as error:
            self.send(str(error).encode(), TEXT)
            return
        told = f"shaking job {escape(job)} again: some seconds, up to a minute the first time"
        waiting = WAITING.replace("TOLD", told)
        self.send((page or waiting).encode(), policy=_OF_A_REPLAY)


def watching(run: Path, folder: Path, port: int = 0) -> _Watching:
    """Make the server of a run, whose replays go to a folder outside of it.

    Raises InputError if the folder is no run.
    """
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
    # Replays go with the server.
    with TemporaryDirectory(prefix="toppling-watch-") as folder, watching(run, Path(folder), port) as server:
        try:
            served(server, str(run), opens, "ended; a run in progress continues")
        finally:
            server.replays.end()
