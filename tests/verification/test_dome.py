"""A flat base that rolls on a smooth dome: against the equations of its motion, and the triangles of the dome."""

import math

import numpy as np
import pytest
from reference.bodies import height_field
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from test_ground import block, strips

from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.models.shapes import box
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


def rolled(scene, tilt):
    """The start of the block that has rolled toward x."""
    com = RADIUS_M * np.array([math.sin(tilt), 0.0, math.cos(tilt) - 1.0])
    com += -RADIUS_M * tilt * np.array([math.cos(tilt), 0.0, -math.sin(tilt)])
    com += HALF_HEIGHT_M * np.array([math.sin(tilt), 0.0, math.cos(tilt)])
    seat = scene.rock.com_m - (0.0, 0.0, HALF_HEIGHT_M)
    return {
        "position_m": com + seat,
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


@pytest.mark.parametrize(
    ("surface", "yaw_deg", "edge_m"),
    [(cylinder, 0.0, 0.015), (cylinder, 25.0, 0.01), (sphere, 0.0, 0.015), (sphere, 25.0, 0.015)],
)
def test_a_block_swings_on_a_dome_as_lagranges_equation_says(surface, yaw_deg, edge_m):
    scene = block_on(dome(surface, edge_m), yaw_deg)
    start = math.radians(6.0)
    found = shake(
        scene, STILL, "fast", initial=rolled(scene, start), trajectory=True, shortcuts=False
    ).trajectory
    q, time_s = found.quaternion_xyzw, found.time_s
    tilt = 2.0 * np.arctan2(q[:, 1], q[:, 3])
    keep = time_s <= 6.0
    exact = exact_tilt(scene.rock.inertia_per_mass_m2[1, 1], start, time_s[keep])
    assert tilt[keep] == pytest.approx(exact, abs=0.03 * start)


def topples_where_it_has_rolled_to(surface, radius_m, within, friction=1.5):
    tilt = np.linspace(0.0, HALF_WIDTH_M / radius_m, 2001)
    exact = (G * np.tan(np.arctan(radius_m * tilt / HALF_HEIGHT_M) - tilt)).max()
    found = block_on(surface, friction=friction).quasi_static_toppling_m_s2([0.0, 180.0])
    return [value for _, value in found] == pytest.approx([exact] * 2, rel=within)


@pytest.mark.parametrize(("surface", "edge_m"), [(cylinder, 0.01), (sphere, 0.015)])
def test_a_block_on_a_dome_topples_where_it_has_rolled_to(surface, edge_m):
    assert topples_where_it_has_rolled_to(dome(surface, edge_m), RADIUS_M, 0.01)


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


def is_smooth(scene):
    return scene.grounded.rolls_on_dome


def test_a_flat_base_on_a_fine_dome_is_taken_for_no_plane():
    """Its nearest contacts, more than are looked at in a step, all lie in one plane."""
    scene = block_on(dome(cylinder, 0.01))
    assert is_smooth(scene)
    assert not scene.ground.is_plane


@pytest.mark.parametrize("yaw_deg", [0.0, 25.0, 45.0])
def test_no_swing_on_a_dome_gains_energy_where_its_contact_passes_a_corner(yaw_deg):
    for friction in (0.6, 1.5):
        scene = block_on(dome(cylinder, 0.02), yaw_deg, friction)
        start = rolled(scene, math.radians(9.0))
        found = shake(scene, STILL, "fast", initial=start, trajectory=True, shortcuts=False)
        assert is_smooth(scene)
        assert found.max_tilt_deg == pytest.approx(9.0, abs=0.05)


NO_SMOOTH_DOMES = {
    "rough": lambda x, y: sphere(x, y) + 0.002 * np.sin(60.0 * x) * np.sin(60.0 * y),
    "a ridge": lambda x, y: -0.15 * np.abs(x) + 0.0 * y,
    "a bowl": lambda x, y: -sphere(x, y),
    "with a wall": lambda x, y: np.where(x > 0.45, 0.5, sphere(x, y)),
}


@pytest.mark.parametrize("surface", NO_SMOOTH_DOMES.values(), ids=NO_SMOOTH_DOMES)
def test_what_is_no_smooth_dome_keeps_its_triangles(surface):
    assert not is_smooth(block_on(dome(surface, 0.015)))


def test_a_dome_of_coarse_triangles_keeps_them():
    assert not is_smooth(block_on(dome(sphere, 0.04)))


@pytest.mark.parametrize(("rise_m", "smooth"), [(0.2, True), (0.05, False)])
def test_a_rock_that_hangs_low_beside_its_base_keeps_the_triangles(rise_m, smooth):
    """What hangs .05 m over the base and .18 m beside it can touch the ground after a tilt of 15 degrees, or less."""
    base = box(HALF_WIDTH_M, HALF_WIDTH_M, HALF_HEIGHT_M)
    vertices = base.vertices_m.copy()
    top = vertices[:, 2] > 0.0
    vertices[top] = vertices[top] * (1.9, 1.9, 0.0) + (0.0, 0.0, rise_m - HALF_HEIGHT_M)
    rock = vertices + np.array([0.0, 0.0, HALF_HEIGHT_M])
    assert (
        is_smooth(Scene.from_mesh((rock, base.faces), pedestal=dome(sphere, 0.015), friction=0.8)) is smooth
    )


def test_a_base_with_a_hollow_keeps_the_triangles():
    """The dome would reach into it."""
    base = box(HALF_WIDTH_M, HALF_WIDTH_M, HALF_HEIGHT_M).moved(np.eye(3), (0.0, 0.0, HALF_HEIGHT_M))
    low = np.isclose(base.vertices_m[base.faces][:, :, 2], 0.0).all(axis=1)
    corners = np.unique(base.faces[low])
    ring = corners[np.argsort(np.arctan2(*base.vertices_m[corners, :2].T))]
    sides = [[ring[k], ring[(k + 1) % 4], len(base.vertices_m)] for k in range(4)]
    vertices = np.vstack([base.vertices_m, [0.0, 0.0, 0.05]])
    rock = vertices, np.vstack([base.faces[~low], sides])
    assert not is_smooth(Scene.from_mesh(rock, pedestal=dome(sphere, 0.015), friction=0.8))


def test_a_shake_on_a_dome_gives_the_same_bits_after_another():
    scene = block_on(dome(sphere, 0.015), 25.0)
    swings = [
        shake(scene, STILL, "fast", initial=rolled(scene, math.radians(tilt)), trajectory=True).trajectory
        for tilt in (5.0, 8.0, 5.0)
    ]
    assert (swings[0].position_m == swings[2].position_m).all()
