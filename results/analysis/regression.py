"""Binomial regression of toppling on logarithms of intensity measures.

With a probit link and one measure it is the lognormal fragility Phi(ln(x / median) / beta) at maximum likelihood
(Baker 2015, eq. 11).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.special import expit, ndtr, ndtri

from toppling.models.arrays import Array
from toppling.results.analysis.lognormal import Lognormal, Resampled, Surface, lognormal_of, with_samples
from toppling.results.schema import SCHEMA, describe

_FLATTEST_SLOPE = 0.1
"""Minimum slope of a probit fit to one measure. At this slope the toppling probability grows from 50 to 84 % over a
factor of 22,000 in intensity (e^10): the measure does not predict, and medians overflow."""
NEAR_TIE = 1e-6
"""Relative difference below which two intensities are equal: jobs of one level differ by rounding alone."""


SURFACES = (("pga_m_s2", "pgv_m_s"), ("pga_m_s2", "pgv_pga_s"))
"""Pairs of measures that are fitted jointly. On logarithms both are the same model; both are plotted."""

LINKS = {"probit": ndtr, "logit": expit}
"""Inverse link functions: probability of a linear predictor."""

_STEPS = 100
"""Maximum number of Fisher scoring steps."""
_EPSILON = float(np.finfo(float).eps)
_TOLERANCE = 1e-9
"""Convergence tolerance of a coefficient, relative to the larger of itself and 1."""

_EDGES = {"probit": -float(ndtri(_EPSILON)), "logit": -math.log(_EPSILON)}
"""Largest absolute linear predictor; beyond it a probability is clipped, as in statsmodels."""


@dataclass(frozen=True)
class Fit:
    """A binomial regression on logarithms of intensity measures."""

    measures: tuple[str, ...]
    link: str  # probit or logit
    # Intercept, then one slope a measure's natural logarithm; empty where there is a problem.
    coefficients: tuple[float, ...]
    jobs: int
    toppled: int
    records: int
    problem: str = ""  # why there is no fit; empty where there is one
    # For one measure: the largest intensity that a job survived, and the smallest that toppled one. Where the
    # answers are separated these bound the median.
    bounds: tuple[float, float] = (math.nan, math.nan)
    # Bootstrap of the fit, where requested.
    resampled: Resampled | None = field(default=None, compare=False, repr=False)

    @property
    def lognormal(self) -> Lognormal | None:
        """Equivalent lognormal fragility of a probit fit to one measure; None for other fits."""
        if self.problem or self.link != "probit" or len(self.measures) != 1:
            return None
        return with_samples(lognormal_of(self.measures[0], *self.coefficients), self.resampled)

    @property
    def surface(self) -> Surface | None:
        """Equivalent fragility surface over the measures of a probit fit; None for other fits."""
        if self.problem or self.link != "probit":
            return None
        return Surface(self.measures, self.coefficients, resampled=self.resampled)

    def probability(self, frame: pd.DataFrame) -> Array:
        """Toppling probability of each row's measures."""
        return LINKS[self.link](design_of(frame, self.measures) @ np.array(self.coefficients))


def fit(frame: pd.DataFrame, measures: Sequence[str], link: str = "probit") -> Fit:
    """Fit toppling probability to one or several intensity measures by maximum likelihood.

    frame: rows of results with an answer (`answered`).
    measures: columns, each positive throughout.
    link: probit or logit.
    Returns Fit: with a `problem` instead of coefficients where the maximum does not exist (one answer only, or answers
    that a threshold separates, but for those at it: Albert and Anderson 1984), or where probability does not rise with
    the one measure.
    """
    names = tuple(measures)
    toppled = frame["toppled"].to_numpy(bool)
    counts = {
        "measures": names, "link": link, "jobs": len(frame), "toppled": int(toppled.sum()),
        "records": frame["record_id"].nunique(), "bounds": _bounds(frame, names),
    }  # fmt: skip
    if toppled.all() or not toppled.any():
        which = "every job topples" if len(toppled) and toppled.all() else "no job topples"
        return Fit(**counts, coefficients=(), problem=which)
    if _separable(design_of(frame, names), toppled):
        return Fit(**counts, coefficients=(), problem=_separation(frame, names))
    groups = grouped(frame, names)
    coefficients = _regress(design_of(groups, names), groups, link)
    if coefficients is None:
        return Fit(**counts, coefficients=(), problem="the fit does not converge")
    if is_flat(coefficients):
        return Fit(**counts, coefficients=(), problem="probability does not rise with the measure")
    return Fit(**counts, coefficients=tuple(float(value) for value in coefficients))


def softened(frame: pd.DataFrame, measures: Sequence[str]) -> tuple[float, ...] | None:
    """Coefficients of a probit whose answers are softened by half a job in total, so that separated ones have a fit.

    None where all jobs have the same answer.
    """
    toppled = frame["toppled"].astype(float)
    if toppled.nunique() < 2:
        return None
    softening = 0.5 / len(frame)
    groups = grouped(frame, measures, toppled.clip(softening, 1.0 - softening))
    found = _regress(design_of(groups, measures), groups, "probit")
    return None if found is None else tuple(float(value) for value in found)


def design_of(frame: pd.DataFrame, measures: Sequence[str]) -> Array:
    """Design matrix: ones and the logarithms of the measures, (rows, 1 + measures)."""
    return np.column_stack([np.ones(len(frame)), np.log(frame[list(measures)].to_numpy(float))])


