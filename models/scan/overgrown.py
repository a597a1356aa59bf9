"""Whether grass or the like hides where the rock meets its pedestal: what was seen beside it is then no surface."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from toppling.models.scan.doubt import Doubt
from toppling.models.scan.interface import Interface
from toppling.models.scan.measure import ObservedRock

_BESIDE_PER_HEIGHT = (0.02, 0.15)
"""Distances from the rock at which the pedestal is looked at: the two sides of a crevice are thick together."""
_BAND_PER_HEIGHT = 0.1
_FEWEST = 30
_THICK, _OVER_ROCK = 0.4, 3.0
"""Thickness over width of the median patch of grass, and how often that of the rock's patches, which noise thickens
too. Known grounds have 0.2 at most, or as much as the rock; grass of 0.02 of the height and more 0.45 to 0.75."""
_LOW, _HIGH = 0.05, 0.95
"""Shares of the patches below and above which they are single blades and holes."""


def overgrown(observed: ObservedRock, interface: Interface) -> Doubt | None:
    """A doubt in the interface where what was seen beside the rock is as thick as it is wide, and the rock is not."""
    if observed.hint is not None:
        return None  # the user knows the interface
    surfels, rock, height = observed.surfels, observed.patches, observed.height_m
    over = interface.over(surfels.points_m)[:, 2]
    away, _ = cKDTree(surfels.points_m[rock]).query(surfels.points_m)
    near, far = (share * height for share in _BESIDE_PER_HEIGHT)
    beside = ~rock & (away > near) & (away < far) & (np.abs(over) < _BAND_PER_HEIGHT * height)
    if beside.sum() < _FEWEST or not _grown_over(surfels.roughness[beside], surfels.roughness[rock]):
        return None
    low, high = np.quantile(over[beside], [_LOW, _HIGH])
    return Doubt(
        "overgrown",
        f"what was seen beside the rock is no surface but {high - low:.2g} m thick, as grass, twigs or rubble are: the "
        f"interface lies in it, up to {max(-low, 0.0):.2g} m too high, and the rock ends there, so that it is too low "
        "and its toppling acceleration wrong by more than is stated. Clear its foot and scan again, or say where the "
        "two meet by three places --point X,Y,Z",
    )


def _grown_over(beside: NDArray[np.float64], rock: NDArray[np.float64]) -> bool:
    """Whether patches beside a rock are a plant's, by their thickness over width (n,) and that of the rock's (m,)."""
    thick = float(np.median(beside))
    return thick > _THICK and thick > _OVER_ROCK * float(np.median(rock))
