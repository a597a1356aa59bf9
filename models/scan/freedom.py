"""Whether what was scanned is a free rigid block: seen, embedded, attached, leaning, a stack, with room to fall."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, cKDTree

from toppling.models.arrays import Array, Flags, at_most
from toppling.models.errors import InputError
from toppling.models.frames import azimuth_deg, slope_of_normal
from toppling.models.rock import Rock
from toppling.models.scan.candidates import neighbourhood
from toppling.models.scan.close import ClosedRock
from toppling.models.scan.doubt import SECTORS, Doubt, azimuth_told, direction_told, sectors, widest_gap_deg
from toppling.models.scan.foot import (
    SPARSE,
    attached,
    bridged,
    check_not_sunk,
    embedded,
    off_what_was_seen,
    overgrown,
    unseen_rim,
)
from toppling.models.scan.hanging import hanging_doubt
from toppling.models.scan.interface import Interface, fitted_plane
from toppling.models.scan.measure import ObservedRock, outside_support_m
from toppling.models.scan.one_block import OF_JOINT, OF_LAYERS, doubled, side_by_side, stacked
from toppling.models.scan.read import Cloud
from toppling.models.scan.segment import PEDESTAL, ROCK, level_planes
from toppling.models.scan.surfels import Surfels, in_plants, roughness, thin

_MOST_INVENTED = 0.6
"""More of the surface invented, and nothing of the answer is the rock's: known volumes came out off by half."""
_ONE_SIDE_DEG = 120.0
"""A rock of whose sides none shows in so wide a range of directions was seen from one side."""
_UPRIGHT = 0.7
"""Sine of the dip above which a patch belongs to a side."""
_SEEN_SHARE = 0.1
"""A direction is seen if it has this share of the patches of an average one."""
_LEANS_ABOVE = 0.2
"""Of the rock's height: a neighbour that is touched above it holds the rock."""
_LEAST_TOUCHES = 8
_BESIDE_VOXELS, _OTHERS, _LEAST_IN_REACH = 4.0, 400_000, 25
_IN_REACH_ABOVE, _ON_ROCK = 0.3, 0.05
"""Of the rock's height: what rises so far above the interface stops it where it is nearer than the rock is high,
and so far out of the hull of the closed rock; what is not is the rock's own."""
_HULL_AT_ONCE = 1000


def checked_doubts(
    observed: ObservedRock, interface: Interface, closed: ClosedRock, cloud: Cloud, label: NDArray[np.int8]
) -> list[Doubt]:
    """Doubts in a closed rock, if it was seen enough and can stand; label (n,): of each point of the cloud.

    Raises InputError as of each check, and as of `doubts`.
    """
    check_seen_enough(observed, interface, closed)
    check_not_sunk(observed, interface)
    _check_can_stand(closed.rock, interface)
    of_block = doubts(observed, interface, cloud.points_m, label, cloud.label is not None, closed.rock)
    step_m = 0.0 if cloud.coarsest is None else cloud.coarsest.step_m
    of_rock = at_most(np.flatnonzero(label == ROCK), OF_LAYERS)
    of_contact = [
        off_what_was_seen(observed, interface, cloud.origin_m),
        hanging_doubt(observed, interface),
        overgrown(observed, interface),
        doubled(observed, cloud.points_m[of_rock], step_m),
        unseen_rim(observed, interface, closed.rock.com_m),
        bridged(observed, interface) if any(mesh is not None for mesh in cloud.meshes) else None,
    ]
    return [*(each for each in of_contact if each is not None), *of_block]


def _check_can_stand(rock: Rock, interface: Interface) -> None:
    """Refuse a rock whose centre of mass lies outside everything near the interface: the split must be wrong."""
    outside = outside_support_m(rock, interface)
    if outside > 0.0:
        raise InputError(
            "rock.outside_support",
            f"the centre of mass lies {outside:.3g} m outside any support the rock could have",
            where="statics",
            expected="a rock that stands: its centre of mass above its base",
            remedy="look for a second support or a wrong split in the cloud; name the rock by --near X Y",
        )


