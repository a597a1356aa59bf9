"""Statics of a rock on its pedestal: support polygon, lift-off, quasi-static toppling, cone of equilibrium.

Everything here is for the interface plane; an uneven surface has a support polygon only where it lies in that
plane.

The quasi-static path. A horizontal ground acceleration grows so slowly that inertia other than its own plays
no part. Then the rock stands at every moment in an equilibrium under the effective gravity g - a, on a set of
its hull's vertices whose convex hull holds the point where the line of action through the centre of mass
pierces the plane. An equilibrium on a vertex or an edge alone is that of an inverted pendulum and is never
stable, so the path goes from facet to facet of the convex hull: a facet holds until the piercing point
crosses its border, where the rock tips about the edge (or vertex) that is nearest to the piercing point,
rolling without slip or spin and without gathering speed, until a facet holds again. Where none does, the
stable equilibrium is lost: the rock topples. A smooth base is the limit of fine facets, whose path ends at
the limit point of the equilibria of the potential -g_eff . x_com. For a sharp-edged flat base it is the
formula of Anooshehpoor, Brune and Zeng (2004), g tan(alpha), extended to three dimensions (moments about each
edge) and to slopes (gravity in the plane's frame).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from toppling.models.arrays import Array
from toppling.models.frames import horizontal_unit_vector, plane_axes
from toppling.models.pedestal import Pedestal
from toppling.models.relief import contact_feet_m
from toppling.models.rock import Rock

CONTACT_SHARE_OF_HEIGHT = 1e-6
"""Points within this share of the rock's height of the interface plane count as touching it."""

TOPPLED_TILT_DEG = 45.0
"""A rest tilted by more than this counts as toppled."""

TOPPLED_FALL = 0.25
"""A centre of mass fallen by more than this share of its height above the support counts as toppled."""

EQUILIBRIUM_MARGIN = 1e-9
"""Share by which each condition must be met before :func:`equilibrium_possible` says yes."""

_VERTEX_STEP_RAD = 2e-3  # a rock that pivots on one vertex keeps its direction of fall for this long
_PAST_THE_EDGE = 1e-9  # share by which the acceleration is raised past lift-off, to give the fall a direction
_ROUNDING = 1e-12  # share by which a moment may miss zero and still hold


def support_polygon_m(rock: Rock, pedestal: Pedestal) -> Array:
    """Corners (k, 3), scene frame, of the convex hull of the rock's contact with the interface plane.

    Counter-clockwise seen along the plane's normal from above. Where the pedestal is a surface,
    its relief and its edges are taken into the rock's feet (:mod:`models.relief`). Fewer than three corners
    mean that the rock stands on a point or a line within ``CONTACT_SHARE_OF_HEIGHT``: it rolls, or is not
    seated.
    """
    return polygon(_contact_points(rock, pedestal), pedestal.normal, CONTACT_SHARE_OF_HEIGHT * rock.height_m)


def lift_off_m_s2(
    rock: Rock, pedestal: Pedestal, gravity_m_s2: float, azimuths_deg: Iterable[float]
) -> list[tuple[float, float]]:
    """Least constant horizontal ground acceleration that moves the rock off its support, by its azimuth.

    A rock that does not stand on three points is first let down onto the facet of its hull that gravity alone
    leads to. No slip. Zero where gravity alone topples the rock, infinite where no acceleration of this
    azimuth lifts it.

    Returns
    -------
    list of (azimuth_deg, acceleration_m_s2)
    """
    seat = _Seat.of(rock, pedestal)
    return [(float(az), seat.path(gravity_m_s2, float(az))[0]) for az in azimuths_deg]


