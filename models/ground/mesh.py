"""Triangle meshes prepared for contact: which edges and vertices stand out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from toppling.models.compiled import Array, Flags, Indices
from toppling.models.errors import InputError
from toppling.models.ground.boxes import Boxes, boxes_around
from toppling.models.shapes import joined_parts

_FINE_SHARE, _SMOOTH_TURN = 0.02, np.cos(np.radians(4.0))
"""Of R: triangles so narrow across an edge, between which normals turn by so little, stand for one smooth surface."""

_FLAT_SHARE = 1e-6
"""Sine of the angle between two triangles up to which they are one face."""


class ContactMesh(NamedTuple):
    """A mesh, its features, and boxes around its triangles and edges. All compiled code reads it.

    Parameters
    ----------
    vertices_m : (n, 3) array
    faces : (m, 3) int array
        Counter-clockwise seen from the free side.
    normals : (m, 3) array
        Unit, toward the free side.
    offsets_m : (m,) array
        Of the triangles' planes from the origin, along their normals.
    middles_m, radii_m : (m, 3) array, (m,) array
        Spheres around the triangles.
    edge_of : (m, 3) int array
        Edge opposite to none: edge k of a triangle joins its corners k and k + 1.
    triangles_at_edge : (e,) int array
        One or two.
    over_hollow : (m, 3) int array
        The triangle across each of a triangle's edges that lie in a hollow, -1 across any other. Near such an edge what
        is free lies above the planes of both.
    triangles_at_vertex : (n,) int array
    points : (p,) int array
        Vertices that can touch another body's faces: all but those in a face, a crease or a hollow.
    first_way, ways : (p + 1,) int array, (w, 3) array
        Unit vectors from point i to its neighbours: ways[first_way[i]:first_way[i + 1]].
    edges : (k, 2) int array
        Vertices of the edges that can touch another body's edges.
    edge_middles_m, edge_halves_m : (k, 3) array, (k,) array
        Spheres around these.
    inward : (k, 2, 3) array
        For each of these, unit vectors in its triangles, away from it; where the mesh ends the second leads down, as
        in a wall.
    ends : (n,) bool array
        Vertices at which the mesh ends: beside them nothing is inside.
    smooth_points, smooth_edges : (p,), (k,) int arrays
        Of those within one smooth part the first; -1 of any other.
    near_triangles, near_edges : Boxes
        By which triangles and `edges` near a place are found.
    """

    vertices_m: Array
    faces: Indices
    normals: Array
    offsets_m: Array
    middles_m: Array
    radii_m: Array
    edge_of: Indices
    triangles_at_edge: Indices
    over_hollow: Indices
    triangles_at_vertex: Indices
    points: Indices
    first_way: Indices
    ways: Array
    edges: Indices
    edge_middles_m: Array
    edge_halves_m: Array
    inward: Array
    ends: Flags
    smooth_points: Indices
    smooth_edges: Indices
    near_triangles: Boxes
    near_edges: Boxes


_NONE = np.zeros((0, 3), np.int64)

NO_MESH = ContactMesh(
    np.zeros((0, 3)), _NONE, np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3)), np.zeros(0), _NONE, _NONE[:, 0].copy(),
    _NONE, _NONE[:, 0].copy(), _NONE[:, 0].copy(), np.zeros(1, np.int64), np.zeros((0, 3)),
    _NONE[:, :2].copy(), np.zeros((0, 3)), np.zeros(0), np.zeros((0, 2, 3)), np.zeros(0, bool),
    _NONE[:, 0].copy(), _NONE[:, 0].copy(), *2 * [boxes_around(np.zeros((0, 2, 3)))],
)  # fmt: skip
"""Mesh of a body that touches with none."""


def contact_mesh(
    vertices_m: Array,
    faces: NDArray[np.int64],
    low_m: Array,
    high_m: Array,
    reach_m: float,
    touching: Flags | None = None,
) -> ContactMesh:
    """Prepare a mesh.

    Parameters
    ----------
    vertices_m : (n, 3) array
    faces : (m, 3) int array
    low_m, high_m : (3,) arrays
        Box in which it is looked up.
    reach_m : float
        Triangles farther from it are left out.
    touching : (n,) bool array, optional
        Vertices that may be points and ends of edges that touch: all unless given.

    Raises
    ------
    InputError
        If no triangle lies in the box.
    """
    vertices, faces, used = _within(vertices_m, faces, low_m - reach_m, high_m + reach_m)
    if len(faces) == 0:
        raise not_touching(reach_m)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    offsets = (normals * corners[:, 0]).sum(axis=1)
    middles = corners.mean(axis=1)
    radii = np.linalg.norm(corners - middles[:, None], axis=2).max(axis=1)
    edge_of, ends, owners = _edges(faces)
    stands_out, over_hollow, inward = _convexity(vertices, faces, normals, edge_of, owners)
    if touching is not None:
        stands_out &= touching[used][ends].all(axis=1)
    touching_ends = ends[stands_out]
    start, end = vertices[touching_ends[:, 0]], vertices[touching_ends[:, 1]]
    points = np.unique(touching_ends)
    return ContactMesh(
        vertices, faces, normals, offsets, middles, radii, edge_of, owners, over_hollow,
        np.bincount(faces.ravel(), minlength=len(vertices)), points, *_ways(vertices, ends, points),
        touching_ends, 0.5 * (start + end), 0.5 * np.linalg.norm(end - start, axis=1), inward[stands_out],
        np.isin(np.arange(len(vertices)), ends[owners == 1]),
        np.full(len(points), -1), np.full(len(touching_ends), -1),
        boxes_around(corners), boxes_around(vertices[touching_ends]),
    )  # fmt: skip


def not_touching(within_m: float) -> InputError:
    """The refusal of a rock that is farther from the ground than `within_m`, or as deep in it."""
    return InputError(
        "rock.apart_from_pedestal",
        "the rock does not touch the ground",
        where="scene",
        expected=f"a rock within {within_m:.3g} m of its pedestal's surface",
        remedy="give rock and pedestal in one frame, the rock as it stands",
    )


def _within(
    vertices_m: Array, faces: NDArray[np.int64], low_m: Array, high_m: Array
) -> tuple[Array, NDArray[np.int64], Indices]:
    """The triangles that meet a box, without those of no area, and which vertices these have."""
    corners = vertices_m[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    longest = np.ptp(corners, axis=1).max(axis=1)
    meets = ((corners.min(axis=1) <= high_m) & (corners.max(axis=1) >= low_m)).all(axis=1)
    faces = faces[meets & (area > 1e-12 * longest**2)]
    used, faces = np.unique(faces, return_inverse=True)
    return np.ascontiguousarray(vertices_m[used], float), faces.reshape(-1, 3).astype(np.int64), used


def _edges(faces: Indices) -> tuple[Indices, Indices, Indices]:
    """Number of each triangle's edges (m, 3), their ends (e, 2), and of how many triangles they are."""
    a, b = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    vertices = int(faces.max(initial=0)) + 1
    name = np.minimum(a, b) * vertices + np.maximum(a, b)
    unique, number, count = np.unique(name, return_inverse=True, return_counts=True)
    return number.reshape(-1, 3), np.column_stack(np.divmod(unique, vertices)), count


