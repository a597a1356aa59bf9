"""The rules around a shake: what is refused, what is skipped, what stays the same."""

import hashlib
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from refusals import refused
from scipy.spatial.transform import Rotation
from virtual_rocks import ellipsoid

from toppling.models.motions.motion import Motion
from toppling.models.pedestal import ContactProperties, Pedestal
from toppling.models.rock import Rock
from toppling.models.scene import Scene
from toppling.models.shapes import box
from toppling.workers.barrier import least_overturning_j_kg
from toppling.workers.engines import ENGINES
from toppling.workers.options import PRESETS
from toppling.workers.shaking import shake
from toppling.workers.start import State

G = 9.81


def pulse(peak_m_s2, period_s=0.5, azimuth_deg=0.0, samples=200):
    time = np.linspace(0.0, period_s, samples + 1)
    along = peak_m_s2 * np.sin(2 * np.pi * time / period_s)
    direction = np.array([np.cos(np.deg2rad(azimuth_deg)), np.sin(np.deg2rad(azimuth_deg)), 0.0])
    return Motion(along[:, None] * direction, period_s / samples)


def noise(seed, peak_m_s2, seconds=6.0):
    random = np.random.default_rng(seed)
    samples = random.normal(size=(int(seconds * 50), 3))
    return Motion(peak_m_s2 * samples / np.abs(samples).max(), 0.02)


def fingerprint(result):
    path = result.trajectory
    return hashlib.sha256(path.position_m.tobytes() + path.quaternion_xyzw.tobytes()).hexdigest()


@pytest.mark.parametrize("preset", ["fast", "standard"])
@pytest.mark.parametrize("slope_deg", [0.0, 7.0])
def test_skipping_rest_changes_no_bit_of_what_follows(preset, slope_deg):
    rock = box(0.2, 0.25, 0.6)
    scene = Scene.from_mesh((rock.vertices_m, rock.faces), friction=0.7, slope_deg=slope_deg)
    quiet, bursts = np.zeros((150, 3)), [noise(seed, 6.0).acceleration_m_s2 for seed in (1, 2)]
    motion = Motion(np.vstack([quiet, bursts[0], quiet, bursts[1], quiet]), 0.02)
    short, whole = (shake(scene, motion, preset, shortcuts=s, trajectory=True) for s in (True, False))
    assert short.skipped_s > 2 * 2.5  # the first quiet time and the second, all but a block
    assert whole.skipped_s == 0.0
    poses = [
        dict(zip(entry.time_s, map(tuple, np.hstack([entry.position_m, entry.quaternion_xyzw])), strict=True))
        for entry in (short.trajectory, whole.trajectory)
    ]
    common = poses[0].keys() & poses[1].keys()
    # While one run rests it has a pose a block, the other one for the whole rest.
    assert len(common) > 0.99 * len(poses[0])
    assert all(poses[0][time] == poses[1][time] for time in common)
    assert short.max_tilt_deg == whole.max_tilt_deg


def test_a_rock_at_rest_that_its_contacts_can_hold_does_not_creep():
    rock = box(0.3, 0.3, 0.5)
    scene = Scene.from_mesh((rock.vertices_m, rock.faces), friction=0.8, slope_deg=8.0)
    weak = noise(5, 0.3, 20.0)
    result = shake(scene, weak, shortcuts=False, trajectory=True)
    assert result.steps > 1000
    assert result.slip_m == 0.0
    assert len(set(map(tuple, result.trajectory.position_m))) == 1


@pytest.mark.thorough
def test_a_rock_that_rolls_is_shaken_through_the_weak_end_of_a_motion():
    # Nothing resists its rolling: it is never at rest while the ground moves.
    rock = ellipsoid((0.5, 0.5, 0.3), 3)
    scene = Scene.from_mesh((rock.vertices_m, rock.faces), friction=0.5)
    ends = [noise(2, 8.0, 3.0).acceleration_m_s2, noise(4, 0.15, 30.0).acceleration_m_s2]
    motion = Motion(np.vstack(ends), 0.02)
    short, whole = (shake(scene, motion, "fast", shortcuts=s) for s in (True, False))
    assert short.outcome == whole.outcome == "moved"
    assert short.simulated_s > motion.duration_s


