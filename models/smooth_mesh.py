"""Meshes of rounded bases: the smooth surface that their triangles stand for, as quadratic patches.

Each edge between two faces of a smooth part has a middle on the circle that its ends' normals give, which are weighted
as Max (1999) does: both are exact on spheres. Creases stay creases; one that is a smooth curve has its middles on the
curve through four of its corners (Dyn, Levin and Gregory 1987). Parts that are flat stay flat.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial import ConvexHull

from toppling.models.arrays import Array, Flags, Indices
from toppling.models.caching import cached
from toppling.models.pedestal import TOPPLED_TILT_DEG
from toppling.models.rock import Rock
from toppling.models.shapes import joined_parts

CREASE_DEG = 30.0
"""Two faces that meet at a larger angle form an edge, and two parts of an edge a corner."""

_COPLANAR_DEG = 0.05
"""Faces that meet at a smaller angle are one flat patch."""

_FLAT_AREAS = 5.0
"""A patch so many times larger than its neighbours is flat, not a facet of a curved surface."""

_FEWEST_PATCHES = 12
"""Fewer that go over into each other are a body's own faces, such as chamfers, not a curved surface."""

_FEWEST_INNER_CORNERS = 3
"""A part with fewer corners away from its outline is an uneven base of facets, not a sampled curved surface."""

_ONE_WAY_FRACTION = 1e-3
"""Share of the spread of a part's normals across a great circle below which the part curves in one direction."""

FALLEN_DEG = 75.0
"""Faces whose outward normal is so near to downward can touch before a rock has fallen."""

_CONCAVE_FRACTION = 0.05
"""Maximum share of concave angles between faces of a rounded part; with more, the part is rough."""


_LARGEST_TURN_DEG = 4.0
"""Patches that turn by more from one to the next are halved."""

MOST_FACES = 20_000
"""Maximum number of faces of a refined mesh: finer ones cost minutes of preparing contacts, and no time of a shake."""

SINGULAR = 1e-9
"""Share of its size to which the determinant of a patch's curvature vanishes: it is curved in one direction only."""


