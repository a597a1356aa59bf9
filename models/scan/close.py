"""Closing: one closed body from the rock's surfels, its base on the interface plane.

The seen surface is joined by screened Poisson reconstruction (Kazhdan and Hoppe 2013). A side that no station saw goes
on level by level as the outlines that were seen do. Where the base is hidden, points sunk below it close it. The body
is cut at the convex hull of all of these, above which Poisson reconstruction lets an unseen crown bulge, and exactly
(Manifold) at the base, so that where the rock rests its vertices lie on the interface plane.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import manifold3d
import numpy as np
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError, cKDTree

from toppling.models.arrays import Array, Flags, Indices
from toppling.models.errors import InputError
from toppling.models.hidden_base.gap import Base
from toppling.models.hidden_base.near_interface import LEVELS, SidesSeen, UnseenSide
from toppling.models.rock import Rock
from toppling.models.scan import o3d
from toppling.models.scan.crevice import grid_triangles
from toppling.models.scan.interface import Interface, Sheet
from toppling.models.scan.surfels import LEVEL, Surfels

_LEAST_PATCHES = 40
_NEIGHBOURS = 9


def extended_side(base: UnseenSide, flat_m: Array, normals: Array, step_m: float) -> tuple[Array, Array]:
    """Places (k, 3) of the side above an unseen rim, u, v, h, and their outward normals, about a step apart.

    base: over whose unseen range the side is closed.
    flat_m, normals: (n, 3), of the rock's patches.
    """
    upright = normals[:, 2] < LEVEL
    side, sides = flat_m[upright], SidesSeen.of(flat_m, normals, base.middle_m)
    levels = np.linspace(side[:, 2].min(), side[:, 2].max(), LEVELS + 1)
    height_m, rings, directions = np.diff(levels)[0], [], []
    for low_m, high_m in pairwise(levels):
        patches = side[(side[:, 2] >= low_m) & (side[:, 2] < high_m)]
        around = _unseen(patches, normals[upright], sides.led_down(0.5 * (low_m + high_m)))
        if around is None:
            continue
        turn = np.arange(0.0, 2.0 * np.pi, step_m / around.radius_m)
        out = np.column_stack([np.cos(turn), np.sin(turn)])
        far = around.middle_m + 2.0 * around.radius_m * out
        places = around.middle_m + (far - around.middle_m) / around.share_out(far)[:, None]
        inside = around.in_range(far) & base.in_range(places)
        for up in np.arange(low_m, high_m, min(step_m, height_m)):
            rings.append(np.column_stack([places, np.full(len(places), up)])[inside])
            directions.append(out[inside])
    if not rings or not sum(map(len, rings)):
        return np.zeros((0, 3)), np.zeros((0, 3))
    places, direction = np.vstack(rings), np.vstack(directions)
    return places, _outward(places, direction)


def _unseen(patches_m: Array, normals: Array, led_down: Array) -> UnseenSide | None:
    """How the outline of a level goes on; None where it was seen around, or too little of it."""
    if len(patches_m) < _LEAST_PATCHES:
        return None
    try:
        return UnseenSide.of(patches_m * [1.0, 1.0, 0.0], normals, led_down)
    except QhullError:
        return None


def _outward(places_m: Array, direction: Array) -> Array:
    """Normals (k, 3) of planes through the neighbourhood of each place, on the side of a horizontal way (k, 2)."""
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(places_m))
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(_NEIGHBOURS))
    normals = np.array(cloud.normals)
    sense = np.sign((normals[:, :2] * direction).sum(axis=1))
    return normals * np.where(sense == 0.0, 1.0, sense)[:, None]


_POISSON_DEPTH = 7
"""Levels of the octree."""
_POISSON_SCALES = (1.15, 1.17, 1.2, 1.24)
"""Sizes of the octree's cube over the rock's, tried in turn: an unlucky grid tears the surface."""
_BULGES_PER_WIDTH = 0.2
"""A side that was not seen lies so near to the hull of what was: less than the corner of a square that is cut off over
the widest range of directions that may be missing. Stations that look up see what slopes; a crown that they do not see
is nearly level, and lies at the hull."""
_EDGE_VOXELS = 0.5
"""Margin of the hull, along the normals of what was seen: a sharp edge lies at most so far out of patches beside it."""
_SIMPLIFIED_SHARE_OF_HEIGHT = 0.0015
"""Triangles are joined where the surface moves by less than this: noise, not shape."""
_BASE_SHARE_OF_HEIGHT = 0.0003
"""Largest movement of the base's surface, whose shape decides how the rock rolls."""
_APART_SHARE_OF_HEIGHT = 1e-6
"""How far sheets that touch each other are drawn apart."""


