"""The pedestal's own surface below a rock: facets or a curve seen beside it, carried under the base that hides it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from toppling.models.arrays import Array

Planes = Array
"""(k, 3): heights h = a + b u + c v."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """The pedestal's surface over the interface plane."""

    planes: Planes  # (k, 3): facets as h = a + b u + c v; of a curve the one plane from which it bends
    # How facets meet: "hollow" (the highest counts), "ridge" (the lowest), "steps" (the one that is named by
    # `sides`); or "curve"; or "plane", the interface's own, where the surface is needed for what stands
    # beside.
    how: str
    # (k, 3): of steps: the facet whose value a + b u + c v is the largest is there. Of a curve its bend (uu,
    # uv, vv) as the only row: h = ... + (uu u^2 + 2 uv u v + vv v^2) / 2 about `middle_m`.
    sides: Array
    middle_m: Array  # (2,)
    reach_m: float  # beyond this distance from the middle a curve goes on as at it
    # Between its nodes it is linear, so that a rock's base and the pedestal's mesh are made of the same
    # triangles.
    lattice_m: float = 0.0
    # (k, 2): convex outline of the rock's foot, u and v.
    ring_m: Array = field(default_factory=lambda: np.zeros((0, 2)))

    def at(self, flat_m: Array) -> Array:
        """Heights (...) over the plane at places (..., 2 or 3), u and v: linear within the lattice's triangles."""
        return between_nodes(flat_m, self.lattice_m, self._smooth) if self.lattice_m else self._smooth(flat_m)

    def _smooth(self, flat_m: Array) -> Array:
        u, v = flat_m[..., 0], flat_m[..., 1]
        each = self.planes[:, 0] + u[..., None] * self.planes[:, 1] + v[..., None] * self.planes[:, 2]
        if self.how == "curve":
            offset = flat_m[..., :2] - self.middle_m
            away = np.linalg.norm(offset, axis=-1, keepdims=True)
            near = offset * np.minimum(1.0, self.reach_m / np.maximum(away, 1e-12))
            uu, uv, vv = self.sides[0]
            bend = uu * near[..., 0] ** 2 + 2.0 * uv * near[..., 0] * near[..., 1] + vv * near[..., 1] ** 2
            return np.asarray(each[..., 0] + 0.5 * bend)
        if self.how == "steps":
            side = self.sides[:, 0] + u[..., None] * self.sides[:, 1] + v[..., None] * self.sides[:, 2]
            return np.take_along_axis(each, side.argmax(axis=-1)[..., None], axis=-1)[..., 0]
        return np.asarray(each.max(axis=-1) if self.how == "hollow" else each.min(axis=-1))

    def to_json(self) -> dict[str, Any]:
        """What :meth:`of` reads."""
        return {
            each.name: value.tolist() if isinstance(value := getattr(self, each.name), np.ndarray) else value
            for each in fields(self)
        }

    @classmethod
    def of(cls, told: Mapping[str, Any]) -> Sheet:
        """The sheet of a document."""
        read: dict[str, Any] = {
            name: np.array(value) if isinstance(value, list) else value for name, value in told.items()
        }
        return cls(**read)

    @property
    def sentence(self) -> str:
        """What it is, in words."""
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
    start, side, end = (at_nodes(each * lattice_m) for each in (first, corner, first + 1.0))
    return np.asarray(start + (side - start) * share.max(axis=-1) + (end - side) * share.min(axis=-1))


def lattice(sheet: Sheet, low_m: Array, high_m: Array) -> Array:
    """Nodes (n, m, 2) of the lattice over a rectangle of u, v."""
    begin, end = np.floor(low_m / sheet.lattice_m), np.ceil(high_m / sheet.lattice_m)
    ways = [sheet.lattice_m * np.arange(a, b + 1.0) for a, b in zip(begin, end, strict=True)]
    return np.stack(np.meshgrid(*ways, indexing="ij"), axis=-1)
