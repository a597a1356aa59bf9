"""Fits of toppling probability to intensity: lognormal curves, surfaces, and which measure predicts best.

Every model is a binomial regression on logarithms of intensity measures. With a probit link and one measure
it is the lognormal fragility Phi(ln(x / median) / beta) at maximum likelihood (Baker 2015, eq. 11).
Uncertainty comes from resampling records, never jobs: scaled and turned copies of one record are not
independent. The same holds for cross-validation, whose folds divide the records.
"""

import math
import warnings
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
import statsmodels.api as sm
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linprog
from scipy.stats import norm, t
from sklearn.metrics import brier_score_loss, log_loss, roc_auc_score
from sklearn.model_selection import GroupKFold
from statsmodels.tools.sm_exceptions import ConvergenceWarning, DomainWarning, PerfectSeparationWarning

from toppling.results.completeness import Completeness
from toppling.results.fragility import effective_records, wilson
from toppling.results.schema import SCHEMA, describe
from toppling.results.studentised import studentised

MEASURES = (
    *("pga_m_s2", "pgv_m_s", "pgd_m", "pgv_pga_s", "sa_1s_m_s2", "sa_2s_m_s2"),
    *("arias_m_s", "cav_m_s", "duration_energy_s", "pga_vertical_m_s2"),
)
"""The measures that are compared."""

SURFACES = (("pga_m_s2", "pgv_m_s"), ("pga_m_s2", "pgv_pga_s"))
"""On logarithms the two are one model in other coordinates; both are given, as both are plotted."""

LEAST_RECORDS = 5
"""Fewer cannot be drawn anew: their resamples are too often the same few."""

SAMPLES = 200
"""Of resampled records, for intervals of 95 %."""

FLATTEST_SLOPE = 0.1
"""Of a fit to one measure; less counts as none. With it, two thirds more of the jobs topple (84 % for one in two) at
22,000 times the intensity: no shaking tells, and medians leave the range of numbers."""

NEAR_TIE = 1e-6
"""Jobs of one level differ in the last digits, as each is scaled and turned: so much nearer, values are one."""

SUSPECT_SLOPE = 1.5
"""Times the fit's own, from which a resample's slope may be that of separated answers, where the search just ends:
its likelihood rises for ever."""

FEW_TOPPLED = 10
"""Fewer topplings bear no curve that is worth a picture, and rank no measure."""

NO_HEADLINE = ("pga_vertical_m_s2",)
"""Measures that never stand for a run: vertical shaking goes with the horizontal that topples, and topples nothing."""

LINKS = {"probit": sm.families.links.Probit, "logit": sm.families.links.Logit}


@dataclass(frozen=True)
class Basis:
    """What a fragility over a measure rests on.

    Parameters
    ----------
    scene_id : str
        Of the rock.
    jobs, toppled, records : int
        Jobs with an answer.
    without_answer : int
        Jobs that ended without one, and are left out. What rocked too long to be decided is no random sample.
    strongest_shaken : float
        Largest value of the measure that a job was shaken with: beyond it the curve is an extrapolation.
    jobs_planned, jobs_done : int or None
        Of the whole run: jobs that it was begun with, and those that have run; None where that is not known.
    """

    scene_id: str
    jobs: int
    toppled: int
    records: int
    without_answer: int
    strongest_shaken: float
    jobs_planned: int | None = None
    jobs_done: int | None = None

    @property
    def unfinished(self) -> str:
        """That the run was not finished, in words; empty where it was, or it is not known."""
        return "" if self.jobs_done is None else Completeness(self.jobs_planned, self.jobs_done).remark


