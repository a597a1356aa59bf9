"""Bootstrap of fits over records and hidden bases, the intervals that follow, and the variation between bases."""

import math
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import log_ndtr, logsumexp, ndtr, ndtri, stdtrit

from toppling.models.arrays import AT_ONCE, Array, Flags, Indices, effective_number
from toppling.models.hidden_base.intervals import inspection_sentence, narrowing_pull
from toppling.results.analysis import CONFIDENCE, SAMPLES
from toppling.results.analysis.lognormal import (
    LEAST_RECORDS,
    Fit,
    Resampled,
    design_of,
    grouped,
    groups_separable,
    is_flat,
    probit_weights,
    scored,
)
from toppling.results.weights import records_weight

_CORRELATION = (np.arange(40) + 0.5) ** 2 / 40.0**2
"""Grid of values of c, equally likely a priori: a uniform prior of the standard deviation of u."""
_SPREAD = np.sqrt(_CORRELATION / (1.0 - _CORRELATION))
"""Standard deviation of u in those of a curve on one base."""
_NORMAL = np.linspace(-4.0, 4.0, 161)
"""Standard normal deviates that u is integrated over."""
_SCORES = np.linspace(-6.0, 6.0, 121)
"""Centres of the bins of scores, in standard deviations: narrow against the width of a curve."""


@dataclass(frozen=True, eq=False)
class BaseSpread:
    """Posterior of the variation between bases."""

    chance: Array  # (40,): posterior probability of each correlation of the grid
    effective: float  # effective number of bases, by their weights
    within: float  # spread of the curve on one base, as a share of that of the curve of all

    @property
    def _of_new(self) -> Array:
        """Standard deviation of u for a new base, with the error of the mean over the bases of the jobs."""
        return self.within * _SPREAD * math.sqrt(1.0 + 1.0 / self.effective)

    @property
    def half_width(self) -> float:
        """Half of the 95 % interval of u for a new base."""
        return float(brentq(lambda u: self.chance @ ndtr(u / self._of_new) - 0.975, 0.0, 50.0))

    def drawn(self, count: int, random: np.random.Generator) -> Array:
        """Shift u (count,) of the score on new bases, stratified, so that few draws represent its distribution."""
        even = random.permuted(np.tile((np.arange(count) + 0.5) / max(count, 1), (2, 1)), axis=1)
        place = np.searchsorted(self.chance.cumsum(), even[0]).clip(max=len(_SPREAD) - 1)
        return self._of_new[place] * ndtri(even[1])


def base_spread(jobs: pd.DataFrame, score: Array) -> BaseSpread | None:
    """Posterior of the variation between bases, from the likelihood of the jobs on each; None for a single base.

    jobs: rows of results with an answer, all of one contact; realisations are what differs.
    score: (jobs,), probit of the probability that the curve of all bases gives each.
    """
    if "realisation" not in jobs:
        return None
    by_record = records_weight(jobs)
    weight = np.ones(len(jobs)) if by_record is None else by_record.to_numpy(float)
    base, of_base = bases_of(jobs)
    return spread_of(jobs["toppled"].to_numpy(bool), score, base, weight, of_base)


def bases_of(jobs: pd.DataFrame) -> tuple[Indices, Array]:
    """Index of each job's realisation, each of which has its own base, and the weights of the realisations."""
    _, first, base = np.unique(jobs["realisation"], return_index=True, return_inverse=True)
    return base, jobs.get("base_weight", pd.Series(1.0, jobs.index)).to_numpy(float)[first]


def spread_of(
    toppled: Flags, score: Array, base: Indices, weight: Array, of_base: Array
) -> BaseSpread | None:
    """Posterior of the variation between bases, from arrays of jobs.

    toppled, score, base, weight: (jobs,), answer, probit score, index of the base, and weight of the record.
    of_base: (bases,), weights of the bases.
    """
    if len(of_base) < 2:
        return None
    place = np.clip(np.round((score + 6.0) * 10.0), 0, 120).astype(int)
    counts = np.zeros((2, len(of_base), len(_SCORES)))
    np.add.at(counts, (toppled.astype(int), base, place), weight / weight.mean())
    effective = effective_number(of_base)
    share = of_base / of_base.sum() * effective

    def likelihood(spread: Array, within: Array) -> Array:
        return np.array([_log_likelihood(counts, *pair) for pair in zip(spread, within, strict=True)]) @ share

    tied = np.sqrt(1.0 - _CORRELATION)  # the spread of the curve of all is that of one base and of the bases
    within = tied[likelihood(_SPREAD, tied).argmax()]
    # That of one base is known by many jobs, that of the bases by few: their mean is not (restricted likelihood).
    known = counts.sum(axis=(0, 1)) @ probit_weights(_SCORES / within)[1] / len(of_base)
    total = likelihood(_SPREAD, np.full(len(_SPREAD), within)) + 0.5 * np.log(_SPREAD**2 + 1.0 / known)
    return BaseSpread(np.exp(total - logsumexp(total)), effective, float(within))


