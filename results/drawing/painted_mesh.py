"""Rendering of meshes: smooth shading up to sharp edges, painter's algorithm, and occlusion of points."""

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
"""Angle between faces above which their edge is drawn sharp, degrees: blocks have edges, boulders are smooth."""

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
    """Surface of a mesh whose edges are sharp where faces meet at more than `_CREASE_DEG`."""
    mesh = trimesh.Trimesh(vertices_m, faces, process=False)
    smooth = trimesh.graph.smooth_shade(mesh, angle=np.deg2rad(_CREASE_DEG))
    return Surface(
        np.asarray(smooth.vertices, float),
        np.asarray(smooth.vertex_normals, float),
        np.asarray(smooth.faces),
        colour,
    )


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
    order = order[(faces_eye(corner) | ~of_rock)[order]]
    return corner[order], colour[order], of_rock[order]


def _shades(surface: Surface, light: Array) -> Array:
    """Colour of each face (k, 3), between 0 and 1, under directional light with visible shape in the shadow."""
    normal = surface.normals[surface.faces].mean(axis=1)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    # Half Lambert: light wraps around, so that the dark side of a boulder is not flat.
    lit = _AMBIENT + (1.0 - _AMBIENT) * (0.5 + 0.5 * (normal @ (light / np.linalg.norm(light)))) ** 1.5
    return lit[:, None] * np.array(to_rgb(surface.colour))


def faces_eye(corners: Array) -> NDArray[np.bool_]:
    """Mask of the triangles (n, 3, 3), third axis toward the eye, whose outer side faces the eye."""
    return np.asarray(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0.0)


def hidden(points: Array, corners: Array, tolerance_m: float) -> NDArray[np.bool_]:
    """Mask of the points (k, 3) behind a triangle (n, 3, 3), third axis toward the eye, by more than a tolerance."""
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
