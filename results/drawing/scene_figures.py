"""Pictures of a scene: painted meshes, its figure, interactive pages without a network, export to other programs."""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import trimesh
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.patheffects import Stroke, withStroke
from matplotlib.projections.polar import PolarAxes
from numpy.typing import NDArray

from toppling.models.arrays import Array
from toppling.models.caching import cached
from toppling.models.errors import InputError
from toppling.models.files.folder import new_file
from toppling.models.frames import quadrant_of
from toppling.models.hidden_base.intervals import volume_text
from toppling.models.pedestal import Pedestal
from toppling.models.scene import Scene
from toppling.models.smooth_mesh import CREASE_DEG
from toppling.results.drawing.roses import emptiest_deg, mark_winds, wind_of
from toppling.results.drawing.style import (
    ALARM_COLOUR,
    CLIFF_COLOUR,
    COLOURS,
    CONTACT_COLOUR,
    FULL_WIDTH_IN,
    PEDESTAL_COLOUR,
    ROCK_COLOUR,
    style,
    svg_text,
)
from toppling.results.drawing.templates import rendered
from toppling.results.replayed_job import STILL_FRACTION, Replay

_AMBIENT = 0.45
"""Fraction of ambient light."""
_LIGHT = np.array([-0.4, 0.55, 0.75])
"""Direction of the remaining light, in view axes: the upper left."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles with vertex normals; vertices on a sharp edge are duplicated, one per side."""

    # (n, 3) each.
    vertices_m: Array
    normals: Array
    faces: NDArray[np.int64]  # (k, 3)
    colour: str


def smooth_surface(vertices_m: Array, faces: NDArray[np.int64], colour: str) -> Surface:
    """Surface of a mesh whose edges are sharp where faces meet at more than `CREASE_DEG`."""
    mesh = trimesh.Trimesh(vertices_m, faces, process=False)
    smooth = trimesh.graph.smooth_shade(mesh, angle=np.deg2rad(CREASE_DEG))
    return Surface(
        np.asarray(smooth.vertices, float),
        np.asarray(smooth.vertex_normals, float),
        np.asarray(smooth.faces),
        colour,
    )


@cached
def surfaces_of(scene: Scene) -> tuple[Surface, Surface]:
    """Surfaces of the rock and the pedestal of a scene."""
    return (
        smooth_surface(scene.rock.vertices_m, scene.rock.faces, ROCK_COLOUR),
        smooth_surface(*scene.pedestal_triangles(), PEDESTAL_COLOUR),
    )


def view_frame(elevation_deg: float, azimuth_deg: float) -> Array:
    """Axes (3, 3; columns right, up, toward the eye) of a view from an elevation and azimuth."""
    turn, lift = np.deg2rad(azimuth_deg), np.deg2rad(elevation_deg)
    toward = np.array([np.cos(lift) * np.cos(turn), np.cos(lift) * np.sin(turn), np.sin(lift)])
    right = np.array([-np.sin(turn), np.cos(turn), 0.0])
    return np.column_stack([right, np.cross(toward, right), toward])


