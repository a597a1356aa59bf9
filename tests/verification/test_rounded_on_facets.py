"""Rounded bases on ground of several facets: what topples them and how they roll, against closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from engine_cases import energy_j_kg, periods_s, topples_at_m_s2
from reference.bodies import height_field, round_cap
from refusals import refused
from scipy.spatial.transform import Rotation

from toppling import Motion, Scene, shake
from toppling.workers.engines import DEFAULT, engine_named
from toppling.workers.options import PRESETS, TerminationOptions
from toppling.workers.problem import Problem
from toppling.workers.shaking import Shaking
from toppling.workers.start import State

G, RADIUS_M, HALF_WIDTH_M = 9.81, 0.65, 0.3
RIM_RAD = math.asin(HALF_WIDTH_M / RADIUS_M)
STILL = Motion(np.zeros((2400, 3)), 0.005)
EDGES_M = [0.08, 0.02]


def folded(left, right, crease_m=0.0, half_m=3.0):
    """Two facets that meet in the line x = crease, by the height that each gains outward over a metre."""
    x = np.array([-half_m, crease_m, half_m])
    z = np.array([(crease_m + half_m) * left, 0.0, (half_m - crease_m) * right])
    ends = [np.column_stack([x, np.full(3, y), z]) for y in (-half_m, half_m)]
    return np.vstack(ends), np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]])


def cap_in_groove(edge_m, slope_deg, friction=1.2):
    rise = math.tan(math.radians(slope_deg))
    return Scene.from_mesh(round_cap(edge_m), pedestal=folded(rise, rise), friction=friction)


def centre_over_com_m(scene):
    """From the centre of mass of a cap up to its sphere's centre."""
    return RADIUS_M - (scene.rock.com_m[2] - scene.rock.vertices_m[:, 2].min())


def least(scene, *azimuths_deg):
    return [a for _, a in scene.quasi_static_toppling_m_s2(azimuths_deg)]


@pytest.mark.parametrize("edge_m", EDGES_M)
@pytest.mark.parametrize("slope_deg", [5.0, 15.0])
def test_a_cap_leaves_a_groove_as_a_sphere_that_rolls_up_a_facet(edge_m, slope_deg):
    """Tilted by t the contact is at (rho sin s, -rho cos s) from the sphere's centre, the centre of mass at
    (-d sin t, -d cos t): a = g (rho sin s + d sin t) / (rho cos s - d cos t), until the contact meets the rim."""
    scene, s = cap_in_groove(edge_m, slope_deg), math.radians(slope_deg)
    d, t = centre_over_com_m(scene), np.linspace(0.0, RIM_RAD - s, 2001)
    exact = G * (RADIUS_M * math.sin(s) + d * np.sin(t)) / (RADIUS_M * math.cos(s) - d * np.cos(t))
    assert least(scene, 0.0, 180.0) == pytest.approx([exact.max()] * 2, rel=0.005)


def cap_on_slope(slope_deg):
    """On a facet that falls toward x, above one that rises from its foot."""
    rise, (vertices, faces) = math.tan(math.radians(slope_deg)), round_cap(0.04)
    raised = vertices + np.array([0.0, 0.0, 2.0 * rise])
    return Scene.from_mesh((raised, faces), pedestal=folded(rise, 0.3, 2.0), friction=1.2)


@pytest.mark.thorough
@pytest.mark.parametrize("slope_deg", [10.0, 20.0])
def test_a_cap_that_rolls_off_by_itself_stands_no_acceleration_however_it_comes_to_lie(slope_deg):
    """With d sin(rim) < rho sin(s) its weight acts downhill of the contact up to the rim: 0, as on a plane."""
    scene = cap_on_slope(slope_deg)
    assert centre_over_com_m(scene) * math.sin(RIM_RAD) < RADIUS_M * math.sin(math.radians(slope_deg))
    assert least(scene, 0.0, 90.0, 180.0) == [0.0, 0.0, 0.0]
    with refused("rock.does_not_stand"):
        shake(scene, STILL)


