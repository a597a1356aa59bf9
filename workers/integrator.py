"""Time integration of second order across impacts: a leapfrog with steps that end where a contact closes. Compiled.

Bullet's step adds the specific force to the velocity, solves the contacts at the places of the step's start, and
moves the rock with the new velocity. Read as a leapfrog, with velocities that belong to the middles of the steps, it
is of second order where the force of step n is the mean over the time from middle to middle, and that is what is
imposed.

An impact spoils the order: the contact solver lets a point that would penetrate arrive just at the surface, and so
moves the rock's weight to the new support at the start of the step in which it lands, half a step too early on the
average. The energy lost in an impact is then too large in proportion to the step, and a base of many corners rolls as
if braked. Therefore steps are taken in small chunks, the gaps of the chunk are looked at together, and where a point
has landed fast the chunk is taken back to the step before. It is replaced by substeps that end at the moment of
contact, a short one for the impact, as many such groups as other points land at once, and one that leads to the grid
of steps.

The impact must meet the velocity at the contact, and the points that carry until then must give what they hold up:
the force is therefore imposed up to the contact before the impact's step. That moves the rock too fast, so a substep
of second order leads nearly there and only a terminal substep has the velocity of its end.

Substeps need care: in a steady step a point that carries leaves its arc by half of (step)^2 times its centripetal
acceleration, and the next step takes that back. After a change of step the points are therefore set to the height
that belongs to the new one (some 1e-6 of R). Left out, each impact jolts the rock by half a step's arc, which on a
polygon of 48 sides raised the energy lost in an impact by a third.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.workers import engine
from toppling.workers.contact_points import REACH_DEG, ContactModel, Pose
from toppling.workers.events import (
    centripetal_m_s2,
    gaps_m,
    height_correction_m,
    terminal_substep_s,
)
from toppling.workers.friction_axes import best_axes_rad, point_mobilities, squared_error
from toppling.workers.options import Settings
from toppling.workers.quaternion import normal_in_body, rotation_between

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

DONE, NEEDS_WORLD, NEEDS_ROOM = 0, 1, 2
"""Why :func:`advance` came back: it is there; `state.set` has no world yet; the trajectory's arrays are full."""

NOTHING, BEGIN, CHANGE_SET, WHOLE_STEPS = 0, 1, 2, 3
"""What is to be done before the next chunk, with a world that may be missing yet."""

ROOM = 1024
"""Poses that a chunk and its impacts may add."""

STATE = np.dtype(
    [
        ("last", "i8"),  # index of the latest pose
        ("grid", "i8"),  # present steps from time 0 to it
        ("parts", "i8"),  # how many of them make a whole one
        ("steps", "i8"),  # engine steps taken, repeated ones included
        ("set", "i8"),  # set of contact points, by the tilt that it serves
        ("widest", "i8"),  # that of all so far
        ("world", "i8"),  # set whose world holds the rock
        ("pending", "i8"),
        ("chunk", "i8"),  # steps of the next chunk
        ("smooth_from", "i8"),  # pose before which steps say nothing of those to come
        ("narrow_from", "i8"),  # pose from which the set may be narrowed
        ("rested", "i8"),  # latest pose in which it rested
        ("step_s", "f8"),  # a present step
        ("resolved_m_s", "f8"),  # impacts faster than this are resolved
        ("axes_rad", "f8"),
        ("prepared_share", "f8"),  # of R: within it the engine was told of contacts
    ]
)


class Options(NamedTuple):
    """Numbers of :mod:`workers.options` that compiled code needs, as it takes them."""

    short_chunk: int
    long_chunk: int
    fewest_steps: int
    repeated_parts: int
    tries_to_contact: int
    tries_at_impact: int
    most_impacts: int
    short_of_contact: float
    terminal_substep: float
    least_terminal: float
    left_out: float
    carrying_share: float
    highest_offset: float
    nearest_share: float
    ahead: float
    at_once: float
    impact_step: float
    low_tilt_deg: float
    penetrating_share: float
    prepared_steps: float
    prepared_share: float
    friction_direction_rad: float
    impact_friction_direction_rad: float


class Simulation(NamedTuple):
    """A rock on its way through a motion, as arrays and records; the arrays are the caller's.

    Poses are (7,): centre of mass in the support frame, and attitude as a quaternion. The velocities of the step to a
    pose belong to `velocity_time_s`: up to then the specific force is in them.
    """

    state: Any  # (1,) record of STATE
    worlds: Any  # (sets,) records of engine.WORLD, those without a client are still to be built
    options: Options
    # the trajectory, in arrays that may be longer than it
    time_s: Array
    velocity_time_s: Array
    pose: Array
    correction_m: Array  # height by which a pose was raised before the step from it
    rests: NDArray[np.bool_]  # whether the rock rested on its way to a pose
    # the rock
    centres_m: Array
    mobilities: Array
    upright: Array  # the normal in body axes in the pose of the scene
    start_velocity: Array  # (6,) velocity and angular velocity at time 0
    half_diagonal_m: float
    radius_m: float
    set_tilt_deg: Array
    set_points: NDArray[np.int64]
    sets: NDArray[np.int64]  # those that differ
    # what shakes it
    gravity_m_s2: Array
    ground_acceleration_m_s2: Array
    ground_velocity_m_s: Array
    sample_s: float
    # how finely
    whole_step_s: float
    parts_when_low: int
    whole_resolved_m_s: float
    residual_share: float


