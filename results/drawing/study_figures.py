"""Figures of studies alone: the ramp of figure 4, directionality, cost of presets, calibration of a validation."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from statsmodels.stats.proportion import proportion_confint

from toppling.models.arrays import Array
from toppling.models.frames import compass_deg
from toppling.results.analysis.directions import topple_rose
from toppling.results.analysis.fragility import DIRECTION_BINS, direction_bin_deg
from toppling.results.drawing.roses import by_compass, direction_words, draw_petals
from toppling.results.drawing.style import COLOURS, FULL_WIDTH_IN, HALF_WIDTH_IN, plain_log, style


def ramp_figure(table: pd.DataFrame, azimuth_deg: float, quasi_static_m_s2: float) -> Figure:
    """Least PGA that topples by the waveform's PGV/PGA (figure 4).

    table: from `orchestrator.studies.ramp.summary`.
    azimuth_deg: of the motion.
    quasi_static_m_s2: least constant acceleration of this azimuth that topples.
    """
    toppled = table.dropna(subset=["toppling_pga_m_s2"])
    stood = table[table["toppling_pga_m_s2"].isna()]
    with style():
        figure = Figure(figsize=(HALF_WIDTH_IN, 3.0))
        axes = figure.subplots(gridspec_kw={"left": 0.15, "right": 0.96, "bottom": 0.15, "top": 0.86})
        axes.plot(
            toppled["pgv_pga_s"],
            toppled["toppling_pga_m_s2"],
            "o",
            ms=4,
            color=COLOURS(0.35),
            label="topples",
        )
        if len(stood):
            highest = stood["strongest_standing_m_s2"]
            axes.plot(
                stood["pgv_pga_s"], highest, "^", ms=4, mfc="none", color="0.4", label="stands up to here"
            )
        if np.isfinite(quasi_static_m_s2):
            axes.axhline(quasi_static_m_s2, color="k", lw=0.8, ls="--", label="quasi-static")
        axes.set(xlabel="PGV/PGA, mean over the levels (s)", ylabel="least PGA that topples (m/s²)")
        axes.set_xlim(0.0, 1.1 * float(table["pgv_pga_s"].max()))
        axes.set_ylim(0.0)
        compass = float(compass_deg(azimuth_deg))
        axes.set_title(f"{len(table)} waveforms along {azimuth_deg:g}° (compass {compass:g}°)")
        axes.legend(frameon=False)
    return figure


def topple_by_direction(frame: pd.DataFrame) -> pd.DataFrame:
    """Count toppled jobs by the direction bin of their vector PGA and the azimuth they toppled toward (figure 8).

    Returns DataFrame: direction_deg, azimuth_deg (centres), toppled, share_of_toppled (of the direction's).
    """
    toppled = frame[frame["toppled"].fillna(value=False).astype(bool)].dropna(
        subset=["topple_azimuth_deg", "pga_azimuth_deg"]
    )
    by_direction = toppled.groupby(direction_bin_deg(toppled["pga_azimuth_deg"]))
    roses = [topple_rose(jobs).assign(direction_deg=centre) for centre, jobs in by_direction]
    table = pd.concat(roses or [topple_rose(toppled)[:0].assign(direction_deg=math.nan)], ignore_index=True)
    return table[["direction_deg", "azimuth_deg", "toppled", "share_of_toppled"]]


def topple_direction_figure(table: pd.DataFrame) -> Figure:
    """A rose of toppling azimuths for each direction of the vector PGA, from `topple_by_direction`."""
    directions = by_compass(table["direction_deg"].unique())
    columns = min(4, max(1, len(directions)))
    lines = max(1, -(-len(directions) // columns))
    with style():
        height = 0.45 + 2.35 * lines
        figure = Figure(figsize=(FULL_WIDTH_IN, height))
        grid = figure.subplots(
            lines, columns, squeeze=False, subplot_kw={"projection": "polar"},
            gridspec_kw={
                "hspace": 0.5, "wspace": 0.35, "left": 0.05, "right": 0.95, "top": 1 - 0.95 / height,
                "bottom": 0.25 / height,
            },
        )  # fmt: skip
        for axes, direction in zip(grid.flat, directions, strict=False):
            petals = table[table["direction_deg"] == direction]
            draw_petals(axes, petals, lw=0)
            axes.set_title(
                f"{direction_words(direction, DIRECTION_BINS)}\n{petals['toppled'].sum():,} toppled", pad=4
            )
            axes.tick_params(labelsize=6)
            axes.yaxis.set_major_locator(MaxNLocator(3))
        for axes in grid.flat[len(directions) :]:
            axes.set_axis_off()
        figure.suptitle(
            "toppled toward, % of each panel's topplings\n"
            "panels: compass direction of the vector PGA; azimuths counter-clockwise from east",
            size=8,
            y=1 - 0.06 / height,
        )
    return figure


def directionality_figure(motions: pd.DataFrame) -> Figure:
    """How strongly the records prefer a direction: `directionality` of each, from the catalogue."""
    values = motions["directionality"].dropna().to_numpy(float)
    with style():
        figure = Figure(figsize=(HALF_WIDTH_IN, 2.6))
        axes = figure.subplots(gridspec_kw={"left": 0.15, "right": 0.96, "bottom": 0.18, "top": 0.88})
        axes.hist(values, bins=np.linspace(0.0, 1.0, 21).tolist(), color=COLOURS(0.35))
        axes.set(xlabel="share of PGA reached over 22.5° off its azimuth", ylabel="records", xlim=(0, 1))
        axes.set_title(
            f"{len(values)} records, {int((values > 0.9).sum())} above 0.9: without strong directionality"
        )
    return figure


_FRONT_PANELS = {
    "median_shift": "median PGA (%)",
    "share_shift": "share toppled (points)",
    "tilt_log_ratio": "tilt where both stand (%)",
}


def front_figure(table: pd.DataFrame) -> Figure:
    """What each setting moves of the answer, against its cost; bars of one standard deviation over jobs.

    table: columns setting, processor_s_per_job, and for each panel its shift and, with `_std`, the standard deviation.
    """
    with style():
        figure = Figure(figsize=(FULL_WIDTH_IN, 2.9))
        for axes, (column, label) in zip(
            figure.subplots(1, 3, sharex=True), _FRONT_PANELS.items(), strict=True
        ):
            axes.axhline(0.0, color="0.5", linewidth=0.8)
            for number, (_, row) in enumerate(table.iterrows()):
                axes.errorbar(
                    row["processor_s_per_job"], 100.0 * row[column], 100.0 * row[f"{column}_std"],
                    fmt="osD^vPX"[number % 7], ms=4.5, elinewidth=0.7, capsize=2, label=row["setting"],
                    color=COLOURS(number / len(table)), zorder=3,
                )  # fmt: skip
            axes.set_xscale("log")
            plain_log(axes.xaxis)
            axes.margins(x=0.15)
            axes.set_xlabel("cost (processor s per job)")
            axes.set_ylabel(f"shift of the\n{label}")
        figure.legend(*axes.get_legend_handles_labels(), loc="upper center", ncols=3, frameon=False)
        sns.despine(figure)
        figure.tight_layout(rect=(0.0, 0.0, 1.0, 1.0 - 0.07 * math.ceil(len(table) / 3)))
    return figure


def calibration_figure(
    bins: pd.DataFrame, probability: Array, overturned: NDArray[np.bool_], title: str
) -> Figure:
    """Shares that overturned over the predicted probability, and below it how many tests had which probability.

    Intervals of 95 % (Wilson) count tests as independent, which those of one record are not.
    """
    with style():
        figure = Figure(figsize=(HALF_WIDTH_IN, 1.25 * HALF_WIDTH_IN), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
        above.plot([0, 1], [0, 1], color="0.7", linewidth=0.8)
        hits = bins["overturned"] * bins["tests"]
        low, high = proportion_confint(hits, bins["tests"], method="wilson")
        spread = np.abs(np.vstack([bins["overturned"] - low, high - bins["overturned"]]))
        above.errorbar(
            bins["probability"], bins["overturned"], yerr=spread, fmt="o", markersize=4, color="0.1"
        )
        for x, y, tests in bins[["probability", "overturned", "tests"]].itertuples(index=False):
            above.annotate(f"{int(tests)}", (x, y), xytext=(5, -9), textcoords="offset points", fontsize=7)
        above.set(xlim=(0, 1), ylim=(-0.03, 1.03), ylabel="share that overturned", title=title)
        edges = np.linspace(0.0, 1.0, 21)
        below.hist(
            [probability[~overturned], probability[overturned]], edges, stacked=True, color=["0.75", "0.25"],
            label=["stood", "overturned"],
        )  # fmt: skip
        below.set(xlabel="predicted probability", ylabel="tests")
        below.legend(fontsize=7, frameon=False)
    return figure
