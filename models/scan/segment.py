"""Segmentation: which of the things that stand in a cloud is meant, and where it ends above its pedestal."""

from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, cKDTree

from toppling.models.arrays import Array, Flags, Indices, bounds_of, inside_box, inside_cylinder
from toppling.models.errors import InputError
from toppling.models.scan.candidates import (
    JOINED_SPACINGS,
    JOINED_VOXELS,
    LEAST_PEAK_VOXELS,
    LEAST_SURFELS,
    Candidate,
    cut_between,
    find_candidates,
    highest,
    joined_rock,
    minimum_cut,
    parted,
    surface_edges,
    surfels_of,
    thing_and_rest,
)
from toppling.models.scan.interface import Interface
from toppling.models.scan.interface_hint import InterfaceHint, points_text, seen_about_points
from toppling.models.scan.surfels import FEW_SAMPLED, LEVEL, Surfels, orient, roughness, thin
from toppling.models.shapes import joined_parts

_RIVAL_SHARE = 0.6
"""Least height, over the first candidate's, of a second one that may be the rock that is meant."""
_NEAR_HEIGHTS = 1.5
"""Largest distance, in its heights, of a candidate from where the user points."""
_CIRCLES = (0.2, 0.08, 0.032, 0.0128)
"""Radii about a named place, over the cloud's extent; a circle with fewer points than a sample shows no rock."""
_TURNED_BACK = 0.5
"""Cosine to the way out of the survey below which the normal of a patch at its end shows that a thing ends there."""


def choose(candidates: list[Candidate], near_m: Array | None, origin_m: Array, coarse: Surfels) -> Candidate:
    """Pick the one thing that stands there, or the one nearest to where the user points.

    Raises InputError where the evidence does not decide: what was seen, and the one hint that would.
    """
    if not candidates:
        raise _nothing_stands(coarse, origin_m)
    chosen = candidates[0] if near_m is None else _nearest(candidates, near_m, origin_m)
    rivals = [c for c in candidates if c is not chosen and c.height_m > _RIVAL_SHARE * chosen.height_m]
    if near_m is None and rivals:
        what = f"{1 + len(rivals)} things of like size stand there"
        raise _several(f"{what}, tops at x, y: {_tops([chosen, *rivals], origin_m)}")
    if _ends_with_survey(chosen, coarse):
        raise InputError(
            "scan.cut_by_survey",
            f"what stands there, {chosen.height_m:.2g} m high, ends where the cloud ends along more of its outline "
            "than at a crease or gap: it may be a cliff behind the rock",
            where="segmentation",
            expected="a rock that was seen to end on all sides",
            remedy="crop the cloud to the rock and what it stands on, without what is behind it, or give the rock and "
            "the rest as --rock and --pedestal",
        )
    bodies = _side_by_side(chosen) if chosen.rivals else []
    if len(bodies) > 1:
        if near_m is None:
            raise _several(_touching(chosen.surfels, bodies, chosen.rock, origin_m))
        return chosen
    if chosen.rivals:
        seen = [
            f"{thing.height_m:.3g} m high above "
            + " ".join(f"--point {x:.2f},{y:.2f},{z:.2f}" for x, y, z in places)
            for thing in (chosen, *chosen.rivals)
            for places in [_three_of(thing.loop_m) + origin_m]
        ]
        raise InputError(
            "scan.several_creases",
            f"by the creases and gaps around it one thing may end at several heights: it is {', or '.join(seen)}",
            where="segmentation",
            expected="one crease, or a hint which one parts the rock from its pedestal",
            remedy="give the three --point of one of them, as printed here, or click three places where the two meet "
            "with --pick",
        )
    return chosen


