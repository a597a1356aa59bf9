"""Bayesian update of a hazard by standing rocks: posterior weights, hazard before and after, scale factors, export."""

import csv
import io
import math
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from toppling.models.arrays import Array, effective_number
from toppling.models.files.folder import write_text
from toppling.models.files.table import plain
from toppling.results.analysis import FEW
from toppling.results.analysis.lognormal import ends
from toppling.results.hazard.ages import Exposure
from toppling.results.hazard.events import MEAN, EventSet, Standing, events_of_tree
from toppling.results.hazard.measure_names import UNSCALED, imt_of
from toppling.results.hazard.survival import (
    Draws,
    any_topples,
    draws_of,
    greatest_rate,
    rates_by_state,
    scale_factors,
    survivals,
    toppling_rate,
    unstated_fractions,
)
from toppling.results.hazard.tree import (
    FRACTILES,
    Branch,
    HazardCurve,
    HazardTree,
    Statistics,
    annual_rate_of,
    bearing,
    branch_weights,
    common_levels,
    continued,
    drawn_weights,
    intensity_at,
    level_choices,
    probability_of,
    same_levels,
    statistics,
    statistics_of,
)

RATES = (1e-2, 1 / 475, 1e-3, 1 / 2475, 1e-4, 1e-5)
"""Annual rates at which prior and posterior motions are compared; 475 and 2475 years are 10 and 2 % in 50 years."""
_LEVELS = 60
"""Maximum number of levels (order statistics of the motions of events) at which rates of exceedance are counted."""


@dataclass(frozen=True, eq=False)
class Exceedance:
    """Annual rates of exceedance of all branches, for a measure and a site."""

    measure: str
    site: str
    levels: Array  # (n,)
    rates: Array  # (branches, n)
    # Investigation time of the probabilities that means and fractiles are of; None for rates.
    years: float | None = None
    # Fractiles stated by the files of a single branch, used in place of fractiles over branches.
    stated: dict[float, Array] | None = None
    # (branches, n): sum of squares of the events' rates; None for curves.
    squares: Array | None = None

    def statistics(self, weights: Array, *, after: bool = False) -> Statistics:
        """Mean and fractiles under given weights, NaN where too few events support them."""
        found = statistics_of(self.levels, self.rates, weights, self.years)
        if self.squares is not None:
            with np.errstate(divide="ignore", invalid="ignore"):
                effective = (weights @ self.rates) ** 2 / (weights**2 @ self.squares)  # Kish
                largest_event_rate = np.nanmax(self.squares / self.rates, axis=0, initial=0.0)
            few = ~(effective > FEW - 1e-6)  # rounded
            # A fractile is the rate of one branch, which its own events support.
            fractiles = {
                q: np.where(few | (rates < (FEW - 1e-6) * largest_event_rate), math.nan, rates)
                for q, rates in found.fractiles.items()
            }
            return Statistics(self.levels, np.where(few, math.nan, found.mean), fractiles)
        if self.stated is None:
            return found
        unknown = {q: np.full(len(self.levels), math.nan) for q in FRACTILES}
        return replace(found, fractiles=unknown if after else unknown | self.stated)


