"""Hazard curves beside the rates of exceedance that standing rocks reject."""

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from toppling.models.arrays import Array
from toppling.results.drawing.style import (
    COLOURS,
    HALF_WIDTH_IN,
    LETTERS_PER_IN,
    MAIN_COLOUR,
    measure_label,
    plain_log,
    style,
)
from toppling.results.hazard.curves import HazardCurve
from toppling.results.hazard.survival import Standing
from toppling.results.hazard.tree import Branch

_MOST_NAMED = 6
"""Branches that the legend names, at most."""


def constraint_figure(
    bound: pd.DataFrame,
    branches: Sequence[Branch],
    confidence: float,
    verdicts: pd.DataFrame | None = None,
    rocks: Sequence[Standing] = (),
    width_in: float = HALF_WIDTH_IN,
) -> Figure:
    """Which rates of exceedance the standing rocks reject, with the hazard curves that were asked about.

    bound: rates that are rejected whatever the hazard, `Constraint.bound`.
    verdicts: `Constraint.branches`: survival and verdict of each branch, for the legend.
    rocks: their ages stand above the figure.
    """
    measure = bound.columns[0]
    rate = bound["rejected_annual_rate"]
    below_in = 0.45 + 0.16 * (1 + (len(branches) if len(branches) <= _MOST_NAMED else 1))
    height = 3.0 + below_in
    with style():
        figure = Figure(figsize=(width_in, height))
        axes = figure.subplots(
            gridspec_kw={
                "left": 0.62 / width_in, "right": 1 - 0.12 / width_in, "bottom": (below_in + 0.1) / height,
                "top": 1 - 0.3 / height,
            }
        )  # fmt: skip
        shown = [_within(bound, branch.curve) for branch in branches]
        least, top = _rates_shown(bound, [rates for rates in shown if len(rates)])
        axes.fill_between(
            bound[measure], rate, top, color="0.85", lw=0,
            label=f"rates rejected at {100 * confidence:g} %, whatever the rest of the curve",
        )  # fmt: skip
        axes.plot(bound[measure], rate, color="k", lw=1)
        if len(branches) <= _MOST_NAMED:
            _draw_named(axes, branches, verdicts, shown)
        else:
            _draw_many(axes, branches, verdicts)
        axes.set(
            xscale="log", yscale="log", xlabel=measure_label(measure), ylabel="annual rate of exceedance",
            xlim=(bound[measure].min(), bound[measure].max()), ylim=(least, top),
        )  # fmt: skip
        axes.set_title(ages_words(rocks, width_in))
        plain_log(axes.xaxis)
        axes.yaxis.set_major_locator(LogLocator(numticks=10))
        axes.yaxis.set_minor_locator(LogLocator(subs=tuple(range(2, 10)), numticks=99))
        figure.legend(
            *axes.get_legend_handles_labels(), loc="lower left", frameon=False, bbox_to_anchor=(0.0, 0.0),
            handlelength=2.4, borderaxespad=0.2,
        )  # fmt: skip
    return figure


def _draw_named(
    axes: Axes,
    branches: Sequence[Branch],
    verdicts: pd.DataFrame | None,
    shown: Sequence[Array],
) -> None:
    """Each branch as a line of its own, which the legend names with its verdict."""
    colours = COLOURS(np.linspace(0.15, 0.85, max(1, len(branches))))
    for number, (branch, rates) in enumerate(zip(branches, shown, strict=True)):
        name = branch.name if len(rates) else f"{branch.name} (no rates here)"
        verdict = "" if verdicts is None else _verdict(verdicts.iloc[number])
        axes.plot(
            branch.curve.intensity, branch.curve.annual_rate, ("-", "--", "-.", ":")[number % 4],
            color=colours[number], lw=1.3, label=name + verdict,
        )  # fmt: skip


def _draw_many(axes: Axes, branches: Sequence[Branch], verdicts: pd.DataFrame | None) -> None:
    """More branches than a legend can name, as faint lines: the darker, the more weight they have."""
    weights = np.array([branch.weight for branch in branches])
    if verdicts is not None and verdicts["posterior_weight"].notna().all():
        weights = verdicts["posterior_weight"].to_numpy()
    label = f"{len(branches)} hazard curves, darker with more weight"
    if verdicts is not None:
        label += f"; {int(verdicts['rejected'].sum()) or 'none'} rejected"
    for branch, weight in zip(branches, weights / weights.max(), strict=True):
        axes.plot(
            branch.curve.intensity, branch.curve.annual_rate, color=MAIN_COLOUR, lw=0.6, alpha=0.1 + 0.6 * weight,
            label=label,
        )  # fmt: skip
        label = "_"


def ages_words(rocks: Sequence[Standing], width_in: float = math.inf) -> str:
    """Say how long rocks have stood, in a line: an age or a range, of each where there is room; empty without ages."""
    dated = [rock for rock in rocks if np.isfinite(rock.years).any()]
    ages = {rock.name: _years(rock.years) for rock in dated}
    if len(set(ages.values())) == 1:
        return f"standing for {next(iter(ages.values()))}"
    each = "; ".join(f"{name}: {years}" for name, years in ages.items())
    if len(each) <= LETTERS_PER_IN * width_in:
        return each
    return f"{len(ages)} rocks, standing for {_years(np.concatenate([rock.years for rock in dated]))}"


def _years(years: Array) -> str:
    low, high = (f"{float(f'{value:.3g}'):,.0f}" for value in (np.min(years), np.max(years)))
    return f"{low} years" if low == high else f"{low} to {high} years"


def _verdict(row: pd.Series) -> str:
    survival = row["survival"]
    words = f"{survival:.2f}" if survival >= 0.01 else f"{survival:.0e}" if survival > 1e-99 else "0"
    return f": survival {words}, {'rejected' if row['rejected'] else 'not rejected'}"


def _within(bound: pd.DataFrame, branch: HazardCurve) -> Array:
    """Rates of a branch at the bound's intensities that it has."""
    intensity = bound.iloc[:, 0].to_numpy()
    inside = (intensity >= branch.intensity[0]) & (intensity <= branch.intensity[-1])
    return branch.rate(intensity[inside])


def _rates_shown(bound: pd.DataFrame, drawn: Sequence[Array]) -> tuple[float, float]:
    """Ends of the rates: those of the bound, widened to what the branches have at its intensities.

    A branch that falls steeply may leave the frame a thousand times below the bound, but where it comes nearest to
    the bound it is seen, however far off that is.
    """
    rejected = bound["rejected_annual_rate"]
    least, top = rejected.min() / 10, 3 * rejected.max()
    for rates in drawn:
        least = min(least, rates.max() / 10, max(rates.min() / 2, rejected.min() / 1000))
        top = max(top, 3 * rates.min())
    return float(least), float(top)
