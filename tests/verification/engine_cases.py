"""Cases with exact answers, run through the engine: each returns the engine's relative error."""

from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
import trimesh
from reference import closed_forms as exact
from reference.rocking import Ground, PlaneBody, overturns
from reference.rocking import rock as rock_in_plane
from reference.sliding_rocking import slide_and_rock
from scipy.optimize import fsolve
from scipy.spatial.transform import Rotation

from toppling.models.frames import azimuth_deg, horizontal_unit_vector
from toppling.models.motions.motion import Motion
from toppling.models.pedestal import ContactProperties, Pedestal
from toppling.models.scene import Scene
from toppling.models.shapes import box, cylinder
from toppling.workers.engines import options_of
from toppling.workers.shaking import shake

G = 9.81
GRIP = 10.0  # friction that holds the corner in every rocking case
STILL = Motion(np.zeros((2, 3)), 1e-3)


def block(alpha_deg, half_diagonal, friction=GRIP, restitution=0.0):
    b, h = half_diagonal * np.sin(np.deg2rad(alpha_deg)), half_diagonal * np.cos(np.deg2rad(alpha_deg))
    return Scene.block(b, b, h, friction=friction, restitution=restitution), b, h


def leaning(b, h, angle, rate=0.0):
    """A block that stands on its right corner at x = b, leaning toward +x."""
    c, s = np.cos(angle), np.sin(angle)
    arm = np.array([-b * c + h * s, 0.0, b * s + h * c])
    return {
        "position_m": np.array([b, 0, 0]) + arm,
        "quaternion_xyzw": (0.0, np.sin(angle / 2), 0.0, np.cos(angle / 2)),
        "velocity_m_s": rate * np.array([arm[2], 0.0, -arm[0]]),
        "angular_velocity_rad_s": (0.0, rate, 0.0),
    }


def let_go(scene, start, preset, motion=STILL, **settings):
    """A shake from this start, without shortcuts, with the rock's way."""
    return shake(scene, motion, preset, trajectory=True, shortcuts=False, initial=start, **settings)


def turning_about(scene, corner, spin):
    """The rock where the scene has it, turning about a corner."""
    com = scene.rock.com_m
    return {"position_m": com, "angular_velocity_rad_s": spin, "velocity_m_s": np.cross(spin, com - corner)}


def energy_before(scene, trajectory, sample):
    """Energy over mass in the middle of the step that leads to a sample; heights count from the scene's pose."""
    step = trajectory.time_s[sample] - trajectory.time_s[sample - 1]
    before, after = trajectory.position_m[sample - 1 : sample + 1]
    turned_from, turned_to = Rotation.from_quat(trajectory.quaternion_xyzw[sample - 1 : sample + 1])
    speed, spin = (after - before) / step, (turned_to * turned_from.inv()).as_rotvec() / step
    inertia = turned_to.as_matrix() @ scene.rock.inertia_per_mass_m2 @ turned_to.as_matrix().T
    height = 0.5 * (before[2] + after[2]) - scene.rock.com_m[2]
    return 0.5 * speed @ speed + 0.5 * spin @ inertia @ spin + G * height


def energy_j_kg(shaking):
    """Energy over mass of each pose of a shake on ground at rest; heights count from the support frame's origin."""
    sim, count = shaking.sim, shaking.last + 1
    velocity, height_m = (
        sim.velocity[:count],
        sim.pose[:count, :3] @ shaking.problem.contact.scene_from_support[2],
    )
    spin = Rotation.from_quat(sim.pose[:count, 3:]).inv().apply(velocity[:, 3:])
    return 0.5 * ((velocity[:, :3] ** 2).sum(axis=1) + spin**2 @ sim.inertia_m2) + G * height_m


def lean(trajectory):
    """Angle (n,) toward +x of a motion in the plane y = 0."""
    q = trajectory.quaternion_xyzw
    angle = 2 * np.arctan2(q[:, 1], q[:, 3])
    return (angle + np.pi) % (2 * np.pi) - np.pi