@dataclass(frozen=True, eq=False)
class Update:
    """A hazard and the rocks that constrain it."""

    rocks: Sequence[Standing]
    events: EventSet
    exposure: Exposure
    # A branch with a survival probability below 1 - confidence is inconsistent; scale factors have that survival.
    confidence: float = 0.95
    tree: HazardTree | None = None  # logic tree of curves that the events represent, if any

    @classmethod
    def of_curves(
        cls, rocks: Sequence[Standing], tree: HazardTree, exposure: Exposure, confidence: float = 0.95
    ) -> "Update":
        """Update a logic tree of curves by rocks at its site."""
        return cls(rocks, events_of_tree(tree, rocks, _mean_of(tree)), exposure, confidence, tree)

    @cached_property
    def _rates(self) -> Array:
        """Annual rates of events that topple any rock (branches with the mean hazard last, states)."""
        return rates_by_state(self.rocks, self.events.groups, self.exposure.states)

    @cached_property
    def _survivals(self) -> Array:
        return np.array([self.exposure.survival(row) for row in self._rates])

    @property
    def survival(self) -> Array:
        """Survival probability of the rocks under each branch."""
        return self._survivals[:-1]

    @property
    def inconsistent(self) -> NDArray[np.bool_]:
        """Mask of the inconsistent branches."""
        return self.survival < 1.0 - self.confidence

    @cached_property
    def survival_least(self) -> Array:
        """Survival under each branch with what may topple the rocks outside its curve's points; events omit none."""
        if self.tree is None:
            return self.survival
        curves = [rock.curve for rock in self.rocks]
        whole = [Branch(curve.name, 1.0, continued(curve, curves)) for curve in self.tree.curves]
        trees = [HazardTree(self.tree.measure, (branch,)) for branch in whole]
        return np.array([Update.of_curves(self.rocks, tree, self.exposure).survival[0] for tree in trees])

    @property
    def verdicts(self) -> NDArray[np.str_]:
        """Verdict on each branch: undecided where it depends on what the curve leaves out."""
        accepted = np.where(self.survival_least < 1.0 - self.confidence, "undecided", "consistent")
        return np.where(self.inconsistent, "inconsistent", accepted)

    @cached_property
    def posterior(self) -> Array | None:
        """Posterior weights of the branches; None where all are inconsistent and an update is meaningless."""
        return None if self.inconsistent.all() else branch_weights(self.events.prior, self.survival)

    @cached_property
    def draws(self) -> Draws | None:
        """Results in draws of all uncertain quantities; None where there are none."""
        return draws_of(self.rocks, self.events, self.exposure, 1.0 - self.confidence)

    @cached_property
    def factors(self) -> pd.DataFrame:
        """Survival and largest factors of each branch and, last, of the mean hazard, with intervals.

        Columns: name (of a branch, or `MEAN`), survival, scale_factor (of motions), rate_factor, and _low and _high of
        each (95 %, over all draws; null without draws).
        """
        chance = 1.0 - self.confidence
        table = pd.DataFrame({"name": [*(branch.name for branch in self.events.branches), MEAN]})
        drawn: dict[str, Array] = {}
        if self.draws is not None:
            drawn = {"survival": np.exp(-self.draws.topplings), "scale_factor": self.draws.factors}
            with np.errstate(divide="ignore"):
                drawn["rate_factor"] = -math.log(chance) / self.draws.topplings
        for name, values in (
            ("survival", self._survivals),
            ("scale_factor", scale_factors(self.rocks, self.events, self.exposure, chance)),
            ("rate_factor", [greatest_rate(row, chance) for row in self._rates @ self.exposure.years]),
        ):
            table[name] = values
            table[f"{name}_low"] = table[f"{name}_high"] = math.nan
            if drawn:
                table[f"{name}_low"], table[f"{name}_high"] = ends(drawn[name])
        return table

    @cached_property
    def branches(self) -> pd.DataFrame:
        """Table of branches: survival, rejection, weights and factors.

        A branch is inconsistent where the rocks survive with less than 1 - confidence (5 % in Stirling et al. 2021).

        Returns DataFrame: one row per branch: name, toppling_rate (annual, any of the rocks), verdict,
        prior_weight, posterior_weight (null where all branches are inconsistent), and columns of `factors`. For a set
        of events also model, events and effective_events (Kish's number for the toppling rate); for curves
        unstated_below and unstated_above (fractions of the rate outside the curve's points, not counted:
        `results.hazard`) and survival_least (with these counted).
        """
        bearing_rate = [
            any_topples(self.rocks, branch.motions)[0] * branch.rate for branch in self.events.branches
        ]
        table = pd.DataFrame({
            "name": [branch.name for branch in self.events.branches],
            "toppling_rate": [part.sum() for part in bearing_rate], "verdict": self.verdicts,
            "prior_weight": self.events.prior,
            "posterior_weight": math.nan if self.posterior is None else self.posterior,
        })  # fmt: skip
        if self.tree is None:
            table["model"] = [branch.model for branch in self.events.branches]
            table["events"] = [len(branch.rate) for branch in self.events.branches]
            table["effective_events"] = [
                effective_number(part) if part.sum() > 0 else 0.0 for part in bearing_rate
            ]
        else:
            curves = [rock.curve for rock in self.rocks]
            fractions = [unstated_fractions(curves, curve) for curve in self.tree.curves]
            table["unstated_below"], table["unstated_above"] = zip(*fractions, strict=True)
            table["survival_least"] = self.survival_least
        return table.join(self.factors.iloc[:-1].drop(columns="name"))

    @property
    def decided(self) -> dict[str, float | None]:
        """Effective number of branches before and after the update, mean survival, and inconsistent prior weight."""
        prior, out = self.events.prior, self.inconsistent
        return {
            "branches": len(prior),
            "effective_branches_prior": effective_number(prior),
            "effective_branches_posterior": None
            if self.posterior is None
            else effective_number(self.posterior),
            "survival_mean_of_branches": float(prior @ self.survival),
            "weight_inconsistent": float(prior[out].sum()),
            "branches_inconsistent": int(out.sum()),
            "branches_undecided": int((self.verdicts == "undecided").sum()),
        }

    @property
    def of_all_branches(self) -> dict[str, Any]:
        """Summary of all branches for a statement."""
        return {
            "mean": self.factors.iloc[-1].to_dict(),
            "decided": self.decided,
            "intervals_carry": list(self.draws.carries) if self.draws else [],
        }

    @cached_property
    def tables(self) -> dict[str, pd.DataFrame]:
        """Non-empty tables by name."""
        found = {
            "branches": self.branches,
            "models": models_table(self),
            "left_out": leave_one_out(self),
            "updated": self.updated,
            "changes": self.changes,
            "levels": _levels_table(self),
            "parts": _parts_table(self),
        }
        return {name: table for name, table in found.items() if len(table)}

    @cached_property
    def exceedances(self) -> list[Exceedance]:
        """Hazard of each measure at each of the rocks' sites, where some event is felt."""
        if self.tree is not None:
            return [_of_tree(self.tree, self.events.sites[0].name)]
        places = dict.fromkeys(rock.site for rock in self.rocks)
        found = [
            Exceedance(
                measure, self.events.sites[at].name, levels, rates[:, 0],
                squares=self._above(measure, [at], levels, 2)[:, 0] if self.events.sampled else None,
            )
            for at in places
            for measure in self.rocks[0].fragility.measures
            for levels, rates in [self.counted(measure, [at])]
        ]  # fmt: skip
        return [hazard for hazard in found if len(hazard.levels)]

    @cached_property
    def _judged(self) -> list[tuple[Exceedance, Statistics, Statistics | None]]:
        """Hazards, with their means and fractiles under the prior and the posterior weights."""
        prior, new = self.events.prior, self.posterior
        return [
            (hazard, hazard.statistics(prior), None if new is None else hazard.statistics(new, after=True))
            for hazard in self.exceedances
        ]

    @property
    def before(self) -> Statistics:
        """Mean and fractiles of the first hazard under the prior weights."""
        return self._judged[0][1]

    @property
    def after(self) -> Statistics | None:
        """Mean and fractiles of the first hazard under the posterior weights."""
        return self._judged[0][2]

    def counted(self, measure: str, sites: Sequence[int]) -> tuple[Array, Array]:
        """Levels, and each branch's rates of exceedance (branches, sites, levels); empty where no event is felt.

        Levels are those of the curves, or order statistics of the motions in increasing steps.
        """
        if self.tree is not None:
            levels, rates = common_levels(self.tree.curves)
            return levels, rates[:, None]
        felt = np.concatenate([branch.motions[measure][:, sites].ravel() for branch in self.events.branches])
        falling = np.sort(felt[felt > 0])[::-1]
        ranks = np.unique(np.geomspace(1, max(len(falling), 1), _LEVELS).round().astype(int))
        levels = np.unique(falling[ranks - 1]) if len(falling) else falling
        return levels, self._above(measure, sites, levels, 1)

    def _above(self, measure: str, sites: Sequence[int], levels: Array, power: int) -> Array:
        """Sum of a power of the rates of the events that reach each level, (branches, sites, levels)."""
        return np.array([
            [_exceeded(branch.motions[measure][:, site], branch.rate**power, levels) for site in sites]
            for branch in self.events.branches
        ])  # fmt: skip

    def _drawn_means(self, of: Exceedance) -> Array | None:
        """Posterior mean rates of each draw (draws, levels); None without draws, or without posterior weights."""
        if self.draws is None or self.posterior is None:
            return None
        weights = drawn_weights(self.events.prior, np.exp(-self.draws.topplings[:, :-1]))
        if not len(weights):
            return None
        if of.years is None:
            return weights @ np.where(np.isfinite(of.rates), of.rates, 0.0)
        return annual_rate_of(np.minimum(weights @ probability_of(of.rates, of.years), 1.0), of.years)

    @cached_property
    def updated(self) -> pd.DataFrame:
        """Prior and posterior hazard at every level.

        Returns DataFrame: measure, site, level (SI); rate_prior_* and rate_posterior_* (mean, p05, p16, p50, p84, p95:
        over branches), rate_posterior_mean_low and _high (95 %, over all draws), change_percent (of the mean rate).
        """
        return _stacked([self._updated(*judged) for judged in self._judged])

    def _updated(self, of: Exceedance, before: Statistics, after: Statistics | None) -> pd.DataFrame:
        table = pd.DataFrame({"measure": of.measure, "site": of.site, "level": of.levels})
        for name, curves in (("prior", before), ("posterior", after)):
            table[f"rate_{name}_mean"] = math.nan if curves is None else curves.mean
            for q in FRACTILES:
                table[f"rate_{name}_p{round(100 * q):02}"] = (
                    math.nan if curves is None else curves.fractiles[q]
                )
        table["rate_posterior_mean_low"] = table["rate_posterior_mean_high"] = math.nan
        if (means := self._drawn_means(of)) is not None:
            table["rate_posterior_mean_low"], table["rate_posterior_mean_high"] = ends(means)
        with np.errstate(invalid="ignore", divide="ignore"):
            table["change_percent"] = 100.0 * (table["rate_posterior_mean"] / table["rate_prior_mean"] - 1.0)
        return table

    @cached_property
    def changes(self) -> pd.DataFrame:
        """Prior and posterior motions exceeded at the annual rates `RATES`.

        Returns DataFrame: measure, site, annual_rate, return_years; level_prior_* and level_posterior_* (mean, p05,
        p50, p95: over branches), level_posterior_mean_low and _high (95 %, over all draws), level_change_percent (of
        the mean's motion), rate_change_percent (of the mean's rate at the prior's motion). Null where a curve does not
        reach the rate.
        """
        return _stacked([self._changes(*judged) for judged in self._judged])

    def _changes(self, of: Exceedance, before: Statistics, after: Statistics | None) -> pd.DataFrame:
        means = self._drawn_means(of)
        rows = []
        for rate in RATES:
            low, high = _level_interval(of.levels, means, rate)
            drawn = {"level_posterior_mean_low": low, "level_posterior_mean_high": high}
            rows.append(_change_at(rate, before, after) | drawn)
        table = pd.DataFrame(rows)
        table.insert(0, "site", of.site)
        table.insert(0, "measure", of.measure)
        return table


