"""Which loads contacts with friction hold at rest, each along its own normal: linear programmes over their cones."""

from __future__ import annotations

import numpy as np
import scipy

from toppling.models.compiled import Array, Flags

_SIDES = 32
"""Of the pyramid within each friction cone: it misses at most 1 - cos(pi / SIDES), half a per cent, of the friction."""

_DIRECTIONS = 48
"""In which the border of the loads that are held is looked for."""


def wrenches(arms_m: Array, normals: Array, friction: float) -> Array:
    """Forces and moments about the centre of mass (6, n) of the edges of the contacts' friction pyramids."""
    columns = []
    angle = 2.0 * np.pi * np.arange(_SIDES) / _SIDES if friction > 0.0 else np.zeros(1)
    for arm, normal in zip(arms_m, normals, strict=True):
        helper = np.eye(3)[np.argmin(np.abs(normal))]
        one = np.cross(normal, helper)
        one /= np.linalg.norm(one)
        other = np.cross(normal, one)
        force = normal + friction * (np.cos(angle)[:, None] * one + np.sin(angle)[:, None] * other)
        columns.append(np.hstack([force, np.cross(arm, force)]))
    return np.vstack(columns).T if columns else np.zeros((6, 0))


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


def is_held(columns: Array, load_m_s2: Array, size_m: float) -> bool:
    """Whether contacts with the given :func:`wrenches` (6, n) hold a rock's weight, a specific force (3,).

    Of a load that leans it says whether they hold it or a heavier one: for that ask :func:`farthest_load`.
    """
    far = farthest_load(columns, load_m_s2, np.array([0.0, 0.0, -1e-6]), size_m)
    return far is not None and far >= 0.0


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
    down = -loads_m_s2[:, 2]
    outside = loads_m_s2[:, :2] @ half_planes[:, :2].T - down[:, None] * (half_planes[:, 2] - margin)
    return (down > 0.0) & (outside <= 0.0).all(axis=1)
