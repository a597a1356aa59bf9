"""Which of the things that stand in a cloud is meant, and what to tell the user where nobody can say or none shows."""

import numpy as np
from scipy.spatial import cKDTree

from toppling.models.arrays import Array, at_most
from toppling.models.errors import InputError
from toppling.models.scan.candidates import (
    LEAST_PEAK_VOXELS,
    Candidate,
    find_candidates,
    surfels_of,
)
from toppling.models.scan.interface import fitted_plane
from toppling.models.scan.surfels import Surfels

_RIVAL_SHARE = 0.6
"""A second thing of this share of the first one's height may be the rock that is meant."""
_NEAR_HEIGHTS = 1.5
"""What is farther from where the user points than this many of its heights is not meant."""
_JOINED_VOXELS = 3.0
"""Patches so near to each other are neighbours."""
_CIRCLES, _FEWEST_AROUND = (0.2, 0.08, 0.032, 0.0128), 5000
"""Radii about a named place, over the cloud's extent; with fewer points a circle shows no rock."""


def choose(candidates: list[Candidate], near_m: Array | None, origin_m: Array, coarse: Surfels) -> Candidate:
    """Pick the one thing that stands there, or the one nearest to where the user points.

    Raises InputError where the evidence does not decide: what was seen, and the one hint that would.
    """
    if not candidates:
        raise _nothing_stands(coarse, origin_m)
    chosen = candidates[0] if near_m is None else _nearest(candidates, near_m, origin_m)
    rivals = [c for c in candidates if c is not chosen and c.height_m > _RIVAL_SHARE * chosen.height_m]
    if near_m is None and rivals:
        raise InputError(
            "scan.several_rocks",
            f"{1 + len(rivals)} things of like size stand there, tops at x, y: {_tops([chosen, *rivals], origin_m)}",
            where="segmentation",
            expected="one rock, or a hint which one",
            remedy="click on one with --pick, name one by --near X Y in survey coordinates, as printed here, or crop "
            "the cloud",
        )
    if chosen.rivals:
        each = [chosen, *chosen.rivals]
        z = [float(np.median(thing.loop_m[:, 2]) + origin_m[2]) for thing in each]
        raise InputError(
            "scan.several_creases",
            "a crease goes around one thing at several heights: as a rock it is "
            + ", or ".join(
                f"{thing.height_m:.3g} m high from z {up:.2f} on" for thing, up in zip(each, z, strict=True)
            ),
            where="segmentation",
            expected="one crease, or a hint which one parts the rock from its pedestal",
            remedy="click three places where the two meet with --pick, or name them by --point X,Y,Z",
        )
    return chosen


def _nothing_stands(coarse: Surfels, origin_m: Array) -> InputError:
    x, y, z = coarse.points_m[np.argmax(coarse.points_m[:, 2])] + origin_m
    size = np.ptp(coarse.points_m, axis=0)
    return InputError(
        "scan.nothing_stands",
        f"nothing in the cloud stands on anything: patches of {coarse.voxel_m:.2g} m show no thing with a crevice or "
        f"crease around it in its {size[0]:.3g} by {size[1]:.3g} m, {size[2]:.3g} m from its lowest to its highest",
        where="segmentation",
        expected="a rock above a crevice or narrowing, seen from several sides with some of its pedestal",
        remedy="point at the rock by a click with --pick or by --near X Y; the cloud's highest place is --near "
        f"{x:.2f} {y:.2f}, at z {z:.2f}. A rock less than {LEAST_PEAK_VOXELS * coarse.voxel_m:.2g} m high is found "
        "from near by alone. Or say where the two meet by three places --point X,Y,Z around the contact. Check "
        "that z points up",
    )


def lies_on(near_m: Array, things: list[Candidate]) -> bool:
    """Whether a place (2,) lies on one of some things in plan view."""
    return any(_away_m(each, near_m) == 0.0 for each in things)


def _away_m(thing: Candidate, near_m: Array) -> float:
    """How far a place (2,) lies from a thing in plan view, 0 on its patches."""
    away = np.hypot(*(thing.surfels.points_m[thing.rock, :2] - near_m).T).min()
    return max(float(away) - _JOINED_VOXELS * thing.surfels.voxel_m, 0.0)


