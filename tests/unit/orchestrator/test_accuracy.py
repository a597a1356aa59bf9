"""The comparison of settings: flips, their bias, and the cost beside them."""

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from models import Scene
from models.motions.ensemble import Ensemble
from models.motions.synthetic import synthetic_ensemble
from orchestrator.front import Answers, Job, compare
from orchestrator.verbs.accuracy import accuracy

COUNT = 40
JOBS = [Job(f"R{k % 8}", 1.0 + 0.25 * k, 0.0) for k in range(COUNT)]


def said(toppled, cpu_s=10.0):
    return Answers(np.asarray(toppled, bool), cpu_s, 100.0, 1e-5)


@pytest.fixture
def converged():
    # Mostly those above 6 m/s2, with a few on the wrong side so that a fit exists.
    toppled = np.array([job.pga_m_s2 > 6.0 for job in JOBS])
    toppled[[12, 15]], toppled[[24, 27]] = True, False
    return said(toppled)


def test_equal_answers_have_no_flips_no_bias_and_no_shift(converged):
    row = compare(JOBS, {"same": said(converged.toppled, cpu_s=3.0)}, converged).iloc[0]
    assert (row.flips_share, row.sign_test_p, row.median_shift) == (0.0, 1.0, 0.0)
    assert row.cpu_s_per_simulated_s == 0.03
    assert row.cpu_s_per_job == 3.0 / COUNT


def test_flips_one_way_only_are_a_bias_and_shift_the_median(converged):
    # Six flips one way: two-sided sign test 2 / 2^6.
    other = converged.toppled.copy()
    other[np.flatnonzero(other)[:6]] = False
    row = compare(JOBS, {"stable": said(other)}, converged).iloc[0]
    assert (row.flips_to_toppled, row.flips_to_standing) == (0, 6)
    assert row.sign_test_p == pytest.approx(2 / 2**6)
    assert row.median_shift > 0.05


@pytest.mark.slow
def test_the_command_compares_the_presets_and_draws_the_front(tmp_path):
    Scene.block(0.25, 0.2, 0.6, friction=0.8).save(tmp_path / "scene")
    Ensemble.write(tmp_path / "ensemble", synthetic_ensemble(2, 3))
    arguments = [
        str(tmp_path / "scene"),
        str(tmp_path / "ensemble"),
        "--out",
        str(tmp_path / "out"),
        "--jobs",
        "10",
    ]
    result = CliRunner().invoke(accuracy, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    table = pd.read_csv(tmp_path / "out" / "accuracy.csv").set_index("setting")
    assert list(table.index) == ["fast", "standard", "reference", "reference, disturbed"]
    assert table.loc["reference", "flips_share"] == 0.0
    assert table.loc["fast", "cpu_s_per_simulated_s"] < table.loc["reference", "cpu_s_per_simulated_s"]
    assert (tmp_path / "out" / "front.svg").stat().st_size > 0
