"""Hard cases: what must hold where a rigid-body engine is most likely to fail."""

from dataclasses import replace
from functools import partial

import engine_cases as case
import numpy as np
import pytest
import trimesh
from reference.closed_forms import landing_boundary
from scipy.spatial.transform import Rotation
from virtual_rocks import ellipsoid

from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.models.shapes import box, cylinder
from toppling.workers.engines import DEFAULT, engine_named
from toppling.workers.options import PRESETS
from toppling.workers.problem import Problem
from toppling.workers.shaking import Shaking, shake
from toppling.workers.start import State

G = case.G
SINK = 1e-3  # of R: the contact tolerance


def record(seconds, rate, peak, frequency=2.0, seed=0, vertical=0.5):
    """Band-limited noise with a smooth beginning and end, peak in m/s2, vertical peak a share of it."""
    rng = np.random.default_rng(seed)
    time = np.arange(int(seconds * rate)) / rate
    motion = np.zeros((len(time), 3))
    for axis in range(3):
        for _ in range(12):
            motion[:, axis] += np.sin(
                2 * np.pi * frequency * rng.uniform(0.5, 1.5) * time + rng.uniform(0, 2 * np.pi)
            )
    motion *= np.sin(np.pi * time / time[-1])[:, None] ** 2
    motion *= peak * np.array([1, 0.7, vertical]) / np.abs(motion).max(axis=0)
    return Motion(motion, 1 / rate)


def sound(result, scene):
    """A finite answer in which nothing sank in."""
    assert result.status == "ok", result
    assert np.isfinite([result.max_tilt_deg, result.slip_m, result.residual_tilt_deg]).all()
    assert result.penetration_m <= SINK * scene.rock.half_diagonal_m


@pytest.mark.parametrize("alpha_deg", [1, 60])
def test_very_slender_and_very_stout_blocks_answer(alpha_deg):
    scene, b, h = case.block(alpha_deg, 1.0, friction=0.8)
    weak = shake(scene, record(3, 100, 0.8 * G * min(b / h, 0.8)), shortcuts=False)
    sound(weak, scene)
    assert weak.outcome == "stands"
    strong = shake(scene, record(6, 100, 6.0 * G), shortcuts=False)
    sound(strong, scene)
    assert strong.toppled or alpha_deg == 60


@pytest.mark.parametrize("half_diagonal", [0.05, 30.0])
def test_five_centimetres_and_thirty_metres_answer(half_diagonal):
    scene, *_ = case.block(15, half_diagonal, friction=0.8)
    result = shake(scene, record(6, 100, 2.0 * G * np.tan(np.deg2rad(15))), shortcuts=False)
    sound(result, scene)
    assert result.toppled == (half_diagonal < 1.0)  # a large rock needs a longer push


def test_a_release_at_0_999_alpha_falls_back():
    scene, b, h = case.block(18, 1.0)
    start = case.leaning(b, h, 0.999 * np.arctan2(b, h))
    for preset in ("standard", "reference"):
        result = shake(scene, case.STILL, preset, shortcuts=False, initial=start, trajectory=True)
        sound(result, scene)
        assert not result.toppled
        assert abs(case.lean(result.trajectory)[-1]) < 1e-3


def test_a_release_at_1_001_alpha_falls_over():
    scene, b, h = case.block(18, 1.0)
    start = case.leaning(b, h, 1.001 * np.arctan2(b, h))
    for toward_deg in (0.0, 90.0, 180.0):
        turn = Rotation.from_euler("z", toward_deg, degrees=True)
        lean = turn * Rotation.from_quat(start["quaternion_xyzw"]) * turn.inv()
        turned = {"position_m": turn.apply(start["position_m"]), "quaternion_xyzw": lean.as_quat()}
        for preset in ("standard", "reference"):
            result = shake(scene, case.STILL, preset, shortcuts=False, initial=turned)
            assert result.toppled
            # It passed its balance before the start, where it has no way yet: its azimuth is that of the fall.
            off_deg = (result.falls_toward_deg - toward_deg + 180.0) % 360.0 - 180.0
            assert abs(off_deg) < 0.01  # 3e-6


@pytest.mark.parametrize("slope_deg", [5.0, float(np.rad2deg(np.arctan(0.6 * 0.99)))])
def test_a_rock_at_rest_on_a_slope_creeps_by_less_than_1e_4_of_its_height_in_a_minute(slope_deg):
    rock = box(0.5, 0.5, 0.4)
    scene = Scene.from_mesh(
        (rock.vertices_m, rock.faces), friction=0.6, slope_deg=slope_deg, slope_azimuth_deg=30
    )
    result = shake(scene, Motion(np.zeros((61, 3)), 1.0), shortcuts=False)
    sound(result, scene)
    assert result.slip_m < 1e-4 * 0.8
    assert result.outcome == "stands"


