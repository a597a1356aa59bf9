"""How well probabilities foretell an experiment's outcomes: scores, simple rules beside them, draws learnt from others.

Tests of one record at several amplitudes are not independent: intervals resample records, and whatever learns from
outcomes predicts a record without having seen any test of it.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import logit
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import LeaveOneGroupOut

from toppling.models.arrays import Array
from toppling.models.shares import jeffreys_mean

_CALLED_FROM = 0.5
"""Probability from which on a rock is called overturned."""
_BINS = 6
_SAMPLES = 500
"""Of resampled records, for intervals of 95 %."""
_SURE = 1e-3
"""Probabilities nearer to 0 or 1 count as this near in logarithmic scores: who says never may be wrong."""
_ROUNDS = 200
"""In which weights and rates are found together."""
_FIRST_RATES = (0.05, 0.95)
_Truths = NDArray[np.bool_]


def share(toppled: Array) -> tuple[Array, Array]:
    """Probability of each test from its draws (draws, tests), and its standard error; NaN is no answer.

    The mean and the deviation of a share of which nothing is known but the draws (Jeffreys' prior), so that a test
    that no draw topples is not called impossible.
    """
    answered = np.isfinite(toppled).sum(axis=0)
    toppling = np.nansum(toppled, axis=0)
    mean = jeffreys_mean(toppling, answered)
    return mean, np.sqrt(mean * (1.0 - mean) / (answered + 2.0))


def scores(overturned: _Truths, probability: Array) -> dict[str, Any]:
    """Scores of probabilities, called at one half where a score needs a call.

    Returns dict: n, accuracy, balanced_accuracy, recall, specificity, brier, log_loss, calibration_slope (logistic
    regression of the outcomes on the log odds; 1 is calibrated, less is overconfident; None where there are too few
    outcomes) and confusion, a dict of counts.
    """
    called = probability >= _CALLED_FROM
    fell_right, fell_wrong = (overturned & called).sum(), (overturned & ~called).sum()
    stood_wrong, stood_right = (~overturned & called).sum(), (~overturned & ~called).sum()
    unsure = _unsure(probability)
    fell, stood = fell_right + fell_wrong, stood_right + stood_wrong
    recall = fell_right / fell if fell else np.nan
    specificity = stood_right / stood if stood else np.nan
    return {
        "n": len(overturned),
        "accuracy": _number((overturned == called).mean()),
        "balanced_accuracy": _number(0.5 * (recall + specificity)),
        "recall": _number(recall),
        "specificity": _number(specificity),
        "brier": _number(((probability - overturned) ** 2).mean()),
        "log_loss": _number(-np.log(np.where(overturned, unsure, 1.0 - unsure)).mean()),
        "calibration_slope": _number(_calibration_slope(overturned, probability)),
        "confusion": {
            "overturned_called_overturned": int(fell_right),
            "overturned_called_standing": int(fell_wrong),
            "standing_called_overturned": int(stood_wrong),
            "standing_called_standing": int(stood_right),
        },
    }


def intervals(overturned: _Truths, probability: Array, group: NDArray[Any]) -> dict[str, list[float | None]]:
    """Intervals of 95 % of the scores, by resampling records; none of tests of one record."""
    if len(np.unique(group)) < 2:
        return {}
    random = np.random.default_rng(0)
    of_group = [np.flatnonzero(group == name) for name in np.unique(group)]
    drawn = []
    for _ in range(_SAMPLES):
        rows = np.concatenate([of_group[k] for k in random.integers(len(of_group), size=len(of_group))])
        drawn.append(scores(overturned[rows], probability[rows]))
    return _quantiles(drawn, 0.025, 0.975)


def were_a_draw_true(toppled: Array) -> dict[str, list[float | None]]:
    """Intervals of 90 % of the scores that draws would have were each of them in turn the specimen.

    All tests are of one specimen, so what nobody measured of it is one draw for them all: even where the distribution
    drawn from is right, shares are not calibrated over its tests, and the slope is rarely 1. Scores outside of these
    intervals say that the specimen is none of the draws.

    toppled: (draws, tests), 1, 0, or NaN where a draw has no answer. Draws that shook not all tests, such as those
    added where a share was still unsure, are left out: easy tests are part of the scores.
    """
    whole = toppled[np.isfinite(toppled).all(axis=1)]
    drawn = []
    for number, true in enumerate(whole):
        probability, _ = share(np.delete(whole, number, axis=0))
        drawn.append(scores(true > 0.5, probability))
    return _quantiles(drawn, 0.05, 0.95)


def calibration(overturned: _Truths, probability: Array) -> pd.DataFrame:
    """Shares that overturned, where probabilities are alike: one row a bin of equal width that holds any test."""
    number = np.clip((probability * _BINS).astype(int), 0, _BINS - 1)
    frame = pd.DataFrame({"bin": number, "probability": probability, "overturned": overturned})
    grouped = frame.groupby("bin")
    return grouped.agg(
        tests=("overturned", "size"), probability=("probability", "mean"), overturned=("overturned", "mean")
    ).reset_index(drop=True)


def learnt(toppled: Array, overturned: _Truths, group: NDArray[Any]) -> Array:
    """Probabilities (tests,) from draws weighted by the likelihood of the outcomes of other records only.

    toppled: (draws, tests), 1, 0, or NaN where a draw has no answer.
    overturned: (tests,).
    group: (tests,), the record of each test: none of its tests is looked at when it is predicted.
    Returns (tests,) array.
    """
    predicted = np.empty(len(overturned))
    for training, held_out in LeaveOneGroupOut().split(toppled.T, overturned, group):
        seen = toppled[:, training], overturned[training], group[training]
        weights, (stands, topples) = _weighted_draws(*seen)
        known = np.isfinite(toppled[:, held_out])
        said = np.where(toppled[:, held_out] > 0.5, topples, stands)
        evidence = (weights[:, None] * known).sum(axis=0)
        mean = (weights[:, None] * known * said).sum(axis=0) / np.where(evidence > 0.0, evidence, 1.0)
        predicted[held_out] = np.where(evidence > 0.0, mean, overturned[training].mean())
    return predicted


def _weighted_draws(
    toppled: Array, overturned: _Truths, group: NDArray[Any]
) -> tuple[Array, tuple[float, float]]:
    """Weights of draws that make their mean most likely, with the rates at which a draw is right, found together.

    No draw is the true base. Weights by each draw's own likelihood would leave the one that errs least, whereas draws
    on either side of the truth tell more together: so it is the likelihood of the weighted mean that is as large as it
    can be (stacking of predictive distributions, Yao et al. 2018), by expectation and maximisation. The tests of a
    record err together and count as one; before any outcome, draws weigh alike, with the weight of one record.

    Returns weights, (draws,) array: their sum is 1.
    Returns rates: share that overturns where a draw says that it stands, and where it says that it topples.
    """
    names, size = np.unique(group, return_counts=True)
    evidence = len(names) / size.sum()
    known = np.isfinite(toppled)
    falls, stands = known & (toppled > 0.5), known & (toppled <= 0.5)
    weights = np.full(len(toppled), 1.0 / len(toppled))
    rates = _FIRST_RATES
    for _ in range(_ROUNDS):
        chance = np.where(falls, rates[1], rates[0])
        likelihood = weights[:, None] * np.where(overturned, chance, 1.0 - chance) * known
        total = likelihood.sum(axis=0)
        responsibility = likelihood / np.where(total > 0.0, total, 1.0)
        weights = evidence * responsibility.sum(axis=1) + 1.0 / len(toppled)
        weights /= weights.sum()
        rates = (_rate(responsibility * stands, overturned), _rate(responsibility * falls, overturned))
    return weights, rates


def simple_rules(intensity: pd.DataFrame, overturned: _Truths, group: NDArray[Any]) -> dict[str, Array]:
    """Probabilities of rules without mechanics, each fitted without the record that it predicts.

    intensity: pga_m_s2, pgv_m_s and pgv_pga_s of each test.
    overturned: (tests,).
    group: (tests,).
    Returns dict: by the rule's name; empty where all tests are of one record.
    """
    if len(np.unique(group)) < 2:
        return {}
    pga, ratio = (np.log(intensity[name].to_numpy()) for name in ("pga_m_s2", "pgv_pga_s"))
    linear = np.column_stack([pga, ratio])
    quadratic = np.column_stack([pga, ratio, pga**2, pga * ratio, ratio**2])
    pgv = intensity["pgv_m_s"].to_numpy()
    rules: dict[str, Callable[[NDArray, NDArray], Array]] = {
        "one PGV threshold": partial(_threshold, pgv, overturned),
        "logistic in ln PGA, ln PGV/PGA": partial(_logistic, linear, overturned),
        "quadratic in ln PGA, ln PGV/PGA": partial(_logistic, quadratic, overturned),
    }
    said = {name: np.empty(len(overturned)) for name in rules}
    for training, held_out in LeaveOneGroupOut().split(linear, overturned, group):
        for name, rule in rules.items():
            said[name][held_out] = rule(training, held_out)
    return said


def table(rows: Mapping[str, Mapping[str, Any]]) -> pd.DataFrame:
    """Scores of several predictors, one per row."""
    names = [
        "accuracy",
        "balanced_accuracy",
        "recall",
        "specificity",
        "brier",
        "log_loss",
        "calibration_slope",
    ]
    frame = pd.DataFrame([{"who": who, **row} for who, row in rows.items()], columns=["who", "n", *names])
    return frame.set_index("who").astype(dict.fromkeys(names, float))


def _quantiles(drawn: list[dict[str, Any]], low: float, high: float) -> dict[str, list[float | None]]:
    names = [name for name in drawn[0] if name not in ("n", "confusion")]
    frame = pd.DataFrame(drawn)[names].astype(float)
    return {
        name: [_number(end) for end in np.nanquantile(frame[name], [low, high])]
        if frame[name].notna().any()
        else [None, None]
        for name in names
    }


def _rate(responsibility: Array, overturned: _Truths) -> float:
    return float(jeffreys_mean((responsibility * overturned).sum(), responsibility.sum()))


def _threshold(measure: Array, overturned: _Truths, training: NDArray, held_out: NDArray) -> Array:
    """1 above the threshold that is most often right among the tests seen, 0 below."""
    order = np.sort(measure[training])
    between = np.sqrt(order[1:] * order[:-1])
    right = [(overturned[training] == (measure[training] > each)).mean() for each in between]
    return (measure[held_out] > between[int(np.argmax(right))]).astype(float)


def _logistic(features: Array, overturned: _Truths, training: NDArray, held_out: NDArray) -> Array:
    """Logistic regression, hardly regularised, so that separated outcomes have a fit."""
    if len(np.unique(overturned[training])) < 2:
        return np.full(len(held_out), float(overturned[training].mean()))
    centre, spread = features[training].mean(axis=0), features[training].std(axis=0)
    scaled = (features - centre) / np.where(spread > 0.0, spread, 1.0)
    model = LogisticRegression(C=100.0, max_iter=1000).fit(scaled[training], overturned[training])
    return np.asarray(model.predict_proba(scaled[held_out])[:, 1])


def _calibration_slope(overturned: _Truths, probability: Array) -> float:
    odds = logit(_unsure(probability))
    if len(np.unique(overturned)) < 2 or np.ptp(odds) == 0.0:
        return np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = LogisticRegression(C=1e6, solver="newton-cholesky").fit(odds[:, None], overturned)
    return float(model.coef_[0, 0])


def _unsure(probability: Array) -> Array:
    return np.clip(probability, _SURE, 1.0 - _SURE)


def _number(value: float) -> float | None:
    return None if not np.isfinite(value) else float(value)
