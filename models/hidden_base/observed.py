"""Observations of the gap between rock and pedestal by a scan, and the places without any."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy import ndimage
from scipy.spatial import ConvexHull, cKDTree

from toppling.models.arrays import Array, Flags, Indices
from toppling.models.errors import InputError
from toppling.models.hidden_base.gap import (
    LEAST_GAP_PER_HEIGHT,
    BaseObservation,
    Relief,
    Underside,
)
from toppling.models.hidden_base.inspection import Inspection
from toppling.models.hidden_base.near_interface import BESIDE_PER_GAP, BESIDE_PER_HEIGHT, NearInterface
from toppling.models.pedestal import Pedestal
from toppling.models.relief import height_below
from toppling.models.scan.crevice import depth_of_holes
from toppling.models.scan.interface import Interface

PLACES_ACROSS = 21
"""Places of the hidden base over the root of its area."""
_MOST_RIM = 160
"""Places of the rim that carry its seen gap."""
_RIM_CELLS = 8.0
"""Cells from the hidden part within which what was seen is its rim."""
_RIM_WINDOW, _RIM_RISES_PER_CELL = 13, 0.8
"""The rim is what of it is as low as all within a window of cells, but for so much: a rim may rise along itself."""
_STD_PER_SPACING, _STD_PER_SPACING_AT_CONTACT = 0.19, 0.29
"""Error of the gap below a steep side's lowest seen point, over the distance of its fourth neighbour; where the side
may go down to the pedestal, it ends anywhere within a spacing."""
_LEAST_STD_PER_SPACING = 0.02
"""Error of the gap below a level underside, which does not go on downward."""
_SPACING_OVER = 15
"""Places of the rim over which the points' spacing is taken."""
_BELOW_GAPS, _BELOW_TO_GAPS, _BELOW_PER_HEIGHT = 1.2, 2.5, 0.006
"""A steep side that hangs may go on down: it ends where the pedestal was seen at least so many of its gaps farther in
(looked for to so many gaps and twice this share of the height, this share to the sides)."""
_STEEP = 0.7
"""Horizontal part of a side's normal from which it may go on down, as a level underside does not."""
UNSEEN_STD_SHARE = 0.3
"""Spread of a gap about the middle of the range in which it may lie, over that range."""
_CLOSED_STDS = 2.0
"""A rim that hangs by fewer standard deviations of its error may be closed; others do not touch."""
_FLATTEST_RAY = 0.07
"""Tangent over the pedestal of the flattest ray (4 degrees) that lights it below a rock."""
_NEIGHBOURS, _OF_SIDE = 5, 6
"""Points by which the pedestal, and a rock's side, are known at a place; the place's own point is one of them."""
_FARTHER_OUT = 8
"""So many times these points tell the pedestal's slope and relief."""
_SMOOTHED_OVER = 10
"""Patches of a rock's side in whose plane each of them is taken."""
_RIM_BORDER = 3.0
"""Cells from the hidden part's border: points there may be the pedestal beside the rock."""
_LIT_CELLS = 2.0
"""Depth of a hole in the pedestal's seen points, cells, below which it counts as seen."""
_SHAPES_PER_WIDTH = (0.003, 0.012, 0.04)
"""Priors tried: standard deviation of what a base bulges, over the root of its area ..."""
_LENGTHS_PER_WIDTH = (0.25, 0.7, 2.0)
"""... and over what length."""
_LONG_PER_WIDTH = 0.5
"""Length above which the base sees a part of the correlation, so that its deviation is raised in proportion."""
_ROUGH_PER_WIDTH, ROUGH_LENGTH_PER_WIDTH = (0.0005, 0.003, 0.01), 0.07
_CURVATURE_PER_SHAPE = 8.0
"""Curvature of the whole base, times its width, over the shape's deviation."""
LEVEL_PER_WIDTH = 0.1
_OUTLINE_STD_PER_HEIGHT = 0.0015
"""Error of the gap along an outline of the contact."""
BAND_PER_HEIGHT = 0.15
"""Clearance, over the rock's height, below which a draw's feet replace those of the scene's meshes."""
_CLOSED_PER_HEIGHT = 1e-4
"""Least gap of what is known not to touch, however near it is."""
_SHOWN_SHARE = 0.5
"""Share of what low parts enclose: where so much of the pedestal shows and nothing is hidden, they touch nowhere."""
_NOT_UNDER_THE_ROCK = 0.05
"""Share of the height beyond which a place of an inspection, beside the hidden base or off the interface, is none of
the base."""
_LIT_IN_FRONT = 0.1
"""Share of the height for daylight beside it, which shows in front of the crevice, where the side has risen already."""


