"""Polar plots of the azimuths a rock topples toward, and of its least constant toppling acceleration."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import MaxNLocator

from toppling.models.arrays import Array
from toppling.models.files.folder import new_file
from toppling.models.frames import WINDS, compass_deg, quadrant_of
from toppling.models.scene import Scene
from toppling.models.statics import support_polygon_m
from toppling.results.drawing.style import FULL_WIDTH_IN, MAIN_COLOUR, style

_WINDS = ("E", "NE", "N", "NW", "W", "SW", "S", "SE")
"""Compass directions in the order of azimuths, counter-clockwise from east."""


def rose_figure(
    rose: pd.DataFrame,
    quasi_static: pd.DataFrame | None,
    sector: dict[str, float] | None,
    width_in: float = FULL_WIDTH_IN,
) -> Figure:
    """Rose of toppling azimuths, and the least constant ground acceleration that topples, by azimuth.

    rose: from `analysis.directions.topple_rose`.
    quasi_static: `Run.quasi_static`.
    sector: from `analysis.directions.sector_fraction`, reported in the title.
    width_in: width of the figure; panels side by side at full width, stacked at less.
    """
    in_row = width_in >= FULL_WIDTH_IN
    with style():
        figure = Figure(figsize=(width_in, 3.4 if in_row else 6.8))
        shape, room = ((1, 2), {"top": 0.76, "bottom": 0.08}) if in_row else (
            (2, 1), {"top": 0.87, "bottom": 0.05, "hspace": 0.5}
        )  # fmt: skip
        left, right = figure.subplots(*shape, subplot_kw={"projection": "polar"}, gridspec_kw=room)
        _draw_petals(left, rose, edgecolor="white", lw=0.4)
        within = "" if sector is None else (
            f"\n{quadrant_of(sector['high_deg'])} to {quadrant_of(sector['low_deg'])}: "
            f"{100 * sector['share_of_jobs']:.0f} % of "
            f"{sector['jobs']:,} jobs,\n{100 * sector['share_of_toppled']:.0f} % of the toppled"
        )  # fmt: skip
        left.set_title(f"falls toward, % of {int(rose['toppled'].sum()):,} toppled{within}")
        if quasi_static is not None and len(quasi_static):
            of = _draw_round(right, quasi_static)
            right.set_title(
                f"least constant acceleration (m/s²){of}\nby where the ground accelerates toward:\n"
                "the rock falls the opposite way"
            )
        else:
            right.set_visible(False)
    return figure


def _draw_petals(axes: PolarAxes, rose: pd.DataFrame, **look: Any) -> None:
    """Draw the fraction of topplings by azimuth, with the scale where it is lowest."""
    width = 2 * np.pi / len(rose)
    axes.bar(
        np.deg2rad(rose["falls_toward_deg"]), 100 * rose["share_of_toppled"], width, color=MAIN_COLOUR, **look
    )
    nearby = rose["toppled"].rolling(3, center=True, min_periods=1).sum()
    mark_winds(axes, float(rose["falls_toward_deg"].iloc[int(nearby.argmin())]))


def _draw_round(axes: PolarAxes, quasi_static: pd.DataFrame) -> str:
    """Draw the least constant toppling acceleration as a closed curve over the azimuths; what it is of."""
    closed = pd.concat([quasi_static, quasi_static[:1]]).astype(float)
    around = np.unwrap(np.deg2rad(closed["ground_accelerates_toward_deg"]))
    axes.plot(around, closed["value"], color=MAIN_COLOUR, lw=1.3)
    of = ""
    if (level := closed["level"].iloc[0]) == level:
        of = f",\nmedian and {100 * level:.0f} % of its bases,"
        axes.fill_between(around, closed["low_m_s2"], closed["high_m_s2"], color=MAIN_COLOUR, alpha=0.2, lw=0)
    axes.set_rlim(0.0)
    mark_winds(
        axes, emptiest_deg(*quasi_static[["ground_accelerates_toward_deg", "value"]].to_numpy(float).T)
    )
    return of


def emptiest_deg(azimuth_deg: np.ndarray, value: np.ndarray) -> float:
    """Azimuth at which a curve is nearest to the centre, where a radial scale overlaps it least."""
    return float(azimuth_deg[np.nanargmin(value)]) if np.isfinite(value).any() else 67.5


def by_compass(directions_deg: Iterable[float]) -> list[float]:
    """Sort azimuths clockwise from north, the order of panels."""
    return sorted(directions_deg, key=lambda azimuth: float(compass_deg(azimuth)))


def wind_of(azimuth_deg: float) -> str:
    """Nearest of the sixteen compass directions to an azimuth (degrees counter-clockwise from east)."""
    return WINDS[round(float(compass_deg(azimuth_deg)) / 22.5) % 16]


def direction_words(direction_deg: float, bins: int) -> str:
    """Compass name of a direction bin, with its azimuths."""
    compass, half = float(compass_deg(direction_deg)), 180.0 / bins
    wind = wind_of(direction_deg) if compass % 45.0 == 0.0 else f"compass {compass:g}°"
    return f"{wind} ({direction_deg - half:g}° to {direction_deg + half:g}°)"


def mark_winds(axes: PolarAxes, scale_deg: float = 67.5) -> None:
    """Label a polar plot with compass directions, and put its radial scale at an azimuth."""
    axes.set_xticks(np.deg2rad(np.arange(0, 360, 45)), _WINDS)
    axes.tick_params(labelsize=7, pad=0)
    axes.grid(linewidth=0.4)
    axes.yaxis.set_major_locator(MaxNLocator(4))
    axes.set_rlabel_position(scale_deg)
    for label in axes.get_yticklabels():
        label.set_bbox({"facecolor": "white", "alpha": 0.8, "lw": 0, "pad": 0.5})


_SCANNED, _STANDS = "#0072b2", "#d55e00"
"""Blue and vermilion of Okabe and Ito, distinguishable with all kinds of colour vision."""
_Rose = Sequence[tuple[float, float]]


def draw_settled(
    scanned: Scene, stands: Scene, outline_m: Array, rose_scanned: _Rose, rose_stands: _Rose, path: Path
) -> None:
    """Write a PNG of two panels: the contact in plan, and the least toppling acceleration by azimuth.

    scanned, stands: scenes of the rock as scanned and after settling.
    outline_m: (k, 3), corners of the contact as scanned.
    rose_scanned, rose_stands: azimuth of the ground's acceleration, degrees counter-clockwise from east, and the least
    constant acceleration that topples, m/s2.
    """
    with style():
        figure = Figure(figsize=(FULL_WIDTH_IN, 4.4), layout="constrained")
        FigureCanvasAgg(figure)
        _plan(figure.add_subplot(1, 2, 1), scanned, stands, outline_m)
        _roses(figure.add_subplot(1, 2, 2, projection="polar"), rose_scanned, rose_stands)
        legends = [axes.get_legend_handles_labels() for axes in figure.axes]
        lines, names = ([entry for part in parts for entry in part] for parts in zip(*legends, strict=True))
        figure.legend(lines, names, loc="outside lower center", ncols=2, frameon=False)
        with new_file(path) as hidden:
            figure.savefig(hidden, format="png")


def _plan(axes: Axes, scanned: Scene, stands: Scene, outline_m: Array) -> None:
    ring = np.vstack([outline_m, outline_m[:1]])
    axes.plot(ring[:, 0], ring[:, 1], "--", color=_SCANNED, linewidth=1.3, label="contact as scanned")
    carrying = support_polygon_m(stands.rock, stands.pedestal)
    ring = np.vstack([carrying, carrying[:1]])
    label = f"{len(carrying)} contact points once settled"
    axes.plot(ring[:, 0], ring[:, 1], "s-", color=_STANDS, markersize=4, linewidth=1.3, label=label)
    for scene, colour, name in ((scanned, _SCANNED, "as scanned"), (stands, _STANDS, "once settled")):
        label = f"centre of mass {name}"
        axes.plot(*scene.rock.com_m[:2], "+", color=colour, markersize=9, markeredgewidth=1.5, label=label)
    axes.set(aspect="equal", xlabel="east (m)", ylabel="north (m)", title="contact from above")


def _roses(axes: Axes, rose_scanned: _Rose, rose_stands: _Rose) -> None:
    assert isinstance(axes, PolarAxes)
    reach, scale_deg = 0.0, 67.5
    for rose, dashes, colour, name in (
        (rose_scanned, "--", _SCANNED, "on the contact as scanned"),
        (rose_stands, "-", _STANDS, "once settled"),
    ):
        azimuth, value = np.array([*rose, (360.0, rose[0][1])]).T
        finite = value[np.isfinite(value)]
        reach = max(reach, float(finite.max()) if len(finite) else 1.0)
        scale_deg = emptiest_deg(azimuth, value)
        axes.plot(np.deg2rad(azimuth), value, dashes, color=colour, label=f"topples {name}")
    axes.set_ylim(0.0, 1.05 * reach)
    axes.set_title("least constant acceleration (m/s²)\nby where the ground accelerates toward")
    mark_winds(axes, scale_deg)
