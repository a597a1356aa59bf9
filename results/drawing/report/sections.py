"""The report's sections, one function each; SECTIONS orders them."""

from collections.abc import Callable
from functools import partial

import pandas as pd

from toppling.models.hidden_base.intervals import base_sentences
from toppling.models.spelling import counted
from toppling.results.analysis import fits, ranking, resampling
from toppling.results.analysis.audit_statistics import audits_of
from toppling.results.analysis.directions import least_sector, sector_share, topple_rose
from toppling.results.analysis.fragility import (
    PLANES,
    DirectionCells,
    planes_of,
)
from toppling.results.analysis.friction_comparison import compare_frictions
from toppling.results.analysis.unphysical import unphysical_of
from toppling.results.drawing.constraint_words import age_words
from toppling.results.drawing.fit_figures import few_records, fit_figure, fit_table
from toppling.results.drawing.friction_figures import friction_figure
from toppling.results.drawing.maps import direction_figure, map_figure
from toppling.results.drawing.record_figures import records_figure
from toppling.results.drawing.report.constraint_page import branches_table, rejected_drawing
from toppling.results.drawing.report.content import CONFIDENCE, Contact, Content
from toppling.results.drawing.report.document import Document, heading, pair, paragraph, safe, sentence
from toppling.results.drawing.report.methods import methods_section
from toppling.results.drawing.roses import rose_figure
from toppling.results.drawing.scene_figures import scene_picture
from toppling.results.drawing.style import (
    HALF_WIDTH_IN,
    digits,
    png_bytes,
    printed_unit,
    short_name,
    with_superscripts,
)
from toppling.results.reader import Run
from toppling.results.weights import records_weight, sentences

_MOST_RECORDS = 12
"""Largest number of rows in the table of records; those that topple the rock most often are shown."""


def _scene_section(content: Content, document: Document) -> str:
    table, parts = content.run.scene(), []
    if table is None:
        return "<p>The run holds no scene.</p>"
    settling = (content.run.provenance().get("settling") or {}).get("sentence")
    if content.scene is not None:
        scene = content.scene
        caption = (
            f"The rock {content.run.rock} on its pedestal, from three sides and from above (blue: contact outline; "
            "black: cliff edge; dotted where hidden), and the least constant ground acceleration that topples it."
        )
        parts.append(document.figure(lambda width: scene_picture(scene, width), caption))
        parts += map(sentence, base_sentences(content.run.scene_report()))
    if weights := content.run.weights():
        parts += map(sentence, sentences(weights.summary(content.frame)))
    row = table.drop_columns(["quasi_static_toppling"]).to_pylist()[0]
    rows = [
        {
            "quantity": field.metadata[b"description"].decode(),
            "value": row[field.name],
            "unit": _unit(field.metadata[b"unit"].decode()),
        }
        for field in table.schema
        if field.name in row
    ]
    if settling:
        rows.append({"quantity": "from scan to shake", "value": settling, "unit": ""})
    return "".join([*parts, document.table(pd.DataFrame(rows), "The scene in numbers.")])


def _records_section(content: Content, document: Document) -> str:
    frame = content.frame
    used = frame.drop_duplicates("record_id")
    events = counted(used["event"].nunique(), "named earthquake")
    lines = [paragraph(f"{counted(len(used), 'record')} of {events}.")]
    if (weight := records_weight(frame)) is not None:
        least, most = weight[used.index].min(), weight[used.index].max()
        lines.append(
            f"<p>The records are weighted by a hazard deaggregation, from {least:.3g} to {most:.3g} times an equal "
            "share, in maps and fits.</p>"
        )
    if content.ensemble is not None:
        caption = (
            "The records as recorded. Left: response spectra (RotD50, 5 % damping) with median and 16 and 84 % "
            "quantiles; middle: PGA against PGV/PGA (triangles at the edge: outside the axes, with names and values "
            "above); right: magnitude against distance."
        )
        lines.append(document.figure(partial(records_figure, content.ensemble), caption))
    if (beyond := unphysical_of(content.run, frame)) is not None:
        lines.append(paragraph(f"{beyond.sentence}."))
    answered = frame.groupby("record_id")["toppled"]
    counts = pd.DataFrame({"jobs": answered.count(), "toppled": answered.sum().astype(int)}).reset_index()
    motions = content.run.motions()
    if motions is not None:
        counts = counts.merge(_as_recorded(motions.to_pandas()), how="left")
    counts = counts.sort_values(["toppled", "record_id"], ascending=[False, True])
    some = f", the {_MOST_RECORDS} that topple the rock most often" if len(counts) > _MOST_RECORDS else ""
    order = [*counts.columns.drop(["jobs", "toppled"]), "jobs", "toppled"]
    shown = counts.head(_MOST_RECORDS)[order].rename(columns={"record_id": "record"})
    caption = f"Records as recorded{some}: answered jobs of each, and those that toppled."
    lines.append(document.table(shown, caption))
    return "".join(lines)


