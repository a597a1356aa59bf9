"""Laws of a rock's statics, against closed forms, symmetries and a linear program."""

import dataclasses
from itertools import islice

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from refusals import refused
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation
from virtual_rocks import ellipsoid

from toppling.models.frames import plane_axes, plane_normal
from toppling.models.ground.facet_path import Seat
from toppling.models.pedestal import ContactProperties, Pedestal
from toppling.models.rock import Rock
from toppling.models.scene import Scene
from toppling.models.shapes import box
from toppling.models.statics import equilibrium_possible, quasi_static_toppling_m_s2, support_polygon_m

G = 9.81
EXACT = 1e-6  # the share that statics promises for polygons
LEVEL = Pedestal(np.zeros(3), np.array([0.0, 0.0, 1.0]))


def hull(points) -> Rock:
    mesh = trimesh.Trimesh(np.asarray(points, float), process=False).convex_hull
    return Rock.from_triangles(mesh.vertices, mesh.faces)


def extruded(profile, half_depth=1.0) -> Rock:
    """Convex profile (k, 2) in x, z drawn out along y."""
    profile = np.asarray(profile, float)
    ends = [
        np.column_stack([profile[:, 0], np.full(len(profile), y), profile[:, 1]])
        for y in (-half_depth, half_depth)
    ]
    return hull(np.vstack(ends))


def toppling(scene, azimuth):
    return quasi_static_toppling_m_s2(scene.rock, scene.pedestal, scene.gravity_m_s2, [azimuth])[0][1]


def possible(scene, acceleration):
    friction = scene.contact.friction_static
    return equilibrium_possible(scene.rock, scene.pedestal, scene.gravity_m_s2, friction, acceleration)


def lift_off(scene, azimuth):
    return Seat.of(scene.rock, scene.pedestal).path(scene.gravity_m_s2, azimuth)[0]


@pytest.mark.parametrize(
    ("azimuth", "share"),
    [(0, 1.0), (15, 1 / np.cos(np.pi / 12)), (30, 1 / np.cos(np.pi / 6)), (45, np.sqrt(2))],
)
@pytest.mark.parametrize("width", [0.02, 0.2, 0.55])
def test_a_square_prism_topples_at_g_tan_alpha_over_the_cosine_to_its_nearest_side(azimuth, share, width):
    scene = Scene.block(width, width, 0.6)
    assert toppling(scene, azimuth) == pytest.approx(G * width / 0.6 * share, rel=EXACT)


@given(
    alpha=st.floats(2.0, 40.0),
    slope=st.floats(0.0, 30.0),
    downhill=st.floats(0.0, 360.0),
    half_diagonal=st.floats(0.05, 10.0),
)
@settings(max_examples=40)
def test_a_block_on_a_slope_topples_downhill_at_g_tan_of_alpha_less_the_slope(
    alpha, slope, downhill, half_diagonal
):
    # Plane case: the block's sides lie along the slope; the ground accelerates uphill, the block falls
    # downhill.
    b, h = half_diagonal * np.sin(np.deg2rad(alpha)), half_diagonal * np.cos(np.deg2rad(alpha))
    mesh = box(b, b, h).moved(turn("z", downhill))
    scene = Scene.from_mesh((mesh.vertices_m, mesh.faces), slope_deg=slope, slope_azimuth_deg=downhill)
    expected = max(0.0, G * np.tan(np.deg2rad(alpha - slope)))
    assert toppling(scene, downhill + 180) == pytest.approx(expected, rel=EXACT, abs=1e-9 * G)
    if expected > 0 and alpha + slope < 89:
        assert toppling(scene, downhill) == pytest.approx(G * np.tan(np.deg2rad(alpha + slope)), rel=EXACT)


