"""The figures: drawing only, from the tables of `results.fragility`.

Readable at paper width (178 mm), colour-blind safe, units on every axis. Empty cells stay empty, thin ones
carry a dot, and a cell is as wide as its share of the jobs, which the colour bar says.
"""

import math
from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.axes import Axes
from matplotlib.axis import XAxis
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter
from numpy.typing import NDArray
from scipy.stats import norm

from toppling.models.folder import new_file
from toppling.models.frames import compass_deg
from toppling.models.motions.motion import Motion
from toppling.results.fits import Lognormal, Resampled
from toppling.results.fragility import FRICTION, THIN_RECORDS, Axis, Plane
from toppling.results.friction import friction_words
from toppling.results.hazard import HazardCurve
from toppling.results.schema import SCHEMA, describe

FULL_WIDTH_IN = 7.0
HALF_WIDTH_IN = 3.6
HEADING_IN = 0.15
"""Height of a line above or below all panels."""
FULL_SHARE = 0.4
"""Share of the jobs from which on a cell fills its bin; without it, the narrow columns would vanish."""

LAST_TICK = 0.85
"""Share of a small panel's width beyond which no tick is labelled."""
DIRECTION_CAPTION = "panels: azimuth of the vector PGA (east 0°, north 90°)"

COLOURS = sns.color_palette("viridis", as_cmap=True)
"""Equal steps in lightness, so that it reads in grey and with every kind of colour vision."""

_STYLE = {
    "savefig.dpi": 200,
    "svg.fonttype": "none",  # text stays text, to be searched and edited
    "svg.hashsalt": "toppling",  # the same table gives the same file
    "axes.linewidth": 0.6,
    "font.size": 8,
    "axes.labelsize": 8,
    "axes.titlesize": 7.5,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 3,
    "ytick.major.size": 3,
    "legend.fontsize": 7,
}


def map_figure(
    table: pd.DataFrame, plane: Plane, title: str = "", unplaced: int = 0, beyond: int = 0
) -> Figure:
    """One map: toppling probability in the cells of a plane.

    Parameters
    ----------
    table : DataFrame
        From `results.fragility.cells`.
    plane : Plane
        The plane it was made for.
    title : str
    unplaced, beyond : int
        From `results.fragility`'s functions of these names.
    """
    with style():
        figure = Figure(figsize=(HALF_WIDTH_IN, 3.0))
        margins = _margins(HALF_WIDTH_IN, 3.0)
        axes = figure.subplots(gridspec_kw=margins)
        _draw_cells(axes, table, plane, f"{title}\n".lstrip(), full_share=_full_share(table))
        axes.set_title(axes.get_title() + _beyond(plane, beyond) + _missing(unplaced))
        _frame_cells(axes, table, plane)
        axes.set(xlabel=_label(plane.x), ylabel=_label(plane.y))
        _colour_bar(figure, margins, _width_words(table, plane))
    return figure


