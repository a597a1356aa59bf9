"""Hazard logic tree: branches with prior and posterior weights, their mean and fractiles.

Statistics follow OpenQuake: mean and fractiles are of probabilities over the investigation time, level by level, and a
fractile is interpolated on the cumulative weights of the sorted branches (openquake/hazardlib/stats.py). Where a tree
states annual rates instead, the mean is of rates: the same for rare events.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from toppling.models.arrays import Array
from toppling.models.errors import InputError
from toppling.results.hazard.curves import HazardCurve, annual_rate_of, probability_of
from toppling.results.hazard.places import Place

_WEIGHT_TOLERANCE = 1e-3
"""Maximum deviation of the sum of weights from 1: files print single precision, analysts three decimals."""

FRACTILES = (0.05, 0.16, 0.5, 0.84, 0.95)
"""Probabilities of the reported fractiles over branches."""


@dataclass(frozen=True, eq=False)
class Branch:
    """Branch of a logic tree."""

    name: str
    weight: float  # prior weight; those of a tree sum to 1
    curve: HazardCurve
    # Choices of its path in OpenQuake's abbreviation: one letter per level, source models ~ ground motion.
    path: str = ""
    number: int | None = None  # OpenQuake's number of the realisation

    @property
    def model(self) -> str:
        """Ground-motion model in the path; the branch's name where there is none."""
        return self.path.partition("~")[2] or self.name


@dataclass(frozen=True, eq=False)
class HazardTree:
    """Branches of one intensity measure at one site."""

    measure: str  # column of the results
    branches: tuple[Branch, ...]  # a single branch where a file states one curve
    weights_from: str = "equal"  # source of the weights: a file, the command line, or "equal"
    # Fractiles stated by the files, which cannot be reweighted.
    fractiles: dict[float, HazardCurve] = field(default_factory=dict)
    # Contributions that add up to a single branch: by source type or by ground-motion model.
    parts: tuple[HazardCurve, ...] = ()

    def __post_init__(self) -> None:
        total = math.fsum(branch.weight for branch in self.branches)
        if not abs(total - 1.0) <= _WEIGHT_TOLERANCE:
            raise InputError(
                "hazard.weights_sum",
                what=f"the weights of {len(self.branches)} branches sum to {total:.6g}",
                where=self.weights_from,
                expected="weights that sum to 1",
                remedy="give every branch of the tree, with its weight",
            )

    @property
    def site(self) -> Place | None:
        """Location of the first branch that states one."""
        return next((branch.curve.site for branch in self.branches if branch.curve.site), None)

    @property
    def site_name(self) -> str:
        """Name of the site; empty if the files state none."""
        return next((branch.curve.site_name for branch in self.branches if branch.curve.site_name), "")

    @property
    def years(self) -> float | None:
        """Investigation time of the files' probabilities; None where some state rates."""
        stated = {branch.curve.years for branch in self.branches}
        return stated.pop() if len(stated) == 1 else None

    @property
    def weights(self) -> Array:
        """Weights of the branches, summing to 1."""
        weights = np.array([branch.weight for branch in self.branches])
        return weights / weights.sum()

    def stronger(self, factor: float) -> "HazardTree":
        """Tree of motions stronger by a factor, such as for another horizontal component."""
        return replace(
            self,
            branches=tuple(replace(branch, curve=branch.curve.stronger(factor)) for branch in self.branches),
            fractiles={q: curve.stronger(factor) for q, curve in self.fractiles.items()},
            parts=tuple(part.stronger(factor) for part in self.parts),
        )

    @property
    def curves(self) -> list[HazardCurve]:
        """Curves of the branches."""
        return [branch.curve for branch in self.branches]


def sources(tree: HazardTree) -> list[str]:
    """Distinct files that a tree was read from, that of the weights first."""
    weights = [tree.weights_from] if tree.weights_from.endswith(".csv") else []
    curves = [*tree.curves, *tree.fractiles.values(), *tree.parts]
    return list(dict.fromkeys([*weights, *(curve.source for curve in curves if curve.source)]))


@dataclass(frozen=True, eq=False)
class Statistics:
    """Mean and fractiles of a tree's annual rates of exceedance."""

    levels: Array  # (n,): intensities in SI
    # (n,): annual rates; infinite where exceedance is certain in all branches, 0 where it is impossible.
    mean: Array
    fractiles: dict[float, Array]  # dict of (n,)


def same_levels(first: Array, other: Array) -> bool:
    """Whether two curves have the same levels to printed precision."""
    return len(first) == len(other) and np.allclose(first, other, rtol=1e-6)


