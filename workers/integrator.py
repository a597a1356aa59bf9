"""Time integration of second order across impacts: a leapfrog with steps that end where a point lands.

A step moves the rock with the velocity of its middle, which the specific force from middle to middle has brought about,
held by the contacts. Where no point slips that velocity is found directly (:mod:`workers.held`), and the engine moves
the rock with it and checks every contact; where a point slips the engine solves the contacts too
(:mod:`workers.engine_steps`).

An impact spoils the order of a step that goes over it: a solver that lets the point arrive just at the surface moves
the rock's weight to the new support at the start of the step, half a step too early on the average. The energy lost in
the impact is then too large in proportion to the step. So a step over which a point would land is cut where it touches,
the velocity is brought up to that moment, the impact changes it (:mod:`workers.impact`), and what is left of the step
follows, over as many impacts as come. Points that land slower than a preset resolves come to the surface as their step
ends.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from toppling.workers import engine, sticking
from toppling.workers.compiled import Array, compiled, inner
from toppling.workers.contact_points import REACH_DEG
from toppling.workers.engine_steps import approach_1_s, place, solved_step, take_over
from toppling.workers.events import gap_rates_m_s, time_to_contact_s
from toppling.workers.held import LOOKED_AHEAD, held_velocity, velocity_over
from toppling.workers.impact import resolve_impact
from toppling.workers.problem import Problem
from toppling.workers.simulation import (
    NOT,
    RAISED,
    STATE,
    Simulation,
    append,
    gaps_of,
    hover_for,
    largest_tilt_deg,
    lowest_gap_m,
    note_acceleration,
)

DONE, NEEDS_WORLD, NEEDS_ROOM = 0, 1, 2
"""Why :func:`advance` came back: it is there; `state.set` has no world yet; the trajectory's arrays are full."""

ROOM = 512
"""Poses that one step, cut at its impacts, may add."""

SOON = 0.02
"""Share of a step: the engine is given no shorter one before an impact of points that slip."""

LATER = 2.0
"""Times the time to a contact: where the velocity that was found for it meets the contact later, it is not yet met."""


@compiled
def advance(sim: Simulation, steps_to: int) -> int:
    """Go on until `steps_to` steps from time 0, or a step more; says why it came back."""
    state = sim.state[0]
    while state.grid < steps_to:
        _choose_set(sim)
        if sim.worlds[state.set].client == 0:
            return NEEDS_WORLD
        if state.last + ROOM > len(sim.time_s):
            return NEEDS_ROOM
        if state.world != state.set:
            take_over(sim)
        if not (state.rests and _stays(sim)):
            _step_over(sim)
    return DONE


@compiled
def rest_until(sim: Simulation, grid: int) -> None:
    """Let the rock rest where it is up to a step; what comes then depends on that pose alone."""
    state = sim.state[0]
    hover_for(sim, 0.0)
    last = state.last
    if not (last > 0 and state.rests and (sim.pose[last] == sim.pose[last - 1]).all()):
        last = append(sim, 0.0, 0.0)
        sim.pose[last] = sim.pose[last - 1]
    sim.time_s[last] = sim.velocity_time_s[last] = grid * sim.step_s
    sim.velocity[last] = 0.0
    sim.acceleration[:] = 0.0
    state.grid, state.rests, state.placed = grid, 1, NOT


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
def _stays(sim: Simulation) -> bool:
    """Take one step with a rock at rest, if its contact holds it; whether it does."""
    state, pose = sim.state[0], sim.pose[sim.state[0].last]
    near = gaps_of(sim, pose) < sim.contact.resting_share * sim.half_diagonal_m
    velocity, least = np.empty(6), np.zeros(len(near))
    held = held_velocity(sim, pose, sim.step_s, near, least, velocity)
    if not held or sim.carries.sum() < sticking.MOST_CARRYING:
        state.rests = 0
        return False
    if not sim.skips_rest:
        there, still = pose.copy(), np.zeros(6)
        raised_m = sim.contact.raised_share * sim.half_diagonal_m
        engine.glide(sim.worlds[state.world], sim.step_s, False, raised_m, there, still)
        state.engine_steps += 1
    rest_until(sim, state.grid + 1)
    return True


