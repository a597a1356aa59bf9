"""Which acceleration tips a rock in a pose without slip, and how it then turns.

A rock that does not slip turns about an axis through two of its contacts, or about one contact, while each other
contact stays or opens. It tips at the least acceleration for which such a rotation about an axis through two contacts
gains energy. On one plane these axes are the edges of the support polygon, and the acceleration is that of
Anooshehpoor, Brune and Zeng (2004). Contacts that nothing opens, such as those of a slab with a wall that it is pushed
against, leave no axis: then no acceleration tips it.

Equilibrium within friction cones that are opened to half-spaces is no measure of this. In a groove, or between floor
and wall, contacts whose line lies within both half-spaces would hold any load by forces on each other.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from toppling.models.arrays import Array

_APART_FRACTION = 1e-4
"""Distance between contacts up to which they are one place, as a fraction of the half diagonal R."""

OPENS = 1e-4
"""Speed at which a contact may close and still count as staying, over that of a point at a distance R from the axis:
its place is known to about a hundredth of this."""

_MANY = 16
"""Contacts above which those are left out that lie between others."""

_DIRECTIONS = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)], float)

_ROUNDING = 1e-12
"""Rate at which the centre of mass may go along a load or push by rounding, over R."""

_BALANCED = 1e-6
"""Speed of the centre of mass along the load, over that of a point at a distance R from the axis, of a rotation about
which a rock is balanced: some hundred times what rounding leaves of a pose."""

_NEXT, _LAST = [1, 2, 0], [2, 0, 1]


class Turn(NamedTuple):
    """A rotation: a point of its axis, from the centre of mass, and the axis as a unit vector."""

    arm_m: Array
    axis: Array


def crossed(first: Array, other: Array) -> Array:
    """Vector product along the last axis, in a fifth of the time of `numpy.cross` for a few vectors."""
    product: Array = first[..., _NEXT] * other[..., _LAST] - first[..., _LAST] * other[..., _NEXT]
    return product


def tips_m_s2(arms_m: Array, normals: Array, size_m: float, load_m_s2: Array, push: Array) -> float | None:
    """Largest acceleration s at which the load + s push tips a rock about no axis; None if each tips it.

    Infinite where none is too large. Arms (n, 3) are from the centre of mass, normals toward the rock.
    """
    if on_one_line(arms_m, size_m):  # they let it turn both ways
        return None
    start, axis = _axes(arms_m, normals, size_m)
    moved, g = crossed(start, axis), float(np.linalg.norm(load_m_s2))  # of the centre of mass
    gains, by_push = moved @ load_m_s2, moved @ push
    across = np.abs(by_push) <= _ROUNDING * size_m
    if (gains[across] > _ROUNDING * size_m * g).any():
        return None
    share, ahead = -gains[~across] / by_push[~across], by_push[~across] > 0.0
    most, least = float(share[ahead].min(initial=np.inf)), float(share[~ahead].max(initial=-np.inf))
    return most if least < most else None


def on_one_line(arms_m: Array, size_m: float) -> bool:
    """Whether contacts (n, 3) lie on a line, or at a place."""
    if len(arms_m) < 3:
        return True
    widths = np.linalg.svd(arms_m - arms_m.mean(axis=0), compute_uv=False)
    return bool(widths[1] <= _APART_FRACTION * size_m)


def balanced_on(arms_m: Array, normals: Array, size_m: float, load_m_s2: Array) -> Turn | None:
    """The rotation without slip with which a rock in equilibrium falls at the least touch; None if it is stable.

    The load does no work over it in its first order, and the centre of mass lies above its axis.
    """
    start, axis = _axes(arms_m, normals, size_m)
    # At one place: toward x, as on a plane.
    if len(start) == 0 and len(arms_m) and on_one_line(arms_m, size_m):
        start, axis = arms_m[:1], crossed(np.eye(3)[np.abs(load_m_s2).argmin()], load_m_s2)[None]
        axis = axis / np.linalg.norm(axis)
    com = (start * axis).sum(axis=1)[:, None] * axis - start
    falls = np.abs(crossed(start, axis) @ load_m_s2) <= _BALANCED * size_m * float(np.linalg.norm(load_m_s2))
    falls &= com @ load_m_s2 < 0.0
    return Turn(start[falls][0], axis[falls][0]) if falls.any() else None


def turn_under(arms_m: Array, normals: Array, size_m: float, force_m_s2: Array) -> Turn | None:
    """The rotation without slip that gains the most energy over its angle under a force; None if none gains any."""
    start, axis = _axes(arms_m, normals, size_m)
    moment = crossed(-arms_m, force_m_s2)
    moment -= (moment * normals).sum(axis=1)[:, None] * normals  # without spin
    size = np.linalg.norm(moment, axis=1)
    rolls = np.flatnonzero(size > 0.0)
    pivots, about = _that_open(arms_m[rolls], moment[rolls] / size[rolls, None], arms_m, normals, size_m)
    arms, axes = np.vstack([start, pivots]), np.vstack([axis, about])
    gains = (crossed(arms, axes) * force_m_s2).sum(axis=1)
    best = int(gains.argmax()) if len(gains) else 0
    return Turn(arms[best], axes[best]) if len(gains) and gains[best] > 0.0 else None


def _that_open(
    start_m: Array, axis: Array, arms_m: Array, normals: Array, size_m: float
) -> tuple[Array, Array]:
    """Select the points and axes (k, 3) about which the rock can turn without closing a contact."""
    opening = (crossed(axis[:, None], arms_m - start_m[:, None]) * normals).sum(axis=2)
    can = opening.min(axis=1, initial=0.0) >= -OPENS * size_m
    return start_m[can], axis[can]


def _axes(arms_m: Array, normals: Array, size_m: float) -> tuple[Array, Array]:
    """Points and axes (k, 3) through two contacts about which the rock can turn."""
    if len(arms_m) > _MANY:
        outermost = _outermost(arms_m)
        arms_m, normals = arms_m[outermost], normals[outermost]
    first, second = np.triu_indices(len(arms_m), 1)
    along = arms_m[second] - arms_m[first]
    length = np.linalg.norm(along, axis=1)
    apart = length > _APART_FRACTION * size_m
    start, axis = arms_m[first[apart]], along[apart] / length[apart, None]
    return _that_open(np.vstack([start, start]), np.vstack([axis, -axis]), arms_m, normals, size_m)


def _outermost(places_m: Array) -> Array:
    """Numbers of the contacts (n, 3) that are outermost in plan, or of all of them in some direction.

    Of many contacts these decide: about an axis between others, contacts on one of its sides would close.
    """
    some = np.unique((places_m @ _DIRECTIONS.T).argmax(axis=0))
    try:
        return np.union1d(ConvexHull(places_m[:, :2]).vertices, some)
    except QhullError:  # all on a line in plan
        return some
