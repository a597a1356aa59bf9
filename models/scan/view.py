"""A cloud as a screen shows it, thinned and shaded, and any of its points picked through those that are shown."""

from dataclasses import dataclass

import numpy as np
import open3d as o3d
from scipy.spatial import cKDTree

from toppling.models.arrays import Array, Flags, Indices, at_most, inside_box

SHOWN_POINTS = 200_000
"""Points that the graphics of a laptop turn without a pause."""
SAMPLED_POINTS = 2_000_000
"""More tell a screen no more."""
_LEAST_SHARE = 0.75
"""Least share of the points that may be shown."""
_SPACINGS, _COVERED_SHARE = 5000, 0.8
"""Points of which spacings are taken, and the share of them that is no farther apart."""
_NEIGHBOURS = 12
"""Points by whose plane one is shaded."""
LIGHT = np.array([-0.45, -0.6, 0.66])
"""Direction toward the light, from the upper left of one who looks north."""
_DARKEST = 0.35
_WITHIN_SPACINGS = 2.0
"""Distance from the clicked point within which the cloud is searched, in spacings of the shown points."""


@dataclass(frozen=True, eq=False)
class Shown:
    """Points of a cloud that a page shows."""

    rows: Indices  # (n,): which of the cloud's points
    spacing_m: float  # between neighbours, where the cloud is not much sparser than elsewhere


def thinned(points_m: Array, most: int = SHOWN_POINTS, among: Indices | None = None) -> Shown:
    """Choose one point per voxel, in voxels as small as a number of points allows.

    Parameters
    ----------
    points_m : (n, 3) array
    most : int
        Number of points, which is nearly reached where the cloud has so many.
    among : (k,) int array, optional
        Rows to choose from; all if not given.
    """
    rows = np.arange(len(points_m)) if among is None else among
    rows = at_most(rows, SAMPLED_POINTS)
    points = points_m[rows]
    voxel = float(np.ptp(points, axis=0).max()) / np.sqrt(most)
    for _ in range(8):
        first = _one_per_voxel(points, voxel) if len(rows) > most else np.arange(len(rows))
        if len(first) <= most and len(first) > _LEAST_SHARE * min(most, len(rows)):
            break
        # A surface's voxels go with the inverse square of their size.
        voxel *= np.clip(np.sqrt(len(first) / (0.9 * most)), 0.3, 3.0)
    chosen = at_most(np.sort(first), most)
    return Shown(rows[chosen], _spacing(points[chosen]))


def _spacing(points_m: Array) -> float:
    """Distance of the fourth neighbour of most points: what a point has to cover so that a surface looks closed."""
    some = points_m[:: max(1, len(points_m) // _SPACINGS)]
    neighbour = min(4, len(points_m) - 1)
    return float(np.quantile(cKDTree(points_m).query(some, neighbour + 1)[0][:, -1], _COVERED_SHARE))


def _one_per_voxel(points_m: Array, voxel_m: float) -> Indices:
    cell = np.floor((points_m - points_m.min(axis=0)) / voxel_m).astype(np.int64)
    size = cell.max(axis=0) + 1
    return np.unique((cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2], return_index=True)[1]


def around(points_m: Array, centre_m: Array, reach_m: float) -> Indices:
    """Rows of the points (n, 3) in a cube about a place."""
    return np.flatnonzero(inside_box(points_m, centre_m - reach_m, centre_m + reach_m))


def shade(points_m: Array, rock: Flags | None = None) -> Array:
    """Brightness (n,) of points (n, 3), from `_DARKEST` to 1, by the slope of the surface that they lie on.

    Parameters
    ----------
    points_m : (n, 3) array
    rock : (n,) bool array, optional
        Points whose surface faces away from their middle; that of the others faces upward.
    """
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points_m))
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(_NEIGHBOURS))
    normals = np.asarray(cloud.normals)
    outward = normals[:, 2].copy()
    if rock is not None and rock.any():
        middle = 0.5 * (points_m[rock].min(axis=0) + points_m[rock].max(axis=0))
        outward[rock] = ((points_m[rock] - middle) * normals[rock]).sum(axis=1)
    normals = normals * np.where(outward < 0.0, -1.0, 1.0)[:, None]
    return _DARKEST + (1.0 - _DARKEST) * (0.5 + 0.5 * normals @ LIGHT)


def picked(points_m: Array, shown_m: Array, eye_m: Array, spacing_m: float) -> int:
    """Row of the cloud's point that a click on a shown point means: of those around it, the one nearest to the ray.

    Parameters
    ----------
    points_m : (n, 3) array
    shown_m : (3,) array
        A place on the ray from the eye through the click, at the depth of the shown point that was hit.
    eye_m : (3,) array
    spacing_m : float
        Of the shown points.
    """
    rows = around(points_m, shown_m, _WITHIN_SPACINGS * spacing_m)
    if not len(rows):
        return int(np.argmin(np.linalg.norm(points_m - shown_m, axis=1)))
    along = (shown_m - eye_m) / max(float(np.linalg.norm(shown_m - eye_m)), 1e-12)
    offset = points_m[rows] - shown_m
    depth = offset @ along
    beside = np.linalg.norm(offset - depth[:, None] * along, axis=1)
    # Of points as near to the ray, the one in front is seen.
    return int(rows[np.argmin(beside + 0.25 * np.maximum(depth, 0.0))])