def _ends_with_survey(thing: Candidate, coarse: Surfels) -> bool:
    """Whether a thing ends along more of the survey's outline, without turning back there, than of a crease or gap."""
    lines = ConvexHull(coarse.points_m[:, :2]).equations
    inward_m = -(thing.surfels.points_m[thing.rock, :2] @ lines[:, :2].T + lines[:, 2])
    facing = np.einsum("ij,ij->i", thing.surfels.normals[thing.rock, :2], lines[inward_m.argmin(axis=1), :2])
    at_end = (inward_m.min(axis=1) < JOINED_VOXELS * coarse.voxel_m) & (facing < _TURNED_BACK)
    return int(at_end.sum()) > len(thing.loop_m) > 0


def _side_by_side(thing: Candidate) -> list[Flags]:
    """Bodies (n,) of a thing that touch each other, if none lies over the middle of another: a click names one of them.

    Its creases at several heights are then no question: what is cut off with the others is parted from them.
    """
    surfels = thing.surfels
    bodies, _ = parted(surfels, surface_edges(surfels), thing.rock)
    outside_m = [
        _outside_m(surfels, body, np.median(surfels.points_m[other, :2], axis=0))
        for body, other in permutations(bodies, 2)
    ]
    return bodies if all(outside_m) else []


def _outside_m(surfels: Surfels, body: Flags, place_m: Array) -> float:
    """How far a place (2,) lies outside the convex outline of a body's patches (n,) in plan view, 0 within."""
    lines = ConvexHull(surfels.points_m[body, :2]).equations
    return max(float((lines[:, :2] @ place_m + lines[:, 2]).max()), 0.0)


def _touching(surfels: Surfels, bodies: list[Flags], rock: Flags, origin_m: Array) -> str:
    """Which bodies (n,) of a rock touch each other, in words."""
    return f"{len(bodies)} bodies touch each other there: {_where(surfels, bodies, rock, origin_m)}"


def _where(surfels: Surfels, parts: list[Flags], rock: Flags, origin_m: Array) -> str:
    """Sizes and places of parts (n,) of a rock, in words."""
    return ", and ".join(
        "{:.0%} of the patches about {:.2f}, {:.2f}, {:.2f}".format(
            part.sum() / rock.sum(), *(np.median(surfels.points_m[part], axis=0) + origin_m)
        )
        for part in parts
    )


def _several(seen: str) -> InputError:
    return InputError(
        "scan.several_rocks",
        f"more than one may be the rock: {seen}",
        where="segmentation",
        expected="one rock, or a hint which one",
        remedy="click on one with --pick, name one by --near X Y in survey coordinates, as printed here, or crop "
        "the cloud",
    )


def _three_of(loop_m: Array) -> Array:
    """Three places (3, 3) of a loop (k, 3), a third of a turn apart."""
    turn = np.arctan2(*(loop_m[:, :2] - loop_m[:, :2].mean(axis=0)).T[::-1])
    return loop_m[[np.cos(turn - way).argmax() for way in np.deg2rad([0, 120, 240])]]


def _nothing_stands(coarse: Surfels, origin_m: Array) -> InputError:
    x, y, z = coarse.points_m[np.argmax(coarse.points_m[:, 2])] + origin_m
    size = np.ptp(coarse.points_m, axis=0)
    return InputError(
        "scan.nothing_stands",
        f"nothing in the cloud stands on anything: patches of {coarse.voxel_m:.2g} m, about "
        f"{np.median(coarse.roughness):.0%} as thick as wide, show no thing with a crevice or crease around it in its "
        f"{size[0]:.3g} by {size[1]:.3g} m, {size[2]:.3g} m from its lowest to its highest",
        where="segmentation",
        expected="a rock above a crevice or narrowing, seen from several sides with some of its pedestal",
        remedy="point at the rock by a click with --pick or by --near X Y; the cloud's highest place is --near "
        f"{x:.2f} {y:.2f}, at z {z:.2f}. A rock less than {LEAST_PEAK_VOXELS * coarse.voxel_m:.2g} m high is found "
        "from near by alone. Or say where the two meet by three places --point X,Y,Z around the contact. Check "
        "that z points up. Where patches are a fifth as thick as wide, noise, plants or rubble hide the crevice: scan "
        "from nearer, or leave out far stations, plants and returns at grazing angles",
    )