def _log_likelihood(counts: Array, spread: float, within: float) -> Array:
    """Log-likelihood (bases,) of the jobs on each base, up to a constant.

    counts: (2, bases, scores), weighted numbers of jobs that stood and that toppled.
    """
    toppled = log_ndtr(_SCORES[:, None] / within + spread * _NORMAL)
    return logsumexp(counts[0] @ toppled[::-1, ::-1] + counts[1] @ toppled - 0.5 * _NORMAL**2, axis=1)


def narrowed_by(parts: Mapping[str, float], scan: Mapping[str, Any]) -> str:
    """Say which measurement would narrow an interval most; empty without parts.

    parts: parts of the interval by cause (`Lognormal.interval_parts`).
    scan: the scan's report in the scene, hints included.
    """
    if not parts:
        return ""
    found = scan.get("unseen_base") or {}
    if parts.get("base", 0.0) <= parts["records"]:
        return "More records would narrow the interval most."
    if not found:
        return "The base's part is of a drawn centre of mass and friction: measuring these would narrow it."
    means = "touches and daylight seen along the crevice"
    if pull := narrowing_pull(found)[0]:
        means = f"{pull}, more than by one toward anywhere else"
    sentence = f"The base's part would be narrowed by {means} (toppling scan --again)."
    if "without_inspection" not in found:
        return sentence
    known = inspection_sentence(found["toppling"], found["without_inspection"])
    return f"{known[0].upper()}{known[1:]}. {sentence}"


_SUSPECT_SLOPE = 1.5
"""Ratio of a resample's slope to the fit's above which it is tested for separated answers, whose likelihood has no
maximum although the search ends."""


def bootstrap(
    frame: pd.DataFrame,
    fitted: Fit,
    samples: int = SAMPLES,
    seed: int = 0,
    advance: Callable[[], None] = lambda: None,
) -> Resampled:
    """Fit a model again to resampled `earthquakes`; no samples where there are fewer records than `LEAST_RECORDS`.

    `advance` is called before each sample. Rocks shaken by the same records get the same resamples, because the choice
    of records is common to them; bases are drawn for each rock.
    """
    groups = grouped(frame, fitted.measures)
    design = design_of(groups, fitted.measures)
    codes, records = pd.factorize(groups["earthquake"], sort=True)
    random = np.random.default_rng([seed, zlib.crc32("\n".join(records).encode())])
    steep = _SUSPECT_SLOPE * np.abs(fitted.coefficients[1:]).max()
    fitted_again = np.zeros(samples if len(records) >= LEAST_RECORDS else 0, bool)
    drawn = np.array([
        np.bincount(random.integers(0, len(records), len(records)), minlength=len(records))[codes]
        for _ in fitted_again
    ]).reshape(-1, len(codes))  # fmt: skip
    share, trials = groups["share"].to_numpy(float), groups["trials"].to_numpy(float)
    quick = refitted(design, share, trials, fitted.coefficients, drawn)
    found = []
    for number, again in enumerate(quick):
        advance()
        if np.isnan(again).any() or is_flat(again):
            continue
        if np.abs(again[1:]).max() > steep and groups_separable(design, groups, drawn[number] > 0):
            continue
        fitted_again[number] = True
        found.append(again)
    refits = np.array(found).reshape(-1, design.shape[1])
    if found:
        refits = _reflected(np.array(fitted.coefficients), refits, len(records))
    known = design_of(frame, fitted.measures) @ fitted.coefficients
    spread = base_spread(frame, known)
    if spread is None:
        return Resampled(refits, fitted_again)
    rock = str(frame["scene_id"].iloc[0]) if "scene_id" in frame else ""
    shift = spread.drawn(len(refits), np.random.default_rng([seed, zlib.crc32(rock.encode())]))
    on_single_base = (refits + np.outer(shift, np.eye(1, design.shape[1])[0])) / spread.within
    return Resampled(on_single_base, fitted_again, refits)