def quasi_static_toppling_m_s2(
    rock: Rock, pedestal: Pedestal, gravity_m_s2: float, azimuths_deg: Iterable[float]
) -> list[tuple[float, float]]:
    """Least constant horizontal ground acceleration, slowly applied, that topples, by its azimuth.

    The end of the quasi-static path (see the module): the acceleration beyond which no rest is left with a
    tilt up to ``TOPPLED_TILT_DEG`` and a centre of mass fallen by no more than ``TOPPLED_FALL``. A rock with
    a flat sharp-edged base topples when it lifts off; one with a rounded base rolls before. No slip.

    Returns
    -------
    list of (azimuth_deg, acceleration_m_s2)
        Zero where gravity alone topples the rock, infinite where no acceleration of this azimuth does.
    """
    seat = _Seat.of(rock, pedestal)
    return [(float(az), seat.path(gravity_m_s2, float(az))[1]) for az in azimuths_deg]


def at_rest(rock: Rock, pedestal: Pedestal, gravity_m_s2: float) -> tuple[Array, Array] | None:
    """Rotation (3, 3) and translation (3,) that let a rock down to where it stands; None if it falls.

    It rolls without slip or gathering speed from facet to facet of its hull until one holds it. The three or more feet
    of that facet lie in the interface plane within ``CONTACT_SHARE_OF_HEIGHT``.
    """
    seat = _Seat.of(rock, pedestal)
    gravity = seat.frame @ np.array([0.0, 0.0, -gravity_m_s2])
    rest = seat.fallen(gravity)
    if rest is None:
        return None
    before, after = seat.pose.points, rest.points
    turn = Rotation.align_vectors(after - after.mean(axis=0), before - before.mean(axis=0))[0].as_matrix()
    feet = contact_feet_m(rock, pedestal)
    lowest = ((feet - pedestal.point_m) @ pedestal.normal).min()
    in_scene = seat.frame.T @ turn @ seat.frame
    lowered = before.mean(axis=0) + np.array([0.0, 0.0, lowest])
    shift = pedestal.point_m - in_scene @ pedestal.point_m
    shift = shift + seat.frame.T @ (after.mean(axis=0) - turn @ lowered)
    gap = (feet @ in_scene.T + shift - pedestal.point_m) @ pedestal.normal
    return in_scene, shift - gap.min() * pedestal.normal


def equilibrium_possible(
    rock: Rock,
    pedestal: Pedestal,
    gravity_m_s2: float,
    friction_static: float,
    acceleration_m_s2: ArrayLike,
) -> NDArray[np.bool_]:
    """Whether contact forces exist that keep the rock at rest under each ground acceleration.

    For frictional points on one plane the set is exactly: the effective gravity g - a points into the plane,
    its tangential part is at most the static friction times the normal one, and its line of action through
    the centre of mass pierces the support polygon. (Necessary: sum the forces; take moments about each edge.
    Sufficient: share the weight so that its centre of pressure is the piercing point, and let every point's
    friction be the same share of its normal force; then the resultant acts along the line of action.) The
    three conditions are homogeneous and convex in (g - a): a cone.

    Each must hold with the margin ``EQUILIBRIUM_MARGIN``, so the answer errs toward no by that share. A rock
    that stands on fewer than three points, or on a pedestal of which nothing lies in the interface plane, is
    given no equilibrium: whether it stays at rest is not decided by statics.

    Parameters
    ----------
    rock : Rock
    pedestal : Pedestal
    gravity_m_s2, friction_static : float
    acceleration_m_s2 : (n, 3) array
        Ground acceleration, scene frame.

    Returns
    -------
    (n,) bool array
    """
    corners = support_polygon_m(rock, pedestal)
    pull = np.array([0.0, 0.0, -gravity_m_s2]) - np.atleast_2d(np.asarray(acceleration_m_s2, float))
    return holds_still(corners, rock.com_m, pedestal.normal, friction_static, pull)


def polygon(points_m: Array, normal: Array, width_m: float) -> Array:
    """Corners of the convex hull of points (k, 3) of a plane, counter-clockwise; all points if it is thinner."""
    if len(points_m) < 3:
        return points_m
    order = _planar_hull(points_m @ np.column_stack(plane_axes(normal)), width_m)
    return points_m if order is None else points_m[order]


