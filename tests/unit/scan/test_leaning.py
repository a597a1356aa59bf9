"""A rock that leans is refused by that name, where it is held and what to do; one that stands beside a wall is not."""

import contextlib

import numpy as np
import patches
import pytest
from refusals import refused
from scipy.spatial.transform import Rotation

from toppling.models.pedestal import Pedestal
from toppling.models.rock import Rock
from toppling.models.scan import virtual
from toppling.models.scan.leaning import leaning, refuse, upright_split
from toppling.models.scan.one_block import weakest_joint
from toppling.models.scan.segment import PEDESTAL, segment
from toppling.models.scan.surfels import Surfels
from toppling.models.shapes import box
from toppling.orchestrator.public.making import scan

HALF_WIDTH_M, HEIGHT_M, VOXEL_M = 0.2, 1.2, 0.012
OF_WALL_M = 1.6


def face(corner, u, v):
    """Patches of a rectangle and their normals, u x v outward."""
    u, v = np.asarray(u, float), np.asarray(v, float)
    s, t = (np.arange(0.5, np.linalg.norm(way) / VOXEL_M) * VOXEL_M / np.linalg.norm(way) for way in (u, v))
    points = np.asarray(corner) + s[:, None, None] * u + t[None, :, None] * v
    normal = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
    return points.reshape(-1, 3), np.tile(normal, (points[..., 0].size, 1))


def block(lean_deg):
    """Top and sides of a block that leans toward x on its lower edge at x = 0."""
    w, h = HALF_WIDTH_M, HEIGHT_M
    points, normals = patches.together(
        face((-2 * w, -w, 0), (2 * w, 0, 0), (0, 0, h)), face((0, -w, 0), (0, 2 * w, 0), (0, 0, h)),
        face((0, w, 0), (-2 * w, 0, 0), (0, 0, h)), face((-2 * w, w, 0), (0, -2 * w, 0), (0, 0, h)),
        face((-2 * w, -w, h), (2 * w, 0, 0), (0, 2 * w, 0)),
    )  # fmt: skip
    turn = Rotation.from_rotvec([0.0, np.deg2rad(lean_deg), 0.0])
    return turn.apply(points), turn.apply(normals)


def held_at_m(lean_deg, height_m):
    """Distance from the foot and height of the place where a wall of some height touches a block that leans."""
    angle = np.deg2rad(lean_deg)
    if height_m > HEIGHT_M * np.cos(angle):
        return HEIGHT_M * np.sin(angle), HEIGHT_M * np.cos(angle)
    return height_m * np.tan(angle), height_m


def beside_a_wall(lean_deg, wall_m, gap_m=0.0, azimuth_deg=0.0):
    """Patches of a block, the wall toward an azimuth from it, and the ground between."""
    at = held_at_m(lean_deg, wall_m)[0] + gap_m
    points, normals = patches.together(
        block(lean_deg),
        face((at, 1.5, 0.0), (0, -3.0, 0), (0, 0, wall_m)), face((at, -1.5, wall_m), (1.0, 0, 0), (0, 3.0, 0)),
        face((-1.5, -1.5, 0.0), (1.5 + at, 0, 0), (0, 3.0, 0)),
    )  # fmt: skip
    under = (points[:, 2] == 0.0) & (points[:, 0] < 0.0) & (points[:, 0] > -2 * HALF_WIDTH_M)
    under &= np.abs(points[:, 1]) < HALF_WIDTH_M
    turn = Rotation.from_euler("z", azimuth_deg, degrees=True)
    noise = np.random.default_rng(3).normal(scale=2e-4, size=points.shape)
    points, normals = turn.apply((points + noise)[~under]), turn.apply(normals[~under])
    return Surfels(points, normals, np.zeros(len(points)), VOXEL_M)


@pytest.mark.parametrize(("wall_m", "azimuth_deg"), [(OF_WALL_M, 0.0), (OF_WALL_M, 90.0), (0.8, 217.0)])
def test_a_block_past_its_balance_on_a_wall_leans_toward_it_by_what_its_weight_hangs_over(
    wall_m, azimuth_deg
):
    """The weight lies at h / 2 sin - w cos from the foot's edge; patches beside the edge are as far as their width."""
    (found,) = leaning(beside_a_wall(25.0, wall_m, azimuth_deg=azimuth_deg))
    angle = np.deg2rad(25.0)
    hangs_m = 0.5 * HEIGHT_M * np.sin(angle) - HALF_WIDTH_M * np.cos(angle)
    assert found.overhang_m == pytest.approx(hangs_m, abs=2.5 * VOXEL_M)
    assert found.above_foot_m == pytest.approx(held_at_m(25.0, wall_m)[1], abs=0.1 * HEIGHT_M)
    assert (found.toward_deg - azimuth_deg + 180.0) % 360.0 == pytest.approx(180.0, abs=5.0)
    with refused("rock.leans") as said:
        refuse([found], np.array([1000.0, 2000.0, 300.0]))
    for words in (f"azimuth {found.toward_deg:.0f}", "--rock", "--pedestal", "Scene.from_mesh"):
        assert words in str(said.value)


@pytest.mark.parametrize("leans", [True, False])
def test_what_stands_and_leans_on_the_rock_alone_is_a_part_of_it(leans):
    """As a sculpted leg is, or a knob: a rock taken together with its wall still stands on the ground."""
    surfels = beside_a_wall(25.0, OF_WALL_M)
    rock = surfels.points_m[:, 2] > VOXEL_M if leans else np.ones(len(surfels.points_m), bool)
    assert bool(list(leaning(surfels, rock=rock))) == leans


