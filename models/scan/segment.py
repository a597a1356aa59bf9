"""Segmentation: the rock is what stands on the pedestal, above the narrowing or crevice.

Two passes. The coarse one sweeps a horizontal plane down through the surfels and keeps the peaks that rise far above
the level at which they join something else; what stands on a dressed or worn flat top, however it is shaped above, is
found by the planes that carry things. The fine one cuts the surface around what was chosen along the loop that is short
and concave (a minimum cut between peak and surroundings, after Boykov and Kolmogorov 2004, with the convexity of Stein,
Schoeler, Papon and Woergoetter 2014 as capacity).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, cKDTree

from toppling.models.arrays import Array, Flags, Indices, bounds_of, inside_box, inside_cylinder
from toppling.models.errors import InputError
from toppling.models.joined import joined_parts
from toppling.models.scan.candidates import (
    JOINED_SPACINGS,
    LEAST_SURFELS,
    Candidate,
    cut_between,
    find_candidates,
    joined_rock,
    minimum_cut,
    neighbourhood,
    surfels_of,
    thing_and_rest,
)
from toppling.models.scan.choice import choose, lies_on, look_around
from toppling.models.scan.interface import Interface
from toppling.models.scan.interface_hint import InterfaceHint
from toppling.models.scan.surfels import LEVEL, Surfels, orient, roughness, thin

ROCK, PEDESTAL, NEITHER = 0, 1, 2

_FINE_VOXELS_PER_HEIGHT = 100
_CLUTTER_ROUGHNESS = 0.6
"""Median thickness over width above which a neighbourhood is clutter."""
_SHEET_ROUGHNESS = 0.3
"""Thickness over width of a fine voxel's neighbourhood among clutter, below which it lies on a surface: the ground
below a bush, a wall's edge."""
_LABELLING_POINTS = 20
"""So many points for each patch tell its label."""
_OVER_VOXELS = 2.0
"""What rises by so much over a surface that was found is none of it."""
_GROUND_PER_HEIGHT = 0.03
"""The ground beside a rock rises no higher over the interface."""
_FEWEST_OF_A_SURFACE = 100
"""Fewer points among clutter are clutter."""


@dataclass(frozen=True, eq=False)
class Segmentation:
    """Labels of all points and of the surfels around the rock."""

    label: NDArray[np.int8]  # (n,): per point: 0 rock, 1 pedestal, 2 neither
    surfels: Surfels  # around the rock, at a hundredth of its height
    surfel_label: NDArray[np.int8]  # (k,)
    # list of (x, y, z, height): other things that stand there, metres.
    others: list[tuple[float, float, float, float]]


def segment(
    points_m: Array, origin_m: Array, near_m: Array | None = None, hint: InterfaceHint | None = None
) -> Segmentation:
    """Split a cloud into rock, pedestal and neither.

    points_m: (n, 3).
    origin_m: (3,), survey coordinates of the points' origin, in which places are told to the user.
    near_m: (2,), x, y in the points' frame, near the top of the rock that is meant, where several stand.
    hint: the interface as the user knows it: the rock is what stands on it.
    Raises InputError if nothing in the cloud stands on anything, two things stand there equally, or none near where
    the user points.
    """
    coarse = surfels_of(points_m)
    if hint is not None:
        return _refine(points_m, coarse, _standing_on(coarse, hint, near_m), [], hint)
    candidates = find_candidates(points_m, coarse)
    if near_m is not None and not lies_on(near_m, candidates):
        # A rock that is small in its cloud shows in patches made around the place alone.
        coarse, candidates = look_around(points_m, near_m, coarse, candidates)
    chosen = choose(candidates, near_m, origin_m, coarse)
    return _refine(points_m, coarse, chosen, [c for c in candidates if c is not chosen])