@njit(cache=True)
def advance(sim: Simulation, steps_to: int) -> int:
    """Go on until `steps_to` whole steps from time 0, and to the end of a whole one; says why it came back."""
    state = sim.state[0]
    while True:
        if state.pending != NOTHING:
            if sim.worlds[state.set].client == 0:
                return NEEDS_WORLD
            _take_over(sim)
        to_whole = -state.grid % state.parts
        if not (to_whole or state.grid // state.parts < steps_to):
            return DONE
        if state.last + ROOM > len(sim.time_s):
            return NEEDS_ROOM
        left = max(steps_to * state.parts - state.grid, to_whole)
        if state.parts > 1 and _tilt_since_rest_deg(sim) > sim.options.low_tilt_deg:
            if not to_whole:
                _take_whole_steps(sim)
                continue
            left = to_whole
        steps = min(state.chunk, left, _steps_within_set(sim))
        if state.pending == NOTHING:
            _chunk(sim, steps)


@njit(cache=True)
def begin(sim: Simulation, parts: int) -> None:
    """Give the latest pose to an engine that remembers nothing."""
    state = sim.state[0]
    _divide(sim, parts)
    state.rested = state.smooth_from = state.last
    state.narrow_from, state.chunk = 0, sim.options.short_chunk
    state.axes_rad = state.prepared_share = 0.0
    state.set = sim.sets[0]
    _widen(sim, largest_tilt_deg(sim, state.last))
    state.pending = BEGIN


@njit(cache=True)
def rest_until(sim: Simulation, grid: int) -> None:
    """Let the rock rest where it is up to a whole step; what comes then depends on that pose alone."""
    state = sim.state[0]
    sim.correction_m[state.last] = 0.0
    time = grid * sim.whole_step_s
    last = _append(sim, time, time)
    sim.pose[last] = sim.pose[last - 1]
    sim.rests[last] = True
    state.grid = grid * sim.parts_when_low
    begin(sim, sim.parts_when_low)


@njit(cache=True)
def ground_velocity_m_s(sim: Simulation, time_s: float) -> Vector:
    """Ground velocity, support frame: the exact integral of an acceleration that is linear between samples."""
    acceleration, velocity, sample = sim.ground_acceleration_m_s2, sim.ground_velocity_m_s, sim.sample_s
    time = min(max(time_s, 0.0), (len(acceleration) - 1) * sample)
    i = min(int(time / sample), len(acceleration) - 2)
    since = time - i * sample
    here, next_, at = acceleration[i], acceleration[i + 1], velocity[i]
    x = at[0] + since * (here[0] + 0.5 * since * ((next_[0] - here[0]) / sample))
    y = at[1] + since * (here[1] + 0.5 * since * ((next_[1] - here[1]) / sample))
    z = at[2] + since * (here[2] + 0.5 * since * ((next_[2] - here[2]) / sample))
    return x, y, z


# --- the trajectory ---------------------------------------------------------------------------------------------------


@njit(cache=True)
def _append(sim: Simulation, time_s: float, velocity_time_s: float) -> int:
    """Add a pose, still to be filled in; its index."""
    state = sim.state[0]
    state.last += 1
    last = state.last
    sim.time_s[last], sim.velocity_time_s[last] = time_s, velocity_time_s
    sim.correction_m[last], sim.rests[last] = 0.0, False
    return last


@njit(cache=True)
def velocities(sim: Simulation, index: int) -> tuple[Vector, Vector]:
    """Velocity (m/s) and angular velocity (rad/s) in the step that led to a pose, or at the start."""
    if index == 0:
        v = sim.start_velocity
        return (v[0], v[1], v[2]), (v[3], v[4], v[5])
    if sim.rests[index]:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    start, end = sim.pose[index - 1], sim.pose[index]
    rate = 1.0 / (sim.time_s[index] - sim.time_s[index - 1])
    z0 = start[2] + sim.correction_m[index - 1]
    a, b, c = rotation_between(start, end)
    velocity = ((end[0] - start[0]) * rate, (end[1] - start[1]) * rate, (end[2] - z0) * rate)
    return velocity, (a * rate, b * rate, c * rate)


@njit(cache=True)
def largest_tilt_deg(sim: Simulation, since: int) -> float:
    """Largest angle, from a pose on, of the interface's normal carried along to where it was in the scene."""
    a, b, c = sim.upright
    cosine = 1.0
    for index in range(since, sim.state[0].last + 1):
        x, y, z = normal_in_body(sim.pose[index])
        cosine = min(cosine, x * a + y * b + z * c)
    return math.degrees(math.acos(max(cosine, -1.0)))


@njit(cache=True)
def lowest_gap_m(sim: Simulation, since: int) -> float:
    """Least gap, from a pose on, of the contact points that were looked at so far."""
    out, lowest = np.empty(sim.set_points[sim.state[0].widest]), np.inf
    for index in range(since, sim.state[0].last + 1):
        gaps_m(sim.centres_m, sim.radius_m, sim.pose[index], out)
        lowest = min(lowest, out.min())
    return lowest


@njit(cache=True)
def _tilt_since_rest_deg(sim: Simulation) -> float:
    """Angle between the normal and where the rock has carried it since it rested.

    Of a rock that has turned about the normal too it is more, by a twenty-fourth of that turn's square.
    """
    x, y, _ = rotation_between(sim.pose[sim.state[0].rested], sim.pose[sim.state[0].last])
    return math.degrees(math.sqrt(x * x + y * y))


@njit(cache=True)
def _gaps_m(sim: Simulation, index: int) -> Array:
    """Gaps (points,) of the present set in a pose."""
    out = np.empty(sim.set_points[sim.state[0].set])
    gaps_m(sim.centres_m, sim.radius_m, sim.pose[index], out)
    return out


@njit(cache=True)
def _closing_m_s(sim: Simulation, index: int, before: Array, after: Array) -> Array:
    """Mean speed (points,) at which points came down in the step to a pose, from the gaps before and after it."""
    duration = sim.time_s[index] - sim.time_s[index - 1]
    return (before - after + sim.correction_m[index - 1]) / duration


@njit(cache=True)
def _centripetal_m_s2(sim: Simulation, index: int) -> Array:
    out = np.empty(sim.set_points[sim.state[0].set])
    centripetal_m_s2(sim.centres_m, sim.pose[index], velocities(sim, index)[1], out)
    return out


# --- steps, and the world that takes them -----------------------------------------------------------------------------


@njit(cache=True)
def _divide(sim: Simulation, parts: int) -> None:
    """Set the length of the present steps, and with it the slowest impact that is resolved."""
    state = sim.state[0]
    state.parts = parts
    state.step_s, state.resolved_m_s = sim.whole_step_s / parts, sim.whole_resolved_m_s / parts


@njit(cache=True)
def _take_whole_steps(sim: Simulation) -> None:
    """Go on with whole steps; the latest pose ends one of them."""
    state = sim.state[0]
    state.grid = state.grid // state.parts
    _divide(sim, 1)
    state.smooth_from, state.chunk = state.last, sim.options.short_chunk
    state.pending = WHOLE_STEPS


@njit(cache=True)
def _take_over(sim: Simulation) -> None:
    """Give the rock to the world of the present set and step."""
    state = sim.state[0]
    world = sim.worlds[state.set]
    gravity = sim.gravity_m_s2
    impulse = (
        math.sqrt(gravity[0] * gravity[0] + gravity[1] * gravity[1] + gravity[2] * gravity[2]) * state.step_s
    )
    near = max(
        sim.options.prepared_steps * (impulse * state.step_s) / sim.half_diagonal_m,
        sim.options.prepared_share,
    )
    engine.configure(world, impulse, near, state.resolved_m_s, sim.residual_share)
    if state.pending == BEGIN:
        engine.let_stick(world)
    else:
        engine.hold_as(world, sim.worlds[state.world])
    state.world = state.set
    if state.pending == CHANGE_SET:
        _place(sim, near, _axes_rad(sim, state.last, near))
    else:
        _set_state(sim, state.step_s, 0.5, 0.0, False)
    state.pending = NOTHING


@njit(cache=True)
def _steps_within_set(sim: Simulation) -> int:
    """Steps for which the rock stays within reach of its points at twice its spin; changes the set for that.

    To fewer points only below half their reach, and where they leave ample room, or the sets would change to and fro.
    """
    state, options = sim.state[0], sim.options
    tilt_deg = largest_tilt_deg(sim, state.last)
    x, y, z = velocities(sim, state.last)[1]
    turned_deg = math.degrees(2.0 * math.sqrt(x * x + y * y + z * z) * state.step_s) + 1e-9
    before = state.set
    _widen(sim, tilt_deg + options.fewest_steps * turned_deg)
    if state.set == before and state.last >= state.narrow_from:
        for narrower in sim.sets:
            ample = _room(sim, narrower, tilt_deg, turned_deg) > 2 * options.short_chunk
            if narrower < before and tilt_deg < 0.5 * sim.set_tilt_deg[narrower] and ample:
                state.set = narrower
                break
    if state.set != before:
        state.pending = CHANGE_SET
    return _room(sim, state.set, tilt_deg, turned_deg)


@njit(cache=True)
def _room(sim: Simulation, points: int, tilt_deg: float, turned_deg: float) -> int:
    """Steps until a rock that turns so much in each leaves what a set of points serves."""
    if points == len(sim.set_tilt_deg) - 1:
        return sim.options.long_chunk
    return int((sim.set_tilt_deg[points] - tilt_deg) / turned_deg)


@njit(cache=True)
def _widen(sim: Simulation, tilt_deg: float) -> None:
    """Serve at least this tilt."""
    state = sim.state[0]
    reached = sim.sets[-1]
    for points in sim.sets[::-1]:
        if sim.set_tilt_deg[points] >= tilt_deg:
            reached = points
    state.set = max(state.set, reached)
    state.widest = max(state.widest, state.set)


@njit(cache=True)
def _set_state(
    sim: Simulation, next_step_s: float, velocity_share: float, ahead_s: float, carrying_only: bool
) -> None:
    """Give the engine the latest pose, its points at the height that belongs to a step of that duration.

    That step's velocity is the one at `velocity_share` of it. Contacts are prepared for what the rock may do in
    `ahead_s`, or only those of the points that carry.
    """
    near = _prepare(sim, next_step_s, velocity_share, ahead_s, carrying_only)
    _place(sim, near, _axes_rad(sim, sim.state[0].last, near))


@njit(cache=True)
def _prepare(
    sim: Simulation, next_step_s: float, velocity_share: float, ahead_s: float, carrying_only: bool
) -> float:
    """Correct the latest pose's height for the next step; within what share of R contacts are to be prepared."""
    state, options = sim.state[0], sim.options
    index = state.last
    centripetal = _centripetal_m_s2(sim, index)
    gap = _gaps_m(sim, index)
    offset = velocity_share * next_step_s**2 * centripetal
    sim.correction_m[index] = 0.0
    sim.correction_m[index] = height_correction_m(
        gap, offset, _aloft_m(sim, centripetal), options.penetrating_share * sim.half_diagonal_m
    )
    velocity, spin = velocities(sim, index)
    x, y, z = spin
    speed_1_s = abs(velocity[2]) / sim.half_diagonal_m + math.sqrt(x * x + y * y + z * z)
    near = max(options.ahead * ahead_s * speed_1_s, sim.worlds[state.world].near_share)
    return min(near, options.left_out * _nearest_coming_share(sim)) if carrying_only else near


@njit(cache=True)
def _aloft_m(sim: Simulation, centripetal: Array) -> float:
    """Height over its rest from which a rock is aloft: points that carry stand off by an offset at most."""
    largest = 0.0
    for value in centripetal:
        largest = max(largest, abs(value))
    offset_m = sim.options.highest_offset * sim.state[0].step_s ** 2 * largest
    return max(offset_m, sim.options.carrying_share * sim.half_diagonal_m)


@njit(cache=True)
def _place(sim: Simulation, near_share: float, axes_rad: float) -> None:
    """Give the engine the latest pose, with contacts prepared within a share of R, and axes for their friction."""
    state = sim.state[0]
    state.prepared_share, state.axes_rad = near_share, axes_rad
    velocity, spin = velocities(sim, state.last)
    world, last = sim.worlds[state.world], state.last
    engine.place(world, sim.pose[last], sim.correction_m[last], velocity, spin, near_share, axes_rad)


@njit(cache=True)
def _axes_rad(sim: Simulation, moving: int, near_share: float) -> float:
    """Axes for the friction of the points of the latest pose, with the velocities of the step to pose `moving`."""
    state = sim.state[0]
    unlike, slip = _mobilities(sim, state.last, moving, near_share)
    return best_axes_rad(unlike, slip, state.axes_rad, sim.options.friction_direction_rad)


@njit(cache=True)
def _mobilities(
    sim: Simulation, index: int, moving: int, near_share: float
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Mobilities and slips of the points whose contacts are prepared in a pose."""
    near = np.flatnonzero(_gaps_m(sim, index) < near_share * sim.half_diagonal_m)
    unlike, slip = np.empty(len(near), np.complex128), np.empty(len(near), np.complex128)
    velocity, spin = velocities(sim, moving)
    point_mobilities(
        sim.centres_m,
        sim.mobilities,
        near,
        sim.pose[index],
        velocity,
        spin,
        sim.state[0].resolved_m_s,
        unlike,
        slip,
    )
    return unlike, slip


@njit(cache=True)
def _nearest_coming_share(sim: Simulation) -> float:
    """Gap, over R, of the nearest point that is about to land in the latest pose."""
    state = sim.state[0]
    gap = _gaps_m(sim, state.last)
    closing = _closing_m_s(sim, state.last, _gaps_m(sim, state.last - 1), gap)
    nearest = np.inf
    for i in range(len(gap)):
        share = gap[i] / sim.half_diagonal_m
        if closing[i] > 0.5 * state.resolved_m_s and share > sim.options.carrying_share:
            nearest = min(nearest, share)
    return nearest


@njit(cache=True)
def _step_to(sim: Simulation, time_s: float, velocity_time_s: float, step_s: float, impact: bool) -> None:
    """One engine step of any duration; its specific force covers the time since the last step's velocities."""
    state = sim.state[0]
    since_s = sim.velocity_time_s[state.last]
    before, after = ground_velocity_m_s(sim, since_s), ground_velocity_m_s(sim, velocity_time_s)
    gravity, lasting_s = sim.gravity_m_s2, velocity_time_s - since_s
    force = (
        (gravity[0] * lasting_s - (after[0] - before[0])) / step_s,
        (gravity[1] * lasting_s - (after[1] - before[1])) / step_s,
        (gravity[2] * lasting_s - (after[2] - before[2])) / step_s,
    )
    last = _append(sim, time_s, velocity_time_s)
    world = sim.worlds[state.world]
    if impact:
        engine.rebound(world, sim.centres_m, step_s, force, sim.pose[last])
    else:
        engine.step(world, sim.centres_m, step_s, force, sim.pose[last])
    state.steps += 1


@njit(cache=True)
def _substep(sim: Simulation, step_s: float, velocity_share: float) -> None:
    """One engine step of any duration, with the velocity at this share of it."""
    time = sim.time_s[sim.state[0].last]
    _step_to(sim, time + step_s, time + velocity_share * step_s, step_s, False)


@njit(cache=True)
def _chunk(sim: Simulation, steps: int) -> None:
    """Some steps, and a look at what happened in them."""
    state, step_s = sim.state[0], sim.state[0].step_s
    first, grid = state.last, state.grid
    if abs(sim.velocity_time_s[first] - (grid - 0.5) * step_s) > 1e-9 * step_s:
        _substep(sim, step_s, 0.5)
        state.grid += 1
        steps -= 1
    if steps > 0:
        near = sim.worlds[state.world].near_share
        state.prepared_share = near
        axes_rad = _axes_rad(sim, state.last, near)
        if axes_rad != state.axes_rad:
            _place(sim, near, axes_rad)
        for n in range(state.grid, state.grid + steps):
            _whole_step(sim, n)
        state.grid += steps
    if not _left_set(sim, first, grid):
        _mend(sim, first)


@njit(cache=True)
def _whole_step(sim: Simulation, n: int) -> None:
    """The present step number n."""
    state, step_s = sim.state[0], sim.state[0].step_s
    before, after = ground_velocity_m_s(sim, (n - 0.5) * step_s), ground_velocity_m_s(sim, (n + 0.5) * step_s)
    gravity = sim.gravity_m_s2
    force = (
        gravity[0] - (after[0] - before[0]) / step_s,
        gravity[1] - (after[1] - before[1]) / step_s,
        gravity[2] - (after[2] - before[2]) / step_s,
    )
    last = _append(sim, (n + 1) * step_s, (n + 1 - 0.5) * step_s)
    engine.step(sim.worlds[state.world], sim.centres_m, step_s, force, sim.pose[last])
    state.steps += 1


@njit(cache=True)
def _left_set(sim: Simulation, first: int, grid: int) -> bool:
    """Whether the rock left what its points serve after a pose: at rest it does not tell how fast it will turn.

    Goes back to that pose then, with points that serve as far as the rock went.
    """
    state = sim.state[0]
    if state.set == len(sim.set_tilt_deg) - 1:
        return False
    farthest_deg = largest_tilt_deg(sim, first)
    if farthest_deg <= sim.set_tilt_deg[state.set]:
        return False
    state.narrow_from, state.chunk = state.last, sim.options.short_chunk
    state.last, state.grid = first, grid
    _widen(sim, farthest_deg)
    state.pending = CHANGE_SET
    return True


# --- events -----------------------------------------------------------------------------------------------------------


@njit(cache=True)
def _mend(sim: Simulation, first: int) -> None:
    """Look at the gaps since a pose; take back what an impact or a penetrating point has spoilt."""
    state, options = sim.state[0], sim.options
    back = max(first - 3, 0)
    count = state.last - back + 1
    gap = np.empty((count, sim.set_points[state.set]))
    for i in range(count):
        gaps_m(sim.centres_m, sim.radius_m, sim.pose[back + i], gap[i])
    penetrating = -options.penetrating_share * sim.half_diagonal_m
    sinks = -1
    for i in range(max(first - back, 0), count - 1):
        if gap[i + 1].min() < penetrating and not gap[i].min() < penetrating:
            sinks = back + i
            break
    smooth = max(back, state.smooth_from)
    index, contact_s = _first_impact(sim, gap[smooth - back :], smooth, first)
    if index < 0:
        state.chunk = min(2 * state.chunk, options.long_chunk, _steps_to_contact(sim))
    else:
        state.chunk = options.short_chunk
    if index >= 0 and not (0 <= sinks < index):
        _resolve(sim, index, contact_s)
    elif sinks >= 0:
        _repeat(sim, sinks)


@njit(cache=True)
def _steps_to_contact(sim: Simulation) -> int:
    """Steps by whose end the next resolved impact will be seen, if the points go on at their speeds."""
    state = sim.state[0]
    gap = _gaps_m(sim, state.last)
    closing = _closing_m_s(sim, state.last, _gaps_m(sim, state.last - 1), gap)
    soonest = np.inf
    for i in range(len(gap)):
        if closing[i] > state.resolved_m_s and gap[i] > 0.0:
            soonest = min(soonest, gap[i] / closing[i])
    if soonest == np.inf:
        return sim.options.long_chunk
    return max(math.ceil(soonest / state.step_s) + 1, sim.options.fewest_steps)


@njit(cache=True)
def _first_impact(sim: Simulation, gap: Array, back: int, first: int) -> tuple[int, float]:
    """Pose, not before pose `first`, ahead of the first resolved impact, and the time from it; -1 without one."""
    state = sim.state[0]
    nearest_m = sim.options.nearest_share * sim.half_diagonal_m
    time, correction = sim.time_s[back:], sim.correction_m[back:]
    for i in range(max(first - back - 1, 0), len(gap) - 2):
        # A point lands in interval i + 1 if the speed in i and its change before carry it through.
        duration, next_duration = time[i + 1] - time[i], time[i + 2] - time[i + 1]
        lands = np.zeros(gap.shape[1], np.bool_)
        for k in range(gap.shape[1]):
            closing = (gap[i, k] - gap[i + 1, k] + correction[i]) / duration
            predicted = closing
            if i > 0:
                predicted += closing - (gap[i - 1, k] - gap[i, k] + correction[i - 1]) / (
                    time[i] - time[i - 1]
                )
            before = gap[i + 1, k]
            lands[k] = (
                closing > state.resolved_m_s and before > -nearest_m and before < predicted * next_duration
            )
        if lands.any():
            points = np.flatnonzero(lands)
            here = i + 1
            contact_s = _time_to_contact_s(sim, back + here, points, back)
            if contact_s < 0.5 * state.step_s and back + here - 1 > first and here > 2:
                off = max(
                    abs(time[here - 1] - time[here - 2] - state.step_s),
                    abs(time[here] - time[here - 1] - state.step_s),
                )
                if off < 1e-9 * state.step_s:  # from a whole step further back
                    here -= 1
                    contact_s = _time_to_contact_s(sim, back + here, points, back)
            # An impact that the next one and a half steps do not bring was an extrapolation's error.
            return (back + here, contact_s) if contact_s <= 1.6 * state.step_s else (-1, 0.0)
    return -1, 0.0


@njit(cache=True)
def _time_to_contact_s(sim: Simulation, index: int, points: NDArray[np.int64], smooth_from: int) -> float:
    """Time from a pose to the first contact of some points, for a way whose terminal substep has the velocity there.

    Such a substep moves points along their tangents at its start: what the mean speeds of the steps before have lost or
    gained by the turning of the tangent is taken out of their change, and half a step's of it is put back. Unknown
    changes, those across pose `smooth_from`, are taken as zero.
    """
    options, step_s = sim.options, sim.state[0].step_s
    all_gaps, gaps_before = _gaps_m(sim, index), _gaps_m(sim, index - 1)
    centripetal = _centripetal_m_s2(sim, index)
    closing = _closing_m_s(sim, index, gaps_before, all_gaps)
    before_s = sim.time_s[index] - sim.time_s[index - 1]
    growth = centripetal.copy()
    if index - 2 >= smooth_from:
        middle_to_middle = 0.5 * (sim.time_s[index] - sim.time_s[index - 2])
        earlier = _closing_m_s(sim, index - 1, _gaps_m(sim, index - 2), gaps_before)
        growth += (closing - earlier) / middle_to_middle
    gap, soonest = np.empty(len(points)), np.inf
    for k, i in enumerate(points):
        gap[k] = max(all_gaps[i], options.nearest_share * sim.half_diagonal_m)
        soonest = min(soonest, gap[k] / closing[i])
    told_apart_m = 2.0 * options.carrying_share * sim.half_diagonal_m
    aloft_m = _aloft_m(sim, centripetal)
    penetrating_m = options.penetrating_share * sim.half_diagonal_m
    for _ in range(4):
        last = np.inf
        for k in range(len(points)):
            last = min(
                last, terminal_substep_s(soonest, gap[k], step_s, told_apart_m, options.terminal_substep)
            )
        offset = centripetal * (0.5 * (soonest - last) ** 2 + last**2)
        raised = height_correction_m(all_gaps, offset, aloft_m, penetrating_m)
        next_soonest = np.inf
        for k, i in enumerate(points):
            terminal = terminal_substep_s(soonest, gap[k], step_s, told_apart_m, options.terminal_substep)
            forced = 0.5 * (soonest**2 + terminal**2) / max(soonest, 1e-300)  # a correction may leave none
            tangent = closing[i] - 0.5 * before_s * centripetal[i]
            on_the_way = max(tangent + growth[i] * (0.5 * before_s + forced), 0.5 * closing[i])
            next_soonest = min(next_soonest, (gap[k] + raised) / on_the_way)
        soonest = (1.0 - options.short_of_contact) * next_soonest
    return soonest


@njit(cache=True)
def _repeat(sim: Simulation, index: int) -> None:
    """Take the step from a pose again, in parts and with contacts prepared far ahead."""
    state, parts = sim.state[0], sim.options.repeated_parts
    end_s = sim.time_s[index + 1]
    state.last = index
    part = (end_s - sim.time_s[index]) / parts
    _set_state(sim, part, 0.5, end_s - sim.time_s[index], False)
    for _ in range(parts):
        _substep(sim, part, 0.5)
    sim.time_s[state.last] = end_s
    state.grid = round(end_s / state.step_s)
    state.smooth_from = state.last
    _set_state(sim, state.step_s, 0.5, 0.0, False)


@njit(cache=True)
def _resolve(sim: Simulation, index: int, contact_s: float) -> None:
    """Go back to a pose, step to the contact, to those that follow at once, and from there to the grid."""
    state, options = sim.state[0], sim.options
    step_s = state.step_s
    state.last = index
    rest_s = 0.0
    for _ in range(options.most_impacts):
        if contact_s > options.at_once * step_s:
            _step_to_contact(sim, contact_s)
        if sim.worlds[state.world].restitution > 0.0:  # only a point that touches rebounds
            left_s = _next_contact_s(sim)
            if 1e-6 < left_s / step_s < options.at_once:
                _step_to_contact(sim, left_s)
        _impact(sim, options.impact_step * step_s)
        state.smooth_from = state.last
        time = sim.time_s[state.last]
        state.grid = math.ceil(time / step_s + 0.5)  # leaves half a step to one and a half
        rest_s = state.grid * step_s - time
        contact_s = _next_contact_s(sim)
        if contact_s > rest_s:
            break
    _set_state(sim, rest_s, 0.5, rest_s, False)
    _substep(sim, rest_s, 0.5)
    sim.time_s[state.last] = state.grid * step_s
    _set_state(sim, step_s, 0.5, 0.0, False)


@njit(cache=True)
def _impact(sim: Simulation, step_s: float) -> None:
    """Step over an impact, again where it turns the slip of the points away from the axes of their friction.

    Friction opposes the slip with which the points leave an impact. Along the axes that served the slip before it the
    impulse of a block that landed on an edge was off by up to 16 degrees, at any step.
    """
    state, options = sim.state[0], sim.options
    contact, chosen, axes_rad = state.last, False, 0.0
    for _ in range(options.tries_at_impact):
        state.last = contact
        near = _prepare(sim, step_s, 0.5, step_s, False)
        _place(sim, near, axes_rad if chosen else _axes_rad(sim, contact, near))
        time = sim.time_s[contact]
        _step_to(sim, time + step_s, time + 0.5 * step_s, step_s, True)
        unlike, slip = _mobilities(sim, contact, state.last, near)
        slipping = np.flatnonzero(slip != 0)
        unlike, slip = unlike[slipping], slip[slipping]
        axes_rad = best_axes_rad(unlike, slip, state.axes_rad, options.friction_direction_rad)
        chosen = True
        gained = squared_error(unlike, slip, state.axes_rad) - squared_error(unlike, slip, axes_rad)
        if gained <= options.impact_friction_direction_rad**2 * len(slipping):
            return


@njit(cache=True)
def _step_to_contact(sim: Simulation, contact_s: float) -> None:
    """Substeps that end as a point touches down, and not so late that the point already carries."""
    state, options = sim.state[0], sim.options
    index, step_s = state.last, state.step_s
    nearest_m = _nearest_coming_share(sim) * sim.half_diagonal_m
    told_apart_m = 2.0 * options.carrying_share * sim.half_diagonal_m
    for tries_left in range(options.tries_to_contact - 1, -1, -1):
        terminal_s = terminal_substep_s(contact_s, nearest_m, step_s, told_apart_m, options.terminal_substep)
        if terminal_s < contact_s:
            before_s = contact_s - terminal_s
            _set_state(sim, before_s, 0.5, before_s, True)
            _substep(sim, before_s, 0.5)
            left_s = _next_contact_s(sim)
            if left_s < 2.0 * terminal_s:
                terminal_s = max(left_s, options.least_terminal * terminal_s)
        _set_state(sim, terminal_s, 1.0, terminal_s, True)
        _substep(sim, terminal_s, 1.0)
        gap = _gaps_m(sim, state.last)
        closing = _closing_m_s(sim, state.last, _gaps_m(sim, state.last - 1), gap)
        offset = 0.5 * terminal_s**2 * _centripetal_m_s2(sim, state.last)
        late = False
        for i in range(len(gap)):
            # A point that the engine stopped is left with its offset alone.
            short = 0.6 * options.short_of_contact * terminal_s * closing[i]
            late = late or (closing[i] > state.resolved_m_s and gap[i] - offset[i] < short)
        if tries_left == 0 or not late:
            return
        state.last = index
        contact_s *= 1.0 - 2.0 * options.short_of_contact


@njit(cache=True)
def _next_contact_s(sim: Simulation) -> float:
    """Time from the latest pose to the next resolved impact; infinite if none comes."""
    state = sim.state[0]
    gap = _gaps_m(sim, state.last)
    closing = _closing_m_s(sim, state.last, _gaps_m(sim, state.last - 1), gap)
    points = np.flatnonzero((closing > state.resolved_m_s) & (gap > 0.0))
    if len(points) == 0:
        return np.inf
    return _time_to_contact_s(sim, state.last, points, state.smooth_from)


# --- for Python -------------------------------------------------------------------------------------------------------


class Integrator:
    """A rock on its way through a motion.

    Parameters
    ----------
    scene : Scene
    contact : ContactModel
        The scene's.
    motion : Motion
    time_step_s : float
        A whole step.
    settings : Settings
    pose, velocity_m_s, angular_velocity_rad_s
        State at time 0, support frame; the velocities belong to the start itself, not to a step's middle.
    pool : EnginePool
    """

    def __init__(
        self,
        scene: Scene,
        contact: ContactModel,
        motion: Motion,
        time_step_s: float,
        settings: Settings,
        pose: Pose,
        velocity_m_s: Vector,
        angular_velocity_rad_s: Vector,
        pool: engine.EnginePool,
    ) -> None:
        self._contact, self._surface, self._solver, self.pool = contact, scene.contact, settings.solver, pool
        counts = [contact.points_within(tilt) for tilt in REACH_DEG]
        acceleration = np.ascontiguousarray(motion.acceleration_m_s2 @ contact.scene_from_support)
        speed_m_s = float(np.sqrt(scene.gravity_m_s2 * contact.half_diagonal_m))
        self.sim = Simulation(
            state=np.zeros(1, STATE),
            worlds=np.zeros(len(counts), engine.WORLD),
            options=OPTIONS,
            **_track(2 * ROOM),
            centres_m=np.ascontiguousarray(contact.centres_body_m),
            mobilities=np.ascontiguousarray(contact.mobilities_m2),
            upright=np.ascontiguousarray(contact.support_from_body[2]),
            start_velocity=np.array([*velocity_m_s, *angular_velocity_rad_s]),
            half_diagonal_m=contact.half_diagonal_m,
            radius_m=contact.radius_m,
            set_tilt_deg=np.array(REACH_DEG),
            set_points=np.array(counts),
            sets=np.array([i for i, count in enumerate(counts) if count not in counts[i + 1 :]]),
            gravity_m_s2=np.array([0.0, 0.0, -scene.gravity_m_s2]) @ contact.scene_from_support,
            ground_acceleration_m_s2=acceleration,
            ground_velocity_m_s=_velocity_at_samples(acceleration, motion.time_step_s),
            sample_s=motion.time_step_s,
            whole_step_s=time_step_s,
            parts_when_low=settings.parts_when_low,
            whole_resolved_m_s=settings.resolved_landing * speed_m_s,
            residual_share=settings.solver.residual_share,
        )
        self._deepest_m = 0.0
        self.sim.pose[0] = [*pose[0], *pose[1]]
        moves = any((*velocity_m_s, *angular_velocity_rad_s))
        sunk = contact.lowest_m(pose) < -OPTIONS.penetrating_share * contact.half_diagonal_m
        parts = 1 if moves or sunk else settings.parts_when_low
        self.sim.state["set"] = self.sim.state["widest"] = self.sim.sets[0]
        begin(self.sim, parts)

    @property
    def last(self) -> int:
        """Index of the latest pose."""
        return int(self.sim.state["last"][0])

    @property
    def time_s(self) -> float:
        """Time of the latest pose."""
        return float(self.sim.time_s[self.last])

    @property
    def grid(self) -> int:
        """Whole steps from time 0 to the latest pose."""
        return int(self.sim.state["grid"][0] // self.sim.state["parts"][0])

    @property
    def steps(self) -> int:
        """Engine steps taken, repeated ones included."""
        return int(self.sim.state["steps"][0])

    @property
    def points(self) -> int:
        """How many of the contact points were looked at so far."""
        return int(self.sim.set_points[self.sim.state["widest"][0]])

    def advance(self, steps: int) -> None:
        """Go on by about this many whole steps."""
        goal = self.grid + steps
        while (why := advance(self.sim, goal)) != DONE:
            if why == NEEDS_ROOM:
                self._make_room()
            else:
                self._make_world(int(self.sim.state["set"][0]))

    def time_and_pose(self) -> tuple[Array, Array]:
        """Times (n,) and poses (n, 7) so far."""
        return self.sim.time_s[: self.last + 1], self.sim.pose[: self.last + 1]

    def penetration_m(self) -> float:
        """Deepest that a contact point has been below the surface."""
        return max(self._deepest_m, -lowest_gap_m(self.sim, 0), 0.0)

    def rest_until(self, since: int, grid: int) -> None:
        """Let the rock rest in a pose up to a whole step; what comes then depends on that pose alone."""
        self._deepest_m = max(self._deepest_m, -lowest_gap_m(self.sim, since))
        if self.last + ROOM > len(self.sim.time_s):
            self._make_room()
        self.sim.state["last"] = since
        rest_until(self.sim, grid)

    def _make_world(self, points: int) -> None:
        world = self.pool.world(self._contact, int(self.sim.set_points[points]))
        engine.configure_for(world, self._surface, self._solver)
        self.sim.worlds[points] = world[0]

    def _make_room(self) -> None:
        longer = _track(2 * len(self.sim.time_s))
        for name, array in longer.items():
            array[: self.last + 1] = getattr(self.sim, name)[: self.last + 1]
        self.sim = self.sim._replace(**longer)


def _track(room: int) -> dict[str, Any]:
    """Empty arrays of a trajectory."""
    return {
        "time_s": np.zeros(room),
        "velocity_time_s": np.zeros(room),
        "pose": np.zeros((room, 7)),
        "correction_m": np.zeros(room),
        "rests": np.zeros(room, np.bool_),
    }


def _velocity_at_samples(acceleration_m_s2: Array, sample_s: float) -> Array:
    velocity = np.zeros_like(acceleration_m_s2)
    means = 0.5 * (acceleration_m_s2[1:] + acceleration_m_s2[:-1])
    np.cumsum(sample_s * means, axis=0, out=velocity[1:])
    return velocity


OPTIONS = Options(
    short_chunk=6, long_chunk=64, fewest_steps=4, repeated_parts=4, tries_to_contact=4, tries_at_impact=3,
    most_impacts=40, short_of_contact=0.013, terminal_substep=0.1, least_terminal=0.2, left_out=0.5,
    carrying_share=3e-6, highest_offset=1.5, nearest_share=1e-9, ahead=1.5, at_once=0.02, impact_step=0.06,
    low_tilt_deg=0.1, penetrating_share=1e-4, prepared_steps=0.8, prepared_share=2e-5,
    friction_direction_rad=1e-3, impact_friction_direction_rad=1e-2,
)  # fmt: skip
