"""A hazard before and after standing rocks have a say, of curves and of a set of events; survival of branches."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from numpy.typing import ArrayLike

from toppling.models.arrays import Array
from toppling.results.drawing.constraint_figures import ages_words
from toppling.results.drawing.style import FULL_WIDTH_IN, MAIN_COLOUR, measure_label, plain_log, style
from toppling.results.hazard.tree import Statistics
from toppling.results.hazard.update import Update

_LEAST_RATE = 3e-7
"""Lower end of the annual rates that are drawn: analysts ask for none below 1e-6."""

_LEAST_RANGE = 50.0
"""Of the rates that are drawn: at least one power of ten has a label."""


def hazard_figure(update: Update, width_in: float = FULL_WIDTH_IN) -> Figure:
    """Annual rates of exceedance before and after, over intensity, with return periods on the right."""
    count = len(update.tree.branches)
    rows = (1 + bool(update.tree.fractiles)) if count == 1 else 5 if width_in < FULL_WIDTH_IN else 2
    below_in = 0.5 + 0.16 * rows
    height = 3.4 + below_in
    with style():
        figure = Figure(figsize=(width_in, height))
        axes = figure.subplots(
            gridspec_kw={
                "left": 0.6 / width_in, "right": 1 - 0.75 / width_in, "bottom": below_in / height,
                "top": 1 - 0.3 / height,
            }
        )  # fmt: skip
        if count > 1:
            _draw_branches(axes, update)
        _draw_fractiles(axes, update)
        if update.after is not None and count > 1:
            _draw_band(axes, update.after, "5 to 95 % after")
        name = "mean before" if count > 1 else "hazard"
        axes.plot(*_bearing(update.before.levels, update.before.mean), "k--", lw=1.3, label=name)
        if update.after is not None and count > 1:
            axes.plot(
                *_bearing(update.after.levels, update.after.mean),
                color=MAIN_COLOUR,
                lw=1.6,
                label="mean after",
            )
        _frame(axes, update, width_in)
        figure.legend(
            *axes.get_legend_handles_labels(), frameon=False, loc="lower left", bbox_to_anchor=(0.0, 0.0),
            borderaxespad=0.3, ncols=1 if width_in < FULL_WIDTH_IN else 3,
        )  # fmt: skip
    return figure


def _draw_branches(axes: Axes, update: Update) -> None:
    """Each branch as a thin line, the darker the more weight it has now."""
    weights = update.tree.weights if update.posterior is None else update.posterior
    axes.plot([], [], color="0.6", lw=0.7, label=f"{len(weights)} branches, darker with more weight")
    for branch, weight in zip(update.tree.branches, weights / weights.max(), strict=True):
        axes.plot(
            branch.curve.intensity, branch.curve.annual_rate, color="k", lw=0.5, alpha=0.08 + 0.3 * weight,
            zorder=1.5,
        )  # fmt: skip


def _draw_fractiles(axes: Axes, update: Update) -> None:
    """5 and 95 % of the branches, or of a lone curve the outermost that its files state."""
    if len(update.tree.branches) > 1:
        of, shown = "of the branches before", {q: update.before.fractiles[q] for q in (0.05, 0.95)}
        lines = {q: _bearing(update.before.levels, rates) for q, rates in shown.items()}
    else:
        of, stated = "as the files state them", sorted(update.tree.fractiles.items())
        lines = {q: (curve.intensity, curve.annual_rate) for q, curve in (*stated[:1], *stated[-1:])}
    lines = {q: line for q, line in lines.items() if len(line[0])}
    label = f"{' and '.join(f'{100 * q:g}' for q in lines)} % {of}"
    for line in lines.values():
        axes.plot(*line, "k:", lw=1.0, label=label)
        label = "_"


def _draw_band(axes: Axes, curves: Statistics, label: str) -> None:
    low, high = curves.fractiles[0.05], curves.fractiles[0.95]
    positive = np.isfinite(low) & np.isfinite(high) & (high > 0)
    axes.fill_between(
        curves.levels[positive], np.maximum(low[positive], _LEAST_RATE / 10), high[positive], color=MAIN_COLOUR,
        alpha=0.3, lw=0, label=label,
    )  # fmt: skip


def _bearing(levels: Array, rates: Array) -> tuple[Array, Array]:
    """Points of a curve that have a rate."""
    positive = np.isfinite(rates) & (rates > 0)
    return levels[positive], rates[positive]


def _frame(axes: Axes, update: Update, width_in: float) -> None:
    """Axes over what is asked for: intensities whose rates are drawn, and return periods beside them."""
    x, rates = _bearing(update.before.levels, update.before.mean)
    shown = rates >= _LEAST_RATE
    top = max(
        rates.max(), *(rate[np.isfinite(rate)].max(initial=0.0) for rate in update.before.fractiles.values())
    )
    right = x[min(int(shown.sum()), len(x) - 1)]
    least = min(max(_LEAST_RATE, rates.min() / 2), top / _LEAST_RANGE)
    axes.set(
        xscale="log", yscale="log", xlabel=measure_label(update.tree.measure), ylabel="annual rate of exceedance",
        xlim=(x[0], max(right, x[0] * 1.5)), ylim=(least, 1.5 * top),
    )  # fmt: skip
    axes.set_title(ages_words(update.rocks, width_in))
    plain_log(axes.xaxis)
    axes.yaxis.set_major_locator(LogLocator(numticks=10))
    axes.yaxis.set_minor_locator(LogLocator(subs=tuple(range(2, 10)), numticks=99))
    axes.yaxis.set_minor_formatter(NullFormatter())
    period = axes.secondary_yaxis("right", functions=(_inverse, _inverse))
    period.set_ylabel("return period (years)")
    period.yaxis.set_major_locator(LogLocator(numticks=10))
    period.yaxis.set_minor_formatter(NullFormatter())


def _inverse(value: ArrayLike) -> Array:
    with np.errstate(divide="ignore"):
        return 1.0 / np.asarray(value, float)


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
