"""Figures of prior and posterior hazard, of the rates that rocks reject, and of the magnitudes that they exclude."""

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from numpy.typing import ArrayLike

from toppling.models.arrays import Array
from toppling.models.files.documents import MOST_NAMED, MOST_SHOWN
from toppling.results.analysis.constraint import Constraint
from toppling.results.drawing.sentences import ages_words, percent
from toppling.results.drawing.style import (
    COLOURS,
    FULL_WIDTH_IN,
    HALF_WIDTH_IN,
    MAIN_COLOUR,
    measure_label,
    plain_log,
    style,
)
from toppling.results.hazard.magnitudes import MotionGrid
from toppling.results.hazard.places import FaultTrace
from toppling.results.hazard.tree import Branch, HazardCurve, bearing
from toppling.results.hazard.update import Update

_LEAST_RATE = 3e-7
"""Lower end of the annual rates that are drawn: rates below 1e-6 are of no practical interest."""


def constraint_figure(constraint: Constraint) -> Figure:
    """Rates of exceedance inconsistent with the standing rocks, with hazard curves and their verdicts in the legend.

    constraint: constraint with ages.
    """
    bound, verdicts = constraint.bound, constraint.update.branches if constraint.update else None
    assert bound is not None
    tree = constraint.update.tree if constraint.update else None
    branches = tree.branches if tree else ()
    measure, rate = bound.columns[0], bound["inconsistent_annual_rate"]
    named = len(branches) <= MOST_NAMED
    below_in = 0.45 + 0.16 * (1 + (len(branches) if named else 1))
    with style():
        figure, axes = _rates_axes(measure, HALF_WIDTH_IN, below_in + 0.1, 0.12)
        shown = [_within(bound, branch.curve) for branch in branches]
        least, top = _rates_shown(bound, [rates for rates in shown if len(rates)])
        axes.fill_between(
            bound[measure], rate, top, color="0.85", lw=0,
            label=f"rates inconsistent at {100 * constraint.confidence:g} %, whatever the rest of the curve",
        )  # fmt: skip
        axes.plot(bound[measure], rate, color="k", lw=1)
        if named:
            _draw_named(axes, branches, verdicts, shown)
        elif verdicts is not None:
            weights = verdicts["posterior_weight"].fillna(verdicts["prior_weight"]).to_numpy()
            count = verdicts["verdict"].value_counts()
            label = "".join(f"; {count.get(name, 'none')} {name}" for name in ("inconsistent", "undecided"))
            _draw_branches(
                axes, branches, weights, f"{len(branches)} hazard curves, darker with more weight{label}"
            )
        axes.set(xlim=(bound[measure].min(), bound[measure].max()), ylim=(least, top))
        axes.set_title(ages_words(constraint.rocks, HALF_WIDTH_IN))
        _legend_below(figure, axes)
    return figure


def _rates_axes(measure: str, width_in: float, below_in: float, right_in: float) -> tuple[Figure, Axes]:
    """Figure for annual rates of exceedance over a measure, with room below for a legend."""
    height = 3.4 + below_in
    figure = Figure(figsize=(width_in, height))
    axes = figure.subplots(
        gridspec_kw={
            "left": 0.62 / width_in, "right": 1 - right_in / width_in, "bottom": below_in / height,
            "top": 1 - 0.3 / height,
        }
    )  # fmt: skip
    _over_rates(axes, measure)
    return figure, axes


def _over_rates(axes: Axes, measure: str) -> None:
    """Label axes of annual rates of exceedance over a measure."""
    axes.set(xscale="log", yscale="log", xlabel=measure_label(measure), ylabel="annual rate of exceedance")
    plain_log(axes.xaxis)
    axes.yaxis.set_major_locator(LogLocator(numticks=10))
    axes.yaxis.set_minor_locator(LogLocator(subs=tuple(range(2, 10)), numticks=99))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _legend_below(figure: Figure, axes: Axes, columns: int = 1) -> None:
    figure.legend(
        *axes.get_legend_handles_labels(), loc="lower left", frameon=False, bbox_to_anchor=(0.0, 0.0), handlelength=2.4,
        borderaxespad=0.2, ncols=columns,
    )  # fmt: skip


def _draw_named(
    axes: Axes, branches: Sequence[Branch], verdicts: pd.DataFrame | None, shown: Sequence[Array]
) -> None:
    """Draw each branch as a separate line, with its verdict in the legend."""
    colours = COLOURS(np.linspace(0.15, 0.85, max(1, len(branches))))
    for number, (branch, rates) in enumerate(zip(branches, shown, strict=True)):
        name = branch.name if len(rates) else f"{branch.name} (no rates here)"
        verdict = ""
        if verdicts is not None:
            row = verdicts.iloc[number]
            verdict = f": survival {percent(row['survival'])}, {row['verdict']}"
        axes.plot(
            branch.curve.intensity, branch.curve.annual_rate, ("-", "--", "-.", ":")[number % 4],
            color=colours[number], lw=1.3, label=name + verdict,
        )  # fmt: skip


