"""Which loads contacts with friction hold at rest, each along its own normal, and how long through a motion."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy

from toppling.models.compiled import Array, Flags, compiled, inner
from toppling.models.ground.cones import solve_cones
from toppling.models.ground.contacts import SolverRoom, Touching, solver_room
from toppling.models.ground.rigid import invert, rotation_of, square
from toppling.models.ground.stepping import SECTORS, Grounded, enough_in_step_m_s, touching, touching_m

_SIDES = 32
"""Number of sides of the pyramid within each friction cone, which misses at most half a per cent of it."""

_HELD_WITHIN = 1e-8
"""Share of a load that a mixture of wrenches may miss: rounding."""

_ENOUGH, _UNMOVED = 1e-9, 1e-7
"""Tolerance of the solver, and speed of a rock that is kept still, over the one that a load gives."""

_FIRST_SHARE, _LAST_SHARE = 0.05, 1e-6
"""First and last step, over gravity, with which the largest acceleration is looked for."""

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


def held_up_to_m_s2(
    contacts: np.ndarray,
    friction: float,
    inertia_m2: Array,
    load_m_s2: Array,
    push: Array,
    span: tuple[float, float],
) -> float | None:
    """Largest acceleration s at which contacts keep a rock still under a load + s push, by the solver of the shakes.

    Equilibrium within the friction cones is necessary for that and not enough: two contacts whose line lies within both
    cones would hold any load by pressing on each other.

    Parameters
    ----------
    contacts : (n,) records of CONTACT
    friction : float
    inertia_m2 : (3, 3) array
        Over mass.
    load_m_s2, push : (3,) arrays
    span : (float, float)
        Least and largest acceleration to look at.

    Returns
    -------
    float or None
        Infinite where they hold the largest, None where they do not hold the least.
    """
    (held, most), g, size_m = span, float(np.linalg.norm(load_m_s2)), math.sqrt(np.trace(inertia_m2))
    moves_under = _from_rest(contacts, friction, inertia_m2)

    def holds(acceleration_m_s2: float) -> bool:
        force = load_m_s2 + acceleration_m_s2 * push
        moves = moves_under(force)
        fastest = np.linalg.norm(moves[:3]) + size_m * np.linalg.norm(moves[3:])
        return bool(fastest <= _UNMOVED * np.linalg.norm(force))

    if not holds(held):
        return None
    more, grows = _FIRST_SHARE * g, True
    while more > _LAST_SHARE * g:
        if holds(held + more):
            held += more
            if held >= most:
                return np.inf
        else:
            grows = False
        more *= 2.0 if grows else 0.5
    return held


def _from_rest(contacts: np.ndarray, friction: float, inertia_m2: Array) -> Callable[[Array], Array]:
    """Acceleration and rotational acceleration (6,) of a rock at rest on contacts, by the force (3,) over its mass."""
    contacts, inverse, room = contacts.copy(), np.linalg.inv(inertia_m2), solver_room(len(contacts))
    contacts["floor_m_s"] = 0.0

    def moves_under(force_m_s2: Array) -> Array:
        contacts["impulse"] = contacts["slip_m_s"] = 0.0
        moves, enough = np.append(force_m_s2, np.zeros(3)), _ENOUGH * float(np.linalg.norm(force_m_s2))
        _solve(contacts, friction, inverse, moves, enough, room)
        return moves

    return moves_under


@compiled
def _solve(
    contacts: np.ndarray,
    friction: float,
    inverse: Array,
    velocity: Array,
    enough_m_s: float,
    room: SolverRoom,
) -> None:
    """Change the velocity (6,) by what contacts make of it."""
    solve_cones(Touching(contacts, len(contacts), (friction, friction), inverse, velocity, enough_m_s, room))


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
    """Residual (6,) of a load and the nearest mixture of wrenches, as a share of the load; None if none is found.

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
    """Excess over a target of the nearest mixture of columns; None if none is found."""
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