def _lies_on(near_m: Array, things: list[Candidate]) -> bool:
    """Whether a place (2,) lies on one of some things in plan view."""
    return any(_away_m(thing, near_m) == 0.0 for thing in things)


def _away_m(thing: Candidate, near_m: Array) -> float:
    """How far a place (2,) lies from a thing in plan view, 0 on its patches."""
    away = np.hypot(*(thing.surfels.points_m[thing.rock, :2] - near_m).T).min()
    return max(float(away) - JOINED_VOXELS * thing.surfels.voxel_m, 0.0)


def look_around(
    points_m: Array, near_m: Array, coarse: Surfels, candidates: list[Candidate]
) -> tuple[Surfels, list[Candidate]]:
    """Patches and what stands in ever smaller circles around a place, the first ones in which something is near it."""
    away = np.hypot(*(points_m[:, :2] - near_m).T)
    extent_m = float(np.ptp(coarse.points_m[:, :2], axis=0).max())
    for share in _CIRCLES:
        around = points_m[away < share * extent_m]
        if len(around) < FEW_SAMPLED:
            break
        closer = surfels_of(around)
        found = find_candidates(around, closer)
        if _lies_on(near_m, found):
            return closer, found
    return coarse, candidates


def _nearest(standing: list[Candidate], near_m: Array, origin_m: Array) -> Candidate:
    """Pick what the user points at, the highest of those, or what is nearest to it, if that is near."""
    away = [_away_m(thing, near_m) for thing in standing]
    first = int(np.argmin(away))
    if away[first] > _NEAR_HEIGHTS * standing[first].height_m:
        raise InputError(
            "scan.nothing_near",
            f"the nearest thing there is {away[first]:.3g} m away and {standing[first].height_m:.2g} m high",
            where="--near",
            expected=f"a place within {_NEAR_HEIGHTS} heights of a thing; those found, tops at x, y: "
            + _tops(standing, origin_m),
            remedy="name one of them by --near X Y in survey coordinates; if yours is not among them, crop the cloud "
            "to it and its pedestal",
        )
    return standing[first]


def _tops(candidates: list[Candidate], origin_m: Array) -> str:
    """Where things stand, survey coordinates."""
    return "; ".join(
        "{:.1f}, {:.1f} ({:.2g} m high)".format(*(c.top_m + origin_m)[:2], c.height_m) for c in candidates
    )


ROCK, PEDESTAL, NEITHER = 0, 1, 2

_FINE_VOXELS_PER_HEIGHT = 100
_APART_VOXELS = 1.5
"""Distance of the fourth patch from a place, in their width, from which on they leave gaps: 1.1 where they touch."""
_CLUTTER_ROUGHNESS = 0.6
"""Median thickness over width above which a neighbourhood is clutter."""
_SHEET_ROUGHNESS = 0.3
"""Thickness over width of a fine voxel's neighbourhood among clutter, below which it lies on a surface: the ground
below a bush, a wall's edge."""
_LABELLING_POINTS = 20
"""Number of points for each patch that decide its label."""
_OVER_VOXELS = 2.0
"""Height over a surface beyond which points do not belong to it."""
_GROUND_PER_HEIGHT = 0.03
"""The ground beside a rock rises no higher over the interface."""
_FEWEST_OF_A_SURFACE = 100
"""Least number of points of a surface among clutter."""


