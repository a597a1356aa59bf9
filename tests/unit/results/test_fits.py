"""Fits recover what made the data, say when there is none, and take no copy of a record for evidence."""

import math

import numpy as np
import pandas as pd
import pytest
from seeded import BETA, THETA_M_S, rows
from statsmodels.genmod.families import Binomial
from statsmodels.genmod.families.links import Probit
from statsmodels.genmod.generalized_linear_model import GLM

from toppling.results.analysis import FEW
from toppling.results.analysis.fits import (
    ContactFits,
    answered,
    calibration,
    compare_measures,
    curve_over,
    observed_fractions,
    out_of_fold,
    scores,
)
from toppling.results.analysis.fragility import wilson
from toppling.results.analysis.lognormal import Basis, Lognormal, design_of, fit, grouped, lognormal_interval
from toppling.results.analysis.resampling import bootstrap, refitted, sampled
from toppling.results.drawing.sentences import what_topples
from toppling.results.schema import SCHEMA


@pytest.fixture(scope="module")
def jobs():
    return answered(pd.DataFrame(rows(records=60, azimuths=(0.0, 90.0, 180.0)), columns=SCHEMA.names))


def test_the_lognormal_that_made_the_answers_is_recovered(jobs):
    curve = fit(jobs, ["pgv_m_s"]).lognormal
    # 3,420 independent jobs: standard errors are about 1.5 % of the median and 3 % of beta; three of each.
    assert curve.median == pytest.approx(THETA_M_S, rel=0.045)
    assert curve.beta == pytest.approx(BETA, rel=0.09)


def tiny(values, toppled):
    frame = pd.DataFrame({"pgv_m_s": values, "toppled": toppled})
    return frame.assign(record_id=[f"R{number}" for number in range(len(frame))])


T, S = True, False


