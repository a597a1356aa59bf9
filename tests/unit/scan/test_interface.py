"""The plane through what was seen of a pedestal, by reweighted least squares."""

import numpy as np
import pytest
from patches import level

from toppling.models.frames import plane_normal, rotation_between
from toppling.models.scan.interface import fit_interface, reweighted_plane
from toppling.models.scan.surfels import Surfels


def test_points_of_a_drawn_plane_that_are_off_by_nothing_have_it():
    points = level(1.0, 0.125)
    for std_m in (lambda height, weight: float(np.sqrt((weight * height**2).mean())), lambda height, _: 0.0):
        centre, normal, height, weight = reweighted_plane(points, np.ones(len(points)), std_m)
        assert normal == pytest.approx([0.0, 0.0, 1.0])
        assert weight.min() == 1.0
        assert abs(centre[2]) + np.abs(height).max() == 0.0


def test_a_drawn_pedestal_that_is_exactly_a_plane_has_it():
    normal = plane_normal(6.0, 250.0)
    turn = rotation_between((0.0, 0.0, 1.0), normal)
    ground = level(1.0, 0.02)
    away_m = np.hypot(*ground[:, :2].T)
    ground = ground[(away_m > 0.5) & (away_m < 0.6)]
    way = np.arange(0.0, 2.0 * np.pi, 0.02)
    side = np.vstack(
        [0.5 * np.column_stack([np.cos(way), np.sin(way), np.full(len(way), z)]) for z in (0.02, 0.06, 0.1)]
    )
    points = np.vstack([ground, side]) @ turn.T + [0.3, 0.2, 0.4]
    patches = Surfels(points, np.broadcast_to(normal, points.shape), np.zeros(len(points)), 0.02)
    assert fit_interface(patches, np.arange(len(points)) >= len(ground)).normal == pytest.approx(
        normal, abs=1e-9
    )