@pytest.mark.thorough
def test_a_cap_that_rolls_to_rest_on_a_slope_is_shaken_and_topples_there_as_on_a_plane():
    on_facet, on_plane = (cap_on_slope(5.0), Scene.from_mesh(round_cap(0.04), friction=1.2, slope_deg=5.0))
    assert least(on_facet, 0.0, 90.0, 180.0) == pytest.approx(least(on_plane, 0.0, 90.0, 180.0), rel=0.03)
    assert shake(on_facet, STILL, preset="fast").outcome == "stands"


@pytest.mark.parametrize("edge_m", EDGES_M)
@pytest.mark.parametrize("slope_deg", [5.0, 15.0])
def test_a_cap_rolls_along_a_groove_as_on_a_smaller_sphere(edge_m, slope_deg):
    """On both facets it rolls with the radius rho cos s, until its rim touches: cos(rim) = cos(s) cos(t)."""
    scene, s = cap_in_groove(edge_m, slope_deg), math.radians(slope_deg)
    d, t = centre_over_com_m(scene), math.acos(math.cos(RIM_RAD) / math.cos(s))
    exact = G * d * math.sin(t) / (RADIUS_M * math.cos(s) - d * math.cos(t))
    assert least(scene, 90.0) == pytest.approx([exact], rel=0.01)


@pytest.mark.thorough
def test_a_cap_in_a_groove_topples_toward_any_azimuth_as_a_finer_cap():
    coarse, fine = (least(cap_in_groove(edge_m, 15.0), 30.0, 60.0, 160.0) for edge_m in (0.08, 0.02))
    assert coarse == pytest.approx(fine, rel=0.02)


@pytest.mark.parametrize("edge_m", EDGES_M)
@pytest.mark.parametrize("fall", [0.2, 0.6])
def test_a_cap_tips_over_the_edge_of_a_ledge_once_it_has_rolled_there(edge_m, fall):
    """Rolled by t = x / rho it stands on the edge, and turns about that: a = g d sin t / (rho - d cos t)."""
    scene = Scene.from_mesh(round_cap(edge_m), pedestal=folded(0.0, -fall, 0.15), friction=1.2)
    d, t = centre_over_com_m(scene), 0.15 / RADIUS_M
    exact = G * d * math.sin(t) / (RADIUS_M - d * math.cos(t))
    assert least(scene, 180.0) == pytest.approx([exact], rel=0.005)


def test_contacts_over_an_edge_are_the_same_bits_whatever_was_found_before():
    ledge = Scene.from_mesh(round_cap(0.08), pedestal=folded(0.0, -0.2, 0.1), friction=1.2).grounded
    poses, rng = [], np.random.default_rng(0)
    for angle in rng.uniform(0.1, 0.5, 60):
        turned = (Rotation.from_rotvec([0.0, angle, 0.0]) * Rotation.from_quat(ledge.pose[3:])).as_quat()
        shift = [0.25 * angle + rng.normal(0.0, 0.02), rng.normal(0.0, 0.02), 0.0]
        poses.append(ledge.touching(np.concatenate([ledge.pose[:3] + shift, turned])))
    there, back = ([ledge.contacts(value, 1e-3).copy() for value in order] for order in (poses, poses[::-1]))
    for single, other in zip(there, back[::-1], strict=True):
        for field in ("key", "gap_m", "normal", "place_m"):
            assert np.array_equal(single[field], other[field])


@pytest.mark.parametrize("edge_m", EDGES_M)
def test_a_cap_on_a_ledge_rolls_on_up_the_facet_that_rises_from_it(edge_m):
    """It meets the facet after rolling x - rho tan(s / 2), and is held there as in a groove, its axis tilted so far."""
    s, x = math.radians(10.0), 0.12
    scene = Scene.from_mesh(round_cap(edge_m), pedestal=folded(0.0, math.tan(s), x), friction=1.2)
    d, begun = centre_over_com_m(scene), (x - RADIUS_M * math.tan(0.5 * s)) / RADIUS_M
    t = np.linspace(begun, RIM_RAD - s, 2001)
    exact = G * (RADIUS_M * math.sin(s) + d * np.sin(t)) / (RADIUS_M * math.cos(s) - d * np.cos(t))
    assert least(scene, 180.0) == pytest.approx([exact.max()], rel=0.005)


