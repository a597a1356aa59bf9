"""Lognormal fragilities over one measure or several, what a fit of one rests on, and its samples."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_ndtr, ndtr, ndtri
from scipy.stats import t

from toppling.models.arrays import Array
from toppling.results.completeness import Completeness

LOG_ROOT_2_PI = 0.5 * math.log(2.0 * math.pi)


def probit_weights(eta: Array) -> tuple[Array, Array]:
    """What multiplies an answer in the score of a probit, and Fisher's information of a job about its own eta.

    phi / (Phi (1 - Phi)) and phi^2 / (Phi (1 - Phi)), which logarithms keep within the range of numbers.
    """
    log_density = -0.5 * eta**2 - LOG_ROOT_2_PI
    below, above = log_ndtr(eta), log_ndtr(-eta)
    return np.exp(log_density - below - above), np.exp(2.0 * log_density - below - above)


@dataclass(frozen=True)
class Basis:
    """What a fragility over a measure rests on."""

    scene_id: str  # of the rock
    # Jobs with an answer.
    jobs: int
    toppled: int
    records: int
    # Jobs that ended without one, and are left out. What rocked too long to be decided is no random sample.
    without_answer: int
    # Largest value of the measure that a job was shaken with: beyond it the curve is an extrapolation.
    strongest_shaken: float
    # Of the whole run: jobs that it was begun with, and those that have run; None where that is not known.
    jobs_planned: int | None = None
    jobs_done: int | None = None

    @property
    def unfinished(self) -> str:
        """That the run was not finished, in words; empty where it was, or it is not known."""
        return "" if self.jobs_done is None else Completeness(self.jobs_planned, self.jobs_done).remark


@dataclass(frozen=True)
class Lognormal:
    """Lognormal fragility: P(topple | x) = Phi(ln(x / median) / beta)."""

    measure: str  # column of the results that x is a value of, in its SI unit
    median: float  # intensity at which one in two topples
    beta: float  # standard deviation of its logarithm; 0 for a sharp threshold
    basis: Basis | None = None  # where it is known
    # Ends of the median's 95 % interval, where they are known.
    median_interval: tuple[float, float] | None = None
    # Halves of that interval over the median, by what they come from: records, and base where the jobs are on several.
    # The squares of their logarithms add up to the interval's.
    interval_parts: Mapping[str, float] = field(default_factory=dict, compare=False)
    # The same curve of resampled records, where it is known.
    resampled: "Resampled | None" = field(default=None, compare=False, repr=False)

    def probability(self, intensity: ArrayLike) -> Array:
        """Toppling probability at some intensities, in the measure's SI unit; 0 at intensity 0."""
        with np.errstate(divide="ignore", invalid="ignore"):
            above = np.log(np.asarray(intensity, float) / self.median)
            z = np.where(above == 0.0, 0.0, above / self.beta) if self.beta > 0 else np.sign(above) * np.inf
        return ndtr(np.nan_to_num(z, nan=0.0))

    @property
    def strongest_shaken(self) -> float | None:
        """Largest value that a job was shaken with, where that is known."""
        return self.basis.strongest_shaken if self.basis else None

    @property
    def is_beyond_shaken(self) -> bool:
        """Whether the median lies beyond all that a job was shaken with."""
        return self.strongest_shaken is not None and self.median > self.strongest_shaken

    @property
    def measures(self) -> tuple[str, ...]:
        """Its measure, as of a `Surface`."""
        return (self.measure,)

    def stouter(self, factor: float) -> "Lognormal":
        """The same curve of a rock that takes a factor stronger motions."""
        return replace(self, median=self.median * factor)

    def intensity(self, probability: float) -> float:
        """Intensity at which a toppling probability is reached."""
        return self.median * math.exp(self.beta * ndtri(probability))


@dataclass(frozen=True)
class Surface:
    """Fragility over several measures: P(topple | x, y) = Phi(a + b ln x + c ln y)."""

    measures: tuple[str, ...]  # columns of the results
    coefficients: tuple[float, ...]  # a, then one slope a measure's natural logarithm
    basis: Basis | None = None  # where it is known; its strongest shaking is in the first measure
    # The same surface of resampled records, where it is known.
    resampled: "Resampled | None" = field(default=None, compare=False, repr=False)

    def probability(self, motions: Mapping[str, Array]) -> Array:
        """Toppling probability of events; 0 where a measure with a slope above 0 is 0."""
        intercept, *slopes = self.coefficients
        with np.errstate(divide="ignore", invalid="ignore"):
            parts = [slope * np.log(motions[name]) for name, slope in zip(self.measures, slopes, strict=True)]
            score = intercept + sum(parts)
        felt = np.all([np.asarray(motions[name]) > 0 for name in self.measures], axis=0)
        return np.where(felt, ndtr(score), 0.0)

    def stouter(self, factor: float) -> "Surface":
        """The same surface of a rock that takes a factor stronger motions."""
        intercept, *slopes = self.coefficients
        return replace(self, coefficients=(intercept - sum(slopes) * math.log(factor), *slopes))


