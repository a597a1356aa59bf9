"""Surfels: a cloud thinned to one oriented patch of surface per voxel; and a cloud as a screen shows it."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from toppling.models.arrays import Array, Flags, Indices, at_most, bounds_of, inside_box, numbered
from toppling.models.scan import o3d

NEIGHBOURS = 16
"""Patches that a local plane is fitted to: two rings around one."""
_ESCAPE_DIRECTIONS, _SKY_FROM = 24, -0.15
"""Rays from a patch, and the least upward part of those to the sky."""
_BOTH_SIDES = 3.0
"""Rays that escape from both sides of a patch: where they are nearly as many, something of the rock was not seen."""
_LEAVING, _OWN_SHEET_VOXELS = 0.1, 4.0
"""Cosine between a ray and the way out, and how far away it meets something, of a ray that left its own sheet."""
_STRAY_FRACTION = 0.2
"""A voxel with less than this share of the points of a typical neighbour holds strays only."""


LEVEL = 0.8
"""Upward part of a normal from which on a patch lies level: it is of a top, carries, and belongs to no side."""
_PLANT_ROUGHNESS, _OF_A_PLANT = 0.3, 9
"""Thickness over width, in the median of so many patches, above which they are a plant's."""


@dataclass(frozen=True, eq=False)
class Surfels:
    """Patches by occupied voxel."""

    points_m: Array  # (n, 3): mean of the voxel's points
    normals: Array  # (n, 3): unit normals, toward the air
    # (n,): thickness of the neighbourhood over its width: near 0 on a surface, near 1 in a bush.
    roughness: Array
    voxel_m: float

    def only(self, chosen: Flags) -> "Surfels":
        """Some of them."""
        return Surfels(self.points_m[chosen], self.normals[chosen], self.roughness[chosen], self.voxel_m)


def in_plants(points_m: Array, roughness: Array) -> Flags:
    """Which thinned points (n,) lie among such as are thick: a rock falls through what is there.

    So do those on both sides of a narrow crevice.
    """
    _, near = cKDTree(points_m).query(points_m, min(_OF_A_PLANT, len(points_m)))
    return np.asarray(np.median(roughness[near].reshape(len(points_m), -1), axis=1) > _PLANT_ROUGHNESS)


def thin(points_m: Array, voxel_m: float) -> tuple[Array, Indices]:
    """Mean points by voxel of a surface, and the index of each point's voxel, -1 for strays.

    A voxel with far fewer points than its neighbours holds strays: mixed pixels hang between surfaces,
    thinly.
    """
    index, count = numbered(voxels(points_m, voxel_m))
    mean = np.column_stack([np.bincount(index, points_m[:, axis]) / count for axis in range(3)])
    near = cKDTree(mean).query(mean, min(13, len(mean)))[1].reshape(len(mean), -1)
    near = near[:, 1:] if len(mean) > 1 else near
    solid = count >= _STRAY_FRACTION * np.median(count[near], axis=1)
    renumbered = np.where(solid, np.cumsum(solid) - 1, -1)
    return mean[solid], renumbered[index]


def voxels(points_m: Array, voxel_m: float) -> Indices:
    """A number (n,) of each point's voxel, the same for all in it, from 0 on."""
    low, high = bounds_of(points_m)
    size = np.floor((high - low) / voxel_m).astype(np.int64) + 1
    key = np.zeros(len(points_m), np.int64)
    for axis in range(3):
        key *= size[axis]
        key += np.floor((points_m[:, axis] - low[axis]) / voxel_m).astype(np.int64)
    return key


def orient(points_m: Array, voxel_m: float) -> Surfels:
    """Local planes of thinned points, their normals turned toward the side from which more sky is seen."""
    normals, thickness = _local_planes(points_m)
    rays = _Rays.over(points_m, normals, voxel_m)
    before, behind = rays.escaping(normals), rays.escaping(-normals)
    normals = _turned(points_m, normals, before - behind, voxel_m)
    fewer = np.minimum(before, behind)
    doubtful = np.flatnonzero((fewer >= _BOTH_SIDES) & (fewer > 0.5 * np.maximum(before, behind)))
    if len(doubtful):
        outside = np.abs(before - behind)
        outside[doubtful] = rays.of_air(doubtful, normals, 1.0) - rays.of_air(doubtful, normals, -1.0)
        normals = _turned(points_m, normals, outside, voxel_m)
    return Surfels(points_m, normals, thickness, voxel_m)


def roughness(points_m: Array) -> Array:
    """Thickness over width of the neighbourhood of each of some thinned points."""
    return _local_planes(points_m)[1]


def scene_of_rays(*meshes: tuple[Array, Indices]) -> Any:
    """Open3D's scene of meshes, vertices and triangles each, in which to cast rays and find nearest places."""
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    for vertices_m, faces in meshes:
        corners = o3d.core.Tensor.from_numpy(vertices_m.astype(np.float32))
        scene.add_triangles(corners, o3d.core.Tensor.from_numpy(faces.astype(np.uint32)))
    return scene


def _local_planes(points_m: Array) -> tuple[Array, Array]:
    """Normals, either way, of planes through the neighbourhoods, and how thick these are over their width."""
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points_m))
    cloud.estimate_covariances(o3d.geometry.KDTreeSearchParamKNN(NEIGHBOURS))
    variance, axes = np.linalg.eigh(np.asarray(cloud.covariances))
    thickness = np.sqrt(np.maximum(variance[:, 0], 0.0) / np.maximum(variance[:, 1], 1e-30))
    return axes[:, :, 0], thickness