@dataclass(frozen=True, eq=False)
class HiddenPart:
    """Places over the hidden base, what was seen of the gap there, and how they map to the grid."""

    under: Underside
    observed: BaseObservation
    width_m: float  # root of the hidden area
    inner: int  # so many of the places, the first ones, lie on a square grid over the hidden area
    inspection: Inspection  # in the scene's frame; its places lie at the base
    side_m: Array  # (s, 3): what was seen of the rock beside the hidden area, u, v and its clearance
    free_m: Array  # (k,): the least gap that rays left where rock and pedestal are said to touch
    beyond: Flags  # (shape): over land so far below the interface that a rock that tips does not meet it
    pedestal: Pedestal | None = None  # its surface around the rock; None: the interface

    @property
    def in_closing(self) -> Flags:
        """Which of the inner places lie on the likeliest outline."""
        under = self.under
        return under.hidden.ravel()[under.grid.index(self.observed.places_m[: self.inner])]


@dataclass(frozen=True, eq=False)
class Rim:
    """Places (k, 2) of a rim, the gap there (k,), what is known of its errors as in :class:`BaseObservation` (k,)."""

    places_m: Array
    gap_m: Array
    std_m: Array
    shared_m: Array
    group: Indices
    drop_m: Array  # (k,): of the pedestal below the interface
    inward_m: Array  # (k,): over which it rises again to the interface, as it does farther out

    @property
    def least_m(self) -> Array:
        """Least gap (k,) within the errors of what was seen; below 0 where the rim may be closed."""
        return self.gap_m - _CLOSED_STDS * np.hypot(self.std_m, self.shared_m)

    def drop_at_m(self, places_m: Array) -> Array:
        """How far (n,) the pedestal has dropped from the interface at places (n, 2), as at the nearest of the rim."""
        if not len(self.drop_m):
            return np.zeros(len(places_m))
        away, nearest = cKDTree(self.places_m).query(places_m)
        return self.drop_m[nearest] * np.maximum(1.0 - away / np.maximum(self.inward_m[nearest], 1e-9), 0.0)


