"""Why a cloud itself may show no rock: too few points, plants, or so much noise that a crevice is lost in it."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from scipy.spatial import cKDTree

from toppling.models.arrays import Array, at_most
from toppling.models.errors import InputError
from toppling.models.scan.candidates import surfels_of
from toppling.models.scan.interface import fitted_plane
from toppling.models.scan.surfels import Surfels, in_plants

_SAMPLE = 5_000
_SPACINGS_PER_HEIGHT = 50
"""A rock so many times as high as points lie apart is split off and closed; of 30 it is not."""
_THICK = 0.18
"""Thickness over width of the median patch: noise of 0.01 of the relief makes it 0.13, of 0.015 0.23."""
_WIDTH_VOXELS = 1.1
"""Standard deviation of the places around a patch that its plane is fitted to."""
_LEAST_NOISES_PER_HEIGHT = 100
_PLANTS = 0.15
"""Share of the patches that are thick: at most 0.1 without plants, 0.2 to 0.7 where grass stands all around a rock."""
_OF_NOISE, _OF_EXTENT, _STRAYS = 8.0, 0.02, 20
"""All but so few points lie no farther off the plane through them than this many standard deviations of the noise,
and this share of the cloud's extent: of noise alone the farthest of a million lies 5 off."""


def with_reason(error: InputError, points_m: Array) -> InputError:
    """The same refusal of a cloud (n, 3) with what of its points may be the reason, and what would do."""
    if (of_plane := _without_relief(points_m)) is not None:
        return of_plane
    patches = surfels_of(points_m)
    return _with(error, _too_noisy(patches) or _grown_over(patches) or _too_few(points_m))


@contextmanager
def plants_named(points_m: Array) -> Iterator[None]:
    """What is refused within has the plants in a cloud (n, 3) as a reason, if it shows many."""
    try:
        yield
    except InputError as error:
        raise _with(error, _grown_over(surfels_of(points_m))) from error


def _with(error: InputError, told: tuple[str, str] | None) -> InputError:
    if told is None:
        return error
    what, remedy = told
    return InputError(
        f"{error.what}; {what}",
        where=error.where,
        expected=error.expected,
        remedy=f"{remedy}; else: {error.remedy}",
    )


def _grown_over(patches: Surfels) -> tuple[str, str] | None:
    share = float(in_plants(patches.points_m, patches.roughness).mean())
    if share < _PLANTS:
        return None
    return (
        f"{share:.0%} of the patches of the cloud are as thick as they are wide, as grass, twigs and rubble are: where "
        "these hide the rock's foot, what seems to be its pedestal is none",
        "crop plants from the cloud (CloudCompare's CSF or a filter of last returns leaves the ground), or clear the "
        "rock's foot and scan again",
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
