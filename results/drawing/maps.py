"""Maps of toppling probability in the cells of a plane: over all directions, by direction, and under two frictions."""

from textwrap import wrap
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from toppling.results.analysis import FEW
from toppling.results.analysis.fragility import (
    FRICTION,
    Axis,
    DirectionCells,
    Plane,
    beyond,
    cells,
    friction_words,
    records_on,
    unplaced,
)
from toppling.results.drawing.roses import by_compass, direction_words
from toppling.results.drawing.style import (
    COLOURS,
    FULL_WIDTH_IN,
    HALF_WIDTH_IN,
    LETTERS_PER_IN,
    LINE_IN,
    MAIN_COLOUR,
    THIN_ALPHA,
    style,
)

_PALE = f"Pale: fewer than {FEW} independent records."

_NO_RECORDS = "no records"

_COLOUR_SCALE = Normalize(0, 1)
"""Colour scale of probabilities."""


def map_figure(jobs: pd.DataFrame, plane: Plane, title: str = "") -> Figure:
    """Map of the toppling probability in the cells of a plane.

    jobs: rows of results, all of one contact.
    title: common parameters of the jobs, such as "μ = 0.8".
    """
    table, records = cells(jobs, plane), records_on(jobs, plane)
    left_out = unplaced(jobs, plane), beyond(jobs, plane)
    caption = [_PALE, *_left_out(plane, *left_out)]
    height = 3.0 + LINE_IN * len(caption)
    with style():
        figure = Figure(figsize=(HALF_WIDTH_IN, height))
        margins = _margins(HALF_WIDTH_IN, height, below_in=LINE_IN * len(caption))
        axes = figure.subplots(gridspec_kw=margins)
        _frame_cells(axes, table, plane)
        _draw_cells(axes, table, plane)
        axes.set_title("\n".join(filter(None, (title, _counted(table, records)))))
        axes.set(xlabel=_label(plane.x), ylabel=_label(plane.y))
        _colour_bar(figure, margins)
        _write_caption(figure, caption)
    return figure


