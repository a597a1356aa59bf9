"""Rocks under sets of events: survival event by event, branch by branch, of several rocks at several sites.

An event e of annual rate r_e topples at least one of some rocks with 1 - prod(1 - F_i(motion of e at rock i)): rocks
at several sites feel the same events, and taking them as independent would be biased. Such events have the rate
nu = sum r_e (1 - prod(1 - F_i)), and all rocks survive A years with exp(-nu A), the events being Poisson.

A set of events is a sample: where few of them bear the rate, nu is uncertain by chance. `events_drawn_anew` draws every
event a Poisson number of times.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from toppling.models.arrays import Array
from toppling.models.errors import InputError
from toppling.models.shares import effective_number
from toppling.results.analysis.lognormal import Lognormal, Surface
from toppling.results.hazard.ages import AS_NOW, STOUTER, Exposure, Since
from toppling.results.hazard.tree import branch_weights

_DRAWS = 200
"""Resamples of the events, and of the fragilities with them."""

_AGES = 1
"""Seed of the ages of draws: branches are compared under the same ones."""

NEGLIGIBLE = 1e-12
"""Toppling probability of an event below which it is not resampled."""

_LEAST_LOGARITHM = -745.0
"""Of a probability of survival: exp gives 0, and 0 times it is 0."""


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
    # mapping of (m, sites): by measure, in its SI unit; 0 where an event is not felt.
    motions: Mapping[str, Array]
    weight: float = 1.0  # of this branch among others
    model: str = ""  # its ground-motion model, where the branches' names tell it

    def at(self, site: int) -> Motions:
        """Motions at one site, by measure."""
        return {name: values[:, site] for name, values in self.motions.items()}

    def chosen(self, some: NDArray[np.bool_]) -> "EventBranch":
        """The branch with some of its events (m,) alone."""
        motions = {name: values[some] for name, values in self.motions.items()}
        return replace(self, rate=self.rate[some], motions=motions)


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

    @property
    def measures(self) -> tuple[str, ...]:
        """Measures of the motions."""
        return tuple(self.branches[0].motions)

    @property
    def prior(self) -> Array:
        """Weights of the branches, which sum to 1."""
        weights = np.array([branch.weight for branch in self.branches])
        return weights / weights.sum()

    def readings_of(self, number: int) -> list[EventBranch]:
        """A branch as each of the readings has it."""
        return [branches[number] for branches in self.readings]


@dataclass(frozen=True, eq=False)
class FeltRock:
    """A rock at a site of a set of events."""

    name: str
    fragility: Fragility
    site: int = 0  # number of the site
    # Fragilities of resampled records; empty where they are not known.
    drawn: Sequence[Fragility] = field(default=())
    since: Since | None = None  # when it became as fragile as it is; None where it has always been


def topples(fragility: Fragility, motions: Motions) -> Array:
    """Toppling probability of events, given their motions.

    Raises InputError if the motions lack a measure of the fragility.
    """
    lacking = [name for name in fragility.measures if name not in motions]
    if lacking:
        raise InputError("hazard.measure_other",
            what=f"states {', '.join(motions)}, and no {', '.join(lacking)}", where="--hazard",
            expected=f"motions in {', '.join(fragility.measures)}, as the rock's fragility is over them",
            remedy="choose another --measure, or compute fields of that measure too")  # fmt: skip
    if isinstance(fragility, Surface):
        return fragility.probability(motions)
    return fragility.probability(motions[fragility.measure])


def standing_shares(rocks: Sequence[FeltRock], branch: EventBranch) -> tuple[NDArray, NDArray]:
    """Logarithms of 1 - F of each rock in each event, (rocks, m): as the rocks are, and as they were before."""
    now = np.array([_log_standing(rock.fragility, branch.at(rock.site)) for rock in rocks])
    before = now.copy()
    for number, rock in enumerate(rocks):
        if rock.since is not None and math.isfinite(rock.since.factor):
            then = rock.fragility.stouter(rock.since.factor)
            before[number] = _log_standing(then, branch.at(rock.site))
    return now, before


def any_topples(
    shares: tuple[NDArray, NDArray], states: NDArray[np.int8], some: NDArray | slice = slice(None)
) -> Array:
    """Probability that an event topples at least one of the rocks, in each state: (s, m)."""
    now, before = shares
    as_now, as_before = (states == AS_NOW).astype(float), (states == STOUTER).astype(float)
    return -np.expm1(np.maximum(as_now @ now[:, some] + as_before @ before[:, some], _LEAST_LOGARITHM))


def survival(rocks: Sequence[FeltRock], branch: EventBranch, exposure: Exposure) -> float:
    """Probability that all rocks still stand under a branch's events."""
    return exposure.survival(any_topples(standing_shares(rocks, branch), exposure.states) @ branch.rate)