def free_rocking(alpha_deg, half_diagonal, share, preset, **settings):
    """Relative errors of the time to the first impact, its ratio c_v and the energy it loses, 1 - c_v^2.

    The ratio is read off the peaks before and after the impact: between impacts the energy is kept.
    """
    scene, b, h = block(alpha_deg, half_diagonal)
    alpha, p = np.arctan2(b, h), exact.rocking_frequency(b, h)
    result = let_go(scene, leaning(b, h, share * alpha), preset, **settings)
    time, angle = result.trajectory.time_s, lean(result.trajectory)
    time_error = first_landing(time, angle) / exact.free_rocking_time_s(alpha, p, share) - 1
    peaks = swing_peaks(angle)
    if not peaks:
        return time_error, np.nan, np.nan
    ratio, top = exact.impact_ratio(b, h), np.cos(alpha)
    remaining = np.sqrt((np.cos(alpha - peaks[0]) - top) / (np.cos(alpha * (1 - share)) - top))
    return time_error, remaining / ratio - 1, (1 - remaining**2) / (1 - ratio**2) - 1


def small_swing_errors(share, preset, swings=8):
    """Error of each swing's peak over that of the swing before, for a block of alpha 18.4 degrees let go at `share`.

    While a block swings at a hundredth of alpha, few steps lie between two landings. NaN for swings that do not come.
    """
    scene, b, h = block(18.4349, 0.632)
    start = share * np.arctan2(b, h)
    peaks = swing_peaks(lean(let_go(scene, leaning(b, h, start), preset).trajectory))[:swings]
    found = np.full(swings + 1, np.nan)
    found[: len(peaks) + 1] = start, *peaks
    pieces = rock_in_plane(PlaneBody.rectangle(b, h), Ground.still(), 10.0, start).pieces[1 : swings + 1]
    exact_peaks = [np.abs(swing(np.linspace(begin, end, 400))[0]).max() for begin, end, swing in pieces]
    exact_peaks = np.array([start, *exact_peaks])
    return (found[1:] / found[:-1]) / (exact_peaks[1:] / exact_peaks[:-1]) - 1


def rebound_error(alpha_deg, restitution, preset, share=0.5):
    """Errors of what a block, released at `share` of alpha, does just after its first impact.

    First its lean over alpha, then the relative error of the rise of its centre of mass, half way to where its corner
    lands again: until then it flies, with the velocity that an impact without restitution leaves and, times the
    restitution, the change to that.
    """
    scene, b, h = block(alpha_deg, 1.0, restitution=restitution)
    alpha, p = np.arctan2(b, h), exact.rocking_frequency(b, h)
    lands_s = exact.free_rocking_time_s(alpha, p, share)
    path = let_go(scene, leaning(b, h, share * alpha), preset).trajectory
    spin = -p * np.sqrt(2.0 * (np.cos(alpha * (1.0 - share)) - np.cos(alpha)))
    # Up: about its right corner before, about its left one after an impact that takes what it can.
    up = np.array([-b * spin, b * exact.impact_ratio(b, h) * spin])
    spins = np.array([spin, exact.impact_ratio(b, h) * spin])
    spin, up = (
        (1.0 + restitution) * after - restitution * before for before, after in (spins, -up * [1.0, 1.0])
    )
    time_s = np.linspace(0.0, 0.2 * lands_s, 2001)[1:]
    above_m = h + up * time_s - 0.5 * G * time_s**2 - b * np.sin(-spin * time_s) - h * np.cos(spin * time_s)
    lands_again_s = time_s[np.argmax(np.append(above_m[:-1] <= 0.0, [True]))]
    at = int(np.searchsorted(path.time_s, lands_s + 0.5 * lands_again_s))
    flight_s = path.time_s[at] - lands_s
    rise_m = up * flight_s - 0.5 * G * flight_s**2
    return ((lean(path)[at] - spin * flight_s) / alpha, (path.position_m[at, 2] - h) / rise_m - 1.0)


def first_landing(time, angle):
    """Zero of the angle, from the samples before it; never where it does not land."""
    landed = np.flatnonzero(angle <= 0)
    if len(landed) == 0:
        return np.inf
    before = slice(landed[0] - 4, landed[0])  # a cubic of time over angle through four samples meets zero
    centre, spread = angle[before].mean(), np.ptp(angle[before])
    return float(np.polyval(np.polyfit((angle[before] - centre) / spread, time[before], 3), -centre / spread))


def swing_peaks(angle):
    """Peaks between landings, by a parabola through the highest samples."""
    size, sign = np.abs(angle), np.sign(angle)
    turns = np.flatnonzero(sign[1:] * sign[:-1] < 0) + 1
    peaks = []
    for start, end in pairwise(turns):
        top = start + int(np.argmax(size[start:end]))
        below, at, above = size[top - 1 : top + 2]
        bend = below - 2 * at + above
        peaks.append(float(at - (above - below) ** 2 / (8 * bend)) if bend < 0 else float(at))
    return peaks


