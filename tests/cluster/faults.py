"""Loaded by workers in tests: jobs crash, hang, fail or wait as a file tells, or no worker lives to join."""

import json
import os
import signal
import time
from pathlib import Path

from toppling.orchestrator import task

FAULTS_VARIABLE = "TOPPLING_TEST_FAULTS"
STILLBORN_VARIABLE = "TOPPLING_TEST_STILLBORN"


def _strike(job_id):
    """Let a job's fault happen."""
    control = Path(os.environ[FAULTS_VARIABLE])
    if not control.exists():
        return
    faults = json.loads(control.read_text())
    fault = faults.get(job_id) or faults.get("every")
    if fault is None:
        return
    if "times" in fault:
        progress = control.with_name(f"{control.name}.{job_id}")
        with progress.open("a") as file:
            file.write("x")
        if progress.stat().st_size > fault["times"]:
            return
    if fault["kind"] == "segfault":
        os.kill(os.getpid(), signal.SIGSEGV)
    elif fault["kind"] == "freeze":
        os.kill(os.getpid(), signal.SIGSTOP)
    elif fault["kind"] == "hang":
        time.sleep(10_000)
    elif fault["kind"] == "raise":
        1 / 0  # noqa: B018  (the exception is the point)
    elif fault["kind"] == "wait":
        time.sleep(fault["seconds"])


if not hasattr(task, "genuine_run_job"):
    task.genuine_run_job = task.run_job

    def run_job(spec, assets):
        _strike(spec.job_id)
        return task.genuine_run_job(spec, assets)

    task.run_job = run_job

if STILLBORN_VARIABLE in os.environ:
    os.kill(os.getpid(), signal.SIGKILL)