def toppling_probabilities(rocks: Sequence[FeltRock], branch: EventBranch) -> Array:
    """Probability that each event topples at least one of the rocks as they are, (m,)."""
    together = np.full((1, len(rocks)), AS_NOW, np.int8)
    return any_topples(standing_shares(rocks, branch), together)[0]


def events_drawn_anew(
    rocks: Sequence[FeltRock],
    branch: EventBranch,
    exposure: Exposure,
    draws: int = _DRAWS,
    seed: int = 0,
    sampled: bool = True,
    readings: Sequence[EventBranch] = (),
) -> Array:
    """Topplings to be expected, all that is uncertain resampled: events, fragilities of other records, and ages.

    Survival is exp(-topplings), which hundreds of them make 0 to the last bit. Each event of a sample occurs a Poisson
    number of times with a mean of 1, as the number of events in a catalogue would. Each sample takes one of the
    branch's readings, in turn.

    Returns (draws,) array.
    """
    random = np.random.default_rng(seed)
    ages = np.random.default_rng(_AGES).integers(exposure.years.shape[1], size=draws)
    readings = readings or (branch,)
    as_read = [standing_shares(rocks, one) for one in readings]
    found = np.empty(draws)
    for number in range(draws):
        turn = number % len(readings)
        branch, shares = readings[turn], as_read[turn]
        if any(rock.drawn for rock in rocks):
            shares = standing_shares(drawn_rocks(rocks, number), branch)
        felt = np.flatnonzero(shares[0].min(axis=0) < -NEGLIGIBLE)
        rate = branch.rate[felt] * (random.poisson(1.0, len(felt)) if sampled else 1.0)
        once = exposure.drawn(int(ages[number]))
        found[number] = float(any_topples(shares, once.states, felt) @ rate @ once.years[:, 0])
    return found


def bootstrap_branches(rocks: Sequence[FeltRock], events: EventSet, exposure: Exposure) -> list[Array]:
    """`events_drawn_anew` of each branch: the same records and ages for all, and events of their own."""
    return [
        events_drawn_anew(
            rocks, branch, exposure, seed=number, sampled=events.sampled, readings=events.readings_of(number)
        )
        for number, branch in enumerate(events.branches)
    ]


def drawn_rocks(rocks: Sequence[FeltRock], number: int) -> list[FeltRock]:
    """Rocks with the fragilities of a sample of records, where these are known."""
    return [
        replace(rock, fragility=rock.drawn[number % len(rock.drawn)]) if rock.drawn else rock
        for rock in rocks
    ]