def many_corners_error(corners, preset, start_deg=13.0, radius=3.0, half_angle_deg=6.0, **settings):
    """Error of the energy that is left after one swing of a body on `corners` corners that lie on an arc.

    The body is let go at rest on its last corner and rolls, impact by impact, over all of them to its first.
    """
    angle = np.deg2rad(np.linspace(-half_angle_deg, half_angle_deg, corners))
    base = radius * np.column_stack([np.sin(angle), 1 - np.cos(angle)])
    base[:, 1] -= base[:, 1].min()
    profile = np.vstack([base, [[base[-1, 0], 2.0], [base[0, 0], 2.0]]])
    mesh = trimesh.convex.convex_hull(np.vstack([np.insert(profile, 1, y, axis=1) for y in (-0.4, 0.4)]))
    scene = Scene.from_mesh((mesh.vertices, mesh.faces), friction=GRIP)
    lean_rad, com = np.deg2rad(start_deg), scene.rock.com_m
    feet = base - com[[0, 2]]
    arm = -turned(feet[-1], lean_rad)
    start = {
        "position_m": (base[-1, 0] + arm[0], 0.0, arm[1]),
        "quaternion_xyzw": (0.0, np.sin(lean_rad / 2), 0.0, np.cos(lean_rad / 2)),
    }
    result = let_go(scene, start, preset, **settings)
    angles, height = lean(result.trajectory), result.trajectory.position_m[:, 2]
    across = np.flatnonzero(angles < 0)
    if len(across) == 0:
        return np.nan
    back = np.flatnonzero(angles[across[0] :] > 0)
    swing = slice(0, across[0] + back[0] if len(back) else None)
    left = G * (height[swing][np.argmin(angles[swing])] - com[2])
    return float(
        left / (energy_after_rolling(feet, scene.rock.inertia_per_mass_m2[1, 1], lean_rad) - G * com[2]) - 1
    )