def direction_figure(counted: DirectionCells, title: str = "") -> Figure:
    """Maps of the direction bins of the vector PGA, clockwise from north, on common axes.

    counted: cells by direction; bins without a record are drawn empty.
    """
    plane = counted.plane
    directions = by_compass(k * 360.0 / counted.bins for k in range(counted.bins))
    columns = min(4, len(directions))
    lines = -(-len(directions) // columns)
    caption = [
        "Panels: compass direction of the vector PGA; azimuths counter-clockwise from east.",
        _PALE,
        *_left_out(plane, counted.unplaced, 0),
    ]
    letters = int(LETTERS_PER_IN * FULL_WIDTH_IN)
    caption = [part for line in caption for part in wrap(line, letters, break_on_hyphens=False)]
    with style():
        height = 0.9 + 2.1 * lines + LINE_IN * (len(caption) + bool(title))
        figure = Figure(figsize=(FULL_WIDTH_IN, height))
        margins = _margins(
            FULL_WIDTH_IN, height, above_in=LINE_IN * bool(title), below_in=LINE_IN * len(caption)
        )
        apart = {**margins, "wspace": 0.12, "hspace": 0.32}
        grid = figure.subplots(lines, columns, sharex=True, sharey=True, squeeze=False, gridspec_kw=apart)
        for axes, direction in zip(grid.flat, directions, strict=False):
            _draw_direction(axes, counted, direction)
        _close_grid(grid, len(directions))
        middle = 0.5 * (margins["left"] + margins["right"])
        figure.supxlabel(
            _label(plane.x), x=middle, y=(LINE_IN * len(caption) + 0.1) / height, size=8, va="bottom"
        )
        figure.supylabel(_label(plane.y), size=8)
        if title:
            figure.text(0.01, 1 - 0.05 / height, title, size=8.5, va="top")
        _colour_bar(figure, margins)
        _write_caption(figure, caption)
    return figure


def _close_grid(grid: NDArray[Any], panels: int) -> None:
    """Label the lowest panel of each column, also where the last row is incomplete, and hide unused panels."""
    lines, columns = grid.shape
    for axes in grid.flat[panels:]:
        axes.set_axis_off()
    for column in range(columns):
        lowest = max(row for row in range(lines) if row * columns + column < panels)
        grid[lowest, column].tick_params(labelbottom=True)


def _draw_direction(axes: Axes, counted: DirectionCells, direction_deg: float) -> None:
    table, plane = counted.table, counted.plane
    there = table[table["direction_deg"] == direction_deg]
    number = _counted(there, counted.records.get(direction_deg, 0))
    axes.set_title(f"{direction_words(direction_deg, counted.bins)}\n{number}")
    _frame_cells(axes, table, plane)
    if len(there):
        _draw_cells(axes, there, plane)
    else:
        axes.text(0.5, 0.5, _NO_RECORDS, transform=axes.transAxes, ha="center", va="center", color="0.4")
    axes.xaxis.set_major_locator(MaxNLocator(4, prune="upper"))  # its label would overlap the next panel's
    axes.yaxis.set_major_locator(MaxNLocator(5))


def _counted(table: pd.DataFrame, records: int) -> str:
    return f"{int(table['jobs'].sum()):,} jobs, {records:,} records"


def _draw_cells(axes: Axes, table: pd.DataFrame, plane: Plane) -> None:
    low, high = (table[f"{plane.x.column}_{end}"].to_numpy() for end in ("low", "high"))
    bottom, top = (table[f"{plane.y.column}_{end}"].to_numpy() for end in ("low", "high"))
    corners = np.array([[low, bottom], [high, bottom], [high, top], [low, top]])
    bars = PolyCollection(
        list(corners.transpose(2, 0, 1)), cmap=COLOURS, norm=_COLOUR_SCALE, edgecolors="white", linewidths=0.3
    )
    bars.set_array(table["probability"].to_numpy(float))
    bars.set_alpha(np.where(table["thin"], THIN_ALPHA, 1.0).tolist())
    axes.add_collection(bars)


def _left_out(plane: Plane, missing: int, outside: int) -> list[str]:
    """Caption lines on jobs that the map does not show."""
    ends = [f"{axis.below:g} {axis.unit}" for axis in (plane.x, plane.y) if axis.below is not None]
    lines = []
    if outside:
        lines.append(f"Not shown: {outside:,} jobs from {' or '.join(ends)} on.")
    if missing:
        lines.append(f"In no cell: {missing:,} jobs whose measures are not known.")
    return lines


def _frame_cells(axes: Axes, table: pd.DataFrame, plane: Plane) -> None:
    """Set limits that include all cells of a table, for all maps on common axes."""
    low, high = table[f"{plane.x.column}_low"], table[f"{plane.x.column}_high"]
    axes.set_xlim(min(0.0, low.min()) if len(low) else 0.0, high.max() if len(high) else 1.0)
    axes.set_ylim(0.0, table[f"{plane.y.column}_high"].max() if len(table) else 1.0)


def _write_caption(figure: Figure, lines: list[str]) -> None:
    figure.text(
        0.02, 0.04 / figure.get_size_inches()[1], "\n".join(lines), size=6.5, va="bottom", color="0.25"
    )


def _margins(
    width_in: float, height_in: float, above_in: float = 0.0, below_in: float = 0.0
) -> dict[str, float]:
    """Margins for labels and colour bar, fixed in inches; a layout engine would take seconds."""
    return {
        "left": 0.55 / width_in,
        "right": 1 - 0.62 / width_in,
        "bottom": (0.48 + below_in) / height_in,
        "top": 1 - (0.4 + above_in) / height_in,
    }


def _colour_bar(figure: Figure, margins: dict[str, float]) -> None:
    """Draw the colour bar at the right margin."""
    width = figure.get_size_inches()[0]
    box = (
        margins["right"] + 0.08 / width,
        margins["bottom"],
        0.1 / width,
        margins["top"] - margins["bottom"],
    )
    bar = figure.colorbar(ScalarMappable(_COLOUR_SCALE, COLOURS), cax=figure.add_axes(box))
    bar.set_label("toppling probability", size=7.5)


def _label(axis: Axis) -> str:
    return f"{axis.label} ({axis.unit})"


_BAND = 0.3
"""Difference of probability marked by the outer lines: the uncertainty of a cell of 10 records."""

_GAP_IN = 0.6
"""Gap between panels, for an axis and half a circle, inches."""


def friction_figure(table: pd.DataFrame, jobs: pd.DataFrame, width_in: float = FULL_WIDTH_IN) -> Figure:
    """Toppling probability of each cell under each friction, plotted against that under the reference.

    table: from `analysis.friction_comparison.compare_cells`.
    jobs: from `analysis.friction_comparison.compare_jobs`.
    width_in: maximum width; panels without room beside each other are stacked.
    """
    columns = min(len(jobs), max(1, int((width_in - 0.6) // 2.2)))
    lines = -(-len(jobs) // columns)
    side_in = min(2.9, (width_in - 0.7 - _GAP_IN * (columns - 1)) / columns)
    width, height = 0.7 + columns * side_in + _GAP_IN * (columns - 1), 0.55 + lines * (side_in + 0.85)
    with style():
        figure = Figure(figsize=(width, height))
        room = {
            "left": 0.55 / width, "right": 1 - 0.15 / width, "bottom": 0.95 / height, "top": 1 - 0.45 / height,
            "wspace": _GAP_IN / side_in, "hspace": 0.85 / side_in,
        }  # fmt: skip
        grid = figure.subplots(lines, columns, squeeze=False, gridspec_kw=room)
        for axes, (_, counts) in zip(grid.flat, jobs.iterrows(), strict=False):
            cells = table[(table[FRICTION] == counts[FRICTION]).all(axis=1)]
            _draw_pair(axes, cells, counts)
        for axes in grid.flat[len(jobs) :]:
            axes.set_axis_off()
        figure.legend(
            *grid.flat[0].get_legend_handles_labels(),
            loc="lower center",
            ncols=2,
            frameon=False,
            columnspacing=1.2,
        )
    return figure


def _draw_pair(axes: Axes, cells: pd.DataFrame, counts: pd.Series) -> None:
    friction, reference = (
        friction_words(*(counts[end + name] for name in FRICTION)) for end in ("", "reference_")
    )
    places = (
        cells.groupby(["reference_probability", "probability", "thin"]).size().rename("cells").reset_index()
    )
    for thin, face in ((False, MAIN_COLOUR), (True, "white")):
        some = places[places["thin"] == thin]
        axes.scatter(
            some["reference_probability"], some["probability"], s=12.0 * some["cells"] ** 0.5, facecolors=face,
            linewidths=0.7, edgecolors=MAIN_COLOUR, clip_on=False, zorder=3,
        )  # fmt: skip
        axes.scatter(
            [], [], s=12.0, facecolors=face, linewidths=0.7, edgecolors=MAIN_COLOUR,
            label=f"cells of {'<' if thin else '≥'} {FEW} independent records",
        )  # fmt: skip
    for (x, y), several in places.groupby(["reference_probability", "probability"])["cells"].sum().items():
        if several > 2:  # coinciding cells
            inward = -1 if x > 0.5 else 1
            axes.annotate(
                f"{several} cells", (x, y), xytext=(7 * inward, -4 if y > 0.5 else 3), textcoords="offset points",
                size=6.5, ha="left" if inward > 0 else "right", va="top" if y > 0.5 else "bottom", color="0.25",
                zorder=2.5,
                bbox={"facecolor": "white", "lw": 0, "pad": 0.8},
            )  # fmt: skip
    axes.plot([0, 1], [0, 1], "k--", lw=0.8, label="same probability")
    for number, shift in enumerate((-_BAND, _BAND)):
        axes.plot(
            [max(0, -shift), min(1, 1 - shift)], [max(0, shift), min(1, 1 + shift)], "-", color="0.45", lw=0.7,
            label=None if number else f"{_BAND:g} more or less",
        )  # fmt: skip
    ticks = [0.0, 0.25, 0.5, 0.75, 1.0]
    axes.set(
        xlim=(0, 1), ylim=(0, 1), aspect="equal", xticks=ticks, yticks=ticks,
        xticklabels=["0", "", "0.5", "", "1"], yticklabels=["0", "", "0.5", "", "1"],
        xlabel=f"toppling probability, friction {reference}",
        ylabel=f"toppling probability, friction {friction}",
        title=f"{len(cells)} cells; of {counts['pairs']:,g} pairs of jobs\n{counts['only_this']:,g} topple only at "
        f"friction {friction}, {counts['only_reference']:,g} only at {reference}",
    )  # fmt: skip
