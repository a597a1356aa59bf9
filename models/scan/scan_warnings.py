"""Warnings of a scan: what was not seen, where rock and pedestal may be one, points off the closed surface.

Only what statics rules out is refused: a rock that does not stand, and one of which a side was not seen. All else that
speaks against a free block is one warning with what was seen, and a question to the user.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from toppling.models.arrays import Array, Flags, at_most
from toppling.models.errors import InputError
from toppling.models.frames import horizontal_unit_vector, quadrant_of, slope_of_normal
from toppling.models.hidden_base.near_interface import shown_sectors
from toppling.models.rock import Rock
from toppling.models.scan import o3d
from toppling.models.scan.candidates import LEAST_SURFELS, SURFACE_ROUGHNESS, neighbourhood
from toppling.models.scan.close import ClosedRock
from toppling.models.scan.interface import (
    Interface,
    ScanWarning,
    bearing_text,
    fit_interface,
    middle,
    sectors,
    widest_gap_deg,
)
from toppling.models.scan.interface_hint import OFF_PER_HEIGHT
from toppling.models.scan.segment import ROCK
from toppling.models.scan.surfels import SAMPLED, scene_of_rays
from toppling.models.scan.uncertainty import ObservedRock
from toppling.models.shapes import joined_parts
from toppling.models.smooth_mesh import CREASE_DEG

_MOST_INVENTED = 0.6
"""Share of the surface; with more of it invented known volumes came out off by half."""
_UPRIGHT = 0.7
"""Sine of the dip above which a patch belongs to a side."""
_UNSEEN_DEG = 130.0
"""Width from which an unseen range of the rim or the sides is reported: feet of a rock lie less than 180 degrees
apart."""
_MEET_VOXELS = 4.0
"""Patches of rock and pedestal so near to each other meet."""
_CREASED_FRACTION = 0.5
"""Fraction of the rim that was seen along which a crease must show."""
_TOUCHES_ABOVE = 0.2
"""Share of the rock's height above which what touches it is a warning."""
_OFF_SURFACE = 0.3
"""Widths of a patch by which half of the seen points may lie off the surface: noise is a tenth of it."""
_LEFT_OVER = 2.0
"""Widths of a patch off the closed surface from which on a patch is none of it."""


def warnings_of(
    observed: ObservedRock,
    interface: Interface,
    closed: ClosedRock,
    points_m: Array,
    label: NDArray[np.int8],
    origin_m: Array,
) -> list[ScanWarning]:
    """Warnings of a closed rock that was seen enough.

    Parameters
    ----------
    observed, interface, closed
        The rock, and where it meets its pedestal.
    points_m, label : (n, 3) and (n,) arrays
        The cloud, and the label of each point.
    origin_m : (3,) array
        Survey coordinates of the scene's origin.

    Raises
    ------
    InputError
        If most of the surface was not seen, or half of the points lie off it.
    """
    check_seen_enough(observed, interface, closed)
    found = [
        _contact(observed, interface),
        off_hint(observed, interface, origin_m),
        _off_surface(
            closed.rock, points_m[at_most(np.flatnonzero(label == ROCK), SAMPLED)], observed.surfels.voxel_m
        ),
        unseen_rim(observed, interface, closed.rock.com_m),
    ]
    return [warning for warning in found if warning is not None]


def check_seen_enough(observed: ObservedRock, interface: Interface, closed: ClosedRock) -> None:
    """Refuse a rock most of whose surface no station saw.

    Raises
    ------
    InputError
        With the range of directions in which none of its sides shows.
    """
    if closed.invented_share <= _MOST_INVENTED:
        return
    blind_deg, toward_deg = unseen_range(observed, interface)
    share = f"{closed.invented_share:.0%} of the rock's surface was not seen"
    if blind_deg >= _UNSEEN_DEG:
        share = (
            f"one side is not enough: {share}, none of its sides over {blind_deg:.0f} degrees about "
            f"{quadrant_of(toward_deg)}"
        )
    raise InputError(
        "rock.mostly_unseen",
        share,
        where="the rock",
        expected=f"a free-standing rock, at most {_MOST_INVENTED:.0%} of it unseen",
        remedy="scan it from the other sides; a rock that is embedded or buried is held by what surrounds it, and no "
        "toppling of a free block is its own",
    )


