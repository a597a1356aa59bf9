"""Rounded bases: a mesh refined over the smooth surface that its triangles stand for.

A base that rolls topples where its curvature decides, and the facets of a coarse mesh topple later. Each edge between
two faces of a smooth part is cut at the middle of the cubic curve through its ends with their normals (Vlachos,
Peters, Boyd and Mitchell 2001: curved PN triangles), whose normals are weighted as Max (1999) does, exact on spheres.
Creases stay creases; one that is a smooth curve is cut on the curve through four of its corners (Dyn, Levin and
Gregory 1987). Parts that are flat stay flat.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toppling.models.compiled import Array, Flags, Indices
from toppling.models.frames import STANDARD_GRAVITY_M_S2
from toppling.models.joined import joined_parts
from toppling.models.pedestal import Pedestal
from toppling.models.rock import Rock
from toppling.models.statics import quasi_static_toppling_m_s2

_CREASE_DEG = 30.0
"""Two faces that meet at a larger angle form an edge, and two parts of an edge a corner."""

_COPLANAR_DEG = 0.05
"""Faces that meet at a smaller angle are one flat patch."""

_FLAT_AREAS = 5.0
"""A patch so many times larger than its neighbours is flat, not a facet of a curved surface."""

_FEWEST_PATCHES = 12
"""Fewer that go over into each other are a body's own faces, such as chamfers, not a curved surface."""

_BELOW_DEG = 60.0
"""Faces whose outward normal is so near to downward can touch before a rock topples."""

_CHANGE_SHARE = 0.02
"""By which one refinement may change the least toppling acceleration of any azimuth."""

_MOST_FACES = 20_000
"""Finer ones cost minutes of preparing contacts; what one more halving changes is stated."""

_CHECKED_FACES = 60_000
"""Of a mesh that would be finer when halved the change is not looked for."""

_AZIMUTHS_DEG = (0.0, 72.0, 144.0, 216.0, 288.0)


@dataclass(frozen=True)
class RoundedBase:
    """What the mesh of a rounded base is worth."""

    # Largest share by which halving its edges changes a least toppling acceleration, over azimuths.
    change: float

    @property
    def is_coarse(self) -> bool:
        """Whether that is more than answers may be off by."""
        return self.change > _CHANGE_SHARE

    @property
    def sentence(self) -> str:
        """For pages and plans."""
        return (
            "its base is rounded, and its triangles are coarse: with edges half as long it topples at an acceleration "
            f"{self.change:.0%} lower, and about twice that with a smooth base. "
            "Scene.from_mesh(mesh, refine=True) refines it"
        )


def rounded_base_of(rock: Rock) -> RoundedBase | None:
    """What one halving of the edges of a rounded base changes; None if nothing of it is rounded."""
    mesh = _Mesh.of(rock)
    if not mesh.rounded.any() or mesh.faces_when_halved > _CHECKED_FACES:
        return None
    return RoundedBase(_change(_thresholds(rock), _thresholds(_rock_of(mesh.halved()))))


def refined(rock: Rock) -> Rock:
    """A rock whose rounded base is fine enough for its least toppling acceleration.

    Its edges are halved until one halving more changes that by less than 2 %, or makes more than 20,000 faces.
    """
    mesh = _Mesh.of(rock)
    if not mesh.rounded.any():
        return rock
    now = _thresholds(rock)
    while mesh.faces_when_halved <= _CHECKED_FACES:
        mesh = mesh.halved()
        finer = _rock_of(mesh)
        then = _thresholds(finer)
        if _change(now, then) < _CHANGE_SHARE or len(mesh.faces) > _MOST_FACES:
            break
        rock, now = finer, then
    return rock


def _rock_of(mesh: _Mesh) -> Rock:
    return Rock.from_triangles(mesh.vertices_m, mesh.faces, where="the refined rock")


def _change(now_m_s2: Array, then_m_s2: Array) -> float:
    known = np.isfinite(now_m_s2) & np.isfinite(then_m_s2) & (then_m_s2 > 0.0)
    return float((np.abs(now_m_s2 - then_m_s2)[known] / now_m_s2[known]).max(initial=0.0))


def _thresholds(rock: Rock) -> Array:
    """Least toppling accelerations on a level plane."""
    level = Pedestal(np.array([0.0, 0.0, rock.vertices_m[:, 2].min()]), np.array([0.0, 0.0, 1.0]))
    return np.array(quasi_static_toppling_m_s2(rock, level, STANDARD_GRAVITY_M_S2, _AZIMUTHS_DEG))[:, 1]