def _of_tree(tree: HazardTree, site: str) -> Exceedance:
    """Rates of a tree's curves, with the files' fractiles where the tree has a single branch."""
    levels, rates = common_levels(tree.curves)
    stated = None
    if len(tree.branches) == 1 and tree.fractiles:
        stated = {
            q: curve.rates
            for q, curve in tree.fractiles.items()
            if q in FRACTILES and same_levels(curve.levels, levels)
        }
    return Exceedance(tree.measure, site, levels, rates, tree.years, stated)


def _exceeded(values: Array, rate: Array, levels: Array) -> Array:
    order = np.argsort(values)
    summed = np.concatenate([np.cumsum(rate[order][::-1])[::-1], [0.0]])
    return summed[np.searchsorted(values[order], levels, side="left")]


def _stacked(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()


def _mean_of(tree: HazardTree) -> HazardCurve:
    """Mean hazard of a tree as a curve, at the levels where it has a rate."""
    if len(tree.branches) == 1:
        return tree.curves[0]
    curves = statistics(tree)
    levels, rates = bearing(curves.levels, curves.mean)
    falling = np.minimum.accumulate(rates)
    return HazardCurve(MEAN, tree.measure, levels, falling, site=tree.site, years=tree.years)


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


def _level_interval(levels: Array, means: Array | None, rate: float) -> tuple[float, float]:
    """Ends of the interval of the motion at a rate over mean curves (draws, levels); NaN where one lacks the rate."""
    found = np.array([intensity_at(levels, drawn, rate) for drawn in (() if means is None else means)])
    if not len(found) or np.isnan(found).any():
        return math.nan, math.nan
    low, high = ends(found)
    return float(low), float(high)


def _rate_change(after: Statistics | None, level: float, rate: float) -> float:
    if after is None or math.isnan(level):
        return math.nan
    x, rates = bearing(after.levels, after.mean)
    if not (len(x) > 1 and x[0] <= level <= x[-1]):
        return math.nan
    return 100.0 * (math.exp(np.interp(math.log(level), np.log(x), np.log(rates))) / rate - 1.0)


def _levels_table(update: Update) -> pd.DataFrame:
    """Prior and posterior weights of the choices at each level of the logic tree, the most changed level first.

    Returns DataFrame: level, moved (total variation: half the sum of absolute changes of weight), choice,
    prior_weight, posterior_weight; empty where branches have no paths.
    """
    if update.posterior is None or update.tree is None:
        return pd.DataFrame()
    tables = []
    for level, chosen in level_choices([branch.path for branch in update.tree.branches]).items():
        weights = pd.DataFrame({
            "choice": chosen, "prior_weight": update.events.prior, "posterior_weight": update.posterior,
        }).groupby("choice", as_index=False).sum()  # fmt: skip
        moved = 0.5 * (weights["posterior_weight"] - weights["prior_weight"]).abs().sum()
        weights.insert(0, "moved", moved)
        weights.insert(0, "level", level)
        tables.append(weights)
    return _stacked(sorted(tables, key=lambda table: -table["moved"].iloc[0]))


def _parts_table(update: Update) -> pd.DataFrame:
    """Contributions to the toppling rate by source type or ground-motion model.

    Returns DataFrame: part, toppling_rate (annual), share (fraction); empty where the files state no contributions.
    """
    if update.tree is None:
        return pd.DataFrame()
    curves = [rock.curve for rock in update.rocks]
    total = toppling_rate(curves, update.tree.curves[0])
    rows = [(part.name, toppling_rate(curves, part)) for part in update.tree.parts]
    table = pd.DataFrame(rows, columns=["part", "toppling_rate"])
    return table.assign(share=table["toppling_rate"] / total if total > 0 else math.nan)


def models_table(update: Update) -> pd.DataFrame:
    """Ground-motion models of a set of events: mean survival over a model's branches, prior and posterior weight.

    Returns DataFrame: best first: model, branches, survival, prior_weight, posterior_weight, bayes_factor (relative to
    the mean of all models); empty for curves.
    """
    if update.tree is not None:
        return pd.DataFrame()
    branches = update.branches
    table = branches.assign(joint=branches["prior_weight"] * branches["survival"]).groupby("model", sort=False).agg(
        branches=("name", "size"), joint=("joint", "sum"), prior_weight=("prior_weight", "sum"),
        posterior_weight=("posterior_weight", lambda weights: weights.sum(min_count=1)),
    ).reset_index()  # fmt: skip
    table["survival"] = table.pop("joint") / table["prior_weight"]
    table["bayes_factor"] = table["survival"] / (table["survival"] @ table["prior_weight"])
    order = ["model", "branches", "survival", "prior_weight", "posterior_weight", "bayes_factor"]
    return table[order].sort_values("survival", ascending=False, ignore_index=True)


def leave_one_out(update: Update) -> pd.DataFrame:
    """Leave-one-out update: branch weights without each rock, and its survival as predicted from the others.

    Returns DataFrame: one row per rock and branch: left_out, branch, survival_of_others, posterior_weight (from the
    others), survival_predicted (of the rock that is left out, given that the others stand: the same in all its
    rows); empty for one rock, or curves.
    """
    rocks, events, stood = update.rocks, update.events, update.exposure
    if len(rocks) < 2 or update.tree is not None:
        return pd.DataFrame()
    tables = []
    for number, rock in enumerate(rocks):
        others = [rock for place, rock in enumerate(rocks) if place != number]
        left = replace(stood, states=np.delete(stood.states, number, axis=1))
        alive = survivals(others, events, left)[:-1]
        chance = events.prior @ alive
        tables.append(pd.DataFrame({
            "left_out": rock.name, "branch": [branch.name for branch in events.branches],
            "survival_of_others": alive, "posterior_weight": branch_weights(events.prior, alive),
            "survival_predicted": (events.prior @ update.survival) / chance if chance > 0 else math.nan,
        }))  # fmt: skip
    return pd.concat(tables, ignore_index=True)


_YEARS = 1.0
"""Time that the probabilities are over which are written for rates and for events: OpenQuake's files state no rates."""


@dataclass(frozen=True, eq=False)
class _Curves:
    """Rates of one measure: branches, updated mean and fractiles, by OpenQuake's kind; a row per site."""

    measure: str
    levels: Array
    sites: Sequence[tuple[str, tuple[float, float]]]
    rates: Mapping[str, Array]


def write_openquake(update: Update, folder: Path, ratio: float = 1.0) -> Iterator[Path]:
    """Write realizations.csv with the posterior weights, each branch's curve, and their updated mean and fractiles.

    Curves of a set of events are counted at the rocks' sites, with probabilities in `_YEARS`, so that
    their mean over branches is that of the rates.

    update: update whose sites have coordinates.
    folder: output folder, created if absent.
    ratio: factor by which the hazard's motions were multiplied; the files are for its original component.
    Yields each file once it is complete.
    """
    tree, events, weights = update.tree, update.events, update.posterior
    assert weights is not None
    branches = tree.branches if tree else events.branches
    own_numbers = [getattr(branch, "number", None) for branch in branches]
    numbers = [number if own is None else own for number, own in enumerate(own_numbers)]
    paths = [getattr(branch, "path", "") or branch.name for branch in branches]
    places = list(dict.fromkeys(rock.site for rock in update.rocks))
    sites = [(site.name, site.place or (0.0, 0.0)) for site in map(events.sites.__getitem__, places)]
    if tree:
        sites = [(tree.site_name, tree.site or (0.0, 0.0))]
    curves = []
    for measure in update.rocks[0].fragility.measures:
        levels, rates = update.counted(measure, places)
        after = [
            statistics_of(levels, at_site, weights, tree.years if tree else None)
            for at_site in rates.swapaxes(0, 1)
        ]
        kinds = {f"rlz-{number:03}": rate for number, rate in zip(numbers, rates, strict=True)}
        kinds["mean"] = np.array([statistics.mean for statistics in after])
        for q in FRACTILES:
            kinds[f"quantile-{q:g}"] = np.array([statistics.fractiles[q] for statistics in after])
        own = levels if measure in UNSCALED else levels / ratio
        curves.append(_Curves(measure, own, sites, kinds))
    years = (tree and tree.years) or _YEARS
    yield from _write(folder, dict(zip(numbers, paths, strict=True)), weights, curves, years)


def _write(
    folder: Path, branches: Mapping[int, str], weights: Array, measures: Sequence[_Curves],
    years: float,
) -> Iterator[Path]:  # fmt: skip
    mark = zlib.crc32(repr([list(weights), list(branches.values())]).encode())
    common = f"generated_by='toppling {version('toppling')}', checksum={mark}"
    rows = [["rlz_id", "branch_path", "weight"]]
    for (number, path), weight in zip(branches.items(), weights, strict=True):
        rows.append([str(number), path, f"{weight:.7e}"])
    yield _written(folder / "realizations.csv", common, rows)
    for curves in measures:
        imt, per_si = imt_of(curves.measure)
        named = any(name for name, _ in curves.sites)
        head = ["custom_site_id"] * named + [
            "lon",
            "lat",
            "depth",
            *(f"poe-{x:.7f}" for x in curves.levels * per_si),
        ]
        for kind, rates in curves.rates.items():
            header = f"{common}, kind='{kind}', investigation_time={years}, imt='{imt}'"
            lines = [
                [plain(name)] * named + [f"{degree:.5f}" for degree in place] + ["0.00000"]
                + [f"{poe:.6E}" for poe in probability_of(rate, years)]
                for (name, place), rate in zip(curves.sites, rates, strict=True)
            ]  # fmt: skip
            file = (
                kind.replace("quantile", "quantile_curve") if "quantile" in kind else f"hazard_curve-{kind}"
            )
            yield _written(folder / f"{file}-{imt}.csv", header, [head, *lines])


def _written(target: Path, header: str, rows: list[list[str]]) -> Path:
    """Write a file in the engine's format: the first line ends with one quoted cell of key-value pairs."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    first = "#" + "," * (len(rows[0]) - 1) + f'"{header}"\n'
    return write_text(first + text.getvalue(), target)
