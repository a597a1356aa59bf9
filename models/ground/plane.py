"""Contacts of a rock's points with the plane z = 0, and over which part of the ground they answer. Compiled.

Where the ground is the interface plane, within a share of the rock's height and a few degrees, points over that plane
tell the same contacts as its mesh, for less. Whether the rock is there is asked of its present position, in every step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy import ndimage
from scipy.spatial import ConvexHull, QhullError

from toppling.models.caching import cached
from toppling.models.compiled import Array, Flags, Indices, inner
from toppling.models.frames import plane_axes
from toppling.models.ground.contacts import add
from toppling.models.ground.pairs import moved_m
from toppling.models.ground.rigid import plus, turned
from toppling.models.pedestal import Pedestal
from toppling.models.relief import height_below
from toppling.models.rock import Rock

FLAT_SHARE = 0.01
"""Distance from the interface plane, over the rock's height, up to which ground is that plane."""

FLAT_DEG = 2.0
"""Slope up to which ground is that plane."""

_ROLLED_DEG = 16.5
"""Tilt up to which a rock may roll onto ground beside the plane; farther on it tips."""

_KEY = 6 << 60
"""Key of the first point's contact."""

_CELL_SHARE, _REACH = 0.03, 4.0
"""Size over R of the cells in which the ground is looked up, and of the area around the rock that they cover."""

_SIZES_AN_OCTAVE = 4
"""Number of values per octave to which R is rounded for these cells."""

_LISTED_SHARE = 0.03
"""Height over R up to which points are listed as near the plane."""


class FlatPart(NamedTuple):
    """Where ground is the interface plane; without cells it is so everywhere. Distances are to the nearest cell."""

    low_m: Array  # (2,): corner of the first cell
    cell_m: float
    falls_m: Array  # (k, k): to ground below the plane, or to none
    rises_m: Array  # (k, k): to ground above it


class PlanePoints(NamedTuple):
    """Points of a rock over the plane; none where its mesh always answers."""

    points: Array  # (n, 3), body axes
    is_base: Indices  # (n,): whether the plane must be there where the point comes down
    part: FlatPart
    as_drawn: bool  # the base was drawn over the plane, which is where the base stands
    listed: Indices  # (n,): points that are near
    seen: Array  # (9,): pose in which these were listed, the least gap of the others, how many are listed
    held: Array  # (8,): pose that was looked up, and the way over which the rock stays over the plane


ENDLESS = FlatPart(np.zeros(2), 1.0, np.zeros((0, 0)), np.zeros((0, 0)))
"""A plane that goes on for ever."""


def plane_points(points: Array, base: Flags, part: FlatPart, *, as_drawn: bool) -> PlanePoints:
    """Points of which none is listed yet."""
    nothing = np.zeros(0, np.int64), np.zeros(0), np.zeros(0)
    points = np.ascontiguousarray(points)
    return not_listed(PlanePoints(points, base.astype(np.int64), part, as_drawn, *nothing))


def not_listed(on: PlanePoints) -> PlanePoints:
    """Copy without cached lookups, so that answers depend on no other shake."""
    return on._replace(
        listed=np.zeros(len(on.points), np.int64),
        seen=np.full(9, -np.inf),
        held=np.append(np.full(7, np.inf), -1.0),
    )


NO_POINTS = plane_points(np.zeros((0, 3)), np.zeros(0, bool), ENDLESS, as_drawn=False)


@inner
def is_over_plane(on: PlanePoints, pose: Array, turn: Array, farthest_m: float, margin_m: float) -> bool:
    """Whether in a pose (7,) all that the rock may meet within a margin is the plane."""
    if len(on.points) == 0 or len(on.part.falls_m) == 0:
        return len(on.points) > 0
    if moved_m(on.held, pose, farthest_m) + margin_m < on.held[7]:
        return True
    left, part = np.inf, on.part
    if not on.as_drawn:
        left = _at(part, part.rises_m, pose[0], pose[1]) - 1.5 * part.cell_m - farthest_m - margin_m
        if left <= 0.0:
            return False
    for i in range(len(on.points)):
        if on.is_base[i] == 0:
            continue
        x, y, z = plus(pose, 1.0, turned(turn, on.points[i]))
        away = _at(part, part.falls_m, x, y)
        if on.as_drawn:
            away = min(away, _at(part, part.rises_m, x, y))
        if away <= 0.0 and z < margin_m:
            return False
        left = min(left, max(away - 1.5 * part.cell_m, z))
    for k in range(7):
        on.held[k] = pose[k]
    on.held[7] = left
    return True


@inner
def _at(part: FlatPart, distance_m: Array, x: float, y: float) -> float:
    """Distance at a place by the table of cells; 0 beyond the cells."""
    i, j = int(np.floor((x - part.low_m[0]) / part.cell_m)), int(np.floor((y - part.low_m[1]) / part.cell_m))
    if i < 0 or j < 0 or i >= distance_m.shape[0] or j >= distance_m.shape[1]:
        return 0.0
    return distance_m[i, j]