def painted(
    surfaces: Sequence[Surface], frame: Array, pedestal: Pedestal
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Triangles of a rock, and optionally of its pedestal, sorted from far to near for painting.

    surfaces: the rock's first; the pedestal's is open, and its inside may be visible.
    frame: from `view_frame`.

    Returns (n, 3, 3) array: corners along the axes of the view.
    Returns (n, 3) array: colours, between 0 and 1.
    Returns (n,) array: whether triangles belong to the rock.
    """
    corner = np.concatenate([surface.vertices_m[surface.faces] @ frame for surface in surfaces])
    colour = np.concatenate([_shades(surface, frame @ _LIGHT) for surface in surfaces])
    of_rock = np.arange(len(corner)) < len(surfaces[0].faces)
    depth = corner[:, :, 2].mean(axis=1)
    if pedestal.is_plane:  # its triangles are too large for a single depth, and lie behind the rock
        depth[~of_rock] = -np.inf
    order = np.argsort(depth)
    order = order[(_faces_eye(corner) | ~of_rock)[order]]
    return corner[order], colour[order], of_rock[order]


def _shades(surface: Surface, light: Array) -> Array:
    """Colour of each face (k, 3), between 0 and 1, under directional light with visible shape in the shadow."""
    normal = surface.normals[surface.faces].mean(axis=1)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    # Half Lambert: light wraps around, so that the dark side of a boulder is not flat.
    lit = _AMBIENT + (1.0 - _AMBIENT) * (0.5 + 0.5 * (normal @ (light / np.linalg.norm(light)))) ** 1.5
    return lit[:, None] * np.array(to_rgb(surface.colour))


def _faces_eye(corners: Array) -> NDArray[np.bool_]:
    """Mask of the triangles (n, 3, 3), third axis toward the eye, whose outer side faces the eye."""
    return np.asarray(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0.0)


def hidden(points: Array, corners: Array, tolerance_m: float) -> NDArray[np.bool_]:
    """Mask of the points (k, 3) behind a triangle (n, 3, 3), third axis toward the eye, by more than a tolerance."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    facing = np.abs(area) > 1e-14
    facing &= (corners.max(axis=1) >= points.min(axis=0))[:, :2].all(axis=1)
    facing &= (corners.min(axis=1) <= points.max(axis=0))[:, :2].all(axis=1)
    a, b, c, area = a[facing], b[facing], c[facing], area[facing]
    behind = np.zeros(len(points), bool)
    for number, (x, y, depth) in enumerate(points):
        u = ((b[:, 0] - x) * (c[:, 1] - y) - (b[:, 1] - y) * (c[:, 0] - x)) / area
        v = ((c[:, 0] - x) * (a[:, 1] - y) - (c[:, 1] - y) * (a[:, 0] - x)) / area
        over = (u >= 0) & (v >= 0) & (u + v <= 1)
        if over.any():
            w = 1.0 - u[over] - v[over]
            nearest = (u[over] * a[over, 2] + v[over] * b[over, 2] + w * c[over, 2]).max()
            behind[number] = nearest > depth + tolerance_m
    return behind


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
    with style(), new_file(path) as hidden:
        figure.savefig(hidden, format="png")


def scene_picture(scene: Scene, width_in: float = FULL_WIDTH_IN) -> Figure:
    """Three views, the plan of the interface, and the statics by azimuth.

    width_in: width of the figure; three panels per row at full width, one at less.
    """
    with style():
        if width_in >= FULL_WIDTH_IN:
            figure = Figure(figsize=(width_in, 5.7), layout="constrained")
            grid = figure.add_gridspec(2, 6)
            places = [*(grid[0, 2 * k : 2 * k + 2] for k in range(3)), grid[1, :3], grid[1, 3:]]
        else:
            figure = Figure(figsize=(width_in, 17.6), layout="constrained")
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
        _draw_statics(polar, scene)
        _add_legend(figure, 3 if width_in >= FULL_WIDTH_IN else 1)
    return figure


def _add_legend(figure: Figure, columns: int) -> None:
    """Explain below a figure what its panels label."""
    marks = {
        label: mark
        for axes in figure.axes
        for mark, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(marks.values(), marks, loc="outside lower center", ncols=columns, frameon=False)


def draw_view(axes: Axes, scene: Scene, elevation_deg: float, azimuth_deg: float) -> None:
    """Draw an orthographic view of the scene with the interface's lines, thin where hidden."""
    frame = view_frame(elevation_deg, azimuth_deg)
    toward = frame[:, 2]
    rock, pedestal = surfaces_of(scene)
    surfaces = [rock]
    # From below, or from behind a slope steeper than the view's elevation, an infinite plane would hide the rock.
    if not scene.pedestal.is_plane or toward @ scene.pedestal.normal > 0:
        surfaces.append(pedestal)
    corner, colour, of_rock = painted(surfaces, frame, scene.pedestal)
    axes.add_collection(flat_triangles(corner, colour), autolim=False)
    before_lines = corner[of_rock] if scene.pedestal.is_plane else corner
    for line, dashes, of_line, _ in _interface_lines(scene):
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


def flat_triangles(corners: Array, colours: Array | str) -> PolyCollection:
    """Triangles (n, 3, 3), projected along the third axis, in the order of painting."""
    # Matplotlib makes paths faster from an array than from the sequence that its types require.
    flat = cast("list[Array]", corners[:, :, :2])
    return PolyCollection(flat, facecolors=colours, edgecolors="face", linewidths=0.3)


def _draw_line(axes: Axes, line: Array, corners: Array, tolerance_m: float, dashes: str, colour: str) -> None:
    """Draw a line of the interface: thick where visible, thin where hidden by a surface."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.linspace(0.0, along[-1], _POINTS_ON_LINE)
    points = np.column_stack([np.interp(at, along, axis) for axis in line.T])
    behind = hidden(points, corners, tolerance_m)
    seen, covered = (np.where((behind == there)[:, None], points[:, :2], np.nan).T for there in (False, True))
    axes.plot(*covered, dashes, lw=0.5, alpha=0.9, color=colour)
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
    name, middle = f"{length:g} m", x + 0.5 * length
    axes.text(middle, y + 0.04 * reach_m, name, ha="center", va="bottom", size=7, path_effects=around)


def _interface_lines(scene: Scene) -> list[tuple[Array, str, str, str]]:
    """Contact outlines and the pedestal's edges, (n, 3) each, with dashes, colour and meaning."""
    interface = scene.report.get("interface", {})
    around = "around all possible contacts" if scene.report.get("unseen_base") else "contact"
    outlines = [(interface.get("outline_m", []), around)] + [
        (row["outline_m"], f"inside the contacts of {100 * row['probability']:.0f} % of the bases")
        for row in interface.get("outlines", [])
    ]
    lines = [
        (np.array([*outline, outline[0]]), dashes, CONTACT_COLOUR, meaning)
        for (outline, meaning), dashes in zip(outlines, ["-", "--", ":"], strict=False)
        if len(outline)
    ]
    edges = interface.get("edges_m", [])
    return lines + [(np.array(edge), "-.", CLIFF_COLOUR, "edge of the pedestal") for edge in edges]


def _draw_plan(axes: Axes, scene: Scene) -> None:
    """Draw the plan: outline of the rock, contact outline, cliff edge, centre of mass, north."""
    projected = scene.rock.vertices_m[scene.rock.faces]
    axes.add_collection(flat_triangles(projected[_faces_eye(projected)], _SHADOW_COLOUR), autolim=False)
    for line, dashes, colour, meaning in _interface_lines(scene):
        axes.plot(line[:, 0], line[:, 1], dashes, color=colour, lw=1.3, label=meaning)
    axes.plot(*scene.rock.com_m[:2], "k+", markersize=8, mew=1.3, label="centre of mass")
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
        "N", (0.93, 0.76), (0.93, 0.97), xycoords="axes fraction", ha="center", va="top", size=8, weight="bold",
        path_effects=[withStroke(linewidth=3, foreground="white")],
        arrowprops={"arrowstyle": "<|-", "lw": 1.2, "color": "k"},
    )  # fmt: skip


def _draw_statics(axes: PolarAxes, scene: Scene) -> None:
    """Draw the accelerations that topple and slide the rock by azimuth; of the drawn bases, where there are any."""
    nominal = np.array([*scene.stated, scene.stated[0]]).T
    azimuth_deg, topples, slides = np.where(np.isfinite(nominal), nominal, np.nan)
    around_deg, label = azimuth_deg, "topples"
    found = scene.report.get("unseen_base") or {}
    if table := found.get("toppling"):
        rows, names = [*table, table[0]], ("azimuth_deg", "low_m_s2", "median_m_s2", "high_m_s2")
        around_deg, low, topples, high = (np.array([row[name] for row in rows]) for name in names)
        label, band = "topples: median of the bases", f"topples: {100 * found['level']:.0f} % of the bases"
        turn = np.unwrap(np.deg2rad(around_deg))
        axes.fill_between(turn, low, high, color=CONTACT_COLOUR, alpha=0.18, lw=0, label=band)
    axes.plot(np.unwrap(np.deg2rad(around_deg)), topples, color=CONTACT_COLOUR, lw=1.2, label=label)
    if np.isfinite(slides).any():
        slips = "slides before it topples"
        axes.plot(
            np.unwrap(np.deg2rad(azimuth_deg)), slides, color=CONTACT_COLOUR, lw=1.2, ls=":", label=slips
        )
    axes.set_ylim(0, _polar_reach_m_s2(topples))
    axes.set_title("least constant acceleration (m/s²)\nby where the ground accelerates toward")
    mark_winds(axes, emptiest_deg(around_deg[:-1], topples[:-1]))


def _polar_reach_m_s2(value: Array) -> float:
    """Radius of the statics' plot, m/s²; a few azimuths with much higher values leave it."""
    positive = value[np.isfinite(value) & (value > 0.0)]
    return float(min(2.0 * np.median(positive), positive.max()) * 1.3) if len(positive) else 1.0


def numbers_of(scene: Scene, notes: Sequence[str] = ()) -> list[str]:
    """Text lines for a scene: sizes with their uncertainty, the interface, and notes."""
    rock, report = scene.rock, scene.report
    spread, registration = report.get("uncertainty", {}), report.get("registration", {})
    com = spread.get("com_std_m")
    if "com_m" in (report.get("unseen_base") or {}):
        com = None  # the notes give its interval over the drawn bases, which includes all uncertainty
    lines = [
        f"volume {volume_text(report, rock.volume_m3)}, height {rock.height_m:.4g} m",
        "centre of mass {:.3f}, {:.3f}, {:.3f}".format(*rock.com_m)
        + ("" if com is None else " ± {:.2g}, {:.2g}, {:.2g} (one standard deviation)".format(*com))
        + " m (east, north, up of the origin)",
        f"interface dips {scene.pedestal.slope_deg:.2f}° toward {quadrant_of(scene.pedestal.downhill_azimuth_deg)}",
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
        seen, closed, invented = (100 * surface[f"{how}_share"] for how in ("seen", "closed", "invented"))
        lines.append(
            f"surface seen {seen:.1f} %, closed at the interface {closed:.1f} %, invented {invented:.1f} %"
        )
    return lines


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


PAGE_HZ = 25.0
"""Rate of the poses in a page, Hz."""
_PAGE_POSES = 1500
"""Maximum number of poses, and of samples of the ground motion, in a page: about the resolution of a screen."""

ELEVATION_DEG = 14.0
"""Elevation of the view, degrees, from which both the tilt of a rock and its base are visible."""

_FARTHEST_FRAMED = 0.9
"""Maximum displacement, in rock radii, that the initial view includes; the user can follow the rock beyond it."""

_AT_REST_DEG = -60.0
"""Azimuth of the view for a rock that does not fall, degrees: two sides of a block are visible."""

ARROW_COLOUR = "#7a1fa2"


def scene_page(scene: Scene, name: str, notes: Sequence[str] = ()) -> str:
    """HTML of a scene: rock, pedestal, contact outline, cliff edges and statics, with numbers and notes."""
    low, high = scene.rock.vertices_m.min(axis=0), scene.rock.vertices_m.max(axis=0)
    stage = _stage(scene, 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low)), 35.0)
    meanings = dict.fromkeys(meaning for *_, meaning in _interface_lines(scene))
    lines = "\n".join(numbers_of(scene, notes)).replace("\n  ", " ").split("\n")  # joins indented lines
    with style():
        figure = Figure(figsize=(3.4, 4.0), layout="constrained")
        axes = figure.add_subplot(projection="polar")
        assert isinstance(axes, PolarAxes)
        _draw_statics(axes, scene)
        _add_legend(figure, 1)
    return rendered(
        "scene.html", kind="scene", title=f"{name}: scene", heading=name, stage=stage, lines=lines,
        svg=Markup(svg_text(figure)), meanings="; ".join(meanings),
    )  # fmt: skip


