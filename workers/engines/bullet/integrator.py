"""Time integration of second order across impacts: a leapfrog with steps that end where a point lands.

A step moves the rock with the velocity of its middle, which the specific force from middle to middle has brought about,
held by the contacts. Where no point slips that velocity is found directly (`contact/sticking.py`), and the motion with
it is known: a straight line and a rotation. The presets that judge let PyBullet carry it out and check every contact;
the others take such a step themselves, and PyBullet repeats a share of them, of which none may differ. Where a point
slips PyBullet solves the contacts (`solved_steps.py`).

An impact spoils the order of a step that goes over it: a solver that lets the point arrive just at the surface moves
the rock's weight to the new support at the start of the step, half a step too early on the average. The energy lost in
the impact is then too large in proportion to the step. So a step over which a point would land is cut where it touches,
the velocity is brought up to that moment, the impact changes it (`contact/impact.py`), and what is left of the step
follows, over as many impacts as come. Points that land slower than a preset resolves come to the surface as their step
ends.
"""

from __future__ import annotations

import math

import numpy as np

from toppling.models.compiled import compiled, inner
from toppling.workers.contact.active_set import MOST_ACTIVE
from toppling.workers.contact.events import time_to_contact_s
from toppling.workers.contact.gaps import find_rates, look, lowest_looked_at_m
from toppling.workers.contact.impact import arrive, land_sticking, lowest_slip_m_s
from toppling.workers.contact.offset import set_normal_offset
from toppling.workers.contact.sticking import (
    LOOKED_AHEAD,
    count_active,
    forget_slip,
    sticking_velocity,
    velocity_over_step,
)
from toppling.workers.engines.bullet import world as bullet
from toppling.workers.engines.bullet.let_down import let_down
from toppling.workers.engines.bullet.pool import MOST_WORLDS, EnginePool, configure_for, process_pool
from toppling.workers.engines.bullet.prescribed_steps import ALLOWED, advance_prescribed, carry_out, hand_over
from toppling.workers.engines.bullet.solved_steps import (
    Worlds,
    approach_1_s,
    solved_impact,
    solved_step,
)
from toppling.workers.engines.bullet.world import WORLD
from toppling.workers.engines.protocol import GroundSteps, Integrator, StepCheckError
from toppling.workers.ground.rolling import RollingIntegrator
from toppling.workers.ground.stepping import take_steps
from toppling.workers.history import ROOM, StateHistory, rest_until
from toppling.workers.observation import Watch, calls_for_look
from toppling.workers.problem import Problem
from toppling.workers.simulation import (
    ACCELERATION,
    FOUND,
    GAP,
    LEAST,
    MEAN,
    NEAR,
    NOT,
    RATE,
    Simulation,
    copy,
    forget_acceleration,
    largest_tilt_deg,
    points_in_use,
)
from toppling.workers.termination import unwatched

__all__ = ["advance", "integrator", "let_down", "process_pool"]

_DONE, _NEEDS_WORLD, _NEEDS_ROOM, _UNLIKE = 0, 1, 2, 3
"""Why :func:`advance` came back: it is there; `state.set` has no world yet; the trajectory's arrays are full; the
engine has repeated an own step and moved the rock elsewhere."""

_SOON = 0.02
"""Share of a step: the engine is given no shorter one before an impact of points that slip."""

_LATER = 2.0
"""Times the time to a contact: where the velocity that was found for it meets the contact later, it is not yet met."""


@compiled
def advance(sim: Simulation, worlds: Worlds, watch: Watch, steps: int) -> int:
    """Go on to the goal, or a step more, and by so many steps again until a look is called for; why it came back."""
    state = sim.state[0]
    while True:
        why = _take_steps(sim, worlds)
        if why != _DONE or calls_for_look(sim, watch, state.since):
            return why
        state.since, state.goal = state.last, state.grid + steps