def _as_recorded(catalogue: pd.DataFrame) -> pd.DataFrame:
    """Readable columns of the catalogue, with their units."""
    names = {
        "record_id": "record_id", "event": "event", "station": "station", "magnitude": "magnitude",
        "distance_km": "distance (km)", "pga_m_s2": "PGA (m/s²)", "pgv_m_s": "PGV (m/s)",
        "pgv_pga_s": "PGV/PGA (s)", "duration_energy_s": "duration (s)",
    }  # fmt: skip
    shown = catalogue[[name for name in names if name in catalogue]].rename(columns=names)
    numbers = shown.select_dtypes("number").columns
    return shown.assign(**{name: [digits(value) for value in shown[name]] for name in numbers})


def _maps_section(content: Content, document: Document) -> str:
    return "".join(_maps_of(content, one, document) for one in content.contacts)


def _maps_of(content: Content, contact: Contact, document: Document) -> str:
    jobs, words = contact.jobs, contact.words
    planes = planes_of(content.frame).values()
    single, split = [], []
    for plane in planes:
        caption = f"Toppling probability over {plane.x.label} and {plane.y.label} ({words})."
        drawn = png_bytes(map_figure(jobs, plane, words), document.remark)
        single.append(document.picture(drawn, caption, width_in=HALF_WIDTH_IN))
    for plane in (plane for plane in planes if plane.by_direction):
        caption = f"Toppling probability over {plane.x.label} and {plane.y.label}, by direction of shaking ({words})."
        draw = partial(direction_figure, DirectionCells.of(jobs, plane), words, None)
        split.append(document.figure(draw, caption))
    within = least_sector(content.run.quasi_static())
    sector = sector_share(jobs, *within) if within else None
    rose = document.figure(
        lambda width: rose_figure(topple_rose(jobs), content.run.quasi_static(), sector, width),
        f"Where the rock topples to ({words}), and the least constant ground acceleration that topples it.",
    )
    title = heading(words, 3) if len(content.contacts) > 1 else ""
    return "".join([title, *(pair(*single[k : k + 2]) for k in range(0, len(single), 2)), *split, rose])


def _friction_section(content: Content, document: Document) -> str:
    """Each friction against the highest; empty if there is only one."""
    parts = []
    for surroundings, table, pairs in compare_frictions(content.frame, PLANES["pga_pgv"]):
        caption = (
            "Toppling probability in cells of PGA and PGV with one friction against another, for the same jobs shaken "
            "with both. Dashed: no difference."
        )
        draw = partial(friction_figure, table, pairs)
        parts.append(heading(surroundings, 3) + document.figure(draw, caption))
    return "".join(parts)


def _fits_section(content: Content, document: Document) -> str:
    return "".join(_fits_of(content, one, document) for one in content.contacts)


def _fits_of(content: Content, contact: Contact, document: Document) -> str:
    title = heading(contact.words, 3) if len(content.contacts) > 1 else ""
    few = few_records(contact.known["record_id"].nunique())
    if contact.toppled < fits.FEW_TOPPLED:
        return title + paragraph(
            f"Too few topplings: {contact.toppled} of {len(contact.known):,} jobs, fewer than {fits.FEW_TOPPLED}. "
            f"No curve is drawn and no measure is ranked; shake more strongly, or with more records. {few}".rstrip()
        )
    summary = fits.summary(contact.models)
    parts = [title, _verdict(contact.ranking)]
    if (curve := contact.best) is not None:
        calibrated = ranking.calibration(contact.known, ranking.out_of_fold(contact.known, [curve.measure]))
        observed = ranking.observed_shares(contact.known, curve.measure)
        data = curve, observed, contact.ranking, calibrated, contact.toppled
        caption = (
            f"Left: lognormal fragility over {short_name(curve.measure)}, the measure that predicts best "
            f"({contact.words}), with its 95 % band. Middle: how much worse the others predict records left out "
            "of the fit. Right: predicted probability against observed share."
        )
        parts.append(document.figure(lambda width: fit_figure(*data, width), caption))
    ranked, fitted = _ranking_table(contact.ranking), fit_table(summary, contact.known)
    parts += [
        document.table(ranked, f"Measures of intensity, best first ({contact.words})."),
        document.table(fitted, f"Lognormal fragility over each measure ({contact.words})."),
        "<p>Intervals (95 %) come from the bootstrap samples of records that have a fit; the others have none: "
        f"their answers are separated, or there are fewer than {resampling.LEAST_RECORDS} records. {few} Beyond "
        "the strongest shaking the jobs say nothing.</p>",
    ]
    return "".join(parts)


