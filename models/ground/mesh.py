"""Triangle meshes prepared for contact: which edges and vertices stand out, and which triangles lie near a place."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from toppling.models.compiled import Array, Flags, Indices, Vector, compiled, inner
from toppling.models.errors import InputError
from toppling.models.ground.vectors import cross, dot, minus, plus

_CELLS = 40
"""Cells of the grid along the longest side of what is looked up, or more, that none is longer than the reach."""

_FLAT_SHARE = 1e-6
"""Sine of the angle between two triangles up to which they are one face."""


class ContactMesh(NamedTuple):
    """A mesh, its features, and a grid of the triangles and edges near each cell. All compiled code reads it.

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
        For each of these, unit vectors in its triangles, away from it; of an edge of one triangle twice the same.
    origin_m, cell_m, shape
        The grid.
    first, near : int arrays
        Triangles near cell c: near[first[c]:first[c + 1]].
    first_edge, near_edges : int arrays
        The same of `edges`.
    """

    vertices_m: Array
    faces: Indices
    normals: Array
    offsets_m: Array
    middles_m: Array
    radii_m: Array
    edge_of: Indices
    triangles_at_edge: Indices
    triangles_at_vertex: Indices
    points: Indices
    first_way: Indices
    ways: Array
    edges: Indices
    edge_middles_m: Array
    edge_halves_m: Array
    inward: Array
    origin_m: Array
    cell_m: float
    shape: Indices
    first: Indices
    near: Indices
    first_edge: Indices
    near_edges: Indices


_NONE = np.zeros((0, 3), np.int64)

NO_MESH = ContactMesh(
    np.zeros((0, 3)), _NONE, np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3)), np.zeros(0), _NONE, _NONE[:, 0].copy(),
    _NONE[:, 0].copy(), _NONE[:, 0].copy(), np.zeros(1, np.int64), np.zeros((0, 3)), _NONE[:, :2].copy(),
    np.zeros((0, 3)), np.zeros(0), np.zeros((0, 2, 3)), np.zeros(3), 1.0, np.ones(3, np.int64), np.zeros(2, np.int64),
    _NONE[:, 0].copy(), np.zeros(2, np.int64), _NONE[:, 0].copy(),
)  # fmt: skip
"""That of a body which touches with no mesh."""


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
        Box in which it is looked up; triangles outside of it are left out.
    reach_m : float
        Triangles and edges so near a place are found there.
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
    edge_of, ends, shares = _edges(faces)
    stands_out, inward = _convexity(vertices, faces, normals, edge_of, shares)
    if touching is not None:
        stands_out &= touching[used][ends].all(axis=1)
    low, high = (
        np.maximum(low_m, vertices.min(axis=0)) - reach_m,
        np.minimum(high_m, vertices.max(axis=0)) + reach_m,
    )
    cell = min(float((high - low).max()) / _CELLS, reach_m)
    shape = np.maximum(np.ceil((high - low) / cell).astype(np.int64), 1)
    first, near = _register(corners, low, cell, shape, reach_m)
    kept = ends[stands_out]
    first_edge, near_edges = _register(vertices[kept][:, [0, 1, 1]], low, cell, shape, reach_m)
    start, end = vertices[kept[:, 0]], vertices[kept[:, 1]]
    points = np.unique(kept)
    return ContactMesh(
        vertices, faces, normals, offsets, middles, radii, edge_of, shares,
        np.bincount(faces.ravel(), minlength=len(vertices)), points, *_ways(vertices, ends, points),
        kept, 0.5 * (start + end), 0.5 * np.linalg.norm(end - start, axis=1), inward[stands_out],
        low, cell, shape, first, near, first_edge, near_edges,
    )  # fmt: skip


def not_touching(within_m: float) -> InputError:
    """The refusal of a rock that is farther from the ground than `within_m`, or as deep in it."""
    return InputError(
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
    vertices: Array, faces: Indices, normals: Array, edge_of: Indices, shares: Indices
) -> tuple[Flags, Array]:
    """Which edges stand out (are convex, or bound the mesh), and the unit vectors (e, 2, 3) into their triangles."""
    way = vertices[np.roll(faces, -1, axis=1)] - vertices[faces]  # (m, 3, 3)
    inward = np.cross(normals[:, None, :], way)
    inward /= np.linalg.norm(inward, axis=2)[:, :, None]
    first, last = sides_at_edges(edge_of, shares).T
    flat_inward, flat_normal = inward.reshape(-1, 3), np.repeat(normals, 3, axis=0)
    both = np.stack([flat_inward[first], flat_inward[last]], axis=1)
    opens = (flat_inward[last] * flat_normal[first]).sum(axis=1) < -_FLAT_SHARE
    return opens | (shares == 1), both


def sides_at_edges(edge_of: Indices, triangles_at_edge: Indices) -> Indices:
    """Sides (e, 2) of the first and the last triangle at each edge; side k of triangle t is 3 t + k."""
    order = np.argsort(edge_of.ravel(), kind="stable")
    end = np.cumsum(triangles_at_edge)
    return order[np.column_stack([end - triangles_at_edge, end - 1])]


def normals_beside_edges(mesh: ContactMesh) -> Array:
    """Normals (k, 2, 3) of the triangles beside each of a mesh's `edges`, as `inward` has them."""
    sides = sides_at_edges(mesh.edge_of, mesh.triangles_at_edge)
    triangle, corner = np.divmod(sides[:, 0], 3)
    ends = np.sort(
        np.column_stack([mesh.faces[triangle, corner], mesh.faces[triangle, (corner + 1) % 3]]), axis=1
    )
    name, sought = (pair[:, 0] * len(mesh.vertices_m) + pair[:, 1] for pair in (ends, mesh.edges))
    return mesh.normals[sides[np.searchsorted(name, sought)] // 3]


def _ways(vertices: Array, ends: Indices, points: Indices) -> tuple[Indices, Array]:
    """Unit vectors from some vertices along their edges, vertex after vertex, and where those of each begin."""
    both = np.vstack([ends, ends[:, ::-1]])
    both = both[np.argsort(both[:, 0], kind="stable")]
    number = np.full(len(vertices), -1)
    number[points] = np.arange(len(points))
    both = both[number[both[:, 0]] >= 0]
    way = vertices[both[:, 1]] - vertices[both[:, 0]]
    first = np.searchsorted(number[both[:, 0]], np.arange(len(points) + 1))
    return first.astype(np.int64), way / np.linalg.norm(way, axis=1)[:, None]


@compiled(allocates=True)
def _register(
    corners: Array, low: Array, cell: float, shape: Indices, reach_m: float
) -> tuple[Indices, Indices]:
    """For each cell the triangles (m, 3, 3) within a reach of it: by their boxes, and by their planes or lines."""
    # Counted one cell further on, then summed: where each cell begins moves on as it is filled, to where it ends.
    first = np.zeros(shape[0] * shape[1] * shape[2] + 2, np.int64)
    near = np.zeros(0, np.int64)
    begin, end = np.zeros(3, np.int64), np.zeros(3, np.int64)
    far_m = reach_m + 0.5 * math.sqrt(3.0) * cell
    for fills in (False, True):
        if fills:
            for number in range(1, len(first)):
                first[number] += first[number - 1]
            near = np.zeros(first[-1], np.int64)
        for owner in range(len(corners)):
            of = corners[owner]
            for k in range(3):
                least, most = min(of[0, k], of[1, k], of[2, k]), max(of[0, k], of[1, k], of[2, k])
                begin[k] = min(max(math.floor((least - reach_m - low[k]) / cell), 0), shape[k] - 1)
                end[k] = min(max(math.floor((most + reach_m - low[k]) / cell), 0), shape[k] - 1)
            for x in range(begin[0], end[0] + 1):
                for y in range(begin[1], end[1] + 1):
                    for z in range(begin[2], end[2] + 1):
                        middle = (
                            low[0] + (x + 0.5) * cell,
                            low[1] + (y + 0.5) * cell,
                            low[2] + (z + 0.5) * cell,
                        )
                        if not _is_near(of, middle, far_m):
                            continue
                        number = (x * shape[1] + y) * shape[2] + z
                        if fills:
                            near[first[number + 1]] = owner
                            first[number + 1] += 1
                        else:
                            first[number + 2] += 1
    return first[:-1].copy(), near


@inner
def _is_near(corners: Array, place: Vector, far_m: float) -> bool:
    """Whether a place lies within a distance of a triangle's plane, or of its line where it is one."""
    way, other, offset = (
        minus(corners[1], corners[0]),
        minus(corners[2], corners[0]),
        minus(place, corners[0]),
    )
    normal = cross(way, other)
    size = math.sqrt(dot(normal, normal))
    if size > 0.0:
        return abs(dot(offset, normal)) <= far_m * size
    share = min(max(dot(offset, way) / dot(way, way), 0.0), 1.0)
    aside = plus(offset, -share, way)
    return dot(aside, aside) <= far_m * far_m
