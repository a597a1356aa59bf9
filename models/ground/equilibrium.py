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


def wrenches(arms_m: Array, normals: Array, friction: float) -> Array:
    """Forces and moments about the centre of mass (6, n) of the edges of the contacts' friction pyramids."""
    angle = 2.0 * np.pi * np.arange(_SIDES) / _SIDES if friction > 0.0 else np.zeros(1)
    one = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
    one /= np.linalg.norm(one, axis=1)[:, None]
    other = np.cross(normals, one)
    across = np.cos(angle)[:, None] * one[:, None] + np.sin(angle)[:, None] * other[:, None]
    force = normals[:, None] + friction * across  # contacts, sides, 3
    return np.concatenate([force, np.cross(arms_m[:, None], force)], axis=2).reshape(-1, 6).T


def farthest_load(columns: Array, load_m_s2: Array, way_m_s2: Array, size_m: float) -> float | None:
    """Largest share s for which the specific force load + s way on the centre of mass is held; None if none is.

    Parameters
    ----------
    columns : (6, n) array
        As :func:`wrenches` gives them.
    load_m_s2, way_m_s2 : (3,) arrays
    size_m : float
        Scale of lengths.

    Returns
    -------
    float or None
        Infinite where every share is held; negative where only loads against the way are.
    """
    scaled = columns / np.array([1.0, 1.0, 1.0, size_m, size_m, size_m])[:, None]
    moved = np.concatenate([way_m_s2, np.zeros(3)])
    solved = scipy.optimize.linprog(
        np.append(np.zeros(columns.shape[1]), -1.0),
        A_eq=np.column_stack([scaled, moved]),
        b_eq=-np.concatenate([load_m_s2, np.zeros(3)]),
        bounds=[(0.0, None)] * columns.shape[1] + [(None, None)],
        method="highs",
    )
    if solved.status == 3:
        return np.inf
    return float(solved.x[-1]) if solved.status == 0 else None


def are_held(columns: Array, loads_m_s2: Array, size_m: float) -> Flags:
    """Which specific forces (n, 3) on the centre of mass contacts with the given :func:`wrenches` (6, k) hold.

    A load is held where a mixture of the wrenches opposes it, which non-negative least squares finds without error
    (Lawson and Hanson 1974); sizes of loads do not matter.
    """
    if columns.shape[1] == 0:
        return np.zeros(len(loads_m_s2), bool)
    scaled = columns / np.array([1.0, 1.0, 1.0, size_m, size_m, size_m])[:, None]
    return np.array([_misses(scaled, load) <= _HELD_WITHIN for load in loads_m_s2], bool)


def _misses(scaled: Array, load_m_s2: Array) -> float:
    """What the nearest mixture of wrenches leaves of a load, as a share of it."""
    size = float(np.linalg.norm(load_m_s2))
    try:
        return float(scipy.optimize.nnls(scaled, np.append(-load_m_s2 / size, np.zeros(3)))[1])
    except RuntimeError:  # it has found none in the steps that it takes at most
        return np.inf


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
