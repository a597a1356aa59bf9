"""What an impact leaves of a rock's velocity where the points that land stick. Compiled, no engine."""

from __future__ import annotations

import numpy as np

from toppling.workers.compiled import Array, Flags, inner
from toppling.workers.contact.gaps import gap_rates_m_s, slip_m_s
from toppling.workers.contact.sticking import sticking_velocity
from toppling.workers.quaternion import to_world
from toppling.workers.simulation import RAISED, Simulation, gaps_of, touching_m


@inner
def arrive(sim: Simulation) -> None:
    """Bring the velocity of the latest pose up to its time, as the active contacts hold it, if they can."""
    count = sim.set_points[sim.state[0].set]
    _hold_here(sim, sim.active[:count].copy(), np.zeros(count))
    sim.acceleration[:] = 0.0


@inner
def land_sticking(sim: Simulation) -> bool:
    """Change the velocity of the latest pose as its touching points land and stick; whether they can.

    What touches leaves with Newton's share of the speed that it lands with.
    """
    state, pose = sim.state[0], sim.pose[sim.state[0].last]
    gap = gaps_of(sim, pose)
    near, least = np.empty(len(gap), np.bool_), np.empty(len(gap))
    gap_rates_m_s(sim.points_m, pose, sim.velocity[state.last], least)
    for i in range(len(gap)):
        near[i] = sim.active[i] or gap[i] < touching_m(sim)
        least[i] = -sim.restitution * least[i] if -least[i] > sim.resolved_m_s else 0.0
    sim.active[:] = False
    if not _hold_here(sim, near, least):
        return False
    state.needed_friction = 0.0
    return True


@inner
def _hold_here(sim: Simulation, near: Flags, least: Array) -> bool:
    """Bring the velocity up to the time of the latest pose, as points that stick hold it; whether they can."""
    state, last, velocity = sim.state[0], sim.state[0].last, np.empty(6)
    lasting_s = sim.time_s[last] - sim.velocity_time_s[last]
    if not sticking_velocity(sim, sim.pose[last], lasting_s, near, least, velocity):
        return False
    sim.velocity[last] = velocity
    sim.velocity_time_s[last] = sim.time_s[last]
    state.placed = min(state.placed, RAISED)
    return True


@inner
def lowest_slip_m_s(sim: Simulation) -> float:
    """Speed along the plane of the lowest contact point."""
    pose, velocity = sim.pose[sim.state[0].last], sim.velocity[sim.state[0].last]
    lowest = gaps_of(sim, pose).argmin()
    x, y, z = to_world(sim.points_m[lowest, 0], sim.points_m[lowest, 1], sim.points_m[lowest, 2], pose)
    return slip_m_s(velocity, (x, y, z))
