"""Interactive pages of a scene and of a shake, which need no network."""

import base64
import json
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from typing import Any

import numpy as np
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes

from toppling.models.arrays import Array
from toppling.models.scene import Scene
from toppling.results.drawing.painted_mesh import Surface, smooth_surface, view_frame
from toppling.results.drawing.scene_figures import draw_statics, interface_lines, numbers_of, statics_words
from toppling.results.drawing.style import (
    ALARM_COLOUR,
    COLOURS,
    PEDESTAL_COLOUR,
    ROCK_COLOUR,
    style,
    svg_text,
)
from toppling.results.replayed_job import STILL_FRACTION, Replay

_PAGE_HZ, _PAGE_POSES = 25.0, 1500
"""Rate of the poses in a page, Hz, and their maximum number."""

_TRACE_SAMPLES = 3000
"""Maximum number of samples of each component of ground motion in a page: the resolution of a screen."""

ELEVATION_DEG = 14.0
"""Elevation of the view, degrees, from which both the tilt of a rock and its base are visible."""

_FARTHEST_FRAMED = 0.9
"""Maximum displacement, in rock radii, that the initial view includes; the user can follow the rock beyond it."""

_AT_REST_DEG = -60.0
"""Azimuth of the view for a rock that does not fall, degrees: two sides of a block are visible."""

ARROW_COLOUR = "#7a1fa2"

_COMPASS = (
    '<svg id="compass" viewBox="0 0 48 48" aria-label="compass"><circle cx="24" cy="24" r="22" fill="#ffffffb0"/>'
    '<g id="needle"><path d="M24 17 L31 42 L24 37 L17 42 Z" fill="#222"/>'
    '<text x="24" y="15" text-anchor="middle" font-size="13" font-weight="bold">N</text></g></svg>'
)


def scene_page(scene: Scene, name: str, notes: Sequence[str] = ()) -> str:
    """HTML of a scene: rock, pedestal, contact outline, cliff edges and statics, with numbers and notes."""
    low, high = scene.rock.vertices_m.min(axis=0), scene.rock.vertices_m.max(axis=0)
    stage = _stage(scene, 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low)), 35.0)
    lines = "\n".join(numbers_of(scene, notes)).replace("\n  ", " ").split("\n")  # joins indented lines
    items = "".join(f"<li>{escape(line)}</li>" for line in lines)
    with style():
        figure = Figure(figsize=(3.4, 3.6), layout="constrained")
        axes = figure.add_subplot(projection="polar")
        assert isinstance(axes, PolarAxes)
        draw_statics(axes, scene)
    body = (
        f'<h1>{escape(name)}</h1><div id="view">{_COMPASS}</div>{_HINT}{_LINES if interface_lines(scene) else ""}'
        f'<div class="beside"><div>{svg_text(figure)}<p class="hint">Round: {escape(statics_words(scene))}.</p></div>'
        f"<ul>{items}</ul></div>"
    )
    return _page(f"{name}: scene", body, stage, "scene")


def replay_page(replay: Replay, title: str) -> str:
    """HTML page that plays a shake: rock, seismogram with a moving cursor, ground acceleration, point of no return.

    title: heading with the rock's name, the shaking and the outcome.
    """
    times = shown_times(replay, _PAGE_HZ, _PAGE_POSES)
    position, turn = replay.at(times)
    target, radius = _framed(replay, position)
    stage = _stage(replay.scene, target, radius, azimuth_across(replay))
    stage["replay"] = _motion_of(replay, times, position, turn)
    at_return = (
        f' <span style="background:{ALARM_COLOUR}"></span>point of no return'
        if replay.topple_time_s is not None
        else ""
    )
    body = f"""<h1>{escape(title)}</h1>
<div id="view">{_COMPASS}<p id="legend"><span style="background:{ARROW_COLOUR}"></span>ground's acceleration<br>
<span style="background:#555"></span>path of the centre of mass{"<br>" if at_return else ""}{at_return}</p></div>
<input id="time" type="range" min="0" max="{len(times) - 1}" value="0" aria-label="time">
<div class="controls"><button id="play">play</button><select id="speed" aria-label="speed">
<option value="0.25">¼ speed</option><option value="1" selected>real time</option><option value="4">4 times</option>
</select><output id="told"></output></div>
<div id="traces" aria-label="ground acceleration (m/s²) and tilt against time"><canvas></canvas><div id="cursor"></div>
</div><p class="hint">Ground acceleration toward east, north and up (m/s²), and the rock's tilt. Touch the traces to go
to a time; space plays.</p>
{_HINT}<p class="hint">Seen from the pedestal, which moves with the ground.</p>"""
    return _page(title, body, stage, "replay")


_LINES = (
    '<p class="hint">Blue: contact outline; black: cliff edge; dashed where rock or pedestal hides them.</p>'
)

_HINT = (
    '<p class="hint">Drag to turn, scroll or pinch to come nearer, double-click to frame the rock again.</p>'
)


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
    lines = [{"points": _rounded(line), "colour": colour} for line, _, colour in interface_lines(scene)]
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
        times[0], times[-1], int(np.clip((times[-1] - times[0]) * 200.0, 2, _TRACE_SAMPLES))
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


def _page(title: str, body: str, described: Mapping[str, Any], kind: str) -> str:
    room = files("toppling.results.drawing")
    look, script = (room.joinpath(name).read_text(encoding="utf-8") for name in ("viewer.css", "viewer.js"))
    library = room.joinpath("vendor/three.min.js").read_text(encoding="utf-8")
    content = json.dumps(described).replace("</", "<\\/")
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><meta name="viewport" '
        f'content="width=device-width, initial-scale=1"><title>{escape(title)}</title><style>{look}</style></head>\n'
        f'<body class="{kind}">\n{body}\n<script type="application/json" id="data">{content}</script>\n'
        f"<script>{library}</script>\n<script>{script}</script></body></html>\n"
    )
