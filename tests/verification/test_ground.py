"""Rocks on ground that is no plane: closed forms, the plane as a limit, and what stands beside them."""

import math
from itertools import pairwise, product

import engine_cases as case
import numpy as np
import pytest
import trimesh
from engine_cases import topples_at_m_s2
from reference.bodies import round_cap
from reference.rocking import Ground, PlaneBody
from reference.rocking import rock as rock_exactly
from refusals import refused
from scipy.integrate import solve_ivp
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from toppling.models.ground.plane import GroundKind
from toppling.models.hidden_base.draw_bases import ContradictionError
from toppling.models.motions.motion import Motion
from toppling.models.pedestal import ContactProperties
from toppling.models.scan.survey import SeparatedMeshes
from toppling.models.scene import Scene
from toppling.models.shapes import box
from toppling.models.statics import quasi_static_toppling_m_s2
from toppling.models.tipping import limits_on_surface
from toppling.orchestrator.public.making import scan
from toppling.workers.engines import DEFAULT, engine_named
from toppling.workers.options import PRESETS
from toppling.workers.problem import Problem
from toppling.workers.shaking import Shaking, shake
from toppling.workers.standing import holds, least_overturning_j_kg
from toppling.workers.start import State

G = 9.81
HALF_WIDTH_M, HALF_HEIGHT_M = 0.2, 0.6


def facets(left_deg, right_deg, reach_m=6.0):
    """Two facets that meet in the line x = 0, rising outward by so many degrees."""
    left, right = (math.tan(math.radians(a)) * reach_m for a in (left_deg, right_deg))
    s = reach_m
    vertices = np.array([[-s, -s, left], [0, -s, 0], [s, -s, right], [-s, s, left], [0, s, 0], [s, s, right]])
    return vertices, np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]])


def block_on(
    left_deg, right_deg, friction=0.8, half_width=HALF_WIDTH_M, half_height=HALF_HEIGHT_M, foot_m=0.16
):
    """A block whose four corner edges are feet that reach down to two facets; between them its base is hollow."""
    vertices, faces = legged(half_width, half_height, foot_m)
    lowest = np.isclose(vertices[:, 2], 0.0)
    slope = np.where(vertices[:, 0] < 0.0, left_deg, right_deg)
    crest = math.tan(math.radians(max(0.0, -min(left_deg, right_deg)))) * half_width
    both_fall = left_deg < 0.0 and right_deg < 0.0
    under = np.tan(np.radians(slope)) * half_width + (crest if both_fall else 0.0)
    vertices[lowest, 2] = under[lowest]
    ground, triangles = facets(left_deg, right_deg)
    return Scene.from_mesh(
        (vertices, faces),
        pedestal=(ground + np.array([0.0, 0.0, crest if both_fall else 0.0]), triangles),
        friction=friction,
    )


def stool_on(left_deg, right_deg, friction=0.4):
    return block_on(left_deg, right_deg, friction, half_width=0.4, half_height=0.25, foot_m=0.245)


def legged(half_width, half_height, foot_m):
    """A box whose base is an inverted pyramid cut out of it: only its four corners stand on the ground."""
    solid = box(half_width, half_width, half_height).moved(np.eye(3), (0.0, 0.0, half_height))
    vertices, faces = solid.vertices_m, solid.faces
    base = [f for f in faces if np.allclose(vertices[f][:, 2], 0.0)]
    rest = np.array([f for f in faces if not np.allclose(vertices[f][:, 2], 0.0)])
    ring = sorted({int(i) for f in base for i in f}, key=lambda i: math.atan2(vertices[i, 1], vertices[i, 0]))
    middles = np.array(
        [0.5 * (vertices[a] + vertices[b]) + [0, 0, foot_m] for a, b in pairwise([*ring, ring[0]])]
    )
    return _with_arches(vertices, rest, ring, middles, foot_m)


def _with_arches(vertices, rest, ring, middles, foot_m):
    """Close a box without its base by arches between its corners, all edges shared."""
    top = [i for i in range(len(vertices)) if i not in ring]
    n = len(vertices)
    points = np.vstack([vertices, middles, [[0.0, 0.0, foot_m]]])
    centre, faces = n + 4, [f for f in rest if all(int(i) in top for i in f)]
    above = {i: min(top, key=lambda j: np.linalg.norm(vertices[j, :2] - vertices[i, :2])) for i in ring}
    for k, (a, b) in enumerate(pairwise([*ring, ring[0]])):
        m = n + k
        faces += [[a, m, above[a]], [m, above[b], above[a]], [m, b, above[b]]]
        faces += [[a, centre, m], [m, centre, b]]
    return points, np.array(faces, np.int64)


def strips(profile, reach_m=6.0):
    """Ground with a profile of (x, z), the same along y."""
    vertices = np.array([[x, y, z] for y in (-reach_m, reach_m) for x, z in profile])
    n, i = len(profile), np.arange(len(profile) - 1)
    return vertices, np.vstack(
        [np.column_stack([i, i + 1, n + i + 1]), np.column_stack([i, n + i + 1, n + i])]
    )


def block(pedestal=None, friction=0.8, half_width=HALF_WIDTH_M, half_height=HALF_HEIGHT_M, turn=None):
    """A block that stands with its middle over the origin."""
    rock = box(half_width, half_width, half_height).moved(
        np.eye(3) if turn is None else turn, (0.0, 0.0, half_height)
    )
    return Scene.from_mesh((rock.vertices_m, rock.faces), pedestal=pedestal, friction=friction)


def pulse(acceleration_m_s2, lasting_s, azimuth_deg=0.0, after_s=2.0):
    """A rectangular pulse, a sample wide at its ends."""
    step = 0.001
    x = np.zeros(int((lasting_s + after_s) / step))
    x[1 : round(lasting_s / step) + 1] = acceleration_m_s2
    rad = math.radians(azimuth_deg)
    return Motion(np.column_stack([x * math.cos(rad), x * math.sin(rad), 0.0 * x]), step)