@dataclass(frozen=True, eq=False)
class ClosedRock:
    """The rock and how much of its surface was seen."""

    rock: Rock
    # Shares of the surface: within two voxels of a surfel, on the interface plane, neither.
    seen_share: float
    closed_share: float
    invented_share: float
    # Of its crown, the surface that faces up: what was not seen, and lies at most at the hull of what was.
    crown_unseen_share: float


SHARES = ("seen_share", "closed_share", "invented_share", "crown_unseen_share")


def close_rock(surfels: Surfels, rock: Flags, base: Base, interface: Interface) -> ClosedRock:
    """Close the rock with its base.

    Raises InputError if the seen surface does not close to one body that reaches the interface.
    """
    flat, flat_normals = interface.flat(surfels.points_m[rock]), surfels.normals[rock] @ interface.axes
    above = interface.over(surfels.points_m[rock])[:, 2] > 0.0
    flat, flat_normals = flat[above], flat_normals[above]
    closes = base.hidden if base.passage is None else base.hidden & ~base.passage
    # As dense as the patches: the level at which the surface lies is the mean over all points.
    every = (slice(None, None, max(1, round(surfels.voxel_m / base.grid.cell_m))),) * 2
    within = base.grid.nodes_m[every][closes[every]]
    sunk = np.column_stack([within, base.height_m[every][closes[every]] - surfels.voxel_m])
    sunk += interface.rise(within)
    down = np.tile([0.0, 0.0, -1.0], (len(sunk), 1))
    height = float(np.ptp(flat[:, 2]))
    unseen, outward = np.zeros((0, 3)), np.zeros((0, 3))
    if base.side is not None:
        unseen, outward = extended_side(base.side, flat, flat_normals, 2.0 * surfels.voxel_m)
    smooth = _poisson(np.vstack([flat, sunk, unseen]), np.vstack([flat_normals, down, outward]))
    body = smooth.simplify(_SIMPLIFIED_SHARE_OF_HEIGHT * height)
    # Chords of a convex surface lie inside it: without this .2 % of the volume is lost.
    middle = flat.mean(axis=0)
    grown = (smooth.volume() / body.volume()) ** (1.0 / 3.0)
    body = body.translate(-middle).scale([grown] * 3).translate(middle)
    edges = flat + _EDGE_VOXELS * surfels.voxel_m * flat_normals
    body ^= about_hull(np.vstack([edges, sunk, unseen]), interface.axes[2])
    if interface.sheet is None:
        parts = (body ^ _above(base, flat, height)).simplify(_BASE_SHARE_OF_HEIGHT * height).decompose()
    else:  # the base keeps the lattice's nodes: draws move them
        parts = (body ^ _above_surface(base, flat, height, interface.sheet)).decompose()
    if not parts:
        raise _not_closed("the reconstructed surface lies below the interface")
    mesh = max(parts, key=lambda part: part.volume()).to_mesh64()
    vertices = np.array(mesh.vert_properties[:, :3], float)
    faces = np.array(mesh.tri_verts, np.int64)
    if interface.sheet is None:
        vertices[np.abs(vertices[:, 2]) < 1e-9 * height, 2] = 0.0
    vertices = _apart(vertices, faces, _APART_SHARE_OF_HEIGHT * height)
    try:
        rock_body = Rock.from_triangles(interface.scene(vertices), faces, where="closed rock")
    except InputError as error:
        raise _not_closed(
            f"the surface closed about what was seen is no body of a rock: {error.what}"
        ) from error
    on_plane = np.abs(vertices[:, 2] - interface.rise(vertices)[:, 2]) < 1e-9 * height
    if not on_plane.any():
        raise _not_closed("the reconstructed surface does not reach the interface")
    return ClosedRock(
        rock_body,
        *_areas(vertices[faces], np.asarray(on_plane[faces].all(axis=1)), flat, surfels.voxel_m, interface),
    )