def rank_branches(
    rocks: Sequence[FeltRock],
    events: EventSet,
    exposure: Exposure,
    confidence: float = 0.95,
    drawn: Sequence[Array] | None = None,
) -> pd.DataFrame:
    """Survival and Bayes weight of each branch, by all rocks together.

    `drawn` are topplings under each branch with everything resampled (`bootstrap_branches`), where these are known.

    Returns DataFrame: one row a branch, in the set's order: name, model, events, effective_events (Kish's number of
    those that bear the toppling rate), toppling_rate (annual), survival, survival_low and survival_high (95 %: events,
    records and ages resampled), rejected (survival below 1 - confidence), prior_weight, posterior_weight (null where
    no branch lets the rocks survive), rank (1 is the branch that the rocks favour most).
    """
    lines = []
    resampled = bootstrap_branches(rocks, events, exposure) if drawn is None else drawn
    for branch, prior, topplings in zip(events.branches, events.prior, resampled, strict=True):
        low, high = np.quantile(np.exp(-topplings), [0.025, 0.975])
        survives = survival(rocks, branch, exposure)
        part = toppling_probabilities(rocks, branch) * branch.rate
        lines.append({
            "name": branch.name, "model": branch.model, "events": len(branch.rate),
            "effective_events": effective_number(part) if part.sum() > 0 else 0.0,
            "toppling_rate": float(part.sum()), "survival": survives,
            "survival_low": low, "survival_high": high, "rejected": survives < 1.0 - confidence,
            "prior_weight": prior,
        })  # fmt: skip
    table = pd.DataFrame(lines)
    table["posterior_weight"] = branch_weights(table["prior_weight"], table["survival"])
    return table.assign(rank=table["survival"].rank(ascending=False, method="min").astype(int))


def rank_models(ranked: pd.DataFrame) -> pd.DataFrame:
    """Rank ground-motion models: survival averaged over a model's branches, and its weight before and after.

    ranked: from `rank_branches`.
    Returns DataFrame: best first: model, branches, survival, prior_weight, posterior_weight, bayes_factor (over all
    models' mean).
    """
    parts = ranked.assign(joint=ranked["prior_weight"] * ranked["survival"])
    table = parts.groupby("model", sort=False).agg(
        branches=("name", "size"), joint=("joint", "sum"), prior_weight=("prior_weight", "sum"),
        posterior_weight=("posterior_weight", lambda weights: weights.sum(min_count=1)),
    ).reset_index()  # fmt: skip
    table["survival"] = table.pop("joint") / table["prior_weight"]
    table["bayes_factor"] = table["survival"] / (table["survival"] @ table["prior_weight"])
    order = ["model", "branches", "survival", "prior_weight", "posterior_weight", "bayes_factor"]
    return table[order].sort_values("survival", ascending=False, ignore_index=True)


def leave_one_out(rocks: Sequence[FeltRock], events: EventSet, exposure: Exposure) -> pd.DataFrame:
    """What each rock adds: weights of the branches without it, and its survival as the others predict it.

    Returns DataFrame: one row a rock and branch: left_out, branch, survival_of_others, posterior_weight (by the
    others), survival_predicted (of the rock that is left out, given that the others stand: the same in all its
    rows).
    """
    whole = np.array([survival(rocks, branch, exposure) for branch in events.branches])
    tables = []
    for number, rock in enumerate(rocks):
        others = [one for place, one in enumerate(rocks) if place != number]
        left = replace(exposure, states=np.delete(exposure.states, number, axis=1))
        survivals = np.array(
            [survival(others, branch, left) if others else 1.0 for branch in events.branches]
        )
        chance = events.prior @ survivals
        tables.append(pd.DataFrame({
            "left_out": rock.name, "branch": [branch.name for branch in events.branches],
            "survival_of_others": survivals, "posterior_weight": branch_weights(events.prior, survivals),
            "survival_predicted": (events.prior @ whole) / chance if chance > 0 else math.nan,
        }))  # fmt: skip
    return pd.concat(tables, ignore_index=True)


def check_measures(rocks: Sequence[FeltRock], events: EventSet) -> None:
    """Refuse rocks whose fragility is over a measure that the events do not state, before anything is computed."""
    for rock in rocks:
        topples(rock.fragility, {name: np.empty(0) for name in events.measures})
        if not 0 <= rock.site < len(events.sites):
            raise InputError("site.unknown", what=f"{rock.name} stands at site number {rock.site}",
                where=events.source, expected=f"one of {len(events.sites)} sites",
                remedy="choose its site with --site")  # fmt: skip


def _log_standing(fragility: Fragility, motions: Motions) -> Array:
    with np.errstate(divide="ignore"):
        return np.maximum(np.log1p(-topples(fragility, motions)), _LEAST_LOGARITHM)
