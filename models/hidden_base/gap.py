"""The rock's underside and its gap to the pedestal where neither was seen: random fields on which the rock stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage
from scipy.linalg import block_diag, cho_factor, cho_solve, cholesky, eigh
from scipy.spatial import ConvexHull, QhullError, cKDTree
from scipy.spatial.distance import cdist
from scipy.special import ndtr

from toppling.models.arrays import Array, Flags, Indices, at_most
from toppling.models.hidden_base.near_interface import DRAWN, SIDE_TANGENT, NearInterface, UnseenSide
from toppling.models.scan.crevice import Grid, cells_apart, check_seen, depth_of_holes, smooth_sheet
from toppling.models.scan.interface import SECTORS, Interface, sectors
from toppling.models.scan.interface_hint import InterfaceHint

_JITTER = 1e-6
"""Share of the variance added to the diagonal of a covariance so that it can be inverted."""
_ROUNDS = 80
"""Rounds of the active set, in each of which up to `_MOST_AT_ONCE` places are added."""
_MOST_AT_ONCE = 12
_TRIANGLES = 12
"""Triangles of the hull that are looked at below the line of the weight."""
_TOUCHING_SHARE = 1e-6
"""Share of the field's level below which a gap is closed."""

_TOUCHING_PER_SHAPE = 1e-3
"""Error of a gap that is known to be closed, over the shape's deviation."""
_SCALES = np.geomspace(1.0, 1e3, 61)
"""Factors on a prior's covariance that are tried."""


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
            bowls = self.bowl_m * _outward_fraction(places_m)[:, None] ** np.array(self.bowl_powers)
            shape += bowls @ bowls.T
        return self.level_m**2 + shape + self.rough_m**2 * _matern(apart / self.rough_length_m)


@dataclass(frozen=True, eq=False)
class BaseObservation:
    """Observations of the gap between rock and pedestal, with their errors."""

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
    drop_m: Array | None = None  # (n,): how far below the interface the pedestal lies; nowhere if not given

    @property
    def means_m(self) -> Array:
        """Means (k, n) of the gap that are as likely as each other before the rim was seen.

        Where the pedestal drops around a rock, its base may follow, or end over an edge of it.
        """
        level = np.zeros((1, len(self.places_m)))
        return level if self.drop_m is None else np.vstack([level, self.drop_m])

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