def common_levels(curves: Sequence[HazardCurve]) -> tuple[Array, Array]:
    """Common levels (n,) of curves, and the rates of each (curves, n).

    Curves with different levels are interpolated at the union of their levels, within the range common to all.

    Raises InputError if the curves have fewer than two levels in common.
    """
    first = curves[0].levels
    if all(same_levels(curve.levels, first) for curve in curves):
        return first, np.array([curve.rates for curve in curves])
    low = max(curve.levels[0] for curve in curves)
    high = min(curve.levels[-1] for curve in curves)
    levels = np.unique(np.concatenate([curve.levels for curve in curves]))
    levels = levels[(levels >= low) & (levels <= high)]
    if len(levels) < 2:
        raise InputError(
            "hazard.levels_not_shared",
            what="the curves of the branches have fewer than two levels in common",
            where="--hazard",
            expected="branches that cover the same intensities",
            remedy="compute all branches at the same levels",
        )
    return levels, np.array([_rates_at(curve, levels) for curve in curves])


def _rates_at(curve: HazardCurve, levels: Array) -> Array:
    if not len(curve.intensity):
        return np.where(levels <= curve.certain.max(initial=0.0), math.inf, 0.0)
    rates = curve.rate(levels)
    rates = np.where(levels < curve.intensity[0], math.inf, rates)
    return np.where(levels > curve.intensity[-1], 0.0, rates)


def statistics(tree: HazardTree) -> Statistics:
    """Mean and fractiles of a tree under its prior weights."""
    return statistics_of(*common_levels(tree.curves), tree.weights, tree.years)


def statistics_of(levels: Array, rates: Array, weights: Array, years: float | None = None) -> Statistics:
    """Mean and fractiles of rates (branches, levels), taken of probabilities over the investigation time, if given."""
    values = rates if years is None else probability_of(rates, years)
    back = (lambda x: x) if years is None else (lambda x: annual_rate_of(np.minimum(x, 1.0), years))
    return Statistics(
        levels, back(weights @ values), {q: back(weighted_fractile(values, weights, q)) for q in FRACTILES}
    )


def weighted_fractile(values: Array, weights: Array, probability: float) -> Array:
    """Fractile of each column of values (branches, n) by OpenQuake's rule.

    Sorted values are interpolated on their cumulative weights; below the first weight it is the smallest value.
    """
    order = np.argsort(values, axis=0, kind="stable")
    rising = np.take_along_axis(values, order, axis=0)
    cumulated = np.cumsum(weights[order], axis=0)
    return np.array(
        [np.interp(probability, summed, column) for summed, column in zip(cumulated.T, rising.T, strict=True)]
    )


def branch_weights(prior: ArrayLike, survivals: ArrayLike) -> Array:
    """Posterior weights of branches, given the rocks' survival probability under each; NaN if all are zero."""
    joint = np.asarray(prior, float) * np.asarray(survivals, float)
    return joint / joint.sum() if joint.sum() > 0 else np.full(len(joint), math.nan)


def drawn_weights(prior: Array, survivals: Array) -> Array:
    """Posterior weights of each draw (draws, branches), without draws in which survival is zero under all branches."""
    joint = prior * survivals
    total = joint.sum(axis=1, keepdims=True)
    return (joint / np.where(total > 0, total, 1.0))[total[:, 0] > 0]


def level_choices(paths: Sequence[str]) -> dict[str, list[str]]:
    """Choice of each branch at each level of the logic tree, from its path.

    In OpenQuake's abbreviated paths each letter is a level where all have equal length; otherwise each part between ~
    is one, which may be LEVEL=CHOICE. Levels at which all branches have the same choice are left out.

    Returns dict of lists of str, by the level's name, such as "source 1", "ground motion 2".
    """
    parts = [path.split("~") for path in paths]
    if not paths or len({len(split) for split in parts}) != 1 or not all(paths):
        return {}
    names = [f"part {n + 1}" for n in range(len(parts[0]))]
    if len(names) == 2:
        names = ["source", "ground motion"]
    levels: dict[str, list[str]] = {}
    for name, column in zip(names, zip(*parts, strict=True), strict=True):
        titled = [text.partition("=") for text in column]
        if not column[0].startswith("[") and {title + sign for title, sign, _ in titled} == {
            titled[0][0] + "="
        }:
            name, choices = titled[0][0], [[choice for _, _, choice in titled]]
        else:
            choices = [list(level) for level in _choices(column)]
        for number, chosen in enumerate(choices, 1):
            if len(set(chosen)) > 1:
                levels[f"{name} {number}" if len(choices) > 1 else name] = list(chosen)
    return levels


def _choices(column: Sequence[str]) -> list[Sequence[str]]:
    """Choices at each level of one part of the paths: a letter per level, or in old engines names separated by _."""
    if any(text.startswith("[") for text in column):
        return [column]
    split = [text.split("_") if "_" in text else list(text) for text in column]
    return list(zip(*split, strict=True)) if len({len(words) for words in split}) == 1 else [column]
