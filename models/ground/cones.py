"""Impulses of contacts with Coulomb friction, each along its own normal: a block Gauss-Seidel over their cones.

Of each contact in turn the impulse is found with which it sticks, or slips against the direction of its slip with
friction at its limit, the others' being kept, until none changes (Moreau 1988; Jean 1999, nonsmooth contact dynamics).
The normal velocity of a contact is at least its floor; friction is not associated with it: a slip does not lift.
Most steps need no sweep: all that carried go on to stick, which is solved in one go.
"""

from __future__ import annotations

import math
from typing import Any

from toppling.models.compiled import Array, inner
from toppling.models.ground.carrying import SolverRoom, Touching, carry_at_once, push
from toppling.models.ground.sticking_contacts import stick_at_once

_SWEEPS = 400
"""Over all contacts, at most."""

_SWEEPS_BETWEEN = 12
"""After so many at least, and half as many as were taken, those that carry are solved for at once again."""

_DIRECTIONS = 12
"""Times that the direction of a slip is found anew from the slip that it gives, in one sweep."""


@inner
def solve_cones(at: Touching) -> int:
    """Change the velocity by the impulses of contacts; those that these have are applied first. Sweeps taken."""
    for i in range(at.number):
        push(at.contacts[i].arm_m, at.contacts[i].impulse, at.inverse_inertia, at.velocity)
    if stick_at_once(at):
        return 1
    for i in range(at.number):
        _prepare(at.contacts[i], i, at.inverse_inertia, at.room)
    ask = 1 if at.number == 1 else 0  # one that sticks is found in one sweep, and seen in the next
    for sweep in range(_SWEEPS):
        largest = 0.0
        for i in range(at.number):
            largest = max(largest, _change_one(at, i))
        if largest < at.enough_m_s:
            return sweep + 1
        if sweep == ask:
            if carry_at_once(at):
                return sweep + 1
            ask = sweep + max(_SWEEPS_BETWEEN, sweep // 2)
    return _SWEEPS


@inner
def _change_one(at: Touching, i: int) -> float:
    """Change the impulse of a contact to what its cone allows, the others' being kept; by how much, at most."""
    one, axes, m, velocity = at.contacts[i], at.room.axes[i], at.room.mobility[i], at.velocity
    own, slip, new, change = at.room.vectors[0], at.room.vectors[1], at.room.vectors[2], at.room.vectors[3]
    r, p = one.arm_m, one.impulse
    u = (
        velocity[0] + velocity[4] * r[2] - velocity[5] * r[1],
        velocity[1] + velocity[5] * r[0] - velocity[3] * r[2],
        velocity[2] + velocity[3] * r[1] - velocity[4] * r[0],
    )
    for k in range(3):
        own[k] = axes[k, 0] * p[0] + axes[k, 1] * p[1] + axes[k, 2] * p[2]
        slip[k] = axes[k, 0] * u[0] + axes[k, 1] * u[1] + axes[k, 2] * u[2]
    for k in range(3):
        slip[k] -= m[k, 0] * own[0] + m[k, 1] * own[1] + m[k, 2] * own[2]
    slip[0] -= one.floor_m_s
    _one_cone(m, at.room.inverse[i], slip, at.friction, own, new)
    moved = 0.0
    for k in range(3):
        change[k] = (
            axes[0, k] * (new[0] - own[0]) + axes[1, k] * (new[1] - own[1]) + axes[2, k] * (new[2] - own[2])
        )
        moved = max(moved, abs(change[k]))
    if moved > 0.0:
        push(r, change, at.inverse_inertia, velocity)
        for k in range(3):
            p[k] = p[k] + change[k] if new[0] > 0.0 else 0.0  # to the bit: it tells which contacts carry
    return moved


@inner
def _prepare(one: Any, number: int, inverse_inertia: Array, room: SolverRoom) -> None:
    """Note the axes of a contact, its mobility in them, and the inverse of that."""
    n, r, turned = one.normal, one.arm_m, room.turned
    axes, mobility, inverse = room.axes[number], room.mobility[number], room.inverse[number]
    k = 0
    if abs(n[1]) < abs(n[k]):
        k = 1
    if abs(n[2]) < abs(n[k]):
        k = 2
    size = 0.0
    for i in range(3):
        axes[0, i] = n[i]
        axes[1, i] = (1.0 if i == k else 0.0) - n[k] * n[i]
        size += axes[1, i] ** 2
    for i in range(3):
        axes[1, i] /= math.sqrt(size)
    axes[2, 0] = n[1] * axes[1, 2] - n[2] * axes[1, 1]
    axes[2, 1] = n[2] * axes[1, 0] - n[0] * axes[1, 2]
    axes[2, 2] = n[0] * axes[1, 1] - n[1] * axes[1, 0]
    for i in range(3):
        turned[i, 0] = r[1] * axes[i, 2] - r[2] * axes[i, 1]
        turned[i, 1] = r[2] * axes[i, 0] - r[0] * axes[i, 2]
        turned[i, 2] = r[0] * axes[i, 1] - r[1] * axes[i, 0]
    for i in range(3):
        for j in range(3):
            total = 1.0 if i == j else 0.0
            for a in range(3):
                for b in range(3):
                    total += turned[i, a] * inverse_inertia[a, b] * turned[j, b]
            mobility[i, j] = total
    m = mobility
    c00, c01 = m[1, 1] * m[2, 2] - m[1, 2] ** 2, m[0, 2] * m[1, 2] - m[0, 1] * m[2, 2]
    c02 = m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1]
    det = m[0, 0] * c00 + m[0, 1] * c01 + m[0, 2] * c02
    inverse[0, 0], inverse[0, 1], inverse[0, 2] = c00 / det, c01 / det, c02 / det
    inverse[1, 1] = (m[0, 0] * m[2, 2] - m[0, 2] ** 2) / det
    inverse[1, 2] = (m[0, 1] * m[0, 2] - m[0, 0] * m[1, 2]) / det
    inverse[2, 2] = (m[0, 0] * m[1, 1] - m[0, 1] ** 2) / det
    inverse[1, 0], inverse[2, 0], inverse[2, 1] = inverse[0, 1], inverse[0, 2], inverse[1, 2]


