"""Gaps between a rock's underside and its pedestal where neither was seen: random fields on which the rock stands.

The gap is a Gaussian random field, conditioned on where it was seen (the rim). What is known besides is put in as a
mechanical contact problem: of all fields near a draw, the one that costs least in the field's own metric and that

- lies nowhere below its floor (no interpenetration; where the pedestal was seen below the rock a ray went through), and
- touches at three or more places around the line of the weight, so that the rock is at rest in the pose of the scan.

What a draw costs to be brought to this is its misfit with standing, and weighs it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve, cholesky
from scipy.spatial import ConvexHull, QhullError, cKDTree
from scipy.spatial.distance import cdist

from toppling.models.arrays import Array, Flags, Indices
from toppling.models.hidden_base.near_interface import SIDE_TANGENT
from toppling.models.proportions import effective_number

_JITTER = 1e-6
"""Share of the variance added to the diagonal of a covariance so that it can be inverted."""
_ROUNDS = 80
"""Rounds of the active set, in each of which up to `_MOST_AT_ONCE` places are added."""
_MOST_AT_ONCE = 12
_TRIANGLES = 12
"""Triangles of the hull that are looked at below the line of the weight."""
_EFFECTIVE_SHARE = 0.1
"""Least share of the draws that their weights leave effective."""
_TOUCHING_SHARE = 1e-6
"""Share of the field's level below which a gap is closed."""

_TOUCHING_PER_SHAPE = 1e-3
"""Error of a gap that is known to be closed, over the shape's deviation."""


@dataclass(frozen=True)
class Relief:
    """Prior of a gap: a level that is not known, a shape, and roughness upon it."""

    level_m: float  # standard deviation of the mean gap
    # Standard deviation and correlation length of what the base bulges, hollows or slopes.
    shape_m: float
    shape_length_m: float
    # The same of its roughness.
    rough_m: float
    rough_length_m: float
    # Standard deviation of the curvature of a paraboloid about the middle: a base is round or hollow as a whole.
    curvature_per_m: float = 0.0
    # Standard deviation of what a base rises from its middle to its outline, as each of these powers of the
    # way there: a base that is round within its own outline, however long that is.
    bowl_m: float = 0.0
    bowl_powers: tuple[float, ...] = (2.0, 4.0)
    # Standard deviation of the slope of the whole base: a round rock turns until it stands.
    slope: float = 0.0

    def covariance(self, places_m: Array) -> Array:
        """Covariance (n, n) of the gaps at places (n, 2)."""
        apart = cdist(places_m, places_m)
        shape = self.shape_m**2 * _matern(apart / self.shape_length_m)
        off_m = places_m - places_m.mean(axis=0)
        paraboloid = 0.5 * self.curvature_per_m * (off_m**2).sum(axis=1)
        shape += np.outer(paraboloid, paraboloid) + self.slope**2 * (off_m @ off_m.T)
        if self.bowl_m:
            bowls = self.bowl_m * way_out(places_m)[:, None] ** np.array(self.bowl_powers)
            shape += bowls @ bowls.T
        return self.level_m**2 + shape + self.rough_m**2 * _matern(apart / self.rough_length_m)


@dataclass(frozen=True, eq=False)
class BaseObservation:
    """What is known of a gap."""

    places_m: Array  # (n, 2): where the gap is asked for
    known: Indices  # (m,): places where it was seen
    # (m,): what was seen there, and the standard deviation of an error of the place's own.
    gap_m: Array
    std_m: Array
    # (m,): the same of an error that it shares with its group. Where it follows from what was seen, so that
    # low places have large ones, a fit takes the group's error for the difference between them: give such a
    # group one value.
    shared_m: Array
    group: Indices  # (m,)
    floor_m: Array  # (n,): least gap; above 0 where rock and pedestal cannot touch
    touching: Indices  # (k,): places where they are known to touch
    # (draws, n): how far each place lies beyond the rim of the draws on each line of the weight, where nobody saw it.
    beyond_m: Array | None = None

    def on_base(self, number: int) -> Flags:
        """Which places (n,) lie on the base of the draws on a line of the weight."""
        if self.beyond_m is None:
            return np.ones(len(self.places_m), bool)
        within = self.beyond_m[number % len(self.beyond_m)] <= 0.0
        within[self.touching] = True
        return within