STILL = Motion(np.zeros((2, 3)), 0.01)


def cone_programme(scene, azimuth_deg):
    """Largest acceleration with an equilibrium of the rock where it rests."""
    body, rad = scene.grounded, math.radians(azimuth_deg)
    push = -np.array([math.cos(rad), math.sin(rad), 0.0]) @ body.scene_from_support
    columns = body.wrenches(body.resting_pose)
    return linprog(
        np.append(np.zeros(columns.shape[1]), -1.0),
        A_eq=np.column_stack([columns, np.append(push, np.zeros(3))]),
        b_eq=-np.append(body.load_m_s2(), np.zeros(3)),
    ).x[-1]


@pytest.mark.parametrize(
    ("left", "right", "friction"),
    [
        (5, 5, 0.6), (30, 30, 0.6), (30, 30, 0.8), (-15, -15, 0.8), (-30, -30, 0.6), (0, -30, 0.8),
        (0, 15, 0.6), (5, 5, 0.2), (-15, -15, 0.4),
    ],
)  # fmt: skip
def test_a_block_on_two_facets_leaves_its_friction_cones_by_tipping_or_sliding(left, right, friction):
    """It tips about the two feet on its far side, wherever the facets put them, whatever the friction."""
    scene = block_on(left, right, friction)
    arms = scene.rock.vertices_m - scene.rock.com_m
    feet = [min(arms[side * arms[:, 0] > 0.0], key=lambda arm: arm[2]) for side in (-1.0, 1.0)]
    over = [G * abs(foot[0]) / -foot[2] for foot in feet]
    for azimuth, tips, slides in scene.statics([0.0, 180.0, 90.0, 250.0]):
        if azimuth in (0.0, 180.0):
            assert tips == pytest.approx(over[int(azimuth / 180.0)], rel=1e-4)
        # The pyramids lie within the cones by half a per cent.
        assert min(tips, slides) == pytest.approx(cone_programme(scene, azimuth), rel=0.01)
        assert slides == math.inf or slides < tips


def test_a_squat_rock_on_a_surface_slides_before_it_tips():
    level = block(facets(0, 0), 0.4, 0.6, 0.3)
    ((_, level_tips, level_slides), (_, tips, slides)) = limits_on_surface(level.grounded, (0.0, 30.0))
    assert (level_tips, tips) == pytest.approx((2.0 * G, 2.0 * G / math.cos(math.radians(30.0))), rel=1e-4)
    assert (level_slides, slides) == pytest.approx((0.4 * G, 0.4 * G), rel=0.01)


def test_rocking_between_two_walls_of_a_groove_is_rocking_on_the_plane():
    """Without slip the facets' normals drop out of plane rocking: the peaks are those of the exact solution."""
    scene = block_on(15, 15, friction=2.0)
    rise, com = math.tan(math.radians(15)) * HALF_WIDTH_M, scene.rock.com_m
    body = PlaneBody(HALF_WIDTH_M, HALF_WIDTH_M, com[2] - rise, scene.rock.inertia_per_mass_m2[1, 1])
    tilt = 0.7 * body.slenderness(1)
    pivot = np.array([HALF_WIDTH_M, 0.0, rise])
    turn = Rotation.from_euler("y", tilt).as_matrix()
    start = {
        "position_m": pivot + turn @ (com - pivot),
        "quaternion_xyzw": [0, math.sin(tilt / 2), 0, math.cos(tilt / 2)],
    }
    result = shake(scene, STILL, "standard", initial=start, trajectory=True)
    quaternion = result.trajectory.quaternion_xyzw
    found = peaks(2.0 * np.arctan2(quaternion[:, 1], quaternion[:, 3]))
    exact = peaks(rock_exactly(body, Ground.still(), 4.0, tilt).angle_at(np.arange(0.0, 4.0, 1e-4)))
    assert found[:3] == pytest.approx(exact[:3], rel=0.015)


@pytest.mark.parametrize(
    ("left", "right", "tilt_deg", "rest_deg", "slip_m"),
    [(-30, -30, 8.0, 0.755, 0.0132), (0, -30, -8.0, 3.59, 0.0908), (0, -30, 8.0, 2.229, 0.0564)],
    ids=["ridge", "fall, from its level side", "fall, from its steep side"],
)
def test_a_released_rock_wedges_and_slides_as_in_independent_contact_dynamics(
    left, right, tilt_deg, rest_deg, slip_m
):
    """Moreau's steps of 1/40,000 s on point feet, with De Saxce's cones by projection."""
    scene = block_on(left, right)
    foot_x_m, half = math.copysign(HALF_WIDTH_M, tilt_deg), math.radians(tilt_deg) / 2.0
    side = scene.rock.vertices_m[np.isclose(scene.rock.vertices_m[:, 0], foot_x_m)]
    pivot = np.array([foot_x_m, 0.0, side[:, 2].min()])
    turn = Rotation.from_quat([0.0, math.sin(half), 0.0, math.cos(half)])
    start = {"position_m": pivot + turn.apply(scene.rock.com_m - pivot), "quaternion_xyzw": turn.as_quat()}
    trajectory = shake(scene, STILL, "fast", initial=start, trajectory=True).trajectory
    rested = Rotation.from_quat(trajectory.quaternion_xyzw[-1]).magnitude()
    assert math.degrees(rested) == pytest.approx(rest_deg, rel=0.01)
    moved_m = abs(trajectory.position_m[-1, 0] - scene.rock.com_m[0])
    assert moved_m == pytest.approx(slip_m, rel=0.01)