@dataclass(frozen=True, eq=False)
class _Mesh:
    """A closed mesh whose faces are known as flat, and as parts of a rounded base."""

    vertices_m: Array
    faces: Indices
    flat: Flags
    rounded: Flags

    @classmethod
    def of(cls, rock: Rock) -> _Mesh:
        faces = rock.faces
        none = np.zeros(len(faces), bool)
        mesh = cls(rock.vertices_m, faces, none, none)
        normals, areas = mesh.normals
        _, sides = mesh.edges
        angle = _angle_deg(normals[sides[:, 0]], normals[sides[:, 1]])
        patch = joined_parts(sides[angle < _COPLANAR_DEG], len(faces))
        size, area = np.bincount(patch), np.bincount(patch, areas)
        smooth = (angle >= _COPLANAR_DEG) & (angle < _CREASE_DEG)
        one, other = np.concatenate([sides[smooth], sides[smooth, ::-1]]).T
        neighbours = np.bincount(patch[one], minlength=len(size))
        beside = np.bincount(patch[one], area[patch[other]], len(size)) / np.maximum(neighbours, 1)
        flat = (size > 2) | (neighbours == 0) | (area > _FLAT_AREAS * beside)
        joined = sides[(angle < _CREASE_DEG) & ~flat[patch][sides].any(axis=1)]
        part = joined_parts(patch[joined], len(size))
        flat |= np.bincount(part)[part] < _FEWEST_PATCHES
        low = normals[:, 2] < -np.cos(np.radians(_BELOW_DEG))
        low &= rock.vertices_m[faces].mean(axis=1)[:, 2] < rock.com_m[2]
        return cls(rock.vertices_m, faces, flat[patch], low & ~flat[patch])

    @property
    def faces_when_halved(self) -> int:
        """How many faces, about."""
        return int(len(self.faces) + 3 * self.rounded.sum())

    @property
    def normals(self) -> tuple[Array, Array]:
        """Unit normals (m, 3) and areas (m,)."""
        corners = self.vertices_m[self.faces]
        area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        size = np.linalg.norm(area, axis=1)
        return area / np.maximum(size, 1e-300)[:, None], 0.5 * size

    @property
    def edges(self) -> tuple[Indices, Indices]:
        """Ends (e, 2), sorted, and the two faces beside (e, 2); a closed mesh has as many of each."""
        half = np.sort(self.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        order = np.lexsort((half[:, 1], half[:, 0]))
        return half[order[::2]], (order // 3).reshape(-1, 2)

    def halved(self) -> _Mesh:
        """The mesh with the edges of its rounded faces cut in two."""
        ends, sides = self.edges
        normals, _ = self.normals
        angle = _angle_deg(normals[sides[:, 0]], normals[sides[:, 1]])
        cut = self.rounded[sides[:, 0]] | self.rounded[sides[:, 1]]
        crease = angle >= _CREASE_DEG
        middle = 0.5 * self.vertices_m[ends].sum(axis=1)
        smooth: Flags = cut & ~crease & ~self.flat[sides].any(axis=1)
        middle[smooth] += self._bulge_m(ends[smooth], sides[smooth], ends[~crease], sides[~crease])
        middle[cut & crease] = self._on_curve(ends[crease])[cut[crease]]
        number = np.full(len(ends), -1)
        number[cut] = len(self.vertices_m) + np.arange(cut.sum())
        order = np.lexsort((ends[:, 1], ends[:, 0]))
        half = np.sort(self.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        name, whole = (
            ends[:, 0] * len(self.vertices_m) + ends[:, 1],
            half[:, 0] * len(self.vertices_m) + half[:, 1],
        )
        middles = number[order][np.searchsorted(name[order], whole)].reshape(-1, 3)
        faces, parents = _split(self.faces, middles)
        return _Mesh(
            np.vstack([self.vertices_m, middle[cut]]), faces, self.flat[parents], self.rounded[parents]
        )

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
        one, other = np.roll(at, -1, axis=1) - at, np.roll(at, 1, axis=1) - at
        squares = (one * one).sum(axis=2) * (other * other).sum(axis=2)
        parts = np.cross(one, other) / np.maximum(squares, 1e-300)[:, :, None]
        # Where a flat part goes over into a curved one, its plane is tangent.
        parts *= np.where(self.flat, 1e6, 1.0)[:, None, None]
        np.add.at(weighted, fan, parts.reshape(-1, 3))
        weighted /= np.maximum(np.linalg.norm(weighted, axis=1), 1e-300)[:, None]
        a, b = self.vertices_m[ends[:, 0]], self.vertices_m[ends[:, 1]]
        at_a, at_b = (weighted[fan[corner(sides[:, 0], ends[:, k])]] for k in (0, 1))
        # At a rim the surface is known on one side only, so that there the other end alone tells.
        rim = np.zeros(fan.max() + 1, bool)
        known = np.bincount(pairs.ravel(), minlength=len(fan))
        rim[fan[known < 2]] = True
        rim_a, rim_b = (rim[fan[corner(sides[:, 0], ends[:, k])]] for k in (0, 1))
        share_a = 0.125 * (1.0 + (rim_b & ~rim_a) - (rim_a & ~rim_b))
        rise_a, rise_b = ((b - a) * at_a).sum(axis=1), ((a - b) * at_b).sum(axis=1)
        return -(share_a * rise_a)[:, None] * at_a - ((0.25 - share_a) * rise_b)[:, None] * at_b

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
        goes_on &= _angle_deg(p[a] - p[before], p[b] - p[a]) < _CREASE_DEG
        goes_on &= _angle_deg(p[b] - p[a], p[after] - p[b]) < _CREASE_DEG
        straight = 0.5 * (p[a] + p[b])
        return np.where(goes_on[:, None], 1.125 * straight - 0.0625 * (p[before] + p[after]), straight)


def _angle_deg(one: Array, other: Array) -> Array:
    """Between vectors (n, 3) of any length."""
    across = np.linalg.norm(np.cross(one, other), axis=1)
    return np.degrees(np.arctan2(across, (one * other).sum(axis=1)))


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
