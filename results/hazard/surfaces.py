"""Fragility over one measure of intensity or over two together: what an event's motions topple."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import ndtr

from toppling.models.arrays import Array
from toppling.models.errors import InputError
from toppling.results.analysis.lognormal import Basis, Lognormal, Resampled
from toppling.results.analysis.regression import Fit

Motions = Mapping[str, Array]
"""Values of each measure, in its SI unit, of some events; 0 where an event is not felt."""


@dataclass(frozen=True)
class Surface:
    """Fragility over several measures: P(topple | x, y) = Phi(a + b ln x + c ln y)."""

    measures: tuple[str, ...]  # columns of the results
    coefficients: tuple[float, ...]  # a, then one slope a measure's natural logarithm
    basis: Basis | None = None  # where it is known; its strongest shaking is in the first measure
    # The same surface of resampled records, where it is known.
    resampled: Resampled | None = field(default=None, compare=False, repr=False)

    def probability(self, motions: Motions) -> Array:
        """Toppling probability of events; 0 where a measure with a slope above 0 is 0."""
        intercept, *slopes = self.coefficients
        with np.errstate(divide="ignore", invalid="ignore"):
            parts = [slope * np.log(motions[name]) for name, slope in zip(self.measures, slopes, strict=True)]
            score = intercept + sum(parts)
        felt = np.all([np.asarray(motions[name]) > 0 for name in self.measures], axis=0)
        return np.where(felt, ndtr(score), 0.0)

    def stouter(self, factor: float) -> "Surface":
        """The same surface with the motions that topple a factor stronger."""
        intercept, *slopes = self.coefficients
        return replace(self, coefficients=(intercept - sum(slopes) * math.log(factor), *slopes))


Fragility = Lognormal | Surface


def measures_of(fragility: Fragility) -> tuple[str, ...]:
    """Measures that a fragility is over."""
    return fragility.measures if isinstance(fragility, Surface) else (fragility.measure,)


def topples(fragility: Fragility, motions: Motions) -> Array:
    """Toppling probability of events, given their motions.

    Raises InputError if the motions lack a measure of the fragility.
    """
    lacking = [name for name in measures_of(fragility) if name not in motions]
    if lacking:
        raise InputError(
            what=f"states {', '.join(motions)}, and no {', '.join(lacking)}",
            where="--hazard",
            expected=f"motions in {', '.join(measures_of(fragility))}, as the rock's fragility is over them",
            remedy="choose another --measure, or compute fields of that measure too",
        )
    if isinstance(fragility, Surface):
        return fragility.probability(motions)
    return fragility.probability(motions[fragility.measure])


def stouter(fragility: Fragility, factor: float) -> Fragility:
    """Fragility of a rock that takes a factor stronger motions."""
    if isinstance(fragility, Surface):
        return fragility.stouter(factor)
    return replace(fragility, median=fragility.median * factor)


def surface_of(fitted: Fit) -> Surface | None:
    """Surface of a probit fit to several measures; None where it has none."""
    if fitted.problem or fitted.link != "probit":
        return None
    return Surface(fitted.measures, fitted.coefficients, resampled=fitted.resampled)


def drawn_surfaces(resampled: Resampled, measures: Sequence[str]) -> list[Surface]:
    """Surfaces of resampled records, in the order drawn; a sample without a fit topples at no motion."""
    found = iter(resampled.coefficients)
    never = Surface(tuple(measures), (-math.inf, *(0.0 for _ in measures)))
    return [
        Surface(tuple(measures), tuple(float(value) for value in next(found))) if has_fit else never
        for has_fit in resampled.fitted
    ]
