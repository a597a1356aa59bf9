"""Contact points of a rock on an uneven pedestal, reduced to an equivalent body on a plane.

Contact is determined by the clearance between rock and pedestal. Over the interface plane, the clearance of a point of
the rock is its height minus that of the pedestal below it, and that of a point of the pedestal (a bump, the edge of a
cliff) is the height of the rock's surface above it minus its own; where an edge of the rock crosses one of the
pedestal it is the difference of their heights. A foot is such a point with its clearance as height: a body with these
feet on the plane touches it where and when the rock touches the pedestal in a rocking motion. The approximation uses
the plane's normal at every contact, and moves the relief with the rock in a slip, so it is valid for relief with small
slopes and for slips that are short compared with it.
"""

from collections.abc import Iterator
from itertools import chain

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, cKDTree

from toppling.models.arrays import AT_ONCE, ROUNDING, Array
from toppling.models.caching import cached
from toppling.models.errors import InputError
from toppling.models.frames import plane_axes
from toppling.models.pedestal import Pedestal
from toppling.models.rock import Rock

_PIECE_FRACTION = 0.01
"""Length of the pieces of edges in the search of neighbours, as a fraction of the rock's size in plan."""

_HALVINGS = 10
"""Maximum number of bisections of a triangle: points at a sharp corner remain."""
_MANY_POINTS = 256
"""Number of points in a triangle's circle above which it is bisected."""
_SLENDER = 0.15
"""Fraction of that circle's area below which it is: an equilateral triangle has 0.41."""


@cached
def contact_feet_m(rock: Rock, pedestal: Pedestal) -> Array:
    """Points of the rock that can touch the interface plane, with the pedestal's relief included in their heights.

    Returns
    -------
    (n, 3) array
        Scene frame; the height over the interface plane is the clearance. On an infinite plane these are the vertices
        of the rock's convex hull, on a surface those of the convex hull of all feet, for a drawn base its feet.

    Raises
    ------
    InputError
        If the pedestal does not lie below the rock.
    """
    if rock.feet_m is not None:
        return rock.feet_m
    if pedestal.vertices_m is None or pedestal.faces is None:
        return rock.hull_vertices_m
    frame = np.vstack([*plane_axes(pedestal.normal), pedestal.normal])
    rock_points = (rock.vertices_m - pedestal.point_m) @ frame.T
    ground = (pedestal.vertices_m - pedestal.point_m) @ frame.T
    under_rock = height_below(rock_points[:, :2], ground, pedestal.faces, highest=True)
    over_ground = height_below(ground[:, :2], rock_points, rock.faces, highest=False)
    feet = np.vstack(
        [
            rock_points - np.column_stack([np.zeros((len(rock_points), 2)), under_rock]),
            np.column_stack([ground[:, :2], over_ground - ground[:, 2]]),
            *_crossings(
                ground[_edges_that_stand_out(ground, pedestal.faces)],
                rock_points[_edges_that_stand_out(rock_points * (1.0, 1.0, -1.0), rock.faces)],
            ),
        ]
    )
    feet = feet[np.isfinite(feet[:, 2])]
    if len(feet) < 3:
        raise InputError(
            "pedestal.not_below_rock",
            f"only {len(feet)} points of rock and pedestal lie over each other",
            where="scene",
            expected="a pedestal below the rock",
            remedy="check that rock and pedestal share one frame",
        )
    # Including the centre of mass, which is never lowest, makes the hull of coplanar feet non-degenerate.
    com = (rock.com_m - pedestal.point_m) @ frame.T
    corners = ConvexHull(np.vstack([feet, com])).vertices
    return feet[corners[corners < len(feet)]] @ frame + pedestal.point_m


