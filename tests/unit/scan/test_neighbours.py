"""Walls and neighbours beside a scanned rock: what the tilting rock can reach is part of its scene's ground."""

import math

import numpy as np
import pytest
from patches import LEVEL, face

from toppling import Motion, shake
from toppling.models.pedestal import Pedestal
from toppling.models.rock import Rock
from toppling.models.scan import virtual
from toppling.models.scan.candidates import find_candidates, surfels_of
from toppling.models.scan.crevice import grid_triangles
from toppling.models.scan.segment import PEDESTAL
from toppling.models.scan.surfels import Surfels
from toppling.models.scan.surroundings import (
    CELL_PER_HEIGHT,
    TILTS_DEG,
    few_triangles,
    in_reach,
    mesh_surroundings,
    surroundings_met,
)
from toppling.models.scan.survey import save_survey, survey
from toppling.models.scene import Scene
from toppling.models.shapes import box

HALF_WIDTH_M, HEIGHT_M, VOXEL_M = 0.2, 1.2, 0.012
WALL_M = 1.0


def meshed(surfels, rock, other=None):
    """The mesh of what stands beside a rock."""
    shown = surroundings_met(surfels, rock, ~rock if other is None else other, LEVEL, HEIGHT_M)
    return mesh_surroundings(surfels, rock, shown, LEVEL, HEIGHT_M)


def patches(gap_m, *, hidden_from_m=None):
    """A block on level ground beside a wall at x = half width + gap, and which patches are the block's."""
    w, h = HALF_WIDTH_M, HEIGHT_M
    block = [
        face([2 * w, 0, 0], [0, 0, h], [-w, -w, 0], [0, -1, 0]), face([2 * w, 0, 0], [0, 0, h], [-w, w, 0], [0, 1, 0]),
        face([0, 2 * w, 0], [0, 0, h], [-w, -w, 0], [-1, 0, 0]), face([0, 2 * w, 0], [0, 0, h], [w, -w, 0], [1, 0, 0]),
        face([2 * w, 0, 0], [0, 2 * w, 0], [-w, -w, h], [0, 0, 1]),
    ]  # fmt: skip
    wall = face([0, 2.4, 0], [0, 0, WALL_M], [w + gap_m, -1.2, 0], [-1, 0, 0])
    top = face([0.4, 0, 0], [0, 2.4, 0], [w + gap_m, -1.2, WALL_M], [0, 0, 1])
    if hidden_from_m is not None:
        shown = (np.abs(wall[0][:, 1]) > HALF_WIDTH_M) | (wall[0][:, 2] > hidden_from_m)
        wall = wall[0][shown], wall[1][shown]
    ground = face([1.2, 0, 0], [0, 2.4, 0], [-1.5, -1.2, 0], [0, 0, 1])
    parts = [*block, wall, top, ground]
    points, normals = (np.vstack([part[k] for part in parts]) for k in (0, 1))
    noise = np.random.default_rng(5).normal(scale=0.0005, size=points.shape)
    rock = np.arange(len(points)) < sum(len(part[0]) for part in block)
    return Surfels(points + noise, normals, np.zeros(len(points)), VOXEL_M), rock


@pytest.mark.parametrize("gap_m", [0.25, 0.4])
def test_a_wall_is_reached_from_where_the_fallen_block_meets_it_up_to_its_crest(gap_m):
    """The block's side, tilted by t about its foot, is at the wall gap / tan(t) above the ground."""
    surfels, rock = patches(gap_m)
    reached = in_reach(surfels, rock, ~rock, LEVEL, HEIGHT_M)
    height = surfels.points_m[reached & (np.abs(surfels.points_m[:, 0] - HALF_WIDTH_M - gap_m) < 0.01), 2]
    cell = CELL_PER_HEIGHT * HEIGHT_M
    assert height.max() > WALL_M - 2.0 * VOXEL_M
    lowest = gap_m / math.tan(math.radians(TILTS_DEG[-1]))
    assert lowest - 3.0 * cell < height.min() < lowest + cell
    assert not reached[rock].any()


def test_a_wall_farther_than_the_rock_reaches_is_dropped():
    surfels, rock = patches(1.3)
    assert not in_reach(surfels, rock, ~rock, LEVEL, HEIGHT_M).any()
    assert not surroundings_met(surfels, rock, ~rock, LEVEL, HEIGHT_M).any()


