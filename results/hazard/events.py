"""Events with annual rates and motions of each branch: sets of earthquakes, hazard curves as events, vector hazard."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from toppling.models.arrays import Array
from toppling.models.errors import InputError
from toppling.results.analysis.lognormal import STEPS, Lognormal, Surface
from toppling.results.hazard.ages import Since
from toppling.results.hazard.tree import HazardCurve, HazardTree, events_of_curves

MEAN = "mean hazard"

_CURVES_AT_ONCE = 128
"""Number of curves that are discretised to common events, which bounds memory for a tree of thousands."""

Motions = Mapping[str, Array]
"""Values of each measure of some events, in its SI unit; 0 where an event is not felt."""

Fragility = Lognormal | Surface


@dataclass(frozen=True)
class EventSite:
    """Site at which a set of events is felt."""

    name: str
    place: tuple[float, float] | None = None  # (longitude, latitude): degrees


@dataclass(frozen=True, eq=False)
class EventBranch:
    """Events of one branch of a hazard model."""

    name: str
    rate: Array  # (m,): annual rate of each event
    # mapping of (m, sites): by measure, in its SI unit; 0 where an event is not felt. Branches may share it.
    motions: Motions
    weight: float = 1.0  # weight among the branches
    model: str = ""  # ground-motion model, where the branch's name contains it


@dataclass(frozen=True, eq=False)
class Group:
    """Branches with the same events, and their rates."""

    numbers: list[int]
    motions: Motions
    rates: Array  # (branches, m)

    def chosen(self, some: NDArray) -> "Group":
        """Group of a subset of the events (m,)."""
        return Group(
            self.numbers, {name: values[some] for name, values in self.motions.items()}, self.rates[:, some]
        )


def _groups_of(branches: Sequence[EventBranch]) -> list[Group]:
    """Group branches that share the motions of their events."""
    alike: dict[int, list[int]] = {}
    for number, branch in enumerate(branches):
        alike.setdefault(id(branch.motions), []).append(number)
    return [
        Group(numbers, branches[numbers[0]].motions, np.array([branches[n].rate for n in numbers]))
        for numbers in alike.values()
    ]


@dataclass(frozen=True, eq=False)
class EventSet:
    """Hazard as events: branches whose events are felt at the same sites."""

    sites: tuple[EventSite, ...]
    branches: tuple[EventBranch, ...]
    source: str  # file or folder
    # Simulated time of each branch's catalogue, if the events are one.
    years: float | None = None
    notes: tuple[str, ...] = ()  # remarks for a reader of the results
    # Whether the events are a random sample with uncertain rates; False where they represent hazard curves.
    sampled: bool = True
    # Alternative, equally likely versions of the branches (such as of an unknown joint rate), which intervals include;
    # empty where the hazard is unambiguous.
    readings: tuple[tuple[EventBranch, ...], ...] = ()
    # Whether the residuals of two measures of one event are correlated as in earthquakes.
    correlated: bool = True
    # Events of the mean hazard; None for the branches' events with their weighted rates.
    mean: EventBranch | None = None

    @property
    def measures(self) -> tuple[str, ...]:
        """Measures of the motions."""
        return tuple(self.branches[0].motions)

    @property
    def prior(self) -> Array:
        """Normalised prior weights of the branches."""
        weights = np.array([branch.weight for branch in self.branches])
        return weights / weights.sum()

    @cached_property
    def groups(self) -> list[Group]:
        """Groups of the branches and, last, the mean hazard, by common motions."""
        return _groups_of([*self.branches, self.mean or _together(self.branches, self.prior)])

    @cached_property
    def drawn_groups(self) -> list[list[Group]]:
        """Groups of the branches of each of `readings`, with the mean hazard only if it has its own events."""
        own = [self.mean] if self.mean else []
        return [_groups_of([*branches, *own]) for branches in self.readings or (self.branches,)]


def _together(branches: Sequence[EventBranch], prior: Array) -> EventBranch:
    """Mean hazard: the events of all branches, with rates multiplied by the branches' weights."""
    rates = [w * branch.rate for w, branch in zip(prior, branches, strict=True)]
    motions = {
        name: np.concatenate([branch.motions[name] for branch in branches]) for name in branches[0].motions
    }
    return EventBranch(MEAN, np.concatenate(rates), motions)