@dataclass(frozen=True, eq=False)
class GapDraw:
    """One field of gaps on which the rock stands."""

    gap_m: Array  # (n,)
    # Logarithm of its weight among those of its kind: the likelihood of what was seen, and its misfit with standing.
    log_weight: float
    number: int  # which line of the weight it has
    kind: str = "rough"
    log_likelihood: float = 0.0  # of the seen rim alone, given the places known to touch


def way_out(places_m: Array) -> Array:
    """Share (n,) of the way from the middle of places to their convex outline: 0 in the middle, 1 on the outline."""
    outline, middle = ConvexHull(places_m).equations, places_m.mean(axis=0)
    reach = -(outline[:, :2] @ middle + outline[:, 2])
    return np.asarray(((places_m - middle) @ outline[:, :2].T / reach).max(axis=1).clip(0.0, 1.0))


def draw_gaps(
    observed: BaseObservation,
    projected_com_m: Array,
    reliefs: Sequence[Relief],
    random: np.random.Generator,
    kind: str = "rough",
) -> list[GapDraw]:
    """Fields on which the rock stands; fewer than asked for, down to none, where no contact can enclose its weight.

    projected_com_m: (count, 2), where the line of the weight pierces the interface, for each draw of each relief.
    kind: of which the reliefs are.
    """
    found = []
    for relief in reliefs:
        fields, covariance, log_likelihood = _conditioned(observed, relief, len(projected_com_m), random)
        level = max(relief.shape_m, relief.rough_m)
        for number, (field, projected_com) in enumerate(zip(fields, projected_com_m, strict=True)):
            stood = _stood(field, covariance, observed, projected_com, _TOUCHING_SHARE * level, number)
            if stood is not None:
                gap, cost = stood
                found.append(GapDraw(gap, log_likelihood - 0.5 * cost, number, kind, log_likelihood))
    return found


def resampled(weight: Array, count: int, random: np.random.Generator) -> Indices:
    """Numbers (count,) of draws, each as often as its weight says (systematic resampling)."""
    steps = (np.arange(count) + random.random()) / count
    return np.searchsorted(np.cumsum(weight) / weight.sum(), steps).clip(max=len(weight) - 1)


def weights(log_weight: Array) -> Array:
    """Weights (n,) of draws of one kind, the largest 1.

    Weights that would leave fewer effective draws than a share of all are tempered: they are costs of a Gaussian prior,
    which no base follows so closely.
    """
    log_weight = log_weight - log_weight.max()
    weight = np.exp(log_weight)
    power = 1.0
    for _ in range(60):
        weight = np.exp(power * log_weight)
        if effective_number(weight) >= _EFFECTIVE_SHARE * len(weight):
            break
        power *= 0.9
    return np.asarray(weight)


def facet_below(places_m: Array, gap_m: Array, projected_com_m: Array) -> Indices | None:
    """The three places on which a body with these gaps rests under a line through a point of the plane, if any."""
    try:
        hull = ConvexHull(np.column_stack([places_m, gap_m]))
    except QhullError:
        return None
    facing = np.flatnonzero(hull.equations[:, 2] < -1e-9)
    a, b, c, d = hull.equations[facing].T
    height = -(a * projected_com_m[0] + b * projected_com_m[1] + d) / c
    # Facets of one plane are several triangles, of which one lies below the line.
    for number in np.argsort(-height, kind="stable")[:_TRIANGLES]:
        corners = hull.simplices[facing[number]]
        if encloses(places_m[corners], projected_com_m):
            return corners
    return None


