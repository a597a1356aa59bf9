"""Target of a sequential run: an intensity, a probability or a failure rate, and its estimate with an interval."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri, stdtrit

from toppling.models.arrays import Array
from toppling.results.analysis.lognormal import Lognormal
from toppling.results.analysis.resampling import BaseSpread
from toppling.results.hazard.curves import HazardCurve
from toppling.results.hazard.survival import toppling_rate
from toppling.results.precision.probit import Curve
from toppling.results.schema import SCHEMA, SHORT_NAMES, describe

_PROBABILITIES = {"median": 0.5, "p05": 0.05, "p95": 0.95}
"""Toppling probability of each target that is an intensity."""

_USUAL_CORRELATION = 0.5
"""Prior correlation of two jobs of one record, used only to predict gains of more jobs."""
_USUAL_PAIRS = 30.0
"""Weight of that prior, in pairs of jobs."""


_USUAL_BETA = 0.4
"""Typical beta over the best predictor; used only to predict the precision of the records before any job is done."""


@dataclass(frozen=True, eq=False)
class Target:
    """A quantity derived from a fragility curve."""

    # One of `_PROBABILITIES`, "probability" (at an intensity), or "rate" (of failure under a hazard curve).
    name: str = "median"
    # Column of the results; None for the best predictor. Required for a probability or a rate.
    measure: str | None = None
    intensity: float | None = None  # intensity of the probability, in the measure's SI unit
    hazard: HazardCurve | None = None

    @property
    def informative_range(self) -> tuple[float, float]:
        """Range of toppling probabilities in which jobs are most informative on the target."""
        if self.name == "median":
            return 0.25, 0.75
        if self.name == "probability":
            return 0.15, 0.85
        low = (0.02, 0.6)
        return low if self.name in ("p05", "rate") else (1.0 - low[1], 1.0 - low[0])

    def borne_by(self, records: int) -> float | None:
        """Approximate half interval from so many records with unlimited jobs; None unless the target is an intensity.

        Log thresholds of records are normal with standard deviation beta; the variance of the quantile z is that of
        the mean times 1 + z^2 / 2.
        """
        if self.name not in _PROBABILITIES or records < 2:
            return None
        wider = math.sqrt(1.0 + 0.5 * float(ndtri(_PROBABILITIES[self.name])) ** 2)
        return float(stdtrit(records - 1, 0.975)) * _USUAL_BETA * wider / math.sqrt(records)

    def score(self, coefficients: Array) -> float:
        """Target on the scale of its symmetric interval: its logarithm, or the probit of a probability.

        coefficients: (2,), intercept and slope of a probit on the logarithm of the intensity.
        """
        a, b = coefficients
        if self.name == "probability":
            assert self.intensity is not None
            return float(a + b * math.log(self.intensity))
        if self.name == "rate":
            assert self.hazard is not None
            curve = Lognormal(self.hazard.measure, math.exp(-a / b), 1.0 / b)
            return math.log(max(toppling_rate([curve], self.hazard), 1e-300))
        return float((ndtri(_PROBABILITIES[self.name]) - a) / b)

    def value(self, score: float) -> float:
        """Convert a score to the target in its own unit."""
        return float(ndtr(score)) if self.name == "probability" else math.exp(min(score, 700.0))

    def precision(self, score: float, half: float) -> float:
        """Half width of an interval: relative, but absolute for a probability."""
        if self.name == "probability":
            return 0.5 * (self.value(score + half) - self.value(score - half))
        return math.sinh(min(half, 700.0))  # of a value that the interval's ends are a factor from

    def words(self, measure: str, value: float, low: float, high: float) -> str:
        """Clause that states a value and its 95 % interval."""
        name, unit = SHORT_NAMES[measure], describe(SCHEMA.field(measure))["unit"]
        if self.name == "probability":
            at = f"at a {name} of {self.intensity:g} {unit}"
            return f"{100 * value:.0f} % topple {at}, 95 %: {100 * low:.0f} to {100 * high:.0f} %"
        ends = f"{value:.3g}", f"{low:.3g} to {high:.3g}"
        if self.name == "rate":
            return f"the rock topples {ends[0]} times a year under {name}, 95 %: {ends[1]}"
        share = {"median": "half topple", "p05": "5 % topple", "p95": "95 % topple"}[self.name]
        return f"{share} at a {name} of {ends[0]} {unit}, 95 %: {ends[1]}"


@dataclass(frozen=True)
class Estimate:
    """Estimate of a target from the jobs so far."""

    # The target and its 95 % interval.
    value: float
    low: float
    high: float
    # Half widths due to jobs and records, and due to the unknown base: relative, but absolute for a probability.
    precision: float
    base: float
    bearable: float  # `precision` if every record had unlimited jobs
    # Variance on the target's scale: part of independent jobs, which falls with their number, and of records.
    independent: float
    pairs: float
    scale: float  # precision over Student's factor times the standard error on the target's scale


def _record_correlation(curve: Curve, independent: float, pairs: float) -> float:
    """Correlation of two jobs of one record in their influence on a target; tends to the prior for few pairs."""
    count = 0.5 * curve.pairs_fraction * curve.jobs**2
    if not count:
        return _USUAL_CORRELATION
    pair_weight = min(pairs / (independent * curve.pairs_fraction * curve.jobs), 1.0)
    return (count * pair_weight + _USUAL_PAIRS * _USUAL_CORRELATION) / (count + _USUAL_PAIRS)


def estimate(curve: Curve, target: Target, records: int, spread: BaseSpread | None = None) -> Estimate:
    """Target of a fitted curve with its interval over records and bases.

    records: number of records of the campaign.
    spread: variation between bases; None for a single base.
    """
    score = target.score(curve.coefficients)
    independent, added = curve.variances(target.score)
    pairs = max(added, 0.0)
    half = curve.student() * math.sqrt(independent + pairs)
    floor = _record_correlation(curve, independent, pairs) * independent * curve.jobs / max(records, 1)
    of_base = 0.0
    if spread is not None:
        shift = np.array([spread.half_width * (1.0 + curve.slope_variance), 0.0])  # as `Curve.beta`
        ends = [target.score(curve.coefficients + sign * shift) for sign in (1.0, -1.0)]
        of_base = 0.5 * abs(ends[0] - ends[1])
    whole = math.hypot(half, of_base)
    return Estimate(
        value=target.value(score),
        low=target.value(score - whole),
        high=target.value(score + whole),
        precision=target.precision(score, half),
        base=target.precision(score, of_base),
        bearable=target.precision(score, curve.student() * math.sqrt(floor)),
        independent=independent,
        pairs=floor,
        scale=target.precision(score, half) / math.sqrt(independent + pairs) / curve.student(),
    )