def holds_still(
    corners_m: Array, com_m: Array, normal: Array, friction: float, pull_m_s2: Array
) -> NDArray[np.bool_]:
    """The cone of :func:`equilibrium_possible` for a support polygon in any pose and frame.

    Parameters
    ----------
    corners_m : (k, 3) array
        Counter-clockwise seen against the normal; fewer than three hold nothing.
    com_m : (3,) array
    normal : (3,) array
        Upward unit normal of the plane.
    friction : float
        Static coefficient.
    pull_m_s2 : (n, 3) array
        Gravity less ground acceleration.

    Returns
    -------
    (n,) bool array
    """
    if len(corners_m) < 3 or _planar_hull(corners_m @ np.column_stack(plane_axes(normal)), 0.0) is None:
        return np.zeros(len(pull_m_s2), bool)
    pressing = -pull_m_s2 @ normal
    along = np.linalg.norm(pull_m_s2 + pressing[:, None] * normal, axis=1)
    margin = EQUILIBRIUM_MARGIN * np.linalg.norm(pull_m_s2, axis=1)
    grips = along <= friction * pressing - margin
    holding = pull_m_s2 @ _moment_arms(corners_m, com_m, normal).T  # (n, edges)
    arm = np.linalg.norm(corners_m - com_m, axis=1).max()
    held = (holding >= margin[:, None] * arm).all(axis=1)
    return (pressing > margin) & grips & held


def tipping_m_s2(
    corners_m: Array, com_m: Array, normal: Array, gravity_m_s2: float, azimuths_deg: Iterable[float]
) -> list[tuple[float, float]]:
    """Least constant horizontal ground acceleration that tips a rock over an edge of a given support polygon.

    Anooshehpoor, Brune and Zeng's formula (2004) for each edge, without slip: the line of action of gravity less
    ground acceleration leaves the polygon.

    Parameters
    ----------
    corners_m : (k, 3) array
        Counter-clockwise seen against the normal.
    com_m, normal : (3,) array
    gravity_m_s2 : float
    azimuths_deg : iterable of float
        Of the ground's acceleration.

    Returns
    -------
    list of (azimuth_deg, acceleration_m_s2)
        Zero where gravity alone tips it, infinite where no acceleration of this azimuth does.

    Examples
    --------
    A block of 0.4 x 0.4 x 1.2 m: g times half its width over half its height.

    >>> corners = np.array([[-.2, -.2, 0], [.2, -.2, 0], [.2, .2, 0], [-.2, .2, 0]])
    >>> com, up = np.array([0, 0, .6]), np.array([0.0, 0, 1])
    >>> [(azimuth, round(float(value), 3)) for azimuth, value in tipping_m_s2(corners, com, up, 9.81, [0, 45])]
    [(0, 3.27), (45, 4.624)]
    """
    arms = _moment_arms(corners_m, com_m, normal)
    holding = arms @ np.array([0.0, 0.0, -gravity_m_s2])
    found = []
    for azimuth in azimuths_deg:
        tipping = arms @ horizontal_unit_vector(azimuth)
        over = tipping > 0.0
        least = float((holding[over] / tipping[over]).min()) if over.any() else np.inf
        found.append((azimuth, max(least, 0.0)))
    return found


def _moment_arms(ring: Array, com: Array, normal: Array) -> Array:
    """Vectors w (k, 3): w_k . f > 0 where a force f on the centre of mass holds the rock down on edge k."""
    edge = np.roll(ring, -1, axis=0) - ring
    edge = edge - np.outer(edge @ normal, normal)
    axis = edge / np.linalg.norm(edge, axis=1)[:, None]
    return np.cross(com - ring, axis)


def _contact_points(rock: Rock, pedestal: Pedestal) -> Array:
    """Feet (k, 3) of the rock that touch the interface plane, scene frame."""
    feet = contact_feet_m(rock, pedestal)
    gap = (feet - pedestal.point_m) @ pedestal.normal
    return feet[gap <= gap.min() + CONTACT_SHARE_OF_HEIGHT * rock.height_m]


