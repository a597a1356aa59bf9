"""Contacts that stick, solved directly: which are active, and the velocity they leave the rock. Compiled, no engine.

Bullet hands contact impulses from point to point, and two points of an edge under a tall rock agree only after hundreds
of iterations. Where no point slips the answer is that of a few linear equations: some points carry and stay where they
are, the others do not come nearer than their gap allows. Active ones are found by pivoting: from the former ones, the
one that would have to pull most is dropped, the one that comes nearer most is added, until none does either. At most
three are active, since on a plane more would only share what three hold.

A point that is dropped as it sticks, and comes nearer without, slides under next to no load: its friction is left out.

The normal of all is z. Velocities are (6,): of the centre of mass, and angular; impulses are per
mass. All is kept in the arrays of :class:`Simulation`; those of the first `count` of `sim.near` are solved for.
"""

from __future__ import annotations

import math

import numpy as np

from toppling.models.compiled import inner
from toppling.workers.simulation import (
    ARM_X,
    ARM_Y,
    ARM_Z,
    DROPPED,
    FOUND,
    FREE,
    GRAM,
    IMPULSE,
    JACOBIAN,
    LEAST,
    MOBILITY,
    SLIDES,
    TOUCHES,
    TRIED,
    TURNED,
    Simulation,
)

MOST_ACTIVE = 3

_ROUNDS = 16
"""Of pivoting; blocks and scanned rocks took up to six."""

_LOOSE = 1e4
"""Times what is allowed otherwise: a fourth point may come nearer than three that hold the rock let it."""

_SLIDING_SHARE = 0.05
"""Of the whole load, up to which the friction of points that slide is left out."""

_SINGULAR = 1e-12
"""Share of a diagonal element that must be left, or the points are too close to each other."""


@inner
def solve(sim: Simulation, count: int) -> tuple[bool, float]:
    """Velocity, into FOUND, of a rock whose points stick where they carry; the flags TRIED say which do.

    Returns
    -------
    found : bool
        Whether there is such a velocity.
    friction : float
        Least coefficient of friction at which no active point slips.
    """
    flags, allowed_m_s = sim.flags, sim.fixed[0].allowed_m_s
    for k in range(count):
        i = sim.near[k]
        flags[SLIDES, i] = flags[DROPPED, i] = False
    for _ in range(_ROUNDS):
        pulled, pulls, near, comes_near = _try(sim, count)
        active = _active(sim, count)
        if pulled < -1e-3 * allowed_m_s:
            if pulled == -np.inf:
                return False, np.inf
            flags[TRIED, pulls], flags[DROPPED, pulls] = False, True
        elif near < allowed_m_s * (_LOOSE if active == MOST_ACTIVE else 1.0):
            if not _extend(sim, count, active):
                return True, _friction(sim, count)
        elif active == MOST_ACTIVE:
            return False, np.inf
        else:
            flags[TRIED, comes_near], flags[SLIDES, comes_near] = True, flags[DROPPED, comes_near]
    return False, np.inf


@inner
def _active(sim: Simulation, count: int) -> int:
    """How many are tried."""
    active = 0
    for k in range(count):
        active += 1 if sim.flags[TRIED, sim.near[k]] else 0
    return active


@inner
def _try(sim: Simulation, count: int) -> tuple[float, int, float, int]:
    """Let some points carry: the least of their normal impulses, and by how much another comes nearer than it may.

    Each with the point's index. An impulse of minus infinity says that the points can't carry together.
    """
    flags, work, candidates = sim.flags, sim.work, sim.candidates
    sticking, active = _choose(sim, count)
    for k in range(6):
        work[FOUND, k] = work[FREE, k]
    pulled, pulls = np.inf, -1
    if active > 0:
        if sticking == 0 or not _hold(sim, sticking, active):
            return -np.inf, -1, 0.0, -1
        for k in range(active):
            impulse = work[IMPULSE, _normal_row(k, sticking)]
            if impulse < pulled:
                pulled, pulls = impulse, sim.chosen[k]
    near, comes_near = 0.0, -1
    for k in range(count):
        i = sim.near[k]
        if not flags[TRIED, i]:
            missing = candidates[LEAST, i] - _rise_m_s(sim, i)
            if missing > near:
                near, comes_near = missing, i
    return pulled, pulls, near, comes_near