@pytest.mark.parametrize("edge_m", EDGES_M)
def test_a_cap_swings_along_a_groove_with_the_period_of_a_smaller_sphere_and_loses_no_energy(edge_m):
    """T = 2 pi sqrt((I + (rho cos s - d)^2) / (g d)) for small swings, I per mass."""
    scene, s, tilt = cap_in_groove(edge_m, 15.0), math.radians(15.0), math.radians(2.0)
    rest = scene.grounded.rock_at_rest(scene.rock, scene.pedestal, "test")
    d, rolling_m = centre_over_com_m(scene), RADIUS_M * math.cos(s)
    inertia = scene.rock.inertia_per_mass_m2[0, 0]
    exact_s = 2.0 * math.pi * math.sqrt((inertia + (rolling_m - d) ** 2) / (G * d))
    turn = Rotation.from_rotvec([-tilt, 0.0, 0.0])
    place = rest.com_m + np.array([0.0, rolling_m * tilt, d]) - turn.apply([0.0, 0.0, d])
    start = {"position_m": place, "quaternion_xyzw": turn.as_quat()}
    found = shake(scene, STILL, "fast", initial=start, trajectory=True, shortcuts=False).trajectory
    swing = np.degrees(2.0 * np.arcsin(-np.asarray(found.quaternion_xyzw)[:, 0]))
    assert periods_s(found.time_s, swing)[:3] == pytest.approx(exact_s, rel=0.002)
    assert np.abs(swing[found.time_s > found.time_s[-1] - exact_s]).max() == pytest.approx(2.0, rel=0.01)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("ground", "azimuth_deg"),
    [(folded(0.0, -0.4, 0.15), 180.0), (folded(0.1, 0.1), 90.0), (folded(0.1, 0.1), 0.0)],
)
def test_a_slowly_growing_acceleration_topples_a_cap_on_facets_at_the_static_limit(ground, azimuth_deg):
    """So slowly that the swings that its growth begins, which nothing brakes, stay small."""
    scene = Scene.from_mesh(round_cap(0.04), pedestal=ground, friction=1.2)
    ((_, threshold),) = scene.quasi_static_toppling_m_s2([azimuth_deg])
    knots_s, levels_m_s2 = [0.0, 80.0, 240.0], threshold * np.array([0.0, 0.95, 1.05])
    assert topples_at_m_s2(scene, azimuth_deg, knots_s, levels_m_s2) == pytest.approx(threshold, rel=0.01)
    assert topples_at_m_s2(scene, azimuth_deg, knots_s, 0.94 * levels_m_s2) is None


@pytest.mark.parametrize(("friction", "restitution"), [(0.3, 0.0), (1.0, 0.0), (0.3, 0.3), (1.0, 0.3)])
def test_an_ellipsoid_that_rolls_over_uneven_ground_gains_no_energy(friction, restitution):
    """But for what half a step's fall gives, and the tolerance within which contacts touch, 2e-6 R each."""
    random = np.random.default_rng(0)
    waves, phases = 8.0 * random.normal(size=(2, 20, 1)), random.uniform(0.0, 2.0 * np.pi, (20, 1))
    ground = height_field(
        lambda x, y: 1e-3 * np.cos(waves[0] * x + waves[1] * y + phases).sum(axis=0),
        np.linspace(-1.2, 1.2, 41),
    )
    ball = trimesh.creation.icosphere(3, 1.0)
    vertices = np.array(ball.vertices) * [0.4, 0.5, 0.35] + [0.0, 0.0, 0.36]
    scene = Scene.from_mesh((vertices, np.array(ball.faces)), pedestal=ground, friction=friction)
    scene = scene.with_contact(replace(scene.contact, restitution=restitution))
    options = replace(PRESETS["fast"], termination=TerminationOptions(cap_after=2.0))
    start = State(velocity_m_s=[0.2, 0.1, 0.0], angular_velocity_rad_s=[-0.3, 0.6, 0.2])
    problem = Problem(scene, Motion(np.zeros((200, 3)), 0.01), options, 0.002, start, shortcuts=False)
    shaking = Shaking(problem, engine_named(DEFAULT).steps(problem))
    assert scene.rolls
    assert shaking.run() == "time_cap"
    energy = energy_j_kg(shaking)
    assert (energy - np.minimum.accumulate(energy)).max() < 2e-5 * G * scene.rock.half_diagonal_m