@dataclass(frozen=True)
class Lognormal:
    """Lognormal fragility: P(topple | x) = Phi(ln(x / median) / beta).

    Parameters
    ----------
    measure : str
        Column of the results that x is a value of, in its SI unit.
    median : float
        Intensity at which one in two topples.
    beta : float
        Standard deviation of its logarithm; 0 for a sharp threshold.
    basis : Basis or None
        Where it is known.
    median_interval : (float, float) or None
        Ends of the median's 95 % interval, where they are known.
    resampled : Resampled or None
        The same curve of records drawn anew, where it is known.
    """

    measure: str
    median: float
    beta: float
    basis: Basis | None = None
    median_interval: tuple[float, float] | None = None
    resampled: "Resampled | None" = field(default=None, compare=False, repr=False)

    def probability(self, intensity: ArrayLike) -> NDArray[np.float64]:
        """Toppling probability at some intensities, in the measure's SI unit; 0 at intensity 0."""
        with np.errstate(divide="ignore", invalid="ignore"):
            above = np.log(np.asarray(intensity, float) / self.median)
            z = np.where(above == 0.0, 0.0, above / self.beta) if self.beta > 0 else np.sign(above) * np.inf
        return norm.cdf(np.nan_to_num(z, nan=0.0))

    def intensity(self, probability: float) -> float:
        """Intensity at which a toppling probability is reached."""
        return self.median * math.exp(self.beta * norm.ppf(probability))


@dataclass(frozen=True)
class Fit:
    """A binomial regression on logarithms of intensity measures.

    Parameters
    ----------
    measures : tuple of str
    link : str
        probit or logit.
    coefficients : tuple of float
        Intercept, then one slope a measure's natural logarithm; empty where there is a problem.
    jobs, toppled, records : int
    problem : str
        Why there is no fit; empty where there is one.
    bounds : pair of float
        For one measure: the largest intensity that some job stood, and the least that toppled one. Where the
        answers are separated these bound the median.
    """

    measures: tuple[str, ...]
    link: str
    coefficients: tuple[float, ...]
    jobs: int
    toppled: int
    records: int
    problem: str = ""
    bounds: tuple[float, float] = (math.nan, math.nan)

    @property
    def lognormal(self) -> Lognormal | None:
        """The lognormal fragility that this is, if it is one: one measure, probit, rising with intensity."""
        if self.problem or self.link != "probit" or len(self.measures) != 1:
            return None
        return _lognormal(self.measures[0], *self.coefficients)

    def probability(self, frame: pd.DataFrame) -> NDArray[np.float64]:
        """Toppling probability of each row's measures."""
        link = LINKS[self.link]()
        return link.inverse(_design(frame, self.measures) @ np.array(self.coefficients))


@dataclass(frozen=True, eq=False)
class Resampled:
    """The same model fitted to records drawn anew.

    Parameters
    ----------
    coefficients : (k, 1 + number of measures) array
        Of the samples that have a fit.
    fitted : (samples,) bool array
        Which have one, in the order they were drawn: in the others the answers are separated, or probability does not
        rise.
    records : int
        Number that are drawn.
    studentised : bool
        Whether the coefficients are those of a bootstrap-t (`results.studentised`), whose percentiles allow for few
        records themselves.
    """

    coefficients: NDArray[np.float64]
    fitted: NDArray[np.bool_]
    records: int
    studentised: bool = False

    @property
    def without_fit(self) -> int:
        """Number of samples without a fit."""
        return int((~self.fitted).sum())

    def interval(self, values: NDArray[np.float64], level: float = 0.95) -> NDArray[np.float64]:
        """Ends of the interval of something that each sample has a value of, (2, ...); null without samples.

        Values may be infinite.
        """
        if self.studentised and len(values):
            return _ends(values, (1.0 - level) / 2)
        return _expanded_interval(values, self.records, level)

    def lognormals(self, measure: str) -> list[Lognormal]:
        """Each sample's lognormal fragility over the one measure that was fitted, in the order drawn.

        A sample without a fit bounds nothing: its curve is that of a rock which no shaking topples.
        """
        found = iter(self.coefficients)
        never = Lognormal(measure, math.inf, 0.0)
        return [_lognormal(measure, *next(found)) if has_fit else never for has_fit in self.fitted]