def slide_of_two_contacts_m(rock, feet_m, slopes_deg, friction, level_m_s2, lasting_s):
    """Way of the centre of mass toward x of a rock both of whose feet slide on their facets, in a plane.

    From rest, under a horizontal specific force for a while, until they stop: their normal forces are those with which
    neither leaves its facet.
    """
    slope = np.radians(slopes_deg)
    normals = np.column_stack([-np.sin(slope), np.cos(slope)])
    forces = normals - friction * np.column_stack([np.cos(slope), np.sin(slope)])
    inertia_m2, arms = rock.inertia_per_mass_m2[1, 1], feet_m - rock.com_m[[0, 2]]

    def moved(time_s, state):
        rate, angle = state[3:], state[2]
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        arm = arms @ turn.T
        moments = arm[:, 0] * forces[:, 1] - arm[:, 1] * forces[:, 0]
        turning = (arm[:, 0] * normals[:, 1] - arm[:, 1] * normals[:, 0])[:, None]
        free = np.array([level_m_s2 if time_s < lasting_s else 0.0, -G])
        loads = np.linalg.solve(
            normals @ forces.T + turning * moments / inertia_m2,
            rate[2] ** 2 * (normals * arm).sum(axis=1) - normals @ free,
        )
        assert (loads > 0.0).all()
        return np.concatenate([rate, free + loads @ forces, [loads @ moments / inertia_m2]])

    def stops(time_s, state):
        return state[3] if time_s > 0.5 * lasting_s else 1.0

    stops.terminal = True
    return solve_ivp(moved, (0.0, 2.0), np.zeros(6), events=stops, max_step=1e-3, rtol=1e-8).y[0, -1]


@pytest.mark.parametrize(
    ("level_m_s2", "lasting_s"), [(2.4, 0.2), (3.0, 0.1), (3.0, 0.2), (4.0, 0.1), (6.0, 0.05)]
)
def test_a_rock_that_wedges_off_a_ledge_slides_by_the_equations_of_its_two_contacts(level_m_s2, lasting_s):
    scene = block_on(0, -30)
    feet = np.array([[-HALF_WIDTH_M, 0.0], [HALF_WIDTH_M, -HALF_WIDTH_M * math.tan(math.radians(30))]])
    exact_m = slide_of_two_contacts_m(scene.rock, feet, [0, -30], 0.8, level_m_s2, lasting_s)
    shaken = shake(scene, pulse(-level_m_s2, lasting_s), "standard", trajectory=True, shortcuts=False)
    moved_m = shaken.trajectory.position_m[-1, 0] - scene.rock.com_m[0]
    assert moved_m == pytest.approx(exact_m, rel=0.03)


def thrown(scene, random):
    """A shake of a rock that is thrown onto still ground, not yet begun."""
    start = State(
        position_m=scene.rock.com_m + np.array([0.0, 0.0, random.uniform(0.2, 0.8)]),
        quaternion_xyzw=Rotation.from_rotvec(random.uniform(-0.35, 0.35, 3)).as_quat(),
        velocity_m_s=0.5 * random.normal(size=3),
        angular_velocity_rad_s=random.normal(size=3),
    )
    options = PRESETS["fast"]
    step_s = options.time_step_s(scene.rock.half_diagonal_m, G)
    problem = Problem(scene, STILL, options, step_s, start, shortcuts=False)
    return Shaking(problem, engine_named(DEFAULT).steps(problem))


@pytest.mark.parametrize("restitution", [0.0, 0.5])
@pytest.mark.parametrize(("left", "right"), [(30, 30), (-30, -30), (0, -30), (0, 0)])
def test_a_rock_that_is_thrown_gains_no_energy_at_any_friction(left, right, restitution):
    """But for what gravity gives in half a step, where a contact stops the rock in the middle of one."""
    scene, randoms = (
        block_on(left, right, half_height=0.3),
        [np.random.default_rng(seed) for seed in (3, 5, 6, 8)],
    )
    for friction, random in product((0.3, 0.8, 3.0), randoms):
        shaking = thrown(as_surface(scene.with_contact(ContactProperties.of(friction, restitution))), random)
        assert shaking.run() in ("rest", "tilted", "fallen", "left_ground")
        energy = case.energy_j_kg(shaking)
        assert np.diff(energy).max() < (0.5 * G * shaking.sim.step_s) ** 2


def test_a_step_without_impulses_that_agree_fails_the_shake():
    shaking = thrown(as_surface(block_on(0, 0)), np.random.default_rng(3))
    shaking.sim.counts[4] = 1
    result = shaking.result(shaking.run(), trajectory=False)
    assert (result.status, result.toppled, result.ended_by) == ("failed", None, "contacts_disagree")


def peaks(angle_rad):
    """Largest sizes of an angle between its zeros, after the first zero."""
    sizes = np.abs(angle_rad)
    swing = np.cumsum(np.diff(np.sign(angle_rad), prepend=np.sign(angle_rad[0])) != 0)
    largest = [sizes[swing == k].max() for k in range(1, swing.max() + 1)]
    return [v for v in largest if v > 0.02]


def test_a_stool_slides_over_a_shallow_groove_as_in_independent_contact_dynamics():
    """On the plane it is (A g t)^2 / (2 mu g) (1 - mu / A) = 0.245 m."""
    scene = stool_on(5, 5)
    assert shake(scene, pulse(0.8 * G, 0.25), "standard").slip_m == pytest.approx(0.216, rel=0.05)


def test_a_steep_groove_holds_what_slides_into_its_walls():
    """What is left is the way on which the stool wedges."""
    scene = stool_on(30, 30)
    assert shake(scene, pulse(0.8 * G, 0.25), "standard").slip_m < 0.1 * 0.245


class SurfaceScene(Scene):
    """A scene to be shaken on its surface where a plane would do, also once its rock has settled."""

    ground = GroundKind(False, "asked for")


def as_surface(scene):
    """A scene to be shaken on its surface instead of its plane."""
    return SurfaceScene(scene.rock, scene.pedestal, scene.contact)


