"""Lognormal fragilities over one or several measures: binomial regression, its basis, and bootstrap samples."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linprog
from scipy.special import log_ndtr, ndtr, ndtri, stdtrit

from toppling.models.arrays import Array
from toppling.results.analysis import FEW
from toppling.results.reader import Completeness
from toppling.results.schema import SCHEMA, describe

LOG_ROOT_2_PI = 0.5 * math.log(2.0 * math.pi)


def probit_weights(eta: Array) -> tuple[Array, Array]:
    """Weights of a probit at linear predictors eta: of an answer in the score, and of a job in the Fisher information.

    phi / (Phi (1 - Phi)) and phi^2 / (Phi (1 - Phi)), computed by logarithms to avoid overflow.
    """
    log_density = -0.5 * eta**2 - LOG_ROOT_2_PI
    below, above = log_ndtr(eta), log_ndtr(-eta)
    return np.exp(log_density - below - above), np.exp(2.0 * log_density - below - above)


@dataclass(frozen=True)
class Basis:
    """Data that a fragility over a measure is based on."""

    scene_id: str
    # Jobs with an answer, those of them that toppled, and their records.
    jobs: int
    toppled: int
    records: int
    # Jobs without an answer, left out of the fit; those that rocked too long to decide are no random sample.
    without_answer: int
    # Largest value of the measure of any job: beyond it the curve is an extrapolation.
    strongest_shaken: float
    # Jobs planned and jobs done in the whole run; None where unknown.
    jobs_planned: int | None = None
    jobs_done: int | None = None
    # Smallest value of the measure of any job, below which the curve is an extrapolation; None where unknown.
    weakest_shaken: float | None = None

    @property
    def unfinished(self) -> str:
        """Remark that the run was not finished; empty where it was or this is unknown."""
        return "" if self.jobs_done is None else Completeness(self.jobs_planned or 0, self.jobs_done).remark


@dataclass(frozen=True)
class Lognormal:
    """Lognormal fragility: P(topple | x) = Phi(ln(x / median) / beta)."""

    measure: str  # column of the results that x is a value of, in its SI unit
    median: float  # intensity with a toppling probability of one half
    beta: float  # logarithmic standard deviation; 0 for a sharp threshold
    basis: Basis | None = None  # where known
    # Ends of the median's 95 % interval, where known.
    median_interval: tuple[float, float] | None = None
    # Relative half widths of that interval by cause: "records", and "base" where the jobs are on several bases.
    # The squares of their logarithms add up to that of the interval.
    interval_parts: Mapping[str, float] = field(default_factory=dict, compare=False)
    # Bootstrap refits of the curve, where known.
    resampled: "Resampled | None" = field(default=None, compare=False, repr=False)

    def probability(self, intensity: ArrayLike) -> Array:
        """Toppling probability at intensities in the measure's SI unit; 0 at intensity 0."""
        with np.errstate(divide="ignore", invalid="ignore"):
            above = np.log(np.asarray(intensity, float) / self.median)
            z = np.where(above == 0.0, 0.0, above / self.beta) if self.beta > 0 else np.sign(above) * np.inf
        return ndtr(np.nan_to_num(z, nan=0.0))

    @property
    def strongest_shaken(self) -> float | None:
        """Largest value of the measure of any job; None where unknown."""
        return self.shaken[0]

    @property
    def shaken(self) -> tuple[float | None, float | None]:
        """Largest and smallest value of the measure of any job; None where unknown."""
        return (self.basis.strongest_shaken, self.basis.weakest_shaken) if self.basis else (None, None)

    @property
    def is_beyond_shaken(self) -> bool:
        """Whether the median exceeds the strongest shaking of any job."""
        return self.strongest_shaken is not None and self.median > self.strongest_shaken

    @property
    def numbers(self) -> dict[str, float]:
        """Median, beta, and where known the median's interval and its parts, for a statement."""
        ends = dict(zip(("median_low", "median_high"), self.median_interval or (), strict=False))
        parts = {f"median_{name}": part for name, part in self.interval_parts.items()}
        return {"median": self.median, "beta": self.beta} | ends | parts

    @property
    def measures(self) -> tuple[str, ...]:
        """The single measure as a tuple, for use in place of a `Surface`."""
        return (self.measure,)

    def less_fragile(self, factor: float) -> "Lognormal":
        """Curve of a rock that withstands motions stronger by a factor."""
        return replace(self, median=self.median * factor)

    def intensity(self, probability: float) -> float:
        """Intensity with a given toppling probability."""
        return self.median * math.exp(self.beta * ndtri(probability))