def check_seen_enough(observed: ObservedRock, interface: Interface, closed: ClosedRock) -> None:
    """Refuse a rock most of whose surface no station saw.

    Raises InputError: that one side is not enough, that points are too few, or that the rock is hidden or embedded.
    """
    if closed.invented_share <= _MOST_INVENTED:
        return
    blind_deg, toward_deg = unseen_range(observed, interface)
    share = f"{closed.invented_share:.0%} of the rock's surface was not seen"
    if blind_deg >= _ONE_SIDE_DEG:
        what = (
            f"one side is not enough: {share}, none of its sides over {blind_deg:.0f} degrees about "
            f"{direction_told(toward_deg)}"
        )
    elif (sunk := embedded(observed, interface)) is not None:
        what = f"{share}; {sunk.sentence}"
    elif (apart := observed.patches_apart) > SPARSE:
        raise InputError(
            "cloud.too_sparse",
            f"{share}: the cloud has too few points, its patches of {observed.surfels.voxel_m:.2g} m lie {apart:.1f} "
            "times as far apart as they are wide",
            where="the rock",
            expected="points so dense that patches of a hundredth of the rock's height touch each other",
            remedy="give all stations, and clouds that were not thinned, or not so much",
        )
    else:
        what = f"{share}, and what was seen lies all around: it is embedded in what surrounds it, or hidden by it"
    raise InputError(
        "rock.mostly_unseen",
        what,
        where="the rock",
        expected=f"a free-standing rock, at most {_MOST_INVENTED:.0%} of it unseen",
        remedy="scan it from the other sides; a rock that is embedded or buried is held by what surrounds it, and no "
        "toppling of a free block is its own",
    )


def unseen_range(observed: ObservedRock, interface: Interface) -> tuple[float, float]:
    """Widest range of directions, degrees, in which no side of the rock was seen, and its middle azimuth."""
    normals = observed.surfels.normals[observed.patches]
    side = np.hypot(*(normals @ interface.axes)[:, :2].T) > _UPRIGHT
    count = np.bincount(sectors(normals[side, :2]), minlength=SECTORS)
    shown = np.flatnonzero(count >= max(3.0, _SEEN_SHARE * count.mean()))
    return widest_gap_deg(shown) if len(shown) else (360.0, 0.0)


def doubts(
    observed: ObservedRock,
    interface: Interface,
    points_m: Array,
    label: NDArray[np.int8],
    separated: bool = False,
    closed: Rock | None = None,
) -> list[Doubt]:
    """What tells against a free rigid block.

    points_m: (n, 3), of the cloud.
    label: (n,), 0 rock, 1 pedestal, 2 neither.
    separated: whether the user has said which points are which.
    closed: the rock as it was closed; what lies on or in its hull is not beside it.
    Raises InputError if the rock goes on into its pedestal along most of the rim that was seen, or is two bodies
    that touch.
    """
    found = [
        attached(observed, interface, parted=separated or observed.hint is not None),
        embedded(observed, interface),
        _leaning(observed, interface),
        side_by_side(observed, interface, separated),
        stacked(observed, interface, points_m[at_most(np.flatnonzero(label == ROCK), OF_JOINT)]),
        _hemmed_in(observed, points_m[at_most(np.flatnonzero(label == PEDESTAL), _OTHERS)], closed),
        tilted_frame(observed.surfels, observed.patches),
    ]
    return [each for each in found if each is not None]


def _leaning(observed: ObservedRock, interface: Interface) -> Doubt | None:
    surfels, flat = observed.surfels, interface.flat(observed.surfels.points_m)
    other = ~observed.patches & (flat[:, 2] > _LEANS_ABOVE * observed.height_m)
    high = observed.patches & (flat[:, 2] > _LEANS_ABOVE * observed.height_m)
    if not other.any() or not high.any():
        return None
    away, _ = cKDTree(surfels.points_m[high]).query(surfels.points_m[other])
    touch = away < 2.0 * surfels.voxel_m
    if touch.sum() < _LEAST_TOUCHES:
        return None
    places = flat[other][touch]
    toward = azimuth_told(places[:, :2].mean(axis=0) - flat[observed.patches, :2].mean(axis=0), interface)
    return Doubt(
        "leaning",
        f"a neighbour touches the rock {np.median(places[:, 2]):.2g} m above the interface, toward {toward}: it may "
        "hold or wedge the rock, and the answer is that of the rock without it",
    )


