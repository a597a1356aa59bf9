"""The rock's underside: seen at the rim, hidden within, touching only where the pedestal is hidden too."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import ConvexHull, cKDTree

from toppling.models.arrays import Array, Flags
from toppling.models.hidden_base.near_interface import DRAWN, NearInterface, UnseenSide
from toppling.models.scan.crevice import Grid, check_seen, smooth_sheet
from toppling.models.scan.directions import SECTORS, sectors
from toppling.models.scan.interface import Interface
from toppling.models.scan.interface_hint import InterfaceHint

CELLS_PER_HEIGHT = 200
_MOST_CELLS_ACROSS = 400
"""A base twice as wide as the rock is high and wider is laid out in so many: a sheet of a million takes a minute."""
_RIM_CELLS = 5
"""Cells within which the lowest seen one carries the hidden base; the others are the rock's side."""
_RIM_SPREAD_PER_HEIGHT = 0.0003
"""Cells this little higher than the lowest are as low."""
_TENSION = 0.05
"""Tension of the hidden base's membrane over its plate's stiffness, cells: it keeps it from dipping below its rim."""
_CLOSING_CELLS = (12, 24, 48, 96)
"""Gaps in the seen rim, half as wide, that are bridged: the first that leave a base of some size."""
_LEAST_BASE_SHARE = 0.3
"""Share of the seen underside's convex hull that a hidden base takes up at least."""
_HOLE_STIFFNESS = 0.02
_RESTING_PER_HEIGHT = 0.0008
"""The rock rests where the closed underside is nearer to the plane than this: below what a scan resolves."""
_HOLE_SPACINGS = 1.3
"""A gap between seen points is a hole from this many of their spacings (to the seventh neighbour)."""
_CORE_OF_HOLES = 0.8
"""The rock rests where a foot's hole is at least this share of its greatest depth: skimming rays miss its border."""
_FLAT_SHARE = 0.5
"""A hole that takes up more than this share of the hidden base is a flat base, not a foot."""
_SIDE_PER_HEIGHT = 0.006
"""A side seen down to this height, with no pedestal seen behind it, stands on the pedestal."""
LEAST_GAP_PER_HEIGHT = 0.003
"""Gap left where the pedestal was seen below the rock: a ray went through, from a rim that is higher."""
_LIT_ENDS_SHARE = 0.7
"""Share of the way to a rim that nobody saw: pedestal seen farther out lies beside the rock and not below it."""
_PASSED_SHARE, _FEET_AROUND_SHARE, _PASSAGE_CELLS = 0.5, 0.5, 2
"""One sees through between feet where the pedestal shows below so much of what low parts enclose, and these stand in at
most such a share of the directions around it; cells beside what shows."""
_FEET_SHARE = 0.2
"""Or where what is hidden beside it, within all low parts, takes up so much of it: feet stand all around a sculpture; a
base that is seen through all around its middle has next to nothing there."""
_WIDEST_SPACING_CELLS = 4.0
"""Points farther apart than this are strays: no ray went through between them."""


@dataclass(frozen=True, eq=False)
class Base:
    """Height of the rock's underside over the interface plane."""

    grid: Grid
    height_m: Array  # (shape): height over the plane, 0 where the rock rests on it
    hidden: Flags  # (shape): where the underside was not seen
    side: UnseenSide | None = None  # over which the rim was not seen
    passage: Flags | None = None  # (shape): what of the hidden part one sees through, between feet


