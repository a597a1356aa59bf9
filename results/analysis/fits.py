"""Fragility fits of the jobs of one contact, and the ranking of intensity measures by cross-validation."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from toppling.models.arrays import Array
from toppling.models.motions.measures import COMPARED, MEASURES
from toppling.results.analysis.fragility import trials, wilson
from toppling.results.analysis.lognormal import (
    LEAST_RECORDS,
    NEAR_TIE,
    PAIR,
    Basis,
    Fit,
    Lognormal,
    earthquakes,
    ends,
    expanded_interval,
    fit,
    lognormal_interval,
)
from toppling.results.analysis.resampling import SAMPLES, sampled
from toppling.results.reader import Completeness

_BINS = 10
"""Number of bins of a calibration table."""
_FOLDS = 5
"""Number of cross-validation folds."""


def out_of_fold(frame: pd.DataFrame, measures: Sequence[str]) -> pd.Series:
    """Predict each job from a fit to other `earthquakes`; null where that fit does not exist.

    Where a threshold of the single measure separates the answers of the other records, it predicts: the middle between
    the strongest standing and the weakest toppled job, with half a job of the opposite answer as uncertainty.
    """
    predicted = pd.Series(np.nan, index=frame.index)
    independent = earthquakes(frame)
    folds = min(_FOLDS, independent.nunique())
    if folds < 2:
        return predicted
    fold = _folds_of(independent, folds)
    for number in range(folds):
        test = np.flatnonzero(fold == number)
        fitted = fit(frame.iloc[np.flatnonzero(fold != number)], measures, least_toppled=1)
        standing, toppled = fitted.bounds
        if not fitted.problem:
            predicted.iloc[test] = fitted.probability(frame.iloc[test])
        elif 0 < standing * (1 + NEAR_TIE) < toppled < math.inf:
            softening = 0.5 / fitted.jobs
            above = frame.iloc[test][measures[0]] > math.sqrt(standing * toppled)
            predicted.iloc[test] = np.where(above, 1 - softening, softening)
    return predicted


def scores(toppled: ArrayLike, predicted: ArrayLike) -> dict[str, float]:
    """Brier score, log loss and area under the ROC curve of predictions; NaN where they are undefined."""
    truth, guess = np.asarray(toppled, bool), np.asarray(predicted, float)
    if np.isnan(guess).any() or truth.all() or not truth.any():
        return dict.fromkeys(("brier", "log_loss", "auc"), math.nan)
    toppled_ranks, count = pd.Series(guess).rank()[truth], truth.sum()
    # The share of pairs of a toppled and a standing job that are in the right order (Mann and Whitney's U).
    ordered = toppled_ranks.sum() - count * (count + 1) / 2
    return {
        "brier": float(np.mean((guess - truth) ** 2)),
        "log_loss": float(_loss(truth, guess).mean()),
        "auc": float(ordered / (count * (len(truth) - count))),
    }


def _folds_of(independent: pd.Series, folds: int) -> NDArray[np.int64]:
    """Fold of each job, of about equally many jobs: the largest earthquake first, into the smallest fold."""
    codes, _ = pd.factorize(independent, sort=True)
    jobs, size, of_record = np.bincount(codes), np.zeros(folds), np.zeros(codes.max() + 1, np.int64)
    for record in np.argsort(jobs, kind="stable")[::-1]:
        of_record[record] = size.argmin()
        size[of_record[record]] += jobs[record]
    return of_record[codes]


def compare_measures(
    frame: pd.DataFrame, measures: Sequence[Sequence[str]] | None = None, samples: int = 500
) -> pd.DataFrame:
    """Rank intensity measures by how well they predict records that were not fitted to.

    frame: rows of results with an answer (`answered`).
    measures: `COMPARED` one by one, and PGA with PGV together, if not given. Those that are not known and positive for
    every job are left out, so that all are compared on the same jobs.
    Returns DataFrame: best first: measures, brier, log_loss, auc (out of fold), worse_by (log loss minus the best's),
    worse_by_low and worse_by_high (95 %, records resampled; null of fewer than `LEAST_RECORDS`).
    """
    chosen = measures or [*((name,) for name in COMPARED), PAIR]
    usable = [tuple(names) for names in chosen if (frame[list(names)].fillna(0.0) > 0).all(axis=None)]
    predictions = {names: out_of_fold(frame, names) for names in usable}
    truth = frame["toppled"].to_numpy(bool)
    lines = [
        {"measures": " + ".join(names), **scores(truth, guessed)} for names, guessed in predictions.items()
    ]
    table = pd.DataFrame(lines, columns=["measures", "brier", "log_loss", "auc"])
    losses = {" + ".join(names): _loss(truth, guessed.to_numpy()) for names, guessed in predictions.items()}
    ranked = table.sort_values("log_loss", ignore_index=True)
    if not len(ranked) or math.isnan(ranked["log_loss"][0]):
        return ranked
    codes, records = pd.factorize(earthquakes(frame))
    random = np.random.default_rng(0)
    draws = random.multinomial(len(records), np.full(len(records), 1 / len(records)), samples)
    weight = draws @ np.bincount(codes)
    for place, name in enumerate(ranked["measures"]):
        worse = losses[name] - losses[ranked["measures"][0]]
        resampled = draws @ np.bincount(codes, weights=worse) / weight
        ranked.loc[place, "worse_by"] = worse.mean()
        if len(records) >= LEAST_RECORDS:
            interval = expanded_interval(resampled, len(records))
            ranked.loc[place, ["worse_by_low", "worse_by_high"]] = interval
    return ranked


def calibration(frame: pd.DataFrame, predicted: pd.Series) -> pd.DataFrame:
    """Predicted and observed fraction of jobs that topple, in bins of equally many jobs.

    Returns DataFrame: one row a bin: predicted (mean), observed, jobs, records, wilson_low and wilson_high of observed.
    """
    known = predicted.notna()
    table = _binned_fractions(frame[known], predicted[known], _BINS)
    return table.rename(columns={"value": "predicted", "probability": "observed"})


def observed_fractions(frame: pd.DataFrame, measure: str, bins: int = 12) -> pd.DataFrame:
    """Fraction of jobs that topple in bins of equally many jobs along a measure, with Wilson's interval by `trials`.

    Returns DataFrame: one row a bin: value (geometric mean), probability, wilson_low, wilson_high, jobs, records.
    """
    table = _binned_fractions(frame, np.log(frame[measure]), bins)
    return table.assign(value=np.exp(table["value"]))


def _binned_fractions(frame: pd.DataFrame, value: pd.Series, bins: int) -> pd.DataFrame:
    """Mean value and fraction toppled in bins of equally many jobs, each job weighted by its record's weight.

    Records are weighted as in the fit that they are compared with.
    """
    place = ((value.rank(method="average") - 0.5) * bins / max(1, len(value))).astype(int)
    jobs = frame.assign(
        value=value, bin=place, weight=frame.get("record_weight", 1.0), independent=earthquakes(frame)
    )
    grouped = jobs.assign(
        value=jobs["weight"] * value, toppled=jobs["weight"] * jobs["toppled"].astype(float)
    ).groupby("bin")
    total = grouped["weight"].sum()
    table = pd.DataFrame({
        "value": grouped["value"].sum() / total,
        "probability": grouped["toppled"].sum() / total,
        "jobs": grouped.size(),
        "records": grouped["record_id"].nunique(),
    })  # fmt: skip
    table["wilson_low"], table["wilson_high"] = wilson(table["probability"], trials(jobs, ["bin"]))
    return table.reset_index(drop=True)


def _loss(truth: NDArray[np.bool_], predicted: Array) -> Array:
    safe = np.clip(predicted, 1e-15, 1 - 1e-15)
    return -np.log(np.where(truth, safe, 1 - safe))


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
            "measures": " + ".join(model.measures), "problem": model.problem,
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
                low, high = ends(found[:, number])
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
        weakest_shaken=float(known[measure].min()),
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

    def fitted(self, measures: Sequence[str]) -> Fit:
        """Joint fit of some measures, with its bootstrap samples."""
        self.notify(measures)
        return sampled(self.known, fit(self.known, measures), self.samples)

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