def look_around(
    points_m: Array, near_m: Array, coarse: Surfels, candidates: list[Candidate]
) -> tuple[Surfels, list[Candidate]]:
    """Patches and what stands in ever smaller circles around a place, the first ones in which something is near it."""
    away = np.hypot(*(points_m[:, :2] - near_m).T)
    extent_m = float(np.ptp(coarse.points_m[:, :2], axis=0).max())
    for share in _CIRCLES:
        around = points_m[away < share * extent_m]
        if len(around) < _FEWEST_AROUND:
            break
        closer = surfels_of(around)
        found = find_candidates(around, closer)
        if lies_on(near_m, found):
            return closer, found
    return coarse, candidates


def _nearest(standing: list[Candidate], near_m: Array, origin_m: Array) -> Candidate:
    """Pick what the user points at, the highest of those, or what is nearest to it, if that is near."""
    away = [_away_m(each, near_m) for each in standing]
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


_SAMPLE = 5_000
_SPACINGS_PER_HEIGHT = 50
"""A rock so many times as high as points lie apart is split off and closed; of 30 it is not."""
_THICK = 0.18
"""Thickness over width of the median patch: noise of 0.01 of the relief makes it 0.13, of 0.015 0.23."""
_WIDTH_VOXELS = 1.1
"""Standard deviation of the places around a patch that its plane is fitted to."""
_LEAST_NOISES_PER_HEIGHT = 100
_OF_NOISE, _OF_EXTENT, _STRAYS = 8.0, 0.02, 20
"""All but so few points lie no farther off the plane through them than this many standard deviations of the noise,
and this share of the cloud's extent."""


def with_reason(error: InputError, points_m: Array) -> InputError:
    """Refusal of a cloud (n, 3) with what of its points may be the reason, and the remedy."""
    if (of_plane := _without_relief(points_m)) is not None:
        return of_plane
    patches = surfels_of(points_m)
    return _with(error, _too_noisy(patches) or _too_few(points_m))


def _with(error: InputError, told: tuple[str, str] | None) -> InputError:
    if told is None:
        return error
    what, remedy = told
    return InputError(
        error.code,
        f"{error.what}; {what}",
        where=error.where,
        expected=error.expected,
        remedy=f"{remedy}; else: {error.remedy}",
    )


def _without_relief(points_m: Array) -> InputError | None:
    """The refusal of a wall, a floor or a slope: nothing stands out of its plane but noise."""
    every = at_most(points_m, _SAMPLE)
    plane = fitted_plane(every)
    off_m = np.abs((points_m - plane.point_m) @ plane.normal)
    noise_m = 1.4826 * float(np.median(off_m))
    strays = min(_STRAYS, len(off_m))
    farthest_m = float(np.partition(off_m, -strays)[-strays])
    extent_m = float(np.ptp(every, axis=0).max())
    if farthest_m > min(_OF_NOISE * noise_m, _OF_EXTENT * extent_m):
        return None
    dip_deg = np.rad2deg(np.arccos(min(abs(plane.normal[2]), 1.0)))
    return InputError(
        "scan.no_relief",
        f"nothing in the cloud stands on anything: all of it lies within {farthest_m:.2g} m of a plane that dips by "
        f"{dip_deg:.0f} degrees, as a floor, a slope or a wall does",
        where="segmentation",
        expected="a rock that stands on a pedestal",
        remedy="give the clouds that show the rock as well, or a larger part of them",
    )


def _too_few(points_m: Array) -> tuple[str, str] | None:
    every = at_most(points_m, _SAMPLE)
    spacing_m = float(np.median(cKDTree(points_m).query(every, min(5, len(points_m)))[0][:, -1]))
    relief_m = float(np.ptp(np.quantile(points_m[:, 2], [0.001, 0.999])))
    if _SPACINGS_PER_HEIGHT * spacing_m < relief_m:
        return None
    return (
        f"the cloud has few points: they lie about {spacing_m:.2g} m apart, and show rocks of "
        f"{_SPACINGS_PER_HEIGHT * spacing_m:.2g} m and more",
        f"give all stations and clouds that were not thinned: points a {_SPACINGS_PER_HEIGHT}th of the rock's height "
        "apart or nearer",
    )


def _too_noisy(patches: Surfels) -> tuple[str, str] | None:
    thick = float(np.median(patches.roughness))
    if thick < _THICK:
        return None
    off_m = thick * _WIDTH_VOXELS * patches.voxel_m
    return (
        f"the cloud is noisy or rough: its patches of {patches.voxel_m:.2g} m lie about {off_m:.2g} m off the surface "
        "through those around them, from noise, plants or rubble",
        f"give a cloud with less noise than a {_LEAST_NOISES_PER_HEIGHT}th of the rock's height: scan from nearer, "
        "average repeated scans, leave out far stations, plants and returns at grazing angles",
    )
