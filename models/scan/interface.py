"""The interface: the plane on which rock and pedestal meet, the surface carried below the rock, directions around."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from toppling.models.arrays import Array, Flags, Indices
from toppling.models.errors import InputError
from toppling.models.frames import azimuth_deg, plane_axes, quadrant_of, shifted_and_turned
from toppling.models.scan.surfels import Surfels

Planes = Array
"""(k, 3): heights h = a + b u + c v."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """The pedestal's surface over the interface plane."""

    planes: Planes  # (k, 3): facets as h = a + b u + c v; of a curve the one plane from which it bends
    # How facets meet: "hollow" (the highest counts), "ridge" (the lowest), "steps" (the one that is named by
    # `sides`); or "curve"; or "plane", the interface's own, where the surface is needed for what stands beside.
    how: str
    # (k, 3): of steps: the facet whose value a + b u + c v is the largest is there. Of a curve its bend (uu,
    # uv, vv) as the only row: h = ... + (uu u^2 + 2 uv u v + vv v^2) / 2 about `middle_m`.
    sides: Array
    middle_m: Array  # (2,)
    reach_m: float  # beyond this distance from the middle a curve goes on as at it
    # Between its nodes it is linear, so that a rock's base and the pedestal's mesh are made of the same triangles.
    lattice_m: float = 0.0
    # (k, 2): convex outline of the rock's foot, u and v.
    ring_m: Array = field(default_factory=lambda: np.zeros((0, 2)))

    def at(self, flat_m: Array) -> Array:
        """Heights (...) over the plane at places (..., 2 or 3), u and v: linear within the lattice's triangles."""
        return between_nodes(flat_m, self.lattice_m, self._smooth) if self.lattice_m else self._smooth(flat_m)

    def _smooth(self, flat_m: Array) -> Array:
        u, v = flat_m[..., 0], flat_m[..., 1]
        heights = self.planes[:, 0] + u[..., None] * self.planes[:, 1] + v[..., None] * self.planes[:, 2]
        if self.how == "curve":
            offset = flat_m[..., :2] - self.middle_m
            away = np.linalg.norm(offset, axis=-1, keepdims=True)
            near = offset * np.minimum(1.0, self.reach_m / np.maximum(away, 1e-12))
            uu, uv, vv = self.sides[0]
            bend = uu * near[..., 0] ** 2 + 2.0 * uv * near[..., 0] * near[..., 1] + vv * near[..., 1] ** 2
            return np.asarray(heights[..., 0] + 0.5 * bend)
        if self.how == "steps":
            side = self.sides[:, 0] + u[..., None] * self.sides[:, 1] + v[..., None] * self.sides[:, 2]
            return np.take_along_axis(heights, side.argmax(axis=-1)[..., None], axis=-1)[..., 0]
        return np.asarray(heights.max(axis=-1) if self.how == "hollow" else heights.min(axis=-1))

    def to_json(self) -> dict[str, Any]:
        """Document that :meth:`of` reads."""
        return {
            item.name: value.tolist() if isinstance(value := getattr(self, item.name), np.ndarray) else value
            for item in fields(self)
        }

    @classmethod
    def of(cls, stored: Mapping[str, Any]) -> Sheet:
        """The sheet of a document."""
        read: dict[str, Any] = {
            name: np.array(value) if isinstance(value, list) else value for name, value in stored.items()
        }
        return cls(**read)

    @property
    def sentence(self) -> str:
        """Shape of the surface, in words."""
        if self.how == "plane":
            return "the interface plane below the rock"
        slopes = np.rad2deg(np.arctan(np.hypot(*self.planes[:, 1:].T)))
        if self.how == "curve":
            uu, uv, vv = self.sides[0]
            bend = np.linalg.eigvalsh([[uu, uv], [uv, vv]])
            most = bend[np.abs(bend).argmax()]
            return f"a {'hollow' if most > 0 else 'dome'} of radius {1.0 / abs(most):.2g} m carried under the rock"
        listed = " and ".join(f"{slope:.0f}" for slope in slopes)
        meet = {"hollow": "that meet in a hollow", "ridge": "that meet in a ridge", "steps": "with a step"}
        return f"{len(slopes)} facets, {listed} degrees off the interface plane, {meet[self.how]}"


