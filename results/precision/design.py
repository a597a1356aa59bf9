"""Sequential design: the target, rounds of jobs chosen from the answers so far, the statement after each round."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri, stdtrit

from toppling.models.arrays import Array
from toppling.models.errors import InputError
from toppling.models.files.digest import read_json, write_json
from toppling.results.analysis import HEADLINE_MEASURE
from toppling.results.analysis.lognormal import Lognormal, parts_words
from toppling.results.analysis.resampling import BaseSpread, spread_of
from toppling.results.hazard.survival import toppling_rate
from toppling.results.hazard.tree import HazardCurve
from toppling.results.precision import STATEMENT_FILE
from toppling.results.precision.probit import Answers, Curve, Departure, departure, fit_curve
from toppling.results.run_integrity import check_plan_id
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

    def borne_by(self, records: float) -> float | None:
        """Approximate half interval of independent records with unlimited jobs; None unless the target is an intensity.

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

    records: number of independent records of the campaign: of earthquakes, where these are known.
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


_Numbers = NDArray[np.int64]

FIRST_ROUND = 32
"""Number of jobs of the first round."""
_GROWTH = (0.3, 1.0)
"""Minimum and maximum size of the next round, as fractions of the jobs so far: frequent looks would stop a run at a
curve that is steep by chance."""
_RANDOM_FRACTION = 0.15
"""Fraction of the jobs at random levels."""
_OUTSIDE = 1.0 / 3.0
"""Fraction of the distance from the informative probabilities to 0 and to 1 within which a record still gets designed
jobs; a record that no level of the campaign brings so near has only jobs at random levels."""
_LEAST_JOBS = 48
"""Minimum number of jobs before a statement may end a run."""
_LEAST_PER_ANSWER = 5
"""Minimum number of them of each answer."""
_SLOPE_VARIANCE = 0.05
"""Relative variance of the slope above which a narrow interval is not trusted: the curve may be steep by chance."""
_SHARP_JOBS = 300
"""Number of jobs from which it is trusted nevertheless: the slope of a sharp threshold is never known."""
_ONE_SIDED_JOBS = 120
"""Number of equal answers that show that the levels do not reach the curve."""
_MEASURE_JOBS = 60
"""Number of jobs after which the measure is fixed, because a choice at every round would favour chance."""
_CLEARLY_BETTER = 5.0
"""Log-likelihood ratio by which another measure must be better than the default."""
_RECORDS_BOUND = 0.3
"""Ratio of the jobs' to the records' variance below which more jobs cannot narrow the interval."""


@dataclass(frozen=True, eq=False)
class Pool:
    """Jobs to choose from: those of a campaign under one contact."""

    rows: _Numbers  # (records, cells, levels): rows of the plan
    log_x: Mapping[str, Array]  # logarithm of each measure, (records, levels)
    independent: int  # number of their earthquakes, or of records where these are not known


@dataclass(frozen=True)
class Verdict:
    """Estimate from the jobs so far, and whether they are enough."""

    measure: str  # the target's measure, or the best predictor
    curve: Curve | None = None  # None before both answers have occurred
    estimate: Estimate | None = None
    ended: bool = False
    reason: str = ""  # why the precision cannot be reached; empty where it is reached, or may still be
    jobs_needed: int = 0  # estimated total number of jobs
    departure: Departure | None = None  # significant departure of the answers from the curve, if any


def _best_measure(observed: Mapping[str, Answers]) -> str:
    """Measure whose curve has the highest likelihood; all curves have equally many coefficients.

    The default measure stays unless another is clearly better: levels are chosen by it, so its answers are near its
    threshold, where they say little about its predictive power.
    """
    likelihood = {name: fit_curve(answers).log_likelihood for name, answers in observed.items()}
    best = max(likelihood, key=lambda name: likelihood[name])
    close = (
        HEADLINE_MEASURE in likelihood and likelihood[best] < likelihood[HEADLINE_MEASURE] + _CLEARLY_BETTER
    )
    return HEADLINE_MEASURE if close else best


