"""A side that no station saw is closed as the outlines of what was seen go on, level by level."""

import numpy as np
import pytest

from toppling.models.hidden_base.near_interface import UnseenSide
from toppling.models.scan.close import side_gone_on

STEP_M = 0.04


def barrel(unseen_deg):
    """Patches and normals of a side whose radius is 1 at the foot and at the top, 1.3 in between."""
    turn = np.deg2rad(np.arange(0.5 * unseen_deg, 360.0 - 0.5 * unseen_deg, 2.0))
    up = np.arange(0.0, 3.0, STEP_M)
    up, turn = (each.ravel() for each in np.meshgrid(up, turn, indexing="ij"))
    radius, slope = radius_at(up), -np.cos(np.pi * up / 3.0) * 0.1 * np.pi
    points = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), up])
    normals = np.column_stack([np.cos(turn), np.sin(turn), slope])
    return points, normals / np.linalg.norm(normals, axis=1)[:, None]


def radius_at(up):
    return 1.0 + 0.3 * np.sin(np.pi * up / 3.0)


@pytest.mark.parametrize("unseen_deg", [90.0, 150.0])
def test_a_round_side_goes_on_round_and_faces_outward(unseen_deg):
    points, normals = barrel(unseen_deg)
    places, outward = side_gone_on(UnseenSide.of(points[points[:, 2] < 0.2]), points, normals, STEP_M)
    turn = np.rad2deg(np.arctan2(places[:, 1], places[:, 0]))
    middle = np.abs(turn) < 0.4 * unseen_deg
    away = np.linalg.norm(places[:, :2], axis=1) / radius_at(places[:, 2])
    assert away[middle] == pytest.approx(np.ones(middle.sum()), abs=0.08)
    assert (np.abs(turn) < 0.5 * unseen_deg + 15.0).all()  # a sector of directions and a half
    assert ((outward[:, :2] * places[:, :2]).sum(axis=1) > 0.0).all()
    assert np.ptp(places[:, 2]) > 2.7


def test_levels_that_were_seen_around_stay_as_they_were_seen():
    points, normals = barrel(90.0)
    around, of_around = barrel(0.0)
    high = points[:, 2] < 1.5, around[:, 2] >= 1.5
    seen = np.vstack([points[high[0]], around[high[1]]])
    ways = np.vstack([normals[high[0]], of_around[high[1]]])
    places, _ = side_gone_on(UnseenSide.of(points[points[:, 2] < 0.2]), seen, ways, STEP_M)
    assert places[:, 2].max() < 1.5 + 2.0 * STEP_M
