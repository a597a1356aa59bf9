"""Statistics of a logic tree follow OpenQuake's rules, before and after the rocks have a say."""

import math

import numpy as np
import pytest
from hazard_samples import LEVELS, PLACES, RATE_AT_1, WEIGHTS, branch_poes, logic_tree

from toppling.results.analysis.lognormal import Lognormal
from toppling.results.hazard.ages import exposure, joint_ages, parse_age
from toppling.results.hazard.events import Standing
from toppling.results.hazard.readers import read_hazard
from toppling.results.hazard.readers.assembly import chosen_tree
from toppling.results.hazard.survival import toppling_rate
from toppling.results.hazard.tree import (
    Branch,
    HazardCurve,
    HazardTree,
    branch_weights,
    curve_of,
    probability_of,
    statistics,
)
from toppling.results.hazard.update import Update

G = 9.80665
ROCK = Lognormal("pga_m_s2", 0.3 * G, 0.3)
TOPPLING_RATES = RATE_AT_1 * np.arange(1, 5) * 0.3**-2 * math.exp(0.5 * (2 * 0.3) ** 2)
"""The rock's toppling rate under every branch, a power law."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return logic_tree(tmp_path_factory.mktemp("tree"))


@pytest.fixture(scope="module")
def four(folder):
    return chosen_tree(read_hazard(folder), "pga_m_s2", PLACES[0], "tree")


@pytest.fixture(scope="module")
def mean(folder):
    found = read_hazard(folder / "hazard_curve-mean-PGA_6.csv")
    return chosen_tree(found, "pga_m_s2", PLACES[0], "mean").curves[0]


def test_mean_and_fractiles_are_those_that_the_engine_prints(four, mean):
    out = statistics(four)
    np.testing.assert_allclose(
        probability_of(out.mean, 50), probability_of(mean.rates, 50), rtol=1e-6, atol=1e-12
    )
    assert sorted(four.fractiles) == [0.05, 0.16, 0.5, 0.84, 0.95]
    for q, curve in four.fractiles.items():
        np.testing.assert_allclose(
            probability_of(out.fractiles[q], 50), probability_of(curve.rates, 50), rtol=1e-6, atol=1e-12
        )


def test_survival_and_new_weights_of_branches_that_are_power_laws_have_their_closed_form(four):
    alive = np.exp([-1e4 * toppling_rate([ROCK], curve) for curve in four.curves])
    expected = np.exp(-1e4 * TOPPLING_RATES)
    np.testing.assert_allclose(alive, expected, rtol=1e-4)
    weights = np.array(WEIGHTS) * expected / (WEIGHTS @ expected)
    branches = map(Branch, "abcd", branch_weights(four.weights, alive), four.curves)
    after = statistics(HazardTree(four.measure, tuple(branches)))
    poes = weights @ np.array([branch_poes(branch) for branch in range(4)])
    np.testing.assert_allclose(probability_of(after.mean, 50), poes, rtol=1e-4)
    np.testing.assert_allclose(after.levels, LEVELS * G, rtol=1e-5)


def curve(*poes, name="branch", years=50.0):
    return curve_of(name, "pga_m_s2", np.arange(1.0, 1 + len(poes)), poes, years)


def test_certain_and_impossible_levels_and_branches_without_any_event_count_in_the_mean_of_probabilities():
    certain, impossible, quiet = curve(1.0, 0.5, 0.1), curve(0.6, 0.2, 0.0), curve(0.0, 0.0, 0.0)
    branches = (Branch("a", 0.25, certain), Branch("b", 0.25, impossible), Branch("quiet", 0.5, quiet))
    out = statistics(HazardTree("pga_m_s2", branches))
    np.testing.assert_allclose(probability_of(out.mean, 50.0), [0.4, 0.175, 0.025])
    assert toppling_rate([Lognormal("pga_m_s2", 1.0, 0.3)], quiet) == 0.0


def test_branches_at_other_levels_are_interpolated_where_all_have_rates():
    x = np.array([1.0, 2.0, 4.0, 8.0])
    a, b = (HazardCurve(n, "pga_m_s2", at, 1e-2 * at**-2.0) for n, at in (("a", x), ("b", x[1:] / 1.5)))
    out = statistics(HazardTree("pga_m_s2", (Branch("a", 0.4, a), Branch("b", 0.6, b))))
    assert (out.levels[0], out.levels[-1]) == pytest.approx((2 / 1.5, 8 / 1.5))
    np.testing.assert_allclose(out.mean, 1e-2 * out.levels**-2.0)


def test_fractiles_without_branches_are_reported_before_and_unknown_after(folder):
    tree = chosen_tree(read_hazard(folder), "sa_1s_m_s2", PLACES[0], "tree")
    rock = Standing("rock", Lognormal("sa_1s_m_s2", 3.0, 0.4))
    table = Update.of_curves([rock], tree, exposure(joint_ages([parse_age("10000")]))).updated.iloc[10]
    assert table["rate_prior_p05"] < table["rate_prior_mean"] < table["rate_prior_p95"]
    assert table["rate_posterior_mean"] == table["rate_prior_mean"]
    assert math.isnan(table["rate_posterior_p05"])
