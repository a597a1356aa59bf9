"""Between feet through which one sees, a rock is closed at its lower edge and not at its feet."""

from itertools import product

import numpy as np
import pytest
from patches import LEVEL, level
from refusals import refused

from toppling.models.hidden_base.gap import Underside, hidden_base
from toppling.models.hidden_base.inspection import Inspection
from toppling.models.hidden_base.near_interface import NearInterface, near_the_interface
from toppling.models.hidden_base.observed import hidden_part
from toppling.models.scan.close import about_hull, close_rock
from toppling.models.scan.surfels import Surfels, orient

HALF_M, HEIGHT_M, CLEAR_M, LEG_M, VOXEL_M = 0.2, 1.2, 0.16, 0.08, 0.012


def sides_of(half_m, low_m, high_m, middle_m=(0.0, 0.0), pitch_m=VOXEL_M):
    """Places on the sides of an upright prism, half as wide along x and y, and their normals."""
    half_m, points, normals = np.broadcast_to(half_m, 2), [], []
    for turn in range(4):
        away, wide = half_m[[turn % 2, 1 - turn % 2]]
        along = np.arange(-wide + 0.5 * pitch_m, wide, pitch_m)
        across, up = (g.ravel() for g in np.meshgrid(along, np.arange(low_m, high_m, pitch_m)))
        c, s = round(np.cos(turn * np.pi / 2)), round(np.sin(turn * np.pi / 2))
        points.append(np.column_stack([c * away - s * across, s * away + c * across, up]))
        normals.append(np.tile([c, s, 0.0], (len(up), 1)))
    return np.vstack(points) + np.append(middle_m, 0.0), np.vstack(normals).astype(float)


def top():
    points = level(HALF_M, VOXEL_M, HEIGHT_M)
    return points, np.tile([0.0, 0.0, 1.0], (len(points), 1))


def feet(pitch_m=VOXEL_M):
    off_m = HALF_M - 0.5 * LEG_M
    return [sides_of(0.5 * LEG_M, 0.0, CLEAR_M, at, pitch_m) for at in product((-off_m, off_m), repeat=2)]


def slabs(pitch_m=VOXEL_M):
    """Two feet as long as the block: low parts in most of the directions from its middle."""
    off_m = HALF_M - 0.5 * LEG_M
    return [sides_of((0.5 * LEG_M, HALF_M), 0.0, CLEAR_M, (x, 0.0), pitch_m) for x in (-off_m, off_m)]


def ground(below, on_slabs=False):
    points = level(0.8, 0.006)
    deep = np.abs(points[:, :2])
    under = (deep < HALF_M).all(axis=1)
    foot = (deep[:, : 1 if on_slabs else 2] > HALF_M - LEG_M).all(axis=1) & under
    mask = ~foot if below else ~under
    return points[mask]


@pytest.mark.thorough
@pytest.mark.parametrize(("feet_of", "sole_m2"), [(feet, 4.0 * LEG_M**2), (slabs, 4.0 * LEG_M * HALF_M)])
def test_a_block_on_feet_is_as_heavy_as_without_what_lies_between_them(feet_of, sole_m2):
    points, normals = (
        np.vstack(v) for v in zip(sides_of(HALF_M, CLEAR_M, HEIGHT_M), top(), *feet_of(), strict=True)
    )
    block = Surfels(points, normals, np.zeros(len(points)), VOXEL_M)
    rock, pedestal = np.vstack([places for places, _ in feet_of(0.006)]), ground(True, feet_of is slabs)
    low, lit = near_the_interface(rock, pedestal, HEIGHT_M)
    base = hidden_base(NearInterface(rock[low], pedestal[lit], HEIGHT_M))
    closed = close_rock(block, np.ones(len(block.points_m), bool), base, LEVEL)
    true_m3 = 4.0 * HALF_M**2 * (HEIGHT_M - CLEAR_M) + sole_m2 * CLEAR_M
    assert closed.rock.volume_m3 == pytest.approx(true_m3, rel=0.02)  # else 4 to 11 % more


@pytest.mark.parametrize("below", [False, True])
def test_lines_of_sight_pass_between_feet_only(below):
    around, _ = sides_of(HALF_M, 0.02, 0.07, pitch_m=0.006)
    on_feet = np.vstack([points[points[:, 2] < 0.07] for points, _ in feet(0.006)])
    assert hidden_base(NearInterface(around, ground(below), HEIGHT_M)).passage is None
    assert (hidden_base(NearInterface(on_feet, ground(below), HEIGHT_M)).passage is not None) == below


def test_a_rock_that_hangs_over_a_pedestal_seen_all_below_it_touches_nowhere():
    near = NearInterface(level(HALF_M, 0.006, 0.02), level(0.8, 0.006), HEIGHT_M)
    with refused("base.nothing_hidden", "0.02"):
        hidden_part(Underside.of(near), near, Inspection(), LEVEL)


def test_what_was_not_seen_bulges_sideways_no_farther_than_a_corner_may_and_not_up():
    seen_m = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-0.5, 0.5)])
    low_m, high_m = np.reshape(about_hull(seen_m, np.array([0.0, 0.0, 1.0])).bounding_box(), (2, 3))
    assert np.allclose(high_m, [1.4, 1.4, 0.5])
    assert np.allclose(low_m, [-1.4, -1.4, -0.9])


def plate(corner, u, v):
    s, t = (np.arange(0.5, np.linalg.norm(w) / VOXEL_M) * VOXEL_M / np.linalg.norm(w) for w in (u, v))
    return (corner + s[:, None, None] * np.array(u) + t[None, :, None] * np.array(v)).reshape(-1, 3)


@pytest.mark.thorough
def test_a_wall_below_what_hangs_over_faces_the_ground_that_was_seen_before_it():
    """A cloud of a rock whose back, ceiling and inside of the base were not seen: more sky shows from within."""
    wall = plate((-0.5, 0.5, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 0.6))
    others = [
        plate((-0.5, 0.0, 0.6), (1.0, 0.0, 0.0), (0.0, 0.0, 0.4)),
        plate((-0.5, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
        *(plate((x, 0.0, 0.6), (0.0, 0.5, 0.0), (0.0, 0.0, 0.4)) for x in (-0.5, 0.5)),
        *(plate((x, 0.5, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, 1.0)) for x in (-0.5, 0.5)),
        plate((-3.0, -3.0, 0.0), (6.0, 0.0, 0.0), (0.0, 3.5, 0.0)),
    ]  # fmt: skip
    points = np.vstack([wall, *others])
    normals = orient(points + np.random.default_rng(1).normal(scale=2e-4, size=points.shape), VOXEL_M).normals
    x, _, z = wall.T
    away_from_corners = (np.abs(x) < 0.4) & (z > 0.1) & (z < 0.5)
    assert (normals[: len(wall)][away_from_corners, 1] < 0.0).all()