@pytest.mark.parametrize("frequency_hz", [20, 50])
def test_fast_shaking_at_two_g_does_not_topple_what_it_only_rattles(frequency_hz):
    scene = Scene.block(0.3, 0.3, 0.6, friction=0.8)
    time = np.arange(0, 2, 1 / 1000)
    wave = 2 * G * np.sin(2 * np.pi * frequency_hz * time) * np.hanning(len(time))
    result = shake(scene, case.along(0, wave, 1e-3), shortcuts=False)
    sound(result, scene)
    assert result.toppled is False


def test_ground_that_falls_away_throws_the_rock_and_catches_it():
    scene = Scene.block(0.5, 0.5, 0.5, friction=0.8)
    time = np.arange(0, 1, 0.005)
    wave = np.zeros((200, 3))
    wave[:, 2] = 1.8 * G * np.sin(2 * np.pi * 2 * time) * (time <= 1)
    result = shake(scene, Motion(wave, 0.005), shortcuts=False, trajectory=True)
    sound(result, scene)
    assert result.trajectory.position_m[:, 2].max() > 0.5 + 0.01  # it flew
    assert result.residual_tilt_deg < 0.1  # and landed flat: nothing in the plane acted on it
    assert result.slip_m < 1e-3


def raised_and_risen(scene, start, preset):
    """How far a rock that starts inside still ground is raised, and rises from there, over R; sound and standing."""
    result = shake(scene, case.STILL, preset, shortcuts=False, initial=start, trajectory=True)
    sound(result, scene)
    assert result.outcome == "stands"
    height = result.trajectory.position_m[:, 2]
    return (
        np.array([height[0] - start["position_m"][2], height.max() - height[0]]) / scene.rock.half_diagonal_m
    )


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("share", [0.0, 1e-3, -1e-3, -0.01, -0.05])
def test_a_start_in_contact_above_and_inside_settles(share, preset):
    scene = Scene.block(0.2, 0.2, 0.6, friction=0.8)
    start = {"position_m": (0.0, 0.0, 0.6 + share * scene.rock.height_m)}
    _, risen = raised_and_risen(scene, start, preset)
    assert risen < SINK  # a rock that starts inside is set on the ground, not shot out: 6e-11


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize(
    ("lean_deg", "deep_share"), [(0.02, 1.4e-4), (0.1, 7.1e-4), (1.0, 7.0e-3), (4.0, 2.65e-2)]
)
def test_a_leaning_start_with_its_corner_in_the_ground_falls_back(lean_deg, deep_share, preset):
    # Let out by the engine, it was shot up and toppled from 1 degree on.
    scene, lean = Scene.block(0.3, 0.3, 0.6), np.deg2rad(lean_deg)
    start = {"position_m": (0.0, 0.0, 0.6), "quaternion_xyzw": (0.0, np.sin(lean / 2), 0.0, np.cos(lean / 2))}
    raised, risen = raised_and_risen(scene, start, preset)
    assert raised == pytest.approx(deep_share, rel=0.03)
    assert risen < SINK


def test_a_start_inside_the_ground_retains_its_velocity():
    scene, speed_m_s = Scene.block(0.5, 0.5, 0.1, friction=0.5), 1.0
    start = {"position_m": (0.0, 0.0, 0.1 - 0.01), "velocity_m_s": (speed_m_s, 0.0, 0.0)}
    result = shake(scene, case.STILL, shortcuts=False, initial=start)
    sound(result, scene)
    assert result.slip_m == pytest.approx(
        speed_m_s**2 / (2.0 * 0.5 * G), rel=1e-4
    )  # 8e-6, as from the surface


def test_a_nearly_spherical_base_rocks_and_stays():
    rock = ellipsoid((0.5, 0.5, 0.45), 3)
    scene = Scene.from_mesh((rock.vertices_m, rock.faces), friction=0.8)
    result = shake(scene, record(3, 100, 0.15 * G, vertical=0.2), shortcuts=False)
    sound(result, scene)
    assert result.max_tilt_deg > 1.0
    assert not result.toppled


def rolled_on_its_rim(preset):
    """A prism that is set going at 14 of its 18 degrees, and what becomes of it."""
    rock, start = cylinder(0.2, 0.6, 48), case.rolling_start(0.2, 0.6, np.deg2rad(14))
    scene = Scene.from_mesh((rock.vertices_m, rock.faces), friction=case.GRIP)
    return scene, shake(scene, case.STILL, preset, initial=start)