def replay_page(replay: Replay, title: str) -> str:
    """HTML page that plays a shake: rock, seismogram with a moving cursor, ground acceleration, point of no return.

    title: heading with the rock's name, the shaking and the outcome.
    """
    times = shown_times(replay, PAGE_HZ, _PAGE_POSES)
    position, turn = replay.at(times)
    target, radius = _framed(replay, position)
    stage = _stage(replay.scene, target, radius, azimuth_across(replay))
    stage["replay"] = _motion_of(replay, times, position, turn)
    return rendered("replay.html", kind="replay", title=title, heading=title, stage=stage)


def shown_times(replay: Replay, rate_hz: float, most: int) -> Array:
    """Times of the part in which the rock moves, at `rate_hz` but `most` at most."""
    first, last = replay.shown_s()
    return np.linspace(first, max(last, first + 1e-3), int(np.clip((last - first) * rate_hz, 2, most)))


def azimuth_across(replay: Replay) -> float:
    """Azimuth of a view perpendicular to the fall, degrees."""
    off = replay.trajectory.position_m - replay.trajectory.position_m[0]
    if np.hypot(off[:, 0], off[:, 1]).max() < STILL_FRACTION * replay.scene.rock.height_m:
        return _AT_REST_DEG
    farthest = off[np.argmax(np.hypot(off[:, 0], off[:, 1]))]
    return float(np.rad2deg(np.arctan2(farthest[1], farthest[0])) - 90.0)