@inner
def _step_over(sim: Simulation) -> None:
    """Go on to the end of this step, or of the next where this one has nearly ended, over all impacts on the way."""
    state = sim.state[0]
    state.rests = 0
    for impact in range(sim.impact.most + 1):
        grid = math.ceil(sim.time_s[state.last] / sim.step_s + 0.5)  # leaves half a step to one and a half
        left_s = grid * sim.step_s - sim.time_s[state.last]
        if abs(left_s - sim.step_s) < 1e-9 * sim.step_s:
            left_s = sim.step_s
        resolved_m_s = sim.resolved_m_s if impact < sim.impact.most else np.inf
        if not _move(sim, left_s, resolved_m_s):
            sim.time_s[state.last] = grid * sim.step_s
            state.grid = grid
            return


@inner
def _move(sim: Simulation, left_s: float, resolved_m_s: float) -> bool:
    """Move for some time, or until a point has landed or nearly has; whether time is left."""
    last, velocity, lands = sim.state[0].last, np.empty(6), True
    hover_for(sim, 0.0)
    held, contact_s = velocity_over(sim, left_s, left_s, resolved_m_s, velocity)
    soonest_s = sim.impact.at_once * sim.step_s
    if held and soonest_s < contact_s < left_s:
        # Once more with the velocity up to the contact, which it meets a little sooner or later.
        before_s = contact_s
        held, contact_s = velocity_over(sim, before_s, left_s, resolved_m_s, velocity)
        lands = contact_s < LATER * before_s
        contact_s = contact_s if lands else before_s
        share = 0.5 * (contact_s - before_s) / (sim.time_s[last] - sim.velocity_time_s[last] + 0.5 * before_s)
        velocity += share * (velocity - sim.velocity[last])
    if not held:
        return _slide(sim, left_s, resolved_m_s)
    if contact_s > soonest_s:
        _glide(sim, velocity, contact_s)
    if contact_s >= left_s:
        return False
    if lands:
        resolve_impact(sim)
    return True


@inner
def _glide(sim: Simulation, velocity: Array, step_s: float) -> None:
    """Move with a velocity that meets all contacts."""
    state, last = sim.state[0], sim.state[0].last
    if state.near_share != sim.contact.checked_share:
        place(sim, sim.contact.checked_share, state.axes_rad)
    placed = state.placed == RAISED
    new = append(sim, step_s, 0.5 * step_s)
    sim.pose[new], sim.velocity[new] = sim.pose[last], velocity
    world, raised_m = sim.worlds[state.world], sim.contact.raised_share * sim.half_diagonal_m
    engine.glide(world, step_s, placed, raised_m, sim.pose[new], sim.velocity[new])
    state.engine_steps += 1
    state.placed = RAISED
    note_acceleration(sim, last)


@inner
def _slide(sim: Simulation, left_s: float, resolved_m_s: float) -> bool:
    """Move for some time, or until a point has landed, with contacts solved by the engine; whether one did."""
    state, contact, impact = sim.state[0], sim.contact, sim.impact
    last, world = state.last, sim.worlds[state.world]
    if state.slips_after >= 0.0 and world.friction_kinetic != world.friction_static:
        # The force of a step is that from middle to middle: slip may have begun before it, held by the latest step.
        held = (world.friction_static - world.friction_kinetic) * (state.slips_after - 0.5)
        engine.set_friction(world, max(world.friction_kinetic + held, 0.0))
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
            solved_step(sim, contact_s - terminal_s, 0.5, near)
            solved_step(sim, terminal_s, 1.0, impact.left_out * impact.terminal_share * near)
        resolve_impact(sim)
        return True
    near = max(2.0 * LOOKED_AHEAD * needed_m / sim.half_diagonal_m, contact.prepared_share)
    near = min(near, world.near_share)
    if 0.5 * near < state.near_share < 4.0 * near:  # what the engine was told of serves
        near = state.near_share
    solved_step(sim, left_s, 0.5, near)
    deepest_m = -contact.penetrating_share * sim.half_diagonal_m
    if gap.min() > deepest_m > gaps_of(sim, sim.pose[state.last]).min():
        state.last, state.placed = last, NOT
        near = max(LOOKED_AHEAD * left_s * approach_1_s(sim), world.near_share)
        for _ in range(contact.repeated_parts):
            solved_step(sim, left_s / contact.repeated_parts, 0.5, near)
        sim.acceleration[:] = 0.0
    return False


