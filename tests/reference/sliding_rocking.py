"""Plane motion of a body on two corners that may slide, rock, fly and land: Coulomb and Newton.

Moreau's time stepping (Moreau 1988; Jean 1999): over a step the impulses of the corners that touch at its
midpoint obey, at the level of velocities, Signorini's law with Newton's restitution, 0 <= v_n(after) + e
v_n(before), complementary to the normal impulse, and Coulomb's law for the tangential one. Two corners on a
plane share their tangential velocity, so one tangential impulse bounded by both normal ones stands for the
two; the few modes (which corners press; stick, slip either way) are tried one by one and solved exactly,
without iteration or regularisation. Free flight is exact under a constant force; turning and events are
followed to first order: halve the step to see the error. With restitution and friction together Newton's law
may create energy; none is hidden.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from reference.rocking import PlaneBody
from toppling.models.pedestal import ContactProperties

Array = NDArray[np.float64]

STEPS_OF_FLIGHT = 10
"""A corner that has been off the ground for so many steps lands as one that slips."""

_SLACK = 1e-12  # share of the speeds and impulses at hand by which a mode may miss its conditions


@dataclass(frozen=True)
class PlaneMotion:
    """Motion relative to the ground at every step, (n, 3): along it and off it, m, and the angle toward +x, rad."""

    time_s: Array
    place: Array
    velocity: Array


def slide_and_rock(
    body: PlaneBody,
    contact: ContactProperties,
    gravity_m_s2: Callable[[float], tuple[float, float]],
    duration_s: float,
    time_step_s: float,
    place: tuple[float, float, float] | None = None,
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> PlaneMotion:
    """Follow a body on two corners under an effective gravity, standing at rest at the start unless told.

    The gravity, less the ground's acceleration, is along the ground and off it: (-a_x, -g - a_z) on level ground.
    """
    steps = int(np.ceil(duration_s / time_step_s - 1e-9))
    at = np.array(place if place is not None else (0.0, body.height_m, 0.0), float)
    moving = np.array(velocity, float)
    places, velocities = np.empty((steps + 1, 3)), np.empty((steps + 1, 3))
    places[0], velocities[0] = at, moving
    touch_depth = 1e-12 * body.height_m
    sticks, aloft = False, 0
    for step in range(steps):
        middle = at + 0.5 * time_step_s * moving
        cosine, sine, z = np.cos(middle[2]), np.sin(middle[2]), -body.height_m
        corners = [(x * cosine + z * sine, -x * sine + z * cosine) for x in (body.right_m, -body.left_m)]
        touching = [corner for corner in corners if middle[1] + corner[1] <= touch_depth]
        g_x, g_z = gravity_m_s2((step + 0.5) * time_step_s)
        free = moving + time_step_s * np.array([g_x, g_z, 0.0])
        after, stuck = free, None
        if touching:
            after, stuck = _impulses(body.inertia_per_mass_m2, contact, touching, moving, free, sticks)
        # A pivot leaves the ground for single steps, by the arc that its step cuts short: it has not let go.
        aloft = aloft + 1 if stuck is None else 0
        sticks = sticks and aloft < STEPS_OF_FLIGHT if stuck is None else stuck
        at = at + 0.5 * time_step_s * (moving + after)
        moving = after
        places[step + 1], velocities[step + 1] = at, moving
    return PlaneMotion(np.linspace(0.0, steps * time_step_s, steps + 1), places, velocities)


def _impulses(inertia, contact, touching, before, free, sticks) -> tuple[Array, bool | None]:
    """Velocity after the impulses of the corners that touch, and whether they stick; None if they leave.

    Whether they stuck in the step before must be told: a corner that does is moved along the ground by the turning of
    a step, which looks like slip.
    """
    normals = [np.array([0.0, 1.0, -x]) for x, _ in touching]
    tangent = np.array([1.0, 0.0, sum(z for _, z in touching) / len(touching)])
    compliance = np.array([1.0, 1.0, 1.0 / inertia])
    # Newton: the normal velocity that a corner must at least leave with.
    least = [-contact.restitution * min(float(n @ before), 0.0) for n in normals]
    if all(float(n @ free) >= v for n, v in zip(normals, least, strict=True)):
        return free, None
    scale = float(np.abs(free).max() + np.abs(before).max()) + 1e-300
    slack = _SLACK * scale

    def after_mode(direction: int, pressing: tuple[bool, ...]) -> Array | None:
        """Velocity after one mode's impulses, or None where it breaks one of its conditions."""
        closed = [n for n, p in zip(normals, pressing, strict=True) if p]
        targets = [v for v, p in zip(least, pressing, strict=True) if p]
        if direction == 0:
            rows, wanted = [*closed, tangent], [*targets, 0.0]
            columns = rows
        else:
            rows, wanted = closed, targets
            columns = [n - direction * contact.friction_kinetic * tangent for n in closed]
        system = np.array([[float(r @ (compliance * c)) for c in columns] for r in rows])
        try:
            impulse = np.linalg.solve(system, np.array(wanted) - np.array([float(r @ free) for r in rows]))
        except np.linalg.LinAlgError:
            return None
        after = free + compliance * np.sum([i * c for i, c in zip(impulse, columns, strict=True)], axis=0)
        normal = impulse[: len(closed)]
        if (normal < -slack).any():
            return None
        if any(float(n @ after) < v - slack for n, v in zip(normals, least, strict=True)):
            return None
        if direction == 0:
            return after if abs(impulse[-1]) <= contact.friction_static * normal.sum() + slack else None
        return after if direction * float(tangent @ after) >= -slack else None

    slip = float(tangent @ before)
    slipping = not sticks and abs(slip) > 1e-9 * scale
    onward = int(np.sign(slip))
    # A corner that slides keeps sliding where that is consistent; one that rests keeps resting.
    directions = (onward, 0, -onward) if slipping else (0, 1, -1)
    sets = [s for s in product((True, False), repeat=len(normals)) if any(s)]
    for direction, pressing in product(directions, sets):
        after = after_mode(direction, pressing)
        if after is not None:
            return after, direction == 0
    msg = f"no contact mode is consistent: velocity before {before}, free {free}, corners {touching}"
    raise ArithmeticError(msg)
