"""Support polygons, and when a rock counts as toppled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from toppling.models.arrays import Array

CONTACT_SHARE_OF_HEIGHT = 1e-6
"""Points within this share of the rock's height of the interface plane count as touching it."""

TOPPLED_TILT_DEG = 45.0
"""A rest tilted by more than this counts as toppled."""

TOPPLED_FALL = 0.25
"""A centre of mass fallen by more than this share of its height above the support counts as toppled."""


_ON_A_LINE = 1e-14
"""Share of its sides' squares below which a triangle has no area but rounding."""


def moment_arms(ring: Array, com: Array, normal: Array) -> Array:
    """Vectors w (k, 3): w_k . f > 0 where a force f on the centre of mass holds the rock down on edge k."""
    edge = np.roll(ring, -1, axis=0) - ring
    edge = edge - np.outer(edge @ normal, normal)
    axis = edge / np.linalg.norm(edge, axis=1)[:, None]
    return np.cross(com - ring, axis)


def planar_hull(points: Array, width_m: float) -> NDArray[np.intp] | None:
    """Order (k, 2) points into their counter-clockwise convex hull; None where they lie on one line."""
    if np.ptp(points @ _narrow_direction(points)) <= width_m:
        return None
    if len(points) == 3:  # most supports of a path: Qhull took a sixth of it
        (x, y), (u, v) = points[1] - points[0], points[2] - points[0]
        twice_area = x * v - y * u
        if abs(twice_area) <= _ON_A_LINE * (x * x + y * y + u * u + v * v):
            return None
        return np.array([0, 1, 2] if twice_area > 0.0 else [0, 2, 1])
    try:
        return np.asarray(ConvexHull(points).vertices)
    except QhullError:
        return None


def _narrow_direction(points: Array) -> Array:
    """Unit vector across the longer principal axis of points (k, 2)."""
    x, y = (points - points.mean(axis=0)).T
    along_rad = 0.5 * math.atan2(2.0 * (x @ y), x @ x - y @ y)
    return np.array([-math.sin(along_rad), math.cos(along_rad)])
