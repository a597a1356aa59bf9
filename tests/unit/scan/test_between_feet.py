"""Between feet through which one sees, a rock is closed at its lower edge and not at its feet."""

from itertools import product

import numpy as np
import pytest

from toppling.models.hidden_base.near_interface import NearInterface, near_the_interface
from toppling.models.hidden_base.underside import hidden_base
from toppling.models.scan.close import close_rock
from toppling.models.scan.interface import Interface
from toppling.models.scan.surfels import Surfels

HALF_M, HEIGHT_M, CLEAR_M, FOOT_M, VOXEL_M = 0.2, 1.2, 0.16, 0.08, 0.012
LEVEL = Interface(np.zeros(3), np.array([0.0, 0.0, 1.0]), np.eye(3), 0.0)


def sides_of(half_m, low_m, high_m, middle_m=(0.0, 0.0), pitch_m=VOXEL_M):
    """Places on the sides of an upright square prism, and their normals."""
    along = np.arange(-half_m + 0.5 * pitch_m, half_m, pitch_m)
    across, up = (each.ravel() for each in np.meshgrid(along, np.arange(low_m, high_m, pitch_m)))
    points, normals = [], []
    for turn in range(4):
        c, s = round(np.cos(turn * np.pi / 2)), round(np.sin(turn * np.pi / 2))
        points.append(np.column_stack([c * half_m - s * across, s * half_m + c * across, up]))
        normals.append(np.tile([c, s, 0.0], (len(up), 1)))
    return np.vstack(points) + np.append(middle_m, 0.0), np.vstack(normals).astype(float)


def top():
    along = np.arange(-HALF_M, HALF_M, VOXEL_M)
    x, y = (each.ravel() for each in np.meshgrid(along, along))
    return np.column_stack([x, y, np.full(len(x), HEIGHT_M)]), np.tile([0.0, 0.0, 1.0], (len(x), 1))


def feet(pitch_m=VOXEL_M):
    off_m = HALF_M - 0.5 * FOOT_M
    return [sides_of(0.5 * FOOT_M, 0.0, CLEAR_M, at, pitch_m) for at in product((-off_m, off_m), repeat=2)]


def ground(below):
    """Points of the pedestal beside a block, and below it but for its feet."""
    along = np.arange(-0.8, 0.8, 0.006)
    x, y = (each.ravel() for each in np.meshgrid(along, along))
    deep = np.minimum(np.abs(np.column_stack([x, y])), HALF_M + 1.0)
    under = (deep < HALF_M).all(axis=1)
    foot = (deep > HALF_M - FOOT_M).all(axis=1) & under
    kept = ~foot if below else ~under
    return np.column_stack([x, y, np.zeros(len(x))])[kept]


@pytest.fixture(scope="module")
def block():
    points, normals = (
        np.vstack(each) for each in zip(sides_of(HALF_M, CLEAR_M, HEIGHT_M), top(), *feet(), strict=True)
    )
    return Surfels(points, normals, np.zeros(len(points)), VOXEL_M)


def test_a_block_on_four_feet_is_as_heavy_as_without_what_lies_between_them(block):
    rock = np.vstack([points for points, _ in feet(0.006)])
    low, lit = near_the_interface(rock, ground(below=True), HEIGHT_M)
    base = hidden_base(NearInterface(rock[low], ground(below=True)[lit], HEIGHT_M), 0.8)
    closed = close_rock(block, np.ones(len(block.points_m), bool), base, LEVEL)
    true_m3 = 4.0 * HALF_M**2 * (HEIGHT_M - CLEAR_M) + 4.0 * FOOT_M**2 * CLEAR_M
    assert closed.rock.volume_m3 == pytest.approx(true_m3, rel=0.06)  # with what lies between them 11 % more


@pytest.mark.parametrize("below", [False, True])
def test_one_sees_through_between_feet_alone(below):
    around, _ = sides_of(HALF_M, 0.02, 0.07, pitch_m=0.006)
    on_feet = np.vstack([points[points[:, 2] < 0.07] for points, _ in feet(0.006)])
    assert hidden_base(NearInterface(around, ground(below), HEIGHT_M), 0.8).passage is None
    assert (hidden_base(NearInterface(on_feet, ground(below), HEIGHT_M), 0.8).passage is not None) == below
