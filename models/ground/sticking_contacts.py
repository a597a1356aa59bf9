"""Impulses of contacts that all stick, in closed form. Compiled.

Contacts that stick hold the rock like the bolts of a plate. The velocities that their points lack tell how the rock's
motion changes, and that change tells the force and the moment on it. Of the impulses that add up to these the smallest
are taken: an even share of the force, and of the moment a share that grows with the way from the contacts' middle. So
forces between contacts that no motion depends on stay as they were. Contacts on one line leave the rock free to roll
about it, and contacts at one point free to turn about that.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from toppling.models.compiled import Array, Vector, inner
from toppling.models.ground.contacts import Touching
from toppling.models.ground.rigid import cross, dot, minus, plus, square

_Symmetric = tuple[float, float, float, float, float, float]
"""xx, yy, zz, xy, xz, yz of a matrix."""

_AT_A_POINT, _ON_A_LINE = 1e-12, 1e-10
"""Spread, as a share of the inertia, of contacts at one point; and across a line, as a share of that along it."""

_MISSED = 500.0
"""Times what is right: by so much a contact that sticks may miss its floor, as gaps are not equal."""

_SHARED_ANEW = 12
"""Times at most that a load is shared by weights which follow it; a load at the base's edge takes the most."""

_ZERO, _NO_MOMENTS = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class _Clamped(NamedTuple):
    """Change of the motion with which some contacts stick, and how it is shared among them."""

    number: int
    middle_m: Vector  # of their arms
    force: Vector  # change of the velocity of the centre of mass
    spin: Vector
    moment: Vector  # of their impulses about their middle
    bends: _Symmetric  # of this a contact takes, over its way from the middle


class _Sharing(NamedTuple):
    """How contacts take a load, each times its weight."""

    total: float  # of the weights
    centre_m: Vector  # of the weights
    share: Vector  # of the force
    bending: Vector  # of the moment, over the way from the centre


@inner
def stick_at_once(at: Touching) -> bool:
    """Change impulses and velocity so that the contacts that carry now all stick; whether they can, else nothing.

    They cannot where one would pull or slip, or where one that carries nothing would close. If impulses that change
    least do not lie in their cones, those that are smallest are tried, and then those that follow the load.
    """
    for i in range(at.number):
        contact = at.contacts[i]
        at.room.sticks[i] = 1 if dot(contact.impulse, contact.normal) > 0.0 else 0
    clamped = _clamp(at)
    if clamped.number == 0 or not _moves_right(at, clamped):
        return False
    for retained in (1.0, 0.0):
        parts = _sticking_parts(at, clamped, retained)
        if _all_stick(at, clamped, parts):
            _apply(at, clamped, parts)
            return True
    return _share_by_load(at, clamped)


@inner
def _clamp(at: Touching) -> _Clamped:
    """Change of the motion by the contacts that are to stick."""
    number, middle_m = _middle(at)
    if number == 0:
        return _Clamped(0, _ZERO, _ZERO, _ZERO, _ZERO, _NO_MOMENTS)
    missing, turning, spread, along = _missing(at, middle_m, number)
    mobility, bends = _symmetric(at.inverse_inertia), _NO_MOMENTS
    inertia = _inverse(mobility)
    wide = spread[0] + spread[1] + spread[2]
    if wide <= _AT_A_POINT * (inertia[0] + inertia[1] + inertia[2]):
        force = _times(_inverse(_mobility_at(middle_m, mobility)), missing)
        spin = _times(mobility, cross(middle_m, force))
    else:
        on_a_line = wide - dot(along, _times(spread, along)) <= _ON_A_LINE * wide
        even = (1.0 / wide, 1.0 / wide, 1.0 / wide, 0.0, 0.0, 0.0)
        bends = even if on_a_line else _inverse(_moment_of_bending(spread))
        spin = _times(bends, turning)
        if on_a_line:
            spin = plus(spin, _roll(inertia, middle_m, along, missing, spin), along)
        force = minus(missing, cross(spin, middle_m))
    moment = minus(_times(inertia, spin), cross(middle_m, force))
    return _Clamped(number, middle_m, force, spin, moment, bends)


