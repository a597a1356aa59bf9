"""Output of a replayed shake: table, time series plots, interactive page and animated GIF."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from textwrap import wrap

import matplotlib as mpl
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.spatial.transform import Rotation

from toppling.models.arrays import Array
from toppling.models.files.folder import new_file, write_text
from toppling.models.files.table import write_csv
from toppling.models.motions.motion import Motion
from toppling.results.drawing.scene_figures import (
    ARROW_COLOUR,
    ELEVATION_DEG,
    PAGE_HZ,
    Surface,
    azimuth_across,
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

WIDTH = 480
STRIP = 92
"""Height of the seismogram's strip, pixels."""

_OVERSAMPLING = 2
"""Factor of resolution at which frames are drawn, to smooth edges."""


@dataclass(frozen=True, eq=False)
class _View:
    """Constant parts of all frames: the rock's surface and the view."""

    rock: Surface  # about its centre of mass, in the pose of its scene
    frame: Array  # axes of the view
    # Centre and half width of the view, along these axes.
    middle: Array
    half_m: float

    def pixels(self, seen_m: Array, size: int) -> Array:
        """Pixel coordinates (..., 2) of points along the view's axes, on a square of `size` pixels."""
        return 0.5 * size * (1.0 + (seen_m[..., :2] - self.middle) / self.half_m * (1.0, -1.0))


def _moving_picture(replay: Replay, path: Path, title: str) -> None:
    """Write a GIF of the part of a shake in which the rock moves, with title, seismogram and speed."""
    times = shown_times(replay, _FRAMES_HZ, _MOST_FRAMES)
    position, turn = replay.at(times)
    tilts = replay.tilts_deg(turn)
    milliseconds = round(1000 / _FRAMES_HZ)
    speed = (times[-1] - times[0]) / (len(times) - 1) / (1e-3 * milliseconds)
    view = _view_of(replay, position)
    ground = _ground(replay, view)
    below = _seismogram(replay, times)
    heading = _heading(title, speed)
    frames = []
    for time, centre_m, attitude, tilt in zip(times, position, turn, tilts, strict=True):
        picture = Image.new("RGB", (WIDTH, heading.height + WIDTH + STRIP), "white")
        picture.paste(heading, (0, 0))
        picture.paste(_pose(replay, view, ground, centre_m, attitude, time), (0, heading.height))
        picture.paste(below, (0, heading.height + WIDTH))
        draw = ImageDraw.Draw(picture)
        past = replay.topple_time_s is not None and time >= replay.topple_time_s
        draw.text(
            (8, heading.height + 6), f"{time:.2f} s, tilt {tilt:.1f}°" + (", past no return" if past else ""),
            fill=ALARM_COLOUR if past else "black", font=_font(14),
        )  # fmt: skip
        x = _across(time, times)
        draw.line(
            [(x, heading.height + WIDTH + 4), (x, heading.height + WIDTH + STRIP - 18)], fill="black", width=2
        )
        frames.append(picture.convert("P", palette=Image.Palette.ADAPTIVE, colors=128))
    # The last pose is shown for a second.
    durations = [milliseconds] * (len(frames) - 1) + [1000]
    frames[0].save(path, format="GIF", save_all=True, append_images=frames[1:], duration=durations, loop=0)


def _speed_words(speed: float) -> str:
    """Describe the playback speed relative to real time."""
    if abs(speed - 1.0) < 0.05:
        return "real time"
    return f"{speed:.1f} times real time" if speed > 1.0 else f"1/{1.0 / speed:.1f} of real time"


def _view_of(replay: Replay, position: Array) -> _View:
    """View across the fall that includes all poses."""
    rock = replay.scene.rock
    frame = view_frame(ELEVATION_DEG, azimuth_across(replay))
    reach = float(np.linalg.norm(rock.vertices_m - rock.com_m, axis=1).max())
    centres = position @ frame[:, :2]
    low, high = centres.min(axis=0) - reach, centres.max(axis=0) + reach
    surface = smooth_surface(rock.vertices_m - rock.com_m, rock.faces, ROCK_COLOUR)
    return _View(surface, frame, 0.5 * (low + high), 0.5 * float((high - low).max()))


def _ground(replay: Replay, view: _View) -> tuple[NDArray[np.uint8], Array]:
    """Colour and depth of the pedestal (see `_drawn`); a plane is always behind the rock."""
    pedestal = replay.scene.pedestal
    triangles, colours, of_rock = painted(surfaces_of(replay.scene), view.frame, pedestal)
    colour, depth = _drawn(view, triangles[~of_rock], colours[~of_rock])
    return colour, np.full_like(depth, -np.inf) if pedestal.is_plane else depth