def turned(arm, angle):
    """A vector (x, z) of the body, leaning by an angle toward +x."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([arm[0] * c + arm[1] * s, arm[1] * c - arm[0] * s])


def energy_after_rolling(feet, inertia, angle):
    """Energy over mass of a body let go at rest on the last of its feet (n, 2), after the impact on the first.

    Feet are seen from the centre of mass, the energy counts from where they touch. At each impact the angular momentum
    about the new foot is kept: (I + r_new . r_old) / (I + r_new^2) of the angular velocity remains.
    """
    energy = -G * turned(feet[-1], angle)[1]
    for new, old in zip(feet[-2::-1], feet[:0:-1], strict=True):
        landing = np.arctan2(*(old - new)[::-1])
        height = -turned(old, landing)[1]
        speed = np.sqrt(2 * (energy - G * height) / (inertia + old @ old))
        speed *= (inertia + new @ old) / (inertia + new @ new)
        energy = G * height + 0.5 * (inertia + new @ new) * speed**2
    return energy


def least(overturning, low, high, steps):
    for _ in range(steps):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if overturning(middle) else (middle, high)
    return 0.5 * (low + high)


def threshold_error(scene, motion_of, reference, preset, toward=None, span=0.02, resolution=1e-4, **settings):
    """Error of the least amplitude that overturns, by bisection about the exact one; +-span where outside."""

    def topples(share):
        result = shake(scene, motion_of(share * reference), preset, shortcuts=False, **settings)
        assert result.status == "ok", result
        if toward is None or not result.toppled:
            return result.toppled
        return np.cos(np.deg2rad(result.falls_toward_deg - toward)) > 0

    if topples(1 - span):
        return -span
    if not topples(1 + span):
        return span
    return least(topples, 1 - span, 1 + span, int(np.ceil(np.log2(2 * span / resolution)))) - 1


def along(azimuth_deg, values, time_step):
    return Motion(np.asarray(values)[:, None] * horizontal_unit_vector(azimuth_deg), time_step)


def topples_at_m_s2(scene, azimuth_deg, knots_s, levels_m_s2, **settings):
    """Acceleration at which a rock topples under one that rises through such levels, or None."""
    time_s = np.arange(0.0, knots_s[-1], 0.01)
    ramp = np.interp(time_s, knots_s, levels_m_s2)
    shaken = shake(scene, along(azimuth_deg, ramp, 0.01), "fast", **settings)
    return np.interp(shaken.topple_time_s, time_s, ramp) if shaken.toppled else None


def periods_s(time_s, swing):
    """Times from one fall of a swing through zero to the next."""
    before = np.flatnonzero((swing[:-1] > 0.0) & (swing[1:] <= 0.0))
    return np.diff(
        time_s[before] + np.diff(time_s)[before] * swing[before] / (swing[before] - swing[before + 1])
    )


def full_sine_error(
    alpha_deg, half_diagonal, frequency_share, preset, branch="no impact", azimuth=0.0, **settings
):
    """Error of the threshold of a full sine of angular frequency `frequency_share` p."""
    scene, b, h = block(alpha_deg, half_diagonal)
    period = 2 * np.pi / (frequency_share * exact.rocking_frequency(b, h))
    return sine_threshold_error(scene, PlaneBody.rectangle(b, h), period, branch, azimuth, preset, **settings)


def many_contacts_error(sides, leading, preset, **settings):
    """Error of the threshold of a full sine for a prism of many sides, radius 0.2 and half height 0.6 m.

    The motion goes toward the middle of an edge, or toward a vertex, of the base: the prism turns about it in a plane.
    Its angular frequency is 2 p for an edge; 4 p for a vertex, on which it cannot stand for long.
    """
    rock = cylinder(0.2, 0.6, sides)
    scene = Scene.from_mesh((rock.vertices_m, rock.faces), friction=GRIP)
    feet = scene.rock.vertices_m[scene.rock.vertices_m[:, 2] < 1e-9]
    azimuth = azimuth_deg(feet[0]) + (180.0 / sides if leading == "edge" else 0.0)
    toward = horizontal_unit_vector(azimuth)
    axis = np.cross([0.0, 0.0, 1.0], toward)
    body = PlaneBody(
        (feet @ toward).max(),
        -(feet @ toward).min(),
        scene.rock.com_m[2],
        axis @ scene.rock.inertia_per_mass_m2 @ axis,
    )
    p = np.sqrt(G * body.arm_m(1) / body.inertia_about_corner_m2(1))
    period = 2 * np.pi / ((2.0 if leading == "edge" else 4.0) * p)
    return sine_threshold_error(scene, body, period, "no impact", azimuth, preset, **settings)


def sine_threshold_error(scene, body, period, branch, azimuth, preset, **settings):
    """Error of the least full sine that overturns a rock whose motion in the plane of an azimuth is that of `body`."""
    unit, reference = G * body.right_m / body.height_m, full_sine_threshold(body, period, branch)

    def motion_of(ratio):
        time = np.linspace(0, period, 801)
        return along(azimuth, -ratio * unit * np.sin(2 * np.pi * time / period), period / 800)

    toward = azimuth if branch == "no impact" else azimuth + 180
    return threshold_error(scene, motion_of, reference, preset, toward, **settings)


@lru_cache
def full_sine_threshold(body, period, branch):
    """Least amplitude over g b/h, b the leading corner's distance, that overturns with no impact, or after one."""
    unit = G * body.right_m / body.height_m

    def fate(ratio):
        return overturns(body, Ground.sine(-ratio * unit, period))

    if branch == "no impact":
        high = 2.0
        while fate(high) != 1:
            high *= 1.3
        return least(lambda a: fate(a) == 1, high / 1.3 if high > 2 else 1.0, high, 17)
    low = 1.0
    while fate(low) != -1:
        low *= 1.02
        if fate(low) == 1:
            msg = "no branch after an impact"
            raise ValueError(msg)
    return least(fate, low / 1.02, low, 12)


def pulse_error(alpha_deg, half_diagonal, duration_share, preset, **settings):
    """Threshold of a constant acceleration for `duration_share` / p with ramps of a hundredth of that."""
    scene, b, h = block(alpha_deg, half_diagonal)
    step = 0.01 * duration_share / exact.rocking_frequency(b, h)
    shape = np.concatenate([[0.0], np.ones(100), [0.0]])
    unit, reference = G * b / h, pulse_threshold(b, h, duration_share)
    return threshold_error(
        scene, lambda a: along(0.0, -a * unit * shape, step), reference, preset, **settings
    )


