"""Doubts in where a rock meets its pedestal: grown together, grass or a filled crevice between, sunk."""

import numpy as np
from scipy.spatial import cKDTree

from toppling.models.arrays import Array, Indices
from toppling.models.errors import InputError
from toppling.models.frames import horizontal_unit_vector, slope_of_normal
from toppling.models.scan.doubt import (
    SECTORS,
    Doubt,
    azimuth_told,
    direction_told,
    median_by_sector,
    middle,
    sectors,
    widest_gap_deg,
)
from toppling.models.scan.interface import Interface, fit_interface
from toppling.models.scan.interface_hint import OFF_PER_HEIGHT
from toppling.models.scan.measure import ObservedRock

_NEAR_VOXELS = 4.0
"""Patches of rock and pedestal so near to each other meet."""
_CREASE_DEG = 20.0
"""Where rock and pedestal meet at less than this, the surface goes on from one to the other."""
_ATTACHED_SHARE, _TOLD_SHARE = 0.2, 0.5
"""Share of the rim that was seen along which a crease must show: less is no block, or is told."""
_FOOT, _SIDE = (0.01, 0.02), (0.1, 0.2)
"""Of the rock's height above the interface: where a rounded foot still faces upward, and where a side begins."""
_ROUNDED_DEG, _TURN_DEG = 12.0, 10.0
"""A foot is rounded that faces so far up, and so much farther than the side above it: patches blur a sharp crease."""
_ROUNDED_TOLD, _ROUNDED_REFUSED = 0.5, 0.8
"""Share of the directions around the rock."""
_LEAST_SEEN = 0.25
"""Of the directions: in fewer a foot tells nothing."""
SPARSE = 1.5
"""Patches so much farther apart than they are wide show neither a crevice nor a rounded foot."""


def attached(observed: ObservedRock, interface: Interface, parted: bool) -> Doubt | None:
    """A doubt where no crease parts rock and pedestal along the rim, or the rim is rounded.

    parted: whether the user has said where rock and pedestal meet, or which is which.
    Raises InputError if hardly any crease shows, or nearly all of the rim is rounded and the user has said nothing
    of it.
    """
    share = creased_share(observed, interface)
    expected = what = ""
    if share is not None and share < _TOLD_SHARE:
        what = f"no crevice or crease shows along {1.0 - share:.0%} of the seen rim between rock and pedestal"
        if share < _ATTACHED_SHARE:
            expected = f"a crease along at least {_ATTACHED_SHARE:.0%} of the rim"
    elif (rounded := rounded_share(observed, interface)) >= _ROUNDED_TOLD:
        what = (
            f"the rock curves outward into its pedestal along {rounded:.0%} of the seen rim, without a crease"
        )
        if rounded >= _ROUNDED_REFUSED and not parted:
            expected = f"a sharp rim along more than {1.0 - _ROUNDED_REFUSED:.0%}, as where two bodies meet"
    if expected:
        raise InputError(
            "rock.goes_on_below",
            f"{what}: the rock goes on into its pedestal",
            where="the interface",
            expected=expected,
            remedy="a rock that is attached does not topple as a free block; if it is not (soil or debris may cover "
            "the rim), the interface lies elsewhere: give it by --plane, --point or --outline",
        )
    told = f"{what}: if it is attached there, its strength is not in the answer, which is then too low"
    return Doubt("attached", told) if what else None


def creased_share(observed: ObservedRock, interface: Interface) -> float | None:
    """Share of the directions in which rock and pedestal were seen to meet where it is in a crease; None if unseen."""
    surfels, flat = observed.surfels, interface.flat(observed.surfels.points_m)
    low = observed.patches & (np.abs(flat[:, 2]) < 0.15 * observed.height_m)
    ground = ~observed.patches & (surfels.normals @ interface.normal > 0.0)
    if low.sum() < 3 or ground.sum() < 3:
        return None
    away, nearest = cKDTree(surfels.points_m[ground]).query(surfels.points_m[low])
    meet = away < _NEAR_VOXELS * surfels.voxel_m
    if not meet.any():
        return None
    normals = np.einsum("ij,ij->i", surfels.normals[low][meet], surfels.normals[ground][nearest[meet]])
    angle = np.rad2deg(np.arccos(np.clip(normals, -1.0, 1.0)))
    sector = sectors(flat[low][meet, :2] - middle(flat[low]))
    steepest = np.array([np.quantile(angle[sector == k], 0.75) for k in np.unique(sector)])
    return float((steepest > _CREASE_DEG).mean())


