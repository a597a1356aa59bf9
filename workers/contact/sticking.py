"""The velocity that contacts leave the rock where none of them slips, and when the next point lands. Compiled."""

from __future__ import annotations

from toppling.models.compiled import inner
from toppling.workers.contact import active_set
from toppling.workers.contact.events import time_to_contact_s
from toppling.workers.contact.gaps import find_centripetal, find_rates
from toppling.workers.simulation import (
    ACCELERATION,
    ACTIVE,
    FOUND,
    FREE,
    GAP,
    LEAST,
    MEAN,
    NEAR,
    RATE,
    ROTATION,
    TOUCHES,
    TRIED,
    Simulation,
    points_in_use,
    velocity_increment_m_s,
)

LOOKED_AHEAD = 1.2
"""Times the rest of the step: points that come down so far at their present speed may land within it."""


@inner
def velocity_over_step(
    sim: Simulation, step_s: float, left_s: float, resolved_m_s: float
) -> tuple[bool, float]:
    """Find the velocity of the middle of a step from the latest pose, by which it moves the rock, into FOUND.

    The pose has been looked at. Points that land within `left_s` slower than `resolved_m_s` come to the surface as the
    step ends. Returns whether no point slips, and when the first other one lands, `left_s` if none does.
    """
    fixed, last, flags = sim.fixed[0], sim.state[0].last, sim.flags
    gap, rate, least = sim.candidates[GAP], sim.candidates[RATE], sim.candidates[LEAST]
    lasting_s = sim.time_s[last] - sim.velocity_time_s[last] + 0.5 * step_s
    count = points_in_use(sim)
    find_rates(sim, sim.velocity[last])
    find_centripetal(sim, sim.velocity[last])
    # So that the point comes to the surface on its arc; from below in a whole step, as less would throw it.
    per_s, per_s_below = 1.0 / step_s, 1.0 / max(step_s, fixed.step_s)
    for i in range(count):
        least[i] = -gap[i] * (per_s if gap[i] > 0.0 else per_s_below) - 0.5 * step_s * least[i]
    for i in range(count):
        flags[NEAR, i] = flags[ACTIVE, i] or gap[i] < fixed.touching_m
        if flags[NEAR, i] and -rate[i] > resolved_m_s:  # it has landed as the latest step ended
            return True, 0.0
    while True:
        if not sticking_velocity(sim, lasting_s):
            return False, left_s
        find_rates(sim, sim.work[FOUND])
        contact_s, slow, known = left_s, False, False
        for i in range(count):
            lands = -rate[i] > resolved_m_s and gap[i] + LOOKED_AHEAD * rate[i] * left_s < 0.0
            if flags[NEAR, i] or not (lands or rate[i] < least[i]):
                continue
            lands_s = left_s
            if lands:
                if not known:
                    _mean_acceleration(sim, lasting_s)
                    known = True
                since_s = lasting_s - 0.5 * step_s
                pose, before = sim.pose[last], sim.velocity[last]
                lands_s = time_to_contact_s(sim, i, pose, before, sim.work[MEAN], since_s, left_s)
            if lands_s < left_s:
                contact_s = min(contact_s, lands_s)
            elif rate[i] < least[i]:
                flags[NEAR, i] = slow = True
        if contact_s < left_s or not slow:
            return True, contact_s


@inner
def _mean_acceleration(sim: Simulation, lasting_s: float) -> None:
    last, work = sim.state[0].last, sim.work
    for k in range(6):
        work[MEAN, k] = (work[FOUND, k] - sim.velocity[last, k]) / lasting_s


@inner
def sticking_velocity(sim: Simulation, lasting_s: float) -> bool:
    """Find the velocity some time after that of the latest pose, as active contacts stick; whether they can.

    Those flagged NEAR may carry, each with a LEAST velocity along its normal. Sets those that are ACTIVE, or if one
    would slip, when (`slips_after`).
    """
    state, flags, friction = sim.state[0], sim.flags, sim.fixed[0].friction_static
    _free_velocity(sim, lasting_s)
    count = _list_near(sim)
    if count == 0:
        for k in range(6):
            sim.work[FOUND, k] = sim.work[FREE, k]
        forget_active(sim)
        state.needed_friction = 0.0
        return True
    found, needed = active_set.solve(sim, count)
    if not found or needed > friction:
        state.slips_after = -1.0
        if found:  # between the middles of the latest step and of this one
            before = state.needed_friction
            state.slips_after = (friction - before) / (needed - before) if 0.0 < before <= friction else 0.5
        return False
    state.needed_friction = needed
    forget_active(sim)
    for k in range(count):
        flags[ACTIVE, sim.near[k]] = flags[TRIED, sim.near[k]]
    return True


@inner
def _list_near(sim: Simulation) -> int:
    """List the candidates flagged NEAR, with the flags that finding active ones begins with; how many there are."""
    flags, count = sim.flags, 0
    for i in range(points_in_use(sim)):
        if flags[NEAR, i]:
            flags[TRIED, i] = flags[ACTIVE, i]
            flags[TOUCHES, i] = sim.candidates[GAP, i] < sim.fixed[0].touching_m
            sim.near[count] = i
            count += 1
    return count


@inner
def forget_active(sim: Simulation) -> None:
    """No candidate carries."""
    active = sim.flags[ACTIVE]
    for i in range(len(active)):
        active[i] = False


@inner
def activate(sim: Simulation, nearer_m: float) -> None:
    """Candidates in use whose gap is less carry, as an engine has left them."""
    forget_active(sim)
    for i in range(points_in_use(sim)):
        sim.flags[ACTIVE, i] = sim.candidates[GAP, i] < nearer_m


@inner
def count_active(sim: Simulation) -> int:
    """How many candidates carry."""
    active, count = sim.flags[ACTIVE], 0
    for i in range(len(active)):
        count += 1 if active[i] else 0
    return count


@inner
def forget_slip(sim: Simulation) -> None:
    """What is known of the latest step's friction says nothing of the next."""
    sim.state[0].slips_after, sim.state[0].needed_friction = -1.0, 0.0


@inner
def _free_velocity(sim: Simulation, lasting_s: float) -> None:
    """Velocity some time after that of the latest pose, without contact, into FREE.

    The moment of the rock's own turning is that at the middle of the time, as far as the latest step tells.
    """
    last, work, inertia = sim.state[0].last, sim.work, sim.fixed[0].inertia_m2
    since_s, half_s = sim.velocity_time_s[last], 0.5 * lasting_s
    ahead = velocity_increment_m_s(sim, since_s, since_s + lasting_s)
    u = sim.velocity[last, 3] + half_s * work[ACCELERATION, 3]
    v = sim.velocity[last, 4] + half_s * work[ACCELERATION, 4]
    w = sim.velocity[last, 5] + half_s * work[ACCELERATION, 5]
    r, s, t = ROTATION, ROTATION + 1, ROTATION + 2
    a = work[r, 0] * u + work[s, 0] * v + work[t, 0] * w
    b = work[r, 1] * u + work[s, 1] * v + work[t, 1] * w
    c = work[r, 2] * u + work[s, 2] * v + work[t, 2] * w
    x, y, z = inertia[0], inertia[1], inertia[2]
    a, b, c = (y - z) / x * b * c, (z - x) / y * c * a, (x - y) / z * a * b
    for k in range(3):
        turned = work[ROTATION + k, 0] * a + work[ROTATION + k, 1] * b + work[ROTATION + k, 2] * c
        work[FREE, k] = sim.velocity[last, k] + ahead[k]
        work[FREE, 3 + k] = sim.velocity[last, 3 + k] + lasting_s * turned
