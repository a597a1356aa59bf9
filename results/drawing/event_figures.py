"""Branches of a set of events by the survival of standing rocks, and the hazard before and after."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from toppling.results.drawing.style import FULL_WIDTH_IN, MAIN_COLOUR, measure_label, plain_log, style

_NAMED = 16
"""Branches that have their names beside the axis."""

_LEAST_SURVIVAL = 1e-4


MOST_PANELS = 7
"""Of sites and measures whose hazard is drawn; the file of rates has all."""


def events_figure(
    branches: pd.DataFrame, updated: pd.DataFrame | None, confidence: float, width_in: float = FULL_WIDTH_IN
) -> Figure:
    """Survival of each branch, and rates of exceedance before and after at each site, of each measure.

    branches: from `EventUpdate.branches`.
    updated: from `EventUpdate.updated`, with its `measure` and `site`; None where no event is felt at the rocks'
    sites.
    """
    hazards = [] if updated is None else [one for _, one in updated.groupby(["site", "measure"], sort=False)]
    count = 1 + len(hazards[:MOST_PANELS])
    columns = 1 if width_in < FULL_WIDTH_IN else min(count, 2)
    rows = -(-count // columns)
    first_in = max(3.2, 0.2 * min(len(branches), _NAMED))
    with style():
        figure = Figure(figsize=(width_in, first_in + 3.2 * (rows - 1)), layout="constrained")
        grid = figure.subplots(rows, columns, squeeze=False, height_ratios=[first_in, *[3.2] * (rows - 1)])
        first, *others = grid.ravel()
        _draw_survival(first, branches.sort_values("survival", ignore_index=True), confidence)
        for axes, hazard in zip(others[: count - 1], hazards, strict=False):
            _draw_hazard(axes, hazard)
        for axes in others[count - 1 :]:
            axes.remove()
    return figure


def _draw_survival(axes: Axes, branches: pd.DataFrame, confidence: float) -> None:
    places = np.arange(len(branches))
    low, middle, high = (
        branches[name].clip(lower=_LEAST_SURVIVAL) for name in ("survival_low", "survival", "survival_high")
    )
    axes.hlines(places, low, high, color="0.6", lw=0.8)
    before, after = (branches[f"{name}_weight"].fillna(0.0) for name in ("prior", "posterior"))
    most = max(before.max(), after.max())
    axes.scatter(
        middle, places, 60 * before / most, facecolors="none", edgecolors="0.3", lw=0.8, label="weight before"
    )
    axes.scatter(middle, places, 60 * after / most, color=MAIN_COLOUR, lw=0, label="weight after", zorder=3)
    axes.axvline(1.0 - confidence, color="0.3", lw=0.7, ls="--")
    axes.text(
        1.0 - confidence, len(branches) - 0.45, " rejected left of here", size=6.5, ha="right", va="bottom"
    )
    axes.set(
        xscale="log", xlabel="probability that all rocks stand", ylim=(-0.6, len(branches) + 0.3),
        xlim=(max(_LEAST_SURVIVAL, 0.5 * min(low.min(), 1 - confidence)), 1.1),
    )  # fmt: skip
    axes.set_yticks(
        places if len(branches) <= _NAMED else [], branches["name"] if len(branches) <= _NAMED else []
    )
    if len(branches) > _NAMED:
        axes.set_ylabel(f"{len(branches)} branches, by survival")
    axes.legend(loc="lower right", frameon=False, ncols=2, bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)


def _draw_hazard(axes: Axes, updated: pd.DataFrame) -> None:
    level = updated["level"]
    measure = updated["measure"].iloc[0]
    axes.fill_between(
        level,
        updated["rate_prior_p05"],
        updated["rate_prior_p95"],
        color="0.85",
        lw=0,
        label="5 to 95 % before",
    )
    if updated["rate_posterior_mean"].notna().any():
        axes.fill_between(
            level, updated["rate_posterior_p05"], updated["rate_posterior_p95"], color=MAIN_COLOUR, alpha=0.3, lw=0,
            label="5 to 95 % after",
        )  # fmt: skip
        axes.plot(
            level, _positive(updated["rate_posterior_mean"]), color=MAIN_COLOUR, lw=1.4, label="mean after"
        )
    axes.plot(level, _positive(updated["rate_prior_mean"]), "k--", lw=1.0, label="mean before")
    least = _positive(updated["rate_prior_mean"]).min()
    axes.set(
        xscale="log", yscale="log", xlabel=measure_label(measure), ylabel="annual rate of exceedance",
        ylim=(least / 10, None), xlim=(level.min(), level.max()), title=f"at {updated['site'].iloc[0]}",
    )  # fmt: skip
    plain_log(axes.xaxis)
    axes.yaxis.set_major_locator(LogLocator(numticks=10))
    axes.legend(loc="lower left", frameon=False)


def _positive(values: pd.Series) -> pd.Series:
    return values.where(values > 0)