def _outward_fraction(places_m: Array) -> Array:
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

    projected_com_m: (count, 2), where the line of the weight pierces the interface, for each draw; priors take turns.
    kind: of which the reliefs are.
    """
    found = []
    for turn, relief in enumerate(reliefs):
        numbers = np.arange(turn, len(projected_com_m), len(reliefs))
        fields, covariance, log_likelihood = _conditioned(observed, relief, len(numbers), random)
        level = max(relief.shape_m, relief.rough_m)
        for number, field, likelihood in zip(numbers.tolist(), fields, log_likelihood, strict=True):
            projected_com = projected_com_m[number]
            stood = _stood(field, covariance, observed, projected_com, _TOUCHING_SHARE * level, number)
            if stood is not None:
                gap, cost = stood
                found.append(GapDraw(gap, likelihood - 0.5 * cost, number, kind, likelihood))
    return found


def resampled(weight: Array, count: int, random: np.random.Generator) -> Indices:
    """Numbers (count,) of draws, each as often as its weight says (systematic resampling)."""
    steps = (np.arange(count) + random.random()) / count
    return np.searchsorted(np.cumsum(weight) / weight.sum(), steps).clip(max=len(weight) - 1)


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
    return beyond_m(points_m, projected_com_m) < 0.0


def beyond_m(points_m: Array, projected_com_m: Array) -> float:
    """How far a point lies outside the convex hull of points (k, 2); infinite where these span no area."""
    try:
        hull = ConvexHull(points_m).equations if len(points_m) > 2 else None
    except QhullError:
        hull = None
    return np.inf if hull is None else float((hull[:, :2] @ projected_com_m + hull[:, 2]).max())


def _matern(apart: Array) -> Array:
    """Matérn correlation of smoothness 5/2."""
    scaled = np.sqrt(5.0) * apart
    return np.asarray((1.0 + scaled + scaled**2 / 3.0) * np.exp(-scaled))


def _conditioned(
    observed: BaseObservation, relief: Relief, count: int, random: np.random.Generator
) -> tuple[Array, Array, Array]:
    """Fields (count, n) that agree with what was seen, their covariance, and how likely the seen is for each (count,).

    With the same generator the fields differ by what is known of them alone, also by places that touch.
    """
    prior = relief.covariance(observed.places_m)
    prior[np.diag_indices_from(prior)] += _JITTER * relief.level_m**2
    prior *= _scale(observed, prior[np.ix_(observed.known, observed.known)])
    of_field, of_errors = random.spawn(2)
    mean = np.arange(count) % len(observed.means_m)
    free = cholesky(prior, lower=True) @ of_field.normal(size=(len(prior), count)) + observed.means_m[mean].T
    known = np.concatenate([observed.known, observed.touching])
    target = np.concatenate([observed.gap_m, np.zeros(len(observed.touching))])
    if not len(known):
        return free.T, prior, np.zeros(count)
    touching_m = np.full(len(observed.touching), _TOUCHING_PER_SHAPE * relief.shape_m)
    errors = block_diag(_rim_errors(observed), np.diag(touching_m))
    factor = cho_factor(prior[np.ix_(known, known)] + errors @ errors.T, lower=True)
    noise = errors @ of_errors.normal(size=(errors.shape[1], count))
    cross = prior[:, known]
    fields = free + cross @ cho_solve(factor, target[:, None] - free[known] - noise)
    covariance = prior - cross @ cho_solve(factor, cross.T)
    likelihood = _rim_log_likelihood(observed, observed.means_m, prior[np.ix_(known, known)], touching_m)
    return fields.T, covariance, likelihood[mean]


def _scale(observed: BaseObservation, prior: Array) -> float:
    """Factor on a prior's covariance at the rim (m, m), at least 1, with which what was seen there is likeliest.

    Between the legs of a rock, and below a round one, the gap differs by more than the base's width tells: fields of a
    stiffer prior would pass below the gap that was seen.
    """
    if not len(prior):
        return 1.0
    errors, off_m = _rim_errors(observed), observed.gap_m - observed.means_m[:, observed.known]
    noise = errors @ errors.T
    noise[np.diag_indices_from(noise)] += _JITTER * prior.max()
    variance, modes = eigh(prior, noise)
    total = 1.0 + _SCALES[:, None] * variance.clip(0.0)
    misfit = np.log(total).sum(axis=1)[:, None] + (1.0 / total) @ (off_m @ modes).T ** 2
    return float(_SCALES[misfit.min(axis=1).argmin()])


def flat_log_likelihood(observed: BaseObservation, edge: Relief) -> float:
    """How likely what was seen is (natural logarithm) on a base that lies on its pedestal up to its edge.

    edge: relief of the edge alone, which may be broken, and rough.
    """
    known = np.concatenate([observed.known, observed.touching])
    touching_m = np.full(len(observed.touching), _TOUCHING_PER_SHAPE * edge.shape_m)
    prior = edge.covariance(observed.places_m[known])
    return float(_rim_log_likelihood(observed, observed.means_m[-1:], prior, touching_m)[0])


def foretold_gaps(observed: BaseObservation, reliefs: Sequence[Relief]) -> tuple[Array, Array]:
    """Gap (k,) that the rim foretells where rock and pedestal are said to touch, m, and how likely it is closed (k,).

    Both by the prior under which it is the likeliest to be closed.
    """
    rim, touching = observed.known, observed.touching
    errors, own = _rim_errors(observed), slice(len(rim))
    found = []
    for relief in reliefs:
        prior = relief.covariance(observed.places_m[np.concatenate([rim, touching])])
        prior *= _scale(observed, prior[own, own])
        gain = cho_solve(
            cho_factor(prior[own, own] + errors @ errors.T, lower=True), prior[own, len(rim) :]
        ).T
        std_m = np.sqrt(np.diag(prior)[len(rim) :] - (gain * prior[len(rim) :, own]).sum(axis=1))
        for mean_m in observed.means_m:
            gap_m = mean_m[touching] + gain @ (observed.gap_m - mean_m[rim])
            found.append((gap_m, ndtr(-gap_m / std_m)))
    gaps_m, chances = np.array(found).swapaxes(0, 1)
    likeliest = chances.argmax(axis=0), np.arange(len(touching))
    return gaps_m[likeliest], chances[likeliest]


def _rim_log_likelihood(observed: BaseObservation, means_m: Array, prior: Array, touching_m: Array) -> Array:
    """How likely the seen rim is given the places known to touch, with each of some means (k, n) of the gap.

    prior: their common covariance, the rim's places first.

    Who looks for contacts finds them where they are: that there are some tells nothing of how likely a base is, but
    where they are tells how its rim must hang.
    """
    if not (count := len(observed.known)):
        return np.zeros(len(means_m))
    rim = _rim_errors(observed)
    joint = prior + block_diag(rim @ rim.T, np.diag(touching_m**2))
    known = np.concatenate([observed.known, observed.touching])
    target = np.concatenate([observed.gap_m, np.zeros(len(touching_m))])[:, None] - means_m[:, known].T
    together = _log_density(target, cho_factor(joint, lower=True))
    if not len(touching_m):
        return together
    return together - _log_density(target[count:], cho_factor(joint[count:, count:], lower=True))


def _rim_errors(observed: BaseObservation) -> Array:
    """Square root (m, k) of the covariance of what was seen at the rim: errors of its places, and of their groups."""
    of_group = observed.shared_m[:, None] * (observed.group[:, None] == np.unique(observed.group))
    return np.hstack([np.diag(observed.std_m), of_group])


def _log_density(targets: Array, factor: tuple[Array, bool]) -> Array:
    """Logarithms (k,) of a normal density of targets (n, k), without its constant, by its covariance's factor."""
    fit = (targets * cho_solve(factor, targets)).sum(axis=0) + 2.0 * np.log(np.diag(factor[0])).sum()
    return np.asarray(-0.5 * fit)


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


