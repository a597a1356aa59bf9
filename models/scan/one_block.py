"""Whether what was taken for one rock is one: two side by side, one upon the other, or one that was seen twice."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from toppling.models.arrays import Array, at_most
from toppling.models.errors import InputError
from toppling.models.frames import horizontal_unit_vector
from toppling.models.scan.candidates import CREASE, bend, minimum_cut, neighbourhood
from toppling.models.scan.doubt import SECTORS, Doubt, azimuth_told, middle, sectors
from toppling.models.scan.foot import SPARSE
from toppling.models.scan.interface import Interface
from toppling.models.scan.measure import ObservedRock
from toppling.models.scan.surfels import Surfels, thin

_PATCHES = 5000
"""So many tell a joint, and are cut in a tenth of a second."""
_WIDER, _WIDEST = 1.5, 4.5
"""Than patches are wide, or than they lie apart where a cloud has few points: else no crease shows between them."""
_WAYS_DEG = (0.0, 45.0, 90.0, 135.0)
_SIDES = ((0.2, 0.8), (0.35, 0.9))
"""Shares of the extent below which and above which patches are of one side and of the other."""
_LEAST_PART = 0.1
"""Less of the patches is a knob."""
_LEAST_CUT = 30
"""Fewer edges across are a thread of strays."""


@dataclass(frozen=True)
class _Joint:
    """Where a rock comes apart most easily."""

    creased_share: float  # of the cut: 1 where a crease goes all around
    part: float  # share of the patches in the smaller part
    lowest_m: float  # of the smaller part over the interface
    way: Array  # (2,): toward its middle from that of the other, along the interface's u and v


def weakest_joint(observed: ObservedRock, interface: Interface) -> _Joint | None:
    """The cut between two sides of a rock that runs through creases most; None where nothing comes apart.

    Wider patches show a crease across a gap into which few points fall.
    """
    apart = observed.patches_apart
    least = _WIDER * (apart if apart > SPARSE else 1.0)
    found = [
        _weakest_of(_coarser(observed, each), interface) for each in sorted({least, max(least, _WIDEST)})
    ]
    return max(
        (each for each in found if each is not None), key=lambda each: each.creased_share, default=None
    )


def _weakest_of(patches: Surfels, interface: Interface) -> _Joint | None:
    edges = neighbourhood(patches.points_m, patches.voxel_m)
    over = interface.flat(patches.points_m)
    flat = over[:, :2]
    found = None
    for way in horizontal_unit_vector(np.array(_WAYS_DEG))[:, :2]:
        along = flat @ way
        along = (along - along.min()) / np.ptp(along)
        for low, high in _SIDES:
            part, share = minimum_cut(patches, edges, along > high, along < low)
            size = float(part.mean())
            across = (part[edges[:, 0]] != part[edges[:, 1]]).sum()
            if min(size, 1.0 - size) < _LEAST_PART or across < _LEAST_CUT:
                continue
            if found is None or share > found.creased_share:
                smaller = part if size < 0.5 else ~part
                middles = [flat[each].mean(axis=0) for each in (smaller, ~smaller)]
                found = _Joint(
                    share, min(size, 1.0 - size), float(over[smaller, 2].min()), middles[0] - middles[1]
                )
    return found


def _coarser(observed: ObservedRock, least: float) -> Surfels:
    """The rock's patches joined to wider ones, at least so many times as wide."""
    surfels, own = observed.surfels, observed.patches
    voxel = surfels.voxel_m * max(least, float(np.sqrt(own.sum() / _PATCHES)))
    points, index = thin(surfels.points_m[own], voxel)
    kept = index >= 0
    normals = np.zeros_like(points)
    np.add.at(normals, index[kept], surfels.normals[own][kept])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    return Surfels(points, normals, np.zeros(len(points)), voxel)


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
_LEVELS = ((0.15, 0.6), (0.45, 0.9))
"""Shares of the height below which and above which patches are of the lower and of the upper block."""
_CREASED_SHARE, _ALL_AROUND = 0.7, 0.9
"""Of the cheapest cut between the two, so much runs through creases, and so many of the directions show one."""


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
    patches, found = _coarser(observed, _WIDEST), (0.0, 0.0)
    edges, over = neighbourhood(patches.points_m, patches.voxel_m), interface.flat(patches.points_m)
    up = (over[:, 2] - over[:, 2].min()) / np.ptp(over[:, 2])
    for low, high in _LEVELS:
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
    surfels, own = observed.surfels, np.flatnonzero(observed.patches)
    pairs = own[cKDTree(surfels.points_m[own]).query_pairs(2.0 * surfels.voxel_m, output_type="ndarray")]
    along = np.diff(interface.flat(surfels.points_m)[pairs], axis=1)[:, 0]
    steep = np.abs(along[:, 2]) > 0.5 * np.linalg.norm(along, axis=1)
    creased = bend(surfels, pairs) < -np.deg2rad(_CREASE_DEG)
    return interface.flat(surfels.points_m[pairs[creased & steep]].mean(axis=1))


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


