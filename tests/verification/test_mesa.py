"""Blocks on mesas and beside curbs: tops as large as their bases, and what they slide off and into."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_ground import HALF_HEIGHT_M, HALF_WIDTH_M, G, as_surface, block, prism, pulse, strips
from test_rest_on_facets import burst

from toppling.models.hidden_base.unseen_base import BaseDraw, UnseenBase
from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.workers.shaking import shake

HEIGHT_M = 1.0
OFFSETS = [0.0, *(sign * size for size in (1e-9, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3) for sign in (1.0, -1.0))]
"""Margin of the top's half width over the base's, as a fraction of that."""
ROUNDINGS = [pytest.param(o, marks=[] if abs(o) < 1e-8 else pytest.mark.thorough) for o in OFFSETS]


def yawed(yaw_deg):
    rad = math.radians(yaw_deg)
    return np.array([[math.cos(rad), -math.sin(rad), 0], [math.sin(rad), math.cos(rad), 0], [0, 0, 1]])


def mesa(half_x_m, half_y_m, reach_m=6.0):
    """A square top at the height 0, its faces, and the ground below."""
    square, x, y = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float), half_x_m, half_y_m
    rings = [square * [x, y], square * [x, y], reach_m * square]
    heights = [0.0, -HEIGHT_M, -HEIGHT_M]
    vertices = np.vstack([np.column_stack([r, np.full(4, h)]) for r, h in zip(rings, heights, strict=True)])
    faces = [[0, 1, 2], [0, 2, 3]]
    for i in range(4):
        j = (i + 1) % 4
        faces += [[4 + i, 4 + j, j], [4 + i, j, i], [8 + i, 8 + j, 4 + j], [8 + i, 4 + j, 4 + i]]
    return vertices, np.array(faces)


def block_on_mesa(half_x_m, half_y_m, yaw_deg=0.0, turned_deg=0.0):
    """Turned against its mesa by an angle, and both by another."""
    vertices, faces = mesa(half_x_m, half_y_m)
    return as_surface(block((vertices @ yawed(yaw_deg).T, faces), turn=yawed(yaw_deg + turned_deg)))


def turned(motion, angle_deg):
    return Motion(motion.acceleration_m_s2 @ yawed(angle_deg).T, motion.time_step_s)


MOTIONS = [pulse(4.0, 0.3), pulse(5.0, 0.3, 45.0), *(Motion(burst(k, 7.0), 0.01) for k in (0, 2, 3))]


@pytest.fixture(scope="module")
def wide():
    shakes = [shake(block_on_mesa(0.6, 0.6), m, "fast") for m in MOTIONS]
    assert not any(s.toppled for s in shakes)
    assert max(s.max_tilt_deg for s in shakes) > 2.5
    return shakes


@pytest.mark.parametrize("yaw_deg", [0.0, 45.0, 27.3])
@pytest.mark.parametrize("offset", ROUNDINGS)
def test_a_block_rocks_on_a_top_of_its_bases_size_as_on_a_wider_top(offset, yaw_deg, wide):
    """Both ways, or along one side alone; what differs is where it tips: on its own edge or the mesa's."""
    half_m = HALF_WIDTH_M * (1.0 + offset)
    for half_y_m in (half_m, 0.6):
        scene = block_on_mesa(half_m, half_y_m, yaw_deg)
        for motion, expected in zip(MOTIONS, wide, strict=True):
            found = shake(scene, turned(motion, yaw_deg), "fast")
            assert not found.toppled
            assert found.max_tilt_deg == pytest.approx(expected.max_tilt_deg, rel=0.03)


@pytest.mark.parametrize("turned_deg", [1e-7, 1e-5, 1e-3, 0.05, -1e-6])
def test_a_block_turned_a_little_against_its_mesa_rocks_as_on_a_wider_mesa(turned_deg, wide):
    scene = block_on_mesa(HALF_WIDTH_M, HALF_WIDTH_M, 0.0, turned_deg)
    for motion, expected in zip(MOTIONS[:2], wide, strict=False):
        found = shake(scene, motion, "fast")
        assert not found.toppled
        assert found.max_tilt_deg == pytest.approx(expected.max_tilt_deg, rel=0.03)


@pytest.mark.parametrize("offset", OFFSETS)
def test_a_top_of_the_bases_size_holds_what_a_wider_top_holds(offset):
    scene = block_on_mesa(HALF_WIDTH_M * (1.0 + offset), HALF_WIDTH_M)
    tipped = G * HALF_WIDTH_M * min(1.0 + offset, 1.0) / HALF_HEIGHT_M
    for _, least in scene.quasi_static_toppling_m_s2([0.0, 180.0]):
        assert least == pytest.approx(tipped, rel=1e-3)


def slab_on(ground, half_height_m):
    return block(ground, 0.4, 0.3, half_height_m)


def between_curbs(height_m, distance_m):
    x = 0.3 + distance_m
    return strips([(-6, height_m), (-x, height_m), (-x, 0), (x, 0), (x, height_m), (6, height_m)])


SLIDES = [
    pulse(level, 0.3, azimuth_deg, 0.6) for level, azimuth_deg in ((6.0, 10.0), (8.0, 200.0), (11.0, 55.0))
]