@pytest.mark.thorough
def test_it_does_not_matter_at_which_step_a_rock_at_rest_is_pushed():
    # Points are taken in as the rock tilts; a push from rest turns it past all that are in at once.
    rock = ellipsoid((0.5, 0.5, 0.42), 3)
    scene = Scene.from_mesh((rock.vertices_m, rock.faces), friction=0.8)
    push = np.repeat([20.0, -20.0], 12)
    largest = []
    for quiet in range(20, 41, 5):
        along = np.concatenate([np.zeros(quiet), push, np.zeros(60 - quiet)])
        result = shake(scene, Motion(np.outer(along, [1.0, 0.0, 0.0]), 0.01), "fast")
        assert result.penetration_m < 1e-3 * scene.rock.half_diagonal_m
        largest.append(result.max_tilt_deg)
    assert min(largest) > 20.0  # it came far beyond the points that are in at rest
    assert np.ptp(largest) < 0.5  # measured .2: the grid of steps falls elsewhere on the push


def test_a_rock_that_starts_with_its_thin_side_downhill_is_not_called_certain_in_a_weak_motion():
    # What tips it is known for the pose of the scene, wide side downhill; the push topples it as it is turned.
    scene = turned_block((0.6, 0.13, 0.6), 0.0, slope_deg=10.0, friction=0.8)
    quarter = Rotation.from_rotvec(0.5 * np.pi * scene.pedestal.normal).as_quat()
    start = State(quaternion_xyzw=quarter, velocity_m_s=(0.0, 0.8, 0.0))
    late_push = np.concatenate([np.zeros(300), np.full(500, -0.048 * G)])
    motion = Motion(np.outer(late_push, [1.0, 0.0, 0.0]), 0.01)
    short, whole = (shake(scene, motion, "fast", shortcuts=s, initial=start) for s in (True, False))
    assert (short.outcome, whole.outcome) == ("toppled", "toppled")


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_a_rock_let_go_near_its_balance_is_not_certain_before_it_has_come_down(share):
    scene = Scene.block(0.2, 0.35, 0.6, friction=2.0)
    radius, alpha = np.hypot(0.2, 0.6), np.arctan2(0.2, 0.6)
    lean = share * alpha
    start = State(
        position_m=[0.2 - radius * np.sin(alpha - lean), 0.0, radius * np.cos(alpha - lean)],
        quaternion_xyzw=(0.0, np.sin(lean / 2), 0.0, np.cos(lean / 2)),
    )
    still = Motion(np.zeros((2, 3)), 0.01)
    short, whole = (shake(scene, still, "fast", shortcuts=s, initial=start) for s in (True, False))
    assert short.toppled == whole.toppled == (share > 1.0)
    if share < 1.0:  # what is left of the rocking turns it by half a degree more
        assert short.residual_tilt_deg == pytest.approx(whole.residual_tilt_deg, abs=1.0)


def test_a_peak_beyond_the_tilt_that_counts_as_toppled_holds_nothing():
    # A foot of half width .05 m, and a facet at 50 degrees on which the rock would lie toppled.
    scene = extruded(((0.05, 0.0), (0.6, 0.655), (0.3, 0.8)), 0.6, 0.9)
    height = scene.rock.com_m[2]
    edge = G * (np.hypot(0.05, height) - height)
    # The edge is passed between whole degrees of tilt.
    assert least_overturning_j_kg(scene) == pytest.approx(edge, rel=0.05)


def turned_block(half_sizes, turn_deg, slope_deg=0.0, **contact):
    rock = box(*half_sizes).moved(Rotation.from_euler("z", turn_deg, degrees=True).as_matrix())
    return Scene.from_mesh((rock.vertices_m, rock.faces), slope_deg=slope_deg, **contact)


def extruded(section, half_depth, friction):
    """The convex rock that is symmetrical about x = 0 over a section (x, z), drawn out along y."""
    corners = [(side * x, y, z) for side in (1, -1) for y in (-half_depth, half_depth) for x, z in section]
    hull = trimesh.convex.convex_hull(np.array(corners))
    return Scene.from_mesh((hull.vertices, hull.faces), friction=friction)


def over_the_edge(half_width, half_height, slope_deg=0.0):
    """Least energy per mass that overturns a block over its lower edge."""
    alpha = np.arctan2(half_width, half_height) - np.deg2rad(slope_deg)
    return G * np.hypot(half_width, half_height) * (1.0 - np.cos(alpha))