def unseen_range(observed: ObservedRock, interface: Interface) -> tuple[float, float]:
    """Widest range of directions, degrees, in which no side of the rock was seen, and its middle azimuth."""
    normals = observed.surfels.normals[observed.patches]
    side = np.hypot(*(normals @ interface.axes)[:, :2].T) > _UPRIGHT
    shown = shown_sectors(normals[side, :2])
    return widest_gap_deg(shown) if len(shown) else (360.0, 0.0)


def with_unseen_range(
    error: InputError, observed: ObservedRock, interface: Interface, origin_m: Array
) -> InputError:
    """Refusal of a rock whose surface does not close, with what was split as the rock and where it was not seen."""
    blind_deg, toward_deg = unseen_range(observed, interface)
    x, y = np.median(observed.surfels.points_m[observed.patches, :2], axis=0) + origin_m[:2]
    side = f"no side was seen over {blind_deg:.0f} degrees about {quadrant_of(toward_deg)}: "
    rock = f"of what was split as the rock, {observed.height_m:.2g} m high about {x:.2f}, {y:.2f}, "
    what = f"{rock}{side if blind_deg else ''}{error.what}"
    return InputError(**vars(error) | {"what": what})


def _creased_fraction(observed: ObservedRock, interface: Interface) -> float | None:
    """Share of the directions in which rock and pedestal were seen to meet where it is in a crease; None if unseen."""
    surfels, flat = observed.surfels, interface.flat(observed.surfels.points_m)
    low = observed.patches & (np.abs(flat[:, 2]) < 0.15 * observed.height_m)
    ground = ~observed.patches & (surfels.normals @ interface.normal > 0.0)
    if low.sum() < 3 or ground.sum() < 3:
        return None
    away, nearest = cKDTree(surfels.points_m[ground]).query(surfels.points_m[low])
    meet = away < _MEET_VOXELS * surfels.voxel_m
    if not meet.any():
        return None
    normals = np.einsum("ij,ij->i", surfels.normals[low][meet], surfels.normals[ground][nearest[meet]])
    angle = np.rad2deg(np.arccos(np.clip(normals, -1.0, 1.0)))
    sector = sectors(flat[low][meet, :2] - middle(flat[low]))
    # Normals of patches at the very crease are between those of its two sides.
    median_deg = [np.median(angle[sector == k]) for k in np.unique(sector)]
    return float((np.array(median_deg) > CREASE_DEG).mean())


def _contact(observed: ObservedRock, interface: Interface) -> ScanWarning | None:
    """A warning where the rock may be held: no crevice shows along its rim, or something touches it above its foot."""
    share, touch = _creased_fraction(observed, interface), _touched_above(observed, interface)
    found = []
    if share is not None and share < _CREASED_FRACTION:
        found.append(
            f"a crevice or crease between rock and pedestal shows along {share:.0%} of the rim that was seen: where "
            "none does the two may be one, or soil and plants cover the rim"
        )
    if touch.any():
        places = interface.flat(observed.surfels.points_m)
        direction = places[touch, :2].mean(axis=0) - places[observed.patches, :2].mean(axis=0)
        found.append(
            f"something touches the rock {np.median(places[touch, 2]):.2g} m above the interface, toward "
            f"{bearing_text(direction, interface)}"
        )
    if not found:
        return None
    return ScanWarning(
        "contact",
        f"{'; '.join(found)}. The answer is that of a free block: is it free? If the two meet elsewhere, say where by "
        "three places --point X,Y,Z; if they were separated already, give them as --rock and --pedestal",
    )


def _touched_above(observed: ObservedRock, interface: Interface) -> Flags:
    """Which patches (k,) of another surface touch the rock above its foot; strewn points and leaves are no surface."""
    surfels = observed.surfels
    high = interface.flat(surfels.points_m)[:, 2] > _TOUCHES_ABOVE * observed.height_m
    own, other = observed.patches & high, ~observed.patches & high & (surfels.roughness < SURFACE_ROUGHNESS)
    edges = neighbourhood(surfels.points_m, surfels.voxel_m)
    part = joined_parts(edges[other[edges].all(axis=1)], len(other))
    other &= (np.bincount(part, other)[part] >= LEAST_SURFELS) & own.any()
    if other.any():
        away_m = cKDTree(surfels.points_m[own]).query(surfels.points_m[other])[0]
        other[other] = away_m < 2.0 * surfels.voxel_m
    return other


