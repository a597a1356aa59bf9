"""Contacts that stick, solved directly: which points carry, and the velocity they leave the rock. Compiled, no engine.

Bullet hands contact impulses from point to point, and two points of an edge under a tall rock agree only after hundreds
of iterations. Where no point slips the answer is that of a few linear equations: some points carry and stay where they
are, the others do not come nearer than their gap allows. Points that carry are found by pivoting: from the former ones,
the one that would have to pull most is dropped, the one that comes nearer most is added, until none does either. At
most three carry, since on a plane more would only share what three hold.

A point that is dropped as it sticks, and comes nearer without, slides under next to no load: its friction is left out.

Velocities are (6,): of the centre of mass, and angular; impulses are per mass.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from toppling.workers.compiled import Array, Flags, Indices, inner

MOST_ACTIVE = 3

ROUNDS = 16
"""Of pivoting; blocks and scanned rocks took up to six."""

LOOSE = 1e4
"""Times what is allowed otherwise: a fourth point may come nearer than three that hold the rock let it."""

SLIDING_SHARE = 0.05
"""Of the whole load, up to which the friction of points that slide is left out."""

SINGULAR = 1e-12
"""Share of a diagonal element that must be left, or the points are too close to each other."""


class Contacts(NamedTuple):
    """Points that may carry a rock which begins to move, and arrays to work in."""

    arms_m: Array  # (n, 3) from the centre of mass to the points, at equal heights
    least_m_s: Array  # (n,) normal velocity of a point that carries, below which none may be
    touches: Flags  # (n,) as the rock begins to move
    active: Flags  # (n,) before; those that are now are put here
    free: Array  # (6,) velocity without contact
    mobility: Array  # (3, 3) inverse of the inertia over mass, same frame
    allowed_m_s: float  # by which a point may come nearer all the same
    velocity: Array  # (6,) that which the points leave is put here
    slides: Flags  # (n,) of those that carry
    chosen: Indices  # (3,) points that carry, those that stick first
    rows: Array  # (6, 6) directions of the impulses that hold these
    gram: Array  # (6, 6) what the impulses do to each other
    impulse: Array  # (6,)


@inner
def solve(these: Contacts) -> tuple[bool, float]:
    """Velocity of a rock whose points stick where they carry.

    Returns
    -------
    found : bool
        Whether there is such a velocity.
    friction : float
        Least coefficient of friction at which no point that carries slips.
    """
    active, dropped = these.active, np.zeros(len(these.active), np.bool_)
    for _ in range(ROUNDS):
        pulled, pulls, near, comes_near = _try(these)
        count = active.sum()
        if pulled < -1e-3 * these.allowed_m_s:
            if pulled == -np.inf:
                return False, np.inf
            active[pulls], dropped[pulls] = False, True
        elif near < these.allowed_m_s * (LOOSE if count == MOST_ACTIVE else 1.0):
            if not _extend(these):
                return True, _friction(these)
        elif count == MOST_ACTIVE:
            return False, np.inf
        else:
            active[comes_near], these.slides[comes_near] = True, dropped[comes_near]
    return False, np.inf


@inner
def _try(these: Contacts) -> tuple[float, int, float, int]:
    """Let some points carry: the least of their normal impulses, and by how much another comes nearer than it may.

    Each with the point's index. An impulse of minus infinity says that the points can't carry together.
    """
    active, velocity, arms_m = these.active, these.velocity, these.arms_m
    sticking, count = _choose(these)
    velocity[:] = these.free
    pulled, pulls = np.inf, -1
    if count > 0:
        if sticking == 0 or not _hold(these, sticking, count):
            return -np.inf, -1, 0.0, -1
        for k in range(count):
            impulse = these.impulse[_normal_row(k, sticking)]
            if impulse < pulled:
                pulled, pulls = impulse, these.chosen[k]
    near, comes_near = 0.0, -1
    for i in range(len(active)):
        if not active[i]:
            rise = velocity[2] + velocity[3] * arms_m[i, 1] - velocity[4] * arms_m[i, 0]
            if these.least_m_s[i] - rise > near:
                near, comes_near = these.least_m_s[i] - rise, i
    return pulled, pulls, near, comes_near


@inner
def _extend(these: Contacts) -> bool:
    """Let one more of the points that touch carry, if one can: that which takes most. Whether one does.

    Sticking has several answers: a block on an edge that is pushed hard may turn about it, or swing about one of its
    corners, off the other one, though nothing has begun to turn it so. The answer that lets go of least is taken.
    """
    active = these.active
    count = active.sum()
    if count == 0 or count == MOST_ACTIVE or these.slides.any():
        return False
    most, best = 0.0, -1
    for i in range(len(active)):
        if these.touches[i] and not active[i]:
            active[i] = True
            pulled, _, near, _ = _try(these)
            active[i] = False
            if pulled > most and near < these.allowed_m_s * (LOOSE if count + 1 == MOST_ACTIVE else 1.0):
                most, best = pulled, i
    if best < 0:
        _try(these)
        return False
    active[best] = True
    return True


@inner
def _choose(these: Contacts) -> tuple[int, int]:
    """Indices of points that carry, those that stick first: how many stick, and how many there are."""
    sticking, count = 0, 0
    for slides in (False, True):
        sticking = count
        for i in range(len(these.active)):
            if these.active[i] and these.slides[i] == slides:
                if count < MOST_ACTIVE:
                    these.chosen[count] = i
                    count += 1
                else:
                    these.active[i] = False
    return sticking, count


@inner
def _normal_row(k: int, sticking: int) -> int:
    """Row of the normal of the point chosen k-th, among the equations of :func:`_hold`."""
    before = min(k, sticking)  # points that stick have three, two and one
    return (before * (7 - before)) // 2 + max(k - sticking, 0)


@inner
def _hold(these: Contacts, sticking: int, count: int) -> bool:
    """Add the impulses that hold some points to the velocity; they and their directions are kept.

    Equations without those that follow from others: the first point along the normal, x and y; the second along the
    normal and across the line to the first; the third, and points that slide, along the normal.
    """
    arms_m, chosen, mobility, velocity = these.arms_m, these.chosen, these.mobility, these.velocity
    rows, gram, impulse = these.rows, these.gram, these.impulse
    ax, ay, _ = arms_m[chosen[0]]
    total = 0
    for k in range(count):
        arm = arms_m[chosen[k]]
        _row(rows, total, 0.0, 0.0, 1.0, arm)
        impulse[total] = these.least_m_s[chosen[k]]
        total += 1
        if k == 0:
            _row(rows, 1, 1.0, 0.0, 0.0, arm)
            _row(rows, 2, 0.0, 1.0, 0.0, arm)
            impulse[1] = impulse[2] = 0.0
            total = 3
        elif k == 1 and sticking > 1:
            x, y = arm[0] - ax, arm[1] - ay
            far = math.sqrt(x * x + y * y)
            if far == 0.0:
                return False
            _row(rows, total, -y / far, x / far, 0.0, arm)
            impulse[total] = 0.0
            total += 1
    turned = np.empty((6, 3))
    for i in range(total):
        for k in range(3):
            turned[i, k] = (
                mobility[k, 0] * rows[i, 3] + mobility[k, 1] * rows[i, 4] + mobility[k, 2] * rows[i, 5]
            )
        for k in range(6):
            impulse[i] -= rows[i, k] * velocity[k]
        for j in range(i + 1):
            gram[i, j] = (
                rows[i, 0] * rows[j, 0] + rows[i, 1] * rows[j, 1] + rows[i, 2] * rows[j, 2]
                + turned[i, 0] * rows[j, 3] + turned[i, 1] * rows[j, 4] + turned[i, 2] * rows[j, 5]
            )  # fmt: skip
    if not _solve_symmetric(gram, impulse, total):
        return False
    for i in range(total):
        for k in range(3):
            velocity[k] += rows[i, k] * impulse[i]
            velocity[3 + k] += turned[i, k] * impulse[i]
    return True


@inner
def _row(rows: Array, i: int, x: float, y: float, z: float, arm: Array) -> None:
    """Row i: velocity along (x, y, z) of the point at an arm, as a function of the rock's velocity."""
    rows[i, 0], rows[i, 1], rows[i, 2] = x, y, z
    rows[i, 3] = arm[1] * z - arm[2] * y
    rows[i, 4] = arm[2] * x - arm[0] * z
    rows[i, 5] = arm[0] * y - arm[1] * x