def judge(pool: Pool, observed: Mapping[str, Answers], target: Target, precision: float) -> Verdict:
    """Estimate the target from the answers so far, and decide whether another round follows.

    observed: answers by measure, of all rounds so far.
    precision: largest half width of the 95 % interval due to jobs and records: relative, but absolute for a
    probability.
    """
    any_measure = next(iter(observed))
    toppled = observed[any_measure].toppled
    jobs, count = len(toppled), int(toppled.sum())
    least = min(count, jobs - count)
    unknown = Verdict(any_measure, jobs_needed=max(2 * jobs, _LEAST_JOBS))
    if least == 0:
        if jobs < _ONE_SIDED_JOBS:
            return unknown
        side = "weaker levels are needed" if count else "stronger levels are needed"
        reason = f"{'every job' if count else 'no job'} of {jobs} topples: {side}"
        return replace(unknown, ended=True, reason=reason)
    measure = target.measure or _best_measure(observed)
    curve = fit_curve(observed[measure])
    answers = observed[measure]
    score = curve.coefficients[0] + curve.coefficients[1] * answers.log_x
    spread = spread_of(answers.toppled > 0.5, score, answers.base, answers.weight, answers.of_base)
    found = estimate(curve, target, pool.independent, spread)
    known = replace(unknown, measure=measure, curve=curve, estimate=found)
    steep = curve.slope_variance / _SLOPE_VARIANCE
    if jobs < _LEAST_JOBS or least < _LEAST_PER_ANSWER or (steep > 1.0 and jobs < _SHARP_JOBS):
        return replace(known, jobs_needed=math.ceil(jobs * max(min(steep, 2.0), 1.0)))
    known = replace(known, departure=departure(curve, observed[measure]))
    if found.precision <= precision and _reaches(pool, curve, measure, target):
        return replace(known, ended=True, jobs_needed=jobs)
    # One part of the variance falls with the number of jobs, the other only with that of records.
    allowed = (precision / found.scale / curve.student(math.inf)) ** 2
    if allowed < found.pairs and found.independent <= _RECORDS_BOUND * found.pairs:
        more = math.ceil(pool.independent * (found.pairs / allowed - 1.0))
        of = "" if pool.independent == len(pool.rows) else f" of {pool.independent} earthquakes"
        bear = f"{len(pool.rows)} records{of} bear {100 * found.bearable:.1f} %"
        reason = f"{bear}; some {_rounded(more)} more would be needed"
        return replace(known, ended=True, reason=reason, jobs_needed=jobs)
    return replace(known, jobs_needed=min(_needed(jobs, curve, found, precision), pool.rows.size))


def _needed(jobs: int, curve: Curve, found: Estimate, precision: float) -> int:
    """Number of jobs that reach a precision, or show that the records do not support it."""
    for times in 1.05 ** np.arange(1, 120):
        left = found.independent / times
        half = found.scale * curve.student(times) * math.sqrt(left + found.pairs)
        if half <= precision or left <= _RECORDS_BOUND * found.pairs:
            break
    return math.ceil(times * jobs)


def _rounded(number: int) -> int:
    digits = max(len(str(number)) - 2, 0)
    return math.ceil(number / 10**digits) * 10**digits


def _reaches(pool: Pool, curve: Curve, measure: str, target: Target) -> bool:
    """Whether the levels of the records bracket the target's intensity."""
    if target.name == "rate":
        return True
    at = math.log(target.intensity) if target.intensity else target.score(curve.coefficients)
    return bool(pool.log_x[measure].min() < at < pool.log_x[measure].max())


def _round_size(number: int, jobs: int, needed: int) -> int:
    """Number of jobs of round `number` (from 0), after `jobs` so far and about `needed` in total."""
    if number == 0:
        return FIRST_ROUND
    least, most = (math.ceil(share * jobs) for share in _GROWTH)
    return min(max(needed - jobs, least), most)


