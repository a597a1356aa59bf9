"""Which loads contacts with friction hold at rest, each along its own normal, and how long through a motion."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import scipy

from toppling.models.compiled import Array, Flags, inner
from toppling.models.ground.cones import solve_cones
from toppling.models.ground.rigid import invert, rotation_of, square
from toppling.models.ground.stepping import SECTORS, Grounded, enough_in_step_m_s, touching, touching_m

_SIDES = 32
"""Number of sides of the pyramid within each friction cone, which misses at most half a per cent of it."""

_DIRECTIONS = 48
"""Number of directions in which the border of the loads that are held is computed."""

_HELD_WITHIN = 1e-8
"""Share of a load that a mixture of wrenches may miss: rounding."""

_FARTHEST, _MOST_TRIALS = 1e3, 100
"""Of a load's size: a share of the way that is every share; and shares tried, of which six have been enough."""

_AT_ONCE = 60
"""Wrenches that are weighed together."""


def wrenches(arms_m: Array, normals: Array, friction: float) -> Array:
    """Forces and moments about the centre of mass (6, n) of the edges of the contacts' friction pyramids."""
    angle = 2.0 * np.pi * np.arange(_SIDES) / _SIDES if friction > 0.0 else np.zeros(1)
    first = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
    first /= np.linalg.norm(first, axis=1)[:, None]
    other = np.cross(normals, first)
    across = np.cos(angle)[:, None] * first[:, None] + np.sin(angle)[:, None] * other[:, None]
    force = normals[:, None] + friction * across  # contacts, sides, 3
    return np.concatenate([force, np.cross(arms_m[:, None], force)], axis=2).reshape(-1, 6).T


def farthest_load(
    columns: Array, load_m_s2: Array, direction_m_s2: Array, size_m: float, more_than: float = -np.inf
) -> float | None:
    """Largest share s for which the specific force load + s direction on the centre of mass is held; None if none is.

    Where a load is not held, what the nearest mixture of wrenches leaves of it is the normal of a plane between it and
    all that are held (Farkas 1902). From far away, the share at which load + s direction meets that plane is next.

    Parameters
    ----------
    columns : (6, n) array
        As :func:`wrenches` gives them.
    load_m_s2, direction_m_s2 : (3,) arrays
    size_m : float
        Scale of lengths.
    more_than : float
        None as well where no larger share than this is held, which a single trial tells.

    Returns
    -------
    float or None
        Infinite where every share is held; negative where only loads against the direction are.
    """
    scaled = _scaled(columns, size_m)
    far = _FARTHEST * float(np.linalg.norm(load_m_s2) / np.linalg.norm(direction_m_s2))
    if more_than > -np.inf:
        missed = _missed(scaled, load_m_s2 + more_than * direction_m_s2)
        if missed is None or (np.linalg.norm(missed) > _HELD_WITHIN and missed[:3] @ direction_m_s2 > 0.0):
            return None
    share = far
    for _ in range(_MOST_TRIALS):
        missed = _missed(scaled, load_m_s2 + share * direction_m_s2)
        if missed is None:
            return None
        if np.linalg.norm(missed) <= _HELD_WITHIN:
            break
        beyond = float(missed[:3] @ direction_m_s2)
        if beyond <= 0.0:  # with less of the load even more is missed
            return None
        share = -float(missed[:3] @ load_m_s2) / beyond
    return np.inf if share == far else share


def are_held(columns: Array, loads_m_s2: Array, size_m: float) -> Flags:
    """Which specific forces (n, 3) on the centre of mass contacts with the given :func:`wrenches` (6, k) hold.

    A load is held where a mixture of the wrenches opposes it; sizes of loads do not matter.
    """
    scaled = _scaled(columns, size_m)
    missed = [_missed(scaled, load) for load in loads_m_s2]
    return np.array([lack is not None and np.linalg.norm(lack) <= _HELD_WITHIN for lack in missed], bool)


def _scaled(columns: Array, size_m: float) -> Array:
    """Wrenches whose moments are forces at a distance of size_m."""
    return columns / np.array([1.0, 1.0, 1.0, size_m, size_m, size_m])[:, None]


