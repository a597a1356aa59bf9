"""Magnitudes and distances that a standing rock excludes, given a ground-motion model.

An earthquake of magnitude M at a distance R gives a median motion exp(mu) with a spread sigma, and topples a rock of
lognormal fragility (median theta, spread beta) with

    P(M, R) = Phi((mu - ln theta) / sqrt(sigma^2 + beta^2)),

exactly; for any other fragility, the integral of F over the motion's lognormal. One such earthquake is excluded with
confidence C where P >= C, n of them where 1 - (1 - P)^n >= C, and a source that repeats it every T years (Poisson) over
an uncertain age A where E[exp(-P A / T)] <= 1 - C. Models are averaged by their weights: P = sum w P.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri

from toppling.models.arrays import Array
from toppling.models.errors import InputError
from toppling.models.motions.deaggregation import Bin
from toppling.results.analysis.lognormal import Lognormal, ends
from toppling.results.hazard.gmm import GroundMotionModel
from toppling.results.hazard.survival import greatest_rate

_MAGNITUDE_STEP = 0.1
"""Step of the grid of magnitudes."""
_DISTANCES = 40
"""Number of distances of the grid, in equal steps of the logarithm."""
_QUADRATURE = np.linspace(-8.0, 8.0, 2001)
"""Nodes in standard deviations of ln(motion) for the integration of fragilities that are not lognormal."""
TARGETS = (6.0, 6.5, 7.0, 7.5)
"""Magnitudes for which the smallest allowed distance is reported."""


@dataclass(frozen=True, eq=False)
class MotionGrid:
    """Motions of some models on a grid of magnitudes and distances."""

    magnitude: Array  # (m,)
    distance_km: Array  # (r,)
    # (models, m, r): mean and standard deviation of the logarithm of the motion in SI.
    mean: Array
    sigma: Array
    weights: Array  # (models,): weights of the models, summing to 1


@dataclass(frozen=True)
class Occurrence:
    """Occurrences of an earthquake while the rock stood."""

    name: str  # such as "one event"
    # Smallest toppling probability of a single earthquake that excludes it; above 1 where none can be excluded.
    probability: float


def toppling_probability(
    fragility: Lognormal | Callable[[NDArray], NDArray], mean: ArrayLike, sigma: ArrayLike
) -> Array:
    """Probability that motions topple a rock; `mean` and `sigma` are those of the logarithm of the motion."""
    centre, spread = np.broadcast_arrays(np.asarray(mean, float), np.asarray(sigma, float))
    if isinstance(fragility, Lognormal):
        if fragility.median == math.inf:
            return 0.0 * centre
        total = np.maximum(np.hypot(spread, fragility.beta), 1e-300)
        return ndtr((centre - math.log(fragility.median)) / total)
    share = np.exp(-(_QUADRATURE**2) / 2)
    motions = np.exp(centre[..., None] + spread[..., None] * _QUADRATURE)
    return fragility(motions) @ (share / share.sum())


def motion_grid(
    models: Sequence[GroundMotionModel], weights: Sequence[float], distances_km: ArrayLike | None = None
) -> MotionGrid:
    """Motions of models over the magnitudes and distances that are valid for all of them.

    weights: weights of the models, summing to 1.
    distances_km: distances of the grid instead; those outside the models' range are clipped to it.
    """
    if not (len(weights) == len(models) and min(weights) > 0 and abs(sum(weights) - 1.0) < 1e-3):
        raise InputError(
            "model.weights_unusable",
            what=f"the weights of {len(models)} models are {', '.join(f'{weight:g}' for weight in weights)}",
            where="--model",
            expected="positive weights that sum to 1",
            remedy="give NAME=WEIGHT for each model",
        )
    least, most = (end(one.magnitudes[n] for one in models) for n, end in enumerate((max, min)))
    near, far = (end(one.distances_km[n] for one in models) for n, end in enumerate((max, min)))
    magnitude = np.linspace(least, most, 1 + round((most - least) / _MAGNITUDE_STEP))
    distance = (
        np.geomspace(near, far, _DISTANCES) if distances_km is None else np.clip(distances_km, near, far)
    )
    found = [one.motion(magnitude[:, None], distance) for one in models]
    mean, sigma = (np.array([pair[number] for pair in found]) for number in (0, 1))
    return MotionGrid(magnitude, distance, mean, sigma, np.array(weights) / sum(weights))


def one_event(confidence: float, events: int = 1) -> Occurrence:
    """Occurrence of an earthquake a given number of times."""
    name = "one event" if events == 1 else f"{events} events"
    return Occurrence(name, -math.expm1(math.log1p(-confidence) / events))


def recurring(confidence: float, years: Array, recurrence_years: float) -> Occurrence:
    """Poisson occurrence of an earthquake with a mean recurrence time, over equally likely ages `years` (n,)."""
    exposure = np.asarray(years, float) / recurrence_years
    name = f"one event every {recurrence_years:,.0f} years"
    return Occurrence(name, greatest_rate(exposure, 1.0 - confidence))


def excess(grid: MotionGrid, fragility: Lognormal, occurrence: Occurrence) -> Array:
    """Probit of the toppling probability minus that of exclusion, (m, r): an earthquake is excluded above 0."""
    if occurrence.probability >= 1:
        return np.full(grid.mean.shape[1:], -math.inf)
    shares = np.tensordot(grid.weights, toppling_probability(fragility, grid.mean, grid.sigma), axes=1)
    return ndtri(np.clip(shares, 1e-300, 1 - 1e-16)) - float(ndtri(occurrence.probability))


def largest_magnitudes(
    grid: MotionGrid, fragility: Lognormal, drawn: Sequence[Lognormal], occurrence: Occurrence
) -> pd.DataFrame:
    """Largest magnitude that the standing rock allows at each distance.

    drawn: fragilities of resampled records; empty if unknown.
    Returns DataFrame: one row per distance: distance_km, magnitude (infinite where no magnitude of the models is
    excluded, minus infinity where all are), magnitude_low, magnitude_high (95 %, resampled records; null if unknown).
    """
    return _crossings(
        grid.magnitude, drawn, fragility, lambda one: excess(grid, one, occurrence).T, "distance_km", "magnitude",
        grid.distance_km,
    )  # fmt: skip


def least_distances(
    grid: MotionGrid, fragility: Lognormal, drawn: Sequence[Lognormal], occurrence: Occurrence
) -> pd.DataFrame:
    """Smallest distance that the standing rock allows at each magnitude.

    Returns DataFrame: one row per magnitude: magnitude, distance_km (0 where no distance of the models is excluded,
    infinite where all are), distance_km_low, distance_km_high (95 %, resampled records; null if unknown).
    """
    # The excess rises with falling distance, as it does with magnitude.
    table = _crossings(
        -np.log(grid.distance_km[::-1]), drawn, fragility, lambda one: excess(grid, one, occurrence)[:, ::-1],
        "magnitude", "distance_km", grid.magnitude,
    )  # fmt: skip
    ends = np.exp(-table[["distance_km", "distance_km_low", "distance_km_high"]].to_numpy())
    return table.assign(distance_km=ends[:, 0], distance_km_low=ends[:, 2], distance_km_high=ends[:, 1])


def _crossings(
    along: Array, drawn: Sequence[Lognormal], fragility: Lognormal,
    excess_of: Callable[[Lognormal], Array], row: str, name: str, rows: Array,
) -> pd.DataFrame:  # fmt: skip
    found = _last_allowed(along, excess_of(fragility))
    low = high = np.full(len(rows), math.nan)
    if drawn:
        values = np.array([_last_allowed(along, excess_of(one)) for one in drawn])
        low, high = ends(values)
    return pd.DataFrame({row: rows, name: found, f"{name}_low": low, f"{name}_high": high})


def _last_allowed(along: Array, beyond: Array) -> Array:
    """Largest allowed value of an increasing variable in each row; inf where none is excluded, -inf where all are."""
    allowed = beyond < 0
    none, whole = ~allowed.any(axis=1), allowed[:, -1]
    last = np.where(none | whole, 0, beyond.shape[1] - 1 - np.argmax(allowed[:, ::-1], axis=1))
    lines = np.arange(len(beyond))
    following = np.minimum(last + 1, beyond.shape[1] - 1)
    before, after = beyond[lines, last], beyond[lines, following]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(after > before, -before / (after - before), 0.0)
    value = along[last] + share * (along[following] - along[last])
    return np.where(none, -math.inf, np.where(whole, math.inf, value))


def excluded_bins(
    bins: Sequence[Bin], models: Sequence[GroundMotionModel], weights: Sequence[float], fragility: Lognormal,
    occurrences: Sequence[Occurrence],
) -> pd.DataFrame:  # fmt: skip
    """Toppling probability and exclusion of the earthquake at the centre of each contributing deaggregation bin.

    models, weights: ground-motion models and their weights.
    Returns DataFrame: one row per occurrence and bin: occurrence, magnitude, distance_km (centres), share (fraction of
    the deaggregated hazard), topples (probability that one such earthquake topples the rock), excluded, beyond_models
    (whether it was clipped to the models' range). The largest contribution first.
    """
    known = [one for one in bins if one.contribution > 0]
    magnitude = np.array([math.fsum(one.magnitude) / 2 for one in known])
    distance = np.array([math.fsum(one.distance_km) / 2 for one in known])
    share = np.array([one.contribution for one in known])
    topples, beyond = np.zeros(len(known)), np.zeros(len(known), bool)
    for model, weight in zip(models, np.asarray(weights, float) / sum(weights), strict=True):
        within = np.clip(magnitude, *model.magnitudes), np.clip(distance, *model.distances_km)
        topples += weight * toppling_probability(fragility, *model.motion(*within))
        beyond |= (within[0] != magnitude) | (within[1] != distance)
    tables = [
        pd.DataFrame({
            "occurrence": one.name, "magnitude": magnitude, "distance_km": distance, "share": share / share.sum(),
            "topples": topples, "excluded": topples >= one.probability, "beyond_models": beyond,
        }).sort_values("share", ascending=False)
        for one in occurrences
    ]  # fmt: skip
    return pd.concat(tables, ignore_index=True)


def bins_words(table: pd.DataFrame) -> list[str]:
    """Lines on the excluded fraction of the hazard and the largest contribution, one per occurrence."""
    lines = []
    for occurrence, rows in table.groupby("occurrence", sort=False):
        gone = rows[rows["excluded"]]
        most = rows.iloc[0]
        lines.append(
            f"{str(occurrence).capitalize()}: {100 * gone['share'].sum():.3g} % of the deaggregated hazard, "
            f"{len(gone)} of {len(rows)} bins, is of earthquakes that the rock excludes; the largest contribution, "
            f"magnitude {most['magnitude']:.2f} at {most['distance_km']:.3g} km, topples it with "
            f"{most['topples']:.2g}"
        )
    if table["beyond_models"].any():
        lines.append("Bins beyond what the models are for are taken as their nearest.")
    return lines
