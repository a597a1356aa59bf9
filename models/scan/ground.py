"""The pedestal's surface around the rock and carried under it, facets or a curve, and the edges where it ends."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import contourpy
import numpy as np
from scipy import ndimage
from scipy.sparse import diags
from scipy.sparse.linalg import spsolve
from scipy.spatial import ConvexHull, QhullError, cKDTree

from toppling.models.arrays import Array, Flags, Indices
from toppling.models.ground.plane import FLAT_DEG, FLAT_SHARE
from toppling.models.hidden_base.gap import CELLS_PER_HEIGHT
from toppling.models.hidden_base.observed import PLACES_ACROSS
from toppling.models.pedestal import Pedestal
from toppling.models.relief import height_below
from toppling.models.rock import Rock
from toppling.models.scan.crevice import Grid, cells_apart, grid_laplacian, grid_triangles, seen_apart
from toppling.models.scan.interface import UPWARD, Interface, Planes, Sheet, reweighted_plane
from toppling.models.scan.surfels import Surfels
from toppling.models.scan.surroundings import Surroundings, few_triangles, is_ground
from toppling.models.statics import CONTACT_SHARE_OF_HEIGHT, polygon, support_polygon_m

_REACH_HEIGHTS = 0.6
"""How far beyond the rock's outline the pedestal is kept, in rock heights: a rock whose centre of mass
has left its support by half its height is falling, whatever it meets."""
_CELLS_PER_HEIGHT = 60
_LEVEL_PER_HEIGHT = 0.003
"""Distance from a plane up to which a surface is that plane at any normals: bumps rise as high."""


_MEDIAN_OF = 13
"""Patches, two rings around one, whose median height is the pedestal's there."""


@dataclass(frozen=True, eq=False)
class Ground:
    """Pedestal surface, contact outline and edges."""

    pedestal: Pedestal
    # (k, 3): convex outline of the contact on the interface plane, counter-clockwise seen from above.
    outline_m: Array
    # list of (k, 3): where the pedestal ends, the pedestal on the left side.
    edges_m: list[Array]
    # What of that surface stands beside the rock and is no map of heights, in words.
    surroundings: str | None = None

    def with_surroundings(self, stands: Surroundings, interface: Interface, height_m: float) -> Ground:
        """Add what stands beside the rock, in as few triangles as the relief around the rock needs."""
        own = self.pedestal
        assert own.vertices_m is not None
        assert own.faces is not None
        over = interface.over(own.vertices_m)
        rise = interface.rise(over)
        over[:, 2] = np.sign(over[:, 2]) * np.maximum(np.abs(over[:, 2]) - _LEVEL_PER_HEIGHT * height_m, 0.0)
        level = (over[:, 2] == 0.0)[own.faces].all(axis=1)
        relief = few_triangles(over + rise, own.faces[~level], height_m)
        seat = over + rise, own.faces[level]
        if interface.is_plane:
            vertices, faces = few_triangles(*seat, height_m)
            seat = vertices * [1.0, 1.0, 0.0], faces
        parts = [seat, relief, (interface.flat(stands.vertices_m), stands.faces)]
        first = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
        vertices = interface.scene(np.vstack([vertices for vertices, _ in parts]))
        faces = np.vstack([faces + start for (_, faces), start in zip(parts, first, strict=False)])
        pedestal = replace(own, vertices_m=vertices, faces=faces)
        return replace(self, pedestal=pedestal, surroundings=stands.sentence)


