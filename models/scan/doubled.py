"""Whether a cloud shows its surfaces twice, as two registrations in one file, or one that is off, do."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from toppling.models.arrays import Array, at_most
from toppling.models.errors import InputError
from toppling.models.scan.doubt import Doubt
from toppling.models.scan.measure import ObservedRock

_LOOKED_AT, OF_LAYERS = 500, 500_000
"""So many patches, and points around them, tell; more points are not to be given."""
_REACHES_VOXELS = (2.5, 6.0)
"""Around a patch: the wider circle shows layers that lie wider apart."""
_FEWEST = 24
_APART = 5.0
"""Distance of two layers over the thickness of one. Halves of a noisy one have 2.7, of a bent or sloping one 3.5."""
_LEAST_PART = 0.12
"""Of the points around a patch, in the thinner layer."""
_BESIDE = 2.0
"""Two layers lie over each other where points of one have some of the other so near in plan, in their spacing; the two
sides of a ledge do not."""
_TOLD_SHARE = 0.12
"""Of the patches that are told; edges and cracks make up to 0.05."""
_FARTHEST_PER_HEIGHT = 0.008
"""Layers so near leave the stated intervals true (92 to 100 % held at 0.005); at 0.01 they may hold a third, at 0.03
nothing."""
_LEAST_STEPS = 3.0
"""Coordinates in steps make layers of their own, a step apart."""


def doubled(observed: ObservedRock, rock_m: Array, step_m: float) -> Doubt | None:
    """A doubt where the rock's points lie in two layers.

    rock_m: (n, 3), points of the rock.
    step_m: between coordinates, 0 where they have none.
    Raises InputError if the layers lie so far apart that what is stated would not hold.
    """
    surfels = observed.surfels
    own = at_most(np.flatnonzero(observed.patches), _LOOKED_AT)
    reaches = [each * surfels.voxel_m for each in _REACHES_VOXELS]
    share, apart_m = layers(surfels.points_m[own], rock_m, reaches, step_m)
    if share < _TOLD_SHARE:
        return None
    what = (
        f"the rock's surface was seen twice, about {apart_m:.2g} m apart, over {share:.0%} of it: two registrations of "
        "the same scans in one cloud, or stations that are off by so much"
    )
    farthest_m = _FARTHEST_PER_HEIGHT * observed.height_m
    if apart_m > farthest_m:
        raise InputError(
            what,
            where="registration",
            expected=f"one surface, or two within {farthest_m:.2g} m ({_FARTHEST_PER_HEIGHT:.1%} of the rock's height)",
            remedy="register the stations anew, or leave one of the two out; where each has a file or a number of its "
            "own, give the stations one by one: they are fitted to each other",
        )
    return Doubt(
        "doubled",
        f"{what}. Rock and contact are those of both together. Register the stations anew, or leave one of the two out",
    )


def layers(
    places_m: Array, points_m: Array, reaches_m: Sequence[float], step_m: float
) -> tuple[float, float]:
    """Share of some places (k, 3) around which points (n, 3) lie in two layers, and how far these are apart.

    reaches_m: of what is around a place.
    """
    apart_m = np.zeros(len(places_m))
    judged = np.zeros(len(places_m), bool)
    tree = cKDTree(points_m)
    for reach in reaches_m:
        for number, rows in enumerate(tree.query_ball_point(places_m, reach)):
            if len(rows) < _FEWEST or apart_m[number]:
                continue
            judged[number] = True
            apart_m[number] = _apart_m(points_m[rows] - places_m[number], _LEAST_STEPS * step_m)
    double = apart_m > 0.0
    if not double.any():
        return 0.0, 0.0
    # Surfaces along a shift show little of it.
    return float(double.sum() / judged.sum()), float(np.quantile(apart_m[double], 0.95))


def _apart_m(around_m: Array, least_m: float) -> float:
    """How far two layers of points (n, 3) about a place lie apart; 0 if they are one."""
    centred = around_m - around_m.mean(axis=0)
    axes = np.linalg.svd(centred, full_matrices=False)[2]
    flat, height = centred @ axes[:2].T, centred @ axes[2]
    order = np.argsort(height)
    height = height[order]
    split = _halves(height)
    lower, upper = height[:split], height[split:]
    if min(len(lower), len(upper)) < max(3.0, _LEAST_PART * len(height)):
        return 0.0
    apart = float(np.median(upper) - np.median(lower))
    thick = 1.4826 * max(float(np.median(np.abs(part - np.median(part)))) for part in (lower, upper))
    if apart < max(_APART * thick, least_m):
        return 0.0
    return apart if _over_each_other(flat[order[:split]], flat[order[split:]]) else 0.0


def _halves(height: Array) -> int:
    """Where sorted heights (n,) part into two groups with the least spread within each."""
    count = np.arange(1, len(height))
    total = np.cumsum(height)
    before, after = total[:-1] / count, (total[-1] - total[:-1]) / (len(height) - count)
    return 1 + int(np.argmax(count * (len(height) - count) * (after - before) ** 2))


def _over_each_other(flat_m: Array, other_m: Array) -> bool:
    fewer, more = sorted((flat_m, other_m), key=len)
    spacing = np.median(cKDTree(more).query(more, 2)[0][:, 1])
    return bool(np.median(cKDTree(more).query(fewer)[0]) < _BESIDE * spacing)
