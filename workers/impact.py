"""One impact resolved: the velocity brought up to it, and what it leaves of it. Compiled."""

from __future__ import annotations

import numpy as np

from toppling.workers import engine
from toppling.workers.compiled import Array, Flags, inner
from toppling.workers.engine_steps import solved_impact
from toppling.workers.events import gap_rates_m_s
from toppling.workers.held import held_velocity
from toppling.workers.quaternion import to_world
from toppling.workers.simulation import RAISED, Simulation, gaps_of, touching_m


@inner
def resolve_impact(sim: Simulation) -> None:
    """Change the velocity of the latest pose as its touching points land: at once where they stick, else in a step."""
    state, pose = sim.state[0], sim.pose[sim.state[0].last]
    world, gap = sim.worlds[state.world], gaps_of(sim, pose)
    _hold_here(
        sim, sim.carries[: len(gap)].copy(), np.zeros(len(gap))
    )  # the velocity at the time of the impact
    sim.acceleration[:] = 0.0
    if world.friction_static != world.friction_kinetic and not sim.carries.any():
        # A rock in the air lands as one that slips if its lowest point moves along the plane.
        sliding = _lowest_slip_m_s(sim) > world.impulse_m_s
        engine.set_friction(world, world.friction_kinetic if sliding else world.friction_static)
    if world.friction == world.friction_static:
        # What touches leaves with Newton's share of the speed that it lands with.
        near, least = np.empty(len(gap), np.bool_), np.empty(len(gap))
        gap_rates_m_s(sim.points_m, pose, sim.velocity[state.last], least)
        for i in range(len(gap)):
            near[i] = sim.carries[i] or gap[i] < touching_m(sim)
            least[i] = -world.restitution * least[i] if -least[i] > sim.resolved_m_s else 0.0
        sim.carries[:] = False
        if _hold_here(sim, near, least):
            state.needed_friction = 0.0
            return
    solved_impact(sim)


@inner
def _hold_here(sim: Simulation, near: Flags, least: Array) -> bool:
    """Bring the velocity up to the time of the latest pose, as points that stick hold it; whether they can."""
    state, last, velocity = sim.state[0], sim.state[0].last, np.empty(6)
    lasting_s = sim.time_s[last] - sim.velocity_time_s[last]
    if not held_velocity(sim, sim.pose[last], lasting_s, near, least, velocity):
        return False
    sim.velocity[last] = velocity
    sim.velocity_time_s[last] = sim.time_s[last]
    state.placed = min(state.placed, RAISED)
    return True


@inner
def _lowest_slip_m_s(sim: Simulation) -> float:
    """Speed along the plane of the lowest contact point."""
    pose, velocity = sim.pose[sim.state[0].last], sim.velocity[sim.state[0].last]
    lowest = gaps_of(sim, pose).argmin()
    x, y, z = to_world(sim.points_m[lowest, 0], sim.points_m[lowest, 1], sim.points_m[lowest, 2], pose)
    return engine.slip_m_s(velocity, (x, y, z))