def pedestal_ground(surfels: Surfels, pedestal: Flags, rock: Rock, interface: Interface) -> Ground:
    """Mesh the pedestal as a height over the interface plane, within reach of the rock, up to cliff edges."""
    flat_rock = interface.over(rock.vertices_m)
    height = float(np.ptp(interface.flat(rock.vertices_m)[:, 2]))
    outline_m = _outline_m(rock, interface, height)
    outline = interface.flat(outline_m)[:, :2]
    margin = _REACH_HEIGHTS * height
    low, high = flat_rock[:, :2].min(axis=0) - margin, flat_rock[:, :2].max(axis=0) + margin
    cell = interface.lattice_m or height / _CELLS_PER_HEIGHT
    if interface.sheet is not None:  # on the nodes on which it is known
        low, high = np.floor(low / cell) * cell, np.ceil(high / cell) * cell
    grid = Grid.over(low, high - 1e-9 * cell, cell)
    nodes = grid.nodes_m
    flat = interface.over(surfels.points_m[pedestal])
    top = is_ground(flat, surfels.normals[pedestal], interface, height)
    # Strays between rock and pedestal, and grass, make spikes, over which the rock would roll too late.
    near = cKDTree(flat[top, :2]).query(flat[top, :2], min(_MEDIAN_OF, int(top.sum())))[1]
    flat[top, 2] = np.median(flat[top, 2][near], axis=1)
    lower = _lower(flat, top, nodes, cell)
    standing = _inside(nodes, outline if interface.sheet is None else interface.sheet.ring_m)
    standing &= ~cells_apart(grid, seen_apart(surfels, ~pedestal, interface, height))
    # Every cell that the outline crosses is there and lies in the plane, so that the whole base rests on it.
    lost = _lost(lower, ndimage.binary_dilation(standing, np.ones((3, 3))))
    seat = ndimage.binary_dilation(standing, np.ones((3, 3)), iterations=2)
    surface = _surface(flat[top], grid, seat)
    surface = np.where(seat, 0.0, np.minimum(surface, _underside(flat_rock, rock.faces, grid)))
    if interface.sheet is not None:
        surface = surface + interface.sheet.at(nodes)
    vertices, faces = _triangles(nodes, surface, ~lost)
    edges = _edges(grid, surface, lost)
    return Ground(
        Pedestal(interface.point_m, interface.normal, interface.scene(vertices), faces),
        outline_m,
        [interface.scene(edge) for edge in edges],
    )


def _outline_m(rock: Rock, interface: Interface, height_m: float) -> Array:
    """Convex outline (k, 3) of where the rock rests, counter-clockwise."""
    if interface.sheet is None:
        return support_polygon_m(rock, Pedestal(interface.point_m, interface.normal))
    resting = interface.over(rock.vertices_m)[:, 2] < CONTACT_SHARE_OF_HEIGHT * height_m
    places = interface.flat(rock.vertices_m[resting]) * [1.0, 1.0, 0.0]
    corners = polygon(places, np.array([0.0, 0.0, 1.0]), CONTACT_SHARE_OF_HEIGHT * height_m)
    return interface.scene(corners + interface.rise(corners))


def _inside(nodes: Array, ring: Array) -> Flags:
    from matplotlib.path import Path as Polygon

    return Polygon(ring).contains_points(nodes.reshape(-1, 2)).reshape(nodes.shape[:2])


def _lower(flat: Array, top: Flags, nodes: Array, cell: float) -> Flags:
    """Nodes nearer to a cliff's face, or to the land below it, than to its top."""
    tree_top = cKDTree(flat[top, :2])
    below = flat[~top & (flat[:, 2] < -2 * cell)]
    if len(below) < 20:
        return np.zeros(nodes.shape[:2], bool)
    to_top = tree_top.query(nodes.reshape(-1, 2))[0].reshape(nodes.shape[:2])
    to_below = cKDTree(below[:, :2]).query(nodes.reshape(-1, 2))[0].reshape(nodes.shape[:2])
    return ndimage.binary_opening(to_below < to_top, iterations=2)


def _lost(lost: Flags, standing: Flags) -> Flags:
    """Nodes without pedestal: those lower than it that lead out of the map, and what they part from where it stands."""
    # A cliff leads out of the map; a hole in its middle is a few strays below an unseen patch.
    parts, _ = ndimage.label(lost)
    rim = np.concatenate([parts[0], parts[-1], parts[:, 0], parts[:, -1]])
    lost = np.isin(parts, rim[rim > 0]) & ~standing
    labels, _ = ndimage.label(~lost)
    if not standing.any():
        return lost
    return labels != np.bincount(labels[standing]).argmax()


