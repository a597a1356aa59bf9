"""Hazard curves, and their logic tree: branches with prior and posterior weights, their mean and fractiles.

Statistics follow OpenQuake: mean and fractiles are of probabilities over the investigation time, level by level, and a
fractile is interpolated on the cumulative weights of the sorted branches (openquake/hazardlib/stats.py). Where a tree
states annual rates instead, the mean is of rates: the same for rare events.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from toppling.models.arrays import Array
from toppling.models.errors import InputError
from toppling.results.analysis.lognormal import Lognormal
from toppling.results.hazard.places import Place

NODES_PER_E_FOLD = 400
"""Number of integration nodes per factor e of intensity.

Under a power law of exponent k the relative error of the rate is (k / 400)^2 / 24: 1e-6 for k = 2, 2.3e-6 for k = 3. A
nearly sharp fragility (beta below 0.02) adds up to 4.4e-5 k, most where beta is a third of an interval.
"""

_PRINTED = 2e-6
"""Relative amount by which a value may exceed that at a lower level: files print seven digits, some six."""


@dataclass(frozen=True, eq=False)
class HazardCurve:
    """Annual rate of exceedance of an intensity at a site, a power law between its points."""

    name: str
    # Column of the results, such as pga_m_s2; sa_0.2s_m_s2 for other periods.
    measure: str
    # (n,): increasing and positive, in the measure's SI unit. A branch of a tree may have fewer than two
    # points, where no event of its catalogue was strong enough.
    intensity: NDArray[np.float64]
    annual_rate: NDArray[np.float64]  # (n,): positive and finite, not increasing
    # (longitude, latitude) in degrees of the file's site.
    site: tuple[float, float] | None = None
    site_name: str = ""  # name in the file, if any
    component: str = ""  # horizontal component, such as RotD50, where known
    source: str = ""  # file that it was read from
    years: float | None = None  # investigation time of the file's probabilities; None where it states rates
    # Levels with a stated probability of 1 (unbounded rate) and of 0 (underflow): they have no finite rate, but
    # count where probabilities are averaged over branches.
    certain: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    never: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    def rate(self, intensity: ArrayLike) -> NDArray[np.float64]:
        """Annual rate of exceedance at intensities within the curve, interpolated on logarithms."""
        logarithm = np.interp(np.log(intensity), np.log(self.intensity), np.log(self.annual_rate))
        return np.exp(logarithm)

    @property
    def levels(self) -> NDArray[np.float64]:
        """All levels of the file, including those without a finite rate."""
        return np.concatenate([self.certain, self.intensity, self.never])

    @property
    def rates(self) -> NDArray[np.float64]:
        """Annual rates at `levels`: infinite where exceedance is certain, 0 where it is impossible."""
        unbounded, none = np.full(len(self.certain), math.inf), np.zeros(len(self.never))
        return np.concatenate([unbounded, self.annual_rate, none])

    def stronger(self, factor: float) -> "HazardCurve":
        """Curve of motions stronger by a factor: rate'(x) = rate(x / factor)."""
        return replace(
            self, intensity=factor * self.intensity, certain=factor * self.certain, never=factor * self.never
        )


def _curve_of_rates(
    name: str, measure: str, x: NDArray[np.float64], rate: NDArray[np.float64], **stated: Any
) -> HazardCurve:
    """Curve from a file's annual rates; rates of 0 and infinite ones become levels without a rate."""
    where = str(stated.get("source") or name)
    expected = "annual rates of exceedance, or probabilities, that fall as the level rises"
    if len(x) > 1 and (np.diff(x) < 0).all():
        x, rate = x[::-1], rate[::-1]
    if len(x) > 1 and x[0] == 0:  # exceeded by every event, and has no logarithm
        x, rate = x[1:], rate[1:]
    if wrong := _wrong_levels(x):
        raise InputError(
            "hazard.levels_not_rising",
            what=wrong,
            where=where,
            expected=expected,
            remedy="state each level once, in rising order, and leave out those of 0",
        )
    if not (rate >= 0).all():
        worst = int(np.argmax(~(rate >= 0)))
        raise InputError(
            "hazard.rate_not_positive",
            what=f"states {rate[worst]:g} at the level {x[worst]:g}: rates must fall, all of them positive",
            where=where,
            expected=expected,
            remedy="correct the value, or leave the level out",
        )
    finite = np.where(np.isinf(rate), 1e300, rate)
    risen = finite[1:] > finite[:-1] * (1.0 + _PRINTED)
    if risen.any():
        index = int(np.argmax(risen))
        raise InputError(
            "hazard.rates_rise",
            what=f"the value at {x[index + 1]:g} lies above that at {x[index]:g}: rates must fall",
            where=where,
            expected=expected,
            remedy="check the order of the columns, and the program that wrote them",
        )
    falling = np.where(np.isinf(rate), rate, np.minimum.accumulate(finite))
    positive = (falling > 0) & np.isfinite(falling)
    return HazardCurve(
        name,
        measure,
        x[positive],
        falling[positive],
        certain=x[np.isinf(falling)],
        never=x[falling == 0],
        **stated,
    )


def _wrong_levels(x: NDArray[np.float64]) -> str:
    """Describe an error in the levels of a curve; empty if they are valid."""
    if not len(x):
        return "has no level"
    if not (np.isfinite(x) & (x > 0)).all():
        return f"has the level {x[~(np.isfinite(x) & (x > 0))][0]:g}: intensities must be positive"
    falls = np.flatnonzero(np.diff(x) <= 0)
    if not len(falls):
        return ""
    before, after = x[falls[0]], x[falls[0] + 1]
    if after == before:
        return f"has the level {after:g} twice"
    return f"has the level {after:g} after {before:g}: intensities must rise, each level once"


