"""The plane through what was seen of a pedestal, by reweighted least squares."""

import numpy as np
import pytest

from toppling.models.scan.interface import reweighted_plane


def test_points_of_a_drawn_plane_that_are_off_by_nothing_have_it():
    u, v = (axis.ravel() for axis in np.meshgrid(np.arange(-1.0, 1.0, 0.125), np.arange(-1.0, 1.0, 0.125)))
    points = np.column_stack([u, v, np.zeros(len(u))])
    for std_m in (lambda height, weight: float(np.sqrt((weight * height**2).mean())), lambda height, _: 0.0):
        centre, normal, height, weight = reweighted_plane(points, np.ones(len(points)), std_m)
        assert normal == pytest.approx([0.0, 0.0, 1.0])
        assert weight.min() == 1.0
        assert abs(centre[2]) + np.abs(height).max() == 0.0
