"""The report as HTML and as PDF: sections, one function each, the paragraph on methods among them, in their order."""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pandas as pd

from toppling.models.errors import InputError, counted
from toppling.models.files.documents import MOST_SHOWN
from toppling.models.files.folder import new_file
from toppling.models.frames import quadrant_of
from toppling.models.hidden_base.intervals import base_sentences, volume_text
from toppling.models.pedestal import FRICTION_SPREAD
from toppling.models.scene import COM_SPREAD_SHARE, Scene
from toppling.results.analysis import FEW, fits
from toppling.results.analysis.fragility import (
    compare_frictions,
    friction_words,
    frictions,
    least_sector,
    planes_of,
    sector_fraction,
    topple_rose,
)
from toppling.results.drawing.maps import friction_figure, map_figure
from toppling.results.drawing.record_figures import records_figure
from toppling.results.drawing.report.constraint_page import branches_table, inconsistent_drawing
from toppling.results.drawing.report.content import Content
from toppling.results.drawing.report.headline import first_screen
from toppling.results.drawing.roses import rose_figure
from toppling.results.drawing.run_figures import fit_figure, fit_table, interval_words
from toppling.results.drawing.scene_figures import scene_picture
from toppling.results.drawing.sentences import age_words
from toppling.results.drawing.style import HALF_WIDTH_IN, digits, measure_label, short_name, with_superscripts
from toppling.results.drawing.templates import Block, Document, Section, block, rendered, sentence
from toppling.results.reader import Run
from toppling.results.weights import records_weight, sentences

_REFERENCES = (
    "Baker, J. W. (2015). Efficient analytical fragility function fitting using dynamic structural analysis. "
    "Earthquake Spectra 31, 579-599.",
    "Veeraraghavan, S., Hudnut, K. W., and Krishnan, S. (2017). Toppling analysis of the Echo Cliffs precariously "
    "balanced rock. Bulletin of the Seismological Society of America 107, 72-84.",
    "Wilson, E. B. (1927). Probable inference, the law of succession, and statistical inference. "
    "Journal of the American Statistical Association 22, 209-212.",
)


def methods_section(content: Content, document: Document) -> list[Block]:  # noqa: ARG001  (as every section)
    """Methods to copy, and references."""
    references = sorted((*_REFERENCES, content.run.provenance()["engine"]["reference"]))
    cited = block("items", texts=[_program(content), *references])
    return [block("methods", text=methods(content)), "To cite:", cited]


def methods(content: Content) -> str:
    """Methods of the run, in the past tense, with its own numbers."""
    run, frame, table = content.run, content.frame, content.run.scene()
    provenance = run.provenance()
    versions, cited = provenance["versions"], provenance["engine"]
    report = content.scene.report if content.scene is not None else {}
    drawn = frame[frame["realisation"] > 0]
    weighted_by = ["a hazard deaggregation"] if records_weight(frame) is not None else []
    weighted_by += [weights.method] if (weights := run.weights()) else []
    physics = ", ".join(sorted(frame["physics_version"].dropna().astype(str).unique()))
    engines = sorted(frame["engine"].unique(), reverse=True)
    text = rendered(
        "methods.html",
        remark=content.completeness.remark,
        scene=table.to_pylist()[0] if table is not None else None,
        stations=report.get("registration", {}).get("stations"),
        records=frame["record_id"].nunique(),
        levels=sorted(frame["level_pga_m_s2"].unique()),
        azimuths=frame["azimuth_deg"].nunique(),
        realisations=frame["realisation"].nunique(),
        friction=" and ".join(friction_words(*pair) for pair in frictions(frame)),
        restitution=", ".join(f"{value:g}" for value in sorted(frame["restitution"].unique())),
        nominal=bool((frame["realisation"] == 0).any()),
        drawn=None if drawn.empty else {
            "count": drawn["realisation"].nunique(), "quantities": _quantities_drawn(content, drawn)
        },
        jobs=len(frame),
        answered=int(frame["toppled"].notna().sum()),
        version=versions["toppling"],
        physics=physics or versions["physics"],
        presets=", ".join(sorted(frame["preset"].unique())),
        engines=" and ".join(_engine_words(name, versions, cited) for name in engines),
        weighted_by=weighted_by,
        samples=content.samples,
    )  # fmt: skip
    return " ".join(text.split())


