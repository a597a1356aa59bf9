"""Errors of a run's answers: a random sample of its jobs is repeated with a finer or different engine.

Only the difference between two answers to the same job is estimated from the sample; the run's own answer is known
for every job. A fragility's median is where the score of its likelihood vanishes, and the score is linear in the
answers, so each differing answer moves the median by an amount known beforehand (its influence). The shift of the
median is the sum of influences over the jobs whose answers differ, a total that a random sample estimates.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import ndtr, stdtrit

from toppling.models.arrays import Array
from toppling.models.files.digest import read_json
from toppling.models.files.documents import finite
from toppling.results.analysis.fits import answered
from toppling.results.analysis.fragility import by_contact
from toppling.results.analysis.lognormal import fit, probit_weights, scored
from toppling.results.reader import Run, as_frame
from toppling.results.run_integrity import AUDIT_FOLDER, DRAWN_FILE, LEAST_JOBS, REFERENCE, check_audit
from toppling.results.store import newest_rows, read_steady, result_files

JOB_COLUMNS = [
    "scene_id", "record_id", "level_pga_m_s2", "azimuth_deg", "friction_static", "friction_kinetic", "restitution",
    "realisation",
]  # fmt: skip
"""Columns that match a job with its repetition."""

_MEASURE = "pga_m_s2"
"""Measure of the median whose shift an audit states."""


@dataclass(frozen=True)
class Estimate:
    """An estimate with its 95 % sampling interval; NaN where it is undefined."""

    value: float
    low: float
    high: float

    @classmethod
    def around(cls, mean: float, half: float) -> "Estimate":
        """Estimate with a symmetric interval of the given half width."""
        return cls(mean, mean - half, mean + half)

    def holds(self, truth: float) -> bool:
        """Whether the interval contains a value."""
        return self.low <= truth <= self.high

    def text(self, form: str, unknown: str = "none") -> str:
        """Format the estimate and its interval with a format such as '{:+.1f}'."""
        if math.isnan(self.value):
            return unknown
        value, low, high = (form.format(part) for part in (self.value, self.low, self.high))
        return f"{value} ({low} to {high})"


@dataclass(frozen=True)
class Audit:
    """Differences between a run's answers and those of another engine or preset to the same jobs."""

    by: str  # engine or preset that repeated the jobs
    # Jobs compared, and the answered jobs that they were drawn from.
    jobs: int
    of_jobs: int
    no_answer: int  # drawn jobs whose repetition has no answer
    # Jobs that topple in the run and stand when repeated, and vice versa.
    flips_to_toppled: int
    flips_to_standing: int
    share_shift: Estimate  # fraction toppled in the run minus that of the repetitions
    # By how much the run's median PGA lies above that of the repeated jobs.
    median_shift_percent: Estimate

    def to_json(self) -> dict[str, Any]:
        """Fields as JSON numbers, null where undefined; intervals as `..._low` and `..._high`."""
        content: dict[str, Any] = {}
        for name, value in asdict(self).items():
            if isinstance(value, dict):
                stem = name.removesuffix("_percent")
                content |= {name: value["value"], f"{stem}_low": value["low"], f"{stem}_high": value["high"]}
            else:
                content[name] = value
        return finite(content)

    @property
    def agrees(self) -> bool:
        """Whether the intervals of both the median's shift and the toppled fraction's shift include zero."""
        median = self.median_shift_percent
        return self.share_shift.holds(0.0) and (math.isnan(median.value) or median.holds(0.0))

    @property
    def sentence(self) -> str:
        """Summary for a reader."""
        up, down = self.flips_to_toppled, self.flips_to_standing
        median, share = self.median_shift_percent, self.share_shift
        shift = median.text("{:+.1f}", unknown="an unknown number of")
        agrees = "agree within" if self.agrees else "differ beyond"
        what = "the finest steps" if self.by == REFERENCE else f"the contacts and steps of {self.by}"
        return (
            f"{self.jobs} of {self.of_jobs:,} jobs were repeated with {what}: the answers {agrees} chance (95 %). "
            f"The run's median PGA is shifted by {shift} %, its share toppled by {share.text('{:+.3f}')}; {up} toppled "
            f"only in the run, {down} only when repeated: near the threshold answers depend on steps and contacts"
        )


