"""A pull inside the stated interval leaves many draws, true ones keep the truth in it, and the best is named."""

from types import SimpleNamespace

import numpy as np
import pytest

from toppling.models.arrays import effective_number
from toppling.models.hidden_base import draw_bases
from toppling.models.hidden_base.draw_bases import AZIMUTHS_DEG, DRAWS, ENOUGH, interval_of
from toppling.models.hidden_base.evidence import conditioned, pulls_log_likelihood
from toppling.models.hidden_base.gap import resampled
from toppling.models.hidden_base.inspection import Inspection
from toppling.models.hidden_base.intervals import PULL, narrowing_pull
from toppling.models.hidden_base.standing import intervals, observations, pulls_beyond
from toppling.models.scan.interface import Interface

TURNS_DEG = np.arange(0.0, 360.0, 30.0)


def ratios_of(bases, random):
    """Ratios (bases, azimuths) that random bases of one rock bear, their largest foot toward a random azimuth.

    Every fourth base is of another kind, that bears half as much: the draws have a gap between the two.
    """
    spread = random.uniform(0.05, 0.3)
    lobes = random.normal(0.0, spread, (bases, 5)) / (1.0 + np.arange(5))
    turn, order = np.deg2rad(TURNS_DEG), np.arange(5)[:, None]
    ratios = random.uniform(0.15, 0.6) * np.exp(lobes @ np.cos(order * (turn - random.uniform(0.0, 6.3))))
    ratios[::4] *= random.uniform(0.5, 1.0)
    return ratios


def known_by(pulls, ratios, weight, random):
    """What the draws that are kept bear after pulls, numbers of azimuths with what was measured there."""
    measured_pulls = [(TURNS_DEG[row], value) for row, value in pulls]
    measured = ratios[:, [row for row, _ in pulls]]
    likelihood = pulls_log_likelihood(measured_pulls, measured)
    return ratios[resampled(conditioned(weight, likelihood, ENOUGH), DRAWS, random)]


@pytest.mark.parametrize("seed", range(20))
def test_a_pull_anywhere_inside_the_stated_interval_leaves_many_draws(seed):
    random = np.random.default_rng(seed)
    ratios, weight = ratios_of(200, random), random.exponential(size=200)
    low, _, high = interval_of(ratios[resampled(weight, DRAWS, random)])
    for row in range(0, len(TURNS_DEG), 3):
        for value in np.linspace(low[row], high[row], 9):
            selected = known_by([(row, value)], ratios, weight, random)
            assert len(np.unique(selected[:, row])) > 5  # no interval rests on a few draws


@pytest.mark.parametrize("count", [19, 48])
def test_the_next_draw_lies_in_nine_of_ten_intervals_however_few_draws_they_are_of(count, monkeypatch):
    monkeypatch.setattr(draw_bases, "OTHER_ERRORS_SHARE", 0.0)
    draws = np.random.default_rng(count).lognormal(size=(count + 1, 20_000))
    next_draw, of_equal_weight = draws[0], np.ones((1, count))
    low, _, high = interval_of(draws[1:])
    assert ((low <= next_draw) & (next_draw <= high)).mean() == pytest.approx(0.9, abs=0.01)
    low, _, high = (entry[0] for entry in interval_of(draws[1:], of_equal_weight))
    assert ((low <= next_draw) & (next_draw <= high)).mean() == pytest.approx(0.9, abs=0.03)


@pytest.mark.parametrize("pulls", [1, 2, 4])
def test_true_pulls_narrow_the_interval_and_it_covers_the_truth_no_less(pulls):
    covered, widths = [], []
    for seed in range(150):
        random = np.random.default_rng([pulls, seed])
        ratios = ratios_of(200, random)
        true = ratios_of_draw(ratios, random)
        drawn, weight = np.delete(ratios, 0, axis=0), np.ones(199)
        rows = random.choice(len(TURNS_DEG), pulls, replace=False)
        read = true[rows] * (1.0 + 0.05 * random.normal(size=pulls))
        selected = known_by(list(zip(rows, read, strict=True)), drawn, weight, random)
        free = drawn[resampled(weight, DRAWS, random)]
        for entry in (free, selected):
            low, _, high = interval_of(entry)
            covered.append(((low <= true) & (true <= high)).mean())
            widths.append((high - low).mean())
    before, after = np.reshape(covered, (-1, 2)).mean(axis=0)
    assert len(covered) > 2 * 140
    assert after > max(0.88, before - 0.02)
    assert np.reshape(widths, (-1, 2)).mean(axis=0)[1] < np.mean(widths[::2])


