"""Time integration of second order across impacts: a leapfrog with steps that end where a point lands.

A step moves the rock with the velocity of its middle, which the specific force from middle to middle has brought about,
held by the contacts. Where no point slips that velocity is found directly (`contact/sticking.py`), and the engine moves
the rock with it and checks every contact; where a point slips the engine solves the contacts too
(`solved_steps.py`).

An impact spoils the order of a step that goes over it: a solver that lets the point arrive just at the surface moves
the rock's weight to the new support at the start of the step, half a step too early on the average. The energy lost in
the impact is then too large in proportion to the step. So a step over which a point would land is cut where it touches,
the velocity is brought up to that moment, the impact changes it (`contact/impact.py`), and what is left of the step
follows, over as many impacts as come. Points that land slower than a preset resolves come to the surface as their step
ends.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from toppling.workers.compiled import Array, compiled, inner
from toppling.workers.contact.active_set import MOST_ACTIVE
from toppling.workers.contact.events import time_to_contact_s
from toppling.workers.contact.gaps import gap_rates_m_s
from toppling.workers.contact.impact import arrive, land_sticking, lowest_slip_m_s
from toppling.workers.contact.sticking import LOOKED_AHEAD, sticking_velocity, velocity_over_step
from toppling.workers.engines.bullet import world as bullet
from toppling.workers.engines.bullet.let_down import let_down
from toppling.workers.engines.bullet.pool import EnginePool, configure_for, process_pool
from toppling.workers.engines.bullet.solved_steps import (
    approach_1_s,
    place,
    solved_impact,
    solved_step,
    take_over,
)
from toppling.workers.engines.bullet.world import WORLD
from toppling.workers.problem import Problem
from toppling.workers.simulation import (
    NOT,
    RAISED,
    ROOM,
    Simulation,
    StateHistory,
    append,
    gaps_of,
    largest_tilt_deg,
    note_acceleration,
    rest_until,
    set_normal_offset,
)

__all__ = ["advance", "integrator", "let_down", "process_pool"]

DONE, NEEDS_WORLD, NEEDS_ROOM = 0, 1, 2
"""Why :func:`advance` came back: it is there; `state.set` has no world yet; the trajectory's arrays are full."""

SOON = 0.02
"""Share of a step: the engine is given no shorter one before an impact of points that slip."""

LATER = 2.0
"""Times the time to a contact: where the velocity that was found for it meets the contact later, it is not yet met."""


@compiled
def advance(sim: Simulation, worlds: Any, steps_to: int) -> int:
    """Go on until `steps_to` steps from time 0, or a step more; says why it came back."""
    state = sim.state[0]
    while state.grid < steps_to:
        _choose_set(sim)
        if worlds[state.set].client == 0:
            return NEEDS_WORLD
        if state.last + ROOM > len(sim.time_s):
            return NEEDS_ROOM
        if state.world != state.set:
            take_over(sim, worlds)
        if not (state.rests and _stays(sim, worlds)):
            _step_over(sim, worlds)
    return DONE


@inner
def _choose_set(sim: Simulation) -> None:
    """Choose points that serve the tilts of the next steps at twice the present spin.

    Fewer points only below half of what they serve, or the sets would change to and fro.
    """
    state = sim.state[0]
    velocity = sim.velocity[state.last]
    spin = math.sqrt(velocity[3] ** 2 + velocity[4] ** 2 + velocity[5] ** 2)
    needed_deg = largest_tilt_deg(sim, state.last) + math.degrees(4.0 * spin * sim.step_s)
    chosen = len(sim.set_points) - 1
    for points in range(chosen, -1, -1):
        if sim.set_tilt_deg[points] * (0.5 if points < state.set else 1.0) >= needed_deg:
            chosen = points
    state.set, state.widest = chosen, max(state.widest, chosen)