def about_hull(places_m: Array, up: Array) -> manifold3d.Manifold:
    """The convex hull of places (n, 3), its crown as it is and the rest moved out by a share of its width."""
    planes = ConvexHull(places_m).equations
    bulge_m = _BULGES_PER_WIDTH * np.ptp(places_m[:, :2], axis=0).mean()
    planes[:, 3] -= np.where(planes[:, :3] @ up > LEVEL, 0.0, bulge_m)
    return manifold3d.Manifold.hull_points(HalfspaceIntersection(planes, places_m.mean(axis=0)).intersections)


def _apart(vertices: Array, faces: Indices, reach_m: float) -> Array:
    """Vertices, those of sheets that touch moved toward their own sheet: joined, they would be no closed body."""
    touching = np.unique(cKDTree(vertices).query_pairs(0.1 * reach_m, output_type="ndarray"))
    moved = vertices.copy()
    for vertex in touching:
        direction = vertices[faces[(faces == vertex).any(axis=1)]].mean(axis=(0, 1)) - vertices[vertex]
        moved[vertex] += reach_m * direction / max(float(np.linalg.norm(direction)), reach_m)
    return moved


def _above(base: Base, flat: Array, height_m: float) -> manifold3d.Manifold:
    """Everything above the base, as a body: its floor the base and, beyond it, the interface plane.

    It reaches two heights beyond the base, or as far as the rock's points and a quarter of its height.
    """
    first, last = base.grid.nodes_m[0, 0], base.grid.nodes_m[-1, -1]
    overhang = max(float((first - flat[:, :2]).max()), float((flat[:, :2] - last).max()))
    top_m = 2.0 * height_m
    reach = int(np.ceil(max(top_m, overhang + 0.25 * height_m) / base.grid.cell_m))
    steps = [np.concatenate([[-reach], np.arange(n), [n - 1 + reach]]) for n in base.grid.shape]
    u, v = np.meshgrid(
        *(first + step * base.grid.cell_m for first, step in zip(base.grid.first_m, steps, strict=True)),
        indexing="ij",
    )
    floor = np.pad(base.height_m, 1)
    floor[[0, 1, -2, -1]] = 0.0
    floor[:, [0, 1, -2, -1]] = 0.0
    return body_over(u, v, floor, top_m)


def _above_surface(base: Base, flat: Array, height_m: float, sheet: Sheet) -> manifold3d.Manifold:
    """Body above a base over a surface, its floor at the lattice's nodes; beyond it what was seen closes it."""
    stride = round(sheet.lattice_m / base.grid.cell_m)
    nodes = base.grid.nodes_m[::stride, ::stride]
    floor = base.height_m[::stride, ::stride] + sheet.at(nodes)
    overhang = max(float((nodes[0, 0] - flat[:, :2]).max()), float((flat[:, :2] - nodes[-1, -1]).max()), 0.0)
    low, high = float(flat[:, 2].min()) - height_m, float(flat[:, 2].max()) + height_m
    out = np.array([0.5 * sheet.lattice_m, overhang + height_m])
    u, v = (
        np.concatenate([axis[0] - out[::-1], axis, axis[-1] + out])
        for axis in (nodes[:, 0, 0], nodes[0, :, 1])
    )
    across, along = np.meshgrid(u, v, indexing="ij")
    return body_over(across, along, np.pad(floor, 2, constant_values=low), high)


