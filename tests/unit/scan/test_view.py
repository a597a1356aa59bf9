"""What a page draws of a cloud, and that a click means a point of the whole cloud."""

import numpy as np
import pytest

from toppling.models.scan.surfels import picked, thinned


@pytest.fixture(scope="module")
def wall():
    """300,000 points of a wall in the plane y = 0, dense on its left."""
    rng = np.random.default_rng(7)
    across = 10.0 * rng.random(300_000) ** 2
    return np.column_stack([across, np.zeros_like(across), 3.0 * rng.random(300_000)])


def test_as_many_points_as_are_wanted_are_shown_evenly(wall):
    shown = thinned(wall, 20_000)
    assert 0.75 * 20_000 < len(shown.rows) <= 20_000
    assert len(np.unique(shown.rows)) == len(shown.rows)
    left = (wall[shown.rows, 0] < 5.0).mean()
    assert abs(left - 0.5) < 0.02  # of the points themselves, 71 % lie there
    # A surface looks closed where points cover their spacing, uneven as it is: a square grid's and somewhat more.
    assert 1.0 < shown.spacing_m / np.sqrt(30.0 / len(shown.rows)) < 1.6


def test_a_click_means_the_point_nearest_to_its_ray(wall):
    shown = thinned(wall, 2_000)
    eye = np.array([5.0, -8.0, 1.5])
    for row in (11, 222, 3333):
        place = wall[row] + 0.3 * shown.spacing_m * (wall[row] - eye) / np.linalg.norm(wall[row] - eye)
        assert picked(wall, place, eye, shown.spacing_m) == row
    behind = np.vstack([wall, wall + np.array([0.0, 0.5 * shown.spacing_m, 0.0])])
    assert picked(behind, wall[44], eye, shown.spacing_m) == 44