CELLS_PER_HEIGHT = 200
_MOST_CELLS_ACROSS = 400
"""A base twice as wide as the rock is high and wider is laid out in so many: a sheet of a million takes a minute."""
_RIM_CELLS = 5
"""Cells within which the lowest seen one carries the hidden base; the others are the rock's side."""
_RIM_SPREAD_PER_HEIGHT = 0.0003
"""Cells this little higher than the lowest are as low."""
_TENSION = 0.05
"""Tension of the hidden base's membrane over its plate's stiffness, cells: it keeps it from dipping below its rim."""
_CLOSING_CELLS = (12, 24, 48, 96)
"""Gaps in the seen rim, half as wide, that are bridged: the first that leave a base of some size."""
_LEAST_BASE_SHARE = 0.3
"""Share of the seen underside's convex hull that a hidden base takes up at least."""
_HOLE_STIFFNESS = 0.02
_RESTING_PER_HEIGHT = 0.0008
"""The rock rests where the closed underside is nearer to the plane than this: below what a scan resolves."""
_CORE_OF_HOLES = 0.8
"""The rock rests where a foot's hole is at least this share of its greatest depth: skimming rays miss its border."""
_FLAT_SHARE = 0.5
"""A hole that takes up more than this share of the hidden base is a flat base, not a foot."""
_SIDE_PER_HEIGHT = 0.006
"""A side seen down to this height, with no pedestal seen behind it, stands on the pedestal."""
LEAST_GAP_PER_HEIGHT = 0.003
"""Gap left where the pedestal was seen below the rock: a ray went through, from a rim that is higher."""
_LIT_ENDS_SHARE = 0.7
"""Share of the way to a rim that nobody saw: pedestal seen farther out lies beside the rock and not below it."""
_PASSED_SHARE, _FEET_AROUND_SHARE, _PASSAGE_CELLS = 0.5, 0.5, 2
"""One sees through between feet where the pedestal shows below so much of what low parts enclose, and these stand in at
most such a share of the directions around it; cells beside what shows."""
_FEET_SHARE = 0.2
"""Or where what is hidden beside it, within all low parts, takes up so much of it: feet stand all around a sculpture; a
base that is seen through all around its middle has next to nothing there."""