@dataclass(frozen=True, eq=False)
class Segmentation:
    """Labels of all points and of the surfels around the rock."""

    label: NDArray[np.int8]  # (n,): per point: 0 rock, 1 pedestal, 2 neither
    surfels: Surfels  # around the rock (`patches_around`)
    surfel_label: NDArray[np.int8]  # (k,)
    # list of (x, y, z, height): other things that stand there, metres.
    others: list[tuple[float, float, float, float]]
    # What touches the rock, and whether it was taken with it; which interface was taken instead of the user's.
    notes: tuple[str, ...] = ()
    hint: InterfaceHint | None = None  # where the rock was split, none where a crease was seen to part it


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
    candidates = find_candidates(points_m, coarse) if hint is None or hint.kind == "points" else []
    if hint is not None:
        at_crease = _at_crease(hint, candidates)
        if at_crease is not None:
            return _refine(points_m, coarse, at_crease, [], origin_m, near_m)
        parts = _refine(points_m, coarse, _standing_on(coarse, hint, near_m), [], origin_m, near_m, hint)
        seen = at_seen(parts)
        if seen.hint is None or seen.hint is hint:
            return parts
        thing = _standing_on(coarse, seen.hint, near_m)
        again = _refine(points_m, coarse, thing, [], origin_m, near_m, seen.hint)
        return replace(again, notes=(*again.notes, seen.notes[-1]))
    # A rock that is small in its cloud shows in patches made around it alone: where points lie densest, unless named.
    place_m = np.median(points_m[:, :2], axis=0) if near_m is None and not candidates else near_m
    if place_m is not None and not _lies_on(place_m, candidates):
        coarse, candidates = look_around(points_m, place_m, coarse, candidates)
    chosen = choose(candidates, near_m, origin_m, coarse)
    return _refine(points_m, coarse, chosen, [c for c in candidates if c is not chosen], origin_m, near_m)


def _standing_on(surfels: Surfels, hint: InterfaceHint, near_m: Array | None) -> Candidate:
    """Cut off what stands on the interface that the user names: where they point, or else nearest to its anchors."""
    edges = surface_edges(surfels)
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
    peak = highest(chosen, height)
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


def _at_crease(hint: InterfaceHint, candidates: list[Candidate]) -> Candidate | None:
    """What stands above that of several creases around one thing on which the places lie that the user names.

    They answer which is meant, and where it runs was seen. None where there are not several, or on none of them.
    """
    things = [thing for thing in candidates if thing.rivals]
    seen = [cut for thing in things for cut in (thing, *thing.rivals) if not cut.hidden]
    off = [cKDTree(cut.loop_m).query(hint.anchors_m)[0].max() / cut.surfels.voxel_m for cut in seen]
    return seen[int(np.argmin(off))] if off and min(off) < JOINED_VOXELS else None


def at_seen(parts: Segmentation) -> Segmentation:
    """The same parts with the pedestal's plane as it was seen, where that is known better than by the user's places."""
    hint = parts.hint
    seen = None if hint is None else seen_about_points(hint, parts.surfels, parts.surfel_label == ROCK)
    if hint is None or seen is None:
        return parts
    return replace(parts, hint=seen, notes=(*parts.notes, points_text(hint, seen.interface)))


def _off(code: str, hint: InterfaceHint, what: str, remedy: str) -> InputError:
    where = f"the interface's {hint.kind}"
    return InputError(
        code, what, where=where, expected="a plane below the rock, above the rest", remedy=remedy
    )


def patches_around(points_m: Array, rock_m: Array, height_m: float) -> tuple[Surfels, Indices, Indices]:
    """Patches around a rock, the points that they are of, and the patch of each.

    They are a hundredth of its height wide, or as far apart as its points where these lie farther apart.
    """
    axis = rock_m[:, :2].mean(axis=0)
    radius = float(np.hypot(*(rock_m[:, :2] - axis).T).max())
    # As deep as a wide rock's overhang may hang over land.
    lowest = rock_m[:, 2].min() - max(0.7 * height_m, radius)
    around = inside_cylinder(points_m, axis, radius + 0.5 * height_m, lowest)
    voxel = height_m / _FINE_VOXELS_PER_HEIGHT
    thinned, index = thin(points_m[around], voxel)
    apart_m = float(np.median(cKDTree(thinned).query(rock_m, 4)[0][:, 3]))
    if apart_m > _APART_VOXELS * voxel:
        voxel = apart_m
        thinned, index = thin(points_m[around], voxel)
    return orient(thinned, voxel), around, index