@dataclass(frozen=True, eq=False)
class Standing:
    """A rock that still stands."""

    name: str
    fragility: Fragility
    site: int = 0  # index of its site among those of the events
    since: Since | None = None  # date at which it became as fragile as now; None where it always was
    age: str = ""  # label of its age
    narrowed_by: str = ""  # which measurement would narrow the interval of its fragility

    @property
    def curve(self) -> Lognormal:
        """Fragility over a single measure; an error for a surface."""
        assert isinstance(self.fragility, Lognormal)
        return self.fragility

    @cached_property
    def drawn(self) -> list[Any]:
        """Fragility of each resample of the records; empty without resamples."""
        known = self.fragility.resampled
        if known is None or not len(known.fitted):
            return []
        if isinstance(self.fragility, Surface):
            return [*known.surfaces(self.fragility.measures)]
        return [*known.lognormals(self.fragility.measure)]


def events_of_tree(tree: HazardTree, rocks: Sequence[Standing], mean: HazardCurve) -> EventSet:
    """Events of a tree's curves and their mean: the differences of rates between levels."""
    medians = [rock.curve.median for rock in rocks]
    curves = [*tree.curves, mean]
    found: list[EventBranch] = []
    for first in range(0, len(curves), _CURVES_AT_ONCE):
        some = curves[first : first + _CURVES_AT_ONCE]
        intensity, rates = events_of_curves(some, medians)
        motions = {tree.measure: intensity[:, None]}
        found += [EventBranch(curve.name, rate, motions) for curve, rate in zip(some, rates, strict=True)]
    branches = tuple(
        replace(events, name=branch.name, weight=branch.weight, model=branch.model)
        for events, branch in zip(found[:-1], tree.branches, strict=True)
    )
    site = EventSite(tree.site_name or "site", tree.site)
    return EventSet((site,), branches, tree.weights_from, sampled=False, mean=found[-1])


_CORRELATIONS = {("pga_m_s2", "pgv_m_s"): 0.733, ("sa_1s_m_s2", "pgv_m_s"): 0.786}
"""Correlation of the residuals of two measures of one earthquake: Bradley (2012)."""

SIGMA = 0.65
"""Standard deviation of ln PGV about a ground-motion model: Boore et al. (2014) at magnitude 7, 20 km."""

SCATTERS = 0.36, 0.62
"""Range of the standard deviation of ln PGV given PGA for unknown seismicity: from one recurring earthquake to many
near magnitudes."""
READINGS = 5
"""Number of scatters within `SCATTERS`, both ends included, that intervals are over."""
_BINS_PER_E_FOLD = 30
"""Number of bins of a measure per factor e of intensity."""
_EXTENDED = 3.0
"""Logarithm of the factor of intensity by which curves are extrapolated as power laws."""
_NODES = 16
"""Number of Gauss-Hermite nodes over the second measure, given the first."""
_END_SCATTERS = 4.0
"""Margin at the ends of the second measure's range, in scatters, where sums are incomplete."""
_SATURATED = 0.98
"""Fraction of the largest rate above which a curve is flat, so that the level of a rate is undefined."""
_CLOSE = 1e-4
"""Shift of ln(intensity) at which the search for g ends."""


def correlation_of(first: str, second: str) -> float | None:
    """Published correlation of the residuals of two measures; None if unknown."""
    return _CORRELATIONS.get((first, second), _CORRELATIONS.get((second, first)))


