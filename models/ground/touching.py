"""A rock that touches its ground at one moment, and the room in which the impulses of its contacts are found."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from toppling.models.compiled import Array, Indices, Vector, inner
from toppling.models.ground.vectors import cross, plus


class SolverRoom(NamedTuple):
    """Where impulses are worked out, so that no step makes arrays."""

    free: Array  # (6,): the velocity without any impulses
    start: Array  # (6,): velocities from and with which one is searched for
    trial: Array
    off: Array  # (6,): by how much a velocity is not what its impulses make of the free one
    matrix: Array  # (6, 6): the derivative of that by the velocity
    stiffness: Array  # (contacts,): impulse over velocity
    weights: Array  # (contacts,): by which contacts that stick share the load
    sticks: Indices  # (contacts,): those that are to stick
    states: Indices  # (contacts,): open, sticks or slips, at the velocity that was looked at
    toward: Array  # (contacts, 4): of one that slips, direction of its friction, and what turns that


def solver_room(most: int) -> SolverRoom:
    """Room for so many contacts."""
    contacts, marks = np.zeros((2, most)), np.zeros((2, most), np.int64)
    rooms = [*np.zeros((4, 6)), np.zeros((6, 6)), *contacts, *marks, np.zeros((most, 4))]
    return SolverRoom(*rooms)


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
def velocity_of(arm: Any, velocity: Array) -> Vector:
    """Velocity of the point at an arm."""
    return plus(velocity, 1.0, cross((velocity[3], velocity[4], velocity[5]), arm))


@inner
def response(arm: Any, impulse: Any, inverse_inertia: Array) -> tuple[Vector, Vector]:
    """What an impulse at an arm adds to the velocity: of the centre of mass, and the spin."""
    x, y, z = cross(arm, impulse)
    m = inverse_inertia
    return (impulse[0], impulse[1], impulse[2]), (
        m[0, 0] * x + m[0, 1] * y + m[0, 2] * z,
        m[1, 0] * x + m[1, 1] * y + m[1, 2] * z,
        m[2, 0] * x + m[2, 1] * y + m[2, 2] * z,
    )


@inner
def push(at: Touching, i: int, share: float, impulse: Any, velocity: Array) -> None:
    """Change a velocity (6,) by a share of an impulse at a contact."""
    way, spin = response(at.contacts[i].arm_m, impulse, at.inverse_inertia)
    for k in range(3):
        velocity[k] += share * way[k]
        velocity[3 + k] += share * spin[k]
