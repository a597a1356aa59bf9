"""The engine in three dimensions: wobble, free bodies, invariances, restitution, energy, determinism."""

import engine_cases as case
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.models.shapes import box
from toppling.workers.shaking import shake

G = case.G
ROCK = box(0.2, 0.3, 0.6)
TIMES = np.linspace(0.0, 1.4, 15)


def shaking(scale=1.0):
    """A smooth three-component motion that makes the block rock, slide and turn."""
    t = np.arange(100) * 0.01
    waves = [3.4 * np.sin(9 * t) + np.sin(23 * t), 2.5 * np.sin(7 * t + 1), 1.5 * np.sin(11 * t)]
    return scale * 1.6 * np.column_stack(waves) * np.hanning(100)[:, None]


def state(mesh, acceleration, preset="standard", time_step=0.01, times=TIMES, friction=0.9):
    """Horizontal up axis and place (k, 3 + 2) at times."""
    scene = Scene.from_mesh(mesh, friction=friction)
    result = shake(scene, Motion(acceleration, time_step), preset, trajectory=True, shortcuts=False)
    path = result.trajectory
    up = Rotation.from_quat(path.quaternion_xyzw).apply([0, 0, 1])
    columns = np.column_stack([up[:, :2], path.position_m])
    return np.column_stack([np.interp(times, path.time_s, column) for column in columns.T])


@pytest.fixture(scope="module")
def plain():
    return state((ROCK.vertices_m, ROCK.faces), shaking())


def test_a_mirrored_record_and_rock_give_the_mirrored_motion(plain):
    mirror = np.array([1, -1, 1])
    mirrored = state((ROCK.vertices_m * mirror, ROCK.faces[:, ::-1]), shaking() * mirror)
    mirrored[:, [1, 3]] *= -1
    # The order in which contacts are solved is not mirrored: 5e-7 here.
    assert np.abs(mirrored - plain).max() < 1e-4


SLIDES = {
    "a plate of 1:3": (case.plate((0.5, 1.5, 0.05)), 30),
    "a turned cube": (case.plate((0.3, 0.3, 0.3), 20), 0),
    "a tall turned block": (case.plate((0.25, 0.4, 0.6), 50), 10),
    "a boulder": (case.boulder(), 250),
}


@pytest.mark.parametrize("name", SLIDES)
@pytest.mark.parametrize("preset", ["fast", "standard", "reference"])
def test_a_sliding_rock_goes_straight_and_as_far_as_its_friction_lets_it_in_any_direction(preset, name):
    # Measured 2.5e-5 with fast; along axes of friction that stayed, the plate ended a quarter of its way beside.
    assert case.sliding_error(*SLIDES[name], preset) < 1e-4


@pytest.mark.parametrize("friction", [0.35, 0.9])
@pytest.mark.parametrize("azimuth_deg", [37.3, 90])
def test_scene_and_record_turned_together_give_the_same_motion_turned(azimuth_deg, friction):
    turn = Rotation.from_euler("z", azimuth_deg, degrees=True).as_matrix()
    plain = state((ROCK.vertices_m, ROCK.faces), shaking(), friction=friction)
    turned = state((ROCK.vertices_m @ turn.T, ROCK.faces), shaking() @ turn.T, friction=friction)
    back = turned.copy()
    back[:, :2], back[:, 2:4] = turned[:, :2] @ turn[:2, :2], turned[:, 2:4] @ turn[:2, :2]
    # The axes of friction turn too, but for those of the very first step and what they are kept within: 1e-6 here.
    assert np.abs(back - plain).max() < 1e-4


@pytest.mark.parametrize("scale", [0.25, 4.0])
def test_length_times_s_and_time_times_root_s_give_the_same_angles(plain, scale):
    root = np.sqrt(scale)
    scaled = state(
        (ROCK.vertices_m * scale, ROCK.faces), shaking(), time_step=0.01 * root, times=TIMES * root
    )
    scaled[:, 2:] /= scale
    # The preset's step scales too, and powers of four without rounding; Bullet takes slip below 1e-8 m/s for none.
    assert np.abs(scaled - plain).max() < 1e-6


def test_a_slow_vertical_acceleration_is_another_gravity():
    # Ground that falls at g/2 all the time: the rock rocks as under g/2.
    time_step, b, h = 0.01, 0.2, 0.6
    start = case.leaning(b, h, 0.15)
    falling = Motion(np.tile([0, 0, -G / 2], (100, 1)), time_step)
    directions = [
        shake(scene, motion, trajectory=True, shortcuts=False, initial=start, time_step=0.001).trajectory
        for scene, motion in (
            (Scene.block(b, b, h, friction=5.0), falling),
            (Scene.block(b, b, h, friction=5.0, gravity=G / 2), case.STILL),
        )
    ]
    times = np.linspace(0.05, 0.9, 10)
    first, second = (np.interp(times, entry.time_s, case.lean(entry)) for entry in directions)
    assert np.abs(first - second).max() < 2e-4