def _quantities_drawn(content: Content, drawn: pd.DataFrame) -> list[str]:
    """Unmeasured quantities that the realisations draw: base, centre of mass, friction and the campaign's own."""
    unmeasured = content.run.unmeasured()
    found = [_base_drawn(drawn, content.scene), _friction_drawn(drawn, unmeasured.get("friction"))]
    if pair := unmeasured.get("restitution"):
        found.append(f"restitution (uniform, {pair[0]:g} to {pair[1]:g})")
    if yaw_deg := unmeasured.get("yaw_deg"):
        found.append(f"a turn of the motion about the vertical (uniform, at most {yaw_deg:g}° either way)")
    if unmeasured.get("either_sense"):
        found.append("the sense of the motion (reversed in one half)")
    if pair := unmeasured.get("above_band"):
        above = f"motion in the octave above {unmeasured['band_hz']:g} Hz"
        found.append(f"{above}, {pair[0]:g} to {pair[1]:g} times that in the octave below")
    return found


def _base_drawn(drawn: pd.DataFrame, scene: Scene | None) -> str:
    """Base and centre of mass, or the centre of mass alone where the scene keeps no draws of its base."""
    bases = drawn["base"].nunique()
    if bases:
        of = f" of the scene's {len(scene.unseen)}" if scene is not None and scene.unseen is not None else ""
        return f"one of the possible unseen bases ({bases}{of} in use) with a centre of mass"
    std_m = None if scene is None else scene.com_std_m
    spread = (
        f"{100 * COM_SPREAD_SHARE:g} % of the rock's height in each direction" if std_m is None
        else f"{', '.join(f'{1e3 * std:.2g}' for std in std_m)} mm toward east, north and up"
    )  # fmt: skip
    return f"a centre of mass (normal, standard deviation {spread})"


def _friction_drawn(drawn: pd.DataFrame, uniform: Sequence[float] | None) -> str:
    factor = drawn["friction_factor"].dropna()
    if uniform:
        return f"friction (static and kinetic alike, uniform, {uniform[0]:g} to {uniform[1]:g})"
    ends = "" if factor.empty else f"; drawn: {factor.min():.2f} to {factor.max():.2f}"
    return f"a factor on friction (lognormal, {100 * FRICTION_SPREAD:g} %{ends})"


def _engine_words(name: str, versions: Mapping[str, str], cited: Mapping[str, str]) -> str:
    """An engine with its version, and its authors where the run states them."""
    number = f" {versions[name]}" if name in versions else ""
    if cited.get("name") != name:
        return f"{name}{number}"
    return f"{cited['title']}{number} ({cited['authors']})"


def _program(content: Content) -> str:
    provenance = content.run.provenance()
    versions = provenance["versions"]
    return (
        f"The toppling developers ({provenance['created_at'][:4]}). toppling: toppling probability of precariously "
        f"balanced rocks under ensembles of earthquake records, version {versions['toppling']}, physics version "
        f"{versions['physics']}."
    )


_OF_SCENE = ("height_m", "volume_m3", "com_x_m", "com_y_m", "com_z_m", "slope_deg", "downhill_azimuth_deg")
"""Quantities of a scene that a reader compares with the rock; the file beside the page has all."""