def rounded_share(observed: ObservedRock, interface: Interface) -> float:
    """Share of the directions in which the rock's foot bends outward like a fillet; 0 where too little was seen."""
    (below, foot_deg), (above, side_deg) = (
        _dips_deg(observed, interface, band, about=_FOOT) for band in (_FOOT, _SIDE)
    )
    seen, of_foot, of_side = np.intersect1d(below, above, return_indices=True)
    if len(seen) < _LEAST_SEEN * SECTORS or observed.patches_apart > SPARSE:
        return 0.0
    rounded = (foot_deg[of_foot] > _ROUNDED_DEG) & (foot_deg[of_foot] - side_deg[of_side] > _TURN_DEG)
    return float(rounded.mean())


def _dips_deg(
    observed: ObservedRock,
    interface: Interface,
    band: tuple[float, float],
    about: tuple[float, float] | None = None,
) -> tuple[Indices, Array]:
    """Directions (k,), and the median angle of the normals over the plane in each, between two shares of the height.

    about: band about whose middle the directions are counted; None for the same.
    """
    surfels, own = observed.surfels, observed.patches
    over = interface.over(surfels.points_m[own])
    inside, around = (
        (over[:, 2] > low * observed.height_m) & (over[:, 2] < high * observed.height_m)
        for low, high in (band, about or band)
    )
    if not inside.any() or not around.any():
        return np.zeros(0, np.int64), np.zeros(0)
    dip = np.rad2deg(np.arcsin(np.clip(surfels.normals[own][inside] @ interface.normal, -1.0, 1.0)))
    return median_by_sector(dip, over[inside, :2] - middle(over[around]))


_GROWN_PER_HEIGHT, _GROWN_BAND_PER_HEIGHT = (0.02, 0.15), 0.1
"""Distances from the rock at which the pedestal is looked at: the two sides of a crevice are thick together."""
_FEWEST = 30
_THICK, _OVER_ROCK = 0.4, 3.0
"""Thickness over width of the median patch of grass, and how often that of the rock's patches, which noise thickens
too."""
_LOW, _HIGH = 0.05, 0.95
"""Shares of the patches below and above which they are single blades and holes."""


def overgrown(observed: ObservedRock, interface: Interface) -> Doubt | None:
    """A doubt in the interface where what was seen beside the rock is as thick as it is wide, and the rock is not."""
    if observed.hint is not None:
        return None  # the user knows the interface
    roughness, over = observed.surfels.roughness, interface.over(observed.surfels.points_m)[:, 2]
    beside, _ = _ring(observed, interface, _GROWN_PER_HEIGHT, _GROWN_BAND_PER_HEIGHT)
    if len(beside) < _FEWEST:
        return None
    thick = np.median(roughness[beside])
    if thick < max(_THICK, _OVER_ROCK * np.median(roughness[observed.patches])):
        return None
    low, high = np.quantile(over[beside], [_LOW, _HIGH])
    return Doubt(
        "overgrown",
        f"what was seen beside the rock is no surface but {high - low:.2g} m thick, as grass, twigs or rubble are: the "
        f"interface lies in it, up to {max(-low, 0.0):.2g} m too high, and the rock ends there, so that it is too low "
        "and its toppling acceleration wrong by more than is stated. Clear its foot and scan again, or say where the "
        "two meet by three places --point X,Y,Z",
    )


def _ring(
    observed: ObservedRock, interface: Interface, away_per_height: tuple[float, float], band_per_height: float
) -> tuple[Indices, Array]:
    """Patches (k,) of the pedestal at such distances from the rock's foot, and the ways (k, 2) to them from it."""
    flat, height = interface.over(observed.surfels.points_m), observed.height_m
    foot = flat[observed.patches & (flat[:, 2] < _COLLAR_BAND_PER_HEIGHT * height), :2]
    if not len(foot):
        return np.zeros(0, np.int64), np.zeros((0, 2))
    away, nearest = cKDTree(foot).query(flat[:, :2])
    near, far = (share * height for share in away_per_height)
    beside = (
        ~observed.patches & (away > near) & (away < far) & (np.abs(flat[:, 2]) < band_per_height * height)
    )
    return np.flatnonzero(beside), flat[beside, :2] - foot[nearest[beside]]