@inner
def plane_contacts(
    on: PlanePoints, pose: Array, turn: Array, lengths_m: tuple[float, float], margin_m: float, out: Any
) -> int:
    """Contacts with gaps up to a margin in a pose (7,) with its rotation; how many.

    lengths_m: R, and from the centre of mass to the farthest point.
    """
    size_m, farthest_m = lengths_m
    seen, points = on.seen, on.points
    if not moved_m(seen, pose, farthest_m) + margin_m < seen[7]:
        near_m, others_m, listed = margin_m + _LISTED_SHARE * size_m, np.inf, 0
        for i in range(len(points)):
            gap = pose[2] + turn[2, 0] * points[i, 0] + turn[2, 1] * points[i, 1] + turn[2, 2] * points[i, 2]
            if gap < near_m:
                on.listed[listed] = i
                listed += 1
            else:
                others_m = min(others_m, gap)
        for k in range(7):
            seen[k] = pose[k]
        seen[7], seen[8] = others_m, listed
    count = 0
    for k in range(int(seen[8])):
        i = on.listed[k]
        gap = pose[2] + turn[2, 0] * points[i, 0] + turn[2, 1] * points[i, 1] + turn[2, 2] * points[i, 2]
        if gap < margin_m:
            place = plus(pose, 1.0, turned(turn, points[i]))
            count = add(out, count, _KEY + i, gap, (0.0, 0.0, 1.0), place, pose)
    return count


@dataclass(frozen=True)
class GroundKind:
    """Kind of ground below a rock: the interface plane, or a surface."""

    is_plane: bool  # where it stands; where it slides to, its position tells
    why: str  # in words, for plans and pages

    @property
    def sentence(self) -> str:
        """Kind of ground, as a sentence."""
        what = (
            "one plane" if self.is_plane else "the pedestal's own surface, each contact along its own normal"
        )
        return f"the rock stands on {what}: {self.why}"


def kind_where_it_stands(rock: Rock, pedestal: Pedestal) -> GroundKind:
    """Whether a rock stands where its pedestal is the interface plane."""
    frame = np.column_stack([*plane_axes(pedestal.normal), pedestal.normal])
    points, com = ((places - pedestal.point_m) @ frame for places in (rock.hull_vertices_m, rock.com_m))
    part = flat_part_of(pedestal, rock)
    reach_m = np.linalg.norm(points - com, axis=1).max() + 1.5 * part.cell_m
    if _look_up(part, part.rises_m, com[None, :2])[0] <= reach_m:
        return GroundKind(False, "ground within its reach stands over the interface plane, or is steep")
    # Also what comes down as it rolls: statics would follow it over the plane.
    apart_m = np.linalg.norm(points[:, :2] - com[:2], axis=1)
    comes_down = np.maximum(FLAT_SHARE * rock.height_m, np.tan(np.radians(_ROLLED_DEG)) * apart_m)
    low = points[points[:, 2] < points[:, 2].min() + comes_down]
    if (_look_up(part, part.falls_m, low[:, :2]) <= 0.0).any():
        return GroundKind(False, "a part of its base is beyond an edge of the interface plane")
    return GroundKind(True, "all that it can reach where it stands lies in one plane")


def _look_up(part: FlatPart, distance_m: Array, places_m: Array) -> Array:
    cell = np.floor((places_m - part.low_m) / part.cell_m).astype(int)
    inside = ((cell >= 0) & (cell < len(distance_m))).all(axis=1)
    found = np.zeros(len(places_m))
    found[inside] = distance_m[tuple(cell[inside].T)]
    return found


def flat_part_of(pedestal: Pedestal, rock: Rock, base_m: Array | None = None) -> FlatPart:
    """The part of a pedestal's surface around a rock that is its interface plane.

    base_m: (n, 2), support frame: of a base that was drawn over the plane. Below it there is the plane, and slopes of
    the ground beside it do not count.
    """
    if pedestal.is_plane:
        return ENDLESS
    size_m, off_m, is_drawn = float(rock.half_diagonal_m), FLAT_SHARE * rock.height_m, base_m is not None
    frame = np.column_stack([*plane_axes(pedestal.normal), pedestal.normal])
    # Bases and centres of mass that are drawn share the cells: their sizes differ by some per cent.
    size_m = 2.0 ** (round(_SIZES_AN_OCTAVE * np.log2(size_m)) / _SIZES_AN_OCTAVE)
    centre = (((rock.com_m - pedestal.point_m) @ frame)[:2] / size_m).round() * size_m
    low_m, cell_m, falls, rises = _off_plane(pedestal, size_m, off_m, tuple(centre), is_drawn)
    if base_m is not None:
        below = _cells_within(base_m, low_m, cell_m, falls.shape)
        rises, falls = rises & ~below, falls & ~below
    return FlatPart(low_m, cell_m, *(_distance_m(cells, cell_m) for cells in (falls, rises)))


