"""Figures of the magnitudes and distances that a standing rock excludes, and of the faults around it."""

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from toppling.models.arrays import Array
from toppling.results.drawing.style import COLOURS, FULL_WIDTH_IN, HALF_WIDTH_IN, plain_log, style
from toppling.results.hazard.faults import FaultTrace

_DASHES = ("-", "--", "-.", ":")
_PLATE = {"boxstyle": "square,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.75}
"""Background box of names on the map."""

_REACH_KM = 100.0
"""Maximum reach of the map to include the nearest fault, km; circles may extend it."""


def magnitudes_figure(
    tables: dict[str, pd.DataFrame],
    confidence: float,
    limits: tuple[float, float],
) -> Figure:
    """Largest magnitude allowed at each distance.

    tables: from `results.hazard.magnitudes.largest_magnitudes`, by name of the occurrence.
    limits: (low, high), range of magnitudes of the models.
    """
    with style():
        figure = Figure(figsize=(HALF_WIDTH_IN, 3.0), layout="constrained")
        axes = figure.subplots()
        colours = COLOURS(np.linspace(0.15, 0.75, max(1, len(tables))))
        for number, ((name, table), colour) in enumerate(zip(tables.items(), colours, strict=True)):
            distance = table["distance_km"]
            line = _shown(table["magnitude"], limits)
            none = " (excludes none)" if np.isposinf(table["magnitude"]).all() else ""
            low, high = (table[f"magnitude_{end}"].clip(*limits) for end in ("low", "high"))
            if np.isfinite(low).any():
                axes.fill_between(distance, low, high, color=colour, alpha=0.2, lw=0)
            axes.plot(distance, line, _DASHES[number % 4], color=colour, lw=1.3, label=name + none)
        axes.set(
            xscale="log", ylim=limits, xlim=(distance.min(), distance.max()), xlabel="distance (km)",
            ylabel="magnitude", title=f"magnitudes above the line are excluded at {100 * confidence:g} %",
        )  # fmt: skip
        plain_log(axes.xaxis)
        axes.legend(loc="lower right", frameon=False)
    return figure


def faults_figure(
    faults: Sequence[FaultTrace],
    circles: dict[float, float],
    title: str,
    limits: tuple[float, float],
) -> Figure:
    """Map around a rock: fault traces coloured by the largest allowed magnitude, and circles of smallest distance.

    faults: traces with their largest allowed magnitude: infinite where none is excluded, minus infinity where all are.
    circles: smallest allowed distance, by magnitude.
    limits: (low, high), range of magnitudes of the models.
    """
    known = [
        fault.magnitude for fault in faults if fault.magnitude is not None and math.isfinite(fault.magnitude)
    ]
    shades = Normalize(
        max(limits[0], math.floor(2 * min(known, default=limits[0])) / 2),
        min(limits[1], math.ceil(2 * max(known, default=limits[1])) / 2 + 0.01),
    )
    with style():
        width_in = 0.75 * FULL_WIDTH_IN
        figure = Figure(figsize=(width_in, 0.82 * width_in), layout="constrained")
        axes = figure.subplots()
        reach = _reach_km(faults, circles)
        for fault in faults:
            _draw_fault(axes, fault, shades, reach)
        _draw_circles(axes, circles, _clear_angle(faults, reach))
        axes.plot(0, 0, "k^", ms=5)
        axes.set(
            xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", xlabel="km east of the rock",
            ylabel="km north of the rock", title=title,
        )  # fmt: skip
        if known:
            figure.colorbar(
                ScalarMappable(shades, COLOURS),
                ax=axes,
                shrink=0.8,
                label="largest magnitude that standing allows",
            )
    return figure


def _draw_circles(axes: Axes, circles: dict[float, float], angle: float) -> None:
    round_about = np.linspace(0, 2 * np.pi, 200)
    for magnitude, distance in circles.items():
        if 0 < distance < math.inf:
            axes.plot(
                distance * np.cos(round_about), distance * np.sin(round_about), color="0.4", lw=0.6, ls=":"
            )
            axes.annotate(
                f"M {magnitude:g}: {distance:.2g} km", (distance * math.cos(angle), distance * math.sin(angle)),
                ha="center", va="center", size=6.5, color="0.25", bbox=_PLATE,
            )  # fmt: skip


def _clear_angle(faults: Sequence[FaultTrace], reach: float) -> float:
    """Direction of the labels: farthest from the traces, preferring up or down, where labels overlap less."""
    angles = np.deg2rad([90, 270, 60, 120, 240, 300])
    points = np.concatenate([line for fault in faults for line in fault.lines])
    radii = np.linspace(0.1, 0.6, 6)[:, None] * reach
    clear = [
        min(np.hypot(*(points - step * (math.cos(angle), math.sin(angle))).T).min() for step in radii)
        for angle in angles
    ]
    return float(angles[int(np.argmax(clear))])


def _draw_fault(axes: Axes, fault: FaultTrace, shades: Normalize, reach: float) -> None:
    """Draw a named trace coloured by its magnitude, grey where none is excluded."""
    magnitude = math.inf if fault.magnitude is None else fault.magnitude
    free = magnitude == math.inf
    colour = "0.65" if free else COLOURS(shades(max(magnitude, shades.vmin or 0.0)))
    for line in fault.lines:
        axes.plot(*line.T, color=colour, lw=1.0 if free else 2.0, solid_capstyle="round")
    points = np.concatenate(list(fault.lines))
    inside = points[(np.abs(points) < 0.9 * reach).all(axis=1)]
    if len(inside):
        allowed = "" if free else " (all)" if magnitude == -math.inf else f" ({magnitude:.1f})"
        middle_km = inside[int(np.argmin(np.abs(np.hypot(*inside.T) - 0.6 * reach)))]
        axes.annotate(
            fault.name + allowed, middle_km, size=6.5, color="0.1", xytext=(0, 5), textcoords="offset points",
            ha="left" if middle_km[0] < 0 else "right", bbox=_PLATE,
        )  # fmt: skip


def _reach_km(faults: Sequence[FaultTrace], circles: dict[float, float]) -> float:
    nearest = [min(np.hypot(*line.T).min() for line in fault.lines) for fault in faults]
    widest = max((d for d in circles.values() if math.isfinite(d)), default=0.0)
    return 1.15 * max(widest, min(_REACH_KM, max(nearest, default=0.0)), 5.0)


def _shown(values: pd.Series, limits: tuple[float, float]) -> Array:
    """Values of a line, with infinite ones at the limits of the frame."""
    shown = np.clip(values.to_numpy(float), limits[0], limits[1] + 1e-6)
    beyond = np.flatnonzero(np.isposinf(values.to_numpy(float)))
    shown[beyond[1:] if len(beyond) else beyond] = np.nan
    return shown