def _surface(top: Array, grid: Grid, standing: Flags) -> Array:
    """Heights at the nodes: the mean of what was seen, zero where the rock stands, a membrane elsewhere."""
    index = grid.index(top)
    count = np.bincount(index, minlength=standing.size)
    total = np.bincount(index, top[:, 2], minlength=standing.size)
    weight = np.where(standing.ravel(), 1e6, np.minimum(count, 4.0))
    target = np.where(standing.ravel(), 0.0, total / np.maximum(count, 1))
    system = diags(weight) + 0.1 * grid_laplacian(grid.shape)
    return spsolve(system.tocsc(), weight * target).reshape(grid.shape)


def _underside(flat_rock: Array, faces: Indices, grid: Grid) -> Array:
    """Lowest of the rock's vertices near each node and of its faces over it, huge beside it: no pedestal reaches in."""
    low = np.full(grid.shape, 1e30)
    np.minimum.at(low.ravel(), grid.index(flat_rock), flat_rock[:, 2])
    over = height_below(grid.nodes_m.reshape(-1, 2), flat_rock, faces, highest=False).reshape(grid.shape)
    return np.fmin(ndimage.grey_erosion(low, size=3), over)


def _triangles(nodes: Array, surface: Array, selected: Flags) -> tuple[Array, Indices]:
    faces = grid_triangles(selected.shape)
    faces = faces[selected.ravel()[faces].all(axis=1)]
    used, faces = np.unique(faces, return_inverse=True)
    vertices = np.column_stack([nodes.reshape(-1, 2), surface.ravel()])[used]
    return vertices, faces.reshape(-1, 3)


def _edges(grid: Grid, surface: Array, lost: Flags) -> list[Array]:
    """Boundary between kept and lost, smoothed and straightened, the kept side on the left."""
    if not lost.any():
        return []
    smooth = ndimage.gaussian_filter((~lost).astype(float), 1.5, mode="nearest")
    nodes = grid.nodes_m
    lines = contourpy.contour_generator(nodes[:, 0, 0], nodes[0, :, 1], smooth.T).lines(0.5)
    edges = []
    for line in map(np.asarray, lines):  # contourpy has what is larger, kept, on the left
        if len(line) >= 5:
            straight = _straightened(line, 0.6 * grid.cell_m)
            edges.append(np.column_stack([straight, grid.at(surface, straight)]))
    return edges


def _straightened(line: Array, tolerance: float) -> Array:
    """Fewest of the line's points that keep it within a tolerance (Douglas and Peucker 1973)."""
    chord = line[-1] - line[0]
    length = float(np.linalg.norm(chord))
    off = np.abs((line - line[0]) @ [-chord[1], chord[0]]) / max(length, 1e-12)
    if length < 1e-12:
        off = np.linalg.norm(line - line[0], axis=1)
    far = int(np.argmax(off))
    if off[far] <= tolerance or len(line) < 3:
        return line[[0, -1]]
    return np.vstack([_straightened(line[: far + 1], tolerance)[:-1], _straightened(line[far:], tolerance)])


_RING_PER_HEIGHT = 0.12
"""Patches of the pedestal so near the rock tell how its surface goes on below."""
_NARROW_PER_HEIGHT = 0.05
"""Distance of patches that tell a bent surface: what lies farther off may bend otherwise."""
_LEAST_PATCHES, _LEAST_RIM = 60, 12
"""Fewest patches of the ring, and of the rock's rim: four small feet show few."""
_LEAST_BEND_DEG = 3.0
"""Facets that differ by less, and curves whose rim slopes by less, are one plane."""
_FACET_PER_HEIGHT = 0.004
"""Patches so near a facet's plane are its own."""
_FACET_DEG = 12.0
"""Angle of patches' normals to a facet's below which they are its own."""
_LEAST_SHARE = 0.1
"""Least share of the ring that a facet takes up."""
_EXPLAINED = 0.85
"""Facets that together take up less of the ring are none."""
_MOST_OF_MEDIAN = 12.0
"""Area that a patch counts for, over the median's: where points are few, each patch stands for more."""
_MOST_FACETS = 3
_SEEDS, _SEED_TOLERANCES = 60, 10.0
"""Patches from which facets are grown, and how far around them a plane is first fitted."""
_CURVES_BETTER = 0.7
"""A curve must leave less than this share of a plane's misfit ..."""
_CURVE_NOISE_PER_HEIGHT = 0.0012
"""... and not more than this: bumps beside a flat contact are no dome."""