def velocity_step_error(alpha_deg, half_diagonal, preset, pulse_s=0.004, **settings):
    """Error of the least step of the base's velocity that overturns, made in a short pulse.

    Exact is the closed form, times what the integrator needs more of it in the pulse than at once: 0.7 % in 4 ms.
    """
    scene, b, h = block(alpha_deg, half_diagonal)
    step, shape = pulse_s / 7, np.concatenate([[0.0], np.ones(7), [0.0]])
    unit = exact.overturning_velocity_step_m_s(b, h) / pulse_s
    body = PlaneBody.rectangle(b, h)
    more = least(lambda a: overturns(body, Ground.samples(step, -a * unit * shape)), 1.0, 1.02, 9)
    return threshold_error(
        scene, lambda a: along(0.0, -a * unit * shape, step), more, preset, toward=0.0, **settings
    )


def overhang_error(azimuth, preset, **settings):
    """Error of the threshold of a full sine toward an azimuth for a block of which a quarter hangs over, toward +x."""
    b, h, over = 0.2, 0.6, 0.1
    top = np.array([[-2.0, -2.0, 0.0], [b - over, -2.0, 0.0], [b - over, 2.0, 0.0], [-2.0, 2.0, 0.0]])
    pedestal = Pedestal(np.zeros(3), np.array([0.0, 0.0, 1.0]), top, np.array([[0, 1, 2], [0, 2, 3]]))
    scene = replace(Scene.block(b, b, h, friction=GRIP), pedestal=pedestal)
    inertia = PlaneBody.rectangle(b, h).inertia_per_mass_m2
    body = PlaneBody(b - over, b, h, inertia) if azimuth == 0.0 else PlaneBody(b, b - over, h, inertia)
    return sine_threshold_error(scene, body, 1.0, "no impact", azimuth, preset, **settings)


@lru_cache
def pulse_threshold(b, h, duration_share):
    """Least such acceleration over g b/h that overturns."""
    step = 0.01 * duration_share / exact.rocking_frequency(b, h)
    shape = np.concatenate([[0.0], np.ones(100), [0.0]])
    body, unit = PlaneBody.rectangle(b, h), G * b / h
    high = 2.0
    while not overturns(body, Ground.samples(step, -high * unit * shape)):
        high *= 2
    return least(lambda a: overturns(body, Ground.samples(step, -a * unit * shape)), high / 2, high, 16)


def quasi_static_error(half_sizes, azimuth, preset, reference, scene=None, span=0.01, **settings):
    """Threshold of a ramp so slow that only statics counts."""
    scene = scene or Scene.block(*half_sizes, friction=GRIP)
    time_scale = np.sqrt(scene.rock.half_diagonal_m / G)
    shape = np.concatenate([np.linspace(0, 1, 41), np.ones(60)])
    return threshold_error(
        scene, lambda a: along(azimuth, a * shape, 0.5 * time_scale), reference, preset, span=span, **settings
    )


def slip_error(mu, slope_deg, downhill_deg, acceleration_g, duration, preset, azimuth=None, **settings):
    """Slip of a flat block under a rectangular pulse whose edges take one sample."""
    rock = box(1.0, 1.0, 0.2)
    scene = Scene.from_mesh(
        (rock.vertices_m, rock.faces), friction=mu, slope_deg=slope_deg, slope_azimuth_deg=downhill_deg
    )
    step = duration / 200
    shape = np.concatenate([np.ones(200), [0.0, 0.0]]) * acceleration_g * G
    azimuth = downhill_deg + 180 if azimuth is None else azimuth
    result = shake(scene, along(azimuth, shape, step), preset=preset, shortcuts=False, **settings)
    return result.slip_m / slip_of_samples(mu, np.deg2rad(slope_deg), shape, step) - 1


def sliding_error(mesh, azimuth_deg, preset, friction=0.25, speed_m_s=1.0, **settings):
    """Distance of where a flat rock that was sent off comes to rest from v^2 / (2 mu g) straight on, over that way.

    Whatever the rock's feet: their friction is against the same direction, and its moment about the vertical is that of
    the weight's centre, which braking moves along the slide.
    """
    scene = Scene.from_mesh(mesh, friction=friction)
    ahead = np.array([np.cos(np.deg2rad(azimuth_deg)), np.sin(np.deg2rad(azimuth_deg)), 0.0])
    start = {"velocity_m_s": speed_m_s * ahead}
    path = shake(scene, STILL, preset, trajectory=True, shortcuts=False, initial=start, **settings).trajectory
    exact_m = speed_m_s**2 / (2.0 * friction * G)
    return np.linalg.norm(path.position_m[-1] - path.position_m[0] - exact_m * ahead) / exact_m


def plate(half_m, turned_deg=0.0):
    """Mesh of a block turned about the vertical."""
    rock = box(*half_m)
    return Rotation.from_euler("z", turned_deg, degrees=True).apply(rock.vertices_m), rock.faces


