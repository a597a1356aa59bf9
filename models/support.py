"""Support polygons, and when a rock counts as toppled."""

from __future__ import annotations

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


def moment_arms(ring: Array, com: Array, normal: Array) -> Array:
    """Vectors w (k, 3): w_k . f > 0 where a force f on the centre of mass holds the rock down on edge k."""
    edge = np.roll(ring, -1, axis=0) - ring
    edge = edge - np.outer(edge @ normal, normal)
    axis = edge / np.linalg.norm(edge, axis=1)[:, None]
    return np.cross(com - ring, axis)


def planar_hull(points: Array, width_m: float) -> NDArray[np.intp] | None:
    """Order (k, 2) points into their counter-clockwise convex hull; None where they lie on one line."""
    spread = points - points.mean(axis=0)
    thickness = np.ptp(spread @ np.linalg.svd(spread, full_matrices=False)[2][-1])
    if thickness <= width_m:
        return None
    try:
        return np.asarray(ConvexHull(points).vertices)
    except QhullError:
        return None