def ratios_of_draw(ratios, random):
    """The truth: the first of the bases, with what no draw shows."""
    return ratios[0] * (1.0 + 0.04 * random.normal())


def test_pulls_that_no_base_makes_together_leave_enough_draws():
    random = np.random.default_rng(3)
    ratios = random.uniform(0.2, 0.4, (300, 1)) * np.array([1.0, 1.0])
    likelihood = pulls_log_likelihood([(0.0, 0.2), (90.0, 0.4)], ratios)
    weight = np.ones(300)
    assert effective_number(conditioned(weight, likelihood, ENOUGH)) >= 0.999 * ENOUGH


LEVEL = Interface.through(np.zeros(3), np.array([0.0, 0.0, 1.0]))
PLACES = np.array([[0.5, 0.1], [-0.5, 0.3], [-0.5, -0.3], [0.1, 0.3], [0.1, -0.3]])
"""The first lies toward azimuth 11 degrees; without it the rock stands on the others."""


def drawn(far):
    """Draws that touch toward the east (those of `far`) bear twice as much toward there as the others."""
    toppling = np.full((len(far), len(AZIMUTHS_DEG)), 2.0)
    toppling[np.ix_(far, np.cos(np.deg2rad(AZIMUTHS_DEG)) < 0.4)] = (
        4.0  # the ground accelerates the other way
    )
    gaps = [SimpleNamespace(gap_m=np.where(np.arange(5) == 0, 0.0 if value else 0.01, 0.0)) for value in far]
    part = SimpleNamespace(observed=SimpleNamespace(places_m=PLACES))
    return SimpleNamespace(
        toppling_m_s2=toppling, gaps=gaps, com_m=np.tile([0.0, 0.0, 0.5], (len(far), 1)), part=part
    )


def width(toppling):
    low, median, high = interval_of(toppling)
    return np.median((high - low) / median)


def named(drawn):
    """The pull that is offered, as a scene reports it, and its words."""
    low, median, high = interval_of(drawn.toppling_m_s2)
    table = [
        dict(zip(("low_m_s2", "median_m_s2", "high_m_s2"), row, strict=True))
        for row in np.column_stack([low, median, high])
    ]
    (pull,) = found = observations(drawn)
    return pull, narrowing_pull({"next_observations": found, "toppling": table})[0]


def test_a_pull_distinguishes_draws_that_differ_by_a_contact_in_its_direction():
    far = np.arange(40) % 2 == 0
    pull, words = named(drawn(far))
    assert pull["kind"] == PULL
    assert words.startswith("a pull toward")
    assert abs((pull["from_deg"] + 180.0) % 360.0 - 180.0) <= 120.0
    assert pull["width"] == pytest.approx(width(drawn(far[far]).toppling_m_s2), rel=0.05)


def test_where_all_draws_are_alike_no_pull_narrows_and_none_is_named():
    alike = drawn(np.ones(12, bool))
    pull, words = named(alike)
    assert pull["width"] == pytest.approx(width(alike.toppling_m_s2))
    assert words == ""


def test_a_pull_is_held_against_what_draws_bore_before_it_though_they_agree_with_it_after():
    pulls = Inspection(pulls=((30.0, 0.2), (90.0, 0.5)))
    borne = np.array([[0.1, 0.2, 0.3], [0.1, 0.2, 0.3]])
    (result,) = pulls_beyond(SimpleNamespace(borne=borne), pulls)
    assert (result["azimuth_deg"], result["low"], result["high"]) == (90.0, 0.1, 0.3)


def test_outlines_hold_the_places_that_a_fraction_of_the_draws_contacts_enclose():
    far = drawn(np.arange(40) % 4 > 0)  # three quarters reach to the east
    far.interval_m_s2 = lambda: interval_of(far.toppling_m_s2)
    far.lift_off_interval_m_s2 = lambda: None
    far.kind_weights, far.kinds, far.distinct, far.com_interval_m = {}, {}, 40, lambda: np.zeros((3, 3))
    contacts = intervals(far, LEVEL)["contacts"]
    east = [max(x for x, _, _ in contacts["outline_m"])]
    east += [max(x for x, _, _ in outline["outline_m"]) for outline in contacts["outlines"]]
    assert [outline["probability"] for outline in contacts["outlines"]] == [0.5, 0.95]
    assert east == pytest.approx([0.5, 0.5, 0.1], abs=0.02)  # the grid has 60 nodes over a metre
