"""Statics of a rock on its pedestal: support polygon, slenderness, quasi-static toppling acceleration."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from models.frames import horizontal_unit_vector, plane_axes
from models.pedestal import Pedestal
from models.rock import Rock

CONTACT_SHARE_OF_HEIGHT = 1e-6
"""Points within this share of the rock's height of the interface plane count as touching it."""


def support_polygon_m(rock: Rock, pedestal: Pedestal) -> NDArray[np.float64]:
    """Corners (k, 3), scene frame, of the convex hull of the rock's contact with the interface plane, in order."""
    gap = (rock.hull_vertices_m - pedestal.point_m) @ pedestal.normal
    touching = rock.hull_vertices_m[gap <= gap.min() + CONTACT_SHARE_OF_HEIGHT * rock.height_m]
    if len(touching) < 3:
        return touching
    flat = touching @ np.column_stack(plane_axes(pedestal.normal))
    if np.linalg.matrix_rank(flat - flat.mean(axis=0), tol=CONTACT_SHARE_OF_HEIGHT * rock.height_m) < 2:
        return touching
    return touching[ConvexHull(flat).vertices]


def quasi_static_toppling_m_s2(
    rock: Rock, pedestal: Pedestal, gravity_m_s2: float, azimuths_deg: Iterable[float]
) -> list[tuple[float, float]]:
    """Least constant horizontal ground acceleration that topples, by azimuth of the ground's acceleration.

    The moment about each edge of the support polygon, of gravity and the inertial force -a together, is linear in a;
    the least positive root over the edges topples (`Anooshehpoor, Brune and Zeng 2004`, extended to three dimensions).

    Returns
    -------
    list of (azimuth_deg, acceleration_m_s2)
    """
    corners = support_polygon_m(rock, pedestal)
    start, end = corners, np.roll(corners, -1, axis=0)
    axis = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
    arm = rock.com_m - start
    moment_of_weight = np.einsum("ij,ij->i", axis, np.cross(arm, np.array([0.0, 0.0, -gravity_m_s2])))
    table = []
    for azimuth in azimuths_deg:
        push = -horizontal_unit_vector(azimuth)
        moment_of_push = np.einsum("ij,ij->i", axis, np.cross(arm, push))
        with np.errstate(divide="ignore", invalid="ignore"):
            root = -moment_of_weight / moment_of_push
        # Counter-clockwise corners: a positive moment about an edge holds the rock down, so only a push that lowers it counts.
        lowering = np.sign(moment_of_weight) * moment_of_push < 0
        table.append((float(azimuth), float(root[lowering].min(initial=np.inf))))
    return table