def _hemmed_in(observed: ObservedRock, pedestal_m: Array, closed: Rock | None) -> Doubt | None:
    own, height = observed.surfels.points_m[observed.patches], observed.height_m
    others = pedestal_m[pedestal_m[:, 2] > own[:, 2].min() + _IN_REACH_ABOVE * height]
    if len(others) < _LEAST_IN_REACH:
        return None
    others, _ = thin(others, observed.surfels.voxel_m)
    others = others[~in_plants(others, roughness(others))]
    away, _ = cKDTree(own[:, :2]).query(others[:, :2], distance_upper_bound=height)
    # A slope of less than 45 degrees is fallen over.
    rises = others[:, 2] - own[:, 2].min() > away
    near = np.isfinite(away) & (away > _BESIDE_VOXELS * observed.surfels.voxel_m) & rises
    if closed is not None:
        # Where few points fell on the rock they join no patches of it.
        near[near] = _out_of_hull_m(others[near], closed.vertices_m) > _ON_ROCK * height
    if near.sum() < _LEAST_IN_REACH:
        return None
    offset = others[near, :2] - own[:, :2].mean(axis=0)
    toward = azimuth_deg(offset.mean(axis=0))
    return Doubt(
        "in reach",
        f"something rises beside the rock within its height, over {len(np.unique(sectors(offset))) * 360 // SECTORS} "
        f"degrees about {direction_told(toward)}: a rock that falls that way may come to lean there",
    )


def _out_of_hull_m(points_m: Array, vertices_m: Array) -> Array:
    """How far points (n, 3) lie out of the planes of the hull of vertices (k, 3) at most; below 0 inside."""
    planes = ConvexHull(vertices_m).equations
    # All at once take gigabytes: 30,000 points beside a hull of 10,000 facets.
    blocks = np.array_split(points_m, len(points_m) // _HULL_AT_ONCE + 1)
    return np.concatenate([(each @ planes[:, :3].T + planes[:, 3]).max(axis=1) for each in blocks])


_MOST_DIP_DEG, _LEAST_DIP_DEG = 12.0, 1.5
"""Dips of levels that are told: steeper ones were not made level, a gentler one hardly matters."""
_ALIKE_DEG = 1.0
"""Between the normals of two levels: natural ground does not keep a dip so well from one height to another."""
_LEAST_SHARE = 0.1
"""Of the patches that lie about level, in one level."""
_WIDE_VOXELS, _APART_VOXELS = 8.0, 6.0
"""How wide a level is (standard deviation of its patches' places), and how far over another."""
_NEAR_VOXELS, _ABOUT_VOXELS, _TURNED_DEG, _GROWN = 0.5, 2.0, 8.0, 4
"""How far off a plane, and turned from it, its patches lie; how far off others about it do; how often it is grown."""
_EVEN_SHARE = 0.8
"""Of the patches about a plane that lie on it, where it was made: ground is uneven."""


def tilted_frame(surfels: Surfels, rock: Flags) -> Doubt | None:
    """A doubt where planes beside a rock at different heights dip alike: paving, steps and plinths are made level."""
    level = ~rock & (surfels.normals[:, 2] > np.cos(np.deg2rad(_MOST_DIP_DEG)))
    about = surfels.only(level)
    points, normals, voxel = about.points_m, about.normals, about.voxel_m

    def on(plane: Interface, voxels: float) -> Flags:
        near = np.abs((points - plane.point_m) @ plane.normal) < voxels * voxel
        return np.asarray(near & (normals @ plane.normal > np.cos(np.deg2rad(_TURNED_DEG))))

    planes = []
    for own, plane in level_planes(about, neighbourhood(points, voxel)):
        for _ in range(_GROWN):  # over what lies apart: what stands on a level hides parts of it
            if own.any():
                plane = fitted_plane(points[own])
                own = on(plane, _NEAR_VOXELS)
        even = own.sum() > _EVEN_SHARE * on(plane, _ABOUT_VOXELS).sum()
        wide_m2 = np.linalg.eigvalsh(np.cov(points[own].T))[1] if own.sum() > _LEAST_SHARE * len(own) else 0.0
        if even and wide_m2 > (_WIDE_VOXELS * voxel) ** 2:
            planes.append(plane)
    if not planes:
        return None
    first = planes[0]
    like = [each for each in planes if each.normal @ first.normal > np.cos(np.deg2rad(_ALIKE_DEG))]
    heights_m = [float((each.point_m - first.point_m) @ first.normal) for each in like]
    apart_m = max(heights_m) - min(heights_m)
    dip_deg, toward_deg = slope_of_normal(first.normal)
    if apart_m < _APART_VOXELS * surfels.voxel_m or dip_deg < _LEAST_DIP_DEG:
        return None
    off_m = max(each.roughness_m for each in like)
    return Doubt(
        "frame",
        f"levels {apart_m:.2g} m apart about the rock, each a plane within {off_m:.1g} m, dip alike, by "
        f"{dip_deg:.1f} degrees toward {direction_told(toward_deg)}: if they were made level, as paving, steps or a "
        "plinth, z does not point upward in this cloud, and the rock is taken to lean by as much. Then give --up "
        "{:.4f},{:.4f},{:.4f}".format(*first.normal),
    )
