"""Where a rock was scanned and where it stands once it has settled: its contact, and what topples it."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes

from toppling.models.arrays import Array
from toppling.models.scene import Scene
from toppling.models.statics import support_polygon_m
from toppling.results.drawing.roses import emptiest_deg, mark_winds
from toppling.results.drawing.style import FULL_WIDTH_IN, style

_SCANNED, _STANDS = "#0072b2", "#d55e00"
"""Blue and vermilion of Okabe and Ito, which everybody can tell apart."""
Rose = Sequence[tuple[float, float]]


def draw(
    scanned: Scene, stands: Scene, outline_m: Array, rose_scanned: Rose, rose_stands: Rose, path: Path
) -> None:
    """Write a PNG of two panels: the contact in plan, and the least toppling acceleration by azimuth.

    Parameters
    ----------
    scanned, stands : Scene
        The rock as it was scanned, and settled.
    outline_m : (k, 3) array
        Corners of the contact as scanned.
    rose_scanned, rose_stands : sequence of (float, float)
        Azimuth of the ground's acceleration, degrees counter-clockwise from east, and the least constant
        acceleration that topples, m/s2.
    """
    with style():
        figure = Figure(figsize=(FULL_WIDTH_IN, 4.4), layout="constrained")
        FigureCanvasAgg(figure)
        _plan(figure.add_subplot(1, 2, 1), scanned, stands, outline_m)
        _roses(figure.add_subplot(1, 2, 2, projection="polar"), rose_scanned, rose_stands)
        legends = [axes.get_legend_handles_labels() for axes in figure.axes]
        lines, names = ([one for part in parts for one in part] for parts in zip(*legends, strict=True))
        figure.legend(lines, names, loc="outside lower center", ncols=2, frameon=False)
        figure.savefig(path, format="png")


def _plan(axes: Axes, scanned: Scene, stands: Scene, outline_m: Array) -> None:
    ring = np.vstack([outline_m, outline_m[:1]])
    axes.plot(ring[:, 0], ring[:, 1], "--", color=_SCANNED, linewidth=1.3, label="contact as scanned")
    carrying = support_polygon_m(stands.rock, stands.pedestal)
    ring = np.vstack([carrying, carrying[:1]])
    label = f"{len(carrying)} contact points once settled"
    axes.plot(ring[:, 0], ring[:, 1], "s-", color=_STANDS, markersize=4, linewidth=1.3, label=label)
    for scene, colour, name in ((scanned, _SCANNED, "as scanned"), (stands, _STANDS, "once settled")):
        label = f"centre of mass {name}"
        axes.plot(*scene.rock.com_m[:2], "+", color=colour, markersize=9, markeredgewidth=1.5, label=label)
    axes.set(aspect="equal", xlabel="east (m)", ylabel="north (m)", title="contact from above")


def _roses(axes: Axes, rose_scanned: Rose, rose_stands: Rose) -> None:
    assert isinstance(axes, PolarAxes)
    reach, scale_deg = 0.0, 67.5
    for rose, dashes, colour, name in (
        (rose_scanned, "--", _SCANNED, "on the contact as scanned"),
        (rose_stands, "-", _STANDS, "once settled"),
    ):
        azimuth, value = np.array([*rose, (360.0, rose[0][1])]).T
        finite = value[np.isfinite(value)]
        reach = max(reach, float(finite.max()) if len(finite) else 1.0)
        scale_deg = emptiest_deg(azimuth, value)
        axes.plot(np.deg2rad(azimuth), value, dashes, color=colour, label=f"topples {name}")
    axes.set_ylim(0.0, 1.05 * reach)
    axes.set_title("quasi-static toppling acceleration (m/s²)\nby azimuth of the ground's acceleration")
    mark_winds(axes, scale_deg)