@inner
def _solve_symmetric(gram: Array, right: Array, count: int) -> bool:
    """Solve a symmetric positive system in place, by Cholesky's decomposition of its lower triangle."""
    for i in range(count):
        for j in range(i + 1):
            rest = gram[i, j]
            for k in range(j):
                rest -= gram[i, k] * gram[j, k]
            if i > j:
                gram[i, j] = rest / gram[j, j]
            elif rest > SINGULAR * gram[i, i]:
                gram[i, i] = math.sqrt(rest)
            else:
                return False
        for k in range(i):
            right[i] -= gram[i, k] * right[k]
        right[i] /= gram[i, i]
    for i in range(count - 1, -1, -1):
        for k in range(i + 1, count):
            right[i] -= gram[k, i] * right[k]
        right[i] /= gram[i, i]
    return True


@inner
def _friction(these: Contacts) -> float:
    """Least coefficient of friction with which the points can give what holds them.

    How they share it is not determined for rigid bodies. As in :func:`models.statics.equilibrium_possible` each gives
    the resultant in proportion to its normal force; what turns the rock about the centre of pressure is shared in
    proportion to the distance from it too.
    """
    arms_m, chosen, rows, impulse = these.arms_m, these.chosen, these.rows, these.impulse
    sticking, count = _choose(these)
    total, sliding, x, y = 0.0, 0.0, 0.0, 0.0
    for k in range(count):
        normal = impulse[_normal_row(k, sticking)]
        if k >= sticking:
            sliding += normal
            continue
        total += normal
        x += normal * arms_m[chosen[k], 0]
        y += normal * arms_m[chosen[k], 1]
    if sliding > SLIDING_SHARE * total:
        return np.inf
    if total <= 0.0:
        return 0.0
    x, y, along, across, turning = x / total, y / total, 0.0, 0.0, 0.0
    for i in (1, 2, 4):
        if i < 4 or sticking > 1:
            along += rows[i, 0] * impulse[i]
            across += rows[i, 1] * impulse[i]
            turning += rows[i, 5] * impulse[i]
    turning -= x * across - y * along
    spread = 0.0
    for k in range(sticking):
        square = (arms_m[chosen[k], 0] - x) ** 2 + (arms_m[chosen[k], 1] - y) ** 2
        spread += impulse[_normal_row(k, sticking)] * square / total
    share, largest = turning / spread if spread > 0.0 else 0.0, 0.0
    for k in range(sticking):
        if impulse[_normal_row(k, sticking)] > 0.0:
            a = along - share * (arms_m[chosen[k], 1] - y)
            b = across + share * (arms_m[chosen[k], 0] - x)
            largest = max(largest, math.sqrt(a * a + b * b) / total)
    return largest