@dataclass(frozen=True, eq=False)
class Base:
    """Height of the rock's underside over the interface plane."""

    grid: Grid
    height_m: Array  # (shape): height over the plane, 0 where the rock rests on it
    hidden: Flags  # (shape): where the underside was not seen
    side: UnseenSide | None = None  # over which the rim was not seen
    passage: Flags | None = None  # (shape): what of the hidden part one sees through, between feet


@dataclass(frozen=True, eq=False)
class Underside:
    """Observed parts of the rock's underside, on the cells of a grid."""

    grid: Grid
    # (shape): least height of the rock's points over the interface plane, 0 where there are none.
    seen_m: Array
    # (shape): cells with points of the rock, those within its rim without, and those of the rim itself.
    seen: Flags
    hidden: Flags
    carries: Flags
    outline: Flags | None  # (shape): within the contact that the user outlined
    # (shape): how many cells deep a hidden cell lies in a hole of the pedestal's seen points; 0 where the
    # pedestal was seen.
    hole_depth: Array
    into_seen: Array  # (shape): cells from the hidden part
    apart: Flags  # (shape): where rock and pedestal were seen apart
    # How the rim goes on where nobody saw it; the hidden part reaches to its likeliest outline.
    side: UnseenSide | None = None
    widest: Flags | None = None  # (shape): hidden on the widest of them
    # (shape): of the hidden part, what one sees through between feet.
    passage: Flags | None = None

    @property
    def may_touch(self) -> Flags:
        """Cells (shape) of the base on one outline or another."""
        return (self.hidden if self.widest is None else self.widest) & ~self.apart

    @classmethod
    def of(
        cls, near: NearInterface, hint: InterfaceHint | None = None, interface: Interface | None = None
    ) -> Underside:
        """Underside from what was seen near the interface, on cells of its lattice if any.

        Raises InputError if next to nothing of the rock shows near it.
        """
        low, lit, height_m = near.low, near.lit, near.height_m
        check_seen(len(low), "rock", given=hint is not None)
        lattice_m = 0.0 if interface is None else interface.lattice_m
        # Half as wide as points lie apart at least: finer cells are holes.
        apart_m = float(np.median(cKDTree(low).query(at_most(low, 5000), 5)[0][:, 4]))
        across_m = float(np.ptp(low[:, :2], axis=0).max())
        cell = max(height_m / CELLS_PER_HEIGHT, 0.5 * apart_m, across_m / _MOST_CELLS_ACROSS)
        if lattice_m:
            cell = lattice_m / max(1, round(lattice_m / cell))
        first, last = low[:, :2].min(axis=0) - 6 * cell, low[:, :2].max(axis=0) + 6 * cell
        side = None if hint is not None and hint.encloses else UnseenSide.of(low, led_down=near.led_down)
        if side is not None:
            first, last = np.minimum(first, side.reach_m[0]), np.maximum(last, side.reach_m[1])
        if lattice_m:
            first, last = np.floor(first / lattice_m) * lattice_m, np.ceil(last / lattice_m) * lattice_m
        grid = Grid.over(first, last, cell)
        seen_height, seen = _lowest(grid, low)
        shown, apart = depth_of_holes(grid, lit) == 0.0, cells_apart(grid, near.apart)
        hidden, widest = _within_rim(seen, apart), None
        if side is not None:
            ends = side.in_range(grid.nodes_m) & (side.share_out(grid.nodes_m) > _LIT_ENDS_SHARE)
            hidden, widest = _extended(grid, side, hidden, ~seen & ~(shown & ends) & ~apart)
        feet = _feet(grid, seen, shown | apart)
        passed = bool(hidden.any() and (hidden & shown).sum() >= _PASSED_SHARE * hidden.sum())
        if on_feet := _stands_on_feet(grid, seen, hidden, feet, passed):
            hidden = hidden | feet
        outline = hint.inside(grid.nodes_m) if hint is not None and hint.encloses else None
        if outline is not None:
            seen, hidden, apart = seen & ~outline, hidden | outline, apart & ~outline
        # Points at the border may be the pedestal beside the rock.
        within = ndimage.binary_erosion(hidden, iterations=3)
        depth = depth_of_holes(grid, lit[within.ravel()[grid.index(lit)]]) * hidden
        into_seen = ndimage.distance_transform_edt(~hidden)
        known = np.where(seen, seen_height, np.inf)
        lowest = known <= ndimage.minimum_filter(known, _RIM_CELLS) + _RIM_SPREAD_PER_HEIGHT * height_m
        carries = seen & (lowest | (into_seen > 8.0))
        passage = None
        if on_feet and passed and outline is None:
            lit_there = hidden & (depth == 0.0)
            passage = hidden & ndimage.binary_dilation(lit_there, iterations=_PASSAGE_CELLS)
        return cls(
            grid, seen_height, seen, hidden, carries, outline, depth, into_seen, apart, side, widest, passage
        )

    def beyond_m(self, places_m: Array) -> Array | None:
        """How far places (n, 2) lie beyond each rim that was drawn (DRAWN, n); None where it was seen around."""
        side = self.side
        return None if side is None else np.array([side.beyond_m(places_m, k) for k in range(DRAWN)])

    def closed_by(self, sheet_m: Array, height_m: float) -> Base:
        """Base whose hidden part is a sheet; beside it the seen surface rules, and gives way within a few cells."""
        side = smooth_sheet(self.grid, np.where(self.seen, self.seen_m, 0.0), np.where(self.seen, 3.0, 0.0))
        away = 0.002 * height_m * np.maximum(self.into_seen - 1.0, 0.0)
        sheet = np.where(self.hidden, sheet_m, side - away)
        height = np.where(sheet < _RESTING_PER_HEIGHT * height_m, 0.0, sheet)
        return Base(self.grid, height, self.hidden, side=self.side, passage=self.passage)