def _planar_hull(points: Array, width_m: float) -> NDArray[np.intp] | None:
    """Order (k, 2) points into their counter-clockwise convex hull; None where they lie on one line."""
    spread = points - points.mean(axis=0)
    thickness = np.ptp(spread @ np.linalg.svd(spread, full_matrices=False)[2][-1])
    if thickness <= width_m:
        return None
    try:
        return np.asarray(ConvexHull(points).vertices)
    except QhullError:
        return None


@dataclass(frozen=True)
class _Pose:
    """Hull vertices, centre of mass and the normal carried along, in the frame of the plane (z its normal, 0 in it)."""

    points: Array
    com: Array
    up: Array

    def rolled(self, pivot: Array, outward: Array, angle: float) -> _Pose:
        """Turn about the line in the plane through a pivot, toward the outward in-plane unit vector."""
        axis = np.array([-outward[1], outward[0], 0.0])
        cosine, sine = np.cos(angle), np.sin(angle)
        skew = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
        turn = (np.eye(3) + sine * skew + (1 - cosine) * (skew @ skew)).T
        anchor = np.array([pivot[0], pivot[1], 0.0])
        return _Pose(
            (self.points - anchor) @ turn + anchor, (self.com - anchor) @ turn + anchor, self.up @ turn
        )


@dataclass(frozen=True)
class _Seat:
    """A rock as it stands in the scene, ready to be tipped."""

    pose: _Pose
    ring: Array | None  # in-plane support polygon (k, 2), counter-clockwise, where there is one
    frame: Array  # rows: axes of the plane and its normal, scene frame
    tolerance: float

    @classmethod
    def of(cls, rock: Rock, pedestal: Pedestal) -> _Seat:
        frame = np.vstack([*plane_axes(pedestal.normal), pedestal.normal])
        points = (contact_feet_m(rock, pedestal) - pedestal.point_m) @ frame.T
        tolerance = CONTACT_SHARE_OF_HEIGHT * rock.height_m
        lowest = np.array([0.0, 0.0, points[:, 2].min()])
        up = np.array([0.0, 0.0, 1.0])
        pose = _Pose(points - lowest, (rock.com_m - pedestal.point_m) @ frame.T - lowest, up)
        touching = _touching(pose, tolerance)
        return cls(pose, touching if len(touching) > 2 else None, frame, tolerance)

    def path(self, gravity_m_s2: float, azimuth_deg: float) -> tuple[float, float]:
        """Accelerations at lift-off and at toppling."""
        gravity = self.frame @ np.array([0.0, 0.0, -gravity_m_s2])
        push = -self.frame @ horizontal_unit_vector(azimuth_deg)
        seated = self._seated(gravity)
        if seated is None:
            return 0.0, 0.0
        pose, ring = seated
        lift_off, acceleration = np.inf, 0.0
        while True:
            acceleration = _leaves(ring, pose.com, gravity, push, acceleration)
            lift_off = min(lift_off, acceleration)
            if not np.isfinite(acceleration):
                return lift_off, acceleration
            beyond = acceleration * (1 + _PAST_THE_EDGE) + _PAST_THE_EDGE * gravity_m_s2
            landed = self._fallen(pose, ring, gravity + beyond * push)
            if landed is None:
                return lift_off, acceleration
            pose, ring = landed

    def fallen(self, gravity: Array) -> _Pose | None:
        """The pose in which gravity alone leaves the rock; None if it topples."""
        seated = self._seated(gravity)
        return None if seated is None else seated[0]

    def _seated(self, gravity: Array) -> tuple[_Pose, Array] | None:
        if self.ring is not None and _holds(self.ring, self.pose.com, gravity):
            return self.pose, self.ring
        return self._fallen(self.pose, self.ring, gravity)

    def _fallen(self, pose: _Pose, ring: Array | None, weight: Array) -> tuple[_Pose, Array] | None:
        """Find next rest under a constant effective gravity, and its support; None if it topples first."""
        support = _touching(pose, self.tolerance) if ring is None else ring
        least_height = (1.0 - TOPPLED_FALL) * self.pose.com[2]
        least_up = np.cos(np.deg2rad(TOPPLED_TILT_DEG))
        if weight[2] >= 0:
            return None
        while pose.up @ self.pose.up >= least_up and pose.com[2] >= least_height:
            if len(support) > 2 and _holds(support, pose.com, weight):
                return pose, support
            pierced = pose.com[:2] - weight[:2] * pose.com[2] / weight[2]
            pivot, outward, on_vertex = _nearest(support, pierced)
            reach = (pose.points[:, :2] - pivot) @ outward
            free = np.hypot(reach, pose.points[:, 2]) > self.tolerance
            # A touching point behind the pivot stands at an angle of pi and rises: it cannot land next.
            angle = np.arctan2(np.maximum(pose.points[:, 2], 0.0), reach)
            landing = float(angle[free].min(initial=np.pi))
            step = min(landing, max(landing / 4, _VERTEX_STEP_RAD)) if on_vertex else landing
            pose = pose.rolled(pivot, outward, step)
            support = _touching(pose, self.tolerance)
        return None