def audits_of(run: Run) -> dict[str, Audit]:
    """Audits of a run by the engine or preset that repeated its jobs, the reference first; empty without audits."""
    folder = run.path / AUDIT_FOLDER
    places = [place for place in folder.iterdir() if place.is_dir()] if folder.is_dir() else []
    rows = run.weighted(run.frame()) if places else pd.DataFrame()
    found = {}
    for place in sorted(places, key=lambda place: (place.name != REFERENCE, place.name)):
        check_audit(run.path, place)
        repeated = as_frame(read_steady([place], lambda: newest_rows(result_files(place))))  # noqa: B023  (read at once)
        audit = compare(place.name, _drawn_from(rows, place), repeated) if len(repeated) else None
        if audit is not None:
            found[place.name] = audit
    return found


def audits_json(audits: Mapping[str, Audit]) -> dict[str, Any]:
    """JSON of the reference's audit, with those of other engines under `engines`; empty without an audit."""
    if not audits:
        return {}
    others = {name: audit.to_json() for name, audit in audits.items() if name != REFERENCE}
    reference = audits[REFERENCE].to_json() if REFERENCE in audits else {}
    return {**reference, "engines": others}


def compare(by: str, rows: pd.DataFrame, repeated: pd.DataFrame) -> Audit | None:
    """Compare a run's answers with those of a random sample of its jobs, repeated.

    rows: rows of results that the sample was drawn from: its jobs are the first by job_id, which is a hash.
    repeated: rows of the repeated jobs.
    Returns Audit or None: None for fewer than `LEAST_JOBS`.
    """
    known = answered(rows).sort_values("job_id", ignore_index=True)
    again = repeated[[*JOB_COLUMNS, "toppled"]].assign(drawn=True)
    both = known.merge(again, on=JOB_COLUMNS, how="left", suffixes=("", "_again"), validate="one_to_one")
    # A sample is random up to the first gap in the order of the hashes.
    drawn = both["drawn"].notna().to_numpy()
    sample = both[: len(drawn) if drawn.all() else int(drawn.argmin())]
    place = sample.index[sample["toppled_again"].notna()].to_numpy()
    if len(place) < LEAST_JOBS:
        return None
    ours = both.loc[place, "toppled"].to_numpy(bool)
    theirs = both.loc[place, "toppled_again"].to_numpy(bool)
    differs = ours.astype(float) - theirs
    up, down = int((differs > 0).sum()), int((differs < 0).sum())
    weight = known.get("record_weight", pd.Series(1.0, known.index)).to_numpy(float)
    values = differs * weight[place] / weight.mean()
    return Audit(
        by=by,
        jobs=len(place),
        of_jobs=len(known),
        no_answer=len(sample) - len(place),
        flips_to_toppled=up,
        flips_to_standing=down,
        share_shift=Estimate.around(float(values.mean()), _half_width(values, 1.0, len(known))),
        median_shift_percent=median_shift_percent(known, place, differs),
    )


