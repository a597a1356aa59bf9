"""Figures, tables and sentences on fits, and the files of a run's figures and their tables."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.special import ndtr

from toppling.models.arrays import Array
from toppling.models.files.table import write_csv
from toppling.models.motions.measures import COMPARED, OPENQUAKE
from toppling.results.analysis import fits, lognormal, resampling
from toppling.results.analysis.exchange import write_curves
from toppling.results.analysis.fragility import (
    DIRECTION_BINS,
    DirectionCells,
    Plane,
    beyond,
    by_contact,
    cells,
    compare_frictions,
    contact_words,
    sector_fraction,
    topple_rose,
    unplaced,
)
from toppling.results.analysis.lognormal import Lognormal
from toppling.results.analysis.resampling import LEAST_RECORDS
from toppling.results.drawing.maps import direction_figure, friction_figure, map_figure
from toppling.results.drawing.roses import rose_figure
from toppling.results.drawing.style import (
    FULL_WIDTH_IN,
    MAIN_COLOUR,
    digits,
    measure_label,
    plain_log,
    printed_unit,
    save,
    short_name,
    style,
    within,
)
from toppling.results.reader import Completeness

_FIT_CAPTION = (
    "All intervals are of 95 %. Bars of shares: Wilson's, by earthquake.",
    "Band, and bars of the ranking: bootstrap of earthquakes and bases.",
)


def fit_figure(
    curve: Lognormal,
    observed: pd.DataFrame,
    ranking: pd.DataFrame,
    calibrated: pd.DataFrame,
    width_in: float = FULL_WIDTH_IN,
) -> Figure:
    """Fragility of one measure with its interval, ranking of the measures, and calibration of the predictions.

    observed, ranking, calibrated: from `analysis.ranking`: observed_fractions, compare_measures, calibration.
    width_in: width of the figure; three panels in a row at full width, stacked at less.
    """
    in_row = width_in >= FULL_WIDTH_IN
    with style():
        figure = Figure(figsize=(width_in, 2.75) if in_row else (width_in, 7.6))
        shape, room = (
            ((1, 3), {"wspace": 0.72, "bottom": 0.27, "left": 0.075, "right": 0.975, "top": 0.86})
            if in_row
            else ((3, 1), {"hspace": 0.5, "bottom": 0.11, "left": 0.27, "right": 0.95, "top": 0.96})
        )
        left, middle, right = figure.subplots(*shape, gridspec_kw=room)
        caption = (" " if in_row else "\n").join(_FIT_CAPTION)
        figure.text(0.5, 0.008, caption, ha="center", va="bottom", size=6.5, color="0.25")
        draw_curve(left, curve, observed)
        median = within(curve.median, *curve.shaken)
        left.set_title(f"median {median} {printed_unit(curve.measure)}, beta {curve.beta:.2f}")
        _draw_ranking(middle, ranking)
        middle.set_title("which measure predicts best")
        _draw_calibration(right, calibrated)
    return figure


def draw_curve(axes: Axes, curve: Lognormal, observed: pd.DataFrame) -> None:
    """Draw a lognormal fragility with its interval, over the observed fractions with theirs."""
    intensity = np.geomspace(
        min(observed["value"].min(), curve.intensity(0.01)), observed["value"].max() * 1.1, 200
    )
    draw_band(axes, curve, intensity, MAIN_COLOUR)
    axes.plot(intensity, curve.probability(intensity), color=MAIN_COLOUR, lw=1.2)
    draw_fractions(axes, observed, "value", "probability", fmt=".", ms=4, lw=0.6, color="0.2", clip_on=False)
    axes.set(
        xscale="log", ylim=(0, 1), xlim=(intensity[0], intensity[-1]), xlabel=measure_label(curve.measure),
        ylabel="toppling probability",
    )  # fmt: skip
    plain_log(axes.xaxis)


def draw_band(axes: Axes, curve: Lognormal, intensity: Array, colour: Any) -> None:
    """Fill the 95 % interval, over resampled records and bases, at each intensity."""
    resampled = curve.resampled
    if resampled is not None and len(resampled.coefficients):
        drawn = ndtr(resampled.coefficients[:, :1] + resampled.coefficients[:, 1:] * np.log(intensity))
        axes.fill_between(intensity, *lognormal.ends(drawn), color=colour, alpha=0.3, lw=0)


def draw_fractions(axes: Axes, table: pd.DataFrame, x: str, share: str, **dots: Any) -> None:
    """Draw fractions as dots with their intervals."""
    ends = table[["wilson_low", "wilson_high"]].to_numpy().T
    axes.errorbar(table[x], table[share], np.abs(ends - table[share].to_numpy()), **dots)


def _draw_ranking(axes: Axes, ranking: pd.DataFrame) -> None:
    """Draw each measure's log loss minus that of the best, with its interval."""
    places = np.arange(len(ranking))[::-1]
    if "worse_by" in ranking:
        # Few records have no interval, and so no bar.
        ends = ranking.reindex(columns=["worse_by_low", "worse_by_high"]).to_numpy(float).T
        bars = np.abs(ends - ranking["worse_by"].to_numpy())
        axes.axvline(0.0, color="0.7", lw=0.6)
        axes.errorbar(ranking["worse_by"], places, xerr=bars, fmt="o", ms=3, lw=0.8, color=MAIN_COLOUR)
    lost = ranking["worse_by"].isna() if "worse_by" in ranking else np.full(len(ranking), fill_value=True)
    for height in places[lost]:
        axes.text(
            0.04, height, "no fit", va="center", size=6.5, color="0.4", transform=axes.get_yaxis_transform()
        )
    axes.set_ylim(-0.6, len(ranking) - 0.4)
    axes.set_yticks(places, [short_name(name) for name in ranking["measures"]])
    axes.set(xlabel="log loss above the best's")


