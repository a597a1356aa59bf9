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
    LEAST_PEAK_VOXELS,
    LEAST_SURFELS,
    Candidate,
    component_of,
    cut_between,
    find_candidates,
    joined_rock,
    joined_within_m,
    minimum_cut,
    neighbourhood,
    surfels_of,
)
from toppling.models.scan.choice import choose, lies_on, look_around, standing_of
from toppling.models.scan.doubt import sectors
from toppling.models.scan.interface import Interface, fitted_plane
from toppling.models.scan.interface_hint import InterfaceHint
from toppling.models.scan.surfels import LEVEL, Surfels, orient, roughness, thin

_LIKE = 0.97
"""Cosine between the normals of neighbours in one plane."""
_LEAST_OF_A_PLANE = 80
"""Fewer patches are no plane that carries anything."""
_FLAT_VOXELS = 1.0
"""Root mean square distance of a plane's patches from it, in their width."""
_FOOT_VOXELS, _BESIDE_VOXELS, _ABOVE_VOXELS = 6.0, 6.0, 2.0
_SECTORS, _SURROUNDED = 24, 0.6
"""Share of the directions around its foot in which the plane must be seen beside a thing that it carries."""
_CREASED = 0.2
"""Share of the cut's edges that must run through a crease, where a plane around it tells of the thing as well."""
_OF_THE_RELIEF = 0.3
"""One thing alone that has this share of the cloud's relief is meant, whatever planes carry."""
_TALLER = 2.0
"""A thing that a plane carries is meant before others if it is so many times as high as they are."""
_OF_A_STACK = 0.5
"""Of two things one upon the other the upper is meant if it has this share of the height of both."""
_WITHIN = 0.13
"""Its foot must lie this share of the height of both above theirs: a statue's lies .21, on 48 rocks .04 at most."""


def find_carried(surfels: Surfels) -> list[Candidate]:
    """What the planes of a cloud carry, the highest first; of what stands upon another, the upper one.

    surfels: of the whole cloud.
    """
    edges = neighbourhood(surfels.points_m, surfels.voxel_m)
    found: list[Candidate] = []
    for _, plane in level_planes(surfels, edges):
        found += _on_plane(surfels, edges, plane)
    found.sort(key=lambda each: -each.height_m)
    kept: list[Candidate] = []
    for each in found:
        below = [k for k, other in enumerate(kept) if (each.rock & other.rock).sum() > 0.5 * each.rock.sum()]
        if not below:
            kept.append(each)
        elif each.height_m > _OF_A_STACK * kept[below[0]].height_m:
            kept[below[0]] = each
    return kept


def _carried_instead(surfels: Surfels, standing: list[Candidate]) -> Candidate | None:
    """What a plane carries, if that is much higher than all that stands otherwise; None if it is not.

    surfels: of the whole cloud.
    standing: what was found to stand there, the highest first.
    """
    relief = float(np.ptp(surfels.points_m[:, 2]))
    highest = standing[0].height_m if standing else 0.0
    if _TALLER * highest > relief or (len(standing) == 1 and highest > _OF_THE_RELIEF * relief):
        return None
    for each in find_carried(surfels):
        if each.height_m > _TALLER * highest:
            return each
    return None


def upper_of(surfels: Surfels, chosen: Candidate) -> Candidate | None:
    """What a level top within a thing carries, where that is most of its height: a statue, and not its plinth with it.

    surfels: of the whole cloud.
    chosen: None is told of one that was cut off along no line, as the largest of many boulders.
    """
    if not len(chosen.loop_m):
        return None
    own = cKDTree(chosen.surfels.points_m[chosen.rock])
    reach_m = _BESIDE_VOXELS * max(surfels.voxel_m, chosen.surfels.voxel_m)
    foot_m = np.median(chosen.loop_m[:, 2]) + _WITHIN * chosen.height_m
    for each in find_carried(surfels):
        upper = each.height_m > _OF_A_STACK * chosen.height_m and np.median(each.loop_m[:, 2]) > foot_m
        if upper and (own.query(surfels.points_m[each.rock])[0] < reach_m).all():
            return each
    return None


