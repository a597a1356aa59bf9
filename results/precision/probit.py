"""Penalised probit-lognormal fragility from few jobs: P(topple | x) = Phi(a + b ln x), finite for separated answers.

The likelihood is multiplied by Jeffreys' prior (Firth 1993), so that a maximum always exists: where a threshold
separates the answers, the curve is only as steep as the number of jobs supports. Jobs of one record are not
independent: the variance is that of independent jobs plus the covariance of pairs of jobs of one record. It holds for
one job per record, without pairs, and for hundreds, where only the number of records matters.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import fdtrc, log_ndtr, ndtr, stdtrit

from toppling.models.arrays import Array, effective_number
from toppling.results.analysis import FEW
from toppling.results.analysis.lognormal import LOG_ROOT_2_PI, probit_weights
from toppling.results.analysis.resampling import bases_of

_DIFFERENCE = 1e-4
"""Step of numerical derivatives, as a fraction of a coefficient's standard error."""

_LEAST_SLOPE = 1e-9
"""Slope, in standard deviations of the logarithms, of a curve that does not rise with its measure."""

_SCATTERED = 20
"""Number of records or earthquakes below which the test of their scatter rejects too often."""


@dataclass(frozen=True, eq=False)
class Answers:
    """Answers to jobs, in the order in which the jobs were chosen."""

    log_x: Array  # (n,): logarithm of the intensity
    toppled: Array  # (n,): 1 or 0
    record: NDArray[np.int64]  # (n,): index of each job's record, or of its earthquake
    weight: Array  # (n,): weight of each job, with mean 1
    # (n,): index of each job's realisation, each of which has its own base; (m,): weights of the realisations.
    base: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    of_base: Array = field(default_factory=lambda: np.zeros(0))


def answers_of(
    frame: pd.DataFrame, jobs: Sequence[str], measures: Sequence[str], records: Mapping[str, int]
) -> dict[str, Answers]:
    """Answers to some jobs by measure, in the order of the jobs rather than of the rows.

    frame: rows of results, with weights in `record_weight` where they differ.
    jobs: job ids, in the order chosen.
    measures: columns; those not positive in every row are left out.
    records: index of each record id, or of its earthquake.
    """
    rows = frame.set_index("job_id").reindex(jobs)
    rows = rows[rows["toppled"].notna()]
    toppled = rows["toppled"].to_numpy(bool).astype(float)
    record = rows["record_id"].map(records).to_numpy(np.int64)
    weight = rows["record_weight"].to_numpy(float) if "record_weight" in rows else np.ones(len(rows))
    base, of_base = bases_of(rows)
    usable = [name for name in measures if (rows[name].fillna(0.0) > 0).all()]
    return {
        name: Answers(
            np.log(rows[name].to_numpy(float)), toppled, record, weight / weight.mean(), base, of_base
        )
        for name in usable
    }


@dataclass(frozen=True, eq=False)
class Curve:
    """A fitted curve with its covariance."""

    coefficients: Array  # (2,): a and b
    independent: Array  # (2, 2): covariance as if jobs were independent
    pairs: Array  # (2, 2): covariance added by pairs of jobs of one record
    log_likelihood: float  # at the maximum, without the prior
    # Number of jobs, and Kish's effective number of records.
    jobs: int
    records: float
    # Number of ordered pairs of jobs of one record, over the square of the number of jobs.
    pairs_fraction: float

    @property
    def median(self) -> float:
        """Intensity with a toppling probability of one half."""
        a, b = self.coefficients
        return math.exp(min(-a / b, 700.0))

    @property
    def beta(self) -> float:
        """Logarithmic standard deviation, averaged over the uncertainty of the slope.

        The inverse of the estimated slope is biased low: stopping at a narrow interval favours steep curves.
        """
        return float((1.0 + self.slope_variance) / self.coefficients[1])

    def log_x(self, z: Array) -> Array:
        """Logarithm of the intensity with toppling probability Phi(z)."""
        a, b = self.coefficients
        return (z - a) / b

    def wide_log_x(self, z: Array) -> Array:
        """Logarithm of the intensity with toppling probability Phi(z) on a curve two standard deviations flatter.

        Jobs chosen by a curve that is steep by chance would never reveal that.
        """
        a, b = self.coefficients
        return -a / b + z / b * (1.0 + 2.0 * math.sqrt(self.slope_variance))

    def student(self, times: float = 1.0) -> float:
        """Half width of a 95 % interval in standard errors, if there were `times` as many jobs.

        A standard error is proportional to beta, which is estimated with a relative standard deviation c. This
        corresponds to 1 / (2 c^2) degrees of freedom, or fewer if there are fewer records, and beta is too small by c^2
        on average.
        """
        c2 = self.slope_variance / times
        freedom = max(self.records - 1.0, 1.0)
        if c2 > 0.0:
            freedom = max(min(freedom, 0.5 / c2), 1.0)
        return float(stdtrit(freedom, 0.975)) * (1.0 + c2)

    @property
    def slope_variance(self) -> float:
        """Relative variance of the slope."""
        return float(self.independent[1, 1] + max(self.pairs[1, 1], 0.0)) / float(self.coefficients[1]) ** 2

    def variances(self, target: Callable[[Array], float]) -> tuple[float, float]:
        """Variance of a function of the coefficients (2,) for independent jobs, and the part added by pairs."""
        step = _DIFFERENCE * np.sqrt(np.diag(self.independent))
        ends = [[target(self.coefficients + sign * shift) for sign in (1, -1)] for shift in np.diag(step)]
        slope = -np.diff(ends)[:, 0] / (2.0 * step)
        return float(slope @ self.independent @ slope), float(slope @ self.pairs @ slope)


