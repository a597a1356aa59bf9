"""Output of a replayed shake: table, time series plots, interactive page and animated GIF."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from textwrap import wrap

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation

from toppling.models.arrays import Array
from toppling.models.files.folder import new_file, write_text
from toppling.models.files.table import write_csv
from toppling.models.motions.motion import Motion
from toppling.results.drawing.scene_figures import (
    ARROW_COLOUR,
    ELEVATION_DEG,
    PAGE_HZ,
    azimuth_across,
    flat_triangles,
    painted,
    replay_page,
    shown_times,
    smooth_surface,
    surfaces_of,
    view_frame,
)
from toppling.results.drawing.style import ALARM_COLOUR, COLOURS, FULL_WIDTH_IN, ROCK_COLOUR, save, style
from toppling.results.replayed_job import Replay, trajectory_table

_FRAMES_HZ = PAGE_HZ / 2
"""Frame rate, Hz: half of the page's."""
_MOST_FRAMES = 100
"""Maximum number of frames: a longer shake is played faster, which the heading states."""
_FRAME_IN = (4.8, 6.4)
"""Width and height of a frame, inches of 100 pixels."""
_ARROW_REACH = 0.6
"""Length of the strongest acceleration's arrow, as a fraction of the view's half width."""


def _moving_picture(replay: Replay, path: Path, title: str) -> None:
    """Write a GIF of the part of a shake in which the rock moves, with title, seismogram and speed."""
    times = shown_times(replay, _FRAMES_HZ, _MOST_FRAMES)
    position, attitude = replay.at(times)
    tilts_deg, scene = replay.tilts_deg(attitude), replay.scene
    rock = smooth_surface(scene.rock.vertices_m - scene.rock.com_m, scene.rock.faces, ROCK_COLOUR)
    pedestal, frame = surfaces_of(scene)[1], view_frame(ELEVATION_DEG, azimuth_across(replay))
    speed = _speed_words((times[-1] - times[0]) / (len(times) - 1) * _FRAMES_HZ)
    with style():
        figure = Figure(figsize=_FRAME_IN, dpi=100, layout="constrained")
        canvas = FigureCanvasAgg(figure)
        figure.suptitle("\n".join([*wrap(title, 62), f"{speed}; arrow: ground's acceleration"]), size=8)
        view, below = figure.subplots(2, 1, height_ratios=(5, 1))
        arrows = _set_view(view, replay, position @ frame) * replay.ground_m_s2(times) @ frame
        label, cursor = view.set_title(" ", loc="left"), _draw_seismogram(below, replay, times)
        corners, colours, of_rock = painted([rock, pedestal], frame, scene.pedestal)
        view.add_collection(flat_triangles(corners[~of_rock], colours[~of_rock]), autolim=False)
        base = np.append(scene.rock.com_m[:2], scene.pedestal.point_m[2]) @ frame
        arrow = view.quiver(*base[:2], 0.0, 0.0, color=ARROW_COLOUR, **_TO_SCALE)
        figure.draw_without_rendering()
        figure.set_layout_engine("none")  # all frames have the same
        for artist in (arrow, label, cursor):
            artist.set_animated(True)  # drawn in each frame, not on the background
        canvas.draw()
        background, pictures = canvas.copy_from_bbox(figure.bbox), []
        for shown, turn in enumerate(Rotation.from_quat(attitude).as_matrix()):
            moved_m = position[shown] + rock.vertices_m @ turn.T
            moved = replace(rock, vertices_m=moved_m, normals=rock.normals @ turn.T)
            mesh = flat_triangles(*_unless_behind(*painted([moved, pedestal], frame, scene.pedestal)))
            past = replay.topple_time_s is not None and times[shown] >= replay.topple_time_s
            remark = ", past no return" if past else ""
            label.set(text=f"{times[shown]:.2f} s, tilt {tilts_deg[shown]:.1f}°{remark}")
            label.set(color=ALARM_COLOUR if past else "black")
            arrow.set_UVC(*arrows[shown, :2])
            cursor.set_xdata([times[shown]] * 2)
            canvas.restore_region(background)
            for artist in (view.add_collection(mesh, autolim=False), arrow, label, cursor):
                figure.draw_artist(artist)
            mesh.remove()
            picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
            pictures.append(picture.convert("P", palette=Image.Palette.ADAPTIVE, colors=128))
    # The last pose is shown for a second.
    durations = [round(1000 / _FRAMES_HZ)] * (len(pictures) - 1) + [1000]
    first, *others = pictures
    first.save(path, format="GIF", save_all=True, append_images=others, duration=durations, loop=0)


