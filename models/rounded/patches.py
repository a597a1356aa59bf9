"""The smooth surface of a rounded base as quadratic patches, and where it is farthest in a direction.

A patch is the quadratic through the corners of a triangle and the middles of its edges. Along a direction it is a
quadratic of two shares, whose greatest value is known in closed form: the point with which a body touches a plane.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import ConvexHull

from toppling.models.arrays import Array, Flags, Indices
from toppling.models.joined import joined_parts
from toppling.models.kept import kept
from toppling.models.rock import Rock
from toppling.models.rounded.smooth_mesh import FALLEN_DEG, SmoothMesh

_LARGEST_TURN_DEG = 4.0
"""Patches that turn by more from one to the next are halved."""

_MOST_FACES = 20_000
"""Finer meshes are not made: they cost time of preparing, and none of a shake."""

_AT_ONCE = 2048
"""Directions whose products with all vertices are worked out together."""

_ROUNDS = 6
"""Patches through which a point is followed to where it is farthest."""

SINGULAR = 1e-9
"""Share of its size to which the determinant of a patch's curvature vanishes: it is curved in one direction only."""


@dataclass(frozen=True, eq=False)
class Patches:
    """The surface of a rock with a rounded base: patches, and the points that can touch a plane beside them.

    vertices_m: (n, 3), of the mesh, as many as the patches need.
    corners: (k, 3) int, vertices of each patch.
    bulges_m: (k, 3, 3), four times the way from the middle of the chord of edge k, from corner k to the next, to that
    of its curve.
    beside: (k, 3) int, patch across each edge; -1 where the rounded part ends.
    sharp: (k, 3) bool, edges at which it ends in a crease.
    points: (p,) int, vertices that can touch a plane and lie within no rounded part.
    """

    vertices_m: Array
    corners: Indices
    bulges_m: Array
    beside: Indices
    sharp: Flags
    points: Indices

    @cached_property
    def around(self) -> tuple[Indices, Indices]:
        """Patches around vertices: those of vertex i are second[first[i]:first[i + 1]]."""
        owner = self.corners.ravel()
        order = np.argsort(owner, kind="stable")
        return np.searchsorted(owner[order], np.arange(len(self.vertices_m) + 1)), order // 3

    @cached_property
    def parts(self) -> Indices:
        """One patch (r,) of each rounded part."""
        patch, edge = np.nonzero(self.beside >= 0)
        part = joined_parts(np.column_stack([patch, self.beside[patch, edge]]), len(self.corners))
        return np.unique(part, return_index=True)[1]

    @cached_property
    def _touching(self) -> Indices:
        return np.union1d(np.unique(self.corners), self.points)

    def farthest_m(self, directions: Array) -> Array:
        """Points (n, 3) of the rock that are farthest in some directions (n, 3)."""
        vertex = np.empty(len(directions), np.int64)
        reach = self.vertices_m[self._touching].T
        for done in range(0, len(directions), _AT_ONCE):
            rows = slice(done, done + _AT_ONCE)
            vertex[rows] = self._touching[(directions[rows] @ reach).argmax(axis=1)]
        place, moving = self.vertices_m[vertex], np.arange(len(directions))
        first, around = self.around
        for _ in range(_ROUNDS):
            begin, count = first[vertex[moving]], np.diff(first)[vertex[moving]]
            moving, begin, count = moving[count > 0], begin[count > 0], count[count > 0]
            if len(moving) == 0:
                break
            starts = np.cumsum(count) - count
            row = np.repeat(np.arange(len(moving)), count)
            patches = around[np.repeat(begin - starts, count) + np.arange(len(row))]
            corners = self.vertices_m[self.corners[patches]]
            value, shares = _highest(corners, self.bulges_m[patches], directions[moving[row]])
            best = np.lexsort((value, row))[starts + count - 1]  # of each row the last
            place[moving] = _placed(corners[best], self.bulges_m[patches[best]], shares[best])
            nearest = self.corners[patches[best], shares[best].argmax(axis=1)]
            moved = nearest != vertex[moving]
            vertex[moving] = nearest
            moving = moving[moved]
        return place