def body_over(u: Array, v: Array, floor: Array, top_m: float) -> manifold3d.Manifold:
    """Body between a floor, given at the nodes of a grid, and a level top."""
    count = u.size
    nodes = np.column_stack([u.ravel(), v.ravel()])
    levels = floor.reshape(-1, 1), np.full((count, 1), top_m)
    vertices = np.vstack([np.hstack([nodes, level]) for level in levels])
    number = np.arange(count).reshape(u.shape)
    up = grid_triangles(u.shape)
    border = np.concatenate([number[:-1, 0], number[-1, :-1], number[:0:-1, -1], number[0, :0:-1]])
    after = np.roll(border, -1)
    corners = (border, after, after + count), (border, after + count, border + count)
    sides = np.concatenate([np.column_stack(columns) for columns in corners])
    faces = np.concatenate([up[:, ::-1], up + count, sides])
    return manifold3d.Manifold(manifold3d.Mesh64(vertices, faces.astype(np.uint64)))


def _poisson(points: Array, normals: Array) -> manifold3d.Manifold:
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    cloud.normals = o3d.utility.Vector3dVector(normals)
    for scale in _POISSON_SCALES:
        with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
            mesh, _ = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
                cloud, depth=_POISSON_DEPTH, scale=scale, n_threads=1
            )
        vertices, faces = _capped(np.asarray(mesh.vertices), np.asarray(mesh.triangles))
        body = manifold3d.Manifold(manifold3d.Mesh64(vertices, faces.astype(np.uint64)))
        if body.status() == manifold3d.Error.NoError and not body.is_empty():
            return body
    raise _not_closed(f"the reconstructed surface is no closed body ({body.status().name})")


def _capped(vertices: Array, faces: Indices) -> tuple[Array, Indices]:
    """Mesh with its open loops, cracks between the octree's levels, closed by fans about their centres."""
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    forward, backward = directed @ [len(vertices), 1], directed @ [1, len(vertices)]
    open_edges = directed[~np.isin(forward, backward)]
    following = {int(b): int(a) for a, b in open_edges}
    new_vertices, new_faces = [np.asarray(vertices, float)], [faces.astype(np.int64)]
    count = len(vertices)
    while following:
        loop = [next(iter(following))]
        while loop[-1] in following:
            loop.append(following.pop(loop[-1]))
        ring = np.array(loop[:-1])
        new_vertices.append(vertices[ring].mean(axis=0)[None])
        new_faces.append(np.column_stack([ring, np.roll(ring, -1), np.full(len(ring), count)]))
        count += 1
    return np.concatenate(new_vertices), np.concatenate(new_faces)


def _areas(
    corner: Array, on_plane: Flags, seen: Array, voxel_m: float, interface: Interface
) -> tuple[float, float, float, float]:
    """Shares as of a closed rock, of triangles (n, 3, 3) as u, v, h."""
    twice = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    area = 0.5 * np.linalg.norm(twice, axis=1)
    crown = twice @ interface.axes[2] > 2.0 * LEVEL * area
    near = cKDTree(seen).query(corner.mean(axis=1))[0] < 2.0 * voxel_m
    seen_m2, closed_m2, crown_m2 = area[near & ~on_plane].sum(), area[on_plane].sum(), area[crown].sum()
    fractions = np.array([seen_m2, closed_m2, area[~near & ~on_plane].sum()]) / area.sum()
    unseen_crown = area[crown & ~near].sum() / crown_m2 if crown_m2 else 0.0
    return float(fractions[0]), float(fractions[1]), float(fractions[2]), float(unseen_crown)


def _not_closed(what: str) -> InputError:
    return InputError(
        "scan.not_closed",
        what,
        where="closing the rock",
        expected="a rock seen from several sides",
        remedy="add stations on the sides that none saw, or check the segmentation in the scene's picture",
    )