@inner
def _sticking_parts(at: Touching, clamped: _Clamped, retained: float) -> tuple[float, Vector, Vector]:
    """Parts of a contact: of its former impulse, of the force, and of the moment over its arm from the middle.

    Where none is kept, they share all that they carry together.
    """
    force, moment = (clamped.force, clamped.moment) if retained > 0.0 else _total_loads(at, clamped)
    n = clamped.number
    return retained, (force[0] / n, force[1] / n, force[2] / n), _times(clamped.bends, moment)


@inner
def _total_loads(at: Touching, clamped: _Clamped) -> tuple[Vector, Vector]:
    """Force, and moment about their middle, of all contacts after a change of the motion."""
    force, moment = clamped.force, clamped.moment
    for i in range(at.number):
        if at.room.sticks[i] == 1:
            contact = at.contacts[i]
            force = plus(force, 1.0, contact.impulse)
            moment = plus(moment, 1.0, cross(minus(contact.arm_m, clamped.middle_m), contact.impulse))
    return force, moment


@inner
def _share_by_load(at: Touching, clamped: _Clamped) -> bool:
    """Let all contacts at rest share the load, each by a weight that follows what it presses; whether they all stick.

    The impulses are a weight times a linear function of the place. A weight is multiplied by what that function presses
    there, none where it would pull, so that the load's centre becomes that of the weights and friction is shared as
    pressure is. Changes nothing where they do not stick.
    """
    weights, (force, moment) = at.room.weights, _total_loads(at, clamped)
    for i in range(at.number):
        weights[i] = 1.0 if _rests(at, _lacks_then(at, at.contacts[i], clamped)) else 0.0
    for _ in range(_SHARED_ANEW):
        sharing = _sharing(at, clamped.middle_m, force, moment)
        if not sharing.total > 0.0:
            return False
        all_stick = True
        for i in range(at.number):
            if weights[i] > 0.0:
                all_stick = all_stick and _is_in_cone(at, i, _weighted_impulse(at, i, sharing))
        if all_stick:
            _move(at, clamped)
            for i in range(at.number):
                _take(at, i, _weighted_impulse(at, i, sharing))
            return True
        for i in range(at.number):
            if weights[i] > 0.0:
                weights[i] = max(dot(_weighted_impulse(at, i, sharing), at.contacts[i].normal), 0.0)
    return False


@inner
def _lacks_then(at: Touching, contact: Any, clamped: _Clamped) -> Vector:
    """Velocity that a contact lacks once the motion has changed."""
    return minus(_missing_at(at, contact), plus(clamped.force, 1.0, cross(clamped.spin, contact.arm_m)))


@inner
def _rests(at: Touching, lacks_m_s: Vector) -> bool:
    """Whether a contact that lacks so much velocity is at rest."""
    return max(abs(lacks_m_s[0]), abs(lacks_m_s[1]), abs(lacks_m_s[2])) <= _MISSED * at.enough_m_s


@inner
def _sharing(at: Touching, middle_m: Vector, force: Vector, moment: Vector) -> _Sharing:
    """How contacts with weights take a force and a moment about a place; of no weight where they cannot."""
    total, own, spread = 0.0, _ZERO, _NO_MOMENTS
    for i in range(at.number):
        w = at.room.weights[i]
        total, own = total + w, plus(own, w, minus(at.contacts[i].arm_m, middle_m))
    if not total > 0.0:
        return _Sharing(0.0, _ZERO, _ZERO, _ZERO)
    centre = plus(middle_m, 1.0 / total, own)
    for i in range(at.number):
        spread = _spread_with(spread, at.room.weights[i], minus(at.contacts[i].arm_m, centre))
    bent = _moment_of_bending(spread)
    if not _determinant(bent) > _ON_A_LINE * (spread[0] + spread[1] + spread[2]) ** 3:
        return _Sharing(0.0, _ZERO, _ZERO, _ZERO)
    about = minus(moment, cross(minus(centre, middle_m), force))
    share = force[0] / total, force[1] / total, force[2] / total
    return _Sharing(total, centre, share, _times(_inverse(bent), about))