@inner
def _take_steps(sim: Simulation, worlds: Worlds) -> int:
    """Go on to the goal, or a step more; says why it came back."""
    state = sim.state[0]
    while state.grid < state.goal:
        _choose_set(sim)
        if worlds.records[state.set].client == 0:
            return _NEEDS_WORLD
        if state.last + ROOM > len(sim.time_s):
            return _NEEDS_ROOM
        if not sim.fixed[0].own_steps:
            hand_over(sim, worlds)
        if not (state.rests and _stays(sim, worlds)):
            _step_over(sim, worlds)
        if state.unlike > 0.0:
            return _UNLIKE
    return _DONE


@inner
def _choose_set(sim: Simulation) -> None:
    """Choose candidates that serve the tilts of the next steps at twice the present spin.

    Fewer only below half of what they serve, or the sets would change to and fro.
    """
    state = sim.state[0]
    velocity = sim.velocity[state.last]
    spin = math.sqrt(velocity[3] ** 2 + velocity[4] ** 2 + velocity[5] ** 2)
    needed_deg = largest_tilt_deg(sim, state.last) + math.degrees(4.0 * spin * sim.fixed[0].step_s)
    chosen = len(sim.set_points) - 1
    for points in range(chosen, -1, -1):
        if sim.set_tilt_deg[points] * (0.5 if points < state.set else 1.0) >= needed_deg:
            chosen = points
    state.set, state.widest = chosen, max(state.widest, chosen)


@inner
def _stays(sim: Simulation, worlds: Worlds) -> bool:
    """Take one step with a rock at rest, if its contact holds it; whether it does."""
    state, fixed, last = sim.state[0], sim.fixed[0], sim.state[0].last
    look(sim, last)
    for i in range(points_in_use(sim)):
        sim.flags[NEAR, i], sim.candidates[LEAST, i] = sim.candidates[GAP, i] < fixed.resting_m, 0.0
    held = sticking_velocity(sim, fixed.step_s)
    if not held or count_active(sim) < MOST_ACTIVE:
        state.rests = 0
        return False
    if not fixed.skips_rest:
        state.steps += 1
        if not fixed.own_steps:
            copy(sim.pose[last], sim.pose[last + 1])
            for k in range(6):
                sim.velocity[last + 1, k] = 0.0
            state.placed = NOT
            carry_out(sim, worlds, fixed.step_s, last + 1, 1.0)
    rest_until(sim, state.grid + 1)
    return True


@inner
def _step_over(sim: Simulation, worlds: Worlds) -> None:
    """Go on to the end of this step, or of the next where this one has nearly ended, over all impacts on the way."""
    state, fixed = sim.state[0], sim.fixed[0]
    state.rests = 0
    for impact in range(fixed.most + 1):
        grid = math.ceil(sim.time_s[state.last] / fixed.step_s + 0.5)  # leaves half a step to one and a half
        left_s = grid * fixed.step_s - sim.time_s[state.last]
        if abs(left_s - fixed.step_s) < 1e-9 * fixed.step_s:
            left_s = fixed.step_s
        resolved_m_s = fixed.resolved_m_s if impact < fixed.most else np.inf
        if not _move(sim, worlds, left_s, resolved_m_s):
            sim.time_s[state.last] = grid * fixed.step_s
            state.grid = grid
            return