_LOOKED_AT, OF_LAYERS = 500, 500_000
"""So many patches, and points around them, tell; more points are not to be given."""
_REACHES_VOXELS = (2.5, 6.0)
"""Around a patch: the wider circle shows layers that lie wider apart."""
_FEWEST = 24
_APART = 5.0
"""Distance of two layers over the thickness of one; halves of one that is noisy, bent or slopes are nearer."""
_LEAST_LAYER = 0.12
"""Of the points around a patch, in the thinner layer."""
_BESIDE = 2.0
"""Two layers lie over each other where points of one have some of the other so near in plan, in their spacing; the two
sides of a ledge do not."""
_TOLD_SHARE = 0.12
"""Of the patches that are told; edges and cracks make fewer."""
_FARTHEST_PER_HEIGHT = 0.008
"""Layers so near leave the stated intervals true."""
_LEAST_STEPS = 3.0
"""Coordinates in steps make layers of their own, a step apart."""


def doubled(observed: ObservedRock, rock_m: Array, step_m: float) -> Doubt | None:
    """A doubt where the rock's points lie in two layers.

    rock_m: (n, 3), points of the rock.
    step_m: between coordinates, 0 where they have none.
    Raises InputError if the layers lie so far apart that what is stated would not hold.
    """
    surfels = observed.surfels
    own = at_most(np.flatnonzero(observed.patches), _LOOKED_AT)
    reaches = [each * surfels.voxel_m for each in _REACHES_VOXELS]
    share, apart_m = layers(surfels.points_m[own], rock_m, reaches, step_m)
    if share < _TOLD_SHARE:
        return None
    what = (
        f"the rock's surface was seen twice, about {apart_m:.2g} m apart, over {share:.0%} of it: two registrations of "
        "the same scans in one cloud, or stations that are off by so much"
    )
    farthest_m = _FARTHEST_PER_HEIGHT * observed.height_m
    if apart_m > farthest_m:
        raise InputError(
            "scan.surface_doubled",
            what,
            where="registration",
            expected=f"one surface, or two within {farthest_m:.2g} m ({_FARTHEST_PER_HEIGHT:.1%} of the rock's height)",
            remedy="register the stations anew, or leave one of the two out; where each has a file or a number of its "
            "own, give the stations one by one: they are fitted to each other",
        )
    return Doubt(
        "doubled",
        f"{what}. Rock and contact are those of both together. Register the stations anew, or leave one of the two out",
    )