def _standing_on(surfels: Surfels, hint: InterfaceHint, near_m: Array | None) -> Candidate:
    """Cut off what stands on the interface that the user names: where they point, or else nearest to its anchors."""
    edges = neighbourhood(surfels.points_m, surfels.voxel_m)
    points = surfels.points_m
    height = hint.interface.flat(points)[:, 2]
    above = height > 2.0 * surfels.voxel_m
    inside = edges[above[edges].all(axis=1)]
    part = joined_parts(inside, len(points))
    if near_m is None:
        away = np.median([np.linalg.norm(points - anchor, axis=1) for anchor in hint.anchors_m], axis=0)
    else:
        away = np.hypot(*(points[:, :2] - near_m).T)
    large = above & (np.bincount(part)[part] >= LEAST_SURFELS)
    if not large.any():
        raise _off(
            "interface.nothing_above",
            hint,
            "nothing stands above the interface that is given",
            "check its height and slope; azimuths are counted from east to north",
        )
    chosen = part == part[large][np.argmin(away[large])]
    peak = int(np.argmax(np.where(chosen, height, -np.inf)))
    seeds, far = thing_and_rest(surfels, edges, chosen, peak, height)
    if not far.any():
        raise _off(
            "interface.nothing_below",
            hint,
            "nothing lies below the interface that is given",
            "check its height; a cloud cropped to the rock shows no pedestal to stand on",
        )
    found = cut_between(surfels, edges, seeds, far, peak, height)
    if found is None:
        raise _off(
            "interface.no_rock_above",
            hint,
            "what stands above the interface that is given is no rock's surface",
            "check its place; what stands there is as thick as it is wide, like a bush",
        )
    return found


def _off(code: str, hint: InterfaceHint, what: str, remedy: str) -> InputError:
    where = f"the interface's {hint.kind}"
    return InputError(
        code, what, where=where, expected="a plane below the rock, above the rest", remedy=remedy
    )


def patches_around(points_m: Array, rock_m: Array, height_m: float) -> tuple[Surfels, Indices, Indices]:
    """Patches of a hundredth of a rock's height around it, the points that they are of, and the patch of each."""
    axis = rock_m[:, :2].mean(axis=0)
    reach = np.hypot(*(rock_m[:, :2] - axis).T).max() + 0.5 * height_m
    around = inside_cylinder(points_m, axis, reach, rock_m[:, 2].min() - 0.7 * height_m)
    voxel = height_m / _FINE_VOXELS_PER_HEIGHT
    thinned, index = thin(points_m[around], voxel)
    return orient(thinned, voxel), around, index


def _refine(
    points_m: Array,
    coarse: Surfels,
    chosen: Candidate,
    others: list[Candidate],
    hint: InterfaceHint | None = None,
) -> Segmentation:
    """Cut again at a hundredth of the rock's height, and label every point."""
    rock = chosen.surfels.points_m[chosen.rock]
    surfels, around, index = patches_around(points_m, rock, chosen.height_m)
    voxel = surfels.voxel_m
    edges = neighbourhood(surfels.points_m, voxel)
    _, near = cKDTree(chosen.surfels.points_m).query(surfels.points_m, 8)
    votes = chosen.rock[near].mean(axis=1)
    if hint is None:
        fine_rock = minimum_cut(surfels, edges, votes == 1.0, votes == 0.0)
    else:
        over = hint.interface.flat(surfels.points_m)[:, 2]
        seeds, far = (votes == 1.0) & (over > 2.0 * voxel), (votes == 0.0) | (over < -2.0 * voxel)
        fine_rock = minimum_cut(surfels, edges, seeds, far, over)
    surfel_label = np.where(fine_rock, ROCK, PEDESTAL).astype(np.int8)
    surfel_label[fine_rock & ~joined_rock(surfels.points_m, fine_rock, votes == 1.0)] = NEITHER
    label = np.full(len(points_m), PEDESTAL, np.int8)
    strays = np.flatnonzero(index < 0)
    away_m, index[strays] = cKDTree(surfels.points_m).query(points_m[around[strays]])
    label[around] = surfel_label[index]
    label[around[strays[away_m > voxel]]] = NEITHER
    surfels, surfel_label = surfels.only(surfel_label != NEITHER), surfel_label[surfel_label != NEITHER]
    label[_clutter(points_m, coarse, rock, voxel)] = NEITHER
    return Segmentation(
        label,
        surfels,
        surfel_label,
        [(*other.top_m.tolist(), other.height_m) for other in others],
    )