@inner
def _stays(sim: Simulation, worlds: Any) -> bool:
    """Take one step with a rock at rest, if its contact holds it; whether it does."""
    state, pose = sim.state[0], sim.pose[sim.state[0].last]
    near = gaps_of(sim, pose) < sim.contact.resting_share * sim.half_diagonal_m
    velocity, least = np.empty(6), np.zeros(len(near))
    held = sticking_velocity(sim, pose, sim.step_s, near, least, velocity)
    if not held or sim.active.sum() < MOST_ACTIVE:
        state.rests = 0
        return False
    if not sim.skips_rest:
        there, still = pose.copy(), np.zeros(6)
        raised_m = sim.contact.raised_share * sim.half_diagonal_m
        bullet.advance_prescribed(worlds[state.world], sim.step_s, False, raised_m, there, still)
        state.engine_steps += 1
    rest_until(sim, state.grid + 1)
    return True


@inner
def _step_over(sim: Simulation, worlds: Any) -> None:
    """Go on to the end of this step, or of the next where this one has nearly ended, over all impacts on the way."""
    state = sim.state[0]
    state.rests = 0
    for impact in range(sim.impact.most + 1):
        grid = math.ceil(sim.time_s[state.last] / sim.step_s + 0.5)  # leaves half a step to one and a half
        left_s = grid * sim.step_s - sim.time_s[state.last]
        if abs(left_s - sim.step_s) < 1e-9 * sim.step_s:
            left_s = sim.step_s
        resolved_m_s = sim.resolved_m_s if impact < sim.impact.most else np.inf
        if not _move(sim, worlds, left_s, resolved_m_s):
            sim.time_s[state.last] = grid * sim.step_s
            state.grid = grid
            return


@inner
def _move(sim: Simulation, worlds: Any, left_s: float, resolved_m_s: float) -> bool:
    """Move for some time, or until a point has landed or nearly has; whether time is left."""
    last, velocity, lands = sim.state[0].last, np.empty(6), True
    set_normal_offset(sim, 0.0)
    if worlds[sim.state[0].world].friction != sim.friction_static:
        return _slide(sim, worlds, left_s, resolved_m_s)
    held, contact_s = velocity_over_step(sim, left_s, left_s, resolved_m_s, velocity)
    soonest_s = sim.impact.at_once * sim.step_s
    if held and soonest_s < contact_s < left_s:
        # Once more with the velocity up to the contact, which it meets a little sooner or later.
        before_s = contact_s
        held, contact_s = velocity_over_step(sim, before_s, left_s, resolved_m_s, velocity)
        lands = contact_s < LATER * before_s
        contact_s = contact_s if lands else before_s
        share = 0.5 * (contact_s - before_s) / (sim.time_s[last] - sim.velocity_time_s[last] + 0.5 * before_s)
        velocity += share * (velocity - sim.velocity[last])
    if not held:
        return _slide(sim, worlds, left_s, resolved_m_s)
    if contact_s > soonest_s:
        _advance_prescribed(sim, worlds, velocity, contact_s)
    if contact_s >= left_s:
        return False
    if lands:
        _resolve_impact(sim, worlds)
    return True


@inner
def _advance_prescribed(sim: Simulation, worlds: Any, velocity: Array, step_s: float) -> None:
    """Move with a velocity that meets all contacts."""
    state, last = sim.state[0], sim.state[0].last
    if state.near_share != sim.contact.checked_share:
        place(sim, worlds, sim.contact.checked_share, state.axes_rad)
    placed = state.placed == RAISED
    new = append(sim, step_s, 0.5 * step_s)
    sim.pose[new], sim.velocity[new] = sim.pose[last], velocity
    world, raised_m = worlds[state.world], sim.contact.raised_share * sim.half_diagonal_m
    bullet.advance_prescribed(world, step_s, placed, raised_m, sim.pose[new], sim.velocity[new])
    state.engine_steps += 1
    state.placed = RAISED
    note_acceleration(sim, last)


