"""Joint survival of rocks through events, the rates that it rejects, and the largest scale factors that it allows.

An event of annual rate r topples at least one of some rocks with 1 - prod(1 - F_i(its motion at rock i)): rocks feel
the same events, and taking them as independent would be biased. Such events have the rate nu = sum r (1 - prod(1 -
F_i)), and all rocks survive A years with exp(-nu A) (Poisson events). In the years in which only the older rocks
stood, only these could topple. Hazard curves are converted to events (`curves.events_of_curves`).

A hazard is scaled in two ways: motions stronger by a factor s, rate'(x) = rate(x / s), and rates higher by a factor k,
rate' = k rate. Each factor is that at which survival falls to a given probability: 1 or more means that the unscaled
hazard is compatible. Uncertainty is drawn from resampled fragilities, ages, the events of a catalogue (each occurs a
Poisson number of times), and versions of the hazard (`EventSet.readings`).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from toppling.models.arrays import ROUNDING, Array
from toppling.models.errors import InputError
from toppling.results.analysis.lognormal import Lognormal, Surface, ends
from toppling.results.analysis.resampling import SAMPLES
from toppling.results.hazard.ages import AS_NOW, LESS_FRAGILE, Exposure
from toppling.results.hazard.events import EventSet, Fragility, Group, Motions, Standing
from toppling.results.hazard.tree import HazardCurve, continued, events_of_curves

_LEAST_LOGARITHM = math.log(math.ulp(0.0))
"""Smallest finite logarithm of a survival probability: its exp underflows to 0."""
LARGEST_FACTOR = 1e3
"""Largest scale factor of motions in a search, beyond which any is allowed; the smallest is its inverse."""
_FURTHEST = math.log(LARGEST_FACTOR)
_STEP = math.log(1.05)
"""Logarithmic step between scale factors of motions in a draw; rates are power laws between them."""


def topples(fragility: Fragility, motions: Motions) -> Array:
    """Toppling probability of events, given their motions.

    Raises InputError if the motions lack a measure of the fragility.
    """
    lacking = [name for name in fragility.measures if name not in motions]
    if lacking:
        raise InputError(
            "hazard.measure_other",
            what=f"states {', '.join(motions)}, and no {', '.join(lacking)}",
            where="--hazard",
            expected=f"motions in {', '.join(fragility.measures)}, as the rock's fragility is over them",
            remedy="choose another --measure, or compute fields of that measure too",
        )
    if isinstance(fragility, Surface):
        return fragility.probability(motions)
    return fragility.probability(motions[fragility.measure])


def any_topples(rocks: Sequence[Standing], motions: Motions, states: ArrayLike | None = None) -> Array:
    """Probability that each event topples at least one of the rocks, (s, m) for each set of states.

    motions: mapping of (m, sites), by measure.
    states: (s, rocks), of `Exposure`; all rocks as now unless given.
    """
    wanted = np.full((1, len(rocks)), AS_NOW) if states is None else np.asarray(states)
    standing = np.zeros((len(wanted), len(next(iter(motions.values())))))
    for number, rock in enumerate(rocks):
        felt = {name: values[:, rock.site] for name, values in motions.items()}
        for state in np.unique(wanted[:, number]):
            if state in (AS_NOW, LESS_FRAGILE):
                factor = rock.since.factor if state == LESS_FRAGILE and rock.since else 1.0
                with np.errstate(divide="ignore"):
                    part = np.log1p(-topples(rock.fragility.less_fragile(factor), felt))
                standing[wanted[:, number] == state] += np.maximum(part, _LEAST_LOGARITHM)
    return -np.expm1(np.maximum(standing, _LEAST_LOGARITHM))


def together(curves: Sequence[Lognormal], intensity: ArrayLike) -> Array:
    """Probability that an event of a given intensity topples at least one of several rocks."""
    rocks = [Standing("", curve) for curve in curves]
    return any_topples(rocks, {curves[0].measure: np.asarray(intensity, float).reshape(-1, 1)})[0]


def toppling_rate(curves: Sequence[Lognormal], hazard: HazardCurve) -> float:
    """Annual rate of events that topple at least one of several rocks at a site.

    The rate above the hazard curve's last point has the probability at that point; events below its first are not
    counted (`unstated_fractions`).
    """
    intensity, rates = events_of_curves([hazard], [curve.median for curve in curves])
    return float(together(curves, intensity) @ rates[0])


def unstated_fractions(curves: Sequence[Lognormal], hazard: HazardCurve) -> tuple[float, float]:
    """Fractions of the toppling rate under the `continued` curve from below and above the stated points."""
    stated, whole = (toppling_rate(curves, curve) for curve in (hazard, continued(hazard, curves)))
    if not whole > 0:
        return 0.0, 0.0
    above = (1.0 - together(curves, hazard.intensity[-1:])[0]) * hazard.annual_rate[-1]
    return max(0.0, 1.0 - (stated + above) / whole), float(above / whole)


def rates_by_state(rocks: Sequence[Standing], groups: Sequence[Group], states: NDArray[np.int8]) -> Array:
    """Annual rate of events that topple at least one of the rocks, for each branch and set of states (branches, s)."""
    found = np.empty((sum(len(group.numbers) for group in groups), len(states)))
    for group in groups:
        found[group.numbers] = group.rates @ any_topples(rocks, group.motions, states).T
    return found


def survivals(rocks: Sequence[Standing], events: EventSet, exposure: Exposure) -> Array:
    """Probability that all rocks still stand under each branch and, last, under the mean hazard."""
    return np.array([exposure.survival(row) for row in rates_by_state(rocks, events.groups, exposure.states)])


def inconsistent_rate(
    rocks: Sequence[Standing], intensity: ArrayLike, exposure: Exposure, confidence: float = 0.95
) -> Array:
    """Annual rate of exceedance above which an intensity is inconsistent under any hazard curve.

    Fragility rises with intensity, so the toppling rate is at least F(x) lambda(x), and the rocks' survival
    at most exp(-F(x) lambda(x) T). The result is the rate at which that bound is 1 - confidence; infinite where
    F(x) is 0.
    """
    motions = {rocks[0].fragility.measures[0]: np.asarray(intensity, float).reshape(-1, 1)}
    topple = any_topples(rocks, motions, exposure.states)
    return np.array([greatest_rate(row, 1.0 - confidence) for row in topple.T @ exposure.years])


def unexceeded(curves: Sequence[Lognormal], confidence: float = 0.95) -> float:
    """Intensity that no event has exceeded, at a confidence, since the rocks stand: F(x) = confidence.

    Needs neither an age nor a hazard curve. Infinite where the probability stays below the confidence.
    """
    low, high = (min(curve.intensity(share) for curve in curves) for share in (1e-9, confidence))
    if len(curves) == 1 or math.isinf(high):
        return high
    return float(brentq(lambda x: together(curves, x)[0] - confidence, low, high * (1 + 1e-9)))


def greatest_rate(exposure: Array, chance: float) -> float:
    """Rate at which the mean of exp(-rate x exposure) over draws falls to `chance`; infinite without exposure."""
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


def scale_factors(rocks: Sequence[Standing], events: EventSet, exposure: Exposure, chance: float) -> Array:
    """Largest scale factor of motions with a survival probability of `chance`, for each branch and the mean hazard.

    Infinite where there are so few events that survival never falls so low; 0 where no factor is small enough.
    """
    found = np.empty(len(events.branches) + 1)
    for group in events.groups:
        felt = _felt(rocks, group) if events.sampled else group
        for row, number in enumerate(group.numbers):
            rate = felt.rates[row]

            def above(log_factor: float, felt: Group = felt, rate: Array = rate) -> float:
                topple = any_topples(_scaled(rocks, log_factor), felt.motions, exposure.states)
                return exposure.survival(topple @ rate) - chance

            found[number] = _largest_factor(above)
    return found


def _scaled(rocks: Sequence[Standing], log_factor: float) -> list[Standing]:
    """Rocks whose fragility under unscaled motions is that under motions scaled by a factor."""
    factor = math.exp(-log_factor)
    return [replace(rock, fragility=rock.fragility.less_fragile(factor)) for rock in rocks]


def _largest_factor(above: Callable[[float], float]) -> float:
    """Factor at which a decreasing function of its logarithm is 0; infinite or 0 outside the search range."""
    if above(_FURTHEST) > 0:
        return math.inf
    if above(-_FURTHEST) < 0:
        return 0.0
    return math.exp(brentq(above, -_FURTHEST, _FURTHEST, xtol=1e-8))


def _felt(rocks: Sequence[Standing], group: Group) -> Group:
    """Group without the events that topple nothing even at ten times the motion."""
    return group.chosen(any_topples(_scaled(rocks, math.log(10.0)), group.motions)[0] > ROUNDING)


@dataclass(frozen=True, eq=False)
class Draws:
    """Results in each draw of the uncertain quantities."""

    carries: tuple[str, ...]  # varied quantities: event, fragility, age, joint rate
    # (draws, branches), the mean hazard last: expected number of topplings since the rocks stand (survival is
    # exp(-topplings)), and scale factors of motions.
    topplings: Array
    factors: Array


def drawn_together(rocks: Sequence[Standing]) -> list[list[Any]]:
    """Fragilities of all rocks in each common resample; empty unless all rocks have resampled fragilities."""
    drawn = [rock.drawn for rock in rocks]
    return [list(draw) for draw in zip(*drawn, strict=False)] if all(drawn) else []


def draws_of(rocks: Sequence[Standing], events: EventSet, exposure: Exposure, chance: float) -> Draws | None:
    """Results in draws of all uncertain quantities; None where there are none."""
    known, count = drawn_together(rocks), exposure.years.shape[1]
    vary = {
        "event": events.sampled, "fragility": bool(known), "age": count > 1,
        "joint rate": bool(events.readings),
    }  # fmt: skip
    if not any(vary.values()):
        return None
    curves = known or [[rock.fragility for rock in rocks]] * SAMPLES
    levels = ((np.arange(len(curves)) + 0.5) * count / len(curves)).astype(int)
    ages = exposure.years[:, np.random.default_rng(0).permutation(levels)]  # independent of the resamples
    found = [
        _draw_of(
            [replace(rock, fragility=fragility) for rock, fragility in zip(rocks, fragilities, strict=True)],
            events, number, (exposure.states, years), chance,
        )
        for number, (fragilities, years) in enumerate(zip(curves, ages.T, strict=True))
    ]  # fmt: skip
    topplings, factors = (np.array(rows) for rows in zip(*found, strict=True))
    return Draws(tuple(name for name, varies in vary.items() if varies), topplings, factors)


def _draw_of(
    rocks: Sequence[Standing],
    events: EventSet,
    number: int,
    stood: tuple[NDArray[np.int8], Array],
    chance: float,
) -> tuple[Array, Array]:
    """Expected topplings and scale factors (survival `chance`) of a draw, for each branch and, last, the mean hazard.

    Factors are interpolated on a logarithmic grid, computed once for all branches with common events.

    stood: states of the rocks, and the years in each.
    """
    random = np.random.default_rng(number)
    groups = []
    for group in events.drawn_groups[number % len(events.drawn_groups)]:
        if events.sampled:
            felt = _felt(rocks, group)
            group = replace(felt, rates=felt.rates * random.poisson(1.0, felt.rates.shape))
        groups.append(group)
    places = {of: (group, row) for group in groups for row, of in enumerate(group.numbers)}
    states, years = stood
    known: dict[tuple[int, int], Array] = {}

    def topplings(of: int, step: int) -> float:
        if of not in places:  # the mean hazard
            return float(events.prior @ [topplings(branch, step) for branch in range(len(events.branches))])
        group, row = places[of]
        if (key := (id(group), step)) not in known:
            topple = any_topples(_scaled(rocks, _STEP * step), group.motions, states)
            known[key] = group.rates @ (years @ topple)
        return float(known[key][row])

    enough = -math.log(chance)
    rows = range(len(events.branches) + 1)
    factors = [_reached(partial(topplings, of), enough) for of in rows]
    return np.array([topplings(of, 0) for of in rows]), np.array(factors)


def _reached(topplings: Callable[[int], float], enough: float) -> float:
    """Scale factor at which the expected topplings reach `enough`; infinite or 0 outside the search range."""
    high = math.ceil(_FURTHEST / _STEP)
    low = -high
    if topplings(high) < enough:
        return math.inf
    if topplings(low) >= enough:
        return 0.0
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if topplings(middle) >= enough else (middle, high)
    if not topplings(low) > 0:
        return math.exp(_STEP * high)
    below, above = math.log(topplings(low)), math.log(topplings(high))
    return math.exp(_STEP * (low + (math.log(enough) - below) / (above - below)))


@dataclass(frozen=True)
class RandomRock:
    """Fragility of a random rock drawn from those of a site."""

    # Its variance is that of the mixture of the rocks' curves: variance between medians plus mean variance within.
    curve: Lognormal
    # Root mean square of the rocks' betas, and standard deviation of the logarithms of their medians.
    beta_within: float
    beta_between: float
    # 95 %, over resampled records; None where not all rocks have resamples.
    median_interval: tuple[float, float] | None
    # Lower bound of the median, where some rock's median lies beyond its strongest shaking; else None.
    beyond: float | None


def random_rock(rocks: Sequence[Standing]) -> RandomRock | None:
    """Fragility of a random rock over one measure; None for fewer than two rocks, or where one never topples."""
    curves = [rock.curve for rock in rocks]
    if len(curves) < 2 or not all(math.isfinite(curve.median) for curve in curves):
        return None
    logs = np.log([curve.median for curve in curves])
    shaken = np.array([curve.strongest_shaken or math.inf for curve in curves])
    beyond = float(np.exp(np.minimum(logs, np.log(shaken)).mean())) if (logs > np.log(shaken)).any() else None
    within = math.sqrt(np.mean([curve.beta**2 for curve in curves]))
    between = float(np.std(logs, ddof=1))
    curve = Lognormal(curves[0].measure, math.exp(logs.mean()), math.hypot(within, between))
    known = drawn_together(rocks)
    if not known:
        return RandomRock(curve, within, between, None, beyond)
    medians = [math.exp(np.mean([math.log(curve.median) for curve in drawn])) for drawn in known]
    low, high = ends(np.array(medians))
    return RandomRock(curve, within, between, (float(low), float(high)), beyond)