def _within(bound: pd.DataFrame, branch: HazardCurve) -> Array:
    """Rates of a branch at those of the bound's intensities that lie within its points."""
    intensity = bound.iloc[:, 0].to_numpy()
    inside = (intensity >= branch.intensity[0]) & (intensity <= branch.intensity[-1])
    return branch.rate(intensity[inside])


def _rates_shown(bound: pd.DataFrame, drawn: Sequence[Array]) -> tuple[float, float]:
    """Limits of the drawn rates: those of the bound, extended to the branches at its intensities.

    A steep branch may leave the frame a thousand times below the bound, but the part nearest to the bound is always
    inside.
    """
    inconsistent = bound["inconsistent_annual_rate"]
    least, top = inconsistent.min() / 10, 3 * inconsistent.max()
    for rates in drawn:
        least = min(least, rates.max() / 10, max(rates.min() / 2, inconsistent.min() / 1000))
        top = max(top, 3 * rates.min())
    return float(least), float(top)


def hazard_figure(update: Update, width_in: float = FULL_WIDTH_IN) -> Figure:
    """Prior and posterior annual rates of exceedance over intensity, with return periods on the right."""
    tree = update.tree
    assert tree is not None
    several = len(tree.branches) > 1
    rows = 2 if not several else 5 if width_in < FULL_WIDTH_IN else 2
    with style():
        figure, axes = _rates_axes(tree.measure, width_in, 0.5 + 0.16 * rows, 0.75)
        if several:
            weights = tree.weights if update.posterior is None else update.posterior
            _draw_branches(axes, tree.branches, weights, f"{len(weights)} branches, darker with more weight")
        _draw_before_and_after(axes, update.updated, after=several)
        _frame(axes, update, width_in)
        _legend_below(figure, axes, 1 if width_in < FULL_WIDTH_IN else 3)
    return figure


def _draw_branches(axes: Axes, branches: Sequence[Branch], weights: Array, label: str) -> None:
    """Draw each branch as a thin line, darker with higher weight."""
    axes.plot([], [], color="0.6", lw=0.7, label=label)
    for branch, weight in zip(branches, weights / weights.max(), strict=True):
        axes.plot(
            branch.curve.intensity, branch.curve.annual_rate, color="k", lw=0.5, alpha=0.08 + 0.3 * weight,
            zorder=1.5,
        )  # fmt: skip


def _draw_before_and_after(axes: Axes, updated: pd.DataFrame, *, after: bool = True) -> None:
    """Draw mean and 5 to 95 % of the branches by their prior weights and, `after`, by any posterior ones."""
    rates = updated.replace(math.inf, math.nan)
    level, times = rates["level"], ("prior", "posterior")
    (low, high, mean), new = (
        [rates[f"rate_{time}_{kind}"] for kind in ("p05", "p95", "mean")] for time in times
    )
    after = after and new[2].notna().any()
    if high.notna().any():
        axes.plot(level, low.where(low > 0), "k:", lw=1.0, label=f"5 and 95 %{' before' if after else ''}")
        axes.plot(level, high.where(high > 0), "k:", lw=1.0)
    axes.plot(level, mean.where(mean > 0), "k--", lw=1.3, label="mean before" if after else "hazard")
    low, high, mean = new
    if after:
        low = low.clip(lower=_LEAST_RATE / 10)
        axes.fill_between(level, low, high, color=MAIN_COLOUR, alpha=0.3, lw=0, label="5 to 95 % after")
        axes.plot(level, mean.where(mean > 0), color=MAIN_COLOUR, lw=1.6, label="mean after")


def _frame(axes: Axes, update: Update, width_in: float) -> None:
    """Set the limits to intensities whose rates are drawn, and label return periods."""
    x, rates = bearing(update.before.levels, update.before.mean)
    shown = rates >= _LEAST_RATE
    top = max(
        rates.max(), *(rate[np.isfinite(rate)].max(initial=0.0) for rate in update.before.fractiles.values())
    )
    right = x[min(int(shown.sum()), len(x) - 1)]
    least = min(max(_LEAST_RATE, rates.min() / 2), top / 10.0)  # every decade has a labelled power of ten
    axes.set(xlim=(x[0], max(right, x[0] * 1.5)), ylim=(least, 1.5 * top))
    axes.set_title(ages_words(update.rocks, width_in))
    period = axes.secondary_yaxis("right", functions=(_inverse, _inverse))
    period.set_ylabel("return period (years)")
    period.yaxis.set_major_locator(LogLocator(numticks=10))
    period.yaxis.set_minor_formatter(NullFormatter())


