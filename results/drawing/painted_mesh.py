"""Surfaces for pictures: shaded smoothly up to their edges, painted from far to near, and what they hide."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from toppling.models.arrays import Array
from toppling.models.pedestal import Pedestal
from toppling.models.scene import Scene
from toppling.results.drawing.style import PEDESTAL_COLOUR, ROCK_COLOUR

_CREASE_DEG = 35.0
"""Between faces at a larger angle an edge stays sharp: a block looks like one, a boulder is smooth."""

_AMBIENT = 0.45
"""Share of light that comes from everywhere."""
_LIGHT = np.array([-0.4, 0.55, 0.75])
"""Where the rest comes from: the upper left of every view, as a reader expects."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles with a normal at each vertex; vertices on a sharp edge occur once a side."""

    # (n, 3).
    vertices_m: Array
    normals: Array
    faces: NDArray[np.int64]  # (k, 3)
    colour: str


def smooth_surface(vertices_m: Array, faces: NDArray[np.int64], colour: str) -> Surface:
    """A mesh whose edges are sharp where its faces meet at more than `_CREASE_DEG`."""
    mesh = trimesh.Trimesh(vertices_m, faces, process=False)
    smooth = trimesh.graph.smooth_shade(mesh, angle=np.deg2rad(_CREASE_DEG))
    return Surface(
        np.asarray(smooth.vertices, float),
        np.asarray(smooth.vertex_normals, float),
        np.asarray(smooth.faces),
        colour,
    )


def surfaces_of(scene: Scene) -> tuple[Surface, Surface]:
    """Rock and pedestal of a scene."""
    return (
        smooth_surface(scene.rock.vertices_m, scene.rock.faces, ROCK_COLOUR),
        smooth_surface(*scene.pedestal_triangles(), PEDESTAL_COLOUR),
    )


def view_frame(elevation_deg: float, azimuth_deg: float) -> Array:
    """Axes (3, 3, as columns) of a view: to the right, up, toward the eye, which stands at an elevation and azimuth."""
    turn, lift = np.deg2rad(azimuth_deg), np.deg2rad(elevation_deg)
    toward = np.array([np.cos(lift) * np.cos(turn), np.cos(lift) * np.sin(turn), np.sin(lift)])
    right = np.array([-np.sin(turn), np.cos(turn), 0.0])
    return np.column_stack([right, np.cross(toward, right), toward])


def painted(
    surfaces: Sequence[Surface], frame: Array, pedestal: Pedestal
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Triangles of a rock, and perhaps of its pedestal, as they are painted in a view: from far to near.

    surfaces: the rock's first; of the pedestal's, which is open, one may see the inside.
    frame: from `view_frame`.

    Returns (n, 3, 3) array: their corners along the axes of the view.
    Returns (n, 3) array: their colours, between 0 and 1.
    Returns (n,) array: whether they are the rock's.
    """
    corner = np.concatenate([surface.vertices_m[surface.faces] @ frame for surface in surfaces])
    colour = np.concatenate([_shades(surface, frame @ _LIGHT) for surface in surfaces])
    of_rock = np.arange(len(corner)) < len(surfaces[0].faces)
    depth = corner[:, :, 2].mean(axis=1)
    if pedestal.is_plane:  # its triangles are too large to have one depth, and the rock is on them
        depth[~of_rock] = -np.inf
    order = np.argsort(depth)
    order = order[(faces_eye(corner) | ~of_rock)[order]]
    return corner[order], colour[order], of_rock[order]


def _shades(surface: Surface, light: Array) -> Array:
    """Colour of each face (k, 3), between 0 and 1, lit from a direction; the side in shadow keeps its shape."""
    normal = surface.normals[surface.faces].mean(axis=1)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    # Half Lambert: light wraps around, so that no side of a boulder is one flat dark.
    lit = _AMBIENT + (1.0 - _AMBIENT) * (0.5 + 0.5 * (normal @ (light / np.linalg.norm(light)))) ** 1.5
    return lit[:, None] * np.array(to_rgb(surface.colour))


def faces_eye(corners: Array) -> NDArray[np.bool_]:
    """Which triangles (n, 3, 3), third axis toward the eye, show it their outer side."""
    return np.asarray(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0.0)


def hidden(points: Array, corners: Array, tolerance_m: float) -> NDArray[np.bool_]:
    """Which points (k, 3) lie behind a triangle (n, 3, 3), third axis toward the eye.

    A point that is less than the tolerance behind lies on the surface, and is seen.
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    facing = np.abs(area) > 1e-14
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