def _convexity(
    vertices: Array, faces: Indices, normals: Array, edge_of: Indices, owners: Indices
) -> tuple[Flags, Indices, Array]:
    """Which edges stand out (are convex, or bound the mesh), which triangles lie across hollows, ways into triangles.

    The second as :class:`ContactMesh` has it; the last are unit vectors (e, 2, 3), two at each edge.
    """
    along = vertices[np.roll(faces, -1, axis=1)] - vertices[faces]  # (m, 3, 3)
    inward = np.cross(normals[:, None, :], along)
    inward /= np.linalg.norm(inward, axis=2)[:, :, None]
    first, last = sides_at_edges(edge_of, owners).T
    flat_inward, flat_normal = inward.reshape(-1, 3), np.repeat(normals, 3, axis=0)
    both = np.stack([flat_inward[first], flat_inward[last]], axis=1)
    both[owners == 1, 1] = -flat_normal[first[owners == 1]]
    rises = (flat_inward[last] * flat_normal[first]).sum(axis=1)
    hollow, over = rises > _FLAT_SHARE, np.full(faces.size, -1)
    over[first[hollow]], over[last[hollow]] = last[hollow] // 3, first[hollow] // 3
    return (rises < -_FLAT_SHARE) | (owners == 1), over.reshape(-1, 3), both


