"""`toppling study` to its end: runs, ramp, figures, findings and report."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

TOPPLING = str(Path(sys.executable).with_name("toppling"))


@pytest.mark.thorough
def test_a_small_study_writes_all_that_it_promises(inputs, tmp_path):
    out = tmp_path / "study"
    options = [
        "--pga-step",
        "9",
        "--directions",
        "2",
        "--preset",
        "draft",
        "--audit",
        "0",
        "--workers",
        "1",
        "--json",
    ]
    given = ["--scene", inputs / "scene", "--records", inputs / "ensemble"]
    said = subprocess.run(
        [TOPPLING, "study", out, *given, *options], capture_output=True, text=True, timeout=300, check=False
    )
    assert said.returncode == 0, said.stderr
    content = json.loads(said.stdout[said.stdout.index("{") :])
    assert content["runs"]["main"]["done"] == 3 * 3 * 2
    assert len(content["findings"]) == 9
    for name in (
        "findings.md",
        "figures/figure_04.png",
        "figures/figure_11.png",
        "report.html",
    ):
        assert (out / name).exists(), name
