"""Rocks that stand together under curves of hazard: their survival, what it rejects, and what it allows at most.

Two readings of "scaling a hazard curve": motions that are a factor s stronger, rate'(x) = rate(x / s), and rates that
are a factor k higher, rate' = k rate. Each is the factor at which survival falls to a probability: 1 and more says
that the hazard is compatible as it is. Draws are of what is uncertain: fragilities of other records, and ages.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from toppling.models.arrays import Array
from toppling.results.analysis.lognormal import Lognormal, Resampled, ends
from toppling.results.analysis.resampling import SAMPLES
from toppling.results.hazard.ages import Exposure, exposure
from toppling.results.hazard.curves import HazardCurve, any_topples, nodes_between, toppling_rate

_NODES_PER_E_FOLD = 60
"""Points of an integral in an interval where intensity grows by e: 1e-4 of a rate, where draws differ by per cents."""

_FURTHEST = 1e3
"""Largest factor of motions that is looked for, and the inverse of the least."""

_GROUP = 128
"""Curves at a time, so that a tree of thousands needs no more memory than one of these."""

_STEP = 1.05
"""Between factors of motions at which draws are computed; rates are power laws between them."""


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
    together, stood = _epochs(rocks)
    return stood.survival([toppling_rate(curves, hazard) for curves in together])


def rejected_rate(rocks: Sequence[Standing], intensity: ArrayLike, confidence: float = 0.95) -> Array:
    """Annual rate of exceedance above which an intensity is rejected, whatever the rest of the hazard curve.

    Fragility rises with intensity, so the toppling rate is at least F(x) lambda(x), and the rocks' survival
    at most exp(-F(x) lambda(x) T). Returned is the rate at which that bound is 1 - confidence; infinite where
    F(x) is 0.
    """
    values = np.atleast_1d(np.asarray(intensity, float))
    together, stood = _epochs(rocks)
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


def _drawn_ages(rocks: Sequence[Standing], draws: int) -> Array:
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


def _epochs(rocks: Sequence[Standing]) -> tuple[list[list[Lognormal]], Exposure]:
    """Find the sets of rocks that stood together, by their curves, and how long in each draw of their ages."""
    stood = exposure(_drawn_ages(rocks, max(len(rock.years) for rock in rocks)))
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


def motion_factor(rocks: Sequence[Standing], hazard: HazardCurve, chance: float) -> float:
    """Largest factor of a curve's motions under which the rocks survive with a probability.

    Infinite where they do however strong the motions are, as there are so few events.
    """
    together, stood = _epochs(rocks)

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
    together, stood = _epochs(rocks)
    rates = np.array([toppling_rate(curves, hazard) for curves in together])
    return greatest_rate(rates @ stood.years, chance)


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


def drawn_together(rocks: Sequence[Standing]) -> tuple[list[list[Lognormal]], Resampled] | None:
    """Curves of all rocks in each resample, as many as every rock has, and the bootstrap with the fewest records.

    None unless all rocks' fragilities are known to vary.
    """
    drawn = [rock.drawn for rock in rocks]
    if not all(drawn):
        return None
    known = [rock.curve.resampled for rock in rocks if rock.curve.resampled]
    together = [list(curves) for curves in zip(*drawn, strict=False)]
    return together, min(known, key=lambda one: one.records)


def draws_of(rocks: Sequence[Standing]) -> Draws | None:
    """Draws of rocks' fragilities and ages; None where neither is known to vary.

    Fragilities vary if all rocks' do; a sample without a fit is a rock that no shaking topples.
    """
    known = drawn_together(rocks)
    old = any(len(rock.years) > 1 for rock in rocks)
    if not (known or old) or any(np.isnan(rock.years).any() for rock in rocks):
        return None
    curves, fewest = known or ([[rock.curve for rock in rocks]] * SAMPLES, None)
    carries = ("fragility",) * (known is not None) + ("age",) * old
    return Draws(curves, _drawn_ages(rocks, len(curves)), carries, fewest)


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


def _exponents(draws: Draws, curves: Sequence[HazardCurve], factors: Array) -> Array:
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
    topplings = _exponents(draws, curves, np.exp(grid))
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
    # What the median exceeds at least, where some rock's lies beyond its strongest shaking; None where none does.
    beyond: float | None


def random_rock(rocks: Sequence[Standing]) -> RandomRock | None:
    """Fragility of a random rock from several; None from fewer than two, or where one never topples."""
    curves = [rock.curve for rock in rocks]
    if len(curves) < 2 or not all(math.isfinite(curve.median) for curve in curves):
        return None
    logs = np.log([curve.median for curve in curves])
    shaken = np.array([curve.strongest_shaken or math.inf for curve in curves])
    beyond = float(np.exp(np.minimum(logs, np.log(shaken)).mean())) if (logs > np.log(shaken)).any() else None
    within = math.sqrt(np.mean([curve.beta**2 for curve in curves]))
    between = float(np.std(logs, ddof=1))
    curve = Lognormal(curves[0].measure, math.exp(logs.mean()), math.hypot(within, between))
    known = draws_of(rocks)
    if known is None or "fragility" not in known.carries:
        return RandomRock(curve, within, between, None, beyond)
    medians = np.array([math.exp(np.mean([math.log(one.median) for one in drawn])) for drawn in known.curves])
    low, high = known.interval(medians)
    return RandomRock(curve, within, between, (float(low), float(high)), beyond)