def hidden_base(
    near: NearInterface,
    hint: InterfaceHint | None = None,
    interface: Interface | None = None,
) -> Base:
    """Close the underside: a sheet hung into its seen rim, resting where the pedestal was not seen.

    The rim's lowest points alone carry the sheet. The slope of the sides above them says nothing about the base: led
    inward, it would press every base flat.

    Parameters
    ----------
    near : NearInterface
    hint : InterfaceHint, optional
        If it is a contact outline, the rock rests inside it and nowhere else.
    interface : Interface, optional
        On the nodes of whose surface cells lie.

    Raises
    ------
    InputError
        If next to nothing of the rock shows near the interface.
    """
    under, height_m = Underside.of(near, hint, interface), near.height_m
    grid, outline, depth, hidden = under.grid, under.outline, under.hole_depth, under.hidden
    rests = _deepest(depth, hidden) & ~under.apart
    if outline is not None:
        rests, depth = outline, np.where(outline, 10.0, 0.0)
    weight = np.where(under.carries, 3.0, np.where(rests, _HOLE_STIFFNESS * depth**2, 0.0))
    sheet = smooth_sheet(grid, np.where(under.carries, under.seen_m, 0.0), weight, tension=_TENSION)
    low_side = under.seen & (under.seen_m < _SIDE_PER_HEIGHT * height_m)
    to_the_side = ndimage.binary_dilation(low_side, iterations=3)
    sheet = np.where(rests & (to_the_side if outline is None else outline), 0.0, sheet)
    sheet = np.where(hidden & ~rests, np.maximum(sheet, LEAST_GAP_PER_HEIGHT * height_m), sheet)
    free = _largest(hidden & ~under.apart)
    if free.any():  # the rock stands: where nothing is seen to rest, the lowest does
        sheet = sheet - sheet[free].min() * hidden
    return under.closed_by(sheet, height_m)


