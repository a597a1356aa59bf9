"""One figure of an ensemble: response spectra, PGA against PGV/PGA, magnitude against distance."""

from pathlib import Path

import matplotlib
import matplotlib.axes
import numpy as np
from matplotlib.figure import Figure

from toppling.models.folder import new_file
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.intensity import SPECTRUM_PERIODS_S


def draw(ensemble: Ensemble, path: Path) -> None:
    """Draw the figure into a file whose suffix names its format."""
    with matplotlib.rc_context({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False}):
        figure = Figure(figsize=(11, 3.6), layout="constrained")
        spectra, ratio, source = figure.subplots(1, 3)
        _spectra(ensemble, spectra)
        column = {name: ensemble.catalog.column(name).to_numpy() for name in ("pga_m_s2", "pgv_pga_s")}
        ratio.scatter(column["pgv_pga_s"], column["pga_m_s2"], s=14, alpha=0.7, color="#31688e")
        ratio.set(xlabel="PGV/PGA (s)", ylabel="PGA, horizontal vector (m/s²)", yscale="log", xlim=(0, None))
        distance, magnitude = (
            np.array(ensemble.catalog.column(name).to_pylist(), dtype=float)
            for name in ("distance_km", "magnitude")
        )
        known = np.isfinite(distance) & np.isfinite(magnitude)
        source.scatter(distance[known], magnitude[known], s=14, alpha=0.7, color="#35b779")
        source.set(xlabel="distance (km)", ylabel="magnitude", title=_unknown(known))
        figure.suptitle(
            f"{len(known)} records, {len(set(ensemble.catalog.column('event').to_pylist()))} events"
        )
        with new_file(path) as hidden:
            figure.savefig(hidden, format=path.suffix[1:] or "png", dpi=150)


def _spectra(ensemble: Ensemble, axes: matplotlib.axes.Axes) -> None:
    table = np.column_stack(
        [ensemble.catalog.column(f"sa_rotd50_{period:g}s_m_s2").to_numpy() for period in SPECTRUM_PERIODS_S]
    )
    axes.loglog(SPECTRUM_PERIODS_S, table.T, color="0.75", linewidth=0.5)
    low, median, high = np.percentile(table, [16, 50, 84], axis=0)
    axes.loglog(SPECTRUM_PERIODS_S, median, color="#440154", linewidth=2, label="median")
    axes.loglog(SPECTRUM_PERIODS_S, low, color="#440154", linewidth=1, linestyle="--", label="16 and 84 %")
    axes.loglog(SPECTRUM_PERIODS_S, high, color="#440154", linewidth=1, linestyle="--")
    axes.set(xlabel="period (s)", ylabel="SA RotD50, 5 % damping (m/s²)")
    axes.legend(frameon=False)


def _unknown(known: np.ndarray) -> str:
    missing = int((~known).sum())
    return f"{missing} of unknown magnitude or distance" if missing else ""
