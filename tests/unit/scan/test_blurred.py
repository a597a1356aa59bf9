"""A cloud of too few or too noisy points is refused as such, with how few or noisy, and what would do."""

import numpy as np
import pytest

from toppling.models.errors import InputError
from toppling.models.scan.choice import with_reason

REFUSED = InputError(
    "scan.nothing_stands", "nothing stands", where="segmentation", expected="a rock", remedy="point at it"
)


def of_a_scene(points, noise_m=0.0):
    """Level ground of 8 by 8 m with a ball of 2 m on it, seen with noise."""
    random = np.random.default_rng(1)
    flat = random.uniform(-4.0, 4.0, (3 * points // 4, 2))
    way = random.normal(size=(points // 4, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    ground = np.column_stack([flat, np.zeros(len(flat))])
    return np.concatenate([ground, way + np.array([0.0, 0.0, 1.0])]) + random.normal(
        0.0, noise_m, (points // 4 * 4, 3)
    )


def test_a_cloud_of_few_points_is_told_how_far_apart_they_lie_and_what_rock_they_show():
    """2250 points on 64 m2."""
    told = with_reason(REFUSED, of_a_scene(3000))
    assert "they lie about 0.17 m apart, and show rocks of 8.5 m and more" in told.what
    assert "not thinned" in told.remedy


@pytest.mark.parametrize("noise_m", [0.03, 0.05])
def test_a_noisy_cloud_is_told_how_thick_its_surfaces_are(noise_m):
    told = with_reason(REFUSED, of_a_scene(150_000, noise_m))
    assert "the cloud is noisy or rough" in told.what
    assert "less noise than a 100th of the rock's height" in told.remedy


@pytest.mark.parametrize("axis", [0, 2])
@pytest.mark.parametrize("slope", [0.0, 0.4])
def test_nothing_stands_out_of_a_wall_a_floor_or_a_slope(axis, slope):
    random = np.random.default_rng(3)
    points = random.uniform(-4.0, 4.0, (40_000, 3))
    points[:, axis] = slope * points[:, 1] + random.normal(0.0, 0.003, len(points))
    told = with_reason(REFUSED, points)
    assert "few points" not in told.what
    dip = np.rad2deg(np.arctan(slope)) if axis == 2 else 90.0
    assert f"a plane that dips by {dip:.0f} degrees" in told.what


def test_a_low_stone_on_a_floor_stands_out_of_it():
    random = np.random.default_rng(3)
    floor = np.column_stack([random.uniform(-4.0, 4.0, (60_000, 2)), random.normal(0.0, 0.003, 60_000)])
    stone = random.uniform(0.0, 0.1, (200, 3))
    assert "of a plane" not in with_reason(REFUSED, np.vstack([floor, stone])).what


@pytest.mark.parametrize("noise_m", [0.0, 0.01])
def test_of_a_cloud_that_would_show_a_rock_nothing_else_is_said(noise_m):
    assert with_reason(REFUSED, of_a_scene(150_000, noise_m)) is REFUSED
