"""A rock's way as a page that plays and turns with the mouse, and as a moving picture."""

import json
from html import escape
from pathlib import Path

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from toppling.results.drawing.page import scene_figure
from toppling.results.drawing.scene import PEDESTAL_COLOUR, ROCK_COLOUR, far_to_near
from toppling.results.replay import Way, tilt_deg

Array = NDArray[np.float64]

PAGE_HZ, PAGE_POSES = 25.0, 1500
"""Poses a second that a page holds, and how many at most."""

GIF_HZ, GIF_FRAMES = 12.5, 75
"""Frames a second of a moving picture, and how many at most: a longer way is played faster."""

GIF_PIXELS, OVERSAMPLING = 360, 2
"""Width of a moving picture, and how much finer it is drawn, so that its edges are smooth."""

ELEVATION_DEG = 15.0
EYE = 1.6
"""Distance of the page's eye at the start, in plotly's unit, the size of the scene."""

_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title><style>
body {{ font: 15px/1.4 system-ui, sans-serif; margin: 1em auto; max-width: 70em; padding: 0 1em; color: #222; }}
#view {{ height: 78vh; }} #time {{ width: 60%; vertical-align: middle; }} button, select {{ font: inherit; }}
</style></head><body>
<h1 style="font-size: 1.1em">{title}</h1>
<p><button id="play">play</button> <input id="time" type="range" min="0" max="{last}" value="0"
aria-label="time"> <select id="speed" aria-label="speed"><option value="0.25">¼ speed</option>
<option value="1" selected>real time</option><option value="4">4 times</option></select> <output id="told"></output></p>
{view}
<p>Drag to turn, scroll to come nearer. Seen from the pedestal, which moves with the ground.</p>
<script>
const way = {way};
const view = document.getElementById("view"), slider = document.getElementById("time");
const told = document.getElementById("told"), button = document.getElementById("play");
const speed = document.getElementById("speed");
const arms = way.arms;
let playing = false, since = 0, from = 0, wanted = null, busy = true;
async function show(frame) {{
  wanted = frame;
  if (busy) return;
  busy = true;
  while (wanted !== null) {{ const next = wanted; wanted = null; await place(next); }}
  busy = false;
}}
function place(frame) {{
  const [px, py, pz, x, y, z, w] = way.poses[frame];
  const turn = [
    [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
    [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
    [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]];
  const at = [px, py, pz].map((p, k) => {{
    const t = turn[k], out = new Array(arms[0].length);
    for (let i = 0; i < out.length; i++)
      out[i] = p + t[0] * arms[0][i] + t[1] * arms[1][i] + t[2] * arms[2][i];
    return out;
  }});
  slider.value = frame;
  told.value = (way.start + frame * way.step).toFixed(2) + " s, tilt " + way.tilt[frame].toFixed(2) + "°";
  view.dataset.frame = frame;
  return Plotly.restyle(view, {{x: [at[0]], y: [at[1]], z: [at[2]]}}, [0]);
}}
function tick(now) {{
  if (!playing) return;
  const frame = from + Math.floor((now - since) / 1000 * speed.value / way.step);
  if (frame >= way.poses.length) {{ show(way.poses.length - 1); stop(); return; }}
  show(frame).then(() => requestAnimationFrame(tick));
}}
function stop() {{ playing = false; button.textContent = "play"; }}
function go() {{
  from = +slider.value >= way.poses.length - 1 ? 0 : +slider.value;
  since = performance.now(); playing = true; button.textContent = "pause"; requestAnimationFrame(tick);
}}
button.onclick = () => playing ? stop() : go();
speed.onchange = () => {{ if (playing) go(); }};
slider.oninput = () => {{ stop(); show(+slider.value); }};
// The library must have drawn once before it takes new places.
addEventListener("load", () => setTimeout(() => {{ busy = false; show(wanted ?? 0); }}, 500));
</script></body></html>
"""


def page(way: Way, title: str) -> str:
    """Write a page that plays the way and turns with the mouse, and needs no network.

    Parameters
    ----------
    way : Way
    title : str

    Returns
    -------
    str
        HTML, the drawing library inside.
    """
    times = _times(way, PAGE_HZ, PAGE_POSES)
    position, turn = way.at(times)
    figure = scene_figure(way.scene)
    figure.update_layout(
        title=None, margin={"l": 0, "r": 0, "t": 0, "b": 0}, uirevision="the same", showlegend=False
    )
    # Room for the rock wherever it goes, so that the axes stand still while it plays.
    reach = float(np.linalg.norm(way.scene.rock.vertices_m - way.scene.rock.com_m, axis=1).max())
    drawn = np.vstack([np.column_stack([t.x, t.y, t.z]) for t in figure.data])
    low = np.minimum(drawn.min(axis=0), np.append(position.min(axis=0)[:2] - reach, drawn[:, 2].min()))
    high = np.maximum(drawn.max(axis=0), position.max(axis=0) + reach)
    figure.update_scenes(
        {f"{axis}axis_range": [a, b] for axis, a, b in zip("xyz", low, high, strict=True)}
        | {f"camera_eye_{axis}": EYE * part for axis, part in zip("xyz", _eye(way), strict=True)}
    )
    poses = np.column_stack([position, turn])
    told = {
        "arms": np.round(way.scene.rock.vertices_m - way.scene.rock.com_m, 5).T.tolist(),
        "start": float(times[0]),
        "step": float(times[1] - times[0]),
        "tilt": np.round(
            tilt_deg(np.vstack([way.quaternion_xyzw[:1], turn]), way.scene.pedestal.normal)[1:], 3
        ).tolist(),
        "poses": np.round(poses, 6).tolist(),
    }
    view = figure.to_html(full_html=False, include_plotlyjs=True, div_id="view", default_height="78vh")
    return _PAGE.format(title=escape(title), view=view, way=json.dumps(told), last=len(times) - 1)


def moving_picture(way: Way, path: Path) -> None:
    """Write a GIF of the part of the way in which something is to be seen, across the plane of the fall."""
    times = _times(way, GIF_HZ, GIF_FRAMES)
    position, turn = way.at(times)
    tilts = tilt_deg(np.vstack([way.quaternion_xyzw[:1], turn]), way.scene.pedestal.normal)[1:]
    toward = _eye(way)
    right = np.array([-toward[1], toward[0], 0.0]) / np.hypot(toward[0], toward[1])
    frame = np.column_stack([right, np.cross(toward, right), toward])
    rock = way.scene.rock
    reach = np.linalg.norm(rock.vertices_m - rock.com_m, axis=1).max()
    centres = (position - rock.com_m) @ frame[:, :2]
    low, high = centres.min(axis=0) - reach, centres.max(axis=0) + reach
    window = (low + high) / 2, 0.5 * float((high - low).max())
    frames = []
    for time, place, attitude, tilt in zip(times, position, turn, tilts, strict=True):
        text = f"{time:.2f} s, tilt {tilt:.1f}°"
        frames.append(_picture(way, way.placed(place, attitude), frame, window, text))
    # The last pose is held for a second.
    milliseconds = [round(1000 / GIF_HZ)] * (len(frames) - 1) + [1000]
    frames[0].save(path, format="GIF", save_all=True, append_images=frames[1:], duration=milliseconds, loop=0)


def _times(way: Way, rate_hz: float, most: int) -> Array:
    first, last = way.shown_s()
    return np.linspace(first, max(last, first + 1e-3), int(np.clip((last - first) * rate_hz, 2, most)))


def _eye(way: Way) -> Array:
    """Direction from which to look: across the way of the fall, from a little above."""
    off = way.position_m - way.position_m[0]
    farthest = off[np.argmax(np.hypot(off[:, 0], off[:, 1]))]
    azimuth = np.arctan2(farthest[1], farthest[0]) - np.pi / 2
    lift = np.deg2rad(ELEVATION_DEG)
    return np.array([np.cos(lift) * np.cos(azimuth), np.cos(lift) * np.sin(azimuth), np.sin(lift)])


def _picture(
    way: Way, vertices_m: Array, frame: Array, window: tuple[Array, float], text: str
) -> Image.Image:
    """Triangles painted from far to near (orthographic), lit from behind the eye."""
    rock = way.scene.rock
    surfaces = [
        (vertices_m, rock.faces, ROCK_COLOUR),
        (*way.scene.pedestal_triangles(), PEDESTAL_COLOUR),
    ]
    corners, colours = [], []
    for vertices, faces, colour in surfaces:
        seen = ((vertices - rock.com_m) @ frame)[faces]
        normal = np.cross(seen[:, 1] - seen[:, 0], seen[:, 2] - seen[:, 0])
        facing = normal[:, 2] / np.maximum(np.linalg.norm(normal, axis=1), 1e-12)
        corners.append(seen[facing > 0])
        colours.append(np.outer(0.35 + 0.65 * facing[facing > 0], to_rgb(colour)))
    triangles, shades = np.vstack(corners), np.vstack(colours)
    (x, y), half = window
    order = far_to_near(triangles, len(corners[0]), way.scene.pedestal)
    size = OVERSAMPLING * GIF_PIXELS
    places = 0.5 * size * (1.0 + (triangles[order, :, :2] - (x, y)) / half * (1.0, -1.0))
    image = Image.new("RGB", (size, size), "white")
    draw = ImageDraw.Draw(image)
    for corner, shade in zip(
        places.reshape(-1, 6).tolist(), (255 * shades[order]).astype(int).tolist(), strict=True
    ):
        draw.polygon(corner, fill=tuple(shade))
    small = image.resize((GIF_PIXELS, GIF_PIXELS), Image.Resampling.BOX)
    ImageDraw.Draw(small).text((6, 6), text, fill="black", font=ImageFont.load_default(14))
    return small
