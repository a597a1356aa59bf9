"""Impulses of the contacts that carry, found at once by Newton's method. Compiled.

A Gauss-Seidel sweep hands impulses from contact to contact, and two of them on an edge under a tall rock agree only
after hundreds. Once it is known which contacts carry, and which of them slip, their impulses solve a few equations:
one that sticks has no velocity, one that slips has its friction at the limit and against the slip (in another form
Alart and Curnier 1991). A contact that the answer contradicts changes its state, and it is asked anew. Where the
equations have several answers (four feet on a plane), the forces between feet that no motion depends on stay as the
sweeps left them.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from toppling.models.compiled import Array, Indices, inner
from toppling.models.ground.vectors import copy, cross, dot

_MOST_CARRYING = 8
"""Contacts that are solved for at once."""

_ROWS = 3 * _MOST_CARRYING

_ROUNDS = 5
"""Newton's steps at most, with those after which a contact changed its state."""

_DEPENDENT = 1e-7
"""Share of the largest pivot that must be left, or an equation follows from others and is left out."""

_WITHIN = 0.999
"""Share of a friction's limit up to which a contact counts as one that sticks."""

MISSED = 500.0
"""Times what sweeps let go: by so much a velocity whose equation is left out may differ, as gaps are not equal."""

_LARGEST_TURN_RAD = 0.5
"""Of the direction of a slip in one step."""


class SolverRoom(NamedTuple):
    """Where impulses are worked out, so that no step makes arrays. Axes of a contact: its normal, two tangents."""

    axes: Array  # (contacts, 3, 3), by rows
    mobility: Array  # (contacts, 3, 3), in these
    inverse: Array  # of the mobility
    impulse: Array  # (contacts, 3): before those that carry are solved for
    velocity: Array  # (6,): the same
    vectors: Array  # (4, 3)
    turned: Array  # (3, 3)
    carrying: Indices  # (k,): contacts that carry
    slips: Indices  # (k,): whether they slip
    toward: Array  # (k, 2): direction of their friction, in their tangents
    ways: Array  # (rows, 12): direction and moment of an equation; those of its impulse, the moment as a spin
    matrix: Array  # (rows, rows + 1): the equations and their right side
    order: Indices  # (rows,): of their unknowns
    found: Array  # (rows,)
    sticks: Indices  # (contacts,): those that are to stick


def solver_room(most: int) -> SolverRoom:
    """Room for so many contacts."""
    k, rows = _MOST_CARRYING, _ROWS
    return SolverRoom(
        np.zeros((most, 3, 3)), np.zeros((most, 3, 3)), np.zeros((most, 3, 3)), np.zeros((most, 3)), np.zeros(6),
        np.zeros((4, 3)), np.zeros((3, 3)), np.zeros(k, np.int64), np.zeros(k, np.int64), np.zeros((k, 2)),
        np.zeros((rows, 12)), np.zeros((rows, rows + 1)), np.zeros(rows, np.int64), np.zeros(rows),
        np.zeros(most, np.int64),
    )  # fmt: skip


class Touching(NamedTuple):
    """A rock that touches its ground, at one moment."""

    contacts: Any  # records of CONTACT
    number: int  # so many are looked at
    friction: tuple[float, float]  # static, kinetic
    inverse_inertia: Array  # (3, 3) over mass
    velocity: Array  # (6,)
    enough_m_s: float  # a velocity that is off by less is right
    room: SolverRoom


@inner
def carry_at_once(at: Touching) -> bool:
    """Change impulses and velocity to those that all contacts agree with, from what is known; whether it succeeded."""
    room = at.room
    copy(at.velocity, room.velocity)
    for i in range(at.number):
        copy(at.contacts[i].impulse, room.impulse[i])
    count = _those_that_carry(at)
    for k in range(count):
        if room.slips[k] == 1:
            _slide(at, k, _normal_part(at, k))
    for _ in range(_ROUNDS if count > 0 else 0):
        rows = _equations(at, count)
        _eliminate(room.matrix, rows, room.order, room.found)
        moved = _apply(at, count)
        count, same = _change_states(at, count)
        if count == 0:
            break
        if same:
            missed = _missed_m_s(at, count)
            if missed <= at.enough_m_s or (moved <= at.enough_m_s and missed <= MISSED * at.enough_m_s):
                return True
    copy(room.velocity, at.velocity)
    for i in range(at.number):
        copy(room.impulse[i], at.contacts[i].impulse)
    return False


