"""The pedestal's own surface below a rock: facets or a curve seen beside it, carried under the base that hides it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError, cKDTree

from toppling.models.arrays import Array
from toppling.models.contact import ContactProperties
from toppling.models.frames import STANDARD_GRAVITY_M_S2, plane_axes
from toppling.models.ground.body import GroundedBody
from toppling.models.pedestal import Pedestal
from toppling.models.rock import Rock
from toppling.models.scan.base import CELLS_PER_HEIGHT
from toppling.models.scan.crevice import grid_triangles
from toppling.models.scan.gap_seen import PLACES_ACROSS
from toppling.models.scan.interface import Interface
from toppling.models.scan.surfels import Surfels

RING_PER_HEIGHT = 0.12
"""Patches of the pedestal so near the rock tell how its surface goes on below."""
NARROW_PER_HEIGHT = 0.05
"""The same where the surface bends: what lies farther off may bend otherwise."""
UPWARD = 0.3
"""Cosine to the vertical above which a patch can carry a rock."""
LEAST_PATCHES = 60
OFF_PER_HEIGHT = 0.01
"""A surface that stays so near to one plane below the rock is that plane, as for contacts (`ground.kind`)."""
LEAST_BEND_DEG = 3.0
"""Facets that differ by less, and curves whose rim slopes by less, are one plane."""
FACET_PER_HEIGHT = 0.004
"""Patches so near a facet's plane are its own."""
FACET_DEG = 12.0
"""The same for their normals."""
LEAST_SHARE = 0.1
"""Of the ring that a facet takes up."""
EXPLAINED = 0.85
"""Of the ring, facets that together take up less are none."""
MOST_OF_MEDIAN = 12.0
"""Area that a patch counts for, over the median's: where points are few, each patch stands for more."""
MOST_FACETS = 3
SEEDS, SEED_TOLERANCES = 60, 10.0
"""Patches from which facets are grown, and how far around them a plane is first fitted."""
CURVES_BETTER = 0.7
"""A curve must leave less than this share of a plane's misfit."""
FRICTION = ContactProperties().friction_static
AROUND_LATTICES = 12.0
"""Distance beyond the rim over which a rock is tipped on the surface."""

