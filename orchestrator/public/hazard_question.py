"""Parsed request for a constraint: weighted hazard files, sites, measures, ages; and reading of the selected tree."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from toppling.models.arrays import Array
from toppling.models.errors import InputError, UsageError
from toppling.models.files.csv_text import is_numeral
from toppling.models.motions.measures import COMPARED
from toppling.results.analysis.lognormal import SURFACES
from toppling.results.hazard.ages import Since, joint_ages
from toppling.results.hazard.measure_names import is_spectral
from toppling.results.hazard.readers import Hints, read_hazard
from toppling.results.hazard.readers.assembly import chosen_tree
from toppling.results.hazard.readers.event_sets import is_event_set
from toppling.results.hazard.tree import HazardTree

_DEFAULT_MEASURES = ("pgv_m_s", "pga_m_s2")
"""Preferred measures of a constraint if hazard and rocks have several in common, before those of `COMPARED`."""


def _weighted_paths(texts: Sequence[str]) -> tuple[list[Path], list[float] | None]:
    """Parse PATH or PATH=WEIGHT to paths and weights, None without weights.

    Raises UsageError if a weight is not a positive number.
    Raises InputError if only some have weights, or they do not sum to 1.
    """
    paths, weights = [], []
    for text in texts:
        path, sign, weight = text.rpartition("=")
        if not sign or Path(text).exists():
            paths.append(Path(text))
            continue
        share = float(weight) if is_numeral(weight) else math.nan
        if not 0 < share < math.inf:
            raise UsageError(
                "hazard.weight_unusable",
                f"the weight of {path} is {weight!r}",
                where=text,
                expected="a positive number",
                remedy="give FILE=WEIGHT, such as mean.csv=0.6",
            )
        paths.append(Path(path))
        weights.append(share)
    if weights and len(weights) < len(paths):
        raise InputError(
            "hazard.weights_incomplete",
            what=f"{len(weights)} of {len(paths)} paths have a weight",
            where="--hazard",
            expected="a weight for each, or for none",
            remedy="give each --hazard as PATH=WEIGHT",
        )
    total = math.fsum(weights)
    if weights and abs(total - 1.0) > 1e-3:
        scaled = ", ".join(f"{weight / total:.4g}" for weight in weights)
        raise InputError(
            "hazard.weights_sum",
            what=f"the weights sum to {total:.6g}",
            where="--hazard",
            expected="weights that sum to 1",
            remedy=f"give all branches of the tree; if these are all, their weights are {scaled}",
        )
    return paths, weights or None


@dataclass(frozen=True)
class HazardQuestion:
    """Selection of a hazard."""

    site: tuple[float, float] | str | None = None  # (longitude, latitude), or a name
    ratio: float = 1.0  # peak of the horizontal vector over the hazard's horizontal component
    measure: str | None = None  # column of the results, or two joined by +
    # Investigation time of probabilities, 0 for annual rates, for files that do not state it.
    years: float | None = None

    @property
    def measures(self) -> tuple[str, ...]:
        """Requested measures, two for `pga_m_s2+pgv_m_s`; InputError if unknown, or without a joint fragility."""
        names = tuple(part.strip() for part in self.measure.split("+")) if self.measure else ()
        unknown = any(name not in COMPARED and not is_spectral(name) for name in names)
        if unknown or (len(names) > 1 and names != SURFACES[0]):
            raise InputError(
                "measure.unknown",
                what=f"{self.measure!r} is not an intensity measure with a fragility",
                where="--measure",
                expected=f"one of {', '.join(COMPARED)}; sa_3s_m_s2, any period; or {'+'.join(SURFACES[0])}, "
                "both together",
                remedy="leave it out to use that of the hazard, or pgv_m_s",
            )
        return names


@dataclass(frozen=True)
class Dates:
    """Relations between the ages of rocks, and dates since which they have been as fragile as now.

    Parameters
    ----------
    common : bool
        All were uncovered together: one draw of their one age for all.
    common_error : float
        Standard deviation of a relative error that the rocks' dates share, such as 0.08 of a production rate.
    fragile_since : tuple of str
        Since when each rock has been as fragile as it is, AGE or AGE:FACTOR: before, it was buried, or its medians a
        FACTOR higher.
    """

    common: bool = False
    common_error: float = 0.0
    fragile_since: tuple[str, ...] = ()

    @property
    def together(self) -> bool:
        """Whether the rocks' ages are tied to each other."""
        return self.common or self.common_error > 0