def _framed(replay: Replay, position: Array) -> tuple[Array, float]:
    """Centre and radius of the camera's frame: the rock's initial position, and its fall within a limit."""
    rock = replay.scene.rock
    reach = 0.5 * float(np.linalg.norm(np.ptp(rock.vertices_m, axis=0)))
    off = position - position[0]
    distance = np.linalg.norm(off, axis=1)
    near = off * np.minimum(1.0, _FARTHEST_FRAMED * reach / np.maximum(distance, 1e-12))[:, None]
    middle = 0.5 * (rock.vertices_m.min(axis=0) + rock.vertices_m.max(axis=0))
    shift = 0.5 * (near.min(axis=0) + near.max(axis=0))
    return middle + shift, reach + 0.5 * float(np.linalg.norm(np.ptp(near, axis=0)))


def _stage(scene: Scene, target: Array, radius: float, azimuth_deg: float) -> dict[str, Any]:
    com = scene.rock.com_m
    rock = smooth_surface(scene.rock.vertices_m - com, scene.rock.faces, ROCK_COLOUR)
    eye = view_frame(ELEVATION_DEG, azimuth_deg)[:, 2]
    lines = [{"points": _rounded(line), "colour": colour} for line, _, colour, _ in _interface_lines(scene)]
    return {
        "rock": {**_encoded(rock), "origin": com.tolist()},
        "pedestal": _encoded(smooth_surface(*scene.pedestal_triangles(), PEDESTAL_COLOUR)),
        "lines": lines,
        "camera": {"target": target.tolist(), "radius": radius, "eye": eye.tolist()},
    }


