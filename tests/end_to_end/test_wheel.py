"""The built wheel goes the whole way without the checkout."""

import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.thorough


def test_the_demo_runs_from_a_wheel(unpacked, tmp_path):
    program = "from toppling.orchestrator.cli import main; main()"
    command = [sys.executable, "-c", program, "demo", "--out", "demo", "--seconds", "1"]
    environment = os.environ | {"PYTHONPATH": str(unpacked), "PYTHONDONTWRITEBYTECODE": "1"}
    told = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=500, check=False
    )
    assert told.returncode == 0, told.stderr[-2000:]
    assert (tmp_path / "demo" / "scene" / "hints.toml").exists()  # as `toppling scan` leaves it
    assert (tmp_path / "demo" / "run" / "results.parquet").exists()
    assert list((tmp_path / "demo" / "fragility").rglob("*.png"))
