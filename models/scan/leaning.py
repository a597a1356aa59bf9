"""Whether a body in a cloud leans: its weight hangs over beside its foot, and a wall or neighbour holds it there.

Bodies are what creases part from all around, whatever was taken for rock and pedestal: a wall that a rock leans on
stands out as much as the rock itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, Delaunay, QhullError, cKDTree

from toppling.models.arrays import Array, Flags, Indices
from toppling.models.errors import InputError
from toppling.models.frames import azimuth_deg
from toppling.models.joined import joined_parts
from toppling.models.scan.candidates import CREASE, bend, neighbourhood, surfels_of
from toppling.models.scan.choice import circles_around
from toppling.models.scan.doubt import direction_told
from toppling.models.scan.interface_hint import InterfaceHint
from toppling.models.scan.segment import ROCK, Segmentation, segment
from toppling.models.scan.surfels import LEVEL, Surfels, orient, thin

_CREASE_VOXELS = 5.0
"""Patches so near to a body are its."""
_LEAST_CORE, _LEAST_PATCHES = 20, 100
"""Fewer are no body."""
_TALL = 0.4
"""Of what is meant: a body of this height may be it."""
_LEAST_TALL_VOXELS = 20.0
"""Less shows no overhang in its patches."""
_CIRCLES = (0.2, 0.14, 0.1, 0.07)
"""Of the cloud's extent, about a place that is named."""
_FINER = 0.4
"""Of the patches in which a whole cloud is looked through."""
_TOUCH_VOXELS = 3.0
"""Patches of two bodies so near to each other touch."""
_FOOT_VOXELS = 4.0
"""A crevice at the foot may be as wide."""
_FOOT, _HIGH = 0.12, 0.2
"""Of a body's height: what touches below carries it, what touches above holds it."""
_LEAST_TOUCHES, _LEAST_FOOT = 8, 8
_FACES_DOWN = -0.5
"""Upward part of normals: what lies level carries, unless the body's own face leans over it by so much."""
_BESIDE_VOXELS = 0.7
"""A weight so far outside the foot is not carried by it alone: patches tell the foot to their width."""
_TOWARD = 0.5
"""Cosine between the way over which the weight hangs and that to what holds it."""


@dataclass(frozen=True)
class Lean:
    """A body that leans: how high it is, how far its weight hangs over, and where what holds it touches."""

    height_m: float
    overhang_m: float
    places_m: Array  # (n, 3): its patches
    held_m: Array  # (3,): where it is held
    above_foot_m: float
    toward_deg: float


def upright_split(
    points_m: Array, origin_m: Array, near_m: Array | None = None, hint: InterfaceHint | None = None
) -> Segmentation:
    """As :func:`segment.segment`, for a rock that does not lean.

    Raises InputError also where what may be meant leans, or the rock is what it leans on: with a place named, only
    where what stands there leans.
    """
    try:
        parts = segment(points_m, origin_m, near_m, hint)
    except InputError:
        _refuse_near(points_m, near_m, origin_m)
        raise
    of_rock = parts.surfel_label == ROCK
    rock = parts.surfels.points_m[of_rock]
    found = leaning(parts.surfels, _TALL * float(np.ptp(rock[:, 2])), of_rock)
    if near_m is None:
        touching_m = _TOUCH_VOXELS * parts.surfels.voxel_m
        refuse([each for each in found if cKDTree(rock).query(each.places_m)[0].min() < touching_m], origin_m)
    elif not _covers(rock, near_m):
        _refuse_near(points_m, near_m, origin_m)
    else:
        refuse([each for each in found if _covers(each.places_m, near_m)], origin_m)
    return parts


def check_upright(parts: Segmentation, origin_m: Array) -> None:
    """Refuse a rock that was separated before, as points, and leans on its pedestal."""
    rock = parts.surfel_label == ROCK
    found = _lean(parts.surfels, rock, np.ones(len(rock), bool), ~rock)
    refuse([] if found is None else [found], origin_m)


def _refuse_near(points_m: Array, near_m: Array | None, origin_m: Array) -> None:
    """Refuse what leans in a cloud where no rock was found: what covers a place, or anything that is tall."""
    coarse = surfels_of(points_m)
    if near_m is None:
        finer_m = _FINER * coarse.voxel_m
        patches = orient(thin(points_m, finer_m)[0], finer_m)
        refuse(leaning(patches, _TALL * float(np.ptp(coarse.points_m[:, 2]))), origin_m)
        return
    for around in circles_around(points_m, near_m, coarse, _CIRCLES):
        refuse([each for each in leaning(surfels_of(around)) if _covers(each.places_m, near_m)], origin_m)


def _covers(places_m: Array, place_m: Array) -> bool:
    """Whether a place (2,) lies within the rectangle around others (n, 3)."""
    low, high = places_m[:, :2].min(axis=0), places_m[:, :2].max(axis=0)
    return bool(((place_m >= low) & (place_m <= high)).all())


