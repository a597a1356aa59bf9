"""A flat base that rolls on a dome of fine triangles, against the equations for a smooth one."""

import dataclasses
import math

import numpy as np
import pytest
from reference.bodies import height_field
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from test_ground import block, strips

from toppling.models.motions.motion import Motion
from toppling.workers.shaking import shake

G = 9.81
HALF_WIDTH_M, HALF_HEIGHT_M, RADIUS_M = 0.2, 0.5, 1.2
STILL = Motion(np.zeros((1200, 3)), 0.005)


def dome(height_at, edge_m, reach_m=0.6):
    """A height field of square cells, halved."""
    return height_field(height_at, np.arange(-reach_m, reach_m + 0.5 * edge_m, edge_m))


def cylinder(x, y):
    return np.sqrt(RADIUS_M**2 - x**2) - RADIUS_M + 0.0 * y


def sphere(x, y):
    return np.sqrt(RADIUS_M**2 - x**2 - y**2) - RADIUS_M


def block_on(surface, yaw_deg=0.0, friction=1.5):
    turn = Rotation.from_euler("z", yaw_deg, degrees=True).as_matrix()
    return block(surface, friction, HALF_WIDTH_M, HALF_HEIGHT_M, turn)


def rolled_com(tilt):
    """The centre of mass of the block that has rolled toward x."""
    com = RADIUS_M * np.array([math.sin(tilt), 0.0, math.cos(tilt) - 1.0])
    com += -RADIUS_M * tilt * np.array([math.cos(tilt), 0.0, -math.sin(tilt)])
    return com + HALF_HEIGHT_M * np.array([math.sin(tilt), 0.0, math.cos(tilt)])


def rolled(scene, tilt):
    """The start of the block that has rolled toward x."""
    seat = scene.rock.com_m - (0.0, 0.0, HALF_HEIGHT_M)
    return {
        "position_m": rolled_com(tilt) + seat,
        "quaternion_xyzw": [0.0, math.sin(0.5 * tilt), 0.0, math.cos(0.5 * tilt)],
    }


def exact_tilt(inertia_m2, tilt, time_s):
    """From rest: T = (I + h^2 + (rho th)^2) th'^2 / 2, V = g (rho cos th + rho th sin th + h cos th), per mass."""

    def rate(_, state):
        th, speed = state
        arm2 = inertia_m2 + HALF_HEIGHT_M**2 + (RADIUS_M * th) ** 2
        slope = G * (RADIUS_M * th * math.cos(th) - HALF_HEIGHT_M * math.sin(th))
        return [speed, -(slope + RADIUS_M**2 * th * speed**2) / arm2]

    return solve_ivp(rate, (0.0, time_s[-1]), [tilt, 0.0], t_eval=time_s, rtol=1e-10, atol=1e-12).y[0]


def cylinder_of(strip_m):
    """The cylinder as strips along y."""
    x = np.arange(-0.6, 0.6 + 0.5 * strip_m, strip_m)
    return strips([*zip(x, cylinder(x, 0.0), strict=True)], 2.0)


@pytest.mark.parametrize(
    ("surface", "yaw_deg", "within"),
    [
        (cylinder_of(0.01), 0.0, 0.12),
        (cylinder_of(0.002), 0.0, 0.015),
        (cylinder_of(0.002), 25.0, 0.015),
        pytest.param(dome(sphere, 0.01), 25.0, 0.12, marks=pytest.mark.thorough),
    ],
)
def test_a_block_swings_on_a_dome_by_lagranges_equation(surface, yaw_deg, within):
    """The narrower the triangles, the nearer."""
    scene = block_on(surface, yaw_deg)
    start = math.radians(6.0)
    found = shake(scene, STILL, "fast", initial=rolled(scene, start), trajectory=True).trajectory
    q, time_s = found.quaternion_xyzw, found.time_s
    tilt = 2.0 * np.arctan2(q[:, 1], q[:, 3])
    keep = time_s <= 6.0
    exact = exact_tilt(scene.rock.inertia_per_mass_m2[1, 1], start, time_s[keep])
    assert tilt[keep] == pytest.approx(exact, abs=within * start)


