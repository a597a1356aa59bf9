"""How long the contacts of a rock at rest hold the loads of a motion. Compiled."""

from __future__ import annotations

import math
from typing import Any

from toppling.models.compiled import Array, inner
from toppling.models.ground.cones import solve_cones
from toppling.models.ground.rigid import invert, square
from toppling.models.ground.stepping import SECTORS, Grounded, enough_in_step_m_s, touching, touching_m
from toppling.models.ground.vectors import rotation_of

STILL = 1e-9
"""Over sqrt(g R): a rock on contacts that moves slower moves by rounding alone."""


@inner
def is_still(sim: Grounded, velocity: Array) -> bool:
    """Whether a velocity (6,) is rounding."""
    spin = (velocity[3], velocity[4], velocity[5])
    speed_m_s = math.sqrt(square(velocity)) + math.sqrt(square(spin)) * sim.size_m
    return speed_m_s < STILL * math.sqrt(math.sqrt(square(sim.gravity_m_s2)) * sim.size_m)


@inner
def held_until(sim: Grounded, first: int) -> int:
    """First sample of the motion, from `first` on, whose load the contacts that carry do not hold; of all if none.

    What holds two loads holds their mixtures, at any size. So by direction the farthest leaning is kept that was seen
    to be held, and a sample that leans less than these is not asked.
    """
    pose, g, leanings = sim.pose[sim.counts[1]], sim.gravity_m_s2, sim.work.leanings
    rotation_of(pose, sim.work.turn)
    invert(sim.work.turn, sim.inertia_m2, sim.work.inverse)
    if g[2] >= 0.0 or not _is_held(sim, (g[0], g[1], g[2])):
        return first
    for sector in range(SECTORS):
        leanings[sector, 0] = leanings[sector, 1] = 0.0
    for sample in range(first, len(sim.excitation)):
        a = sim.excitation[sample]
        load = (g[0] - a[0], g[1] - a[1], g[2] - a[2])
        if load[2] >= 0.0:
            return sample
        x, y = g[0] / g[2] - load[0] / load[2], g[1] / g[2] - load[1] / load[2]
        if _is_between(leanings, x, y):
            continue
        if not _is_held(sim, load):
            return sample
        sector = _sector(x, y)
        if x * x + y * y > leanings[sector, 0] ** 2 + leanings[sector, 1] ** 2:
            leanings[sector, 0], leanings[sector, 1] = x, y
    return len(sim.excitation)


@inner
def _is_held(sim: Grounded, load_m_s2: Any) -> bool:
    """Whether the contacts of the latest substep keep a rock at rest under a load, in one step."""
    count, velocity, near_m = sim.counts[0], sim.work.free, touching_m(sim)
    for k in range(3):
        velocity[k], velocity[3 + k] = load_m_s2[k] * sim.step_s, 0.0
    for k in range(count):
        sim.trial[k] = sim.contacts[k]
        sim.trial[k].floor_m_s = -2.0 * max(sim.contacts[k].gap_m - near_m, 0.0) / sim.step_s
    solve_cones(touching(sim, count, velocity, enough_in_step_m_s(sim)))
    return is_still(sim, velocity)


@inner
def _sector(x: float, y: float) -> int:
    return int((math.atan2(y, x) / math.pi + 1.0) * 0.5 * SECTORS) % SECTORS


@inner
def _is_between(leanings: Array, x: float, y: float) -> bool:
    """Whether a leaning lies in the triangle of none and the two of those kept that are next to it by direction."""
    own = _sector(x, y)
    before, after = own, own
    p = leanings[own]
    if p[0] * p[0] + p[1] * p[1] > 0.0:
        if p[0] * y - p[1] * x >= 0.0:
            after = _next(leanings, own, 1)
        else:
            before = _next(leanings, own, -1)
    else:
        before, after = _next(leanings, own, -1), _next(leanings, own, 1)
    a, b = leanings[before], leanings[after]
    within = a[0] * y - a[1] * x >= 0.0 and x * b[1] - y * b[0] >= 0.0 and a[0] * b[1] - a[1] * b[0] > 0.0
    return within and (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) >= 0.0


@inner
def _next(leanings: Array, sector: int, way: int) -> int:
    """The next sector, one way around, in which a leaning is kept; the same if in none."""
    for k in range(1, SECTORS):
        other = (sector + way * k) % SECTORS
        if leanings[other, 0] ** 2 + leanings[other, 1] ** 2 > 0.0:
            return other
    return sector
