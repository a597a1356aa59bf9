"""Impulses of contacts with Coulomb friction, each along its own normal: a proximal Newton method over their cones.

A contact is open, sticks within its cone, or slips with kinetic friction against its slip; friction is not associated
with the normal: a slip does not lift. Most steps need no more than :func:`stick_at_once`. In the others each contact is
given a stiffness: what its velocity makes of the impulse that it had, projected on its cone, is its new impulse
(augmented Lagrangian; Alart and Curnier 1991). The six numbers of the rock's velocity that fits are found by Newton's
method, then the stiffness is raised until no velocity is off. A stiffness too large for Newton's method is lowered:
soft contacts always have a solution, and hard ones have one too if no floor is above zero, since the ground is fixed
(Klarbring and Pang 1998; Acary, Cadoux, Lemarechal and Malick 2011). No solution adds energy then, because no contact
does work: it rests, or its friction is against its slip.
"""

from __future__ import annotations

import math
from typing import Any

from toppling.models.compiled import Array, Vector, inner
from toppling.models.ground.contacts import Touching, push, response, velocity_of
from toppling.models.ground.rigid import copy, cross, dot, plus, square
from toppling.models.ground.sticking_contacts import stick_at_once

_PRECISION = 1e-10
"""Convergence tolerance on contact velocities, over the fastest contact's speed; it doubles with each round."""

_AGREEMENT = 2e-6
"""Tolerance up to which it doubles in the last rounds.

Contacts touch whose gaps differ by 2e-6 R (`stepping.TOUCHING_SHARE`): as the rock turns, their velocities differ by
such a share of its speed, and redundant ones hand their load to three of them in very many rounds.
"""

_STIFFNESS, _STIFFEST = 1e5, 1e6
"""Initial and largest stiffness, over that of a contact which a single impulse stops."""

_RAISED, _RAISED_AFTER_FAILURE, _LOWERED = 10.0, 2.0, 0.1
"""Factors on the stiffness where Newton's method has converged, also after it once has not; where it has not."""

_ROUNDS, _BEGINS_ANEW = 400, 80
"""Maximum number of rounds, with a stiffness each, and the number after which all contacts are pressed, as those of a
wedged rock press each other."""

_NEWTON_STEPS, _HALVINGS = 15, 7
"""Maximum number of Newton steps with one stiffness, and of halvings of one step."""

_OPEN, _STICKS, _SLIPS = 0, 1, 2


@inner
def solve_cones(at: Touching) -> bool:
    """Change the velocity by the impulses of contacts; those that these have are applied first. Whether all agree.

    Static friction holds contacts that can all stick with it, however they share their load; else friction is kinetic
    in all of them. With a state of its own in each, those of a pair that carry the same might differ.
    """
    copy(at.velocity, at.room.free)
    for i in range(at.number):
        push(at, i, 1.0, at.contacts[i].impulse, at.velocity)
    if at.number == 0 or stick_at_once(at):
        return True
    static, kinetic = at.friction
    if static > kinetic and _solve_with(at, static) and not _slips(at):
        return True
    return _solve_with(at, kinetic)


