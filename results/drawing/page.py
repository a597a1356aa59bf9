"""Interactive pages of a scene and of a shake, which need no network."""

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np
from markupsafe import Markup
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
from toppling.results.drawing.templates import rendered
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


def scene_page(scene: Scene, name: str, notes: Sequence[str] = ()) -> str:
    """HTML of a scene: rock, pedestal, contact outline, cliff edges and statics, with numbers and notes."""
    low, high = scene.rock.vertices_m.min(axis=0), scene.rock.vertices_m.max(axis=0)
    stage = _stage(scene, 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low)), 35.0)
    lines = "\n".join(numbers_of(scene, notes)).replace("\n  ", " ").split("\n")  # joins indented lines
    with style():
        figure = Figure(figsize=(3.4, 3.6), layout="constrained")
        axes = figure.add_subplot(projection="polar")
        assert isinstance(axes, PolarAxes)
        draw_statics(axes, scene)
    return rendered(
        "scene.html", kind="scene", title=f"{name}: scene", heading=name, stage=stage, lines=lines,
        svg=Markup(svg_text(figure)), statics=statics_words(scene),
    )  # fmt: skip


def replay_page(replay: Replay, title: str) -> str:
    """HTML page that plays a shake: rock, seismogram with a moving cursor, ground acceleration, point of no return.

    title: heading with the rock's name, the shaking and the outcome.
    """
    times = shown_times(replay, _PAGE_HZ, _PAGE_POSES)
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