def fit(frame: pd.DataFrame, measures: Sequence[str], link: str = "probit") -> Fit:
    """Fit toppling probability to one or several intensity measures by maximum likelihood.

    Parameters
    ----------
    frame : DataFrame
        Rows of results with an answer (`answered`).
    measures : sequence of str
        Columns, each positive throughout.
    link : str
        probit or logit.

    Returns
    -------
    Fit
        With a `problem` instead of coefficients where the maximum does not exist (one answer only, or
        answers that a threshold separates, but for those at it: Albert and Anderson 1984), or where probability does
        not rise with the one measure.
    """
    names = tuple(measures)
    toppled = frame["toppled"].to_numpy(bool)
    told = {
        "measures": names, "link": link, "jobs": len(frame), "toppled": int(toppled.sum()),
        "records": frame["record_id"].nunique(), "bounds": _bounds(frame, names),
    }  # fmt: skip
    if toppled.all() or not toppled.any():
        which = "every job topples" if len(toppled) and toppled.all() else "no job topples"
        return Fit(**told, coefficients=(), problem=which)
    if _separable(_design(frame, names), toppled):
        return Fit(**told, coefficients=(), problem=_separation(frame, names))
    groups = _grouped(frame, names)
    coefficients = _regress(_design(groups, names), groups, link)
    if coefficients is None:
        return Fit(**told, coefficients=(), problem="the fit does not converge")
    if _is_flat(coefficients):
        return Fit(**told, coefficients=(), problem="probability does not rise with the measure")
    return Fit(**told, coefficients=tuple(float(value) for value in coefficients))


def softened(frame: pd.DataFrame, measures: Sequence[str]) -> tuple[float, ...] | None:
    """Coefficients of a probit whose answers are each in doubt by half a job in all, so that they exist if separated.

    None where every job has the same answer.
    """
    toppled = frame["toppled"].astype(float)
    if toppled.nunique() < 2:
        return None
    doubt = 0.5 / len(frame)
    groups = _grouped(frame, measures, toppled.clip(doubt, 1.0 - doubt))
    found = _regress(_design(groups, measures), groups, "probit")
    return None if found is None else tuple(float(value) for value in found)


def bootstrap(
    frame: pd.DataFrame,
    fitted: Fit,
    samples: int = SAMPLES,
    seed: int = 0,
    seen: Callable[[], None] = lambda: None,
) -> Resampled:
    """Fit the same model to resampled records; to none where they are fewer than `LEAST_RECORDS`.

    `seen` is called before each sample. Rocks that were shaken by the same records are given the same draws, as other
    records would have been other records for all of them; rocks of other records are given draws of their own.
    """
    groups = _grouped(frame, fitted.measures)
    design = _design(groups, fitted.measures)
    codes, records = pd.factorize(groups["record_id"], sort=True)
    random = np.random.default_rng([seed, zlib.crc32("\n".join(records).encode())])
    steep = SUSPECT_SLOPE * np.abs(fitted.coefficients[1:]).max()
    fitted_again = np.zeros(samples if len(records) >= LEAST_RECORDS else 0, bool)
    found, times = [], []
    for number in range(len(fitted_again)):
        seen()
        drawn = np.bincount(random.integers(0, len(records), len(records)), minlength=len(records))
        again = _regress(design, groups, fitted.link, drawn[codes], start=fitted.coefficients)
        if again is None or _is_flat(again):
            continue
        if np.abs(again[1:]).max() > steep and _groups_separable(design, groups, drawn[codes] > 0):
            continue
        fitted_again[number] = True
        found.append(again)
        times.append(drawn)
    refits = np.array(found).reshape(-1, design.shape[1])
    turns = bool(found) and fitted.link == "probit" and len(fitted.measures) <= 2
    if turns:
        share, trials = (groups[name].to_numpy(float) for name in ("share", "trials"))
        refits = studentised(
            design, share, trials, codes, np.array(fitted.coefficients), refits, np.array(times, float)
        )
    return Resampled(refits, fitted_again, len(records), turns)


def lognormal_interval(resampled: Resampled, level: float = 0.95) -> dict[str, float]:
    """Intervals of median and beta over bootstrap samples of a lognormal fit."""
    intercept, slope = resampled.coefficients.T
    median = resampled.interval(np.exp(-intercept / slope), level)
    beta = resampled.interval(1.0 / slope, level)
    return {"median_low": median[0], "median_high": median[1], "beta_low": beta[0], "beta_high": beta[1]}


