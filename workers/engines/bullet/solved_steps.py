"""Steps whose contacts the engine solves: where points slip, rebound as they slip, or wedge. Compiled."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from toppling.models.compiled import Array, Indices, Vector, inner
from toppling.workers.contact.friction import Complex, best_axes_rad, point_mobilities, squared_error
from toppling.workers.contact.gaps import look
from toppling.workers.contact.offset import largest_offset_m, set_normal_offset
from toppling.workers.contact.sticking import activate
from toppling.workers.engines.bullet import world as bullet
from toppling.workers.simulation import (
    EXACT,
    GAP,
    Simulation,
    append,
    forget_acceleration,
    note_acceleration,
    points_in_use,
    velocity_increment_m_s,
)

_AHEAD = 1.5
"""Around an impact the engine is told of points this many times as far as the rock's speed takes them."""


class Worlds(NamedTuple):
    """A rock's worlds in one shake, and what the engine wants to know of its points."""

    records: Any  # (sets,) of world.WORLD; those without a client are still to be built
    points_m: Array  # (n, 3) body axes
    mobilities: Array  # (n, 6): see contact/friction.py


@inner
def take_over(sim: Simulation, worlds: Worlds) -> None:
    """Give the rock to the world of the present set of points."""
    state, fixed, world = sim.state[0], sim.fixed[0], worlds.records[sim.state[0].set]
    x, y, z = fixed.gravity_m_s2
    impulse_m_s = math.sqrt(x * x + y * y + z * z) * fixed.step_s
    near = fixed.prepared_steps * impulse_m_s * fixed.step_s / fixed.half_diagonal_m
    near = max(near, fixed.prepared_share)
    bullet.configure(world, impulse_m_s, near, fixed.resolved_m_s)
    if state.world >= 0:
        bullet.hold_as(world, worlds.records[state.world])
    state.world = state.set
    look(sim, state.last)
    place(sim, worlds, near, _axes_rad(sim, worlds, near))


@inner
def solved_step(
    sim: Simulation, worlds: Worlds, step_s: float, velocity_share: float, near_share: float
) -> None:
    """One step of the engine with the velocity that belongs to this share of it.

    The engine is told of points within a share of R. The pose that it leads to has been looked at.
    """
    state, last = sim.state[0], sim.state[0].last
    set_normal_offset(sim, step_s)
    axes_rad = _axes_rad(sim, worlds, near_share)
    if state.placed != EXACT or near_share != state.near_share or axes_rad != state.axes_rad:
        place(sim, worlds, near_share, axes_rad)
    force = _force_m_s2(sim, step_s, velocity_share)
    new, world = append(sim, step_s, velocity_share * step_s), worlds.records[state.world]
    bullet.step(world, worlds.points_m, step_s, force, sim.pose[new], sim.velocity[new])
    state.steps += 1
    state.engine_steps += 1
    state.placed = EXACT
    look(sim, new)
    activate(sim, largest_offset_m(sim))
    note_acceleration(sim, last)


@inner(allocates=True)
def solved_impact(sim: Simulation, worlds: Worlds) -> None:
    """Step over an impact, again where it turns the slip of the points away from the axes of their friction.

    Friction opposes the slip with which the points leave an impact. Along the axes that served the slip before it the
    impulse of a block that landed on an edge was off by up to 16 degrees, at any step.
    """
    state, fixed = sim.state[0], sim.fixed[0]
    step_s = fixed.engine_step * fixed.step_s
    contact, world = state.last, worlds.records[state.world]
    set_normal_offset(sim, step_s)
    near = max(_AHEAD * step_s * approach_1_s(sim), world.near_share)
    points = _points_within(sim, near)
    axes_rad = _axes_rad(sim, worlds, near)
    for _ in range(fixed.engine_tries):
        state.last = contact
        place(sim, worlds, near, axes_rad)
        force = _force_m_s2(sim, step_s, 0.5)
        new = append(sim, step_s, 0.5 * step_s)
        bullet.rebound(world, worlds.points_m, step_s, force, sim.pose[new], sim.velocity[new])
        state.steps += 1
        state.engine_steps += 1
        unlike, slip = _mobilities(sim, worlds, points, sim.pose[contact], sim.velocity[new])
        slipping = 0
        for k in range(len(slip)):
            if slip[k] != 0:
                unlike[slipping], slip[slipping] = unlike[k], slip[k]
                slipping += 1
        unlike, slip = unlike[:slipping], slip[:slipping]
        axes_rad = best_axes_rad(unlike, slip, state.axes_rad, fixed.friction_direction_rad)
        gained = squared_error(unlike, slip, state.axes_rad) - squared_error(unlike, slip, axes_rad)
        if gained <= fixed.impact_friction_direction_rad**2 * slipping:
            break
    forget_acceleration(sim)
    state.placed = EXACT


@inner
def approach_1_s(sim: Simulation) -> float:
    """How fast points approach the plane at most, over R."""
    velocity = sim.velocity[sim.state[0].last]
    spin = math.sqrt(velocity[3] ** 2 + velocity[4] ** 2 + velocity[5] ** 2)
    return abs(velocity[2]) / sim.fixed[0].half_diagonal_m + spin


@inner
def place(sim: Simulation, worlds: Worlds, near_share: float, axes_rad: float) -> None:
    """Give the engine the latest pose and velocity, with contacts prepared within a share of R."""
    state, last = sim.state[0], sim.state[0].last
    bullet.place(worlds.records[state.world], sim.pose[last], sim.velocity[last], near_share, axes_rad)
    state.near_share, state.axes_rad, state.placed = near_share, axes_rad, EXACT


@inner(allocates=True)
def _axes_rad(sim: Simulation, worlds: Worlds, near_share: float) -> float:
    """Axes that serve the friction of the points that are near in the latest pose, which has been looked at."""
    state = sim.state[0]
    points = _points_within(sim, near_share)
    unlike, slip = _mobilities(sim, worlds, points, sim.pose[state.last], sim.velocity[state.last])
    return best_axes_rad(unlike, slip, state.axes_rad, sim.fixed[0].friction_direction_rad)


@inner(allocates=True)
def _points_within(sim: Simulation, near_share: float) -> Indices:
    """Candidates within a share of R in the pose looked at."""
    found, near_m, count = (
        np.empty(points_in_use(sim), np.int64),
        near_share * sim.fixed[0].half_diagonal_m,
        0,
    )
    for i in range(len(found)):
        if sim.candidates[GAP, i] < near_m:
            found[count] = i
            count += 1
    return found[:count]


@inner(allocates=True)
def _mobilities(
    sim: Simulation, worlds: Worlds, points: Indices, pose: Array, velocity: Array
) -> tuple[Complex, Complex]:
    """Mobilities and slips of some candidates."""
    return point_mobilities(
        worlds.points_m, worlds.mobilities, points, pose, velocity, sim.fixed[0].resolved_m_s
    )


@inner
def _force_m_s2(sim: Simulation, step_s: float, velocity_share: float) -> Vector:
    """Specific force for a step of the engine that brings the velocity up to a share of it."""
    last = sim.state[0].last
    until_s = sim.time_s[last] + velocity_share * step_s
    x, y, z = velocity_increment_m_s(sim, sim.velocity_time_s[last], until_s)
    return x / step_s, y / step_s, z / step_s