@inner
def _those_that_carry(at: Touching) -> int:
    """Note the contacts that carry most, and whether they slip, and take from others what they carry; how many."""
    room, count, (static, kinetic) = at.room, 0, at.friction
    for i in range(at.number):
        if dot(at.contacts[i].impulse, room.axes[i, 0]) <= 0.0:
            continue
        k = count
        if count < _MOST_CARRYING:
            count += 1
        else:
            k = 0
            for other in range(1, count):
                k = other if _normal_part(at, other) < _normal_part(at, k) else k
            if _normal_part(at, k) >= dot(at.contacts[i].impulse, room.axes[i, 0]):
                _take(at, i)
                continue
            _take(at, room.carrying[k])
        room.carrying[k] = i
    for k in range(count):
        one, axes = at.contacts[room.carrying[k]], room.axes[room.carrying[k]]
        normal, x, y = _normal_part(at, k), dot(one.impulse, axes[1]), dot(one.impulse, axes[2])
        size = math.sqrt(x * x + y * y)
        at_limit = _WITHIN * kinetic * normal <= size <= kinetic * normal / _WITHIN
        room.slips[k] = 1 if size > 0.0 and (at_limit or size >= _WITHIN * static * normal) else 0
        if size > 0.0:
            room.toward[k, 0], room.toward[k, 1] = x / size, y / size
    return count


@inner
def _take(at: Touching, i: int) -> None:
    """Take from a contact the impulse that it has."""
    one = at.contacts[i]
    push(one.arm_m, (-one.impulse[0], -one.impulse[1], -one.impulse[2]), at.inverse_inertia, at.velocity)
    for axis in range(3):
        one.impulse[axis] = 0.0


@inner
def _normal_part(at: Touching, k: int) -> float:
    return dot(at.contacts[at.room.carrying[k]].impulse, at.room.axes[at.room.carrying[k], 0])


@inner
def _give(at: Touching, k: int, normal: float, x: float, y: float) -> float:
    """Give a contact that carries an impulse, in its axes; by how much that differs from the one it had."""
    i = at.room.carrying[k]
    one, axes, change = at.contacts[i], at.room.axes[i], at.room.vectors[0]
    for axis in range(3):
        new = normal * axes[0, axis] + x * axes[1, axis] + y * axes[2, axis]
        change[axis] = new - one.impulse[axis]
        one.impulse[axis] = new
    push(one.arm_m, change, at.inverse_inertia, at.velocity)
    return math.sqrt(dot(change, change))


@inner
def _slide(at: Touching, k: int, normal: float) -> float:
    """Give a contact that slips a normal impulse, and friction at its limit."""
    limit, toward = at.friction[1] * normal, at.room.toward
    return _give(at, k, normal, limit * toward[k, 0], limit * toward[k, 1])


@inner
def _speed(at: Touching, i: int, axis: int) -> float:
    """Velocity of a contact along one of its axes."""
    turning = cross((at.velocity[3], at.velocity[4], at.velocity[5]), at.contacts[i].arm_m)
    way = at.room.axes[i, axis]
    return dot(way, at.velocity) + dot(way, turning)


@inner
def _note_way(out: Array, at: int, arm: Any, way: Any) -> None:
    """A direction at an arm, and its moment, from a place in a row on."""
    x, y, z = cross(arm, way)
    out[at], out[at + 1], out[at + 2] = way[0], way[1], way[2]
    out[at + 3], out[at + 4], out[at + 5] = x, y, z


