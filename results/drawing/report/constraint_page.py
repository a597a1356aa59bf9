"""The page of a constraint, or of one under a set of events: the answer in words, then what it rests on."""

import json
from collections.abc import Sequence
from functools import partial
from typing import Any

import pandas as pd

from toppling.results.analysis.constraint import Constraint
from toppling.results.completeness import Completeness
from toppling.results.drawing.constraint_figures import ages_words, constraint_figure
from toppling.results.drawing.constraint_words import all_words, answer, event_words, rate_words
from toppling.results.drawing.hazard_figures import MOST_PANELS, events_figure, hazard_figure
from toppling.results.drawing.report.document import Document, page, paragraph, safe
from toppling.results.drawing.style import HALF_WIDTH_IN, digits, printed_unit, short_name

_MOST_BRANCHES = 15
"""Branches that the page's table holds, those with the most weight; the file has all."""


def constraint_page(constraint: Constraint, statement: dict[str, Any]) -> str:
    """HTML of a constraint, with its pictures inside.

    statement: its statement (`Constraint.summary`), with the choices that led to it.
    """
    remarks = [one.curve.basis.unfinished for one in constraint.rocks if one.curve.basis]
    document = Document("; ".join(dict.fromkeys(filter(None, remarks))))
    names = [rock.name for rock in constraint.rocks]
    lines = answer(statement) or all_words(statement).splitlines()[:2]
    sections = [
        ("Hazard", _hazard(constraint, statement, document)),
        ("Branches", branches_table(statement, document)),
        ("Logic tree", _levels(statement, document)),
        ("Rates rejected", rejected_part(constraint, document)),
        ("Rocks", _rocks(statement, document)),
        ("In words", "".join(map(paragraph, all_words(statement).splitlines()))),
        ("Method", _METHOD if constraint.update else ""),
        ("Choices and files", _choices_part(statement)),
    ]
    return _page(names, lines, document.remark, sections)


def _page(
    names: Sequence[str], answers: Sequence[str], remark: str, sections: Sequence[tuple[str, str]]
) -> str:
    """HTML: whose page it is, what has to be known first, the answer, and the sections that say something."""
    rocks, says = ", ".join(names), "says" if len(names) == 1 else "say"
    alarm = f'<p class="alarm">{safe(remark)}.</p>' if remark else ""
    head = f"<h1>What {safe(rocks)} {says} by still standing</h1>{alarm}" + "".join(map(paragraph, answers))
    return page(f"toppling: {rocks}", head, [(title, text) for title, text in sections if text])


def _choices_part(statement: dict[str, Any]) -> str:
    """Options and files, as the statement notes them."""
    return f"<pre>{safe(json.dumps(statement.get('choices', {}), indent=1))}</pre>"


_METHOD = (
    "<p>A rock topples at the annual rate &nu; = &int; F(x) |d&lambda;(x)|, with its fragility F and the hazard curve "
    "&lambda;, a power law between its points; Poisson events leave it standing for A years with the probability "
    "exp(&minus;&nu;A), averaged over the age. Branches are weighted by Bayes' rule, w' &prop; w P(survival). Mean and "
    "fractiles are of probabilities over the investigation time, level by level, as OpenQuake computes them. The scale "
    "factor is that by which all motions of a curve may be multiplied before survival falls to one minus the "
    "confidence; the rate factor that of its rates. Motions outside a curve's points are not counted. Intervals of "
    "95 % resample records (bootstrap) and ages from their distribution; 5 to 95 % are fractiles over branches.</p>"
)


def _hazard(constraint: Constraint, statement: dict[str, Any], document: Document) -> str:
    if constraint.update is None:
        return ""
    measure = short_name(statement["measure"])
    many = len(statement["branches"]) > 1
    caption = f"Hazard of {measure} at {_site(statement)}, {ages_words(constraint.rocks)}" + (
        ": mean and 5 to 95 % of the branches before (dashed, dotted) and after (coloured) they are weighted by the "
        "rock's survival; each branch is a line, the darker the more weight it has now."
        if many
        else ": one curve, which cannot be weighted again."
    )
    parts = [document.figure(lambda width: hazard_figure(constraint.update, width), caption)]  # type: ignore[arg-type]
    if many:
        parts.append(_changes_part(statement["changes"], statement["measure"], "", document))
    return "".join(parts)


def _changes_part(rows: Sequence[dict[str, Any]], measure: str, where: str, document: Document) -> str:
    """The table of motions at some annual rates before and after."""
    unit = printed_unit(measure)
    table = pd.DataFrame([
        {
            "annual rate": rate_words(row["annual_rate"]), f"before ({unit})": digits(row["level_prior_mean"]),
            f"after ({unit})": digits(row["level_posterior_mean"]),
            "5 % after": digits(row["level_posterior_p05"]), "50 %": digits(row["level_posterior_p50"]),
            "95 %": digits(row["level_posterior_p95"]),
            "change of motion (%)": digits(row["level_change_percent"]),
            "change of rate (%)": digits(row["rate_change_percent"]),
        } | ({"rejected removed": digits(row["level_kept_mean"])} if "level_kept_mean" in row else {})
        for row in rows
    ])  # fmt: skip
    removed = (
        ", and the mean with rejected branches removed instead of weighted"
        if "rejected removed" in table
        else ""
    )
    return document.table(
        table,
        f"{short_name(measure)} exceeded at some annual rates{where}: mean before and after, fractiles over the "
        f"branches after{removed}. Empty where the curves do not reach.",
    )