def grouped(
    frame: pd.DataFrame, measures: Sequence[str], answers: "pd.Series[float] | None" = None
) -> pd.DataFrame:
    """Group jobs of one record with equal measures: the same likelihood at a fraction of the cost.

    A column `record_weight` (`Run.weighted`) multiplies a job's part of the likelihood: jobs of one record have
    different weights on bases of different weight. `answers` (0 to 1) replaces whether each job toppled.
    """
    weight = frame.get("record_weight", 1.0)
    jobs = frame.assign(
        trials=weight, share=weight * (frame["toppled"].astype(float) if answers is None else answers)
    )
    table = jobs.groupby(["record_id", *measures], sort=False)[["share", "trials"]].sum()
    return table.assign(share=table["share"] / table["trials"]).reset_index()


def _regress(design: Array, groups: pd.DataFrame, link: str) -> Array | None:
    """Maximum likelihood coefficients; None where the search does not converge."""
    share, trials = (groups[name].to_numpy(float) for name in ("share", "trials"))
    (found,) = scored(design, share, trials[None], link, np.zeros(design.shape[1]))
    return found if np.isfinite(found).all() else None


def scored(design: Array, share: Array, trials: Array, link: str, start: Array) -> Array:
    """Maximum likelihood coefficients for each of several weightings, by Fisher scoring, vectorised.

    design: (groups, coefficients).
    share: (groups,), fraction of each group's jobs that toppled.
    trials: (samples, groups), number of jobs of each group times its weight in the sample.
    start: (coefficients,), first iterate.
    Returns (samples, coefficients) array: nan where the search does not converge.
    """
    found, left = np.full((len(trials), design.shape[1]), np.nan), np.arange(len(trials))
    at = np.tile(start, (len(trials), 1))
    with np.errstate(all="ignore"):  # samples with NaN stay in the search and do not converge
        for _ in range(_STEPS):
            step = _step(design, share, trials[left], link, at)
            at = at + step
            ended = (np.abs(step) <= _TOLERANCE * np.maximum(np.abs(at), 1.0)).all(axis=1)
            found[left[ended]] = at[ended]
            left, at = left[~ended], at[~ended]
            if not len(left):
                break
    return found


def _step(design: Array, share: Array, trials: Array, link: str, at: Array) -> Array:
    """Fisher scoring step of each sample's coefficients: inverse information times score."""
    edge = _EDGES[link]
    predictor = np.clip(at @ design.T, -edge, edge)
    if link == "probit":
        probability, slope = ndtr(predictor), np.exp(-(predictor**2) / 2.0) / math.sqrt(2.0 * math.pi)
        other = ndtr(-predictor)
    else:
        probability, other = expit(predictor), expit(-predictor)
        slope = probability * other
    weight = trials * slope / (probability * other)
    score = (weight * (share - probability)) @ design
    information = np.einsum("sj,ja,jb->sab", weight * slope, design, design, optimize=True)
    information[np.linalg.det(information) == 0.0] = np.nan  # too few jobs for the coefficients
    return np.linalg.solve(information, score[:, :, None])[:, :, 0]


def is_flat(coefficients: Array) -> bool:
    """Whether the probability of a fit to one measure does not rise with it."""
    return len(coefficients) == 2 and bool(coefficients[1] < _FLATTEST_SLOPE)


def _separable(design: Array, toppled: NDArray[np.bool_]) -> bool:
    """Whether a hyperplane separates toppled from standing jobs, ties on it allowed."""
    centred = np.column_stack([np.ones(len(design)), design[:, 1:] - design[:, 1:].mean(axis=0)])
    signed = centred * np.where(toppled, 1.0, -1.0)[:, None]
    signed = np.unique(signed, axis=0)
    found = linprog(
        -signed.sum(axis=0), A_ub=-signed, b_ub=np.zeros(len(signed)), bounds=(-1.0, 1.0), method="highs"
    )
    return bool(found.success and -found.fun > 1e-6)


def groups_separable(design: Array, groups: pd.DataFrame, drawn: NDArray[np.bool_]) -> bool:
    """Whether a hyperplane separates the answers of the drawn groups; a group with both answers counts as one each."""
    share = groups["share"].to_numpy(float)
    some, none = drawn & (share > 0), drawn & (share < 1)
    answers = np.concatenate([np.ones(some.sum(), bool), np.zeros(none.sum(), bool)])
    return _separable(np.concatenate([design[some], design[none]]), answers)


def _separation(frame: pd.DataFrame, measures: tuple[str, ...]) -> str:
    """Explain what separates the answers: a threshold, a level with both answers, or a line between two measures."""
    if len(measures) != 1:
        return "separated: a line divides the answers, but for those on it"
    standing, toppled = _bounds(frame, measures)
    if not math.isclose(standing, toppled, rel_tol=NEAR_TIE):
        falls = "probability does not rise with the measure"
        return "separated: a threshold divides the answers" if standing < toppled else falls
    unit = describe(SCHEMA.field(measures[0]))["unit"]
    if frame[measures[0]].max() > toppled * (1 + NEAR_TIE):
        return f"no job topples below {toppled:.4g} {unit}, some do at it and all above: levels near it are needed"
    return f"no job topples below {toppled:.4g} {unit}, and at it some do: levels above it are needed"


def _bounds(frame: pd.DataFrame, measures: tuple[str, ...]) -> tuple[float, float]:
    if len(measures) != 1:
        return (math.nan, math.nan)
    toppled = frame["toppled"].to_numpy(bool)
    value = frame[measures[0]].to_numpy(float)
    return float(value[~toppled].max(initial=0.0)), float(value[toppled].min(initial=math.inf))
