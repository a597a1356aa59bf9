"""Figures of several rocks: fragilities and medians, a map, and the scenarios that topple each."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from toppling.models.errors import counted
from toppling.models.scene import Scene
from toppling.results.analysis.side_by_side import RockResults
from toppling.results.drawing.run_figures import draw_band
from toppling.results.drawing.scene_figures import ELEVATION_DEG, draw_view
from toppling.results.drawing.style import (
    ALARM_COLOUR,
    COLOURS,
    FULL_WIDTH_IN,
    LINE_IN,
    cut,
    measure_label,
    plain_log,
    short_name,
    style,
)
from toppling.results.schema import TOPPLED_OUTCOMES

_MOST_NAMED = 60
"""Maximum number of rocks, or of rows and columns of a matrix, that are labelled."""
_THUMBNAIL_IN = 2.2
"""Side of a thumbnail, inches."""


def fragilities_figure(rocks: Sequence[RockResults], measure: str, width_in: float = FULL_WIDTH_IN) -> Figure:
    """Fragilities of the rocks, and their medians with 95 % intervals, the weakest below.

    measure: measure of all curves.
    width_in: width of the figure; two panels side by side at full width, stacked at less.
    """
    drawn = sorted(
        (rock for rock in rocks if rock.curve), key=lambda rock: rock.curve.median if rock.curve else 0.0
    )
    rows_in = LINE_IN * min(len(drawn), _MOST_NAMED)
    in_row = width_in >= FULL_WIDTH_IN
    with style():
        size = (width_in, max(3.0, rows_in + 0.8)) if in_row else (width_in, 3.2 + max(2.0, rows_in + 0.6))
        figure = Figure(figsize=size, layout="constrained")
        left, right = figure.subplots(*((1, 2) if in_row else (2, 1)))
        if not drawn:
            left.text(0.5, 0.5, "no rock has a fragility yet", ha="center", transform=left.transAxes)
            right.set_axis_off()
            return figure
        _draw_curves(left, drawn, measure)
        _draw_medians(right, drawn, measure)
    return figure


def _colours(count: int) -> list[tuple[float, float, float, float]]:
    """Distinct colours with contrast to the paper, without the yellow end of the colour map."""
    return [COLOURS(share) for share in np.linspace(0.0, 0.75, count)]


def _draw_curves(axes: Axes, drawn: Sequence[RockResults], measure: str) -> None:
    curves = [rock.curve for rock in drawn if rock.curve]
    low = min(curve.intensity(0.01) for curve in curves)
    high = max(curve.intensity(0.99) for curve in curves)
    intensity = np.geomspace(low, high, 200)
    for curve, colour in zip(curves, _colours(len(curves)), strict=True):
        draw_band(axes, curve, intensity, colour)
        axes.plot(intensity, curve.probability(intensity), color=colour, lw=1.0)
    axes.set(
        xscale="log", xlim=(low, high), ylim=(0, 1), xlabel=measure_label(measure), ylabel="toppling probability",
        title=counted(len(curves), "rock"),
    )  # fmt: skip
    plain_log(axes.xaxis)


def _draw_medians(axes: Axes, drawn: Sequence[RockResults], measure: str) -> None:
    shown = drawn[:_MOST_NAMED]
    for index, (rock, colour) in enumerate(zip(shown, _colours(len(drawn)), strict=False)):
        curve = rock.curve
        assert curve is not None
        # Beyond the strongest shaking an interval is cut off, and an arrow replaces the median.
        last = curve.strongest_shaken or np.inf
        if curve.median_interval:
            axes.plot(np.minimum(curve.median_interval, last), [index, index], color=colour, lw=1.4)
        axes.plot(
            min(curve.median, last), index, ">" if curve.is_beyond_shaken else "o", ms=3.5, color=colour
        )
    axes.set_yticks(range(len(shown)), [cut(rock.name) for rock in shown])
    more = f", the weakest {_MOST_NAMED}" if len(drawn) > _MOST_NAMED else ""
    arrows = any(rock.curve and rock.curve.is_beyond_shaken for rock in shown)
    arrow = " (arrow: beyond what was run)" if arrows else ""
    axes.set(
        xscale="log", xlabel=measure_label(measure), ylim=(-0.7, len(shown) - 0.3),
        title=f"half topple at this {short_name(measure)}{arrow}{more}",
    )  # fmt: skip
    axes.grid(axis="x", lw=0.4, alpha=0.5)
    plain_log(axes.xaxis)


def _ring_sizes(points: np.ndarray) -> np.ndarray:
    """Areas of dots (points squared), increasing for dots at the same location."""
    seen: dict[tuple[float, float], int] = {}
    sizes = []
    for point in map(tuple, points.round(6).tolist()):
        seen[point] = seen.get(point, 0) + 1
        sizes.append(8.0 * (seen[point] + 1) ** 2)
    return np.array(sizes)


def _across_date_line(points: np.ndarray) -> np.ndarray:
    """Longitudes and latitudes (n, 2), with longitudes continued beyond 180 degrees across the date line."""
    if len(points) < 2:
        return points
    turned = np.sort(points[:, 0] % 360.0)
    widest = int(np.argmax(np.diff(turned, append=turned[0] + 360.0)))
    west = turned[(widest + 1) % len(turned)]  # east end of the widest gap around the Earth
    west -= 360.0 if west >= 180.0 else 0.0
    return np.column_stack([west + (points[:, 0] - west) % 360.0, points[:, 1]])


def _frame_map(axes: Axes, points: np.ndarray) -> None:
    """Set limits, labels and aspect of a map of longitudes and latitudes, with equal distances in both directions."""
    middle, reach = (points.min(axis=0) + points.max(axis=0)) / 2, np.ptp(points, axis=0)
    shrink = np.cos(np.deg2rad(middle[1]))
    half = 0.7 * max(reach[0] * shrink, reach[1], 0.02)
    axes.set(
        xlim=(middle[0] - half / shrink, middle[0] + half / shrink),
        ylim=(max(middle[1] - half, -90.0), min(middle[1] + half, 90.0)),
        xlabel="longitude (°, WGS 84)", ylabel="latitude (°)",
    )  # fmt: skip
    axes.xaxis.set_major_formatter(
        lambda degrees, _: f"{(degrees + 180.0) % 360.0 - 180.0:.6g}".replace("-", "−")
    )
    axes.set_aspect(1.0 / shrink)
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.grid(lw=0.3, alpha=0.5)


def _name_points(axes: Axes, points: np.ndarray, names: Sequence[str]) -> None:
    """Label each point; those at the same location have a common label."""
    together: dict[tuple[float, float], list[str]] = {}
    for (x, y), name in zip(points.round(6).tolist(), names, strict=True):
        together.setdefault((x, y), []).append(cut(name))
    for point, there in together.items() if len(together) <= _MOST_NAMED else ():
        label = ", ".join(there[:3]) + (f" and {len(there) - 3} more" if len(there) > 3 else "")
        left = point[0] > np.mean(axes.get_xlim())
        axes.annotate(
            label, point, xytext=(-6 if left else 6, 5), textcoords="offset points", size=6, color="0.2",
            ha="right" if left else "left",
        )  # fmt: skip


def thumbnail(scene: Scene, weakest_azimuth_deg: float | None) -> Figure:
    """View of a rock perpendicular to its weakest direction, which an arrow shows."""
    azimuth_deg = 0.0 if weakest_azimuth_deg is None else weakest_azimuth_deg
    with style():
        figure = Figure(figsize=(_THUMBNAIL_IN, _THUMBNAIL_IN), layout="constrained")
        axes = figure.subplots()
        draw_view(axes, scene, ELEVATION_DEG, azimuth_deg - 90.0)
        if (
            weakest_azimuth_deg is not None
        ):  # the ground moves to the right of the picture, the rock falls to the left
            axes.annotate(
                "", (0.05, 0.93), xytext=(0.3, 0.93), xycoords="axes fraction",
                arrowprops={"arrowstyle": "->", "color": ALARM_COLOUR, "lw": 1.2},
            )  # fmt: skip
    return figure


def scenarios_figure(rows: pd.DataFrame, matrix: pd.DataFrame) -> Figure:
    """Fraction of shakes that topple each rock under each scenario, and a map where locations are known.

    rows: from `orchestrator.studies.seismograms.check_sites`: rock, longitude, latitude, outcome.
    matrix: fraction by rock (rows) and scenario (columns).
    """
    placed = rows.dropna(subset=["longitude", "latitude"]).groupby("rock", sort=True)
    height = 1.6 + LINE_IN * min(len(matrix), _MOST_NAMED)
    with style():
        size = (FULL_WIDTH_IN, height + (4.4 if len(placed) else 0.0))
        figure = Figure(figsize=size, layout="constrained")
        if not len(placed):
            _draw_matrix(figure.subplots(), matrix, figure)
            return figure
        above, below = figure.subplots(2, 1, height_ratios=(height, 4.4))
        _draw_matrix(above, matrix, figure)
        places = [group[["longitude", "latitude"]].iloc[0] for _, group in placed]
        points = _across_date_line(np.array(places, float))
        fractions = np.array([_unscaled_fraction(group) for _, group in placed])
        _frame_map(below, points)
        sizes, bare = _ring_sizes(points), np.isnan(fractions)
        below.scatter(points[bare, 0], points[bare, 1], sizes[bare], marker="x", color="0.4", lw=0.9)
        behind = np.argsort(-sizes)[~bare[np.argsort(-sizes)]]
        x, y = points[behind].T
        below.scatter(x, y, sizes[behind], fractions[behind], cmap=COLOURS, vmin=0, vmax=1, ec="0.2", lw=0.5)
        texts = ["none" if np.isnan(share) else f"{100 * share:.0f} %" for share in fractions]
        names = [f"{name} {words}" for (name, _), words in zip(placed, texts, strict=True)]
        _name_points(below, points, names)
        below.set_title("fraction of unscaled scenarios that topple each rock")
    return figure


def _unscaled_fraction(rows: pd.DataFrame) -> float:
    """Fraction toppled of the unscaled seismograms with an answer; NaN where there is none."""
    known = rows["outcome"].isin(["stands", "moved", *TOPPLED_OUTCOMES])
    toppled = rows["outcome"].isin(TOPPLED_OUTCOMES)
    return float(toppled.sum() / known.sum()) if known.any() else float("nan")


def _draw_matrix(axes: Axes, matrix: pd.DataFrame, figure: Figure) -> None:
    values = np.ma.masked_invalid(matrix.to_numpy(float))
    shades = COLOURS.with_extremes(bad="0.9")
    image = axes.imshow(values, aspect="auto", cmap=shades, vmin=0, vmax=1, interpolation="nearest")
    few = max(1, int(np.ceil(matrix.shape[1] / _MOST_NAMED)))
    axes.set_xticks(
        range(0, matrix.shape[1], few),
        [str(name)[:16] for name in matrix.columns[::few]],
        rotation=90,
        size=6,
    )
    few = max(1, int(np.ceil(matrix.shape[0] / _MOST_NAMED)))
    axes.set_yticks(range(0, matrix.shape[0], few), [str(name)[:24] for name in matrix.index[::few]], size=6)
    axes.set(
        xlabel="scenario",
        title="share toppled, with the seismogram a little weaker and stronger too (grey: none)",
    )
    figure.colorbar(image, ax=axes, shrink=0.9, label="share toppled")
