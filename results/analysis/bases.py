"""Variation of fragility between the hidden bases that a scan allows, from jobs that are spread over them.

The rock stands on one base, which is unknown. Its curve is Phi((s + u) / sqrt(1 - c)), where s is the score of the
curve of all bases and u, the effect of the base, is normal with variance c. Averaged over bases that is Phi(s) again;
c is the intraclass correlation between the latent scores of two jobs on one base.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import log_ndtr, logsumexp, ndtri

from toppling.models.arrays import Array, Flags, Indices
from toppling.models.hidden_base.intervals import inspection_told
from toppling.models.proportions import effective_number
from toppling.results.weights import records_weight

_CORRELATION = (np.arange(40) + 0.5) ** 2 / 40.0**2
"""Grid of values of c, equally likely a priori: a uniform prior of the standard deviation of u."""
_NORMAL = np.linspace(-4.0, 4.0, 161)
"""Standard normal deviates that u is integrated over."""
_SCORES = np.linspace(-6.0, 6.0, 121)
"""Centres of the bins of scores, in standard deviations: narrow against the width of a curve."""


@dataclass(frozen=True, eq=False)
class BaseSpread:
    """Posterior of the variation between bases."""

    chance: Array  # (40,): posterior probability of each correlation of the grid
    bases: int  # number of bases that the jobs are on
    effective: float  # effective number of bases, by their weights

    @property
    def variance(self) -> float:
        """Expected variance of u for a new base, with the error of the mean over the bases of the jobs."""
        return float(self.chance @ _CORRELATION) * (1.0 + 1.0 / self.effective)

    def drawn(self, count: int, random: np.random.Generator) -> tuple[Array, Array]:
        """Shift u of the score and sqrt(1 - c), (count,) each, of new bases.

        Both are stratified over their distributions, so that few draws represent them.
        """
        even = random.permuted(np.tile((np.arange(count) + 0.5) / max(count, 1), (2, 1)), axis=1)
        correlation = _CORRELATION[
            np.searchsorted(self.chance.cumsum(), even[0]).clip(max=len(_CORRELATION) - 1)
        ]
        spread = np.sqrt(correlation * (1.0 + 1.0 / self.effective))
        return spread * ndtri(even[1]), np.sqrt(1.0 - correlation)


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
    likelihood = [_log_likelihood(counts, correlation) for correlation in _CORRELATION]
    total = np.array(likelihood) @ (of_base / of_base.sum() * effective)
    return BaseSpread(np.exp(total - logsumexp(total)), len(of_base), effective)


def _log_likelihood(counts: Array, correlation: float) -> Array:
    """Log-likelihood (bases,) of the jobs on each base, up to a constant.

    counts: (2, bases, scores), weighted numbers of jobs that stood and that toppled.
    """
    toppled = _log_probability(correlation)
    return logsumexp(counts[0] @ toppled[::-1, ::-1] + counts[1] @ toppled - 0.5 * _NORMAL**2, axis=1)


@cache
def _log_probability(correlation: float) -> Array:
    """Log-probability of toppling by score and u, (scores, u); with both axes reversed, that of standing."""
    return log_ndtr((_SCORES[:, None] + np.sqrt(correlation) * _NORMAL) / np.sqrt(1.0 - correlation))


def narrowed_by(parts: Mapping[str, float], scan: Mapping[str, Any]) -> str:
    """Say which measurement would narrow an interval most; empty without parts.

    parts: parts of the interval by cause (`Lognormal.interval_parts`).
    scan: the scan's report in the scene, hints included.
    """
    if not parts:
        return ""
    found = scan.get("unseen_base") or {}
    if parts.get("base", 0.0) <= parts["records"] or not found:
        return "More records would narrow the interval most."
    kinds = list(found.get("kinds") or ())
    kind = f", or whether the base is {' or '.join(kinds)}" if len(kinds) > 1 else ""
    means = f"a pull test, places that touch or let daylight through{kind} (toppling scan --again)"
    known = (
        [inspection_told(found["toppling"], found["without_inspection"])]
        if "without_inspection" in found
        else []
    )
    return ". ".join(
        [*(text[0].upper() + text[1:] for text in known), f"The base's part would be narrowed by {means}."]
    )