@pytest.mark.parametrize("half_width", [0.1, 0.2])
@pytest.mark.parametrize("half_depth", [0.35, 3.0])
@pytest.mark.parametrize("turn_deg", [0.0, 2.5, 5.0, 22.0, 45.0])
def test_the_least_energy_that_overturns_a_block_lifts_it_over_an_edge_however_it_is_turned(
    half_width, half_depth, turn_deg
):
    scene = turned_block((half_width, half_depth, 0.6), turn_deg)
    # Looked for at whole degrees of tilt: a miss by half a degree costs (.5 / alpha)^2 = .3 % of it. Never above.
    assert 0.995 < least_overturning_j_kg(scene) / over_the_edge(half_width, 0.6) <= 1.0 + 1e-12


@pytest.mark.parametrize(("turn_deg", "half_width"), [(0.0, 0.2), (90.0, 0.35), (180.0, 0.2)])
def test_on_a_slope_the_least_energy_is_that_of_the_side_that_is_turned_downhill(turn_deg, half_width):
    scene = turned_block((0.2, 0.35, 0.6), 0.0, slope_deg=5.0)
    exact = over_the_edge(half_width, 0.6, 5.0)
    if half_width == 0.35:  # then it tips more easily over its short side, which lies along the slope
        exact = min(exact, np.cos(np.deg2rad(5.0)) * over_the_edge(0.2, 0.6))
    assert least_overturning_j_kg(scene, yaw_deg=turn_deg) == pytest.approx(exact, rel=5e-3)
    assert least_overturning_j_kg(scene, yaw_deg=None) <= least_overturning_j_kg(scene, yaw_deg=turn_deg)


def test_a_slab_that_a_slope_overturns_from_where_it_leans_is_not_called_standing():
    # Its thin side, turned downhill, balances at 10.4 - 10 degrees: its wide one would stand.
    scene = turned_block((0.6, 0.11, 0.6), 0.0, slope_deg=10.0, friction=2.0)
    normal, com = scene.pedestal.normal, scene.rock.com_m
    quarter = Rotation.from_rotvec(0.5 * np.pi * normal)
    down = Rotation.from_euler("y", 10.0, degrees=True).apply([1.0, 0.0, 0.0])
    foot = com - 0.6 * normal + 0.11 * down
    lean = Rotation.from_rotvec(
        np.deg2rad(np.rad2deg(np.arctan2(0.11, 0.6)) - 10.0 + 0.05) * np.cross(normal, down)
    )
    start = State(position_m=foot + lean.apply(com - foot), quaternion_xyzw=(lean * quarter).as_quat())
    still = Motion(np.zeros((2, 3)), 0.01)
    short, whole = (shake(scene, still, "fast", shortcuts=s, initial=start) for s in (True, False))
    assert whole.toppled
    assert short.toppled


@pytest.mark.parametrize("push_m_s2", [2.3, 2.6])
def test_a_rock_that_falls_from_facet_to_facet_is_not_called_standing_meanwhile(push_m_s2):
    # Past its balance, and what it loses as it lands on a facet leaves it less energy than it had lying.
    scene = extruded(((0.12, 0.0), (0.75, 0.3), (0.9, 0.56), (0.9, 2.2)), 1.5, 1.0)
    push = Motion(np.outer([*np.full(50, -push_m_s2), 0.0], [1.0, 0.0, 0.0]), 0.005)
    short, whole = (shake(scene, push, "fast", shortcuts=s) for s in (True, False))
    assert whole.toppled
    assert short.toppled


@pytest.mark.parametrize("alpha_deg", [31.0, 33.7, 40.0, 45.0])
def test_a_stout_block_that_still_rocks_as_its_answer_is_certain_counts_as_it_does_at_rest(alpha_deg):
    alpha = np.deg2rad(alpha_deg)
    scene = Scene.block(np.sin(alpha), np.sin(alpha), np.cos(alpha), friction=1.5)
    time = np.arange(0.0, 0.26, 0.005)
    push = 1.6 * G * np.tan(alpha) * np.sin(np.pi * time / 0.25) * (time < 0.25)
    short, whole = (shake(scene, along_x(push), shortcuts=shortcuts) for shortcuts in (True, False))
    assert short.max_tilt_deg > 1.2
    assert (short.outcome, whole.outcome) == ("stands", "stands")