def test_a_surface_that_is_a_plane_gives_the_planes_answer():
    """Where the surface's own kernel is used on a plane, outcomes and largest tilts are the engine's."""
    on_surface = block_on(0, 0)
    on_plane = Scene.from_mesh((on_surface.rock.vertices_m, on_surface.rock.faces), friction=0.8)
    assert on_surface.ground.is_plane
    forced = as_surface(on_surface)
    for level in (4.0, 7.0, 10.0):
        motion = pulse(level, 0.2, azimuth_deg=25.0)
        mesh, flat = shake(forced, motion, "standard"), shake(on_plane, motion, "standard")
        assert mesh.outcome == flat.outcome
        assert min(mesh.max_tilt_deg, 60.0) == pytest.approx(min(flat.max_tilt_deg, 60.0), rel=0.02, abs=0.05)
        assert mesh.slip_m == pytest.approx(flat.slip_m, rel=0.05, abs=0.003) or mesh.toppled


def test_a_rounded_base_tips_on_a_surface_as_on_the_plane():
    """On facets, where past one a rock may come to stand on the next at a larger acceleration, and on a smooth one."""
    turn, azimuths = np.linspace(-0.48, 0.48, 10), (0.0, 20.0, 80.0, 150.0, 200.0, 330.0)
    arc = 0.65 * np.column_stack([np.sin(turn), 0.0 * turn, 1.0 - np.cos(turn)])
    across, outline = np.array([0.0, 0.25, 0.0]), np.vstack([arc, [[0.3, 0.0, 1.0], [-0.3, 0.0, 1.0]]])
    rocker = trimesh.Trimesh(np.vstack([outline - across, outline + across])).convex_hull
    for shape in ((rocker.vertices, rocker.faces), round_cap(0.02)):
        plane, ground = Scene.from_mesh(shape), strips([(-6.0, 0.0), (6.0, 0.0)])
        on_surface = limits_on_surface(Scene.from_mesh(shape, pedestal=ground).grounded, azimuths)
        tipped = [limits.tips_m_s2 for limits in on_surface]
        assert tipped == pytest.approx([tips for _, tips in plane.tips_m_s2(azimuths)], rel=1e-3)


@pytest.mark.parametrize(
    ("halvings", "rough_m", "finer"),
    [(3, 0.02, 0), (3, 0.02, 1), pytest.param(6, 0.0025, 0, marks=pytest.mark.thorough)],
)
def test_a_rough_base_tips_on_a_surface_as_on_the_plane_however_fine_its_mesh(halvings, rough_m, finer):
    """From rest to rest on its next corners, also of more than are looked at: a step ends before others can land."""
    mesh = trimesh.creation.box((0.5, 0.5, 1.2))
    for _ in range(halvings):
        mesh = mesh.subdivide()
    low = mesh.vertices[:, 2] < -0.59
    mesh.vertices[low, 2] += np.random.default_rng(4).uniform(0.0, rough_m, low.sum())
    for _ in range(finer):
        mesh = mesh.subdivide()
    # At 200 degrees two rests are as likely: slow ramps differ by 7 % among themselves.
    shape, azimuths = (mesh.vertices, mesh.faces), (0.0, 120.0, 240.0)[: 1 if halvings > 3 else 3]
    plane = Scene.from_mesh(shape)
    exact = [tips for _, tips in quasi_static_toppling_m_s2(plane.rock, plane.pedestal, G, azimuths)]
    on_mesh = Scene.from_mesh(shape, pedestal=strips([(-6.0, -0.6), (6.0, -0.6)])).grounded
    held = [limits.tips_m_s2 for limits in limits_on_surface(on_mesh, azimuths)]
    assert held == pytest.approx(exact, rel=0.002)


@pytest.mark.parametrize(("seed", "azimuth_deg"), [(0, 0.0), (1, 200.0), (19, 200.0), (46, 70.0)])
def test_a_rock_that_falls_onto_another_facet_of_its_base_topples_where_its_slow_ramp_does(seed, azimuth_deg):
    """About edges alone, with what an impact on both leaves of the energy, these had stood 10 to 71 % too much."""
    random = np.random.default_rng(seed)
    count = int(random.integers(8, 20))
    turn, away_m = random.uniform(0.0, 2.0 * np.pi, count), 0.4 * np.sqrt(random.uniform(0.0, 1.0, count))
    base = np.column_stack([away_m * np.cos(turn), away_m * np.sin(turn), random.uniform(0.0, 0.04, count)])
    top = [[x, y, 1.0] for x in (-0.4, 0.4) for y in (-0.4, 0.4)]
    rock = trimesh.convex.convex_hull(np.vstack([base, top]))
    scene = Scene.from_mesh((rock.vertices, rock.faces), friction=3.0)
    ((_, least),) = scene.quasi_static_toppling_m_s2([azimuth_deg])
    toppled = topples_at_m_s2(scene, azimuth_deg, [0.0, 900.0], [0.0, 1.2 * least])
    assert least == pytest.approx(toppled, rel=0.01)  # the ramp goes on by half a per cent while it falls


def with_wall(distance_m, height_m=1.0):
    """A level floor with a wall whose face stands at x = half width + distance."""
    x, after = HALF_WIDTH_M + distance_m, HALF_WIDTH_M + distance_m + 0.3
    return strips([(-6.0, 0.0), (x, 0.0), (x, height_m), (after, height_m), (after, 0.0), (6.0, 0.0)])


def test_a_scene_turned_with_its_motion_answers_the_same():
    base = block_on(-15, -15)
    turn = Rotation.from_euler("z", 37.0, degrees=True).as_matrix()
    surface = base.pedestal
    turned = Scene.from_mesh(
        (base.rock.vertices_m @ turn.T, base.rock.faces),
        pedestal=(surface.vertices_m @ turn.T, surface.faces),
    )
    single = shake(base, pulse(3.5, 0.3, azimuth_deg=10.0), "fast")
    other = shake(turned, pulse(3.5, 0.3, azimuth_deg=47.0), "fast")
    assert other.outcome == single.outcome
    assert other.max_tilt_deg == pytest.approx(single.max_tilt_deg, rel=0.01)


