"""Fragility fits of the jobs of one contact: their table, and the curve that represents the run."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import pandas as pd

from toppling.models.motions.measures import COMPARED, MEASURES
from toppling.results.analysis.lognormal import Basis, Lognormal, lognormal_interval
from toppling.results.analysis.ranking import compare_measures
from toppling.results.analysis.regression import Fit, fit
from toppling.results.analysis.resampling import SAMPLES, sampled
from toppling.results.completeness import Completeness

FEW_TOPPLED = 10
"""Minimum number of topplings for a curve to be drawn and for measures to be ranked."""

HEADLINE_MEASURE = "pgv_m_s"
"""Preferred measure of a run's summary, as in 'toppling constrain', because hazard curves of PGV exist."""


def headline(models: Sequence[Fit]) -> Fit | None:
    """First of some fits, best first, that may represent the run: of one horizontal measure, with a curve.

    Vertical shaking correlates with the horizontal shaking that topples, but topples nothing.
    """
    chosen = (model for model in models if model.lognormal and not MEASURES[model.measures[0]].vertical)
    return next(chosen, None)


def summary(models: Sequence[Fit]) -> pd.DataFrame:
    """Table of fits: one row per model, with percentile intervals (95 %) over the samples of `bootstrap`.

    The median's interval is over records and bases; further columns give the relative half width due to each.
    """
    lines = []
    for model in models:
        line: dict[str, object] = {
            "measures": " + ".join(model.measures), "link": model.link, "problem": model.problem,
            "jobs": model.jobs, "toppled": model.toppled, "records": model.records,
            "largest_standing": model.bounds[0], "least_toppled": model.bounds[1],
        }  # fmt: skip
        if curve := model.lognormal:
            line |= {"median": curve.median, "beta": curve.beta}
        if (samples := model.resampled) is not None:
            found = samples.coefficients if samples.over_records is None else samples.over_records
            line |= {"samples": len(found), "samples_without_fit": samples.without_fit}
            if curve:
                line |= lognormal_interval(samples)
                line |= {f"median_{name}": part for name, part in curve.interval_parts.items()}
            for number, value in enumerate(model.coefficients):
                low, high = samples.interval(found[:, number])
                line[f"coefficient_{number}"] = value
                line |= {f"coefficient_{number}_low": low, f"coefficient_{number}_high": high}
        lines.append(line)
    return pd.DataFrame(lines)


def answered(frame: pd.DataFrame) -> pd.DataFrame:
    """Rows with an answer and a non-zero record weight; `toppled` becomes a plain boolean."""
    counts = frame["toppled"].notna()
    if "record_weight" in frame:
        counts &= frame["record_weight"] > 0
    return frame[counts].astype({"toppled": bool}).reset_index(drop=True)


def with_measure(jobs: pd.DataFrame, measure: str) -> pd.DataFrame:
    """Jobs with an answer and a known, positive value of the measure."""
    return answered(jobs[jobs[measure] > 0] if measure in jobs else jobs[:0])


def basis_of(frame: pd.DataFrame, measure: str, run: Completeness | None = None) -> Basis:
    """Basis of a fit of one measure to the answered jobs of one rock and one run."""
    known = answered(frame)
    return Basis(
        scene_id=str(frame["scene_id"].iloc[0]),
        jobs=len(known),
        toppled=int(known["toppled"].sum()),
        records=int(known["record_id"].nunique()),
        without_answer=int(frame["toppled"].isna().sum()),
        strongest_shaken=float(known[measure].max()),
        jobs_planned=run.planned if run else None,
        jobs_done=run.done if run else None,
    )


def curve_over(
    jobs: pd.DataFrame,
    measure: str,
    samples: int = SAMPLES,
    run: Completeness | None = None,
    advance: Callable[[], None] = lambda: None,
) -> Lognormal | None:
    """Fragility of jobs of one contact over a measure, with bootstrap samples and basis; None without a fit.

    run: completeness of the run of these jobs.
    advance: called before each bootstrap sample.
    """
    known = with_measure(jobs, measure)
    fitted = fit(known, [measure]) if len(known) else None
    if fitted is None or fitted.lognormal is None:
        return None
    curve = sampled(known, fitted, samples, advance).lognormal
    assert curve is not None  # samples change no coefficient
    return replace(curve, basis=basis_of(jobs, measure, run))


@dataclass(frozen=True, eq=False)
class ContactFits:
    """Jobs of one scene, preset and contact, with their fits."""

    jobs: pd.DataFrame  # all of them, with or without an answer
    samples: int = SAMPLES  # bootstrap samples of the fits
    run: Completeness | None = None  # completeness of the run of these jobs
    words: str = ""  # what distinguishes it from others, such as "μ = 0.8"
    notify: Callable[[Sequence[str]], object] = lambda _: None  # called with the measures of each fit

    @cached_property
    def known(self) -> pd.DataFrame:
        """Jobs with an answer."""
        return answered(self.jobs)

    @property
    def toppled(self) -> int:
        """Number of jobs that toppled the rock."""
        return int(self.known["toppled"].sum())

    @cached_property
    def ranking(self) -> pd.DataFrame:
        """Intensity measures ranked by predictive power, best first."""
        return compare_measures(self.known)

    @property
    def measures(self) -> list[str]:
        """Single measures, in the ranking's order."""
        return [name for name in self.ranking["measures"] if name in COMPARED]

    @cached_property
    def models(self) -> list[Fit]:
        """Fit of each single measure with its samples, in the ranking's order."""
        return [self.fitted([name]) for name in self.measures]

    def fitted(self, measures: Sequence[str], link: str = "probit") -> Fit:
        """Joint fit of some measures, with its bootstrap samples."""
        self.notify(measures)
        return sampled(self.known, fit(self.known, measures, link), self.samples)

    @cached_property
    def curves(self) -> dict[str, Lognormal]:
        """Lognormal fragility over each measure that has one."""
        found = {model.measures[0]: model.lognormal for model in self.models}
        return {
            name: replace(curve, basis=basis_of(self.jobs, name, self.run))
            for name, curve in found.items()
            if curve
        }

    @property
    def best(self) -> Lognormal | None:
        """Curve of the best predictor that may represent the run."""
        chosen = headline(self.models)
        return self.curves[chosen.measures[0]] if chosen else None
