"""Quick ways through many rows give what the plain ones do."""

import numpy as np
import pytest

from toppling.models.arrays import inside_box, inside_cylinder, numbered


@pytest.fixture
def points():
    return np.random.default_rng(5).normal(size=(2500, 3))


@pytest.mark.parametrize("most", [50, 10**12])
def test_places_and_counts_are_those_of_sorting_however_wide_the_numbers_are_spread(most):
    keys = np.random.default_rng(1).integers(0, most, 3000)
    _, place, count = np.unique(keys, return_inverse=True, return_counts=True)
    found = numbered(keys)
    np.testing.assert_array_equal(found[0], place)
    np.testing.assert_array_equal(found[1], count)


def test_a_box_holds_what_lies_between_its_corners_along_every_axis(points):
    low, high = np.array([-0.5, -1.0, 0.0]), np.array([0.5, 2.0, 1.0])
    inside = ((points > low) & (points < high)).all(axis=1)
    assert 0 < inside.sum() < len(points)
    np.testing.assert_array_equal(inside_box(points, low, high), inside)


@pytest.mark.parametrize("at_once", [7, 10_000])
def test_a_cylinder_holds_what_is_near_its_axis_above_its_floor(points, at_once):
    axis = np.array([0.2, -0.1])
    inside = (np.linalg.norm(points[:, :2] - axis, axis=1) < 0.8) & (points[:, 2] > -0.3)
    found = inside_cylinder(points, axis, 0.8, -0.3, at_once)
    np.testing.assert_array_equal(found, np.flatnonzero(inside))