def sides_at_edges(edge_of: Indices, triangles_at_edge: Indices) -> Indices:
    """Sides (e, 2) of the first and the last triangle at each edge; side k of triangle t is 3 t + k."""
    order = np.argsort(edge_of.ravel(), kind="stable")
    end = np.cumsum(triangles_at_edge)
    return order[np.column_stack([end - triangles_at_edge, end - 1])]


def normals_at_edges(mesh: ContactMesh) -> Array:
    """Normals (k, 2, 3) of the triangles beside each of a mesh's `edges`, as `inward` has them."""
    triangles, _, number = _all_edges(mesh)
    return mesh.normals[triangles[number]]


def _all_edges(mesh: ContactMesh) -> tuple[Indices, Indices, Indices]:
    """Triangles (e, 2) beside all edges, their ends and the corners across (e, 2, 3); numbers of the mesh's `edges`."""
    triangles, side = np.divmod(sides_at_edges(mesh.edge_of, mesh.triangles_at_edge), 3)
    corners = np.stack([mesh.faces[triangles, (side + k) % 3] for k in range(3)], axis=2)
    name, sought = (
        pair.min(axis=1) * len(mesh.vertices_m) + pair.max(axis=1) for pair in (corners[:, 0, :2], mesh.edges)
    )
    return triangles, corners, np.searchsorted(name, sought)


def smooth_parts(mesh: ContactMesh, size_m: float) -> ContactMesh:
    """The mesh of a body, with the points and edges numbered that lie within its smooth parts.

    Where triangles are fine and their normals turn smoothly they stand for a surface that touches with one place, which
    moves over it. Other edges and points touch on their own.
    """
    triangles, corners, number = _all_edges(mesh)
    start, end, far = np.moveaxis(mesh.vertices_m[corners], 2, 0)
    width = np.linalg.norm(np.cross(end - start, far - start), axis=2) / np.linalg.norm(end - start, axis=2)
    turn = (mesh.normals[triangles[:, 0]] * mesh.normals[triangles[:, 1]]).sum(axis=1)
    smooth = (
        (mesh.triangles_at_edge == 2) & (turn >= _SMOOTH_TURN) & (width.max(axis=1) <= _FINE_SHARE * size_m)
    )
    part = joined_parts(triangles[smooth], len(mesh.faces))
    part_at = np.zeros(len(mesh.vertices_m), np.int64)
    part_at[mesh.faces] = part[:, None]
    at_points = np.where(np.isin(mesh.points, corners[~smooth, 0, :2]), -1, part_at[mesh.points])
    at_edges = np.where(smooth[number], part[triangles[number, 0]], -1)
    return mesh._replace(smooth_points=_first_of_parts(at_points), smooth_edges=_first_of_parts(at_edges))


def _first_of_parts(parts: Indices) -> Indices:
    """For each of some numbers of parts where its part is first; -1 stays."""
    _, first, inverse = np.unique(parts, return_index=True, return_inverse=True)
    return np.where(parts < 0, -1, first[inverse])


def _ways(vertices: Array, ends: Indices, points: Indices) -> tuple[Indices, Array]:
    """Unit vectors from some vertices along their edges, vertex after vertex, and where those of each begin."""
    both = np.vstack([ends, ends[:, ::-1]])
    both = both[np.argsort(both[:, 0], kind="stable")]
    number = np.full(len(vertices), -1)
    number[points] = np.arange(len(points))
    both = both[number[both[:, 0]] >= 0]
    along = vertices[both[:, 1]] - vertices[both[:, 0]]
    first = np.searchsorted(number[both[:, 0]], np.arange(len(points) + 1))
    return first.astype(np.int64), along / np.linalg.norm(along, axis=1)[:, None]
