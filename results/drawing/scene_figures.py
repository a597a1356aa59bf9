"""Figure of a scene: rock, interface and pedestal in different colours, which shows a wrong split immediately."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patheffects import Stroke, withStroke
from matplotlib.projections.polar import PolarAxes

from toppling.models.arrays import Array
from toppling.models.frames import compass_deg
from toppling.models.scene import Scene
from toppling.results.drawing.painted_mesh import faces_eye, hidden, painted, surfaces_of, view_frame
from toppling.results.drawing.roses import emptiest_deg, mark_winds, wind_of
from toppling.results.drawing.style import CLIFF_COLOUR, CONTACT_COLOUR, FULL_WIDTH_IN, style

VIEWS_DEG = ((20.0, 0.0), (20.0, 120.0), (20.0, 240.0))
"""Elevation and azimuth of each view, degrees."""
_VIEW_REACH = 0.66
"""Half width of a view, as a fraction of the rock's largest side."""
_SHADOW_COLOUR = "#f0dcc0"
"""Fill colour of the rock in plan."""
_ON_SURFACE = 0.03
"""Depth behind a surface at which a line still counts as visible, as a fraction of the rock's height."""
_POINTS_ON_LINE = 160
"""Number of points at which the visibility of a line is tested."""


def draw_scene(scene: Scene, path: Path) -> None:
    """Write a PNG: three views, the plan of the interface, the statics by azimuth."""
    figure = scene_picture(scene)
    with style():
        figure.savefig(path, format="png")


def scene_picture(scene: Scene, width_in: float = FULL_WIDTH_IN) -> Figure:
    """Three views, the plan of the interface, and the statics by azimuth.

    width_in: width of the figure; three panels per row at full width, one at less.
    """
    with style():
        if width_in >= FULL_WIDTH_IN:
            figure = Figure(figsize=(width_in, 5.4), layout="constrained")
            grid = figure.add_gridspec(2, 6)
            places = [*(grid[0, 2 * k : 2 * k + 2] for k in range(3)), grid[1, :3], grid[1, 3:]]
        else:
            figure = Figure(figsize=(width_in, 17.0), layout="constrained")
            grid = figure.add_gridspec(5, 1)
            places = [grid[k] for k in range(5)]
        FigureCanvasAgg(figure)
        for place, (elevation, azimuth) in zip(places[:3], VIEWS_DEG, strict=True):
            axes = figure.add_subplot(place)
            draw_view(axes, scene, elevation, azimuth)
            axes.set_title(f"looking {wind_of(azimuth + 180.0)}")
        _draw_plan(figure.add_subplot(places[3]), scene)
        polar = figure.add_subplot(places[4], projection="polar")
        assert isinstance(polar, PolarAxes)
        draw_statics(polar, scene)
    return figure


def draw_view(axes: Axes, scene: Scene, elevation_deg: float, azimuth_deg: float) -> None:
    """Draw an orthographic view of the scene with the interface's lines, dotted where hidden."""
    frame = view_frame(elevation_deg, azimuth_deg)
    toward = frame[:, 2]
    rock, pedestal = surfaces_of(scene)
    surfaces = [rock]
    # From below, or from behind a slope steeper than the view's elevation, an infinite plane would hide the rock.
    if not scene.pedestal.is_plane or toward @ scene.pedestal.normal > 0:
        surfaces.append(pedestal)
    corner, colour, of_rock = painted(surfaces, frame, scene.pedestal)
    axes.add_collection(_triangles(corner, colour))
    before_lines = corner[of_rock] if scene.pedestal.is_plane else corner
    for line, dashes, of_line in interface_lines(scene):
        _draw_line(axes, line @ frame, before_lines, _ON_SURFACE * scene.rock.height_m, dashes, of_line)
    # All views have the rock's scale: that of a wide pedestal would make the rock small.
    projected = scene.rock.vertices_m @ frame
    middle = 0.5 * (projected.min(axis=0) + projected.max(axis=0))
    reach = _VIEW_REACH * float(np.ptp(scene.rock.vertices_m, axis=0).max())
    axes.set(
        aspect="equal",
        xlim=(middle[0] - reach, middle[0] + reach),
        ylim=(middle[1] - reach, middle[1] + reach),
        xticks=[],
        yticks=[],
    )
    _draw_scale(axes, reach)
    axes.annotate(
        f"{wind_of(azimuth_deg + 90.0)} →", (0.98, 0.02), xycoords="axes fraction", ha="right", va="bottom", size=7,
        path_effects=[withStroke(linewidth=2, foreground="white")],
    )  # fmt: skip


def _triangles(corners: Array, colours: Array | str) -> PolyCollection:
    """Triangles (n, 3, 3), projected along the third axis, in the order of painting."""
    # Matplotlib makes paths faster from an array than from the sequence that its types require.
    flat = cast("list[Array]", corners[:, :, :2])
    return PolyCollection(flat, facecolors=colours, edgecolors="face", linewidths=0.3)


