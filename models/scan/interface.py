"""The interface: the plane on which rock and pedestal meet, and how far they leave it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from toppling.models.arrays import Array
from toppling.models.errors import InputError
from toppling.models.frames import plane_axes, shifted_and_turned
from toppling.models.scan.edge import Edge
from toppling.models.scan.sheet import Sheet
from toppling.models.scan.surfels import Surfels

_CREVICE_VOXELS = 4.0
"""Pedestal surfels this near to a rock surfel line the crevice."""
_LEAST_CREVICE_SURFELS = 30
_LEVEL = 0.3
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
    edge: Edge | None = None  # where the pedestal ends below the rock, a part of which hangs beside it

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
        return shifted_and_turned(
            points_m, self.point_m, np.column_stack([*plane_axes(self.normal), self.normal])
        )

    def normals(self, flat_m: Array) -> Array:
        """Unit normals (n, 3) of the surface at places, along u, v and the plane's normal."""
        slope = np.zeros((len(flat_m), 2))
        if self.sheet is not None:
            step = 0.5 * self.sheet.lattice_m * np.eye(2)
            slope = (
                np.column_stack(
                    [self.sheet.at(flat_m[:, :2] + way) - self.sheet.at(flat_m[:, :2] - way) for way in step]
                )
                / self.sheet.lattice_m
            )
        normal = np.column_stack([-slope, np.ones(len(slope))])
        return normal / np.linalg.norm(normal, axis=1)[:, None]

    @property
    def is_bare(self) -> bool:
        """Whether it is nothing but a plane without an end."""
        return self.sheet is None and self.edge is None

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

    def projected_m(self, com_m: Array) -> Array:
        """Where the plumb lines through centres of mass (n, 3) meet the plane, (n, 2) u, v."""
        com = self.flat(com_m)
        down = np.array([0.0, 0.0, -1.0]) @ self.axes
        return com[:, :2] - down[:2] / down[2] * com[:, 2:]


def fit_interface(surfels: Surfels, rock: NDArray[np.bool_]) -> Interface:
    """Plane through the pedestal's side of the crevice, by reweighted least squares (Tukey's biweight).

    A few patches high up the rock that were taken for pedestal draw least squares toward them from the start: where
    half of the patches lie much nearer to another plane, it is fitted to those.

    Raises InputError if too little of the crevice was seen.
    """
    distance, _ = cKDTree(surfels.points_m[rock]).query(surfels.points_m)
    below = ~rock & (distance < _CREVICE_VOXELS * surfels.voxel_m)
    lining = below & (surfels.normals[:, 2] > _LEVEL)
    if lining.sum() < _LEAST_CREVICE_SURFELS:
        steep = below & (np.abs(surfels.normals[:, 2]) < _LEVEL)
        like_a_neck = steep.sum() > max(lining.sum(), _LEAST_CREVICE_SURFELS)
        raise InputError(
            f"only {int(lining.sum())} patches of the pedestal's top were seen beside the rock"
            + ("; it goes on below into something steep, like a neck" if like_a_neck else ""),
            where="interface",
            expected=f"at least {_LEAST_CREVICE_SURFELS} patches of {surfels.voxel_m:.3g} m at its foot",
            remedy="scan the crevice from nearer and from more sides, or, where the pedestal is hardly wider than the "
            "rock, say where the two meet by three places --point X,Y,Z around the contact; a rock that a neck "
            "attaches to its pedestal does not topple as a free block",
        )
    points = surfels.points_m[lining]
    plane, off = fitted_plane(points), _least_median_m(points)
    if _DRAWN_AWAY * np.median(off) < np.median(np.abs(plane.flat(points)[:, 2])):
        return fitted_plane(points[off < _STRAY * np.median(off)])
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
    kept = weight > 0.05
    u, v = plane_axes(normal)
    return Interface(
        centre, normal, np.column_stack([u, v, normal]), float(np.sqrt((height[kept] ** 2).mean()))
    )