def sampled(
    frame: pd.DataFrame, fitted: Fit, samples: int = SAMPLES, advance: Callable[[], None] = lambda: None
) -> Fit:
    """Add its `bootstrap` to a fit; a fit with a problem is returned unchanged."""
    if fitted.problem:
        return fitted
    return replace(fitted, resampled=bootstrap(frame, fitted, samples, advance=advance))


_TAIL = (1.0 + CONFIDENCE) / 2.0
"""Quantile whose Student's t widens the samples: the upper end of an interval."""

_FARTHEST = 4.0
"""Largest distance of a refit from the fit, in natural logarithms of median and beta, for which it is reflected."""


def _reflected(fitted: Array, refits: Array, records: int) -> Array:
    """Reflect bootstrap refits of a probit about the fit, so that percentiles are unbiased intervals for few records.

    Percentiles of a plain bootstrap take the spread of refits for the error of the fit. With few records, whose jobs
    are not independent, beta is too small in the fit and smaller again in the refits, so that intervals of beta and
    of what depends on it (a rate of toppling) lie too low. Here each refit is reflected about the fit (the basic
    bootstrap: Davison and Hinkley 1997, Bootstrap methods and their application, section 5.2), in coordinates that are
    nearly normal: location, logarithm of the spread and, for two measures, their direction. Deviations are widened as
    in a regression of p coefficients on n records: by sqrt(n / (n - p)), and by Student's t of n - p over the
    normal quantile (Hesterberg 2015, for means).

    fitted: (p,), coefficients of a fit to one or two measures.
    refits: (k, p), coefficients of the samples.
    records: number of records that are drawn.
    Returns (k, p) array: a sample farther than `_FARTHEST` from the fit is unchanged.
    """
    to, back = (_of_line, _line) if len(fitted) == 2 else (_of_plane, _plane)
    freedom = records - len(fitted)
    wider = math.sqrt(records / freedom) * stdtrit(freedom, _TAIL) / ndtri(_TAIL)
    centre, away = to(fitted), to(refits) - to(fitted)
    if len(fitted) == 3:
        away[:, 2] = (away[:, 2] + math.pi) % (2 * math.pi) - math.pi
    near = np.all(np.abs(away[:, :2]) < _FARTHEST, axis=1, keepdims=True)
    return np.where(near, back(centre - wider * away), refits)


def _of_line(coefficients: Array) -> Array:
    intercept, slope = np.moveaxis(coefficients, -1, 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.stack([-intercept / slope, np.log(slope)], axis=-1)


def _line(coordinates: Array) -> Array:
    location, logarithm = np.moveaxis(coordinates, -1, 0)
    slope = np.exp(logarithm)
    return np.stack([-location * slope, slope], axis=-1)


def _of_plane(coefficients: Array) -> Array:
    intercept, first, second = np.moveaxis(coefficients, -1, 0)
    steepness = np.hypot(first, second)
    return np.stack([-intercept / steepness, np.log(steepness), np.arctan2(second, first)], axis=-1)


def _plane(coordinates: Array) -> Array:
    location, logarithm, direction = np.moveaxis(coordinates, -1, 0)
    steepness = np.exp(logarithm)
    return np.stack(
        [-location * steepness, steepness * np.cos(direction), steepness * np.sin(direction)], axis=-1
    )


def refitted(
    design: Array, share: Array, trials: Array, start: Sequence[float], weights: NDArray[np.int64]
) -> Iterator[Array]:
    """Maximum likelihood coefficients for each row of weights; nan where the search does not converge.

    design: (groups, coefficients).
    share, trials: (groups,), fraction of each group's jobs that toppled, and number of its jobs.
    start: (coefficients,), those of the fit with unit weights.
    weights: (samples, groups), how often each group was drawn.
    """
    block = max(1, AT_ONCE // max(1, len(design)))
    for first in range(0, len(weights), block):
        yield from scored(design, share, trials * weights[first : first + block], np.asarray(start))
