"""The programs of examples/ on small inputs: each is run as its first lines say, and its numbers are looked at."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import trimesh

from toppling import Campaign, Ensemble, Scene, run
from toppling.models.motions.synthetic import synthetic_ensemble

EXAMPLES = Path(__file__).parents[2] / "examples"
PGA_M_S2 = {1: 0.3, 2: 0.5, 3: 0.4, 4: 9.0, 5: 10.0, 6: 11.0}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    Scene.block(0.2, 0.2, 0.6, friction=0.8).save(folder / "scene")
    Ensemble.write(folder / "ensemble", synthetic_ensemble(6, 3))
    return folder


def printed(program, *arguments):
    done = subprocess.run(
        [sys.executable, EXAMPLES / program, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=500,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_an_example_is_a_page_on_the_public_interface(path):
    text = path.read_text("utf-8")
    asked = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ImportFrom)]
    inner = [node.module for node in asked if node.module and re.match(r"toppling\.", node.module)]
    assert inner == []
    assert text.count("\n") <= 140


def test_a_weak_pulse_leaves_the_block_standing_and_a_strong_pulse_topples_it(inputs, tmp_path):
    for pgv, outcome in ((0.1, "stands"), (3.0, "toppled")):
        out = tmp_path / f"{outcome}.png"
        text = printed(
            "pulse.py", inputs / "scene", "--pgv", pgv, "--period", 1.0, "--azimuth", 0, "--out", out
        )
        assert text.startswith(outcome)
        assert out.stat().st_size > 10_000


def test_a_ramp_topples_above_the_static_acceleration_and_the_converged_preset_differs_from_itself_in_nothing(
    inputs, tmp_path
):
    given, ramp, accuracy = (
        (inputs / "scene", inputs / "ensemble"),
        tmp_path / "ramp.png",
        tmp_path / "accuracy.png",
    )
    printed("ramp.py", *given, "--count", 2, "--preset", "fast", "--out", ramp)
    assert (pd.read_csv(ramp.with_suffix(".csv"))["toppling_pga_m_s2"].dropna() > 9.81 / 3.0).all()
    printed("accuracy.py", *given, "--jobs", 12, "--out", accuracy)
    table = pd.read_csv(accuracy.with_suffix(".csv")).set_index("preset")
    assert table.loc["reference", ["share_shift", "only_this", "only_reference"]].tolist() == [0.0, 0.0, 0.0]


def test_pulses_far_below_and_far_above_what_overturns_a_block_are_distinguished(tmp_path):
    mesh = trimesh.creation.box((0.3, 0.3, 1.0))
    for _ in range(3):
        mesh = mesh.subdivide()
    mesh.export(tmp_path / "block.ply")
    time_s = np.arange(0.0, 3.0, 0.01)
    pulse = np.where(time_s < 1.0, np.sin(2.0 * np.pi * time_s), 0.0)
    motions = {
        "test_no": list(PGA_M_S2), "dt_s": 0.01, "acc_m_s2": [(pga * pulse).tolist() for pga in PGA_M_S2.values()],
    }  # fmt: skip
    pd.DataFrame(motions).to_parquet(tmp_path / "motions.parquet")
    tests = pd.DataFrame({"test_no": list(PGA_M_S2), "sp3_overturned": [int(n > 3) for n in PGA_M_S2]})
    tests.to_csv(tmp_path / "tests.csv", index=False)
    asked = ("--mesh", "block.ply", "--outcome", "sp3_overturned", "--draws", 4, "--out", tmp_path / "out")
    assert "accuracy 1," in printed("validation.py", tmp_path, *asked)
    table = pd.read_csv(tmp_path / "out" / "tests.csv")
    assert ((table["probability"] > 0.5) == (table["test_no"] > 3)).all()


def test_a_small_study_runs_all_of_its_jobs_and_prints_its_findings(inputs, tmp_path):
    out = tmp_path / "study"
    asked = ("--pga-step", 9, "--directions", 2, "--preset", "fast")
    text = printed("study.py", inputs / "scene", inputs / "ensemble", out, *asked)
    assert f"main: {6 * 3 * 2} jobs" in text
    assert f"friction: {6 * 3 * 3} jobs" in text
    assert len((out / "findings.txt").read_text().splitlines()) == 5
    for name in ("figures/study.png", "figures/main/pga_pgv.png", "report.html"):
        assert next(out.glob(f"**/{Path(name).name}")).stat().st_size > 5000
    again = run(Campaign.read(out / "main" / "campaign.toml"), out / "main")
    assert again.session.done == 0
