"""Whether answers contradict the lognormal curve fitted to them.

A score test by record: residuals are summed against bends of the curve that no other median or beta imitates, and each
record is one observation of the sums (Boos 1992, generalised score tests; Liang & Zeger 1986, clusters).
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr, ndtr
from scipy.stats import f

from toppling.models.arrays import Array
from toppling.results.precision.probit import LOG_ROOT_2_PI, Answers, Curve

_LEVEL = 0.02
"""Of the test. The answers chose the jobs, which can double the share of false alarms: they stay below 5 %."""
_LEAST_RECORDS, _LEAST_P = 20, 1e-3
_EDGES = np.array([0.1, 0.3, 0.5, 0.7, 0.9])
"""Probabilities of the curve between which its words are compared with the answers."""
_LEAST_JOBS_BETWEEN = 10


@dataclass(frozen=True)
class Departure:
    """How answers contradict a curve."""

    p_value: float  # probability of as clear a contradiction under a lognormal curve
    # Shares that topple, by the curve and by the answers, of the jobs where they differ most clearly.
    expected: float
    observed: float
    jobs: int  # how many those are

    @property
    def words(self) -> str:
        """For the statement."""
        shares = f"{100 * self.observed:.0f} % of {self.jobs} jobs topple where it says {100 * self.expected:.0f} %"
        p = f"p = {self.p_value:.1g}" if self.p_value >= _LEAST_P else f"p below {_LEAST_P:g}"
        return f"the curve is no lognormal: {shares} ({p})"


def p_value(curve: Curve, answers: Answers) -> float:
    """Probability, under a lognormal curve, of answers that depart from the fitted one as clearly; 1 of few records.

    curve: fitted to the answers.
    """
    of_record = _departures(curve, answers)
    records, count = of_record.shape
    if records < _LEAST_RECORDS:
        return 1.0
    total = of_record.sum(axis=0)
    covariance = records * np.cov(of_record.T)
    squared = float(total @ np.linalg.pinv(covariance, rcond=1e-9, hermitian=True) @ total)
    # Hotelling's T squared
    return float(f.sf(squared * (records - count) / (count * (records - 1.0)), count, records - count))


def _departures(curve: Curve, answers: Answers) -> Array:
    """Of each record the summed residuals along two bends of the curve, (records, 2).

    P and P cubed, less what a change of the coefficients does: together they make asymptotes and shoulders.
    """
    eta = curve.coefficients[0] + curve.coefficients[1] * answers.log_x
    probability, log_density = ndtr(eta), -0.5 * eta**2 - LOG_ROOT_2_PI
    design = np.column_stack([np.ones_like(eta), eta])
    scores = np.exp(log_density - log_ndtr(eta) - log_ndtr(-eta))[:, None] * design
    slopes = (answers.weight * np.exp(log_density))[:, None] * design
    bends = np.column_stack([probability, probability**3])
    bends -= scores @ np.linalg.solve(slopes.T @ scores, slopes.T @ bends)
    _, record = np.unique(answers.record, return_inverse=True)
    of_record = np.zeros((int(record.max()) + 1, 2))
    np.add.at(of_record, record, (answers.weight * (answers.toppled - probability))[:, None] * bends)
    return of_record


def departure(curve: Curve, answers: Answers) -> Departure | None:
    """How answers contradict the curve fitted to them; None where they do not."""
    p = p_value(curve, answers)
    if p >= _LEVEL:
        return None
    probability = ndtr(curve.coefficients[0] + curve.coefficients[1] * answers.log_x)
    bin_of_job = np.searchsorted(_EDGES, probability)

    def clarity(part: int) -> float:
        there = bin_of_job == part
        weight, expected = answers.weight[there], probability[there]
        variance = float((weight**2 * expected * (1.0 - expected)).sum())
        # Half a job more, so that the first surprise where all is certain does not count as the clearest.
        return abs(float(weight @ (answers.toppled[there] - expected))) / (variance + 0.5) ** 0.5

    parts = [part for part in range(len(_EDGES) + 1) if (bin_of_job == part).sum() >= _LEAST_JOBS_BETWEEN]
    if not parts:
        return None
    there = bin_of_job == max(parts, key=clarity)
    weight = answers.weight[there]
    expected, observed = (
        float(np.average(of[there], weights=weight)) for of in (probability, answers.toppled)
    )
    return Departure(p, expected, observed, int(there.sum()))