@pytest.mark.parametrize(
    ("values", "toppled", "problem", "bounds"),
    [
        ([0.5, 0.8, 1.2, 2.0], [S, S, T, T], "separated", (0.8, 1.2)),
        *(([0.5, 1.0, 2.0, 2.0 + rounding], [S, S, S, T], "no job topples below 2 m/s, and at it some do", (2.0, 2.0))
          for rounding in (-1e-12, 0.0, 1e-12)),
        ([0.5, 1.0, 1.0, 2.0], [S, S, T, T], "no job topples below 1 m/s, some do at it and all above", (1.0, 1.0)),
        ([0.5, 0.8, 1.2, 2.0], [T, T, S, S], "probability does not rise", None),
        ([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [T, S, T, T, S, S], "probability does not rise", None),
        ([1.0, 2.0, 3.0], [T] * 3, "every job", None),
        ([1.0, 2.0, 3.0], [S] * 3, "no job", None),
    ],
)  # fmt: skip
def test_answers_without_a_maximum_of_the_likelihood_give_bounds_and_no_number(
    values, toppled, problem, bounds
):
    result = fit(tiny(values, toppled), ["pgv_m_s"])
    assert result.problem.startswith(problem)
    assert result.lognormal is None
    assert bounds is None or result.bounds == pytest.approx(bounds)


def test_a_plane_that_separates_two_measures_is_found():
    random = np.random.default_rng(3)
    frame = pd.DataFrame(np.exp(random.normal(size=(200, 2))), columns=["pga_m_s2", "pgv_m_s"])
    frame["record_id"] = frame.index.astype(str)
    frame["toppled"] = frame["pga_m_s2"] * frame["pgv_m_s"] ** 2 > 1
    assert "separated" in fit(frame, ["pga_m_s2", "pgv_m_s"]).problem
    assert not fit(frame, ["pgv_m_s"]).problem


def test_the_measure_that_made_the_answers_predicts_best(jobs):
    ranked = compare_measures(jobs)
    assert ranked["measures"][0] in ("pgv_m_s", "pga_m_s2 + pgv_m_s")
    alone = ranked[ranked["measures"] == "pga_m_s2"].iloc[0]
    assert alone["worse_by_low"] > 0  # PGA is worse for sure
    assert set(ranked["measures"]) <= {"pgv_m_s", "pga_m_s2", "pga_m_s2 + pgv_m_s", "pgv_pga_s", "arias_m_s",
                                       "duration_energy_s"}  # fmt: skip


def test_every_job_is_predicted_by_a_fit_to_other_records(jobs, monkeypatch):
    held_out = []

    def seen(frame, *rest, **options):
        held_out.append(set(jobs["record_id"]) - set(frame["record_id"]))
        return fit(frame, *rest, **options)

    monkeypatch.setattr("toppling.results.analysis.fits.fit", seen)
    predicted = out_of_fold(jobs, ["pgv_m_s"])
    assert sorted(record for held in held_out for record in held) == sorted(jobs["record_id"].unique())
    for held in held_out:
        inside = jobs["record_id"].isin(held)
        others = fit(jobs[~inside], ["pgv_m_s"])
        np.testing.assert_array_equal(predicted[inside], others.probability(jobs[inside]))


@pytest.mark.parametrize("toppled", [FEW - 1, FEW])
def test_report_and_constraint_have_a_curve_from_the_same_number_of_topplings_on(jobs, toppled):
    few = pd.concat([jobs[~jobs["toppled"]], jobs[jobs["toppled"]].sample(toppled, random_state=1)])
    curves = curve_over(few, "pgv_m_s", 2), ContactFits(few, 2).curves.get("pgv_m_s")
    assert [curve is not None for curve in curves] == 2 * [toppled == FEW]
    assert out_of_fold(few, ["pgv_m_s"]).notna().all()


def test_a_sample_without_a_fit_is_a_curve_that_never_topples_in_its_place():
    frame = answered(pd.DataFrame(rows(records=24, levels=(2, 3, 4), seed=4), columns=SCHEMA.names))
    resampled = bootstrap(frame, fit(frame, ["pgv_m_s"], least_toppled=1))
    curves = resampled.lognormals("pgv_m_s")
    assert 0 < resampled.without_fit < len(curves) == 200
    assert [math.isinf(curve.median) for curve in curves] == list(~resampled.fitted)
    assert Lognormal("pgv_m_s", math.inf, 0.0).probability([0.0, 1.0, 1e300]).tolist() == [0.0, 0.0, 0.0]


def test_rocks_of_the_same_records_are_drawn_together_and_of_other_records_by_themselves(jobs):
    def medians(frame):
        resampled = bootstrap(frame, fit(frame, ["pgv_m_s"]), samples=40)
        return np.log([curve.median for curve in resampled.lognormals("pgv_m_s")])

    shuffled = jobs.sample(frac=1.0, random_state=1)
    others = jobs.assign(record_id="other " + jobs["record_id"])
    np.testing.assert_allclose(medians(shuffled), medians(jobs), rtol=1e-6)
    # Of 40 independent pairs the correlation has a standard error of .16; three of it.
    assert abs(np.corrcoef(medians(others), medians(jobs))[0, 1]) < 0.48


def test_scores_agree_with_their_definitions():
    result = scores([True, False, True], [0.9, 0.2, 0.4])
    assert result["brier"] == pytest.approx((0.01 + 0.04 + 0.36) / 3)
    assert result["log_loss"] == pytest.approx(-(math.log(0.9) + math.log(0.8) + math.log(0.4)) / 3)
    assert result["auc"] == 1.0


def test_a_true_model_is_calibrated(jobs):
    result = calibration(jobs, out_of_fold(jobs, ["pgv_m_s"]))
    # About 340 jobs a bin: a standard error of at most 0.027; four of them.
    assert (result["predicted"] - result["observed"]).abs().max() < 0.11
    assert result["jobs"].sum() == len(jobs)


def test_fractions_are_weighted_means_with_an_effective_number_of_records():
    frame = tiny([1.0, 1.0, 4.0], [True, True, False]).assign(record_weight=[1.0, 1.0, 2.0])
    table = observed_fractions(frame, "pgv_m_s", bins=1).iloc[0]
    assert table[["value", "probability"]].tolist() == pytest.approx([2.0, 0.5])
    # Kish: (1 + 1 + 2)^2 / (1 + 1 + 4) records.
    low, high = wilson(pd.Series([0.5]), pd.Series([16 / 6]))
    assert (table["wilson_low"], table["wilson_high"]) == (low[0], high[0])
    assert (table["jobs"], table["records"]) == (3, 3)


def test_a_lognormal_curve_and_its_inverse_agree():
    curve = Lognormal("pgv_m_s", 1.2, 0.4)
    for probability in (0.01, 0.5, 0.95):
        assert curve.probability(curve.intensity(probability)) == pytest.approx(probability)
    np.testing.assert_allclose(curve.probability([0.0, 1.2, np.inf]), [0.0, 0.5, 1.0])
    np.testing.assert_allclose(Lognormal("pgv_m_s", 1.2, 0.0).probability([1.0, 1.2, 1.4]), [0.0, 0.5, 1.0])


def test_what_lies_below_the_weakest_shaking_is_stated_as_under_it():
    basis = Basis("rock", 90, 80, 30, 0, 8.0, weakest_shaken=2.0)
    text = what_topples(Lognormal("pga_m_s2", 2.1, 0.4, basis, (1.2, 2.5)), "", single_base=False)
    assert "2.10 m/s² (95 %: under 2.00 to 2.50)" in text
    assert "with under 2.00 m/s² in one in twenty" in text


def by_statsmodels(design, share, trials):
    some = trials > 0
    return (
        GLM(share[some], design[some], Binomial(link=Probit()), var_weights=trials[some])
        .fit(tol=1e-12)
        .params
    )


@pytest.mark.parametrize(("quakes", "alike"), [(12, True), (4, False)])
def test_identical_records_of_an_earthquake_add_no_information(quakes, alike):
    single = pd.DataFrame(rows(records=12))
    single["event"] = [f"quake {int(name[1:]) % quakes}" for name in single["record_id"]]
    four = pd.concat(
        [single.assign(record_id=single["record_id"] + f"-{n}") for n in range(4)], ignore_index=True
    )

    def intervals(frame):
        fitted = sampled(answered(frame), fit(frame, ["pgv_m_s"]), 60)
        ranked = compare_measures(frame, [["pgv_m_s"], ["pga_m_s2"]], 60)
        return [
            *lognormal_interval(fitted.resampled).values(),
            *ranked[["log_loss", "worse_by_high"]].to_numpy().flat,
        ]

    assert (intervals(four) == pytest.approx(intervals(single), rel=1e-6)) is alike


@pytest.mark.parametrize("measures", [("pgv_m_s",), ("pga_m_s2", "pgv_m_s")])
def test_fits_of_resampled_records_are_those_of_statsmodels(measures):
    frame = pd.DataFrame(rows(records=12))
    weight = np.random.default_rng(1).uniform(0.2, 2.0, 12)
    frame["record_weight"] = weight[pd.factorize(frame["record_id"])[0]]
    groups = grouped(frame, measures)
    design, codes = design_of(groups, measures), pd.factorize(groups["earthquake"])[0]
    share, trials = groups["share"].to_numpy(), groups["trials"].to_numpy()
    drawn = np.random.default_rng(2).multinomial(12, np.full(12, 1 / 12), 20)[:, codes]
    start = fit(frame, measures).coefficients
    assert start == pytest.approx(by_statsmodels(design, share, trials), rel=1e-6, abs=1e-6)
    found = list(refitted(design, share, trials, start, drawn))
    for once, weight in zip(found, drawn, strict=True):
        assert once == pytest.approx(by_statsmodels(design, share, trials * weight), rel=1e-6, abs=1e-6)


def test_separated_answers_and_too_few_jobs_have_no_end_of_the_search_and_hold_up_no_other():
    design = np.column_stack([np.ones(6), np.arange(6.0)])
    share = np.array([0.0, 0.0, 1.0, 0.0, 1.0, 1.0])
    weights = np.array([[1, 1, 1, 1, 1, 1], [1, 1, 0, 0, 1, 1], [0, 0, 0, 1, 0, 0]])
    whole, separated, single = refitted(design, share, np.ones(6), (0.0, 0.5), weights)
    assert np.isfinite(whole).all()
    assert np.isnan([separated, single]).all()