def _refine(
    points_m: Array,
    coarse: Surfels,
    chosen: Candidate,
    others: list[Candidate],
    origin_m: Array,
    near_m: Array | None,
    hint: InterfaceHint | None = None,
) -> Segmentation:
    """Cut again at a hundredth of the rock's height, and label every point."""
    rock = chosen.surfels.points_m[chosen.rock]
    surfels, around, index = patches_around(points_m, rock, chosen.height_m)
    voxel = surfels.voxel_m
    edges = surface_edges(surfels)
    votes = chosen.share_around(surfels.points_m)
    seeds, far, over = votes == 1.0, votes == 0.0, None
    if hint is not None:
        over = hint.interface.flat(surfels.points_m)[:, 2]
        # An underside may reach below the plane that a few places beside it tell, and is no top of a pedestal.
        below = (over < -2.0 * voxel) & (surfels.normals @ hint.interface.normal > 0.0)
        seeds, far = seeds & (over > 2.0 * voxel), far | below
    fine_rock = minimum_cut(surfels, edges, seeds, far, over)
    meant, note = _meant(surfels, edges, fine_rock, near_m, hint is not None, origin_m)
    surfel_label = np.where(meant, ROCK, PEDESTAL).astype(np.int8)
    surfel_label[meant & ~joined_rock(surfels.points_m, meant, meant & seeds)] = NEITHER
    # What hangs together with the rest through the rock alone lies on it.
    part = joined_parts(edges[~meant[edges].any(axis=1)], len(meant))
    surfel_label[fine_rock & ~meant & (np.bincount(part, far)[part] == 0.0)] = NEITHER
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
        (note,) if note else (),
        hint,
    )


def _meant(
    surfels: Surfels, edges: Indices, rock: Flags, near_m: Array | None, hinted: bool, origin_m: Array
) -> tuple[Flags, str]:
    """Which patches (n,) of a rock are those of the body that is meant, and what touches it, in words."""
    bodies, parts = parted(surfels, edges, rock)
    if len(bodies) == 1:
        remedy = "if these are two bodies, give that which is meant and the rest as --rock and --pedestal"
        seen = _where(surfels, parts, rock, origin_m)
        return rock, f"a crease parts the rock in two, {seen}: {remedy}" if parts else ""
    what = _touching(surfels, bodies, rock, origin_m)
    if near_m is None and hinted:
        return rock, f"{what}; they are taken as one rock, or name one by --near X Y"
    if near_m is None:
        raise _several(what)
    nearest = int(np.argmin([_outside_m(surfels, body, near_m) for body in bodies]))
    return bodies[nearest], f"{what}; the rock is that at --near X Y, without the rest"


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
    outside = (over[:, :2] @ outline[:, :2].T + outline[:, 2]).max(axis=1) > clear
    seeds, far = rock & (over[:, 2] > clear), ~rock & (outside | (over[:, 2] < -clear))
    if not seeds.any() or not far.any():
        return parts
    edges = surface_edges(surfels)
    found = minimum_cut(surfels, edges, seeds, far, over[:, 2])
    return relabelled(points_m, parts, found & ~rock & (over[:, 2] > clear), ROCK)


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
        distance_m, nearest = cKDTree(over[above, :2]).query(over[level, :2])
        level[level] = distance_m > JOINED_SPACINGS * np.minimum(own[level], own[above][nearest])
    return relabelled(points_m, parts, level, PEDESTAL)


def relabelled(points_m: Array, parts: Segmentation, patches: Flags, to: int) -> Segmentation:
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
