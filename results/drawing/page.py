"""A scene as one page that turns with the mouse, and as files for other programs."""

from collections.abc import Sequence
from html import escape
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from toppling.models.frames import compass_deg
from toppling.models.scene import Scene
from toppling.results.drawing.export import _meshes
from toppling.results.drawing.scene import (
    BAND_TITLE,
    INTERFACE_COLOUR,
    ROCK_COLOUR,
    beyond_frame,
    numbers_of,
    polar_reach_m_s2,
    toppling_band,
)


def write_page(scene: Scene, path: Path, notes: Sequence[str] = ()) -> None:
    """Write a standalone HTML page: rock, pedestal, contact outline and cliff edges, statics, numbers and notes."""
    figure = scene_figure(scene)
    azimuth, value, spread = toppling_band(scene)
    _add_statics(figure, azimuth, value, spread)
    figure.update_layout(
        height=860,
        scene_domain={"x": [0.0, 0.64], "y": [0.0, 1.0]},
        legend={"x": 0.0, "y": 1.0},
        polar={
            "domain": {"x": [0.70, 0.98], "y": [0.51, 0.89]},
            "radialaxis": {"range": [0.0, polar_reach_m_s2(value)]},
        },
    )
    by = [
        "Quasi-static toppling acceleration, m/s², by azimuth",
        "of the ground's acceleration (from east to north)",
    ]
    title = "<br>".join([*by, *beyond_frame(value)])
    for text, y in ((title, 1.0), ("<br>".join(map(escape, numbers_of(scene, notes))), 0.42)):
        figure.add_annotation(
            text=text,
            x=0.66,
            y=y,
            xref="paper",
            yref="paper",
            xanchor="left",
            yanchor="top",
            align="left",
            showarrow=False,
        )
    figure.write_html(path, include_plotlyjs=True)


def _add_statics(
    figure: go.Figure, azimuth: NDArray[np.float64], value: NDArray[np.float64], spread: NDArray[np.float64]
) -> None:
    """Least acceleration that topples, round the compass, with the band of one standard deviation."""
    known = np.isfinite(value) & np.isfinite(spread)
    if spread.any():
        around = np.concatenate([azimuth[known], azimuth[known][::-1]])
        edge = np.concatenate([(value + spread)[known], (value - spread)[known][::-1]])
        figure.add_scatterpolar(
            theta=around,
            r=edge,
            mode="lines",
            fill="toself",
            line={"width": 0},
            fillcolor=ROCK_COLOUR,
            opacity=0.35,
            name=BAND_TITLE,
            hoverinfo="skip",
        )
    figure.add_scatterpolar(
        theta=azimuth, r=value, mode="lines", line={"color": ROCK_COLOUR, "width": 2}, name="topples, m/s²"
    )


def scene_figure(scene: Scene) -> go.Figure:
    """Draw rock (the first trace), pedestal, contact outline and cliff edges, to be turned with the mouse."""
    figure = go.Figure()
    for name, mesh, colour in _meshes(scene):
        x, y, z = mesh.vertices.T
        i, j, k = mesh.faces.T
        figure.add_mesh3d(x=x, y=y, z=z, i=i, j=j, k=k, color=colour, name=name, flatshading=True)
    interface = scene.report.get("interface", {})
    outline = interface.get("outline_m", [])
    for name, points in [
        ("contact", [*outline, *outline[:1]]),
        *(("edge", e) for e in interface.get("edges_m", [])),
    ]:
        if len(points):
            x, y, z = np.array(points).T
            figure.add_scatter3d(
                x=x, y=y, z=z, mode="lines", name=name, line={"color": INTERFACE_COLOUR, "width": 6}
            )
    slope, downhill = scene.pedestal.slope_deg, scene.pedestal.downhill_azimuth_deg
    figure.update_layout(
        title=f"{scene.id}: {scene.rock.volume_m3:.4g} m³, {scene.rock.height_m:.3g} m high; interface falls "
        f"{slope:.1f}° toward azimuth {downhill:.0f}° ({float(compass_deg(downhill)):.0f}° compass)",
        scene={
            "aspectmode": "data",
            "xaxis_title": "east, m",
            "yaxis_title": "north, m",
            "zaxis_title": "up, m",
        },
    )
    return figure