def _edges_that_stand_out(vertices_m: Array, faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Edges (k, 2) of a surface that an edge above can touch between their ends: all except concave creases.

    A crease is an edge whose two triangles lie on different sides of it in plan, and neither below the other's plane.
    Along a straight edge that crosses above it, the ground on both sides is at least as high as these triangles, so the
    clearance on at least one side is not larger than above the crease, which cannot be a vertex of the feet's hull.
    This holds for any layers above, even if triangles intersect. Rims, ridges, and edges with a vertical triangle or
    with both on one side (the top of a wall, an overhang) are not creases.
    """
    # Rows: both ends of an edge, and the opposite corner.
    half = faces[:, [0, 1, 2, 1, 2, 0, 2, 0, 1]].reshape(-1, 3)
    start, end = half[:, :2].min(axis=1), half[:, :2].max(axis=1)
    name = start * len(vertices_m) + end
    order = np.argsort(name, kind="stable")
    begins = np.flatnonzero(np.diff(name[order], prepend=-1))
    joins_two = np.diff(begins, append=len(order)) == 2
    first = begins[joins_two]
    origin = vertices_m[start[order[first]]]
    along = vertices_m[end[order[first]]] - origin
    before, other = (vertices_m[half[order[place], 2]] - origin for place in (first, first + 1))
    normal = np.cross(along, before)
    side, other_side = normal[:, 2], along[:, 0] * other[:, 1] - along[:, 1] * other[:, 0]
    size_m = float(np.linalg.norm(np.ptp(vertices_m, axis=0)))
    opposite = (side * other_side < 0) & (np.minimum(abs(side), abs(other_side)) >= ROUNDING * size_m**2)
    with np.errstate(divide="ignore", invalid="ignore"):
        rise_m = (normal * other).sum(axis=1) / side
    joins_two[joins_two] = opposite & (rise_m >= -ROUNDING * size_m)
    edges = order[begins[~joins_two]]
    return np.column_stack([start[edges], end[edges]])


def _crossings(ground: Array, rock: Array) -> Iterator[Array]:
    """Yield feet (k, 3), in batches, where edges (n, 2, 3) of the ground pass below edges (m, 2, 3) of the rock."""
    low, high = rock[..., :2].min(axis=(0, 1)), rock[..., :2].max(axis=(0, 1))
    longest = _PIECE_FRACTION * float(np.linalg.norm(high - low))
    owner, middle, reach = _pieces(ground, low - longest, high + longest, longest)
    rock_owner, rock_middle, rock_reach = _pieces(rock, low - longest, high + longest, longest)
    tree = cKDTree(rock_middle)
    radius = (1.0 + 1e-6) * (reach + rock_reach.max())
    for piece, above in _near(tree, middle, radius):
        yield _crossing_points(ground[owner[piece]], rock[rock_owner[above]])


def _near(
    tree: cKDTree, middle: Array, radius: Array
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Yield pairs of circles and points of a tree inside them, in batches, as two index arrays."""
    count = tree.query_ball_point(middle, radius, return_length=True)
    batch = np.cumsum(count) // AT_ONCE
    for some in np.split(np.arange(len(middle)), np.flatnonzero(np.diff(batch)) + 1):
        near = chain.from_iterable(tree.query_ball_point(middle[some], radius[some]))
        yield np.repeat(some, count[some]), np.fromiter(near, int, count[some].sum())


def _pieces(
    edges: Array, low: Array, high: Array, longest_m: float
) -> tuple[NDArray[np.int64], Array, Array]:
    """Divide edges (n, 2, 3) in plan, clipped to a box, to pieces with few neighbours: owner, centre, half length."""
    start, along = edges[:, 0, :2], edges[:, 1, :2] - edges[:, 0, :2]
    with np.errstate(divide="ignore", invalid="ignore"):
        sides = np.stack([(low - start) / along, (high - start) / along])
    enters, leaves = sides.min(axis=0).max(axis=1).clip(min=0.0), sides.max(axis=0).min(axis=1).clip(max=1.0)
    owner = np.flatnonzero(enters < leaves)
    enters, leaves = enters[owner], leaves[owner]
    length = (leaves - enters) * np.linalg.norm(along[owner], axis=1)
    count = np.ceil(length / longest_m).astype(int).clip(min=1)
    place = np.repeat(np.cumsum(count) - count, count)
    share = (np.arange(count.sum()) - place + 0.5) / np.repeat(count, count)
    share = np.repeat(enters, count) + share * np.repeat(leaves - enters, count)
    owner = np.repeat(owner, count)
    return owner, start[owner] + share[:, None] * along[owner], np.repeat(0.5 * length / count, count)


def _crossing_points(below: Array, above: Array) -> Array:
    """Feet of those pairs of edges (n, 2, 3) that cross in plan.

    If another layer lies between the two, the foot is above that layer's feet, and so never touches.
    """
    along, over_span, offset = below[:, 1] - below[:, 0], above[:, 1] - above[:, 0], above[:, 0] - below[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        across = along[:, 0] * over_span[:, 1] - along[:, 1] * over_span[:, 0]
        here = (offset[:, 0] * over_span[:, 1] - offset[:, 1] * over_span[:, 0]) / across
        there = (offset[:, 0] * along[:, 1] - offset[:, 1] * along[:, 0]) / across
    met = (here >= 0) & (here <= 1) & (there >= 0) & (there <= 1)
    here, there = here[met, None], there[met]
    place = below[met, 0] + here * along[met]
    return np.column_stack([place[:, :2], above[met, 0, 2] + there * over_span[met, 2] - place[:, 2]])


def height_below(places_m: Array, vertices_m: Array, faces: NDArray[np.int64], *, highest: bool) -> Array:
    """Height of a triangulated surface at points of the plane.

    Parameters
    ----------
    places_m : (n, 2) array
    vertices_m : (k, 3) array
        Height in the third column.
    faces : (m, 3) int array
    highest : bool
        Whether to take the highest of several layers, instead of the lowest.

    Returns
    -------
    (n,) array
        NaN where there is no triangle.
    """
    if len(places_m) == 0:
        return np.zeros(0)
    x, y = vertices_m[:, 0], vertices_m[:, 1]
    size_m = np.array([x.max() - x.min(), y.max() - y.min()])
    low, high = places_m.min(axis=0) - ROUNDING * size_m, places_m.max(axis=0) + ROUNDING * size_m
    # A bit for each side of the places on which a vertex lies: a triangle with all on one side is below none.
    sides = ((x < low[0]) + 2 * (x > high[0]) + 4 * (y < low[1]) + 8 * (y > high[1])).astype(np.uint8)[faces]
    corners = vertices_m[faces[(sides[:, 0] & sides[:, 1] & sides[:, 2]) == 0]]
    flat = corners[:, :, :2]
    edge1, edge2 = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    area = edge1[:, 0] * edge2[:, 1] - edge1[:, 1] * edge2[:, 0]
    upright = np.abs(area) < ROUNDING * (size_m**2).sum()
    corners, flat, edge1, edge2, area = (a[~upright] for a in (corners, flat, edge1, edge2, area))
    rise1, rise2 = corners[:, 1, 2] - corners[:, 0, 2], corners[:, 2, 2] - corners[:, 0, 2]
    height = np.full(len(places_m), -np.inf if highest else np.inf)
    outermost = np.maximum if highest else np.minimum
    tree = cKDTree(places_m)
    owner, middle, radius = _circles(flat, tree)
    for piece, place in _near(tree, middle, radius):
        face = owner[piece]
        offset = places_m[place] - flat[face, 0]
        share1 = (offset[:, 0] * edge2[face, 1] - offset[:, 1] * edge2[face, 0]) / area[face]
        share2 = (edge1[face, 0] * offset[:, 1] - edge1[face, 1] * offset[:, 0]) / area[face]
        inside = (share1 >= -1e-9) & (share2 >= -1e-9) & (share1 + share2 <= 1 + 1e-9)
        layer = corners[face, 0, 2] + share1 * rise1[face] + share2 * rise2[face]
        outermost.at(height, place[inside], layer[inside])
    return np.where(np.isfinite(height), height, np.nan)


def _circles(triangles: Array, tree: cKDTree) -> tuple[NDArray[np.int64], Array, Array]:
    """Circles, slightly enlarged, that cover triangles (n, 3, 2): owner, centre, radius.

    A slender triangle is bisected at its longest edge while its circle contains many points of a tree, most of which
    lie outside the triangle.
    """
    owner, done = np.arange(len(triangles)), []
    wider = 1e-6 * np.linalg.norm(triangles - triangles.mean(axis=1)[:, None], axis=2).max(axis=1)
    for count in range(_HALVINGS + 1):
        middle, sides = triangles.mean(axis=1), np.roll(triangles, -1, axis=1) - triangles
        radius = np.linalg.norm(triangles - middle[:, None], axis=2).max(axis=1)
        area = 0.5 * np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
        is_slender = area < _SLENDER * np.pi * radius**2
        radius += wider[owner]
        cut = (
            is_slender
            & (count < _HALVINGS)
            & (tree.query_ball_point(middle, radius, return_length=True) > _MANY_POINTS)
        )
        done.append((owner[~cut], middle[~cut], radius[~cut]))
        if not cut.any():
            break
        longest = np.linalg.norm(sides[cut], axis=2).argmax(axis=1)
        first, other, third = (
            np.take_along_axis(triangles[cut], ((longest + k) % 3)[:, None, None], 1)[:, 0] for k in range(3)
        )
        half = 0.5 * (first + other)
        triangles = np.concatenate(
            [np.stack([first, half, third], axis=1), np.stack([half, other, third], axis=1)]
        )
        owner = np.tile(owner[cut], 2)
    owners, middles, radii = zip(*done, strict=True)
    return np.concatenate(owners), np.concatenate(middles), np.concatenate(radii)
