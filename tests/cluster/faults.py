"""Loaded by workers in tests: jobs wait as long as a file tells, or no worker lives to join."""

import json
import os
import signal
import time
from pathlib import Path

from toppling.orchestrator import task

FAULTS_VARIABLE = "TOPPLING_TEST_FAULTS"
STILLBORN_VARIABLE = "TOPPLING_TEST_STILLBORN"

if not hasattr(task, "genuine_run_job"):
    task.genuine_run_job = task.run_job

    def run_job(spec, assets):
        control = Path(os.environ[FAULTS_VARIABLE])
        waits_s = json.loads(control.read_text()) if control.exists() else {}
        time.sleep(waits_s.get(spec.job_id, waits_s.get("every", 0.0)))
        return task.genuine_run_job(spec, assets)

    task.run_job = run_job

if STILLBORN_VARIABLE in os.environ:
    os.kill(os.getpid(), signal.SIGKILL)
