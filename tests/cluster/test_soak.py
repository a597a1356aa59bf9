"""Faults of all kinds at random moments, for as long as TOPPLING_SOAK_S says; the tally is printed."""

import os
import random
import signal
import time
from collections import Counter

import psutil
import pytest
from answers import answers_of

from orchestrator import run as run_module

SOAK_S = float(os.environ.get("TOPPLING_SOAK_S", "90"))
SEED = 20260611
SIGNALS = {
    "kill": signal.SIGKILL,
    "segfault": signal.SIGSEGV,
    "abort": signal.SIGABRT,
    "freeze": signal.SIGSTOP,
}


class Storm:
    """Strikes at workers, the client and the part files while a run goes on."""

    def __init__(self, seed):
        self.random = random.Random(seed)
        self.tally = Counter()
        self.next = 0.0
        self.tear = False

    def __call__(self, tally):
        now = time.monotonic()
        if now < self.next:
            return
        self.next = now + self.random.uniform(0.2, 2.0)
        fault = self.random.choice(["kill", "kill", "segfault", "abort", "freeze", "client", "torn"])
        if fault in SIGNALS:
            victims = [process for process in psutil.Process().children(recursive=True) if is_worker(process)]
            if not victims:
                return
            self.random.choice(victims).send_signal(SIGNALS[fault])
            self.tally[fault] += 1
            return
        self.tally[fault] += 1
        self.tear = fault == "torn"
        raise KeyboardInterrupt


def is_worker(process):
    try:
        running = process.status() in (psutil.STATUS_RUNNING, psutil.STATUS_SLEEPING)
        return running and any("spawn_main" in word for word in process.cmdline())
    except psutil.NoSuchProcess:
        return False


def tear_one(run):
    for part in sorted((run / "parts").glob("part-*"))[:1]:
        part.write_bytes(part.read_bytes()[: part.stat().st_size // 2])


@pytest.mark.slow
@pytest.mark.timeout(SOAK_S + 600)
def test_random_faults_lose_no_row_and_change_none(
    carry_out, undisturbed, tmp_path, faults, monkeypatch, capsys
):
    monkeypatch.setattr(run_module, "FLUSH_S", (0.2, 0.2))
    storm, runs, end = Storm(SEED), 0, time.monotonic() + SOAK_S
    faults.set(every={"kind": "wait", "seconds": 0.1})
    while time.monotonic() < end:
        run = tmp_path / f"run{runs}"
        complete = False
        while not complete:
            try:
                carry_out(run, storm if time.monotonic() < end else lambda tally: None, job_limit_s=5.0)
                complete = True
            except KeyboardInterrupt:
                if storm.tear:
                    tear_one(run)
        assert answers_of(run) == undisturbed
        runs += 1
    with capsys.disabled():
        told = f"soak: {storm.tally.total()} faults, {runs} runs, no row lost or changed: {dict(storm.tally)}"
        print(f"\n{told}")  # noqa: T201
    assert storm.tally.total() > 0