@inner
def _one_cone(
    m: Array, inverse: Array, free: Array, friction: tuple[float, float], own: Array, out: Array
) -> None:
    """Impulse of one contact whose velocity without it, over its floor, is `free`: normal, two tangents."""
    if free[0] >= 0.0:
        # With friction a contact that parts by itself may jam; the impulse that parts is taken.
        out[:] = 0.0
        return
    for k in range(3):
        out[k] = -(inverse[k, 0] * free[0] + inverse[k, 1] * free[1] + inverse[k, 2] * free[2])
    static, kinetic = friction
    tangential = math.sqrt(out[1] ** 2 + out[2] ** 2)
    if out[0] > 0.0 and tangential <= static * out[0]:
        return
    if kinetic == 0.0:
        out[0], out[1], out[2] = -free[0] / m[0, 0], 0.0, 0.0
        return
    # Friction's direction: as it was, or against the slip without friction.
    x, y = own[1], own[2]
    if x == 0.0 and y == 0.0:
        x, y = (out[1], out[2]) if tangential > 0.0 else (-free[1], -free[2])
    size = math.sqrt(x * x + y * y)
    x, y = (x / size, y / size) if size > 0.0 else (1.0, 0.0)
    normal = 0.0
    for _ in range(_DIRECTIONS):
        stiff = m[0, 0] + kinetic * (m[0, 1] * x + m[0, 2] * y)
        if stiff <= 1e-3 * m[0, 0]:  # jammed: friction alone would stop it
            stiff = 1e-3 * m[0, 0]
        normal = -free[0] / stiff
        a, b = kinetic * x, kinetic * y
        slip_x = free[1] + normal * (m[1, 0] + m[1, 1] * a + m[1, 2] * b)
        slip_y = free[2] + normal * (m[2, 0] + m[2, 1] * a + m[2, 2] * b)
        slip = math.sqrt(slip_x**2 + slip_y**2)
        if slip <= 1e-14 * (abs(free[1]) + abs(free[2]) + normal):
            break
        # A step of a projected gradient, which holds where the slip turns back on itself.
        far = 0.5 * (m[1, 1] + m[2, 2]) * normal * kinetic
        if far <= 0.0:
            break
        new_x, new_y = x - slip_x / far, y - slip_y / far
        size = math.sqrt(new_x**2 + new_y**2)
        if size == 0.0:
            break
        new_x, new_y = new_x / size, new_y / size
        done = abs(new_x - x) + abs(new_y - y) < 1e-12
        x, y = new_x, new_y
        if done:
            break
    out[0], out[1], out[2] = normal, kinetic * normal * x, kinetic * normal * y