def fit_curve(answers: Answers) -> Curve:
    """Fit the curve, with a positive slope, by penalised maximum likelihood to answers at two or more intensities."""
    middle = float(np.average(answers.log_x, weights=answers.weight))
    spread = float(answers.log_x.std())
    design = np.column_stack([np.ones(len(answers.log_x)), (answers.log_x - middle) / spread])
    coefficients = _maximise(design, answers)
    eta = design @ coefficients
    information, score, log_likelihood = _terms(design, answers, eta)
    a, b = coefficients[0] - coefficients[1] * middle / spread, coefficients[1] / spread
    # (a, b) of ln x from those of the centred and scaled logarithm
    back = np.array([[1.0, -middle / spread], [0.0, 1.0 / spread]])
    independent = back @ np.linalg.inv(information.sum(axis=0)) @ back.T
    pairs = back @ _pairs(information, score, answers.record) @ back.T
    counts, weight = np.bincount(answers.record), np.bincount(answers.record, answers.weight)
    return Curve(
        coefficients=np.array([a, b]),
        independent=independent,
        pairs=pairs,
        log_likelihood=log_likelihood,
        jobs=len(eta),
        records=effective_number(weight[counts > 0] / counts[counts > 0]),
        pairs_fraction=float((counts * (counts - 1)).sum()) / len(eta) ** 2,
    )


def _maximise(design: Array, answers: Answers) -> Array:
    """Coefficients, with a positive slope, that maximise likelihood times Jeffreys' prior."""

    def against(coefficients: Array) -> tuple[float, Array]:
        """Negative logarithm of what is maximised, and its gradient."""
        eta = design @ coefficients
        information, score, log_likelihood = _terms(design, answers, eta)
        total = information.sum(axis=0)
        sign, log_det = np.linalg.slogdet(total)
        if sign <= 0:
            return math.inf, np.zeros(2)
        leverage = np.einsum("nij,ji->n", information, np.linalg.inv(total))
        log_density = -0.5 * eta**2 - LOG_ROOT_2_PI
        bend = np.exp(log_density - log_ndtr(-eta)) - np.exp(log_density - log_ndtr(eta)) - 2.0 * eta
        gradient = score.sum(axis=0) + 0.5 * (leverage * bend) @ design
        return -log_likelihood - 0.5 * float(log_det), -gradient

    limits = [(None, None), (_LEAST_SLOPE, None)]
    exact = {"ftol": 1e-13, "gtol": 1e-7}
    return np.asarray(minimize(against, [0.0, 1.0], jac=True, bounds=limits, options=exact).x)


def _terms(design: Array, answers: Answers, eta: Array) -> tuple[Array, Array, float]:
    """Information (n, 2, 2) and score (n, 2) of each job, and the total log-likelihood."""
    log_density, above, below = -0.5 * eta**2 - LOG_ROOT_2_PI, log_ndtr(eta), log_ndtr(-eta)
    log_p = np.where(answers.toppled > 0.5, above, below)
    sign = np.where(answers.toppled > 0.5, 1.0, -1.0)
    score = answers.weight * sign * np.exp(log_density - log_p)
    information = answers.weight * probit_weights(eta)[1]
    outer = design[:, :, None] * design[:, None, :]
    return information[:, None, None] * outer, score[:, None] * design, float(answers.weight @ log_p)


