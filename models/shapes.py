"""Meshes of simple bodies with closed-form statics, and connected components."""

import numpy as np
import trimesh
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from toppling.models.arrays import Indices
from toppling.models.rock import Rock


def box(half_width_m: float, half_depth_m: float, half_height_m: float) -> Rock:
    """Rectangular block centred on the origin; half sizes along x, y, z."""
    mesh = trimesh.creation.box((2 * half_width_m, 2 * half_depth_m, 2 * half_height_m))
    return Rock.from_triangles(mesh.vertices, mesh.faces)


def cylinder(radius_m: float, half_height_m: float, sides: int = 64) -> Rock:
    """Upright prism of `sides` corners inscribed in a cylinder, centred on the origin."""
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = radius_m * np.column_stack([np.cos(angle), np.sin(angle)])
    rim = [np.column_stack([ring, np.full(sides, z)]) for z in (-half_height_m, half_height_m)]
    mesh = trimesh.Trimesh(np.vstack(rim), process=False).convex_hull
    return Rock.from_triangles(mesh.vertices, mesh.faces)


def joined_parts(pairs: Indices, count: int) -> Indices:
    """Index (count,) of the connected component of each node, by edges (k, 2)."""
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)