@inner
def _spread_with(spread: _Symmetric, weight: float, r: Vector) -> _Symmetric:
    """The second moment of points, with one more of a weight at a place."""
    return (
        spread[0] + weight * r[0] * r[0], spread[1] + weight * r[1] * r[1], spread[2] + weight * r[2] * r[2],
        spread[3] + weight * r[0] * r[1], spread[4] + weight * r[0] * r[2], spread[5] + weight * r[1] * r[2],
    )  # fmt: skip


@inner
def _moment_of_bending(spread: _Symmetric) -> _Symmetric:
    """Moment about their middle over the bending of pushes that grow with the way from it; of points' second moment."""
    wide = spread[0] + spread[1] + spread[2]
    return wide - spread[0], wide - spread[1], wide - spread[2], -spread[3], -spread[4], -spread[5]


@inner
def _determinant(a: _Symmetric) -> float:
    xx, yy, zz, xy, xz, yz = a
    return xx * (yy * zz - yz * yz) + xy * (xz * yz - xy * zz) + xz * (xy * yz - xz * yy)


@inner
def _weighted_impulse(at: Touching, i: int, sharing: _Sharing) -> Vector:
    w = at.room.weights[i]
    p = plus(sharing.share, 1.0, cross(sharing.bending, minus(at.contacts[i].arm_m, sharing.centre_m)))
    return w * p[0], w * p[1], w * p[2]


@inner
def _move(at: Touching, clamped: _Clamped) -> None:
    """Change the motion."""
    for k in range(3):
        at.velocity[k] += clamped.force[k]
        at.velocity[3 + k] += clamped.spin[k]


@inner
def _take(at: Touching, i: int, impulse: Vector) -> None:
    """Give a contact its new impulse."""
    for k in range(3):
        at.contacts[i].impulse[k] = impulse[k]


@inner
def _new_impulse(contact: Any, clamped: _Clamped, parts: tuple[float, Vector, Vector]) -> Vector:
    retained, share, bending = parts
    arm_m = minus(contact.arm_m, clamped.middle_m)
    return plus(plus(share, retained, contact.impulse), 1.0, cross(bending, arm_m))


@inner
def _apply(at: Touching, clamped: _Clamped, parts: tuple[float, Vector, Vector]) -> None:
    _move(at, clamped)
    for i in range(at.number):
        if at.room.sticks[i] == 1:
            _take(at, i, _new_impulse(at.contacts[i], clamped, parts))


@inner
def _moves_right(at: Touching, clamped: _Clamped) -> bool:
    """Whether with the change of the motion all that are to stick are at rest, and no other contact closes."""
    for i in range(at.number):
        contact = at.contacts[i]
        lacks = _lacks_then(at, contact, clamped)
        if at.room.sticks[i] == 0:
            if dot(lacks, contact.normal) > at.enough_m_s:
                return False
        elif not _rests(at, lacks):
            return False
    return True


@inner
def _all_stick(at: Touching, clamped: _Clamped, parts: tuple[float, Vector, Vector]) -> bool:
    """Whether the new impulses of all that are to stick press, and lie in their cones."""
    for i in range(at.number):
        if at.room.sticks[i] == 1 and not _is_in_cone(at, i, _new_impulse(at.contacts[i], clamped, parts)):
            return False
    return True


@inner
def _is_in_cone(at: Touching, i: int, impulse: Vector) -> bool:
    """Whether an impulse of a contact presses and does not slip."""
    normal = at.contacts[i].normal
    pressed = dot(impulse, normal)
    return pressed > 0.0 and _friction(impulse, normal) <= at.friction[0] * pressed


@inner
def _middle(at: Touching) -> tuple[int, Vector]:
    """How many contacts are to stick, and the middle of their arms."""
    number, middle = 0, _ZERO
    for i in range(at.number):
        if at.room.sticks[i] == 1:
            number, middle = number + 1, plus(middle, 1.0, at.contacts[i].arm_m)
    most = max(number, 1)
    return number, (middle[0] / most, middle[1] / most, middle[2] / most)