def _pairs(information: Array, score: Array, record: NDArray[np.int64]) -> Array:
    """Covariance (2, 2) added by pairs of jobs of one record.

    Scores are corrected by the leverage of their record (as in the jackknife), because residuals of few records are
    too small.
    """
    count = int(record.max()) + 1
    of_record, total = np.zeros((count, 2, 2)), information.sum(axis=0)
    np.add.at(of_record, record, information)
    influence = np.einsum("nij,nj->ni", np.linalg.inv(total - of_record + 1e-12 * total)[record], score)
    summed = np.zeros((count, 2))
    np.add.at(summed, record, influence)
    return summed.T @ summed - influence.T @ influence


_LEVEL = 0.02
"""Significance level of the test for a departure. Adaptive choice of the jobs can double it, to less than 5 %."""
_EDGES = np.array([0.1, 0.3, 0.5, 0.7, 0.9])
"""Edges of the bins of predicted probability in which prediction and answers are compared."""


@dataclass(frozen=True)
class Departure:
    """Significant departure of the answers from a lognormal curve."""

    p_value: float  # probability of as large a departure under a lognormal curve
    # Fractions toppled, by the curve and by the answers, of the jobs where they differ most significantly.
    expected: float
    observed: float
    jobs: int  # number of those jobs

    @property
    def words(self) -> str:
        """Clause for the statement."""
        comparison = (
            f"{100 * self.observed:.0f} % of {self.jobs} jobs topple, predicted {100 * self.expected:.0f} %"
        )
        return f"the curve is not lognormal: {comparison} (p = {self.p_value:.1g})"


def _p_value(curve: Curve, answers: Answers) -> float:
    """p-value of the answers' departure from the lognormal curve fitted to them; 1 for few records.

    A generalised score test by record: residuals are summed against deformations of the curve that are orthogonal to
    median and beta, and each record is one observation of the sums (Boos 1992; Liang & Zeger 1986 for clusters).
    """
    of_record = _departures(curve, answers)
    records, count = of_record.shape
    if records < _SCATTERED:
        return 1.0
    total = of_record.sum(axis=0)
    covariance = records * np.cov(of_record.T)
    squared = float(total @ np.linalg.pinv(covariance, rcond=1e-9, hermitian=True) @ total)
    # Hotelling's T squared
    return float(fdtrc(count, records - count, squared * (records - count) / (count * (records - 1.0))))


def _departures(curve: Curve, answers: Answers) -> Array:
    """Summed residuals of each record along two deformations of the curve, (records, 2).

    The deformations are P and P cubed, orthogonalised against the coefficients: they form asymptotes and shoulders.
    """
    eta = curve.coefficients[0] + curve.coefficients[1] * answers.log_x
    probability, log_density = ndtr(eta), -0.5 * eta**2 - LOG_ROOT_2_PI
    design = np.column_stack([np.ones_like(eta), eta])
    scores = probit_weights(eta)[0][:, None] * design
    slopes = (answers.weight * np.exp(log_density))[:, None] * design
    bends = np.column_stack([probability, probability**3])
    bends -= scores @ np.linalg.solve(slopes.T @ scores, slopes.T @ bends)
    _, record = np.unique(answers.record, return_inverse=True)
    of_record = np.zeros((int(record.max()) + 1, 2))
    np.add.at(of_record, record, (answers.weight * (answers.toppled - probability))[:, None] * bends)
    return of_record


def departure(curve: Curve, answers: Answers) -> Departure | None:
    """Departure of answers from the curve fitted to them; None where it is not significant."""
    p = _p_value(curve, answers)
    if p >= _LEVEL:
        return None
    probability = ndtr(curve.coefficients[0] + curve.coefficients[1] * answers.log_x)
    bin_of_job = np.searchsorted(_EDGES, probability)

    def clarity(part: int) -> float:
        there = bin_of_job == part
        weight, expected = answers.weight[there], probability[there]
        variance = float((weight**2 * expected * (1.0 - expected)).sum())
        # Half a job is added to the variance, so that a first exception among certain answers is not the clearest.
        return abs(float(weight @ (answers.toppled[there] - expected))) / (variance + 0.5) ** 0.5

    parts = [part for part in range(len(_EDGES) + 1) if (bin_of_job == part).sum() >= FEW]
    if not parts:
        return None
    there = bin_of_job == max(parts, key=clarity)
    weight = answers.weight[there]
    expected, observed = (
        float(np.average(of[there], weights=weight)) for of in (probability, answers.toppled)
    )
    return Departure(p, expected, observed, int(there.sum()))