def _inverse(value: ArrayLike) -> Array:
    with np.errstate(divide="ignore"):
        return 1.0 / np.asarray(value, float)


_LEAST_SURVIVAL = 1e-4
"""Lower end of the survival axis."""


MOST_PANELS = 7
"""Maximum number of panels (sites and measures); the file of rates contains all."""


def events_figure(
    branches: pd.DataFrame, updated: pd.DataFrame | None, confidence: float, width_in: float = FULL_WIDTH_IN
) -> Figure:
    """Survival of each branch, and prior and posterior rates of exceedance for each site and measure.

    branches: from `Update.branches`.
    updated: from `Update.updated`; None where no event is felt at the rocks' sites. Sites without a rate are left out.
    """
    groups = [] if updated is None else updated.groupby(["site", "measure"], sort=False)
    hazards = [rows for _, rows in groups if (rows["rate_prior_mean"] > 0).any()]
    count = 1 + len(hazards[:MOST_PANELS])
    columns = 1 if width_in < FULL_WIDTH_IN else min(count, 2)
    rows = -(-count // columns)
    first_in = max(3.2, 0.2 * min(len(branches), MOST_SHOWN))
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
        middle, places, 60 * before / most, facecolors="none", edgecolors="0.3", lw=0.8, label="prior weight"
    )
    axes.scatter(middle, places, 60 * after / most, color=MAIN_COLOUR, lw=0, label="posterior", zorder=3)
    axes.axvline(1.0 - confidence, color="0.3", lw=0.7, ls="--")
    axes.text(
        1.0 - confidence, len(branches) - 0.45, " inconsistent below", size=6.5, ha="right", va="bottom"
    )
    axes.set(
        xscale="log", xlabel="probability that all rocks stand", ylim=(-0.6, len(branches) + 0.3),
        xlim=(max(_LEAST_SURVIVAL, 0.5 * min(low.min(), 1 - confidence)), 1.1),
    )  # fmt: skip
    axes.set_yticks(
        places if len(branches) <= MOST_SHOWN else [], branches["name"] if len(branches) <= MOST_SHOWN else []
    )
    if len(branches) > MOST_SHOWN:
        axes.set_ylabel(f"{len(branches)} branches, by survival")
    axes.legend(loc="lower right", frameon=False, ncols=2, bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)


def _draw_hazard(axes: Axes, updated: pd.DataFrame) -> None:
    level, mean = updated["level"], updated["rate_prior_mean"]
    _draw_before_and_after(axes, updated)
    _over_rates(axes, updated["measure"].iloc[0])
    least = mean.where(mean > 0).min()
    axes.set(ylim=(least / 10, None), xlim=(level.min(), level.max()), title=f"at {updated['site'].iloc[0]}")
    axes.legend(loc="lower left", frameon=False)


_DASHES = ("-", "--", "-.", ":")
_PLATE = {"boxstyle": "square,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.75}
"""Background box of names on the map."""

_REACH_KM = 100.0
"""Maximum reach of the map to include the nearest fault, km; circles may extend it."""


def magnitudes_figure(
    tables: dict[str, pd.DataFrame], confidence: float, grid: MotionGrid, chances: tuple[str, Array]
) -> Figure:
    """Largest magnitude allowed at each distance, over the probability of toppling.

    tables: from `results.hazard.magnitudes.largest_magnitudes`, by name of the occurrence.
    chances: name of an occurrence, and the probability (m, r) that it topples the rock.
    """
    limits = float(grid.magnitude[0]), float(grid.magnitude[-1])
    with style():
        figure = Figure(figsize=(HALF_WIDTH_IN, 3.4), layout="constrained")
        axes = figure.subplots()
        shades = axes.contourf(
            grid.distance_km, grid.magnitude, chances[1], np.linspace(0, 1, 11), cmap="Greys", vmin=0, vmax=2
        )
        figure.colorbar(shades, ax=axes, label=f"probability that it topples ({chances[0]})")
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
    faults: Sequence[FaultTrace], circles: dict[float, float], title: str, limits: tuple[float, float]
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
        nearest = [min(np.hypot(*line.T).min() for line in fault.lines) for fault in faults]
        widest = max((d for d in circles.values() if math.isfinite(d)), default=0.0)
        reach = 1.15 * max(widest, min(_REACH_KM, max(nearest, default=0.0)), 5.0)
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


def _shown(values: pd.Series, limits: tuple[float, float]) -> Array:
    """Values of a line, with infinite ones at the limits of the frame."""
    shown = np.clip(values.to_numpy(float), limits[0], limits[1] + 1e-6)
    beyond = np.flatnonzero(np.isposinf(values.to_numpy(float)))
    shown[beyond[1:] if len(beyond) else beyond] = np.nan
    return shown
