"""The comparison of settings: flips, their bias, and the cost beside them."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

from toppling.models.contact import ContactProperties
from toppling.models.errors import InputError
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.synthetic import synthetic_ensemble
from toppling.models.scene import Scene
from toppling.models.shapes import box
from toppling.orchestrator.studies import accuracy as front
from toppling.orchestrator.studies.accuracy import (
    Setting,
    _disturbed_start,
    answers,
    compare,
    draw_jobs,
)
from toppling.orchestrator.verbs.accuracy import accuracy
from toppling.workers.options import PRESETS

COUNT = 40
FAST = Setting(PRESETS["fast"])


def said(toppled, processor_s=10.0):
    return pd.DataFrame(
        {
            "record_id": [f"R{k % 8}" for k in range(COUNT)],
            "pga_m_s2": 1.0 + 0.25 * np.arange(COUNT),
            "toppled": np.asarray(toppled, bool),
            "processor_s": processor_s / COUNT,
            "simulated_s": 100.0 / COUNT,
            "penetration_share": 1e-5,
            "max_tilt_deg": np.where(toppled, 90.0, 2.0),
        }
    )


@pytest.fixture
def converged():
    # Mostly those above 6 m/s2, with a few on the wrong side so that a fit exists.
    toppled = 1.0 + 0.25 * np.arange(COUNT) > 6.0
    toppled[[12, 15]], toppled[[24, 27]] = True, False
    return said(toppled)


@pytest.fixture(scope="module")
def ensemble(tmp_path_factory):
    return Ensemble.write(tmp_path_factory.mktemp("quakes"), synthetic_ensemble(2, 3))


def test_equal_answers_have_no_flips_no_bias_and_no_shift(converged):
    row = compare({"same": said(converged.toppled, processor_s=3.0)}, converged).iloc[0]
    assert (row.flips_share, row.sign_test_p, row.median_shift) == (0.0, 1.0, 0.0)
    assert row.median_shift_std == 0.0
    assert row.processor_s_per_simulated_s == pytest.approx(0.03)
    assert row.processor_s_per_job == pytest.approx(3.0 / COUNT)


def test_flips_one_way_only_are_a_bias_and_shift_the_median(converged):
    # Six flips one way: two-sided sign test 2 / 2^6.
    other = converged.toppled.to_numpy(copy=True)
    other[np.flatnonzero(other)[:6]] = False
    row = compare({"stable": said(other)}, converged).iloc[0]
    assert (row.flips_to_toppled, row.flips_to_standing) == (0, 6)
    assert row.sign_test_p == pytest.approx(2 / 2**6)
    assert row.median_shift > 0.05
    assert row.share_shift == pytest.approx(-6 / COUNT)
    # Of the paired differences, six of which are -1.
    assert row.share_shift_std == pytest.approx(np.std([-1.0] * 6 + [0.0] * (COUNT - 6)) / np.sqrt(COUNT))


@pytest.mark.thorough
def test_the_stated_spread_of_the_medians_shift_is_that_over_other_jobs(monkeypatch):
    random = np.random.default_rng(5)

    def one_comparison(jobs=300):
        pga = random.uniform(3.0, 12.0, jobs)
        toppled = pga * random.lognormal(0.0, 0.3, jobs) > 8.0
        rest = {"processor_s": 1.0, "simulated_s": 1.0, "penetration_share": 0.0, "max_tilt_deg": 1.0}
        rest |= {"record_id": [f"R{k % 8}" for k in range(jobs)], "pga_m_s2": pga}
        flipped = toppled ^ (random.random(jobs) < 0.06)
        of_preset, of_reference = (pd.DataFrame({"toppled": one, **rest}) for one in (flipped, toppled))
        return compare({"preset": of_preset}, of_reference).iloc[0]

    stated = [one_comparison().median_shift_std for _ in range(4)]
    monkeypatch.setattr(front, "_GROUPS", 1)  # only the shifts are looked at
    found = np.std([one_comparison().median_shift for _ in range(40)], ddof=1)
    # The spread of 40 draws is known to 11 %, the mean of four, each with 19 degrees of freedom, to 8: three sigma.
    assert np.sqrt(np.mean(np.square(stated))) == pytest.approx(found, rel=0.4)


def test_a_job_without_an_answer_is_no_flip_and_counts_in_no_share(converged):
    toppled = converged.toppled.astype("boolean")
    toppled[:4] = pd.NA
    row = compare({"some": converged.assign(toppled=toppled)}, converged).iloc[0]
    assert (row.jobs, row.no_answer, row.flips_share) == (COUNT - 4, 4, 0.0)


def test_without_a_job_that_stands_or_has_an_answer_there_is_no_share_and_no_lean(converged):
    fallen = said(np.ones(COUNT))
    assert np.isnan(compare({"all topple": fallen}, fallen).tilt_log_ratio_std.iloc[0])
    silent = fallen.assign(toppled=None)
    row = compare({"no answer": silent}, fallen).iloc[0]
    assert row.no_answer == COUNT
    assert np.isnan([row.flips_share, row.flips_share_std, row.median_shift, row.tilt_log_ratio]).all()


def test_a_setting_that_answered_the_first_jobs_is_compared_over_these(converged):
    # One of these flips; costs are those of the jobs that both have answered.
    few = COUNT // 2
    costly = converged.assign(processor_s=np.where(np.arange(COUNT) < few, 1.0, 9.0))
    other = converged.iloc[:few].assign(toppled=converged.toppled[:few] ^ (np.arange(few) == 0))
    table = compare({"all": costly, "few": other}, converged)
    table = table.set_index("setting")
    assert table.jobs.to_dict() == {"all": COUNT, "few": few}
    assert table.flips_share.to_dict() == {"all": 0.0, "few": 1.0 / few}
    assert table.processor_s_per_job["all"] == 1.0


def test_a_lean_of_the_tilts_is_the_mean_log_ratio_where_both_stand(converged):
    # Half of the tilts are e times the converged ones; toppled rocks say nothing, one that never moved no lean.
    first, *others = np.flatnonzero(~converged.toppled)
    tilt = converged.max_tilt_deg.to_numpy(copy=True)
    tilt[others[::2]] *= np.e
    still = [converged.assign(max_tilt_deg=np.where(np.arange(COUNT) == first, 0.0, t))
             for t in (tilt, converged.max_tilt_deg)]  # fmt: skip
    row = compare({"larger": still[0]}, still[1]).iloc[0]
    share = len(others[::2]) / (len(others) + 1)
    assert row.tilt_log_ratio == pytest.approx(share)
    assert row.tilt_log_ratio_std == pytest.approx(np.sqrt(share * (1 - share) / len(others)))


def test_kept_answers_are_not_computed_again_and_more_jobs_add_to_them(tmp_path, ensemble):
    scene, jobs = Scene.block(0.25, 0.2, 0.6), draw_jobs(ensemble, 3, (3.0, 9.0))
    first = answers(scene, ensemble, jobs[:2], FAST, processes=1, kept=tmp_path)
    more = answers(scene, ensemble, jobs, FAST, processes=1, kept=tmp_path)
    assert more[:2].equals(first)  # processor_s too: a job that is shaken again takes another time
    assert len(list(tmp_path.glob("*.parquet"))) == 1
    answers(scene, ensemble, jobs[:1], replace(FAST, disturbed_toward_deg=0.0), processes=1, kept=tmp_path)
    assert len(list(tmp_path.glob("*.parquet"))) == 2
    smoother = scene.with_contact(ContactProperties.of(0.5))
    answers(smoother, ensemble, jobs[:1], FAST, processes=1, kept=tmp_path)
    assert len(list(tmp_path.glob("*.parquet"))) == 3


def test_a_rock_that_does_not_stand_is_refused_as_everywhere(ensemble):
    slender = box(0.2, 0.2, 0.6)
    on_slope = Scene.from_mesh((slender.vertices_m, slender.faces), slope_deg=25)  # alpha is 18 degrees
    with pytest.raises(InputError, match="left alone, the rock does not stand"):
        answers(on_slope, ensemble, draw_jobs(ensemble, 1, (2.0, 3.0)), FAST)


def test_a_disturbed_start_tilts_toward_its_azimuth_and_touches_nothing():
    scene = Scene.block(0.25, 0.2, 0.6)
    start = _disturbed_start(scene, 90.0)
    turn = Rotation.from_quat(start.quaternion_xyzw)
    # 1e-6 rad toward y, good to its square.
    assert turn.apply([0.0, 0.0, 1.0]) == pytest.approx([0.0, 1e-6, 1.0], abs=1e-11)
    corners = turn.apply(scene.rock.vertices_m - scene.rock.com_m) + start.position_m
    assert 0.0 < corners[:, 2].min() < 2e-6


@pytest.mark.slow
def test_the_command_compares_the_presets_and_draws_the_front(tmp_path, ensemble):
    Scene.block(0.25, 0.2, 0.6, friction=0.8).save(tmp_path / "scene")
    arguments = [
        str(tmp_path / "scene"),
        str(ensemble.folder),
        "--out",
        str(tmp_path / "out"),
        "--jobs",
        "10",
    ]
    result = CliRunner().invoke(accuracy, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    table = pd.read_csv(tmp_path / "out" / "accuracy.csv").set_index("setting")
    assert {"draft", "fast", "standard", "reference", "reference, disturbed", "mujoco draft"} <= set(
        table.index
    )
    assert table.loc["reference", "flips_share"] == 0.0
    assert (
        table.loc["fast", "processor_s_per_simulated_s"]
        < table.loc["reference", "processor_s_per_simulated_s"]
    )
    assert (tmp_path / "out" / "front.svg").stat().st_size > 0