def _touching(pose: _Pose, tolerance: float) -> Array:
    """Support (k, 2): a counter-clockwise polygon, or the one or two ends of what touches."""
    points = pose.points[pose.points[:, 2] <= pose.points[:, 2].min() + tolerance, :2]
    if len(points) < 3:
        return points
    order = _planar_hull(points, tolerance)
    if order is not None:
        return points[order]
    along = points @ np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][0]
    return points[[along.argmin(), along.argmax()]]


def _edge_moments(ring: Array, com: Array, force: Array) -> Array:
    """Moments (k,) with which a force on the centre of mass holds the rock down on each edge of a ring."""
    corners = np.column_stack([ring, np.zeros(len(ring))])
    return _moment_arms(corners, com, np.array([0.0, 0.0, 1.0])) @ force


def _holds(ring: Array, com: Array, weight: Array) -> bool:
    rounding = -_ROUNDING * com[2] * np.linalg.norm(weight)
    return len(ring) > 2 and bool((_edge_moments(ring, com, weight) >= rounding).all()) and weight[2] < 0


def _leaves(ring: Array, com: Array, gravity: Array, push: Array, least: float) -> float:
    """Least acceleration, not below one that holds, at which an edge lets go."""
    hold, change = _edge_moments(ring, com, gravity), _edge_moments(ring, com, push)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        root = np.where(change < 0, -hold / change, np.inf)
    return max(float(root.min()), least)


def _nearest(support: Array, pierced: Array) -> tuple[Array, Array, bool]:
    """Nearest point of a support to a point outside, unit vector outward, whether it is a vertex."""
    if len(support) > 1:
        edge = np.roll(support, -1, axis=0) - support
        share = ((pierced - support) * edge).sum(axis=1) / (edge * edge).sum(axis=1)
        point = support + np.clip(share, 0.0, 1.0)[:, None] * edge
        away = pierced - point
        if len(support) > 2:  # edges behind which the point lies are not near, even if rounding says so
            left = edge[:, 0] * (pierced - support)[:, 1] - edge[:, 1] * (pierced - support)[:, 0]
            distance = np.where(left < 0, (away * away).sum(axis=1), np.inf)
        else:
            distance = (away * away).sum(axis=1)
        best = int(distance.argmin())
        if 0.0 < share[best] < 1.0:
            outward = np.array([edge[best, 1], -edge[best, 0]]) / np.linalg.norm(edge[best])
            return point[best], outward if outward @ away[best] >= 0 else -outward, False
        vertex = point[best]
    else:
        vertex = support[0]
    away = pierced - vertex
    length = np.linalg.norm(away)
    return vertex, away / length if length > 0 else np.array([1.0, 0.0]), True
