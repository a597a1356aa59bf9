"""Where rock and pedestal can touch: the rock's feet over the interface plane.

The support frame has its origin in the interface plane and z along the plane's upward normal; the body frame has its
origin at the rock's centre of mass and the axes of its principal inertia.

On a plane only vertices of the rock's convex hull can touch, so these points represent the rock exactly. An uneven
pedestal, and one that ends under the rock, is taken into the points (:mod:`models.relief`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError, cKDTree
from scipy.spatial.transform import Rotation

from toppling.models.caching import cached
from toppling.models.compiled import Array, Flags
from toppling.models.errors import InputError
from toppling.models.frames import plane_axes
from toppling.models.pedestal import LARGEST_OPEN_TILT_DEG, TOPPLED_TILT_DEG
from toppling.models.relief import contact_feet_m
from toppling.models.scene import Scene

_AT_A_TIME = 1024
"""Directions that are looked at together, so that a fine mesh of many thousand points takes little memory."""

_NEIGHBOURS, _NEIGHBOURS_LOOKED_AT = 12, 40
"""Numbers of neighbours with which a corner is compared, and that are looked at to find so many."""

_CORE_SHARE = 5e-6
"""Contact points are left out while the hull of the others stays within this share of R of the whole. Ten times as much
takes every second corner from an arc of 32, over which the rock then rolls with too great a loss of energy."""

_FALLING_CORE_SHARE = 2e-3
"""Largest distance, over R, of the hull from left-out points that touch only beyond the largest tilt of statics."""


@dataclass(frozen=True, eq=False)
class ContactModel:
    """The geometry that a shake needs, in the support's and the body's frames.

    Parameters
    ----------
    scene_from_support : (3, 3) array
        Turns vectors of the support frame into the scene frame.
    origin_m : (3,) array
        Origin of the support frame, scene frame.
    com_m : (3,) array
        Centre of mass in the pose of the scene, support frame.
    support_from_body : (3, 3) array
        Turns vectors of the body frame into the support frame, in the pose of the scene.
    principal_inertia_m2 : (3,) array
        Principal moments of inertia over mass.
    points_body_m : (n, 3) array
        Feet that can touch the interface plane, in the order of the tilt from which they can.
    half_diagonal_m : float
        Length scale R.
    """

    scene_from_support: Array
    origin_m: Array
    com_m: Array
    support_from_body: Array
    principal_inertia_m2: Array
    points_body_m: Array
    half_diagonal_m: float

    @property
    def start_quaternion_xyzw(self) -> Array:
        """Attitude of the body frame in the pose of the scene."""
        return np.asarray(Rotation.from_matrix(self.support_from_body).as_quat())

    @property
    def start_pose(self) -> Array:
        """The pose (7,) of the scene: centre of mass, support frame, and attitude of the body frame."""
        return np.concatenate([self.com_m, self.start_quaternion_xyzw])

    def tilts_deg(self, quaternions_xyzw: Array) -> Array:
        """Angle (m,) between the interface's normal and where the rock has carried it, for attitudes (m, 4)."""
        cosines = self.support_from_body[2] @ _normals_body(quaternions_xyzw)
        return np.rad2deg(np.arccos(np.clip(cosines, -1.0, 1.0)))

    def gaps_m(self, pose: Array) -> Array:
        """Clearance over the plane, negative where a point has sunk in: (n,) in a pose (7,), (n, m) in poses (m, 7)."""
        # Not by BLAS, whose threads would go on to spin for longer than a shake lasts.
        return np.asarray(
            pose.T[2] + np.einsum("ij,j...->i...", self.points_body_m, _normals_body(pose[..., 3:]))
        )

    def touching(self, pose: Array) -> Array:
        """A pose (7,) shifted along the interface's normal to where its lowest point touches."""
        return np.concatenate([pose[:2], [pose[2] - self.gaps_m(pose).min()], pose[3:]])


def _normals_body(quaternions_xyzw: Array) -> Array:
    """The interface's normal (3,) or (3, m) in the body frame, for attitudes (4,) or (m, 4)."""
    x, y, z, w = quaternions_xyzw.T
    return np.array([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)])