@pytest.mark.parametrize("slope_deg", [0.0, 25.0])
def test_a_slab_that_spins_flat_on_a_slope_has_turned_and_not_tilted(slope_deg):
    scene = turned_block((0.5, 0.5, 0.1), 0.0, slope_deg=slope_deg, friction=0.9)
    spin = State(angular_velocity_rad_s=12.0 * scene.pedestal.normal)
    result = shake(scene, Motion(np.zeros((2, 3)), 0.01), "fast", initial=spin)
    assert result.outcome == "moved"
    assert result.residual_yaw_deg > 45.0
    assert result.max_tilt_deg < 0.1


@pytest.mark.parametrize("engine", ENGINES)
def test_a_motion_within_the_static_cone_takes_no_step_and_a_motion_just_beyond_it_lifts_the_rock(engine):
    scene = Scene.block(0.2, 0.2, 0.6, friction=0.8)
    result = shake(scene, pulse(0.99 * G / 3), engine=engine)
    assert (result.steps, result.ended_by, result.outcome) == (0, "never_moved", "stands")
    # 5 % above lift-off for a tenth of a second turns it by a hundredth of a degree.
    assert shake(scene, pulse(1.05 * G / 3), engine=engine).max_tilt_deg > 0.005


@pytest.mark.parametrize("engine", ENGINES)
def test_the_same_job_gives_the_same_bits_after_any_other(engine):
    tall, flat = Scene.block(0.2, 0.2, 0.6), Scene.block(0.5, 0.3, 0.4)
    first = fingerprint(shake(tall, pulse(5.0), trajectory=True, engine=engine))
    shake(flat, noise(1, 20.0), engine=engine)
    shake(tall, pulse(9.0), engine=engine)
    assert fingerprint(shake(tall, pulse(5.0), trajectory=True, engine=engine)) == first


def test_a_rock_that_starts_turned_and_stays_so_has_not_moved():
    quarter = State(quaternion_xyzw=(0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)))
    result = shake(Scene.block(0.2, 0.35, 0.6), Motion(np.zeros((2, 3)), 0.01), "fast", initial=quarter)
    assert result.outcome == "stands"
    assert result.residual_yaw_deg < 1e-4  # the solver turns it by 2.6e-6


