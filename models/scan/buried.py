"""Surfaces of meshes that nobody can have seen: the ground below a rock, and the base that rests on it."""

from collections.abc import Sequence

import numpy as np
import open3d as o3d
from numpy.typing import NDArray

from toppling.models.arrays import Array

Mesh = tuple[Array, NDArray[np.int64]]
_LIFT = 2e-5
"""Of the model's extent: how far above its surface a point looks about. Surfaces nearer to each other touch."""
_ROOM = 0.02
"""Of the model's extent: so much room before the next surface, and a camera may have been there."""
_DIRECTIONS = 48
_GRAZING = 0.05
_LOWEST = 0.08
"""Rise of a way over its length that leads to the sky; what leads lower without a hit passes below the model."""
_MOST_BURIED, _MOST_TWISTED = 0.5, 0.02
"""More of the points cannot be buried, or of the edges run the same way in two triangles: these do not say which side
is out, and nothing is left out."""


def exposed(points_m: Array, normals: Array, meshes: Sequence[Mesh]) -> NDArray[np.bool_]:
    """Which points of meshes could have been seen: a way leads from them to the sky, or to room before a surface.

    points_m, normals: (n, 3), on the meshes, z up.
    meshes: of each its vertices (k, 3) and triangles (m, 3).
    """
    everything = np.ones(len(points_m), bool)
    if any(_twisted(faces) > _MOST_TWISTED for _, faces in meshes):
        return everything
    low, high = points_m.min(axis=0), points_m.max(axis=0)
    size, centre = float((high - low).max()), 0.5 * (low + high)
    scene = o3d.t.geometry.RaycastingScene()
    for vertices, faces in meshes:
        corners = o3d.core.Tensor.from_numpy((vertices - centre).astype(np.float32))
        scene.add_triangles(corners, o3d.core.Tensor.from_numpy(faces.astype(np.uint32)))
    seen = _seen(scene, points_m - centre, normals, size)
    return seen if seen.mean() > 1.0 - _MOST_BURIED else everything


def _twisted(faces: NDArray[np.int64]) -> float:
    """Share of the edges that two triangles go along in one direction."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return 1.0 - len(np.unique(edges[:, 0] * (faces.max() + 1) + edges[:, 1])) / len(edges)


def _seen(
    scene: o3d.t.geometry.RaycastingScene, points: Array, normals: Array, size: float
) -> NDArray[np.bool_]:
    seen = np.zeros(len(points), bool)
    left = np.arange(len(points))
    for way in _ways():
        rows = left[normals[left] @ way > _GRAZING]
        start = points[rows] + _LIFT * size * normals[rows]
        rays = np.concatenate([start, np.broadcast_to(way, start.shape)], axis=1).astype(np.float32)
        hit = scene.cast_rays(o3d.core.Tensor.from_numpy(rays))
        away = hit["t_hit"].numpy()
        front = hit["primitive_normals"].numpy() @ way < 0.0
        free = np.isfinite(away) & (away > _ROOM * size) & front
        seen[rows[free | (np.isinf(away) & (way[2] > _LOWEST))]] = True
        left = left[~seen[left]]
    return seen


def _ways() -> Array:
    """Unit vectors (n, 3) all around, from the zenith down."""
    number = np.arange(_DIRECTIONS)
    rise = 1.0 - 2.0 * number / (_DIRECTIONS - 1)
    turn = number * np.pi * (3.0 - np.sqrt(5.0))
    return np.column_stack([*(np.sqrt(1.0 - rise**2) * (np.cos(turn), np.sin(turn))), rise])
