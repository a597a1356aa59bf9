"""Whether what was taken for one rock is two, one upon the other: creases or an open joint around it."""

import numpy as np
from scipy.spatial import cKDTree

from toppling.models.arrays import Array
from toppling.models.scan.candidates import CREASE, bend, minimum_cut, neighbourhood
from toppling.models.scan.doubt import SECTORS, Doubt, middle, sectors
from toppling.models.scan.interface import Interface
from toppling.models.scan.joints import WIDEST, coarser
from toppling.models.scan.measure import ObservedRock

_TOLD_EXCESS = 0.35
"""Share of the directions in which a joint must show, beyond what shows in most planes parallel to it."""
_CREASE_DEG = 35.0
_FROM, _TO = 0.15, 0.9
"""Of the rock's height: a joint lower is the interface's crevice, one higher parts a cap."""
_BAND = 0.01
"""Of the rock's height: half of the band in which a joint runs."""
_SLOPES = np.tan(np.deg2rad(np.arange(-15.0, 16.0, 5.0)))
OF_JOINT = 400_000
"""So many of the rock's points tell a joint; more are not to be given."""
_DEEP_NOISES, _DEEP_PER_HEIGHT = 5.0, 0.002
"""A point in an open joint lies so far below the surface around it: in its noise, and at least of the height."""
_OPEN_SHARE = 0.02
"""Of the points of one direction in such a band so many lie below the surface where a joint is open."""
_SEEDS = ((0.15, 0.6), (0.45, 0.9))
"""Shares of the height below which and above which patches are of the lower and of the upper block."""
_CREASED_SHARE, _ALL_AROUND = 0.7, 0.9
"""Of the cheapest cut between the two, and of the directions: through blocks that lie upon each other 79 % and more
run through creases and all directions show one; through single rocks at most 10 %, with a smooth waist 53 %, through
the mane of a stone lion 66 %, in 78 % of the directions."""
_LEAST_PART = 0.1
"""Less of the patches is a knob."""


def stacked(observed: ObservedRock, interface: Interface, rock_m: Array) -> Doubt | None:
    """A doubt where creases or an open joint go around a rock in one plane.

    rock_m: (n, 3), points of the rock at full resolution: an open joint of a few millimetres is narrower than a
    patch.
    """
    height = observed.height_m
    own = interface.flat(observed.surfels.points_m[observed.patches])
    centre = middle(own)
    places = np.vstack([_creases(observed, interface), _open_places(observed, interface, rock_m, centre)])
    share, excess, level_m = _around(places - np.append(centre, 0.0), height)
    if excess < _TOLD_EXCESS:
        # The joint of blocks that are round where they meet lies in no plane.
        share, level_m = _parted(observed, interface)
        if share < _CREASED_SHARE:
            return None
    return Doubt(
        "stack",
        f"creases or an open joint go around {share:.0%} of the rock {level_m:.2g} m above the interface: it may be "
        "two blocks, one upon the other, and the upper one may fall by itself, earlier",
    )


def _parted(observed: ObservedRock, interface: Interface) -> tuple[float, float]:
    """Share of the cheapest cut between a rock's upper and lower part that runs through creases, and its level, m.

    0 where no crease goes all around.
    """
    patches, found = coarser(observed, WIDEST), (0.0, 0.0)
    edges, over = neighbourhood(patches.points_m, patches.voxel_m), interface.flat(patches.points_m)
    up = (over[:, 2] - over[:, 2].min()) / np.ptp(over[:, 2])
    for low, high in _SEEDS:
        upper, share = minimum_cut(patches, edges, up > high, up < low)
        cut = edges[upper[edges[:, 0]] != upper[edges[:, 1]]]
        places = over[cut[bend(patches, cut) < CREASE]].mean(axis=1)
        around = len(np.unique(sectors(places[:, :2] - middle(over)))) / SECTORS if len(places) else 0.0
        parts = upper.mean(), 1.0 - upper.mean()
        if around > _ALL_AROUND and min(parts) > _LEAST_PART and share > found[0]:
            found = share, float(np.median(places[:, 2]))
    return found


def _around(places_m: Array, height_m: float) -> tuple[float, float, float]:
    """Share of the directions that places about an axis reach within the plane that stands out most.

    Also by how much it exceeds that of nine tenths of the planes parallel to it, and its level on the axis.
    """
    sector, band = sectors(places_m), _BAND * height_m
    first, last = round(_FROM / _BAND), round(_TO / _BAND)
    found = (0.0, 0.0, 0.0)
    for slope in np.stack(np.meshgrid(_SLOPES, _SLOPES), -1).reshape(-1, 2):
        number = np.floor((places_m[:, 2] - places_m[:, :2] @ slope) / band).astype(int) - first
        inside = (number >= 0) & (number < last - first)
        shown = np.zeros((last - first, SECTORS), bool)
        shown[number[inside], sector[inside]] = True
        share = (shown[:-1] | shown[1:]).mean(axis=1)
        best = int(share.argmax())
        excess = float(share[best] - np.quantile(share, 0.9))
        if excess > found[1]:
            found = float(share[best]), excess, (first + best + 1) * band
    return found


def _creases(observed: ObservedRock, interface: Interface) -> Array:
    """Places (n, 3), u, v and height, where the rock's surface is creased across the vertical."""
    surfels = observed.surfels
    points, normals = surfels.points_m[observed.patches], surfels.normals[observed.patches]
    pairs = cKDTree(points).query_pairs(2.0 * surfels.voxel_m, output_type="ndarray")
    along = points[pairs[:, 1]] - points[pairs[:, 0]]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    bend = np.einsum("ij,ij->i", normals[pairs[:, 1]] - normals[pairs[:, 0]], along)
    steep = np.abs(along @ interface.normal) > 0.5
    return interface.flat(points[pairs[(bend < -np.deg2rad(_CREASE_DEG)) & steep]].mean(axis=1))


def _open_places(observed: ObservedRock, interface: Interface, rock_m: Array, centre: Array) -> Array:
    """Points (n, 3), u, v and height, that lie below the rock's surface around them, where more than strays do."""
    surfels = observed.surfels
    patches, normals = surfels.points_m[observed.patches], surfels.normals[observed.patches]
    _, near = cKDTree(patches).query(rock_m, 4)
    off = np.median(np.einsum("ikj,ikj->ik", rock_m[:, None] - patches[near], normals[near]), axis=1)
    noise = 1.4826 * np.median(np.abs(off - np.median(off)))
    deep = off < -max(_DEEP_NOISES * noise, _DEEP_PER_HEIGHT * observed.height_m)
    flat = interface.flat(rock_m)
    level = np.floor(flat[:, 2] / (_BAND * observed.height_m)).astype(int)
    cell = np.unique(level * SECTORS + sectors(flat[:, :2] - centre), return_inverse=True)[1]
    share = np.bincount(cell, deep) / np.bincount(cell)
    return flat[deep & (share[cell] > _OPEN_SHARE)]
