"""The page of a constraint, by curves of hazard or a set of events, and the folder with its tables and figures."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

import pandas as pd
from matplotlib.figure import Figure

from toppling.models.files.documents import MOST_SHOWN
from toppling.models.files.folder import new_file, write_text
from toppling.models.files.table import write_csv
from toppling.results.analysis.constraint import Constraint
from toppling.results.analysis.exchange import write_curves
from toppling.results.drawing.hazard_figures import (
    MOST_PANELS,
    constraint_figure,
    events_figure,
    hazard_figure,
)
from toppling.results.drawing.sentences import (
    ages_words,
    answer,
    by_site_and_measure,
    percent,
    rate_words,
    what_it_rests_on,
    with_ends,
)
from toppling.results.drawing.style import (
    FULL_WIDTH_IN,
    HALF_WIDTH_IN,
    digits,
    printed_unit,
    save,
    short_name,
)
from toppling.results.drawing.templates import Block, Document, rendered
from toppling.results.hazard.update import Update, write_openquake
from toppling.results.reader import Completeness


@dataclass(frozen=True)
class Drawing:
    """A figure of a statement, for its file and for a section of the page."""

    stem: str  # of the file
    section: str
    draw: Callable[[float], Figure]  # from a width in inches
    caption: str
    width_in: float = FULL_WIDTH_IN


def _curve_drawings(constraint: Constraint, statement: dict[str, Any]) -> list[Drawing]:
    """The hazard before and after, where there is one, and with ages the rates that are inconsistent."""
    found = []
    if (update := constraint.update) is not None:
        of = f"Hazard of {short_name(statement['measure'])} at {_site(statement)}, {ages_words(constraint.rocks)}"
        several, weighed = len(update.events.branches) > 1, update.posterior is not None
        shown = (
            f"mean and 5 to 95 % of the branches before (dashed, dotted){' and after (coloured)' if weighed else ''} "
            "they are weighted by the rock's survival; each is a line, the darker the more weight it has"
            f"{'.' if weighed else '. All are inconsistent, so that none gets a weight.'}"
            if several
            else "one curve, which cannot be weighted again."
        )
        found.append(
            Drawing("hazard", "Hazard", lambda width: hazard_figure(update, width), f"{of}: {shown}")
        )
    return found + inconsistent_drawing(constraint)


def inconsistent_drawing(constraint: Constraint) -> list[Drawing]:
    """The rates that the rocks reject; none without ages."""
    if constraint.bound is None:
        return []
    caption = (
        f"Annual rates of exceedance that the standing rocks reject at {100 * constraint.confidence:g} % whatever the "
        "rest of a hazard curve (grey), and the given curves. A curve outside the grey can be inconsistent too, by all "
        "its rates together."
    )
    return [
        Drawing(
            "constraint",
            "Inconsistent rates",
            lambda _: constraint_figure(constraint),
            caption,
            HALF_WIDTH_IN,
        )
    ]


def _event_drawings(statement: dict[str, Any], tables: Mapping[str, pd.DataFrame]) -> list[Drawing]:
    """Survival of branches, and the hazard before and after at each site, of each measure."""
    places = len(by_site_and_measure(statement["updated"], ""))
    weighed = _weighed(statement)
    caption = (
        f"Survival of each branch (circles: prior weights{'; dots: posterior weights' if weighed else ''}; lines: 95 "
        f"%), and rates of exceedance{' before and after the branches are weighted by it' if weighed else ''}"
        + (f", of the first {MOST_PANELS} of {places} sites and measures." if places > MOST_PANELS else ".")
    )
    branches, updated, confidence = tables["branches"], tables.get("updated"), statement["confidence"]
    return [
        Drawing(
            "constraint", "Hazard", lambda width: events_figure(branches, updated, confidence, width), caption
        )
    ]


def constraint_page(statement: dict[str, Any], drawings: Sequence[Drawing]) -> str:
    """HTML of a constraint, with its pictures inside.

    statement: with the choices that led to it.
    """
    document = Document(unfinished(statement))
    shown = {
        drawing.section: [document.figure(drawing.draw, drawing.caption, drawing.width_in)]
        for drawing in drawings
    }
    answers, others = answer(statement), what_it_rests_on(statement, branches=False)
    if not answers:
        answers, others = others[:2], others[2:]
    first = [*answers, *shown.get("Hazard", ()), *_changes(statement, document)]
    sections: dict[str, Sequence[Block]] = {
        "Branches": branches_table(statement, document),
        "Ground-motion models": _models(statement, document),
        "Inconsistent rates": shown.get("Inconsistent rates", ()),
        "What this rests on": others,
    }
    rocks = [rock["name"] for rock in statement["rocks"]]
    of = "events" if "events" in statement else "curves" if "branches" in statement else ""
    return rendered("constraint.html", title=f"toppling: {', '.join(rocks)}", rocks=rocks, remark=document.remark,
        first=first, sections=[pair for pair in sections.items() if pair[1]], of=of)  # fmt: skip


def unfinished(statement: dict[str, Any]) -> str:
    """That runs behind the rocks were not finished, in words; empty where all were, or it is not known."""
    rocks = [rock for rock in statement["rocks"] if rock.get("jobs_done") is not None]
    remarks = [Completeness(rock["jobs_planned"], rock["jobs_done"]).remark for rock in rocks]
    return "; ".join(dict.fromkeys(filter(None, remarks)))


def _site(statement: dict[str, Any]) -> str:
    hazard = statement["hazard"]
    place = f"longitude {hazard['site'][0]:g}, latitude {hazard['site'][1]:g}" if hazard["site"] else ""
    return ", ".join(filter(None, [hazard["site_name"], place])) or "the rock"


def _weighed(statement: dict[str, Any]) -> bool:
    """Whether there are several branches with posterior weights."""
    branches = statement.get("branches", ())
    return len(branches) > 1 and branches[0]["posterior_weight"] is not None


def _changes(statement: dict[str, Any], document: Document) -> list[Block]:
    """Tables of motions at some annual rates before and after the branches are weighted, by site and measure."""
    if not _weighed(statement):
        return []
    names = {
        "level_prior_mean": "before", "level_posterior_mean": "after", "level_posterior_p05": "5 % after",
        "level_posterior_p50": "50 %", "level_posterior_p95": "95 %", "level_change_percent": "change of motion (%)",
        "rate_change_percent": "change of rate (%)",
    }  # fmt: skip
    parts = []
    groups = by_site_and_measure(statement["changes"], statement["measure"])
    several = len({site for site, _ in groups}) > 1
    for (site, measure), rows in list(groups.items())[:MOST_PANELS]:
        rated = [
            {**row, "rate": rate_words(row["annual_rate"])}
            for row in rows
            if row["level_prior_mean"] is not None
        ]
        table = _picked(rated, {"rate": "annual rate"} | names)
        caption = (
            f"{short_name(measure)} ({printed_unit(measure)}) exceeded at some annual rates"
            f"{f' at {site}' if several else ''}: mean before and after, fractiles over the branches after. "
            "Rates are left out, or fractiles, where the hazard ends or fewer than ten events support them."
        )
        parts.append(document.table(table, caption))
    return parts


def _picked(rows: Sequence[Mapping[str, Any]], names: Mapping[str, str]) -> pd.DataFrame:
    """Columns of rows under other names, numbers to three digits; those that no row has are left out."""
    table = pd.DataFrame(list(rows), dtype=object).reindex(columns=list(names))
    some = table.dropna(axis="columns", how="all")
    for name in set(names).intersection(some):
        words = _percent if "weight" in name or "survival" in name else digits
        some[name] = [words(value) if isinstance(value, float) else value for value in some[name]]
    return some.rename(columns=dict(names))


def branches_table(statement: dict[str, Any], document: Document) -> list[Block]:
    """The branches with the most weight, and their mean."""
    if "branches" not in statement:
        return []
    by_weight = sorted(statement["branches"], key=lambda row: -(row["posterior_weight"] or 0.0))
    heaviest = by_weight[:MOST_SHOWN]
    rows = [*heaviest, statement["mean"]] if len(statement["branches"]) > 1 else heaviest
    table = pd.DataFrame([
        {
            "branch": row["name"], "prior weight (%)": _percent(row.get("prior_weight")),
            "posterior weight (%)": _percent(row.get("posterior_weight")),
            "survival (%)": with_ends(row, "survival", _percent),
            "motions at most times": with_ends(row, "scale_factor"),
            "rates at most times": with_ends(row, "rate_factor"),
            "verdict": row.get("verdict", ""),
        }
        for row in rows
    ]).replace("", None).dropna(axis="columns", how="all").fillna("")  # fmt: skip
    left = len(statement["branches"]) - len(heaviest)
    more = (
        [f"{left} branches with less weight: in branches.csv of 'toppling constrain --out'."] if left else []
    )
    caption = (
        "Weights of the branches, the rocks' survival under each, and the factors by which its motions or rates may "
        f"be multiplied for survival to stay above {100 * (1 - statement['confidence']):.3g} %; 95 % intervals in "
        "brackets."
    )
    return [document.table(table, " ".join([caption, *more]))]


def _percent(share: float | None) -> str:
    return "" if share is None else percent(share).removesuffix(" %")


def _models(statement: dict[str, Any], document: Document) -> list[Block]:
    if len(statement.get("models", ())) < 2:
        return []
    names = {
        "model": "model", "branches": "branches", "survival": "survival (%)", "prior_weight": "prior weight (%)",
        "posterior_weight": "posterior weight (%)", "bayes_factor": "over the average",
    }  # fmt: skip
    caption = (
        "Ground-motion models by all rocks together: survival, weights, and Bayes factor over their average."
    )
    return [document.table(_picked(statement["models"], names), caption)]


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
    yield from _write(statement, constraint.tables, _curve_drawings(constraint, statement), folder)
    update = constraint.update
    if update:
        yield from _hazard_after(update, folder, ratio)
    if constraint.random_rock is not None:
        yield write_curves(folder / "random_rock.json", [constraint.random_rock.curve], "random rock")


def write_events(
    update: Update, statement: dict[str, Any], folder: Path, ratio: float = 1.0
) -> Iterator[Path]:
    """Write an update of a set of events to a folder (see `write_constraint`); yields each complete file."""
    yield from _write(statement, update.tables, _event_drawings(statement, update.tables), folder)
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