@inner
def _move(sim: Simulation, worlds: Worlds, left_s: float, resolved_m_s: float) -> bool:
    """Move for some time, or until a point has landed or nearly has; whether time is left."""
    state, fixed, lands = sim.state[0], sim.fixed[0], True
    set_normal_offset(sim, 0.0)
    if state.world >= 0 and worlds.records[state.world].friction != fixed.friction_static:
        return _slide(sim, worlds, left_s, resolved_m_s)
    held, contact_s = velocity_over_step(sim, left_s, left_s, resolved_m_s)
    soonest_s = fixed.at_once * fixed.step_s
    if held and soonest_s < contact_s < left_s:
        # Once more with the velocity up to the contact, which it meets a little sooner or later.
        before_s = contact_s
        held, contact_s = velocity_over_step(sim, before_s, left_s, resolved_m_s)
        lands = contact_s < _LATER * before_s
        contact_s = contact_s if lands else before_s
        since_s = sim.time_s[state.last] - sim.velocity_time_s[state.last] + 0.5 * before_s
        share = 0.5 * (contact_s - before_s) / since_s
        for k in range(6):
            sim.work[FOUND, k] += share * (sim.work[FOUND, k] - sim.velocity[state.last, k])
    if not held:
        return _slide(sim, worlds, left_s, resolved_m_s)
    if contact_s > soonest_s:
        advance_prescribed(sim, worlds, contact_s)
    if contact_s >= left_s:
        return False
    if lands:
        _resolve_impact(sim, worlds)
    return True


@inner
def _slide(sim: Simulation, worlds: Worlds, left_s: float, resolved_m_s: float) -> bool:
    """Move for some time, or until a point has landed, with contacts solved by the engine; whether one did."""
    state, fixed = sim.state[0], sim.fixed[0]
    hand_over(sim, worlds)
    last, world = state.last, worlds.records[state.world]
    if state.slips_after >= 0.0 and world.friction_kinetic != world.friction_static:
        # The force of a step is that from middle to middle: slip may have begun before it, held by the latest step.
        held = (world.friction_static - world.friction_kinetic) * (state.slips_after - 0.5)
        bullet.set_friction(world, max(world.friction_kinetic + held, 0.0))
    forget_slip(sim)
    contact_s, nearest_m, needed_m = _next_contact(sim, left_s, resolved_m_s)
    if contact_s < left_s:
        if contact_s > _SOON * fixed.step_s:
            near = min(world.near_share, fixed.left_out * nearest_m / fixed.half_diagonal_m)
            terminal_s = fixed.terminal_share * contact_s
            solved_step(sim, worlds, contact_s - terminal_s, 0.5, near)
            solved_step(sim, worlds, terminal_s, 1.0, fixed.left_out * fixed.terminal_share * near)
        _resolve_impact(sim, worlds)
        return True
    near = max(2.0 * LOOKED_AHEAD * needed_m / fixed.half_diagonal_m, fixed.prepared_share)
    near = min(near, world.near_share)
    if 0.5 * near < state.near_share < 4.0 * near:  # what the engine was told of serves
        near = state.near_share
    lowest_m, deepest_m = lowest_looked_at_m(sim), -fixed.penetrating_share * fixed.half_diagonal_m
    solved_step(sim, worlds, left_s, 0.5, near)
    if lowest_m > deepest_m > lowest_looked_at_m(sim):
        state.last, state.placed = last, NOT
        near = max(LOOKED_AHEAD * left_s * approach_1_s(sim), world.near_share)
        for _ in range(fixed.repeated_parts):
            solved_step(sim, worlds, left_s / fixed.repeated_parts, 0.5, near)
        forget_acceleration(sim)
    return False


@inner
def _next_contact(sim: Simulation, left_s: float, resolved_m_s: float) -> tuple[float, float, float]:
    """When the next point lands of a rock that slips, `left_s` if none does; the least and largest gap that closes.

    The least is that of points which land fast enough to be resolved; the pose has been looked at.
    """
    fixed, last, work = sim.fixed[0], sim.state[0].last, sim.work
    since_s = sim.time_s[last] - sim.velocity_time_s[last]
    for k in range(6):
        work[MEAN, k] = sim.velocity[last, k] + work[ACCELERATION, k] * (since_s + 0.5 * left_s)
    find_rates(sim, work[MEAN])
    gap, rate = sim.candidates[GAP], sim.candidates[RATE]
    contact_s, nearest_m, needed_m = left_s, np.inf, 0.0
    for i in range(points_in_use(sim)):
        if gap[i] + LOOKED_AHEAD * rate[i] * left_s < 0.0:
            needed_m = max(needed_m, gap[i])
            if gap[i] > fixed.carrying_m and -rate[i] > resolved_m_s:
                nearest_m = min(nearest_m, gap[i])
                lands_s = time_to_contact_s(
                    sim, i, sim.pose[last], sim.velocity[last], work[ACCELERATION], since_s, left_s
                )
                contact_s = min(contact_s, lands_s)
    return contact_s, nearest_m, needed_m