def _draw_calibration(axes: Axes, calibrated: pd.DataFrame) -> None:
    """Draw observed fraction against predicted probability, of records left out of the fit."""
    axes.plot([0, 1], [0, 1], "k--", lw=0.8)
    dots: dict[str, Any] = {"fmt": "o", "ms": 3, "lw": 0.6, "color": MAIN_COLOUR, "clip_on": False}
    draw_fractions(axes, calibrated, "predicted", "observed", **dots)
    axes.set(
        xlabel="predicted probability", ylabel="observed share", title="records left out of the fit",
        xlim=(0, 1), ylim=(0, 1), xticks=np.linspace(0, 1, 5), xticklabels=["0", "", "0.5", "", "1"],
    )  # fmt: skip


def fit_table(summary: pd.DataFrame, known: pd.DataFrame) -> pd.DataFrame:
    """Table of fits for a page, without numbers for medians outside of what was shaken."""
    shaken = [(float(known[name].max()), float(known[name].min())) for name in summary["measures"]]
    table = pd.DataFrame({
        "measure": [f"{short_name(name)} ({printed_unit(name)})" for name in summary["measures"]],
        "strongest shaken": [digits(value) for value, _ in shaken],
    })  # fmt: skip
    for name, bounds in (("median", shaken), ("beta", [()] * len(shaken))):
        values = summary.reindex(columns=[name, f"{name}_low", f"{name}_high"]).astype(
            float
        )  # none without a fit
        rows = values.itertuples(index=False)
        table[f"{name} (95 %)"] = [
            _with_interval(row, bound) for row, bound in zip(rows, bounds, strict=True)
        ]
    # Whole numbers, where some fits have none.
    counts = summary.reindex(columns=["samples", "samples_without_fit"]).astype("Int64")
    table = table.assign(**{"samples": counts["samples"], "without fit": counts["samples_without_fit"]})
    return table.assign(problem=summary["problem"]) if summary["problem"].astype(bool).any() else table


def _with_interval(numbers: Iterable[float], shaken: tuple[float, ...]) -> str:
    ends = [within(number, *(shaken or (None,))) for number in numbers]
    return f"{ends[0]} ({ends[1]} to {ends[2]})" if ends[1] and ends[2] else ends[0]


def interval_words(jobs: pd.DataFrame) -> str:
    """Format what the intervals of fits to some jobs are over."""
    records, independent = jobs["record_id"].nunique(), lognormal.earthquakes(jobs).nunique()
    if records < LEAST_RECORDS:
        return f"Fewer than {LEAST_RECORDS} records, here {records}, give no intervals."
    of = (
        f"the {records} records"
        if independent == records
        else f"the {independent} earthquakes of {records} records"
    )
    return f"Intervals (95 %) are over bootstrap samples of {of} and of the bases."


def fit_words(summary: pd.DataFrame, known: pd.DataFrame) -> str:
    """Text of lognormal fits for a terminal, and what their intervals are over.

    summary: from `analysis.fits.summary`.
    known: rows with an answer that were fitted.
    """
    curves = summary[summary["measures"].isin(COMPARED)]
    if curves.empty:
        return "no measure is known for every job: there is no fit"
    table = fit_table(curves.reset_index(drop=True), known)
    columns = [name for name in table if name not in ("samples", "without fit")]
    return f"{table[columns].to_string(index=False)}\n{interval_words(known)}"


FIT_PARTS = 20
"""Steps of progress for the fits of a contact, which take longer than a figure (one step)."""


def write_maps(
    frame: pd.DataFrame,
    folder: Path,
    planes: Iterable[Plane],
    directions: int = DIRECTION_BINS,
    run: Completeness | None = None,
) -> Iterator[Path]:
    """Write the maps of each plane, over all directions and by direction, and the number of jobs on none.

    frame: rows of results; several contacts have a subfolder each.
    folder: output folder, created if absent; files of the same names are replaced.
    directions: number of direction bins of the vector PGA.
    run: completeness of the run; an unfinished run is marked above each figure.
    Yields each file, once it is complete.
    """
    planes = list(planes)
    for contact, jobs in by_contact(frame).items():
        target = folder / contact
        left_out, title = [], contact_words(jobs, frame)
        for plane in planes:
            outside = beyond(jobs, plane)
            left_out.append((plane.name, len(jobs), unplaced(jobs, plane), outside))
            yield write_csv(cells(jobs, plane), target / f"{plane.name}.csv")
            yield from save(map_figure(jobs, plane, title), target / plane.name, _remark(run))
            if not plane.by_direction:
                continue
            split = DirectionCells.of(jobs, plane, directions)
            stem = target / f"{plane.name}_by_direction"
            left_out.append((stem.name, len(jobs), split.unplaced, outside))
            yield write_csv(split.table, stem.with_name(f"{stem.name}.csv"))
            yield from save(direction_figure(split, title), stem, _remark(run))
        counts = pd.DataFrame(left_out, columns=["map", "jobs", "unplaced", "beyond"])
        yield write_csv(counts, target / "unplaced.csv")


