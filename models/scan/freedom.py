"""Whether what was scanned is a free rigid block: seen, embedded, attached, leaning, a stack, with room to fall."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, cKDTree

from toppling.models.arrays import Array, at_most
from toppling.models.errors import InputError
from toppling.models.frames import azimuth_deg
from toppling.models.rock import Rock
from toppling.models.scan.attached import SPARSE, attached
from toppling.models.scan.close import ClosedRock
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
from toppling.models.scan.interface import Interface
from toppling.models.scan.joints import weakest_joint
from toppling.models.scan.level_frame import tilted_frame
from toppling.models.scan.measure import ObservedRock
from toppling.models.scan.segment import PEDESTAL, ROCK
from toppling.models.scan.stacked import OF_JOINT, stacked
from toppling.models.scan.surfels import in_plants, roughness, thin

_MOST_INVENTED = 0.6
"""More of the surface invented, and nothing of the answer is the rock's: known volumes came out off by half."""
_ONE_SIDE_DEG = 120.0
"""A rock of whose sides none shows in so wide a range of directions was seen from one side."""
_UPRIGHT = 0.7
"""Sine of the dip above which a patch belongs to a side."""
_SEEN_SHARE = 0.1
"""A direction is seen if it has this share of the patches of an average one."""
_LEANS_ABOVE = 0.2
"""Of the rock's height: a neighbour that is touched above it holds the rock."""
_LEAST_TOUCHES = 8
_FLARE, _WAIST = (0.1, 0.3), (0.45, 0.65)
"""Of the rock's height: sides are judged above the ground's last roughness, and where a boulder's upper half bends."""
_FLARE_DEG, _FLARE_SHARE = 8.0, 0.8
"""A side flares if its normals point so far up; in this share of the directions, the rock is widest at the ground.
Of rocks sunk beyond their widest 0.8 to 1 flare, of free ones at most 0.45, of a column with a wide foot 0.69."""
_UPRIGHT_DEG, _BENT_DEG, _UNDERCUT_SHARE, _BULGING_SHARE = -3.0, 12.0, 0.35, 0.12
"""Sides are those of a boulder's upper half if they point no farther down at the foot, in the mean over the directions,
bend by more to the waist, overhang in a smaller share of the directions, and at the waist in hardly any. Of four
boulders sunk by 0.25 to 0.5 of their height feet point -1 to 24 degrees up and bend by 16 to 44; of 25 free rocks those
with feet above -3 bend by at most 9, or overhang at the waist in 0.4 of the directions."""
_TWO_TOLD, _TWO_REFUSED, _TWO_PART = 0.72, 0.82, 0.2
"""Share of the cut between two sides that must run through a crease: of two bodies that touch 0.78 to 0.91, of free
rocks at most 0.18, of a sculpted lion 0.66. With a part of this share of the patches, size and weight are of both."""
_TWO_SPARSE = 0.35
"""Told in a cloud of few points, where patches tell a crease from a bend less: of two bodies 0.5 to 0.74, of free rocks
at most 0.3."""
_TWO_STANDS = 0.1
"""Of the rock's height: a smaller part that comes down so far stands there itself, and may be what is meant."""
_BESIDE_VOXELS, _OTHERS, _LEAST_IN_REACH = 4.0, 400_000, 25
_IN_REACH_ABOVE, _ON_ROCK = 0.3, 0.05
"""Of the rock's height: what rises so far above the interface stops it where it is nearer than the rock is high,
and so far out of the hull of the closed rock; what is not is the rock's own."""
_HULL_AT_ONCE = 1000


def check_seen_enough(observed: ObservedRock, interface: Interface, closed: ClosedRock) -> None:
    """Refuse a rock most of whose surface no station saw.

    Raises InputError: that one side is not enough, that points are too few, or that the rock is hidden or embedded.
    """
    if closed.invented_share <= _MOST_INVENTED:
        return
    blind_deg, toward_deg = _unseen_range(observed, interface)
    share = f"{closed.invented_share:.0%} of the rock's surface was not seen"
    if blind_deg >= _ONE_SIDE_DEG:
        what = (
            f"one side is not enough: {share}, none of its sides over {blind_deg:.0f} degrees about "
            f"{direction_told(toward_deg)}"
        )
    elif (sunk := embedded(observed, interface)) is not None:
        what = f"{share}; {sunk.sentence}"
    elif (apart := observed.patches_apart) > SPARSE:
        raise InputError(
            f"{share}: the cloud has too few points, its patches of {observed.surfels.voxel_m:.2g} m lie {apart:.1f} "
            "times as far apart as they are wide",
            where="the rock",
            expected="points so dense that patches of a hundredth of the rock's height touch each other",
            remedy="give all stations, and clouds that were not thinned, or not so much",
        )
    else:
        what = f"{share}, and what was seen lies all around: it is embedded in what surrounds it, or hidden by it"
    raise InputError(
        what,
        where="the rock",
        expected=f"a free-standing rock, at most {_MOST_INVENTED:.0%} of it unseen",
        remedy="scan it from the other sides; a rock that is embedded or buried is held by what surrounds it, and no "
        "toppling of a free block is its own",
    )