@inner
def _rise_m_s(sim: Simulation, i: int) -> float:
    """Normal velocity of a point with the velocity found."""
    work, candidates = sim.work, sim.candidates
    w, p, q = work[FOUND, 2], work[FOUND, 3], work[FOUND, 4]
    return w + p * candidates[ARM_Y, i] - q * candidates[ARM_X, i]


@inner
def _extend(sim: Simulation, count: int, active: int) -> bool:
    """Let one more of the points that touch carry, if one can: that which takes most. Whether one does.

    Sticking has several answers: a block on an edge that is pushed hard may turn about it, or swing about one of its
    corners, off the other one, though nothing has begun to turn it so. The answer that lets go of least is taken.
    """
    flags = sim.flags
    if active == 0 or active == MOST_ACTIVE:
        return False
    for k in range(count):
        if flags[SLIDES, sim.near[k]]:
            return False
    most, best, tried = 0.0, -1, False
    for k in range(count):
        i = sim.near[k]
        if flags[TOUCHES, i] and not flags[TRIED, i]:
            flags[TRIED, i] = tried = True
            pulled, _, near, _ = _try(sim, count)
            flags[TRIED, i] = False
            loose = _LOOSE if active + 1 == MOST_ACTIVE else 1.0
            if pulled > most and near < sim.fixed[0].allowed_m_s * loose:
                most, best = pulled, i
    if best < 0:
        if tried:
            _try(sim, count)
        return False
    flags[TRIED, best] = True
    return True


@inner
def _choose(sim: Simulation, count: int) -> tuple[int, int]:
    """Indices of active points, those that stick first: how many stick, and how many there are."""
    flags, sticking, active = sim.flags, 0, 0
    for slides in (False, True):
        sticking = active
        for k in range(count):
            i = sim.near[k]
            if flags[TRIED, i] and flags[SLIDES, i] == slides:
                if active < MOST_ACTIVE:
                    sim.chosen[active] = i
                    active += 1
                else:
                    flags[TRIED, i] = False
    return sticking, active


@inner
def _normal_row(k: int, sticking: int) -> int:
    """Row of the normal of the point chosen k-th, among the equations of :func:`_hold`."""
    before = min(k, sticking)  # points that stick have three, two and one
    return (before * (7 - before)) // 2 + max(k - sticking, 0)


@inner
def _hold(sim: Simulation, sticking: int, active: int) -> bool:
    """Add the impulses that hold some points to the velocity; they and their directions are kept.

    Equations without those that follow from others: the first point along its normal and two tangents; the second along
    its normal and across the line to the first; the third, and points that slide, along their normals.
    """
    work, candidates = sim.work, sim.candidates
    for k in range(active):
        i, row = sim.chosen[k], _normal_row(k, sticking)
        _row(sim, row, i, 0.0, 0.0, 1.0, candidates[LEAST, i])
        if k == 0:
            _row(sim, row + 1, i, 1.0, 0.0, 0.0, 0.0)
            _row(sim, row + 2, i, 0.0, 1.0, 0.0, 0.0)
        elif k == 1 and sticking > 1:
            first = sim.chosen[0]
            x = candidates[ARM_X, i] - candidates[ARM_X, first]
            y = candidates[ARM_Y, i] - candidates[ARM_Y, first]
            far = math.sqrt(x * x + y * y)
            if far == 0.0:
                return False
            _row(sim, row + 1, i, -y / far, x / far, 0.0, 0.0)
    total = _normal_row(active, sticking)
    for i in range(total):
        for k in range(3):
            work[TURNED + i, k] = (
                work[MOBILITY + k, 0] * work[JACOBIAN + i, 3]
                + work[MOBILITY + k, 1] * work[JACOBIAN + i, 4]
                + work[MOBILITY + k, 2] * work[JACOBIAN + i, 5]
            )
        for j in range(i + 1):
            work[GRAM + i, j] = (
                work[JACOBIAN + i, 0] * work[JACOBIAN + j, 0]
                + work[JACOBIAN + i, 1] * work[JACOBIAN + j, 1]
                + work[JACOBIAN + i, 2] * work[JACOBIAN + j, 2]
                + work[TURNED + i, 0] * work[JACOBIAN + j, 3]
                + work[TURNED + i, 1] * work[JACOBIAN + j, 4]
                + work[TURNED + i, 2] * work[JACOBIAN + j, 5]
            )
    if not _solve_symmetric(sim, total):
        return False
    for i in range(total):
        impulse = work[IMPULSE, i]
        for k in range(3):
            work[FOUND, k] += work[JACOBIAN + i, k] * impulse
            work[FOUND, 3 + k] += work[TURNED + i, k] * impulse
    return True