def direction_figure(
    table: pd.DataFrame,
    plane: Plane,
    bins: int,
    title: str = "",
    reference: pd.DataFrame | None = None,
    unplaced: int = 0,
) -> Figure:
    """One map for each direction bin of the vector PGA, on shared axes.

    Parameters
    ----------
    table : DataFrame
        From `results.fragility.cells_by_direction`.
    plane : Plane
        The plane it was made for.
    bins : int
        Direction bins around the circle.
    title : str
    reference : DataFrame or None
        From `results.plane_reference.reference_lines`, for a plane of PGV/PGA and PGA.
    unplaced : int
        From `results.fragility.unplaced`.
    """
    directions = sorted(table["direction_deg"].dropna().unique())
    columns = min(4, max(1, len(directions)))
    lines = max(1, -(-len(directions) // columns))
    half = 180.0 / bins
    heading = (title + _missing(unplaced) + _told_lines(reference)).removeprefix(", ")
    with style():
        width = FULL_WIDTH_IN if columns > 1 else HALF_WIDTH_IN
        height = 0.6 + 2.1 * lines + HEADING_IN * (2 if heading else 1)
        figure = Figure(figsize=(width, height))
        margins = _margins(width, height, above_in=HEADING_IN if heading else 0.0, below_in=HEADING_IN)
        apart = {**margins, "wspace": 0.1, "hspace": 0.3}
        grid = figure.subplots(lines, columns, sharex=True, sharey=True, squeeze=False, gridspec_kw=apart)
        for axes, direction in zip(grid.flat, directions, strict=False):
            compass = float(compass_deg(direction))
            told = f"{direction - half:g}° to {direction + half:g}°\ncompass {compass:g}°, "
            cells = table[table["direction_deg"] == direction]
            _draw_cells(axes, cells, plane, told, full_share=_full_share(table))
            _frame_cells(axes, table, plane)
            left, right = axes.get_xlim()
            ticks = MaxNLocator(4).tick_values(left, right)
            # The last would run into the first of the panel beside it.
            axes.set_xticks(ticks[(ticks >= left) & (ticks <= left + LAST_TICK * (right - left))])
            if reference is not None:
                _draw_lines(axes, reference[reference["azimuth_deg"] == direction])
        for axes in grid.flat[len(directions) :]:
            axes.set_axis_off()
        figure.supxlabel(f"{_label(plane.x)}\n{DIRECTION_CAPTION}", size=8)
        figure.supylabel(_label(plane.y), size=8)
        figure.text(0.01, 0.99, heading, size=8, va="top")
        _colour_bar(figure, margins, _width_words(table, plane))
    return figure


def rose_figure(rose: pd.DataFrame, quasi_static: pd.DataFrame | None, sector: dict[str, float]) -> Figure:
    """Where the rock topples to, beside the least constant ground acceleration that topples it, by azimuth.

    Parameters
    ----------
    rose : DataFrame
        From `results.directions.topple_rose`.
    quasi_static : DataFrame or None
        azimuth_deg of the ground's acceleration, and value in m/s2.
    sector : dict
        From `results.directions.sector_share`.
    """
    with style():
        figure = Figure(figsize=(FULL_WIDTH_IN, 3.3))
        left, right = figure.subplots(
            1, 2, subplot_kw={"projection": "polar"}, gridspec_kw={"top": 0.8, "bottom": 0.14}
        )
        width = 2 * np.pi / len(rose)
        left.bar(
            np.deg2rad(rose["azimuth_deg"]), 100 * rose["share_of_toppled"], width, color=COLOURS(0.35), lw=0
        )
        left.set_title(
            f"toppled toward azimuth, % of {sector['toppled']} toppled\n{sector['low_deg']:g}° to "
            f"{sector['high_deg']:g}°: {100 * sector['share_of_jobs']:.0f} % of {sector['jobs']} jobs, "
            f"{100 * sector['share_of_toppled']:.0f} % of the toppled"
        )
        if quasi_static is not None and len(quasi_static):
            closed = pd.concat([quasi_static, quasi_static.iloc[:1]])
            right.plot(np.deg2rad(closed["azimuth_deg"]), closed["value"], color=COLOURS(0.35), lw=1.2)
            right.set_rlim(0.0)
            right.set_title(
                "quasi-static toppling acceleration (m/s²)\nby azimuth of the ground's acceleration"
            )
        else:
            right.set_visible(False)
        for axes in (left, right):
            axes.tick_params(labelsize=6.5)
            axes.grid(linewidth=0.4)
            axes.yaxis.set_major_locator(MaxNLocator(4))
            axes.set_xlabel("azimuth, counter-clockwise from east")
    return figure


def friction_figure(table: pd.DataFrame, jobs: pd.DataFrame) -> Figure:
    """Each cell's toppling probability under one friction against that under the reference.

    Parameters
    ----------
    table : DataFrame
        From `results.friction.compare_cells`.
    jobs : DataFrame
        From `results.friction.compare_jobs`.
    """
    reference = _friction(jobs.iloc[0], "reference_")
    with style():
        width = min(FULL_WIDTH_IN, 0.8 + 2.6 * len(jobs))
        figure = Figure(figsize=(width, 0.9 + (width - 0.8) / len(jobs)))
        grid = figure.subplots(
            1,
            len(jobs),
            sharey=True,
            squeeze=False,
            gridspec_kw={"bottom": 0.16, "top": 0.86, "left": 0.12},
        )
        for axes, (_, counts) in zip(grid.flat, jobs.iterrows(), strict=True):
            friction = _friction(counts)
            cells = table[(table[FRICTION] == counts[FRICTION]).all(axis=1)]
            for thin, face in ((False, COLOURS(0.35)), (True, "none")):
                some = cells[cells["thin"] == thin]
                axes.scatter(
                    some["reference_probability"],
                    some["probability"],
                    s=10,
                    facecolors=face,
                    linewidths=0.5,
                    edgecolors=COLOURS(0.35),
                    label=f"{'<' if thin else '≥'} {THIN_RECORDS} records",
                    clip_on=False,
                )
            axes.plot([0, 1], [0, 1], "k--", lw=0.8)
            for shift in (-0.3, 0.3):
                axes.plot(
                    [max(0, -shift), min(1, 1 - shift)], [max(0, shift), min(1, 1 + shift)], "k-", lw=0.6
                )
            axes.set(
                xlim=(0, 1),
                ylim=(0, 1),
                aspect="equal",
                xlabel=f"toppling probability, friction {reference}",
                title=f"of {counts['pairs']:g} pairs of jobs, {counts['only_this']:g} topple only at "
                f"{friction},\n{counts['only_reference']:g} only at {reference}",
            )
            axes.set_ylabel(f"toppling probability, friction {friction}")
        grid.flat[-1].legend(loc="lower right", frameon=False)
    return figure


def _friction(counts: pd.Series, prefix: str = "") -> str:
    return friction_words(*(counts[prefix + name] for name in FRICTION))


FIT_CAPTION = (
    "All intervals are of 95 %. Bars left and right: Wilson's, by record. "
    "Band, and bars in the middle: of records drawn anew (bootstrap)."
)


def fit_figure(
    curve: Lognormal,
    resampled: Resampled | None,
    observed: pd.DataFrame,
    ranking: pd.DataFrame,
    calibrated: pd.DataFrame,
) -> Figure:
    """Best single measure's fragility with its band, how the measures rank, and how predictions hold.

    Parameters
    ----------
    curve : Lognormal
    resampled : Resampled or None
        From `results.fits.bootstrap`.
    observed, ranking, calibrated : DataFrame
        From `results.fits`: observed_shares, compare_measures, calibration.
    """
    with style():
        figure = Figure(figsize=(FULL_WIDTH_IN, 2.6))
        left, middle, right = figure.subplots(
            1, 3, gridspec_kw={"wspace": 0.75, "bottom": 0.24, "left": 0.07, "right": 0.98, "top": 0.9}
        )
        figure.text(0.5, 0.01, FIT_CAPTION, ha="center", size=6.5)
        _draw_curve(left, curve, resampled, observed)
        places = np.arange(len(ranking))[::-1]
        if "worse_by" in ranking:
            bars = np.abs(
                ranking[["worse_by_low", "worse_by_high"]].to_numpy().T - ranking["worse_by"].to_numpy()
            )
            middle.errorbar(
                ranking["worse_by"], places, xerr=bars, fmt="o", ms=3, lw=0.8, color=COLOURS(0.35)
            )
        lost = ranking["worse_by"].isna() if "worse_by" in ranking else np.full(len(ranking), fill_value=True)
        for place in places[lost]:
            middle.text(
                0.04,
                place,
                "no fit",
                va="center",
                size=6.5,
                color="0.4",
                transform=middle.get_yaxis_transform(),
            )
        middle.set_ylim(-0.6, len(ranking) - 0.4)
        middle.set_yticks(places, [_short(name) for name in ranking["measures"]])
        middle.set(xlabel="log loss above the best's", title="which measure predicts best")
        right.plot([0, 1], [0, 1], "k--", lw=0.8)
        bars = np.abs(
            calibrated[["wilson_low", "wilson_high"]].to_numpy().T - calibrated["observed"].to_numpy()
        )
        right.errorbar(
            calibrated["predicted"], calibrated["observed"], bars, fmt="o", ms=3, lw=0.6, color=COLOURS(0.35)
        )
        right.set(
            xlabel="predicted probability", ylabel="observed share", title="other records predicted",
            xlim=(0, 1), ylim=(0, 1), aspect="equal",
        )  # fmt: skip
    return figure


def way_figure(table: pd.DataFrame, motion: Motion, title: str, topple_time_s: float | None = None) -> Figure:
    """Ground motion, tilt and way of the rock against time.

    Parameters
    ----------
    table : DataFrame
        From `results.replay.way_table`.
    motion : Motion
        As imposed: drawn whole, where the table leaves out the time that the engine skips.
    title : str
    topple_time_s : float or None
        Time of no return, marked by a line.
    """
    axes_of_the_frame = (("x", "east", "-"), ("y", "north", "--"), ("z", "up", ":"))
    with style():
        figure = Figure(figsize=(FULL_WIDTH_IN, 6.0))
        grid = figure.subplots(
            4, 1, sharex=True, gridspec_kw={"left": 0.1, "right": 0.88, "top": 0.95, "bottom": 0.07}
        )
        times = motion.time_s
        velocity = motion.velocity_at(times)
        for column, (axis, name, dashes) in enumerate(axes_of_the_frame):
            look = {"color": COLOURS((0.1, 0.5, 0.75)[column]), "ls": dashes, "lw": 0.9, "label": name}
            grid[0].plot(times, motion.acceleration_m_s2[:, column], **look)
            grid[1].plot(times, velocity[:, column], **look)
            grid[3].plot(table["time_s"], table[f"com_{axis}_m"] - table[f"com_{axis}_m"].iloc[0], **look)
        grid[2].plot(table["time_s"], table["tilt_deg"], color=COLOURS(0.1), lw=0.9)
        labels = (
            "ground acceleration\n(m/s²)",
            "ground velocity\n(m/s)",
            "tilt (°)",
            "centre of mass,\nway (m)",
        )
        for axes, label in zip(grid, labels, strict=True):
            axes.set_ylabel(label)
            if topple_time_s is not None:
                axes.axvline(topple_time_s, color="0.4", lw=0.8, dashes=(4, 2))
        if topple_time_s is not None:
            grid[2].annotate(
                "no return", (topple_time_s, 0.9), xycoords=("data", "axes fraction"), size=7,
                ha="right", xytext=(-3, 0), textcoords="offset points",
            )  # fmt: skip
        for axes in grid[[0, 1, 3]]:
            axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
        grid[-1].set_xlabel("time (s)")
        figure.align_ylabels(grid)
        figure.suptitle(title, size=8)
    return figure


FRONT_PANELS = {
    "flips_share": "answers that differ (%)",
    "median_shift": "shift of the median PGA (%)",
    "largest_threshold_error": "largest error of a threshold (%)",
}


def front_figure(table: pd.DataFrame, floor: str) -> Figure:
    """Errors of each setting against its cost, with the floor of chaos dashed.

    Parameters
    ----------
    table : DataFrame
        Columns setting, processor_s_per_simulated_s, flips_share, flips_share_std, median_shift, and
        largest_threshold_error where it was measured (NaN for a setting without).
    floor : str
        The setting whose flips are the floor.
    """
    shown = {column: label for column, label in FRONT_PANELS.items() if column in table}
    with style():
        figure = Figure(figsize=(FULL_WIDTH_IN, 2.9))
        for axes, (column, label) in zip(
            figure.subplots(1, len(shown), sharex=True), shown.items(), strict=True
        ):
            for number, (_, row) in enumerate(table.iterrows()):
                is_floor = row["setting"] == floor
                axes.errorbar(
                    1e3 * row["processor_s_per_simulated_s"], 100.0 * row[column],
                    100.0 * row["flips_share_std"] if column == "flips_share" else None,
                    fmt="osD^vPX"[number % 7], ms=4.5, elinewidth=0.7, capsize=2, label=row["setting"],
                    color="0.5" if is_floor else COLOURS(number / len(table)), zorder=3,
                )  # fmt: skip
                if is_floor and column == "flips_share":
                    axes.axhline(100.0 * row[column], color="0.5", linewidth=0.8, linestyle="--")
            if column == "median_shift":
                axes.axhline(0.0, color="0.5", linewidth=0.8)
            else:
                axes.set_ylim(0.0, 1.1 * axes.get_ylim()[1])  # settings may all have one value
            axes.set_xscale("log")
            _plain_log(axes.xaxis)
            axes.margins(x=0.15)
            axes.set_xlabel("cost (processor ms\nper simulated second)")
            axes.set_ylabel(label)
        figure.legend(*axes.get_legend_handles_labels(), loc="upper center", ncols=3, frameon=False)
        sns.despine(figure)
        figure.tight_layout(rect=(0.0, 0.0, 1.0, 1.0 - 0.07 * math.ceil(len(table) / 3)))
    return figure


def constraint_figure(bound: pd.DataFrame, branches: Sequence[HazardCurve], confidence: float) -> Figure:
    """Which rates of exceedance the standing rocks reject, with the hazard curves that were asked about.

    Parameters
    ----------
    bound : DataFrame
        From `results.constraint.bound_table`.
    branches : sequence of HazardCurve
    confidence : float
    """
    measure = bound.columns[0]
    rate = bound["rejected_annual_rate"]
    with style():
        figure = Figure(figsize=(HALF_WIDTH_IN, 3.0))
        axes = figure.subplots(gridspec_kw={"left": 0.18, "right": 0.97, "bottom": 0.16, "top": 0.95})
        seen = [_within(bound, branch) for branch in branches]
        least, top = _rates_shown(bound, [rates for rates in seen if len(rates)])
        axes.fill_between(
            bound[measure], rate, top, color="0.85", lw=0, label=f"rejected at {100 * confidence:g} %"
        )
        axes.plot(bound[measure], rate, color="k", lw=1)
        colours = COLOURS(np.linspace(0.15, 0.85, max(1, len(branches))))
        for branch, rates, colour in zip(branches, seen, colours, strict=False):
            name = branch.name if len(rates) else f"{branch.name} (no rates here)"
            axes.plot(branch.intensity, branch.annual_rate, color=colour, lw=1.2, label=name)
        unit = describe(SCHEMA.field(measure))["unit"]
        axes.set(
            xscale="log", yscale="log", xlabel=f"{_short(measure)} ({unit})", ylabel="annual rate exceeded",
            xlim=(bound[measure].min(), bound[measure].max()), ylim=(least, top),
        )  # fmt: skip
        _plain_log(axes.xaxis)
        axes.legend(loc="upper right", frameon=False)
    return figure


def _within(bound: pd.DataFrame, branch: HazardCurve) -> NDArray[np.float64]:
    """Rates of a branch at the bound's intensities that it has."""
    intensity = bound.iloc[:, 0].to_numpy()
    inside = (intensity >= branch.intensity[0]) & (intensity <= branch.intensity[-1])
    return branch.rate(intensity[inside])


def _rates_shown(bound: pd.DataFrame, drawn: Sequence[NDArray[np.float64]]) -> tuple[float, float]:
    """Ends of the rates: those of the bound, widened to what the branches have at its intensities.

    A branch that falls steeply may leave the frame a thousand times below the bound, but where it comes nearest to
    the bound it is seen, however far off that is.
    """
    rejected = bound["rejected_annual_rate"]
    least, top = rejected.min() / 10, 3 * rejected.max()
    for rates in drawn:
        least = min(least, rates.max() / 10, max(rates.min() / 2, rejected.min() / 1000))
        top = max(top, 3 * rates.min())
    return float(least), float(top)


def _draw_curve(
    axes: Axes,
    curve: Lognormal,
    resampled: Resampled | None,
    observed: pd.DataFrame,
) -> None:
    intensity = np.geomspace(
        min(observed["value"].min(), curve.intensity(0.01)), observed["value"].max() * 1.1, 200
    )
    if resampled is not None and len(resampled.coefficients):
        drawn = norm.cdf(resampled.coefficients[:, :1] + resampled.coefficients[:, 1:] * np.log(intensity))
        axes.fill_between(intensity, *resampled.interval(drawn), color=COLOURS(0.35), alpha=0.3, lw=0)
    axes.plot(intensity, curve.probability(intensity), color=COLOURS(0.35), lw=1.2)
    spread = np.abs(observed[["wilson_low", "wilson_high"]].to_numpy().T - observed["probability"].to_numpy())
    axes.errorbar(observed["value"], observed["probability"], yerr=spread, fmt=".", ms=3, lw=0.6, color="0.2")
    unit = describe(SCHEMA.field(curve.measure))["unit"]
    axes.set(
        xscale="log", ylim=(0, 1), xlabel=f"{_short(curve.measure)} ({unit})", ylabel="toppling probability",
        title=f"median {curve.median:.3g} {unit}, beta {curve.beta:.2f}",
    )  # fmt: skip
    _plain_log(axes.xaxis)


def _plain_log(axis: XAxis) -> None:
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def _short(measures: str) -> str:
    names = {
        "pga_m_s2": "PGA", "pgv_m_s": "PGV", "pgd_m": "PGD", "pgv_pga_s": "PGV/PGA", "sa_1s_m_s2": "SA(1 s)",
        "sa_2s_m_s2": "SA(2 s)", "arias_m_s": "Arias", "cav_m_s": "CAV", "duration_energy_s": "duration",
        "pga_vertical_m_s2": "vertical PGA",
    }  # fmt: skip
    return " + ".join(names.get(name, name) for name in measures.split(" + "))


def save(figure: Figure, stem: Path) -> list[Path]:
    """Write a figure as PNG and SVG beside each other; each appears complete or not at all."""
    written = []
    with style():
        for suffix, told in ((".png", {"Software": None}), (".svg", {"Date": None})):
            target = stem.with_name(stem.name + suffix)
            with new_file(target) as hidden:
                figure.savefig(hidden, format=suffix[1:], metadata=told)
            written.append(target)
    return written


def style() -> AbstractContextManager[None]:
    """Seaborn's ticks, in sizes for print."""
    settings: dict = {**sns.axes_style("ticks"), **sns.plotting_context("paper"), **_STYLE}
    return mpl.rc_context(settings)


def _draw_cells(axes: Axes, table: pd.DataFrame, plane: Plane, title: str, full_share: float) -> None:
    """Each cell a bar in the middle of its bin, as wide as its share of the jobs."""
    low, high = (table[f"{plane.x.column}_{end}"].to_numpy() for end in ("low", "high"))
    bottom, top = (table[f"{plane.y.column}_{end}"].to_numpy() for end in ("low", "high"))
    middle, half = (low + high) / 2, 0.48 * (high - low)
    # Never thinner than the eye can tell a colour.
    half *= np.clip(table["share"].to_numpy() / full_share, 0.08, 1.0)
    corners = np.array(
        [[middle - half, bottom], [middle + half, bottom], [middle + half, top], [middle - half, top]]
    )
    bars = PolyCollection(
        list(corners.transpose(2, 0, 1)),
        cmap=COLOURS,
        norm=Normalize(0, 1),
        edgecolors="0.4",
        linewidths=0.15,
    )
    bars.set_array(table["probability"].to_numpy(float))
    axes.add_collection(bars)
    thin = table["thin"].to_numpy()
    # Bright with a dark rim: seen on every colour.
    axes.plot(
        middle[thin], ((bottom + top) / 2)[thin], "o", ms=1.6, mfc="white", mec="0.2", mew=0.3, clip_on=False
    )
    axes.set_title(f"{title}{table['jobs'].sum()} jobs")


def _missing(unplaced: int) -> str:
    return f", {unplaced} more in no cell: measures not known" if unplaced else ""


def _beyond(plane: Plane, beyond: int) -> str:
    ends = [f"{axis.below:g} {axis.unit}" for axis in (plane.x, plane.y) if axis.below is not None]
    return f", {beyond} more from {' or '.join(ends)} on" if beyond else ""


def _frame_cells(axes: Axes, table: pd.DataFrame, plane: Plane) -> None:
    """Limits that hold all cells of a table, so that maps on shared axes hide none of each other's."""
    low, high = table[f"{plane.x.column}_low"], table[f"{plane.x.column}_high"]
    axes.set_xlim(min(0.0, low.min()) if len(low) else 0.0, high.max() if len(high) else 1.0)
    axes.set_ylim(0.0, table[f"{plane.y.column}_high"].max() if len(table) else 1.0)


def _draw_lines(axes: Axes, lines: pd.DataFrame) -> None:
    """Draw the plane reference's probabilities, inside the cells' frame."""
    frame = axes.axis()
    for probability, line in lines.groupby("probability"):
        dashes = "-" if probability > 0.5 else "--"
        axes.plot(line["pgv_pga_s"], line["pga_m_s2"], dashes, color="white", lw=2.0)
        axes.plot(line["pgv_pga_s"], line["pga_m_s2"], dashes, color="black", lw=0.9)
    axes.axis(frame)


def _told_lines(lines: pd.DataFrame | None) -> str:
    if lines is None or not len(lines):
        return ""
    low, high = (f"{100 * part:g} %" for part in (lines["probability"].min(), lines["probability"].max()))
    return f", lines: where a plane section topples with {low} (dashed) and {high} (solid)"


def _full_share(table: pd.DataFrame) -> float:
    return min(FULL_SHARE, table["share"].max()) if len(table) else FULL_SHARE


def _width_words(table: pd.DataFrame, plane: Plane) -> str:
    pool = "the jobs" if plane.share_within is None else "its level's jobs"
    return f"width: share of {pool}, full from {100 * _full_share(table):.0f} % on"


def _margins(
    width_in: float, height_in: float, above_in: float = 0.0, below_in: float = 0.0
) -> dict[str, float]:
    """Room for labels and colour bar, in inches whatever the figure's size; a layout engine costs seconds."""
    return {
        "left": 0.55 / width_in,
        "right": 1 - 0.85 / width_in,
        "bottom": (0.5 + below_in) / height_in,
        "top": 1 - (0.4 + above_in) / height_in,
    }


def _colour_bar(figure: Figure, margins: dict[str, float], widths: str) -> None:
    width = figure.get_size_inches()[0]
    place = (1 - 0.75 / width, margins["bottom"], 0.12 / width, margins["top"] - margins["bottom"])
    bar = figure.colorbar(ScalarMappable(Normalize(0, 1), COLOURS), cax=figure.add_axes(place))
    bar.set_label(f"toppling probability (dot: < {THIN_RECORDS} records)\n{widths}", size=7)


def _label(axis: Axis) -> str:
    return f"{axis.label} ({axis.unit})"
