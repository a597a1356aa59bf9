"""The crevice at full resolution: which points below the rock are pedestal, and where neither side was seen.

A scanner that looks under a rock sees the pedestal through the crevice long before it sees the rock's underside.
The pedestal is therefore followed as one smooth sheet from outside to under the rock; what lies on the sheet is
pedestal, what hangs above it is rock, and the rock can touch it only where the sheet was not seen.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_matrix, csc_matrix, diags
from scipy.sparse.linalg import splu
from scipy.spatial import ConvexHull, cKDTree

from toppling.models.arrays import Array, Flags, Indices, bounds_of, inside_box
from toppling.models.errors import InputError
from toppling.models.scan.interface import LEAST_SEEN, UPWARD, Interface, middle, sectors
from toppling.models.scan.segment import PEDESTAL, ROCK
from toppling.models.scan.surfels import Surfels

_CELLS_PER_PATCH = 1.2
_BAND_PER_HEIGHT = 0.08
"""Height over the interface plane up to which points are judged anew."""
_RELIEFS, _RELIEF_PER_HEIGHT = 3.0, 0.001
"""Standard deviations of the pedestal's relief about the interface above which it hardly rises under the rock, and
the least one, over the rock's height."""
_FOOT_PER_HEIGHT = 0.006
"""Distance outside the rock's outline on the ground up to which points that overhang the sheet are the rock's."""
_HOLE_SPACINGS = 1.3
"""A gap between seen points is a hole from this many of their spacings (to the seventh neighbour)."""
_WIDEST_SPACING_CELLS = 4.0
"""Points farther apart than this are strays: no ray went through between them."""
BELOW_PER_HEIGHT = 0.03
"""Depth below the interface over the rock's height beyond which a rock touches no land, and hangs over no edge."""


@dataclass(frozen=True, eq=False)
class Grid:
    """Square cells over the interface plane."""

    first_m: Array  # (2,): centre of cell (0, 0), u and v
    cell_m: float
    shape: tuple[int, int]

    @classmethod
    def over(cls, low_m: Array, high_m: Array, cell_m: float) -> "Grid":
        """Grid that covers a rectangle."""
        size = np.ceil((high_m - low_m) / cell_m).astype(int) + 1
        return cls(np.asarray(low_m, float), cell_m, (int(size[0]), int(size[1])))

    def index(self, flat_m: Array) -> Indices:
        """Return the number of the cell nearest to each point, the border's for those outside."""
        where = np.rint((flat_m[:, :2] - self.first_m) / self.cell_m).astype(np.int64)
        where = np.clip(where, 0, np.array(self.shape) - 1)
        return where[:, 0] * self.shape[1] + where[:, 1]

    def at(self, values: Array, flat_m: Array) -> Array:
        """Bilinear interpolation of values on the grid."""
        where = (flat_m[:, :2] - self.first_m) / self.cell_m
        return ndimage.map_coordinates(values, where.T, order=1, mode="nearest")

    @property
    def nodes_m(self) -> Array:
        """Centres of the cells (*shape, 2)."""
        ticks_m = (np.arange(count) * self.cell_m for count in self.shape)
        return np.stack(np.meshgrid(*ticks_m, indexing="ij"), -1) + self.first_m


def smooth_sheet(grid: Grid, target: Array, weight: Array, tension: float = 1e-3) -> Array:
    """Heights that bend least (thin plate) while they follow weighted targets; both of the grid's shape.

    A trace of membrane, its tension over the plate's stiffness, keeps far ends level instead of running away.
    """
    laplacian = grid_laplacian(grid.shape)
    system = diags(weight.ravel()) + laplacian @ laplacian + tension * laplacian
    factors = splu(csc_matrix(system), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0)  # it is symmetric
    return factors.solve(weight.ravel() * target.ravel()).reshape(grid.shape)


def grid_laplacian(shape: tuple[int, ...]) -> csc_matrix:
    """Laplacian of the graph that joins each node of a grid with its neighbours along both axes."""
    number = np.arange(shape[0] * shape[1]).reshape(shape)
    ends = (number[:-1], number[1:]), (number[:, :-1], number[:, 1:])
    pairs = np.vstack([np.column_stack([first.ravel(), last.ravel()]) for first, last in ends])
    adjacent = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(number.size, number.size))
    adjacent = adjacent + adjacent.T
    return csc_matrix(diags(np.asarray(adjacent.sum(axis=1)).ravel()) - adjacent)


def grid_triangles(shape: tuple[int, ...]) -> Indices:
    """Triangles (m, 3) of a grid's cells, each halved from its first node to the one across."""
    number = np.arange(shape[0] * shape[1]).reshape(shape)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    halves = np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)
    return np.concatenate(halves)