def _encoded(surface: Surface) -> dict[str, str]:
    """Vertices, normals and faces as base64 of binary arrays for WebGL."""
    return {
        "positions": _base64(surface.vertices_m.astype("<f4")),
        "normals": _base64(surface.normals.astype("<f4")),
        "index": _base64(surface.faces.astype("<u4")),
        "colour": surface.colour,
    }


def _base64(values: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode()


def _rounded(values: Array, digits: int = 5) -> list:
    return np.round(values, digits).tolist()


def _motion_of(replay: Replay, times: Array, position: Array, turn: Array) -> dict[str, Any]:
    """Poses, tilt and ground motion during the playback."""
    ground_times = np.linspace(
        times[0], times[-1], int(np.clip((times[-1] - times[0]) * 200.0, 2, _PAGE_POSES))
    )
    ground = replay.ground_m_s2(ground_times).T
    topple = replay.topple_time_s
    support = replay.scene.pedestal.point_m
    return {
        "start": float(times[0]),
        "step": float(times[1] - times[0]),
        "poses": _rounded(np.column_stack([position, turn]), 6),
        "tilt": _rounded(replay.tilts_deg(turn), 3),
        "ground": {
            "start": float(ground_times[0]),
            "step": float(ground_times[1] - ground_times[0]),
            "values": _rounded(ground, 4),
            "peak": max(float(np.abs(ground).max()), 1e-6),
            "strongest": max(float(np.linalg.norm(ground, axis=0).max()), 1e-6),
        },
        "noReturn": topple,
        "noReturnAt": None if topple is None else replay.at(np.array([topple]))[0][0].tolist(),
        "arrowAt": [*replay.scene.rock.com_m[:2].tolist(), float(support[2])],
        "arrowColour": ARROW_COLOUR,
        "alarm": ALARM_COLOUR,
        "colours": [to_hex(COLOURS(share)) for share in (0.1, 0.5, 0.7)],
    }


_EXPORTS = (".glb", ".gltf", ".ply", ".obj")
_Y_UP = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""Rotation by -90 degrees about x, from z up to glTF's y up."""


def export_scene(scene: Scene, path: Path) -> None:
    """Write rock and pedestal as one glTF, PLY or OBJ file, in the scene's local frame.

    In PLY and OBJ z is up, as in the scene. glTF prescribes y up (specification 2.0, section 3.4): there x is east, y
    up and z south. Every format is a single file.

    Raises InputError if the file's extension is another.
    """
    if path.suffix.lower() not in _EXPORTS:
        raise InputError(
            "scene.format_unknown",
            f"cannot export to '{path.suffix}'",
            where=str(path),
            expected=" or ".join(_EXPORTS),
            remedy="name the file by the format that you want",
        )
    meshes = _meshes(scene)
    kind = path.suffix.lower()[1:]
    with new_file(path) as hidden:
        if kind in ("glb", "gltf"):
            parts = trimesh.Scene()
            for name, mesh in meshes:
                parts.add_geometry(mesh, node_name=name, geom_name=name, transform=_Y_UP)
            parts.export(hidden, kind, **({"embed_buffers": True} if kind == "gltf" else {}))
        else:
            trimesh.util.concatenate([mesh for _, mesh in meshes]).export(hidden, kind)


def _meshes(scene: Scene) -> list[tuple[str, trimesh.Trimesh]]:
    surfaces = [
        ("rock", scene.rock.vertices_m, scene.rock.faces, ROCK_COLOUR),
        ("pedestal", *scene.pedestal_triangles(), PEDESTAL_COLOUR),
    ]
    meshes = []
    for name, vertices, faces, colour in surfaces:
        rgb = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
        meshes.append((name, trimesh.Trimesh(vertices, faces, face_colors=rgb, process=False)))
    return meshes