def out_of_fold(
    frame: pd.DataFrame, measures: Sequence[str], link: str = "probit", folds: int = 5
) -> pd.Series:
    """Predict each job from a fit to other records; null where that fit does not exist.

    Where a threshold of the one measure divides the answers of those others, it predicts: the middle between the
    strongest that stood and the weakest that toppled, with the doubt that half a job of the other answer leaves.
    """
    predicted = pd.Series(np.nan, index=frame.index)
    folds = min(folds, frame["record_id"].nunique())
    if folds < 2:
        return predicted
    for train, test in GroupKFold(folds).split(frame, groups=frame["record_id"]):
        fitted = fit(frame.iloc[train], measures, link)
        standing, toppled = fitted.bounds
        if not fitted.problem:
            predicted.iloc[test] = fitted.probability(frame.iloc[test])
        elif 0 < standing * (1 + NEAR_TIE) < toppled < math.inf:
            doubt = 0.5 / fitted.jobs
            above = frame.iloc[test][measures[0]] > math.sqrt(standing * toppled)
            predicted.iloc[test] = np.where(above, 1 - doubt, doubt)
    return predicted


def scores(toppled: ArrayLike, predicted: ArrayLike) -> dict[str, float]:
    """Brier score, log loss and area under the ROC curve of predictions; null where they cannot be had."""
    truth, guess = np.asarray(toppled, bool), np.asarray(predicted, float)
    if np.isnan(guess).any() or truth.all() or not truth.any():
        return dict.fromkeys(("brier", "log_loss", "auc"), math.nan)
    return {
        "brier": float(brier_score_loss(truth, guess)),
        "log_loss": float(log_loss(truth, guess)),
        "auc": float(roc_auc_score(truth, guess)),
    }


def compare_measures(
    frame: pd.DataFrame, measures: Sequence[Sequence[str]] | None = None, samples: int = 500, seed: int = 0
) -> pd.DataFrame:
    """Rank intensity measures by how well they predict records that were not fitted to.

    Parameters
    ----------
    frame : DataFrame
        Rows of results with an answer (`answered`).
    measures : sequence of sequences of str
        `MEASURES` one by one, and PGA with PGV together, if not given. Those that are not known and positive
        for every job are left out, so that all are compared on the same jobs.

    Returns
    -------
    DataFrame
        Best first: measures, brier, log_loss, auc (out of fold), worse_by (log loss minus the best's),
        worse_by_low and worse_by_high (95 %, records resampled; null of fewer than `LEAST_RECORDS`).
    """
    chosen = measures or [*((name,) for name in MEASURES), SURFACES[0]]
    usable = [tuple(names) for names in chosen if (frame[list(names)].fillna(0.0) > 0).all(axis=None)]
    predictions = {names: out_of_fold(frame, names) for names in usable}
    truth = frame["toppled"].to_numpy(bool)
    lines = [{"measures": " + ".join(names), **scores(truth, told)} for names, told in predictions.items()]
    table = pd.DataFrame(lines, columns=["measures", "brier", "log_loss", "auc"])
    losses = {" + ".join(names): _loss(truth, told.to_numpy()) for names, told in predictions.items()}
    ranked = table.sort_values("log_loss", ignore_index=True)
    if not len(ranked) or math.isnan(ranked["log_loss"][0]):
        return ranked
    codes, records = pd.factorize(frame["record_id"])
    random = np.random.default_rng(seed)
    draws = random.multinomial(len(records), np.full(len(records), 1 / len(records)), samples)
    weight = draws @ np.bincount(codes)
    for place, name in enumerate(ranked["measures"]):
        worse = losses[name] - losses[ranked["measures"][0]]
        resampled = draws @ np.bincount(codes, weights=worse) / weight
        ranked.loc[place, "worse_by"] = worse.mean()
        if len(records) >= LEAST_RECORDS:
            interval = _expanded_interval(resampled, len(records))
            ranked.loc[place, ["worse_by_low", "worse_by_high"]] = interval
    return ranked