def pedestal_surface(
    surfels: Surfels, rock: Flags, height_m: float, given: Interface | None = None
) -> Interface | None:
    """Interface with the surface that the patches beside a rock show; None where one plane is enough.

    rock: (n,), which are the rock's.
    height_m: of the rock.
    given: plane that describes it; otherwise the one nearest to what is seen beside the rock.
    """
    adjacent, away, rim = _ring(surfels, rock, height_m)
    if adjacent.sum() < _LEAST_PATCHES or len(rim) < _LEAST_RIM:
        return None
    points, normals, away = surfels.points_m[adjacent], surfels.normals[adjacent], away[adjacent]
    frame = given or _plane_of(points, _areas(points))
    flat, flat_normals, flat_rim = frame.flat(points), normals @ frame.axes, frame.flat(rim)
    try:
        ring = flat_rim[ConvexHull(flat_rim[:, :2]).vertices, :2]
    except QhullError:
        return None
    below = _inside_ring(ring, surfels.voxel_m)
    if not len(below):
        return None
    narrow = away < _NARROW_PER_HEIGHT * height_m
    found = faceted(flat, flat_normals, height_m)
    if found is None and narrow.sum() > _LEAST_PATCHES:
        found = _curved(flat[narrow], below, height_m)
    if found is None:
        return None
    over = found.at(below)
    if _is_single_plane(found, below, over, height_m):
        return None
    lattice, roughness = _lattice_m(below, height_m), float(np.sqrt((over**2).mean()))
    frame, found = _along_the_crease(frame, found)
    places = frame.flat(rim)[:, :2]
    sheet = replace(found, lattice_m=lattice, ring_m=places[ConvexHull(places).vertices])
    return Interface(frame.point_m, frame.normal, frame.axes, roughness, sheet)


def _is_single_plane(found: Sheet, below: Array, over: Array, height_m: float) -> bool:
    """Whether heights (n,) of a surface at places (n, 2) below a rock, and its normals there, are those of a plane."""
    plane, step = _fitted(np.column_stack([below, over])), 1e-3 * height_m
    off = np.abs(_heights(plane, below) - over).max() / height_m
    if off <= _LEVEL_PER_HEIGHT or off > FLAT_SHARE:
        return bool(off <= _LEVEL_PER_HEIGHT)
    rises = [found.at(below + step * axis) - found.at(below - step * axis) for axis in np.eye(2)]
    normals = np.column_stack([-rises[0], -rises[1], np.full(len(below), 2.0 * step)])
    cosine = normals @ _normal(plane) / np.linalg.norm(normals, axis=1)
    return bool(np.rad2deg(np.arccos(cosine.min())) <= FLAT_DEG)


def level_surface(surfels: Surfels, rock: Flags, height_m: float, plane: Interface) -> Interface:
    """The interface plane as a surface of its own, for a rock beside which something stands; arguments as above.

    The same plane where too little of the rock's rim was seen to lay a surface below it.
    """
    rim = _ring(surfels, rock, height_m)[2]
    places = plane.flat(rim)[:, :2]
    try:
        ring = places[ConvexHull(places).vertices]
    except (QhullError, ValueError):
        return plane
    lattice = _lattice_m(ring, height_m)
    nothing, middle = np.zeros((0, 3)), ring.mean(axis=0)
    return replace(plane, sheet=Sheet(np.zeros((1, 3)), "plane", nothing, middle, 0.0, lattice, ring))


def _ring(surfels: Surfels, rock: Flags, height_m: float) -> tuple[Flags, Array, Array]:
    """Which patches carry a rock and lie beside it, the distance of each from it, and places (k, 3) of its rim."""
    away = cKDTree(surfels.points_m[rock]).query(surfels.points_m)[0]
    adjacent = ~rock & (surfels.normals[:, 2] > UPWARD) & (away < _RING_PER_HEIGHT * height_m)
    if not adjacent.any():
        return adjacent, away, np.zeros((0, 3))
    near_ground = cKDTree(surfels.points_m[adjacent]).query(surfels.points_m[rock])[0]
    return adjacent, away, surfels.points_m[rock][near_ground < 3.0 * surfels.voxel_m]


