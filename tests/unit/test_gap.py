"""Gaps that nobody saw: none below its floor, closed around the weight, and as was seen at the rim."""

import numpy as np
import pytest

from toppling.models.hidden_base.gap import (
    BaseObservation,
    Relief,
    beyond_m,
    draw_gaps,
    encloses,
    facet_below,
    flat_log_likelihood,
)

RELIEF = Relief(level_m=0.1, shape_m=0.01, shape_length_m=0.4, rough_m=0.002, rough_length_m=0.07)
RIM_STD_M = 0.001


def disc(rim_gap_m, touching=(), floor=lambda places: np.zeros(len(places))):
    """A round base of 1 m with a rim that was seen at some height."""
    along = np.linspace(-0.45, 0.45, 13)
    inner = np.array([(x, y) for x in along for y in along if np.hypot(x, y) < 0.47])
    turn = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    rim = 0.5 * np.column_stack([np.cos(turn), np.sin(turn)])
    places = np.vstack([inner, rim])
    known = np.arange(len(inner), len(places))
    std_m = np.full(40, RIM_STD_M)
    observed = (known, np.full(40, rim_gap_m), std_m, std_m, np.zeros(40, int))
    return BaseObservation(places, *observed, floor(places), np.array(touching, int))


def draws(observed, weight=(0.05, -0.1), count=6, seed=1):
    return draw_gaps(observed, np.tile(weight, (count, 1)), [RELIEF], np.random.default_rng(seed))


@pytest.mark.parametrize("rim_gap_m", [0.0, 0.02])
def test_every_draw_stands_sinks_in_nowhere_and_has_the_rim_that_was_seen(rim_gap_m):
    observed = disc(rim_gap_m)
    found = draws(observed)
    assert len(found) == 6
    for draw in found:
        assert draw.gap_m.min() == 0.0
        assert encloses(observed.places_m[draw.gap_m == 0.0], np.array([0.05, -0.1]))
        # Where contacts were not forced onto the rim itself it keeps its height, within four standard deviations.
        at_rim = draw.gap_m[observed.known]
        assert np.abs(at_rim[at_rim > 0.0] - rim_gap_m).max() < 4.0 * (RIM_STD_M + RELIEF.rough_m)


def test_a_high_rim_leaves_contacts_within_and_a_closed_rim_leaves_them_at_the_rim():
    reach = {}
    for rim_gap_m in (0.0, 0.03):
        observed = disc(rim_gap_m)
        reach[rim_gap_m] = np.mean([
            np.hypot(*observed.places_m[draw.gap_m == 0.0].T).max() for draw in draws(observed, count=12)
        ])  # fmt: skip
    assert reach[0.0] > reach[0.03] + 0.05


def test_an_error_common_to_the_rim_does_not_average_out_over_its_places():
    observed = disc(0.05)
    level = [draw.gap_m[observed.known].mean() for draw in draws(observed, count=60)]
    assert 0.7 * RIM_STD_M < np.std(level) < 1.3 * RIM_STD_M  # of its own alone it were a sixth


def test_a_place_known_to_touch_is_closed_and_a_place_with_daylight_is_open():
    place = 30
    assert all(draw.gap_m[place] == 0.0 for draw in draws(disc(0.01, touching=[place])))
    with_daylight = disc(0.01, floor=lambda places: np.where(np.arange(len(places)) == place, 0.005, 0.0))
    assert all(draw.gap_m[place] >= 0.005 for draw in draws(with_daylight))


def test_a_rim_is_likelier_the_nearer_it_hangs_to_where_the_rock_is_known_to_touch():
    at_rim = [-1, -14, -27]

    def effect(rim_gap_m):
        """By how much places that touch raise the likelihood of a rim."""
        touched = disc(rim_gap_m, touching=len(disc(0.0).places_m) + np.array(at_rim))
        flat = flat_log_likelihood(touched, RELIEF) - flat_log_likelihood(disc(rim_gap_m), RELIEF)
        drawn = draws(touched)[0].log_likelihood - draws(disc(rim_gap_m))[0].log_likelihood
        return np.array([flat, drawn])

    assert np.all(effect(0.0) > 0.0)
    assert np.all(effect(0.05) < 0.0)


def test_no_base_is_drawn_on_which_the_rock_would_fall():
    open_right = disc(0.01, floor=lambda places: np.where(places[:, 0] > -0.1, 0.005, 0.0))
    assert draws(open_right, weight=(0.2, 0.0)) == []
    assert len(draws(open_right, weight=(-0.25, 0.0))) == 6


def test_the_facet_below_a_weight_supports_a_table_of_three_legs():
    legs = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    gap = np.array([0.0, 0.0, 0.0, 0.1])
    assert set(facet_below(legs, gap, np.array([0.3, 0.3]))) == {0, 1, 2}
    assert facet_below(legs, gap, np.array([1.3, 0.3])) is None


@pytest.mark.parametrize("places", [[(0, 0), (1, 1), (2, 2)], [(0, 0), (0, 0), (1, 0)], [(0, 0), (1, 0)]])
def test_collinear_places_enclose_no_weight(places):
    assert beyond_m(np.array(places, float), np.array([0.5, 0.5])) == np.inf
    assert not encloses(np.array(places, float), np.array([0.5, 0.5]))