def topples_where_it_has_rolled_to(surface, radius_m, within, friction=1.5):
    tilt = np.linspace(0.0, HALF_WIDTH_M / radius_m, 2001)
    exact = (G * np.tan(np.arctan(radius_m * tilt / HALF_HEIGHT_M) - tilt)).max()
    found = block_on(surface, friction=friction).quasi_static_toppling_m_s2([0.0, 180.0])
    return [value for _, value in found] == pytest.approx([exact] * 2, rel=within)


@pytest.mark.parametrize("surface", [cylinder, sphere])
def test_a_block_on_a_dome_topples_where_it_has_rolled_to(surface):
    """It tips about an edge, half a triangle beyond the place where a smooth dome touches."""
    assert topples_where_it_has_rolled_to(dome(surface, 0.01), RADIUS_M, 0.5 * 0.01 / (HALF_WIDTH_M - 0.03))


def test_a_block_on_a_cylinder_that_is_pushed_obliquely_topples_across_it():
    across, oblique = (
        value for _, value in block_on(dome(cylinder, 0.01)).quasi_static_toppling_m_s2([0.0, 30.0])
    )
    assert oblique == pytest.approx(across / math.cos(math.radians(30.0)), rel=1e-3)


def test_a_smooth_part_touches_an_edge_at_a_single_place_however_it_has_rolled():
    body = block_on(cylinder_of(0.01)).grounded
    rock, ground = body.moving
    assert (ground.smooth_edges >= 0).sum() == 117  # the outermost are wider than .02 R
    for tilt in np.radians(np.linspace(-5.0, 5.0, 41)):
        attitude = Rotation.from_rotvec([0.0, tilt, 0.0]) * Rotation.from_quat(body.pose[3:])
        pose = np.concatenate([rolled_com(tilt), attitude.as_quat()])
        found = dataclasses.replace(body, rock=rock, ground=ground, pose=pose).contacts(pose, 1e-3)
        across = found[found["key"] >= 2 << 60]
        assert len(np.unique(across["key"])) == 2
        assert len(across) <= 4
        assert across["gap_m"] == pytest.approx(0.0, abs=2e-5)
        assert len(body.contacts(pose, 1e-3)) >= 6


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("edge_slope_deg", "strip_count"), [(3.0, 400), (9.5, 400), (14.0, 400), (19.0, 1600)]
)
def test_a_block_on_a_dome_of_strips_topples_where_it_has_rolled_to(edge_slope_deg, strip_count):
    """Over the steepest dome the corners hang higher than what is looked at when the rock is at rest."""
    radius_m = HALF_WIDTH_M / math.sin(math.radians(edge_slope_deg))
    x = np.linspace(-0.5, 0.5, strip_count)
    profile = [*zip(x, np.sqrt(radius_m**2 - x**2) - radius_m, strict=True)]
    assert topples_where_it_has_rolled_to(strips(profile, 2.0), radius_m, 0.03, friction=0.8)


@pytest.mark.parametrize("yaw_deg", [0.0, 25.0, 45.0])
def test_no_swing_on_a_dome_gains_energy_where_its_contact_passes_a_corner(yaw_deg):
    for friction in (0.6, 1.5):
        scene = block_on(cylinder_of(0.01), yaw_deg, friction)
        start = rolled(scene, math.radians(9.0))
        found = shake(scene, STILL, "fast", initial=start)
        assert found.max_tilt_deg == pytest.approx(9.0, abs=0.05)


def test_a_shake_on_a_dome_gives_the_same_bits_after_another():
    scene = block_on(dome(sphere, 0.01), 25.0)
    swings = [
        shake(scene, STILL, "fast", initial=rolled(scene, math.radians(tilt)), trajectory=True).trajectory
        for tilt in (5.0, 8.0, 5.0)
    ]
    assert (swings[0].position_m == swings[2].position_m).all()
