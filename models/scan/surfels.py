"""Surfels: a cloud thinned to one oriented patch of surface per voxel."""

from dataclasses import dataclass

import numpy as np
import open3d as o3d
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from toppling.models.arrays import bounds_of, numbered

_NEIGHBOURS = 16
"""Patches that a local plane is fitted to: two rings around one."""
_ESCAPE_DIRECTIONS = 24
_STRAY_SHARE = 0.2
"""A voxel with less than this share of the points of a typical neighbour holds strays only."""


LEVEL = 0.8
"""Upward part of a normal from which on a patch lies level: it is of a top, carries, and belongs to no side."""
_PLANT_ROUGHNESS, _OF_A_PLANT = 0.3, 9
"""Thickness over width, in the median of so many patches, above which they are a plant's."""


@dataclass(frozen=True, eq=False)
class Surfels:
    """One patch per occupied voxel."""

    points_m: NDArray[np.float64]  # (n, 3): mean of the voxel's points
    normals: NDArray[np.float64]  # (n, 3): unit normals, toward the air
    # (n,): thickness of the neighbourhood over its width: near 0 on a surface, near 1 in a bush.
    roughness: NDArray[np.float64]
    voxel_m: float


def in_plants(points_m: NDArray[np.float64], roughness: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which thinned points (n,) lie among such as are thick: a rock falls through what is there.

    So do those on both sides of a narrow crevice.
    """
    _, near = cKDTree(points_m).query(points_m, min(_OF_A_PLANT, len(points_m)))
    return np.asarray(np.median(roughness[near].reshape(len(points_m), -1), axis=1) > _PLANT_ROUGHNESS)


def thin(points_m: NDArray[np.float64], voxel_m: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """One mean point per voxel of a surface, and the index of each point's voxel, -1 for strays.

    A voxel with far fewer points than its neighbours holds strays: mixed pixels hang between surfaces,
    thinly.
    """
    index, count = numbered(voxels(points_m, voxel_m))
    mean = np.column_stack([np.bincount(index, points_m[:, axis]) / count for axis in range(3)])
    near = cKDTree(mean).query(mean, min(13, len(mean)))[1].reshape(len(mean), -1)
    near = near[:, 1:] if len(mean) > 1 else near
    solid = count >= _STRAY_SHARE * np.median(count[near], axis=1)
    renumbered = np.where(solid, np.cumsum(solid) - 1, -1)
    return mean[solid], renumbered[index]


def voxels(points_m: NDArray[np.float64], voxel_m: float) -> NDArray[np.int64]:
    """A number (n,) of each point's voxel, the same for all in it, from 0 on."""
    low, high = bounds_of(points_m)
    size = np.floor((high - low) / voxel_m).astype(np.int64) + 1
    key = np.zeros(len(points_m), np.int64)
    for axis in range(3):
        key *= size[axis]
        key += np.floor((points_m[:, axis] - low[axis]) / voxel_m).astype(np.int64)
    return key


def orient(points_m: NDArray[np.float64], voxel_m: float) -> Surfels:
    """Local planes of thinned points, their normals turned toward the side from which more sky is seen."""
    normals, thickness = _local_planes(points_m)
    outside = _escapes(points_m, normals, voxel_m) - _escapes(points_m, -normals, voxel_m)
    outside = _agreed(points_m, normals, outside, voxel_m)
    return Surfels(points_m, np.where(outside < 0, -1.0, 1.0)[:, None] * normals, thickness, voxel_m)


def roughness(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Thickness over width of the neighbourhood of each of some thinned points."""
    return _local_planes(points_m)[1]


def _local_planes(points_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Normals, either way, of planes through the neighbourhoods, and how thick these are over their width."""
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points_m))
    cloud.estimate_covariances(o3d.geometry.KDTreeSearchParamKNN(_NEIGHBOURS))
    variance, axes = np.linalg.eigh(np.asarray(cloud.covariances))
    thickness = np.sqrt(np.maximum(variance[:, 0], 0.0) / np.maximum(variance[:, 1], 1e-30))
    return axes[:, :, 0], thickness


def _escapes(
    points_m: NDArray[np.float64], normals: NDArray[np.float64], voxel_m: float
) -> NDArray[np.float64]:
    """How many rays to the sky, from a little above each patch, meet no other patch.

    Rays below the horizon would pass under the ground, which the scan shows from above only.
    """
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    side = np.cross(normals, np.where(np.abs(normals[:, 2:]) < 0.7, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]]))
    side *= 0.8 * voxel_m / np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(normals, side)
    corners = np.stack([points_m + side, points_m + up, points_m - side, points_m - up], axis=1)
    first = 4 * np.arange(len(points_m))[:, None]
    faces = np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])])
    scene.add_triangles(
        o3d.core.Tensor.from_numpy(corners.reshape(-1, 3).astype(np.float32)),
        o3d.core.Tensor.from_numpy(faces.astype(np.uint32)),
    )
    turn = np.pi * (3 - np.sqrt(5)) * np.arange(_ESCAPE_DIRECTIONS)
    z = -0.15 + 1.1 * (np.arange(_ESCAPE_DIRECTIONS) + 0.5) / _ESCAPE_DIRECTIONS
    sky = np.column_stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z])
    start = (points_m + 1.5 * voxel_m * normals).astype(np.float32)
    free = np.zeros(len(points_m))
    for direction in sky.astype(np.float32):
        rays = np.concatenate([start, np.broadcast_to(direction, start.shape)], axis=1)
        free += ~scene.test_occlusions(o3d.core.Tensor.from_numpy(rays), nthreads=1).numpy()
    return free


def _agreed(
    points_m: NDArray[np.float64], normals: NDArray[np.float64], vote: NDArray[np.float64], voxel_m: float
) -> NDArray[np.float64]:
    """Votes averaged with those of neighbours on the same sheet: deep in a crevice no ray escapes."""
    distance, near = cKDTree(points_m).query(points_m, 10)
    same = np.einsum("ij,ikj->ik", normals, normals[near]) * (distance < 3 * voxel_m)
    for _ in range(4):
        vote = vote + 0.5 * np.einsum("ik,ik->i", np.sign(same) * same**2, vote[near]) / same.shape[1]
    return vote
