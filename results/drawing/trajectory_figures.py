"""Output of a replayed shake: table, time series plots, interactive page and animation."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from toppling.models.files.csv_text import write_csv
from toppling.models.files.folder import new_file, write_text
from toppling.models.motions.motion import Motion
from toppling.results.drawing.animation import moving_picture
from toppling.results.drawing.page import replay_page
from toppling.results.drawing.style import ALARM_COLOUR, COLOURS, FULL_WIDTH_IN, save, style
from toppling.results.replayed_job import Replay, trajectory_table

_COMPONENTS = (("x", "east", "-"), ("y", "north", "--"), ("z", "up", ":"))
AFTER_FALL_S = 1.0
"""Duration of ground motion shown after the end of the rock's fall, s."""


def _trajectory_figure(
    table: pd.DataFrame,
    motion: Motion,
    title: str,
    topple_time_s: float | None = None,
) -> Figure:
    """Ground motion, tilt and displacement of the rock against time.

    table: from `results.replayed_job.trajectory_table`.
    motion: imposed motion, drawn also during time that the engine skips. The figure ends soon after a fall, and
    otherwise with the motion or the later end of rocking.
    topple_time_s: time of the point of no return, marked by a line.
    """
    last_s = float(table["time_s"].iloc[-1])
    end_s = max(motion.duration_s, last_s)  # rocking or a fall may continue after the motion
    if topple_time_s is not None:
        end_s = min(end_s, last_s + AFTER_FALL_S)
    shown = motion.time_s <= end_s
    times, velocity = motion.time_s[shown], motion.velocity_at(motion.time_s[shown])
    with style():
        figure = Figure(figsize=(FULL_WIDTH_IN, 7.2))
        grid = figure.subplots(
            6, 1, sharex=True,
            gridspec_kw={
                "left": 0.75 / FULL_WIDTH_IN, "right": 1 - 0.55 / FULL_WIDTH_IN, "top": 0.94, "bottom": 0.06,
                "hspace": 0.16, "height_ratios": (1, 1, 1, 1.2, 1.2, 1.2),
            },
        )  # fmt: skip
        peak = 1.05 * max(float(np.abs(motion.acceleration_m_s2[shown]).max()), 1e-9)
        for axes, column, (axis, name, dashes) in zip(grid[:3], range(3), _COMPONENTS, strict=True):
            colour = COLOURS((0.1, 0.5, 0.75)[column])
            axes.plot(times, motion.acceleration_m_s2[shown, column], color=colour, lw=0.8)
            axes.set(ylim=(-peak, peak), ylabel=name)  # a common scale for comparison
            look = {"color": colour, "ls": dashes, "lw": 1.0, "label": name}
            grid[3].plot(times, velocity[:, column], **look)
            grid[5].plot(table["time_s"], table[f"com_{axis}_m"] - table[f"com_{axis}_m"].iloc[0], **look)
        grid[4].plot(table["time_s"], table["tilt_deg"], color=COLOURS(0.1), lw=1.0)
        grid[0].set_title("ground acceleration (m/s²)", loc="left", pad=3)
        labels = ("ground\nvelocity (m/s)", "tilt (°)", "displacement\nof the rock (m)")
        for axes, label in zip(grid[3:], labels, strict=True):
            axes.set_ylabel(label)
        if topple_time_s is not None:
            _mark_no_return(grid, topple_time_s, late=topple_time_s > 0.75 * end_s)
        for axes in grid[[3, 5]]:
            axes.legend(
                loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, handlelength=1.2, handletextpad=0.4,
                borderaxespad=0.2,
            )  # fmt: skip
        grid[-1].set(xlabel="time (s)", xlim=(0.0, end_s))
        figure.align_ylabels(grid)
        figure.suptitle(title, wrap=True)
    return figure


def _mark_no_return(grid: Sequence[Axes], topple_time_s: float, late: bool) -> None:
    for axes in grid:
        axes.axvline(topple_time_s, color=ALARM_COLOUR, lw=0.8, dashes=(4, 2))
    grid[4].annotate(
        "no return", (topple_time_s, 0.88), xycoords=("data", "axes fraction"), size=7, color=ALARM_COLOUR,
        ha="right" if late else "left", xytext=(-3 if late else 3, 0), textcoords="offset points",
    )  # fmt: skip


def write_replay(replay: Replay, folder: Path, title: str) -> Iterator[Path]:
    """Write table (Parquet, CSV), plots (PNG, SVG), page and animation; yields each path once it is complete."""
    table = trajectory_table(replay)
    frame = table.to_pandas()
    with new_file(folder / "trajectory.parquet") as hidden:
        pq.write_table(table, hidden, compression="zstd")
    yield folder / "trajectory.parquet"
    yield write_csv(frame, folder / "trajectory.csv", digits=7)
    figure = _trajectory_figure(frame, replay.motion, title, replay.topple_time_s)
    yield from save(figure, folder / "trajectory")
    yield write_text(replay_page(replay, title), folder / "replay.html")
    with new_file(folder / "replay.gif") as hidden:
        moving_picture(replay, hidden, title)
    yield folder / "replay.gif"