def boulder():
    """Mesh of a rock of no symmetry on five feet."""
    feet = [(-0.5, -0.2, 0), (0.1, -0.45, 0), (0.6, 0.1, 0), (0.2, 0.5, 0), (-0.4, 0.35, 0)]
    hull = trimesh.Trimesh([*feet, (-0.6, 0.1, 0.2), (0.5, -0.3, 0.25), (0.1, 0.2, 0.4)]).convex_hull
    return np.asarray(hull.vertices), np.asarray(hull.faces)


def slip_of_samples(mu, slope, push, step, fine=200):
    """Newmark's sliding block under an uphill acceleration linear between samples, by fine quadrature."""
    time = np.arange(len(push) * fine) * step / fine
    a = np.interp(time, np.arange(len(push)) * step, push, right=0.0)
    relative = (a * np.cos(slope) + G * np.sin(slope)) - mu * (G * np.cos(slope) - a * np.sin(slope))
    dt = step / fine
    speed = np.concatenate([[0.0], np.cumsum(0.5 * dt * (relative[1:] + relative[:-1]))])
    direction = np.sum(0.5 * dt * (speed[1:] + speed[:-1]))
    assert speed[-1] > 0
    return direction + 0.5 * speed[-1] ** 2 / (G * (mu * np.cos(slope) - np.sin(slope)))


def wobble_error(radius, half_height, tilt_deg, preset, sides=512, turns=1.0, **settings):
    """Error of the rate of steady precession of a cylinder that rolls on its rim."""
    tilt = np.deg2rad(tilt_deg)
    rate = exact.wobble_rate_rad_s(radius, half_height, tilt)
    rock = cylinder(radius, half_height, sides)
    scene = Scene.from_mesh((rock.vertices_m, rock.faces), friction=GRIP)
    motion, start = (
        Motion(np.zeros((2, 3)), turns * 2 * np.pi / rate),
        rolling_start(radius, half_height, tilt),
    )
    result = let_go(scene, start, preset, motion, **settings)
    x, y, z, w = result.trajectory.quaternion_xyzw.T
    azimuth = np.unwrap(np.arctan2(2 * (y * z - w * x), 2 * (x * z + w * y)))
    time = result.trajectory.time_s
    within = time <= turns * 2 * np.pi / rate
    return float((azimuth[within][-1] - azimuth[0]) / (time[within][-1] - time[0]) / rate - 1)


def rolling_start(radius, half_height, tilt_rad):
    """State of a cylinder in steady precession on its rim."""
    rate = exact.wobble_rate_rad_s(radius, half_height, tilt_rad)
    s, c = np.sin(tilt_rad), np.cos(tilt_rad)
    toward_contact = radius * c - half_height * s
    spin = -rate * toward_contact / radius
    return {
        "position_m": (0.0, 0.0, half_height * c + radius * s),
        "quaternion_xyzw": (0.0, np.sin(tilt_rad / 2), 0.0, np.cos(tilt_rad / 2)),
        "angular_velocity_rad_s": (spin * s, 0.0, rate + spin * c),
    }


def coupled(*case, **settings):
    """Differences (3, k) of engine and reference; see :func:`coupled_directions`."""
    engine, reference = coupled_directions(*case, **settings)
    return engine - reference


