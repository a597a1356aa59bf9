"""By how much a site's motions, or its rates, may be multiplied for the rocks to have survived with some probability.

Two readings of "scaling a hazard curve": motions that are a factor s stronger, rate'(x) = rate(x / s), and rates that
are a factor k higher, rate' = k rate. Each is the factor at which survival falls to the probability: 1 and more says
that the hazard is compatible as it is.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from toppling.models.arrays import Array
from toppling.results.hazard.curves import HazardCurve, toppling_rate
from toppling.results.hazard.rock_draws import Draws, exponents
from toppling.results.hazard.survival import Standing, epochs, greatest_rate

_FURTHEST = 1e3
"""Largest factor of motions that is looked for, and the inverse of the least."""

_GROUP = 128
"""Curves at a time, so that a tree of thousands needs no more memory than one of these."""

_STEP = 1.05
"""Between factors of motions at which draws are computed; rates are power laws between them."""


def motion_factor(rocks: Sequence[Standing], hazard: HazardCurve, chance: float) -> float:
    """Largest factor of a curve's motions under which the rocks survive with a probability.

    Infinite where they do however strong the motions are, as there are so few events.
    """
    together, stood = epochs(rocks)

    def above(log_factor: float) -> float:
        stronger = hazard.stronger(math.exp(log_factor))
        return stood.survival([toppling_rate(curves, stronger) for curves in together]) - chance

    return largest_factor(above, precision=1e-9)


def largest_factor(above: Callable[[float], float], precision: float) -> float:
    """Factor at which a falling function of its logarithm is 0; infinite or 0 where that is far beyond 1."""
    far = math.log(_FURTHEST)
    if above(far) > 0:
        return math.inf
    if above(-far) < 0:
        return 0.0
    return math.exp(brentq(above, -far, far, xtol=precision))


def rate_factor(rocks: Sequence[Standing], hazard: HazardCurve, chance: float) -> float:
    """Largest factor of a curve's rates under which the rocks survive with a probability; infinite if none topples."""
    together, stood = epochs(rocks)
    rates = np.array([toppling_rate(curves, hazard) for curves in together])
    return greatest_rate(rates @ stood.years, chance)


def drawn_factors(
    draws: Draws, curves: Sequence[HazardCurve], chance: float, central: Sequence[float]
) -> tuple[Array, Array, Array]:
    """Factors of motions and of rates, and survivals, of each draw and curve, (draws, curves) each.

    `central` are the curves' factors of motions, about which those of the draws are looked for.
    """
    finite = [factor for factor in central if 0 < factor < math.inf] or [1.0]
    low, high = math.log(min(*finite, 1.0) / 8), math.log(max(*finite, 1.0) * 8)
    grid = np.arange(math.floor(low / math.log(_STEP)), math.ceil(high / math.log(_STEP)) + 1) * math.log(
        _STEP
    )
    found = [
        _of_group(draws, curves[first : first + _GROUP], grid, chance)
        for first in range(0, len(curves), _GROUP)
    ]
    motions, rates, survivals = (np.concatenate(parts, axis=1) for parts in zip(*found, strict=True))
    return motions, rates, survivals


def _of_group(
    draws: Draws, curves: Sequence[HazardCurve], grid: NDArray[np.floating], chance: float
) -> tuple[Array, Array, Array]:
    """As `drawn_factors`, of some curves and on a grid of logarithms of factors that holds 0."""
    topplings = exponents(draws, curves, np.exp(grid))
    enough = -math.log(chance)
    as_it_is = topplings[:, int(np.abs(grid).argmin()), :]
    with np.errstate(divide="ignore"):
        rates = enough / as_it_is
        rising = np.log(topplings)
    motions = np.empty_like(as_it_is)
    for number, curve in np.ndindex(*motions.shape):
        motions[number, curve] = _crossing(grid, rising[number, :, curve], math.log(enough))
    return motions, rates, np.exp(-as_it_is)


def _crossing(grid: NDArray[np.floating], rising: NDArray[np.floating], value: float) -> float:
    """Factor at which a rising curve reaches a value; infinite or 0 where it does so outside the grid."""
    if rising[-1] < value:
        return math.inf
    if rising[0] > value:
        return 0.0
    index = int(np.searchsorted(rising, value))
    if index == 0 or not math.isfinite(rising[index - 1]):
        return math.exp(grid[index])
    share = (value - rising[index - 1]) / (rising[index] - rising[index - 1])
    return math.exp(grid[index - 1] + share * (grid[index] - grid[index - 1]))