def calibration(frame: pd.DataFrame, predicted: pd.Series, bins: int = 10) -> pd.DataFrame:
    """Predicted against observed share of toppling, in bins of equally many jobs.

    Returns
    -------
    DataFrame
        One row a bin: predicted (mean), observed, jobs, records, wilson_low and wilson_high of observed.
    """
    known = predicted.notna()
    table = _binned_shares(frame[known], predicted[known], bins)
    return table.rename(columns={"value": "predicted", "probability": "observed"})


def observed_shares(frame: pd.DataFrame, measure: str, bins: int = 12) -> pd.DataFrame:
    """Share of toppling in bins of equally many jobs along a measure, with Wilson's interval by records.

    Returns
    -------
    DataFrame
        One row a bin: value (geometric mean), probability, wilson_low, wilson_high, jobs, records.
    """
    table = _binned_shares(frame, np.log(frame[measure]), bins)
    return table.assign(value=np.exp(table["value"]))


def headline(models: Sequence[Fit]) -> Fit | None:
    """First of some fits, best first, that may stand for the run: of one measure, with a curve, horizontal."""
    return next(
        (told for told in models if told.lognormal and told.measures[0] not in NO_HEADLINE),
        None,
    )


def summary(models: Sequence[Fit], resampled: Sequence[Resampled | None]) -> pd.DataFrame:
    """Fits as a table: one row a model, with percentile intervals (95 %) over the samples of `bootstrap`."""
    lines = []
    for told, samples in zip(models, resampled, strict=True):
        line: dict[str, object] = {
            "measures": " + ".join(told.measures), "link": told.link, "problem": told.problem,
            "jobs": told.jobs, "toppled": told.toppled, "records": told.records,
            "largest_standing": told.bounds[0], "least_toppled": told.bounds[1],
        }  # fmt: skip
        if curve := told.lognormal:
            line |= {"median": curve.median, "beta": curve.beta}
        if samples is not None:
            found = samples.coefficients
            line |= {"samples": len(found), "samples_without_fit": samples.without_fit}
            if told.lognormal:
                line |= lognormal_interval(samples)
            for number, value in enumerate(told.coefficients):
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


def with_interval(curve: Lognormal, resampled: Resampled | None) -> Lognormal:
    """A curve with its bootstrap samples and their interval of its median; as it was where there are none."""
    if resampled is None or not len(resampled.coefficients):
        return curve
    ends = lognormal_interval(resampled)
    interval = float(ends["median_low"]), float(ends["median_high"])
    return replace(curve, median_interval=interval, resampled=resampled)


def _lognormal(measure: str, intercept: float, slope: float) -> Lognormal:
    """The lognormal that a probit of one measure's logarithm is."""
    return Lognormal(measure, math.exp(-intercept / slope), 1.0 / slope)


def _expanded_interval(values: NDArray[np.float64], records: int, level: float = 0.95) -> NDArray[np.float64]:
    """Ends (2, ...) of the interval of values (samples, ...) over records drawn anew; null without samples.

    Percentiles of a bootstrap are narrow by sqrt((n - 1) / n) and know no Student's t; with few records the level is
    raised by as much (Hesterberg 2015, expanded percentiles). Ends are values that occur: infinite ones have no mean.
    """
    if not len(values):
        return np.full((2, *np.shape(values)[1:]), math.nan)
    tail = norm.cdf(-math.sqrt(records / (records - 1)) * t.ppf((1 + level) / 2, records - 1))
    return _ends(values, float(tail))


def _ends(values: NDArray[np.float64], tail: float) -> NDArray[np.float64]:
    """Ends of an interval that occur among the values."""
    low = np.quantile(values, tail, axis=0, method="lower")
    return np.array([low, np.quantile(values, 1 - tail, axis=0, method="higher")])


def _design(frame: pd.DataFrame, measures: Sequence[str]) -> NDArray[np.float64]:
    return np.column_stack([np.ones(len(frame)), np.log(frame[list(measures)].to_numpy(float))])