@pytest.mark.parametrize(("rise", "holds"), [(0.04, True), (0.1, True), (0.2, False)])
def test_a_chamfer_holds_the_rock_again_unless_the_energy_of_its_fall_suffices_for_the_far_edge(rise, holds):
    # Base half width .5, chamfer up to (1, rise): the rock tips over the base's corner first and falls onto the
    # chamfer. On it the effective gravity's angle to the facet's normal is the angle of the ground's push.
    profile = np.array([(-0.5, 0), (0.5, 0), (1, rise), (1, 1.5), (-1, 1.5), (-1, rise)])
    scene = Scene.from_mesh(mesh_of(extruded(profile, 5.0)))
    com, inertia = scene.rock.com_m[[0, 2]], scene.rock.inertia_per_mass_m2[1, 1]
    near, arm = np.array([0.5, 0.0]) - com, np.array([1.0, rise]) - com
    chamfer, lifts = np.arctan2(rise, 0.5), G * 0.5 / com[1]
    assert lift_off(scene, 180) == pytest.approx(lifts, rel=EXACT)
    # It turns by the chamfer's angle about the near edge, from where the force passes through that; of its energy
    # the far edge leaves the square of what the motion about both has in common (Housner 1963).
    force = np.hypot(G, lifts)
    fallen = force * np.hypot(*near) * (1 - np.cos(chamfer))
    remaining = (near @ arm + inertia) ** 2 / ((near @ near + inertia) * (arm @ arm + inertia))
    balance = np.arctan2(arm[0], -arm[1]) - np.arctan2(lifts, G) - chamfer
    assert (fallen * remaining < force * np.hypot(*arm) * (1 - np.cos(balance))) == holds
    along = np.array([np.cos(chamfer), np.sin(chamfer)])
    normal = np.array([np.sin(chamfer), -np.cos(chamfer)])
    assert toppling(scene, 180) == pytest.approx(
        G * (arm @ along) / (arm @ normal) if holds else lifts, rel=EXACT
    )


def test_a_flat_sharp_edged_base_topples_when_it_lifts_off():
    rng = np.random.default_rng(7)
    for _ in range(10):
        base = rng.uniform(-1, 1, (8, 2))
        rock = hull(
            np.vstack([np.column_stack([base, np.zeros(8)]), np.column_stack([base, np.full(8, 3.0)])])
        )
        for azimuth in rng.uniform(0, 360, 6):
            pair = Seat.of(rock, LEVEL).path(G, azimuth)
            # It may tip over a side edge and end on a neighbouring side only: lift-off is the end for upright
            # sides.
            assert pair[0] == pytest.approx(pair[1], rel=EXACT)


def test_an_edge_that_lies_nearly_along_the_push_lets_go_in_finitely_many_steps():
    """Its moment changes so little with the acceleration that rounding hides a step past it."""
    rock = hull([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.6, 2.0]])
    beside_m, slope = 1e-5, 2e-4
    rock = dataclasses.replace(rock, com_m=np.array([0.0, beside_m, 1.0]))
    seat = Seat.of(rock, LEVEL)
    rests = list(islice(seat.rests(G, float(np.rad2deg(slope))), 50))
    assert len(rests) < 50
    assert rests[0][-1] == pytest.approx(G * beside_m / np.sin(slope), rel=1e-6)


def round_base(sides, radius=1.0, com_below=0.75):
    """Plane body on a circular arc of given radius, its centre of mass `com_below` below the arc's centre."""
    # A segment of the circle up to height c: its centroid is (2/3) s^3 / area below the centre, found by
    # bisection.
    angle = np.linspace(-1.0, 1.0, sides)

    def profile(half_angle):
        return np.column_stack(
            [radius * np.sin(half_angle * angle), radius * (1 - np.cos(half_angle * angle))]
        )

    low, high = 0.3, np.pi / 2
    for _ in range(60):
        half = 0.5 * (low + high)
        below = 2 / 3 * radius * np.sin(half) ** 3 / (half - np.sin(half) * np.cos(half))
        low, high = (half, high) if below > com_below else (low, half)
    return extruded(profile(half)), half


def test_a_round_base_rolls_and_topples_where_its_stable_equilibrium_is_lost():
    # Equilibrium of an arc of radius rho with the centre of mass c below its centre: a/g = c sin t / (rho - c
    # cos t), whose limit point is cos t = c / rho, a/g = c / sqrt(rho^2 - c^2). Chords of the arc hold longer, to first
    # order, up to 4.6, 1.2 and .3 %; which of the last ones the rock comes to rest on, its fall from another decides.
    radius, below = 1.0, 0.75
    exact = G * below / np.sqrt(radius**2 - below**2)
    errors, lifts = [], []
    for sides in (40, 160, 640):
        rock, half_angle = round_base(sides, radius, below)
        assert half_angle > np.arccos(below / radius) * 1.05
        scene = Scene.from_mesh(mesh_of(rock))
        errors.append(toppling(scene, 180) / exact - 1)
        lifts.append(lift_off(scene, 180))
    assert np.abs(errors) == pytest.approx([0.0, 0.0, 0.0], abs=0.04)
    assert (np.abs(errors) < 2.0 / np.array([40, 160, 640])).all()
    # A smooth base has no threshold of lift-off.
    assert np.diff(np.log2(lifts)) == pytest.approx([-2, -2], abs=0.4)