@dataclass(frozen=True)
class EventOptions:
    """Options for events.

    Parameters
    ----------
    event_rate : float or None
        Annual rate of a scenario, which states none.
    catalogue_years : float or None
        Years that each branch's events were simulated for, where no file states them.
    correlation : float or None
        Of the residuals of PGA and PGV in one earthquake, for their two curves; 0.733 if not given.
    """

    event_rate: float | None = None
    catalogue_years: float | None = None
    correlation: float | None = None


@dataclass(frozen=True, eq=False)
class Question:
    """Request for a constraint by standing rocks, with one age and date per rock."""

    paths: tuple[Path, ...]
    ages: list[Array]
    ages_given: list[str]  # labels; empty where unknown
    since: list[Since | None]
    dates: Dates
    hazard: tuple[str, ...]
    asked: HazardQuestion
    events: EventOptions
    sites: Sequence[tuple[float, float] | str]
    confidence: float

    @property
    def dated(self) -> bool:
        """Whether ages are known."""
        return bool(np.isfinite(self.ages[0]).all())

    @cached_property
    def event_set(self) -> Path | None:
        """Set of events of the hazard, or None for curves; InputError if further files are given with a set."""
        paths, _ = _weighted_paths(self.hazard)
        sets = [path for path in paths if is_event_set(path)]
        if sets and len(paths) > 1:
            raise InputError(
                "events.given_with_others",
                what=f"{sets[0]} is a set of events, and {len(paths) - 1} more are given",
                where="--hazard",
                expected="one set of events, which has its own branches and weights",
                remedy="give it alone",
            )
        return sets[0] if sets else None

    @property
    def apart(self) -> bool:
        """Whether two measures are used jointly, which only single events support."""
        return len(self.asked.measures) > 1

    @cached_property
    def joint_ages(self) -> Array:
        """Joint draws of the ages, one column per rock."""
        return joint_ages(self.ages, self.dates.common, self.dates.common_error)


def read_tree(texts: Sequence[str], asked: HazardQuestion, rocks: Sequence[str] = COMPARED) -> HazardTree:
    """Tree selected by --hazard, --site and --measure, over a measure for which the rocks have a fragility."""
    paths, weights = _weighted_paths(texts)
    trees = read_hazard(paths, weights, Hints(asked.site, asked.measure, asked.years))
    where = texts[0] if len(texts) == 1 else "--hazard"
    measure = asked.measure or shared_measure([tree.measure for tree in trees], rocks, "--hazard")
    chosen = chosen_tree(trees, measure, asked.site, where)
    if isinstance(asked.site, tuple) and chosen.site is None:
        raise UsageError(
            "site.places_missing",
            "it selects a place, and these curves state none",
            where="--site",
            expected="files that state places",
            remedy="leave --site out",
        )
    return chosen.stronger(asked.ratio) if asked.ratio != 1.0 else chosen


def shared_measure(stated: Sequence[str], rocks: Sequence[str], where: str) -> str:
    """Measure common to a hazard and the rocks' fragilities: the first of the defaults, then of the rocks' order."""
    for name in (*_DEFAULT_MEASURES, *rocks):
        if name in stated and name in rocks:
            return name
    raise InputError(
        "hazard.measure_other",
        what=f"the hazard is over {', '.join(sorted(set(stated)))}, the rock's fragility over "
        f"{', '.join(rocks) or 'nothing'}",
        where=where,
        expected="hazard over a measure that the rock has a fragility over",
        remedy="give curves, or motions, over one of the rock's measures",
    )