@inner
def _equations(at: Touching, count: int) -> int:
    """Write the equations for a change of the impulses; how many.

    Of each contact: the velocity along its normal; of one that sticks those along its tangents too, of one that slips
    the velocity across its friction, which turns until there is none.
    """
    room, row = at.room, 0
    for k in range(count):
        i = room.carrying[k]
        axes, arm = room.axes[i], at.contacts[i].arm_m
        x, y = room.toward[k, 0], room.toward[k, 1]
        share = at.friction[1] if room.slips[k] == 1 else 0.0
        toward = (
            x * axes[1, 0] + y * axes[2, 0], x * axes[1, 1] + y * axes[2, 1], x * axes[1, 2] + y * axes[2, 2],
        )  # fmt: skip
        _note_way(room.ways[row], 0, arm, axes[0])
        pushed = (
            axes[0, 0] + share * toward[0], axes[0, 1] + share * toward[1], axes[0, 2] + share * toward[2],
        )  # fmt: skip
        _note_way(room.ways[row], 6, arm, pushed)
        room.matrix[row, _ROWS] = at.contacts[i].floor_m_s - _speed(at, i, 0)
        row += 1
        if room.slips[k] == 1:
            across = cross(axes[0], toward)
            _note_way(room.ways[row], 0, arm, across)
            _note_way(room.ways[row], 6, arm, across)
            room.matrix[row, _ROWS] = x * -_speed(at, i, 2) + y * _speed(at, i, 1)
            row += 1
            continue
        for axis in (1, 2):
            _note_way(room.ways[row], 0, arm, axes[axis])
            _note_way(room.ways[row], 6, arm, axes[axis])
            room.matrix[row, _ROWS] = -_speed(at, i, axis)
            row += 1
    _fill(at, count, row)
    return row


@inner
def _fill(at: Touching, count: int, rows: int) -> None:
    """What unit impulses along the ways of all equations do to the velocity of each."""
    room, inverse = at.room, at.inverse_inertia
    ways, matrix = room.ways, room.matrix
    for j in range(rows):
        a, b, c = ways[j, 9], ways[j, 10], ways[j, 11]
        for k in range(3):
            ways[j, 9 + k] = inverse[k, 0] * a + inverse[k, 1] * b + inverse[k, 2] * c
    for i in range(rows):
        for j in range(rows):
            total = 0.0
            for k in range(6):
                total += ways[i, k] * ways[j, 6 + k]
            matrix[i, j] = total
    row = 0
    for k in range(count):
        if room.slips[k] == 1:
            # Friction that turns also loses what it had along the slip; the row is scaled to the size of the others.
            i, x, y = room.carrying[k], room.toward[k, 0], room.toward[k, 1]
            against = -(x * _speed(at, i, 1) + y * _speed(at, i, 2))
            limit = at.friction[1] * max(_normal_part(at, k), 1e-6 * at.enough_m_s)
            stiff = max(against, 0.0) / limit
            matrix[row + 1, row + 1] += stiff
            for j in range(rows):
                matrix[row + 1, j] /= 1.0 + stiff
            matrix[row + 1, _ROWS] /= 1.0 + stiff
        row += 2 if room.slips[k] == 1 else 3


@inner
def _eliminate(matrix: Array, rows: int, order: Indices, found: Array) -> None:
    """Solve equations by elimination with complete pivoting; unknowns that nothing is left to tell are zero."""
    rank, largest = rows, 0.0
    for i in range(rows):
        order[i], found[i] = i, 0.0
    for i in range(rows):
        pivot, at_row, at_column = 0.0, i, i
        for a in range(i, rows):
            for b in range(i, rows):
                if abs(matrix[a, b]) > pivot:
                    pivot, at_row, at_column = abs(matrix[a, b]), a, b
        largest = max(largest, pivot)
        if not pivot > _DEPENDENT * largest:
            rank = i
            break
        if at_row != i:
            for b in range(i, rows):
                matrix[i, b], matrix[at_row, b] = matrix[at_row, b], matrix[i, b]
            matrix[i, _ROWS], matrix[at_row, _ROWS] = matrix[at_row, _ROWS], matrix[i, _ROWS]
        if at_column != i:
            order[i], order[at_column] = order[at_column], order[i]
            for a in range(rows):
                matrix[a, i], matrix[a, at_column] = matrix[a, at_column], matrix[a, i]
        for a in range(i + 1, rows):
            share = matrix[a, i] / matrix[i, i]
            for b in range(i + 1, rows):
                matrix[a, b] -= share * matrix[i, b]
            matrix[a, _ROWS] -= share * matrix[i, _ROWS]
    for i in range(rank - 1, -1, -1):
        total = matrix[i, _ROWS]
        for b in range(i + 1, rank):
            total -= matrix[i, b] * found[order[b]]
        found[order[i]] = total / matrix[i, i]


