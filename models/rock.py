"""The rock: a closed surface with the mass properties of a homogeneous body."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from toppling.models.arrays import Array
from toppling.models.errors import InputError, refusals
from toppling.models.lengths import explaining_units

_ROCK_HEIGHTS_M = (0.02, 100.0)
"""Range of heights, from stones on a shaking table to the tallest balanced rocks, m: outside it units are wrong."""
COARSEST_PER_HEIGHT = 1e-2
"""Maximum step of a rock's coordinates, as a fraction of its height: coarser ones lose the shape."""
_FAR_SIZES = 100.0
"""Distance from the origin, in diagonals, beyond which a mesh is integrated about a nearby point: moments grow with the
fourth power of the distance, at this one the inertia loses 3e-10, in survey coordinates all digits."""
_FARTHEST_M = 1e8
"""Maximum absolute coordinate, m: larger than any survey coordinates, including geocentric ones."""


mesh_error = refusals(
    expected="one closed body of triangles, oriented outward, in metres",
    remedy="export the rock alone, closed and with all normals outward, or make the scene with 'toppling scan'",
)


@dataclass(frozen=True, eq=False)
class Rock:
    """A closed, outward-oriented triangle mesh and its mass properties at unit density.

    The motion of a homogeneous rigid body is independent of its density: inertia is given per mass.
    """

    vertices_m: Array  # (n, 3): vertices in the scene frame, metres
    faces: NDArray[np.int64]  # (m, 3): triangles, counter-clockwise seen from outside
    volume_m3: float
    com_m: Array  # (3,): centre of mass, scene frame
    # (3, 3): inertia tensor over mass, about the centre of mass, scene axes.
    inertia_per_mass_m2: Array
    # (k, 3): points that can touch the interface plane, scene frame, of drawn bases (`models.hidden_base.unseen_base`);
    # None where contact is between the meshes.
    feet_m: Array | None = None

    @classmethod
    def from_triangles(cls, vertices_m: ArrayLike, faces: ArrayLike, *, where: str = "rock mesh") -> "Rock":
        """Rock from a closed triangle mesh; coincident vertices are merged, mass properties integrated exactly.

        Raises InputError if it is not oriented, closed or one body, too thin for a usable inertia, or too coarse.
        """
        mesh = joined_mesh(vertices_m, faces, where)
        _check_steps(np.asarray(vertices_m, float), where)
        if len(mesh.faces) < 4:
            raise mesh_error("mesh.encloses_nothing", f"{len(mesh.faces)} triangles enclose nothing", where)
        if not mesh.is_watertight:
            once = np.bincount(mesh.edges_unique_inverse)
            what = f"the mesh is open: {int((once != 2).sum())} edges do not join two triangles"
            raise mesh_error("mesh.open", what, where)
        if not mesh.is_winding_consistent:
            raise mesh_error("mesh.not_oriented", "triangles are not consistently oriented", where)
        if mesh.body_count != 1:
            raise mesh_error("mesh.several_bodies", f"{mesh.body_count} separate bodies", where)
        vertices, origin = np.array(mesh.vertices, float), nearby_origin_m(mesh.vertices)
        if origin.any():
            mesh.apply_translation(-origin)
        if mesh.volume < 0:
            mesh.invert()
        extent = float(np.prod(mesh.extents))
        if not mesh.volume > 1e-9 * extent:
            raise mesh_error("mesh.encloses_nothing", f"the enclosed volume is {mesh.volume:.3g} m3", where)
        inertia = np.array(mesh.moment_inertia, float) / float(mesh.volume)
        least = float(np.linalg.eigvalsh(inertia)[0])
        if not least > 0.0:
            what = f"the least moment of inertia over mass is {least:.3g} m2"
            raise mesh_error("mesh.moment_unusable", what, where)
        return cls(
            vertices_m=vertices,
            faces=np.array(mesh.faces, np.int64),
            volume_m3=float(mesh.volume),
            com_m=np.array(mesh.center_mass, float) + origin,
            inertia_per_mass_m2=inertia,
        )

    def moved(self, rotation: ArrayLike, translation_m: ArrayLike = (0.0, 0.0, 0.0)) -> "Rock":
        """Rock rotated about the origin by a (3, 3) matrix and then shifted by `translation_m`."""
        turn = np.asarray(rotation, float)
        shift = np.asarray(translation_m, float)
        return Rock(
            vertices_m=self.vertices_m @ turn.T + shift,
            faces=self.faces,
            volume_m3=self.volume_m3,
            com_m=turn @ self.com_m + shift,
            inertia_per_mass_m2=turn @ self.inertia_per_mass_m2 @ turn.T,
            feet_m=None if self.feet_m is None else self.feet_m @ turn.T + shift,
        )

    def principal_axes(self, frame: ArrayLike) -> tuple[Array, Array]:
        """Principal moments (3,) of inertia over mass, ascending, and right-handed axes (columns) in a frame.

        frame: (3, 3), its axes as columns, scene frame.
        """
        turn = np.asarray(frame, float)
        moments, axes = np.linalg.eigh(turn.T @ self.inertia_per_mass_m2 @ turn)
        if np.linalg.det(axes) < 0:
            axes[:, 0] *= -1.0
        return moments, axes

    @property
    def height_m(self) -> float:
        """Vertical extent in the pose of the scene."""
        return float(np.ptp(self.vertices_m[:, 2]))

    @cached_property
    def half_diagonal_m(self) -> float:
        """Distance from the centre of mass to the farthest point of the lower half of the convex hull.

        For a rectangular block this is R in the literature on rocking, the distance from centre to corner.
        """
        below = self.hull_vertices_m[self.hull_vertices_m[:, 2] <= self.com_m[2]]
        return float(np.linalg.norm(below - self.com_m, axis=1).max())

    @cached_property
    def hull_vertices_m(self) -> Array:
        """Vertices of the convex hull, scene frame: the only points that can touch a plane."""
        return np.array(trimesh.Trimesh(self.vertices_m, self.faces, process=False).convex_hull.vertices)


