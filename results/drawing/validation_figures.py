"""The calibration plot of a validation: what was predicted against what happened."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray
from statsmodels.stats.proportion import proportion_confint

from toppling.results.drawing.style import HALF_WIDTH_IN, style


def calibration_figure(
    bins: pd.DataFrame, probability: NDArray[np.float64], overturned: NDArray[np.bool_], title: str
) -> Figure:
    """Shares that overturned over the predicted probability, and below it how many tests had which probability.

    Intervals of 95 % (Wilson) count tests as independent, which those of one record are not.
    """
    with style():
        figure = Figure(figsize=(HALF_WIDTH_IN, 1.25 * HALF_WIDTH_IN), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
        above.plot([0, 1], [0, 1], color="0.7", linewidth=0.8)
        hits = bins["overturned"] * bins["tests"]
        low, high = proportion_confint(hits, bins["tests"], method="wilson")
        spread = np.abs(np.vstack([bins["overturned"] - low, high - bins["overturned"]]))
        above.errorbar(
            bins["probability"], bins["overturned"], yerr=spread, fmt="o", markersize=4, color="0.1"
        )
        for x, y, tests in bins[["probability", "overturned", "tests"]].itertuples(index=False):
            above.annotate(f"{int(tests)}", (x, y), xytext=(5, -9), textcoords="offset points", fontsize=7)
        above.set(xlim=(0, 1), ylim=(-0.03, 1.03), ylabel="share that overturned", title=title)
        edges = np.linspace(0.0, 1.0, 21)
        below.hist(
            [probability[~overturned], probability[overturned]], edges, stacked=True, color=["0.75", "0.25"],
            label=["stood", "overturned"],
        )  # fmt: skip
        below.set(xlabel="predicted probability", ylabel="tests")
        below.legend(fontsize=7, frameon=False)
    return figure