def level_planes(surfels: Surfels, edges: Indices) -> list[tuple[Flags, Interface]]:
    """Planes of neighbouring patches that something can stand on, the widest first, and which patches (n,) are theirs.

    edges: (m, 2), of the patches' neighbourhood.
    """
    level = surfels.normals[:, 2] > LEVEL
    alike = np.einsum("ij,ij->i", surfels.normals[edges[:, 0]], surfels.normals[edges[:, 1]]) > _LIKE
    part = joined_parts(edges[level[edges].all(axis=1) & alike], len(level))
    sizes = np.bincount(part[level], minlength=part.max() + 1)
    planes = []
    for number in np.argsort(-sizes)[:12]:
        if sizes[number] < _LEAST_OF_A_PLANE:
            break
        own = part == number
        plane = fitted_plane(surfels.points_m[own])
        if plane.roughness_m < _FLAT_VOXELS * surfels.voxel_m:
            planes.append((own, plane))
    return planes


def _on_plane(surfels: Surfels, edges: Indices, plane: Interface) -> list[Candidate]:
    """What stands on a plane with the plane seen around it."""
    points, voxel = surfels.points_m, surfels.voxel_m
    flat = plane.flat(points)
    height = flat[:, 2]
    top = (np.abs(height) < _ABOVE_VOXELS * voxel) & (surfels.normals @ plane.normal > LEVEL)
    above = height > _ABOVE_VOXELS * voxel
    inside = edges[above[edges].all(axis=1)]
    part = joined_parts(inside, len(points))
    sizes = np.bincount(part[above], minlength=part.max() + 1)
    found = []
    for number in np.argsort(-sizes)[:3]:
        if sizes[number] < LEAST_SURFELS:
            break
        thing = above & (part == number)
        foot = thing & (height < _FOOT_VOXELS * voxel)
        if height[thing].max() < LEAST_PEAK_VOXELS * voxel or not foot.any() or not top.any():
            continue
        away, _ = cKDTree(flat[foot, :2]).query(flat[top, :2])
        beside = flat[top][away < _BESIDE_VOXELS * voxel, :2] - flat[foot, :2].mean(axis=0)
        if len(np.unique(sectors(beside, _SECTORS))) < _SURROUNDED * _SECTORS:
            continue
        peak = int(np.argmax(np.where(thing, height, -np.inf)))
        seeds, far = _thing_and_rest(surfels, edges, thing, peak, height)
        candidate = cut_between(surfels, edges, seeds, far, peak, height) if far.any() else None
        if candidate is not None and candidate.concave_share > _CREASED:
            found.append(candidate)
    return found