def test_a_rock_that_leans_on_a_wall_past_its_balance_is_left_leaning():
    tilt = math.radians(22.0)
    turn = Rotation.from_euler("y", tilt).as_matrix()
    rock = box(HALF_WIDTH_M, HALF_WIDTH_M, HALF_HEIGHT_M).moved(turn)
    corners = rock.vertices_m
    rock = rock.moved(np.eye(3), (0.0, 0.0, -corners[:, 2].min()))
    wall = rock.vertices_m[:, 0].max() - HALF_WIDTH_M
    scene = Scene.from_mesh(
        (rock.vertices_m, rock.faces), pedestal=with_wall(wall, height_m=2.0), friction=0.8
    )
    seated = scene.grounded.rock_at_rest(scene.rock, scene.pedestal, "test")
    assert np.abs(seated.vertices_m - scene.rock.vertices_m).max() < 1e-3
    assert shake(scene, STILL, "fast").outcome == "stands"


def slab_on_a_wall(half_width, lean_deg, half_depth=0.3, gap_m=0.0):
    """Meshes of a slab of 1.2 m that leans toward x on its lower edge at the origin, and of ground and wall."""
    angle, height = math.radians(lean_deg), 1.2
    turn = Rotation.from_rotvec([0.0, angle, 0.0])
    slab = box(half_width, half_depth, 0.5 * height).moved(np.eye(3), (-half_width, 0.0, 0.5 * height))
    vertices, faces = with_wall(height * math.sin(angle) - HALF_WIDTH_M + gap_m, height_m=1.6)
    return (turn.apply(slab.vertices_m), slab.faces), (vertices, faces)


def righted_m_s2(half_width, lean_deg):
    """Ground acceleration toward the wall that takes a slab off it: it undoes gravity's moment about the foot."""
    angle = math.radians(lean_deg)
    x = 0.6 * math.sin(angle) - half_width * math.cos(angle)
    return G * x / (0.6 * math.cos(angle) + half_width * math.sin(angle))


@pytest.mark.parametrize("gap_m", [0.0, 1e-3, 5e-3, -1e-3])
def test_a_leaning_slab_stands_up_to_its_slow_ramp_whatever_gap_it_settles_over(gap_m):
    """A slab that was given a gap away from its wall settles on corners that differ by micrometres."""
    rock, surface = slab_on_a_wall(0.2, 25.0, 0.2, gap_m)
    scene = Scene.from_mesh(rock, pedestal=surface, friction=0.8)
    for azimuth_deg in (0.0, 20.0, 45.0):
        ((_, least),) = scene.quasi_static_toppling_m_s2([azimuth_deg])
        toppled = topples_at_m_s2(scene, azimuth_deg, [0.0, 2.0, 120.0], least * np.array([0.0, 0.8, 1.4]))
        assert least == pytest.approx(toppled, rel=0.03)
        assert least == pytest.approx(cone_programme(scene, azimuth_deg), rel=0.005)


@pytest.mark.parametrize(("half_width", "lean_deg"), [(0.06, 8.0), (0.2, 25.0)])
def test_a_rock_that_leans_is_taken_off_its_wall_by_what_undoes_its_weight(half_width, lean_deg):
    rock, surface = slab_on_a_wall(half_width, lean_deg)
    scene = Scene.from_mesh(rock, pedestal=surface, friction=0.8)
    assert scene.grounded.leans
    ((_, least),) = scene.quasi_static_toppling_m_s2([0.0])
    assert least == pytest.approx(righted_m_s2(half_width, lean_deg), rel=0.005)


def test_a_rock_pushed_against_the_wall_on_which_it_leans_slides_up_it():
    """Foot toward the wall, edge up the wall, friction against both: forces and moments on the verge of it."""
    half_width, angle, friction = 0.06, math.radians(8.0), 0.4
    rock, surface = slab_on_a_wall(half_width, 8.0)
    ((_, tips, most),) = Scene.from_mesh(rock, pedestal=surface, friction=friction).statics([180.0])
    assert tips == math.inf
    x, z = (
        0.6 * math.sin(angle) - half_width * math.cos(angle),
        0.6 * math.cos(angle) + half_width * math.sin(angle),
    )
    edge_x, edge_z = 1.2 * math.sin(angle), 1.2 * math.cos(angle)
    wall = G * (x + friction * z) / (edge_z - friction * edge_x - z * (1.0 + friction**2))
    assert most == pytest.approx(friction * G + (1.0 + friction**2) * wall, rel=0.005)


@pytest.mark.thorough
def test_a_rock_that_leans_is_scanned_as_the_two_meshes_that_the_user_brought_apart(tmp_path):
    rock, surface = slab_on_a_wall(0.2, 25.0)
    for name, (vertices, faces) in (("rock", rock), ("pedestal", surface)):
        trimesh.Trimesh(1000.0 * vertices, faces, process=False).export(tmp_path / f"{name}.ply")
    files = {name: str(tmp_path / f"{name}.ply") for name in ("rock", "pedestal")}
    made = scan([], tmp_path / "scene", **files, units="mm")
    assert any("the rock leans" in note for note in made.notes)
    scene = Scene.load(tmp_path / "scene")
    assert scene.rock.volume_m3 == pytest.approx(0.4 * 0.6 * 1.2, rel=1e-6)
    ((_, least),) = scene.quasi_static_toppling_m_s2([0.0])
    assert least == pytest.approx(righted_m_s2(0.2, 25.0), rel=0.005)


def test_two_meshes_on_which_no_drawn_base_stands_are_taken_as_they_are():
    body = box(0.2, 0.2, 0.5)
    meshes = SeparatedMeshes(
        (body.vertices_m - [0.0, 0.0, body.vertices_m[:, 2].min()], body.faces), facets(0.0, 0.0)
    )

    def contradicted():
        raise ContradictionError(
            "base.contradicted", "the weight", where="standing", expected="rest", remedy="none"
        )

    made = meshes.surveyed(contradicted, hinted=False)
    assert "no interval" in " ".join(made.notes)
    assert made.scene.rock.volume_m3 == pytest.approx(8 * 0.2 * 0.2 * 0.5)
    with pytest.raises(ContradictionError):
        meshes.surveyed(contradicted, hinted=True)


