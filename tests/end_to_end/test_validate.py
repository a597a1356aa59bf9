"""An experiment that the test makes itself is foretold by the command, workers and all."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import trimesh

TOPPLING = str(Path(sys.executable).with_name("toppling"))
PGA_M_S2 = {1: 0.3, 2: 0.5, 3: 0.4, 4: 9.0, 5: 10.0, 6: 11.0}


@pytest.fixture(scope="module")
def experiment(tmp_path_factory):
    """A slender block; pulses of a second far below and far above what overturns it."""
    folder = tmp_path_factory.mktemp("table")
    mesh = trimesh.creation.box((0.3, 0.3, 1.0))
    for _ in range(3):
        mesh = mesh.subdivide()
    mesh.export(folder / "block.ply")
    time_s = np.arange(0.0, 3.0, 0.01)
    pulse = np.where(time_s < 1.0, np.sin(2.0 * np.pi * time_s), 0.0)
    motions = [pga * pulse for pga in PGA_M_S2.values()]
    table = {
        "test_no": list(PGA_M_S2),
        "dt_s": [0.01] * len(motions),
        "acc_m_s2": [m.tolist() for m in motions],
    }
    pq.write_table(pa.table(table), folder / "motions.parquet")
    rows = [f"{number},quake{number % 3},{int(number > 3)},1" for number in PGA_M_S2]
    (folder / "tests.csv").write_text(
        "\n".join(["test_no,ground_motion,sp3_overturned,dem_sp3", *rows]) + "\n"
    )
    return folder


def validate(experiment, out, *options):
    asked = ["--mesh", "block.ply", "--outcome", "sp3_overturned", "--draws", "4", "--workers", "1"]
    return subprocess.run(
        [TOPPLING, "validate", str(experiment), *asked, "--out", str(out), *options],
        capture_output=True, text=True, timeout=400,
    )  # fmt: skip


def test_an_experiment_is_foretold_scored_and_not_shaken_twice(experiment, tmp_path):
    first = validate(experiment, tmp_path / "out", "--json")
    assert first.returncode == 0, first.stderr
    told = json.loads(first.stdout)
    assert (told["n"], told["accuracy"], told["recall"]) == (6, 1.0, 1.0)
    assert [test["probability"] > 0.5 for test in told["tests"]] == [number > 3 for number in PGA_M_S2]
    assert told["peers"]["dem_sp3"]["recall"] == 1.0
    assert told["peers"]["dem_sp3"]["specificity"] == 0.0
    for name in ("unlearnt.json", "unlearnt_tests.csv", "unlearnt_scores.csv", "unlearnt_calibration.png"):
        assert (tmp_path / "out" / name).stat().st_size > 100
    run = tmp_path / "out" / "realisations_0_4" / "results.parquet"
    written = run.stat().st_mtime_ns
    again = validate(experiment, tmp_path / "out", "--learn")
    assert again.returncode == 0, again.stderr
    assert run.stat().st_mtime_ns == written
    assert "base learnt" in again.stdout
    assert json.loads((tmp_path / "out" / "learnt.json").read_text())["accuracy"] == 1.0
    other = validate(experiment, tmp_path / "out", "--draws", "5")
    assert other.returncode == 1
    assert "bases" in other.stderr
    other = validate(experiment, tmp_path / "out", "--seed", "1")
    assert other.returncode == 1
    assert "drawn otherwise" in other.stderr