def _thing_and_rest(
    surfels: Surfels, edges: Indices, thing: Flags, peak: int, height_m: Array
) -> tuple[Flags, Flags]:
    """Which patches are surely of a thing on a plane, and which surely are not: seeds of the cut between them.

    edges: (m, 2).
    thing: (k,), patches joined above the plane.
    peak: one of them.
    height_m: (k,), over the plane.
    """
    points = surfels.points_m
    seeds = component_of(peak, thing & (height_m > 0.4 * height_m[peak]), edges)
    axis = np.median(points[seeds, :2], axis=0)
    reach = 1.2 * height_m[peak] + np.quantile(np.hypot(*(points[seeds, :2] - axis).T), 0.95)
    far = (np.hypot(*(points[:, :2] - axis).T) > reach) | (height_m < -_ABOVE_VOXELS * surfels.voxel_m)
    return seeds, far & ~seeds


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
    # Share of the cut that runs through concave creases: 1 is a clear crevice, near 0 no rock.
    concave_share: float
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
    carried = _carried_instead(coarse, standing_of(candidates))  # of a stack the upper one already
    if near_m is not None and not lies_on(near_m, [carried] if carried else standing_of(candidates)):
        # A rock that is small in its cloud shows in patches made around the place alone.
        carried = None
        coarse, candidates = look_around(points_m, near_m, coarse, candidates)
    whole = carried or choose(candidates, near_m, origin_m, coarse)
    chosen = carried or upper_of(coarse, whole) or whole
    return _refine(points_m, coarse, chosen, [c for c in candidates if c is not whole])


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
        raise _off("interface.nothing_above", hint, "nothing stands above the interface that is given",
            "check its height and slope; azimuths are counted from east to north")  # fmt: skip
    chosen = part == part[large][np.argmin(away[large])]
    peak = int(np.argmax(np.where(chosen, height, -np.inf)))
    seeds, far = _thing_and_rest(surfels, edges, chosen, peak, height)
    if not far.any():
        raise _off("interface.nothing_below", hint, "nothing lies below the interface that is given",
            "check its height; a cloud cropped to the rock shows no pedestal to stand on")  # fmt: skip
    found = cut_between(surfels, edges, seeds, far, peak, height)
    if found is None:
        raise _off("interface.no_rock_above", hint,
            "what stands above the interface that is given is no rock's surface",
            "check its place; what stands there is as thick as it is wide, like a bush")  # fmt: skip
    return found


def _off(code: str, hint: InterfaceHint, what: str, remedy: str) -> InputError:
    where = f"the interface's {hint.kind}"
    return InputError(code, what, where=where, expected="a plane below the rock, above the rest",
        remedy=remedy)  # fmt: skip


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
        fine_rock, concave_share = minimum_cut(surfels, edges, votes == 1.0, votes == 0.0)
    else:
        over = hint.interface.flat(surfels.points_m)[:, 2]
        seeds, far = (votes == 1.0) & (over > 2.0 * voxel), (votes == 0.0) | (over < -2.0 * voxel)
        fine_rock, concave_share = minimum_cut(surfels, edges, seeds, far, over)
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
        concave_share,
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
    """The same with what stands over a surface that is carried under the rock: narrow feet come off at their tops."""
    surfels, rock = parts.surfels, parts.surfel_label == ROCK
    over, clear = interface.over(surfels.points_m), _OVER_VOXELS * surfels.voxel_m
    outline = ConvexHull(over[rock, :2]).equations
    beside = (over[:, :2] @ outline[:, :2].T + outline[:, 2]).max(axis=1) > clear
    seeds, far = rock & (over[:, 2] > clear), ~rock & (beside | (over[:, 2] < -clear))
    if not seeds.any() or not far.any():
        return parts
    edges = neighbourhood(surfels.points_m, surfels.voxel_m)
    found, _ = minimum_cut(surfels, edges, seeds, far, over[:, 2])
    return _relabelled(points_m, parts, found & ~rock & (over[:, 2] > clear), ROCK)


def without_ground(
    points_m: Array, parts: Segmentation, interface: Interface, height_m: float
) -> Segmentation:
    """The same without what lies low and level with nothing of the rock over it: that is the ground beside it."""
    surfels, rock = parts.surfels, parts.surfel_label == ROCK
    over = interface.over(surfels.points_m)
    band_m = _GROUND_PER_HEIGHT * height_m
    above = rock & (over[:, 2] > band_m)
    level = rock & ~above & (surfels.normals @ interface.normal > LEVEL)
    if level.any() and above.any():
        beside_m = cKDTree(over[above, :2]).query(over[level, :2])[0]
        level[level] = beside_m > joined_within_m(surfels.points_m[rock])
    return _relabelled(points_m, parts, level, PEDESTAL)


def _relabelled(points_m: Array, parts: Segmentation, patches: Flags, to: int) -> Segmentation:
    """The same with another label of some patches (k,) and of the points that are theirs."""
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