@dataclass(frozen=True)
class Surface:
    """Fragility over several measures: P(topple | x, y) = Phi(a + b ln x + c ln y)."""

    measures: tuple[str, ...]  # columns of the results
    coefficients: tuple[float, ...]  # intercept a, then a slope per measure's natural logarithm
    basis: Basis | None = None  # where known; its strongest shaking is in the first measure
    # Bootstrap refits of the surface, where known.
    resampled: "Resampled | None" = field(default=None, compare=False, repr=False)

    def probability(self, motions: Mapping[str, Array]) -> Array:
        """Toppling probability of events from their measures; 0 where a measure is 0."""
        intercept, *slopes = self.coefficients
        with np.errstate(divide="ignore", invalid="ignore"):
            parts = [slope * np.log(motions[name]) for name, slope in zip(self.measures, slopes, strict=True)]
            score = intercept + sum(parts)
        felt = np.all([np.asarray(motions[name]) > 0 for name in self.measures], axis=0)
        return np.where(felt, ndtr(score), 0.0)

    def less_fragile(self, factor: float) -> "Surface":
        """Surface of a rock that withstands motions stronger by a factor."""
        intercept, *slopes = self.coefficients
        return replace(self, coefficients=(intercept - sum(slopes) * math.log(factor), *slopes))


@dataclass(frozen=True, eq=False)
class Resampled:
    """Bootstrap refits of a model to resampled records, each sample on a single base.

    They are reflected (`analysis.resampling`), so that their percentiles (`ends`) allow for few records.
    """

    coefficients: Array  # (k, 1 + number of measures): of the samples with a fit
    # (samples,): which samples have a fit, in the order drawn; in the others the answers are separated, or the
    # probability does not rise.
    fitted: NDArray[np.bool_]
    # Coefficients of the curve averaged over bases, shaped as `coefficients`; None where the jobs are on one base.
    over_records: Array | None = None

    @property
    def without_fit(self) -> int:
        """Number of samples without a fit."""
        return int((~self.fitted).sum())

    def drawn(self) -> Iterator[Array | None]:
        """Coefficients of each sample in the order drawn; None for a sample without a fit."""
        found = iter(self.coefficients)
        return (next(found) if has_fit else None for has_fit in self.fitted)

    def lognormals(self, measure: str) -> list[Lognormal]:
        """Lognormal fragility of each sample of a fit to one measure, in the order drawn.

        A sample without a fit gives no bound: its curve is that of a rock that no shaking topples.
        """
        never = Lognormal(measure, math.inf, 0.0)
        return [never if row is None else _lognormal_of(measure, *row) for row in self.drawn()]

    def surfaces(self, measures: Sequence[str]) -> list[Surface]:
        """Fragility surface of each sample over several measures; zero probability for a sample without a fit."""
        never = -math.inf, *(0.0 for _ in measures)
        rows = (never if row is None else tuple(row.tolist()) for row in self.drawn())
        return [Surface(tuple(measures), row) for row in rows]


def lognormal_interval(resampled: Resampled) -> dict[str, float]:
    """Intervals (95 %) of the median on one base and of the beta over all bases, from samples of a lognormal fit."""
    intercept, slope = resampled.coefficients.T
    median = ends(np.exp(-intercept / slope))
    of_all = resampled.coefficients if resampled.over_records is None else resampled.over_records
    beta = ends(1.0 / of_all[:, 1])
    return {"median_low": median[0], "median_high": median[1], "beta_low": beta[0], "beta_high": beta[1]}


CAUSES = ("records", "base")
"""Causes of a median's uncertainty."""


def parts_words(parts: Mapping[str, float]) -> str:
    """Format the parts of an interval (`Lognormal.interval_parts`): "records ±12 %, base ±35 %"."""
    return ", ".join(f"{name} ±{float(f'{100 * part:.2g}'):,g} %" for name, part in parts.items())