def _scene_section(content: Content, document: Document) -> list[Block]:
    table, parts = content.run.scene(), list[Block]()
    if table is None:
        return ["The run holds no scene."]
    settling = (content.run.provenance()["settling"] or {}).get("sentence")
    if content.scene is not None:
        scene = content.scene
        caption = f"The rock {content.run.rock} on its pedestal, from three sides and from above; thin where hidden."
        parts.append(document.figure(lambda width: scene_picture(scene, width), caption))
        parts += map(sentence, base_sentences(content.run.scene_report()))
    if weights := content.run.weights():
        parts += map(sentence, sentences(weights.summary(content.frame)))
    if settling:
        parts.append(sentence(settling))
    found = content.run.scene_report()
    words = {
        "volume_m3": lambda value: volume_text(found, value).replace(" m³", ""),
        "downhill_azimuth_deg": lambda value: f"{value:.4g} ({quadrant_of(value)})",
    }
    rows = [
        {
            "quantity": field.metadata[b"description"].decode(),
            "value": words.get(field.name, lambda value: value)(table[field.name][0].as_py()),
            "unit": _unit(field.metadata[b"unit"].decode()),
        }
        for field in table.schema
        if field.name in _OF_SCENE
    ]
    return [*parts, document.table(pd.DataFrame(rows), "The scene in numbers.")]


def _records_section(content: Content, document: Document) -> list[Block]:
    frame = content.frame
    used = frame.drop_duplicates("record_id")
    events = counted(used["event"].nunique(), "named earthquake")
    lines: list[Block] = [f"{counted(len(used), 'record')} of {events}."]
    if (weight := records_weight(frame)) is not None:
        least, most = weight[used.index].min(), weight[used.index].max()
        lines.append(
            f"The records are weighted by a hazard deaggregation, from {least:.3g} to {most:.3g} times an equal share, "
            "in maps and fits."
        )
    if content.ensemble is not None:
        caption = (
            "The records as recorded. Left: response spectra (RotD50, 5 % damping) with median and 16 and 84 % "
            "quantiles; middle: PGA against PGV/PGA (triangles at the edge: outside the axes, with names and values "
            "above); right: magnitude against distance."
        )
        lines.append(document.figure(partial(records_figure, content.ensemble), caption))
    answered = frame.groupby("record_id")["toppled"]
    counts = pd.DataFrame({"jobs": answered.count(), "toppled": answered.sum().astype(int)}).reset_index()
    motions = content.run.motions()
    if motions is not None:
        counts = counts.merge(_as_recorded(motions.to_pandas()), how="left")
    counts = counts.sort_values(["toppled", "record_id"], ascending=[False, True])
    some = f", the {MOST_SHOWN} that topple the rock most often" if len(counts) > MOST_SHOWN else ""
    order = [*counts.columns.drop(["jobs", "toppled"]), "jobs", "toppled"]
    shown = counts.head(MOST_SHOWN)[order].rename(columns={"record_id": "record"})
    caption = f"Records as recorded{some}: answered jobs of each, and those that toppled."
    return [*lines, document.table(shown, caption)]


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


def _maps_section(content: Content, document: Document) -> list[Block]:
    """Maps and polar plot of the contact that the report begins with; 'toppling fragility' draws all contacts."""
    jobs, words = content.chief.jobs, content.chief.words
    planes = planes_of(content.frame).values()
    single = [
        document.figure(
            lambda _: map_figure(jobs, plane, words),  # noqa: B023  (drawn at once)
            f"Toppling probability over {plane.x.label} and {plane.y.label}.",
            HALF_WIDTH_IN,
        )
        for plane in planes
    ]
    within = least_sector(content.run.quasi_static())
    sector = sector_fraction(jobs, *within) if within else None
    rose = document.figure(
        lambda width: rose_figure(topple_rose(jobs), content.run.quasi_static(), sector, width),
        f"Where the rock topples to ({words}), and the least constant ground acceleration that topples it.",
    )
    return [*(block("pair", blocks=single[k : k + 2]) for k in range(0, len(single), 2)), rose]


