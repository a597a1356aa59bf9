"""Whether a model's program has filled the crevice: a sheet then hangs from the rock down to the pedestal."""

import numpy as np
from scipy.spatial import cKDTree

from toppling.models.scan.doubt import SECTORS, Doubt, median_by_sector
from toppling.models.scan.interface import Interface
from toppling.models.scan.measure import ObservedRock

_BESIDE_PER_HEIGHT = (0.02, 0.1)
"""Distances from the rock at which the pedestal is looked at: smoothing alone rounds a crease nearer to it."""
_BAND_PER_HEIGHT = 0.15
_STEEP_DEG = 15.0
"""A pedestal that falls away from the rock by more than this..."""
_ALL_ROUND = 0.75
"""...in this share of all directions is a sheet that fills a crevice, or a neck."""


def bridged(observed: ObservedRock, interface: Interface) -> Doubt | None:
    """A doubt in the rim of a model whose surface falls away from the rock on all sides, as filled holes do."""
    if observed.hint is not None:
        return None  # the user knows the interface
    falls_deg = collar_deg(observed, interface)
    if falls_deg < _STEEP_DEG:
        return None
    return Doubt(
        "bridged",
        f"the model's surface falls away from the rock's foot on all sides, by {falls_deg:.0f} degrees: programs of "
        "photogrammetry fill a crevice that no picture shows by such a sheet. Behind one the rock goes on, its contact "
        "is lower and narrower than it looks, and it topples more easily than is stated. Export the model without "
        "filled holes (interpolation off), or say where the two meet by three places --point X,Y,Z",
    )


def collar_deg(observed: ObservedRock, interface: Interface) -> float:
    """Slope by which the pedestal falls away from the rock beside it, in three directions in four or more."""
    surfels, rock, height = observed.surfels, observed.patches, observed.height_m
    flat = interface.over(surfels.points_m)
    foot = rock & (flat[:, 2] < _BAND_PER_HEIGHT * height)
    if not foot.any():
        return 0.0
    away, nearest = cKDTree(flat[foot, :2]).query(flat[:, :2])
    near, far = (share * height for share in _BESIDE_PER_HEIGHT)
    beside = ~rock & (away > near) & (away < far) & (np.abs(flat[:, 2]) < _BAND_PER_HEIGHT * height)
    if not beside.any():
        return 0.0
    outward = flat[beside, :2] - flat[foot, :2][nearest[beside]]
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    normals = surfels.normals[beside] @ interface.axes
    falls = np.rad2deg(np.arctan2(np.einsum("ij,ij->i", normals[:, :2], outward), np.abs(normals[:, 2])))
    _, by_sector = median_by_sector(falls, flat[beside, :2] - flat[foot, :2].mean(axis=0))
    every = np.append(by_sector, np.zeros(SECTORS - len(by_sector)))
    return float(np.quantile(every, 1.0 - _ALL_ROUND))