def _interval_parts(interval: tuple[float, float], resampled: Resampled) -> dict[str, float]:
    whole = 0.5 * math.log(interval[1] / interval[0])
    if resampled.over_records is None:
        return {"records": math.sinh(whole)}
    intercept, slope = resampled.over_records.T
    of_records = min(0.5 * float(np.ptp(ends(-intercept / slope))), whole)
    return {"records": math.sinh(of_records), "base": math.sinh(math.sqrt(whole**2 - of_records**2))}


def expanded_interval(values: Array, records: int) -> Array:
    """Ends (2, ...) of the expanded percentile interval (95 %) of values (samples, ...).

    Bootstrap percentiles are too narrow by sqrt((n - 1) / n) and the ratio of Student's t to the normal quantile; the
    level is raised accordingly (Hesterberg 2015). Ends are values that occur: infinite ones cannot be interpolated.
    """
    tail = ndtr(-math.sqrt(records / (records - 1)) * stdtrit(records - 1, 0.975))
    return ends(values, float(tail))


def ends(values: Array, tail: float = 0.025) -> Array:
    """Quantiles (2, ...) at both tails of values (samples, ...); null without samples.

    Without interpolation: values may be infinite.
    """
    if not len(values):
        return np.full((2, *np.shape(values)[1:]), math.nan)
    low = np.quantile(values, tail, axis=0, method="lower")
    return np.array([low, np.quantile(values, 1 - tail, axis=0, method="higher")])


def _lognormal_of(measure: str, intercept: float, slope: float) -> Lognormal:
    """Lognormal fragility equivalent to a probit of one measure's logarithm."""
    return Lognormal(measure, math.exp(-intercept / slope), 1.0 / slope)


_FLATTEST_SLOPE = 0.1
"""Minimum slope of a probit fit to one measure. At this slope the toppling probability grows from 50 to 84 % over a
factor of 22,000 in intensity (e^10): the measure does not predict, and medians overflow."""
NEAR_TIE = 1e-6
"""Relative difference below which two intensities are equal: jobs of one level differ by rounding alone."""


PAIR = ("pga_m_s2", "pgv_m_s")
"""Measures that are fitted jointly. On logarithms the same model holds for PGA and PGV/PGA."""

STEPS = 100
"""Maximum number of steps of Fisher scoring."""
_EPSILON = float(np.finfo(float).eps)
_TOLERANCE = 1e-9
"""Convergence tolerance of a coefficient, relative to the larger of itself and 1."""

_EDGE = -float(ndtri(_EPSILON))
"""Largest absolute linear predictor; beyond it a probability is clipped, as in statsmodels."""


@dataclass(frozen=True)
class Fit:
    """A probit regression on logarithms of intensity measures."""

    measures: tuple[str, ...]
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
        """Equivalent lognormal fragility of a fit to one measure; None for other fits."""
        if self.problem or len(self.measures) != 1:
            return None
        curve = replace(_lognormal_of(self.measures[0], *self.coefficients), resampled=self.resampled)
        if self.resampled is None or not len(self.resampled.coefficients):
            return curve
        found = lognormal_interval(self.resampled)
        interval = float(found["median_low"]), float(found["median_high"])
        return replace(
            curve, median_interval=interval, interval_parts=_interval_parts(interval, self.resampled)
        )

    @property
    def surface(self) -> Surface | None:
        """Equivalent fragility surface over the measures; None without a fit."""
        return None if self.problem else Surface(self.measures, self.coefficients, resampled=self.resampled)

    def probability(self, frame: pd.DataFrame) -> Array:
        """Toppling probability of each row's measures."""
        return ndtr(design_of(frame, self.measures) @ np.array(self.coefficients))


