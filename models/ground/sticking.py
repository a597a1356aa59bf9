"""Impulses of contacts that all stick, found at once. Compiled.

A Gauss-Seidel sweep hands impulses from contact to contact, and two of them on an edge under a tall rock agree only
after hundreds. Where those that carry stick, they are the answer of linear equations. Where these have several answers
(four feet on a plane), the forces between feet that no motion depends on stay as the sweeps have left them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from toppling.models.compiled import Array, inner
from toppling.models.ground.vectors import cross, dot, plus

_MOST_STICKING = 8
"""Contacts that are solved for at once."""

_DEPENDENT = 1e-7
"""Share of a diagonal element that must be left, or its equation follows from those before it and is left out."""

_WITHIN = 0.999
"""Share of static friction up to which a contact counts as one that sticks."""

_MISSED = 500.0
"""Times what the sweeps let go: by so much a velocity whose equation is left out may differ, as gaps are not equal."""


@inner(allocates=True)
def stick_at_once(
    contacts: Any,
    count: int,
    friction: float,
    inverse_inertia: Array,
    velocity: Array,
    basis: Array,
    enough_m_s: float,
) -> bool:
    """Change impulses and a velocity (6,) so that all contacts that carry stick; whether no other one closes then.

    Parameters
    ----------
    contacts : records of CONTACT
    count : int
        So many are looked at.
    friction : float
        Static.
    inverse_inertia : (3, 3) array
    velocity : (6,) array
    basis : (count, 3, 3) array
        Of each contact, by rows: its normal and two tangents.
    enough_m_s : float
        A velocity that is off by less is right.
    """
    chosen = np.empty(_MOST_STICKING, np.int64)
    sticking = _those_that_carry(contacts, count, friction, chosen)
    if sticking < 2:
        return False
    rows = 3 * sticking
    ways, matrix, missing = np.empty((rows, 9)), np.empty((rows, rows)), np.empty(rows)
    for row in range(rows):  # the normals first: what is left out is as little as can be
        k = row if row < sticking else (row - sticking) // 2
        axis = 0 if row < sticking else 1 + (row - sticking) % 2
        one = contacts[chosen[k]]
        _note_way(one.arm_m, basis[chosen[k], axis], inverse_inertia, ways[row])
        missing[row] = (one.floor_m_s if axis == 0 else 0.0) - _rate(ways[row], velocity)
    change = _solved(ways, matrix, missing)
    impulses, after = np.zeros((sticking, 3)), velocity.copy()
    for row in range(rows):
        k = row if row < sticking else (row - sticking) // 2
        for axis in range(3):
            impulses[k, axis] += change[row] * ways[row, axis]
            after[axis] += change[row] * ways[row, axis]
            after[3 + axis] += change[row] * ways[row, 6 + axis]
    for row in range(rows):
        if abs(missing[row] + _rate(ways[row], velocity) - _rate(ways[row], after)) > _MISSED * enough_m_s:
            return False
    for k in range(sticking):
        one = contacts[chosen[k]]
        p = plus(one.impulse, 1.0, impulses[k])
        normal = dot(one.normal, p)
        if normal < 0.0 or dot(p, p) - normal * normal > (friction * normal) ** 2:
            return False
    velocity[:] = after
    for k in range(sticking):
        for axis in range(3):
            contacts[chosen[k]].impulse[axis] += impulses[k, axis]
    return _others_part(contacts, count, velocity, enough_m_s)


@inner
def _those_that_carry(contacts: Any, count: int, friction: float, chosen: Any) -> int:
    """Contacts that carry; how many, 0 if one of them slips or they are too many."""
    sticking = 0
    for i in range(count):
        one = contacts[i]
        normal = dot(one.normal, one.impulse)
        if normal <= 0.0:
            continue
        square = dot(one.impulse, one.impulse) - normal * normal
        if sticking == _MOST_STICKING or square > (_WITHIN * friction * normal) ** 2:
            return 0
        chosen[sticking] = i
        sticking += 1
    return sticking


@inner
def _others_part(contacts: Any, count: int, velocity: Array, enough_m_s: float) -> bool:
    """Whether no contact that does not carry closes faster than it may."""
    for i in range(count):
        one = contacts[i]
        n, r = one.normal, one.arm_m
        if dot(n, one.impulse) <= 0.0:
            turning = cross((velocity[3], velocity[4], velocity[5]), r)
            if dot(n, velocity) + dot(n, turning) < one.floor_m_s - enough_m_s:
                return False
    return True


@inner
def _note_way(arm: Any, way: Any, inverse_inertia: Array, out: Array) -> None:
    """A direction at an arm: itself, the moment of a unit impulse along it, and the spin that this gives."""
    out[0], out[1], out[2] = way[0], way[1], way[2]
    out[3], out[4], out[5] = cross(arm, way)
    for k in range(3):
        out[6 + k] = (
            inverse_inertia[k, 0] * out[3] + inverse_inertia[k, 1] * out[4] + inverse_inertia[k, 2] * out[5]
        )


@inner
def _rate(way: Array, velocity: Array) -> float:
    """Velocity along a direction of :func:`_note_way`."""
    rate = 0.0
    for k in range(6):
        rate += way[k] * velocity[k]
    return rate


@inner(allocates=True)
def _solved(ways: Array, matrix: Array, missing: Array) -> Array:
    """Impulses along directions that bring about the velocities that are missing there.

    By Cholesky's decomposition; equations that follow from those before them are left out, with no impulse of theirs.
    """
    rows, right = len(ways), missing.copy()
    for i in range(rows):
        whole = 0.0
        for j in range(i + 1):
            rest = 0.0
            for k in range(3):
                rest += ways[i, k] * ways[j, k] + ways[i, 3 + k] * ways[j, 6 + k]
            whole = rest
            for k in range(j):
                rest -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = rest * matrix[j, j] if i > j else rest
        if matrix[i, i] > _DEPENDENT * whole:
            matrix[i, i] = 1.0 / math.sqrt(matrix[i, i])
        else:
            matrix[i, : i + 1] = 0.0
        for k in range(i):
            right[i] -= matrix[i, k] * right[k]
        right[i] *= matrix[i, i]
    for i in range(rows - 1, -1, -1):
        for k in range(i + 1, rows):
            right[i] -= matrix[k, i] * right[k]
        right[i] *= matrix[i, i]
    return right


@inner
def push(arm: Any, impulse: Any, inverse_inertia: Array, velocity: Array) -> None:
    """Change a velocity (6,) by an impulse at an arm."""
    x = arm[1] * impulse[2] - arm[2] * impulse[1]
    y = arm[2] * impulse[0] - arm[0] * impulse[2]
    z = arm[0] * impulse[1] - arm[1] * impulse[0]
    for k in range(3):
        velocity[k] += impulse[k]
        velocity[3 + k] += inverse_inertia[k, 0] * x + inverse_inertia[k, 1] * y + inverse_inertia[k, 2] * z
