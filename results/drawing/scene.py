"""The scene's picture: rock, interface and pedestal in colours, so that a wrong split is seen at once."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from toppling.models.frames import compass_deg
from toppling.models.pedestal import Pedestal
from toppling.models.scene import Scene

ROCK_COLOUR, PEDESTAL_COLOUR, INTERFACE_COLOUR = "#c0703a", "#7d8b99", "#d11f3f"
VIEWS_DEG = ((20.0, 0.0), (20.0, 120.0), (20.0, 240.0))
"""Elevation and azimuth of the eye."""
VIEW_REACH = 0.7
"""From the centre of mass to the edge of a view, as share of the rock's largest side."""
STATICS_TITLE = "quasi-static toppling acceleration, m/s², by azimuth of the ground's acceleration"
BAND_TITLE = "band: one standard deviation"
NOTE_WIDTH = 66
"""Letters in a line beside the views."""


def draw_scene(scene: Scene, path: Path, notes: Sequence[str] = ()) -> None:
    """Write a PNG: three views, the plan of the interface, the statics by azimuth, and numbers with notes below."""
    figure = Figure(figsize=(15, 9), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 3)
    for place, (elevation, azimuth) in enumerate(VIEWS_DEG):
        draw_view(figure.add_subplot(grid[0, place]), scene, elevation, azimuth)
    _draw_plan(figure.add_subplot(grid[1, 0]), scene)
    _draw_statics(figure.add_subplot(grid[1, 1], projection="polar"), scene)
    _write_numbers(figure.add_subplot(grid[1, 2]), scene, notes)
    figure.savefig(path, dpi=110)


def draw_view(axes: Axes, scene: Scene, elevation_deg: float, azimuth_deg: float) -> None:
    """Triangles painted from far to near (orthographic)."""
    turn, lift = np.deg2rad(azimuth_deg), np.deg2rad(elevation_deg)
    toward = np.array([np.cos(lift) * np.cos(turn), np.cos(lift) * np.sin(turn), np.sin(lift)])
    right = np.array([-np.sin(turn), np.cos(turn), 0.0])
    frame = np.column_stack([right, np.cross(toward, right), toward])
    corners, colours = [], []
    surfaces = [(scene.rock.vertices_m, scene.rock.faces, ROCK_COLOUR)]
    # From below, as from behind a slope steeper than the eye is high, an endless plane would hide the rock.
    if not scene.pedestal.is_plane or toward @ scene.pedestal.normal > 0:
        surfaces.append((*scene.pedestal_triangles(), PEDESTAL_COLOUR))
    light = np.array([0.4, 0.3, 0.87])
    for vertices, faces, colour in surfaces:
        corner = vertices[faces]
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
        shade = 0.55 + 0.45 * np.clip(np.abs(normal @ light), 0.0, 1.0)
        corners.append(corner @ frame)
        rgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
        colours.append(shade[:, None] * rgb)
    corner, painted = np.concatenate(corners), np.concatenate(colours)
    order = far_to_near(corner, len(scene.rock.faces), scene.pedestal)
    axes.add_collection(
        PolyCollection(
            list(corner[order][:, :, :2]), facecolors=painted[order], edgecolors="face", linewidths=0.2
        )
    )
    for line, style in _lines(scene):
        flat = line @ frame
        axes.plot(flat[:, 0], flat[:, 1], style, color=INTERFACE_COLOUR, linewidth=1.5)
    # The same scale in all views, about the rock: a wide pedestal would make it small.
    middle, reach = scene.rock.com_m @ frame, VIEW_REACH * float(np.ptp(scene.rock.vertices_m, axis=0).max())
    axes.set(
        aspect="equal",
        xlim=(middle[0] - reach, middle[0] + reach),
        ylim=(middle[1] - reach, middle[1] + reach),
        title=f"seen from azimuth {azimuth_deg:.0f}° ({float(compass_deg(azimuth_deg)):.0f}° compass)",
    )
    axes.set_xlabel("m")


def far_to_near(corners: NDArray[np.float64], of_rock: int, pedestal: Pedestal) -> NDArray[np.intp]:
    """Order in which triangles (n, 3, 3), third axis toward the eye, are painted: those of the rock come first."""
    depth = corners[:, :, 2].mean(axis=1)
    if pedestal.is_plane:  # its triangles are too large to have one depth, and the rock is on them
        depth[of_rock:] = -np.inf
    return np.argsort(depth)


def _lines(scene: Scene) -> list[tuple[NDArray[np.float64], str]]:
    interface = scene.report.get("interface", {})
    outline = np.array(interface.get("outline_m", np.empty((0, 3))))
    lines = [(np.vstack([outline, outline[:1]]), "-")] if len(outline) else []
    return lines + [(np.array(edge), "--") for edge in interface.get("edges_m", [])]


def _draw_plan(axes: Axes, scene: Scene) -> None:
    hull = scene.rock.vertices_m
    axes.plot(hull[:, 0], hull[:, 1], ",", color=ROCK_COLOUR, alpha=0.4)
    for line, style in _lines(scene):
        axes.plot(line[:, 0], line[:, 1], style, color=INTERFACE_COLOUR)
    axes.plot(*scene.rock.com_m[:2], "k+", markersize=12)
    axes.set(
        aspect="equal",
        xlabel="east, m",
        ylabel="north, m",
        title="contact outline, cliff edge (dashed), centre of mass",
    )


