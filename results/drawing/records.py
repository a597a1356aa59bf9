"""One figure of an ensemble: response spectra, PGA against PGV/PGA, magnitude against distance."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from toppling.models.folder import new_file
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.intensity import SPECTRUM_PERIODS_S
from toppling.results.drawing.style import COLOURS, FULL_WIDTH_IN, plain_log, style

FENCE = 3.0
"""Interquartile ranges above the third quartile, beyond which a value would stretch an axis."""

MOST_NAMED = 3

Array = NDArray[np.float64]


def draw_records(ensemble: Ensemble, path: Path) -> None:
    """Draw the figure into a file whose suffix names its format."""
    figure = records_figure(ensemble)
    with style(), new_file(path) as hidden:
        figure.savefig(hidden, format=path.suffix[1:] or "png")


def records_figure(ensemble: Ensemble, width_in: float = FULL_WIDTH_IN) -> Figure:
    """Response spectra, PGA against PGV/PGA, magnitude against distance.

    Parameters
    ----------
    ensemble : Ensemble
    width_in : float
        Three panels in a row on a page's width, below each other on less.
    """
    beside = width_in >= FULL_WIDTH_IN
    names = ensemble.record_ids
    value = {
        name: np.array(ensemble.catalog.column(name).to_pylist(), dtype=float)
        for name in ("pga_m_s2", "pgv_pga_s", "distance_km", "magnitude")
    }
    with style():
        figure = Figure(figsize=(width_in, 2.7) if beside else (width_in, 7.6), layout="constrained")
        spectra, ratio, source = figure.subplots(*((1, 3) if beside else (3, 1)))
        _draw_spectra(ensemble, spectra)
        scatter(ratio, value["pgv_pga_s"], value["pga_m_s2"], names, COLOURS(0.35))
        ratio.set(xlabel="PGV/PGA (s)", ylabel="PGA, horizontal vector (m/s²)", yscale="log")
        plain_log(ratio.yaxis)
        known = np.isfinite(value["distance_km"]) & np.isfinite(value["magnitude"])
        scatter(
            source, value["distance_km"][known], value["magnitude"][known],
            [name for name, told in zip(names, known, strict=True) if told], COLOURS(0.35),
        )  # fmt: skip
        source.set(xlabel="distance (km)", ylabel="magnitude", title=_unknown(known))
        events = len(set(ensemble.catalog.column("event").to_pylist()))
        figure.suptitle(f"{len(names)} records, {events} event{'' if events == 1 else 's'}")
    return figure


def upper_limit(values: Array) -> float:
    """End of an axis from 0 that no outlier stretches: the largest value within the fence, and a margin."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return 1.0
    low, high = np.percentile(finite, [25, 75])
    inside = finite[finite <= high + FENCE * (high - low)]
    return float(1.05 * inside.max()) or 1.0


def scatter(axes: Axes, x: Array, y: Array, names: list[str], colour: object) -> None:
    """Points whose outliers in x stand at the right edge as triangles, with name and value."""
    end = upper_limit(x)
    inside = x <= end
    axes.scatter(x[inside], y[inside], s=12, alpha=0.75, color=colour, linewidths=0)
    axes.set_xlim(0.0, end)
    beyond = np.flatnonzero(~inside & np.isfinite(x))
    axes.scatter(np.full(len(beyond), end), y[beyond], s=16, marker=">", color="0.2", clip_on=False, zorder=3)
    farthest = beyond[np.argsort(-x[beyond])]
    for place in farthest[:MOST_NAMED]:
        axes.annotate(
            f"{_shortened(names[place])}: {x[place]:.3g}", (end, y[place]), xytext=(-5, 0), size=6.5, ha="right",
            va="center", textcoords="offset points",
            bbox={"facecolor": "white", "alpha": 0.75, "lw": 0, "pad": 0.6},
        )  # fmt: skip
    if len(farthest) > MOST_NAMED:
        axes.annotate(
            f"and {len(farthest) - MOST_NAMED} more beyond", (0.98, 0.02), xycoords="axes fraction", size=6.5,
            ha="right",
        )  # fmt: skip


def _draw_spectra(ensemble: Ensemble, axes: Axes) -> None:
    table = np.column_stack(
        [ensemble.catalog.column(f"sa_rotd50_{period:g}s_m_s2").to_numpy() for period in SPECTRUM_PERIODS_S]
    )
    axes.loglog(SPECTRUM_PERIODS_S, table.T, color="0.75", linewidth=0.5)
    low, median, high = np.percentile(table, [16, 50, 84], axis=0)
    axes.loglog(SPECTRUM_PERIODS_S, median, color=COLOURS(0.1), linewidth=1.6, label="median")
    axes.loglog(
        SPECTRUM_PERIODS_S, low, color=COLOURS(0.1), linewidth=0.9, linestyle="--", label="16 and 84 %"
    )
    axes.loglog(SPECTRUM_PERIODS_S, high, color=COLOURS(0.1), linewidth=0.9, linestyle="--")
    axes.set(xlabel="period (s)", ylabel="SA RotD50, 5 % damping (m/s²)")
    plain_log(axes.xaxis)
    axes.legend(frameon=False)


def _shortened(name: str, most: int = 22) -> str:
    return name if len(name) <= most else name[: most - 1] + "…"


def _unknown(known: NDArray[np.bool_]) -> str:
    missing = int((~known).sum())
    return f"{missing} of unknown magnitude or distance" if missing else ""