@dataclass(frozen=True, eq=False)
class SmoothMesh:
    """A closed mesh whose faces are known as flat, and as parts of a rounded base."""

    vertices_m: Array
    faces: Indices
    flat: Flags
    rounded: Flags

    @classmethod
    def of(cls, rock: Rock) -> SmoothMesh:
        """That of a rock in the pose in which it stands."""
        faces = rock.faces
        none = np.zeros(len(faces), bool)
        mesh = cls(rock.vertices_m, faces, none, none)
        normals, areas = mesh.normals
        _, sides = mesh.edges
        angle = mesh.angle_deg
        patch = _flat_parts(sides[angle < _COPLANAR_DEG], normals)
        size, area = np.bincount(patch), np.bincount(patch, areas)
        smooth = (angle >= _COPLANAR_DEG) & (angle < CREASE_DEG)
        first, other = np.concatenate([sides[smooth], sides[smooth, ::-1]]).T
        neighbours = np.bincount(patch[first], minlength=len(size))
        adjacent = np.bincount(patch[first], area[patch[other]], len(size)) / np.maximum(neighbours, 1)
        flat = (size > 2) | (neighbours == 0) | (area > _FLAT_AREAS * adjacent)
        joined = sides[(angle < CREASE_DEG) & ~flat[patch][sides].any(axis=1)]
        part = joined_parts(patch[joined], len(size))
        flat |= np.bincount(part)[part] < _FEWEST_PATCHES
        low = normals[:, 2] < -np.cos(np.radians(FALLEN_DEG))
        low &= rock.vertices_m[faces].mean(axis=1)[:, 2] < rock.com_m[2]
        rounded = low & ~flat[patch]
        return cls(
            rock.vertices_m,
            faces,
            flat[patch],
            rounded & mesh._convex_below(rounded, sides[angle < CREASE_DEG]),
        )

    def _convex_below(self, rounded: Flags, sides: Indices) -> Flags:
        """Which faces lie in a rounded part that is convex and reaches below; sides (e, 2) join smoothly."""
        sides = sides[rounded[sides].all(axis=1)]
        part = joined_parts(sides, len(self.faces))
        middle = self.vertices_m[self.faces].mean(axis=1)
        normals, _ = self.normals
        above = (normals[sides[:, 0]] * (middle[sides[:, 1]] - middle[sides[:, 0]])).sum(axis=1) > 0.0
        angle = _angle_deg(normals[sides[:, 0]], normals[sides[:, 1]])
        turns = np.bincount(part[sides[:, 0]], angle, part.max() + 1)
        back = np.bincount(part[sides[:, 0]], angle * above, part.max() + 1)
        below = np.bincount(part, normals[:, 2] < -np.cos(np.radians(TOPPLED_TILT_DEG))) > 0
        whole = (np.bincount(part) >= _FEWEST_PATCHES) & (self._inner_corners(part) >= _FEWEST_INNER_CORNERS)
        return (whole & below & (back <= _CONCAVE_FRACTION * turns))[part]

    def _inner_corners(self, part: Indices) -> Indices:
        """How many vertices lie inside each part: all faces around them are of it."""
        first = np.full(len(self.vertices_m), len(self.faces))
        last = np.full(len(self.vertices_m), -1)
        np.minimum.at(first, self.faces, part[:, None])
        np.maximum.at(last, self.faces, part[:, None])
        return np.bincount(first[first == last], minlength=part.max() + 1)

    def doubly_curved(self) -> SmoothMesh:
        """The mesh with those rounded parts alone that are curved in two directions.

        The others, as of a lying prism, roll over their faces, each of which takes energy.
        """
        _, sides = self.edges
        normals, areas = self.normals
        part = joined_parts(
            sides[(self.angle_deg < CREASE_DEG) & self.rounded[sides].all(axis=1)], len(self.faces)
        )
        spread = np.zeros((part.max() + 1, 3, 3))
        np.add.at(spread, part, areas[:, None, None] * normals[:, :, None] * normals[:, None, :])
        least, middle, _ = np.linalg.eigvalsh(spread).T
        return replace(self, rounded=self.rounded & (least > _ONE_WAY_FRACTION * middle)[part])

    @cached_property
    def normals(self) -> tuple[Array, Array]:
        """Unit normals (m, 3) and areas (m,)."""
        corners = self.vertices_m[self.faces]
        area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        size = np.linalg.norm(area, axis=1)
        return area / np.maximum(size, 1e-300)[:, None], 0.5 * size

    @cached_property
    def edges(self) -> tuple[Indices, Indices]:
        """Ends (e, 2), sorted, and the two faces beside (e, 2); a closed mesh has as many of each."""
        half = np.sort(self.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        order = np.lexsort((half[:, 1], half[:, 0]))
        return half[order[::2]], (order // 3).reshape(-1, 2)

    @cached_property
    def angle_deg(self) -> Array:
        """Angles (e,) between the two faces beside each edge."""
        normals, _ = self.normals
        _, sides = self.edges
        return _angle_deg(normals[sides[:, 0]], normals[sides[:, 1]])

    @property
    def inner(self) -> Flags:
        """Vertices at which all faces are rounded ones that go over into each other: points of the smooth surface."""
        count, corners = len(self.vertices_m), self.faces[self.rounded]
        ends, _ = self.edges
        inner: Flags = np.bincount(corners.ravel(), minlength=count) == np.bincount(
            self.faces.ravel(), minlength=count
        )
        inner[ends[self.angle_deg >= CREASE_DEG].ravel()] = False
        return inner

    @property
    def largest_turn_deg(self) -> float:
        """Largest angle between two faces of a rounded part that go over into each other."""
        _, sides = self.edges
        angle = self.angle_deg[self.rounded[sides].all(axis=1)]
        return float(angle[angle < CREASE_DEG].max(initial=0.0))

    def middles(self) -> tuple[Array, Flags, Flags]:
        """Middles (e, 3) of all edges on the surface, which of them are cut by halving, and which are creases."""
        ends, sides = self.edges
        angle = self.angle_deg
        cut: Flags = self.rounded[sides[:, 0]] | self.rounded[sides[:, 1]]
        crease = angle >= CREASE_DEG
        middle = 0.5 * self.vertices_m[ends].sum(axis=1)
        smooth: Flags = cut & ~crease & ~self.flat[sides].any(axis=1)
        middle[smooth] += self._bulge_m(ends[smooth], sides[smooth], ends[~crease], sides[~crease])
        middle[cut & crease] = self._on_curve(ends[crease])[cut[crease]]
        return middle, cut, crease

    @property
    def edge_of(self) -> Indices:
        """Number (m, 3) of each face's edges, from its corner k to the next."""
        ends, _ = self.edges
        half = np.sort(self.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        name, whole = (pair[:, 0] * len(self.vertices_m) + pair[:, 1] for pair in (ends, half))
        return np.searchsorted(name, whole).reshape(-1, 3)

    @property
    def faces_when_halved(self) -> int:
        """How many faces, about."""
        return int(len(self.faces) + 3 * self.rounded.sum())

    def halved(self) -> SmoothMesh:
        """The mesh with the edges of its rounded faces cut in two."""
        middle, cut, _ = self.middles()
        number = np.full(len(middle), -1)
        number[cut] = len(self.vertices_m) + np.arange(cut.sum())
        faces, parents = _split(self.faces, number[self.edge_of])
        vertices = np.vstack([self.vertices_m, middle[cut]])
        return SmoothMesh(vertices, faces, self.flat[parents], self.rounded[parents])

    def _bulge_m(self, ends: Indices, sides: Indices, smooth_ends: Indices, smooth_sides: Indices) -> Array:
        """From the middles of smooth edges to those of their curves (k, 3)."""
        corner = lambda face, vertex: 3 * face + np.argmax(self.faces[face] == vertex[:, None], axis=1)  # noqa: E731
        pairs = np.vstack(
            [
                np.column_stack([corner(smooth_sides[:, k], smooth_ends[:, end]) for k in (0, 1)])
                for end in (0, 1)
            ]
        )
        fan = joined_parts(pairs, 3 * len(self.faces))
        weighted = np.zeros((fan.max() + 1, 3))
        at = self.vertices_m[self.faces]
        first, other = np.roll(at, -1, axis=1) - at, np.roll(at, 1, axis=1) - at
        squares = (first * first).sum(axis=2) * (other * other).sum(axis=2)
        parts = np.cross(first, other) / np.maximum(squares, 1e-300)[:, :, None]
        # Where a flat part goes over into a curved one, its plane is tangent.
        parts *= np.where(self.flat, 1e6, 1.0)[:, None, None]
        np.add.at(weighted, fan, parts.reshape(-1, 3))
        weighted /= np.maximum(np.linalg.norm(weighted, axis=1), 1e-300)[:, None]
        rim = np.zeros(fan.max() + 1, bool)
        rim[fan[np.bincount(pairs.ravel(), minlength=len(fan)) < 2]] = True
        at_a, at_b = (fan[corner(sides[:, 0], ends[:, k])] for k in (0, 1))
        chord = self.vertices_m[ends[:, 1]] - self.vertices_m[ends[:, 0]]
        along = chord / np.linalg.norm(chord, axis=1)[:, None]
        # At a rim the surface is known on one side only, so that there the other end alone tells.
        first, other = weighted[at_a], weighted[at_b]
        normal_a = np.where((rim[at_a] & ~rim[at_b])[:, None], _mirrored(other, along), first)
        normal_b = np.where((rim[at_b] & ~rim[at_a])[:, None], _mirrored(first, along), other)
        return _arc_m(chord, normal_a, normal_b)

    def _on_curve(self, ends: Indices) -> Array:
        """Middles (k, 3) of creases: on a curve where both go on smoothly, else of the straight edge."""
        count = np.bincount(ends.ravel(), minlength=len(self.vertices_m))
        total = np.zeros(len(self.vertices_m), np.int64)
        np.add.at(total, ends[:, 0], ends[:, 1])
        np.add.at(total, ends[:, 1], ends[:, 0])
        a, b = ends.T
        before, after = total[a] - b, total[b] - a
        goes_on = (count[a] == 2) & (count[b] == 2)
        p = self.vertices_m
        before, after = np.where(goes_on, before, a), np.where(goes_on, after, b)
        goes_on &= _angle_deg(p[a] - p[before], p[b] - p[a]) < CREASE_DEG
        goes_on &= _angle_deg(p[b] - p[a], p[after] - p[b]) < CREASE_DEG
        straight = 0.5 * (p[a] + p[b])
        return np.where(goes_on[:, None], 1.125 * straight - 0.0625 * (p[before] + p[after]), straight)


def _flat_parts(joined: Indices, normals: Array) -> Indices:
    """Number (m,) of the flat part of each face, of pairs (k, 2) that lie in one plane.

    Narrow faces of a curved surface do so one by one, without being flat together: each of them is a part.
    """
    part = joined_parts(joined, len(normals))
    mean = np.zeros((part.max() + 1, 3))
    np.add.at(mean, part, normals)
    curved = np.bincount(part, _angle_deg(mean[part], normals) > _COPLANAR_DEG)[part] > 0
    return np.unique(np.where(curved, part.max() + 1 + np.arange(len(part)), part), return_inverse=True)[1]


def _mirrored(vectors: Array, along: Array) -> Array:
    """Vectors (n, 3) with their parts along unit vectors (n, 3) turned round."""
    return vectors - 2.0 * (vectors * along).sum(axis=1)[:, None] * along


def _arc_m(chord: Array, normal_a: Array, normal_b: Array) -> Array:
    """From the middles of chords (n, 3) to those of the circles that have some normals (n, 3) at their ends."""
    length = np.linalg.norm(chord, axis=1)
    along = chord / length[:, None]
    fall, rise = -(along * normal_a).sum(axis=1), (along * normal_b).sum(axis=1)
    turn = 0.5 * (np.arcsin(fall.clip(-1.0, 1.0)) + np.arcsin(rise.clip(-1.0, 1.0)))
    outward = normal_a + normal_b
    outward -= (outward * along).sum(axis=1)[:, None] * along
    outward /= np.maximum(np.linalg.norm(outward, axis=1), 1e-300)[:, None]
    return (0.5 * length * np.tan(0.5 * turn))[:, None] * outward


def _angle_deg(first: Array, other: Array) -> Array:
    """Between vectors (n, 3) of any length."""
    across = np.linalg.norm(np.cross(first, other), axis=1)
    return np.degrees(np.arctan2(across, (first * other).sum(axis=1)))


def _split(faces: Indices, middles: Indices) -> tuple[Indices, Indices]:
    """Triangles (k, 3), and which each came from, of faces cut at the middles of some of their edges (-1: not)."""
    count = (middles >= 0).sum(axis=1)
    turns = np.select(
        [count == 1, count == 2],
        [np.argmax(middles >= 0, axis=1), (np.argmax(middles < 0, axis=1) + 1) % 3],
        0,
    )
    index = (turns[:, None] + np.arange(3)) % 3
    (a, b, c), (ab, bc, ca) = (
        np.take_along_axis(faces, index, axis=1).T,
        np.take_along_axis(middles, index, axis=1).T,
    )
    pieces = {
        0: [(a, b, c)],
        1: [(a, ab, c), (ab, b, c)],
        2: [(ab, b, bc), (a, ab, bc), (a, bc, c)],
        3: [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)],
    }
    new, parents = [], []
    for k, parts in pieces.items():
        chosen = np.flatnonzero(count == k)
        for part in parts:
            new.append(np.column_stack(part)[chosen])
            parents.append(chosen)
    return np.vstack(new), np.concatenate(parents)


@dataclass(frozen=True, eq=False)
class Patches:
    """The surface of a rock with a rounded base: patches, and the points that can touch a plane beside them.

    vertices_m: (n, 3), of the mesh, as many as the patches need.
    corners: (k, 3) int, vertices of each patch.
    bulges_m: (k, 3, 3), four times the way from the middle of the chord of edge k, from corner k to the next, to that
    of its curve.
    neighbours: (k, 3) int, patch across each edge; -1 where the rounded part ends.
    points: (p,) int, vertices that can touch a plane and lie within no rounded part.
    """

    vertices_m: Array
    corners: Indices
    bulges_m: Array
    neighbours: Indices
    points: Indices

    @cached_property
    def around(self) -> tuple[Indices, Indices]:
        """Patches around vertices: those of vertex i are second[first[i]:first[i + 1]]."""
        owner = self.corners.ravel()
        order = np.argsort(owner, kind="stable")
        return np.searchsorted(owner[order], np.arange(len(self.vertices_m) + 1)), order // 3

    @cached_property
    def parts(self) -> Indices:
        """A patch (r,) of every rounded part."""
        patch, edge = np.nonzero(self.neighbours >= 0)
        part = joined_parts(np.column_stack([patch, self.neighbours[patch, edge]]), len(self.corners))
        return np.unique(part, return_index=True)[1]


@cached
def patches_of(rock: Rock) -> Patches | None:
    """The patches of a rock's rounded base; None where nothing of it is rounded."""
    mesh = smooth_mesh_of(rock)
    return None if mesh is None else _patches_of_mesh(mesh)


@cached
def smooth_mesh_of(rock: Rock) -> SmoothMesh | None:
    """A rock's mesh with its rounded parts as fine as their patches need; None where nothing of it is rounded."""
    mesh = SmoothMesh.of(rock).doubly_curved()
    if not mesh.rounded.any():
        return None
    while mesh.largest_turn_deg > _LARGEST_TURN_DEG and mesh.faces_when_halved <= MOST_FACES:
        mesh = mesh.halved()
    return mesh


def _patches_of_mesh(mesh: SmoothMesh) -> Patches:
    """Patches of a mesh's rounded parts, and the corners of its hull that lie within none of them."""
    middles, _, crease = mesh.middles()
    ends, sides = mesh.edges
    rounded = np.flatnonzero(mesh.rounded)
    number = np.full(len(mesh.faces), -1)
    number[rounded] = np.arange(len(rounded))
    edge_of, corners = mesh.edge_of[rounded], mesh.faces[rounded]
    other = np.where(sides[edge_of, 0] == rounded[:, None], sides[edge_of, 1], sides[edge_of, 0])
    neighbour = np.where(crease[edge_of], -1, number[other])
    touching = np.union1d(_low_corners(mesh.vertices_m), corners)
    chord = 0.5 * mesh.vertices_m[ends].sum(axis=1)
    return Patches(
        mesh.vertices_m,
        corners,
        4.0 * (middles - chord)[edge_of],
        neighbour,
        touching[~mesh.inner[touching]],  # with a point of the smooth surface its patches touch
    )


def _low_corners(points_m: Array) -> Indices:
    """Points of the convex hull that are lowest when the body is tilted by so much that it has fallen, or less."""
    hull = ConvexHull(points_m)
    low = hull.equations[:, 2] < -np.cos(np.radians(FALLEN_DEG))
    return np.union1d(hull.simplices[low].ravel(), points_m[:, 2].argmin())
