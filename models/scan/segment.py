"""Segmentation: the rock is what stands on the pedestal, above the narrowing or crevice.

Two passes. The coarse one sweeps a horizontal plane down through the surfels and keeps the peaks that rise
far
above the level at which they join something else; the fine one cuts the surface around the chosen peak
along the
loop that is short and concave (a minimum cut between peak and surroundings, after Boykov and Kolmogorov
2004, with
the convexity of Stein, Schoeler, Papon and Woergoetter 2014 as capacity).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from toppling.models.arrays import inside_box, inside_cylinder
from toppling.models.errors import InputError
from toppling.models.joined import joined_parts
from toppling.models.scan.candidates import (
    LEAST_CONCAVE_SHARE,
    LEAST_SURFELS,
    Candidate,
    cut_between,
    find_candidates,
    minimum_cut,
    neighbourhood,
    surfels_of,
)
from toppling.models.scan.carried import carried_instead, thing_and_rest, upper_of
from toppling.models.scan.choice import choose, is_near, look_around
from toppling.models.scan.interface_hint import InterfaceHint
from toppling.models.scan.surfels import Surfels, orient, roughness, thin

ROCK, PEDESTAL, NEITHER = 0, 1, 2

_FINE_VOXELS_PER_HEIGHT = 100
_CLUTTER_ROUGHNESS = 0.6
"""Median thickness over width above which a neighbourhood is clutter."""
_SHEET_ROUGHNESS = 0.3
"""Thickness over width of a fine voxel's neighbourhood among clutter, below which it lies on a surface: the ground
below a bush, a wall's edge."""
_LABELLING_POINTS = 20
"""So many points for each patch tell its label."""
_FEWEST_OF_A_SURFACE = 100
"""Fewer points among clutter are clutter."""


@dataclass(frozen=True, eq=False)
class Segmentation:
    """Labels of all points and of the surfels around the rock."""

    label: NDArray[np.int8]  # (n,): per point: 0 rock, 1 pedestal, 2 neither
    surfels: Surfels  # around the rock, at a hundredth of its height
    surfel_label: NDArray[np.int8]  # (k,)
    # Share of the cut that runs through concave creases: 1 is a clear crevice, near 0 no rock.
    concave_share: float
    # list of (x, y, z, height): other things that stand there, metres.
    others: list[tuple[float, float, float, float]]


def segment(
    points_m: NDArray[np.float64],
    origin_m: NDArray[np.float64],
    near_m: NDArray[np.float64] | None = None,
    hint: InterfaceHint | None = None,
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
    if near_m is not None and not is_near(candidates, near_m):
        # A rock that is small in its cloud shows in patches made around the place alone.
        coarse, candidates = look_around(points_m, near_m, coarse, candidates)
    standing = [each for each in candidates if each.concave_share > LEAST_CONCAVE_SHARE]
    carried = carried_instead(coarse, standing, near_m)  # of a stack the upper one already
    whole = carried or choose(candidates, near_m, origin_m, coarse)
    chosen = carried or upper_of(coarse, whole) or whole
    return _refine(points_m, coarse, chosen, [c for c in candidates if c is not whole])


def _standing_on(surfels: Surfels, hint: InterfaceHint, near_m: NDArray[np.float64] | None) -> Candidate:
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
        raise InputError(
            "nothing stands above the interface that is given",
            where=f"the interface's {hint.kind}",
            expected="a plane below the rock, above the rest",
            remedy="check its height and slope; azimuths are counted from east to north",
        )
    chosen = part == part[large][np.argmin(away[large])]
    peak = int(np.argmax(np.where(chosen, height, -np.inf)))
    seeds, far = thing_and_rest(surfels, edges, chosen, peak, height)
    if not far.any():
        raise InputError(
            "nothing lies below the interface that is given",
            where=f"the interface's {hint.kind}",
            expected="a plane below the rock, above the rest",
            remedy="check its height; a cloud cropped to the rock shows no pedestal to stand on",
        )
    found = cut_between(surfels, edges, seeds, far, peak, height)
    if found is None:
        raise InputError(
            "what stands above the interface that is given is no rock's surface",
            where=f"the interface's {hint.kind}",
            expected="a plane below the rock, above the rest",
            remedy="check its place; what stands there is as thick as it is wide, like a bush",
        )
    return found


def patches_around(
    points_m: NDArray[np.float64], rock_m: NDArray[np.float64], height_m: float
) -> tuple[Surfels, NDArray[np.int64], NDArray[np.int64]]:
    """Patches of a hundredth of a rock's height around it, the points that they are of, and the patch of each."""
    axis = rock_m[:, :2].mean(axis=0)
    reach = np.hypot(*(rock_m[:, :2] - axis).T).max() + 0.5 * height_m
    around = inside_cylinder(points_m, axis, reach, rock_m[:, 2].min() - 0.7 * height_m)
    voxel = height_m / _FINE_VOXELS_PER_HEIGHT
    thinned, index = thin(points_m[around], voxel)
    return orient(thinned, voxel), around, index


def _refine(
    points_m: NDArray[np.float64],
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
        fine_rock, concave_share = minimum_cut(surfels, edges, votes == 1.0, votes == 0.0)
    else:
        over = hint.interface.flat(surfels.points_m)[:, 2]
        seeds, far = (votes == 1.0) & (over > 2.0 * voxel), (votes == 0.0) | (over < -2.0 * voxel)
        fine_rock, concave_share = minimum_cut(surfels, edges, seeds, far, over)
    surfel_label = np.where(fine_rock, ROCK, PEDESTAL).astype(np.int8)
    label = np.full(len(points_m), PEDESTAL, np.int8)
    strays = np.flatnonzero(index < 0)
    index[strays] = cKDTree(surfels.points_m).query(points_m[around[strays]])[1]
    label[around] = surfel_label[index]
    label[_clutter(points_m, coarse, rock, voxel)] = NEITHER
    return Segmentation(
        label,
        surfels,
        surfel_label,
        concave_share,
        [
            (float(other.top_m[0]), float(other.top_m[1]), float(other.top_m[2]), other.height_m)
            for other in others
        ],
    )


def _clutter(
    points_m: NDArray[np.float64], coarse: Surfels, rock_m: NDArray[np.float64], fine_m: float
) -> NDArray[np.bool_]:
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
    if len(around) > _FEWEST_OF_A_SURFACE:
        around = around[~_on_a_surface(points_m[around], fine_m)]
    clutter[around] = True
    return clutter


def _on_a_surface(points_m: NDArray[np.float64], voxel_m: float) -> NDArray[np.bool_]:
    """Points whose voxel lies with its neighbours in a sheet, such as the ground below a bush."""
    means, voxel = thin(points_m, voxel_m)
    return (voxel >= 0) & (roughness(means)[voxel] < _SHEET_ROUGHNESS)


def label_surfels(
    surfels: Surfels, points_m: NDArray[np.float64], label: NDArray[np.int8]
) -> NDArray[np.int8]:
    """Label of the point nearest to each surfel."""
    low, high = surfels.points_m.min(axis=0) - surfels.voxel_m, surfels.points_m.max(axis=0) + surfels.voxel_m
    around = np.flatnonzero(inside_box(points_m, low, high))
    around = around[:: max(1, len(around) // (_LABELLING_POINTS * len(surfels.points_m)))]
    return label[around[cKDTree(points_m[around]).query(surfels.points_m)[1]]]