def judge_crevice(
    points_m: Array,
    label: NDArray[np.int8],
    interface: Interface,
    height_m: float,
    voxel_m: float,
    apart: tuple[Array, Array] | None = None,
    *,
    given: bool = False,
) -> NDArray[np.int8]:
    """Judge the labels near the interface anew, by the pedestal's sheet, but where the two were :func:`seen_apart`.

    Where a belly hides the rock's foot, or the pedestal beside it, no crevice was seen and nothing is judged.

    Raises InputError if next to nothing of the rock or of the pedestal shows near the interface.
    """
    low = points_m[(label == ROCK) & (np.abs(interface.height_m(points_m)) < _BAND_PER_HEIGHT * height_m)]
    if len(low) < LEAST_SEEN and not given:
        return label
    check_seen(len(low), "rock", given=given)
    margin = 0.15 * height_m
    lowest, highest = bounds_of(low)
    around = np.flatnonzero(inside_box(points_m, lowest - margin, highest + margin))
    flat = interface.over(points_m[around])
    low = flat[(label[around] == ROCK) & (flat[:, 2] < _BAND_PER_HEIGHT * height_m)]
    margin = 0.12 * height_m
    grid = Grid.over(
        low[:, :2].min(axis=0) - margin, low[:, :2].max(axis=0) + margin, voxel_m / _CELLS_PER_PATCH
    )
    inside = np.abs(flat[:, 2]) < _BAND_PER_HEIGHT * height_m
    inside &= inside_box(flat[:, :2], grid.first_m, grid.nodes_m[-1, -1])
    near, near_label = flat[inside], label[around[inside]]
    adjacent = int((near_label == PEDESTAL).sum())
    if adjacent < LEAST_SEEN and not given:
        return label
    check_seen(adjacent, "pedestal", given=given)
    # Above its relief beside the rock the sheet would climb the rock's own foot.
    low_enough = (near_label == PEDESTAL) | (
        near[:, 2] < _RELIEFS * max(interface.roughness_m, _RELIEF_PER_HEIGHT * height_m)
    )
    low_enough &= ~cells_apart(grid, apart).ravel()[grid.index(near)]
    sheet, tolerance = _pedestal_sheet(grid, near, near_label == PEDESTAL, low_enough, height_m)
    gap = near[:, 2] - grid.at(sheet, near)
    on_sheet = (np.abs(gap) < tolerance) & low_enough
    # Only what the cut called rock is judged: a steep pedestal beside the rock stays pedestal.
    near_label = np.where((near_label == ROCK) & (gap < tolerance) & low_enough, PEDESTAL, near_label)
    near_label = np.where(on_sheet, PEDESTAL, near_label)
    # The cut runs through patches: what it cut off the rock's foot hangs over the sheet, at the rock's outline.
    rim = _rim_polygon(near[near_label == ROCK], height_m, given=given)
    # What lies below the interface's plane is a cliff's face, over which the sheet falls short.
    hanging = np.flatnonzero((near_label == PEDESTAL) & (np.minimum(gap, near[:, 2]) > tolerance))
    near_label[hanging[_outside(rim, near[hanging, :2]) < _FOOT_PER_HEIGHT * height_m]] = ROCK
    changed = label.copy()
    changed[around[inside]] = near_label
    return changed


def check_seen(points: int, side: str, *, given: bool) -> None:
    """Refuse an interface near which next to nothing of one side, rock or pedestal, was seen.

    Raises
    ------
    InputError
        With another remedy where the interface is given than where it was fitted.
    """
    if points >= LEAST_SEEN:
        return
    raise InputError(
        "interface.too_few_points",
        f"only {points} points of the {side} are left near the interface",
        where="the interface",
        expected="a plane on which rock and pedestal meet, each seen once",
        remedy="check its height and slope: given too high it cuts the rock, too low it runs below the pedestal"
        if given
        else "check that the stations fit each other, as one that is off shows the rock's foot twice (leave them "
        "out one by one); or scan the crevice from nearer and from more sides",
    )


def _pedestal_sheet(
    grid: Grid, flat: Array, pedestal: Flags, low_enough: Flags, height_m: float
) -> tuple[Array, float]:
    """Heights of the pedestal's sheet, and how far a point of it may lie from it.

    Starts from the points known to be pedestal, then takes in what is low enough and lies on the sheet under the rock.
    """
    taken = pedestal.copy()
    index = grid.index(flat)
    tolerance = 0.006 * height_m
    for _ in range(4):
        count = np.bincount(index[taken], minlength=grid.shape[0] * grid.shape[1])
        total = np.bincount(index[taken], flat[taken, 2], minlength=len(count))
        weight = np.minimum(count, 3.0).reshape(grid.shape)
        target = (total / np.maximum(count, 1)).reshape(grid.shape)
        sheet = smooth_sheet(grid, target, weight)
        gap = flat[:, 2] - grid.at(sheet, flat)
        noise = 1.4826 * float(np.median(np.abs(gap[taken])))
        tolerance = max(min(tolerance, 6.0 * noise), 3.5 * noise, 0.0015 * height_m)
        taken = (np.abs(gap) < tolerance) & low_enough
    return sheet, tolerance