def fit(frame: pd.DataFrame, measures: Sequence[str], least_toppled: int = FEW) -> Fit:
    """Fit toppling probability to one or several intensity measures by maximum likelihood.

    frame: rows of results with an answer (`answered`).
    measures: columns, each positive throughout.
    Returns Fit: with a `problem` instead of coefficients where the maximum does not exist (one answer only, or answers
    that a threshold separates, but for those at it: Albert and Anderson 1984), where probability does not rise with
    the one measure, or where too few jobs topple for a curve to be stated.
    """
    names = tuple(measures)
    toppled = frame["toppled"].to_numpy(bool)
    counts = {
        "measures": names, "jobs": len(frame), "toppled": int(toppled.sum()),
        "records": frame["record_id"].nunique(), "bounds": _bounds(frame, names),
    }  # fmt: skip
    if toppled.all() or not toppled.any():
        which = "every job topples" if len(toppled) and toppled.all() else "no job topples"
        return Fit(**counts, coefficients=(), problem=which)
    if _separable(design_of(frame, names), toppled):
        return Fit(**counts, coefficients=(), problem=_separation(frame, names))
    groups = grouped(frame, names)
    coefficients = _regress(design_of(groups, names), groups)
    if coefficients is None:
        return Fit(**counts, coefficients=(), problem="the fit does not converge")
    if is_flat(coefficients):
        return Fit(**counts, coefficients=(), problem="probability does not rise with the measure")
    if counts["toppled"] < least_toppled:
        few = f"{counts['toppled']} of {len(frame)} jobs topple, fewer than {least_toppled}"
        return Fit(**counts, coefficients=(), problem=few)
    return Fit(**counts, coefficients=tuple(float(value) for value in coefficients))


def design_of(frame: pd.DataFrame, measures: Sequence[str]) -> Array:
    """Design matrix: ones and the logarithms of the measures, (rows, 1 + measures)."""
    return np.column_stack([np.ones(len(frame)), np.log(frame[list(measures)].to_numpy(float))])


LEAST_RECORDS = 5
"""Minimum number of records for a bootstrap: resamples of fewer are too often identical."""


EVENT_FRACTION = 0.26
"""Fraction of the variance of ln(PGV/PGA) that lies between earthquakes, of 143 real records of 40."""


def earthquakes(jobs: pd.DataFrame) -> "pd.Series[str]":
    """Earthquake of each job's record, by which intervals count; the record where the earthquake is not known.

    Records of an earthquake are alike in spectrum and duration (`EVENT_FRACTION`), and intervals of 95 % that took them
    as independent held 79 to 88 %. Fewer earthquakes than `LEAST_RECORDS` do not show it: there the records count.
    """
    event = jobs.get("event", pd.Series("", jobs.index)).astype(object)
    of_jobs = event.where(event.fillna("") != "", jobs["record_id"].astype(object))
    return of_jobs if of_jobs.nunique() >= LEAST_RECORDS else jobs["record_id"]


def grouped(frame: pd.DataFrame, measures: Sequence[str]) -> pd.DataFrame:
    """Group jobs of one of the `earthquakes` with equal measures: the same likelihood at a fraction of the cost.

    A column `record_weight` (`Run.weighted`) multiplies a job's part of the likelihood: jobs of one record have
    different weights on bases of different weight.
    """
    weight = frame.get("record_weight", 1.0)
    share = weight * frame["toppled"].astype(float)
    jobs = frame.assign(earthquake=earthquakes(frame), trials=weight, share=share)
    table = jobs.groupby(["earthquake", *measures], sort=False)[["share", "trials"]].sum()
    return table.assign(share=table["share"] / table["trials"]).reset_index()


def _regress(design: Array, groups: pd.DataFrame) -> Array | None:
    """Maximum likelihood coefficients; None where the search does not converge."""
    share, trials = (groups[name].to_numpy(float) for name in ("share", "trials"))
    (found,) = scored(design, share, trials[None], np.zeros(design.shape[1]))
    return found if np.isfinite(found).all() else None


def scored(design: Array, share: Array, trials: Array, start: Array) -> Array:
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
        for _ in range(STEPS):
            step = _step(design, share, trials[left], at)
            # Where answers contradict a probability of nearly 0 or 1, a full step would overflow.
            step /= np.maximum(np.abs(step @ design.T).max(axis=1, keepdims=True), 1.0)
            at = at + step
            ended = (np.abs(step) <= _TOLERANCE * np.maximum(np.abs(at), 1.0)).all(axis=1)
            found[left[ended]] = at[ended]
            left, at = left[~ended], at[~ended]
            if not len(left):
                break
    return found


def _step(design: Array, share: Array, trials: Array, at: Array) -> Array:
    """Fisher scoring step of each sample's coefficients: inverse information times score."""
    predictor = np.clip(at @ design.T, -_EDGE, _EDGE)
    probability, slope = ndtr(predictor), np.exp(-(predictor**2) / 2.0) / math.sqrt(2.0 * math.pi)
    weight = trials * slope / (probability * ndtr(-predictor))
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
