"""How likely drawn bases are: by their kind (flat, rough, rounded) and the rim that was seen, and by pull tests."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import brentq
from scipy.special import logsumexp

from toppling.models.arrays import Array, effective_number
from toppling.models.hidden_base.gap import Base, GapDraw, Relief, flat_log_likelihood, side_raised
from toppling.models.hidden_base.observed import (
    LEVEL_PER_WIDTH,
    ROUGH_LENGTH_PER_WIDTH,
    HiddenPart,
)
from toppling.models.scan.hints_file import FLAT, KINDS, ROUGH, ROUNDED

EFFECTIVE_SHARE = 0.2
"""Least share of a kind's draws that their weights leave effective: costs of a Gaussian prior, which no base follows so
closely. Of .1 to .7 that which held most of nine rocks of four families (benchmarks/reports/scan.md)."""
BEFORE = {FLAT: 0.2, ROUGH: 0.4, ROUNDED: 0.4}
"""How likely each kind is before anything was seen."""
_EVIDENCE_SHARE = 0.15
"""Power to which the rim's likelihood is taken: errors of neighbouring places are not independent."""
_EDGE_PER_WIDTH, _EDGE_LENGTH_PER_WIDTH, _EDGE_ROUGH_PER_WIDTH = 0.008, 0.5, 0.0005
"""Edge of a flat base, over the root of its area: how high it is broken, over what length, and how rough it is."""
_BOWL_PER_WIDTH = 0.05
"""Standard deviation of the rise of a rounded base to its outline, over the root of its area."""
_ROUNDED_PER_WIDTH = (
    (0.006, 0.7, (1.5,)),
    (0.006, 0.7, (2.0,)),
    (0.006, 0.7, (4.0,)),
    (0.012, 0.7, (2.0, 4.0)),
    (0.048, 2.0, (2.0, 4.0)),
)
"""Priors of a rounded base: relief and its length, over the root of its area, and the bowl's powers."""
_ROUNDED_ROUGH_PER_WIDTH = 0.002
_ROUNDED_SLOPE = 0.05
"""Standard deviation of a rounded base's slope: where its weight is decided how it lies, and not its shape."""


def bowls(width_m: float) -> list[Relief]:
    """Priors of the gap below a rounded base."""
    return [
        Relief(
            LEVEL_PER_WIDTH * width_m,
            shape * width_m,
            length * width_m,
            _ROUNDED_ROUGH_PER_WIDTH * width_m,
            ROUGH_LENGTH_PER_WIDTH * width_m,
            bowl_m=_BOWL_PER_WIDTH * width_m,
            bowl_powers=powers,
            slope=_ROUNDED_SLOPE,
        )
        for shape, length, powers in _ROUNDED_PER_WIDTH
    ]


def flat_draws(part: HiddenPart, base: Base, count: int) -> list[GapDraw]:
    """A base that lies on its pedestal wherever what was seen allows it, for each of so many lines of the weight.

    base: the smooth closing, for what hangs beyond the errors of the rim.
    """
    seen, width_m = part.observed, part.width_m
    edge = Relief(
        0.0,
        _EDGE_PER_WIDTH * width_m,
        _EDGE_LENGTH_PER_WIDTH * width_m,
        _EDGE_ROUGH_PER_WIDTH * width_m,
        ROUGH_LENGTH_PER_WIDTH * width_m,
    )
    gap_m = np.maximum(base.grid.at(base.height_m, seen.places_m) + seen.means_m[-1], seen.floor_m)
    gap_m[seen.known[seen.floor_m[seen.known] <= 0.0]] = 0.0
    gap_m[seen.touching] = 0.0
    likelihood = flat_log_likelihood(seen, edge)
    return [
        GapDraw(side_raised(gap_m, seen, number), likelihood, number, FLAT, likelihood)
        for number in range(count)
    ]


def fractions_by_evidence(gaps: Sequence[GapDraw]) -> dict[str, float]:
    """How likely each kind is by the rim that was seen; their sum is 1.

    The rim does not tell a rough base from a rounded one: the noise of its places decides which fits, not their shape.
    What a draw costs to be brought to stand is left out: a rim does not tell a flat base from one that is rough by less
    than it resolves, on which a rock stands at some cost. A kind without any candidate is impossible.
    """
    likelihood = np.array([gap.log_likelihood for gap in gaps])
    kind = np.array([gap.kind for gap in gaps])
    found = [name for name in KINDS if (kind == name).any()]
    evidence = [logsumexp(likelihood[kind == name]) - np.log((kind == name).sum()) for name in found]
    relative = _EVIDENCE_SHARE * (np.array(evidence) - np.max(evidence))
    bent = np.array([name != FLAT for name in found])
    relative[bent] = relative[bent].max(initial=-np.inf)
    logs = relative + np.log([BEFORE[name] for name in found])
    return dict(zip(found, np.exp(logs - logsumexp(logs)).tolist(), strict=True))


def mixed_weights(gaps: Sequence[GapDraw], fractions: Mapping[str, float]) -> Array:
    """Weights (n,) of candidates, of which each kind has its share; within it they are those of its priors.

    The rim tells priors of a kind from each other as little as it tells the kinds.
    """
    likelihood = np.array([gap.log_likelihood for gap in gaps])
    log_weight = np.array([gap.log_weight for gap in gaps]) - (1.0 - _EVIDENCE_SHARE) * likelihood
    kind = np.array([gap.kind for gap in gaps])
    weight = np.zeros(len(gaps))
    for name, share in fractions.items():
        of_kind = kind == name
        if of_kind.any():
            count = int(of_kind.sum())
            own = conditioned(
                np.ones(count), log_weight[of_kind] - log_weight[of_kind].max(), EFFECTIVE_SHARE * count
            )
            weight[of_kind] = share * own / own.sum()
    return weight


OTHER_ERRORS_SHARE = 0.1
"""Standard deviation of the toppling acceleration that no draw shows: with it 90 % intervals hold 90 % of the azimuths
of 13 rocks of four families, and 97 % of 12 rocks of four others (benchmarks/scan_coverage.py)."""
_PULL_STD_SHARE = float(np.hypot(0.05, OTHER_ERRORS_SHARE))
"""How well a pull or tilt test tells the ratio that a draw bears: 5 % of the force's direction, height and reading
together, and what the draw itself is off by."""
Pulls = Sequence[tuple[float, float]]


def pulls_log_likelihood(pulls: Pulls, ratios: Array) -> Array:
    """How likely (n,) draws with such ratios (n, pulls) make what was measured, the likeliest 0, as logarithm."""
    measured = np.array([ratio for _, ratio in pulls])
    squares = (((ratios / measured - 1.0) / _PULL_STD_SHARE) ** 2).sum(axis=1)
    return np.asarray(-0.5 * (squares - squares.min()))


def conditioned(weight: Array, log_likelihood: Array, enough: float) -> Array:
    """Weights (n,) of draws by what was measured, tempered where it would leave next to none of them.

    Draws are few where many pulls meet, or near the ends of the interval. The likelihood then counts to that power with
    which enough draws are left: no interval rests on the few that happen to lie nearest.

    enough: effective number of draws, or half of theirs if that is less.
    """
    least = min(enough, 0.5 * effective_number(weight))

    def spare(power: float) -> float:
        return effective_number(weight * np.exp(power * log_likelihood)) - least

    power = 1.0 if spare(1.0) >= 0.0 else brentq(spare, 0.0, 1.0)
    return np.asarray(weight * np.exp(power * log_likelihood))
