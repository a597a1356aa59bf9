"""Whether what was taken for one rock is two that touch side by side: the cheapest cut between its sides."""

from dataclasses import dataclass

import numpy as np

from toppling.models.arrays import Array
from toppling.models.frames import horizontal_unit_vector
from toppling.models.scan.attached import SPARSE
from toppling.models.scan.candidates import minimum_cut, neighbourhood
from toppling.models.scan.interface import Interface
from toppling.models.scan.measure import ObservedRock
from toppling.models.scan.surfels import Surfels, thin

_PATCHES = 5000
"""So many tell a joint, and are cut in a tenth of a second."""
_WIDER, WIDEST = 1.5, 4.5
"""Than patches are wide, or than they lie apart where a cloud has few points: else no crease shows between them."""
_WAYS_DEG = (0.0, 45.0, 90.0, 135.0)
_SEEDS = ((0.2, 0.8), (0.35, 0.9))
"""Shares of the extent below which and above which patches are of one side and of the other."""
_LEAST_PART = 0.1
"""Less of the patches is a knob."""
_LEAST_CUT = 30
"""Fewer edges across are a thread of strays."""


@dataclass(frozen=True)
class Joint:
    """Where a rock comes apart most easily."""

    creased_share: float  # of the cut: 1 where a crease goes all around
    part: float  # share of the patches in the smaller part
    lowest_m: float  # of the smaller part over the interface
    way: Array  # (2,): toward its middle from that of the other, along the interface's u and v


def weakest_joint(observed: ObservedRock, interface: Interface) -> Joint | None:
    """The cut between two sides of a rock that runs through creases most; None where nothing comes apart.

    Wider patches show a crease across a gap into which few points fall.
    """
    apart = observed.patches_apart
    least = _WIDER * (apart if apart > SPARSE else 1.0)
    found = [_weakest_of(coarser(observed, each), interface) for each in sorted({least, max(least, WIDEST)})]
    return max(
        (each for each in found if each is not None), key=lambda each: each.creased_share, default=None
    )


def _weakest_of(patches: Surfels, interface: Interface) -> Joint | None:
    edges = neighbourhood(patches.points_m, patches.voxel_m)
    over = interface.flat(patches.points_m)
    flat = over[:, :2]
    found = None
    for way in horizontal_unit_vector(np.array(_WAYS_DEG))[:, :2]:
        along = flat @ way
        along = (along - along.min()) / np.ptp(along)
        for low, high in _SEEDS:
            part, share = minimum_cut(patches, edges, along > high, along < low)
            size = float(part.mean())
            across = (part[edges[:, 0]] != part[edges[:, 1]]).sum()
            if min(size, 1.0 - size) < _LEAST_PART or across < _LEAST_CUT:
                continue
            if found is None or share > found.creased_share:
                smaller = part if size < 0.5 else ~part
                middles = [flat[each].mean(axis=0) for each in (smaller, ~smaller)]
                found = Joint(
                    share, min(size, 1.0 - size), float(over[smaller, 2].min()), middles[0] - middles[1]
                )
    return found


def coarser(observed: ObservedRock, least: float) -> Surfels:
    """The rock's patches joined to wider ones, at least so many times as wide."""
    surfels, own = observed.surfels, observed.patches
    voxel = surfels.voxel_m * max(least, float(np.sqrt(own.sum() / _PATCHES)))
    points, index = thin(surfels.points_m[own], voxel)
    kept = index >= 0
    normals = np.zeros_like(points)
    np.add.at(normals, index[kept], surfels.normals[own][kept])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    return Surfels(points, normals, np.zeros(len(points)), voxel)