def _missed(scaled: Array, load_m_s2: Array) -> Array | None:
    """What the nearest mixture of wrenches leaves (6,) of a load, as a share of it; None if none is found.

    By non-negative least squares, which end without error (Lawson and Hanson 1974), over the few wrenches that oppose
    most of what is left so far: a base on a curve has tens of thousands, of which at most six bear.
    """
    if not load_m_s2.any():
        return np.zeros(6)
    return _least_missed(scaled, -np.append(load_m_s2 / np.linalg.norm(load_m_s2), np.zeros(3)))


def shortest(columns: Array, least: Array) -> Array:
    """The shortest x (6,) with `columns.T @ x >= least` (Lawson and Hanson 1974, chapter 23)."""
    unit = least.max(initial=0.0)
    missed = _least_missed(np.vstack([columns, least / unit]), np.eye(7)[6]) if unit > 0.0 else None
    return unit * missed[:6] / -missed[6] if missed is not None and missed[6] < 0.0 else np.zeros(6)


def _least_missed(columns: Array, target: Array) -> Array | None:
    """What the mixture of columns that is nearest to a target has beyond it; None if none is found."""
    missed, bearing, before = -target, np.zeros(0, int), np.inf
    while (size := float(np.linalg.norm(missed))) < before:
        along = missed @ columns
        some = np.argpartition(along, _AT_ONCE)[:_AT_ONCE] if len(along) > _AT_ONCE else np.arange(len(along))
        some = some[along[some] < 0.0]
        if len(some) == 0:  # SciPy aborts the process over no wrenches at all
            break
        chosen, before = np.union1d(bearing, some), size
        try:
            multipliers = scipy.optimize.nnls(columns[:, chosen], target)[0]
        except RuntimeError:  # it has found none in the steps that it takes at most
            return None
        missed, bearing = columns[:, chosen] @ multipliers - target, chosen[multipliers > 0.0]
    return missed


def held_polygon(columns: Array, size_m: float) -> Array:
    """Half planes (k, 3) of the loads that are held: a x + b y <= c, of the horizontal over the downward part.

    The loads form a convex cone, of which this is a polygon within the section at unit downward load: what it holds is
    held. Empty where gravity along -z alone is not held.
    """
    down = np.array([0.0, 0.0, -1.0])
    angle = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    corners = []
    for direction in np.column_stack([np.cos(angle), np.sin(angle), np.zeros(_DIRECTIONS)]):
        far = farthest_load(columns, down, direction, size_m)
        if far is None or far < 0.0:
            return np.zeros((0, 3))
        corners.append(min(far, 100.0) * direction[:2])
    ring = np.array(corners)
    edge = np.roll(ring, -1, axis=0) - ring
    normal = np.column_stack([edge[:, 1], -edge[:, 0]])
    length = np.linalg.norm(normal, axis=1)
    normal, ring = normal[length > 1e-12] / length[length > 1e-12, None], ring[length > 1e-12]
    return np.column_stack([normal, (normal * ring).sum(axis=1)])


def held(half_planes: Array, loads_m_s2: Array, margin: float = 1e-6) -> Flags:
    """Which of some loads (n, 3) lie within half planes of :func:`held_polygon`."""
    if len(half_planes) == 0:
        return np.zeros(len(loads_m_s2), bool)
    down, limits = -loads_m_s2[:, 2], half_planes[:, 2] - margin
    inside: Flags = np.hypot(loads_m_s2[:, 0], loads_m_s2[:, 1]) <= limits.min() * down
    far = np.flatnonzero(~inside)
    outside = loads_m_s2[far, :2] @ half_planes[:, :2].T - down[far, None] * limits
    inside[far] = (outside <= 0.0).all(axis=1)
    return inside & (down > 0.0)


STILL = 1e-9
"""Speed over sqrt(g R) below which a rock on contacts moves by rounding alone."""


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
def _next(leanings: Array, sector: int, sense: int) -> int:
    """The next sector, one way around, in which a leaning is kept; the same if in none."""
    for k in range(1, SECTORS):
        other = (sector + sense * k) % SECTORS
        if leanings[other, 0] ** 2 + leanings[other, 1] ** 2 > 0.0:
            return other
    return sector
