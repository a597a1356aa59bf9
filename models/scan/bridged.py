"""Whether a model's program has filled the crevice: a sheet then hangs from the rock down to the pedestal."""

import numpy as np
from scipy.spatial import cKDTree

from toppling.models.arrays import Array
from toppling.models.scan.doubt import SECTORS, Doubt, median_by_sector
from toppling.models.scan.interface import Interface
from toppling.models.scan.measure import ObservedRock

_BESIDE_PER_HEIGHT = (0.02, 0.1)
"""Distances from the rock at which the pedestal is looked at: smoothing alone rounds a crease nearer to it."""
_BAND_PER_HEIGHT = 0.15
_BEYOND_PER_HEIGHT, _FLATTER = (0.15, 0.4), 0.6
"""Distances at which a sheet has reached the ground: it is flatter there, by such a factor, and a knoll is not."""
_STEEP_DEG = 15.0
"""A pedestal that falls away from the rock by more than this..."""
_ALL_ROUND = 0.75
"""...in this share of all directions is a sheet that fills a crevice, or a neck."""


def bridged(observed: ObservedRock, interface: Interface) -> Doubt | None:
    """A doubt in the rim of a model whose surface falls away from the rock on all sides, as filled holes do."""
    if observed.hint is not None:
        return None  # the user knows the interface
    near_deg = _collar_deg(observed, interface)
    if near_deg < _STEEP_DEG:
        return None
    beyond_deg = _beyond_collar_deg(observed, interface)
    if beyond_deg is not None and beyond_deg > _FLATTER * near_deg:
        return None
    return Doubt(
        "bridged",
        f"the model's surface falls away from the rock's foot on all sides, by {near_deg:.0f} degrees, as on a mound: "
        "programs of photogrammetry fill a crevice that no picture shows by such a sheet. Behind one the rock goes on, "
        "its contact is lower and narrower than it looks, and it topples more easily than is stated. Export the model "
        "without filled holes (interpolation off), or say where the two meet by three places --point X,Y,Z",
    )


def _collar_deg(observed: ObservedRock, interface: Interface) -> float:
    """Slope by which the pedestal falls away from the rock beside it, in three directions in four or more."""
    every = _falls_deg(observed, interface, _BESIDE_PER_HEIGHT, _BAND_PER_HEIGHT)
    every = np.append(every, np.zeros(SECTORS - len(every)))
    return float(np.quantile(every, 1.0 - _ALL_ROUND))


def _beyond_collar_deg(observed: ObservedRock, interface: Interface) -> float | None:
    """Slope by which the pedestal falls farther away from the rock, in half of the directions; None if unseen."""
    every = _falls_deg(observed, interface, _BEYOND_PER_HEIGHT, np.inf)
    return float(np.median(every)) if len(every) else None


def _falls_deg(
    observed: ObservedRock, interface: Interface, away_per_height: tuple[float, float], band_per_height: float
) -> Array:
    """Median slopes (k,) by which the pedestal falls at such distances from the rock, in the directions shown."""
    surfels, rock, height = observed.surfels, observed.patches, observed.height_m
    flat = interface.over(surfels.points_m)
    foot = rock & (flat[:, 2] < _BAND_PER_HEIGHT * height)
    if not foot.any():
        return np.zeros(0)
    away, nearest = cKDTree(flat[foot, :2]).query(flat[:, :2])
    near, far = (share * height for share in away_per_height)
    beside = ~rock & (away > near) & (away < far) & (np.abs(flat[:, 2]) < band_per_height * height)
    if not beside.any():
        return np.zeros(0)
    outward = flat[beside, :2] - flat[foot, :2][nearest[beside]]
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    normals = surfels.normals[beside] @ interface.axes
    falls = np.rad2deg(np.arctan2(np.einsum("ij,ij->i", normals[:, :2], outward), np.abs(normals[:, 2])))
    return median_by_sector(falls, flat[beside, :2] - flat[foot, :2].mean(axis=0))[1]