def between_nodes(flat_m: Array, lattice_m: float, at_nodes: Callable[[Array], Array]) -> Array:
    """Values (...) at places (..., 2 or 3), linear within the triangles (`grid_triangles`) of a lattice."""
    share = flat_m[..., :2] / lattice_m
    first = np.floor(share + 1e-9)
    share = share - first
    corner = first + np.where(share[..., :1] >= share[..., 1:], [1.0, 0.0], [0.0, 1.0])
    start, side, end = (at_nodes(node * lattice_m) for node in (first, corner, first + 1.0))
    return np.asarray(start + (side - start) * share.max(axis=-1) + (end - side) * share.min(axis=-1))


def lattice(sheet: Sheet, low_m: Array, high_m: Array) -> Array:
    """Nodes (n, m, 2) of the lattice over a rectangle of u, v."""
    begin, end = np.floor(low_m / sheet.lattice_m), np.ceil(high_m / sheet.lattice_m)
    ticks_m = [sheet.lattice_m * np.arange(a, b + 1.0) for a, b in zip(begin, end, strict=True)]
    return np.stack(np.meshgrid(*ticks_m, indexing="ij"), axis=-1)


_CREVICE_VOXELS = (4.0, 8.0, 16.0, 32.0)
"""Distances, in widths of a patch, of the pedestal's patches from the rock's: the first with enough of them counts."""
LEAST_SEEN, _LEAST_SECTORS = 30, 6
"""Minimum number of patches or points that are no strays, and of directions, by ten degrees, in which they lie."""
UPWARD = 0.3
"""Upward part of a normal from which on a patch may carry a rock."""
_TRIPLES, _DRAWN_AWAY, _STRAY = 500, 3.0, 7.0
"""Planes tried; how much nearer one must be to be believed; of its strays, how far off in the median distance."""