def _friction_section(content: Content, document: Document) -> list[Block]:
    """Comparison of every friction with the highest; empty for a single friction."""
    parts: list[Block] = []
    for surroundings, table, pairs in compare_frictions(content.frame, planes_of(content.frame)["pga_pgv"]):
        caption = (
            "Toppling probability in cells of PGA and PGV with one friction against another, for the same jobs shaken "
            "with both. Dashed: no difference."
        )
        draw = partial(friction_figure, table, pairs)
        parts += [block("heading", text=surroundings)] * bool(surroundings)
        parts.append(document.figure(draw, caption))
    return parts


def _fits_section(content: Content, document: Document) -> list[Block]:
    """Fits of the contact that the report begins with."""
    contact = content.chief
    if contact.toppled < FEW:
        return [
            f"Too few topplings: {contact.toppled} of {len(contact.known):,} jobs, fewer than {FEW}. "
            f"No curve is drawn and no measure is ranked; shake more strongly, or with more records."
        ]
    summary = fits.summary(contact.models)
    parts: list[Block] = []
    if (curve := contact.best) is not None:
        calibrated = fits.calibration(contact.known, fits.out_of_fold(contact.known, [curve.measure]))
        observed = fits.observed_fractions(contact.known, curve.measure)
        data = curve, observed, contact.ranking, calibrated
        caption = (
            f"Left: lognormal fragility over {short_name(curve.measure)}, the measure that predicts best "
            f"({contact.words}), with its 95 % band. Middle: how much worse the others predict records left out "
            "of the fit (not significantly where the bar includes 0). Right: predicted probability against observed "
            "share."
        )
        parts.append(document.figure(lambda width: fit_figure(*data, width), caption))
    parts += [
        document.table(
            _measures_table(contact.ranking, fit_table(summary, contact.known)),
            f"Measures of intensity, best first ({contact.words}): by how much each predicts records left out of the "
            "fit worse than the best, and the lognormal fragility over it.",
        ),
        f"{interval_words(contact.known)} A sample has no fit where its answers are separated. Beyond the strongest "
        "shaking the jobs say nothing.",
    ]
    return parts


def _measures_table(ranking: pd.DataFrame, fitted: pd.DataFrame) -> pd.DataFrame:
    """Rank and fit of each single measure; of two together the rank alone."""
    ranked = ranking.reindex(columns=["worse_by", "worse_by_low", "worse_by_high"]).astype(float)
    table = pd.DataFrame(
        {
            "measure": [
                measure_label(name) if " + " not in name else short_name(name) for name in ranking["measures"]
            ]
        }
    )
    table["log loss above best (95 %)"] = [
        "" if value != value else f"{value:.3f}" + ("" if low != low else f" ({low:.3f} to {high:.3f})")
        for value, low, high in ranked.itertuples(index=False)
    ]
    return table.merge(fitted.drop(columns=["samples", "without fit"]), how="left", on="measure")


def _constraint_section(content: Content, document: Document) -> list[Block]:
    """Constraint on hazard by the rock, where its age is given."""
    constraint, statement = content.constraint, content.statement
    if constraint is None or statement is None or constraint.exposure is None:
        return []
    stood = f"{constraint.rocks[0].name}{age_words(statement['rocks'][0])}."
    drawn = [
        document.figure(drawing.draw, drawing.caption, drawing.width_in)
        for drawing in inconsistent_drawing(constraint)
    ]
    return [stood, *drawn, *branches_table(statement, document)]