def _drawn(view: _View, triangles: Array, colours: Array) -> tuple[NDArray[np.uint8], Array]:
    """Orthographic image of coloured triangles (n, 3, 3), sorted from far to near: colour and depth of each pixel.

    A pixel without a triangle has infinite depth.
    """
    size = _OVERSAMPLING * WIDTH
    image = Image.new("I", (size, size))
    draw = ImageDraw.Draw(image)
    for number, outline in enumerate(view.pixels(triangles, size).reshape(-1, 6).tolist(), 1):
        draw.polygon(outline, fill=number)
    numbers = np.asarray(image)
    depth = triangles[:, :, 2].mean(axis=1)
    shades = (255 * np.concatenate([[to_rgb("#f4f6f8")], colours])).astype(np.uint8)
    return shades[numbers], np.concatenate([[-np.inf], depth])[numbers]


def _pose(
    replay: Replay,
    view: _View,
    ground: tuple[NDArray[np.uint8], Array],
    centre_m: Array,
    attitude: Array,
    time_s: float,
) -> Image.Image:
    """Frame of the rock, in front of or behind its pedestal, with the ground's acceleration as an arrow."""
    turn = Rotation.from_quat(attitude).as_matrix().T
    rock = replace(
        view.rock, vertices_m=centre_m + view.rock.vertices_m @ turn, normals=view.rock.normals @ turn
    )
    triangles, colours, _ = painted([rock], view.frame, replay.scene.pedestal)
    colour, depth = _drawn(view, triangles, colours)
    image = Image.fromarray(np.where((depth > ground[1])[:, :, None], colour, ground[0]))
    _draw_arrow(ImageDraw.Draw(image), replay, view, time_s, image.width)
    return image.resize((WIDTH, WIDTH), Image.Resampling.BOX)


def _draw_arrow(draw: ImageDraw.ImageDraw, replay: Replay, view: _View, time_s: float, size: int) -> None:
    motion = replay.motion
    ground = replay.ground_m_s2(time_s)
    strongest = max(float(np.linalg.norm(motion.acceleration_m_s2, axis=1).max()), 1e-9)
    origin = np.append(replay.scene.rock.com_m[:2], replay.scene.pedestal.point_m[2])
    tip = origin + 0.6 * view.half_m * ground / strongest
    start, end = view.pixels(np.array([origin, tip]) @ view.frame, size)
    along = end - start
    length = float(np.hypot(*along))
    if length < 6:
        return
    unit = along / length
    head = min(22.0, 0.5 * length)
    across = np.array([-unit[1], unit[0]]) * 0.5 * head
    draw.line([tuple(start), tuple(end - head * unit)], fill=ARROW_COLOUR, width=7)
    draw.polygon(
        [tuple(end), tuple(end - head * unit + across), tuple(end - head * unit - across)], fill=ARROW_COLOUR
    )


def _heading(title: str, speed: float) -> Image.Image:
    lines = [*wrap(title, 62), f"{_speed_words(speed)}; arrow: ground's acceleration"]
    row = sum(_font(13).getmetrics()) + 4  # the spacing of lines that Pillow uses
    image = Image.new("RGB", (WIDTH, row * len(lines) + 8), "white")
    draw = ImageDraw.Draw(image)
    for number, line in enumerate(lines):
        fill = "black" if number < len(lines) - 1 else "#555555"
        draw.text((8, 4 + row * number), line, fill=fill, font=_font(13))
    return image


def _seismogram(replay: Replay, times: Array) -> Image.Image:
    """Plot of the stronger horizontal component over the time shown, with the point of no return."""
    motion = replay.motion
    column = int(np.argmax(np.abs(motion.acceleration_m_s2[:, :2]).max(axis=0)))
    at = np.linspace(times[0], times[-1], 4 * WIDTH)
    values = replay.ground_m_s2(at)[:, column]
    peak = max(float(np.abs(values).max()), 1e-9)
    image = Image.new("RGB", (WIDTH, STRIP), "white")
    draw = ImageDraw.Draw(image)
    middle, reach = (STRIP - 18) / 2 + 2, (STRIP - 26) / 2
    draw.line([(8, middle), (WIDTH - 8, middle)], fill="#cccccc")
    draw.line(
        [
            (_across(time, times), middle - reach * value / peak)
            for time, value in zip(at, values, strict=True)
        ],
        fill="#31688e",
    )
    if replay.topple_time_s is not None and times[0] <= replay.topple_time_s <= times[-1]:
        x = _across(replay.topple_time_s, times)
        for y in range(4, STRIP - 18, 7):
            draw.line([(x, y), (x, y + 4)], fill=ALARM_COLOUR, width=2)
    component = ("east", "north")[column]
    draw.text(
        (8, STRIP - 17),
        f"ground acceleration toward {component}, peak {peak:.2g} m/s²",
        fill="#444444",
        font=_font(12),
    )
    return image


def _across(time: float, times: Array) -> float:
    return 8 + (time - times[0]) / (times[-1] - times[0]) * (WIDTH - 16)


def _font(size: int) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(str(Path(mpl.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"), size)


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
