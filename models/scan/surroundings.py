"""Ground next to a rock that it can meet as it tilts or slides: walls, neighbours, ledges, as a mesh."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from toppling.models.arrays import Array, Flags, Indices
from toppling.models.frames import quadrant_of
from toppling.models.pedestal import STEEP
from toppling.models.scan import o3d
from toppling.models.scan.interface import LEAST_SEEN, SECTORS, Interface
from toppling.models.scan.surfels import Surfels, in_plants, scene_of_rays
from toppling.models.shapes import joined_parts

CELL_PER_HEIGHT = 0.03
"""Cells in which the rock's way is noted; what is a cell away from it is reached, as the rock slides a little too."""
TILTS_DEG = np.arange(0.0, 54.0, 1.5)
"""Tilts that are looked at; beyond them the rock has fallen, and nothing catches it."""
_RELIEF_PER_HEIGHT = 0.05
"""Height of the ground's relief: the rock may tip over places below it, and surroundings rise above it."""
_TOUCHING_VOXELS = 4.0
"""Distance from the rock within which a thick neighbourhood is both sides of a crevice, and not a plant."""
_HIGHEST_GROUND_PER_HEIGHT = 0.25
_FROM_PER_HEIGHT = -0.02
"""The mesh begins so far from the interface."""
_ALIKE, _OFF_VOXELS = 0.8, 0.5
"""Neighbours of one sheet: cosine between their normals, and how far one lies off the plane of the other."""
_FACES = 0.2
"""Cosine between a steep patch's normal and the way to the rock from which it faces the rock, or away from it."""
_STRAYS = 0.005
"""Share of the rock's patches that may hang between it and what is beside, and tell no distance."""
_POISSON_DEPTH = 6
_NEAR_VOXELS = 2.5
"""Distance from the patches, in voxels, within which the reconstructed surface was seen; holes in it are closed."""
_ERROR_PER_HEIGHT = 0.002
"""Triangles are joined while the surface moves by less: what is flat becomes a few."""
_WITHIN, _CORNERS = 0.99, 5.0
"""Share of the places that lie within the error, and how many times it the others, at corners, may."""
_OF_ENDS = 0.1
"""Share of the way along a surface to where it ends that counts as an error."""
_JOINED_PER_HEIGHT = 0.25
"""Width of triangles that are joined at first; it is halved down to the error until the surface stays."""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Mesh of the ground next to a rock that the tilting rock can reach."""

    # (n, 3): scene frame, counter-clockwise seen from the air.
    vertices_m: Array
    faces: Indices
    # Least distance from what was seen of the rock, and height over the interface.
    nearest_m: float
    highest_m: float
    azimuth_deg: float  # toward which it is nearest

    @property
    def sentence(self) -> str:
        """Extent of the mesh, in words."""
        return (
            f"what stands beside the rock, {self.nearest_m:.2g} m from it toward {quadrant_of(self.azimuth_deg)} "
            f"and up to {self.highest_m:.2g} m high where the "
            f"tilting rock can reach it, is part of the ground ({len(self.faces)} triangles); crop it if it "
            "stood there for the scan only, as a tripod or a person"
        )


def in_reach(surfels: Surfels, rock: Flags, pedestal: Flags, interface: Interface, height_m: float) -> Flags:
    """Patches (n,) of the pedestal above the ground's relief that the rock meets as it tilts; few are none.

    rock, pedestal: (n,), which are theirs.
    height_m: of the rock.
    """
    cell = CELL_PER_HEIGHT * height_m
    own = interface.over(surfels.points_m[rock])
    own = own[np.unique(np.floor(own / (0.7 * cell)), axis=0, return_index=True)[1]]
    other = interface.over(surfels.points_m)
    high = pedestal & (other[:, 2] > _RELIEF_PER_HEIGHT * height_m)
    bottom = own[own[:, 2] < _RELIEF_PER_HEIGHT * height_m]
    found = np.zeros(len(rock), bool)
    if not high.any() or len(bottom) < 3:
        return found
    first = np.floor(other[high].min(axis=0) / cell).astype(int) - 2
    shape = np.floor(other[high].max(axis=0) / cell).astype(int) - first + 3
    swept = np.zeros(shape, bool)
    for angle in 2.0 * np.pi * np.arange(SECTORS) / SECTORS:
        outward = np.array([np.cos(angle), np.sin(angle), 0.0])
        pivot = bottom[np.argmax(bottom @ outward)] * [1.0, 1.0, 0.0]
        for tilt in np.deg2rad(TILTS_DEG):
            turn = Rotation.from_rotvec(tilt * np.array([-outward[1], outward[0], 0.0]))
            place = np.floor((turn.apply(own - pivot) + pivot) / cell).astype(int) - first
            swept[tuple(place[((place > 0) & (place < shape - 1)).all(axis=1)].T)] = True
    # A cell around each.
    near = np.argwhere(swept)
    for step in np.ndindex(3, 3, 3):
        swept[tuple((near + np.array(step) - 1).T)] = True
    place = np.floor(other[high] / cell).astype(int) - first
    found[high] = swept[tuple(place.T)]
    return found if found.sum() >= LEAST_SEEN else np.zeros(len(rock), bool)


def is_ground(flat: Array, normals: Array, interface: Interface, height_m: float) -> Flags:
    """Which patches (n,) of the pedestal, at u, v and a height over it, a map of heights shows."""
    level = normals @ interface.normal > STEEP
    return level & (np.abs(flat[:, 2]) < _HIGHEST_GROUND_PER_HEIGHT * height_m)


def surroundings_met(
    surfels: Surfels, rock: Flags, pedestal: Flags, interface: Interface, height_m: float
) -> Flags:
    """Patches (n,) of sheets that the rock can reach beside it, and that no map of heights shows; few are none.

    rock, pedestal: (n,), which are theirs.
    height_m: of the rock.
    """
    touching = cKDTree(surfels.points_m[rock]).query(surfels.points_m)[0] < _TOUCHING_VOXELS * surfels.voxel_m
    pedestal = pedestal & (touching | ~in_plants(surfels.points_m, surfels.roughness))
    reached = in_reach(surfels, rock, pedestal, interface, height_m)
    if not reached.any():
        return reached
    flat = interface.over(surfels.points_m)
    away = cKDTree(surfels.points_m[reached]).query(surfels.points_m)[0]
    shown = pedestal & (away < 2.0 * CELL_PER_HEIGHT * height_m) & (flat[:, 2] > 0.0)
    shown &= ~is_ground(flat, surfels.normals, interface, height_m)
    shown &= ~_goes_on(surfels, rock, shown)
    shown[shown] = np.bincount(sheet := _sheets(surfels, shown))[sheet] >= LEAST_SEEN
    return shown if (shown & reached).sum() >= LEAST_SEEN else np.zeros_like(shown)


def mesh_surroundings(
    surfels: Surfels, rock: Flags, shown: Flags, interface: Interface, height_m: float
) -> Surroundings:
    """Mesh of what :func:`surroundings_met` has shown that the rock can reach."""
    axis = surfels.points_m[rock].mean(axis=0)
    normals = _toward(axis, surfels.points_m[shown], surfels.normals[shown], interface.normal)
    vertices, faces = _surface(surfels.points_m[shown], normals, interface, surfels.voxel_m, height_m)
    nearest, distance = _nearest(vertices, faces, surfels.points_m[rock])
    azimuth = np.rad2deg(np.arctan2(*(nearest - axis)[1::-1])) % 360.0
    return Surroundings(
        vertices, faces, distance, float(interface.over(vertices)[:, 2].max()), float(azimuth)
    )


def _nearest(vertices_m: Array, faces: Indices, points_m: Array) -> tuple[Array, float]:
    """Place of a mesh that is nearest to points, and its distance."""
    scene = scene_of_rays((vertices_m, faces))
    found = scene.compute_closest_points(o3d.core.Tensor.from_numpy(points_m.astype(np.float32)), nthreads=1)
    places = found["points"].numpy().astype(float)
    distance = np.linalg.norm(places - points_m, axis=1)
    order = np.argsort(distance)[int(_STRAYS * len(distance))]
    return places[order], float(distance[order])


def _goes_on(surfels: Surfels, rock: Flags, shown: Flags) -> Flags:
    """Patches (n,) shown beside a rock that are its own foot: sheets that go on from its patches without a bend."""
    either = rock | shown
    sheet = _sheets(surfels, either)
    found = np.zeros(len(rock), bool)
    found[either] = np.bincount(sheet, rock[either])[sheet] > 0.0
    return found & shown


def _sheets(surfels: Surfels, which: Flags) -> Indices:
    """Number (k,) of the sheet in which each of some patches goes on: those of mixed pixels hang between surfaces."""
    points_m, normals = surfels.points_m[which], surfels.normals[which]
    pairs = cKDTree(points_m).query_pairs(2.0 * surfels.voxel_m, output_type="ndarray")
    along = points_m[pairs[:, 1]] - points_m[pairs[:, 0]]
    off = np.abs(np.einsum("ij,kij->ki", along, normals[pairs.T])).max(axis=0)
    alike = np.abs(np.einsum("ij,ij->i", *normals[pairs.T])) > _ALIKE
    return joined_parts(pairs[alike & (off < _OFF_VOXELS * surfels.voxel_m)], len(points_m))


def _toward(axis_m: Array, points_m: Array, normals: Array, up: Array) -> Array:
    """Normals of steep patches turned toward the rock, from whose side it meets them: it hides their sky."""
    direction = axis_m - points_m
    direction -= (direction @ up)[:, None] * up
    away = np.einsum("ij,ij->i", normals, direction) < -_FACES * np.linalg.norm(direction, axis=1)
    turned = away & (np.abs(normals @ up) < STEEP)
    return np.where(turned[:, None], -normals, normals)


def _surface(
    points_m: Array, normals: Array, interface: Interface, voxel_m: float, height_m: float
) -> tuple[Array, Indices]:
    """Triangles through patches, holes in what was seen closed, in as few as the error allows."""
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points_m))
    cloud.normals = o3d.utility.Vector3dVector(normals)
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        mesh, _ = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
            cloud, depth=_POISSON_DEPTH, n_threads=1
        )
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.triangles).astype(np.int64)
    middle = vertices[faces].mean(axis=1)
    over = interface.over(middle)[:, 2] > _FROM_PER_HEIGHT * height_m
    seen = cKDTree(points_m).query(middle)[0] < _NEAR_VOXELS * voxel_m
    margin = _NEAR_VOXELS * voxel_m
    low, high = points_m.min(axis=0) - margin, points_m.max(axis=0) + margin
    ends = ((vertices > high) | (vertices < np.append(low[:2], -np.inf))).any(axis=1)
    selected = over & (seen | _holes(faces, over & ~seen, ends))
    return few_triangles(vertices, faces[selected], height_m)


def few_triangles(vertices_m: Array, faces: Indices, height_m: float) -> tuple[Array, Indices]:
    """A mesh with its triangles joined while its surface stays within the error that is allowed."""
    used, numbers = np.unique(faces, return_inverse=True)
    whole = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(vertices_m[used]),
        o3d.utility.Vector3iVector(numbers.reshape(-1, 3).astype(np.int32)),
    )
    error_m = _ERROR_PER_HEIGHT * height_m
    # What Open3D bounds is an area times a squared distance, of an area that grows as triangles are joined.
    halvings = np.arange(math.log2(_JOINED_PER_HEIGHT / _ERROR_PER_HEIGHT))
    for width_m in _JOINED_PER_HEIGHT * height_m * 0.5**halvings:
        mesh = whole.simplify_quadric_decimation(1, (error_m * width_m) ** 2, 1.0)
        off_m = np.append(_off_m(whole, mesh), _off_m(mesh, whole))
        if np.quantile(off_m, _WITHIN) <= error_m and off_m.max() <= _CORNERS * error_m:
            return np.asarray(mesh.vertices), np.asarray(mesh.triangles).astype(np.int64)
    return np.asarray(whole.vertices), np.asarray(whole.triangles).astype(np.int64)


def _off_m(mesh: Any, other: Any) -> Array:
    """How far a mesh's vertices, and the middles of its faces, lie off the surface of another one.

    Where a surface ends is not known as well as where it lies: a place beyond the end of the other counts less.
    """
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    places = np.vstack([vertices[np.unique(faces)], vertices[faces].mean(axis=1)])
    if len(places) == 0 or len(other.triangles) == 0:
        return np.full(max(len(places), 1), 0.0 if len(places) == len(other.triangles) else np.inf)
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(o3d.t.geometry.TriangleMesh.from_legacy(other))
    found = scene.compute_closest_points(o3d.core.Tensor.from_numpy(places.astype(np.float32)), nthreads=1)
    direction = places - found["points"].numpy()
    off = np.abs(np.einsum("ij,ij->i", direction, found["primitive_normals"].numpy()))
    return np.asarray(np.maximum(off, _OF_ENDS * np.linalg.norm(direction, axis=1)))


def _holes(faces: Indices, unseen: Flags, ends: Flags) -> Flags:
    """Unseen faces in parts that do not go on to where the reconstruction ends."""
    numbers = np.flatnonzero(unseen)
    rows = np.repeat(np.arange(len(numbers)), 3)
    used = coo_matrix((np.ones(len(rows)), (rows, faces[numbers].ravel())), (len(numbers), len(ends)))
    part = connected_components(used @ used.T, directed=False)[1]
    open_parts = np.unique(part[ends[faces[numbers]].any(axis=1)])
    found = np.zeros(len(faces), bool)
    found[numbers[~np.isin(part, open_parts)]] = True
    return found
