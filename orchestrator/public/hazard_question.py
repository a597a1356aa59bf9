"""Hazard as it is asked for: paths with weights, a site by place or name, and the one tree that is meant."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from toppling.models.errors import InputError, UsageError
from toppling.models.files.csv_text import is_numeral
from toppling.models.motions.measures import COMPARED
from toppling.results.hazard.readers import Hints, read_hazard
from toppling.results.hazard.readers.assembly import chosen_tree
from toppling.results.hazard.tree import HazardTree

DEFAULT_MEASURES = ("pgv_m_s", "pga_m_s2")
"""The measure of a constraint, where hazard and rocks have several: the first of these, then of `COMPARED`."""


def weighted_paths(texts: Sequence[str]) -> tuple[list[Path], list[float] | None]:
    """Paths of PATH or PATH=WEIGHT, and their weights; None where none has one.

    Raises UsageError if a weight is no positive number.
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
                f"the weight of {path} is {weight!r}",
                where=text, expected="a positive number", remedy="give FILE=WEIGHT, such as mean.csv=0.6",
            )  # fmt: skip
        paths.append(Path(path))
        weights.append(share)
    if weights and len(weights) < len(paths):
        raise InputError(
            what=f"{len(weights)} of {len(paths)} paths have a weight", where="--hazard",
            expected="a weight for each, or for none", remedy="give each --hazard as PATH=WEIGHT",
        )  # fmt: skip
    total = math.fsum(weights)
    if weights and abs(total - 1.0) > 1e-3:
        shares = ", ".join(f"{weight / total:.4g}" for weight in weights)
        raise InputError(
            what=f"the weights sum to {total:.6g}", where="--hazard", expected="weights that sum to 1",
            remedy=f"give all branches of the tree; if these are all, their weights are {shares}",
        )  # fmt: skip
    return paths, weights or None


@dataclass(frozen=True)
class HazardQuestion:
    """What is asked of a hazard."""

    site: tuple[float, float] | str | None = None  # (longitude, latitude)
    ratio: float = 1.0  # peak of the horizontal vector over the hazard's horizontal component
    measure: str | None = None  # column of the results
    # Time that values are probabilities over, 0 for annual rates, where files do not say.
    years: float | None = None


def read_tree(texts: Sequence[str], asked: HazardQuestion, rocks: Sequence[str] = COMPARED) -> HazardTree:
    """The one tree that --hazard, --site and --measure mean, over a measure that rocks have a fragility over."""
    paths, weights = weighted_paths(texts)
    trees = read_hazard(paths, weights, Hints(asked.site, asked.measure, asked.years))
    where = texts[0] if len(texts) == 1 else "--hazard"
    measure = asked.measure or shared_measure([tree.measure for tree in trees], rocks, "--hazard")
    chosen = chosen_tree(trees, measure, asked.site, where)
    if isinstance(asked.site, tuple) and chosen.site is None:
        raise UsageError(
            "it selects a place, and these curves state none", where="--site", expected="files that state places",
            remedy="leave --site out",
        )  # fmt: skip
    return chosen.stronger(asked.ratio) if asked.ratio != 1.0 else chosen


def shared_measure(stated: Sequence[str], rocks: Sequence[str], where: str) -> str:
    """First of the usual measures, then of the rocks', that a hazard states and the rocks have a fragility over."""
    for name in (*DEFAULT_MEASURES, *rocks):
        if name in stated and name in rocks:
            return name
    raise InputError(
        what=f"the hazard is over {', '.join(sorted(set(stated)))}, the rock's fragility over "
        f"{', '.join(rocks) or 'nothing'}",
        where=where, expected="hazard over a measure that the rock has a fragility over",
        remedy="give curves, or motions, over one of the rock's measures",
    )  # fmt: skip
