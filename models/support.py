"""Support polygons, and limits beyond which a rock counts as toppled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from toppling.models.arrays import Array

CONTACT_SHARE_OF_HEIGHT = 1e-6
"""Distance from the interface plane within which points are in contact, as a fraction of the rock's height."""

TOPPLED_TILT_DEG = 45.0
"""Tilt at rest beyond which a rock counts as toppled, degrees."""

TOPPLED_FALL = 0.25
"""Fall of the centre of mass beyond which a rock counts as toppled, as a fraction of its height above the support."""

STEEP = 0.5
"""Upward part of a contact's normal: less, and what is touched stands beside the rock, not below it."""

_ON_A_LINE = 1e-14
"""Area of a triangle, relative to the squares of its sides, below which it is degenerate."""


def moment_arms(ring: Array, com: Array, normal: Array) -> Array:
    """Vectors w (k, 3) such that w_k . f is the stabilising moment of a force f on the centre of mass about edge k."""
    edge = np.roll(ring, -1, axis=0) - ring
    edge = edge - np.outer(edge @ normal, normal)
    axis = edge / np.linalg.norm(edge, axis=1)[:, None]
    return np.cross(com - ring, axis)


def planar_hull(points: Array, width_m: float) -> NDArray[np.intp] | None:
    """Indices of the counter-clockwise convex hull of points (k, 2); None if they are collinear."""
    if np.ptp(points @ _narrow_direction(points)) <= width_m:
        return None
    if len(points) == 3:  # most supports of a path; faster than Qhull
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
