"""What the fits of a run say together: their table, the one that stands for the run, the jobs they rest on."""

from collections.abc import Sequence

import pandas as pd

from toppling.models.motions.measures import MEASURES
from toppling.results.analysis.lognormal import Basis, Resampled
from toppling.results.analysis.regression import Fit
from toppling.results.analysis.resampling import lognormal_interval
from toppling.results.completeness import Completeness

SURFACES = (("pga_m_s2", "pgv_m_s"), ("pga_m_s2", "pgv_pga_s"))
"""On logarithms the two are one model in other coordinates; both are given, as both are plotted."""

FEW_TOPPLED = 10
"""Fewer topplings bear no curve that is worth a picture, and rank no measure."""


def headline(models: Sequence[Fit]) -> Fit | None:
    """First of some fits, best first, that may stand for the run: of one measure, with a curve, horizontal.

    Vertical shaking goes with the horizontal that topples, and topples nothing.
    """
    return next(
        (model for model in models if model.lognormal and not MEASURES[model.measures[0]].vertical),
        None,
    )


def summary(models: Sequence[Fit], resampled: Sequence[Resampled | None]) -> pd.DataFrame:
    """Fits as a table: one row a model, with percentile intervals (95 %) over the samples of `bootstrap`."""
    lines = []
    for model, samples in zip(models, resampled, strict=True):
        line: dict[str, object] = {
            "measures": " + ".join(model.measures), "link": model.link, "problem": model.problem,
            "jobs": model.jobs, "toppled": model.toppled, "records": model.records,
            "largest_standing": model.bounds[0], "least_toppled": model.bounds[1],
        }  # fmt: skip
        if curve := model.lognormal:
            line |= {"median": curve.median, "beta": curve.beta}
        if samples is not None:
            found = samples.coefficients
            line |= {"samples": len(found), "samples_without_fit": samples.without_fit}
            if model.lognormal:
                line |= lognormal_interval(samples)
            for number, value in enumerate(model.coefficients):
                low, high = samples.interval(found[:, number])
                line[f"coefficient_{number}"] = value
                line |= {f"coefficient_{number}_low": low, f"coefficient_{number}_high": high}
        lines.append(line)
    return pd.DataFrame(lines)


def answered(frame: pd.DataFrame) -> pd.DataFrame:
    """Rows with an answer, of records whose weight is not 0; `toppled` is a plain boolean."""
    counts = frame["toppled"].notna()
    if "record_weight" in frame:
        counts &= frame["record_weight"] > 0
    return frame[counts].astype({"toppled": bool}).reset_index(drop=True)


def basis_of(frame: pd.DataFrame, measure: str, run: Completeness | None = None) -> Basis:
    """What a fit of one measure to the answers among some jobs, all of one rock and of one run, rests on."""
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