@cached
def contact_of(scene: Scene) -> ContactModel:
    """Contact model of a scene, made once.

    Raises
    ------
    InputError
        If the points that can touch span no volume.
    """
    normal, origin = scene.pedestal.normal, scene.pedestal.point_m
    scene_from_support = np.column_stack([*plane_axes(normal), normal])
    com = (scene.rock.com_m - origin) @ scene_from_support
    moments, axes = scene.rock.principal_axes(scene_from_support)
    on_plane = scene.ground.is_plane  # else these points say only how large the rock is
    feet_m = contact_feet_m(scene.rock, scene.pedestal) if on_plane else scene.rock.hull_vertices_m
    feet = (feet_m - origin) @ scene_from_support - com
    return ContactModel(
        scene_from_support=scene_from_support,
        origin_m=origin,
        com_m=com,
        support_from_body=axes,
        principal_inertia_m2=moments,
        points_body_m=_vertices_that_can_touch(feet, scene.rock.half_diagonal_m) @ axes,
        half_diagonal_m=scene.rock.half_diagonal_m,
    )


def _vertices_that_can_touch(points_m: Array, size_m: float) -> Array:
    """Hull vertices that are lowest for some tilt up to the largest open one, in the order of the least such tilt.

    As many as keep the hull within `_CORE_SHARE` of the rock's size.

    A vertex is lowest for the directions in its normal cone, bounded by arcs between the normals of neighbouring
    facets: the least tilt is the angle from straight down to the nearest of its arcs, or 0 within the cone.
    """
    try:
        hull = ConvexHull(points_m)
    except QhullError:
        raise InputError(
            "rock.touches_in_a_plane",
            "all points of the rock that can touch lie in one plane or line",
            where="scene",
            expected="a rock with a volume over its pedestal",
            remedy="check that the pedestal lies below the rock",
        ) from None
    normals = hull.equations[:, :3]
    facet, across = np.repeat(np.arange(len(normals)), 3), hull.neighbors.ravel()
    from_arc = _angle_to_arc_deg(normals[facet], normals[across])
    # neighbors[f, i] lies across the edge opposite to vertex i of facet f
    corner = np.tile(np.arange(3), len(normals))
    onset = np.full(len(points_m), np.inf)
    for other in (1, 2):
        np.minimum.at(onset, hull.simplices[facet, (corner + other) % 3], from_arc)
    onset[points_m[:, 2].argmin()] = 0.0
    order = np.argsort(onset, kind="stable")
    order = order[onset[order] <= LARGEST_OPEN_TILT_DEG]
    rocking = onset[order] <= TOPPLED_TILT_DEG
    near, far = order[rocking], order[~rocking]
    near = near[_extreme(points_m[near])]
    directions = _open_directions(hull)
    near = near[_core(points_m[near], directions, _CORE_SHARE * size_m)]
    both = np.concatenate([near, far])
    falling = _core(points_m[both], directions, _FALLING_CORE_SHARE * size_m, len(near))
    return points_m[both[falling]]


def _core(points_m: Array, directions: Array, tolerance_m: float, first: int = 0) -> NDArray[np.intp]:
    """Those of the points, in their order, that reach as far as all of them do, within a tolerance, and the first few.

    The distance of two convex bodies is the largest difference of their support functions (Schneider 2014,
    section 1.8), so points are taken, the one that misses most first, until none of the directions misses more.
    """
    farthest, whole = _farthest(points_m, directions)
    lowest = int(points_m[:, 2].argmin())
    chosen = {lowest, *range(first)}
    missing = whole - _farthest(points_m[sorted(chosen)], directions)[1]
    while missing.max() > tolerance_m:
        point = int(farthest[missing.argmax()])
        chosen.add(point)
        missing = np.minimum(missing, whole - directions @ points_m[point])
    return np.array(sorted(chosen))


def _farthest(points_m: Array, directions: Array) -> tuple[NDArray[np.intp], Array]:
    """Which of the points is farthest in each direction, and how far."""
    point, far = np.empty(len(directions), np.intp), np.empty(len(directions))
    for begin in range(0, len(directions), _AT_A_TIME):
        block = slice(begin, begin + _AT_A_TIME)
        reach = directions[block] @ points_m.T
        point[block], far[block] = reach.argmax(axis=1), reach.max(axis=1)
    return point, far