class Integrator:
    """A rock on its way through a motion, in worlds of a pool."""

    def __init__(self, problem: Problem, pool: engine.EnginePool) -> None:
        contact, motion, options = problem.contact, problem.motion, problem.options
        self._problem, self.pool = problem, pool
        # Of sets with as many points, that which serves most.
        reach_deg = {contact.points_within(tilt): tilt for tilt in REACH_DEG}
        acceleration = motion.acceleration_m_s2 @ contact.scene_from_support
        velocity = np.zeros_like(acceleration)
        means = 0.5 * (acceleration[1:] + acceleration[:-1])
        np.cumsum(motion.time_step_s * means, axis=0, out=velocity[1:])
        self.sim = Simulation(
            state=np.zeros(1, STATE),
            worlds=np.zeros(len(reach_deg), engine.WORLD),
            contact=options.contact,
            impact=options.impact,
            resolved_m_s=options.resolved_impact * problem.speed_m_s,
            allowed_m_s=options.contact.allowed_speed * problem.speed_m_s,
            skips_rest=problem.shortcuts,
            **_track(4 * ROOM),
            carries=np.zeros(len(contact.points_body_m), np.bool_),
            acceleration=np.zeros(6),
            points_m=contact.points_body_m,
            centres_m=contact.centres_body_m,
            radius_m=contact.radius_m,
            mobilities=np.ascontiguousarray(contact.mobilities_m2),
            inertia_m2=contact.principal_inertia_m2,
            upright=np.ascontiguousarray(contact.support_from_body[2]),
            half_diagonal_m=contact.half_diagonal_m,
            set_tilt_deg=np.array(list(reach_deg.values())),
            set_points=np.array(list(reach_deg)),
            gravity_m_s2=np.array([0.0, 0.0, -problem.scene.gravity_m_s2]) @ contact.scene_from_support,
            ground_acceleration_m_s2=acceleration,
            ground_velocity_m_s=velocity,
            sample_s=motion.time_step_s,
            step_s=problem.time_step_s,
        )
        self._deepest_m = 0.0
        self.sim.pose[0], self.sim.velocity[0] = problem.initial
        state = self.sim.state
        state["world"], state["rests"], state["slips_after"] = -1, problem.start is None, -1.0

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
        """Steps from time 0 to the latest pose."""
        return int(self.sim.state["grid"][0])

    @property
    def rests(self) -> bool:
        """Whether the rock rests in the latest pose."""
        return bool(self.sim.state["rests"][0])

    @property
    def steps(self) -> int:
        """Engine steps taken, repeated ones included."""
        return int(self.sim.state["engine_steps"][0])

    def advance(self, steps: int) -> None:
        """Go on by this many steps, or one more."""
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
        """Let the rock rest in a pose up to a step; what comes then depends on that pose alone."""
        if self.last + ROOM > len(self.sim.time_s):
            self._make_room()
        if since < self.last:
            self._deepest_m = max(self._deepest_m, -lowest_gap_m(self.sim, since))
            self.sim.state["last"], self.sim.state["rests"] = since, 0
        rest_until(self.sim, grid)

    def _make_world(self, points: int) -> None:
        problem = self._problem
        world = self.pool.world(problem.contact, int(self.sim.set_points[points]))
        engine.configure_for(world, problem.scene.contact, problem.options.solver)
        self.sim.worlds[points] = world[0]

    def _make_room(self) -> None:
        longer = _track(2 * len(self.sim.time_s))
        for name, array in longer.items():
            array[: self.last + 1] = getattr(self.sim, name)[: self.last + 1]
        self.sim = self.sim._replace(**longer)


def _track(room: int) -> dict[str, Any]:
    """Empty arrays of a trajectory."""
    columns = {"time_s": (room,), "velocity_time_s": (room,), "pose": (room, 7), "velocity": (room, 6)}
    return {name: np.zeros(shape) for name, shape in columns.items()}