def test_a_rock_that_rolls_on_round_its_rim_is_followed_until_it_cannot_overturn():
    # Nothing in rigid contact resists rolling: the prism long keeps what overturns it.
    scene, result = rolled_on_its_rim("fast")
    sound(result, scene)
    assert result.simulated_s > 60 * np.sqrt(scene.rock.half_diagonal_m / G)
    assert not result.toppled


def test_a_rock_whose_fate_is_open_at_the_cap_is_undecided():
    soon = replace(PRESETS["fast"].termination, calmed_after=0.0, cap_after=3.0)
    _, result = rolled_on_its_rim(replace(PRESETS["fast"], termination=soon))
    assert (result.status, result.ended_by) == ("undecided", "time_cap")
    assert (result.outcome, result.toppled, result.topple_time_s) == (None, None, None)


def test_a_thin_disk_stays_flat():
    rock = cylinder(1.0, 0.02, 64)
    scene = Scene.from_mesh((rock.vertices_m, rock.faces), friction=0.6)
    result = shake(scene, record(4, 100, 0.9 * G), shortcuts=False)
    sound(result, scene)
    assert result.max_tilt_deg < 1.0
    assert not result.toppled


def with_sliver(vertices, faces, face, width_share):
    """The mesh with a sliver along the first edge of a face, whose other triangle is split at the sliver's vertex.

    The vertex lies half along the edge, and off it by a share of its way to the split triangle's far corner.
    """
    a, b, _ = faces[face]
    other = next(i for i, (p, q, r) in enumerate(faces) if (b, a) in ((p, q), (q, r), (r, p)))
    far = next(corner for corner in faces[other] if corner not in (a, b))
    on_edge = 0.5 * (vertices[a] + vertices[b])
    new, middle = len(vertices), on_edge + width_share * (vertices[far] - on_edge)
    remaining = np.delete(faces, other, axis=0)
    return np.vstack([vertices, middle]), np.vstack([remaining, [[b, new, far], [new, a, far], [b, a, new]]])


def test_slivers_and_duplicate_vertices_change_nothing():
    rock = box(0.2, 0.3, 0.6)
    fine = trimesh.Trimesh(rock.vertices_m, rock.faces, process=False).subdivide()
    vertices, faces = fine.vertices, fine.faces
    for face, width_share in ((0, 1e-6), (9, 1e-9), (18, 0.0)):
        vertices, faces = with_sliver(vertices, faces, face, width_share)
    copies = len(vertices) * (np.arange(len(faces)) % 2)[:, None]
    split, on_copies = np.vstack([vertices, vertices]), faces + copies
    motion = record(3, 100, 0.5 * G)
    plain, hard = (
        shake(Scene.from_mesh(mesh, friction=0.8), motion, shortcuts=False)
        for mesh in ((rock.vertices_m, rock.faces), (split, on_copies))
    )
    assert plain.max_tilt_deg > 1.0
    assert plain.outcome == hard.outcome
    # The order of the corners, in which their contacts are solved, differs: 2e-5. In the same order 1e-10.
    assert plain.max_tilt_deg == pytest.approx(hard.max_tilt_deg, rel=2e-4)


@pytest.mark.slow
def test_a_record_of_300_seconds_leaves_a_standing_rock_where_it_stood():
    scene = Scene.block(0.5, 0.5, 0.6, friction=0.8)
    result = shake(scene, record(300, 100, 0.3 * G), shortcuts=False)
    sound(result, scene)
    assert result.outcome == "stands"
    assert result.slip_m < 1e-4


def test_the_records_sampling_rate_does_not_decide():
    scene = Scene.block(0.2, 0.2, 0.6, friction=0.8)
    tilts = []
    for rate in (20, 100, 800):
        time = np.arange(int(2 * rate) + 1) / rate
        coarse = np.interp(
            time, np.arange(41) / 20, 4.5 * np.sin(np.pi * np.arange(41) / 10) * np.hanning(41)
        )
        result = shake(scene, case.along(0, coarse, 1 / rate), shortcuts=False)
        sound(result, scene)
        tilts.append(result.max_tilt_deg)
    assert tilts == pytest.approx([tilts[1]] * 3, rel=5e-3)