def hidden_part(
    under: Underside,
    near: NearInterface,
    inspection: Inspection,
    interface: Interface,
    pedestal: Pedestal | None = None,
) -> HiddenPart:
    """Lay places over the hidden base and its rim, and collect what is known of the gap by sight and inspection.

    pedestal: what the clearance of the rock's side is taken over; the interface if not given.

    Raises InputError if a place of the inspection is none of the base, or no base is enclosed.
    """
    low, lit, height_m = near.low, near.lit, near.height_m
    _check_on_interface(inspection, interface, height_m)
    grid, cell = under.grid, under.grid.cell_m
    width_m = cell * float(np.sqrt((under.hidden & ~under.apart).sum()))
    if not width_m:
        raise _no_base(under, low, lit)
    stride = max(1, round((interface.lattice_m or width_m / PLACES_ACROSS) / cell))
    chosen = np.zeros(grid.shape, bool)
    chosen[::stride, ::stride] = True
    inner = grid.nodes_m[under.may_touch & chosen]
    rim = _outlined(under, height_m) if under.outline is not None else _seen_rim(under, low, lit, height_m)
    _check_under_the_rock(inspection, interface, np.vstack([inner, rim.places_m]), height_m)
    inspection = _below_the_rock(inspection, interface, under)
    inspected = interface.over(inspection.places_m)[:, :2]
    places = np.vstack([inner, rim.places_m, inspected])
    first = np.cumsum([len(inner), len(rim.gap_m), len(inspection.touching_m)])
    floor, least_m = np.zeros(len(places)), LEAST_GAP_PER_HEIGHT * height_m
    least_gap = _least_gap(under).ravel()
    floor[: first[0]] = least_gap[grid.index(inner)]
    floor[first[0] : first[1]] = np.maximum(
        least_m * under.apart.ravel()[grid.index(rim.places_m)], rim.least_m
    )
    if inspection.touch_only:
        floor = np.maximum(floor, _CLOSED_PER_HEIGHT * height_m)
    touching = np.arange(first[1], first[2])
    floor[touching] = 0.0
    floor[first[2] : first[2] + len(inspection.open_m)] = least_m
    observed = BaseObservation(
        places,
        np.arange(first[0], first[1]),
        rim.gap_m,
        rim.std_m,
        rim.shared_m,
        rim.group,
        floor,
        touching,
        under.beyond_m(places),
        rim.drop_at_m(places),
    )
    adjacent = near.patches[~under.may_touch.ravel()[grid.index(near.patches)]]
    side = _smoothed(clearances(adjacent, interface, pedestal))
    free_m = least_gap[grid.index(places[touching])]
    beyond = under.apart.copy()
    if near.apart is not None and beyond.any():
        land = near.apart[0][near.apart[0][:, 2] < 0.0]
        below_m = -land[cKDTree(land[:, :2]).query(grid.nodes_m[beyond])[1], 2]
        beyond[beyond] = below_m > BAND_PER_HEIGHT * height_m
    return HiddenPart(under, observed, width_m, len(inner), inspection, side, free_m, beyond, pedestal)


def clearances(places_m: Array, interface: Interface, pedestal: Pedestal | None) -> Array:
    """Places (k, 3) over an interface, with their heights over the pedestal's surface; those beside it left out."""
    if pedestal is None or pedestal.vertices_m is None or pedestal.faces is None:
        return places_m
    ground = interface.flat(pedestal.vertices_m)
    relief_m = (
        height_below(places_m[:, :2], ground, pedestal.faces, highest=True) - interface.rise(places_m)[:, 2]
    )
    return (places_m - np.pad(relief_m[:, None], ((0, 0), (2, 0))))[np.isfinite(relief_m)]


def _no_base(under: Underside, low: Array, lit: Array) -> InputError:
    """Say why nothing is hidden: the pedestal shows all below the rock, or the rock's foot was not seen around."""
    hull, nodes = ConvexHull(low[:, :2]).equations, under.grid.nodes_m
    inside = (nodes @ hull[:, :2].T + hull[:, 2] < 0.0).all(axis=-1)
    if (depth_of_holes(under.grid, lit) == 0.0)[inside].mean() > _SHOWN_SHARE:
        return InputError(
            "base.nothing_hidden",
            f"the pedestal was seen everywhere below the rock, which hangs {low[:, 2].min():.3g} m over it and more: "
            "it touches nowhere",
            where="the base",
            expected="a rock that stands on its pedestal, and hides it where it does",
            remedy="give rock and pedestal in one frame, the rock as it stands, with its foot; or say where they meet "
            "by --plane",
        )
    return InputError(
        "base.not_enclosed",
        "no hidden base is enclosed by what was seen of the rock's foot",
        where="the base",
        expected="the foot of the rock seen from several sides, all around what no laser sees",
        remedy="one side is not enough: scan the rock's foot from the other sides",
    )


