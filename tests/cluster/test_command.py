"""The command itself, a process of its own where it starts workers: exit codes, interruption, other schedulers."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from answers import answers_of
from click.testing import CliRunner
from waiting import wait_until

from toppling.orchestrator.cli import cli
from toppling.orchestrator.status import state_of

TOPPLING = str(Path(sys.executable).with_name("toppling"))


def command(inputs, run, *options):
    return [TOPPLING, "run", str(inputs / "campaign.toml"), "--out", str(run), *options]


def toppling(*arguments, **options):
    return subprocess.run(arguments, capture_output=True, text=True, timeout=240, **options)


def within(*arguments):
    """The command within this process: for what starts no worker."""
    before = signal.getsignal(signal.SIGTERM)
    try:
        return CliRunner().invoke(cli, arguments[1:], catch_exceptions=False)
    finally:
        signal.signal(signal.SIGTERM, before)


def parts(run):
    return list((run / "parts").glob("part-*.parquet"))


@pytest.mark.thorough
def test_interrupting_six_times_loses_no_row_and_prints_how_to_resume(inputs, planned, tmp_path, faults):
    faults.set(every=0.4)
    run = tmp_path / "run"
    # A session of its own, so that the signal reaches workers and client together, as from a terminal.
    process = subprocess.Popen(
        command(inputs, run, "--workers", "2"), start_new_session=True, stderr=subprocess.PIPE, text=True
    )
    wait_until(lambda: parts(run))
    for _ in range(6):
        os.killpg(process.pid, signal.SIGINT)
        time.sleep(0.15)
    _, output = process.communicate(timeout=60)
    assert process.returncode == 130
    assert output.splitlines()[-1] == "stopped; the rows so far are kept, and the same command goes on"
    assert "Traceback" not in output
    assert output.count("stopped") == 1
    state = state_of(run)
    assert state["state"] == "interrupted"
    assert 0 < state["stored"] < len(planned)


@pytest.mark.slow
def test_a_client_killed_between_writing_and_renaming_leaves_a_run_that_resumes(
    inputs, undisturbed, tmp_path
):
    run = tmp_path / "run"
    # The renaming of a part is where this client dies.
    dies = (
        "import os, pathlib, signal, sys; from toppling.orchestrator.cli import main; replace = pathlib.Path.replace\n"
        "def fatal(self, target):\n"
        "    if 'part-' in self.name: os.kill(os.getpid(), signal.SIGKILL)\n"
        "    return replace(self, target)\n"
        "pathlib.Path.replace = fatal\n"
        "if __name__ == '__main__': main()\n"
    )
    script = tmp_path / "dies.py"
    script.write_text(dies)
    died = subprocess.run(
        [sys.executable, str(script), *command(inputs, run, "--workers", "2")[1:]], timeout=240
    )
    assert died.returncode == -signal.SIGKILL
    assert [path.name for path in (run / "parts").iterdir() if not path.name.startswith(".")] == []
    assert len(list((run / "parts").glob(".*.tmp"))) == 1
    assert toppling(*command(inputs, run, "--workers", "2")).returncode == 0
    assert answers_of(run) == undisturbed
    assert list(run.rglob(".*.tmp")) == []


@pytest.mark.thorough
def test_failures_of_earlier_sessions_still_make_exit_code_three(inputs, planned, finished):
    run = finished({3: ("crashed", 4)})
    again = within(*command(inputs, run))
    assert again.exit_code == 3, again.stderr
    assert f"all {len(planned)} jobs done before; in all " in again.stdout
    assert "1 failed" in again.stdout
    assert "--again crashed" in again.stdout
    summary = json.loads(within(*command(inputs, run, "--again", "failed", "--json")).stdout)
    assert (summary["done"], summary["done_before"]) == (0, len(planned))
    assert (summary["failed"], summary["status"]) == (1, {"ok": len(planned) - 1, "crashed": 1})
    assert summary["toppled"] == sum(row["toppled"] is True for row in answers_of(run)) > 0