def _rim_polygon(flat_rock: Array, height_m: float, *, given: bool) -> Array:
    """Convex polygon (k, 2), u and v, through the lowest seen point of the rock in each of 48 directions.

    Raises InputError if next to nothing of the rock shows near the interface.
    """
    low = flat_rock[np.abs(flat_rock[:, 2]) < _BAND_PER_HEIGHT * height_m]
    low = low[not_strays(low)]
    check_seen(len(low), "rock", given=given)
    sector = sectors(low[:, :2] - middle(low), 48)
    order = np.lexsort((low[:, 2], sector))
    _, first = np.unique(sector[order], return_index=True)
    lowest = low[order][first, :2]
    return lowest[ConvexHull(lowest).vertices]


def _outside(polygon: Array, points: Array) -> Array:
    """Distance of points (n, 2) from a convex, counter-clockwise polygon, 0 inside."""
    nearest = np.full(len(points), np.inf)
    inside = np.ones(len(points), bool)
    for start, end in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        edge = end - start
        offset = points - start
        share = np.clip(offset @ edge / (edge @ edge), 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(offset - share[:, None] * edge, axis=1))
        inside &= edge[0] * offset[:, 1] - edge[1] * offset[:, 0] >= 0
    return np.where(inside, 0.0, nearest)


def not_strays(points: Array, alone: float = 3.0) -> Flags:
    """Which points have their neighbours near: mixed pixels hang alone between rock and pedestal."""
    if len(points) < 7:
        return np.zeros(len(points), bool)  # nobody has six neighbours
    tree, distance = cKDTree(points, balanced_tree=False), np.empty(len(points))
    # In the order of the tree's leaves, queries are three times as fast.
    distance[tree.indices] = tree.query(points[tree.indices], 7)[0][:, 1:].mean(axis=1)
    return distance < alone * np.median(distance)


def seen_apart(surfels: Surfels, rock: Flags, interface: Interface, height_m: float) -> tuple[Array, Array]:
    """Places (k, 3) at which rock and pedestal cannot touch, and those (m, 3) of the pedestal at which they may.

    Land far below the interface that faces up was seen through the air above it, and a rock's underside hangs free
    where the pedestal that shows nearest to it is such land. What of the pedestal overhangs may reach over the land.

    rock: (n,), which patches are the rock's.
    height_m: of the rock.

    Returns them as u, v and height over the interface.
    """
    flat_m, upward = interface.over(surfels.points_m), surfels.normals @ interface.normal
    low = ~rock & (flat_m[:, 2] < -BELOW_PER_HEIGHT * height_m)
    land, under = low & (upward > UPWARD), rock & (upward < -UPWARD)
    may_touch = ~rock & ~(low & (upward >= 0.0))
    if land.any() and may_touch.any():
        to_land, to_others = (cKDTree(flat_m[of, :2]).query(flat_m[:, :2])[0] for of in (land, may_touch))
        land |= under & (to_land < to_others)
    return flat_m[land], flat_m[may_touch]


def cells_apart(grid: Grid, apart: tuple[Array, Array] | None) -> Flags:
    """Cells in which rock and pedestal cannot touch, by what :func:`seen_apart` found."""
    if apart is None or not all(map(len, apart)):
        return np.zeros(grid.shape, bool)
    nodes = grid.nodes_m.reshape(-1, 2)
    to_apart, to_others = (cKDTree(places[:, :2]).query(nodes)[0].reshape(grid.shape) for places in apart)
    return np.asarray((to_apart < to_others) & (depth_of_holes(grid, apart[0]) == 0.0))


def depth_of_holes(grid: Grid, lit: Array) -> Array:
    """How many cells deep each cell lies in a hole of the pedestal's seen points; 0 where it was seen."""
    if len(lit) < 10:
        return np.full(grid.shape, 10.0)
    tree = cKDTree(lit[:, :2])
    distance, nearest = tree.query(grid.nodes_m.reshape(-1, 2))
    used, inverse = np.unique(nearest, return_inverse=True)
    spacing = tree.query(lit[used, :2], 7)[0][:, -1]
    strewn = spacing > _WIDEST_SPACING_CELLS * grid.cell_m
    spacing = np.where(strewn, 0.0, np.maximum(spacing, grid.cell_m))[inverse]
    return np.minimum(np.maximum(distance - _HOLE_SPACINGS * spacing, 0.0) / grid.cell_m, 10.0).reshape(
        grid.shape
    )