def _distance_m(of: Flags, cell_m: float) -> Array:
    if not of.any():
        return np.full(of.shape, np.inf)
    return np.asarray(ndimage.distance_transform_edt(~of)) * cell_m


def _cells_within(base_m: Array, low_m: Array, cell_m: float, shape: tuple[int, ...]) -> Flags:
    """Which cells lie within the hull of a base (n, 2), or so near it that they may hold a part of it."""
    found, near_m = np.zeros(shape, bool), 1.5 * cell_m
    begin = np.maximum(np.floor((base_m.min(axis=0) - near_m - low_m) / cell_m).astype(int), 0)
    end = np.minimum(np.ceil((base_m.max(axis=0) + near_m - low_m) / cell_m).astype(int), shape)
    part = np.s_[begin[0] : end[0], begin[1] : end[1]]
    places_m = low_m + (np.moveaxis(np.mgrid[part], 0, -1) + 0.5) * cell_m
    try:
        lines = ConvexHull(base_m).equations
        found[part] = (places_m @ lines[:, :2].T + lines[:, 2]).max(axis=-1) <= near_m
    except (QhullError, ValueError):
        found[part] = np.linalg.norm(places_m - base_m.mean(axis=0), axis=-1) <= near_m
    return found


@cached
def _off_plane(
    pedestal: Pedestal, size_m: float, off_m: float, centre_m: tuple[float, ...], is_drawn: bool
) -> tuple[Array, float, Flags, Flags]:
    """Corner and size of cells around a place; which (k, k) hold ground below the plane, or none, and above it.

    is_drawn: whether slopes are left out.
    """
    assert pedestal.vertices_m is not None
    assert pedestal.faces is not None
    frame = np.column_stack([*plane_axes(pedestal.normal), pedestal.normal])
    ground_m, faces = (pedestal.vertices_m - pedestal.point_m) @ frame, pedestal.faces
    cell_m, half, centre = _CELL_SHARE * size_m, int(_REACH / _CELL_SHARE), np.array(centre_m)
    low_m = centre - half * cell_m
    places = low_m + (np.indices((2 * half, 2 * half)).reshape(2, -1).T + 0.5) * cell_m
    height_m = height_below(places, ground_m, faces, highest=True).reshape(2 * half, 2 * half)
    steepest = np.tan(np.radians(FLAT_DEG))
    falls, rises = ~(height_m >= -off_m), height_m > off_m
    if not is_drawn:
        for axis in (0, 1):
            ahead, behind = (np.moveaxis(height_m, axis, 0)[part] for part in (np.s_[1:], np.s_[:-1]))
            is_step = np.abs(ahead - behind) > steepest * cell_m
            goes_down = -np.minimum(ahead, behind) > np.maximum(ahead, behind)
            for mark, those in ((falls, is_step & goes_down), (rises, is_step & ~goes_down)):
                for part in (np.s_[1:], np.s_[:-1]):
                    np.moveaxis(mark, axis, 0)[part] |= those
        rises &= ~falls
    # What lies between the middles of cells: edges of ground that is off the plane, and ends of the mesh.
    corners = ground_m[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    top, bottom = corners[..., 2].max(axis=1), corners[..., 2].min(axis=1)
    is_steep = np.hypot(normal[:, 0], normal[:, 1]) > steepest * np.abs(normal[:, 2])
    goes_down, goes_up = bottom < -off_m, top > off_m
    _, welded = np.unique(ground_m.round(9), axis=0, return_inverse=True)
    half_edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, number, count = np.unique(
        np.sort(welded.ravel()[half_edges], axis=1), axis=0, return_inverse=True, return_counts=True
    )
    ends, box_m = (count[number.ravel()] == 1), half * cell_m
    of = np.repeat(np.arange(len(faces)), 3)
    for those, mark in (
        (ends | (is_steep & goes_down)[of], falls),
        ((is_steep & (goes_up if is_drawn else goes_up | ~goes_down))[of], rises),
    ):
        edge = ground_m[half_edges[those]]
        lies = (edge[..., :2].min(axis=1) < centre + box_m) & (edge[..., :2].max(axis=1) > centre - box_m)
        edge = edge[lies.all(axis=1)]
        parts = np.ceil(np.linalg.norm(edge[:, 1, :2] - edge[:, 0, :2], axis=1) / cell_m).astype(int) + 1
        owner = np.repeat(np.arange(len(parts)), parts)
        share = (np.arange(len(owner)) - np.repeat(np.cumsum(parts) - parts, parts)) / np.maximum(
            parts - 1, 1
        )[owner]
        along = edge[owner, 0] + share[:, None] * (edge[owner, 1] - edge[owner, 0])
        cell = np.floor((along[np.abs(along[:, 2]) < 10.0 * size_m, :2] - low_m) / cell_m).astype(int)
        cell = cell[((cell >= 0) & (cell < 2 * half)).all(axis=1)]
        thin = np.zeros_like(mark)
        thin[tuple(cell.T)] = True
        mark |= ndimage.binary_dilation(thin, np.ones((3, 3), bool))
    return low_m, cell_m, falls, rises
