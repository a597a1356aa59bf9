"""A rim that was not seen over a wide range is told, with where a station would see it."""

import numpy as np
import pytest

from toppling.models.scan.foot import rounded_share, unseen_rim
from toppling.models.scan.interface import Interface
from toppling.models.scan.measure import ObservedRock
from toppling.models.scan.surfels import Surfels

LEVEL = Interface(np.zeros(3), np.array([0.0, 0.0, 1.0]), np.eye(3), 0.0)


def told(azimuths_deg, interface=LEVEL):
    turn = np.deg2rad(azimuths_deg)
    low = 0.3 * np.column_stack([np.cos(turn), np.sin(turn), np.full(len(turn), 0.01)])
    seen = ObservedRock(low, low, low, low, None, None, 1.0, None)
    return unseen_rim(seen, interface, np.array([0.0, 0.0, 0.5]))


def arc(first_deg, last_deg):
    return np.arange(first_deg + 0.5, last_deg, 1.0)


@pytest.mark.parametrize(
    "azimuths_deg", [arc(0, 360), arc(0, 260), [45.5, 135.5, 225.5, 315.5], [0.5, 120.5, 240.5]]
)
def test_a_rim_seen_around_the_weight_and_feet_around_it_are_not_told(azimuths_deg):
    assert told(azimuths_deg) is None


@pytest.mark.parametrize("turn_deg", [0.0, 90.0, 130.0])
def test_the_range_that_was_not_seen_is_told_with_its_middle_in_the_scene(turn_deg):
    c, s = np.cos(np.deg2rad(turn_deg)), np.sin(np.deg2rad(turn_deg))
    turned = Interface(np.zeros(3), LEVEL.normal, np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), 0.0)
    sentence = told(arc(0, 160)).sentence
    assert "not seen over 200 degrees about azimuth 260" in sentence
    assert "does not surround the line of the weight" in sentence
    assert told(arc(0, 160), turned).sentence == sentence


def test_of_less_than_half_it_is_told_what_was_drawn_there():
    sentence = told(arc(0, 210)).sentence
    assert "not seen over 150 degrees about azimuth 285" in sentence
    assert "as if the outline that was seen went on" in sentence


@pytest.mark.parametrize("seen_deg", [180, 240, 360])
def test_a_foot_that_is_rounded_below_all_of_the_side_that_was_seen_is_wholly_rounded(seen_deg):
    """Of a side seen from one direction alone the middle is not the foot's: both are counted about the foot's."""
    around, side = np.deg2rad(arc(-180, 180)), np.deg2rad(arc(-seen_deg / 2, seen_deg / 2))
    dip = np.where(np.abs(around) < np.deg2rad(seen_deg / 2), np.deg2rad(40.0), 0.0)
    turn = np.concatenate([around, side])
    points = 0.3 * np.column_stack([np.cos(turn), np.sin(turn), np.repeat([0.05, 0.5], [360, seen_deg])])
    dip = np.concatenate([dip, np.zeros(seen_deg)])
    normals = np.column_stack([np.cos(dip) * np.cos(turn), np.cos(dip) * np.sin(turn), np.sin(dip)])
    surfels = Surfels(points, normals, np.zeros(len(points)), 0.01)
    none = np.empty((0, 3))
    observed = ObservedRock(none, none, none, none, surfels, np.ones(len(points), bool), 1.0, None)
    assert rounded_share(observed, LEVEL) == 1.0
