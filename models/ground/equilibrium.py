"""Which loads contacts with friction hold at rest, each along its own normal: linear programmes over their cones."""

from __future__ import annotations

import numpy as np
import scipy

from toppling.models.compiled import Array, Flags

_SIDES = 32
"""Of the pyramid within each friction cone: it misses at most 1 - cos(pi / SIDES), half a per cent, of the friction."""

_DIRECTIONS = 48
"""In which the border of the loads that are held is looked for."""

_HELD_WITHIN = 1e-8
"""Share of a load that a mixture of wrenches may miss: rounding."""

_FARTHEST, _MOST_TRIALS = 1e3, 100
"""Of a load's size: a share of the way that is every share; and shares tried, of which six have been enough."""

_AT_ONCE = 60
"""Wrenches that are weighed together."""


def wrenches(arms_m: Array, normals: Array, friction: float) -> Array:
    """Forces and moments about the centre of mass (6, n) of the edges of the contacts' friction pyramids."""
    angle = 2.0 * np.pi * np.arange(_SIDES) / _SIDES if friction > 0.0 else np.zeros(1)
    one = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
    one /= np.linalg.norm(one, axis=1)[:, None]
    other = np.cross(normals, one)
    across = np.cos(angle)[:, None] * one[:, None] + np.sin(angle)[:, None] * other[:, None]
    force = normals[:, None] + friction * across  # contacts, sides, 3
    return np.concatenate([force, np.cross(arms_m[:, None], force)], axis=2).reshape(-1, 6).T


def farthest_load(
    columns: Array, load_m_s2: Array, way_m_s2: Array, size_m: float, more_than: float = -np.inf
) -> float | None:
    """Largest share s for which the specific force load + s way on the centre of mass is held; None if none is.

    Where a load is not held, what the nearest mixture of wrenches leaves of it is the normal of a plane between it and
    all that are held (Farkas 1902). From far away, the share at which load + s way meets that plane is tried next.

    Parameters
    ----------
    columns : (6, n) array
        As :func:`wrenches` gives them.
    load_m_s2, way_m_s2 : (3,) arrays
    size_m : float
        Scale of lengths.
    more_than : float
        None as well where no larger share than this is held, which a single trial tells.

    Returns
    -------
    float or None
        Infinite where every share is held; negative where only loads against the way are.
    """
    scaled = _scaled(columns, size_m)
    far = _FARTHEST * float(np.linalg.norm(load_m_s2) / np.linalg.norm(way_m_s2))
    if more_than > -np.inf:
        missed = _missed(scaled, load_m_s2 + more_than * way_m_s2)
        if missed is None or (np.linalg.norm(missed) > _HELD_WITHIN and missed[:3] @ way_m_s2 > 0.0):
            return None
    share = far
    for _ in range(_MOST_TRIALS):
        missed = _missed(scaled, load_m_s2 + share * way_m_s2)
        if missed is None:
            return None
        if np.linalg.norm(missed) <= _HELD_WITHIN:
            break
        beyond = float(missed[:3] @ way_m_s2)
        if beyond <= 0.0:  # with less of the way even more is missed
            return None
        share = -float(missed[:3] @ load_m_s2) / beyond
    return np.inf if share == far else share


def are_held(columns: Array, loads_m_s2: Array, size_m: float) -> Flags:
    """Which specific forces (n, 3) on the centre of mass contacts with the given :func:`wrenches` (6, k) hold.

    A load is held where a mixture of the wrenches opposes it; sizes of loads do not matter.
    """
    scaled = _scaled(columns, size_m)
    missed = [_missed(scaled, load) for load in loads_m_s2]
    return np.array([each is not None and np.linalg.norm(each) <= _HELD_WITHIN for each in missed], bool)


def _scaled(columns: Array, size_m: float) -> Array:
    """Wrenches whose moments are forces at a distance of size_m."""
    return columns / np.array([1.0, 1.0, 1.0, size_m, size_m, size_m])[:, None]


def _missed(scaled: Array, load_m_s2: Array) -> Array | None:
    """What the nearest mixture of wrenches leaves (6,) of a load, as a share of it; None if none is found.

    By non-negative least squares, which end without error (Lawson and Hanson 1974), over the few wrenches that oppose
    most of what is left so far: a base on a curve has tens of thousands, of which at most six bear.
    """
    if not load_m_s2.any():
        return np.zeros(6)
    return _least_missed(scaled, -np.append(load_m_s2 / np.linalg.norm(load_m_s2), np.zeros(3)))


def shortest(columns: Array, least: Array) -> Array:
    """The shortest x (6,) with `columns.T @ x >= least` (Lawson and Hanson 1974, chapter 23)."""
    unit = least.max(initial=0.0)
    missed = _least_missed(np.vstack([columns, least / unit]), np.eye(7)[6]) if unit > 0.0 else None
    return unit * missed[:6] / -missed[6] if missed is not None and missed[6] < 0.0 else np.zeros(6)


def _least_missed(columns: Array, target: Array) -> Array | None:
    """What the mixture of columns that is nearest to a target has beyond it; None if none is found."""
    missed, bearing, before = -target, np.zeros(0, int), np.inf
    while (size := float(np.linalg.norm(missed))) < before:
        along = missed @ columns
        some = np.argpartition(along, _AT_ONCE)[:_AT_ONCE] if len(along) > _AT_ONCE else np.arange(len(along))
        some = some[along[some] < 0.0]
        if len(some) == 0:  # SciPy aborts the process over no wrenches at all
            break
        chosen, before = np.union1d(bearing, some), size
        try:
            shares = scipy.optimize.nnls(columns[:, chosen], target)[0]
        except RuntimeError:  # it has found none in the steps that it takes at most
            return None
        missed, bearing = columns[:, chosen] @ shares - target, chosen[shares > 0.0]
    return missed


def held_polygon(columns: Array, size_m: float) -> Array:
    """Half planes (k, 3) of the loads that are held: a x + b y <= c, of the horizontal over the downward part.

    The loads form a convex cone, of which this is a polygon within the section at unit downward load: what it holds is
    held. Empty where gravity along -z alone is not held.
    """
    down = np.array([0.0, 0.0, -1.0])
    angle = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    corners = []
    for way in np.column_stack([np.cos(angle), np.sin(angle), np.zeros(_DIRECTIONS)]):
        far = farthest_load(columns, down, way, size_m)
        if far is None or far < 0.0:
            return np.zeros((0, 3))
        corners.append(min(far, 100.0) * way[:2])
    ring = np.array(corners)
    edge = np.roll(ring, -1, axis=0) - ring
    normal = np.column_stack([edge[:, 1], -edge[:, 0]])
    length = np.linalg.norm(normal, axis=1)
    normal, ring = normal[length > 1e-12] / length[length > 1e-12, None], ring[length > 1e-12]
    return np.column_stack([normal, (normal * ring).sum(axis=1)])


def held(half_planes: Array, loads_m_s2: Array, margin: float = 1e-6) -> Flags:
    """Which of some loads (n, 3) lie within half planes of :func:`held_polygon`."""
    if len(half_planes) == 0:
        return np.zeros(len(loads_m_s2), bool)
    down, limits = -loads_m_s2[:, 2], half_planes[:, 2] - margin
    inside: Flags = np.hypot(loads_m_s2[:, 0], loads_m_s2[:, 1]) <= limits.min() * down
    far = np.flatnonzero(~inside)
    outside = loads_m_s2[far, :2] @ half_planes[:, :2].T - down[far, None] * limits
    inside[far] = (outside <= 0.0).all(axis=1)
    return inside & (down > 0.0)