def _jobs_section(content: Content, document: Document) -> list[Block]:
    """Computation of the jobs, and how they ended."""
    frame = content.frame
    presets, engines = (", ".join(sorted(frame[name].unique())) for name in ("preset", "engine"))
    steps = frame["time_step_s"].dropna()
    step = (
        " to ".join(dict.fromkeys(f"{step:.3g}" for step in (steps.min(), steps.max())))
        if len(steps)
        else "not stated"
    )
    line = f"Engine {engines}; preset {presets}; time step {step or '?'} s"
    for fell, which in ((False, "stays"), (True, "topples")):
        if len(depth_m := frame.loc[(frame["toppled"] == 1) == fell, "penetration_m"].dropna()):
            line += f"; where the rock {which}, it and its pedestal overlap by at most {depth_m.quantile(0.99):.2g} m "
            line += f"in 99 % of the jobs, and at most {depth_m.max():.2g} m in any"
    ended = frame.groupby(["status", "ended_by", "message"], dropna=False)
    counts = ended.agg(jobs=("job_id", "size")).reset_index().sort_values("jobs", ascending=False)
    table = counts.head(MOST_SHOWN).rename(columns={"ended_by": "ended by"})
    return [f"{line}.", document.table(table.dropna(axis="columns", how="all"), "How the jobs ended.")]


SECTIONS: dict[str, Callable[[Content, Document], list[Block]]] = {
    "Scene": _scene_section,
    "Records": _records_section,
    "Toppling probability": _maps_section,
    "Friction": _friction_section,
    "Fits": _fits_section,
    "Constraint": _constraint_section,
    "Jobs": _jobs_section,
    "Methods": methods_section,
}
"""Sections of the report by title, in the page's order; one without blocks is left out."""


def _unit(unit: str) -> str:
    return with_superscripts(unit).replace("deg", "°") if unit != "1" else ""


_BROWSERS = "chromium chromium-browser google-chrome google-chrome-stable chrome msedge microsoft-edge"
_PRINTING_S = 300.0
"""Time limit for a browser to print."""


def report_page(content: Content, advance: Callable[[str], object] = lambda _: None) -> str:
    """HTML of the page about a run, with its pictures inside.

    advance: called with the name of each section once it is done.
    Raises InputError if no job has an answer yet.
    """
    document = Document(content.completeness.remark)
    first = first_screen(content, document)
    written: list[Section] = []
    for title, write in SECTIONS.items():
        if blocks := write(content, document):
            written.append((title, blocks))
        advance(title)
    title = f"toppling: {content.run.rock} ({content.run.name})"
    return rendered("report.html", title=title, sections=written, **first)


def provenance(run: Run) -> dict[str, Any]:
    """Provenance of a page: ids, versions, what was asked, and the meaning of every column."""
    known, campaign = run.provenance(), run.root / "campaign.toml"
    columns = ("created_at", "jobs", "plan_id", "scene_id", "ensemble_id", "versions", "engine")
    return {
        "run": run.name,
        "page_written_by": f"toppling {version('toppling')}",
        **{name: known[name] for name in columns},
        "campaign": campaign.read_text(encoding="utf-8") if campaign.exists() else None,
        "columns": run.describe(),
    }


def write_pdf(text: str, target: Path) -> Path:
    """Print the page to PDF with a headless browser; InputError if there is none."""
    browser = next(filter(None, map(shutil.which, _BROWSERS.split())), None)
    if browser is None:
        raise InputError(
            "package.not_installed",
            "no program that prints to PDF is installed",
            where=str(target),
            expected="Chromium, Chrome or Edge on the PATH",
            remedy="install one, or print the page from any browser",
        )
    with tempfile.TemporaryDirectory() as folder, new_file(target) as hidden:
        source, printed = Path(folder) / "report.html", Path(folder) / "report.pdf"
        source.write_text(text, encoding="utf-8")
        command = [
            browser, "--headless=new", "--disable-gpu", "--no-pdf-header-footer", f"--user-data-dir={folder}/profile",
            f"--print-to-pdf={printed}", source.as_uri(),
        ]  # fmt: skip
        if os.geteuid() == 0:
            command.insert(1, "--no-sandbox")  # Chromium has no sandbox for root
        subprocess.run(command, check=True, capture_output=True, timeout=_PRINTING_S)
        shutil.copyfile(printed, hidden)
    return target
