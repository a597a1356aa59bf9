"""Events with annual rates and motions for each branch: sets of earthquakes, and hazard curves as events."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from toppling.models.arrays import Array
from toppling.results.analysis.lognormal import Lognormal, Surface
from toppling.results.hazard.ages import Since
from toppling.results.hazard.curves import HazardCurve, events_of_curves
from toppling.results.hazard.tree import HazardTree

MEAN = "mean hazard"

_SHARED = 128
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
    for first in range(0, len(curves), _SHARED):
        some = curves[first : first + _SHARED]
        intensity, rates = events_of_curves(some, medians)
        motions = {tree.measure: intensity[:, None]}
        found += [EventBranch(curve.name, rate, motions) for curve, rate in zip(some, rates, strict=True)]
    branches = tuple(
        replace(events, name=branch.name, weight=branch.weight, model=branch.model)
        for events, branch in zip(found[:-1], tree.branches, strict=True)
    )
    site = EventSite(tree.site_name or "site", tree.site)
    return EventSet((site,), branches, tree.weights_from, sampled=False, mean=found[-1])
