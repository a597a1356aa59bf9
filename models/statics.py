"""Statics of a rock on its pedestal: support polygon, quasi-static toppling, cone of equilibrium.

All functions apply to the interface plane; an uneven surface has a support polygon only where it lies in that plane.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from toppling.models.arrays import Array
from toppling.models.frames import horizontal_unit_vector, plane_axes
from toppling.models.pedestal import (
    CONTACT_SHARE_OF_HEIGHT,
    STEEP,
    TOPPLED_FALL,
    TOPPLED_TILT_DEG,
    Pedestal,
    moment_arms,
    planar_hull,
)
from toppling.models.relief import contact_feet_m
from toppling.models.rock import Rock

__all__ = [
    "CONTACT_SHARE_OF_HEIGHT", "EQUILIBRIUM_MARGIN", "STEEP", "TOPPLED_FALL", "TOPPLED_TILT_DEG", "Limits", "at_rest",
    "equilibrium_possible", "polygon", "quasi_static_toppling_m_s2", "slides_m_s2", "support_polygon_m",
]  # fmt: skip

EQUILIBRIUM_MARGIN = 1e-9
"""Relative margin by which each condition of :func:`equilibrium_possible` must be satisfied."""


class Limits(NamedTuple):
    """Limits of a constant horizontal ground acceleration, slowly applied, toward an azimuth.

    tips_m_s2: the largest at which the rock is at rest, in its pose or in one into which it tips up to 45 degrees;
    without slip if it slides before. Zero where it does not stand by itself, infinite where no acceleration topples it.
    slides_m_s2: the least at which static friction does not hold it on its way there; infinite where it always does.
    """

    ground_accelerates_toward_deg: float
    tips_m_s2: float
    slides_m_s2: float


def support_polygon_m(rock: Rock, pedestal: Pedestal) -> Array:
    """Corners (k, 3), scene frame, of the convex hull of the rock's contact with the interface plane.

    Counter-clockwise seen from above along the plane's normal. For a surface, its relief and edges are included in the
    rock's feet (:mod:`models.relief`). Fewer than three corners mean that the rock stands on a point or a line within
    ``CONTACT_SHARE_OF_HEIGHT``: it rolls, or is not seated.
    """
    feet, width_m = contact_feet_m(rock, pedestal), CONTACT_SHARE_OF_HEIGHT * rock.height_m
    gap = (feet - pedestal.point_m) @ pedestal.normal
    return polygon(feet[gap <= gap.min() + width_m], pedestal.normal, width_m)


def quasi_static_toppling_m_s2(
    rock: Rock, pedestal: Pedestal, gravity_m_s2: float, azimuths_deg: Iterable[float]
) -> list[tuple[float, float]]:
    """Least constant horizontal ground acceleration, slowly applied, that topples, by its azimuth.

    End of the quasi-static path (:mod:`models.ground.facet_path`): the acceleration beyond which there is no stable
    pose with a tilt up to ``TOPPLED_TILT_DEG`` and a centre of mass lowered by at most ``TOPPLED_FALL``. A rock with a
    flat sharp-edged base topples when it lifts off; one with a rounded base rolls first. No slip.

    Returns list of (azimuth_deg, acceleration_m_s2): zero where the rock does not stand near by, infinite where no
    acceleration of this azimuth topples it.
    """
    from toppling.models.ground.facet_path import Seat  # which compiles

    seat = Seat.of(rock, pedestal)
    return [(float(az), seat.path(gravity_m_s2, float(az))[1]) for az in azimuths_deg]


def slides_m_s2(normal: Array, gravity_m_s2: float, friction_static: float, azimuths_deg: Array) -> Array:
    """Least constant horizontal ground accelerations (n,) at which a rock slips on a plane, in whatever pose.

    The pull g - a is on the border of the friction cone about the plane's normal (3,): a quadratic equation. Zero where
    gravity alone lets it slip.
    """
    across = -horizontal_unit_vector(azimuths_deg) @ normal
    cone, pressing = 1.0 + friction_static**2, gravity_m_s2 * normal[2]
    a, b = 1.0 - cone * across**2, cone * pressing * across
    c = gravity_m_s2**2 - cone * pressing**2
    if c >= 0.0:
        return np.zeros(len(across))
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(b * b - a * c)
        roots = np.stack([-c / (b + root), -c / (b - root)])  # these stay exact where a vanishes
    return np.where(roots > 0.0, roots, np.inf).min(axis=0)


def at_rest(rock: Rock, pedestal: Pedestal, gravity_m_s2: float) -> tuple[Array, Array] | None:
    """Rotation (3, 3) and translation (3,) that settle a rock to a stable pose near by; None if it falls.

    It rolls quasi-statically without slip from facet to facet of its hull until one is stable. The three or more feet
    of that facet lie in the interface plane within ``CONTACT_SHARE_OF_HEIGHT``.
    """
    from toppling.models.ground.facet_path import Seat  # which compiles

    seat = Seat.of(rock, pedestal)
    rest = next(seat.rests(gravity_m_s2, 0.0), None)
    if rest is None:
        return None
    turn, moved, _ = rest
    feet = contact_feet_m(rock, pedestal)
    lowest = pedestal.normal * ((feet - pedestal.point_m) @ pedestal.normal).min()
    in_scene = seat.frame.T @ turn @ seat.frame
    shift = pedestal.point_m - in_scene @ (pedestal.point_m + lowest) + seat.frame.T @ moved
    gap = (feet @ in_scene.T + shift - pedestal.point_m) @ pedestal.normal
    return in_scene, shift - gap.min() * pedestal.normal


def equilibrium_possible(
    rock: Rock, pedestal: Pedestal, gravity_m_s2: float, friction_static: float, acceleration_m_s2: ArrayLike
) -> NDArray[np.bool_]:
    """Whether contact forces exist that keep the rock at rest under each ground acceleration.

    For frictional points on one plane the exact conditions are: the effective gravity g - a points into the plane, its
    tangential part is at most the static friction times the normal one, and its line of action through the centre of
    mass pierces the support polygon. (Necessary: sum the forces; take moments about each edge. Sufficient: distribute
    the weight so that its centre of pressure is the piercing point, and let every point's friction be the same fraction
    of its normal force; then the resultant acts along the line of action.) The three conditions are homogeneous and
    convex in (g - a): a cone.

    Each must be satisfied with the margin ``EQUILIBRIUM_MARGIN``, so the result is conservative. For a rock on fewer
    than three points, or on a pedestal of which nothing lies in the interface plane, the result is false: statics does
    not decide whether it stays at rest.

    Parameters
    ----------
    acceleration_m_s2 : (n, 3) array
        Ground acceleration, scene frame.

    Returns
    -------
    (n,) bool array
    """
    corners = support_polygon_m(rock, pedestal)
    pull = np.array([0.0, 0.0, -gravity_m_s2]) - np.atleast_2d(np.asarray(acceleration_m_s2, float))
    normal, com_m = pedestal.normal, rock.com_m
    if len(corners) < 3 or planar_hull(corners @ np.column_stack(plane_axes(normal)), 0.0) is None:
        return np.zeros(len(pull), bool)
    pressing = -pull @ normal
    along = np.linalg.norm(pull + pressing[:, None] * normal, axis=1)
    margin = EQUILIBRIUM_MARGIN * np.linalg.norm(pull, axis=1)
    grips = along <= friction_static * pressing - margin
    holding = pull @ moment_arms(corners, com_m, normal).T  # (n, edges)
    arm = np.linalg.norm(corners - com_m, axis=1).max()
    held = (holding >= margin[:, None] * arm).all(axis=1)
    return (pressing > margin) & grips & held


def polygon(points_m: Array, normal: Array, width_m: float) -> Array:
    """Corners, counter-clockwise, of the convex hull of coplanar points (k, 3); all points if narrower than a width."""
    if len(points_m) < 3:
        return points_m
    order = planar_hull(points_m @ np.column_stack(plane_axes(normal)), width_m)
    return points_m if order is None else points_m[order]