def _draw_statics(axes: Axes, scene: Scene) -> None:
    azimuth_deg, value, spread = toppling_band(scene)
    azimuth = np.deg2rad(azimuth_deg)
    axes.fill_between(azimuth, value - spread, value + spread, color=ROCK_COLOUR, alpha=0.3, linewidth=0)
    axes.plot(azimuth, value, color=ROCK_COLOUR)
    axes.set_ylim(0, polar_reach_m_s2(value))
    told = [STATICS_TITLE, *([BAND_TITLE] if spread.any() else []), *beyond_frame(value)]
    axes.set_title("\n".join(told), fontsize=10)


def polar_reach_m_s2(value: NDArray[np.float64]) -> float:
    """Radius of the statics' plot: where a few azimuths need much more than the rest, they leave it."""
    finite = value[np.isfinite(value)]
    return float(min(2.0 * np.median(finite), finite.max()) * 1.05) if len(finite) else 1.0


def beyond_frame(value: NDArray[np.float64]) -> list[str]:
    """Say what the azimuths need whose curve leaves the frame, if there are any."""
    reach = polar_reach_m_s2(value)
    return [f"beyond the frame: more than {reach:.3g} m/s²"] if (value > reach).any() else []


def toppling_band(scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Azimuth of the ground's acceleration (a closed round), what topples (m/s2), and its standard deviation.

    The latter comes from the scan's report, which has it every ten degrees; 0 without one.
    """
    table = scene.to_json()["quasi_static_toppling_m_s2"]
    rows = [*table, {**table[0], "azimuth_deg": 360.0}]
    azimuth = np.array([row["azimuth_deg"] for row in rows], float)
    value = np.array([row["value"] for row in rows], float)
    known = scene.report.get("uncertainty", {}).get("quasi_static_toppling_m_s2", [])
    if not known:
        return azimuth, value, np.zeros(len(azimuth))
    at = np.array([row["azimuth_deg"] for row in known], float)
    std = np.array([row["std"] for row in known], float)
    return azimuth, value, np.interp(azimuth, at, std, period=360.0)


def numbers_of(scene: Scene, notes: Sequence[str] = ()) -> list[str]:
    """What a person wants to read beside the views: sizes with their spread, the interface, how sure the split is.

    Notes follow, broken into lines of the same length.
    """
    rock, report = scene.rock, scene.report
    spread, registration = report.get("uncertainty", {}), report.get("registration", {})
    downhill = scene.pedestal.downhill_azimuth_deg
    volume, com = spread.get("volume_std_m3"), spread.get("com_std_m")
    tilt = spread.get("interface_normal_std_deg")
    lines = [
        f"volume {rock.volume_m3:.5g}{'' if volume is None else f' ± {volume:.2g}'} m³, "
        f"height {rock.height_m:.4g} m",
        "centre of mass {:.3f}, {:.3f}, {:.3f}".format(*rock.com_m)
        + (" m" if com is None else " ± {:.2g}, {:.2g}, {:.2g} m".format(*com)),
        f"interface falls {scene.pedestal.slope_deg:.2f}°{'' if tilt is None else f' ± {tilt:.2f}°'} toward azimuth "
        f"{downhill:.1f}° ({float(compass_deg(downhill)):.0f}° compass)",
        *_surface_of(report),
        "origin {:.1f}, {:.1f}, {:.1f} m".format(*scene.origin_m),
        *_split_of(report),
    ]
    if "residual_m" in registration:
        lines.append(_fit_of(registration))
    return lines + [line for note in notes for line in wrap(note, NOTE_WIDTH)]


def _surface_of(report: Mapping[str, Any]) -> list[str]:
    """How rough the interface is and how much of the surface was seen, where a scan has measured them."""
    interface, surface = report.get("interface", {}), report.get("surface", {})
    lines = []
    if "roughness_m" in interface and interface.get("given_by") != "plane":  # a plane fits itself
        lines.append(f"roughness {interface['roughness_m']:.3g} m")
    if surface:
        lines.append(
            f"surface seen {surface['seen_share']:.1%}, closed at the interface {surface['closed_share']:.1%}, "
            f"invented {surface['invented_share']:.1%}"
        )
    return lines


def _split_of(report: Mapping[str, Any]) -> list[str]:
    """How sure the split of rock and pedestal is; other candidates are sought only where the interface is fitted."""
    sure = report.get("segmentation", {}).get("confidence")
    if not sure:
        return []
    fitted = report.get("interface", {}).get("given_by", "fit") == "fit"
    return [
        f"split: {sure['concave_share_of_cut']:.0%} of the cut lies in creases,",
        f"  crevice seen in {sure['crevice_seen_share']:.0%} of the directions,",
        f"  {sure['undisputed_share']:.1%} of the points beside it undisputed,",
        f"  highest other candidate {sure['runner_up']:.0%} of the rock's height"
        if fitted
        else "  no other candidate looked for, as the interface is given",
    ]


def _fit_of(registration: Mapping[str, Any]) -> str:
    """How well the stations fit each other, if they show common places."""
    stations, residual = registration["stations"], registration["residual_m"]
    if residual is None:
        return f"{stations} stations show no common places: how well they fit each other cannot be told"
    each = [fit["residual_m"] for fit in registration.get("of_stations", [])]
    alone = [one for one in each if one is not None]
    compared = f"{len(alone)} of {stations}" if alone and len(alone) < stations else f"{stations}"
    return f"{compared} stations fit each other within {1e3 * residual:.2g} mm" + (
        f", the worst within {1e3 * max(alone):.2g} mm" if alone else ""
    )


def _write_numbers(axes: Axes, scene: Scene, notes: Sequence[str]) -> None:
    axes.axis("off")
    lines = [*numbers_of(scene, notes), "red: contact outline; dashed: cliff edge"]
    axes.text(0.0, 1.0, "\n".join(lines), va="top", fontsize=10, linespacing=1.7)