def _along_the_crease(frame: Interface, sheet: Sheet) -> tuple[Interface, Sheet]:
    """Frame whose second axis is the line in which two facets meet, so that nodes lie on it."""
    if len(sheet.planes) != 2 or sheet.how == "steps":
        return frame, sheet
    a, *across = sheet.planes[0] - sheet.planes[1]
    across = np.array(across)
    shift = -a * across / (across @ across)
    direction = across / np.linalg.norm(across)
    turn = np.column_stack([direction, [-direction[1], direction[0]]])
    axes = np.column_stack([frame.axes[:, :2] @ turn, frame.normal])
    height = sheet.planes[:, 0] + sheet.planes[:, 1:] @ shift
    planes = np.column_stack([height, sheet.planes[:, 1:] @ turn])
    point = frame.point_m + frame.axes[:, :2] @ shift
    middle = (sheet.middle_m - shift) @ turn
    return replace(frame, point_m=point, axes=axes), replace(sheet, planes=planes, middle_m=middle)


def _lattice_m(below: Array, height_m: float) -> float:
    """A whole number of the cells in which bases are seen, as many as places (n, 2) of a base are apart."""
    cell = height_m / CELLS_PER_HEIGHT
    width = float(np.sqrt(ConvexHull(below).volume))
    return cell * max(1, round(width / PLACES_ACROSS / cell))


def _areas(points: Array) -> Array:
    """Relative area that each patch represents: more where few were measured."""
    area = cKDTree(points).query(points, min(7, len(points)))[0][:, -1] ** 2
    return np.minimum(area, _MOST_OF_MEDIAN * np.median(area))


def _plane_of(points: Array, area: Array) -> Interface:
    """Plane nearest to the points, equal areas with an equal say; strays high up the rock have none."""
    centre, normal, _, _ = reweighted_plane(
        points, area, lambda height, weight: float(np.sqrt(np.average(height**2, weights=weight)))
    )
    return Interface.through(centre, normal)


def _inside_ring(ring: Array, cell_m: float) -> Array:
    """Places (n, 2) of a grid within a convex polygon."""
    hull = ConvexHull(ring)
    low, high = ring.min(axis=0), ring.max(axis=0)
    cell = max(cell_m, float((high - low).max()) / 60.0)
    nodes = np.stack(np.meshgrid(*(np.arange(a, b + cell, cell) for a, b in zip(low, high, strict=True))), -1)
    nodes = nodes.reshape(-1, 2)
    return nodes[(nodes @ hull.equations[:, :2].T + hull.equations[:, 2] <= 0.0).all(axis=1)]


def faceted(flat: Array, normals: Array, height_m: float) -> Sheet | None:
    """Facets that explain the ring; None where one does, or none do."""
    area = _areas(flat)
    planes = _facets(flat, normals, area, height_m)
    if len(planes) < 2:
        return None
    # The smallest facet may be none: the largest two alone explain more then.
    sheets = [
        sheet for count in range(2, len(planes) + 1) for sheet in _meetings(np.array(planes[:count]), flat)
    ]
    off = [np.abs(sheet.at(flat) - flat[:, 2]) for sheet in sheets]
    best = int(np.argmin([np.minimum(off_m, 4.0 * _FACET_PER_HEIGHT * height_m) @ area for off_m in off]))
    if (off[best] < 2.0 * _FACET_PER_HEIGHT * height_m) @ area < _EXPLAINED * area.sum():
        return None
    sheet = _refitted(sheets[best], flat)
    return replace(sheet, middle_m=flat[:, :2].mean(axis=0))