def off_hint(observed: ObservedRock, interface: Interface, origin_m: Array) -> ScanWarning | None:
    """A warning where the pedestal that was seen beside the rock lies off the interface that the user gave."""
    if observed.hint is None:
        return None
    try:
        seen = fit_interface(observed.surfels, observed.patches)
    except InputError:  # next to nothing of it was seen, which is what hints are for
        return None
    bottom = interface.flat(observed.low_m) * [1.0, 1.0, 0.0]
    rises_m = -seen.flat(interface.scene(bottom))[:, 2]
    low_m, high_m = float(rises_m.min()), float(rises_m.max())
    if max(-low_m, high_m) < OFF_PER_HEIGHT * observed.height_m:
        return None
    dip_deg, toward_deg = slope_of_normal(seen.normal)
    x, y, z = seen.point_m + origin_m
    return ScanWarning(
        "hint",
        f"below the rock the pedestal that was seen beside it lies {low_m:+.2g} to {high_m:+.2g} m over the interface "
        f"that is given, and dips by {dip_deg:.1f} degrees toward {quadrant_of(toward_deg)}: one too high cuts "
        f"the rock's foot off, one too low adds to it. What was seen is --plane {x:.2f} {y:.2f} {z:.2f} {dip_deg:.1f} "
        f"{toward_deg:.0f}",
    )


def _off_m(rock: Rock, places_m: Array) -> Array:
    """How far places (n, 3) lie off a rock's surface (n,)."""
    scene = scene_of_rays((rock.vertices_m, rock.faces))
    return scene.compute_distance(o3d.core.Tensor.from_numpy(places_m.astype(np.float32)), nthreads=1).numpy()


def left_over(rock: Rock, observed: ObservedRock) -> tuple[Flags, list[ScanWarning]]:
    """Which patches (k,) were split as the rock's and lie off the surface that closes about the others; and a warning.

    Of rocks alone so far off are one in a thousand, mixed pixels; of a bush nearly all.
    """
    patches, found = np.flatnonzero(observed.patches), np.zeros(len(observed.patches), bool)
    off_m = _off_m(rock, observed.surfels.points_m[patches])
    found[patches] = off_m > _LEFT_OVER * observed.surfels.voxel_m
    if found.sum() < LEAST_SURFELS:
        return found, []
    return found, [
        ScanWarning(
            "left_over",
            f"{found.sum() / len(patches):.1%} of what was split as the rock lies off the surface closed about the "
            f"rest, by up to {off_m.max():.2g} m, as plants do: it is left out. If it is of the rock, scan what joins "
            "them, or give the two as --rock and --pedestal",
        )
    ]


def _off_surface(rock: Rock, seen_m: Array, voxel_m: float) -> ScanWarning | None:
    """A warning where the rock's points lie off the surface closed about them; refused from a patch's width on."""
    off_m = float(np.median(_off_m(rock, seen_m)))
    if off_m < _OFF_SURFACE * voxel_m:
        return None
    what = f"half of the rock's points lie more than {off_m:.2g} m off its closed surface"
    if off_m > voxel_m:
        raise InputError(
            "scan.not_closed",
            what,
            where="closing the rock",
            expected=f"a surface through the points, within the {voxel_m:.2g} m of a patch",
            remedy="the rock was split from its surroundings where it does not end, or its stations do not fit: say "
            "where it meets its pedestal by three places --point X,Y,Z, or leave stations out one by one",
        )
    return ScanWarning(
        "surface",
        f"{what}: noise, or a surface that was seen twice, by stations that do not fit each other or two "
        "registrations in one cloud. Register the stations anew, or leave one of the two out",
    )


def unseen_rim(observed: ObservedRock, interface: Interface, com_m: Array) -> ScanWarning | None:
    """A warning where the rim was not seen over a wide range of directions about the line of the weight."""
    if observed.hint is not None and observed.hint.encloses:
        return None
    places = interface.over(observed.low_m)[:, :2] - interface.projected_m(com_m[None])[0]
    range_deg, toward_deg = widest_gap_deg(np.unique(sectors(places)))
    if range_deg < _UNSEEN_DEG:
        return None
    toward = bearing_text(horizontal_unit_vector(toward_deg)[:2], interface)
    return ScanWarning(
        "rim",
        f"the rock's rim was not seen over {range_deg:.0f} degrees about {toward}: contacts were drawn there as if the "
        "outline that was seen went on. A station toward there would tell the most",
    )