def _unseen_range(observed: ObservedRock, interface: Interface) -> tuple[float, float]:
    """Widest range of directions, degrees, in which no side of the rock was seen, and its middle azimuth."""
    normals = observed.surfels.normals[observed.patches]
    side = np.hypot(*(normals @ interface.axes)[:, :2].T) > _UPRIGHT
    count = np.bincount(sectors(normals[side, :2]), minlength=SECTORS)
    shown = np.flatnonzero(count >= max(3.0, _SEEN_SHARE * count.mean()))
    return widest_gap_deg(shown) if len(shown) else (360.0, 0.0)


def doubts(
    observed: ObservedRock,
    interface: Interface,
    points_m: Array,
    label: NDArray[np.int8],
    separated: bool = False,
    closed: Rock | None = None,
) -> list[Doubt]:
    """What tells against a free rigid block.

    points_m: (n, 3), of the cloud.
    label: (n,), 0 rock, 1 pedestal, 2 neither.
    separated: whether the user has said which points are which.
    closed: the rock as it was closed; what lies on or in its hull is not beside it.
    Raises InputError if the rock goes on into its pedestal along most of the rim that was seen, or is two bodies
    that touch.
    """
    found = [
        attached(observed, interface, parted=separated or observed.hint is not None),
        embedded(observed, interface),
        _leaning(observed, interface),
        _two(observed, interface, separated),
        stacked(observed, interface, points_m[at_most(np.flatnonzero(label == ROCK), OF_JOINT)]),
        _hemmed_in(observed, points_m[at_most(np.flatnonzero(label == PEDESTAL), _OTHERS)], closed),
        tilted_frame(observed.surfels, observed.patches),
    ]
    return [each for each in found if each is not None]


def embedded(observed: ObservedRock, interface: Interface) -> Doubt | None:
    """A doubt where the sides look like the upper part of a boulder, down to the ground: no overhang, or a flare.

    A free rock may widen toward its foot as well, or be round above a foot as wide as itself: this alone is told.
    """
    return _embedded(*_side_dips_deg(observed, interface))


def _embedded(foot: Array, waist: Array) -> Doubt | None:
    if len(foot) < 0.5 * SECTORS:
        return None
    share = float((foot > _FLARE_DEG).mean())
    if share >= _FLARE_SHARE:
        median = np.median(foot)
        what = f"sides widen down to the ground over {share:.0%} of the directions, by a median of {median:.0f} degrees"
    elif _domed(foot, waist):
        what = (
            "the rock is widest near the ground, where hardly anything overhangs, and its sides bend by "
            f"{waist.mean() - foot.mean():.0f} degrees up to the middle, as those of a boulder's upper half"
        )
    else:
        return None
    return Doubt(
        "embedded",
        f"{what}: it may be embedded, and go on below the ground; then the volume is "
        "too small, the contact unknown, and what surrounds the rock holds it. A probe or a trench beside it shows "
        "whether its base lies at the interface",
    )


def check_not_sunk(observed: ObservedRock, interface: Interface) -> None:
    """Refuse a rock that is a dome on the ground, unless the user has said where it meets its pedestal.

    Raises InputError if its sides flare down to the ground and bend inward from there on: its widest part lies
    below.
    """
    foot, waist = _side_dips_deg(observed, interface)
    sunk = _embedded(foot, waist)
    if observed.hint is None and sunk and _domed(foot, waist) and foot.mean() > _FLARE_DEG:
        raise InputError(
            sunk.sentence,
            where="the rock",
            expected="a rock that is seen to its base: sides that are upright or overhang above it",
            remedy="if its base was found at the ground, say where they meet by --plane, --point or --outline; a rock "
            "that goes on below the ground does not topple as a free block",
        )


def _domed(foot_deg: Array, waist_deg: Array) -> bool:
    """Whether sides with such dips are those of a boulder's upper half."""
    if len(waist_deg) < 0.5 * SECTORS:
        return False
    bulging = (foot_deg < -_FLARE_DEG).mean() < _UNDERCUT_SHARE and (waist_deg < 0.0).mean() < _BULGING_SHARE
    return bool(foot_deg.mean() > _UPRIGHT_DEG and waist_deg.mean() - foot_deg.mean() > _BENT_DEG and bulging)


def _side_dips_deg(observed: ObservedRock, interface: Interface) -> tuple[Array, Array]:
    """Median angles of the sides' normals above the interface plane in each direction: at the foot, at the waist."""
    foot, waist = (_dips_deg(observed, interface, *band) for band in (_FLARE, _WAIST))
    return foot, waist


