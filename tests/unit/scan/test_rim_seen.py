"""A rim that was not seen over a wide range is told, with where a station would see it."""

import numpy as np
import pytest
from patches import LEVEL

from toppling.models.scan.interface import Interface
from toppling.models.scan.measure import ObservedRock
from toppling.models.scan.scan_warnings import unseen_rim


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
    assert told(arc(0, 160), turned).sentence == sentence


def test_of_less_than_half_it_is_told_what_was_drawn_there():
    sentence = told(arc(0, 210)).sentence
    assert "not seen over 150 degrees about azimuth 285" in sentence
