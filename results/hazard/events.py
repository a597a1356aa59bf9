"""Events with annual rates and motions, branch by branch: sets of earthquakes, and hazard curves read as events."""

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
"""Curves whose events share their motions, so that a tree of thousands needs no more memory than one of these."""

Motions = Mapping[str, Array]
"""Values of each measure, in its SI unit, of some events; 0 where an event is not felt."""

Fragility = Lognormal | Surface


@dataclass(frozen=True)
class EventSite:
    """A site of a set of events."""

    name: str
    place: tuple[float, float] | None = None  # (longitude, latitude): degrees


@dataclass(frozen=True, eq=False)
class EventBranch:
    """Events of one branch, or of one model."""

    name: str
    rate: Array  # (m,): annual rate of each event
    # mapping of (m, sites): by measure, in its SI unit; 0 where an event is not felt. Branches may share it.
    motions: Motions
    weight: float = 1.0  # of this branch among others
    model: str = ""  # its ground-motion model, where the branches' names tell it


@dataclass(frozen=True, eq=False)
class Group:
    """Branches that share their events' motions."""

    numbers: list[int]
    motions: Motions
    rates: Array  # (branches, m)

    def chosen(self, some: NDArray) -> "Group":
        """Some of the events (m,) alone."""
        return Group(
            self.numbers, {name: each[some] for name, each in self.motions.items()}, self.rates[:, some]
        )


def _groups_of(branches: Sequence[EventBranch]) -> list[Group]:
    """Branches by the motions that they share."""
    alike: dict[int, list[int]] = {}
    for number, branch in enumerate(branches):
        alike.setdefault(id(branch.motions), []).append(number)
    return [
        Group(numbers, branches[numbers[0]].motions, np.array([branches[n].rate for n in numbers]))
        for numbers in alike.values()
    ]


@dataclass(frozen=True, eq=False)
class EventSet:
    """Branches of events that are felt at the same sites."""

    sites: tuple[EventSite, ...]
    branches: tuple[EventBranch, ...]
    source: str  # file or folder
    # Time that the events of each branch were simulated for, where they are a catalogue.
    years: float | None = None
    notes: tuple[str, ...] = ()  # what a reader of the answer should know
    # Whether the events are a sample, whose rates are uncertain by chance; not where they stand for hazard
    # curves.
    sampled: bool = True
    # The branches again, once for each of several equally likely readings of what the hazard leaves open;
    # intervals are over them. Empty where nothing is left open.
    readings: tuple[tuple[EventBranch, ...], ...] = ()
    # Whether two measures of one event vary together as in earthquakes.
    correlated: bool = True
    # Events of the mean hazard; None where it is the branches' events at their rates times the weights.
    mean: EventBranch | None = None

    @property
    def measures(self) -> tuple[str, ...]:
        """Measures of the motions."""
        return tuple(self.branches[0].motions)

    @property
    def prior(self) -> Array:
        """Weights of the branches, which sum to 1."""
        weights = np.array([branch.weight for branch in self.branches])
        return weights / weights.sum()

    @cached_property
    def groups(self) -> list[Group]:
        """The branches and, last, the mean hazard, by the motions that they share."""
        return _groups_of([*self.branches, self.mean or _together(self.branches, self.prior)])

    @cached_property
    def drawn_groups(self) -> list[list[Group]]:
        """The branches of each reading, without the mean hazard unless it has events of its own."""
        own = [self.mean] if self.mean else []
        return [_groups_of([*branches, *own]) for branches in self.readings or (self.branches,)]


def _together(branches: Sequence[EventBranch], prior: Array) -> EventBranch:
    """The events of all branches, at their rates times the branches' weights."""
    rates = [w * branch.rate for w, branch in zip(prior, branches, strict=True)]
    motions = {name: np.concatenate([one.motions[name] for one in branches]) for name in branches[0].motions}
    return EventBranch(MEAN, np.concatenate(rates), motions)


@dataclass(frozen=True, eq=False)
class Standing:
    """A rock that has stood through events."""

    name: str
    fragility: Fragility
    site: int = 0  # number of its site among those of the events
    since: Since | None = None  # when it became as fragile as it is; None where it has always been
    age: str = ""  # how long it has stood, as it was stated

    @property
    def curve(self) -> Lognormal:
        """Its fragility, of a rock that has one over a single measure."""
        assert isinstance(self.fragility, Lognormal)
        return self.fragility

    @cached_property
    def drawn(self) -> list[Any]:
        """Its fragility of each resample of the records; none where they are not known."""
        known = self.fragility.resampled
        if known is None or not len(known.fitted):
            return []
        if isinstance(self.fragility, Surface):
            return [*known.surfaces(self.fragility.measures)]
        return [*known.lognormals(self.fragility.measure)]


def events_of_tree(tree: HazardTree, rocks: Sequence[Standing], mean: HazardCurve) -> EventSet:
    """Curves of a tree, and of its mean, as events: the falls of their rates from level to level."""
    medians = [rock.curve.median for rock in rocks]
    curves = [*tree.curves, mean]
    found: list[EventBranch] = []
    for first in range(0, len(curves), _SHARED):
        some = curves[first : first + _SHARED]
        intensity, rates = events_of_curves(some, medians)
        motions = {tree.measure: intensity[:, None]}
        found += [EventBranch(curve.name, rate, motions) for curve, rate in zip(some, rates, strict=True)]
    branches = tuple(
        replace(events, name=one.name, weight=one.weight, model=one.model)
        for events, one in zip(found[:-1], tree.branches, strict=True)
    )
    site = EventSite(tree.site_name or "site", tree.site)
    return EventSet((site,), branches, tree.weights_from, sampled=False, mean=found[-1])
