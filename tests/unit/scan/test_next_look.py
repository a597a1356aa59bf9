"""What to observe next: the look or the pull after which the draws leave the narrowest interval."""

from types import SimpleNamespace

import numpy as np
import pytest

from toppling.models.hidden_base.from_scan import AZIMUTHS_DEG, interval_of
from toppling.models.hidden_base.intervals import LOOK, PULL, base_sentences
from toppling.models.hidden_base.next_look import observations
from toppling.models.hidden_base.standing import intervals
from toppling.models.scan.interface import Interface

LEVEL = Interface.through(np.zeros(3), np.array([0.0, 0.0, 1.0]))
PLACES = np.array([[0.5, 0.1], [-0.5, 0.3], [-0.5, -0.3], [0.1, 0.3], [0.1, -0.3]])
"""The first lies toward azimuth 11 degrees; without it the rock stands on the others."""


def drawn(far):
    """Draws that touch toward the east (those of `far`) bear twice as much toward there as the others."""
    toppling = np.full((len(far), len(AZIMUTHS_DEG)), 2.0)
    toppling[np.ix_(far, np.cos(np.deg2rad(AZIMUTHS_DEG)) < 0.4)] = (
        4.0  # the ground accelerates the other way
    )
    gaps = [SimpleNamespace(gap_m=np.where(np.arange(5) == 0, 0.0 if each else 0.01, 0.0)) for each in far]
    part = SimpleNamespace(observed=SimpleNamespace(places_m=PLACES))
    return SimpleNamespace(
        toppling_m_s2=toppling, gaps=gaps, com_m=np.tile([0.0, 0.0, 0.5], (len(far), 1)), part=part
    )


def width(toppling):
    low, median, high = interval_of(toppling)
    return np.median((high - low) / median)


def test_where_the_draws_differ_by_one_contact_a_look_there_or_a_pull_toward_there_tells_them_apart():
    far = np.arange(40) % 2 == 0
    look, pull = observations(drawn(far), LEVEL)
    assert (look["kind"], pull["kind"]) == (LOOK, PULL)
    assert look["from_deg"] < np.rad2deg(np.arctan2(0.1, 0.5)) < look["to_deg"]
    assert abs((pull["from_deg"] + 180.0) % 360.0 - 180.0) <= 120.0
    alike = width(drawn(far[far]).toppling_m_s2)
    assert look["width"] == pytest.approx(alike)
    assert pull["width"] == pytest.approx(alike, rel=0.05)


def test_where_all_draws_are_alike_nothing_narrows_and_that_is_said():
    alike = drawn(np.ones(12, bool))
    found = observations(alike, LEVEL)
    assert [each["width"] for each in found] == pytest.approx([width(alike.toppling_m_s2)] * 2)
    rows = [{"azimuth_deg": 0.0, "low_m_s2": 1.67, "median_m_s2": 2.0, "high_m_s2": 2.33}]
    report = {
        "level": 0.9,
        "draws": 12,
        "toppling": rows,
        "contacts": {"count": [3, 4, 5]},
        "com_m": [[0, 0, 0]] * 3,
    }
    told = base_sentences({"unseen_base": {**report, "next_observations": found}})
    assert told[-2 if "few" in told[-1] else -1].count("no gain") == 2


def test_outlines_hold_the_places_that_a_share_of_the_draws_contacts_enclose():
    far = drawn(np.arange(40) % 4 > 0)  # three quarters reach to the east
    far.interval_m_s2 = lambda: interval_of(far.toppling_m_s2)
    far.lift_off_interval_m_s2 = lambda: None
    far.kind_weights, far.kinds, far.distinct, far.com_interval_m = {}, {}, 40, lambda: np.zeros((3, 3))
    contacts = intervals(far, LEVEL)["contacts"]
    east = [max(x for x, _, _ in contacts["outline_m"])]
    east += [max(x for x, _, _ in each["outline_m"]) for each in contacts["outlines"]]
    assert [each["probability"] for each in contacts["outlines"]] == [0.5, 0.95]
    assert east == pytest.approx([0.5, 0.5, 0.1], abs=0.02)  # the grid has 60 nodes over a metre
