"""The statement: survival and rejection for some rocks under some hazard branches."""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from toppling.results.hazard.curves import any_topples, continued, toppling_rate, unstated_shares
from toppling.results.hazard.standing import Standing, joint_survival, rejected_rate, unexceeded
from toppling.results.hazard.tree import Branch, branch_weights


def branch_table(rocks: Sequence[Standing], branches: Sequence[Branch], confidence: float) -> pd.DataFrame:
    """Survival, verdict and Bayes weight of each hazard branch.

    A branch is rejected where the rocks survive with less than 1 - confidence (5 % in Stirling et al. 2021).

    Returns
    -------
    DataFrame
        One row a branch: branch, toppling_rate (annual, any of the rocks), unstated_below and unstated_above
        (shares of the rate outside the curve's points, not counted: `results.hazard`), survival, survival_least
        (with these counted), survival_low and survival_high (95 %, records drawn anew; null where a curve does not
        tell), rejected (by survival), prior_weight, posterior_weight (null where no branch lets the rocks survive).
    """
    curves = [rock.curve for rock in rocks]
    prior = np.array([branch.weight for branch in branches]) / sum(branch.weight for branch in branches)
    survivals = np.array([joint_survival(rocks, branch.curve) for branch in branches])
    posterior = (
        branch_weights(prior, survivals) if (prior * survivals).sum() > 0 else np.full(len(prior), np.nan)
    )
    low, high = zip(
        *(_interval(rocks, partial(joint_survival, hazard=branch.curve)) for branch in branches),
        strict=True,
    )
    below, above = zip(*(unstated_shares(curves, branch.curve) for branch in branches), strict=True)
    return pd.DataFrame(
        {
            "branch": [branch.name for branch in branches],
            "toppling_rate": [toppling_rate(curves, branch.curve) for branch in branches],
            "unstated_below": below,
            "unstated_above": above,
            "survival": survivals,
            "survival_least": [joint_survival(rocks, continued(branch.curve, curves)) for branch in branches],
            "survival_low": low,
            "survival_high": high,
            "rejected": survivals < 1.0 - confidence,
            "prior_weight": prior,
            "posterior_weight": posterior,
        }
    )


def _interval(rocks: Sequence[Standing], told: Callable[[Sequence[Standing]], float]) -> tuple[float, float]:
    """Interval (95 %) of what is told of some rocks, as their records are drawn anew (`results.fits.bootstrap`)."""
    known = [rock.resampled for rock in rocks if rock.resampled and len(rock.resampled.fitted)]
    if len(known) < len(rocks):
        return (math.nan, math.nan)
    fewest = min(known, key=lambda one: one.records)
    drawn = zip(
        *(one.lognormals(rock.curve.measure) for one, rock in zip(known, rocks, strict=True)), strict=True
    )
    values = [
        told([replace(rock, curve=curve) for rock, curve in zip(rocks, curves, strict=True)])
        for curves in drawn
    ]
    low, high = fewest.interval(np.array(values))
    return float(low), float(high)


def bound_table(rocks: Sequence[Standing], confidence: float) -> pd.DataFrame:
    """Annual rate of exceedance above which each intensity is rejected, where a rock may topple.

    Returns
    -------
    DataFrame
        The measure's column, topples (probability that an event topples any), rejected_annual_rate and
        rejected_return_years, its inverse: shorter return periods are rejected.
    """
    curves = [rock.curve for rock in rocks]
    low, high = (
        extreme(curve.intensity(tail) for curve in curves) for extreme, tail in ((min, 0.01), (max, 0.999))
    )
    intensity = np.geomspace(low, high * 1.001, 60)
    rate = rejected_rate(rocks, intensity, confidence)
    return pd.DataFrame(
        {
            curves[0].measure: intensity,
            "topples": any_topples(curves, intensity),
            "rejected_annual_rate": rate,
            "rejected_return_years": 1.0 / rate,
        }
    )


def single_event(rocks: Sequence[Standing], confidence: float) -> dict[str, Any]:
    """State the intensity that no single event exceeded, at a confidence: without age and hazard.

    Returns
    -------
    dict
        measure, confidence, unexceeded, unexceeded_low and unexceeded_high (95 %, records drawn anew; None where a
        curve does not tell, or too many draws have no fit: such a draw bounds nothing), rocks.
    """
    curves = [rock.curve for rock in rocks]
    low, high = _interval(rocks, lambda drawn: unexceeded([rock.curve for rock in drawn], confidence))
    return {
        "measure": curves[0].measure,
        "confidence": confidence,
        "unexceeded": unexceeded(curves, confidence),
        "unexceeded_low": low if math.isfinite(low) else None,
        "unexceeded_high": high if math.isfinite(high) else None,
        "rocks": [
            {"name": rock.name, "median": rock.curve.median, "beta": rock.curve.beta}
            | (asdict(rock.curve.basis) if rock.curve.basis else {})
            | ({"samples_without_fit": rock.resampled.without_fit} if rock.resampled else {})
            for rock in rocks
        ],
    }