def _open_directions(hull: ConvexHull) -> Array:
    """Normals of the hull's facets, and a direction within each vertex's cone, up to the largest open tilt."""
    normals = hull.equations[:, :3]
    # Each flat face counts once at a vertex, however many triangles it has there.
    flat, face = np.unique(normals.round(9), axis=0, return_inverse=True)
    corners, at = np.unique(np.column_stack([hull.simplices.ravel(), np.repeat(face.ravel(), 3)]), axis=0).T
    around = flat[at]
    mean, lowest = np.zeros_like(hull.points), np.zeros_like(hull.points)
    np.add.at(mean, corners, around)
    by_height = np.argsort(-around[:, 2], kind="stable")
    lowest[corners[by_height]] = around[by_height]  # the last one written is the lowest
    mean, lowest = mean[hull.vertices], lowest[hull.vertices]
    cones = lowest + mean / np.linalg.norm(mean, axis=1)[:, None]
    cones /= np.linalg.norm(cones, axis=1)[:, None]
    directions = np.vstack([normals, cones, [[0.0, 0.0, -1.0]]])
    return directions[directions[:, 2] <= -np.cos(np.deg2rad(LARGEST_OPEN_TILT_DEG))]


def _angle_to_arc_deg(start: Array, end: Array) -> Array:
    """Angle between straight down and the nearest point of each great-circle arc between unit vectors."""
    cosine = np.maximum(-start[:, 2], -end[:, 2])
    pole = np.cross(start, end)
    length = np.linalg.norm(pole, axis=1)
    pole /= np.maximum(length, 1e-300)[:, None]
    nearest = np.array([0.0, 0.0, -1.0]) + pole[:, 2:3] * pole
    size = np.linalg.norm(nearest, axis=1)
    nearest /= np.maximum(size, 1e-300)[:, None]
    within = np.einsum("ij,ij->i", np.cross(start, nearest), pole) >= 0
    within &= np.einsum("ij,ij->i", np.cross(nearest, end), pole) >= 0
    on_arc = within & (length > 1e-12) & (size > 1e-12)
    cosine = np.where(on_arc, np.maximum(cosine, -nearest[:, 2]), cosine)
    return np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _extreme(corners: Array) -> Flags:
    """Which corners stand out of their facets: rounding makes hull vertices of points that lie in a flat face.

    A corner within 1e-7 of the size of the segment or triangle of its neighbours takes no load of its own, and would
    share the impulse of a landing that belongs to the true corner.
    """
    keep = np.ones(len(corners), bool)
    if len(corners) < 4:
        return keep
    scale = float(np.ptp(corners, axis=0).max())
    around = cKDTree(corners).query(corners, k=min(_NEIGHBOURS_LOOKED_AT, len(corners)))[1]
    for i in range(len(corners)):
        rest = around[i][keep[around[i]] & (around[i] != i)]
        if len(rest) < min(_NEIGHBOURS, keep.sum() - 1):
            rest = np.flatnonzero(keep & (np.arange(len(corners)) != i))
            rest = rest[np.argsort(np.linalg.norm(corners[rest] - corners[i], axis=1), kind="stable")]
        near = corners[rest[:_NEIGHBOURS]]
        keep[i] = not _inside_flat(corners[i], near, 1e-7 * scale)
    return keep


def _inside_flat(point: Array, around: Array, tolerance_m: float) -> bool:
    """Whether a point lies in the plane or line of its neighbours and within their convex hull."""
    offsets = around - point
    _, spread, axes = np.linalg.svd(offsets, full_matrices=False)
    if spread[-1] > tolerance_m * np.sqrt(len(around)):
        return False
    flat = offsets @ axes[: 2 if spread[1] > tolerance_m * np.sqrt(len(around)) else 1].T
    if flat.shape[1] == 1:
        return bool(flat.min() < -tolerance_m and flat.max() > tolerance_m)
    angles = np.sort(np.arctan2(flat[:, 1], flat[:, 0]))
    widest = np.diff(np.append(angles, angles[0] + 2 * np.pi)).max()
    return bool(widest <= np.pi + 1e-6)
