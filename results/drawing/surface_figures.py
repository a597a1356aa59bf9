"""Fragility over two measures together, with the jobs that it is fitted to."""

import math

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from scipy.special import ndtri

from toppling.results.drawing.style import HALF_WIDTH_IN, MAIN_COLOUR, measure_label, plain_log, style
from toppling.results.hazard.surfaces import Surface

_SHARES = {0.05: ":", 0.5: "-", 0.95: "--"}
"""Toppling probabilities whose lines are drawn."""


def surface_figure(surface: Surface, jobs: pd.DataFrame, width_in: float = HALF_WIDTH_IN) -> Figure:
    """Lines of equal toppling probability over two measures, the band of the middle one, and the jobs.

    surface: of two measures.
    jobs: rows of results with an answer.
    """
    first, second = surface.measures
    x = np.geomspace(jobs[first].min(), jobs[first].max(), 200)
    with style():
        figure = Figure(figsize=(width_in, width_in + 0.5), layout="constrained")
        axes = figure.subplots()
        for toppled, colour in ((False, "0.75"), (True, "#d98c5f")):
            some = jobs[jobs["toppled"] == toppled]
            axes.scatter(some[first], some[second], s=3, color=colour, lw=0, rasterized=True)
        for share, line in _SHARES.items():
            axes.plot(
                x, _crossing(np.array([surface.coefficients]), x, share)[0], line, color=MAIN_COLOUR, lw=1.2
            )
        drawn = surface.resampled
        if drawn is not None and len(drawn.coefficients):
            ends = drawn.interval(_crossing(drawn.coefficients, x, 0.5))
            axes.fill_between(x, *ends, color=MAIN_COLOUR, alpha=0.25, lw=0)
        axes.set(
            xscale="log", yscale="log", xlim=(x[0] / 1.05, x[-1] * 1.05),
            ylim=(jobs[second].min() / 1.1, jobs[second].max() * 1.1),
            xlabel=measure_label(first), ylabel=measure_label(second),
        )  # fmt: skip
        plain_log(axes.xaxis)
        plain_log(axes.yaxis)
        handles: list[Line2D | Patch] = [
            Line2D([], [], color=MAIN_COLOUR, ls=line, label=f"{100 * share:g} % topple")
            for share, line in _SHARES.items()
        ]
        if drawn is not None and len(drawn.coefficients):
            handles.append(Patch(color=MAIN_COLOUR, alpha=0.25, lw=0, label="other records (95 %)"))
        handles += [
            Line2D([], [], color=colour, marker="o", ms=3, ls="", label=word)
            for colour, word in (("0.75", "stands"), ("#d98c5f", "toppled"))
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    return figure


def _crossing(coefficients: np.ndarray, x: np.ndarray, share: float) -> np.ndarray:
    """Second measure at which a share topples, given the first, of each surface (surfaces, x)."""
    intercept, slope, other = coefficients.T[:, :, None]
    with np.errstate(divide="ignore", over="ignore"):
        level = np.exp((ndtri(share) - intercept - slope * np.log(x)) / other)
    return np.where(other > 0, level, math.inf)