def _seen_rim(under: Underside, low: Array, lit: Array, height_m: float) -> Rim:
    """The rim as far as it was seen."""
    rim = _lowest_points(under, low)
    rim = rim[_spread(rim[:, :2], _MOST_RIM)]
    shown = cKDTree(lit[:, :2])
    drop, drop_std, slope, adjacent = _drop_below(rim, lit)
    gap = rim[:, 2] + drop
    hangs = np.maximum(gap, 0.0)
    to_its_end = adjacent < BESIDE_PER_HEIGHT * height_m + BESIDE_PER_GAP * hangs
    end_std, off_m, steep = _errors(rim, hangs, low)
    to_its_end[steep] &= _shows_below(under, rim[steep, :2], hangs[steep], shown, height_m)
    to_its_end |= ~steep  # a level underside that was seen is the underside there
    std = np.hypot(np.hypot(end_std, off_m), drop_std)
    shared = np.full(len(rim), np.sqrt((end_std[to_its_end] ** 2).mean()) if to_its_end.any() else 0.0)
    # A rim that was not seen to its end goes down no farther than to the interface, or from below it to the pedestal.
    goes_on = np.where(rim[:, 2] > 0.0, np.minimum(rim[:, 2], hangs), hangs)
    # What stands above the interface beside the rock may be soil or plants, over a pedestal that lies in the interface.
    buried = np.maximum(-drop, 0.0)
    half_unseen = np.maximum(UNSEEN_STD_SHARE * goes_on, std)
    return Rim(
        rim[:, :2],
        np.where(to_its_end, gap, gap - 0.5 * goes_on) + 0.5 * buried,
        np.hypot(np.where(to_its_end, std, half_unseen), UNSEEN_STD_SHARE * buried),
        np.where(to_its_end, shared, half_unseen),
        to_its_end.astype(np.intp),
        drop,
        (np.abs(drop) / np.maximum(slope, 1e-9)),
    )


def _smoothed(places: Array) -> Array:
    """Places (k, 3) of a surface in the planes of their neighbours: the hull of noisy ones bulges, and topples late."""
    if len(places) < _SMOOTHED_OVER:
        return places
    around = places[cKDTree(places).query(places, _SMOOTHED_OVER)[1]]
    middle = around.mean(axis=1)
    normal = np.linalg.svd(around - middle[:, None], full_matrices=False)[2][:, 2]
    return places - ((places - middle) * normal).sum(axis=1)[:, None] * normal


def _drop_below(places: Array, lit: Array) -> tuple[Array, Array, Array, Array]:
    """How far (k,) below the interface the pedestal lies that shows nearest to each of some places (k, 3).

    Second, the standard deviation (k,) of that: what shows lies so far off a plane, as rubble and grass do, and
    slopes. Third, its slope (k,) against the interface. Fourth, how far (k,) it shows from each.
    """
    if len(lit) < _NEIGHBOURS * _FARTHER_OUT or not len(places):
        return (*np.zeros((3, len(places))), np.full(len(places), np.inf))
    away, nearest = cKDTree(lit[:, :2]).query(places[:, :2], _NEIGHBOURS * _FARTHER_OUT)
    around = np.dstack([lit[nearest, :2] - places[:, None, :2], np.ones(nearest.shape)])
    heights_m = lit[nearest, 2:]
    plane = np.linalg.pinv(around) @ heights_m
    off_m = (heights_m - around @ plane)[:, :, 0]
    relief_m = np.sqrt((off_m**2).sum(axis=1) / (off_m.shape[1] - plane.shape[1]))
    slope = np.linalg.norm(plane[:, :2, 0], axis=1)
    drop_m = -heights_m[:, :_NEIGHBOURS, 0].mean(axis=1)
    return drop_m, np.hypot(relief_m, slope * away[:, 0]), slope, away[:, 0]