@dataclass(frozen=True, eq=False)
class Interface:
    """A plane through the crevice, with its own axes."""

    # (3,).
    point_m: Array
    normal: Array
    axes: Array  # (3, 3): columns u, v in the plane and the normal: right-handed
    roughness_m: float  # root mean square distance of the crevice's pedestal side from the plane
    sheet: Sheet | None = None  # the pedestal's surface below the rock, where one plane does not describe it

    @classmethod
    def through(cls, point_m: Array, normal: Array, roughness_m: float = 0.0) -> Interface:
        """Plane through a point (3,) by its upward normal (3,)."""
        return cls(point_m, normal, np.column_stack([*plane_axes(normal), normal]), roughness_m)

    def flat(self, points_m: Array) -> Array:
        """Coordinates (n, 3) u, v along the plane and height h over it."""
        return shifted_and_turned(points_m, self.point_m, self.axes)

    def over(self, points_m: Array) -> Array:
        """Coordinates (n, 3) u, v along the plane and height over the pedestal's surface."""
        flat = self.flat(points_m)
        return flat if self.sheet is None else flat - self.rise(flat)

    def height_m(self, points_m: Array) -> Array:
        """Heights (n,) over the pedestal's surface alone: of twenty million points u and v take a second."""
        if self.sheet is None:
            return shifted_and_turned(points_m, self.point_m, self.axes[:, 2:])[:, 0]
        return self.over(points_m)[:, 2]

    def rise(self, flat_m: Array) -> Array:
        """The pedestal's surface over the plane at places (n, 2 or 3), as (n, 3): 0, 0, height."""
        height = 0.0 if self.sheet is None else self.sheet.at(flat_m)
        return np.column_stack([np.zeros((len(flat_m), 2)), np.broadcast_to(height, len(flat_m))])

    def support(self, points_m: Array) -> Array:
        """Coordinates (n, 3) in the support frame: along :func:`models.frames.plane_axes` and the normal."""
        return Interface.through(self.point_m, self.normal).flat(points_m)

    def normals(self, flat_m: Array) -> Array:
        """Unit normals (n, 3) of the surface at places, along u, v and the plane's normal."""
        slope = np.zeros((len(flat_m), 2))
        if self.sheet is not None:
            step = 0.5 * self.sheet.lattice_m * np.eye(2)
            places, sheet = flat_m[:, :2], self.sheet
            rises = [sheet.at(places + offset) - sheet.at(places - offset) for offset in step]
            slope = np.column_stack(rises) / sheet.lattice_m
        normal = np.column_stack([-slope, np.ones(len(slope))])
        return normal / np.linalg.norm(normal, axis=1)[:, None]

    @property
    def is_plane(self) -> bool:
        """Whether the pedestal below the rock is the plane itself."""
        return self.sheet is None or self.sheet.how == "plane"

    @property
    def lattice_m(self) -> float:
        """Spacing of the nodes on which the surface is known; 0 for a plane."""
        return 0.0 if self.sheet is None else self.sheet.lattice_m

    def scene(self, flat_m: Array) -> Array:
        """Scene coordinates (n, 3) of points given by u, v, h."""
        return flat_m @ self.axes.T + self.point_m

    def onto(self, points_m: Array) -> Array:
        """The points (n, 3) of the plane nearest to some points."""
        return points_m - np.outer((points_m - self.point_m) @ self.normal, self.normal)

    def projected_m(self, com_m: Array) -> Array:
        """Where the plumb lines through centres of mass (n, 3) meet the plane, (n, 2) u, v."""
        com = self.flat(com_m)
        down = np.array([0.0, 0.0, -1.0]) @ self.axes
        return com[:, :2] - down[:2] / down[2] * com[:, 2:]


def _lining(surfels: Surfels, rock: Flags) -> Flags:
    """Which patches (n,) are the pedestal's top beside a rock.

    What carries a rock lies below its middle. A belly that hides its own foot hides the pedestal there: then the
    nearest patches that were seen count, in steps of twice the distance.

    Raises InputError if too little of it was seen.
    """
    distance, _ = cKDTree(surfels.points_m[rock]).query(surfels.points_m)
    offset = surfels.points_m - surfels.points_m[rock].mean(axis=0)
    top = ~rock & (surfels.normals[:, 2] > UPWARD) & (offset[:, 2] < 0.0)
    sector = np.floor(np.arctan2(offset[:, 1], offset[:, 0]) / np.deg2rad(10.0))
    for reach in _CREVICE_VOXELS:
        near = top & (distance < reach * surfels.voxel_m)
        if near.sum() >= LEAST_SEEN and len(np.unique(sector[near])) >= _LEAST_SECTORS:
            return np.asarray(near)
    raise InputError(
        "scan.no_pedestal",
        f"only {int(near.sum())} patches of the pedestal's top were seen about the rock",
        where="interface",
        expected=f"at least {LEAST_SEEN} patches of {surfels.voxel_m:.3g} m at its foot",
        remedy="scan the crevice from nearer and from more sides, or, where the pedestal is hardly wider than the "
        "rock, say where the two meet by three places --point X,Y,Z around the contact; a rock that a neck "
        "attaches to its pedestal does not topple as a free block",
    )


def fit_interface(surfels: Surfels, rock: Flags) -> Interface:
    """Plane through the pedestal's side of the crevice, by reweighted least squares (Tukey's biweight).

    A few patches high up the rock that were taken for pedestal draw least squares toward them from the start: where
    half of the patches lie much nearer to another plane, it is fitted to those.

    Raises InputError if too little of the crevice was seen.
    """
    return _plane_of_lining(surfels.points_m[_lining(surfels, rock)])