_TO_SCALE = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.012, "zorder": 3}
"""Settings of Matplotlib's arrows whose ends are coordinates."""


def _unless_behind(corners: Array, colours: Array, of_rock: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Triangles of the rock, and those of its pedestal that may cover it (see `painted`), in the order of painting."""
    rock = corners[of_rock]
    covers = corners[:, :, 2].mean(axis=1) > rock[:, :, 2].min()
    covers &= (corners.max(axis=1) > rock.min(axis=(0, 1)))[:, :2].all(axis=1)
    covers &= (corners.min(axis=1) < rock.max(axis=(0, 1)))[:, :2].all(axis=1)
    return corners[of_rock | covers], colours[of_rock | covers]


def _speed_words(speed: float) -> str:
    """Describe the playback speed relative to real time."""
    if abs(speed - 1.0) < 0.05:
        return "real time"
    return f"{speed:.1f} times real time" if speed > 1.0 else f"1/{1.0 / speed:.1f} of real time"


def _set_view(axes: Axes, replay: Replay, centres: Array) -> float:
    """Limit a view to all poses, whose centres (n, 3) are along its axes; length of arrows per acceleration, s²."""
    rock, motion = replay.scene.rock, replay.motion
    reach = float(np.linalg.norm(rock.vertices_m - rock.com_m, axis=1).max())
    low, high = centres[:, :2].min(axis=0) - reach, centres[:, :2].max(axis=0) + reach
    (x, y), half = 0.5 * (low + high), 0.5 * float((high - low).max())
    axes.set(aspect="equal", xlim=(x - half, x + half), ylim=(y - half, y + half), xticks=[], yticks=[])
    axes.set_facecolor("#f4f6f8")
    return _ARROW_REACH * half / max(float(np.linalg.norm(motion.acceleration_m_s2, axis=1).max()), 1e-9)


def _draw_seismogram(axes: Axes, replay: Replay, times: Array) -> Line2D:
    """Draw the stronger horizontal component over the time shown, and return a cursor."""
    column = int(np.argmax(np.abs(replay.motion.acceleration_m_s2[:, :2]).max(axis=0)))
    at = np.linspace(times[0], times[-1], 2000)
    axes.plot(at, replay.ground_m_s2(at)[:, column], color=COLOURS(0.3), lw=0.6)
    if replay.topple_time_s is not None:
        axes.axvline(replay.topple_time_s, color=ALARM_COLOUR, lw=0.8, dashes=(4, 2))
    axes.set(xlim=(times[0], times[-1]), xlabel="time (s)", ylabel="m/s²")
    axes.set_title(f"ground acceleration toward {('east', 'north')[column]}", loc="left", size=7, pad=3)
    return axes.axvline(times[0], color="black", lw=1.0)


_COMPONENTS = (("x", "east", "-"), ("y", "north", "--"), ("z", "up", ":"))
AFTER_FALL_S = 1.0
"""Duration of ground motion shown after the end of the rock's fall, s."""


def _trajectory_figure(
    table: pd.DataFrame, motion: Motion, title: str, topple_time_s: float | None = None
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
        _moving_picture(replay, hidden, title)
    yield folder / "replay.gif"