def _within_rim(seen: Flags, apart: Flags) -> Flags:
    """Cells within the seen rim, whose gaps (a wall stood before them) are bridged as far as is needed.

    apart: where the rock was seen to touch nothing; a hole of the seen underside that lies there is none of the base.
    """
    hull = ConvexHull(np.argwhere(seen)).volume
    for reach in _CLOSING_CELLS:
        # Filled while it is thick: through a rim of single cells what is outside gets in.
        thick = ndimage.binary_dilation(np.pad(seen, reach), iterations=reach)
        filled = ndimage.binary_erosion(ndimage.binary_fill_holes(thick), iterations=reach)
        hidden = filled[reach:-reach, reach:-reach] & ~seen
        parts, free = (ndimage.binary_opening(cells, iterations=3) for cells in (hidden, hidden & ~apart))
        hidden = ndimage.binary_propagation(free, mask=parts)
        if hidden.sum() > _LEAST_BASE_SHARE * hull:
            break
    return hidden


def _extended(grid: Grid, side: UnseenSide, hidden: Flags, free: Flags) -> tuple[Flags, Flags]:
    """Cells of the base on the likeliest outline of the side that nobody saw, and on any.

    hidden: within what was seen of the rim.
    free: where nothing was seen that ends a base.
    """
    nodes = grid.nodes_m
    share = side.share_out(nodes)
    hidden = _largest(ndimage.binary_opening(hidden | (free & (share < 1.0)), iterations=3))
    for number in range(DRAWN):
        share = np.minimum(share, side.share_out(nodes, number))
    return hidden, hidden | _largest(hidden | (free & (share < 1.0) & side.in_range(nodes)))


def _stands_on_feet(grid: Grid, seen: Flags, hidden: Flags, feet: Flags, passed: bool) -> bool:
    """Whether the rock lies low in few directions around its hidden part, or that is passed between wide feet."""
    if not hidden.any() or not seen.any():
        return False
    if passed and (feet & ~hidden).sum() > _FEET_SHARE * hidden.sum():
        return True
    around = np.unique(sectors(grid.nodes_m[seen] - grid.nodes_m[hidden].mean(axis=0)))
    return len(around) <= _FEET_AROUND_SHARE * SECTORS


def _feet(grid: Grid, seen: Flags, shown: Flags) -> Flags:
    """Cells between what was seen of a rock's feet where the pedestal was not: those of each foot."""
    nodes = grid.nodes_m
    hull = ConvexHull(nodes[seen]).equations
    inside = (nodes @ hull[:, :2].T + hull[:, 2] <= 0.0).all(axis=-1)
    # Along the pedestal's edge runs a strip that a few points leave open.
    return ndimage.binary_opening(inside & ~seen & ~shown, iterations=2)


def _largest(mask: Flags) -> Flags:
    """Keep the largest connected part."""
    parts, count = ndimage.label(mask)
    return parts == 1 + np.argmax(np.bincount(parts.ravel())[1:]) if count else mask


def _deepest(depth: Array, hidden: Flags) -> Flags:
    """Where the rock rests: the core of each hole, whose border skimming rays miss; all of a wide one."""
    holes, count = ndimage.label(depth > 0)
    if count == 0:
        return depth > 0
    deepest = np.append(0.0, ndimage.maximum(depth, holes, np.arange(1, count + 1)))
    deepest = np.where(deepest < 2.0, 1e9, deepest)  # cells: a gap between rows of points
    share = np.append(1.0, np.bincount(holes.ravel(), minlength=count + 1)[1:] / hidden.sum())
    least = np.where(share > _FLAT_SHARE, 0.0, _CORE_OF_HOLES * deepest)
    return (depth > 0) & (depth >= least[holes])


def _lowest(grid: Grid, points: Array) -> tuple[Array, Flags]:
    """Least height in each cell, and which cells hold points."""
    index = grid.index(points)
    order = np.lexsort((points[:, 2], index))
    cells, first = np.unique(index[order], return_index=True)
    height = np.zeros(grid.shape)
    seen = np.zeros(grid.shape, bool)
    height.ravel()[cells] = points[order, 2][first]
    seen.ravel()[cells] = True
    return height, seen
