"""Sites of hazard files and rocks: their distances, and the choice of a site."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from toppling.models.arrays import Array
from toppling.models.errors import InputError
from toppling.models.files.documents import listed

SITE_REACH_KM = 30.0
"""Maximum distance of a hazard file's site from the requested location, km.

A grid of 0.3 degrees has a node within 24 km of every location, and published grids have 0.05 to 0.2 degrees. A site
farther away may lie on another side of a fault, with a different hazard.
"""
_SAME_SITE_KM = 0.2
"""Distance below which two locations are the same site, km: files print them with five decimals, some with two."""
EARTH_RADIUS_KM = 6371.0
"""Mean radius of the Earth, km."""
Place = tuple[float, float]
"""Longitude and latitude in degrees."""


def distance_km(longitude_deg: ArrayLike, latitude_deg: ArrayLike, site: tuple[float, float]) -> Array:
    """Great-circle distances from a site (longitude, latitude); longitudes are modulo 360 degrees."""
    east, north, here = (
        np.deg2rad(np.asarray(angle, float)) for angle in (longitude_deg, latitude_deg, site)
    )
    lengths = np.sin((north - here[1]) / 2) ** 2
    widths = np.cos(north) * np.cos(here[1]) * np.sin((east - here[0]) / 2) ** 2
    return 2.0 * EARTH_RADIUS_KM * np.arcsin(np.sqrt(np.minimum(lengths + widths, 1.0)))


def some_of(names: Sequence[str]) -> str:
    """List names in a message, abbreviated if there are many."""
    return listed(names, 12)


def check_place(asked: Place) -> None:
    """Raise InputError if longitude and latitude are out of range."""
    if not (-180 <= asked[0] <= 360 and -90 <= asked[1] <= 90):
        raise InputError(
            "site.out_of_range",
            what=f"{asked[0]:g} {asked[1]:g} is no place on Earth",
            where="--site",
            expected="a longitude of -180 to 360 degrees, then a latitude of -90 to 90",
            remedy="give the longitude first: --site LONGITUDE LATITUDE",
        )


def of_name(names: Sequence[str], asked: str, where: str) -> list[int]:
    """Indices of the sites with a name, ignoring case; InputError if there are none."""
    found = [number for number, name in enumerate(names) if name.casefold() == asked.casefold()]
    if not found:
        known = some_of([*dict.fromkeys(filter(None, names))]) or "none that has a name"
        raise InputError(
            "site.unknown",
            f"has no site called {asked!r}: it has {known}",
            where=where,
            expected="the name of one of its sites",
            remedy="give one of its names, or --site LONGITUDE LATITUDE",
        )
    return found


def nearest(sites: Sequence[Place], asked: Place, where: str) -> int:
    """Index of the site nearest to a location.

    Raises InputError if the coordinates are out of range, or the nearest site lies beyond `SITE_REACH_KM`.
    """
    check_place(asked)
    east, north = np.transpose(sites)
    away_km = distance_km(east, north, asked)
    number = int(away_km.argmin())
    if not away_km[number] <= SITE_REACH_KM:
        raise InputError(
            "site.too_far",
            what=f"the nearest site to {asked[0]:g} {asked[1]:g}, at longitude {sites[number][0]:g} and latitude "
            f"{sites[number][1]:g}, is {away_km[number]:.0f} km away",
            where=where,
            expected=f"a site within {SITE_REACH_KM:g} km",
            remedy="see that the longitude comes first, or compute the hazard at the rock",
        )
    return number


def same_place(first: Place | None, other: Place | None) -> bool:
    """Whether two locations may be the same: nearer than `_SAME_SITE_KM`, or one of them unknown."""
    return first is None or other is None or bool(distance_km(*first, other) <= _SAME_SITE_KM)
