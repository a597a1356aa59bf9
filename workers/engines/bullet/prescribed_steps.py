"""Steps with a velocity that meets all contacts: taken as they are, or carried out by the engine. Compiled."""

from __future__ import annotations

import math

import numpy as np

from toppling.models.compiled import inner
from toppling.workers.contact.gaps import find_centripetal, find_rates, look, lowest_looked_at_m, turned_on
from toppling.workers.contact.offset import sphere_height_m
from toppling.workers.engines.bullet import world as bullet
from toppling.workers.engines.bullet.solved_steps import Worlds, place, take_over
from toppling.workers.simulation import (
    FOUND,
    GAP,
    LEAST,
    NOT,
    RAISED,
    RATE,
    Simulation,
    append,
    copy,
    note_acceleration,
    points_in_use,
)

_SUNK_SHARE = 0.1
"""Of the height by which the engine has the rock higher: a point that sinks farther in an own step is the engine's."""

_RAISED_OVER = 1.2
"""Times the depth of a point on its tangent."""

ALLOWED = 1e-9
"""Of R, and of sqrt(g R): by which the engine's repetition of an own step may differ."""


@inner
def hand_over(sim: Simulation, worlds: Worlds) -> None:
    """Make sure that the world of the present set has the rock; in which pose, `state.placed` says."""
    if sim.state[0].world != sim.state[0].set:
        take_over(sim, worlds)


@inner
def advance_prescribed(sim: Simulation, worlds: Worlds, step_s: float) -> None:
    """Move with the velocity found, which meets all contacts; where it misses one the engine always carries it out."""
    state, last = sim.state[0], sim.state[0].last
    new = append(sim, step_s, 0.5 * step_s)
    state.steps += 1
    if sim.fixed[0].own_steps and _take_own_step(sim, last, new, step_s):
        if state.world >= 0:
            bullet.forget_friction(worlds.records[state.world])
        if _is_drawn(sim):
            _check(sim, worlds, last, step_s)
        state.placed = NOT
    else:
        _let_engine_move(sim, worlds, last, step_s)
    note_acceleration(sim, last)


@inner
def _let_engine_move(sim: Simulation, worlds: Worlds, last: int, step_s: float) -> None:
    """Let the engine move the rock from pose `last` with the velocity found, and take from it what meets no contact."""
    state, fixed, new = sim.state[0], sim.fixed[0], sim.state[0].last
    state.last = last
    hand_over(sim, worlds)
    times = _raised_times(sim, step_s)
    if state.near_share != times * fixed.checked_share:
        place(sim, worlds, times * fixed.checked_share, state.axes_rad)
    state.last = new
    copy(sim.pose[last], sim.pose[new])
    copy(sim.work[FOUND], sim.velocity[new])
    carry_out(sim, worlds, step_s, new, times)
    state.placed = RAISED


@inner
def _take_own_step(sim: Simulation, last: int, new: int, step_s: float) -> bool:
    """A straight line of the centre of mass, and the exact rotation about it; false where a point sinks by it."""
    pose, velocity, there = sim.pose[last], sim.work[FOUND], sim.pose[new]
    x, y, z, w = turned_on(pose, velocity[3], velocity[4], velocity[5], step_s)
    size = math.sqrt(x * x + y * y + z * z + w * w)
    there[3], there[4], there[5], there[6] = x / size, y / size, z / size, w / size
    for k in range(3):
        there[k] = pose[k] + step_s * velocity[k]
    for k in range(6):
        sim.velocity[new, k] = velocity[k]
    fixed = sim.fixed[0]
    lowest_m = min(lowest_looked_at_m(sim), 0.0) - _SUNK_SHARE * fixed.raised_share * fixed.half_diagonal_m
    look(sim, new)
    if lowest_looked_at_m(sim) >= lowest_m:
        return True
    look(sim, last)
    return False


@inner
def _raised_times(sim: Simulation, step_s: float) -> float:
    """By how many times the least height the engine has the rock higher in a prescribed step, a power of two.

    A point that comes to the surface on an arc, or leaves it on one, is below it on its tangent, where the engine would
    stop it; one that ends below the surface is not spared that. And its sphere is lower than the point as it tilts.
    """
    fixed, candidates = sim.fixed[0], sim.candidates
    find_rates(sim, sim.work[FOUND])
    find_centripetal(sim, sim.work[FOUND])
    below_m = 0.0
    for i in range(points_in_use(sim)):
        arc_m = 0.5 * step_s * step_s * candidates[LEAST, i]
        below_m = max(below_m, min(-candidates[GAP, i] - step_s * candidates[RATE, i], arc_m))
    below_m += fixed.radius_m - sphere_height_m(sim, sim.pose[sim.state[0].last])
    times = 1.0
    while times * fixed.raised_share * fixed.half_diagonal_m < _RAISED_OVER * below_m:
        times *= 2.0
    return times


@inner
def carry_out(sim: Simulation, worlds: Worlds, step_s: float, index: int, times: float) -> None:
    """Let the engine move the rock from the pose to that with the velocity which stand at an index."""
    state, fixed = sim.state[0], sim.fixed[0]
    raised_m = times * fixed.raised_share * fixed.half_diagonal_m
    world, placed = worlds.records[state.world], state.placed == RAISED
    bullet.advance_prescribed(world, step_s, placed, raised_m, sim.pose[index], sim.velocity[index])
    state.engine_steps += 1


@inner
def _is_drawn(sim: Simulation) -> bool:
    """Whether the engine is to repeat an own step: a seeded share, by a congruential generator (Knuth's MMIX)."""
    state = sim.state[0]
    state.draw = state.draw * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)
    return float(state.draw >> np.uint64(11)) * 2.0**-53 < sim.fixed[0].checked_steps


@inner
def _check(sim: Simulation, worlds: Worlds, last: int, step_s: float) -> None:
    """Let the engine repeat the latest step from pose `last`, beyond the trajectory's end, and note how it differs."""
    state, fixed, new = sim.state[0], sim.fixed[0], sim.state[0].last
    near_share, axes_rad, held_by = state.near_share, state.axes_rad, state.world
    state.last = last
    look(sim, last)
    hand_over(sim, worlds)
    times = _raised_times(sim, step_s)
    place(sim, worlds, times * fixed.checked_share, state.axes_rad)
    state.last = new
    copy(sim.pose[last], sim.pose[new + 1])
    copy(sim.velocity[new], sim.velocity[new + 1])
    carry_out(sim, worlds, step_s, new + 1, times)
    state.near_share, state.axes_rad, state.world = (
        near_share,
        axes_rad,
        held_by,
    )  # as if it had not been asked
    speed_m_s = math.sqrt(-fixed.gravity_m_s2[2] * fixed.half_diagonal_m)
    along = 0.0
    for k in range(3, 7):
        along += sim.pose[new, k] * sim.pose[new + 1, k]
    same = 1.0 if along >= 0.0 else -1.0  # both quaternions are the same attitude
    unlike = 0.0
    for k in range(3):
        unlike = max(unlike, abs(sim.pose[new, k] - sim.pose[new + 1, k]) / fixed.half_diagonal_m)
        unlike = max(unlike, abs(sim.velocity[new, k] - sim.velocity[new + 1, k]) / speed_m_s)
        spin = abs(sim.velocity[new, 3 + k] - sim.velocity[new + 1, 3 + k])
        unlike = max(unlike, spin * fixed.half_diagonal_m / speed_m_s)
    for k in range(3, 7):
        unlike = max(unlike, abs(sim.pose[new, k] - same * sim.pose[new + 1, k]))
    if not unlike <= ALLOWED:
        state.unlike = unlike