def refuse(found: Iterable[Lean], origin_m: Array) -> None:
    """Refuse the highest of some bodies that lean: say on what, where, and what to do."""
    body = max(found, key=lambda each: each.height_m, default=None)
    if body is None:
        return
    x, y, z = body.held_m + origin_m
    raise InputError(
        "rock.leans",
        f"the rock leans: a body {body.height_m:.2g} m high rests on a wall or neighbour toward "
        f"{direction_told(body.toward_deg)}, which touches it {body.above_foot_m:.2g} m above its foot, about "
        f"{x:.2f}, {y:.2f}, {z:.2f}; its weight hangs {body.overhang_m:.2g} m over beside its foot",
        where="the rock",
        expected="a rock that stands by itself on what lies below it",
        remedy="where two touch, a scan does not show which surface is whose. Bring them apart in another program, as "
        "two meshes, the rock closed and the wall or neighbour with the pedestal, and give them as --rock ROCK "
        "--pedestal PEDESTAL, or in Python as Scene.from_mesh(ROCK, pedestal=PEDESTAL). If another rock is meant, "
        "point at it by --near X Y, or crop the cloud",
    )


def leaning(surfels: Surfels, least_m: float = 0.0, rock: Flags | None = None) -> Iterator[Lean]:
    """Bodies of at least such a height that lean.

    rock: (n,), patches of the rock, where it was found: what stands on the rock alone is a part of it.
    """
    number = _bodies(surfels)
    for each in np.flatnonzero(np.bincount(number[number >= 0]) >= _LEAST_PATCHES):
        own = number == each
        height_m = float(np.ptp(surfels.points_m[own, 2]))
        if height_m < max(least_m, _LEAST_TALL_VOXELS * surfels.voxel_m) or _is_cut_off(surfels, own):
            continue
        carries = np.ones(len(own), bool)
        if rock is not None and rock[own].mean() > 0.5:
            carries = ~rock
        found = _lean(surfels, own, number >= 0, carries)
        if found is not None:
            yield found


def _bodies(surfels: Surfels) -> Indices:
    """Number (n,) of the body of each patch, -1 of none.

    A body is what is joined away from creases; a patch in or beside a crease belongs to the body nearest to it.
    """
    points, edges = surfels.points_m, neighbourhood(surfels.points_m, surfels.voxel_m)
    creased = np.zeros(len(points), bool)
    creased[edges[bend(surfels, edges) < CREASE]] = True
    beside = creased.copy()
    beside[edges[creased[edges].any(axis=1)]] = True
    number = joined_parts(edges[~beside[edges].any(axis=1)], len(points))
    core = np.flatnonzero(~beside & (np.bincount(number)[number] >= _LEAST_CORE))
    if len(core) == 0:
        return np.full(len(points), -1)
    away, nearest = cKDTree(points[core]).query(points)
    return np.where(away < _CREASE_VOXELS * surfels.voxel_m, number[core[nearest]], -1)


def _is_cut_off(surfels: Surfels, own: Flags) -> bool:
    """Whether a body goes on beyond the patches."""
    low, high = surfels.points_m[:, :2].min(axis=0), surfels.points_m[:, :2].max(axis=0)
    places, margin = surfels.points_m[own, :2], 3.0 * surfels.voxel_m
    return bool(((places < low + margin) | (places > high - margin)).any())


def _lean(surfels: Surfels, own: Flags, counts: Flags, carries: Flags) -> Lean | None:
    """How a body leans, by its hull: its weight is that of the hull's volume.

    counts: (n,), patches that may carry or hold something.
    carries: (n,), those of them that may carry it.
    """
    beside = np.flatnonzero(~own & counts)
    points, others = surfels.points_m[own], surfels.points_m[beside]
    if len(others) == 0:
        return None
    low, height_m = points[:, 2].min(), float(np.ptp(points[:, 2]))
    away, nearest = cKDTree(others).query(points)
    up = points[:, 2] - low
    stands = (up < _FOOT * height_m) & (away < _FOOT_VOXELS * surfels.voxel_m)
    foot = points[stands]
    holds = (up > _HIGH * height_m) & (away < _TOUCH_VOXELS * surfels.voxel_m)
    held = points[holds]
    if len(foot) < _LEAST_FOOT or len(held) < _LEAST_TOUCHES or carries[beside[nearest[stands]]].mean() < 0.5:
        return None
    below = np.median(surfels.normals[beside[nearest[holds]], 2])
    if below > LEVEL and np.median(surfels.normals[own][holds, 2]) > _FACES_DOWN:
        return None  # it is carried there, and hangs down over an edge
    try:
        com = _middle_of_hull(points)
        overhang_m, way = _beside(foot[:, :2], com[:2])
    except QhullError:
        return None
    toward = held[:, :2].mean(axis=0) - com[:2]
    if overhang_m < _BESIDE_VOXELS * surfels.voxel_m or way @ toward < _TOWARD * np.linalg.norm(toward):
        return None
    place = np.median(held, axis=0)
    return Lean(height_m, overhang_m, points, place, float(place[2] - low), azimuth_deg(way))


def _middle_of_hull(points_m: Array) -> Array:
    """Centre of mass (3,) of the convex hull of points (n, 3)."""
    corners = points_m[ConvexHull(points_m).vertices]
    pieces: Indices = Delaunay(corners).simplices
    solids = corners[pieces]
    volume = np.abs(np.linalg.det(solids[:, 1:] - solids[:, :1]))
    return np.asarray(np.average(solids.mean(axis=1), axis=0, weights=volume))


def _beside(foot_m: Array, place_m: Array) -> tuple[float, Array]:
    """How far a place (2,) lies outside the hull of a foot (k, 2), negative within, and the way there."""
    equations = ConvexHull(foot_m).equations
    off = equations[:, :2] @ place_m + equations[:, 2]
    farthest = int(off.argmax())
    return float(off[farthest]), equations[farthest, :2]