def curve_of(
    name: str, measure: str, levels: ArrayLike, values: ArrayLike, years: float = 0.0, **stated: Any
) -> HazardCurve:
    """Curve from a file's probabilities of exceedance over some years, or from its annual rates where `years` is 0.

    -ln(1 - p) / T is the annual rate of Poisson events. Levels at the ends whose values are NaN are left out.

    Raises InputError as `_curve_of_rates`, and if the time is negative or probabilities lie outside 0 to 1.
    """
    x, p = np.asarray(levels, float), np.asarray(values, float)
    known = x[np.isfinite(x) & ~np.isnan(p)]
    if len(known):
        within = (x >= known.min()) & (x <= known.max()) | ~np.isfinite(x)
        x, p = x[within], p[within]
    if not years:
        return _curve_of_rates(name, measure, x, p, **stated)
    where = str(stated.get("source") or name)
    if not 0 < years < math.inf:
        raise InputError(
            "hazard.time_unusable",
            what=f"an investigation time of {years:g} years",
            where=where,
            expected="a time above 0",
            remedy="state the years that the probabilities are over",
        )
    if not ((p >= 0) & (p <= 1)).all():
        worst = int(np.argmax(~((p >= 0) & (p <= 1))))
        raise InputError(
            "hazard.probability_out_of_range",
            what=f"states the probability {p[worst]:g} at the level {x[worst]:g}",
            where=where,
            expected="probabilities of exceedance from 0 to 1",
            remedy="if these are annual rates, say so in the file",
        )
    return _curve_of_rates(name, measure, x, annual_rate_of(p, years), years=years, **stated)


def annual_rate_of(probability: ArrayLike, years: float) -> NDArray[np.float64]:
    """Annual rate of Poisson events from the probability of at least one in some years; infinite for 1."""
    with np.errstate(divide="ignore"):
        return -np.log1p(-np.asarray(probability, float)) / years


def probability_of(annual_rate: ArrayLike, years: float) -> NDArray[np.float64]:
    """Probability of at least one Poisson event in some years."""
    return -np.expm1(-np.asarray(annual_rate, float) * years)


def bearing(
    levels: NDArray[np.float64], rates: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points of a curve with a positive, finite rate."""
    positive = (rates > 0) & np.isfinite(rates)
    return levels[positive], rates[positive]


def intensity_at(levels: NDArray[np.float64], rates: NDArray[np.float64], annual_rate: float) -> float:
    """Intensity exceeded at an annual rate, by log-log interpolation; NaN outside the range of the rates."""
    x, falling = bearing(levels, rates)
    falling = np.minimum.accumulate(falling)
    if len(x) < 2 or not falling[-1] <= annual_rate <= falling[0]:
        return math.nan
    return float(np.exp(np.interp(-math.log(annual_rate), -np.log(falling), np.log(x))))


def _nodes_between(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Logarithms of integration nodes from the first corner to the last, including all corners."""
    pieces = [
        np.linspace(start, end, math.ceil((end - start) * NODES_PER_E_FOLD), endpoint=False)
        for start, end in pairwise(corners)
    ]
    return np.concatenate([*pieces, corners[-1:]])


def events_of_curves(
    curves: Sequence[HazardCurve], thresholds: Sequence[float] = ()
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Discretise hazard curves: intensities (m,) common to all, and annual rates of their events (curves, m).

    `NODES_PER_E_FOLD` sets the resolution. Points of the curves and thresholds, such as medians, are ends of intervals:
    none contains parts of two power laws or both sides of a sharp threshold. All events beyond the last point of a
    curve have the intensity of that point.
    """
    bearing = [curve for curve in curves if len(curve.intensity)]
    if not bearing:
        return np.empty(0), np.empty((len(curves), 0))
    corners = np.unique(np.concatenate([np.log(curve.intensity) for curve in bearing]))
    inside = [x for x in np.log(thresholds) if corners[0] < x < corners[-1]]
    nodes = np.exp(_nodes_between(np.unique([*corners, *inside])))
    last = np.unique([curve.intensity[-1] for curve in bearing])
    intensity = np.concatenate([np.sqrt(nodes[1:] * nodes[:-1]), last])
    rates = np.zeros((len(curves), len(intensity)))
    for row, curve in zip(rates, curves, strict=True):
        if len(curve.intensity):
            row[: len(nodes) - 1] = -np.diff(curve.rate(nodes))
            row[len(nodes) - 1 :] = curve.annual_rate[-1] * (last == curve.intensity[-1])
    return intensity, rates


def continued(hazard: HazardCurve, curves: Sequence[Lognormal]) -> HazardCurve:
    """Extend a hazard curve by the first segment's power law below, and by its last rate at intensities that topple.

    It extends as far as the rocks' fragilities require; `toppling.results.hazard` explains both ends.
    """
    x, rate = hazard.intensity, hazard.annual_rate
    if len(x) < 2:
        return hazard
    exponent = math.log(rate[0] / rate[1]) / math.log(x[1] / x[0])
    # F(x) x^-k is proportional to a normal density about ln(median) - k beta^2, negligible 8 beta below that.
    low = min(math.log(curve.median) - exponent * curve.beta**2 - 8 * curve.beta for curve in curves)
    if exponent > 0:  # avoid overflow of the rates
        low = max(low, math.log(x[0]) - 600.0 / exponent)
    high = 2.0 * max(curve.intensity(1 - 1e-12) for curve in curves)
    if math.exp(low) < x[0]:
        rate = np.concatenate([rate[:1] * (x[0] / math.exp(low)) ** exponent, rate])
        x = np.concatenate([[math.exp(low)], x])
    if high > x[-1]:
        x, rate = np.append(x, high), np.append(rate, rate[-1])
    return replace(hazard, intensity=x, annual_rate=rate)


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
