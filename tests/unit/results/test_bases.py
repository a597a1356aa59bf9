"""An interval over records and bases holds what topples the rock on one of these; its parts say whence it comes."""

import numpy as np
import pandas as pd
import pytest

from toppling.orchestrator.plan import realisations_spread
from toppling.results.analysis.lognormal import design_of, fit
from toppling.results.analysis.resampling import base_spread, narrowed_by, sampled

MEDIAN, RECORDS, LEVELS, AZIMUTHS = 0.5, 24, 6, 4
FROM_RECORD, FROM_JOB = 0.25, 0.25
"""Standard deviations of the logarithm of what topples the rock, from record to record and from job to job."""


def run(between_bases, bases=25, seed=0):
    """Jobs of a rock whose bases differ by a standard deviation of the logarithm, and the median of one more base."""
    random = np.random.default_rng(seed)
    realisation = realisations_spread(RECORDS, LEVELS, AZIMUTHS, bases)
    record, level, azimuth, _ = np.indices(realisation.shape).reshape(4, -1)
    base, own = realisation.ravel(), 0.4 * random.normal(size=RECORDS)
    threshold = np.log(MEDIAN) + FROM_RECORD * random.normal(size=RECORDS)[record]
    threshold += between_bases * random.normal(size=bases)[base] + FROM_JOB * random.normal(size=len(base))
    log_x = np.log(MEDIAN) + np.linspace(-1.2, 1.2, LEVELS)[level] + own[record]
    jobs = pd.DataFrame({
        "record_id": [f"r{number}" for number in record], "realisation": base, "base": base, "azimuth_deg": azimuth,
        "pgv_m_s": np.exp(log_x), "toppled": log_x > threshold, "scene_id": "rock",
    })  # fmt: skip
    return jobs, MEDIAN * np.exp(between_bases * random.normal())


def curve_of(jobs):
    return sampled(jobs, fit(jobs, ["pgv_m_s"])).lognormal


@pytest.mark.parametrize(
    ("levels", "azimuths", "count"), [(3, 1, 8), (2, 2, 25), (6, 4, 25), (1, 1, 7), (5, 1, 6)]
)
def test_every_record_has_all_bases_equally_often_and_no_job_twice(levels, azimuths, count):
    for of_record in realisations_spread(10, levels, azimuths, count):
        often = np.bincount(of_record.ravel(), minlength=count)
        assert len(often) == count
        assert np.ptp(often) <= 1
        points = of_record.reshape(-1, of_record.shape[-1]).tolist()
        assert all(len(set(point)) == len(point) for point in points)


@pytest.mark.thorough
@pytest.mark.parametrize("between_bases", [0.0, 0.1, 0.3, 0.6])
def test_the_interval_holds_the_median_of_a_single_base_in_nine_of_ten_runs(between_bases):
    held = []
    for seed in range(40):
        jobs, of_one = run(between_bases, seed=seed)
        low, high = curve_of(jobs).median_interval
        held.append(low <= of_one <= high)
    assert np.mean(held) >= 0.9


@pytest.mark.parametrize("between_bases", [0.3, 0.6])
def test_the_part_of_the_base_is_how_far_bases_differ(between_bases):
    parts = [curve_of(run(between_bases, seed=seed)[0]).interval_parts for seed in range(12)]
    assert np.median([p["base"] for p in parts]) == pytest.approx(np.sinh(1.96 * between_bases), rel=0.2)
    assert 0.08 < np.median([p["records"] for p in parts]) < 0.16


@pytest.mark.parametrize(("bases", "names"), [(25, ["records", "base"]), (1, ["records"])])
def test_parts_add_up_to_the_interval_in_squares_of_logarithms(bases, names):
    jobs, _ = run(0.3)
    curve = curve_of(jobs.assign(realisation=jobs["realisation"] % bases))
    half = 0.5 * np.log(np.divide(*curve.median_interval[::-1]))
    assert [*curve.interval_parts] == names
    assert np.linalg.norm(np.arcsinh([*curve.interval_parts.values()])) == pytest.approx(half)


@pytest.mark.parametrize("scan", [{}, {"unseen_base": {"kinds": {"flat": 0.5, "rough": 0.5}}}])
def test_records_are_what_narrows_an_interval_only_where_their_part_is_the_larger(scan):
    more = narrowed_by({"records": 0.2}, scan)
    assert narrowed_by({"records": 0.2, "base": 0.1}, scan) == more
    assert narrowed_by({"records": 0.1, "base": 0.2}, scan) not in ("", more)
    assert narrowed_by({}, scan) == ""


@pytest.mark.parametrize(
    ("width", "named"),
    [
        (0.2, "a pull toward S60W, more than"),
        (0.4, "touches and daylight"),  # no wider now
    ],
)
def test_a_pull_is_named_where_it_is_expected_to_narrow_the_interval(width, named):
    pulls = [{"kind": "pull", "from_deg": 210.0, "to_deg": 210.0, "width": width}]
    now = [{"low_m_s2": 1.8, "median_m_s2": 2.0, "high_m_s2": 2.6}]
    found = {"next_observations": pulls, "toppling": now}
    assert f"narrowed by {named}" in narrowed_by({"records": 0.1, "base": 0.2}, {"unseen_base": found})


def test_curves_of_single_bases_average_to_that_of_all():
    jobs, _ = run(0.6)
    fitted = sampled(jobs, fit(jobs, ["pgv_m_s"]), samples=400)
    x = np.geomspace(0.2, 1.5, 7)
    entry = [c.probability(x) for c in fitted.resampled.lognormals("pgv_m_s")]
    assert np.mean(entry, axis=0) == pytest.approx(fitted.lognormal.probability(x), abs=0.04)
    assert all(c.beta < fitted.lognormal.beta * 1.3 for c in fitted.resampled.lognormals("pgv_m_s"))


def test_bases_without_weight_do_not_affect_the_spread_between_bases():
    jobs, _ = run(0.0)
    far = jobs["base"] % 2 == 1
    moved = jobs.assign(toppled=np.where(far, jobs["pgv_m_s"] > 4.0 * MEDIAN, jobs["toppled"]))
    weighed = moved.assign(base_weight=np.where(far, 1e-9, 2.0), record_weight=np.where(far, 1e-9, 2.0))
    of_all, of_even = (
        base_spread(v, design_of(v, ["pgv_m_s"]) @ fit(v, ["pgv_m_s"]).coefficients).half_width
        for v in (moved, weighed)
    )
    assert of_all > 1.1
    assert of_even < 0.7