def _dips_deg(observed: ObservedRock, interface: Interface, low: float, high: float) -> Array:
    """Median angle of the normals above the interface plane between two shares of the height, in each direction."""
    surfels = observed.surfels
    points, normals = surfels.points_m[observed.patches], surfels.normals[observed.patches]
    up = interface.over(points)[:, 2] / observed.height_m
    inside = (up > low) & (up < high)
    if not inside.any():
        return np.zeros(0)
    flat = interface.flat(points)[inside, :2]
    dip = np.rad2deg(np.arcsin(np.clip(normals[inside] @ interface.normal, -1.0, 1.0)))
    return median_by_sector(dip, flat - middle(flat))[1]


def _leaning(observed: ObservedRock, interface: Interface) -> Doubt | None:
    surfels, flat = observed.surfels, interface.flat(observed.surfels.points_m)
    other = ~observed.patches & (flat[:, 2] > _LEANS_ABOVE * observed.height_m)
    high = observed.patches & (flat[:, 2] > _LEANS_ABOVE * observed.height_m)
    if not other.any() or not high.any():
        return None
    away, _ = cKDTree(surfels.points_m[high]).query(surfels.points_m[other])
    touch = away < 2.0 * surfels.voxel_m
    if touch.sum() < _LEAST_TOUCHES:
        return None
    places = flat[other][touch]
    toward = azimuth_told(places[:, :2].mean(axis=0) - flat[observed.patches, :2].mean(axis=0), interface)
    return Doubt(
        "leaning",
        f"a neighbour touches the rock {np.median(places[:, 2]):.2g} m above the interface, toward {toward}: it may "
        "hold or wedge the rock, and the answer is that of the rock without it",
    )


def _two(observed: ObservedRock, interface: Interface, separated: bool) -> Doubt | None:
    joint = weakest_joint(observed, interface)
    told = _TWO_SPARSE if observed.patches_apart > SPARSE else _TWO_TOLD
    if joint is None or joint.creased_share < told:
        return None
    what = (
        f"a crease parts {joint.part:.0%} of the rock's surface, toward {azimuth_told(joint.way, interface)}, from the "
        f"rest, along {joint.creased_share:.0%} of the way around: it may be two blocks that touch, one leaning on the "
        "other; volume and weight are then those of both"
    )
    both = joint.part >= _TWO_PART or joint.lowest_m < _TWO_STANDS * observed.height_m
    if joint.creased_share >= _TWO_REFUSED and both and not separated:
        raise InputError(
            what,
            where="the rock",
            expected="one block that stands free",
            remedy="crop the neighbour off the cloud, or separate the rock in another program and give it by --rock "
            "FILE or CLASS, which also says that it is one block",
        )
    return Doubt("leaning", what)


def _hemmed_in(observed: ObservedRock, pedestal_m: Array, closed: Rock | None) -> Doubt | None:
    own, height = observed.surfels.points_m[observed.patches], observed.height_m
    others = pedestal_m[pedestal_m[:, 2] > own[:, 2].min() + _IN_REACH_ABOVE * height]
    if len(others) < _LEAST_IN_REACH:
        return None
    others, _ = thin(others, observed.surfels.voxel_m)
    others = others[~in_plants(others, roughness(others))]
    away, _ = cKDTree(own[:, :2]).query(others[:, :2], distance_upper_bound=height)
    # A slope of less than 45 degrees is fallen over.
    rises = others[:, 2] - own[:, 2].min() > away
    near = np.isfinite(away) & (away > _BESIDE_VOXELS * observed.surfels.voxel_m) & rises
    if closed is not None:
        # Where few points fell on the rock they join no patches of it.
        near[near] = _out_of_hull_m(others[near], closed.vertices_m) > _ON_ROCK * height
    if near.sum() < _LEAST_IN_REACH:
        return None
    offset = others[near, :2] - own[:, :2].mean(axis=0)
    toward = azimuth_deg(offset.mean(axis=0))
    return Doubt(
        "in reach",
        f"something rises beside the rock within its height, over {len(np.unique(sectors(offset))) * 360 // SECTORS} "
        f"degrees about {direction_told(toward)}: a rock that falls that way may come to lean there",
    )


def _out_of_hull_m(points_m: Array, vertices_m: Array) -> Array:
    """How far points (n, 3) lie out of the planes of the hull of vertices (k, 3) at most; below 0 inside."""
    planes = ConvexHull(vertices_m).equations
    # All at once take gigabytes: 30,000 points beside a hull of 10,000 facets.
    blocks = np.array_split(points_m, len(points_m) // _HULL_AT_ONCE + 1)
    return np.concatenate([(each @ planes[:, :3].T + planes[:, 3]).max(axis=1) for each in blocks])
