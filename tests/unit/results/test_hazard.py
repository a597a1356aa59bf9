"""Constraints agree with closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from toppling.results.analysis.lognormal import Lognormal
from toppling.results.hazard.ages import exposure, joint_ages, parse_age
from toppling.results.hazard.events import Standing
from toppling.results.hazard.survival import inconsistent_rate, toppling_rate, unexceeded, unstated_fractions
from toppling.results.hazard.tree import NODES_PER_E_FOLD, Branch, HazardCurve, HazardTree, continued
from toppling.results.hazard.update import Update


def power_law(rate_at_one=1e-3, exponent=2.5, low=1e-4, high=1e4):
    x = np.geomspace(low, high, 9)
    return HazardCurve("power law", "pgv_m_s", x, rate_at_one * x**-exponent)


@settings(max_examples=25)
@given(st.floats(0.3, 3.0), st.floats(0.1, 0.8), st.floats(1.0, 4.0))
def test_a_power_law_hazard_with_a_lognormal_fragility_has_its_closed_form(median, beta, exponent):
    rate = toppling_rate([Lognormal("pgv_m_s", median, beta)], power_law(exponent=exponent))
    # nu = lambda(median) exp(n^2 beta^2 / 2) (Cornell et al. 2002). The midpoint rule's error as it is claimed;
    # 1.1 for the next order, up to 1.05 at a beta of 0.1.
    exact = 1e-3 * median**-exponent * math.exp((exponent * beta) ** 2 / 2)
    assert rate == pytest.approx(exact, rel=1.1 * (exponent / NODES_PER_E_FOLD) ** 2 / 24)


@given(st.floats(0.3, 3.0), st.floats(1.0, 4.0))
def test_a_sharp_threshold_topples_at_the_rate_of_its_exceedance(median, exponent):
    hazard = power_law(exponent=exponent)
    rate = toppling_rate([Lognormal("pgv_m_s", median, 0.0)], hazard)
    # The threshold is a node, so that nothing but the rounding of some thousand terms is left.
    assert rate == pytest.approx(hazard.rate(median), rel=1e-12)


@pytest.mark.parametrize("beta", [2e-4, 8e-4, 3e-3, 1e-2])
def test_a_nearly_sharp_threshold_stays_within_the_claimed_error(beta):
    exponent = 3.0
    for median in np.linspace(0.7, 1.3, 21):
        rate = toppling_rate([Lognormal("pgv_m_s", median, beta)], power_law(exponent=exponent))
        exact = 1e-3 * median**-exponent * math.exp((exponent * beta) ** 2 / 2)
        assert rate == pytest.approx(exact, rel=4.4e-5 * exponent + (exponent / NODES_PER_E_FOLD) ** 2 / 24)


ROCK = Lognormal("pgv_m_s", 1.2, 0.4)


def stood(*ages):
    return exposure(joint_ages([parse_age(age) for age in ages]))


def survival(curves, ages, hazard):
    rocks = [Standing(str(number), curve) for number, curve in enumerate(curves)]
    tree = HazardTree("pgv_m_s", (Branch(hazard.name, 1.0, hazard),))
    return Update.of_curves(rocks, tree, stood(*ages)).survival[0]


def test_a_sharp_weaker_rock_decides_alone():
    hazard = power_law()
    weak, strong = (Lognormal("pgv_m_s", x, 0.0) for x in (1.0, 2.0))
    alone = survival([weak], ["500"], hazard)
    assert survival([weak, strong], ["500", "500"], hazard) == pytest.approx(alone, rel=1e-12)


def test_before_the_younger_rock_stood_only_the_older_could_topple():
    hazard = power_law()
    exponent = 4000 * toppling_rate([ROCK], hazard) + 1000 * toppling_rate([ROCK, ROCK], hazard)
    assert survival([ROCK, ROCK], ["1000", "5000"], hazard) == pytest.approx(math.exp(-exponent))


def test_an_inconsistent_rate_excludes_the_rocks_survival():
    years, confidence = 10_000.0, 0.95
    bound = inconsistent_rate([Standing("rock", ROCK)], [0.0, 1.2, 5.0], stood("10000"), confidence)
    # At the median F is one half: lambda = -ln(0.05) / (0.5 T).
    assert bound[1] == pytest.approx(-math.log(0.05) / (0.5 * years))
    assert math.isinf(bound[0])
    # A hazard curve that reaches the bound at some intensity leaves at most 5 % of survival.
    for exponent in (1.0, 2.5, 4.0):
        hazard = power_law(bound[2] * 5.0**exponent, exponent)
        assert survival([ROCK], ["10000"], hazard) <= 1 - confidence + 1e-9


def test_an_uncertain_age_rejects_less_than_its_greatest_and_more_than_its_least():
    bounds = [
        inconsistent_rate([Standing("rock", ROCK)], [2.0], stood(age))[0]
        for age in ("20000", "10000..20000", "10000")
    ]
    assert bounds[0] < bounds[1] < bounds[2]


def test_without_an_age_a_single_event_is_bounded_at_its_confidence():
    assert unexceeded([ROCK], 0.95) == pytest.approx(ROCK.intensity(0.95))
    assert unexceeded([ROCK, ROCK], 0.95) == pytest.approx(ROCK.intensity(1 - math.sqrt(0.05)))


def test_a_hazard_curve_that_ends_too_early_states_what_it_may_miss():
    assert unstated_fractions([ROCK], power_law())[1] < 1e-6
    assert unstated_fractions([ROCK], power_law(high=1.0))[1] > 0.4


@pytest.mark.parametrize("curves", [[ROCK], [ROCK, Lognormal("pgv_m_s", 0.9, 0.2)]], ids=["one", "two"])
@pytest.mark.parametrize("low", [0.3, 0.8, 3.0])
def test_a_power_law_that_begins_too_late_states_the_fraction_of_the_rate_it_omits(curves, low):
    late, whole = power_law(exponent=3.0, low=low), power_law(exponent=3.0)
    counted, rate = toppling_rate(curves, late), toppling_rate(curves, whole)
    # Both sums have the midpoint rule's error of 2.3e-6; four of them.
    assert unstated_fractions(curves, late)[0] == pytest.approx(1 - counted / rate, abs=1e-5)
    assert toppling_rate(curves, continued(late, curves)) == pytest.approx(rate, rel=1e-5)


def test_a_curve_that_is_flat_at_its_first_point_leaves_out_nothing_below():
    flat = HazardCurve("flat", "pgv_m_s", np.array([0.8, 1.0, 9.0]), np.array([0.01, 0.01, 1e-5]))
    assert unstated_fractions([ROCK], flat)[0] == pytest.approx(0.0, abs=1e-12)  # a difference of sums


def test_a_first_segment_however_steep_gives_a_fraction():
    steep = HazardCurve("steep", "pgv_m_s", np.array([1.0, 1.1, 9.0]), np.array([1.0, 1e-4, 1e-5]))
    assert 0.9 < unstated_fractions([Lognormal("pgv_m_s", 1.0, 0.8)], steep)[0] <= 1.0


def test_what_a_curve_leaves_out_at_its_end_counts_as_toppling_where_it_is_continued():
    early = power_law(high=1.0)
    missing = (1 - ROCK.probability(1.0)) * early.annual_rate[-1]
    result = toppling_rate([ROCK], continued(early, [ROCK]))
    assert result == pytest.approx(toppling_rate([ROCK], early) + missing, rel=1e-9)


def test_a_rock_that_never_topples_leaves_the_bound_to_the_other():
    first, never = Lognormal("pgv_m_s", 1.2, 0.4), Lognormal("pgv_m_s", math.inf, 0.0)
    assert unexceeded([first, never]) == pytest.approx(unexceeded([first]), rel=1e-9)
    assert unexceeded([never, never]) == math.inf