def median_shift_percent(known: pd.DataFrame, place: NDArray[np.intp], differs: Array) -> Estimate:
    """Shift of the median PGA, from a random sample's differing answers.

    known: rows with an answer; of several contacts the mean of their shifts is returned.
    place: (n,), indices of the drawn rows.
    differs: (n,), answer of each drawn row (1 toppled, 0 standing) minus that of its repetition.
    Returns Estimate: in percent; NaN where the answers have no fit.
    """
    difference = np.zeros(len(known))
    difference[place] = differs
    influence, plausible = np.zeros(len(known)), np.zeros(len(known))
    log_shift, fraction_fitted = 0.0, 0.0
    for jobs in by_contact(known).values():
        curve = _Fragility.of(jobs)
        if curve is None:
            continue
        rows, share = jobs.index.to_numpy(), len(jobs) / len(known)
        influence[rows], plausible[rows] = share * curve.influence, curve.plausible
        log_shift += share * curve.log_shift(difference[rows] * len(known) / len(place))
        fraction_fitted += share
    if not fraction_fitted:
        return Estimate(math.nan, math.nan, math.nan)
    typical = math.sqrt(float((plausible * influence**2).sum() / plausible.sum()))
    half = _half_width(influence[place] * differs, typical, len(known)) * len(known)
    ends = np.expm1(np.array([log_shift, log_shift - half, log_shift + half]) / fraction_fitted)
    return Estimate(*(100.0 * ends).tolist())


@dataclass(frozen=True, eq=False)
class _Fragility:
    """Lognormal fragility of all jobs, and the influence of each answer on it."""

    design: Array  # (n, 2): 1 and the logarithm of the PGA, of each job
    # (n,).
    toppled: Array
    weight: Array
    coefficients: Array  # (2,)

    @classmethod
    def of(cls, jobs: pd.DataFrame) -> "_Fragility | None":
        usable = (jobs[_MEASURE] > 0).fillna(value=False)
        if not usable.all() or (found := fit(jobs, [_MEASURE])).problem:
            return None
        weight = jobs.get("record_weight", pd.Series(1.0, jobs.index)).to_numpy(float)
        return cls(
            np.column_stack([np.ones(len(jobs)), np.log(jobs[_MEASURE].to_numpy(float))]),
            jobs["toppled"].to_numpy(float),
            weight,
            np.array(found.coefficients),
        )

    @property
    def plausible(self) -> Array:
        """Variance p (1 - p) of each answer: certain answers do not flip."""
        p = ndtr(self.design @ self.coefficients)
        return p * (1.0 - p)

    @property
    def influence(self) -> Array:
        """Shift (n,) of the median's logarithm by each answer that is toppled here and standing when repeated."""
        of_score, of_information = probit_weights(self.design @ self.coefficients)
        fisher = (self.design * (self.weight * of_information)[:, None]).T @ self.design
        intercept, slope = self.coefficients
        gradient = np.array([-1.0 / slope, intercept / slope**2])
        return (self.design @ np.linalg.solve(fisher, gradient)) * self.weight * of_score

    def log_shift(self, difference: Array) -> float:
        """Logarithm of the ratio of the median to the median of answers minus `difference`."""
        answers = self.toppled - difference
        (other,) = scored(self.design, answers, self.weight[None], self.coefficients)
        (intercept, slope), (other_intercept, other_slope) = self.coefficients, other
        if not other_slope > 0:  # scoring diverged: to first order
            return float(self.influence @ difference)
        return float(other_intercept / other_slope - intercept / slope)


def _half_width(values: Array, typical: float, of_jobs: int) -> float:
    """Half the 95 % interval of a mean over jobs, from a random sample's values, of which most are 0.

    Half a flip in each direction, of `typical` size, is added to the sample, as Agresti and Min (2005) do for matched
    pairs: without it an interval from no flip, or few, is too narrow.
    """
    jobs = len(values)
    variance = ((values**2).sum() + typical**2) / (jobs + 2) - (values.sum() / (jobs + 2)) ** 2
    not_drawn = 1.0 - jobs / of_jobs
    return float(stdtrit(jobs - 1, 0.975) * math.sqrt(variance / jobs * not_drawn))


def _drawn_from(rows: pd.DataFrame, place: Path) -> pd.DataFrame:
    """Rows that existed when the sample was drawn: later ones could not be drawn."""
    until = read_json(place / DRAWN_FILE)["until"]
    if until is None:
        return rows
    return rows[rows["finished_at"].isna() | (rows["finished_at"] <= datetime.fromisoformat(until))]
