"""A crown that no station saw is closed at the convex hull of what was seen."""

import functools

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from tests.virtual_rocks import cut_by, dented, seen_from_tripods, turned
from toppling.models.hidden_base.gap import hidden_base
from toppling.models.hidden_base.near_interface import NearInterface, near_the_interface
from toppling.models.scan import virtual
from toppling.models.scan.close import close_rock
from toppling.models.scan.interface import Interface
from toppling.models.scan.segment import PEDESTAL, ROCK, label_surfels, patches_around
from toppling.models.scan.surfels import LEVEL

PLANE = Interface(np.zeros(3), np.array([0.0, 0.0, 1.0]), np.eye(3), 0.0)
UP = (0.0, 0.0, 1.0)


def boulder(seed, **shape):
    return virtual.boulder(2.0, 1.6, 1.1, seed, bumps=0.02, **shape)


def egg():
    turn = np.linspace(0.0, np.pi, 61)
    radius = 0.75 * np.sin(turn) * (1.0 + 0.15 * np.cos(turn))
    up = 1.0 - np.cos(turn)
    return turned(np.where(up < 0.16, np.maximum(radius, 0.25), np.maximum(radius, 0.003)), up)


SHAPES = {
    "dome": lambda: boulder(1),
    "egg": egg,
    "flat block": lambda: cut_by(boulder(2, squareness=1.0), (UP, 1.5)),
    "flat top": lambda: cut_by(boulder(3), (UP, 1.4)),
    "sloping top": lambda: cut_by(boulder(4), ((0.07, 0.05, 1.0), 1.35)),
    "low slab": lambda: cut_by(virtual.boulder(2.0, 2.4, 1.6, 7, bumps=0.015, squareness=0.6), (UP, 0.9)),
    "roof": lambda: cut_by(boulder(6, squareness=0.8), ((0.1, 0.0, 1.0), 1.45), ((-0.1, 0.0, 1.0), 1.45)),
    "dent": lambda: dented(cut_by(boulder(5), (UP, 1.5)), 1.5, 0.12, 0.45),
}


@functools.cache
def closed(name):
    truth = virtual.on_slope(SHAPES[name](), virtual.ground(6.0, 1.0, 3, cells=60), 0.0, 0.0)
    cloud = seen_from_tripods(truth, 1)
    height_m = truth.rock.height_m
    surfels, _, _ = patches_around(cloud.points_m, cloud.points_m[cloud.label == ROCK], height_m)
    own = label_surfels(surfels, cloud.points_m, cloud.label) == ROCK
    rock, pedestal = (cloud.points_m[cloud.label == value] for value in (ROCK, PEDESTAL))
    low, lit = near_the_interface(rock, pedestal, height_m)
    base = hidden_base(NearInterface(rock[low], pedestal[lit], height_m))
    return truth.rock, surfels.only(own), close_rock(surfels, own, base, PLANE)


ALL = [
    pytest.param(name, marks=pytest.mark.thorough if name in ("flat top", "roof") else pytest.mark.slow)
    for name in sorted(SHAPES.keys() - {"dent"})
]


@pytest.mark.parametrize("name", ALL)
def test_a_convex_rock_is_closed_to_its_volume_height_and_centre_of_mass_and_no_crown_rises_above_the_hull(
    name,
):
    true, seen, found = closed(name)
    assert found.rock.volume_m3 == pytest.approx(true.volume_m3, rel=0.006)
    assert found.rock.height_m == pytest.approx(true.height_m, rel=0.01)
    assert np.abs(found.rock.com_m - true.com_m).max() < 0.003 * true.height_m
    if name in ("flat top", "roof"):
        hull = ConvexHull(seen.points_m).equations
        crown = hull[hull[:, 2] > LEVEL]
        outside_m = (found.rock.vertices_m @ crown[:, :3].T + crown[:, 3]).max()
        assert outside_m < 1.01 * 0.5 * seen.voxel_m


@pytest.mark.slow
def test_a_dent_that_nobody_saw_is_filled_up_to_the_hull_and_no_higher():
    true, _, found = closed("dent")
    bowl_m3 = np.pi * 0.12 * (3.0 * 0.45**2 + 0.12**2) / 6.0
    assert found.rock.volume_m3 == pytest.approx(true.volume_m3 + bowl_m3, rel=0.006)
    assert found.rock.height_m == pytest.approx(true.height_m, rel=0.006)


@pytest.mark.slow
def test_the_unseen_fraction_of_a_crown_distinguishes_a_flat_top_from_a_dome():
    assert closed("flat top")[2].crown_unseen_share > 0.9
    assert closed("dome")[2].crown_unseen_share < 0.2
