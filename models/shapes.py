"""Meshes of simple bodies whose mass properties and statics are known in closed form."""

import numpy as np
import trimesh

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