def choose(pool: Pool, chosen: _Numbers, size: int, seed: int, verdict: Verdict, target: Target) -> _Numbers:
    """Rows of the plan to shake next; fewer than `size` where the pool is exhausted.

    chosen: (n,), rows of the rounds before, in their order.
    seed: seed of the campaign.
    verdict: judgement of the answers so far; without a curve all levels are random.
    """
    free = ~np.isin(pool.rows, chosen)
    visits = (~free).sum(axis=(1, 2))
    random = np.random.default_rng([seed, len(chosen)])
    low, high = target.informative_range
    # Stratified: each round covers the range evenly.
    probabilities = low + (high - low) * (random.permutation(size) + random.random(size)) / size
    at_random = random.random(size) < _RANDOM_FRACTION
    curve, log_x = verdict.curve, pool.log_x[verdict.measure]
    informative = np.ones(log_x.shape, bool)
    if curve is not None:
        expected = ndtr(curve.coefficients[0] + curve.coefficients[1] * log_x)
        informative = (expected > _OUTSIDE * low) & (expected < 1.0 - _OUTSIDE * (1.0 - high))
    found: list[int] = []
    for index, (share, random_level) in enumerate(zip(probabilities, at_random, strict=True)):
        open_records = np.asarray(free.any(axis=(1, 2)))
        if not open_records.any():
            break
        informative_records = np.asarray((free & informative[:, None, :]).any(axis=(1, 2)))
        designed = curve is not None and not random_level and bool(informative_records.any())
        record = _least_visited(informative_records if designed else open_records, visits, seed)
        cell = _in_turn(seed, len(chosen) + index, pool.rows.shape[1])
        if curve is None or not designed:
            order = random.permutation(pool.rows.shape[2])
        else:
            order = np.argsort(np.abs(log_x[record] - curve.wide_log_x(ndtri(share))), kind="stable")
        cell, level = _first_free(free[record], cell, order)
        free[record, cell, level] = False
        visits[record] += 1
        found.append(int(pool.rows[record, cell, level]))
    return np.array(found, np.int64)


def _least_visited(able: NDArray[np.bool_], visits: _Numbers, seed: int) -> int:
    """Index of an allowed record with the fewest jobs, in a random order that differs for each number of jobs."""
    least = int(visits[able].min())
    order = np.random.default_rng([seed, 1, least]).permutation(len(visits))
    return int(next(record for record in order if able[record] and visits[record] == least))


def _in_turn(seed: int, number: int, count: int) -> int:
    """Element `number` of a balanced random sequence: a new random permutation of `count` follows the last."""
    turn, index = divmod(number, count)
    return int(np.random.default_rng([seed, 2, turn]).permutation(count)[index])


def _first_free(free: NDArray[np.bool_], cell: int, order: _Numbers) -> tuple[int, int]:
    """Free cell and level of a record: the first wanted level free in this cell or a later one, else the next level."""
    cells = np.roll(np.arange(len(free)), -cell)
    for level in order:
        open_cells = cells[free[cells, level]]
        if len(open_cells):
            return int(open_cells[0]), int(level)
    raise ValueError("no job of the record is free")


class Rounds:
    """Successive rounds of one contact's jobs.

    precision: see `judge`.
    seed: seed of the campaign.
    chosen: (n,), rows of the plan of all rounds so far.
    verdict: judgement after the last answered round.
    judged: number of chosen jobs that the verdict is based on.
    sizes: number of jobs of each round.
    """

    def __init__(self, pool: Pool, target: Target, precision: float, seed: int) -> None:
        self.pool, self.target, self.precision, self.seed = pool, target, precision, seed
        self.chosen: _Numbers = np.array([], np.int64)
        self.verdict: Verdict | None = None
        self.judged = 0
        self.sizes: list[int] = []

    @property
    def ended(self) -> bool:
        """Whether no round follows."""
        return self.verdict is not None and self.verdict.ended

    def advance(self, observed: Mapping[str, Answers] | None) -> None:
        """Judge the answers to all chosen jobs, and choose the next round unless they are enough.

        observed: answers by measure; None before the first round.
        """
        if observed is not None:
            self.judged = len(self.chosen)
            self.verdict = Verdict("", ended=True, reason=f"none of {self.judged} jobs has an answer")
            if len(next(iter(observed.values())).toppled):
                self.verdict = judge(self.pool, observed, self.target, self.precision)
            if self.verdict.curve and self.judged >= _MEASURE_JOBS:
                self.target = replace(self.target, measure=self.verdict.measure)
            if self.ended:
                return
        known = self.verdict or Verdict(self.target.measure or next(iter(self.pool.log_x)))
        size = _round_size(len(self.sizes), len(self.chosen), known.jobs_needed)
        new = choose(self.pool, self.chosen, size, self.seed, known, self.target)
        if not len(new):
            self.verdict = replace(known, ended=True, reason="every job of the campaign is done")
            return
        self.chosen = np.concatenate([self.chosen, new])
        self.sizes.append(len(new))


