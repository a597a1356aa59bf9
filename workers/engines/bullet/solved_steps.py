"""Steps whose contacts the engine solves: where points slip, rebound as they slip, or wedge. Compiled."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from toppling.workers.compiled import Array, Vector, inner
from toppling.workers.contact.friction import Complex, best_axes_rad, point_mobilities, squared_error
from toppling.workers.engines.bullet import world as bullet
from toppling.workers.simulation import (
    EXACT,
    Simulation,
    append,
    gaps_of,
    largest_offset_m,
    note_acceleration,
    set_normal_offset,
    velocity_increment_m_s,
)

AHEAD = 1.5
"""Around an impact the engine is told of points this many times as far as the rock's speed takes them."""


@inner
def take_over(sim: Simulation, worlds: Any) -> None:
    """Give the rock to the world of the present set of points."""
    state, world = sim.state[0], worlds[sim.state[0].set]
    x, y, z = sim.gravity_m_s2
    impulse_m_s = math.sqrt(x * x + y * y + z * z) * sim.step_s
    near = sim.contact.prepared_steps * impulse_m_s * sim.step_s / sim.half_diagonal_m
    near = max(near, sim.contact.prepared_share)
    bullet.configure(world, impulse_m_s, near, sim.resolved_m_s)
    if state.world >= 0:
        bullet.hold_as(world, worlds[state.world])
    state.world = state.set
    place(sim, worlds, near, _axes_rad(sim, near))


@inner
def solved_step(
    sim: Simulation, worlds: Any, step_s: float, velocity_share: float, near_share: float
) -> None:
    """One step of the engine with the velocity that belongs to this share of it.

    The engine is told of points within a share of R.
    """
    state, last = sim.state[0], sim.state[0].last
    set_normal_offset(sim, step_s)
    axes_rad = _axes_rad(sim, near_share)
    if state.placed != EXACT or near_share != state.near_share or axes_rad != state.axes_rad:
        place(sim, worlds, near_share, axes_rad)
    force = _force_m_s2(sim, step_s, velocity_share)
    new = append(sim, step_s, velocity_share * step_s)
    bullet.step(worlds[state.world], sim.points_m, step_s, force, sim.pose[new], sim.velocity[new])
    state.engine_steps += 1
    state.placed = EXACT
    gap, carrying_m = gaps_of(sim, sim.pose[new]), largest_offset_m(sim)
    sim.active[:] = False
    for i in range(len(gap)):
        sim.active[i] = gap[i] < carrying_m
    note_acceleration(sim, last)


@inner
def solved_impact(sim: Simulation, worlds: Any) -> None:
    """Step over an impact, again where it turns the slip of the points away from the axes of their friction.

    Friction opposes the slip with which the points leave an impact. Along the axes that served the slip before it the
    impulse of a block that landed on an edge was off by up to 16 degrees, at any step.
    """
    state, step_s = sim.state[0], sim.impact.engine_step * sim.step_s
    contact, world = state.last, worlds[state.world]
    state.slips_after = -1.0
    set_normal_offset(sim, step_s)
    near = max(AHEAD * step_s * approach_1_s(sim), world.near_share)
    axes_rad = _axes_rad(sim, near)
    for _ in range(sim.impact.engine_tries):
        state.last = contact
        place(sim, worlds, near, axes_rad)
        force = _force_m_s2(sim, step_s, 0.5)
        new = append(sim, step_s, 0.5 * step_s)
        bullet.rebound(world, sim.points_m, step_s, force, sim.pose[new], sim.velocity[new])
        state.engine_steps += 1
        unlike, slip = _mobilities(sim, sim.pose[contact], sim.velocity[new], near)
        slipping = np.flatnonzero(slip != 0)
        unlike, slip = unlike[slipping], slip[slipping]
        axes_rad = best_axes_rad(unlike, slip, state.axes_rad, sim.contact.friction_direction_rad)
        gained = squared_error(unlike, slip, state.axes_rad) - squared_error(unlike, slip, axes_rad)
        if gained <= sim.contact.impact_friction_direction_rad**2 * len(slipping):
            break
    sim.acceleration[:] = 0.0
    state.placed = EXACT


@inner
def approach_1_s(sim: Simulation) -> float:
    """How fast points approach the plane at most, over R."""
    velocity = sim.velocity[sim.state[0].last]
    spin = math.sqrt(velocity[3] ** 2 + velocity[4] ** 2 + velocity[5] ** 2)
    return abs(velocity[2]) / sim.half_diagonal_m + spin


@inner
def place(sim: Simulation, worlds: Any, near_share: float, axes_rad: float) -> None:
    """Give the engine the latest pose and velocity, with contacts prepared within a share of R."""
    state, last = sim.state[0], sim.state[0].last
    bullet.place(worlds[state.world], sim.pose[last], sim.velocity[last], near_share, axes_rad)
    state.near_share, state.axes_rad, state.placed = near_share, axes_rad, EXACT


@inner
def _axes_rad(sim: Simulation, near_share: float) -> float:
    """Axes that serve the friction of the points that are near in the latest pose."""
    state = sim.state[0]
    unlike, slip = _mobilities(sim, sim.pose[state.last], sim.velocity[state.last], near_share)
    return best_axes_rad(unlike, slip, state.axes_rad, sim.contact.friction_direction_rad)


@inner
def _mobilities(sim: Simulation, pose: Array, velocity: Array, near_share: float) -> tuple[Complex, Complex]:
    """Mobilities and slips of the points within a share of R."""
    near = np.flatnonzero(gaps_of(sim, pose) < near_share * sim.half_diagonal_m)
    return point_mobilities(sim.points_m, sim.mobilities, near, pose, velocity, sim.resolved_m_s)


@inner
def _force_m_s2(sim: Simulation, step_s: float, velocity_share: float) -> Vector:
    """Specific force for a step of the engine that brings the velocity up to a share of it."""
    last = sim.state[0].last
    until_s = sim.time_s[last] + velocity_share * step_s
    x, y, z = velocity_increment_m_s(sim, sim.velocity_time_s[last], until_s)
    return x / step_s, y / step_s, z / step_s