@dataclass(frozen=True, eq=False)
class Underside:
    """What was seen of the rock's underside, on the cells of a grid."""

    grid: Grid
    # (shape): least height of the rock's points over the interface plane, 0 where there are none.
    seen_m: Array
    # (shape): cells with points of the rock, those within its rim without, and those of the rim itself.
    seen: Flags
    hidden: Flags
    carries: Flags
    outline: Flags | None  # (shape): within the contact that the user outlined
    # (shape): how many cells deep a hidden cell lies in a hole of the pedestal's seen points; 0 where the
    # pedestal was seen.
    hole_depth: Array
    into_seen: Array  # (shape): cells from the hidden part
    # How the rim goes on where nobody saw it; the hidden part reaches to its likeliest outline.
    side: UnseenSide | None = None
    widest: Flags | None = None  # (shape): hidden on the widest of them
    # (shape): of the hidden part, what one sees through between feet.
    passage: Flags | None = None

    @property
    def may_be_hidden(self) -> Flags:
        """Cells (shape) of the base on one outline or another."""
        return self.hidden if self.widest is None else self.widest

    @classmethod
    def of(
        cls, near: NearInterface, hint: InterfaceHint | None = None, interface: Interface | None = None
    ) -> "Underside":
        """Underside from what was seen near the interface, on cells of its lattice if any.

        Raises InputError if next to nothing of the rock shows near it.
        """
        low, lit, height_m = near.low, near.lit, near.height_m
        check_seen(len(low), "rock", given=hint is not None)
        lattice_m = 0.0 if interface is None else interface.lattice_m
        cell = max(height_m / CELLS_PER_HEIGHT, float(np.ptp(low[:, :2], axis=0).max()) / _MOST_CELLS_ACROSS)
        if lattice_m and cell > height_m / CELLS_PER_HEIGHT:
            cell = lattice_m / max(1, round(lattice_m / cell))
        first, last = low[:, :2].min(axis=0) - 6 * cell, low[:, :2].max(axis=0) + 6 * cell
        side = None if hint is not None and hint.encloses else UnseenSide.of(low, led_down=near.led_down)
        if side is not None:
            first, last = np.minimum(first, side.reach_m[0]), np.maximum(last, side.reach_m[1])
        if lattice_m:
            first, last = np.floor(first / lattice_m) * lattice_m, np.ceil(last / lattice_m) * lattice_m
        grid = Grid.over(first, last, cell)
        seen_height, seen = _lowest(grid, low)
        hidden = _within_rim(seen)
        widest, shown = None, depth_of_holes(grid, lit) == 0.0
        if side is not None:
            ends = side.in_range(grid.nodes_m) & (side.share_out(grid.nodes_m) > _LIT_ENDS_SHARE)
            hidden, widest = _gone_on(grid, side, hidden, ~seen & ~(shown & ends))
        feet = _feet(grid, seen, shown)
        passed = bool(hidden.any() and (hidden & shown).sum() >= _PASSED_SHARE * hidden.sum())
        if on_feet := _stands_on_feet(grid, seen, hidden, feet, passed):
            hidden = hidden | feet
        outline = hint.inside(grid.nodes_m) if hint is not None and hint.encloses else None
        if outline is not None:
            seen, hidden = seen & ~outline, hidden | outline
        # Points at the border may be the pedestal beside the rock.
        within = ndimage.binary_erosion(hidden, iterations=3)
        depth = depth_of_holes(grid, lit[within.ravel()[grid.index(lit)]]) * hidden
        into_seen = ndimage.distance_transform_edt(~hidden)
        carries = _lowest_of_rim(seen_height, seen, height_m) | (seen & (into_seen > 8.0))
        passage = None
        if on_feet and passed and outline is None:
            lit_there = hidden & (depth == 0.0)
            passage = hidden & ndimage.binary_dilation(lit_there, iterations=_PASSAGE_CELLS)
        return cls(grid, seen_height, seen, hidden, carries, outline, depth, into_seen, side, widest, passage)

    def beyond_m(self, places_m: Array) -> Array | None:
        """How far places (n, 2) lie beyond each rim that was drawn (DRAWN, n); None where it was seen around."""
        side = self.side
        return None if side is None else np.array([side.beyond_m(places_m, k) for k in range(DRAWN)])

    def closed_by(self, sheet_m: Array, height_m: float) -> Base:
        """Base whose hidden part is a sheet; beside it the seen surface rules, and gives way within a few cells."""
        side = smooth_sheet(self.grid, np.where(self.seen, self.seen_m, 0.0), np.where(self.seen, 3.0, 0.0))
        away = 0.002 * height_m * np.maximum(self.into_seen - 1.0, 0.0)
        sheet = np.where(self.hidden, sheet_m, side - away)
        height = np.where(sheet < _RESTING_PER_HEIGHT * height_m, 0.0, sheet)
        return Base(self.grid, height, self.hidden, side=self.side, passage=self.passage)


def hidden_base(
    near: NearInterface,
    hint: InterfaceHint | None = None,
    interface: Interface | None = None,
) -> Base:
    """Close the underside: a sheet hung into its seen rim, resting where the pedestal was not seen.

    The rim's lowest points alone carry the sheet. The slope of the sides above them says nothing about the base: led
    inward, it would press every base flat.

    Parameters
    ----------
    near : NearInterface
    hint : InterfaceHint, optional
        If it is a contact outline, the rock rests inside it and nowhere else.
    interface : Interface, optional
        On the nodes of whose surface cells lie.

    Raises
    ------
    InputError
        If next to nothing of the rock shows near the interface.
    """
    under, height_m = Underside.of(near, hint, interface), near.height_m
    grid, outline, depth, hidden = under.grid, under.outline, under.hole_depth, under.hidden
    rests = _deepest(depth, hidden)
    if outline is not None:
        rests, depth = outline, np.where(outline, 10.0, 0.0)
    weight = np.where(under.carries, 3.0, np.where(rests, _HOLE_STIFFNESS * depth**2, 0.0))
    sheet = smooth_sheet(grid, np.where(under.carries, under.seen_m, 0.0), weight, tension=_TENSION)
    low_side = under.seen & (under.seen_m < _SIDE_PER_HEIGHT * height_m)
    to_the_side = ndimage.binary_dilation(low_side, iterations=3)
    sheet = np.where(rests & (to_the_side if outline is None else outline), 0.0, sheet)
    sheet = np.where(hidden & ~rests, np.maximum(sheet, LEAST_GAP_PER_HEIGHT * height_m), sheet)
    return under.closed_by(sheet, height_m)