def coupled_directions(
    friction, preset, times, acceleration=None, duration=0.0, velocity=(0.0, 0.0), **settings
):
    """Way (3, k) of engine and of reference: corner's place since the start over R, lean over alpha, rate over p.

    A block of k = 3 that may slide and rock under a ground acceleration in steps of 2 ms, linear between.
    """
    body, size = PlaneBody.rectangle(0.2, 0.6), np.hypot(0.2, 0.6)
    scene = Scene.block(0.2, 0.2, 0.6, friction=friction)
    sampled = np.arange(0.0, max(duration, 0.004) + 1e-3, 0.002)
    values = np.zeros(len(sampled)) if acceleration is None else np.array([acceleration(t) for t in sampled])
    start = None if acceleration is not None else {"velocity_m_s": (velocity[0], 0.0, velocity[1])}
    result = shake(
        scene, along(0.0, values, 0.002), preset, trajectory=True, shortcuts=False, initial=start, **settings
    )
    asked = result.trajectory.time_s <= max(times)
    out_of_plane = np.abs(result.trajectory.quaternion_xyzw[asked][:, [0, 2]])
    assert out_of_plane.max() < 5e-6  # a plane motion: measured 1.1e-6
    static, kinetic = scene.contact.friction_static, scene.contact.friction_kinetic
    stepped = slide_and_rock(
        body,
        ContactProperties(static, kinetic),
        lambda t: (-float(np.interp(t, sampled, values, right=0.0)), -G),
        max(times) + 5e-3,
        max(2e-5, max(times) / 4000),
        velocity=(*velocity, 0.0),
    )
    rows = []
    for time, x, angle in (
        (result.trajectory.time_s, result.trajectory.position_m[:, 0], lean(result.trajectory)),
        (stepped.time_s, stepped.place[:, 0], stepped.place[:, 2]),
    ):
        around = 2e-3  # rates as differences over the same 4 ms
        at, before, after = (np.interp(np.asarray(times) + d, time, angle) for d in (0.0, -around, around))
        corner = np.interp(times, time, x + 0.2 * np.cos(angle) - 0.6 * np.sin(angle))
        alpha, p = np.arctan2(0.2, 0.6), exact.rocking_frequency(0.2, 0.6)
        rows.append([(corner - 0.2) / size, at / alpha, (after - before) / (2 * around * p)])
    return np.array(rows[0]), np.array(rows[1])


def rolling_loss_error(sides, rate, preset):
    """Error of the energy that a polygonal prism of radius 1 m loses as it rolls through 60 degrees.

    It turns about a corner until the next face lands, corner by corner: the angular velocity goes down by
    (I + m R^2 cos(2 pi / n)) / (I + m R^2) each time.
    """
    half = np.pi / sides
    angle = 2 * half * (np.arange(sides) + 0.5) - np.pi / 2
    ring = np.column_stack([np.cos(angle), np.zeros(sides), np.sin(angle)])
    prism = trimesh.convex.convex_hull(np.vstack([ring - np.array([0, 1, 0]), ring + np.array([0, 1, 0])]))
    prism.apply_translation([0.0, 0.0, -prism.vertices[:, 2].min()])
    scene = Scene.from_mesh((prism.vertices, prism.faces), friction=GRIP)
    inertia = scene.rock.inertia_per_mass_m2[1, 1]
    corner = np.array([np.sin(half), 0.0, 0.0])
    spin = np.array([0.0, rate, 0.0])
    landings = int(np.deg2rad(60.0) / (2 * half) + 1e-6)
    rolling = Motion(np.zeros((2, 3)), 1.2 * landings * 2 * half / rate)
    path = let_go(scene, turning_about(scene, corner, spin), preset, rolling).trajectory
    # The centre of mass moves on by one face's length a landing; look shortly after the last one.
    seen = np.argmax(path.position_m[:, 0] - scene.rock.com_m[0] > (2 * landings + 0.2) * np.sin(half))
    energy = energy_before(scene, path, seen)
    start = 0.5 * rate**2 * (1 + inertia)
    remaining = ((inertia + np.cos(2 * half)) / (inertia + 1)) ** (2 * landings)
    return (start - energy) / (start * (1 - remaining)) - 1


def rattling_energy(sides, azimuth_deg, preset):
    """Energy kept, over that which overturns, by a prism kicked up onto one corner, 3 sqrt(R / g) later.

    It swings back, and the corners of its base land one after the other around the rim.
    """
    rock = cylinder(1.0, 1.5, sides)
    scene = Scene.from_mesh((rock.vertices_m, rock.faces), friction=GRIP)
    feet = scene.rock.vertices_m[scene.rock.vertices_m[:, 2] < 1e-9]
    toward = horizontal_unit_vector(azimuth_deg)
    corner = feet[np.argmax(feet @ toward)]
    axis = np.cross([0.0, 0.0, 1.0], toward)
    arm = scene.rock.com_m - corner
    about_corner = axis @ scene.rock.inertia_per_mass_m2 @ axis + np.sum(np.cross(axis, arm) ** 2)
    barrier = G * (np.linalg.norm(arm) - arm[2])
    spin = axis * np.sqrt(2 * 0.5 * barrier / about_corner)
    still = Motion(np.zeros((2, 3)), 3.0 * np.sqrt(scene.rock.half_diagonal_m / G))
    path = let_go(scene, turning_about(scene, corner, spin), preset, still).trajectory
    return energy_before(scene, path, np.searchsorted(path.time_s, still.duration_s)) / barrier