def _placed(corners_m: Array, bulges_m: Array, shares: Array) -> Array:
    """Points (..., 3) of patches with some shares (..., 3) of their corners."""
    around = shares * np.roll(shares, -1, axis=-1)
    return (shares[..., None] * corners_m).sum(axis=-2) + (around[..., None] * bulges_m).sum(axis=-2)


def _highest(corners_m: Array, bulges_m: Array, directions: Array) -> tuple[Array, Array]:
    """How far patches (..., 3, 3) reach along directions (..., 3) that broadcast with them, and the shares there."""
    p = (corners_m * directions[..., None, :]).sum(axis=-1)
    m = (bulges_m * directions[..., None, :]).sum(axis=-1)
    best, shares = np.full(p.shape[:-1], -np.inf), np.zeros(p.shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        both = m[..., 1] - m[..., 0] - m[..., 2]
        right, up = p[..., 1] - p[..., 0] + m[..., 0], p[..., 2] - p[..., 0] + m[..., 2]
        size = 4.0 * m[..., 0] * m[..., 2]
        det = size - both * both
        one = (2.0 * m[..., 2] * right + both * up) / det
        other = (2.0 * m[..., 0] * up + both * right) / det
        inside = (m[..., 0] > 0.0) & (m[..., 2] > 0.0) & (det > SINGULAR * size)
        inside &= (one >= 0.0) & (other >= 0.0) & (one + other <= 1.0)
        candidates = [(np.stack([1.0 - one - other, one, other], axis=-1), inside)]
        for k in range(3):
            after = (k + 1) % 3
            share = (p[..., after] - p[..., k] + m[..., k]) / (2.0 * m[..., k])
            share = np.where(m[..., k] > 0.0, share.clip(0.0, 1.0), p[..., after] > p[..., k])
            edge = np.zeros(p.shape)
            edge[..., k], edge[..., after] = 1.0 - share, share
            candidates.append((edge, np.ones(inside.shape, bool)))
    for each, possible in candidates:
        value = (each * p).sum(axis=-1) + (each * np.roll(each, -1, axis=-1) * m).sum(axis=-1)
        better = possible & (value > best)
        best = np.where(better, value, best)
        shares = np.where(better[..., None], each, shares)
    return best, shares


@kept
def patches_of(rock: Rock) -> Patches | None:
    """The patches of a rock's rounded base; None where nothing of it is rounded."""
    mesh = smooth_mesh_of(rock)
    return None if mesh is None else patches_of_mesh(mesh)


@kept
def smooth_mesh_of(rock: Rock) -> SmoothMesh | None:
    """A rock's mesh with its rounded parts as fine as their patches need; None where nothing of it is rounded."""
    mesh = SmoothMesh.of(rock).doubly_curved()
    if not mesh.rounded.any():
        return None
    while mesh.largest_turn_deg > _LARGEST_TURN_DEG and mesh.faces_when_halved <= _MOST_FACES:
        mesh = mesh.halved()
    return mesh


def patches_of_mesh(mesh: SmoothMesh) -> Patches:
    """Patches of a mesh's rounded parts, and the corners of its hull that lie within none of them."""
    middles, _, crease = mesh.middles()
    ends, sides = mesh.edges
    rounded = np.flatnonzero(mesh.rounded)
    number = np.full(len(mesh.faces), -1)
    number[rounded] = np.arange(len(rounded))
    edge_of, corners = mesh.edge_of[rounded], mesh.faces[rounded]
    other = np.where(sides[edge_of, 0] == rounded[:, None], sides[edge_of, 1], sides[edge_of, 0])
    beside = np.where(crease[edge_of], -1, number[other])
    touching = np.union1d(_low_corners(mesh.vertices_m), corners)
    chord = 0.5 * mesh.vertices_m[ends].sum(axis=1)
    return Patches(
        mesh.vertices_m,
        corners,
        4.0 * (middles - chord)[edge_of],
        beside,
        crease[edge_of],
        touching[~mesh.inner[touching]],  # with a point of the smooth surface its patches touch
    )


def _low_corners(points_m: Array) -> Indices:
    """Points of the convex hull that are lowest when the body is tilted by so much that it has fallen, or less."""
    hull = ConvexHull(points_m)
    low = hull.equations[:, 2] < -np.cos(np.radians(FALLEN_DEG))
    return np.union1d(hull.simplices[low].ravel(), points_m[:, 2].argmin())