def _within_rim(seen: Flags) -> Flags:
    """Cells within the seen rim, whose gaps (a wall stood before them) are bridged as far as is needed."""
    hull = ConvexHull(np.argwhere(seen)).volume
    for reach in _CLOSING_CELLS:
        # Filled while it is thick: through a rim of single cells what is outside gets in.
        thick = ndimage.binary_dilation(np.pad(seen, reach), iterations=reach)
        filled = ndimage.binary_erosion(ndimage.binary_fill_holes(thick), iterations=reach)
        hidden = filled[reach:-reach, reach:-reach] & ~seen
        hidden = _largest(ndimage.binary_opening(hidden, iterations=3))
        if hidden.sum() > _LEAST_BASE_SHARE * hull:
            break
    return hidden


def _gone_on(grid: Grid, side: UnseenSide, hidden: Flags, free: Flags) -> tuple[Flags, Flags]:
    """Cells of the base on the likeliest outline of the side that nobody saw, and on any.

    hidden: within what was seen of the rim.
    free: where nothing was seen that ends a base.
    """
    nodes = grid.nodes_m
    share = side.share_out(nodes)
    hidden = _largest(ndimage.binary_opening(hidden | (free & (share < 1.0)), iterations=3))
    for number in range(DRAWN):
        share = np.minimum(share, side.share_out(nodes, number))
    return hidden, hidden | _largest(hidden | (free & (share < 1.0) & side.in_range(nodes)))


def _stands_on_feet(grid: Grid, seen: Flags, hidden: Flags, feet: Flags, passed: bool) -> bool:
    """Whether the rock lies low in few directions around its hidden part, or that is passed between wide feet."""
    if not hidden.any() or not seen.any():
        return False
    if passed and (feet & ~hidden).sum() > _FEET_SHARE * hidden.sum():
        return True
    around = np.unique(sectors(grid.nodes_m[seen] - grid.nodes_m[hidden].mean(axis=0)))
    return len(around) <= _FEET_AROUND_SHARE * SECTORS


def _feet(grid: Grid, seen: Flags, shown: Flags) -> Flags:
    """Cells between what was seen of a rock's feet where the pedestal was not: those of each foot."""
    nodes = grid.nodes_m
    hull = ConvexHull(nodes[seen]).equations
    inside = (nodes @ hull[:, :2].T + hull[:, 2] <= 0.0).all(axis=-1)
    # Along the pedestal's edge runs a strip that a few points leave open.
    return ndimage.binary_opening(inside & ~seen & ~shown, iterations=2)


def _lowest_of_rim(height: Array, seen: Flags, height_m: float) -> Flags:
    """Seen cells that are the lowest around."""
    known = np.where(seen, height, np.inf)
    return seen & (known <= ndimage.minimum_filter(known, _RIM_CELLS) + _RIM_SPREAD_PER_HEIGHT * height_m)


def _largest(mask: Flags) -> Flags:
    """Keep the largest connected part."""
    parts, count = ndimage.label(mask)
    return parts == 1 + np.argmax(np.bincount(parts.ravel())[1:]) if count else mask


def _deepest(depth: Array, hidden: Flags) -> Flags:
    """Where the rock rests: the core of each hole, whose border skimming rays miss; all of a wide one."""
    holes, count = ndimage.label(depth > 0)
    if count == 0:
        return depth > 0
    deepest = np.append(0.0, ndimage.maximum(depth, holes, np.arange(1, count + 1)))
    deepest = np.where(deepest < 2.0, 1e9, deepest)  # cells: a gap between rows of points
    share = np.append(1.0, np.bincount(holes.ravel(), minlength=count + 1)[1:] / hidden.sum())
    least = np.where(share > _FLAT_SHARE, 0.0, _CORE_OF_HOLES * deepest)
    return (depth > 0) & (depth >= least[holes])


def _lowest(grid: Grid, points: Array) -> tuple[Array, Flags]:
    """Least height in each cell, and which cells hold points."""
    index = grid.index(points)
    order = np.lexsort((points[:, 2], index))
    cells, first = np.unique(index[order], return_index=True)
    height = np.zeros(grid.shape)
    seen = np.zeros(grid.shape, bool)
    height.ravel()[cells] = points[order, 2][first]
    seen.ravel()[cells] = True
    return height, seen


def depth_of_holes(grid: Grid, lit: Array) -> Array:
    """How many cells deep each cell lies in a hole of the pedestal's seen points; 0 where it was seen."""
    if len(lit) < 10:
        return np.full(grid.shape, 10.0)
    tree = cKDTree(lit[:, :2])
    distance, nearest = tree.query(grid.nodes_m.reshape(-1, 2))
    used, inverse = np.unique(nearest, return_inverse=True)
    spacing = tree.query(lit[used, :2], 7)[0][:, -1]
    spacing = np.clip(spacing, grid.cell_m, _WIDEST_SPACING_CELLS * grid.cell_m)[inverse]
    return np.minimum(np.maximum(distance - _HOLE_SPACINGS * spacing, 0.0) / grid.cell_m, 10.0).reshape(
        grid.shape
    )
