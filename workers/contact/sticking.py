"""The velocity that contacts leave the rock where none of them slips, and when the next point lands. Compiled."""

from __future__ import annotations

import numpy as np

from toppling.workers.compiled import Array, Flags, inner
from toppling.workers.contact import active_set
from toppling.workers.contact.events import time_to_contact_s
from toppling.workers.contact.gaps import centripetal_m_s2, gap_rates_m_s
from toppling.workers.quaternion import to_body, to_world
from toppling.workers.simulation import Simulation, gaps_of, touching_m, velocity_increment_m_s

LOOKED_AHEAD = 1.2
"""Times the rest of the step: points that come down so far at their present speed may land within it."""


@inner
def velocity_over_step(
    sim: Simulation, step_s: float, left_s: float, resolved_m_s: float, velocity: Array
) -> tuple[bool, float]:
    """Find the velocity (6,) of the middle of a step from the latest pose, by which it moves the rock.

    Points that land within `left_s` slower than `resolved_m_s` come to the surface as the step ends. Returns whether
    no point slips, and when the first other one lands, `left_s` if none does.
    """
    state = sim.state[0]
    last = state.last
    pose, since_s = sim.pose[last], sim.time_s[last] - sim.velocity_time_s[last]
    gap = gaps_of(sim, pose)
    near, rate, least = np.empty(len(gap), np.bool_), np.empty(len(gap)), np.empty(len(gap))
    gap_rates_m_s(sim.points_m, pose, sim.velocity[last], rate)
    centripetal_m_s2(sim.points_m, pose, sim.velocity[last], least)
    for i in range(len(gap)):
        near[i] = sim.active[i] or gap[i] < touching_m(sim)
        if near[i] and -rate[i] > resolved_m_s:  # it has landed as the latest step ended
            return True, 0.0
        # So that the point comes to the surface on its arc; from below in a whole step, as less would throw it.
        least[i] = -gap[i] / (step_s if gap[i] > 0.0 else max(step_s, sim.step_s)) - 0.5 * step_s * least[i]
    while True:
        if not sticking_velocity(sim, pose, since_s + 0.5 * step_s, near, least, velocity):
            return False, left_s
        gap_rates_m_s(sim.points_m, pose, velocity, rate)
        acceleration = (velocity - sim.velocity[last]) / (since_s + 0.5 * step_s)
        contact_s, slow = left_s, False
        for i in range(len(gap)):
            if near[i]:
                continue
            lands_s = left_s
            if -rate[i] > resolved_m_s and gap[i] + LOOKED_AHEAD * rate[i] * left_s < 0.0:
                point, before = sim.points_m[i : i + 1], sim.velocity[last]
                lands_s = time_to_contact_s(point, pose, before, acceleration, since_s, left_s)
            if lands_s < left_s:
                contact_s = min(contact_s, lands_s)
            elif rate[i] < least[i]:
                near[i] = slow = True
        if contact_s < left_s or not slow:
            return True, contact_s


@inner
def sticking_velocity(
    sim: Simulation, pose: Array, lasting_s: float, near: Flags, least: Array, velocity: Array
) -> bool:
    """Find the velocity (6,) some time after that of the latest pose, as the points that carry stick; whether they can.

    May carry `near` points, each with a `least` velocity along the normal. Sets `sim.active`, or if a point would slip
    `slips_after`.
    """
    state, friction = sim.state[0], sim.friction_static
    free, points = _free_velocity(sim, pose, lasting_s), np.flatnonzero(near)
    if len(points) == 0:
        velocity[:] = free
        sim.active[:] = False
        state.needed_friction = 0.0
        return True
    these = active_set.Contacts(
        arms_m=np.empty((len(points), 3)),
        least_m_s=least[points],
        touches=gaps_of(sim, pose)[points] < touching_m(sim),
        active=sim.active[points],
        free=free,
        mobility=_mobility(sim, pose),
        allowed_m_s=sim.allowed_m_s,
        velocity=velocity,
        slides=np.zeros(len(points), np.bool_),
        chosen=np.empty(active_set.MOST_ACTIVE, np.int64),
        rows=np.empty((6, 6)),
        gram=np.empty((6, 6)),
        impulse=np.empty(6),
    )
    for k, i in enumerate(points):
        these.arms_m[k] = to_world(sim.points_m[i, 0], sim.points_m[i, 1], sim.points_m[i, 2], pose)
    found, needed = active_set.solve(these)
    if not found or needed > friction:
        state.slips_after = -1.0
        if found:  # between the middles of the latest step and of this one
            before = state.needed_friction
            state.slips_after = (friction - before) / (needed - before) if 0.0 < before <= friction else 0.5
        return False
    state.needed_friction = needed
    sim.active[:] = False
    sim.active[points] = these.active
    return True


@inner
def _free_velocity(sim: Simulation, pose: Array, lasting_s: float) -> Array:
    """Velocity (6,) some time after that of the latest pose, without contact.

    The moment of the rock's own turning is that at the middle of the time, as far as the latest step tells.
    """
    last = sim.state[0].last
    free, since_s = sim.velocity[last].copy(), sim.velocity_time_s[last]
    x, y, z = velocity_increment_m_s(sim, since_s, since_s + lasting_s)
    free[0] += x
    free[1] += y
    free[2] += z
    half_s, change = 0.5 * lasting_s, sim.acceleration
    p, q, r = to_body(
        free[3] + half_s * change[3], free[4] + half_s * change[4], free[5] + half_s * change[5], pose
    )
    x, y, z = sim.inertia_m2
    a, b, c = to_world((y - z) / x * q * r, (z - x) / y * r * p, (x - y) / z * p * q, pose)
    free[3] += lasting_s * a
    free[4] += lasting_s * b
    free[5] += lasting_s * c
    return free


@inner
def _mobility(sim: Simulation, pose: Array) -> Array:
    """Inverse (3, 3) of the inertia over mass in a pose, support frame."""
    out = np.zeros((3, 3))
    for k in range(3):
        axis = to_world(1.0 * (k == 0), 1.0 * (k == 1), 1.0 * (k == 2), pose)
        for i in range(3):
            for j in range(3):
                out[i, j] += axis[i] * axis[j] / sim.inertia_m2[k]
    return out