def front(found, at_m):
    """Area (m,) of the triangles across x, negative where they face away from the block, and how far they lie off."""
    corners = found.vertices_m[found.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    across = np.abs(normals[:, 0]) > 0.9 * np.linalg.norm(normals, axis=1)
    return -0.5 * normals[across, 0], np.abs(corners[across][:, :, 0] - at_m).max(axis=1)


@pytest.mark.parametrize("turned_in", [False, True])
def test_a_wall_becomes_few_triangles_where_it_stands_that_face_the_rock(turned_in):
    """Which side of a wall is air is not told by the sky that a patch sees where the rock hides it."""
    surfels, rock = patches(0.1)
    if turned_in:
        inward = np.where((surfels.normals[:, 0] < -0.5) & ~rock, -1.0, 1.0)
        surfels = Surfels(
            surfels.points_m, inward[:, None] * surfels.normals, surfels.roughness, surfels.voxel_m
        )
    found = meshed(surfels, rock)
    area, off_m = front(found, HALF_WIDTH_M + 0.1)
    assert area[area < 0.0].sum() > -1e-3
    # The error that is allowed, in most of its area: at its crest it is round.
    assert area[off_m < 0.005 * HEIGHT_M].sum() > 0.8 * area.sum()
    assert len(found.faces) < 200
    assert found.nearest_m == pytest.approx(0.1, abs=0.006)
    assert found.highest_m == pytest.approx(WALL_M, abs=0.02)


@pytest.mark.thorough
def test_what_the_rock_hides_of_a_wall_is_closed():
    surfels, rock = patches(0.1, hidden_from_m=0.7)
    area, off_m = front(meshed(surfels, rock), HALF_WIDTH_M + 0.1)
    surfels, rock = patches(0.1)
    whole, _ = front(meshed(surfels, rock), HALF_WIDTH_M + 0.1)
    assert area.sum() == pytest.approx(whole.sum(), rel=0.03)
    assert off_m[area > 1e-4].max() < 0.05 * HEIGHT_M


@pytest.mark.thorough
def test_no_place_of_a_rough_ground_is_lost_where_its_triangles_are_joined():
    """A stone beside the rock stays a stone however small its triangles are, in metres."""
    for height_m in (0.2, 2.0, 20.0):
        u, v = np.meshgrid(*(np.linspace(-0.6, 0.6, 60),) * 2, indexing="ij")
        bump = 0.05 * np.exp(-((u - 0.2) ** 2 + v**2) / 0.04**2)
        vertices = height_m * np.column_stack([u.ravel(), v.ravel(), bump.ravel()])
        few, faces = few_triangles(vertices, grid_triangles(u.shape), height_m)
        assert len(faces) < 300
        assert few[:, 2].max() == pytest.approx(0.05 * height_m, rel=0.1)


def test_the_rocks_own_lower_end_is_no_neighbour():
    """Where no ground was seen beside a rock, its foot may have been taken for ground: it goes on without a bend."""
    surfels, rock = patches(0.4)
    foot = rock & (surfels.points_m[:, 2] < 0.3 * HEIGHT_M) & (surfels.points_m[:, 0] < -0.9 * HALF_WIDTH_M)
    assert foot.sum() > 500
    rock, other = rock & ~foot, ~rock | foot
    standing = meshed(surfels, rock, other)
    assert standing.vertices_m[:, 0].min() > HALF_WIDTH_M  # of the wall alone


def near_a_wall(gap_m):
    """A block beside a rock face, and the same as a scene of the true meshes."""
    rock = box(HALF_WIDTH_M, HALF_WIDTH_M, HEIGHT_M / 2).moved(np.eye(3), (0.0, 0.0, HEIGHT_M / 2))
    ground = virtual.ground(4.0, 1.0, 3, bumps_m=0.05)
    thick = box(0.5, 1.5, WALL_M / 2 + 0.1)  # no station stands in it
    wall = thick.moved(np.eye(3), (HALF_WIDTH_M + gap_m + 0.5, 0.0, WALL_M / 2 - 0.1))
    truth = virtual.Truth(
        Rock.from_triangles(rock.vertices_m, rock.faces),
        Pedestal(np.zeros(3), np.array([0.0, 0.0, 1.0]), *ground),
        (virtual.Body(wall.vertices_m, wall.faces, PEDESTAL),),
    )
    surface = np.vstack([ground[0], wall.vertices_m]), np.vstack([ground[1], wall.faces + len(ground[0])])
    return truth, Scene.from_mesh((rock.vertices_m, rock.faces), pedestal=surface, friction=0.8)


@pytest.mark.thorough
def test_a_rock_joined_to_a_nearby_wall_by_wide_patches_is_separated_by_finer_patches():
    truth, _ = near_a_wall(0.25)
    stations = virtual.scan_around(truth, 1, resolution_per_height=0.015, clutter=False)
    points_m = np.vstack([station.points_m for station in stations])
    highest = find_candidates(points_m, surfels_of(points_m))[0]
    reach_m = np.abs(highest.surfels.points_m[highest.rock, :2]).max()
    assert HALF_WIDTH_M <= reach_m < HALF_WIDTH_M + 0.1


@pytest.mark.slow
@pytest.mark.parametrize(("gap_m", "outcome"), [(0.25, "stands"), (0.4, "lodged")])
def test_a_scanned_rock_meets_a_nearby_wall_as_the_true_rock_does(gap_m, outcome, tmp_path):
    """A push topples it without the wall, which it meets at asin(gap / height of the wall) and more.

    It arrives slowly: after a hard blow the corner that meets the wall first, by a millimetre, decides what follows.
    """
    truth, true = near_a_wall(gap_m)
    stations = virtual.scan_around(truth, 1, resolution_per_height=0.009, clutter=False)
    result = survey(virtual.cloud_of(stations, virtual.DEMO_ORIGIN_M)[0], near_m=virtual.DEMO_ORIGIN_M[:2])
    scanned = Scene.load(save_survey(result, tmp_path / "rock"))
    assert scanned.id == result.scene.id
    assert not scanned.ground.is_plane
    assert len(scanned.pedestal.faces) < 500
    push = np.zeros((6300, 3))
    push[1:441, 0] = -4.5
    for scene in (scanned, true):
        shaken = shake(scene, Motion(push, 0.001), "fast")
        assert shaken.toppled == (outcome == "lodged")
        assert (shaken.outcome == "lodged") == (outcome == "lodged")
        met = math.degrees(math.atan(gap_m / WALL_M))
        assert shaken.max_tilt_deg == pytest.approx(met, abs=1.0)