def test_a_block_far_past_its_balance_on_the_level_top_edge_of_a_low_boulder_leans():
    assert list(leaning(beside_a_wall(50.0, 0.3)))


@pytest.mark.parametrize(("lean_deg", "gap_m"), [(0.0, 0.05), (0.0, 0.0), (10.0, 0.0), (25.0, 0.06)])
def test_a_block_that_its_foot_carries_or_that_nothing_touches_does_not_lean(lean_deg, gap_m):
    assert not list(leaning(beside_a_wall(lean_deg, OF_WALL_M, gap_m)))


@pytest.mark.parametrize(("lowest_m", "stands"), [(0.0, True), (0.3, False)])
def test_a_slim_block_beside_a_boulder_is_refused_where_it_stands_itself(lowest_m, stands):
    slim = patches.box((0.38, -0.06, lowest_m), (0.5, 0.06, 0.8 + lowest_m))
    both = patches.together(patches.ball_at((0.0, 0.0, 0.4)), slim)
    observed = patches.seen_of(both, patches.ground(0.62))
    joint = weakest_joint(observed, patches.LEVEL)
    assert joint.creased_share > 0.82
    assert joint.part < 0.2
    with refused("rock.several_blocks") if stands else contextlib.nullcontext():
        patches.doubted(observed)


@pytest.mark.thorough
@pytest.mark.parametrize("lean_deg", [0.0, 8.0])
def test_a_block_at_a_lower_wall_is_not_told_apart_and_the_wall_is_named_with_what_to_do(lean_deg):
    points = beside_a_wall(lean_deg, 0.8, 0.02).points_m
    with refused("scan.no_crease"):
        segment(points, np.zeros(3))


@pytest.mark.thorough
def test_uneven_ground_about_a_pillar_that_grows_out_of_it_is_no_cliff():
    rise = np.linspace(0.0, 2.0, 60)
    foot = 0.24 * (1.0 - np.sqrt(1.0 - np.clip(1.0 - rise / 0.24, 0.0, 1.0) ** 2))
    crown = np.sqrt(np.clip(1.0 - np.clip((rise - 1.6) / 0.401, 0.0, None) ** 2, 0.0, 1.0))
    radius = np.repeat(((0.5 + foot) * crown)[:, None], 64, axis=1)
    pillar = virtual.lathe(radius, rise, np.zeros((60, 2)), 64)
    truth = virtual.on_slope(pillar, virtual.ground(5.0, 0.8, 3, bumps_m=0.1), 4.0, 250.0)
    stations = virtual.scan_around(truth, 1, stations=4, resolution_per_height=0.015)
    with refused("scan.no_crease") as found:
        segment(np.vstack([station.points_m for station in stations]), np.zeros(3))
    assert "cliff or wall" not in str(found.value)


@pytest.mark.thorough
@pytest.mark.parametrize("height_m", [0.8, 1.4])
def test_a_smooth_mound_that_nothing_stands_on_is_told_without_a_cliff(height_m):
    x, y = np.random.default_rng(3).uniform(-3.0, 3.0, (2, 20_000))
    points = np.column_stack([x, y, height_m * np.exp(-(x**2 + y**2) / 1.6)])
    with refused("scan.no_crease") as found:
        segment(points, np.zeros(3))
    assert "cliff or wall" not in str(found.value)


def scanned_m(lean_deg, holder, gap_m=0.0):
    """The virtual scanner's points on a block beside a wall, or a boulder that it touches from one side."""
    turn = Rotation.from_rotvec([0.0, np.deg2rad(lean_deg), 0.0])
    rock = box(HALF_WIDTH_M, HALF_WIDTH_M, HEIGHT_M / 2).moved(np.eye(3), (-HALF_WIDTH_M, 0.0, HEIGHT_M / 2))
    rock = rock.moved(turn.as_matrix())
    if holder == "wall":
        at_m = held_at_m(lean_deg, 1.5)[0] + gap_m
        wall = box(0.5, 2.0, 0.8).moved(np.eye(3), (at_m + 0.5, 0.0, 0.7))
        other = wall.vertices_m, wall.faces
    else:
        vertices, faces = virtual.boulder(1.0, 1.2, 0.96, 7, bumps=0.03, sides=64)
        out = turn.apply([1.0, 0.0, 0.0])
        beside = np.abs(vertices[:, 1]) < HALF_WIDTH_M
        other = vertices - [(vertices[beside] @ out).min() / out[0] - gap_m, 0.0, 0.0], faces
    truth = virtual.Truth(
        Rock.from_triangles(rock.vertices_m, rock.faces),
        Pedestal(np.zeros(3), np.array([0.0, 0.0, 1.0]), *virtual.ground(4.0, 2.0, 3, bumps_m=0.05)),
        (virtual.Body(*other, PEDESTAL),),
    )
    seen = virtual.scan_around(truth, 1, resolution_per_height=0.014, clutter=False)
    return virtual.cloud_of(seen, np.zeros(3))[0].points_m


@pytest.mark.slow
@pytest.mark.parametrize("holder", ["wall", "boulder"])
def test_the_scan_of_a_block_that_leans_is_refused_and_nothing_is_written(holder, tmp_path):
    file = tmp_path / "cloud.xyz"
    np.savetxt(file, scanned_m(25.0, holder), fmt="%.5f")
    with refused("rock.leans", "azimuth"):
        scan([file], tmp_path / "scene")
    assert not (tmp_path / "scene").exists()


@pytest.mark.slow
def test_a_block_beside_a_boulder_that_it_does_not_touch_is_split_as_ever():
    points = scanned_m(0.0, "boulder", gap_m=0.05)
    assert upright_split(points, np.zeros(3)).concave_share > 0.3
