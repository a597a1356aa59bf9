"""Cost of presets against what they move of the answer."""

import math

import pandas as pd
import seaborn as sns
from matplotlib.figure import Figure

from toppling.results.drawing.style import COLOURS, FULL_WIDTH_IN, plain_log, style

_FRONT_PANELS = {
    "median_shift": "median PGA (%)",
    "share_shift": "share toppled (points)",
    "tilt_log_ratio": "tilt where both stand (%)",
}


def front_figure(table: pd.DataFrame) -> Figure:
    """What each setting moves of the answer, against its cost; bars of one standard deviation over jobs.

    Parameters
    ----------
    table : DataFrame
        Columns setting, processor_s_per_job, and for each panel its shift and, with `_std`, the standard deviation.
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
