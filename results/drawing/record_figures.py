"""Figure of an ensemble: response spectra, PGA against PGV/PGA, magnitude against distance."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import ScaledTranslation

from toppling.models.arrays import Array
from toppling.models.errors import counted
from toppling.models.files.folder import new_file
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.intensity import SPECTRUM_PERIODS_S
from toppling.results.drawing.style import COLOURS, FULL_WIDTH_IN, cut, plain_log, style

_FENCE = 3.0
"""Distance above the third quartile, in interquartile ranges, beyond which a value is an outlier."""
_MOST_NAMED = 3
"""Maximum number of outliers named above a panel."""
_INSET_IN = 0.04
"""Distance of an outlier's triangle from the edge that it marks, inches."""
_LEAST_KM = 0.1
"""Smallest distance on the logarithmic axis, km; smaller ones are drawn there."""


def draw_records(ensemble: Ensemble, path: Path) -> None:
    """Draw the figure of an ensemble into a file, whose suffix determines the format."""
    figure = records_figure(ensemble)
    with style(), new_file(path) as hidden:
        figure.savefig(hidden, format=path.suffix[1:] or "png")


def records_figure(ensemble: Ensemble, width_in: float = FULL_WIDTH_IN) -> Figure:
    """Response spectra, PGA against PGV/PGA, magnitude against distance.

    width_in: width of the figure; three panels in a row at full width, stacked at less.
    """
    in_row = width_in >= FULL_WIDTH_IN
    names = ensemble.record_ids
    value = {
        name: np.array(ensemble.catalog.column(name).to_pylist(), dtype=float)
        for name in ("pga_m_s2", "pgv_pga_s", "distance_km", "magnitude")
    }
    with style():
        figure = Figure(figsize=(width_in, 2.7) if in_row else (width_in, 7.6), layout="constrained")
        spectra, ratio, source = figure.subplots(*((1, 3) if in_row else (3, 1)))
        _draw_spectra(ensemble, spectra)
        scatter(ratio, value["pgv_pga_s"], value["pga_m_s2"], names, COLOURS(0.35))
        ratio.set(xlabel="PGV/PGA (s)", ylabel="PGA, horizontal vector (m/s²)")
        plain_log(ratio.yaxis)
        known = np.isfinite(value["distance_km"]) & np.isfinite(value["magnitude"])
        distance_km = np.maximum(value["distance_km"][known], _LEAST_KM)
        look: dict[str, Any] = {"s": 12, "alpha": 0.75, "color": COLOURS(0.35), "linewidths": 0}
        source.scatter(distance_km, value["magnitude"][known], **look)
        source.set_xscale("log")
        plain_log(source.xaxis)
        missing = int((~known).sum())
        title = f"{missing} not drawn: magnitude or\ndistance unknown" if missing else ""
        source.set(xlabel="distance (km)", ylabel="magnitude", title=title)
        if not known.any():  # without data the ticks would be meaningless
            source.set_axis_off()
        events = len(set(ensemble.catalog.column("event").to_pylist()))
        figure.suptitle(f"{counted(len(names), 'record')}, {counted(events, 'event')}")
    return figure


def _upper_limit(values: Array) -> float:
    """End of an axis from 0 that excludes outliers: the largest value within the fence, with a margin."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return 1.0
    low, high = np.percentile(finite, [25, 75])
    inside = finite[finite <= high + _FENCE * (high - low)]
    return float(1.05 * inside.max()) or 1.0


def _log_limits(values: Array) -> tuple[float, float]:
    """Ends of a logarithmic axis that excludes outliers: the extreme values within the fences, with a margin."""
    logs = np.log(values[np.isfinite(values) & (values > 0)])
    if not len(logs):
        return 0.1, 10.0
    low, high = np.percentile(logs, [25, 75])
    inside = logs[(logs >= low - _FENCE * (high - low)) & (logs <= high + _FENCE * (high - low))]
    margin = 0.05 * max(float(np.ptp(inside)), 0.2)
    return float(np.exp(inside.min() - margin)), float(np.exp(inside.max() + margin))


def scatter(axes: Axes, x: Array, y: Array, names: list[str], colour: object) -> None:
    """Scatter plot with a logarithmic y; outliers are triangles at the edge, named above the panel."""
    end = _upper_limit(x)
    bottom, top = _log_limits(y)
    inside = (x <= end) & (y >= bottom) & (y <= top)
    axes.scatter(x[inside], y[inside], s=12, alpha=0.75, color=colour, linewidths=0)
    axes.set(xlim=(0.0, end), yscale="log", ylim=(bottom, top))
    lines = []
    for marker, sign, beyond, off, value in (
        (">", "▶", (x > end) & (y > 0), (-1, 0), x),
        ("v", "▼", (x <= end) & (y < bottom), (0, 1), y),
        ("^", "▲", (x <= end) & (y > top), (0, -1), y),
    ):
        some = np.flatnonzero(beyond)
        inward = ScaledTranslation(_INSET_IN * off[0], _INSET_IN * off[1], axes.figure.dpi_scale_trans)
        axes.scatter(
            np.minimum(x[some], end), np.clip(y[some], bottom, top), marker=marker, s=16, color="0.2", zorder=3,
            linewidths=0, transform=axes.transData + inward,
        )  # fmt: skip
        farthest = some[np.argsort(value[some])] if marker == "v" else some[np.argsort(-value[some])]
        lines += [f"{sign} {cut(names[index])}: {value[index]:.3g}" for index in farthest]
    more = [f"and {len(lines) - _MOST_NAMED} more beyond"] if len(lines) > _MOST_NAMED else []
    axes.set_title("\n".join(lines[:_MOST_NAMED] + more), size=6.5, loc="right")


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
    ends = [_log_limits(column) for column in table.T]  # outlying spectra leave the frame
    axes.set_ylim(min(low for low, _ in ends), max(high for _, high in ends))
    axes.set(xlabel="period (s)", ylabel="SA RotD50, 5 % damping (m/s²)")
    plain_log(axes.xaxis)
    axes.legend(frameon=False)