def encloses(points_m: Array, projected_com_m: Array) -> bool:
    """Whether the convex hull of points (k, 2) of the plane holds another point."""
    if len(points_m) < 3:
        return False
    try:
        hull = ConvexHull(points_m)
    except QhullError:
        return False
    return bool((hull.equations[:, :2] @ projected_com_m + hull.equations[:, 2] < 0.0).all())


def _matern(apart: Array) -> Array:
    """Matérn correlation of smoothness 5/2."""
    scaled = np.sqrt(5.0) * apart
    return np.asarray((1.0 + scaled + scaled**2 / 3.0) * np.exp(-scaled))


def _conditioned(
    observed: BaseObservation, relief: Relief, count: int, random: np.random.Generator
) -> tuple[Array, Array, float]:
    """Fields (count, n) that agree with what was seen, their covariance, and how likely the seen is."""
    prior = relief.covariance(observed.places_m)
    prior[np.diag_indices_from(prior)] += _JITTER * relief.level_m**2
    free = cholesky(prior, lower=True) @ random.normal(size=(len(prior), count))
    known = np.concatenate([observed.known, observed.touching])
    target = np.concatenate([observed.gap_m, np.zeros(len(observed.touching))])
    if not len(known):
        return free.T, prior, 0.0
    touching_m = np.full(len(observed.touching), _TOUCHING_PER_SHAPE * relief.shape_m)
    errors = block_diag(_rim_errors(observed), np.diag(touching_m))
    factor = cho_factor(prior[np.ix_(known, known)] + errors @ errors.T, lower=True)
    noise = errors @ random.normal(size=(errors.shape[1], count))
    cross = prior[:, known]
    fields = free + cross @ cho_solve(factor, target[:, None] - free[known] - noise)
    covariance = prior - cross @ cho_solve(factor, cross.T)
    return fields.T, covariance, _rim_log_likelihood(observed, prior[np.ix_(known, known)], touching_m)


def flat_log_likelihood(observed: BaseObservation, edge: Relief) -> float:
    """How likely what was seen is (natural logarithm) on a base that lies on its pedestal up to its edge.

    edge: relief of the edge alone, which may be broken, and rough.
    """
    known = np.concatenate([observed.known, observed.touching])
    touching_m = np.full(len(observed.touching), _TOUCHING_PER_SHAPE * edge.shape_m)
    return _rim_log_likelihood(observed, edge.covariance(observed.places_m[known]), touching_m)


def _rim_log_likelihood(observed: BaseObservation, prior: Array, touching_m: Array) -> float:
    """How likely the seen rim is given the places known to touch, by their common prior, the rim's places first.

    Who looks for contacts finds them where they are: that there are some tells nothing of how likely a base is, but
    where they are tells how its rim must hang.
    """
    if not (count := len(observed.known)):
        return 0.0
    rim = _rim_errors(observed)
    joint = prior + block_diag(rim @ rim.T, np.diag(touching_m**2))
    target = np.concatenate([observed.gap_m, np.zeros(len(touching_m))])
    together = _log_density(target, cho_factor(joint, lower=True))
    if not len(touching_m):
        return together
    return together - _log_density(target[count:], cho_factor(joint[count:, count:], lower=True))


def _rim_errors(observed: BaseObservation) -> Array:
    """Square root (m, k) of the covariance of what was seen at the rim: errors of its places, and of their groups."""
    of_group = observed.shared_m[:, None] * (observed.group[:, None] == np.unique(observed.group))
    return np.hstack([np.diag(observed.std_m), of_group])


def _log_density(target: Array, factor: tuple[Array, bool]) -> float:
    """Logarithm of a normal density without its constant, from the Cholesky factor of its covariance."""
    fit = float(target @ cho_solve(factor, target)) + 2.0 * float(np.log(np.diag(factor[0])).sum())
    return -0.5 * fit