def test_toppling_turns_with_the_rock_and_mirrors_with_it():
    rng = np.random.default_rng(3)
    rock = hull(rng.normal(size=(60, 3)) * [1.0, 0.7, 0.5])
    scene = Scene.from_mesh(mesh_of(rock))
    turned = Scene.from_mesh(mesh_of(rock.moved(turn("z", 37.0))))
    mirror = np.diag([1.0, -1.0, 1.0])
    mirrored = Scene.from_mesh((rock.vertices_m @ mirror, rock.faces[:, ::-1]))
    for azimuth in (0.0, 50.0, 200.0):
        lifts = lift_off(scene, azimuth)
        assert lift_off(turned, azimuth + 37.0) == pytest.approx(lifts, rel=1e-6)
        assert lift_off(mirrored, -azimuth) == pytest.approx(lifts, rel=1e-6)
    for azimuth in (50.0, 120.0, 200.0):  # at 0 two rests are as likely after a fall: 20.2 or 24.5 m/s2
        expected = toppling(scene, azimuth)
        assert toppling(turned, azimuth + 37.0) == pytest.approx(expected, rel=1e-4)
        assert toppling(mirrored, -azimuth) == pytest.approx(expected, rel=1e-4)


def test_toppling_does_not_depend_on_size_or_duplicate_and_sliver_triangles():
    rock = extruded([(-0.5, 0), (0.5, 0), (1, 0.2), (1, 1.5), (-1, 1.5), (-1, 0.2)], 5.0)
    split = trimesh.Trimesh(rock.vertices_m, rock.faces, process=False).subdivide()
    expected = toppling(Scene.from_mesh(mesh_of(rock)), 170)
    assert toppling(Scene.from_mesh((split.vertices, split.faces)), 170) == pytest.approx(expected, rel=EXACT)
    for scale in (2e-2, 5e1):  # 3 cm and 75 m high
        scaled = Scene.from_mesh((rock.vertices_m * scale, rock.faces))
        assert toppling(scaled, 170) == pytest.approx(expected, rel=EXACT)


def test_a_rock_on_fewer_than_three_points_rolls_onto_a_facet_and_has_no_static_equilibrium():
    rock = ellipsoid((1.0, 1.0, 0.8), 2)
    scene = Scene.from_mesh(mesh_of(rock.moved(turn("y", 3.0))))
    assert len(support_polygon_m(scene.rock, scene.pedestal)) < 3
    assert 0 < lift_off(scene, 10) <= toppling(scene, 10)
    assert not possible(scene, np.zeros((3, 3))).any()


def brute_force_equilibrium(corners, com, normal, mu, force, sides=180):
    """Whether forces at the corners, inside many-sided friction pyramids, balance a force on the rock."""
    first, second = plane_axes(normal)
    angle = 2 * np.pi * np.arange(sides) / sides
    rays = normal + mu * (np.outer(np.cos(angle), first) + np.outer(np.sin(angle), second))
    columns = [np.vstack([rays.T, np.cross(corner - com, rays).T]) for corner in corners]
    found = linprog(
        np.zeros(sides * len(corners)),
        A_eq=np.hstack(columns),
        b_eq=np.concatenate([-force, np.zeros(3)]),
        method="highs",
    )
    return found.status == 0