Planes = Array
"""(k, 3): heights h = a + b u + c v."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """The pedestal's surface over the interface plane.

    Parameters
    ----------
    planes : (k, 3) array
        Facets as h = a + b u + c v; of a curve the one plane from which it bends.
    how : str
        How facets meet: "hollow" (the highest counts), "ridge" (the lowest), "steps" (the one that is named by
        `sides`) or "curve".
    sides : (k, 3) array
        Of steps: the facet whose value a + b u + c v is the largest is there. Of a curve its bend (uu, uv, vv) as the
        only row: h = ... + (uu u^2 + 2 uv u v + vv v^2) / 2 about `middle_m`.
    middle_m : (2,) array
    reach_m : float
        Beyond this distance from the middle a curve goes on as at it.
    noise_m : float
        Misfit of what was seen.
    lattice_m : float
        Between its nodes it is linear, so that a rock's base and the pedestal's mesh are made of the same triangles.
    ring_m : (k, 2) array
        Convex outline of the rock's foot, u and v.
    """

    planes: Planes
    how: str
    sides: Array
    middle_m: Array
    reach_m: float
    noise_m: float
    lattice_m: float = 0.0
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
        return cls(
            **{name: np.array(value) if isinstance(value, list) else value for name, value in told.items()}
        )

    @property
    def sentence(self) -> str:
        """What it is, in words."""
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


def carried_surface(
    surfels: Surfels, rock: NDArray[np.bool_], height_m: float, given: Interface | None = None
) -> Interface | None:
    """Interface with the surface that the patches beside a rock show; None where one plane is enough.

    Parameters
    ----------
    surfels : Surfels
    rock : (n,) bool array
        Which are the rock's.
    height_m : float
        Of the rock.
    given : Interface, optional
        Plane that describes it; otherwise the one nearest to what is seen beside the rock.
    """
    away = cKDTree(surfels.points_m[rock]).query(surfels.points_m)[0]
    beside = ~rock & (surfels.normals[:, 2] > UPWARD) & (away < RING_PER_HEIGHT * height_m)
    near_ground = cKDTree(surfels.points_m[beside]).query(surfels.points_m[rock])[0] if beside.any() else away
    rim = surfels.points_m[rock][near_ground < 3.0 * surfels.voxel_m]
    if beside.sum() < LEAST_PATCHES or len(rim) < LEAST_PATCHES:
        return None
    points, normals, away = surfels.points_m[beside], surfels.normals[beside], away[beside]
    frame = given or _plane_of(points, _areas(points))
    flat, flat_normals, flat_rim = frame.flat(points), normals @ frame.axes, frame.flat(rim)
    try:
        ring = flat_rim[ConvexHull(flat_rim[:, :2]).vertices, :2]
    except QhullError:
        return None
    below = _inside(ring, surfels.voxel_m)
    narrow = away < NARROW_PER_HEIGHT * height_m
    found = _faceted(flat, flat_normals, height_m)
    if found is None and narrow.sum() > LEAST_PATCHES:
        found = _curved(flat[narrow], below, height_m)
    if found is None or not _leaves_the_plane(found, below, height_m):
        return None
    lattice, roughness = _lattice_m(below, height_m), _roughness_m(found, below)
    frame, found = _along_the_crease(frame, found)
    places = frame.flat(rim)[:, :2]
    sheet = replace(found, lattice_m=lattice, ring_m=places[ConvexHull(places).vertices])
    return Interface(frame.point_m, frame.normal, frame.axes, roughness, sheet)


def _along_the_crease(frame: Interface, sheet: Sheet) -> tuple[Interface, Sheet]:
    """Frame whose second axis is the line in which two facets meet, so that nodes lie on it."""
    if len(sheet.planes) != 2 or sheet.how == "steps":
        return frame, sheet
    a, *across = sheet.planes[0] - sheet.planes[1]
    across = np.array(across)
    shift = -a * across / (across @ across)
    way = across / np.linalg.norm(across)
    turn = np.column_stack([way, [-way[1], way[0]]])
    axes = np.column_stack([frame.axes[:, :2] @ turn, frame.normal])
    height = sheet.planes[:, 0] + sheet.planes[:, 1:] @ shift
    planes = np.column_stack([height, sheet.planes[:, 1:] @ turn])
    point = frame.point_m + frame.axes[:, :2] @ shift
    middle = (sheet.middle_m - shift) @ turn
    return replace(frame, point_m=point, axes=axes), replace(sheet, planes=planes, middle_m=middle)


@lru_cache(maxsize=8)  # interfaces compare by identity
def surface_of(interface: Interface) -> Pedestal:
    """The pedestal below a rock as its interface describes it: the carried surface as a mesh, or the endless plane."""
    sheet = interface.sheet
    if sheet is None:
        return Pedestal(interface.point_m, interface.normal)
    reach = AROUND_LATTICES * sheet.lattice_m
    nodes = lattice(sheet, sheet.ring_m.min(axis=0) - reach, sheet.ring_m.max(axis=0) + reach)
    flat = np.column_stack([nodes.reshape(-1, 2), sheet.at(nodes).ravel()])
    return Pedestal(
        interface.point_m, interface.normal, interface.scene(flat), grid_triangles(nodes.shape[:2])
    )


def lattice(sheet: Sheet, low_m: Array, high_m: Array) -> Array:
    """Nodes (n, m, 2) of the lattice over a rectangle of u, v."""
    begin, end = np.floor(low_m / sheet.lattice_m), np.ceil(high_m / sheet.lattice_m)
    ways = [sheet.lattice_m * np.arange(a, b + 1.0) for a, b in zip(begin, end, strict=True)]
    return np.stack(np.meshgrid(*ways, indexing="ij"), axis=-1)


def _lattice_m(below: Array, height_m: float) -> float:
    """A whole number of the cells in which bases are seen, as many as places of a base are apart."""
    cell = height_m / CELLS_PER_HEIGHT
    width = float(np.sqrt(ConvexHull(below).volume))
    return cell * max(1, round(width / PLACES_ACROSS / cell))


def _areas(points: Array) -> Array:
    """What each patch stands for, but for a factor: more where few were measured."""
    area = cKDTree(points).query(points, min(7, len(points)))[0][:, -1] ** 2
    return np.minimum(area, MOST_OF_MEDIAN * np.median(area))


def _plane_of(points: Array, area: Array) -> Interface:
    """Plane by least squares, equal areas with an equal say."""
    centre = np.average(points, axis=0, weights=area)
    normal = np.linalg.svd((points - centre) * np.sqrt(area)[:, None], full_matrices=False)[2][2]
    normal = normal * (np.sign(normal[2]) or 1.0)
    return Interface(centre, normal, np.column_stack([*plane_axes(normal), normal]), 0.0)


def _inside(ring: Array, cell_m: float) -> Array:
    """Places (n, 2) of a grid within a convex polygon."""
    hull = ConvexHull(ring)
    low, high = ring.min(axis=0), ring.max(axis=0)
    cell = max(cell_m, float((high - low).max()) / 60.0)
    nodes = np.stack(np.meshgrid(*(np.arange(a, b + cell, cell) for a, b in zip(low, high, strict=True))), -1)
    nodes = nodes.reshape(-1, 2)
    return nodes[(nodes @ hull.equations[:, :2].T + hull.equations[:, 2] <= 0.0).all(axis=1)]


def _leaves_the_plane(sheet: Sheet, below: Array, height_m: float) -> bool:
    """Whether the surface below the rock differs from every plane by what matters to contacts."""
    over = sheet.at(below)
    design = np.column_stack([np.ones(len(below)), below])
    off = over - design @ np.linalg.lstsq(design, over, rcond=None)[0]
    return bool(np.abs(off).max() > OFF_PER_HEIGHT * height_m)


def _roughness_m(sheet: Sheet, below: Array) -> float:
    return float(np.sqrt((sheet.at(below) ** 2).mean()))


def _faceted(flat: Array, normals: Array, height_m: float) -> Sheet | None:
    """Facets that explain the ring; None where one does, or none do."""
    area = _areas(flat)
    planes = _facets(flat, normals, area, height_m)
    if len(planes) < 2:
        return None
    sheets = list(_meetings(np.array(planes), flat))
    off = [np.abs(sheet.at(flat) - flat[:, 2]) for sheet in sheets]
    best = int(np.argmin([np.minimum(each, 4.0 * FACET_PER_HEIGHT * height_m) @ area for each in off]))
    if (off[best] < 2.0 * FACET_PER_HEIGHT * height_m) @ area < EXPLAINED * area.sum():
        return None
    sheet = _refitted(sheets[best], flat)
    noise = 1.4826 * float(np.median(np.abs(sheet.at(flat) - flat[:, 2])))
    return replace(sheet, middle_m=flat[:, :2].mean(axis=0), noise_m=noise)


def _refitted(sheet: Sheet, flat: Array) -> Sheet:
    """The same with each facet fitted to the patches that are its own, and lie in it but for their noise."""
    for _ in range(3):
        each = np.array([_heights(plane, flat) for plane in sheet.planes]) - flat[:, 2]
        own, off = np.abs(each).argmin(axis=0), np.abs(sheet.at(flat) - flat[:, 2])
        near = off < 3.0 * 1.4826 * np.median(off)
        planes = [
            _fitted(flat[near & (own == k)]) if (near & (own == k)).sum() > 9 else plane
            for k, plane in enumerate(sheet.planes)
        ]
        sheet = replace(sheet, planes=np.array(planes))
    return sheet


def _facets(flat: Array, normals: Array, area: Array, height_m: float) -> list[Array]:
    """Planes (3,), the largest first, each seen in a share of the ring and unlike the others."""
    tolerance, alike = FACET_PER_HEIGHT * height_m, np.cos(np.deg2rad(FACET_DEG))
    left, found = np.ones(len(flat), bool), []
    for _ in range(MOST_FACETS):
        plane, own = _largest_facet(flat, normals, np.where(left, area, 0.0), tolerance, alike)
        if own @ area < LEAST_SHARE * area.sum():
            break
        if all(_differ(plane, other, flat, height_m) for other in found):
            found.append(plane)
        left &= ~own
        if left.sum() < LEAST_PATCHES:
            break
    return found


def _largest_facet(
    flat: Array, normals: Array, area: Array, tolerance_m: float, alike: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Plane through the most of the patches that are left (those with an area), and which of these are its own."""
    left = area > 0.0
    tree, candidates = cKDTree(flat), np.flatnonzero(left)
    best, own = np.zeros(3), np.zeros(len(flat), bool)
    for seed in candidates[:: max(1, len(candidates) // SEEDS)]:
        around = np.array(tree.query_ball_point(flat[seed], SEED_TOLERANCES * tolerance_m))
        mine = np.zeros(len(flat), bool)
        mine[around[normals[around] @ normals[seed] > alike]] = True
        for _ in range(4):
            mine &= left
            if mine.sum() < 10:
                break
            plane = _fitted(flat[mine])
            mine = np.abs(_heights(plane, flat) - flat[:, 2]) < tolerance_m
            mine &= normals @ _normal(plane) > alike
        mine &= left
        if mine.sum() > 9 and mine @ area > own @ area:
            best, own = _fitted(flat[mine]), mine
    return best, own


def _fitted(flat: Array) -> Array:
    """Plane h = a + b u + c v by least squares."""
    design = np.column_stack([np.ones(len(flat)), flat[:, :2]])
    return np.linalg.lstsq(design, flat[:, 2], rcond=None)[0]


def _heights(plane: Array, flat: Array) -> Array:
    return np.asarray(plane[0] + flat[:, :2] @ plane[1:])


def _normal(plane: Array) -> Array:
    normal = np.array([-plane[1], -plane[2], 1.0])
    return normal / np.linalg.norm(normal)


def _differ(one: Array, other: Array, flat: Array, height_m: float) -> bool:
    """Whether two facets are two: by their slopes, or by a step between them."""
    bent = np.rad2deg(np.arccos(min(1.0, float(_normal(one) @ _normal(other))))) > LEAST_BEND_DEG
    apart = np.abs(_heights(one, flat) - _heights(other, flat)).min() > 2.0 * OFF_PER_HEIGHT * height_m
    return bool(bent or apart)


def _meetings(planes: Planes, flat: Array) -> Iterator[Sheet]:
    """Ways in which facets may meet below the rock."""
    nothing, middle = np.zeros((0, 3)), np.zeros(2)
    for how in ("hollow", "ridge"):
        yield Sheet(planes, how, nothing, middle, 0.0, 0.0)
    off = np.abs(np.array([_heights(plane, flat) for plane in planes]) - flat[:, 2])
    yield Sheet(planes, "steps", _sides(off.argmin(axis=0), len(planes), flat), middle, 0.0, 0.0)


def _sides(label: NDArray[np.intp], count: int, flat: Array) -> Array:
    """Lines between the facets, by discriminants (count, 3) that are largest on their own."""
    design = np.column_stack([np.ones(len(flat)), flat[:, :2]])
    one_hot = (label[:, None] == np.arange(count)).astype(float)
    weight = 1.0 / np.sqrt(np.bincount(label, minlength=count).clip(1))[label]
    for _ in range(8):  # those beyond their facet's border say nothing on where it runs
        sides = np.linalg.lstsq(design * weight[:, None], one_hot * weight[:, None], rcond=None)[0]
        value = design @ sides
        margin = value[np.arange(len(flat)), label] - np.where(one_hot > 0.0, -np.inf, value).max(axis=1)
        weight = np.exp(-np.maximum(margin, 0.0) / 0.25) + 1e-3
    return np.asarray(sides.T)


def _curved(flat: Array, below: Array, height_m: float) -> Sheet | None:
    """A dome, hollow or saddle that fits what was seen close to the rock, where a plane fits worse."""
    middle = 0.5 * (below.min(axis=0) + below.max(axis=0))
    u, v = (flat[:, :2] - middle).T
    design = np.column_stack([np.ones(len(u)), u, v, 0.5 * u**2, u * v, 0.5 * v**2])
    weight = np.ones(len(u))
    for _ in range(10):
        bend = np.linalg.lstsq(design * weight[:, None], flat[:, 2] * weight, rcond=None)[0]
        off = np.abs(design @ bend - flat[:, 2])
        weight = np.sqrt(1.0 / np.maximum(off, FACET_PER_HEIGHT * height_m))
    plane = _fitted(flat)
    straight = np.abs(_heights(plane, flat) - flat[:, 2]).mean()
    if off.mean() > CURVES_BETTER * straight:
        return None
    a, b, c, uu, uv, vv = bend
    at_zero = np.array([a - b * middle[0] - c * middle[1], b, c])
    reach = float(np.linalg.norm(flat[:, :2] - middle, axis=1).max())
    noise = 1.4826 * float(np.median(off))
    return Sheet(at_zero[None], "curve", np.array([[uu, uv, vv]]), middle, reach, noise)


def grounded_on(rock: Rock, interface: Interface) -> GroundedBody:
    """A rock on the carried surface, with the friction that every scanned scene has by default."""
    return GroundedBody.of(rock, surface_of(interface), STANDARD_GRAVITY_M_S2, (FRICTION, FRICTION))


def on_surface(rock: Rock, interface: Interface, azimuths_deg: Array) -> Array:
    """Quasi-static toppling accelerations (n,), m/s2; 0 where the rock does not stand."""
    body = grounded_on(rock, interface)
    if not body.stands(body.touching(body.pose)):
        return np.zeros(len(azimuths_deg))
    return np.array(body.quasi_static_toppling_m_s2([float(each) for each in azimuths_deg]))[:, 1]