def joint_rate(first: HazardCurve, second: HazardCurve, scatter: float) -> tuple[EventBranch, float]:
    """Joint rate of two measures from their curves.

    Rates of the first measure below its curve's first point are not counted, and those above its last point are
    extrapolated as a power law over a factor of e^`_EXTENDED`.

    first, second: curves of one site over different measures.
    scatter: standard deviation of ln(second measure) given the first, sigma sqrt(1 - rho^2).
    Returns events at one site, and the largest relative difference of the rates of the second measure from its
    curve, where both curves have rates.
    Raises InputError if the curves are over one measure, or the scatter is invalid.
    """
    if first.measure == second.measure:
        raise _vector_error(
            "hazard.measure_given_twice", f"two curves over {first.measure}", "curves of two measures"
        )
    if not 0 <= scatter < 5:
        raise _vector_error("hazard.scatter_unusable", f"a scatter of {scatter:g}", "a scatter near 0.45")
    low, high = math.log(first.intensity[0]) - _EXTENDED, math.log(first.intensity[-1]) + _EXTENDED
    edges = np.linspace(low, high, math.ceil((high - low) * _BINS_PER_E_FOLD) + 1)
    rates = np.exp(_log_rate(first, edges))
    x = np.append((edges[1:] + edges[:-1]) / 2, edges[-1])
    part = np.append(-np.diff(rates), rates[-1])
    reached = np.append((rates[1:] + rates[:-1]) / 2, rates[-1] / 2)
    centre, misfit = _coupled(second, part, reached, scatter)
    stated = (x >= math.log(first.intensity[0])) & (part > 0)
    nodes, weights = np.polynomial.hermite_e.hermegauss(_NODES)
    values = np.exp(centre[stated, None] + scatter * nodes)
    events = EventBranch(
        f"{first.name} with {second.name}",
        (part[stated, None] * weights / weights.sum()).ravel(),
        {first.measure: np.repeat(np.exp(x[stated]), _NODES)[:, None], second.measure: values.reshape(-1, 1)},
    )
    return events, misfit


def _log_rate(curve: HazardCurve, logarithm: Array) -> Array:
    """Logarithm of the rate of exceedance, extrapolated by the power laws of the end segments."""
    x, rate = np.log(curve.intensity), np.log(curve.annual_rate)
    first, last = (np.diff(rate[ends]) / np.diff(x[ends]) for ends in (slice(0, 2), slice(-2, None)))
    inside = np.interp(logarithm, x, rate)
    return inside + first * np.minimum(logarithm - x[0], 0.0) + last * np.maximum(logarithm - x[-1], 0.0)


def _coupled(second: HazardCurve, part: Array, reached: Array, scatter: float) -> tuple[Array, float]:
    """Log medians of the second measure in the bins of the first, and the misfit of its rates."""
    low, high = math.log(second.intensity[0]) - 3 * _EXTENDED, math.log(second.intensity[-1]) + 3 * _EXTENDED
    y = np.linspace(low, high, math.ceil((high - low) * _BINS_PER_E_FOLD) + 1)
    falling = _log_rate(second, y) - 1e-9 * np.arange(len(y))  # strictly decreasing where the curve is flat
    wanted = np.interp(-np.log(reached), -falling, y)
    centre = wanted.copy()
    # Near the ends the sum lacks events beyond them: there the shift is that of the nearest interior bin.
    away = _END_SCATTERS * scatter
    inside = np.flatnonzero(
        (wanted > wanted[0] + away) & (wanted < wanted[-1] - away) & (reached < _SATURATED * reached.max())
    )
    if scatter > 0 and len(inside):
        for _ in range(STEPS):
            modelled = ndtr((centre - y[:, None]) / scatter) @ part
            at = np.interp(
                -np.log(reached), -np.log(np.maximum(modelled, 1e-300)) + 1e-9 * np.arange(len(y)), y
            )
            shift = np.interp(np.arange(len(part)), inside, (at - wanted)[inside])
            centre = np.minimum.accumulate((centre - shift)[::-1])[::-1]
            if np.abs(shift).max() < _CLOSE:
                break
    if not scatter > 0 or not len(inside):
        return centre, 0.0
    ends = reached[inside[[-1, 0]]]
    stated = second.intensity[(second.annual_rate > ends[0]) & (second.annual_rate < ends[1])]
    if not len(stated):
        return centre, 0.0
    found = ndtr((centre - np.log(stated)[:, None]) / scatter) @ part
    return centre, float(np.abs(found / second.rate(stated) - 1.0).max())


def _vector_error(code: str, what: str, expected: str) -> InputError:
    return InputError(
        code,
        what,
        where="--hazard",
        expected=expected,
        remedy="give one curve of each measure, of one site and component",
    )
