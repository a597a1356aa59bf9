"""The page of a constraint under a set of events: the answer in words, then what it rests on."""

from typing import Any

import pandas as pd

from toppling.results.completeness import Completeness
from toppling.results.drawing.constraint_words import answer, event_words
from toppling.results.drawing.hazard_figures import MOST_PANELS, events_figure
from toppling.results.drawing.report.constraint_page import (
    branches_table,
    changes_part,
    choices_part,
    first_lines,
)
from toppling.results.drawing.report.document import Document, page, paragraph
from toppling.results.drawing.style import digits, short_name

_METHOD = (
    "<p>An event of annual rate r topples at least one of the rocks with P = 1 &minus; &prod;(1 &minus; F<sub>i</sub>)"
    ", where F<sub>i</sub> is rock i's fragility at the event's motion at its site: rocks feel the same events. Such "
    "events have the rate &nu; = &Sigma; r P, and Poisson events leave all rocks standing for A years with the "
    "probability exp(&minus;&nu;A), averaged over the ages. Branches are weighted by Bayes' rule, w' &prop; w "
    "P(survival). Rates of exceedance are counted from the events; fractiles are over branches, as OpenQuake computes "
    "them. The scale factor is that by which all motions may be multiplied before survival falls to one minus the "
    "confidence; the rate factor that of the rates. Intervals of 95 % resample records and ages, and the events of a "
    "catalogue.</p>"
)


def event_page(statement: dict[str, Any], tables: dict[str, pd.DataFrame]) -> str:
    """HTML of a constraint under a set of events, with its pictures inside.

    statement: with the choices that led to it.
    tables: of the statement, by name.
    """
    document = Document(unfinished(statement))
    names = [rock["name"] for rock in statement["rocks"]]
    sections = [
        ("Hazard", _hazard(statement, tables, document)),
        ("Branches", branches_table(statement, document)),
        ("Ground-motion models", _models(statement, document)),
        ("Rocks", _rocks(statement, document)),
        ("In words", "".join(map(paragraph, event_words(statement).splitlines()))),
        ("Method", _METHOD),
        ("Choices and files", choices_part(statement)),
    ]
    return page(
        f"toppling: {', '.join(names)}",
        first_lines(names, answer(statement), document.remark),
        [(title, text) for title, text in sections if text],
    )


def unfinished(statement: dict[str, Any]) -> str:
    """That runs behind the rocks were not finished, in words; empty where all were, or it is not known."""
    rocks = [rock for rock in statement["rocks"] if rock.get("jobs_done") is not None]
    remarks = [Completeness(rock["jobs_planned"], rock["jobs_done"]).remark for rock in rocks]
    return "; ".join(dict.fromkeys(filter(None, remarks)))


def _hazard(statement: dict[str, Any], tables: dict[str, pd.DataFrame], document: Document) -> str:
    updated = tables.get("updated")
    places = [] if updated is None else list(updated.groupby(["site", "measure"], sort=False).groups)
    caption = (
        "Survival of each branch (circles: weights before; dots: after; lines: 95 %), and rates of exceedance before "
        "and after the branches are weighted by it" + (
            f", of the first {MOST_PANELS} of {len(places)} sites and measures." if len(places) > MOST_PANELS else "."
        )
    )  # fmt: skip
    parts = [
        document.figure(
            lambda width: events_figure(tables["branches"], updated, statement["confidence"], width), caption
        )
    ]
    for site, measure in places[:MOST_PANELS] if len(statement["branches"]) > 1 else ():
        rows = [row for row in statement["changes"] if (row["site"], row["measure"]) == (site, measure)]
        parts.append(changes_part(rows, measure, f" at {site}", document))
    return "".join(parts)


def _models(statement: dict[str, Any], document: Document) -> str:
    if len(statement.get("models", ())) < 2:
        return ""
    table = pd.DataFrame([
        {
            "model": row["model"], "branches": row["branches"], "survival": digits(row["survival"]),
            "before": digits(row["prior_weight"]), "after": digits(row["posterior_weight"]),
            "over the average": digits(row["bayes_factor"]),
        }
        for row in statement["models"]
    ])  # fmt: skip
    return document.table(
        table,
        "Ground-motion models by all rocks together: survival, weights, and Bayes factor over their average.",
    )


def _rocks(statement: dict[str, Any], document: Document) -> str:
    table = pd.DataFrame([
        {"rock": rock["name"], "fragility": rock["fragility"], "site": rock["site"]} for rock in statement["rocks"]
    ])  # fmt: skip
    measures = " and ".join(map(short_name, statement["measure"].split("+")))
    text = document.table(
        table, f"Fragility over {measures} of each rock, and its site among those of the events."
    )
    if len(statement["rocks"]) > 1:
        firsts = {row["left_out"]: row for row in statement["left_out"]}
        table = pd.DataFrame([
            {"left out": name, "survival that the others predict": digits(row["survival_predicted"])}
            for name, row in firsts.items()
        ])  # fmt: skip
        text += document.table(
            table, "Each rock's survival as the branches predict it once the other rocks have weighted them."
        )
    return text