@inner
def _resolve_impact(sim: Simulation, worlds: Worlds) -> None:
    """Change the velocity of the latest pose as its touching points land: at once where they stick, else in a step."""
    state, fixed = sim.state[0], sim.fixed[0]
    arrive(sim)
    if fixed.two_frictions and count_active(sim) == 0:
        # A rock in the air lands as one that slips if its lowest point moves along the plane.
        hand_over(sim, worlds)
        world = worlds.records[state.world]
        sliding = lowest_slip_m_s(sim) > world.impulse_m_s
        bullet.set_friction(world, world.friction_kinetic if sliding else world.friction_static)
    sticks = state.world < 0 or worlds.records[state.world].friction == fixed.friction_static
    if sticks and land_sticking(sim):
        return
    hand_over(sim, worlds)
    solved_impact(sim, worlds)


class BulletIntegrator:
    """A rock on its way through a motion, in worlds of a pool.

    Raises
    ------
    ValueError
        If its contact candidates come in more sets than a pool keeps worlds: a world at work would be given away.
    """

    def __init__(self, problem: Problem, pool: EnginePool) -> None:
        self._problem, self._pool, contact = problem, pool, problem.contact
        self.history = StateHistory(problem)
        sets = len(self.history.sim.set_points)
        if sets > MOST_WORLDS:
            raise ValueError(
                f"the rock has {sets} sets of contact candidates: at most {MOST_WORLDS} are kept at once"
            )
        self._worlds = Worlds(
            records=np.zeros(sets, WORLD),
            points_m=np.ascontiguousarray(contact.points_body_m),
            mobilities=np.ascontiguousarray(contact.mobilities_m2),
        )

    def advance(self, steps: int, watch: Watch | None = None) -> int:
        """Go on by this many steps, or one more, and again until a look is called for.

        Returns
        -------
        int
            Index of the pose in which the last of these blocks of steps began.

        Raises
        ------
        StepCheckError
            If the engine repeats an own step and comes elsewhere.
        """
        state, watch = self.history.sim.state, watch or unwatched(self._problem)
        state["since"], state["goal"] = self.history.last, self.history.grid + steps
        while (why := advance(self.history.sim, self._worlds, watch, steps)) != _DONE:
            if why == _NEEDS_ROOM:
                self.history.make_room()
            elif why == _NEEDS_WORLD:
                self._make_world(int(self.history.sim.state["set"][0]))
            else:
                unlike = float(self.history.sim.state["unlike"][0])
                raise StepCheckError(self.history.time_s, unlike, ALLOWED)
        return int(state["since"][0])

    def restart(self) -> None:
        """Nothing to forget: a rock that rests is placed anew."""

    def _make_world(self, points: int) -> None:
        problem = self._problem
        world = self._pool.world(problem.contact, int(self.history.sim.set_points[points]))
        configure_for(world, problem.scene.contact, problem.options.solver)
        self._worlds.records[points] = world[0]


def integrator(problem: Problem, pool: EnginePool | None = None) -> Integrator:
    """The integrator of one shake, in worlds of a pool; those of the process unless given.

    On a rounded base the steps are the program's own: Bullet's points do not move over a rock that rolls.
    """
    if problem.rolls:
        return RollingIntegrator(problem)
    return BulletIntegrator(problem, pool or process_pool())


def ground_steps(problem: Problem) -> GroundSteps:  # noqa: ARG001  (the seam's signature)
    """On ground that is no plane the steps are the program's own: Bullet's edges kick."""
    return take_steps