@inner
def _slide(sim: Simulation, worlds: Any, left_s: float, resolved_m_s: float) -> bool:
    """Move for some time, or until a point has landed, with contacts solved by the engine; whether one did."""
    state, contact, impact = sim.state[0], sim.contact, sim.impact
    last, world = state.last, worlds[state.world]
    if state.slips_after >= 0.0 and world.friction_kinetic != world.friction_static:
        # The force of a step is that from middle to middle: slip may have begun before it, held by the latest step.
        held = (world.friction_static - world.friction_kinetic) * (state.slips_after - 0.5)
        bullet.set_friction(world, max(world.friction_kinetic + held, 0.0))
    state.slips_after, state.needed_friction = -1.0, 0.0
    gap, since_s = gaps_of(sim, sim.pose[last]), sim.time_s[last] - sim.velocity_time_s[last]
    rate = np.empty(len(gap))
    mean = sim.velocity[last] + sim.acceleration * (since_s + 0.5 * left_s)
    gap_rates_m_s(sim.points_m, sim.pose[last], mean, rate)
    contact_s, nearest_m, needed_m = left_s, np.inf, 0.0
    for i in range(len(gap)):
        if gap[i] + LOOKED_AHEAD * rate[i] * left_s < 0.0:
            needed_m = max(needed_m, gap[i])
            if gap[i] > contact.carrying_share * sim.half_diagonal_m and -rate[i] > resolved_m_s:
                nearest_m = min(nearest_m, gap[i])
                point, pose, velocity = sim.points_m[i : i + 1], sim.pose[last], sim.velocity[last]
                lands_s = time_to_contact_s(point, pose, velocity, sim.acceleration, since_s, left_s)
                contact_s = min(contact_s, lands_s)
    if contact_s < left_s:
        if contact_s > SOON * sim.step_s:
            near = min(world.near_share, impact.left_out * nearest_m / sim.half_diagonal_m)
            terminal_s = impact.terminal_share * contact_s
            solved_step(sim, worlds, contact_s - terminal_s, 0.5, near)
            solved_step(sim, worlds, terminal_s, 1.0, impact.left_out * impact.terminal_share * near)
        _resolve_impact(sim, worlds)
        return True
    near = max(2.0 * LOOKED_AHEAD * needed_m / sim.half_diagonal_m, contact.prepared_share)
    near = min(near, world.near_share)
    if 0.5 * near < state.near_share < 4.0 * near:  # what the engine was told of serves
        near = state.near_share
    solved_step(sim, worlds, left_s, 0.5, near)
    deepest_m = -contact.penetrating_share * sim.half_diagonal_m
    if gap.min() > deepest_m > gaps_of(sim, sim.pose[state.last]).min():
        state.last, state.placed = last, NOT
        near = max(LOOKED_AHEAD * left_s * approach_1_s(sim), world.near_share)
        for _ in range(contact.repeated_parts):
            solved_step(sim, worlds, left_s / contact.repeated_parts, 0.5, near)
        sim.acceleration[:] = 0.0
    return False


@inner
def _resolve_impact(sim: Simulation, worlds: Any) -> None:
    """Change the velocity of the latest pose as its touching points land: at once where they stick, else in a step."""
    world = worlds[sim.state[0].world]
    arrive(sim)
    if world.friction_static != world.friction_kinetic and not sim.active.any():
        # A rock in the air lands as one that slips if its lowest point moves along the plane.
        sliding = lowest_slip_m_s(sim) > world.impulse_m_s
        bullet.set_friction(world, world.friction_kinetic if sliding else world.friction_static)
    if world.friction == world.friction_static and land_sticking(sim):
        return
    solved_impact(sim, worlds)


class BulletIntegrator:
    """A rock on its way through a motion, in worlds of a pool."""

    def __init__(self, problem: Problem, pool: EnginePool) -> None:
        self._problem, self._pool = problem, pool
        self.history = StateHistory(problem)
        self._worlds = np.zeros(len(self.history.sim.set_points), WORLD)  # to be built as they are needed

    def advance(self, steps: int) -> None:
        """Go on by this many steps, or one more."""
        goal = self.history.grid + steps
        while (why := advance(self.history.sim, self._worlds, goal)) != DONE:
            if why == NEEDS_ROOM:
                self.history.make_room()
            else:
                self._make_world(int(self.history.sim.state["set"][0]))

    def restart(self) -> None:
        """Nothing to forget: a rock that rests is placed anew."""

    def _make_world(self, points: int) -> None:
        problem = self._problem
        world = self._pool.world(problem.contact, int(self.history.sim.set_points[points]))
        configure_for(world, problem.scene.contact, problem.options.solver)
        self._worlds[points] = world[0]


def integrator(problem: Problem, pool: EnginePool | None = None) -> BulletIntegrator:
    """The integrator of one shake, in worlds of a pool; those of the process unless given."""
    return BulletIntegrator(problem, pool or process_pool())
