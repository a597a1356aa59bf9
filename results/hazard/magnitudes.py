"""Magnitudes and distances that a standing rock excludes, given a ground-motion model.

An earthquake of magnitude M at a distance R gives a median motion exp(mu) with a spread sigma, and topples a rock of
lognormal fragility (median theta, spread beta) with

    P(M, R) = Phi((mu - ln theta) / sqrt(sigma^2 + beta^2)).

Sigma has a between-event part tau, a site-to-site part phi_S2S, and a remainder phi_SS (Al Atik et al., 2010). All
earthquakes share the site's own term s (standard deviation phi_S2S), so that n of them leave the rock standing with
E_s[(1 - P(s))^n], where P(s) has the median exp(mu + s) and a spread without phi_S2S; a source that repeats them every
T years (Poisson) over an age A with E_s,A[exp(-P(s) A / T)]. An earthquake is excluded with confidence C where that is
at most 1 - C. Models are averaged by their weights after the power.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
from numpy.polynomial.hermite_e import hermegauss
from numpy.typing import ArrayLike
from scipy.special import logsumexp, ndtr, ndtri

from toppling.models.arrays import Array
from toppling.models.errors import InputError
from toppling.models.files.documents import finite
from toppling.results.analysis.lognormal import Lognormal, ends
from toppling.results.hazard.events import Standing
from toppling.results.hazard.gmm import GroundMotionModel, single_station_parts
from toppling.results.hazard.places import FaultTrace

_MAGNITUDE_STEP = 0.1
"""Step of the grid of magnitudes."""
_DISTANCES = 40
"""Number of distances of the grid, in equal steps of the logarithm."""
_NODES, _NODE_WEIGHTS = hermegauss(24)
"""Gauss-Hermite quadrature of the site term, in its standard deviations."""
_PROBABILITIES = np.linspace(0.0, 1.0, 2001)
"""Toppling probabilities at which survival of a recurring source is tabulated."""
REFERENCE = 6.5, 10.0
"""Magnitude and distance (km) at which effects of options are reported."""
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
    between_sites: Array  # (models, m, r): phi_S2S, standard deviation of the site's own term, part of sigma
    weights: Array  # (models,): weights of the models, summing to 1


@dataclass(frozen=True)
class Occurrence:
    """Occurrences of an earthquake while the rock stood."""

    name: str  # such as "one event"
    confidence: float  # probability of toppling at which the earthquake is excluded
    survival: Callable[
        [Array], Array
    ]  # of the rock, given the toppling probability of each of the earthquakes


def toppling_probability(fragility: Lognormal, mean: ArrayLike, sigma: ArrayLike) -> Array:
    """Probability that motions topple a rock; `mean` and `sigma` are those of the logarithm of the motion."""
    centre, spread = np.broadcast_arrays(np.asarray(mean, float), np.asarray(sigma, float))
    if fragility.median == math.inf:
        return 0.0 * centre
    total = np.maximum(np.hypot(spread, fragility.beta), 1e-300)
    return ndtr((centre - math.log(fragility.median)) / total)


def toppled(grid: MotionGrid, fragility: Lognormal, occurrence: Occurrence) -> Array:
    """Probability that the earthquakes topple the rock at least once, (m, r)."""
    mean = grid.mean[..., None] + grid.between_sites[..., None] * _NODES
    spread = np.sqrt(np.maximum(grid.sigma**2 - grid.between_sites**2, 0.0))[..., None]
    stands = occurrence.survival(toppling_probability(fragility, mean, spread)) @ (
        _NODE_WEIGHTS / _NODE_WEIGHTS.sum()
    )
    return 1.0 - np.tensordot(grid.weights, stands, axes=1)


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
    least, most = (end(model.magnitudes[n] for model in models) for n, end in enumerate((max, min)))
    near, far = (end(model.distances_km[n] for model in models) for n, end in enumerate((max, min)))
    magnitude = np.linspace(least, most, 1 + round((most - least) / _MAGNITUDE_STEP))
    distance = (
        np.geomspace(near, far, _DISTANCES) if distances_km is None else np.clip(distances_km, near, far)
    )
    found = [model.motion(magnitude[:, None], distance) for model in models]
    mean, sigma, between_sites = map(np.array, zip(*found, strict=True))
    return MotionGrid(magnitude, distance, mean, sigma, between_sites, np.array(weights) / sum(weights))


def reference_grid(models: Sequence[GroundMotionModel], grid: MotionGrid) -> MotionGrid:
    """Motions at `REFERENCE` with the weights of a grid."""
    return _motions(models, grid, [([REFERENCE[0]], [REFERENCE[1]])] * len(models))


def _motions(models: Sequence[GroundMotionModel], grid: MotionGrid, at: Sequence[tuple]) -> MotionGrid:
    mean, sigma, between_sites = np.swapaxes(
        [model.motion(*pair) for model, pair in zip(models, at, strict=True)], 0, 1
    )
    return replace(grid, mean=mean, sigma=sigma, between_sites=between_sites)


def sigma_parts(grid: MotionGrid, measure: str) -> dict[str, float]:
    """Sigma at `REFERENCE` and its parts: root mean squares over the models.

    The between-event part and the remainder are smaller than Al Atik's where a model's sigma is.
    """
    total, between_sites = grid.sigma[:, 0], grid.between_sites[:, 0]
    between_events, remaining = single_station_parts(measure, REFERENCE[0])
    share = np.sqrt((total**2 - between_sites**2) / (between_events**2 + remaining**2))
    parts = {
        "total": total, "between_events": share * between_events, "between_sites": between_sites,
        "remaining": share * remaining,
    }  # fmt: skip
    return {name: math.sqrt(grid.weights @ part**2) for name, part in parts.items()}


def effects(models: Sequence[GroundMotionModel], grid: MotionGrid) -> list[dict[str, Any]]:
    """Effect at `REFERENCE` of each option about the site or source that is given, averaged over the models.

    Against the models' own estimates; of the source of Vs30, against the other one.
    """
    found, here = [], reference_grid(models, grid)
    other = "inferred" if models[0].vs30_source == "measured" else "measured"
    changed: dict[str, tuple[str, str, Any]] = {
        "vs30_source": ("--vs30-source", "", other), "hypocentre_km": ("--hypocentre", " km", None),
        "depth_1_0_km": ("--basin", " km", None),
    }  # fmt: skip
    for name, (option, unit, value) in changed.items():
        if (given := getattr(models[0], name)) == value:
            continue
        without = reference_grid([replace(model, **{name: value}) for model in models], grid)
        factor = math.exp(float(grid.weights @ (here.mean - without.mean)[:, 0]))
        sigma, sigma_before = (math.sqrt(grid.weights @ at.sigma[:, 0] ** 2) for at in (here, without))
        if given != getattr(GroundMotionModel, name) or (factor, sigma) != (1.0, sigma_before):
            found.append({
                "option": option, "value": f"{given}{unit}", "instead_of": value or "the models' own estimate",
                "median_factor": factor, "sigma": sigma, "sigma_before": sigma_before,
            })  # fmt: skip
    return found


def event_count(confidence: float, events: int = 1) -> Occurrence:
    """Occurrence of an earthquake a given number of times."""
    name = "one event" if events == 1 else f"{events} events"
    return Occurrence(name, confidence, lambda p: (1.0 - p) ** events)


def recurring(confidence: float, years: Array, recurrence_years: float) -> Occurrence:
    """Poisson occurrence of an earthquake with a mean recurrence time, over equally likely ages `years` (n,)."""
    exposure = np.asarray(years, float) / recurrence_years
    table = logsumexp(-np.outer(_PROBABILITIES, exposure), axis=1) - math.log(len(exposure))
    name = f"one event every {recurrence_years:,.0f} years"
    return Occurrence(name, confidence, lambda p: np.exp(np.interp(p, _PROBABILITIES, table)))


def excess(grid: MotionGrid, fragility: Lognormal, occurrence: Occurrence) -> Array:
    """Probit of the toppling probability minus that of the confidence, (m, r): an earthquake is excluded above 0."""
    chance = np.clip(toppled(grid, fragility, occurrence), 1e-300, 1 - 1e-16)
    return ndtri(chance) - float(ndtri(occurrence.confidence))


def largest_magnitudes(
    grid: MotionGrid, fragility: Lognormal, drawn: Sequence[Lognormal], occurrence: Occurrence
) -> pd.DataFrame:
    """Largest magnitude that the standing rock allows at each distance.

    drawn: fragilities of resampled records; empty if unknown.
    Returns DataFrame: one row per distance: distance_km, magnitude (infinite where no magnitude of the models is
    excluded, minus infinity where all are), magnitude_low, magnitude_high (95 %, resampled records; null if unknown).
    """
    return _crossings(
        grid.magnitude, drawn, fragility, lambda curve: excess(grid, curve, occurrence).T, "distance_km", "magnitude",
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
        -np.log(grid.distance_km[::-1]), drawn, fragility, lambda curve: excess(grid, curve, occurrence)[:, ::-1],
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
        values = np.array([_last_allowed(along, excess_of(curve)) for curve in drawn])
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
    bins: pd.DataFrame, models: Sequence[GroundMotionModel], grid: MotionGrid, fragility: Lognormal,
    occurrences: Sequence[Occurrence],
) -> pd.DataFrame:  # fmt: skip
    """Toppling probability and exclusion of the earthquake at the centre of each contributing deaggregation bin.

    bins: as in `Deaggregation`.
    models, grid: ground-motion models, and their grid with its weights.
    Returns DataFrame: one row per occurrence and bin: occurrence, magnitude, distance_km (centres), share (fraction of
    the deaggregated hazard), topples (probability that one such earthquake topples the rock), excluded, beyond_models
    (whether it was clipped to the models' range). The largest contribution first.
    """
    known = bins[bins["contribution"] > 0]
    magnitude = (known["magnitude_low"] + known["magnitude_high"]).to_numpy() / 2
    distance = (known["distance_low_km"] + known["distance_high_km"]).to_numpy() / 2
    share = known["contribution"].to_numpy()
    within = [
        (np.clip(magnitude, *model.magnitudes), np.clip(distance, *model.distances_km)) for model in models
    ]
    beyond = np.any([(m != magnitude) | (r != distance) for m, r in within], axis=0)
    there = _motions(models, grid, within)
    topples = toppled(there, fragility, event_count(0.5))
    tables = [
        pd.DataFrame({
            "occurrence": case.name, "magnitude": magnitude, "distance_km": distance, "share": share / share.sum(),
            "topples": topples, "excluded": toppled(there, fragility, case) >= case.confidence, "beyond_models": beyond,
        }).sort_values("share", ascending=False)
        for case in occurrences
    ]  # fmt: skip
    return pd.concat(tables, ignore_index=True)


def bins_words(table: pd.DataFrame) -> list[str]:
    """Lines on the excluded fraction of the hazard and the largest contribution, one per occurrence."""
    lines = []
    for occurrence, rows in table.groupby("occurrence", sort=False):
        excluded = rows[rows["excluded"]]
        most = rows.iloc[0]
        lines.append(
            f"{str(occurrence).capitalize()}: {100 * excluded['share'].sum():.3g} % of the deaggregated hazard, "
            f"{len(excluded)} of {len(rows)} bins, is of earthquakes that the rock excludes; the largest contribution, "
            f"magnitude {most['magnitude']:.2f} at {most['distance_km']:.3g} km, topples it with a probability of "
            f"{most['topples']:.2g}"
        )
    if table["beyond_models"].any():
        lines.append("Bins beyond what the models are for are taken as their nearest.")
    return lines


@dataclass(frozen=True, eq=False)
class Exclusions:
    """Magnitudes and distances that a rock excludes."""

    rock: Standing
    grid: MotionGrid
    at_traces: MotionGrid | None
    occurrences: Sequence[Occurrence]
    traces: Sequence[FaultTrace]
    reference: MotionGrid

    @cached_property
    def tables(self) -> dict[str, tuple[pd.DataFrame, pd.DataFrame]]:
        """Largest magnitudes and smallest distances, by occurrence."""
        return {
            case.name: (
                largest_magnitudes(self.grid, self.rock.curve, self.rock.drawn, case),
                least_distances(self.grid, self.rock.curve, self.rock.drawn, case),
            )
            for case in self.occurrences
        }

    @cached_property
    def faults(self) -> pd.DataFrame:
        """Distance of each fault, largest allowed magnitude, and whether its characteristic earthquake is excluded."""
        assert self.at_traces is not None
        lines = []
        for case in self.occurrences:
            allowed = largest_magnitudes(self.at_traces, self.rock.curve, self.rock.drawn, case)
            for number, (trace, row) in enumerate(zip(self.traces, allowed.itertuples(), strict=True)):
                lines.append({
                    "fault": trace.name, "occurrence": case.name, "distance_km": trace.distance_km,
                    "beyond_models": trace.distance_km > self.grid.distance_km[-1],
                    "magnitude": row.magnitude, "magnitude_low": row.magnitude_low,
                    "magnitude_high": row.magnitude_high, "stated_magnitude": trace.magnitude,
                    "topples": self._topples(trace, number),
                    "excluded": None if trace.magnitude is None else bool(trace.magnitude > row.magnitude),
                })  # fmt: skip
        return pd.DataFrame(lines)

    def _topples(self, trace: FaultTrace, number: int) -> float | None:
        """Probability that an earthquake of the fault's stated magnitude topples the rock."""
        if trace.magnitude is None or self.at_traces is None:
            return None
        at = {name: getattr(self.at_traces, name)[..., number] for name in ("mean", "sigma", "between_sites")}
        there = replace(self.at_traces, **at)
        single = toppled(there, self.rock.curve, event_count(0.5))
        return float(np.interp(trace.magnitude, self.at_traces.magnitude, single))

    def statement(self) -> dict[str, Any]:
        """Statement for JSON; null where nothing, or everything, is excluded."""
        tables, curve = self.tables, self.rock.curve
        anew = replace(
            self.reference, between_sites=0.0 * self.reference.sigma
        )  # a site term in each earthquake
        stated = [
            {
                "occurrence": case.name, "topples": float(toppled(self.reference, curve, case)[0]),
                "topples_ergodic": float(toppled(anew, curve, case)[0]),
                "largest_magnitudes": _rows(tables[case.name][0]), "least_distances": _rows(tables[case.name][1]),
                "excludes_nothing": bool((excess(self.grid, curve, case) < 0).all()),
            }
            for case in self.occurrences
        ]  # fmt: skip
        return {
            "rock": self.rock.name, "measure": curve.measure, **curve.numbers,
            **dict(zip(("strongest_shaken", "weakest_shaken"), curve.shaken, strict=True)),
            "magnitude_range": self.grid.magnitude[[0, -1]].tolist(),
            "distance_range_km": self.grid.distance_km[[0, -1]].tolist(), "occurrences": stated,
            "faults": _rows(self.faults) if self.traces else [],
        }  # fmt: skip


def _rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows for JSON; infinite values (nothing or everything excluded) become null with an explaining word."""
    rows = []
    for row in table.astype(object).to_dict("records"):
        plain = finite(row)
        bound = row.get("magnitude") if "occurrence" in row or next(iter(row)) == "distance_km" else None
        if isinstance(bound, float) and math.isinf(bound):
            plain["excluded_magnitudes"] = "none" if bound > 0 else "all"
        rows.append(plain)
    return rows