def _site(statement: dict[str, Any]) -> str:
    hazard = statement["hazard"]
    place = f"longitude {hazard['site'][0]:g}, latitude {hazard['site'][1]:g}" if hazard["site"] else ""
    return ", ".join(filter(None, [hazard["site_name"], place])) or "the rock"


def branches_table(statement: dict[str, Any], document: Document) -> str:
    """The branches with the most weight, and their mean."""
    if "branches" not in statement:
        return ""
    heaviest = sorted(statement["branches"], key=lambda row: -(row["posterior_weight"] or 0.0))[
        :_MOST_BRANCHES
    ]
    rows = [*heaviest, statement["mean"]] if len(statement["branches"]) > 1 else heaviest
    table = pd.DataFrame([
        {
            "branch": row["name"], "weight before": digits(row.get("prior_weight")),
            "after": digits(row.get("posterior_weight")), "rejected removed": digits(row.get("kept_weight")),
            "survival": _with_ends(row, "survival"), "motions at most times": _with_ends(row, "scale_factor"),
            "rates at most times": _with_ends(row, "rate_factor"),
            "verdict": "" if "rejected" not in row else "rejected" if row["rejected"] else "kept",
        }
        for row in rows
    ])  # fmt: skip
    left = len(statement["branches"]) - len(heaviest)
    more = f" {left} branches with less weight: in branches.csv of 'toppling constrain'." if left else ""
    return document.table(
        table,
        "Weights of the branches, the rocks' survival under each, and the factors by which its motions or rates may be "
        f"multiplied for survival to stay above {100 * (1 - statement['confidence']):.3g} %; 95 % intervals in "
        "brackets."
        + more
        + "".join(f" {sentence}" for sentence in statement.get("hazard", {}).get("assumed", ())),
    )


def _with_ends(row: dict[str, Any], name: str) -> str:
    value, low, high = (digits(row[f"{name}{end}"]) for end in ("", "_low", "_high"))
    return f"{value} ({low}-{high or '∞'})" if low else value


def _levels(statement: dict[str, Any], document: Document) -> str:
    if not statement.get("levels"):
        return ""
    table = pd.DataFrame([
        {
            "level": row["level"], "weight moved (%)": digits(100 * row["moved"]), "choice": row["choice"],
            "before": digits(row["prior_weight"]), "after": digits(row["posterior_weight"]),
        }
        for row in statement["levels"]
    ])  # fmt: skip
    return document.table(
        table,
        "Levels of the logic tree by how much of their weight the rocks move from one choice to others.",
    )


def rejected_part(constraint: Constraint, document: Document) -> str:
    """The figure of the rates that the rocks reject; empty without ages."""
    if constraint.bound is None:
        return ""
    branches = constraint.update.tree.branches if constraint.update else ()
    draw = partial(
        constraint_figure,
        constraint.bound,
        branches,
        constraint.confidence,
        constraint.branches,
        constraint.rocks,
    )
    caption = (
        f"Annual rates of exceedance that the standing rocks reject at {100 * constraint.confidence:g} % whatever the "
        "rest of a hazard curve (grey), and the given curves. A curve outside the grey can also be rejected, by all "
        "its rates together."
    )
    return document.figure(lambda _: draw(), caption, HALF_WIDTH_IN)


def _rocks(statement: dict[str, Any], document: Document) -> str:
    unit = printed_unit(statement["measure"])
    table = pd.DataFrame([
        {
            "rock": rock["name"], f"median ({unit})": digits(rock["median"]), "beta": digits(rock["beta"]),
            "jobs": rock.get("jobs"), "toppled": rock.get("toppled"), "records": rock.get("records"),
        }
        for rock in statement["rocks"]
    ])  # fmt: skip
    text = document.table(
        table, f"Fragility over {short_name(statement['measure'])} of each rock, and what it rests on."
    )
    if site := statement.get("random_rock"):
        text += paragraph(
            f"One fragility of the site, of a rock drawn at random from among those like them: median "
            f"{digits(site['median'])} {unit}, beta {digits(site['beta'])}, of which {digits(site['beta_within'])} "
            f"within a rock and {digits(site['beta_between'])} between rocks (random_rock.json)."
        )
    return text


_METHOD_OF_EVENTS = (
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
        ("Hazard", _hazard_of_events(statement, tables, document)),
        ("Branches", branches_table(statement, document)),
        ("Ground-motion models", _models(statement, document)),
        ("Rocks", _rocks_of_events(statement, document)),
        ("In words", "".join(map(paragraph, event_words(statement).splitlines()))),
        ("Method", _METHOD_OF_EVENTS),
        ("Choices and files", _choices_part(statement)),
    ]
    return _page(names, answer(statement), document.remark, sections)


def unfinished(statement: dict[str, Any]) -> str:
    """That runs behind the rocks were not finished, in words; empty where all were, or it is not known."""
    rocks = [rock for rock in statement["rocks"] if rock.get("jobs_done") is not None]
    remarks = [Completeness(rock["jobs_planned"], rock["jobs_done"]).remark for rock in rocks]
    return "; ".join(dict.fromkeys(filter(None, remarks)))


def _hazard_of_events(statement: dict[str, Any], tables: dict[str, pd.DataFrame], document: Document) -> str:
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
        parts.append(_changes_part(rows, measure, f" at {site}", document))
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


def _rocks_of_events(statement: dict[str, Any], document: Document) -> str:
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
