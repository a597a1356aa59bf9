"""Lognormal fragilities over one or several measures, the basis of their fits, and their bootstrap samples."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_ndtr, ndtr, ndtri, stdtrit

from toppling.models.arrays import Array
from toppling.results.completeness import Completeness

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

    @property
    def unfinished(self) -> str:
        """Remark that the run was not finished; empty where it was or this is unknown."""
        return "" if self.jobs_done is None else Completeness(self.jobs_planned, self.jobs_done).remark


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
        return self.basis.strongest_shaken if self.basis else None

    @property
    def is_beyond_shaken(self) -> bool:
        """Whether the median exceeds the strongest shaking of any job."""
        return self.strongest_shaken is not None and self.median > self.strongest_shaken

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
    """Bootstrap refits of a model to resampled records, each sample on a single base."""

    coefficients: Array  # (k, 1 + number of measures): of the samples with a fit
    # (samples,): which samples have a fit, in the order drawn; in the others the answers are separated, or the
    # probability does not rise.
    fitted: NDArray[np.bool_]
    records: int  # number of records per sample
    # Whether the coefficients are reflected (`analysis.resampling`): their percentiles already allow for few records.
    reflected: bool = False
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

    def interval(self, values: Array, level: float = 0.95) -> Array:
        """Ends (2, ...) of the interval of values (samples, ...), which may be infinite; null without samples."""
        if self.reflected and len(values):
            return ends(values, (1.0 - level) / 2)
        return expanded_interval(values, self.records, level)

    def lognormals(self, measure: str) -> list[Lognormal]:
        """Lognormal fragility of each sample of a fit to one measure, in the order drawn.

        A sample without a fit gives no bound: its curve is that of a rock that no shaking topples.
        """
        never = Lognormal(measure, math.inf, 0.0)
        return [never if row is None else lognormal_of(measure, *row) for row in self.drawn()]

    def surfaces(self, measures: Sequence[str]) -> list[Surface]:
        """Fragility surface of each sample over several measures; zero probability for a sample without a fit."""
        never = -math.inf, *(0.0 for _ in measures)
        rows = (never if row is None else tuple(row.tolist()) for row in self.drawn())
        return [Surface(tuple(measures), row) for row in rows]


def lognormal_interval(resampled: Resampled, level: float = 0.95) -> dict[str, float]:
    """Intervals of the median on one base and of the beta over all bases, from samples of a lognormal fit."""
    intercept, slope = resampled.coefficients.T
    median = resampled.interval(np.exp(-intercept / slope), level)
    of_all = resampled.coefficients if resampled.over_records is None else resampled.over_records
    beta = resampled.interval(1.0 / of_all[:, 1], level)
    return {"median_low": median[0], "median_high": median[1], "beta_low": beta[0], "beta_high": beta[1]}


def parts_words(parts: Mapping[str, float]) -> str:
    """Format the parts of an interval (`Lognormal.interval_parts`): "records ±12 %, base ±35 %"."""
    return ", ".join(f"{name} ±{100 * part:.2g} %" for name, part in parts.items())


def with_samples(curve: Lognormal, resampled: Resampled | None) -> Lognormal:
    """Add bootstrap samples, if any, and the median's interval to a curve."""
    if resampled is None or not len(resampled.coefficients):
        return replace(curve, resampled=resampled)
    ends = lognormal_interval(resampled)
    interval = float(ends["median_low"]), float(ends["median_high"])
    parts = _interval_parts(interval, resampled)
    return replace(curve, median_interval=interval, interval_parts=parts, resampled=resampled)


def _interval_parts(interval: tuple[float, float], resampled: Resampled) -> dict[str, float]:
    whole = 0.5 * math.log(interval[1] / interval[0])
    if resampled.over_records is None:
        return {"records": math.sinh(whole)}
    intercept, slope = resampled.over_records.T
    of_records = min(0.5 * float(np.ptp(resampled.interval(-intercept / slope))), whole)
    return {"records": math.sinh(of_records), "base": math.sinh(math.sqrt(whole**2 - of_records**2))}


def expanded_interval(values: Array, records: int, level: float = 0.95) -> Array:
    """Ends (2, ...) of the expanded percentile interval of values (samples, ...); null without samples.

    Bootstrap percentiles are too narrow by sqrt((n - 1) / n) and the ratio of Student's t to the normal quantile; the
    level is raised accordingly (Hesterberg 2015). Ends are values that occur: infinite ones cannot be interpolated.
    """
    if not len(values):
        return np.full((2, *np.shape(values)[1:]), math.nan)
    tail = ndtr(-math.sqrt(records / (records - 1)) * stdtrit(records - 1, (1 + level) / 2))
    return ends(values, float(tail))


def ends(values: Array, tail: float = 0.025) -> Array:
    """Quantiles (2, ...) at both tails of values (samples, ...), without interpolation: values may be infinite."""
    low = np.quantile(values, tail, axis=0, method="lower")
    return np.array([low, np.quantile(values, 1 - tail, axis=0, method="higher")])


def lognormal_of(measure: str, intercept: float, slope: float) -> Lognormal:
    """Lognormal fragility equivalent to a probit of one measure's logarithm."""
    return Lognormal(measure, math.exp(-intercept / slope), 1.0 / slope)
