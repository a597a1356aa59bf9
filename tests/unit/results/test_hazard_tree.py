"""Statistics of a logic tree follow OpenQuake's rules, before and after the rocks have a say."""

import math
from pathlib import Path

import numpy as np
import pytest

from toppling.models.errors import InputError
from toppling.models.shares import effective_number
from toppling.results.analysis.lognormal import Lognormal
from toppling.results.hazard.curves import (
    HazardCurve,
    curve_of,
    probability_of,
    toppling_rate,
)
from toppling.results.hazard.readers import read_hazard
from toppling.results.hazard.readers.assembly import chosen_tree
from toppling.results.hazard.survival import Standing
from toppling.results.hazard.tree import (
    Branch,
    HazardTree,
    _weighted_fractile,
    branch_weights,
    level_choices,
    statistics,
)
from toppling.results.hazard.update import Update, updated_table

SAMPLES = Path(__file__).parents[4] / "shared" / "data" / "hazard"
G = 9.80665

samples = pytest.mark.skipif(
    not SAMPLES.is_dir(), reason="needs the samples of hazard files, ../shared/data/hazard"
)


@pytest.fixture(scope="module")
def lt36():
    return chosen_tree(read_hazard(SAMPLES / "oq_lt36"), "pga_m_s2", (0.5, -0.5), "oq_lt36")


@samples
def test_mean_and_fractiles_are_those_that_the_engine_printed(lt36):
    mean = chosen_tree(
        read_hazard(SAMPLES / "oq_lt36/hazard_curve-mean-PGA_6.csv"), "pga_m_s2", (0.5, -0.5), "mean"
    ).curves[0]
    told = statistics(lt36)
    np.testing.assert_allclose(
        probability_of(told.mean, 50), probability_of(mean.rates, 50), rtol=4e-7, atol=1e-14
    )
    for q, curve in lt36.fractiles.items():
        printed = probability_of(curve.rates, 50)
        # The median falls between two branches of nearly equal weight, which are printed with seven figures.
        np.testing.assert_allclose(
            probability_of(told.fractiles[q], 50), printed, rtol=3e-5, atol=1e-12, err_msg=f"fractile {q}"
        )


@samples
def test_survival_and_weights_of_36_branches_are_the_computed_ones(lt36):
    rock = [Lognormal("pga_m_s2", 0.3 * G, 0.3)]
    alive = np.exp([-1e4 * toppling_rate(rock, curve) for curve in lt36.curves])
    assert (lt36.weights @ alive, alive.min(), alive.max()) == pytest.approx(
        (0.3180, 0.1524, 0.5445), abs=1e-4
    )
    after = statistics(lt36, branch_weights(lt36.weights, alive))
    place = int(np.argmin(abs(after.levels - 0.1224745 * G)))
    found = [
        probability_of(rate[place], 50) for rate in (after.mean, after.fractiles[0.05], after.fractiles[0.95])
    ]
    assert found == pytest.approx([0.07116, 0.03331, 0.13777], abs=6e-6)


@samples
def test_the_mean_curve_gives_the_computed_survival():
    tree = chosen_tree(
        read_hazard(SAMPLES / "oq_lt36/hazard_curve-mean-PGA_6.csv"), "pga_m_s2", (0.5, -0.5), "mean"
    )
    rate = toppling_rate([Lognormal("pga_m_s2", 0.3 * G, 0.3)], tree.curves[0])
    assert rate == pytest.approx(1.2101e-4, rel=1e-4)
    assert math.exp(-1e4 * rate) == pytest.approx(0.2982, abs=1e-4)


def curve(*poes, name="branch", years=50.0):
    return curve_of(name, "pga_m_s2", np.arange(1.0, 1 + len(poes)), poes, years)


def test_certain_and_impossible_levels_count_in_the_mean_of_probabilities():
    tree = HazardTree(
        "pga_m_s2", (Branch("a", 0.5, curve(1.0, 0.5, 0.1)), Branch("b", 0.5, curve(0.6, 0.2, 0.0)))
    )
    told = statistics(tree)
    np.testing.assert_allclose(probability_of(told.mean, 50.0), [0.8, 0.35, 0.05])


def test_a_branch_without_any_event_counts_with_a_rate_of_zero():
    tree = HazardTree("pga_m_s2", (Branch("a", 0.5, curve(0.4, 0.2)), Branch("quiet", 0.5, curve(0.0, 0.0))))
    np.testing.assert_allclose(probability_of(statistics(tree).mean, 50.0), [0.2, 0.1])
    assert toppling_rate([Lognormal("pga_m_s2", 1.0, 0.3)], tree.curves[1]) == 0.0


def test_fractiles_are_read_off_the_cumulated_weights():
    values, weights = np.array([[3.0], [1.0], [2.0]]), np.array([0.2, 0.5, 0.3])
    for q, value in ((0.1, 1.0), (0.5, 1.0), (0.65, 1.5), (0.8, 2.0), (0.9, 2.5), (1.0, 3.0)):
        assert _weighted_fractile(values, weights, q)[0] == pytest.approx(value)


def test_branches_at_other_levels_are_interpolated_where_all_have_rates():
    x = np.array([1.0, 2.0, 4.0, 8.0])
    one, other = (HazardCurve(n, "pga_m_s2", at, 1e-2 * at**-2.0) for n, at in (("a", x), ("b", x[1:] / 1.5)))
    told = statistics(HazardTree("pga_m_s2", (Branch("a", 0.4, one), Branch("b", 0.6, other))))
    assert (told.levels[0], told.levels[-1]) == pytest.approx((2 / 1.5, 8 / 1.5))
    np.testing.assert_allclose(told.mean, 1e-2 * told.levels**-2.0)


def test_weights_that_do_not_sum_to_one_are_refused():
    with pytest.raises(InputError, match=r"sum to 0\.9"):
        HazardTree("pga_m_s2", (Branch("a", 0.5, curve(0.4, 0.2)), Branch("b", 0.4, curve(0.4, 0.2))))


def test_equal_weights_are_as_many_branches_and_one_heavy_one_is_one():
    assert effective_number(np.full(36, 1 / 36)) == pytest.approx(36)
    assert effective_number(np.array([1.0, 0.0])) == pytest.approx(1)


def test_levels_are_letters_of_the_path_and_those_without_a_choice_are_left_out():
    assert level_choices(["AAA~AA", "AAB~AA", "ABA~AB"]) == {
        "source 2": ["A", "A", "B"], "source 3": ["A", "B", "A"], "ground motion 2": ["A", "A", "B"],
    }  # fmt: skip
    assert level_choices(["A~[BooreAtkinson2008]", "A~[AbrahamsonSilva]"]) == {
        "ground motion": ["[BooreAtkinson2008]", "[AbrahamsonSilva]"]
    }
    assert level_choices(["b11_b21~b1", "b12_b21~b1"]) == {"source 1": ["b11", "b12"]}
    assert level_choices(["", ""]) == {}


@samples
def test_fractiles_without_branches_are_told_before_and_unknown_after():
    tree = chosen_tree(read_hazard(SAMPLES / "oq_lt36"), "sa_1s_m_s2", (0.5, -0.5), "oq_lt36")
    rock = Standing("rock", Lognormal("sa_1s_m_s2", 3.0, 0.4), np.array([1e4]))
    told = updated_table(Update([rock], tree)).iloc[10]
    assert told["rate_prior_p05"] < told["rate_prior_mean"] < told["rate_prior_p95"]
    assert told["rate_posterior_mean"] == told["rate_prior_mean"]
    assert math.isnan(told["rate_posterior_p05"])
