"""Closing: one closed body from the rock's surfels, its base on the interface plane.

The seen surface is joined by screened Poisson reconstruction (Kazhdan and Hoppe 2013); where the base is hidden,
points below the interface plane close it, and what lies below the plane is cut away exactly (Manifold), so that the
base lies on the plane.
"""

from dataclasses import dataclass

import manifold3d
import numpy as np
import open3d as o3d
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from models.errors import InputError
from models.rock import Rock
from models.scan.interface import Interface
from models.scan.surfels import Surfels

POISSON_DEPTH = 7
SIMPLIFIED_SHARE_OF_HEIGHT = 0.0015
"""Triangles are joined where the surface moves by less than this: noise, not shape."""


@dataclass(frozen=True, eq=False)
class ClosedRock:
    """The rock and how much of its surface was seen.

    Parameters
    ----------
    rock : Rock
    seen_share, closed_share, invented_share : float
        Shares of the surface: within two voxels of a surfel, on the interface plane, neither.
    """

    rock: Rock
    seen_share: float
    closed_share: float
    invented_share: float


def close_rock(surfels: Surfels, rock: NDArray[np.bool_], interface: Interface) -> ClosedRock:
    """Close the rock at its interface.

    Raises
    ------
    InputError
        If the seen surface does not close to one body that reaches the interface.
    """
    points, normals = surfels.points_m[rock], surfels.normals[rock]
    flat, flat_normals = interface.flat(points), normals @ interface.axes
    base = _hidden_base(flat, surfels.voxel_m)
    below = np.tile([0.0, 0.0, -1.0], (len(base), 1))
    body = _trimmed(_poisson(np.vstack([flat, base]), np.vstack([flat_normals, below])))
    vertices = np.array(body.vert_properties[:, :3], float)
    faces = np.array(body.tri_verts, np.int64)
    vertices[np.abs(vertices[:, 2]) < 1e-9 * np.ptp(vertices[:, 2]), 2] = 0.0
    rock_body = Rock.from_triangles(interface.scene(vertices), faces, where="closed rock")
    return ClosedRock(rock_body, *_shares(vertices, faces, flat, surfels.voxel_m))


def _hidden_base(flat: NDArray[np.float64], voxel_m: float) -> NDArray[np.float64]:
    """Points a little below the plane wherever the rock stands and its underside was not seen."""
    low = flat[flat[:, 2] < 0.25 * np.ptp(flat[:, 2])]
    cell = 0.5 * voxel_m
    first = low[:, :2].min(axis=0) - 4 * cell
    shape = np.ceil((low[:, :2].max(axis=0) + 4 * cell - first) / cell).astype(int)
    index = ((low[:, :2] - first) / cell).astype(int)
    seen = np.zeros(shape, bool)
    seen[index[:, 0], index[:, 1]] = True
    seen = ndimage.binary_dilation(seen, iterations=3)
    holes = ndimage.binary_fill_holes(seen) & ~seen
    inside, count = ndimage.label(holes)
    if count == 0:
        return np.empty((0, 3))
    largest = 1 + int(np.argmax(np.bincount(inside.ravel())[1:]))
    hidden = inside == largest
    grid = np.argwhere(hidden) * cell + first + 0.5 * cell
    return np.column_stack([grid, np.full(len(grid), -0.5 * voxel_m)])


def _poisson(points: NDArray[np.float64], normals: NDArray[np.float64]) -> manifold3d.Manifold:
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    cloud.normals = o3d.utility.Vector3dVector(normals)
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        mesh, _ = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
            cloud, depth=POISSON_DEPTH, scale=1.15, n_threads=1
        )
    body = manifold3d.Manifold(
        manifold3d.Mesh64(
            np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.triangles).astype(np.uint64)
        )
    )
    if body.status() != manifold3d.Error.NoError or body.is_empty():
        raise _not_closed(f"the reconstructed surface is no closed body ({body.status().name})")
    return body


def _trimmed(body: manifold3d.Manifold) -> manifold3d.Mesh64:
    low, high = body.bounding_box()[2], body.bounding_box()[5]
    simple = body.simplify(SIMPLIFIED_SHARE_OF_HEIGHT * (high - low))
    parts = simple.trim_by_plane((0.0, 0.0, 1.0), 0.0).decompose()
    if not parts:
        raise _not_closed("the reconstructed surface lies below the interface")
    return max(parts, key=lambda part: part.volume()).to_mesh64()


def _shares(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], seen: NDArray[np.float64], voxel_m: float
) -> tuple[float, float, float]:
    corner = vertices[faces]
    area = 0.5 * np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    on_plane = (corner[:, :, 2] == 0.0).all(axis=1)
    near = cKDTree(seen).query(corner.mean(axis=1))[0] < 2.0 * voxel_m
    shares = [area[near & ~on_plane].sum(), area[on_plane].sum(), area[~near & ~on_plane].sum()]
    return tuple(float(share / area.sum()) for share in shares)  # type: ignore[return-value]


def _not_closed(what: str) -> InputError:
    return InputError(
        what, where="closing the rock", expected="a rock seen from several sides",
        remedy="add stations, or check the segmentation in the scene's picture",
    )