@pytest.mark.parametrize(
    ("preset", "radius", "half_height", "tilt_deg", "target"),
    [
        pytest.param("standard", 0.2, 0.6, 10, 0.01, marks=pytest.mark.slow),
        pytest.param("reference", 0.2, 0.6, 10, 0.003, marks=pytest.mark.slow),
        pytest.param("standard", 0.2, 0.02, 10, 0.01, marks=pytest.mark.slow),
        pytest.param("reference", 0.2, 0.02, 10, 0.003, marks=pytest.mark.slow),
        pytest.param("standard", 2.0, 2.0, 5, 0.01, marks=pytest.mark.slow),
    ],
)
def test_a_cylinder_wobbles_at_the_exact_rate(preset, radius, half_height, tilt_deg, target):
    sides = 256 if preset == "standard" else 512
    assert abs(case.wobble_error(radius, half_height, tilt_deg, preset, sides)) < target


@pytest.mark.parametrize("preset", ["standard", "reference"])
def test_a_body_free_of_torque_tumbles_by_eulers_equations(preset):
    # Spun about its intermediate axis with a small disturbance, on a flight high above the ground.
    sides = np.array([0.6, 0.4, 0.2])  # half sizes; the intermediate axis is y
    inertia = (np.sum(sides**2) - sides**2) / 3
    spin = np.array([0.05, 8.0, 0.02])
    scene = Scene.block(*sides)
    start = {"position_m": (0, 0, 20.0), "angular_velocity_rad_s": spin}
    path = shake(scene, case.STILL, preset, trajectory=True, shortcuts=False, initial=start).trajectory

    def euler(_, y):
        rate, turn = y[:3], y[3:].reshape(3, 3)
        return [*(-np.cross(rate, inertia * rate) / inertia), *np.cross(turn, rate).ravel()]

    end = float(path.time_s[-1])
    start = [*spin, *np.eye(3).ravel()]
    exact = solve_ivp(euler, (0, end), start, rtol=1e-10, atol=1e-12, t_eval=[end]).y[3:, -1].reshape(3, 3)
    off = (Rotation.from_quat(path.quaternion_xyzw[-1]) * Rotation.from_matrix(exact).inv()).magnitude()
    # The shake ends where a look finds the tilt past return, after 80 (reference) to 130 degrees of a turn; off by 7e-6
    # and 4e-5.
    assert off < 2e-4
    assert np.linalg.norm(path.position_m[-1] - [0, 0, 20 - 0.5 * G * end**2]) < 2e-3


def landings(half_sizes, preset, *, on_a_corner):
    """Errors of six landings that slip on, of random turns and directions."""
    random = np.random.default_rng(5)
    errors = []
    while len(errors) < 6:
        turn = Rotation.from_rotvec([0.0, random.uniform(0.2, 0.5), 0.0])
        if on_a_corner:
            turn = Rotation.from_euler("zx", [random.uniform(0.0, 6.0), random.uniform(0.2, 0.5)]) * turn
            lowest, second, *_ = np.sort(turn.apply(Scene.block(*half_sizes).rock.vertices_m)[:, 2])
            if second - lowest < 0.01:
                continue  # nearly on an edge
        toward, speed = random.uniform(0.0, 2.0 * np.pi), random.uniform(0.5, 2.0)
        velocity = np.array([speed * np.cos(toward), speed * np.sin(toward), -1.5])
        error = case.landing_error(half_sizes, turn, velocity, 0.3, 0.5, preset)
        errors += [] if error is None else [error]
    return errors


SLAB, PLATE, BEAM = (0.1, 0.5, 0.3), (0.3, 0.3, 0.1), pytest.param((0.5, 0.15, 0.3), marks=pytest.mark.slow)


@pytest.mark.parametrize("half_sizes", [SLAB, pytest.param(PLATE, marks=pytest.mark.slow), BEAM])
@pytest.mark.parametrize("preset", ["fast", "standard", pytest.param("reference", marks=pytest.mark.slow)])
def test_a_corner_that_lands_and_slips_on_gets_the_impulse_of_newton_and_coulomb(half_sizes, preset):
    errors = landings(half_sizes, preset, on_a_corner=True)
    assert max(np.abs(turned).max() for _, _, turned in errors) > 0.5  # the impact turns the slip
    for lean, size, _ in errors:
        # The impact's step has .06 of a step's gravity and friction: 5e-4 of the impulse.
        assert abs(lean) < 2e-3
        assert abs(size) < 1e-3


@pytest.mark.parametrize("half_sizes", [SLAB, PLATE, BEAM])
@pytest.mark.parametrize("preset", ["standard", pytest.param("reference", marks=pytest.mark.slow)])
def test_an_edge_that_lands_and_slips_on_gets_the_impulse_of_newton_and_coulomb(half_sizes, preset):
    for lean, size, _ in landings(half_sizes, preset, on_a_corner=False):
        # Its two feet slip in directions that differ by up to 20 degrees, and one pair of axes serves both.
        assert abs(lean) < np.deg2rad(5.0)
        assert abs(size) < 0.04


