"""What standing rocks do to a hazard: branches weighted by survival, the hazard before and after, factors, levels."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from toppling.models.arrays import Array
from toppling.models.shares import effective_number
from toppling.results.analysis.lognormal import ends
from toppling.results.hazard.curves import (
    HazardCurve,
    annual_rate_of,
    bearing,
    intensity_at,
    probability_of,
    toppling_rate,
)
from toppling.results.hazard.survival import (
    Draws,
    Standing,
    drawn_factors,
    draws_of,
    joint_survival,
    motion_factor,
    rate_factor,
)
from toppling.results.hazard.tree import (
    FRACTILES,
    HazardTree,
    Statistics,
    branch_weights,
    common_levels,
    drawn_weights,
    level_choices,
    same_levels,
    statistics,
)

RATES = (1e-2, 1 / 475, 1e-3, 1 / 2475, 1e-4, 1e-5)
"""Annual rates at which motions are compared; those of 475 and 2475 years are 10 and 2 % in 50 years."""

MEAN = "mean of the branches"


@dataclass(frozen=True, eq=False)
class Update:
    """A tree of hazard and the rocks that have stood under it."""

    rocks: Sequence[Standing]
    tree: HazardTree
    # A branch under which the rocks survive with less than 1 - confidence is rejected; factors are those at
    # which survival falls to it.
    confidence: float = 0.95

    @cached_property
    def survival(self) -> Array:
        """Of the rocks under each branch."""
        return np.array([joint_survival(self.rocks, curve) for curve in self.tree.curves])

    @property
    def rejected(self) -> NDArray[np.bool_]:
        """Branches that the confidence rejects."""
        return self.survival < 1.0 - self.confidence

    @cached_property
    def posterior(self) -> Array | None:
        """Bayes weights; None where no branch lets the rocks survive."""
        weights = branch_weights(self.tree.weights, self.survival)
        return None if np.isnan(weights).any() else weights

    @cached_property
    def before(self) -> Statistics:
        """Mean and fractiles under the prior weights; fractiles of the files where these state no branches."""
        curves = statistics(self.tree)
        if not self._bare_fractiles:
            return curves
        fractiles = {q: np.full(len(curves.levels), math.nan) for q in FRACTILES}
        for q, curve in self.tree.fractiles.items():
            if q in fractiles and same_levels(curve.levels, curves.levels):
                fractiles[q] = curve.rates
        return replace(curves, fractiles=fractiles)

    @cached_property
    def after(self) -> Statistics | None:
        """Mean and fractiles under the Bayes weights; null fractiles where the files state no branches."""
        if self.posterior is None:
            return None
        curves = statistics(self.tree, self.posterior)
        unknown = {q: np.full(len(curves.levels), math.nan) for q in FRACTILES}
        return replace(curves, fractiles=unknown) if self._bare_fractiles else curves

    @property
    def _bare_fractiles(self) -> bool:
        return len(self.tree.branches) == 1 and bool(self.tree.fractiles)

    @cached_property
    def mean_curve(self) -> HazardCurve:
        """Mean of the branches before the rocks have a say."""
        return _mean_of(self.tree, self.before)

    @cached_property
    def _curves(self) -> list[HazardCurve]:
        return [*self.tree.curves, self.mean_curve]

    @cached_property
    def draws(self) -> Draws | None:
        """Of fragilities and ages."""
        return draws_of(self.rocks)

    @cached_property
    def _drawn(self) -> dict[str, Array] | None:
        if self.draws is None:
            return None
        found = drawn_factors(self.draws, self._curves, 1.0 - self.confidence, self._motion)
        return dict(zip(("scale_factor", "rate_factor", "survival"), found, strict=True))

    @cached_property
    def _motion(self) -> list[float]:
        return [motion_factor(self.rocks, curve, 1.0 - self.confidence) for curve in self._curves]

    @cached_property
    def factors(self) -> pd.DataFrame:
        """Survival and largest factors of each branch and, last, of their mean, with intervals.

        name (of a branch, or `MEAN`), survival, scale_factor (of motions), rate_factor, and _low and _high of each (95
        %, over other records and ages; null where neither is known to vary).
        """
        chance = 1.0 - self.confidence
        table = pd.DataFrame({"name": [*(branch.name for branch in self.tree.branches), MEAN]})
        for name, values in (
            ("survival", np.append(self.survival, joint_survival(self.rocks, self.mean_curve))),
            ("scale_factor", self._motion),
            ("rate_factor", [rate_factor(self.rocks, curve, chance) for curve in self._curves]),
        ):
            table[name] = values
            table[f"{name}_low"] = table[f"{name}_high"] = math.nan
            if self.draws is not None and self._drawn is not None:
                table[f"{name}_low"], table[f"{name}_high"] = self.draws.interval(self._drawn[name])
        return table

    @property
    def decided(self) -> dict[str, float | None]:
        """How much the rocks decide, `decided_by`."""
        return decided_by(self.tree.weights, self.posterior, self.survival, self.rejected)

    @cached_property
    def drawn_posteriors(self) -> Array | None:
        """`drawn_weights` of the branches; None where neither records nor ages vary."""
        if self._drawn is None:
            return None
        return drawn_weights(self.tree.weights, self._drawn["survival"][:, :-1])

    @cached_property
    def drawn_means(self) -> Array | None:
        """Posterior mean rates of each draw (draws, levels)."""
        if self.drawn_posteriors is None or not len(self.drawn_posteriors):
            return None
        _, rates = common_levels(self.tree.curves)
        years = self.tree.years
        if years is None:
            return self.drawn_posteriors @ np.where(np.isfinite(rates), rates, 0.0)
        return annual_rate_of(np.minimum(self.drawn_posteriors @ probability_of(rates, years), 1.0), years)


def _mean_of(tree: HazardTree, curves: Statistics) -> HazardCurve:
    """The mean of a tree as a curve, of the levels at which it has a rate."""
    if len(tree.branches) == 1:
        return tree.curves[0]
    levels, rates = bearing(curves.levels, curves.mean)
    falling = np.minimum.accumulate(rates)
    return HazardCurve(MEAN, tree.measure, levels, falling, site=tree.site, years=tree.years)


def rates_table(levels: Array, curves: Mapping[str, Statistics | None]) -> pd.DataFrame:
    """Columns level, and rate_NAME_mean, rate_NAME_p05 and so on of statistics by name; null where these are None."""
    table = pd.DataFrame({"level": levels})
    for name, one in curves.items():
        table[f"rate_{name}_mean"] = math.nan if one is None else one.mean
        for q in FRACTILES:
            table[f"rate_{name}_p{round(100 * q):02}"] = math.nan if one is None else one.fractiles[q]
    return table


def updated_table(update: Update) -> pd.DataFrame:
    """The hazard before and after at every level.

    Returns DataFrame: level (SI); rate_prior_* and rate_posterior_* (mean, p05, p16, p50, p84, p95: over branches),
    rate_posterior_mean_low and _high (95 %, over other records and ages), change_percent (of the mean rate).
    """
    levels = update.before.levels
    table = rates_table(levels, {"prior": update.before, "posterior": update.after})
    table["rate_posterior_mean_low"] = table["rate_posterior_mean_high"] = math.nan
    if update.draws is not None and update.drawn_means is not None and update.after is not None:
        low, high = update.draws.interval(update.drawn_means)
        table = table.assign(rate_posterior_mean_low=low, rate_posterior_mean_high=high)
    with np.errstate(invalid="ignore", divide="ignore"):
        table["change_percent"] = 100.0 * (table["rate_posterior_mean"] / table["rate_prior_mean"] - 1.0)
    return table


def changes_table(update: Update) -> pd.DataFrame:
    """The motions exceeded at some annual rates, before and after.

    Returns DataFrame: annual_rate, return_years; level_prior_* and level_posterior_* (mean, p05, p50, p95: over
    branches), level_posterior_mean_low and _high (95 %, over other records and ages), level_change_percent (of the
    mean's motion), rate_change_percent (of the mean's rate at the prior's motion). Null where a curve does not
    reach the rate.
    """
    means = None if update.after is None else update.drawn_means
    return changes_of(update.before, update.after, means, update.draws.interval if update.draws else ends)


def changes_of(
    before: Statistics, after: Statistics | None, means: Array | None, interval: Callable[[Array], Array]
) -> pd.DataFrame:
    """Rows of `changes_table`, a rate each.

    means: mean rates after of each draw (draws, levels), if these are known.
    interval: from values of the draws to its ends.
    """
    rows = []
    for rate in RATES:
        low, high = _level_interval(before.levels, means, rate, interval)
        drawn = {"level_posterior_mean_low": low, "level_posterior_mean_high": high}
        rows.append(_change_at(rate, before, after) | drawn)
    return pd.DataFrame(rows)


def _change_at(rate: float, before: Statistics, after: Statistics | None) -> dict[str, float]:
    row: dict[str, float] = {"annual_rate": rate, "return_years": 1.0 / rate}
    for name, averaged in (("prior", before), ("posterior", after)):
        for key, q in (("mean", None), ("p05", 0.05), ("p50", 0.5), ("p95", 0.95)):
            row[f"level_{name}_{key}"] = math.nan
            if averaged is not None:
                rates = averaged.mean if q is None else averaged.fractiles[q]
                row[f"level_{name}_{key}"] = intensity_at(averaged.levels, rates, rate)
    level = row["level_prior_mean"]
    row["level_change_percent"] = 100.0 * (row["level_posterior_mean"] / level - 1.0)
    row["rate_change_percent"] = _rate_change(after, level, rate)
    return row


def _level_interval(
    levels: Array, means: Array | None, rate: float, interval: Callable[[Array], Array]
) -> tuple[float, float]:
    """Ends of the interval of the motion at a rate over mean curves (draws, levels); null where one lacks the rate."""
    found = np.array([intensity_at(levels, drawn, rate) for drawn in (() if means is None else means)])
    if not len(found) or np.isnan(found).any():
        return math.nan, math.nan
    low, high = interval(found)
    return float(low), float(high)


def _rate_change(after: Statistics | None, level: float, rate: float) -> float:
    if after is None or math.isnan(level):
        return math.nan
    x, rates = bearing(after.levels, after.mean)
    if not (len(x) > 1 and x[0] <= level <= x[-1]):
        return math.nan
    return 100.0 * (math.exp(np.interp(math.log(level), np.log(x), np.log(rates))) / rate - 1.0)


def levels_table(update: Update) -> pd.DataFrame:
    """Choices of the logic tree's levels before and after, the level that the rocks move most first.

    Returns DataFrame: level, moved (share of the weight that changes its choice: half the sum of absolute changes),
    choice, prior_weight, posterior_weight; empty where branches have no paths.
    """
    columns = ["level", "moved", "choice", "prior_weight", "posterior_weight"]
    if update.posterior is None:
        return pd.DataFrame(columns=columns)
    tables = []
    for level, chosen in level_choices([branch.path for branch in update.tree.branches]).items():
        shares = pd.DataFrame({
            "choice": chosen, "prior_weight": update.tree.weights, "posterior_weight": update.posterior,
        }).groupby("choice", as_index=False).sum()  # fmt: skip
        moved = 0.5 * (shares["posterior_weight"] - shares["prior_weight"]).abs().sum()
        tables.append(shares.assign(level=level, moved=moved)[columns])
    tables.sort(key=lambda table: -table["moved"].iloc[0])
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(columns=columns)


def parts_table(update: Update) -> pd.DataFrame:
    """Shares of the toppling rate that contributions to the hazard have: by source type, by ground-motion model.

    Returns DataFrame: part, toppling_rate (annual), share; empty where the files state no contributions.
    """
    curves = [rock.curve for rock in update.rocks]
    total = toppling_rate(curves, update.tree.curves[0])
    rows = [(part.name, toppling_rate(curves, part)) for part in update.tree.parts]
    table = pd.DataFrame(rows, columns=["part", "toppling_rate"])
    return table.assign(share=table["toppling_rate"] / total if total > 0 else math.nan)


def decided_by(
    prior: Array,
    posterior: Array | None,
    survivals: ArrayLike,
    rejected: ArrayLike,
) -> dict[str, float | None]:
    """How much rocks decide: effective branches before and after, mean survival, and the weight rejected."""
    gone = np.asarray(rejected, bool)
    return {
        "branches": len(prior),
        "effective_branches_prior": effective_number(prior),
        "effective_branches_posterior": None if posterior is None else effective_number(posterior),
        "survival_mean_of_branches": float(prior @ np.asarray(survivals)),
        "weight_rejected": float(prior[gone].sum()),
        "branches_rejected": int(gone.sum()),
    }