@dataclass(frozen=True, eq=False)
class _Rays:
    """Rays from a little beside patches."""

    points_m: Array
    voxel_m: float
    scene: Any  # of rays, Open3D's

    @classmethod
    def over(cls, points_m: Array, normals: Array, voxel_m: float) -> "_Rays":
        """Rays among patches as wide as a voxel."""
        side = np.cross(normals, np.where(np.abs(normals[:, 2:]) < 0.7, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]]))
        side *= 0.8 * voxel_m / np.linalg.norm(side, axis=1, keepdims=True)
        up = np.cross(normals, side)
        corners = np.stack([points_m + side, points_m + up, points_m - side, points_m - up], axis=1)
        first = 4 * np.arange(len(points_m))[:, None]
        # The triangles of patch k are number k and k + n.
        faces = np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])])
        return cls(points_m, voxel_m, scene_of_rays((corners.reshape(-1, 3), faces)))

    def _from(self, patches: Indices, out: Array, lowest: float) -> Iterator[tuple[NDArray[np.float32], Any]]:
        """Directions (3,) whose upward part is at least so much, and rays (n, 6) from beside patches that way."""
        start = (self.points_m[patches] + 1.5 * self.voxel_m * out).astype(np.float32)
        number = np.arange(_ESCAPE_DIRECTIONS)
        turn, z = np.pi * (3 - np.sqrt(5)) * number, lowest + (0.95 - lowest) * (number + 0.5) / len(number)
        level = np.sqrt(1 - z**2)
        for ray in np.column_stack([level * np.cos(turn), level * np.sin(turn), z]).astype(np.float32):
            yield ray, o3d.core.Tensor.from_numpy(np.hstack([start, np.broadcast_to(ray, start.shape)]))

    def escaping(self, out: Array) -> Array:
        """How many rays (n,) to the sky that start on one side of each patch meet no other.

        Rays far below the horizon would pass under the ground, which the scan shows from above only.
        """
        free = np.zeros(len(self.points_m))
        for _, rays in self._from(np.arange(len(free)), out, _SKY_FROM):
            free += ~self.scene.test_occlusions(rays, nthreads=1).numpy()
        return free

    def of_air(self, patches: Indices, normals: Array, side: float) -> Array:
        """How many rays (k,) from one side of some patches meet the sky or another's face, less those that meet backs.

        Through what nobody saw of a rock rays escape from within; what they meet of its other side is its back. In
        front of a patch lies the ground that was seen, below what hangs over it.
        """
        out, count = side * normals[patches], np.zeros(len(patches))
        for ray, rays in self._from(patches, out, -1.0):
            met = self.scene.cast_rays(rays, nthreads=1)
            number, away_m = met["primitive_ids"].numpy(), met["t_hit"].numpy()
            of_back = normals[number % len(normals)] @ ray > 0.0
            signs = np.where(np.isfinite(away_m), np.where(of_back, -1.0, 1.0), float(ray[2] > _SKY_FROM))
            # What goes back through the patch's own sheet says nothing.
            count += signs * ((out @ ray > _LEAVING) & (away_m > _OWN_SHEET_VOXELS * self.voxel_m))
        return count


def _turned(points_m: Array, normals: Array, vote: Array, voxel_m: float) -> Array:
    """Normals turned round where votes, agreed with those of neighbours, are below 0."""
    return np.where(_agreed(points_m, normals, vote, voxel_m) < 0, -1.0, 1.0)[:, None] * normals


def _agreed(points_m: Array, normals: Array, vote: Array, voxel_m: float) -> Array:
    """Votes averaged with those of neighbours on the same sheet: deep in a crevice no ray escapes."""
    distance, near = cKDTree(points_m).query(points_m, 10)
    same = np.einsum("ij,ikj->ik", normals, normals[near]) * (distance < 3 * voxel_m)
    for _ in range(4):
        vote = vote + 0.5 * np.einsum("ik,ik->i", np.sign(same) * same**2, vote[near]) / same.shape[1]
    return vote


SAMPLED, FEW_SAMPLED = 20_000, 5_000
"""Number of points that represent a cloud's shares to within a percent, and its quantiles to within a few."""
SHOWN_POINTS = 200_000
"""Points that the graphics of a laptop turn without a pause."""
SAMPLED_POINTS = 2_000_000
"""More tell a screen no more."""
_LEAST_SHARE = 0.75
"""Least share of the points that may be shown."""
_COVERED_FRACTION = 0.8
"""Fraction of the points that are no farther apart than a cloud's spacing."""
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
        first = np.arange(len(rows))
        if len(rows) > most:
            first = np.unique(voxels(points, voxel), return_index=True)[1]
        if len(first) <= most and len(first) > _LEAST_SHARE * min(most, len(rows)):
            break
        # A surface's voxels go with the inverse square of their size.
        voxel *= np.clip(np.sqrt(len(first) / (0.9 * most)), 0.3, 3.0)
    chosen = at_most(np.sort(first), most)
    return Shown(rows[chosen], _spacing(points[chosen]))


def _spacing(points_m: Array) -> float:
    """Distance of the fourth neighbour of most points: what a point has to cover so that a surface looks closed."""
    some = points_m[:: max(1, len(points_m) // FEW_SAMPLED)]
    neighbour = min(4, len(points_m) - 1)
    return float(np.quantile(cKDTree(points_m).query(some, neighbour + 1)[0][:, -1], _COVERED_FRACTION))


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
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(NEIGHBOURS))
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
    aside_m = np.linalg.norm(offset - depth[:, None] * along, axis=1)
    # Of points as near to the ray, the one in front is seen.
    return int(rows[np.argmin(aside_m + 0.25 * np.maximum(depth, 0.0))])