def nearby_origin_m(vertices_m: Array) -> Array:
    """Origin (3,) near a mesh that lies far from its own, at its lowest height; zero for a mesh near its origin."""
    low, high = vertices_m.min(axis=0), vertices_m.max(axis=0)
    if np.linalg.norm(0.5 * (low + high)) <= _FAR_SIZES * np.linalg.norm(high - low):
        return np.zeros(3)
    # Whole metres in plan, so that the subtraction is exact.
    return np.append(np.floor(0.5 * (low + high))[:2], low[2])


def joined_mesh(vertices_m: ArrayLike, faces: ArrayLike, where: str) -> trimesh.Trimesh:
    """A mesh whose triangles share their vertices and occur once; InputError if it is none."""
    check_triangles(vertices_m, faces, where)
    mesh = trimesh.Trimesh(np.asarray(vertices_m, float), np.asarray(faces, np.int64), process=False)
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    # A degenerate triangle of three collinear vertices connects its neighbours, and keeps the mesh closed.
    joins_three = (mesh.faces != np.roll(mesh.faces, 1, axis=1)).all(axis=1)
    mesh.update_faces(joins_three & mesh.unique_faces())
    mesh.remove_unreferenced_vertices()
    return mesh


def check_triangles(vertices_m: ArrayLike, faces: ArrayLike, where: str) -> None:
    """Raise InputError for wrong shapes, coordinates not finite or beyond `_FARTHEST_M`, or indices out of range."""
    try:
        vertices, triangles = np.asarray(vertices_m, float), np.asarray(faces)
    except (TypeError, ValueError) as error:
        what = f"vertices or triangles are no array of numbers ({error})"
        raise mesh_error("mesh.not_numbers", what, where) from None
    if vertices.ndim != 2 or vertices.shape[1] != 3 or triangles.ndim != 2 or triangles.shape[1] != 3:
        what = f"vertices and triangles have shapes {vertices.shape} and {triangles.shape}"
        raise mesh_error("mesh.shape_unusable", what, where)
    if not np.isfinite(vertices).all():
        raise mesh_error("mesh.not_finite", "vertex coordinates are not all finite", where)
    if np.abs(vertices).max(initial=0.0) > _FARTHEST_M:
        what = f"a vertex lies {np.abs(vertices).max():.3g} m from the origin"
        raise mesh_error("mesh.too_far", what, where)
    if triangles.dtype.kind not in "iuf" or (triangles != np.floor(triangles)).any():
        raise mesh_error("mesh.index_not_whole", "the corners of its triangles are no whole numbers", where)
    wrong = ((triangles < 0) | (triangles >= len(vertices))).any(axis=1)
    if wrong.any():
        raise mesh_error(
            "mesh.index_out_of_range",
            f"triangle {int(wrong.argmax())} joins the vertices {', '.join(map(str, triangles[wrong.argmax()]))}, "
            f"where there are {len(vertices)}",
            where,
        )


def check_size(height_m: float, where: str, option: str = "--units") -> None:
    """Raise InputError if a rock's height is implausible in metres; `option` is the one that states the unit."""
    least, most = _ROCK_HEIGHTS_M
    if not least <= height_m <= most:
        raise InputError(
            "rock.height_out_of_range",
            f"the rock is {height_m:.4g} m high",
            where=where,
            expected=f"a rock of {least} to {most:.0f} m: coordinates in metres",
            remedy=f"in {readings} it would be a rock: convert the coordinates, or give their unit by {option}"
            if (readings := explaining_units(height_m))
            else "convert the coordinates from millimetres, feet or whatever they are in, and export again",
        )


def _check_steps(vertices: Array, where: str) -> None:
    """Raise InputError if coordinates in single precision are so large that their steps lose the rock's shape."""
    single, height_m = vertices.astype(np.float32), float(np.ptp(vertices[:, 2])) if len(vertices) else 0.0
    step_m = float(np.spacing(np.abs(single).max(initial=0.0))) if (single == vertices).all() else 0.0
    if step_m > COARSEST_PER_HEIGHT * height_m > 0.0:
        raise InputError(
            "coordinates.too_coarse",
            f"coordinates are in single precision, in steps of {step_m:.3g} m, and the rock is {height_m:.3g} m high",
            where=where,
            expected=f"steps of at most {COARSEST_PER_HEIGHT * height_m:.2g} m",
            remedy="export again in double precision, or with an offset taken away",
        )


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses of a rock relative to its pedestal."""

    time_s: Array  # (n,)
    position_m: Array  # (n, 3): centre of mass, scene frame
    # (n, 4): rotation to the current pose in scene axes, from the pose in which the rock was seated, or from that of
    # the scene if its start was given.
    quaternion_xyzw: Array
