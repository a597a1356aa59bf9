"""Bootstrap of fits over records and hidden bases, and the intervals that follow.

Records are drawn, never jobs: scaled and turned copies of one record are not independent. The rock has one base, so
each sample is for a single base, drawn from the distribution of those that the jobs are spread over (`bases`).
"""

import math
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

from toppling.models.arrays import Array
from toppling.results.analysis import SAMPLES
from toppling.results.analysis.bases import base_spread
from toppling.results.analysis.lognormal import Resampled
from toppling.results.analysis.regression import Fit, design_of, grouped, groups_separable, is_flat, scored

LEAST_RECORDS = 5
"""Minimum number of records for a bootstrap: resamples of fewer are too often identical."""

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
    """Fit a model again to resampled records; no samples where there are fewer records than `LEAST_RECORDS`.

    `advance` is called before each sample. Rocks shaken by the same records get the same resamples, because the choice
    of records is common to them; bases are drawn for each rock.
    """
    groups = grouped(frame, fitted.measures)
    design = design_of(groups, fitted.measures)
    codes, records = pd.factorize(groups["record_id"], sort=True)
    random = np.random.default_rng([seed, zlib.crc32("\n".join(records).encode())])
    steep = _SUSPECT_SLOPE * np.abs(fitted.coefficients[1:]).max()
    fitted_again = np.zeros(samples if len(records) >= LEAST_RECORDS else 0, bool)
    drawn = np.array([
        np.bincount(random.integers(0, len(records), len(records)), minlength=len(records))[codes]
        for _ in fitted_again
    ]).reshape(-1, len(codes))  # fmt: skip
    share, trials = groups["share"].to_numpy(float), groups["trials"].to_numpy(float)
    quick = refitted(design, share, trials, fitted.link, fitted.coefficients, drawn)
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
    turns = bool(found) and fitted.link == "probit" and len(fitted.measures) <= 2
    if turns:
        refits = _reflected(np.array(fitted.coefficients), refits, len(records))
    known = design_of(frame, fitted.measures) @ fitted.coefficients
    spread = base_spread(frame, known) if fitted.link == "probit" else None
    if spread is None:
        return Resampled(refits, fitted_again, len(records), turns)
    rock = str(frame["scene_id"].iloc[0]) if "scene_id" in frame else ""
    shift, within = spread.drawn(len(refits), np.random.default_rng([seed, zlib.crc32(rock.encode())]))
    on_one = (refits + np.outer(shift, np.eye(1, design.shape[1])[0])) / within[:, None]
    return Resampled(on_one, fitted_again, len(records), turns, refits)


def sampled(
    frame: pd.DataFrame, fitted: Fit, samples: int = SAMPLES, advance: Callable[[], None] = lambda: None
) -> Fit:
    """Add its `bootstrap` to a fit; a fit with a problem is returned unchanged."""
    if fitted.problem:
        return fitted
    return replace(fitted, resampled=bootstrap(frame, fitted, samples, advance=advance))


_TAIL = 0.975
"""Quantile whose Student's t widens the samples: the upper end of a 95 % interval."""

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


_AT_ONCE = 200_000
"""Maximum number of elements of an array of jobs by samples, which bounds memory."""


def refitted(
    design: Array, share: Array, trials: Array, link: str, start: Sequence[float], weights: NDArray[np.int64]
) -> Iterator[Array]:
    """Maximum likelihood coefficients for each row of weights; nan where the search does not converge.

    design: (groups, coefficients).
    share, trials: (groups,), fraction of each group's jobs that toppled, and number of its jobs.
    link: probit or logit.
    start: (coefficients,), those of the fit with unit weights.
    weights: (samples, groups), how often each group was drawn.
    """
    block = max(1, _AT_ONCE // max(1, len(design)))
    for first in range(0, len(weights), block):
        yield from scored(design, share, trials * weights[first : first + block], link, np.asarray(start))
