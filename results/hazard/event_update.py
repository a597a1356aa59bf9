"""What standing rocks do to a hazard of events: branches weighted, factors, the hazard at a site before and after."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd

from toppling.models.arrays import Array
from toppling.results.analysis.lognormal import ends
from toppling.results.hazard.ages import Exposure
from toppling.results.hazard.event_survival import (
    NEGLIGIBLE,
    EventBranch,
    EventSet,
    FeltRock,
    any_topples,
    bootstrap_branches,
    drawn_rocks,
    leave_one_out,
    rank_branches,
    rank_models,
    standing_shares,
    survival,
    toppling_probabilities,
)
from toppling.results.hazard.survival import greatest_rate, largest_factor
from toppling.results.hazard.tree import drawn_weights, statistics_of
from toppling.results.hazard.update import MEAN, changes_of, decided_by, rates_table

_FACTOR_DRAWS = 60
_LEVELS = 40


@dataclass(frozen=True, eq=False)
class EventUpdate:
    """A set of events and the rocks that have stood through them."""

    rocks: Sequence[FeltRock]
    events: EventSet
    exposure: Exposure
    # A branch under which the rocks survive with less than 1 - confidence is rejected.
    confidence: float = 0.95

    @cached_property
    def topplings(self) -> Array:
        """Topplings to be expected under each branch with everything resampled, (draws, branches)."""
        return np.array(bootstrap_branches(self.rocks, self.events, self.exposure)).T

    @cached_property
    def branches(self) -> pd.DataFrame:
        """Table of `rank_branches`, with the factors.

        scale_factor is of motions, rate_factor of rates, and each has _low and _high (95 %: events, records and ages
        drawn again).
        """
        table = rank_branches(self.rocks, self.events, self.exposure, self.confidence, list(self.topplings.T))
        lines = [
            self._factors([branch, *self.events.readings_of(number)], self.topplings[:, number], number)
            for number, branch in enumerate(self.events.branches)
        ]
        return pd.concat([table, pd.DataFrame(lines)], axis=1)

    @cached_property
    def mean(self) -> dict[str, float | str]:
        """Survival and factors of the branches' mean: the events of all, at their rates times the weights."""
        together = [self._together(branches) for branches in (self.events.branches, *self.events.readings)]
        topplings = self.topplings @ self.events.prior  # draws of all branches are of the same rocks and ages
        low, high = np.quantile(np.exp(-topplings), [0.025, 0.975])
        survives = survival(self.rocks, together[0], self.exposure)
        statement = {"name": MEAN, "survival": survives, "survival_low": low, "survival_high": high}
        return statement | self._factors(together, topplings, len(self.events.branches))

    def _together(self, branches: Sequence[EventBranch]) -> EventBranch:
        """The events of all branches, at their rates times the branches' weights."""
        rates = [w * branch.rate for w, branch in zip(self.events.prior, branches, strict=True)]
        motions = {
            name: np.concatenate([one.motions[name] for one in branches]) for name in self.events.measures
        }
        return EventBranch(MEAN, np.concatenate(rates), motions)

    def _factors(self, readings: Sequence[EventBranch], topplings: Array, seed: int) -> dict[str, float]:
        """Factors of a branch, the first of its readings, and their intervals over the others."""
        felt, *others = [self._felt(one) for one in readings]
        motions = self._scale_factor_interval(others or [felt], seed)
        allowed = (
            any_topples(standing_shares(self.rocks, readings[0]), self.exposure.states) @ readings[0].rate
        )
        with np.errstate(divide="ignore"):
            rates = ends(-math.log(1.0 - self.confidence) / topplings)
        return {
            "scale_factor": self._scale_factor(self.rocks, felt, self.exposure),
            "scale_factor_low": float(motions[0]), "scale_factor_high": float(motions[1]),
            "rate_factor": greatest_rate(allowed @ self.exposure.years, 1.0 - self.confidence),
            "rate_factor_low": rates[0], "rate_factor_high": rates[1],
        }  # fmt: skip

    def _scale_factor(self, rocks: Sequence[FeltRock], branch: EventBranch, exposure: Exposure) -> float:
        """Largest factor by which a branch's motions may be multiplied for survival to stay above 1 - confidence.

        Infinite where no factor topples the rocks often enough, 0 where none is small enough.
        """

        def above(logarithm: float) -> float:
            scaled = [replace(one, fragility=one.fragility.stouter(math.exp(-logarithm))) for one in rocks]
            return survival(scaled, branch, exposure) - (1.0 - self.confidence)

        return largest_factor(above, precision=1e-4)

    def _scale_factor_interval(self, readings: Sequence[EventBranch], seed: int) -> Array:
        """Ends of 95 % of the factor with everything uncertain resampled, as `bootstrap_branches` does."""
        random = np.random.default_rng(seed)
        found = []
        for number in range(_FACTOR_DRAWS):
            branch = readings[number % len(readings)]
            count = len(branch.rate)
            times = random.poisson(1.0, count) if self.events.sampled else np.ones(count)
            drawn = replace(branch, rate=branch.rate * times).chosen(times > 0)
            once = self.exposure.drawn(int(random.integers(self.exposure.years.shape[1])))
            found.append(self._scale_factor(drawn_rocks(self.rocks, number), drawn, once))
        return ends(np.array(found))

    @cached_property
    def models(self) -> pd.DataFrame:
        """Table of `rank_models`."""
        return rank_models(self.branches)

    @cached_property
    def left_out(self) -> pd.DataFrame | None:
        """Table of `leave_one_out`; None for a single rock."""
        return leave_one_out(self.rocks, self.events, self.exposure) if len(self.rocks) > 1 else None

    @property
    def posterior(self) -> Array | None:
        """Bayes weights; None where the rocks survive under no branch."""
        weights = self.branches["posterior_weight"].to_numpy()
        return None if np.isnan(weights).any() else weights

    @property
    def decided(self) -> dict[str, float | None]:
        """How much the rocks decide, as `Update.decided` states it of curves."""
        return decided_by(
            self.events.prior, self.posterior, self.branches["survival"], self.branches["rejected"]
        )

    def counted(self, measure: str, sites: Sequence[int]) -> tuple[Array, Array]:
        """Levels, and each branch's rate of events above them at sites (branches, sites, levels); none felt, none."""
        branches = self.events.branches
        felt = np.concatenate([branch.motions[measure][:, sites].ravel() for branch in branches])
        felt = felt[felt > 0]
        if not len(felt):
            return np.empty(0), np.empty((len(branches), len(sites), 0))
        levels = np.geomspace(np.quantile(felt, 0.02), felt.max() * 0.999, _LEVELS)
        return levels, np.array([
            [_exceeded(branch.motions[measure][:, site], branch.rate, levels) for site in sites] for branch in branches
        ])  # fmt: skip

    def before_and_after(self, measure: str, site: int = 0) -> tuple[pd.DataFrame, pd.DataFrame]:
        """Annual rates of exceedance at a site before and after, and motions exceeded at some of them.

        Returns DataFrame: level (SI), rate_prior_mean, rate_posterior_mean, and rate_prior_p05 ... rate_posterior_p95
        (fractiles over branches of 5, 16, 50, 84 and 95 %; posterior null where the rocks survive under no branch).
        Returns DataFrame: as `update.changes_table` states motions of curves.
        """
        levels, counted = self.counted(measure, [site])
        if not len(levels):
            return pd.DataFrame(), pd.DataFrame()
        rates = counted[:, 0]
        before = statistics_of(levels, rates, self.events.prior)
        after = None if self.posterior is None else statistics_of(levels, rates, self.posterior)
        means = drawn_weights(self.events.prior, np.exp(-self.topplings)) @ rates
        table = rates_table(levels, {"prior": before, "posterior": after})
        return table, changes_of(before, after, means, ends)

    def _felt(self, branch: EventBranch) -> EventBranch:
        """A branch without the events that topple nothing even a factor stronger: a large set has few others."""
        if len(branch.rate) < 2000:
            return branch
        scaled = [replace(rock, fragility=rock.fragility.stouter(0.1)) for rock in self.rocks]
        return branch.chosen(toppling_probabilities(scaled, branch) > NEGLIGIBLE)


def _exceeded(values: Array, rate: Array, levels: Array) -> Array:
    order = np.argsort(values)
    summed = np.concatenate([np.cumsum(rate[order][::-1])[::-1], [0.0]])
    return summed[np.searchsorted(values[order], levels, side="right")]
