"""A constraint as a folder: page, statement, tables, figures, and the hazard with its new weights."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd

from toppling.models.files.csv_text import write_csv
from toppling.models.files.folder import write_text
from toppling.results.analysis.constraint import Constraint
from toppling.results.analysis.exchange import write_curves
from toppling.results.drawing.constraint_figures import constraint_figure
from toppling.results.drawing.hazard_figures import events_figure, hazard_figure
from toppling.results.drawing.report.constraint_page import constraint_page, event_page, unfinished
from toppling.results.drawing.style import save
from toppling.results.hazard.event_update import EventUpdate
from toppling.results.hazard.export import write_event_openquake, write_openquake

_OF_EVENTS = ("measure", "source", "events", "years_of_each_branch", "hazard_ratio")
"""What a statement under a set of events says of it."""


def write_constraint(
    constraint: Constraint, statement: dict[str, Any], folder: Path, ratio: float = 1.0
) -> Iterator[Path]:
    """Write all of a constraint into a folder.

    Parameters
    ----------
    statement : dict
        Its statement, with the choices that led to it.
    folder : Path
        Made if absent; files of the same names are replaced.
    ratio : float
        By which the hazard's motions were multiplied.

    Yields
    ------
    Path
        Each file, once it is complete.
    """
    yield from _write_statement(statement, constraint.tables(), folder)
    update = constraint.update
    if constraint.bound is not None:
        branches = update.tree.branches if update else ()
        drawn = constraint_figure(
            constraint.bound, branches, constraint.confidence, constraint.branches, constraint.rocks
        )
        yield from save(drawn, folder / "constraint")
    if update is not None:
        yield from save(hazard_figure(update), folder / "hazard")
        if len(update.tree.branches) > 1 and update.posterior is not None and update.tree.site is not None:
            yield from write_openquake(update, folder / "openquake", ratio)
    if constraint.random_rock is not None:
        yield write_curves(folder / "random_rock.json", [constraint.random_rock.curve], "random rock")
    yield write_text(constraint_page(constraint, statement), folder / "constraint.html")


def write_events(
    update: EventUpdate,
    statement: dict[str, Any],
    tables: dict[str, pd.DataFrame],
    folder: Path,
    ratio: float = 1.0,
) -> Iterator[Path]:
    """Write all that rocks say under a set of events into a folder: statement, tables, figure, page and realisations.

    Parameters
    ----------
    statement : dict
        With the choices that led to it.
    tables : dict of DataFrame
        By name: branches, updated and others of the statement.
    folder : Path
        Made if absent; files of the same names are replaced.
    ratio : float
        By which the motions were multiplied.

    Yields
    ------
    Path
        Each file, once it is complete.
    """
    yield from _write_statement(statement, tables, folder)
    placed = all(update.events.sites[rock.site].place for rock in update.rocks)
    if placed and len(update.events.branches) > 1 and update.posterior is not None:
        yield from write_event_openquake(update, folder / "openquake", ratio)
    figure = events_figure(tables["branches"], tables.get("updated"), statement["confidence"])
    yield from save(figure, folder / "constraint", unfinished(statement))
    yield write_text(event_page(statement, tables), folder / "constraint.html")


def _write_statement(
    statement: dict[str, Any], tables: dict[str, pd.DataFrame], folder: Path
) -> Iterator[Path]:
    yield write_text(json.dumps(statement, indent=1, allow_nan=False) + "\n", folder / "constraint.json")
    for name, table in (tables | {"choices": _choices_table(statement)}).items():
        yield write_csv(table, folder / f"{name}.csv")


def _choices_table(statement: dict[str, Any]) -> pd.DataFrame:
    """Every choice, file and number of branches, a row each, for who files the statement."""
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