def _draw_line(axes: Axes, line: Array, corners: Array, tolerance_m: float, dashes: str, colour: str) -> None:
    """Draw a line of the interface: thick where visible, thin and dotted where hidden by a surface."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.linspace(0.0, along[-1], _POINTS_ON_LINE)
    points = np.column_stack([np.interp(at, along, axis) for axis in line.T])
    behind = hidden(points, corners, tolerance_m)
    seen, covered = (np.where((behind == there)[:, None], points[:, :2], np.nan).T for there in (False, True))
    axes.plot(*covered, ":", lw=0.8, alpha=0.9, color=colour)
    halo = [
        Stroke(linewidth=2.8, foreground="white", alpha=0.8),
        withStroke(linewidth=2.2, foreground="white"),
    ]
    axes.plot(*seen, dashes, lw=1.5, color=colour, path_effects=halo if dashes == "-" else None)


def _draw_scale(axes: Axes, reach_m: float) -> None:
    decade = float(10 ** np.floor(np.log10(0.6 * reach_m)))
    length = max(step * decade for step in (1, 2, 5) if step * decade <= 0.6 * reach_m)
    left, bottom = axes.get_xlim()[0], axes.get_ylim()[0]
    x, y = left + 0.08 * reach_m, bottom + 0.1 * reach_m
    around = [withStroke(linewidth=3, foreground="white")]
    axes.plot([x, x + length], [y, y], "k-", lw=1.5, path_effects=around, solid_capstyle="butt")
    axes.text(
        x + 0.5 * length,
        y + 0.04 * reach_m,
        f"{length:g} m",
        ha="center",
        va="bottom",
        size=7,
        path_effects=around,
    )


def interface_lines(scene: Scene) -> list[tuple[Array, str, str]]:
    """Contact outlines and cliff edges, (n, 3) each, with dashes and colour; likelier contacts are broken lines."""
    interface = scene.report.get("interface", {})
    likelier = [each["outline_m"] for each in interface.get("outlines", [])]
    outlines = [np.array(each) for each in [interface.get("outline_m", []), *likelier]]
    lines = [
        (np.vstack([each, each[:1]]), dashes, CONTACT_COLOUR)
        for each, dashes in zip(outlines, ["-", "--", ":"], strict=False)
        if len(each)
    ]
    return lines + [(np.array(edge), "-.", CLIFF_COLOUR) for edge in interface.get("edges_m", [])]


def _draw_plan(axes: Axes, scene: Scene) -> None:
    """Draw the plan: outline of the rock, contact outline, cliff edge, centre of mass, north."""
    projected = scene.rock.vertices_m[scene.rock.faces]
    axes.add_collection(_triangles(projected[faces_eye(projected)], _SHADOW_COLOUR))
    for line, dashes, colour in interface_lines(scene):
        axes.plot(line[:, 0], line[:, 1], dashes, color=colour, lw=1.3)
    axes.plot(*scene.rock.com_m[:2], "k+", markersize=8, mew=1.3)
    flat = scene.rock.vertices_m[:, :2]
    middle, reach = 0.5 * (flat.min(axis=0) + flat.max(axis=0)), 0.72 * float(np.ptp(flat, axis=0).max())
    axes.set(
        aspect="equal",
        xlim=(middle[0] - reach, middle[0] + reach),
        ylim=(middle[1] - reach, middle[1] + reach),
        xlabel="east (m)",
        ylabel="north (m)",
        title="from above",
    )
    axes.annotate(
        "N",
        (0.93, 0.83),
        (0.93, 0.97),
        xycoords="axes fraction",
        ha="center",
        va="top",
        size=8,
        weight="bold",
    )
    axes.annotate(
        "",
        (0.93, 0.9),
        (0.93, 0.76),
        xycoords="axes fraction",
        arrowprops={"arrowstyle": "-|>", "lw": 1.2, "color": "k"},
    )


def draw_statics(axes: PolarAxes, scene: Scene) -> None:
    """Draw the accelerations that tip and slide the rock by azimuth, with that of the drawn bases."""
    azimuth_deg, value, slides = _statics_of(scene)
    azimuth = np.deg2rad(azimuth_deg)
    axes.plot(azimuth, value, color=CONTACT_COLOUR, lw=1.2)
    axes.plot(azimuth, slides, color=CONTACT_COLOUR, lw=1.2, ls=":")
    axes.set_ylim(0, _polar_reach_m_s2(value))
    around, low, high, _ = _base_interval(scene)
    if len(around):
        axes.fill_between(np.deg2rad(around), low, high, color=CONTACT_COLOUR, alpha=0.18, linewidth=0)
    axes.set_title("toppling acceleration (m/s²)")
    mark_winds(axes, emptiest_deg(azimuth_deg[:-1], value[:-1]))


def statics_words(scene: Scene) -> str:
    """What the picture of the statics shows, for the text beside it."""
    _, value, slides = _statics_of(scene)
    around, *_, level = _base_interval(scene)
    bands = [
        *(["dotted: where it slides before it tips"] if np.isfinite(slides).any() else []),
        *([f"blue band: {100 * level:.0f} % of possible bases"] if len(around) else []),
        *_beyond_frame(value),
    ]
    return "; ".join(
        [
            "the least constant ground acceleration that tips it, by where the ground accelerates toward",
            *bands,
        ]
    )


def _base_interval(scene: Scene) -> tuple[Array, Array, Array, float]:
    """Azimuths (closed), lower and upper toppling acceleration over the drawn bases, and the interval's probability.

    Empty for a scene whose base was not drawn.
    """
    found = scene.report.get("unseen_base") or {}
    table = found.get("toppling", [])
    if not table:
        return np.empty(0), np.empty(0), np.empty(0), 0.0
    rows = [*table, {**table[0], "azimuth_deg": table[0]["azimuth_deg"] + 360.0}]
    azimuth, low, high = (
        np.array([row[name] for row in rows], float) for name in ("azimuth_deg", "low_m_s2", "high_m_s2")
    )
    return azimuth, low, high, float(found["level"])


def _polar_reach_m_s2(value: Array) -> float:
    """Radius of the statics' plot, m/s²; a few azimuths with much higher values leave it."""
    positive = value[np.isfinite(value) & (value > 0.0)]
    return float(min(2.0 * np.median(positive), positive.max()) * 1.05) if len(positive) else 1.0


