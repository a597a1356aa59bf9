"""The pedestal's surface around the rock, over the interface plane, and the edges where it ends."""

from dataclasses import dataclass, replace
from typing import Any

import contourpy
import numpy as np
from scipy import ndimage
from scipy.sparse import diags
from scipy.sparse.linalg import spsolve
from scipy.spatial import ConvexHull, cKDTree

from toppling.models.arrays import Array, Flags, Indices
from toppling.models.pedestal import Pedestal
from toppling.models.relief import height_below
from toppling.models.rock import Rock
from toppling.models.scan.crevice import Grid, grid_laplacian, grid_triangles
from toppling.models.scan.interface import Interface
from toppling.models.scan.surfels import Surfels
from toppling.models.scan.surroundings import Surroundings, few_triangles, is_ground
from toppling.models.statics import CONTACT_SHARE_OF_HEIGHT, support_polygon_m

_REACH_HEIGHTS = 0.6
"""How far beyond the rock's outline the pedestal is kept, in rock heights: a rock whose centre of mass
has left its support by half its height is falling, whatever it meets."""
_CELLS_PER_HEIGHT = 60
_LEVEL_PER_HEIGHT = 0.003
"""What is no farther from the interface is level, where the ground is met as a surface."""


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
    beside: str | None = None

    def with_beside(self, stands: Surroundings, interface: Interface, height_m: float) -> "Ground":
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
        return replace(self, pedestal=pedestal, beside=stands.sentence)


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
    standing = _inside(nodes, outline if interface.sheet is None else interface.sheet.ring_m)
    # Every cell that the outline crosses is there and lies in the plane, so that the whole base rests on it.
    lost = _lost(flat, top, nodes, cell, ndimage.binary_dilation(standing, np.ones((3, 3))))
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
    places = interface.flat(rock.vertices_m[resting])[:, :2]
    corners = _hull(places)
    return interface.scene(np.column_stack([corners, np.zeros(len(corners))]) + interface.rise(corners))


def _hull(places: Array) -> Array:
    return places[ConvexHull(places).vertices]


def kept_of(ground: Ground, seen_m: Array, interface: Interface) -> dict[str, Any]:
    """How much of what was seen of the pedestal the scene keeps, and why not the rest."""
    assert ground.pedestal.vertices_m is not None
    assert ground.pedestal.faces is not None
    kept = interface.flat(ground.pedestal.vertices_m)[:, :2]
    step = max(1, len(seen_m) // 100_000)
    flat = interface.flat(seen_m[::step])[:, :2]
    cell = float(np.diff(np.unique(np.round(kept[:, 0], 9))).max()) if len(kept) else 0.0
    inside = cKDTree(kept).query(flat, distance_upper_bound=cell)[0] <= cell
    return {
        "triangles": len(ground.pedestal.faces),
        "resolution_m": cell,
        "kept_share_of_points": float(inside.mean()),
        "left_away": f"what lies farther from the rock's outline than {_REACH_HEIGHTS} of its height, and below cliff "
        "edges: a rock that gets there has toppled",
    }


def _inside(nodes: Array, polygon: Array) -> Flags:
    from matplotlib.path import Path as Polygon

    return Polygon(polygon).contains_points(nodes.reshape(-1, 2)).reshape(nodes.shape[:2])


def _lost(flat: Array, top: Flags, nodes: Array, cell: float, standing: Flags) -> Flags:
    """Nodes without pedestal: nearer to a cliff's face, or to the land below it, than to its top."""
    tree_top = cKDTree(flat[top, :2])
    below = flat[~top & (flat[:, 2] < -2 * cell)]
    if len(below) < 20:
        return np.zeros(nodes.shape[:2], bool)
    to_top = tree_top.query(nodes.reshape(-1, 2))[0].reshape(nodes.shape[:2])
    to_below = cKDTree(below[:, :2]).query(nodes.reshape(-1, 2))[0].reshape(nodes.shape[:2])
    lost = ndimage.binary_opening(to_below < to_top, iterations=2)
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


def _triangles(nodes: Array, surface: Array, kept: Flags) -> tuple[Array, Indices]:
    faces = grid_triangles(kept.shape)
    faces = faces[kept.ravel()[faces].all(axis=1)]
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
    if length < 1e-12:
        off = np.linalg.norm(line - line[0], axis=1)
    else:
        off = (
            np.abs(
                np.cross(np.append(chord, 0.0), np.column_stack([line - line[0], np.zeros(len(line))]))[:, 2]
            )
            / length
        )
    far = int(np.argmax(off))
    if off[far] <= tolerance or len(line) < 3:
        return line[[0, -1]]
    return np.vstack([_straightened(line[: far + 1], tolerance)[:-1], _straightened(line[far:], tolerance)])