@inner
def _row(sim: Simulation, i: int, point: int, x: float, y: float, z: float, wanted_m_s: float) -> None:
    """Equation i: the point's velocity along (x, y, z), a function of the rock's, is to be this one."""
    work, candidates = sim.work, sim.candidates
    a, b, c = candidates[ARM_X, point], candidates[ARM_Y, point], candidates[ARM_Z, point]
    row = JACOBIAN + i
    work[row, 0], work[row, 1], work[row, 2] = x, y, z
    work[row, 3], work[row, 4], work[row, 5] = b * z - c * y, c * x - a * z, a * y - b * x
    missing = wanted_m_s
    for k in range(6):
        missing -= work[row, k] * work[FOUND, k]
    work[IMPULSE, i] = missing


@inner
def _solve_symmetric(sim: Simulation, count: int) -> bool:
    """Solve for the impulses in place, by Cholesky's decomposition of the lower triangle of GRAM."""
    work = sim.work
    for i in range(count):
        for j in range(i + 1):
            rest = work[GRAM + i, j]
            for k in range(j):
                rest -= work[GRAM + i, k] * work[GRAM + j, k]
            if i > j:
                work[GRAM + i, j] = rest * work[GRAM + j, j]
            elif rest > _SINGULAR * work[GRAM + i, i]:
                work[GRAM + i, i] = 1.0 / math.sqrt(rest)
            else:
                return False
        right = work[IMPULSE, i]
        for k in range(i):
            right -= work[GRAM + i, k] * work[IMPULSE, k]
        work[IMPULSE, i] = right * work[GRAM + i, i]
    for i in range(count - 1, -1, -1):
        right = work[IMPULSE, i]
        for k in range(i + 1, count):
            right -= work[GRAM + k, i] * work[IMPULSE, k]
        work[IMPULSE, i] = right * work[GRAM + i, i]
    return True


@inner
def _friction(sim: Simulation, count: int) -> float:
    """Least coefficient of friction with which the points can give what holds them, on one plane.

    How they share it is not determined for rigid bodies. As in :func:`models.statics.equilibrium_possible` each gives
    the resultant in proportion to its normal force; what turns the rock about the centre of pressure is shared in
    proportion to the distance from it too.
    """
    work, candidates, chosen = sim.work, sim.candidates, sim.chosen
    sticking, active = _choose(sim, count)
    total, sliding, x, y = 0.0, 0.0, 0.0, 0.0
    for k in range(active):
        normal = work[IMPULSE, _normal_row(k, sticking)]
        if k >= sticking:
            sliding += normal
            continue
        total += normal
        x += normal * candidates[ARM_X, chosen[k]]
        y += normal * candidates[ARM_Y, chosen[k]]
    if sliding > _SLIDING_SHARE * total:
        return np.inf
    if total <= 0.0:
        return 0.0
    x, y, along, across, turning = x / total, y / total, 0.0, 0.0, 0.0
    for i in (1, 2, 4):
        if i < 4 or sticking > 1:
            along += work[JACOBIAN + i, 0] * work[IMPULSE, i]
            across += work[JACOBIAN + i, 1] * work[IMPULSE, i]
            turning += work[JACOBIAN + i, 5] * work[IMPULSE, i]
    turning -= x * across - y * along
    spread = 0.0
    for k in range(sticking):
        square = (candidates[ARM_X, chosen[k]] - x) ** 2 + (candidates[ARM_Y, chosen[k]] - y) ** 2
        spread += work[IMPULSE, _normal_row(k, sticking)] * square / total
    share, largest = turning / spread if spread > 0.0 else 0.0, 0.0
    for k in range(sticking):
        if work[IMPULSE, _normal_row(k, sticking)] > 0.0:
            a = along - share * (candidates[ARM_Y, chosen[k]] - y)
            b = across + share * (candidates[ARM_X, chosen[k]] - x)
            largest = max(largest, math.sqrt(a * a + b * b) / total)
    return largest