_COLLAR_PER_HEIGHT = (0.02, 0.1)
"""Distances from the rock at which the pedestal is looked at: smoothing alone rounds a crease nearer to it."""
_COLLAR_BAND_PER_HEIGHT = 0.15
_BEYOND_PER_HEIGHT, _FLATTER = (0.15, 0.4), 0.6
"""Distances at which a sheet has reached the ground: it is flatter there, by such a factor, and a knoll is not."""
_STEEP_DEG = 15.0
"""A pedestal that falls away from the rock by more than this..."""
_ALL_ROUND = 0.75
"""...in this share of all directions is a sheet that fills a crevice, or a neck."""


def bridged(observed: ObservedRock, interface: Interface) -> Doubt | None:
    """A doubt in the rim of a model whose surface falls away from the rock on all sides, as filled holes do."""
    if observed.hint is not None:
        return None  # the user knows the interface
    near_deg = _collar_deg(observed, interface)
    if near_deg < _STEEP_DEG:
        return None
    beyond_deg = _falls_deg(observed, interface, _BEYOND_PER_HEIGHT, np.inf)
    if len(beyond_deg) and np.median(beyond_deg) > _FLATTER * near_deg:
        return None
    return Doubt(
        "bridged",
        f"the model's surface falls away from the rock's foot on all sides, by {near_deg:.0f} degrees, as on a mound: "
        "programs of photogrammetry fill a crevice that no picture shows by such a sheet. Behind one the rock goes on, "
        "its contact is lower and narrower than it looks, and it topples more easily than is stated. Export the model "
        "without filled holes (interpolation off), or say where the two meet by three places --point X,Y,Z",
    )


def _collar_deg(observed: ObservedRock, interface: Interface) -> float:
    """Slope by which the pedestal falls away from the rock beside it, in three directions in four or more."""
    every = _falls_deg(observed, interface, _COLLAR_PER_HEIGHT, _COLLAR_BAND_PER_HEIGHT)
    every = np.append(every, np.zeros(SECTORS - len(every)))
    return float(np.quantile(every, 1.0 - _ALL_ROUND))


def _falls_deg(
    observed: ObservedRock, interface: Interface, away_per_height: tuple[float, float], band_per_height: float
) -> Array:
    """Median slopes (k,) by which the pedestal falls at such distances from the rock, in the directions shown."""
    beside, outward = _ring(observed, interface, away_per_height, band_per_height)
    if not len(beside):
        return np.zeros(0)
    places = interface.over(observed.surfels.points_m[beside])[:, :2]
    normals = observed.surfels.normals[beside] @ interface.axes
    along = np.einsum("ij,ij->i", normals[:, :2], outward) / np.linalg.norm(outward, axis=1)
    falls = np.rad2deg(np.arctan2(along, np.abs(normals[:, 2])))
    return median_by_sector(falls, places - outward - middle(places - outward))[1]


def off_what_was_seen(observed: ObservedRock, interface: Interface, origin_m: Array) -> Doubt | None:
    """A doubt where the pedestal that was seen beside the rock lies off the interface that the user gave.

    origin_m: (3,), survey coordinates of the scene's origin.
    """
    if observed.hint is None:
        return None
    try:
        seen = fit_interface(observed.surfels, observed.patches)
    except InputError:  # next to nothing of it was seen, which is what hints are for
        return None
    foot = interface.flat(observed.low_m) * [1.0, 1.0, 0.0]
    rises_m = -seen.flat(interface.scene(foot))[:, 2]
    low_m, high_m = float(rises_m.min()), float(rises_m.max())
    if max(-low_m, high_m) < OFF_PER_HEIGHT * observed.height_m:
        return None
    dip_deg, toward_deg = slope_of_normal(seen.normal)
    x, y, z = seen.point_m + origin_m
    return Doubt(
        "hint",
        f"below the rock the pedestal that was seen beside it lies {low_m:+.2g} to {high_m:+.2g} m over the interface "
        f"that is given, and dips by {dip_deg:.1f} degrees toward {direction_told(toward_deg)}: one too high cuts "
        f"the rock's foot off, one too low adds to it. What was seen is --plane {x:.2f} {y:.2f} {z:.2f} {dip_deg:.1f} "
        f"{toward_deg:.0f}",
    )


