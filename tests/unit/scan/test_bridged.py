"""A model whose crevice was filled by a sheet is named: the sheet falls away from the rock on all sides."""

import numpy as np
import pytest

from toppling.models.scan.foot import bridged
from toppling.models.scan.interface import Interface
from toppling.models.scan.measure import ObservedRock
from toppling.models.scan.surfels import Surfels

LEVEL = Interface(np.zeros(3), np.array([0.0, 0.0, 1.0]), np.eye(3), 0.0)


def drum_on(height_at):
    """A drum of 1 m by 0.6 m on ground whose height over x, y is given."""
    turn = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    angle, rise = (each.ravel() for each in np.meshgrid(turn, np.linspace(0.0, 1.0, 100)))
    side = np.column_stack([0.3 * np.cos(angle), 0.3 * np.sin(angle), rise])
    angle, away = (each.ravel() for each in np.meshgrid(turn, np.linspace(0.3, 0.8, 51)))
    x, y = away * np.cos(angle), away * np.sin(angle)
    slope = np.column_stack(
        [(height_at(x + 1e-6, y) - height_at(x, y)) / 1e-6, (height_at(x, y + 1e-6) - height_at(x, y)) / 1e-6]
    )
    normals = np.column_stack([-slope, np.ones(len(x))])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = np.vstack([side, np.column_stack([x, y, height_at(x, y)])])
    normals = np.vstack([side * [1.0, 1.0, 0.0] / 0.3, normals])
    surfels = Surfels(points, normals, np.zeros(len(points)), 0.01)
    none = np.empty((0, 3))
    return ObservedRock(none, none, none, none, surfels, np.arange(len(points)) < len(side), 1.0, None)


@pytest.mark.parametrize("slope_deg", [20.0, 35.0])
def test_a_sheet_that_falls_away_on_all_sides_is_named_with_its_slope(slope_deg):
    steep = np.tan(np.deg2rad(slope_deg))
    observed = drum_on(lambda x, y: -np.minimum(steep * (np.hypot(x, y) - 0.3), 0.1))
    doubt = bridged(observed, LEVEL)
    assert doubt is not None
    assert f"by {slope_deg:.0f} degrees" in doubt.sentence


@pytest.mark.parametrize(
    "height_at",
    [
        lambda x, y: 0.0 * x,
        lambda x, y: -0.6 * x,  # a slope falls away on one side only
        lambda x, y: -0.6 * np.abs(x),  # a ridge on two
        lambda x, y: 0.6 * (np.hypot(x, y) - 0.3),  # a hollow
        lambda x, y: -0.5 * (np.hypot(x, y) - 0.3),  # a knoll goes on
        lambda x, y: -1.5 * (x**2 + y**2 - 0.09),  # one that grows steeper
        lambda x, y: -3.0 * np.maximum(np.hypot(x, y) - 0.34, 0.0),  # a pedestal with steep sides
        lambda x, y: 1.0 * np.maximum(0.315 - np.hypot(x, y), 0.0),  # a crease that smoothing has rounded
    ],
)
def test_slopes_ridges_hollows_knolls_pedestals_and_rounded_creases_are_no_such_sheet(height_at):
    assert bridged(drum_on(height_at), LEVEL) is None
