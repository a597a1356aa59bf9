"""One page about a run that a reviewer can read without the program and without a network."""

import base64
import html
import io
import json
from collections.abc import Callable, Iterable, Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from toppling.models.digest import check
from toppling.models.errors import InputError
from toppling.models.folder import new_file
from toppling.results import fits
from toppling.results.directions import SECTOR_DEG, sector_share, topple_rose
from toppling.results.drawing import figures
from toppling.results.fragility import PLANES, beyond, by_contact, cells, cells_by_direction, unplaced
from toppling.results.friction import compare_frictions
from toppling.results.run import Run

_LOOK = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em; color: #222; }
h1, h2, h3 { line-height: 1.2; } h2 { border-bottom: 1px solid #ccc; margin-top: 2em; }
img { max-width: 100%; } figure { margin: 1em 0; } figcaption { color: #555; font-size: 90%; }
table { border-collapse: collapse; font-size: 90%; margin: 1em 0; display: block; overflow-x: auto; }
th, td { padding: .2em .7em; text-align: left; border-bottom: 1px solid #ddd; white-space: nowrap; }
pre { background: #f5f5f5; padding: 1em; overflow-x: auto; }
"""


_BUDGET = Path(__file__).parents[1] / "preset_budget.json"
"""Error and flips of the presets, as `benchmarks/accuracy.py` measured them last."""


FAR_SHAKEN = 10.0
"""Medians above so many times the strongest shaken value are no numbers: nothing was shaken anywhere near."""
_FAR_WORDS = "far beyond what was shaken"


def report_page(run: Run, samples: int = 100, advance: Callable[[str], Any] = lambda _: None) -> str:
    """Write the page about a run.

    Parameters
    ----------
    run : Run
    samples : int
        Bootstrap samples of the fits.
    advance : callable
        Told the name of each section once it is done.

    Returns
    -------
    str
        HTML with its pictures inside.

    Raises
    ------
    InputError
        If no job has an answer yet.
    """
    frame = run.weighted(run.frame())
    if not frame["toppled"].notna().any():
        raise InputError(
            what=f"{len(frame)} jobs, none with an answer",
            where=str(run.path),
            expected="finished jobs",
            remedy="'toppling status RUN' shows how far the run is",
        )
    parts = [_heading(f"Run {run.name}", 1), _summary(run, frame)]
    for title, content in _sections(run, frame, samples):
        parts += [_heading(title, 2), content]
        advance(title)
    head = f"<title>toppling: {_safe(run.name)}</title><style>{_LOOK}</style>"
    body = "\n".join(parts)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">{head}</head>\n'
        f"<body>\n{body}\n</body></html>\n"
    )


SECTIONS = (
    "Scene",
    "Ensemble",
    "Toppling probability",
    "Fits",
    "Failures",
    "Accuracy",
    "Provenance",
    "Columns",
)


def _sections(run: Run, frame: pd.DataFrame, samples: int) -> Iterator[tuple[str, str]]:
    yield "Scene", _scene(run)
    yield "Ensemble", _ensemble(run, frame)
    yield "Toppling probability", _maps(run, frame)
    yield "Fits", "".join(_fits(name, jobs, samples) for name, jobs in by_contact(frame).items())
    yield "Failures", _failures(frame)
    yield "Accuracy", _accuracy(frame)
    yield "Provenance", _provenance(run)
    yield "Columns", _table(pd.DataFrame(run.describe()))


def _summary(run: Run, frame: pd.DataFrame) -> str:
    planned = run.provenance().get("jobs")
    answered = frame["toppled"].notna()
    toppled = int(frame["toppled"].fillna(value=False).sum())
    of = f" of {planned} planned" if planned else ""
    levels = frame["level_pga_m_s2"]
    return (
        f"<p>{len(frame)} jobs{of}, {int(answered.sum())} with an answer, {toppled} toppled: "
        f"{frame['record_id'].nunique()} records, PGA {levels.min():g} to {levels.max():g} m/s². Azimuths "
        "are counter-clockwise from east. Probabilities are shares of the jobs with an answer; their "
        "intervals (95 %) count records, not jobs, since turned and scaled copies of one record are not "
        "independent.</p>"
    )


def _scene(run: Run) -> str:
    parts = []
    picture = run.path / "scene" / "scene.png"
    if picture.exists():
        parts.append(_picture(picture.read_bytes(), "Rock and pedestal of the scene"))
    scene = run.scene()
    if scene is None:
        return "<p>The run holds no scene.</p>"
    row = scene.drop_columns(["quasi_static_toppling"]).to_pylist()[0]
    told = [
        {
            "quantity": field.metadata[b"description"].decode(),
            "value": row[field.name],
            "unit": field.metadata[b"unit"].decode(),
        }
        for field in scene.schema
        if field.name in row
    ]
    if settling := (run.provenance().get("settling") or {}).get("sentence"):
        told.append({"quantity": "from scan to shake", "value": settling, "unit": ""})
    return "".join([*parts, _table(pd.DataFrame(told))])


def _ensemble(run: Run, frame: pd.DataFrame) -> str:
    motions = run.motions()
    used = frame.drop_duplicates("record_id")
    lines = [f"<p>{len(used)} records of {used['event'].nunique()} named earthquakes.</p>"]
    if "record_weight" in frame:
        least, most = used["record_weight"].min(), used["record_weight"].max()
        lines.append(
            f"<p>The records are weighted by a hazard deaggregation, from {least:.3g} to {most:.3g} of an even share: "
            "maps and fits count each by its weight.</p>"
        )
    if motions is not None:
        catalogue = motions.to_pandas()
        catalogue = catalogue[catalogue["record_id"].isin(used["record_id"])]
        shown = [
            name
            for name in ("magnitude", "distance_km", "pga_m_s2", "pgv_m_s", "duration_energy_s")
            if name in catalogue
        ]
        told = catalogue[shown].describe().loc[["count", "min", "50%", "max"]].T
        lines.append(_table(told.rename_axis("as recorded").reset_index()))
    return "".join(lines)


def _maps(run: Run, frame: pd.DataFrame) -> str:
    parts = []
    for contact, jobs in by_contact(frame).items():
        parts.append(_heading(contact, 3) if contact else "")
        for plane in PLANES.values():
            drawn = figures.map_figure(
                cells(jobs, plane), plane, unplaced=unplaced(jobs, plane), beyond=beyond(jobs, plane)
            )
            parts.append(_figure(drawn, f"Toppling probability over {plane.x.label} and {plane.y.label}"))
            if plane.by_direction:
                split = cells_by_direction(jobs, plane)
                missing = unplaced(jobs, plane, by_direction=True)
                drawn = figures.direction_figure(split, plane, 8, unplaced=missing)
                parts.append(_figure(drawn, "The same by azimuth of the vector PGA"))
        sector = sector_share(jobs, *SECTOR_DEG)
        drawn = figures.rose_figure(topple_rose(jobs), run.quasi_static(), sector)
        parts.append(
            _figure(drawn, "Where the rock topples to, and the least constant acceleration that topples it")
        )
    for surroundings, table, pairs in compare_frictions(frame, PLANES["pga_pgv"]):
        parts.append(_heading(surroundings, 3) if surroundings else "")
        drawn = figures.friction_figure(table, pairs)
        parts.append(_figure(drawn, "One friction against another, cell by cell"))
    return "".join(parts)


def _fits(contact: str, jobs: pd.DataFrame, samples: int) -> str:
    known = fits.answered(jobs)
    ranking = fits.compare_measures(known)
    singles = [name for name in ranking["measures"] if name in fits.MEASURES]
    models = [fits.fit(known, [name]) for name in singles]
    resampled = [None if told.problem else fits.bootstrap(known, told, samples) for told in models]
    summary = _fit_table(fits.summary(models, resampled), known)
    parts = [
        _heading(contact, 3) if contact else "", _verdict(ranking), _table(ranking), _table(summary),
        "<p>Intervals (95 %) are of the samples, records drawn anew, that have a fit; samples_without_fit have none: "
        f"their answers are separated, or there are fewer than {fits.LEAST_RECORDS} records. "
        "Below some 20 records the intervals are too narrow. "
        f"What is {_FAR_WORDS} lies above {FAR_SHAKEN:g} times strongest_shaken, where the jobs say nothing.</p>",
    ]  # fmt: skip
    for told, drawn in zip(models, resampled, strict=True):
        if curve := told.lognormal:
            measure = curve.measure
            calibrated = fits.calibration(known, fits.out_of_fold(known, [measure]))
            picture = figures.fit_figure(
                curve, drawn, fits.observed_shares(known, measure), ranking, calibrated
            )
            parts.append(
                _figure(picture, f"Lognormal fragility over {measure}, ranking of measures, calibration")
            )
            break
    return "".join(parts)


def _fit_table(summary: pd.DataFrame, known: pd.DataFrame) -> pd.DataFrame:
    """Fits as the page shows them: without medians that lie far beyond what was shaken."""
    medians = ["median", "median_low", "median_high"]
    betas = ["beta", "beta_low", "beta_high"]
    shown = ["measures", "problem", "strongest_shaken", *medians, *betas, "samples", "samples_without_fit"]
    table = summary.reindex(columns=shown)
    table["strongest_shaken"] = [float(known[name].max()) for name in table["measures"]]
    for name in medians:
        far = table[name].astype(float) > FAR_SHAKEN * table["strongest_shaken"]
        table[name] = table[name].astype(object).mask(far, _FAR_WORDS)
    # Whole numbers, where some fits have none.
    return table.astype({"samples": "Int64", "samples_without_fit": "Int64"})


def _verdict(ranking: pd.DataFrame) -> str:
    """Whether this rock agrees with the study, which says that PGV governs toppling."""
    singles = ranking[~ranking["measures"].str.contains("+", regex=False)].dropna(subset=["log_loss"])
    if not len(singles):
        return "<p>No measure has a fit out of fold: too few records, or separated answers.</p>"
    best = singles["measures"].iloc[0]
    agrees = (
        "as the study says of its rock" if best == "pgv_m_s" else "unlike the study's rock, where it was PGV"
    )
    return (
        f"<p>Of the single measures {_safe(best)} predicts records it was not fitted to best, {agrees}. "
        "A difference in log loss whose interval includes 0 decides nothing.</p>"
    )


def _failures(frame: pd.DataFrame) -> str:
    counts = frame.groupby(["status", "ended_by"], dropna=False).size().rename("jobs").reset_index()
    failed = frame[frame["status"] != "ok"]
    parts = [_table(counts)]
    if len(failed):
        why = failed.groupby(["status", "message"], dropna=False)
        told = why.agg(jobs=("job_id", "size"), example=("job_id", "first")).reset_index()
        parts.append(_table(told.sort_values("jobs", ascending=False).head(20)))
    else:
        parts.append("<p>Every job has an answer.</p>")
    return "".join(parts)


def _accuracy(frame: pd.DataFrame) -> str:
    presets, engines = (", ".join(sorted(frame[name].unique())) for name in ("preset", "engine"))
    # A preset's steps may differ beyond the digits that are shown.
    steps = ", ".join(dict.fromkeys(f"{step:g}" for step in sorted(frame["time_step_s"].dropna())))
    lines = [f"<p>Engine {_safe(engines)}; preset {_safe(presets)}; time step {steps or 'not stated'} s.</p>"]
    if frame["penetration_m"].notna().any():
        lines.append(f"<p>Deepest overlap of rock and pedestal {frame['penetration_m'].max():.2g} m.</p>")
    return "".join([*lines, *_budget(frame)])


def _budget(frame: pd.DataFrame) -> Iterator[str]:
    """What was measured of the run's presets on the demo's rock, by the program's own benchmark."""
    told = json.loads(_BUDGET.read_text(encoding="utf-8"))
    versions = sorted(frame["physics_version"].dropna().unique())
    if versions and versions != [told["physics_version"]]:
        yield (
            f"<p>The presets were measured with physics version {_safe(told['physics_version'])}; this run's "
            f"is {_safe(', '.join(versions))}.</p>"
        )
    jobs, floor = told["jobs"], told["floor_of_chaos"]
    for preset in sorted(frame["preset"].unique()):
        measured = told["presets"].get(preset)
        if measured is None:
            yield f"<p>Preset {_safe(preset)} was not measured.</p>"
            continue
        up, down = measured["flips_to_toppled"], measured["flips_to_standing"]
        yield (
            f"<p>On the demo's rock, of {jobs} jobs near and beyond their thresholds "
            f"({100 * told['toppled_share']:.0f} % topple) {100 * (up + down) / jobs:.1f} % have another answer with "
            f"preset {_safe(preset)} than with reference: {up} topple that stood, {down} stand that toppled. "
            f"{100 * floor:.1f} % flip already when the rock's start is disturbed by a millionth of its height, "
            f"{100 * told['floor_of_chaos_of_motion']:.1f} % when the motion is, and "
            f"{100 * told['flips_of_half_the_step']:.1f} % when reference takes half its step: one job is no "
            "statement about a rock, the share of many is. Least overturning pulses of blocks are met within "
            f"{100 * measured['largest_threshold_error']:.2g} % of the exact integrator. None of this was measured on "
            "this run's rock: <code>toppling accuracy</code> says it of yours.</p>"
        )


def _provenance(run: Run) -> str:
    parts = [f"<p>Page written by toppling {_safe(version('toppling'))}.</p>"]
    for name in ("campaign.toml", "run.json"):
        path = run.path / name
        if path.exists():
            check(path)
            parts.append(f"{_heading(name, 3)}<pre>{_safe(path.read_text())}</pre>")
    return "".join(parts)


def _heading(text: str, level: int) -> str:
    return f"<h{level}>{_safe(text)}</h{level}>"


def _table(frame: pd.DataFrame) -> str:
    head = "".join(f"<th>{_safe(name)}</th>" for name in frame.columns)
    rows = "".join(f"<tr>{_cells(row)}</tr>" for row in frame.itertuples(index=False))
    return f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"


def _cells(row: Iterable[object]) -> str:
    return "".join(f"<td>{_safe(_told(value))}</td>" for value in row)


def _told(value: object) -> str:
    if value is None or value is pd.NA or value != value:
        return ""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _figure(figure: Figure, caption: str) -> str:
    drawn = io.BytesIO()
    with figures.style():
        figure.savefig(drawn, format="png", metadata={"Software": None})
    return _picture(drawn.getvalue(), caption)


def _picture(png: bytes, caption: str) -> str:
    data = base64.b64encode(png).decode()
    return (
        f'<figure><img alt="{_safe(caption)}" src="data:image/png;base64,{data}">'
        f"<figcaption>{_safe(caption)}</figcaption></figure>"
    )


def _safe(text: object) -> str:
    return html.escape(str(text))


def write_page(page: str, target: Path) -> Path:
    """Write the page; it appears complete or not at all."""
    with new_file(target) as hidden:
        hidden.write_text(page, encoding="utf-8")
    return target
