"""Cost of presets against their errors."""

import math

import pandas as pd
import seaborn as sns
from matplotlib.figure import Figure

from toppling.results.drawing.style import COLOURS, FULL_WIDTH_IN, plain_log, style

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
            plain_log(axes.xaxis)
            axes.margins(x=0.15)
            axes.set_xlabel("cost (processor ms\nper simulated second)")
            axes.set_ylabel(label)
        figure.legend(*axes.get_legend_handles_labels(), loc="upper center", ncols=3, frameon=False)
        sns.despine(figure)
        figure.tight_layout(rect=(0.0, 0.0, 1.0, 1.0 - 0.07 * math.ceil(len(table) / 3)))
    return figure