def _refitted(sheet: Sheet, flat: Array) -> Sheet:
    """Fit each facet anew to the patches that are its own, and lie in it but for their noise."""
    for _ in range(3):
        heights = np.array([_heights(plane, flat) for plane in sheet.planes]) - flat[:, 2]
        own, off = np.abs(heights).argmin(axis=0), np.abs(sheet.at(flat) - flat[:, 2])
        near = off < 3.0 * 1.4826 * np.median(off)
        planes = [
            _fitted(flat[near & (own == k)]) if (near & (own == k)).sum() > 9 else plane
            for k, plane in enumerate(sheet.planes)
        ]
        sheet = replace(sheet, planes=np.array(planes))
    return sheet


def _facets(flat: Array, normals: Array, area: Array, height_m: float) -> list[Array]:
    """Planes (3,), the largest first, each seen in a share of the ring and unlike the others."""
    tolerance, alike = _FACET_PER_HEIGHT * height_m, np.cos(np.deg2rad(_FACET_DEG))
    left = np.ones(len(flat), bool)
    found: list[Array] = []
    for _ in range(_MOST_FACETS):
        plane, own = _largest_facet(flat, normals, np.where(left, area, 0.0), tolerance, alike)
        if own @ area < _LEAST_SHARE * area.sum():
            break
        if all(_differ(plane, other, flat, height_m) for other in found):
            found.append(plane)
        left &= ~own
        if left.sum() < _LEAST_PATCHES:
            break
    return found


def _largest_facet(
    flat: Array, normals: Array, area: Array, tolerance_m: float, alike: float
) -> tuple[Array, Flags]:
    """Plane through the most of the patches that are left (those with an area), and which of these are its own."""
    left = area > 0.0
    tree, candidates = cKDTree(flat), np.flatnonzero(left)
    best, own = np.zeros(3), np.zeros(len(flat), bool)
    # As many in a part seen by few points as its area asks for.
    steps = np.linspace(0.0, 1.0, min(_SEEDS, len(candidates)), endpoint=False)
    passed = np.cumsum(area[candidates]) / area.sum()
    for seed in np.unique(candidates[np.searchsorted(passed, steps, side="right")]):
        around = np.array(tree.query_ball_point(flat[seed], _SEED_TOLERANCES * tolerance_m))
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
    return np.asarray(np.linalg.lstsq(design, flat[:, 2], rcond=None)[0], float)


def _heights(plane: Array, flat: Array) -> Array:
    return np.asarray(plane[0] + flat[:, :2] @ plane[1:])


def _normal(plane: Array) -> Array:
    normal = np.array([-plane[1], -plane[2], 1.0])
    return normal / np.linalg.norm(normal)


def _differ(first: Array, other: Array, flat: Array, height_m: float) -> bool:
    """Whether two facets are two: by their slopes, or by a step between them."""
    bent = np.rad2deg(np.arccos(min(1.0, float(_normal(first) @ _normal(other))))) > _LEAST_BEND_DEG
    apart = np.abs(_heights(first, flat) - _heights(other, flat)).min() > 2.0 * FLAT_SHARE * height_m
    return bool(bent or apart)


def _meetings(planes: Planes, flat: Array) -> Iterator[Sheet]:
    """Ways in which facets may meet below the rock."""
    nothing, middle = np.zeros((0, 3)), np.zeros(2)
    for how in ("hollow", "ridge"):
        yield Sheet(planes, how, nothing, middle, 0.0)
    off = np.abs(np.array([_heights(plane, flat) for plane in planes]) - flat[:, 2])
    yield Sheet(planes, "steps", _sides(off.argmin(axis=0), len(planes), flat), middle, 0.0)


def _sides(label: Indices, count: int, flat: Array) -> Array:
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
        weight = np.sqrt(1.0 / np.maximum(off, _FACET_PER_HEIGHT * height_m))
    plane = _fitted(flat)
    straight = np.abs(_heights(plane, flat) - flat[:, 2]).mean()
    noise = 1.4826 * float(np.median(off))
    if off.mean() > _CURVES_BETTER * straight or noise > _CURVE_NOISE_PER_HEIGHT * height_m:
        return None
    a, b, c, uu, uv, vv = bend
    at_zero = np.array([a - b * middle[0] - c * middle[1], b, c])
    reach = float(np.linalg.norm(flat[:, :2] - middle, axis=1).max())
    return Sheet(at_zero[None], "curve", np.array([[uu, uv, vv]]), middle, reach)
