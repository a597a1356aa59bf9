"""Figures that compare toppling probabilities under two frictions, cell by cell."""

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from toppling.results.analysis.fragility import FRICTION, THIN_RECORDS
from toppling.results.analysis.friction_comparison import friction_words
from toppling.results.drawing.style import FULL_WIDTH_IN, MAIN_COLOUR, style

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
            label=f"cells of {'<' if thin else '≥'} {THIN_RECORDS} records",
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
