"""Which rocks which scenarios topple: a matrix, and a map of the sites."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from toppling.results.drawing.side_by_side_figures import frame_map, name_points, ring_sizes
from toppling.results.drawing.style import COLOURS, FULL_WIDTH_IN, style
from toppling.results.schema import TOPPLED_OUTCOMES

_MOST_LABELS = 60
_ROW_IN = 0.16


def scenarios_figure(rows: pd.DataFrame, matrix: pd.DataFrame) -> Figure:
    """Share of each rock's shakings that topple it under each scenario; below, where places are known, a map.

    Parameters
    ----------
    rows : DataFrame
        From `orchestrator.studies.check_sites`: rock, longitude, latitude, outcome.
    matrix : DataFrame
        Share by rock (rows) and scenario (columns).
    """
    placed = rows.dropna(subset=["longitude", "latitude"]).groupby("rock", sort=True)
    height = 1.6 + _ROW_IN * min(len(matrix), _MOST_LABELS)
    with style():
        size = (FULL_WIDTH_IN, height + (4.4 if len(placed) else 0.0))
        figure = Figure(figsize=size, layout="constrained")
        if not len(placed):
            _draw_matrix(figure.subplots(), matrix, figure)
            return figure
        above, below = figure.subplots(2, 1, height_ratios=(height, 4.4))
        _draw_matrix(above, matrix, figure)
        points = np.array([group[["longitude", "latitude"]].iloc[0] for _, group in placed], float)
        shares = np.array([_share_as_they_are(group) for _, group in placed])
        frame_map(below, points)
        sizes, bare = ring_sizes(points), np.isnan(shares)
        below.scatter(points[bare, 0], points[bare, 1], sizes[bare], marker="x", color="0.4", lw=0.9)
        behind = np.argsort(-sizes)[~bare[np.argsort(-sizes)]]
        x, y = points[behind].T
        below.scatter(x, y, sizes[behind], shares[behind], cmap=COLOURS, vmin=0, vmax=1, ec="0.2", lw=0.5)
        texts = ["none" if np.isnan(share) else f"{100 * share:.0f} %" for share in shares]
        names = [f"{name} {words}" for (name, _), words in zip(placed, texts, strict=True)]
        name_points(below, points, names)
        below.set_title("share of scenarios that topple each rock as they are")
    return figure


def _share_as_they_are(rows: pd.DataFrame) -> float:
    """Of the seismograms with an answer; not a number where there is none."""
    known = rows["outcome"].isin(["stands", "moved", *TOPPLED_OUTCOMES])
    toppled = rows["outcome"].isin(TOPPLED_OUTCOMES)
    return float(toppled.sum() / known.sum()) if known.any() else float("nan")


def _draw_matrix(axes: Axes, matrix: pd.DataFrame, figure: Figure) -> None:
    values = np.ma.masked_invalid(matrix.to_numpy(float))
    shades = COLOURS.with_extremes(bad="0.9")
    image = axes.imshow(values, aspect="auto", cmap=shades, vmin=0, vmax=1, interpolation="nearest")
    few = max(1, int(np.ceil(matrix.shape[1] / _MOST_LABELS)))
    axes.set_xticks(
        range(0, matrix.shape[1], few),
        [str(name)[:16] for name in matrix.columns[::few]],
        rotation=90,
        size=6,
    )
    few = max(1, int(np.ceil(matrix.shape[0] / _MOST_LABELS)))
    axes.set_yticks(range(0, matrix.shape[0], few), [str(name)[:24] for name in matrix.index[::few]], size=6)
    axes.set(
        xlabel="scenario",
        title="share toppled, with the seismogram a little weaker and stronger too (grey: none)",
    )
    figure.colorbar(image, ax=axes, shrink=0.9, label="share toppled")
