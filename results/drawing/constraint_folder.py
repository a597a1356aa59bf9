"""Export of a constraint to a folder: page, statement, tables, figures, and the hazard with posterior weights."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from toppling.models.files.csv_text import write_csv
from toppling.models.files.folder import write_text
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

_OF_EVENTS = ("measure", "source", "events", "years_of_each_branch", "hazard_ratio")
"""Keys of a statement that describe its set of events."""


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
        yield from write_openquake(update, folder / "openquake", ratio)


def _write(
    statement: dict[str, Any], tables: dict[str, pd.DataFrame], drawings: Sequence[Drawing], folder: Path
) -> Iterator[Path]:
    yield write_text(json.dumps(statement, indent=1, allow_nan=False) + "\n", folder / "constraint.json")
    for name, table in (tables | {"choices": _choices_table(statement)}).items():
        yield write_csv(table, folder / f"{name}.csv")
    for one in drawings:
        yield from save(one.draw(one.width_in), folder / one.stem, unfinished(statement))
    yield write_text(constraint_page(statement, drawings), folder / "constraint.html")


def _choices_table(statement: dict[str, Any]) -> pd.DataFrame:
    """Table of all options, input files and branch weights behind a statement, for archiving."""
    choices = statement.get("choices", {})
    rows = [("program", "", choices.get("program", ""))]
    rows += [("option", name, json.dumps(value)) for name, value in choices.get("options", {}).items()]
    events = {name: statement[name] for name in _OF_EVENTS if name in statement}
    rows += [
        ("hazard", name, json.dumps(value))
        for name, value in statement.get("hazard", events).items()
        if name != "files"
    ]
    rows += [("rock", rock["name"], _fragility(rock)) for rock in statement["rocks"]]
    rows += [
        ("branch", branch["name"], f"weight {branch['prior_weight']:.6g}")
        for branch in statement.get("branches", ())
    ]
    rows += [("file", one["path"], f"sha256 {one['sha256']}") for one in choices.get("files", ())]
    return pd.DataFrame(rows, columns=["kind", "name", "value"])


def _fragility(rock: dict[str, Any]) -> str:
    if "median" in rock:
        return f"median {rock['median']:.6g}, beta {rock['beta']:.6g}"
    return f"probit {', '.join(f'{value:.6g}' for value in rock['coefficients'])}"