def _binned_shares(frame: pd.DataFrame, value: pd.Series, bins: int) -> pd.DataFrame:
    """Mean value and share of toppling in bins of equally many jobs, each job by its record's weight.

    What the fit is held against has to count records as the fit does. Wilson's trials are Kish's number.
    """
    place = ((value.rank(method="average") - 0.5) * bins / max(1, len(value))).astype(int)
    jobs = frame.assign(value=value, bin=place, weight=frame.get("record_weight", 1.0))
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
    table["wilson_low"], table["wilson_high"] = wilson(table["probability"], effective_records(jobs, ["bin"]))
    return table.reset_index(drop=True)


def _grouped(
    frame: pd.DataFrame, measures: Sequence[str], answers: "pd.Series[float] | None" = None
) -> pd.DataFrame:
    """Jobs of one record with equal measures together: the same likelihood at a fraction of the cost.

    A column `record_weight` (`Run.weighted`) multiplies a job's part of the likelihood: jobs of one record weigh unlike
    on bases that do. Answers are whether a job toppled, unless others, between 0 and 1, are given.
    """
    weight = frame.get("record_weight", 1.0)
    jobs = frame.assign(
        trials=weight, share=weight * (frame["toppled"].astype(float) if answers is None else answers)
    )
    table = jobs.groupby(["record_id", *measures], sort=False)[["share", "trials"]].sum()
    return table.assign(share=table["share"] / table["trials"]).reset_index()


def _regress(
    design: NDArray[np.float64],
    groups: pd.DataFrame,
    link: str,
    weight: NDArray[np.int64] | None = None,
    start: Sequence[float] | None = None,
) -> NDArray[np.float64] | None:
    trials = groups["trials"].to_numpy(float) * (1.0 if weight is None else weight)
    drawn = trials > 0
    family = sm.families.Binomial(link=LINKS[link]())
    with warnings.catch_warnings():
        for kind in (ConvergenceWarning, PerfectSeparationWarning, RuntimeWarning):
            warnings.simplefilter("error", kind)
        warnings.simplefilter("ignore", DomainWarning)
        try:
            share = groups["share"].to_numpy(float)[drawn]
            model = sm.GLM(share, design[drawn], family, var_weights=trials[drawn])
            found = model.fit(start_params=start)
        except (
            ConvergenceWarning,
            PerfectSeparationWarning,
            RuntimeWarning,
            np.linalg.LinAlgError,
            ValueError,
        ):
            return None
    return np.asarray(found.params) if np.isfinite(found.params).all() else None


def _is_flat(coefficients: NDArray[np.float64]) -> bool:
    """Whether probability does not rise with the one measure that was fitted."""
    return len(coefficients) == 2 and bool(coefficients[1] < FLATTEST_SLOPE)


def _separable(design: NDArray[np.float64], toppled: NDArray[np.bool_]) -> bool:
    """Whether a plane has every toppled job on its one side and every standing one on the other, or on it."""
    centred = np.column_stack([np.ones(len(design)), design[:, 1:] - design[:, 1:].mean(axis=0)])
    signed = centred * np.where(toppled, 1.0, -1.0)[:, None]
    signed = np.unique(signed, axis=0)
    found = linprog(
        -signed.sum(axis=0), A_ub=-signed, b_ub=np.zeros(len(signed)), bounds=(-1.0, 1.0), method="highs"
    )
    return bool(found.success and -found.fun > 1e-6)


def _groups_separable(design: NDArray[np.float64], groups: pd.DataFrame, drawn: NDArray[np.bool_]) -> bool:
    """The same of some groups of jobs: one of both answers counts as a job of each."""
    share = groups["share"].to_numpy(float)
    some, none = drawn & (share > 0), drawn & (share < 1)
    answers = np.concatenate([np.ones(some.sum(), bool), np.zeros(none.sum(), bool)])
    return _separable(np.concatenate([design[some], design[none]]), answers)


def _separation(frame: pd.DataFrame, measures: tuple[str, ...]) -> str:
    """What separates answers: a threshold, a level that divides its own jobs, or a line between two measures."""
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


def _loss(truth: NDArray[np.bool_], predicted: NDArray[np.float64]) -> NDArray[np.float64]:
    safe = np.clip(predicted, 1e-15, 1 - 1e-15)
    return -np.log(np.where(truth, safe, 1 - safe))