def _shows_below(under: Underside, places: Array, hangs: Array, shown: cKDTree, height_m: float) -> Flags:
    """Where (k,) the pedestal shows so far in below places (k, 2) of a rim that hangs that its side goes on no more."""
    shows = np.zeros(len(places), bool)
    core = under.grid.nodes_m[ndimage.binary_erosion(under.hidden, iterations=int(_RIM_BORDER))]
    if not len(core):
        return shows
    toward = core[cKDTree(core).query(places)[1]] - places
    inward = toward / np.linalg.norm(toward, axis=1, keepdims=True)
    margin_m = _BELOW_PER_HEIGHT * height_m
    reach_m = _BELOW_TO_GAPS * hangs + 2.0 * margin_m
    for number, near in enumerate(shown.query_ball_point(places, reach_m)):
        away, (x, y) = shown.data[near] - places[number], inward[number]
        between = np.abs(away @ [-y, x]) < margin_m
        shows[number] = (away[between] @ [x, y] > _BELOW_GAPS * hangs[number]).any()
    return shows


def _errors(rim: Array, hangs: Array, low: Array) -> tuple[Array, Array, Flags]:
    """Standard deviation (k,) of where the side ends below each place of a rim that hangs so high, m.

    Second, how far the place lies off the plane of its neighbours (k,), m. Third, where (k,) the side is steep.
    """
    away, nearest = cKDTree(low).query(rim, _OF_SIDE)
    apart_m = rim[:, None, :2] - rim[None, :, :2]
    around = np.argsort((apart_m**2).sum(axis=2), axis=1)[:, :_SPACING_OVER]
    spacing = np.median(away[around, _NEIGHBOURS - 1], axis=1)
    others = low[nearest[:, 1:]]
    middle = others.mean(axis=1)
    normal = np.linalg.svd(others - middle[:, None], full_matrices=False)[2][:, 2]
    steepness = np.hypot(normal[:, 0], normal[:, 1])
    at_contact = np.clip(2.0 - hangs / spacing, 0.0, 1.0)
    of_side = _STD_PER_SPACING + (_STD_PER_SPACING_AT_CONTACT - _STD_PER_SPACING) * at_contact
    steep = steepness > _STEEP
    end_std = np.hypot(np.where(steep, of_side * steepness, 0.0), _LEAST_STD_PER_SPACING) * spacing
    return end_std, np.abs(((rim - middle) * normal).sum(axis=1)), steep


def _outlined(under: Underside, height_m: float) -> Rim:
    """Rim along the border of a contact that the user outlined: there the gap is closed."""
    assert under.outline is not None
    border = under.outline & ~ndimage.binary_erosion(under.outline)
    at = under.grid.nodes_m[border]
    at = at[_spread(at, _MOST_RIM)]
    std = np.full(len(at), _OUTLINE_STD_PER_HEIGHT * height_m)
    none = np.zeros(len(at))
    return Rim(at, none, std, std, np.ones(len(at), np.intp), none, none)


def _check_on_interface(inspection: Inspection, interface: Interface, height_m: float) -> None:
    """Refuse a place of an inspection (scene frame) that lies off the interface by more than a share of the height."""
    over = interface.over(inspection.places_m)[:, 2]
    off = np.abs(over) > _NOT_UNDER_THE_ROCK * height_m
    if off.any():
        number = int(off.argmax())
        also = f", and so do {off.sum() - 1} more of {len(off)} places" if off.sum() > 1 else ""
        raise inspection.misplaced(
            "base.place_off_interface",
            number,
            f"the place lies {abs(over[number]):.3g} m {'above' if over[number] > 0 else 'below'} the interface, "
            f"{100 * abs(over[number]) / height_m:.0f} % of the rock's height{also}",
            f"places at the base, within {_NOT_UNDER_THE_ROCK * height_m:.2g} m of the interface",
            "check the height (z) and its datum; if the interface is wrong, give it by --plane, --point or --outline",
        )


