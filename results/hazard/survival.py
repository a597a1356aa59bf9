"""Rocks that stand together: their survival under a hazard curve, and the rates that it rejects."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from toppling.models.arrays import Array
from toppling.results.analysis.lognormal import Lognormal
from toppling.results.hazard.ages import Exposure, exposure
from toppling.results.hazard.curves import HazardCurve, any_topples, toppling_rate


@dataclass(frozen=True, eq=False)
class Standing:
    """A rock that has stood for some time."""

    name: str
    curve: Lognormal  # with samples of other records, where these are known
    years: Array  # (n,): equally likely ages; one where it is known
    # Whether its ages go with those of the other rocks, draw by draw, as for dates with a common error.
    together: bool = False

    @property
    def drawn(self) -> list[Lognormal]:
        """Its curve of each resample; none where they are not known."""
        known = self.curve.resampled
        return known.lognormals(self.curve.measure) if known and len(known.fitted) else []


def joint_survival(rocks: Sequence[Standing], hazard: HazardCurve) -> float:
    """Probability that all rocks still stand, each after its own age, under common events.

    Over the years that only the older rocks stood, only they could topple. Uncertain ages are averaged over.
    """
    together, stood = epochs(rocks)
    return stood.survival([toppling_rate(curves, hazard) for curves in together])


def rejected_rate(rocks: Sequence[Standing], intensity: ArrayLike, confidence: float = 0.95) -> Array:
    """Annual rate of exceedance above which an intensity is rejected, whatever the rest of the hazard curve.

    Fragility rises with intensity, so the toppling rate is at least F(x) lambda(x), and the rocks' survival
    at most exp(-F(x) lambda(x) T). Returned is the rate at which that bound is 1 - confidence; infinite where
    F(x) is 0.
    """
    values = np.atleast_1d(np.asarray(intensity, float))
    together, stood = epochs(rocks)
    topple = np.array([any_topples(curves, values) for curves in together])
    return np.array([greatest_rate(row, 1.0 - confidence) for row in topple.T @ stood.years])


def unexceeded(curves: Sequence[Lognormal], confidence: float = 0.95) -> float:
    """Intensity that no single event has exceeded, at a confidence, since the rocks stand: F(x) = confidence.

    What can be said without an age or a hazard curve. Infinite where no curve gets there.
    """
    low, high = (min(curve.intensity(share) for curve in curves) for share in (1e-9, confidence))
    if len(curves) == 1 or math.isinf(high):
        return high
    return float(brentq(lambda x: any_topples(curves, x) - confidence, low, high * (1 + 1e-9)))


def drawn_ages(rocks: Sequence[Standing], draws: int) -> Array:
    """Ages of each rock (draws, rocks).

    Independent ones are each rock's equally likely ages, shuffled with a fixed seed; those that go `together` keep
    their order.
    """
    random = np.random.default_rng(0)
    alone = all(rock.together for rock in rocks) or (len(rocks) == 1 and len(rocks[0].years) == draws)
    columns = [_resized(rock.years, draws) for rock in rocks]
    return np.column_stack(
        [ages if alone or len(ages) == 1 else random.permutation(ages) for ages in columns]
    )


def _resized(years: Array, draws: int) -> Array:
    """As many equally likely ages as are asked for: repeated, or evenly left out."""
    if draws >= len(years):
        return np.resize(years, draws)
    return years[((np.arange(draws) + 0.5) * len(years) / draws).astype(int)]


def epochs(rocks: Sequence[Standing]) -> tuple[list[list[Lognormal]], Exposure]:
    """Find the sets of rocks that stood together, by their curves, and how long in each draw of their ages."""
    stood = exposure(drawn_ages(rocks, max(len(rock.years) for rock in rocks)))
    together = [
        [rock.curve for rock, stands in zip(rocks, state, strict=True) if stands] for state in stood.states
    ]
    return together, stood


def greatest_rate(exposure: Array, chance: float) -> float:
    """Rate at which the mean of exp(-rate x exposure) over draws falls to a chance; infinite without exposure."""
    if not exposure.mean() > 0:
        return math.inf
    # The mean of exp(-rate A) lies between exp(-rate mean(A)), by Jensen, and exp(-rate min(A)).
    low = -math.log(chance) / exposure.mean()
    high = -math.log(chance) / exposure.min() if exposure.min() > 0 else low * 1e6
    if high <= low * (1 + 1e-12):
        return low
    return float(
        brentq(lambda rate: np.exp(-rate * exposure).mean() - chance, low * (1 - 1e-9), high * (1 + 1e-9))
    )