@pytest.mark.thorough
def test_equilibrium_is_possible_exactly_where_forces_inside_the_friction_cones_balance():
    rng = np.random.default_rng(11)
    answers, samples = 0, 0
    for _ in range(12):
        base = rng.uniform(-1, 1, (5, 2))
        rock = hull(
            np.vstack([np.column_stack([base, np.zeros(5)]), rng.uniform([-1, -1, 0.6], [1, 1, 2.6], (6, 3))])
        )
        slope, downhill = rng.uniform(0, 25), rng.uniform(0, 360)
        scene = Scene.from_mesh(
            mesh_of(rock), friction=rng.uniform(0.2, 1.5), slope_deg=slope, slope_azimuth_deg=downhill
        )
        acceleration = rng.normal(size=(25, 3)) * [4, 4, 5]
        corners = support_polygon_m(scene.rock, scene.pedestal)
        mu, normal = scene.contact.friction_static, scene.pedestal.normal
        for single, holds in zip(acceleration, possible(scene, acceleration), strict=True):
            weight = np.array([0, 0, -G]) - single
            # The pyramid lies inside the cone by a share 1.5e-4: skip the samples between the two.
            pressing = -weight @ normal
            if abs(np.linalg.norm(weight + pressing * normal) - mu * pressing) < 3e-4 * mu * pressing:
                continue
            assert holds == brute_force_equilibrium(corners, scene.rock.com_m, normal, mu, weight)
            answers += holds
            samples += 1
    assert 30 < answers < samples - 30  # both answers were put to the test


@pytest.mark.parametrize(("half_height", "mu", "slope"), [(0.6, 0.9, 0.0), (0.6, 0.2, 0.0), (0.2, 0.6, 5.0)])
def test_equilibrium_ends_at_the_toppling_or_the_slip_acceleration(half_height, mu, slope):
    # Ground accelerated uphill: tan(angle - slope), of friction or of the block's slenderness.
    scene = Scene.from_mesh(mesh_of(box(0.2, 0.2, half_height)), friction=mu, slope_deg=slope)
    least = G * np.tan(np.arctan(min(mu, 0.2 / half_height)) - np.deg2rad(slope))
    uphill = least * np.outer([1 - 1e-6, 1 + 1e-6], [-1.0, 0.0, 0.0])
    assert possible(scene, uphill).tolist() == [True, False]
    assert not possible(scene, [[0, 0, -1.01 * G]])[0]  # the ground falls away


def test_the_support_polygon_runs_counter_clockwise_about_the_normal():
    scene = Scene.from_mesh(mesh_of(box(1, 2, 3)), slope_deg=20, slope_azimuth_deg=70)
    ring = support_polygon_m(scene.rock, scene.pedestal)
    bend = np.cross(np.roll(ring, -1, axis=0) - ring, np.roll(ring, -2, axis=0) - np.roll(ring, -1, axis=0))
    assert (bend @ plane_normal(20, 70) > 0).all()


def mesh_of(rock):
    return rock.vertices_m, rock.faces


def turn(axis, degrees):
    return Rotation.from_euler(axis, degrees, degrees=True).as_matrix()


def test_another_friction_leaves_the_restitution_as_it_is():
    scene = Scene.block(0.2, 0.2, 0.6, friction=(0.8, 0.6), restitution=0.3).with_friction(0.7)
    assert scene.contact == ContactProperties(0.7, 0.7, 0.3)


@pytest.mark.parametrize(
    ("given", "pair"),
    [*((pair, (0.8, 0.6)) for pair in ((0.8, 0.6), [0.8, 0.6], np.array([0.8, 0.6]))),
     *((value, (1.0, 1.0)) for value in (1, 1.0, [1], np.float32(1.0), np.int64(1), np.array(1.0)))],
)  # fmt: skip
def test_friction_may_be_any_number_or_sequence_of_at_most_two(given, pair):
    assert ContactProperties.of(given) == ContactProperties(*pair)


def test_a_direction_and_a_list_of_a_single_direction_are_equivalent():
    assert len({str(Scene.block(0.2, 0.3, 0.6).tips_m_s2(value)) for value in ("N40E", 50, [50.0])}) == 1


def test_a_mesh_is_taken_as_a_pair_as_lists_or_as_a_trimesh_alike():
    rock = box(0.2, 0.2, 0.6).moved(np.eye(3), (0.0, 0.0, 0.6))
    pair = rock.vertices_m, rock.faces
    plate = (
        9.0 * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    forms = [pair, [rock.vertices_m.tolist(), rock.faces.tolist()], trimesh.Trimesh(*pair)]
    assert len({Scene.from_mesh(form).id for form in forms}) == 1
    assert len({Scene.from_mesh(pair, pedestal=form).id for form in (plate, trimesh.Trimesh(*plate))}) == 1
    with refused("mesh.kind_unknown", "int"):
        Scene.from_mesh(3)
