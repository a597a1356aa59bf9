"""Export of a hazard as OpenQuake realisations, with the posterior weights."""

import csv
import io
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

from toppling.models.arrays import Array
from toppling.models.files.csv_text import plain
from toppling.models.files.folder import write_text
from toppling.results.hazard.curves import probability_of
from toppling.results.hazard.measure_names import UNSCALED, imt_of
from toppling.results.hazard.tree import FRACTILES, statistics_of
from toppling.results.hazard.update import Update

_YEARS_OF_RATES = 50.0
"""Investigation time of the probabilities written for annual rates, years: OpenQuake's files state no rates."""
_YEARS_OF_EVENTS = 1.0
"""Investigation time of the probabilities written for a set of events, years."""


@dataclass(frozen=True, eq=False)
class _Curves:
    """Rates of one measure: branches, updated mean and fractiles, by OpenQuake's kind; a row per site."""

    measure: str
    levels: Array
    sites: Sequence[tuple[str, tuple[float, float]]]
    rates: Mapping[str, Array]


def write_openquake(update: Update, folder: Path, ratio: float = 1.0) -> Iterator[Path]:
    """Write realizations.csv with the posterior weights, each branch's curve, and their updated mean and fractiles.

    Curves of a set of events are counted at the rocks' sites, with probabilities in `_YEARS_OF_EVENTS`, so that
    their mean over branches is that of the rates.

    update: update whose sites have coordinates.
    folder: output folder, created if absent.
    ratio: factor by which the hazard's motions were multiplied; the files are for its original component.
    Yields each file once it is complete.
    """
    tree, events, weights = update.tree, update.events, update.posterior
    assert weights is not None
    branches = tree.branches if tree else events.branches
    own_numbers = [getattr(branch, "number", None) for branch in branches]
    numbers = [number if own is None else own for number, own in enumerate(own_numbers)]
    paths = [getattr(branch, "path", "") or branch.name for branch in branches]
    places = list(dict.fromkeys(rock.site for rock in update.rocks))
    sites = [(site.name, site.place or (0.0, 0.0)) for site in map(events.sites.__getitem__, places)]
    if tree:
        sites = [(tree.site_name, tree.site or (0.0, 0.0))]
    curves = []
    for measure in update.rocks[0].fragility.measures:
        levels, rates = update.counted(measure, places)
        after = [
            statistics_of(levels, at_site, weights, tree.years if tree else None)
            for at_site in rates.swapaxes(0, 1)
        ]
        kinds = _kinds(numbers, rates, np.array([statistics.mean for statistics in after]), {
            q: np.array([statistics.fractiles[q] for statistics in after]) for q in FRACTILES
        })  # fmt: skip
        own = levels if measure in UNSCALED else levels / ratio
        curves.append(_Curves(measure, own, sites, kinds))
    years = _YEARS_OF_EVENTS if tree is None else tree.years or _YEARS_OF_RATES
    yield from _write(folder, dict(zip(numbers, paths, strict=True)), weights, curves, years)


def _kinds(
    numbers: Sequence[int], rates: Array, mean: Array,
    fractiles: Mapping[float, Array],
) -> dict[str, Array]:  # fmt: skip
    """Rates (sites, levels) by OpenQuake's name of their kind of curve."""
    kinds = {f"rlz-{number:03}": rate for number, rate in zip(numbers, rates, strict=True)}
    return kinds | {"mean": mean} | {f"quantile-{q:g}": rate for q, rate in fractiles.items()}


def _write(
    folder: Path, branches: Mapping[int, str], weights: Array, measures: Sequence[_Curves],
    years: float,
) -> Iterator[Path]:  # fmt: skip
    mark = zlib.crc32(repr([list(weights), list(branches.values())]).encode())
    common = f"generated_by='toppling {version('toppling')}', checksum={mark}"
    rows = [["rlz_id", "branch_path", "weight"]]
    for (number, path), weight in zip(branches.items(), weights, strict=True):
        rows.append([str(number), path, f"{weight:.7e}"])
    yield _written(folder / "realizations.csv", common, rows)
    for curves in measures:
        imt, per_si = imt_of(curves.measure)
        named = any(name for name, _ in curves.sites)
        head = ["custom_site_id"] * named + [
            "lon",
            "lat",
            "depth",
            *(f"poe-{x:.7f}" for x in curves.levels * per_si),
        ]
        for kind, rates in curves.rates.items():
            header = f"{common}, kind='{kind}', investigation_time={years}, imt='{imt}'"
            lines = [
                [plain(name)] * named + [f"{degree:.5f}" for degree in place] + ["0.00000"]
                + [f"{poe:.6E}" for poe in probability_of(rate, years)]
                for (name, place), rate in zip(curves.sites, rates, strict=True)
            ]  # fmt: skip
            file = (
                kind.replace("quantile", "quantile_curve") if "quantile" in kind else f"hazard_curve-{kind}"
            )
            yield _written(folder / f"{file}-{imt}.csv", header, [head, *lines])


def _written(target: Path, header: str, rows: list[list[str]]) -> Path:
    """Write a file in the engine's format: the first line ends with one quoted cell of key-value pairs."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    first = "#" + "," * (len(rows[0]) - 1) + f'"{header}"\n'
    return write_text(first + text.getvalue(), target)
