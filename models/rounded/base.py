"""A rounded base as smooth quadratic patches: where a rock that rolls on it rests and what topples it slowly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from toppling.models.arrays import Array, Flags, Indices
from toppling.models.caching import cached
from toppling.models.frames import STANDARD_GRAVITY_M_S2, horizontal_unit_vector, plane_axes
from toppling.models.pedestal import Pedestal
from toppling.models.rock import Rock
from toppling.models.rounded.smooth_mesh import FALLEN_DEG, SmoothMesh
from toppling.models.shapes import joined_parts
from toppling.models.statics import quasi_static_toppling_m_s2
from toppling.models.support import TOPPLED_FALL, TOPPLED_TILT_DEG

_LARGEST_TURN_DEG = 4.0
"""Patches that turn by more from one to the next are halved."""

_MOST_PATCH_FACES = 20_000
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
    neighbours: Indices
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
        patch, edge = np.nonzero(self.neighbours >= 0)
        part = joined_parts(np.column_stack([patch, self.neighbours[patch, edge]]), len(self.corners))
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
            value, fractions = _highest(corners, self.bulges_m[patches], directions[moving[row]])
            best = np.lexsort((value, row))[starts + count - 1]  # of each row the last
            place[moving] = _placed(corners[best], self.bulges_m[patches[best]], fractions[best])
            nearest = self.corners[patches[best], fractions[best].argmax(axis=1)]
            moved = nearest != vertex[moving]
            vertex[moving] = nearest
            moving = moving[moved]
        return place


def _placed(corners_m: Array, bulges_m: Array, fractions: Array) -> Array:
    """Points (..., 3) of patches with some shares (..., 3) of their corners."""
    around = fractions * np.roll(fractions, -1, axis=-1)
    return (fractions[..., None] * corners_m).sum(axis=-2) + (around[..., None] * bulges_m).sum(axis=-2)


def _highest(corners_m: Array, bulges_m: Array, directions: Array) -> tuple[Array, Array]:
    """How far patches (..., 3, 3) reach along directions (..., 3) that broadcast with them, and the shares there."""
    p = (corners_m * directions[..., None, :]).sum(axis=-1)
    m = (bulges_m * directions[..., None, :]).sum(axis=-1)
    best, fractions = np.full(p.shape[:-1], -np.inf), np.zeros(p.shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        both = m[..., 1] - m[..., 0] - m[..., 2]
        right, up = p[..., 1] - p[..., 0] + m[..., 0], p[..., 2] - p[..., 0] + m[..., 2]
        size = 4.0 * m[..., 0] * m[..., 2]
        det = size - both * both
        first = (2.0 * m[..., 2] * right + both * up) / det
        second = (2.0 * m[..., 0] * up + both * right) / det
        inside = (m[..., 0] > 0.0) & (m[..., 2] > 0.0) & (det > SINGULAR * size)
        inside &= (first >= 0.0) & (second >= 0.0) & (first + second <= 1.0)
        candidates = [(np.stack([1.0 - first - second, first, second], axis=-1), inside)]
        for k in range(3):
            after = (k + 1) % 3
            share = (p[..., after] - p[..., k] + m[..., k]) / (2.0 * m[..., k])
            share = np.where(m[..., k] > 0.0, share.clip(0.0, 1.0), p[..., after] > p[..., k])
            edge = np.zeros(p.shape)
            edge[..., k], edge[..., after] = 1.0 - share, share
            candidates.append((edge, np.ones(inside.shape, bool)))
    for candidate, possible in candidates:
        value = (candidate * p).sum(axis=-1) + (candidate * np.roll(candidate, -1, axis=-1) * m).sum(axis=-1)
        better = possible & (value > best)
        best = np.where(better, value, best)
        fractions = np.where(better[..., None], candidate, fractions)
    return best, fractions


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
    while mesh.largest_turn_deg > _LARGEST_TURN_DEG and mesh.faces_when_halved <= _MOST_PATCH_FACES:
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
        crease[edge_of],
        touching[~mesh.inner[touching]],  # with a point of the smooth surface its patches touch
    )


def _low_corners(points_m: Array) -> Indices:
    """Points of the convex hull that are lowest when the body is tilted by so much that it has fallen, or less."""
    hull = ConvexHull(points_m)
    low = hull.equations[:, 2] < -np.cos(np.radians(FALLEN_DEG))
    return np.union1d(hull.simplices[low].ravel(), points_m[:, 2].argmin())


_TILTS = 21
"""Number of tilts at which an equilibrium is looked for, and again between the neighbours of the steepest."""

_ZOOMS = 3

_ASIDE_DEG = (1.0, 3.0, 8.0, 20.0)
"""Angles by which a rock that tips may roll aside until its centre of mass is over its contact."""

_HALVINGS = 6

_ROLLS, _ROLL_STEP_DEG = 30, 2.0
"""Maximum number and size, in degrees, of the rolls by which a rock is let down."""

_NUDGE_RAD, _SMALL_RAD, _LARGEST_STEP_RAD = 1e-3, 1e-6, 0.05

_BALANCED = 1e-9
"""Sine of the angle to the plumb line of the way to the contact of a rock that rests."""


class RollingBody:
    """A rock on a plane that it touches with patches and points.

    It touches the plane where it is farthest along the plane's normal. It is in equilibrium where the way from its
    centre of mass to that point has the direction of gravity less the ground's acceleration (for a body of revolution
    Housner's and later Ichinose's rolling rocks). No slip, no spin about the normal, as in
    :mod:`toppling.models.ground.facet_path`.

    com_m: (3,).
    normal: (3,), of the plane, upward.
    """

    def __init__(self, patches: Patches, com_m: Array, normal: Array, gravity_m_s2: float) -> None:
        self._patches, self._com_m, self._normal, self._gravity_m_s2 = patches, com_m, normal, gravity_m_s2

    def arms_m(self, turns: Rotation) -> Array:
        """From the centre of mass to the contact (n, 3), scene axes, of the rock turned from its pose."""
        down = np.atleast_2d(turns.inv().apply(-self._normal))
        return np.atleast_2d(turns.apply(self._patches.farthest_m(down) - self._com_m))

    def resting_turn(self) -> Rotation | None:
        """The turn that lets the rock down to where it rests, without gathering speed; None if it falls."""
        # Turned a little, for one that would fall may be balanced.
        turn = Rotation.from_rotvec(_NUDGE_RAD * np.cross(self._normal, [1.0, 0.0, 0.0]))
        for _ in range(_ROLLS):
            arm = self.arms_m(turn)[0]
            axis = self._moment(arm)
            size = float(np.linalg.norm(axis))
            if size <= _BALANCED * float(np.linalg.norm(arm)):
                return turn
            near = self._newton(turn, axis)
            if np.linalg.norm(self._moment(self.arms_m(near)[0])) < 0.5 * size:
                turn = near
                continue
            rolled = self._rolled(turn, axis / size)
            if rolled is None:
                return None
            turn = rolled
        return turn

    def _newton(self, turn: Rotation, moment: Array) -> Rotation:
        """The rock rolled to where its weight has no moment, were that linear; only where it is stable."""
        axes = np.column_stack(plane_axes(self._normal))
        moments = [
            self._moment(self.arms_m(Rotation.from_rotvec(_SMALL_RAD * axis) * turn)[0]) for axis in axes.T
        ]
        slope = ((np.array(moments) - moment) @ axes).T / _SMALL_RAD
        if not (slope[0, 0] < 0.0 and slope[1, 1] < 0.0 and np.linalg.det(slope) > 0.0):
            return turn
        step = -np.linalg.solve(slope, moment @ axes)
        return (
            Rotation.from_rotvec(axes @ (step * min(1.0, _LARGEST_STEP_RAD / float(np.linalg.norm(step)))))
            * turn
        )

    def _moment(self, arm_m: Array) -> Array:
        """Moment of gravity about a contact over the weight, in the plane: about it the rock rolls."""
        moment = np.cross(np.array([0.0, 0.0, -1.0]), arm_m)
        return moment - (moment @ self._normal) * self._normal

    def _rolled(self, turn: Rotation, axis: Array) -> Rotation | None:
        """The rock rolled about an axis until its weight rolls it no farther."""
        low, high = 0.0, np.radians(_ROLL_STEP_DEG)

        def goes_on(angle_rad: float) -> bool:
            return bool(
                self._moment(self.arms_m(Rotation.from_rotvec(angle_rad * axis) * turn)[0]) @ axis > 0.0
            )

        while goes_on(high):
            low, high = high, high + np.radians(_ROLL_STEP_DEG)
            if high > np.radians(TOPPLED_TILT_DEG):
                return None
        for _ in range(40):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if goes_on(middle) else (low, middle)
        return Rotation.from_rotvec(0.5 * (low + high) * axis) * turn

    def toppling_m_s2(self, azimuths_deg: ArrayLike) -> Array:
        """Largest constant ground acceleration (n,) with an equilibrium, by azimuth; 0 where gravity topples alone."""
        azimuths_deg = np.asarray(azimuths_deg, float)
        rest = self.resting_turn()
        if rest is None:
            return np.zeros(len(azimuths_deg))
        low, high = np.full(len(azimuths_deg), 1e-7), np.full(len(azimuths_deg), np.radians(TOPPLED_TILT_DEG))
        best = np.zeros(len(azimuths_deg))
        height_m = -float(self.arms_m(rest)[0] @ self._normal)
        for _ in range(_ZOOMS):
            tilts = np.linspace(low, high, _TILTS, axis=1)
            held = self._held_m_s2(rest, np.repeat(azimuths_deg, _TILTS), tilts.ravel(), height_m)
            held = held.reshape(-1, _TILTS)
            at, rows = held.argmax(axis=1), np.arange(len(held))
            best = np.maximum(best, held[rows, at])
            low, high = tilts[rows, np.maximum(at - 1, 0)], tilts[rows, np.minimum(at + 1, _TILTS - 1)]
        return best

    def _held_m_s2(self, rest: Rotation, azimuths_deg: Array, tilts_rad: Array, height_m: float) -> Array:
        """Acceleration (n,) at which a rock tilted away from it is in equilibrium; minus infinity where none is."""
        away = -horizontal_unit_vector(azimuths_deg)
        across = np.cross([0.0, 0.0, 1.0], away)

        def arms(rows: Indices, aside_rad: Array) -> Array:
            turn_rad = tilts_rad[rows, None] * away[rows] + aside_rad[:, None] * across[rows]
            return self.arms_m(Rotation.from_rotvec(np.cross(self._normal, turn_rad)) * rest)

        arm, found = _balanced_aside(arms, across)
        down = -arm[:, 2]
        stands = found & (down > 0.0) & (-arm @ self._normal >= (1.0 - TOPPLED_FALL) * height_m)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(stands, self._gravity_m_s2 * (arm * away).sum(axis=1) / down, -np.inf)


def _balanced_aside(arms: Callable[[Indices, Array], Array], across: Array) -> tuple[Array, Flags]:
    """Arms (n, 3) without a part across, of bodies that roll aside by an angle; and which have one.

    across: (n, 3).
    """
    count = len(across)
    rows = np.arange(count)
    near, far = np.zeros(count), np.zeros(count)
    at_near = arms(rows, near)
    miss = (at_near * across).sum(axis=1)
    at_far, found = at_near.copy(), np.abs(miss) <= _BALANCED * np.linalg.norm(at_near, axis=1)
    left = rows[~found]
    for aside_deg in _ASIDE_DEG:
        far[left] = -np.sign(miss[left]) * np.radians(aside_deg)
        at_far[left] = arms(left, far[left])
        crosses = (at_far[left] * across[left]).sum(axis=1) * miss[left] <= 0.0
        found[left[crosses]] = True
        stays = left[~crosses]
        near[stays], at_near[stays] = far[stays], at_far[stays]
        left = stays
    open_rows = rows[found & (near != far)]
    for _ in range(_HALVINGS):
        middle = 0.5 * (near[open_rows] + far[open_rows])
        there = arms(open_rows, middle)
        same = (there * across[open_rows]).sum(axis=1) * miss[open_rows] > 0.0
        near[open_rows[same]], at_near[open_rows[same]] = middle[same], there[same]
        far[open_rows[~same]], at_far[open_rows[~same]] = middle[~same], there[~same]
    first, other = ((surface * across).sum(axis=1) for surface in (at_near, at_far))
    share = np.where(first != other, first / np.where(first != other, first - other, 1.0), 0.0)[:, None]
    return (1.0 - share) * at_near + share * at_far, found


_CHANGE_SHARE = 0.02
"""Largest change of the least toppling acceleration, at any azimuth, that one refinement may make."""

_MOST_FACES = 20_000
"""Finer ones cost minutes of preparing contacts; what one more halving changes is stated."""

_CHECKED_FACES = 60_000
"""Maximum number of faces of a halved mesh for which the change by refinement is computed."""

_AZIMUTHS_DEG = (0.0, 72.0, 144.0, 216.0, 288.0)

_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class RoundedBase:
    """A rounded base, and what the mesh of it is worth.

    rolls: whether it touches with the smooth surface through its vertices, or with its triangles.
    """

    rock: Rock
    rolls: bool

    @property
    def patches(self) -> Patches:
        """The smooth surface."""
        found = patches_of(self.rock)
        assert found is not None  # else the rock has no rounded base
        return found

    @cached_property
    def change(self) -> float:
        """Largest share by which halving its edges changes a least toppling acceleration, over azimuths.

        Zero where the mesh is too fine to be halved.
        """
        if not self.rolls:
            mesh = SmoothMesh.of(self.rock)
            if mesh.faces_when_halved > _CHECKED_FACES:
                return 0.0
            return _change(_over_facets_m_s2(self.rock), _over_facets_m_s2(_rock_of(mesh.halved())))
        fine = smooth_mesh_of(self.rock)
        assert fine is not None
        if fine.faces_when_halved > _CHECKED_FACES:
            return 0.0
        both = (
            RollingBody(surface, self.rock.com_m, _UP, STANDARD_GRAVITY_M_S2).toppling_m_s2(_AZIMUTHS_DEG)
            for surface in (self.patches, _patches_of_mesh(fine.halved()))
        )
        return _change(*both)

    @property
    def is_coarse(self) -> bool:
        """Whether that is more than answers may be off by."""
        return self.change > _CHANGE_SHARE

    @property
    def sentence(self) -> str:
        """For pages and plans."""
        if self.rolls:
            found = f"its base is rounded: it rolls on the smooth surface through the {len(self.patches.corners)} faces"
            found += f"' corners; one refinement changes the least acceleration that topples it by {self.change:.1%}"
            return found + (". Give a finer mesh" if self.is_coarse else "")
        return (
            "its base is rounded, and its triangles are coarse: with edges half as long it topples at an acceleration "
            f"{self.change:.0%} lower, and about twice that with a smooth base. "
            "Scene.from_mesh(mesh, refine=True) refines it"
        )


def rounded_base_of(rock: Rock) -> RoundedBase | None:
    """The rounded base of a rock, which rolls unless it is curved in one direction only; None if nothing is rounded."""
    if not SmoothMesh.of(rock).rounded.any():
        return None
    return RoundedBase(rock, rolls=patches_of(rock) is not None)


def refined(rock: Rock) -> Rock:
    """A rock whose rounded base has triangles that are fine enough for its least toppling acceleration.

    Its edges are halved until one halving more changes that by less than 2 %, or makes more than 20,000 faces.
    """
    mesh = SmoothMesh.of(rock)
    if not mesh.rounded.any():
        return rock
    now = _over_facets_m_s2(rock)
    while mesh.faces_when_halved <= _CHECKED_FACES:
        mesh = mesh.halved()
        finer = _rock_of(mesh)
        then = _over_facets_m_s2(finer)
        if _change(now, then) < _CHANGE_SHARE or len(mesh.faces) > _MOST_FACES:
            break
        rock, now = finer, then
    return rock


def _rock_of(mesh: SmoothMesh) -> Rock:
    return Rock.from_triangles(mesh.vertices_m, mesh.faces, where="the refined rock")


def _change(now_m_s2: Array, then_m_s2: Array) -> float:
    known = np.isfinite(now_m_s2) & np.isfinite(then_m_s2) & (now_m_s2 > 0.0) & (then_m_s2 > 0.0)
    return float((np.abs(now_m_s2 - then_m_s2)[known] / now_m_s2[known]).max(initial=0.0))


def _over_facets_m_s2(rock: Rock) -> Array:
    """Least toppling accelerations on a level plane of a rock that tips over its facets."""
    level = Pedestal(np.array([0.0, 0.0, rock.vertices_m[:, 2].min()]), _UP)
    return np.array(quasi_static_toppling_m_s2(rock, level, STANDARD_GRAVITY_M_S2, _AZIMUTHS_DEG))[:, 1]