@dataclass(frozen=True, eq=False)
class Resampled:
    """The same model fitted to resampled records, each sample on one of the bases that the jobs are spread over."""

    coefficients: Array  # (k, 1 + number of measures): of the samples that have a fit
    # (samples,): which have one, in the order they were drawn: in the others the answers are separated, or
    # probability does not rise.
    fitted: NDArray[np.bool_]
    records: int  # number that are drawn
    # Whether the coefficients are those of `analysis.resampling.reflected`, whose percentiles allow for few records
    # themselves.
    reflected: bool = False
    # As `coefficients`, of the curve of all bases together; None where the jobs are on one base.
    over_records: Array | None = None

    @property
    def without_fit(self) -> int:
        """Number of samples without a fit."""
        return int((~self.fitted).sum())

    def drawn(self) -> Iterator[Array | None]:
        """Coefficients of each sample in the order drawn; None of one without a fit."""
        found = iter(self.coefficients)
        return (next(found) if has_fit else None for has_fit in self.fitted)

    def interval(self, values: Array, level: float = 0.95) -> Array:
        """Ends of the interval of something that each sample has a value of, (2, ...); null without samples.

        Values may be infinite.
        """
        if self.reflected and len(values):
            return ends(values, (1.0 - level) / 2)
        return expanded_interval(values, self.records, level)

    def lognormals(self, measure: str) -> list[Lognormal]:
        """Each sample's lognormal fragility over the one measure that was fitted, in the order drawn.

        A sample without a fit bounds nothing: its curve is that of a rock which no shaking topples.
        """
        never = Lognormal(measure, math.inf, 0.0)
        return [never if one is None else lognormal_of(measure, *one) for one in self.drawn()]

    def surfaces(self, measures: Sequence[str]) -> list[Surface]:
        """The same over several measures."""
        never = -math.inf, *(0.0 for _ in measures)
        rows = (never if one is None else tuple(one.tolist()) for one in self.drawn())
        return [Surface(tuple(measures), row) for row in rows]


def lognormal_interval(resampled: Resampled, level: float = 0.95) -> dict[str, float]:
    """Intervals of the median of one base, and of the beta of all bases together, over samples of a lognormal fit."""
    intercept, slope = resampled.coefficients.T
    median = resampled.interval(np.exp(-intercept / slope), level)
    of_all = resampled.coefficients if resampled.over_records is None else resampled.over_records
    beta = resampled.interval(1.0 / of_all[:, 1], level)
    return {"median_low": median[0], "median_high": median[1], "beta_low": beta[0], "beta_high": beta[1]}


def parts_words(parts: Mapping[str, float]) -> str:
    """Parts of an interval (`Lognormal.interval_parts`): "records ±12 %, base ±35 %"."""
    return ", ".join(f"{name} ±{100 * part:.2g} %" for name, part in parts.items())


def with_samples(curve: Lognormal, resampled: Resampled | None) -> Lognormal:
    """A curve with its bootstrap samples, if there are any, and their interval of its median."""
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
    """Ends (2, ...) of the interval of values (samples, ...) over resampled records; null without samples.

    Percentiles of a bootstrap are narrow by sqrt((n - 1) / n) and know no Student's t; with few records the level is
    raised by as much (Hesterberg 2015, expanded percentiles). Ends are values that occur: infinite ones have no mean.
    """
    if not len(values):
        return np.full((2, *np.shape(values)[1:]), math.nan)
    tail = ndtr(-math.sqrt(records / (records - 1)) * t.ppf((1 + level) / 2, records - 1))
    return ends(values, float(tail))


def ends(values: Array, tail: float = 0.025) -> Array:
    """Ends (2, ...) of an interval that occur among the values (samples, ...), which may be infinite."""
    low = np.quantile(values, tail, axis=0, method="lower")
    return np.array([low, np.quantile(values, 1 - tail, axis=0, method="higher")])


def lognormal_of(measure: str, intercept: float, slope: float) -> Lognormal:
    """The lognormal that a probit of one measure's logarithm is."""
    return Lognormal(measure, math.exp(-intercept / slope), 1.0 / slope)
