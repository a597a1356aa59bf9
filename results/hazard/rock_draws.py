"""Draws of what is uncertain about standing rocks: fragilities of other records, and ages; and what they expose to."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from toppling.models.arrays import Array
from toppling.results.analysis.lognormal import Lognormal, Resampled, ends
from toppling.results.analysis.resampling import SAMPLES
from toppling.results.hazard.curves import HazardCurve, nodes_between
from toppling.results.hazard.survival import Standing, drawn_ages

_NODES_PER_E_FOLD = 60
"""Points of an integral in an interval where intensity grows by e: 1e-4 of a rate, where draws differ by per cents."""


@dataclass(frozen=True, eq=False)
class Draws:
    """Draws of rocks' fragilities and ages."""

    curves: list[list[Lognormal]]  # of each draw, one per rock
    years: Array  # (draws, rocks)
    carries: tuple[str, ...]  # what differs between draws: fragility, age, or both
    # The bootstrap with the fewest records, which decides how wide an interval has to be; None where only
    # ages vary.
    records: Resampled | None

    def interval(self, values: Array) -> Array:
        """Ends of the 95 % interval (2, ...) of values of each draw (draws, ...), which may be infinite."""
        if self.records is not None:
            return self.records.interval(values)
        return ends(values)


def draws_of(rocks: Sequence[Standing]) -> Draws | None:
    """Draws of rocks' fragilities and ages; None where neither is known to vary.

    Fragilities vary if all rocks' do; a sample without a fit is a rock that no shaking topples.
    """
    drawn = [rock.drawn for rock in rocks]
    vary = all(drawn)
    old = any(len(rock.years) > 1 for rock in rocks)
    if not (vary or old) or any(np.isnan(rock.years).any() for rock in rocks):
        return None
    count = min(map(len, drawn)) if vary else SAMPLES
    by_rock = [each[:count] for each in drawn] if vary else [[rock.curve] * count for rock in rocks]
    carries = ("fragility",) * vary + ("age",) * old
    known = [rock.curve.resampled for rock in rocks if rock.curve.resampled]
    fewest = min(known, key=lambda one: one.records) if vary else None
    return Draws(
        [list(curves) for curves in zip(*by_rock, strict=True)], drawn_ages(rocks, count), carries, fewest
    )


def _event_matrix(curves: Sequence[HazardCurve]) -> tuple[Array, Array]:
    """Intensities (m,) common to some curves, and annual rates of events of each (curves, m).

    As `curves.events_by_intensity`, for many curves at once: what each says beyond its last point lies at that point.
    """
    bearing = [curve for curve in curves if len(curve.intensity)]
    if not bearing:
        return np.ones(1), np.zeros((len(curves), 1))
    corners = np.unique(np.concatenate([np.log(curve.intensity) for curve in bearing]))
    nodes = nodes_between(corners, _NODES_PER_E_FOLD)
    ends = np.unique([curve.intensity[-1] for curve in bearing])
    x = np.concatenate([np.exp((nodes[1:] + nodes[:-1]) / 2), ends])
    rates = np.zeros((len(curves), len(x)))
    for row, curve in zip(rates, curves, strict=True):
        if len(curve.intensity):
            row[: len(nodes) - 1] = -np.diff(curve.rate(np.exp(nodes)))
            row[len(nodes) - 1 :] = curve.annual_rate[-1] * (ends == curve.intensity[-1])
    return x, rates


def exponents(draws: Draws, curves: Sequence[HazardCurve], factors: Array) -> Array:
    """Expected topplings (draws, factors, curves) since the rocks stand, of motions multiplied by each factor.

    Survival is exp of minus it. Over the years that only the older rocks stood, only they could topple.
    """
    x, rates = _event_matrix(curves)
    scaled = np.outer(factors, x)
    found = np.zeros((len(draws.curves), len(factors), len(curves)))
    known: dict[tuple, Array] = {}
    for number, (fragilities, years) in enumerate(zip(draws.curves, draws.years, strict=True)):
        order = np.argsort(-years)
        spans = -np.diff(np.append(years[order], 0.0))
        standing = np.ones_like(scaled)
        for index, rock in enumerate(order):
            curve = fragilities[rock]
            key = (rock, curve.median, curve.beta)
            if key not in known:
                known = {key: curve.probability(scaled)} if len(known) > len(order) else known
                known[key] = curve.probability(scaled)
            standing = standing * (1.0 - known[key])
            if spans[index] > 0:
                found[number] += spans[index] * ((1.0 - standing) @ rates.T)
    return found


@dataclass(frozen=True)
class RandomRock:
    """Fragility of a theoretical random rock of a site."""

    # Its beta holds the spread between rocks and the mean spread within them: the logarithm's variance of a
    # mixture of their curves is the sum of both.
    curve: Lognormal
    # Root mean square of the rocks' betas, and standard deviation of the logarithms of their medians.
    beta_within: float
    beta_between: float
    # 95 %, over other records; None where these are not known of all rocks.
    median_interval: tuple[float, float] | None


def random_rock(rocks: Sequence[Standing]) -> RandomRock | None:
    """Fragility of a random rock from several; None from fewer than two, or where one never topples."""
    curves = [rock.curve for rock in rocks]
    if len(curves) < 2 or not all(math.isfinite(curve.median) for curve in curves):
        return None
    logs = np.log([curve.median for curve in curves])
    within = math.sqrt(np.mean([curve.beta**2 for curve in curves]))
    between = float(np.std(logs, ddof=1))
    curve = Lognormal(curves[0].measure, math.exp(logs.mean()), math.hypot(within, between))
    known = draws_of(rocks)
    if known is None or "fragility" not in known.carries:
        return RandomRock(curve, within, between, None)
    medians = np.array([math.exp(np.mean([math.log(one.median) for one in drawn])) for drawn in known.curves])
    low, high = known.interval(medians)
    return RandomRock(curve, within, between, (float(low), float(high)))
