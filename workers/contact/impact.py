"""What an impact leaves of a rock's velocity where the points that land stick. Compiled, no engine."""

from __future__ import annotations

from toppling.models.compiled import inner
from toppling.workers.contact.gaps import find_rates, look, slip_m_s
from toppling.workers.contact.sticking import forget_active, sticking_velocity
from toppling.workers.simulation import (
    ACTIVE,
    ARM_X,
    ARM_Y,
    ARM_Z,
    FOUND,
    GAP,
    LEAST,
    NEAR,
    RAISED,
    RATE,
    Simulation,
    forget_acceleration,
    points_in_use,
)


@inner
def arrive(sim: Simulation) -> None:
    """Look at the latest pose and bring its velocity up to its time, as active contacts hold it, if they can."""
    look(sim, sim.state[0].last)
    for i in range(points_in_use(sim)):
        sim.flags[NEAR, i], sim.candidates[LEAST, i] = sim.flags[ACTIVE, i], 0.0
    _hold_here(sim)
    forget_acceleration(sim)


@inner
def land_sticking(sim: Simulation) -> bool:
    """Change the velocity of the latest pose as its touching points land and stick; whether they can.

    It has been looked at. What touches leaves with Newton's share of the speed that it lands with.
    """
    fixed, flags = sim.fixed[0], sim.flags
    gap, rate, least = sim.candidates[GAP], sim.candidates[RATE], sim.candidates[LEAST]
    find_rates(sim, sim.velocity[sim.state[0].last])
    for i in range(points_in_use(sim)):
        flags[NEAR, i] = flags[ACTIVE, i] or gap[i] < fixed.touching_m
        least[i] = -fixed.restitution * rate[i] if -rate[i] > fixed.resolved_m_s else 0.0
    forget_active(sim)
    if not _hold_here(sim):
        return False
    sim.state[0].needed_friction = 0.0
    return True


@inner
def _hold_here(sim: Simulation) -> bool:
    """Bring the velocity up to the time of the latest pose, as points that stick hold it; whether they can."""
    state, last = sim.state[0], sim.state[0].last
    if not sticking_velocity(sim, sim.time_s[last] - sim.velocity_time_s[last]):
        return False
    for k in range(6):
        sim.velocity[last, k] = sim.work[FOUND, k]
    sim.velocity_time_s[last] = sim.time_s[last]
    state.placed = min(state.placed, RAISED)
    return True


@inner
def lowest_slip_m_s(sim: Simulation) -> float:
    """Speed along the plane of the lowest contact point, in the pose looked at."""
    candidates, lowest = sim.candidates, 0
    for i in range(points_in_use(sim)):
        if candidates[GAP, i] < candidates[GAP, lowest]:
            lowest = i
    arm = (candidates[ARM_X, lowest], candidates[ARM_Y, lowest], candidates[ARM_Z, lowest])
    return slip_m_s(sim.velocity[sim.state[0].last], arm)