@pytest.mark.parametrize("margin_m", [-0.05, -0.02, 0.02, 0.06, 0.3])
def test_a_rock_slides_off_a_rim_as_on_the_whole_surface(margin_m):
    scene = slab_on(mesa(0.3 + margin_m, 0.3 + margin_m), 0.45)
    assert scene.ground.is_plane is (margin_m > 0.05)
    found = [shake(scene, s, "fast") for s in SLIDES]
    expected = [shake(as_surface(scene), s, "fast") for s in SLIDES]
    assert [e.outcome for e in found] == [e.outcome for e in expected]
    assert found[-1].toppled
    for entry, other in zip(found, expected, strict=True):
        assert entry.toppled or entry.slip_m == pytest.approx(other.slip_m, rel=0.02)


@pytest.mark.parametrize(("height_m", "distance_m"), [(0.05, 0.15), (0.05, 0.3), (0.1, 0.2), (0.2, 0.3)])
def test_a_curb_stops_a_slab_that_slides_into_it(height_m, distance_m):
    free, ahead = slab_on(strips([(-6, 0), (6, 0)]), 0.1), slab_on(between_curbs(height_m, distance_m), 0.1)
    for level, reaches in ((5.0, False), (10.0, True)):
        push = pulse(-level, 0.3, 0.0, 0.6)
        slip_m = shake(free, push, "fast").slip_m
        assert (slip_m > distance_m) is reaches
        met = shake(ahead, push, "fast")
        assert met.outcome == "moved"
        assert met.penetration_m < 0.01 * height_m
        if reaches:
            assert 0.8 * distance_m < met.slip_m < 1.001 * distance_m
        else:
            assert met.slip_m == pytest.approx(slip_m, rel=1e-3)


def on_drawn_base(scene):
    """A scene whose own base counts as drawn over the interface plane."""
    rock = dataclasses.replace(scene.rock, feet_m=scene.rock.hull_vertices_m)
    return dataclasses.replace(scene, rock=rock)


def test_a_base_drawn_over_a_plane_meets_a_curb_and_a_rim_as_its_own_would():
    for ground, half_height_m in ((between_curbs(0.05, 0.15), 0.2), (mesa(0.36, 0.36), 0.45)):
        scene = slab_on(ground, half_height_m)
        for level, lasting_s in ((8.0, 0.3), (5.0, 0.2)):
            push = pulse(level, lasting_s, 0.0, 0.6)
            drawn, own = (shake(v, push, "fast") for v in (on_drawn_base(scene), scene))
            assert drawn.outcome == own.outcome
            assert own.toppled or drawn.slip_m == pytest.approx(own.slip_m, rel=0.05)


def test_a_drawn_base_leaves_its_plane_for_ground_that_is_the_same_plane_to_one_per_cent_of_its_height():
    """What of the rock its feet replace, and relief of which their clearances tell, overlap nothing there."""
    for height_m, level_m in ((0.003, 0.0), (0.054, 0.05)):  # of a rock .4 m high
        scene = slab_on(between_curbs(height_m, 0.15), 0.2)
        upper = scene.rock.vertices_m[scene.rock.vertices_m[:, 2] > 0.1]
        rock = dataclasses.replace(scene.rock, feet_m=np.vstack([upper, upper * [0.5, 0.5, 0.0]]))
        draws = UnseenBase(0.1, (BaseDraw(rock.feet_m, np.zeros(3)),))
        body = dataclasses.replace(scene, rock=rock, unseen=draws).grounded
        assert np.unique(body.ground.vertices_m[:, 2].round(9)).tolist() == sorted({0.0, level_m})
        placed = Rotation.from_quat(body.pose[3:]).apply(body.rock.vertices_m) + body.pose[:3]
        low = np.abs(placed[placed[:, 2] < 0.1, :2]).max(axis=0)
        np.testing.assert_allclose(low, 0.5 * np.abs(upper[:, :2]).max(axis=0))


def test_a_rock_that_topples_before_it_slides_anywhere_has_toppled():
    assert shake(on_drawn_base(block(mesa(0.26, 0.26))), pulse(5.0, 0.6), "fast").outcome == "toppled"


@pytest.mark.parametrize("step_m", [0.05, 0.2, 0.4])
def test_exactly_parallel_legs_on_two_levels_agree_in_every_impact(step_m):
    """Eight corners of two feet are more than a rock needs: they share an impact in more ways than one."""
    ring = [
        (-0.5, 0),
        (-0.3, 0),
        (-0.3, 0.6),
        (0.3, 0.6),
        (0.3, step_m),
        (0.5, step_m),
        (0.5, 1.6),
        (-0.5, 1.6),
    ]
    rock = prism(ring, [(0, 1, 2), (0, 2, 7), (2, 3, 6), (2, 6, 7), (3, 4, 5), (3, 5, 6)], half_depth=0.4)
    levels = strips([(-6.0, 0.0), (-0.2, 0.0), (-0.2, -1.0), (0.2, -1.0), (0.2, step_m), (6.0, step_m)])
    scene = Scene.from_mesh(rock, pedestal=levels, friction=0.8)
    shakes = [shake(scene, Motion(burst(seed, 9.0, 6.0), 0.01), "fast") for seed in range(6)]
    assert {"contacts_disagree"}.isdisjoint(s.ended_by for s in shakes)
    assert max(s.max_tilt_deg for s in shakes) > 1.0
