"""One fragility of a site from several rocks: that of a rock drawn at random from among those like them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from toppling.results.analysis.lognormal import Lognormal
from toppling.results.hazard.draws import draws_of
from toppling.results.hazard.survival import Standing


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