@inner
def _friction(impulse: Any, normal: Any) -> float:
    """Size of the part of an impulse along a contact."""
    return math.sqrt(square(plus(impulse, -dot(impulse, normal), normal)))


@inner
def _missing_at(at: Touching, contact: Any) -> Vector:
    """Velocity that a contact lacks, to move with its floor along its normal and not at all across it."""
    v, w = at.velocity, (at.velocity[3], at.velocity[4], at.velocity[5])
    moves = plus(v, 1.0, cross(w, contact.arm_m))
    n, floor = contact.normal, contact.floor_m_s
    return floor * n[0] - moves[0], floor * n[1] - moves[1], floor * n[2] - moves[2]


@inner
def _missing(at: Touching, middle_m: Vector, number: int) -> tuple[Vector, Vector, _Symmetric, Vector]:
    """Mean of the velocities that contacts lack, their moment and the points' second moment about the middle.

    And the direction in which the farthest lies.
    """
    total, turning, spread = _ZERO, _ZERO, _NO_MOMENTS
    far, along = 0.0, _ZERO
    for i in range(at.number):
        if at.room.sticks[i] == 0:
            continue
        contact = at.contacts[i]
        lacks, r = _missing_at(at, contact), minus(contact.arm_m, middle_m)
        total, turning = plus(total, 1.0, lacks), plus(turning, 1.0, cross(r, lacks))
        spread = _spread_with(spread, 1.0, r)
        if square(r) > far:
            far = square(r)
            size = math.sqrt(far)
            along = r[0] / size, r[1] / size, r[2] / size
    return (total[0] / number, total[1] / number, total[2] / number), turning, spread, along


@inner
def _roll(inertia: _Symmetric, arm_m: Vector, axis: Vector, missing: Vector, spin: Vector) -> float:
    """Spin about a line of contacts with which these, pushing at an arm, have no moment about it."""
    pushed = cross(arm_m, minus(missing, cross(spin, arm_m)))
    about = dot(axis, _times(inertia, axis)) + dot(axis, cross(arm_m, cross(axis, arm_m)))
    return (dot(axis, pushed) - dot(axis, _times(inertia, spin))) / about


@inner
def _mobility_at(arm_m: Vector, mobility: _Symmetric) -> _Symmetric:
    """Velocity, of a point at an arm, over an impulse there."""
    x = _turned_about(arm_m, mobility, (1.0, 0.0, 0.0))
    y = _turned_about(arm_m, mobility, (0.0, 1.0, 0.0))
    z = _turned_about(arm_m, mobility, (0.0, 0.0, 1.0))
    return 1.0 + x[0], 1.0 + y[1], 1.0 + z[2], x[1], x[2], y[2]


@inner
def _turned_about(arm_m: Vector, mobility: _Symmetric, impulse: Vector) -> Vector:
    return cross(_times(mobility, cross(arm_m, impulse)), arm_m)


@inner
def _symmetric(a: Array) -> _Symmetric:
    return a[0, 0], a[1, 1], a[2, 2], a[0, 1], a[0, 2], a[1, 2]


@inner
def _times(a: _Symmetric, b: Any) -> Vector:
    """Symmetric matrix times a vector."""
    return (
        a[0] * b[0] + a[3] * b[1] + a[4] * b[2],
        a[3] * b[0] + a[1] * b[1] + a[5] * b[2],
        a[4] * b[0] + a[5] * b[1] + a[2] * b[2],
    )


@inner
def _inverse(a: _Symmetric) -> _Symmetric:
    """Inverse of a symmetric matrix, by its cofactors."""
    xx, yy, zz, xy, xz, yz = a
    c0, c1, c2 = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    det = xx * c0 + xy * c1 + xz * c2
    return (
        c0 / det, (xx * zz - xz * xz) / det, (xx * yy - xy * xy) / det,
        c1 / det, c2 / det, (xy * xz - xx * yz) / det,
    )  # fmt: skip
