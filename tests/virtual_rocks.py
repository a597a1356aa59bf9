"""Rocks that several tests scan or shake."""

import numpy as np
import trimesh

from toppling.models.rock import Rock
from toppling.models.scan import virtual


def stump_on_a_slope():
    """A boulder of 2 m with bumps, on a pedestal that dips 6 degrees."""
    return virtual.on_slope(
        virtual.boulder(2.0, 1.3, 1.0, 3, bumps=0.02, sides=64),
        virtual.ground(5.0, 0.7, 3, bumps_m=0.1), 6.0, 250.0,
    )  # fmt: skip


def ellipsoid(semi_axes_m: tuple[float, float, float], subdivisions: int = 4) -> Rock:
    """Subdivided icosahedron scaled to an ellipsoid, centred on the origin."""
    sphere = trimesh.creation.icosphere(subdivisions=subdivisions)
    return Rock.from_triangles(sphere.vertices * np.asarray(semi_axes_m, float), sphere.faces)