_SCHEMA_VERSION = 1
"""Version of the statement's format."""


def statement_of(rounds: Rounds, answered: int, records: int, contact: Mapping[str, float]) -> dict[str, Any]:
    """Statement from the rounds of one contact so far.

    rounds: rounds with a verdict.
    answered, records: numbers of jobs with an answer and of their records.
    contact: columns of the results and their values.
    Returns dict: contact, target, measure, value, low, high, precision and asked (relative, but absolute for a
    probability), beta, jobs, records, rounds, ended, reason, departure (of the answers from the curve, or None), words,
    and sentence, which adds what remains to be done.
    """
    verdict = rounds.verdict
    assert verdict is not None
    content: dict[str, Any] = {
        "contact": dict(contact), "target": rounds.target.name, "at": rounds.target.intensity,
        "measure": verdict.measure, "asked": rounds.precision, "jobs": rounds.judged, "answered": answered,
        "records": records, "rounds": list(rounds.sizes), "ended": verdict.ended, "reason": verdict.reason,
        "jobs_needed": verdict.jobs_needed,
    }  # fmt: skip
    found, curve = verdict.estimate, verdict.curve
    if found is None or curve is None:
        sentence = f"nothing can be stated yet: {verdict.reason or 'too few answers'}"
        return {**content, "value": None, "sentence": sentence}
    words = rounds.target.words(verdict.measure, found.value, found.low, found.high)
    if found.base:
        words += f" ({parts_words({'records': found.precision, 'base': found.base})})"
    words += f", from {rounds.judged} jobs with {records} records"
    if verdict.departure is not None:
        words += f"; {verdict.departure.words}"
    sentence = words
    if verdict.reason:
        sentence += f"; not within {100 * rounds.precision:.3g} %: {verdict.reason}"
    elif not verdict.ended:
        sentence += f"; about {verdict.jobs_needed} jobs are needed for {100 * rounds.precision:.3g} %"
    return {
        **content, "value": found.value, "low": found.low, "high": found.high, "precision": found.precision,
        "base": found.base,
        "median": curve.median, "beta": curve.beta, "words": words, "sentence": sentence,
        "departure": verdict.departure and asdict(verdict.departure),
    }  # fmt: skip


def write_statements(run: Path, statements: Sequence[Mapping[str, Any]], plan_id: str) -> None:
    """Write the statements of a run, one per contact."""
    content = {"schema_version": _SCHEMA_VERSION, "plan_id": plan_id, "statements": list(statements)}
    write_json(run / STATEMENT_FILE, content)


def statements_of(run: Path) -> list[dict[str, Any]]:
    """Read the statements of a run; empty for a run without a target.

    Raises InputError if the file is damaged, or of another run.
    """
    path = run / STATEMENT_FILE
    if not path.exists():
        return []
    content = read_json(path)
    if not isinstance(content, dict) or content.get("schema_version") != _SCHEMA_VERSION:
        raise InputError(
            "document.schema_version",
            "is of another layout",
            where=str(path),
            expected=f"schema version {_SCHEMA_VERSION}",
            remedy="remove it and go on with the run: it is written again",
        )
    check_plan_id(run, path, content.get("plan_id"))
    return list(content["statements"])


def sentences(statements: Sequence[Mapping[str, Any]]) -> list[str]:
    """Summary for a reader: one sentence per contact."""
    texts = [statement["sentence"] for statement in statements]
    if len(texts) > 1:
        under = "with friction {friction_static:g} and restitution {restitution:g} "
        texts = [under.format(**statement["contact"]) + statement["sentence"] for statement in statements]
    names = tuple(SHORT_NAMES.values())
    return [text if text.startswith(names) else text[0].upper() + text[1:] for text in texts]