def _plane_of_lining(points: Array) -> Interface:
    """Plane through most of some places (n, 3) of a crevice's pedestal side."""
    plane, off = fitted_plane(points), _least_median_m(points)
    if _DRAWN_AWAY * np.median(off) < np.median(np.abs(plane.flat(points)[:, 2])):
        return fitted_plane(points[off <= _STRAY * np.median(off)])
    return plane


def _least_median_m(points: Array) -> Array:
    """Distances (n,) from the plane through three of the points to which half of them lie nearest."""
    corners = points[np.random.default_rng(7).integers(0, len(points), (_TRIPLES, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1)
    real = length > 1e-9 * length.max()
    normals, origin = normals[real] / length[real, None], corners[real, 0]
    off = np.abs(points @ normals.T - np.einsum("ij,ij->i", origin, normals))
    return off[:, np.argmin(np.median(off, axis=0))]


def reweighted_plane(
    points: Array, given: Array, std_m: Callable[[Array, Array], float]
) -> tuple[Array, Array, Array, Array]:
    """Plane by least squares, reweighted with Tukey's biweight: a point, its upward normal, heights (n,), weights (n,).

    points: (n, 3).
    given: (n,), weights that each point has anyhow.
    std_m: standard deviation of the heights, from heights and weights.
    """
    weight, least_m = given, 1e-8 * float(np.ptp(points, axis=0).max())
    for _ in range(20):
        centre = np.average(points, axis=0, weights=weight)
        offset = points - centre
        normal = np.linalg.svd(offset * np.sqrt(weight)[:, None], full_matrices=False)[2][2]
        normal *= np.sign(normal[2]) or 1.0
        height = offset @ normal
        spread = 4.7 * max(std_m(height, weight), least_m)
        weight = given * np.where(np.abs(height) < spread, (1 - (height / spread) ** 2) ** 2, 0.0)
    return centre, normal, height, weight


def fitted_plane(points: Array) -> Interface:
    """Plane through most of some points, by reweighted least squares (Tukey's biweight)."""
    centre, normal, height, weight = reweighted_plane(
        points, np.ones(len(points)), lambda height, _: 1.4826 * float(np.median(np.abs(height)))
    )
    inliers = weight > 0.05
    return Interface.through(centre, normal, float(np.sqrt((height[inliers] ** 2).mean())))


SECTORS = 36


@dataclass(frozen=True)
class ScanWarning:
    """Why the answer for a free rigid block may not be this rock's: its kind, and a sentence."""

    kind: str
    sentence: str


def sectors(directions: Array, count: int = SECTORS) -> Indices:
    """Sector, of `count` around the vertical, of horizontal directions (n, 2 or 3)."""
    turn = np.arctan2(directions[:, 1], directions[:, 0]) / (2.0 * np.pi) + 0.5
    return np.floor(turn * count).astype(np.int64) % count


def widest_gap_deg(shown: Indices) -> tuple[float, float]:
    """Width of the widest range of directions without any of some sectors (k,), in order, and its middle, degrees."""
    empty = np.diff(np.append(shown, shown[0] + SECTORS)) - 1
    widest = int(empty.argmax())
    width = 360.0 / SECTORS
    toward = (shown[widest] + 0.5 * (empty[widest] + 2)) * width - 180.0
    return float(empty[widest] * width), float(toward % 360.0)


def middle(flat_m: Array) -> Array:
    """Middle (2,) of the rectangle around places, u and v."""
    return np.asarray(0.5 * (flat_m[:, :2].min(axis=0) + flat_m[:, :2].max(axis=0)))


def bearing_text(direction: Array, interface: Interface) -> str:
    """Quadrant bearing of a way (2,) along the interface's u and v."""
    return quadrant_of(azimuth_deg(interface.axes[:, :2] @ direction))
