"""Whether a rock grows out of its pedestal: no crease where the two meet, or one that is rounded like a fillet."""

import numpy as np
from scipy.spatial import cKDTree

from toppling.models.errors import InputError
from toppling.models.scan.doubt import Doubt, median_by_sector, middle, sectors
from toppling.models.scan.interface import Interface
from toppling.models.scan.measure import ObservedRock

_NEAR_VOXELS = 4.0
"""Patches of rock and pedestal so near to each other meet."""
_CREASE_DEG = 20.0
"""Where rock and pedestal meet at less than this, the surface goes on from one to the other."""
_ATTACHED_SHARE, _TOLD_SHARE = 0.2, 0.5
"""Share of the rim that was seen along which a crease must show: less is no block, or is told."""
_FOOT, _SIDE = (0.01, 0.02), (0.1, 0.2)
"""Of the rock's height above the interface: where a rounded foot still faces upward, and where a side begins."""
_ROUNDED_DEG, _TURN_DEG = 12.0, 10.0
"""A foot is rounded that faces so far up, and so much farther than the side above it. Patches blur a sharp crease to
0 to 10 degrees there; an arc of .025 of the height faces 24 degrees up."""
_ROUNDED_TOLD, _ROUNDED_REFUSED = 0.5, 0.8
"""Share of the directions around the rock. Soil that buries a third of a rim rounds less."""
_LEAST_PATCHES = 20
SPARSE = 1.5
"""Patches so much farther apart than they are wide show neither a crevice nor a rounded foot."""


def attached(observed: ObservedRock, interface: Interface, parted: bool) -> Doubt | None:
    """A doubt where no crease parts rock and pedestal along the rim, or the rim is rounded.

    parted: whether the user has said where rock and pedestal meet, or which is which.
    Raises InputError if hardly any crease shows, or nearly all of the rim is rounded and the user has said nothing
    of it.
    """
    share = creased_share(observed, interface)
    if share is not None and share < _TOLD_SHARE:
        what = f"no crevice or crease shows along {1.0 - share:.0%} of the seen rim between rock and pedestal"
        if share < _ATTACHED_SHARE:
            raise _no_block(what, f"a crease along at least {_ATTACHED_SHARE:.0%} of the rim")
        return _told(what)
    rounded = _rounded_share(observed, interface)
    if rounded is None or rounded < _ROUNDED_TOLD:
        return None
    what = f"the rock curves outward into its pedestal along {rounded:.0%} of the seen rim, without a crevice or crease"
    if rounded >= _ROUNDED_REFUSED and not parted:
        raise _no_block(
            what, f"a sharp rim along more than {1.0 - _ROUNDED_REFUSED:.0%}, as where two bodies meet"
        )
    return _told(what)


def _no_block(what: str, expected: str) -> InputError:
    return InputError(
        f"{what}: the rock goes on into its pedestal",
        where="the interface",
        expected=expected,
        remedy="a rock that is attached does not topple as a free block; if it is not (soil or debris may cover the "
        "rim), the interface lies elsewhere: give it by --plane, --point or --outline",
    )


def _told(what: str) -> Doubt:
    return Doubt(
        "attached",
        f"{what}: if it is attached there, its strength is not in the answer, which is then too low",
    )


def creased_share(observed: ObservedRock, interface: Interface) -> float | None:
    """Share of the directions in which rock and pedestal were seen to meet where it is in a crease; None if unseen."""
    surfels, flat = observed.surfels, interface.flat(observed.surfels.points_m)
    low = observed.patches & (np.abs(flat[:, 2]) < 0.15 * observed.height_m)
    ground = ~observed.patches & (surfels.normals @ interface.normal > 0.0)
    if low.sum() < 3 or ground.sum() < 3:
        return None
    away, nearest = cKDTree(surfels.points_m[ground]).query(surfels.points_m[low])
    meet = away < _NEAR_VOXELS * surfels.voxel_m
    if not meet.any():
        return None
    normals = np.einsum("ij,ij->i", surfels.normals[low][meet], surfels.normals[ground][nearest[meet]])
    angle = np.rad2deg(np.arccos(np.clip(normals, -1.0, 1.0)))
    sector = sectors(flat[low][meet, :2] - middle(flat[low]))
    steepest = np.array([np.quantile(angle[sector == k], 0.75) for k in np.unique(sector)])
    return float((steepest > _CREASE_DEG).mean())


def _rounded_share(observed: ObservedRock, interface: Interface) -> float | None:
    """Share of the directions in which the rock's foot bends outward like a fillet; None where too little was seen."""
    surfels, own = observed.surfels, observed.patches
    over = interface.over(surfels.points_m[own])
    up = over[:, 2] / observed.height_m
    dip = np.rad2deg(np.arcsin(np.clip(surfels.normals[own] @ interface.normal, -1.0, 1.0)))
    foot, side = ((up > low) & (up < high) for low, high in (_FOOT, _SIDE))
    if foot.sum() < _LEAST_PATCHES or observed.patches_apart > SPARSE:
        return None
    ways = over[:, :2] - middle(over[foot])
    (below, foot_deg), (above, side_deg) = (median_by_sector(dip[part], ways[part]) for part in (foot, side))
    seen, of_foot, of_side = np.intersect1d(below, above, return_indices=True)
    if not len(seen):
        return None
    rounded = (foot_deg[of_foot] > _ROUNDED_DEG) & (foot_deg[of_foot] - side_deg[of_side] > _TURN_DEG)
    return float(rounded.mean())