@pytest.mark.parametrize("restitution", [0.5, 0.9])
@pytest.mark.parametrize("preset", ["fast", "standard", "reference"])
def test_a_block_rebounds_from_any_fall_by_newtons_restitution(preset, restitution):
    # One fall takes sqrt(R / g), a whole number of steps: its touch is a step's end.
    half = np.array([0.2, 0.2, 0.6])
    scene = Scene.block(*half, friction=0.8, restitution=restitution)
    for fall_m in np.array([1e-3, 5e-3, 0.02, 0.1, 0.3, 0.5]) * scene.rock.half_diagonal_m:
        start = {"position_m": (0.0, 0.0, half[2] + fall_m)}
        path = case.let_go(scene, start, preset).trajectory
        after = path.time_s > np.sqrt(2 * fall_m / G)
        time, above = path.time_s[after], path.position_m[after, 2] - half[2]
        top = above.argmax()
        around = slice(top - 1, top + 2)  # between samples: the slowest rebound takes seven steps of `fast`
        rise = np.polyfit(time[around] - time[top], above[around], 2)
        assert np.polyval(rise, -0.5 * rise[1] / rise[0]) / fall_m == pytest.approx(restitution**2, rel=1e-6)


@pytest.mark.parametrize("alpha_deg", [5, 18, 40])
def test_energy_never_grows_in_free_rocking(alpha_deg):
    scene, b, h = case.block(alpha_deg, 1.0)
    alpha = np.arctan2(b, h)
    result = shake(
        scene, case.STILL, trajectory=True, shortcuts=False, initial=case.leaning(b, h, 0.8 * alpha)
    )
    path, step = result.trajectory, result.time_step_s
    # A step with a landing in it has two velocities.
    whole = np.flatnonzero(abs(np.diff(path.time_s) - step) < 1e-9) + 1
    swings = np.sign(case.lean(path))
    whole = whole[
        (whole > 1) & (swings[whole] == swings[whole - 1]) & (swings[whole - 1] == swings[whole - 2])
    ]
    energy = np.array([case.energy_before(scene, path, sample) for sample in whole])
    barrier = G * 1.0 * (1.0 - np.cos(alpha))
    # The scheme keeps energy to the second order of the step: at most 3.3e-4 measured.
    assert (energy - np.minimum.accumulate(energy)).max() < 5e-4 * barrier
    peaks = np.array(case.swing_peaks(case.lean(path)))
    peaks = peaks[peaks > 1e-4 * alpha]  # smaller ones lie between two samples
    assert len(peaks) > 2
    assert (np.diff(peaks) < 0).all()
    assert result.outcome in {"stands", "moved"}


@pytest.mark.parametrize(
    ("azimuth_deg", "coarse", "fine"),
    [
        (10.0, "fast", "standard"),
        pytest.param(10.0, "fast", "reference", marks=pytest.mark.slow),
        pytest.param(351.0, "fast", "standard", marks=pytest.mark.slow),
        pytest.param(351.0, "standard", "reference", marks=pytest.mark.slow),
        pytest.param(
            317.0, "standard", "reference", marks=pytest.mark.slow
        ),  # over the middle of a side: falls flat
        pytest.param(75.0, "standard", "reference", marks=pytest.mark.slow),
        pytest.param(200.0, "standard", "reference", marks=pytest.mark.slow),
    ],
)
def test_a_base_of_many_corners_rattles_to_the_same_energy_at_every_step(azimuth_deg, coarse, fine):
    # Ten and more corners land within a tenth of sqrt(R / g), several in one step of the coarse presets. Measured:
    # within 1.1e-3 of the barrier; steps that did not resolve each landing were 0.02 to 0.17 off.
    remaining = [case.rattling_energy(29, azimuth_deg, preset) for preset in (coarse, fine)]
    assert remaining[0] == pytest.approx(remaining[1], abs=4e-3)


JUST_LIFTING_HZ = np.concatenate([np.linspace(4.0, 6.0, 20), np.linspace(8.0, 10.0, 20)])


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["fast", "standard"])
def test_rocks_that_are_just_lifted_come_to_rest_no_sooner_than_with_short_steps(preset):
    # Which of them rock on is chance: falling flat, what is kept goes by the order in which the corners land.
    tilt, exact = (
        np.array([case.largest_tilt_of_a_pentagon(frequency, value) for frequency in JUST_LIFTING_HZ])
        for value in (preset, "reference")
    )
    rests, should = (np.sum(value < 0.05) for value in (tilt, exact))
    assert abs(rests - should) < 2.5 * np.sqrt(rests + should)  # of the difference of two counts, 1.2 %
    rocks, should = (np.log(entry[entry >= 0.05]) for entry in (tilt, exact))
    error = np.hypot(rocks.std() / np.sqrt(len(rocks)), should.std() / np.sqrt(len(should)))
    assert abs(rocks.mean() - should.mean()) < 2.5 * error