_TOLD_DEG = 130.0
"""An unseen range from which it is told: feet of one rock may lie as far apart, and those that carry it, below 180."""


def unseen_rim(observed: ObservedRock, interface: Interface, com_m: Array) -> Doubt | None:
    """A doubt where the rim was not seen over a wide range of directions about the line of the weight.

    com_m: (3,), centre of mass of the closed rock, scene frame.
    """
    if observed.hint is not None and observed.hint.encloses:
        return None
    places = interface.over(observed.low_m)[:, :2] - interface.projected_m(com_m[None])[0]
    range_deg, toward_deg = widest_gap_deg(np.unique(sectors(places)))
    if range_deg < _TOLD_DEG:
        return None
    toward = azimuth_told(horizontal_unit_vector(toward_deg)[:2], interface)
    beyond = (
        "what was seen of it does not surround the line of the weight, and the interval means little there"
        if range_deg >= 180.0
        else "contacts were drawn there as if the outline that was seen went on"
    )
    return Doubt(
        "rim",
        f"the rock's rim was not seen over {range_deg:.0f} degrees about {toward}: {beyond}. A station toward there "
        "would tell the most",
    )


_FLARE, _WAIST = (0.1, 0.3), (0.45, 0.65)
"""Of the rock's height: sides are judged above the ground's last roughness, and where a boulder's upper half bends."""
_FLARE_DEG, _FLARE_SHARE = 8.0, 0.8
"""A side flares if its normals point so far up; in this share of the directions, the rock is widest at the ground."""
_UPRIGHT_DEG, _BENT_DEG, _UNDERCUT_SHARE, _BULGING_SHARE = -3.0, 12.0, 0.35, 0.12
"""Sides are those of a boulder's upper half if they point no farther down at the foot, in the mean over the directions,
bend by more to the waist, overhang in a smaller share of the directions, and at the waist in hardly any."""


def embedded(observed: ObservedRock, interface: Interface) -> Doubt | None:
    """A doubt where the sides look like the upper part of a boulder, down to the ground: no overhang, or a flare.

    A free rock may widen toward its foot as well, or be round above a foot as wide as itself: this alone is told.
    """
    return _sunk(observed, interface)[0]


def _sunk(observed: ObservedRock, interface: Interface) -> tuple[Doubt | None, bool]:
    """The doubt that a rock is embedded, and whether its widest part surely lies below the ground."""
    foot, waist = (_dips_deg(observed, interface, band)[1] for band in (_FLARE, _WAIST))
    if len(foot) < 0.5 * SECTORS:
        return None, False
    share = float((foot > _FLARE_DEG).mean())
    domed = len(waist) >= 0.5 * SECTORS and foot.mean() > _UPRIGHT_DEG
    domed = domed and waist.mean() - foot.mean() > _BENT_DEG
    domed = domed and (foot < -_FLARE_DEG).mean() < _UNDERCUT_SHARE and (waist < 0.0).mean() < _BULGING_SHARE
    if share >= _FLARE_SHARE:
        median = np.median(foot)
        what = f"sides widen down to the ground over {share:.0%} of the directions, by a median of {median:.0f} degrees"
    elif domed:
        what = (
            "the rock is widest near the ground, where hardly anything overhangs, and its sides bend by "
            f"{waist.mean() - foot.mean():.0f} degrees up to the middle, as those of a boulder's upper half"
        )
    else:
        return None, False
    doubt = Doubt(
        "embedded",
        f"{what}: it may be embedded, and go on below the ground; then the volume is "
        "too small, the contact unknown, and what surrounds the rock holds it. A probe or a trench beside it shows "
        "whether its base lies at the interface",
    )
    return doubt, bool(domed and foot.mean() > _FLARE_DEG)


def check_not_sunk(observed: ObservedRock, interface: Interface) -> None:
    """Refuse a rock that is a dome on the ground, unless the user has said where it meets its pedestal.

    Raises InputError if its sides flare down to the ground and bend inward from there on: its widest part lies
    below.
    """
    sunk, surely = _sunk(observed, interface)
    if observed.hint is None and sunk is not None and surely:
        raise InputError(
            "rock.sunk",
            sunk.sentence,
            where="the rock",
            expected="a rock that is seen to its base: sides that are upright or overhang above it",
            remedy="if its base was found at the ground, say where they meet by --plane, --point or --outline; a rock "
            "that goes on below the ground does not topple as a free block",
        )