def side_raised(gap_m: Array, observed: BaseObservation, number: int) -> Array:
    """Gaps (n,) of a base whose side rises where its rim, which nobody saw, ends on a line of the weight."""
    within = observed.on_base(number)
    if within.all() or observed.beyond_m is None:
        return gap_m
    beyond, places = observed.beyond_m[number % len(observed.beyond_m)][~within], observed.places_m
    nearest = cKDTree(places[within]).query(places[~within])[1]
    raised = gap_m.copy()
    raised[~within] = gap_m[within][nearest] + SIDE_TANGENT * beyond
    return raised


def _stood(
    field: Array,
    covariance: Array,
    observed: BaseObservation,
    projected_com: Array,
    closed_m: float,
    number: int,
) -> tuple[Array, float] | None:
    """The nearest field that stands on the base of its line of the weight, and what it cost to get there."""
    base = np.flatnonzero(observed.on_base(number))
    if len(base) == len(field):
        return _made_to_stand(field, covariance, observed, projected_com, closed_m)
    of_base = replace(
        observed,
        places_m=observed.places_m[base],
        floor_m=observed.floor_m[base],
        touching=np.searchsorted(base, observed.touching),
    )
    stood = _made_to_stand(field[base], covariance[np.ix_(base, base)], of_base, projected_com, closed_m)
    if stood is None:
        return None
    gap_m = field.copy()
    gap_m[base] = stood[0]
    return side_raised(gap_m, observed, number), stood[1]


def _made_to_stand(
    field: Array, covariance: Array, observed: BaseObservation, projected_com: Array, closed_m: float
) -> tuple[Array, float] | None:
    """The nearest field that stands, and what it cost to get there."""
    gap, cost = _above_floor(field, covariance, observed.floor_m, observed.touching)
    can_touch = np.flatnonzero(observed.floor_m <= 0.0)
    touching = can_touch[gap[can_touch] <= closed_m]
    if encloses(observed.places_m[touching], projected_com):
        return gap, cost
    # It is brought to touch where that costs least: in the middle rather than at a rim that was seen to hang.
    cost_of_touching = gap / np.sqrt(np.diag(covariance))
    corners = facet_below(observed.places_m[can_touch], cost_of_touching[can_touch], projected_com)
    if corners is None:
        return None
    feet = np.union1d(can_touch[corners], observed.touching)
    return _above_floor(field, covariance, observed.floor_m, feet)


def _above_floor(field: Array, covariance: Array, floor_m: Array, feet: Indices) -> tuple[Array, float]:
    """Field nearest to the given one that is 0 at the feet and nowhere below its floor; squared distance to it.

    A quadratic programme, solved by its active set: forces at the feet may pull, all others only push.
    """
    target = floor_m.copy()
    target[feet] = 0.0
    fixed = np.zeros(len(field), bool)
    fixed[feet] = True
    active = fixed.copy()
    tolerance = 3e-3 * float(np.sqrt(np.diag(covariance).max()))
    gap, cost = field, 0.0
    for _ in range(_ROUNDS):
        held = np.flatnonzero(active)
        if len(held):
            inner = covariance[np.ix_(held, held)]
            inner[np.diag_indices_from(inner)] += _JITTER * np.diag(covariance).max()
            missing = target[held] - field[held]
            force = cho_solve(cho_factor(inner, lower=True), missing)
            pulls = (force < 0.0) & ~fixed[held]
            if pulls.any():
                active[held[pulls]] = False
                continue
            gap, cost = field + covariance[:, held] @ force, float(missing @ force)
        below = np.where(active, 0.0, floor_m - gap)
        worst = np.argsort(below)[: -_MOST_AT_ONCE - 1 : -1]
        worst = worst[below[worst] > tolerance]
        if not len(worst):
            break
        active[worst] = True
    gap = np.maximum(gap, floor_m)
    gap[feet] = 0.0
    return gap, cost
