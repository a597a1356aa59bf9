"""Export of a constraint to a folder: page, statement, tables, figures, and the hazard with posterior weights."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

import pandas as pd

from toppling.models.files.csv_text import write_csv
from toppling.models.files.folder import new_file, write_text
from toppling.results.analysis.constraint import Constraint
from toppling.results.analysis.exchange import write_curves
from toppling.results.drawing.report.constraint_page import (
    Drawing,
    constraint_page,
    curve_drawings,
    event_drawings,
    unfinished,
)
from toppling.results.drawing.style import save
from toppling.results.hazard.export import write_openquake
from toppling.results.hazard.update import Update

_TABLES = ("branches", "updated", "changes")
"""Tables that are written as separate files; the statement contains all tables."""


def write_constraint(
    constraint: Constraint, statement: dict[str, Any], folder: Path, ratio: float = 1.0
) -> Iterator[Path]:
    """Write a constraint to a folder: page, statement, tables, figures, and the hazard with posterior weights.

    statement: the constraint's statement, with the options that produced it.
    folder: output folder, created if absent; files of the same names are replaced.
    ratio: factor by which the hazard's motions were multiplied.
    Yields each file, once it is complete.
    """
    yield from _write(statement, constraint.tables, curve_drawings(constraint, statement), folder)
    update = constraint.update
    if update:
        yield from _hazard_after(update, folder, ratio)
    if constraint.random_rock is not None:
        yield write_curves(folder / "random_rock.json", [constraint.random_rock.curve], "random rock")


def write_events(
    update: Update, statement: dict[str, Any], folder: Path, ratio: float = 1.0
) -> Iterator[Path]:
    """Write an update of a set of events to a folder (see `write_constraint`); yields each complete file."""
    yield from _write(statement, update.tables, event_drawings(statement, update.tables), folder)
    yield from _hazard_after(update, folder, ratio)


def _hazard_after(update: Update, folder: Path, ratio: float) -> Iterator[Path]:
    """Write the hazard with its posterior weights, if it has these and coordinates of its sites."""
    placed = all(update.events.sites[rock.site].place for rock in update.rocks)
    if placed and len(update.events.branches) > 1 and update.posterior is not None:
        target = folder / "openquake.zip"
        with (
            TemporaryDirectory() as made,
            new_file(target) as hidden,
            ZipFile(hidden, "w", ZIP_DEFLATED) as archive,
        ):
            for file in write_openquake(update, Path(made), ratio):
                archive.write(file, file.name)
        yield target


def _write(
    statement: dict[str, Any], tables: dict[str, pd.DataFrame], drawings: Sequence[Drawing], folder: Path
) -> Iterator[Path]:
    yield write_text(json.dumps(statement, indent=1, allow_nan=False) + "\n", folder / "constraint.json")
    for name in _TABLES:
        if name in tables:
            yield write_csv(tables[name], folder / f"{name}.csv")
    for drawing in drawings:
        yield from save(drawing.draw(drawing.width_in), folder / drawing.stem, unfinished(statement))
    yield write_text(constraint_page(statement, drawings), folder / "constraint.html")