@inner
def _solve_with(at: Touching, friction: float) -> bool:
    """Solve from the present impulses and velocity, with a single coefficient of friction."""
    fastest_m_s, stiffness, raised = _fastest_m_s(at), _STIFFNESS, _RAISED
    within = max(_PRECISION * fastest_m_s, _STIFFNESS * _rounding_m_s(at))
    enough = within
    for count in range(1, _ROUNDS):
        if count % _BEGINS_ANEW == 0:
            _press(at, fastest_m_s * (count // _BEGINS_ANEW))
            stiffness, raised = _STIFFNESS, _RAISED
        _stiffen(at, stiffness)
        copy(at.velocity, at.room.start)
        if _find_velocity(at, friction, within):
            if _take_impulses(at, friction) <= enough:
                return True
            most = max(at.enough_m_s, within if count < _ROUNDS - _BEGINS_ANEW else _AGREEMENT * fastest_m_s)
            enough = min(2.0 * enough, most)
            stiffness = min(raised * stiffness, _STIFFEST)
        else:
            copy(at.room.start, at.velocity)
            stiffness, raised = _LOWERED * stiffness, _RAISED_AFTER_FAILURE
    return False


@inner
def _slips(at: Touching) -> bool:
    """Whether a contact that carries moves along the ground."""
    for i in range(at.number):
        contact = at.contacts[i]
        if dot(contact.impulse, contact.normal) > 0.0:
            moves = velocity_of(contact.arm_m, at.velocity)
            if square(plus(moves, -dot(moves, contact.normal), contact.normal)) > at.enough_m_s**2:
                return True
    return False


@inner
def _fastest_m_s(at: Touching) -> float:
    """Largest speed of a contact without impulses, or of its floor."""
    fastest = 0.0
    for i in range(at.number):
        contact = at.contacts[i]
        speed_m_s = math.sqrt(square(velocity_of(contact.arm_m, at.room.free)))
        fastest = max(fastest, speed_m_s, abs(contact.floor_m_s))
    return fastest


@inner
def _rounding_m_s(at: Touching) -> float:
    """By how much rounding changes a contact's velocity: that of a rock which rolls is a difference of larger ones."""
    v, farthest_m2 = at.room.free, 0.0
    for i in range(at.number):
        farthest_m2 = max(farthest_m2, square(at.contacts[i].arm_m))
    spin2 = v[3] * v[3] + v[4] * v[4] + v[5] * v[5]
    return 2.0**-52 * (math.sqrt(square(v)) + math.sqrt(spin2 * farthest_m2))


@inner
def _press(at: Touching, impulse_m_s: float) -> None:
    """Give all contacts an impulse along their normals."""
    copy(at.room.free, at.velocity)
    for i in range(at.number):
        contact = at.contacts[i]
        for k in range(3):
            contact.impulse[k] = impulse_m_s * contact.normal[k]
        push(at, i, 1.0, contact.impulse, at.velocity)


@inner
def _stiffen(at: Touching, share: float) -> None:
    """Give each contact a share of the stiffness of one that a single impulse along its normal stops."""
    for i in range(at.number):
        contact = at.contacts[i]
        shift, spin = response(contact.arm_m, contact.normal, at.inverse_inertia)
        mobility = dot(contact.normal, shift) + dot(cross(contact.arm_m, contact.normal), spin)
        at.room.stiffness[i] = share / mobility


@inner
def _answer(at: Touching, i: int, friction: float, velocity: Array) -> tuple[int, Vector, Vector, float]:
    """State of a contact at a velocity (6,), and its impulse; direction of its friction, and what turns that.

    The last is the change of friction across itself over the change of the impulse that is projected.
    """
    contact, stiffness = at.contacts[i], at.room.stiffness[i]
    n, tried = contact.normal, plus(contact.impulse, -stiffness, velocity_of(contact.arm_m, velocity))
    along = dot(tried, n)
    pressed = along + stiffness * contact.floor_m_s
    across = plus(plus(tried, -along, n), -stiffness, contact.slip_m_s)
    if pressed <= 0.0:
        return _OPEN, (0.0, 0.0, 0.0), across, 0.0
    size, limit = math.sqrt(square(across)), friction * pressed
    if size <= limit and friction > 0.0:
        return _STICKS, plus(across, pressed, n), across, 1.0
    scale = 1.0 / size if size > 0.0 else 0.0
    toward = (scale * across[0], scale * across[1], scale * across[2])
    impulse = plus((pressed * n[0], pressed * n[1], pressed * n[2]), limit, toward)
    return _SLIPS, impulse, toward, scale * limit


@inner
def _look(at: Touching, friction: float, velocity: Array) -> float:
    """By how much a velocity is not what the contacts' impulses make of the free one; its size. Notes their states."""
    room, off = at.room, at.room.off
    for k in range(6):
        off[k] = velocity[k] - room.free[k]
    for i in range(at.number):
        state, impulse, toward, turning = _answer(at, i, friction, velocity)
        room.states[i], room.toward[i, 3] = state, turning
        for k in range(3):
            room.toward[i, k] = toward[k]
        if state != _OPEN:
            push(at, i, -1.0, impulse, off)
    m = at.inverse_inertia
    spin_m2 = 3.0 / (m[0, 0] + m[1, 1] + m[2, 2])
    return math.sqrt(square(off) + spin_m2 * (off[3] * off[3] + off[4] * off[4] + off[5] * off[5]))


@inner
def _find_velocity(at: Touching, friction: float, within: float) -> bool:
    """Change the velocity to one that fits the impulses with which the contacts answer it; whether one is near."""
    room, velocity = at.room, at.velocity
    size = _look(at, friction, velocity)
    for _ in range(_NEWTON_STEPS):
        if size <= within:
            return True
        _differentiate(at, friction)
        if not _solve(room.matrix, room.off):
            return False
        share, before = 1.0, size
        for k in range(6):
            room.trial[k] = room.off[k]
        for _ in range(_HALVINGS):
            for k in range(6):
                velocity[k] -= share * room.trial[k]
            size = _look(at, friction, velocity)
            if size <= max((1.0 - 1e-4 * share) * before, within):
                break
            for k in range(6):
                velocity[k] += share * room.trial[k]
            share *= 0.5
        if not size <= max(0.999 * before, within):
            return False
    return False


@inner
def _differentiate(at: Touching, friction: float) -> None:
    """The derivative of what :func:`_look` found, at the velocity that it looked at."""
    room = at.room
    for k in range(6):
        for m in range(6):
            room.matrix[k, m] = 1.0 if k == m else 0.0
    for i in range(at.number):
        n, stiffness = at.contacts[i].normal, room.stiffness[i]
        if room.states[i] == _STICKS:
            _add_sticking(at, i, stiffness)
        elif room.states[i] == _SLIPS:
            toward = (room.toward[i, 0], room.toward[i, 1], room.toward[i, 2])
            _add(at, i, stiffness, plus(n, friction, toward), n)
            across = cross(n, toward)
            _add(at, i, stiffness * room.toward[i, 3], across, across)


@inner
def _add_sticking(at: Touching, i: int, stiffness: float) -> None:
    """Add to the derivative that a contact is pushed against its motion in all directions alike."""
    x, y, z = at.contacts[i].arm_m
    x, y, z, matrix, m = stiffness * x, stiffness * y, stiffness * z, at.room.matrix, at.inverse_inertia
    for k in range(3):
        matrix[k, k] += stiffness
    matrix[0, 4] += z
    matrix[0, 5] -= y
    matrix[1, 3] -= z
    matrix[1, 5] += x
    matrix[2, 3] += y
    matrix[2, 4] -= x
    arm = at.contacts[i].arm_m
    xx, yy, zz = x * arm[0], y * arm[1], z * arm[2]
    xy, xz, yz = x * arm[1], x * arm[2], y * arm[2]
    for k in range(3):
        a, b, c = m[k, 0], m[k, 1], m[k, 2]
        matrix[3 + k, 0] += b * z - c * y
        matrix[3 + k, 1] += c * x - a * z
        matrix[3 + k, 2] += a * y - b * x
        matrix[3 + k, 3] += a * (yy + zz) - b * xy - c * xz
        matrix[3 + k, 4] += b * (xx + zz) - a * xy - c * yz
        matrix[3 + k, 5] += c * (xx + yy) - a * xz - b * yz


@inner
def _add(at: Touching, i: int, stiffness: float, pushed: Any, moved: Any) -> None:
    """Add to the derivative that a contact is pushed one way where it moves against another."""
    arm = at.contacts[i].arm_m
    shift, spin = response(arm, pushed, at.inverse_inertia)
    turned = cross(arm, moved)
    for k in range(3):
        for m in range(3):
            at.room.matrix[k, m] += stiffness * shift[k] * moved[m]
            at.room.matrix[k, 3 + m] += stiffness * shift[k] * turned[m]
            at.room.matrix[3 + k, m] += stiffness * spin[k] * moved[m]
            at.room.matrix[3 + k, 3 + m] += stiffness * spin[k] * turned[m]


@inner
def _solve(matrix: Array, right: Array) -> bool:
    """Solve linear equations in place, by elimination with partial pivoting; false where they are singular."""
    for i in range(6):
        pivot = i
        for a in range(i + 1, 6):
            pivot = a if abs(matrix[a, i]) > abs(matrix[pivot, i]) else pivot
        if not abs(matrix[pivot, i]) > 0.0:
            return False
        for b in range(i, 6):
            matrix[i, b], matrix[pivot, b] = matrix[pivot, b], matrix[i, b]
        right[i], right[pivot] = right[pivot], right[i]
        for a in range(i + 1, 6):
            share = matrix[a, i] / matrix[i, i]
            for b in range(i + 1, 6):
                matrix[a, b] -= share * matrix[i, b]
            right[a] -= share * right[i]
    for i in range(5, -1, -1):
        for b in range(i + 1, 6):
            right[i] -= matrix[i, b] * right[b]
        right[i] /= matrix[i, i]
    return True


@inner
def _take_impulses(at: Touching, friction: float) -> float:
    """Give the contacts the impulses with which they answer the velocity; the largest velocity that was off."""
    off_m_s = 0.0
    for i in range(at.number):
        contact = at.contacts[i]
        _, impulse, _, _ = _answer(at, i, friction, at.velocity)
        for k in range(3):
            off_m_s = max(off_m_s, abs(impulse[k] - contact.impulse[k]) / at.room.stiffness[i])
            contact.impulse[k] = impulse[k]  # of an open one zero to the bit: it tells which contacts carry
    copy(at.room.free, at.velocity)
    for i in range(at.number):
        push(at, i, 1.0, at.contacts[i].impulse, at.velocity)
    return off_m_s
