"""What standing rocks do to a hazard of events: branches weighted, factors, the hazard at a site before and after."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import brentq

from toppling.results.hazard.ages import Exposure
from toppling.results.hazard.events import (
    NEGLIGIBLE,
    EventBranch,
    EventSet,
    FeltRock,
    any_topples,
    drawn_rocks,
    leave_one_out,
    rank_branches,
    rank_models,
    standing_shares,
    survival,
)
from toppling.results.hazard.surfaces import stouter
from toppling.results.hazard.tree import effective_branches, weighted_fractile

FACTORS = (1e-3, 1e3)
"""Factors of the motions within which the largest is sought."""

FACTOR_DRAWS = 60
LEVELS = 40
FRACTILES = (0.05, 0.16, 0.5, 0.84, 0.95)


def scale_factor(
    rocks: Sequence[FeltRock], branch: EventBranch, exposure: Exposure, confidence: float = 0.95
) -> float:
    """Largest factor by which a branch's motions may be multiplied for survival to stay above 1 - confidence.

    Infinite where no factor topples the rocks often enough, 0 where none is small enough.
    """

    def above(logarithm: float) -> float:
        scaled = [replace(rock, fragility=stouter(rock.fragility, math.exp(-logarithm))) for rock in rocks]
        return survival(scaled, branch, exposure) - (1.0 - confidence)

    low, high = map(math.log, FACTORS)
    if above(high) > 0:
        return math.inf
    if above(low) < 0:
        return 0.0
    return math.exp(brentq(above, low, high, xtol=1e-4))


def scale_factor_interval(
    rocks: Sequence[FeltRock],
    branch: EventBranch,
    exposure: Exposure,
    confidence: float = 0.95,
    seed: int = 0,
    sampled: bool = True,
) -> tuple[float, float]:
    """Interval (95 %) of the factor with events drawn anew, ages, and fragilities where other records' are known."""
    random = np.random.default_rng(seed)
    found = []
    for number in range(FACTOR_DRAWS):
        times = random.poisson(1.0, len(branch.rate)) if sampled else np.ones(len(branch.rate))
        drawn = replace(
            branch,
            rate=(branch.rate * times)[times > 0],
            motions={name: values[times > 0] for name, values in branch.motions.items()},
        )
        once = exposure.drawn(int(random.integers(exposure.years.shape[1])))
        found.append(scale_factor(drawn_rocks(rocks, number), drawn, once, confidence))
    low, high = np.quantile(found, [0.025], method="lower"), np.quantile(found, [0.975], method="higher")
    return float(low[0]), float(high[0])


@dataclass(frozen=True, eq=False)
class EventUpdate:
    """A set of events and the rocks that have stood through them.

    Parameters
    ----------
    rocks : sequence of FeltRock
    events : EventSet
    exposure : Exposure
    confidence : float
        A branch under which the rocks survive with less than 1 - confidence is rejected.
    """

    rocks: Sequence[FeltRock]
    events: EventSet
    exposure: Exposure
    confidence: float = 0.95

    @cached_property
    def branches(self) -> pd.DataFrame:
        """Table of `rank_branches`, with scale_factor, scale_factor_low and scale_factor_high."""
        table = rank_branches(self.rocks, self.events, self.exposure, self.confidence)
        lines = []
        for number, branch in enumerate(self.events.branches):
            felt = self._felt(branch)
            low, high = scale_factor_interval(
                self.rocks, felt, self.exposure, self.confidence, number, self.events.sampled
            )
            factor = scale_factor(self.rocks, felt, self.exposure, self.confidence)
            lines.append({"scale_factor": factor, "scale_factor_low": low, "scale_factor_high": high})
        return pd.concat([table, pd.DataFrame(lines)], axis=1)

    @cached_property
    def models(self) -> pd.DataFrame:
        """Table of `rank_models`."""
        return rank_models(self.branches)

    @cached_property
    def left_out(self) -> pd.DataFrame | None:
        """Table of `leave_one_out`; None of a single rock."""
        return leave_one_out(self.rocks, self.events, self.exposure) if len(self.rocks) > 1 else None

    @property
    def survival(self) -> float:
        """Of all rocks, the branches averaged by their weights."""
        return float(self.events.prior @ self.branches["survival"])

    @property
    def effective_branches(self) -> float | None:
        """Number of branches that bear the weight after; None where the rocks survive under none."""
        weights = self.branches["posterior_weight"].to_numpy()
        return None if np.isnan(weights).any() else effective_branches(weights)

    def updated(self, measure: str, site: int = 0) -> pd.DataFrame:
        """Annual rates of exceedance at a site before and after, counted from the events.

        Returns
        -------
        DataFrame
            level (SI), rate_prior_mean, rate_posterior_mean, and rate_prior_p05 ... rate_posterior_p95 (fractiles over
            branches by OpenQuake's rule, of 5, 16, 50, 84 and 95 %; posterior null where the rocks survive under no
            branch).
        """
        values = [branch.motions[measure][:, site] for branch in self.events.branches]
        felt = np.concatenate([one[one > 0] for one in values])
        if not len(felt):
            return pd.DataFrame()
        levels = np.geomspace(np.quantile(felt, 0.02), felt.max() * 0.999, LEVELS)
        pairs = zip(values, self.events.branches, strict=True)
        rates = np.array([_exceeded(one, branch.rate, levels) for one, branch in pairs])
        table = pd.DataFrame({"level": levels})
        after = self.branches["posterior_weight"].to_numpy()
        for name, weights in (("prior", self.events.prior), ("posterior", after)):
            known = not np.isnan(weights).any()
            table[f"rate_{name}_mean"] = weights @ rates if known else math.nan
            for q in FRACTILES:
                table[f"rate_{name}_p{round(100 * q):02d}"] = (
                    weighted_fractile(rates, weights, q) if known else math.nan
                )
        return table

    def _felt(self, branch: EventBranch) -> EventBranch:
        """A branch without the events that topple nothing even a factor stronger: a large set has few others."""
        if len(branch.rate) < 2000:
            return branch
        scaled = [replace(rock, fragility=stouter(rock.fragility, 0.1)) for rock in self.rocks]
        together = np.ones((1, len(self.rocks)), np.int8)
        some = any_topples(standing_shares(scaled, branch), together)[0] > NEGLIGIBLE
        return replace(
            branch,
            rate=branch.rate[some],
            motions={name: values[some] for name, values in branch.motions.items()},
        )


def _exceeded(
    values: NDArray[np.float64], rate: NDArray[np.float64], levels: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Rate of events above each level."""
    order = np.argsort(values)
    summed = np.concatenate([np.cumsum(rate[order][::-1])[::-1], [0.0]])
    return summed[np.searchsorted(values[order], levels, side="right")]