@inner
def _apply(at: Touching, count: int) -> float:
    """Change the impulses by what was found; the largest change."""
    room, row, moved = at.room, 0, 0.0
    for k in range(count):
        i = room.carrying[k]
        normal = _normal_part(at, k) + room.found[row]
        if room.slips[k] == 1:
            limit = at.friction[1] * max(_normal_part(at, k), 1e-6 * at.enough_m_s)
            turn = min(max(room.found[row + 1] / limit, -_LARGEST_TURN_RAD), _LARGEST_TURN_RAD)
            x, y, c, s = room.toward[k, 0], room.toward[k, 1], math.cos(turn), math.sin(turn)
            room.toward[k, 0], room.toward[k, 1] = c * x - s * y, s * x + c * y
            moved = max(moved, _slide(at, k, normal))
            row += 2
            continue
        x = dot(at.contacts[i].impulse, room.axes[i, 1]) + room.found[row + 1]
        y = dot(at.contacts[i].impulse, room.axes[i, 2]) + room.found[row + 2]
        moved = max(moved, _give(at, k, normal, x, y))
        row += 3
    return moved


@inner
def _change_states(at: Touching, count: int) -> tuple[int, bool]:
    """Change the states that the impulses and velocities contradict: how many carry now, and whether none changed."""
    room, same, static = at.room, True, at.friction[0]
    k = 0
    while k < count:
        i, normal = room.carrying[k], _normal_part(at, k)
        if normal <= 0.0:
            _take(at, i)
            count, same = count - 1, False
            room.carrying[k], room.slips[k] = room.carrying[count], room.slips[count]
            copy(room.toward[count], room.toward[k])
            continue
        if room.slips[k] == 1:
            x, y = room.toward[k, 0], room.toward[k, 1]
            if x * _speed(at, i, 1) + y * _speed(at, i, 2) > at.enough_m_s:
                room.slips[k], same = 0, False
        else:
            x, y = dot(at.contacts[i].impulse, room.axes[i, 1]), dot(at.contacts[i].impulse, room.axes[i, 2])
            size = math.sqrt(x * x + y * y)
            if size > static * normal:
                room.slips[k], same = 1, False
                room.toward[k, 0], room.toward[k, 1] = x / size, y / size
                _slide(at, k, normal)
        k += 1
    worst, fastest = -1, at.enough_m_s
    for i in range(at.number):
        if dot(at.contacts[i].impulse, at.room.axes[i, 0]) <= 0.0:
            closing = at.contacts[i].floor_m_s - _speed(at, i, 0)
            if closing > fastest:
                worst, fastest = i, closing
    if worst < 0:
        return count, same
    if count == _MOST_CARRYING:
        return 0, False
    room.carrying[count], room.slips[count] = worst, 0
    return count + 1, False


@inner
def _missed_m_s(at: Touching, count: int) -> float:
    """Largest velocity by which a contact that carries misses its equations."""
    room, missed = at.room, 0.0
    for k in range(count):
        i = room.carrying[k]
        missed = max(missed, abs(_speed(at, i, 0) - at.contacts[i].floor_m_s))
        x, y = _speed(at, i, 1), _speed(at, i, 2)
        if room.slips[k] == 1:
            missed = max(missed, abs(room.toward[k, 0] * y - room.toward[k, 1] * x))
        else:
            missed = max(missed, abs(x), abs(y))
    return missed


@inner
def push(arm: Any, impulse: Any, inverse_inertia: Array, velocity: Array) -> None:
    """Change a velocity (6,) by an impulse at an arm."""
    x, y, z = cross(arm, impulse)
    for k in range(3):
        velocity[k] += impulse[k]
        velocity[3 + k] += inverse_inertia[k, 0] * x + inverse_inertia[k, 1] * y + inverse_inertia[k, 2] * z
