"""A hazard written back as OpenQuake's realisations, with the weights that the rocks give them."""

import csv
import io
import zlib
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from toppling.models.csv_text import plain
from toppling.models.folder import new_file
from toppling.results.hazard.curves import probability_of
from toppling.results.hazard.measures import imt_of
from toppling.results.hazard.tree import common_levels
from toppling.results.hazard.update import Update

YEARS_OF_RATES = 50.0
"""Investigation time of probabilities that rates are written as; the engine states no rates."""


def write_openquake(update: Update, folder: Path, ratio: float = 1.0) -> Iterator[Path]:
    """Write realizations.csv with the Bayes weights, the curve of each branch, and their updated mean and fractiles.

    Parameters
    ----------
    update : Update
        Its curves state their site.
    folder : Path
        Made if absent.
    ratio : float
        By which the hazard's motions were multiplied: the files are for its own component again.

    Yields
    ------
    Path
        Each file, once it is complete.
    """
    assert update.posterior is not None
    assert update.after is not None
    folder.mkdir(parents=True, exist_ok=True)
    tree, (imt, per_si) = update.tree, imt_of(update.tree.measure)
    years = tree.years or YEARS_OF_RATES
    mark = zlib.crc32(repr([list(update.posterior), [branch.name for branch in tree.branches]]).encode())
    common = f"generated_by='toppling {version('toppling')}', checksum={mark}"
    rows = [["rlz_id", "branch_path", "weight"]]
    numbers = [
        number if branch.number is None else branch.number for number, branch in enumerate(tree.branches)
    ]
    for number, branch, weight in zip(numbers, tree.branches, update.posterior, strict=True):
        rows.append([str(number), branch.path or branch.name, f"{weight:.7e}"])
    yield _written(folder / "realizations.csv", common, rows)
    levels, rates = common_levels(tree.curves)
    kinds: list[tuple[str, str, NDArray[np.float64]]] = [
        (f"hazard_curve-rlz-{number:03}-{imt}", f"rlz-{number:03}", rate)
        for number, rate in zip(numbers, rates, strict=True)
    ]
    kinds.append((f"hazard_curve-mean-{imt}", "mean", update.after.mean))
    kinds += [
        (f"quantile_curve-{q:g}-{imt}", f"quantile-{q:g}", rate) for q, rate in update.after.fractiles.items()
    ]
    head = ["lon", "lat", "depth", *(f"poe-{level:.7f}" for level in levels * per_si / ratio)]
    site = [f"{degree:.5f}" for degree in tree.site or (0.0, 0.0)]
    if tree.site_name:
        head, site = ["custom_site_id", *head], [plain(tree.site_name), *site]
    for name, kind, rate in kinds:
        header = f"{common}, kind='{kind}', investigation_time={years}, imt='{imt}'"
        row = [*site, "0.00000", *(f"{poe:.6E}" for poe in probability_of(rate, years))]
        yield _written(folder / f"{name}.csv", header, [head, row])


def _written(target: Path, header: str, rows: list[list[str]]) -> Path:
    """A file as the engine writes it: its first line ends with one quoted cell of pairs."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    first = "#" + "," * (len(rows[0]) - 1) + f'"{header}"\n'
    with new_file(target) as hidden:
        hidden.write_text(first + text.getvalue(), encoding="utf-8")
    return target