def _ranking_table(ranking: pd.DataFrame) -> pd.DataFrame:
    table = pd.DataFrame({"measure": [short_name(name) for name in ranking["measures"]]})
    names = {"brier": "Brier score", "log_loss": "log loss", "auc": "area under ROC", "worse_by": "log loss above best",
             "worse_by_low": "from", "worse_by_high": "to"}  # fmt: skip
    for column, name in names.items():
        if column in ranking:
            table[name] = ["" if value != value else f"{value:.3f}" for value in ranking[column]]
    return table


def _verdict(ranking: pd.DataFrame) -> str:
    """Whether this rock agrees with the study, which says that PGV governs toppling."""
    singles = ranking[~ranking["measures"].str.contains("+", regex=False)].dropna(subset=["log_loss"])
    if not len(singles):
        return "<p>No measure has an out-of-fold fit: too few records, or separated answers.</p>"
    best = singles["measures"].iloc[0]
    agrees = (
        "as for the study's rock" if best == "pgv_m_s" else "unlike for the study's rock, where it was PGV"
    )
    return (
        f"<p>Of the single measures, {safe(short_name(best))} best predicts records left out of the fit, {agrees}. "
        "A difference in log loss whose interval includes 0 is not significant.</p>"
    )


def _constraint_section(content: Content, document: Document) -> str:
    constraint, said = content.constraint, content.statement
    if constraint is None or said is None:
        return paragraph("Without a fragility curve the standing rock gives no constraint.")
    unit, ends = printed_unit(said["measure"]), (said["unexceeded_low"], said["unexceeded_high"])
    interval = (
        "" if None in ends else f" ({ends[0]:.3g} to {ends[1]:.3g} with other records like these, 95 %)"
    )
    event = paragraph(
        f"At {100 * CONFIDENCE:g} % confidence no single event since the rock acquired its present shape has "
        f"exceeded a {short_name(said['measure'])} of {said['unexceeded']:.3g} {unit}{interval} ({content.chief.words})"
        f"{', ' if content.extrapolated else ''}{content.extrapolated}."
    )
    if constraint.exposure is None:
        return (
            f"{event}<p>No age was given. With one (<code>--age 15000..30000</code>) the report rejects rates of "
            "exceedance, and tests hazard curves (<code>--hazard FILE</code>).</p>"
        )
    stood = paragraph(f"{constraint.rocks[0].name}{age_words(said['rocks'][0])}.")
    drawn = [document.figure(one.draw, one.caption, one.width_in) for one in rejected_drawing(constraint)]
    return "".join([event, stood, *drawn, branches_table(said, document)])


def _failures_section(content: Content, document: Document) -> str:
    frame = content.frame
    counts = frame.groupby(["status", "ended_by"], dropna=False).size().rename("jobs").reset_index()
    parts = [document.table(counts.rename(columns={"ended_by": "ended by"}), "How the jobs ended.")]
    failed = frame[frame["status"] != "ok"]
    if len(failed):
        why = failed.groupby(["status", "message"], dropna=False)
        rows = why.agg(jobs=("job_id", "size"), example=("job_id", "first")).reset_index()
        rows = rows.sort_values("jobs", ascending=False).head(20)
        parts.append(document.table(rows, "Jobs without an answer, by reason."))
    else:
        parts.append("<p>Every job has an answer.</p>")
    return "".join(parts)


SECTIONS: dict[str, Callable[[Content, Document], str]] = {
    "Scene": _scene_section,
    "Records": _records_section,
    "Toppling probability": _maps_section,
    "Friction": _friction_section,
    "Fits": _fits_section,
    "Constraint": _constraint_section,
    "Failures": _failures_section,
    "Accuracy": lambda content, _: _accuracy_section(content.run, content.frame),
    "Methods": methods_section,
}
"""By title, in the page's order: HTML of a part of the report; empty omits it."""


def _unit(unit: str) -> str:
    return with_superscripts(unit).replace("deg", "°") if unit != "1" else ""


def _accuracy_section(run: Run, frame: pd.DataFrame) -> str:
    presets, engines = (", ".join(sorted(frame[name].unique())) for name in ("preset", "engine"))
    # A preset's steps may differ beyond the digits that are shown.
    steps = ", ".join(dict.fromkeys(f"{step:g}" for step in sorted(frame["time_step_s"].dropna())))
    lines = [f"<p>Engine {safe(engines)}; preset {safe(presets)}; time step {steps or 'not stated'} s.</p>"]
    if frame["penetration_m"].notna().any():
        lines.append(f"<p>Deepest penetration of rock and pedestal {frame['penetration_m'].max():.2g} m.</p>")
    audits = audits_of(run)
    lines += [f"<p>{safe(audit.sentence)}.</p>" for audit in audits.values()]
    if not audits:
        lines.append(
            "<p>This run has not been audited: <code>toppling audit RUN --jobs 200</code> repeats a sample of its jobs "
            "and states how far its answers may be off.</p>"
        )
    return "".join(lines)
