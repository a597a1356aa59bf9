"""Levels about a rock that dip alike: a frame whose z does not point upward."""

import numpy as np
import pytest

from toppling.models.frames import plane_normal
from toppling.models.scan.scan_warnings import tilted_frame
from toppling.models.scan.surfels import Surfels

PATCH_M, STEP_M = 0.03, 0.45
DIP_DEG, TOWARD_DEG = 3.6, 235.0


def level(dip_deg, toward_deg, middle, bumps_m=0.002, seed=1):
    """Patches of a square level, 1.8 m wide: places and normals."""
    across = np.arange(-0.9, 0.9, PATCH_M)
    x, y = (each.ravel() for each in np.meshgrid(across, across))
    normal = plane_normal(dip_deg, toward_deg)
    bumps = bumps_m * np.random.default_rng(seed).normal(size=len(x))
    places = np.column_stack([x, y, bumps - (normal[0] * x + normal[1] * y) / normal[2]]) + middle
    return places, np.broadcast_to(normal, places.shape)


def frame_of(*levels):
    places, normals = (np.vstack(each) for each in zip(*levels, strict=True))
    return tilted_frame(Surfels(places, normals, np.zeros(len(places)), PATCH_M), np.zeros(len(places), bool))


UPPER, LOWER = np.array([0.0, 0.0, STEP_M]), np.array([2.0, 0.0, 0.0])


def test_levels_at_two_heights_that_dip_alike_tell_what_points_upward():
    normal = plane_normal(DIP_DEG, TOWARD_DEG)
    below = LOWER - [0.0, 0.0, (normal @ LOWER) / normal[2]]  # so that they are a step apart
    doubt = frame_of(level(DIP_DEG, TOWARD_DEG, UPPER), level(DIP_DEG, TOWARD_DEG, below, seed=2))
    assert doubt.kind == "frame"
    assert "levels 0.45 m apart" in doubt.sentence
    assert "by 3.6 degrees toward azimuth 235" in doubt.sentence
    up = [float(word) for word in doubt.sentence.rpartition("--up ")[2].split(",")]
    assert up == pytest.approx(normal, abs=1e-3)


@pytest.mark.parametrize(
    "levels",
    [
        pytest.param([level(0.3, 10.0, UPPER), level(0.3, 10.0, LOWER)], id="level"),
        pytest.param([level(DIP_DEG, TOWARD_DEG, UPPER)], id="one, as any slope is"),
        pytest.param(
            [level(DIP_DEG, TOWARD_DEG, UPPER), level(0.0, 0.0, LOWER)], id="a slope over level ground"
        ),
        pytest.param(
            [level(DIP_DEG, TOWARD_DEG, UPPER), level(DIP_DEG + 1.5, TOWARD_DEG, LOWER)],
            id="ledges, nearly alike",
        ),
        pytest.param(
            [level(DIP_DEG, TOWARD_DEG, UPPER, 0.02), level(DIP_DEG, TOWARD_DEG, LOWER, 0.02)],
            id="uneven ground",
        ),
    ],
)
def test_a_level_frame_a_slope_and_natural_ground_are_not_doubted(levels):
    assert frame_of(*levels) is None