def test_without_friction_the_ground_slides_away_under_the_rock():
    scene = Scene.block(0.5, 0.5, 0.5, friction=0.0)
    step = 0.01
    wave = np.concatenate([np.full(50, 2.0), np.full(50, -2.0), [0.0]])
    motion = case.along(0, wave, step)
    result = shake(scene, motion, shortcuts=False, trajectory=True)
    fine = np.linspace(0.0, 0.9, 9001)
    ground = np.trapezoid(motion.velocity_at(fine)[:, 0], fine)
    end = np.interp(0.9, result.trajectory.time_s, result.trajectory.position_m[:, 0])
    assert end == pytest.approx(-ground, rel=1e-4)
    assert result.max_tilt_deg < 0.01


def test_a_friction_of_ten_never_slips_under_a_weak_motion():
    scene = Scene.block(0.5, 0.5, 0.5, friction=10.0)
    result = shake(scene, record(4, 100, 0.9 * G), shortcuts=False)
    sound(result, scene)
    assert result.slip_m < 1e-4


@pytest.mark.parametrize("time_step", [pytest.param(0.00025, marks=pytest.mark.slow), 0.001, 0.004, 0.008])
def test_every_time_step_is_stable_or_refused_with_a_reason(time_step):
    scene = Scene.block(0.2, 0.2, 0.6, friction=0.8)
    sound(shake(scene, record(3, 100, 0.45 * G), time_step=time_step, shortcuts=False), scene)


@pytest.mark.parametrize("down_m_s", [0.1, 0.6 * landing_boundary(3.0, 0.6), 1.0])
def test_a_landing_never_stretches_a_step(down_m_s):
    scene = Scene.block(0.2, 0.2, 0.6, friction=0.6)
    start = {"velocity_m_s": (0.5, 0.0, -down_m_s)}
    result = shake(scene, case.STILL, shortcuts=False, initial=start, trajectory=True)
    assert np.diff(result.trajectory.time_s).max() < 2.0 * result.time_step_s
    assert result.status == "ok"


@pytest.mark.parametrize(
    ("velocity_m_s", "limit_m_s"), [((np.nan, 0.0, 0.0), np.inf), ((0.0, 0.0, 5.0), 4.9)]
)
def test_a_state_that_is_not_finite_or_too_fast_ends_as_diverged_never_as_toppled(
    velocity_m_s, limit_m_s, monkeypatch
):
    scene = Scene.block(0.2, 0.2, 0.6)
    start, settings = State(velocity_m_s=velocity_m_s), PRESETS["fast"]
    step_s = settings.time_step_s(scene.rock.half_diagonal_m, G)
    dropped = partial(shake, scene, case.STILL, "fast", initial={"position_m": (0, 0, 0.7)}, trajectory=True)
    before = dropped()
    problem = Problem(scene, case.STILL, settings, step_s, start, False)
    shaking = Shaking(problem, engine_named(DEFAULT).steps(problem))
    with monkeypatch.context() as patched:
        # Nothing that a caller may ask for makes the engine faster than its own.
        patched.setattr(Problem, "speed_limit_m_s", limit_m_s)
        result = shaking.result(shaking.run(), trajectory=False)
    assert (result.status, result.toppled, result.outcome) == ("diverged", None, None)
    after = dropped()  # it fell through the ground of a world that had held a rock without a place
    assert after.outcome == before.outcome == "stands"
    np.testing.assert_array_equal(after.trajectory.position_m, before.trajectory.position_m)


@pytest.mark.slow
def test_random_strong_shaking_respects_its_steps_and_its_surface():
    rng = np.random.default_rng(1)
    stretched, diverged, deepest = 0, 0, 0.0
    for seed in range(40):
        scene = Scene.block(*rng.uniform(0.15, 0.4, 2), rng.uniform(0.4, 0.8), friction=rng.uniform(0.3, 1.2))
        peak, frequency, vertical = rng.uniform(0.4, 1.5) * G, rng.uniform(1, 5), rng.uniform(0, 0.8)
        motion = record(4, 100, peak, frequency, seed=seed, vertical=vertical)
        result = shake(scene, motion, shortcuts=False, trajectory=True)
        path = result.trajectory
        # A rest has one step; where it ends the rock is set on its surface.
        moved = np.abs(np.diff(path.position_m, axis=0)).max(axis=1) > 1e-6 * scene.rock.half_diagonal_m
        stretched += np.diff(path.time_s)[moved].max(initial=0.0) > 2.0 * result.time_step_s
        diverged += result.status == "diverged"
        deepest = max(deepest, result.penetration_m / scene.rock.half_diagonal_m)
    assert (stretched, diverged) == (0, 0)
    assert deepest <= SINK
