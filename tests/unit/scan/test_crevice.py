"""The crevice: an interface beside which one side was not seen is refused, whoever named it."""

import numpy as np
import pytest

from models import InputError
from models.scan.base import hidden_base
from models.scan.crevice import judge_crevice, not_strays
from models.scan.interface import Interface
from models.scan.segment import PEDESTAL, ROCK

HEIGHT_M = 2.0


def level_at(height_m):
    return Interface(np.array([0.0, 0.0, height_m]), np.array([0.0, 0.0, 1.0]), np.eye(3), 0.0)


def sheet(height_m):
    """Ground of 2 m by 2 m, 2 cm between its points, and a little noise."""
    along = np.arange(-1.0, 1.0, 0.02)
    x, y = (each.ravel() for each in np.meshgrid(along, along))
    return np.column_stack([x, y, height_m + np.random.default_rng(1).normal(0.0, 1e-3, len(x))])


def side(low_m, high_m):
    """A round rock's side between two heights."""
    turn, up = np.meshgrid(np.arange(0.0, 2 * np.pi, 0.05), np.arange(low_m, high_m, 0.02))
    return np.column_stack([0.4 * np.cos(turn.ravel()), 0.4 * np.sin(turn.ravel()), up.ravel()])


def judged(rock, pedestal, interface, *, refit):
    points = np.concatenate([rock, pedestal])
    label = np.repeat(np.array([ROCK, PEDESTAL], np.int8), [len(rock), len(pedestal)])
    return judge_crevice(points, label, interface, HEIGHT_M, refit=refit)


def test_a_foot_that_lies_on_the_pedestal_as_a_station_that_is_off_shows_it_is_refused():
    # Nothing of the rock is left above the sheet up to where its side begins, 0.3 m up: the crevice is no crevice.
    foot = sheet(0.0)[np.hypot(*sheet(0.0).T[:2]) < 0.4]
    with pytest.raises(InputError, match="only 0 points of the rock are left") as error:
        judged(np.concatenate([foot, side(0.3, 2.0)]), sheet(0.0), level_at(0.0), refit=True)
    assert "stations fit each other" in error.value.remedy


@pytest.mark.parametrize(
    ("height_m", "missing"),
    [(1.0, "only 0 points of the pedestal lie near"), (-0.5, "only 0 points of the rock lie near")],
)
def test_an_interface_given_through_the_rock_or_below_the_pedestal_is_refused(height_m, missing):
    with pytest.raises(InputError, match=missing) as error:
        judged(side(0.0, 2.0), sheet(0.0), level_at(height_m), refit=False)
    assert "height and slope" in error.value.remedy


def test_no_base_hangs_in_a_rim_that_was_not_seen():
    with pytest.raises(InputError, match="only 0 points of the rock"):
        hidden_base(np.empty((0, 3)), sheet(0.0), HEIGHT_M, 0.8)


def test_fewer_points_than_have_six_neighbours_are_strays():
    assert [int(not_strays(side(0.0, 0.02)[:count]).sum()) for count in (0, 6, 8)] == [0, 0, 8]
