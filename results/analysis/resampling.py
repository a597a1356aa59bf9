"""Fits repeated on resampled records, and the intervals that follow.

Records are drawn, never jobs: scaled and turned copies of one record are not independent.
"""

import zlib
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from toppling.results.analysis.lognormal import Lognormal, Resampled
from toppling.results.analysis.refits import refitted
from toppling.results.analysis.reflected import reflected
from toppling.results.analysis.regression import Fit, design_of, grouped, groups_separable, is_flat, regress

LEAST_RECORDS = 5
"""Fewer cannot be resampled: their resamples are too often the same few."""

SAMPLES = 200
"""Of resampled records, for intervals of 95 %."""

_SUSPECT_SLOPE = 1.5
"""Times the fit's own, from which a resample's slope may be that of separated answers, where the search just ends:
its likelihood rises for ever."""


def bootstrap(
    frame: pd.DataFrame,
    fitted: Fit,
    samples: int = SAMPLES,
    seed: int = 0,
    advance: Callable[[], None] = lambda: None,
) -> Resampled:
    """Fit the same model to resampled records; to none where they are fewer than `LEAST_RECORDS`.

    `advance` is called before each sample. Rocks shaken by the same records get the same draws, as other records would
    have been other records for all of them.
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
    for number, once in enumerate(quick):
        advance()
        again: NDArray[np.float64] | None = once
        if np.isnan(once).any():
            again = regress(design, groups, fitted.link, drawn[number], start=fitted.coefficients)
        if again is None or is_flat(again):
            continue
        if np.abs(again[1:]).max() > steep and groups_separable(design, groups, drawn[number] > 0):
            continue
        fitted_again[number] = True
        found.append(again)
    refits = np.array(found).reshape(-1, design.shape[1])
    turns = bool(found) and fitted.link == "probit" and len(fitted.measures) <= 2
    if turns:
        refits = reflected(np.array(fitted.coefficients), refits, len(records))
    return Resampled(refits, fitted_again, len(records), turns)


def lognormal_interval(resampled: Resampled, level: float = 0.95) -> dict[str, float]:
    """Intervals of median and beta over bootstrap samples of a lognormal fit."""
    intercept, slope = resampled.coefficients.T
    median = resampled.interval(np.exp(-intercept / slope), level)
    beta = resampled.interval(1.0 / slope, level)
    return {"median_low": median[0], "median_high": median[1], "beta_low": beta[0], "beta_high": beta[1]}


def with_interval(curve: Lognormal, resampled: Resampled | None) -> Lognormal:
    """A curve with its bootstrap samples and their interval of its median; as it was where there are none."""
    if resampled is None or not len(resampled.coefficients):
        return curve
    ends = lognormal_interval(resampled)
    interval = float(ends["median_low"]), float(ends["median_high"])
    return replace(curve, median_interval=interval, resampled=resampled)