def slipping_impulses(arms, inertia, velocity, friction, restitution):
    """Impulses over mass (n, 3) on feet that land at once and slip on, and the azimuths of their slips, rad.

    Those that take the normal velocity of each foot, with Coulomb's friction against the slip that is left, and the
    restitution times these again. The rock does not turn before. None where a foot sticks or lifts off.
    """
    crossed = [np.cross(np.eye(3), arm) for arm in arms]
    mobility = [[np.eye(3) - a @ np.linalg.solve(inertia, b) for b in crossed] for a in crossed]

    def of(unknown):
        azimuth, normal = unknown.reshape(2, -1)
        return normal[:, None] * np.column_stack(
            [-friction * np.cos(azimuth), -friction * np.sin(azimuth), np.ones(len(arms))]
        )

    def leaving(unknown):
        return velocity + np.einsum("ijkl,jl->ik", np.array(mobility), of(unknown))

    def missed(unknown):
        azimuth, after = unknown[: len(arms)], leaving(unknown)
        across = after[:, 0] * np.sin(azimuth) - after[:, 1] * np.cos(azimuth)
        return [*across, *after[:, 2]]

    for guess in np.arange(0.0, 2.0 * np.pi, 0.3):
        found, _, solved, _ = fsolve(missed, [guess] * len(arms) + [0.5] * len(arms), full_output=True)
        azimuth, normal = found.reshape(2, -1)
        slip = leaving(found)[:, :2]
        along = slip[:, 0] * np.cos(azimuth) + slip[:, 1] * np.sin(azimuth)
        if solved == 1 and normal.min() > 0.0 and along.min() > 0.05:
            return (1.0 + restitution) * of(found), azimuth
    return None


def landing_error(half_sizes, turn, velocity, friction, restitution, preset):
    """Lean (rad) and relative error of the friction's impulse on a block that lands turned, and the turns of its slips.

    The turns (n,), rad, are those of the feet from before to after the impact. None where a foot sticks or lifts off.
    """
    scene = Scene.block(*half_sizes, friction=friction, restitution=restitution)
    corners = turn.apply(scene.rock.vertices_m - scene.rock.com_m)
    lowest = corners[:, 2].min()
    inertia = turn.as_matrix() @ scene.rock.inertia_per_mass_m2 @ turn.as_matrix().T
    feet = corners[corners[:, 2] < lowest + 1e-9]
    law = slipping_impulses(feet, inertia, np.array(velocity), friction, restitution)
    if law is None:
        return None
    flight_s = 6.5 * options_of(preset).time_step_s(scene.rock.half_diagonal_m, G)
    fall = np.array([0.0, 0.0, -G * flight_s])
    start = {
        "position_m": np.array([0.0, 0.0, -lowest]) - (np.array(velocity) - 0.5 * fall) * flight_s,
        "quaternion_xyzw": turn.as_quat(),
        "velocity_m_s": np.array(velocity) - fall,
    }
    path = let_go(scene, start, preset).trajectory
    after = int(np.searchsorted(path.time_s, flight_s))
    left = (path.position_m[after] - np.array([0.0, 0.0, -lowest])) / (path.time_s[after] - flight_s)
    exact_along, along = law[0].sum(axis=0)[:2], left[:2] - velocity[:2]
    ratio = complex(*along) / complex(*exact_along)
    turned = np.angle(np.exp(1j * (law[1] - np.arctan2(velocity[1], velocity[0]))))
    return np.angle(ratio), abs(ratio) - 1.0, turned


def largest_tilt_of_a_pentagon(frequency_hz, preset):
    """Largest tilt (deg) of a prism on five feet under a motion that just lifts it."""
    turn = 2 * np.pi * np.arange(5) / 5
    base = np.column_stack([0.25 * np.cos(turn), 0.2 * np.sin(turn), np.zeros(5)])
    top = base * [1.3, 1.3, 0.0] + [0.0, 0.0, 1.0]
    mesh = trimesh.convex.convex_hull(np.vstack([base, top]))
    step_s, duration_s = 0.005, 4.0
    time = np.arange(0, duration_s, step_s)
    phase = 2 * np.pi * frequency_hz * time
    along = np.column_stack([np.sin(phase), 0.6 * np.sin(1.13 * phase + 1.0), 0.0 * time])
    swell = 0.36 * G * np.sin(np.pi * time / duration_s) ** 2
    scene = Scene.from_mesh((mesh.vertices, mesh.faces), friction=0.8)
    return shake(scene, Motion(swell[:, None] * along, step_s), preset).max_tilt_deg