def _clutter(points_m: Array, coarse: Surfels, rock_m: Array, fine_m: float) -> Flags:
    """Points of a bush or the like: where neighbourhoods are as thick as they are wide, what lies on no surface.

    Not beside the rock, where the two sides of the crevice make one thick neighbourhood.
    """
    _, near = cKDTree(coarse.points_m).query(coarse.points_m, 9)
    thick = np.median(coarse.roughness[near], axis=1) > _CLUTTER_ROUGHNESS
    thick &= cKDTree(rock_m).query(coarse.points_m)[0] > 4 * coarse.voxel_m
    clutter = np.zeros(len(points_m), bool)
    if not thick.any():
        return clutter
    low = coarse.points_m[thick].min(axis=0) - coarse.voxel_m
    high = coarse.points_m[thick].max(axis=0) + coarse.voxel_m
    around = np.flatnonzero(inside_box(points_m, low, high))
    around = around[thick[cKDTree(coarse.points_m).query(points_m[around])[1]]]
    # But not what lies with its neighbours in a sheet, as the ground below it.
    if len(around) > _FEWEST_OF_A_SURFACE:
        means, voxel = thin(points_m[around], fine_m)
        around = around[~((voxel >= 0) & (roughness(means)[voxel] < _SHEET_ROUGHNESS))]
    clutter[around] = True
    return clutter


def cut_over(points_m: Array, parts: Segmentation, interface: Interface) -> Segmentation:
    """Add to the rock what stands over the pedestal's surface below it: narrow feet come off at their tops."""
    surfels, rock = parts.surfels, parts.surfel_label == ROCK
    over, clear = interface.over(surfels.points_m), _OVER_VOXELS * surfels.voxel_m
    outline = ConvexHull(over[rock, :2]).equations
    beside = (over[:, :2] @ outline[:, :2].T + outline[:, 2]).max(axis=1) > clear
    seeds, far = rock & (over[:, 2] > clear), ~rock & (beside | (over[:, 2] < -clear))
    if not seeds.any() or not far.any():
        return parts
    edges = neighbourhood(surfels.points_m, surfels.voxel_m)
    found = minimum_cut(surfels, edges, seeds, far, over[:, 2])
    return _relabelled(points_m, parts, found & ~rock & (over[:, 2] > clear), ROCK)


def without_ground(
    points_m: Array, parts: Segmentation, interface: Interface, height_m: float
) -> Segmentation:
    """Take from the rock what lies low and level with nothing of it above: that is the ground beside it."""
    surfels, rock = parts.surfels, parts.surfel_label == ROCK
    over = interface.over(surfels.points_m)
    band_m = _GROUND_PER_HEIGHT * height_m
    above = rock & (over[:, 2] > band_m)
    level = rock & ~above & (surfels.normals @ interface.normal > LEVEL)
    if level.any() and above.any():
        spacing_m = cKDTree(surfels.points_m[rock]).query(surfels.points_m[rock], 5)[0][:, 4]
        own = np.zeros(len(rock))
        own[rock] = spacing_m
        beside_m, nearest = cKDTree(over[above, :2]).query(over[level, :2])
        level[level] = beside_m > JOINED_SPACINGS * np.minimum(own[level], own[above][nearest])
    return _relabelled(points_m, parts, level, PEDESTAL)


def _relabelled(points_m: Array, parts: Segmentation, patches: Flags, to: int) -> Segmentation:
    """Change the label of some patches (k,) and of their points."""
    if not patches.any():
        return parts
    surfels = parts.surfels
    low, high = bounds_of(surfels.points_m[patches])
    around = np.flatnonzero(inside_box(points_m, low - surfels.voxel_m, high + surfels.voxel_m))
    around = around[patches[cKDTree(surfels.points_m).query(points_m[around])[1]]]
    label = parts.label.copy()
    label[around[label[around] != NEITHER]] = to
    surfel_label = np.where(patches, to, parts.surfel_label).astype(np.int8)
    return replace(parts, label=label, surfel_label=surfel_label)


def label_surfels(surfels: Surfels, points_m: Array, label: NDArray[np.int8]) -> NDArray[np.int8]:
    """Label of the point nearest to each surfel."""
    low, high = surfels.points_m.min(axis=0) - surfels.voxel_m, surfels.points_m.max(axis=0) + surfels.voxel_m
    around = np.flatnonzero(inside_box(points_m, low, high))
    around = around[:: max(1, len(around) // (_LABELLING_POINTS * len(surfels.points_m)))]
    return label[around[cKDTree(points_m[around]).query(surfels.points_m)[1]]]