def layers(
    places_m: Array, points_m: Array, reaches_m: Sequence[float], step_m: float
) -> tuple[float, float]:
    """Share of some places (k, 3) around which points (n, 3) lie in two layers, and how far these are apart.

    reaches_m: of what is around a place.
    """
    apart_m = np.zeros(len(places_m))
    judged = np.zeros(len(places_m), bool)
    tree = cKDTree(points_m)
    for reach in reaches_m:
        for number, rows in enumerate(tree.query_ball_point(places_m, reach)):
            if len(rows) < _FEWEST or apart_m[number]:
                continue
            judged[number] = True
            apart_m[number] = _apart_m(points_m[rows] - places_m[number], _LEAST_STEPS * step_m)
    double = apart_m > 0.0
    if not double.any():
        return 0.0, 0.0
    # Surfaces along a shift show little of it.
    return float(double.sum() / judged.sum()), float(np.quantile(apart_m[double], 0.95))


def _apart_m(around_m: Array, least_m: float) -> float:
    """How far two layers of points (n, 3) about a place lie apart; 0 if they are one."""
    centred = around_m - around_m.mean(axis=0)
    axes = np.linalg.svd(centred, full_matrices=False)[2]
    flat, height = centred @ axes[:2].T, centred @ axes[2]
    order = np.argsort(height)
    height = height[order]
    split = _halves(height)
    lower, upper = height[:split], height[split:]
    if min(len(lower), len(upper)) < max(3.0, _LEAST_LAYER * len(height)):
        return 0.0
    apart = float(np.median(upper) - np.median(lower))
    thick = 1.4826 * max(float(np.median(np.abs(part - np.median(part)))) for part in (lower, upper))
    if apart < max(_APART * thick, least_m):
        return 0.0
    return apart if _over_each_other(flat[order[:split]], flat[order[split:]]) else 0.0


def _halves(height: Array) -> int:
    """Where sorted heights (n,) part into two groups with the least spread within each."""
    count = np.arange(1, len(height))
    total = np.cumsum(height)
    before, after = total[:-1] / count, (total[-1] - total[:-1]) / (len(height) - count)
    return 1 + int(np.argmax(count * (len(height) - count) * (after - before) ** 2))


def _over_each_other(flat_m: Array, other_m: Array) -> bool:
    fewer, more = sorted((flat_m, other_m), key=len)
    spacing = np.median(cKDTree(more).query(more, 2)[0][:, 1])
    return bool(np.median(cKDTree(more).query(fewer)[0]) < _BESIDE * spacing)


_TWO_TOLD, _TWO_REFUSED, _TWO_PART = 0.72, 0.82, 0.2
"""Share of the cut between two sides that must run through a crease. With a part of this share of the patches, size and
weight are of both."""
_TWO_SPARSE = 0.35
"""The same in a cloud of few points, where patches tell a crease from a bend less."""
_TWO_STANDS = 0.1
"""Of the rock's height: a smaller part that comes down so far stands there itself, and may be what is meant."""


def side_by_side(observed: ObservedRock, interface: Interface, separated: bool) -> Doubt | None:
    """A doubt where a crease parts a rock from top to bottom; InputError if two large parts surely are two bodies.

    separated: whether the user has said which points are the rock's.
    """
    joint = weakest_joint(observed, interface)
    told = _TWO_SPARSE if observed.patches_apart > SPARSE else _TWO_TOLD
    if joint is None or joint.creased_share < told:
        return None
    what = (
        f"a crease parts {joint.part:.0%} of the rock's surface, toward {azimuth_told(joint.way, interface)}, from the "
        f"rest, along {joint.creased_share:.0%} of the way around: it may be two blocks that touch, one leaning on the "
        "other; volume and weight are then those of both"
    )
    both = joint.part >= _TWO_PART or joint.lowest_m < _TWO_STANDS * observed.height_m
    if joint.creased_share >= _TWO_REFUSED and both and not separated:
        raise InputError(
            "rock.several_blocks",
            what,
            where="the rock",
            expected="one block that stands free",
            remedy="crop the neighbour off the cloud, or separate the rock in another program and give it by --rock "
            "FILE or CLASS, which also says that it is one block",
        )
    return Doubt("leaning", what)