def on_a_table(half_sizes, half_table, **contact):
    block, top = (
        Scene.block(*half_sizes, **contact),
        half_table * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]),
    )
    table = Pedestal(
        np.zeros(3),
        np.array([0.0, 0.0, 1.0]),
        np.column_stack([top, np.zeros(4)]),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    return replace(block, pedestal=table)


def test_a_rock_that_slides_over_the_end_of_its_pedestal_falls_and_a_rock_that_stops_before_stands():
    scene = on_a_table((0.3, 0.3, 0.2), 0.35, friction=0.3)
    for peak_m_s2, outcome in ((5.0, "moved"), (9.0, "toppled")):
        push = Motion(np.outer([*np.full(60, peak_m_s2), 0.0], [1.0, 0.0, 0.0]), 0.005)
        result = shake(scene, push, "fast")
        assert result.outcome == outcome
    assert result.ended_by in ("fallen", "tilted")
    assert result.falls_toward_deg == pytest.approx(180.0, abs=1.0)
    assert 0.0 < result.topple_time_s < 2.0


def plumb_rock_on_a_slope(end_m, uphill):
    """A block .5 m wide and 1.7 m high whose centre of mass lies over its base's middle, on a mesh that ends there.

    The slope of 20 degrees falls toward x; the mesh ends at `end_m` along it from the foot of the plumb line.
    """
    slope = np.deg2rad(20.0)
    normal = np.array([np.sin(slope), 0.0, np.cos(slope)])
    down = np.array([np.cos(slope), 0.0, -np.sin(slope)])
    heels = [side * 0.25 * down for side in (-1.0, 1.0)]
    tops = [heel + np.array([0.0, 0.0, 1.7]) for heel in heels]  # walls that stand plumb
    corners = [np.add(point, (0.0, y, 0.0)) for point in (*heels, *tops) for y in (-0.25, 0.25)]
    hull = trimesh.convex.convex_hull(np.array(corners)).subdivide()
    ends = (-end_m, 6.0) if uphill else (-6.0, end_m)
    ground = np.array([np.add(along * down, (0.0, y, 0.0)) for along in ends for y in (-3.0, 3.0)])
    pedestal = Pedestal(np.zeros(3), normal, ground, np.array([[0, 2, 1], [1, 2, 3]]))
    return Scene(Rock.from_triangles(hull.vertices, hull.faces), pedestal, ContactProperties.of((0.6, 0.45)))


def test_a_rock_whose_plumb_line_is_over_its_pedestal_has_not_slid_off_a_slope():
    # The mesh ends at its uphill heel, behind where the interface's normal through the centre of mass meets it.
    scene = plumb_rock_on_a_slope(0.25, uphill=True)
    along = np.concatenate([np.full(20, 3.7), np.full(20, -3.4), [0.0]])
    result = shake(scene, Motion(np.outer(along, [1.0, 0.0, 0.0]), 0.005), "fast")
    assert result.steps > 0
    assert result.outcome in {"stands", "moved"}


def test_a_rock_whose_plumb_line_is_beyond_its_pedestal_has_slid_off_a_slope():
    scene = plumb_rock_on_a_slope(0.32, uphill=False)
    # Friction stops it after .4 m, before the normal through its centre of mass comes to the end.
    push = Motion(np.outer([*np.full(42, -4.0), 0.0], [1.0, 0.0, 0.0]), 0.005)
    result = shake(scene, push, "fast")
    assert result.toppled
    far = plumb_rock_on_a_slope(2.0, uphill=False)
    assert 0.32 < shake(far, push, "fast").slip_m < 0.6


def burst(start_s, end_s, push_m_s2, until_s=8.0):
    """Ground acceleration along x between two times, at 200 samples a second, and that sampling's times."""
    time = np.arange(0.0, until_s, 0.005)
    return time, np.where((time > start_s) & (time < end_s), push_m_s2, 0.0)


def along_x(push_m_s2):
    return Motion(np.outer(push_m_s2, [1.0, 0.0, 0.0]), 0.005)


@pytest.mark.parametrize(
    ("push_m_s2", "azimuth_deg"), [(5.0, 180.0), (-5.0, 0.0)], ids=["uphill", "downhill"]
)
def test_on_a_slope_the_point_of_no_return_is_the_highest_of_the_centre_of_mass(push_m_s2, azimuth_deg):
    rock = plumb_rock_on_a_slope(6.0, uphill=False)
    plane = Pedestal(np.zeros(3), rock.pedestal.normal)
    scene = replace(rock, pedestal=plane, contact=ContactProperties.of(1.2))
    result = shake(scene, along_x(burst(3.0, 3.6, push_m_s2)[1]), trajectory=True)
    highest = int(result.trajectory.position_m[:, 2].argmax())
    assert result.outcome == "toppled"
    assert abs((result.falls_toward_deg - azimuth_deg + 180.0) % 360.0 - 180.0) < 0.1
    # The rock slips by a millimetre as it turns, downhill or back: its top lies a few steps off that of the height.
    assert result.topple_time_s == pytest.approx(result.trajectory.time_s[highest], abs=0.01)


def test_a_rock_rolled_onto_its_next_face_passed_its_edge_then_and_not_as_it_was_rocked_there():
    angles = np.deg2rad(np.arange(0, 360, 60))
    scene = extruded(np.column_stack([0.5 * np.cos(angles), 0.5 * np.sin(angles)]), 0.6, 1.5)
    time, push = burst(2.0, 2.35, 8.6, until_s=15.0)
    push = push + np.where((time > 8.0) & (time < 14.0), 6.2 * np.sin(4.0 * np.pi * time), 0.0)
    result = shake(scene, along_x(push), trajectory=True)
    assert (result.outcome, result.ended_by) == ("toppled", "rest_certain")
    turned_rad = 2.0 * np.arctan2(*np.abs(result.trajectory.quaternion_xyzw[:, [1, 3]]).T)
    over_edge = int(np.argmax(turned_rad > np.pi / 6.0))  # of a hexagon
    assert result.trajectory.time_s[-1] > 14.0
    assert result.topple_time_s == pytest.approx(result.trajectory.time_s[over_edge], abs=0.005)


@pytest.mark.parametrize("table_m", [1.24, 20.0])  # scans keep .6 heights beside the rock; 4 R are looked at
def test_a_rock_that_slides_past_the_ground_that_is_known_has_no_answer(table_m):
    scene = on_a_table((1.0, 1.0, 0.2), table_m, friction=0.2)
    push = Motion(np.outer([*np.full(200, 9.0), 0.0], [1.0, 0.0, 0.0]), 0.005)
    result = shake(scene, push, "fast")
    assert (result.status, result.outcome, result.ended_by) == ("failed", None, "left_ground")
    weaker = shake(scene, Motion(push.acceleration_m_s2 * (0.25, 1.0, 1.0), 0.005), "fast")
    assert weaker.outcome == "moved"


def test_a_slope_on_which_slips_never_end_is_refused():
    scene = turned_block((0.3, 0.3, 0.3), 0.0, slope_deg=20.0, friction=(0.6, 0.36))  # tan 20 degrees is .364
    with refused("contact.slides_forever", "0.364"):
        shake(scene, pulse(5.0))
    assert (
        shake(turned_block((0.3, 0.3, 0.3), 0.0, 20.0, friction=(0.6, 0.37)), pulse(0.5)).outcome == "stands"
    )


@pytest.mark.parametrize("height_m", [0.05, -0.05])
def test_a_rock_off_its_surface_is_set_on_it(height_m):
    seated = Scene.block(0.2, 0.2, 0.6)
    moved = replace(seated, rock=seated.rock.moved(np.eye(3), (0.0, 0.0, height_m)))
    results = [shake(scene, pulse(4.5), trajectory=True) for scene in (seated, moved)]
    assert results[1].penetration_m < 1e-3 * seated.rock.half_diagonal_m
    # The same bits but for those of the height's sum.
    assert results[1].max_tilt_deg == pytest.approx(results[0].max_tilt_deg, rel=1e-6)
    with refused("rock.does_not_stand"):
        shake(replace(seated, rock=seated.rock.moved(np.eye(3), (0.0, 0.0, 0.3))), pulse(5.0))


def test_a_rock_that_still_slides_after_the_motion_slides_to_its_end():
    scene = Scene.block(0.5, 0.5, 0.2, friction=0.3)
    push = Motion(np.outer([*np.full(60, 6.0), 0.0], [1.0, 0.0, 0.0]), 0.005)  # ends at .9 m/s of slip
    short, whole = (shake(scene, push, shortcuts=s).slip_m for s in (True, False))
    assert whole > 0.1 * scene.rock.half_diagonal_m
    # What is left below the speed of rest: (5e-4)^2 R / (2 mu), under 1e-6 R.
    assert short == pytest.approx(whole, abs=1e-6)


@pytest.mark.parametrize("time_step", [0.0, -0.001, 1e-10, 0.05, 1.0, float("nan")])
def test_a_step_that_resolves_nothing_is_refused(time_step):
    with refused("shake.step_out_of_range", time_step):
        shake(Scene.block(0.02, 0.02, 0.06), pulse(5.0), time_step=time_step)


@pytest.mark.parametrize(
    ("rock", "slope_deg", "options", "code"),
    [
        (box(0.05, 0.05, 0.6), 20.0, {}, "rock.does_not_stand"),
        (box(0.2, 0.2, 0.6), 0.0, {"preset": "exact"}, "engine.preset_unknown"),
        (box(0.2, 0.2, 0.6), 0.0, {"initial": {"position_m": (0, 0, 0.05)}}, "shake.starts_in_ground"),
        (box(0.2, 0.2, 0.6), 0.0, {"engine": "newton"}, "engine.unknown"),
        (box(0.2, 0.2, 0.6), 0.0, {"engine": "newton", "preset": PRESETS["fast"]}, "engine.unknown"),
    ],
)
def test_what_cannot_be_shaken_is_refused_by_name(rock, slope_deg, options, code):
    scene = Scene.from_mesh((rock.vertices_m, rock.faces), slope_deg=slope_deg)
    with refused(code):
        shake(scene, pulse(5.0), **options)


@pytest.mark.parametrize(
    "start",
    [
        {"quaternion_xyzw": (0, 0, 0, 0)}, {"quaternion_xyzw": (0, 0, 1)}, {"position_m": (0.0, 0.0, np.nan)},
        {"velocity_m_s": (np.inf, 0.0, 0.0)}, {"angular_velocity_rad_s": (0.0, np.nan, 0.0)},
        {"velocity_m_s": "fast"}, {"speed_m_s": (1.0, 0.0, 0.0)},
    ],
)  # fmt: skip
def test_a_start_in_no_finite_state_is_refused(start):
    code = "shake.start_unknown" if "speed_m_s" in start else "shake.start_unusable"
    with refused(code, *start):
        shake(Scene.block(0.2, 0.2, 0.6), Motion(np.zeros((2, 3)), 0.01), "fast", initial=start)