def test_a_rock_that_a_wall_catches_past_its_balance_has_lodged():
    """The wall is .5 m away: the block leans on it at asin(.5 / 1.2) or, where its foot slides back, more."""
    away = pulse(-8.0, 0.3, after_s=6.0)
    scene = block(with_wall(0.5), 0.8)
    lodged = shake(scene, away, "fast", trajectory=True)
    assert (lodged.outcome, lodged.toppled, lodged.ended_by) == ("lodged", True, "rest_certain")
    assert math.degrees(math.asin(0.5 / 1.2)) - 0.1 < lodged.residual_tilt_deg < 45.0
    assert math.cos(math.radians(lodged.falls_toward_deg)) > 0.996  # within 5 degrees of x
    assert 0.0 < lodged.topple_time_s < 1.5
    assert scene.tips_m_s2([180.0])[0][1] == pytest.approx(G * HALF_WIDTH_M / HALF_HEIGHT_M, rel=1e-3)


def test_a_rock_that_a_wall_catches_before_its_balance_has_not_lodged():
    scene = block(with_wall(0.1), 0.8)
    caught = shake(scene, pulse(-8.0, 0.3, after_s=6.0), "fast")
    assert caught.outcome in {"stands", "moved"}
    assert not caught.toppled
    assert scene.tips_m_s2([180.0])[0][1] == math.inf


def test_a_prism_that_rolls_over_to_its_next_side_has_toppled_and_not_lodged():
    """Nothing stands beside it."""
    angle = np.radians(np.arange(0.0, 360.0, 60.0))
    ring = [*zip(0.4 * np.cos(angle), 0.4 * np.sin(angle) + 0.4 * math.cos(math.pi / 6), strict=True)]
    scene = Scene.from_mesh(
        prism(ring, [(0, k, k + 1) for k in range(1, 5)]),
        pedestal=strips([(-6.0, 0.0), (6.0, 0.0)]),
        friction=1.5,
    )
    rolled = shake(as_surface(scene), pulse(8.0, 0.3, after_s=6.0), "fast")
    assert rolled.residual_tilt_deg == pytest.approx(60.0, abs=0.1)
    assert rolled.outcome == "toppled"


@pytest.mark.parametrize("slope_deg", [15, -15])
def test_a_stool_that_slides_across_a_fold_on_its_own_legs_has_not_lodged(slope_deg):
    """A leg comes to stand higher than the other by more than a quarter of the centre of mass's height."""
    scene = stool_on(slope_deg, slope_deg)
    slid = shake(scene, pulse(0.8 * G, 0.25), "fast")
    assert slid.slip_m > 0.1
    assert (slid.outcome, slid.toppled) == ("moved", False)


@pytest.mark.parametrize(("kerb_m", "slope_deg", "friction"), [(0.03, 25.0, 0.3), (0.02, 20.0, 0.2)])
def test_a_stool_that_slides_down_to_a_kerb_has_not_lodged(kerb_m, slope_deg, friction):
    """The slope it comes to is steeper than its friction's angle: a low kerb holds its foot, nothing catches it."""
    low_m = 1.6
    down = low_m * math.tan(math.radians(slope_deg))
    profile = [(-6.0, 0.0), (0.0, 0.0), (low_m, -down), (low_m, kerb_m - down), (6.0, kerb_m - down)]
    stool = box(0.4, 0.4, 0.15).moved(np.eye(3), (-0.42, 0.0, 0.15))
    scene = Scene.from_mesh((stool.vertices_m, stool.faces), pedestal=strips(profile), friction=friction)
    slid = shake(as_surface(scene), pulse(-6.0, 0.8, after_s=6.0), "reference")
    assert slid.slip_m > 1.0
    assert (slid.outcome, slid.toppled) == ("moved", False)


def test_a_rock_that_stands_on_two_levels_and_falls_against_a_wall_has_lodged():
    """Its right feet stand on a step of more than a quarter of its centre of mass's height: both feet carry it."""
    step_m, away_m, s = 0.14, 0.45, 6.0
    vertices, faces = legged(HALF_WIDTH_M, 0.4, 0.2)
    raised = np.isclose(vertices[:, 2], 0.0) & (vertices[:, 0] > 0.0)
    vertices[raised, 2] = step_m
    wall = -HALF_WIDTH_M - away_m
    before = [(-s, 0), (wall - 0.3, 0), (wall - 0.3, 1), (wall, 1), (wall, 0)]
    profile = [*before, (0, 0), (0, step_m), (s, step_m)]
    scene = Scene.from_mesh((vertices, faces), pedestal=strips(profile), friction=0.8)
    fallen = shake(scene, pulse(8.0, 0.3, after_s=6.0), "fast")
    assert (fallen.outcome, fallen.toppled) == ("lodged", True)
    assert 30.0 < fallen.residual_tilt_deg < 45.0


@pytest.mark.parametrize("right_m", [0.3, 0.5])
def test_a_ledge_that_a_rock_touches_from_the_start_hides_no_lodging_on_a_lower_ledge(right_m):
    """A tee on its stem, past its balance once its arm comes down on the left ledge; the right one carries nothing."""
    between = [(-6.0, 0.35), (-0.3, 0.35), (-0.3, 0.0), (0.3, 0.0), (0.3, right_m), (6.0, right_m)]
    scene = Scene.from_mesh(tee(), pedestal=strips(between), friction=0.8)
    body = scene.grounded
    arm_m = body.contacts(body.resting_pose, 1e-6)["arm_m"] @ body.scene_from_support.T
    assert (arm_m[:, 0] > 0.2).any() == (right_m == 0.5)
    fallen = shake(scene, pulse(3.0, 0.3, after_s=6.0), "fast")
    assert (fallen.outcome, fallen.toppled) == ("lodged", True)
    assert fallen.residual_tilt_deg > 3.0 * math.degrees(math.atan(0.06 / 0.57))