def _check_under_the_rock(
    inspection: Inspection, interface: Interface, places: Array, height_m: float
) -> None:
    """Refuse a place of an inspection that is none of the base."""
    if not len(inspection.places_m):
        return
    away_m = cKDTree(places).query(interface.over(inspection.places_m)[:, :2])[0]
    counts = len(inspection.touching_m), len(inspection.open_m)
    beyond_m = away_m - height_m * np.repeat([_NOT_UNDER_THE_ROCK, _LIT_IN_FRONT], counts)
    if beyond_m.max() > 0.0:
        number = int(beyond_m.argmax())
        raise inspection.misplaced(
            "base.place_off_base",
            number,
            f"the place lies {away_m[number]:.3g} m from the hidden base and its rim",
            "places below the rock, where it may touch its pedestal",
            "give them in the coordinates of the clouds, in metres",
        )


def _below_the_rock(inspection: Inspection, interface: Interface, under: Underside) -> Inspection:
    """Move places to the base: one in front of the crevice, as seen from outside, to its nearest cell."""
    cells = under.grid.nodes_m[under.hidden]
    cells_m = interface.scene(np.pad(cells, ((0, 0), (0, 1))) + interface.rise(cells))

    def moved(places_m: Array) -> Array:
        away, nearest = cKDTree(cells).query(interface.over(places_m)[:, :2])
        return np.where((away > under.grid.cell_m)[:, None], cells_m[nearest], places_m)

    return replace(inspection, touching_m=moved(inspection.touching_m), open_m=moved(inspection.open_m))


def _lowest_points(under: Underside, low: Array) -> Array:
    """Lowest point (k, 3) of each cell of the rim."""
    index = under.grid.index(low)
    order = np.lexsort((low[:, 2], index))
    cells, first = np.unique(index[order], return_index=True)
    known = np.where(under.seen, under.seen_m, np.inf)
    lowest = known <= ndimage.minimum_filter(known, _RIM_WINDOW) + _RIM_RISES_PER_CELL * under.grid.cell_m
    of_rim = (lowest & under.seen & (under.into_seen <= _RIM_CELLS)).ravel()[cells]
    return low[order][first[of_rim]]


def _least_gap(under: Underside) -> Array:
    """Least gap along a ray that lit the pedestal below the rock: larger, the farther it went on inward."""
    lit = (
        under.hidden
        & (under.hole_depth < _LIT_CELLS)
        & (ndimage.distance_transform_edt(under.hidden) > _RIM_BORDER)
    )
    if under.outline is not None:
        lit &= ~under.outline
    return np.asarray(_FLATTEST_RAY * under.grid.cell_m * ndimage.distance_transform_edt(lit) * lit)


def _spread(places: Array, most: int) -> Indices:
    """Numbers of at most so many places that lie spread, the corners of their hull among them."""
    if len(places) <= most:
        return np.arange(len(places))
    chosen = list(ConvexHull(places).vertices[:most])
    away = np.linalg.norm(places[:, None] - places[chosen], axis=2).min(axis=1)
    while len(chosen) < most:
        far = int(away.argmax())
        chosen.append(far)
        away = np.minimum(away, np.linalg.norm(places - places[far], axis=1))
    return np.array(sorted(chosen))


def reliefs(width_m: float) -> list[Relief]:
    """Priors of the gap, from nearly flat to much bulged, and of the base over the interface."""
    return [
        Relief(
            LEVEL_PER_WIDTH * width_m,
            shape * width_m * max(1.0, length / _LONG_PER_WIDTH),
            length * width_m,
            rough * width_m,
            ROUGH_LENGTH_PER_WIDTH * width_m,
            _CURVATURE_PER_SHAPE * shape / width_m,
        )
        for shape, length, rough in product(_SHAPES_PER_WIDTH, _LENGTHS_PER_WIDTH, _ROUGH_PER_WIDTH)
    ]