def write_directions(
    frame: pd.DataFrame,
    quasi_static: pd.DataFrame | None,
    folder: Path,
    sector_deg: tuple[float, float] | None,
    run: Completeness | None = None,
) -> Iterator[Path]:
    """Write the rose of toppling azimuths, the fraction in an optional sector, and the quasi-static limit.

    Yields each file, once it is complete.
    """
    for contact, jobs in by_contact(frame).items():
        target = folder / contact
        rose, sector = topple_rose(jobs), None
        yield write_csv(rose, target / "directions.csv")
        (target / "sector.csv").unlink(missing_ok=True)
        if sector_deg is not None:
            sector = sector_fraction(jobs, *sector_deg)
            yield write_csv(pd.DataFrame([sector]), target / "sector.csv")
        yield from save(rose_figure(rose, quasi_static, sector), target / "directions", _remark(run))


def write_friction(
    frame: pd.DataFrame, folder: Path, plane: Plane, run: Completeness | None = None
) -> Iterator[Path]:
    """Write the comparison of each friction with the highest, cell by cell and job by job.

    Several scenes, presets or restitutions have a subfolder each.

    Yields each file, once it is complete; none for a single friction.
    """
    for surroundings, table, jobs in compare_frictions(frame, plane):
        target = folder / surroundings
        yield write_csv(table, target / "friction_cells.csv")
        yield write_csv(jobs, target / "friction_jobs.csv")
        yield from save(friction_figure(table, jobs), target / "friction", _remark(run))


def write_fits(
    frame: pd.DataFrame,
    folder: Path,
    name: str,
    samples: int = resampling.SAMPLES,
    advance: Callable[[float, str], object] = lambda _, __: None,
    run: Completeness | None = None,
) -> Iterator[Path]:
    """Write the fits of each contact: curves with intervals, surfaces, ranking, calibration, exchange files.

    frame: rows of results.
    name: name of the rock in exchange files.
    samples: number of bootstrap samples of records.
    advance: called with the steps done for a contact, of FIT_PARTS, and the name of the next one.
    run: completeness of the run, stored with curves; an unfinished run is marked above the figure.
    Yields each file, once it is complete.
    """
    for contact, jobs in by_contact(frame).items():
        target = folder / contact / "fits"
        former_files = [file for stem in ("curves", "fits", "surface") for file in target.glob(f"{stem}.*")]
        for former in (*former_files, target / "calibration.csv"):
            former.unlink(missing_ok=True)  # files of measures that have no fit any more are not overwritten
        yield from _write_contact(jobs, target, name, samples, advance, run)


def _write_contact(
    jobs: pd.DataFrame,
    target: Path,
    name: str,
    samples: int,
    advance: Callable[[float, str], object],
    run: Completeness | None,
) -> Iterator[Path]:
    advance(0, "ranking of the measures")
    parts = 0

    def notify(measures: Sequence[str]) -> None:
        names = " and ".join(map(short_name, measures))
        advance(FIT_PARTS / parts, f"bootstrap of the fit over {names}")

    contact = fits.ContactFits(jobs, samples, run, notify=notify)
    yield write_csv(contact.ranking, target / "measures.csv")
    both = set(lognormal.PAIR) <= set(contact.measures)
    parts = len(contact.measures) + both
    of_two = [contact.fitted(lognormal.PAIR)] if both else []
    yield write_csv(fits.summary([*contact.models, *of_two]), target / "fits.csv")
    surfaces = [
        replace(surface, basis=fits.basis_of(jobs, surface.measures[0], run))
        for model in of_two
        if (surface := model.surface)
    ]
    if curves := list(contact.curves.values()):
        for suffix in (".csv", ".json"):
            yield write_curves(target / f"curves{suffix}", curves, name, surfaces)
        if any(curve.measure in OPENQUAKE for curve in curves):
            yield write_curves(target / "curves.xml", curves, name)
        chosen = contact.best or curves[0]
        calibrated = fits.calibration(contact.known, fits.out_of_fold(contact.known, [chosen.measure]))
        yield write_csv(calibrated, target / "calibration.csv")
        observed = fits.observed_fractions(contact.known, chosen.measure)
        figure = fit_figure(chosen, observed, contact.ranking, calibrated)
        yield from save(figure, target / "fits", _remark(run))


def _remark(run: Completeness | None) -> str:
    return run.remark if run else ""