def test_a_rock_that_shifts_on_its_two_supporting_levels_has_not_lodged():
    """Its left feet alone hold it at the start, on a ledge that ends beyond its middle; later they do not."""
    step_m, edge_m = 0.3, 0.1
    ring = [(-0.4, 0.0), (0.25, 0.0), (0.25, step_m), (0.5, step_m), (0.5, 0.5), (-0.4, 0.5)]
    rock = prism(ring, [(0, 1, 5), (1, 2, 5), (2, 3, 4), (2, 4, 5)])
    ground = strips([(-6.0, 0.0), (edge_m, 0.0), (edge_m, -1.0), (0.45, -1.0), (0.45, step_m), (6.0, step_m)])
    scene = Scene.from_mesh(rock, pedestal=ground, friction=0.3)
    body = scene.grounded
    touching = body.contacts(body.resting_pose, 1e-6)
    left = touching[touching["arm_m"] @ body.scene_from_support[2] < -0.1]
    assert 0 < len(left) < len(touching)
    assert body.hold(left, body.load_m_s2()[None])[0]
    shifted = shake(scene, pulse(-6.0, 0.25), "fast")
    assert edge_m - scene.rock.com_m[0] < shifted.slip_m < 0.25
    assert (shifted.outcome, shifted.toppled) == ("moved", False)


def tee():
    """A rock with arms: a stem of half width .06, arms that reach .4 to either side from .5 up."""
    stem, arm, under, top = 0.06, 0.4, 0.5, 0.8
    half = [(stem, 0.0), (stem, under), (arm, under), (arm, top)]
    ring = [(-stem, 0.0), *half, *((-x, z) for x, z in half[:0:-1])]
    return prism(ring, [(0, 1, 2), (0, 2, 7), (4, 5, 6), (4, 6, 7), (4, 7, 2), (4, 2, 3)])


def prism(ring, triangles, half_depth=0.3):
    """A closed mesh over a ring (x, z) and the triangles that fill it, seen from where y is negative."""
    vertices = np.array([[x, y, z] for y in (-half_depth, half_depth) for x, z in ring])
    n, front = len(ring), np.array(triangles)
    i, after = np.arange(n), (np.arange(n) + 1) % n
    sides = np.column_stack([i, n + i, after]), np.column_stack([after, n + i, n + after])
    return vertices, np.vstack([front, front[:, ::-1] + n, *sides])


@pytest.mark.parametrize(
    ("left", "right", "friction"), [(30, 30, 0.6), (0, -15, 0.8), (-15, -15, 0.8), (0, 30, 0.6)]
)
def test_a_slowly_growing_acceleration_topples_by_the_second_engine_at_the_cones_limit(left, right, friction):
    scene = block_on(left, right, friction)
    (threshold,) = [v for _, v in scene.quasi_static_toppling_m_s2([0.0])]
    levels_m_s2 = threshold * np.array([0.0, 0.9, 1.1])
    toppled = topples_at_m_s2(scene, 0.0, [0.0, 4.0, 30.0], levels_m_s2, engine="mujoco")
    # Once past it a block of this size takes half a second to fall, while the ramp grows by .4 %.
    assert toppled == pytest.approx(threshold, rel=0.03)


def test_a_rock_that_falls_onto_an_outrigger_topples_where_it_leaves_its_base():
    """The outrigger would hold more than the base, but meets the ground once the rock has fallen by 12 degrees."""
    ring = [(-0.1, 0.0), (0.1, 0.0), (0.1, 0.3), (0.3, 0.0425), (0.3, 0.5), (0.1, 1.2), (-0.1, 1.2)]
    rock = prism(ring, [(0, 1, 2), (0, 2, 6), (2, 5, 6), (2, 3, 4), (2, 4, 5)])
    scene = as_surface(Scene.from_mesh(rock, pedestal=strips([(-6.0, 0.0), (6.0, 0.0)]), friction=0.8))
    (tipped,) = [v for _, v in scene.quasi_static_toppling_m_s2([180.0])]
    over_m = scene.rock.com_m - scene.rock.vertices_m.min(axis=0)
    assert tipped == pytest.approx(G * (0.2 - over_m[0]) / over_m[2], rel=0.005)
    # It leaves its base slowly, and topples two and a half seconds later: the ramp has grown by 3 %.
    toppled = topples_at_m_s2(scene, 180.0, [0.0, 4.0, 20.0], tipped * np.array([0.0, 0.9, 1.1]))
    assert toppled == pytest.approx(tipped, rel=0.04)


def test_a_rock_that_rolls_onto_an_adjacent_facet_topples_where_it_leaves_that():
    """It leaves its base at an acceleration that the facet, reached at 6 degrees, bears three times."""
    rise = math.tan(math.radians(6.0)) * 0.22
    ring = [(-0.03, 0.0), (0.03, 0.0), (0.25, rise), (0.3, 1.0), (-0.3, 1.0), (-0.25, rise)]
    rock = prism(ring, [(0, 1, 2), (0, 2, 5), (2, 3, 4), (2, 4, 5)])
    scene = as_surface(Scene.from_mesh(rock, pedestal=strips([(-6.0, 0.0), (6.0, 0.0)]), friction=0.8))
    (tips,) = [v for _, v in scene.tips_m_s2([180.0])]
    arm_m, up_m = np.array([0.25, rise]) - scene.rock.com_m[[0, 2]] + [0.0, scene.rock.vertices_m[:, 2].min()]
    assert tips == pytest.approx(G * math.tan(math.atan2(arm_m, -up_m) - math.radians(6.0)), rel=0.005)
    toppled = topples_at_m_s2(scene, 180.0, [0.0, 4.0, 40.0], tips * np.array([0.0, 0.3, 1.2]))
    assert toppled == pytest.approx(tips, rel=0.04)