def _beyond_frame(value: Array) -> list[str]:
    """Caption line on values beyond the frame; empty if there are none."""
    reach = _polar_reach_m_s2(value)
    return [f"beyond the frame: more than {reach:.3g} m/s²"] if (value > reach).any() else []


def _statics_of(scene: Scene) -> tuple[Array, Array, Array]:
    """Azimuths (closed) of the ground's acceleration, and the values (m/s²) at which the rock tips and slides."""
    table = scene.to_json()["quasi_static_toppling_m_s2"]
    rows = [*table, {**table[0], "azimuth_deg": 360.0}]
    azimuth, tips, slides = (
        np.array([row[name] for row in rows], float) for name in ("azimuth_deg", "value", "slides_m_s2")
    )
    return azimuth, tips, slides


def numbers_of(scene: Scene, notes: Sequence[str] = ()) -> list[str]:
    """Text lines for a scene: sizes with their uncertainty, the interface, and notes."""
    rock, report = scene.rock, scene.report
    spread, registration = report.get("uncertainty", {}), report.get("registration", {})
    downhill = scene.pedestal.downhill_azimuth_deg
    volume, com = spread.get("volume_std_m3"), spread.get("com_std_m")
    if "com_m" in (report.get("unseen_base") or {}):
        com = None  # the notes give its interval over the drawn bases, which includes all uncertainty
    lines = [
        f"volume {rock.volume_m3:.5g}{'' if volume is None else f' ± {volume:.2g}'} m³, "
        f"height {rock.height_m:.4g} m",
        "centre of mass {:.3f}, {:.3f}, {:.3f}".format(*rock.com_m)
        + (" m" if com is None else " ± {:.2g}, {:.2g}, {:.2g} m (one standard deviation)".format(*com)),
        f"interface falls {scene.pedestal.slope_deg:.2f}° toward azimuth "
        f"{downhill:.1f}° ({float(compass_deg(downhill)):.0f}° compass)",
        *_surface_of(report),
        "origin {:.1f}, {:.1f}, {:.1f} m".format(*scene.origin_m),
    ]
    if "residual_m" in registration:
        lines.append(_fit_of(registration))
    return [*lines, *notes]


def _surface_of(report: Mapping[str, Any]) -> list[str]:
    """Lines on the interface's roughness and the observed part of the surface, where a scan measured them."""
    interface, surface = report.get("interface", {}), report.get("surface", {})
    lines = []
    if "roughness_m" in interface and interface.get("given_by") != "plane":  # a plane fits itself
        lines.append(f"roughness {interface['roughness_m']:.3g} m")
    if surface:
        lines.append(
            f"surface seen {_percent(surface['seen_share'], 1)}, closed at the interface "
            f"{_percent(surface['closed_share'], 1)}, invented {_percent(surface['invented_share'], 1)}"
        )
    return lines


def _percent(share: float, digits: int = 0) -> str:
    return f"{100 * share:.{digits}f} %"


def _fit_of(registration: Mapping[str, Any]) -> str:
    """Line on the residual of the stations' registration, if they overlap."""
    stations, residual = registration["stations"], registration["residual_m"]
    if residual is None:
        return f"{stations} stations do not overlap: the residual of their registration is unknown"
    residuals = [fit["residual_m"] for fit in registration.get("of_stations", [])]
    alone = [value for value in residuals if value is not None]
    compared = f"{len(alone)} of {stations}" if alone and len(alone) < stations else f"{stations}"
    return f"{compared} stations fit each other within {1e3 * residual:.2g} mm" + (
        f", the worst within {1e3 * max(alone):.2g} mm" if alone else ""
    )