def test_a_wall_holds_a_block_that_falls_without_it_by_either_engine():
    push = pulse(-6.0, 0.5, after_s=4.0)
    walled = block(with_wall(0.02), 0.7)
    assert not walled.ground.is_plane
    for engine in ("pybullet", "mujoco"):
        assert shake(block(facets(0, 0), 0.7), push, "fast", engine=engine).outcome == "toppled"
        caught = shake(walled, push, "fast", engine=engine)
        assert caught.outcome == "stands"
        assert caught.max_tilt_deg < 10.0


def test_an_arch_that_no_point_sees_whole_is_refused_by_the_second_engine():
    profile = [(-0.4, 0), (-0.2, 0), (-0.2, 0.8), (0.2, 0.8), (0.2, 0), (0.4, 0), (0.4, 1.2), (-0.4, 1.2)]
    vertices = np.array([[x, y, z] for y in (-0.4, 0.4) for x, z in profile])
    quads = np.array([[0, 1, 2, 7], [2, 3, 6, 7], [3, 4, 5, 6]])
    front = np.vstack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    sides = [face for a, b in pairwise([*range(8), 0]) for face in ([b, a, a + 8], [b, a + 8, b + 8])]
    faces = np.vstack([front, front[:, ::-1] + 8, sides])
    ground, triangles = facets(15, 15)
    lowered = ground - np.array([0.0, 0.0, 0.4 * math.tan(math.radians(15.0))])
    scene = Scene.from_mesh((vertices, faces), pedestal=(lowered, triangles), friction=0.7)
    with refused("engine.rock_hollow"):
        shake(scene, STILL, "fast", engine="mujoco")


@pytest.mark.parametrize(("left", "right"), [(30, 30), (0, -15), (0, 0)])
def test_a_rest_is_certain_only_under_loads_that_the_cones_hold(left, right):
    """Nine tenths of the friction count: on these the rock tips before it slides."""
    scene = block_on(left, right, 0.8)
    (threshold,) = [v for _, v in scene.quasi_static_toppling_m_s2([0.0])]
    body = scene.grounded
    for share, held in ((0.5, True), (1.05, False), (2.0, False), (20.0, False)):
        loads = np.array([body.load_m_s2(), body.load_m_s2(np.array([share * threshold, 0.0, 0.0]))])
        assert holds(body, body.resting_pose, loads) is held


def cliff(lip_m):
    """Level ground for x below the lip, and a face that falls from there."""
    return strips([(-6.0, 0.0), (lip_m, 0.0), (lip_m + 0.05, -3.0)])


def test_a_rock_that_falls_past_its_surfaces_edge_is_described_by_where_it_touched():
    scene = block(strips([(-3.0, 0.0), (-0.1, 0.0)], 2.0))  # ends before its middle
    assert scene.pedestal.normal == pytest.approx([0.0, 0.0, 1.0])
    assert scene.pedestal.point_m[2] == pytest.approx(0.0, abs=1e-6)
    with refused("rock.does_not_stand"):
        shake(scene, STILL, "fast")


@pytest.mark.parametrize("yaw_deg", [0.0, 20.0, 45.0])
@pytest.mark.parametrize("lip_m", [0.05, 0.12])
def test_a_flat_base_that_overhangs_a_cliff_tips_over_the_lip(lip_m, yaw_deg):
    """The lip is an edge below a face: it carries where the base's edges cross it, and not at the corners beyond."""
    turn = Rotation.from_euler("z", yaw_deg, degrees=True).as_matrix()
    scene = block(cliff(lip_m), 2.0, turn=turn)
    for entry in (scene, as_surface(scene)):
        ((_, over_lip),) = entry.quasi_static_toppling_m_s2([180.0])
        assert over_lip == pytest.approx(G * lip_m / HALF_HEIGHT_M, rel=0.005)


@pytest.mark.parametrize("lip_m", [0.05, 0.1, 0.3])
def test_the_least_energy_overturns_over_a_cliffs_lip_where_that_is_nearer_than_the_edges(lip_m):
    body = as_surface(block(cliff(lip_m), 2.0)).grounded
    raised_m = math.hypot(min(lip_m, HALF_WIDTH_M), HALF_HEIGHT_M) - HALF_HEIGHT_M
    assert least_overturning_j_kg(body, body.resting_pose) == pytest.approx(G * raised_m, rel=0.03)


@pytest.mark.thorough
def test_a_block_rocks_about_a_cliffs_lip_as_about_an_edge_there():
    """A pulse that tips it over the lip, and one that does not, about what Housner's block needs."""
    lip_m = 0.1
    scene = block(cliff(lip_m), 2.0)
    inertia = scene.rock.inertia_per_mass_m2[1, 1]
    lasting_s, height = 0.3, HALF_HEIGHT_M
    arm = math.hypot(lip_m, height)

    def falls(level):
        """Fine integration of the pendulum about the lip; it does not fall where it comes back."""
        tilt, rate, step = 0.0, 0.0, 1e-5
        for k in range(200_000):
            a = level if k * step < lasting_s else 0.0
            x = lip_m * math.cos(tilt) - height * math.sin(tilt)
            z = height * math.cos(tilt) + lip_m * math.sin(tilt)
            rate += step * (a * z - G * x) / (inertia + arm**2)
            tilt += step * rate
            if tilt < 0.0 or x < -0.2:
                return x < -0.2
        return False

    low, high = G * lip_m / height, 4.0 * G * lip_m / height
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if falls(middle) else (middle, high)
    for entry in (scene, as_surface(scene)):
        for share, topples in ((0.985, False), (1.015, True)):
            assert shake(entry, pulse(-share * high, lasting_s), "standard").toppled is topples
