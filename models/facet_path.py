"""Quasi-static path of a rock over the facets of its hull.

A horizontal ground acceleration a grows so slowly that the rock's inertia relative to the ground is negligible. Then
the rock is always in an equilibrium under the effective gravity g - a, on a set of its hull's vertices whose convex
hull contains the point where the line of action through the centre of mass pierces the plane. An equilibrium on a
vertex or an edge is that of an inverted pendulum and never stable, so the path goes from facet to facet of the convex
hull: a facet is stable until the piercing point crosses its border, where the rock rotates about the edge (or vertex)
nearest to the piercing point, rolling without slip or spin and without gathering speed, until a facet is stable again.
If there is none, the rock topples. A smooth base is the limit of fine facets, whose path ends at the limit point of the
equilibria of the potential -g_eff . x_com. For a sharp-edged flat base it is the formula of Anooshehpoor, Brune and
Zeng (2004), g tan(alpha), extended to three dimensions (moments about each edge) and to slopes (gravity in the plane's
frame).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from toppling.models.arrays import Array
from toppling.models.frames import horizontal_unit_vector, plane_axes
from toppling.models.pedestal import Pedestal
from toppling.models.relief import contact_feet_m
from toppling.models.rock import Rock
from toppling.models.support import (
    CONTACT_SHARE_OF_HEIGHT,
    TOPPLED_FALL,
    TOPPLED_TILT_DEG,
    planar_hull,
)

_VERTEX_STEP_RAD = 2e-3  # rotation about a single vertex between updates of the direction of fall
_PAST_THE_EDGE = 1e-9  # relative excess of the acceleration over lift-off, which sets the direction of fall
_ROUNDING = 1e-12  # relative tolerance of a moment for equilibrium


@dataclass(frozen=True)
class _Pose:
    """Hull vertices, centre of mass and the body's initial normal, in the plane's frame (z normal to it, 0 in it)."""

    points: Array
    com: Array
    up: Array

    def rolled(self, pivot: Array, outward: Array, angle: float) -> _Pose:
        """Turn about the line in the plane through a pivot, toward the outward in-plane unit vector."""
        x, y = -float(outward[1]), float(outward[0])  # axis of rotation
        sine, versed = math.sin(angle), 1.0 - math.cos(angle)
        turn = np.array(
            [
                [1.0 - versed * y * y, versed * x * y, -sine * y],
                [versed * x * y, 1.0 - versed * x * x, sine * x],
                [sine * y, -sine * x, 1.0 - versed],
            ]
        )  # of rows: the transpose of Rodrigues' matrix
        anchor = np.array([pivot[0], pivot[1], 0.0])
        return _Pose(
            (self.points - anchor) @ turn + anchor, (self.com - anchor) @ turn + anchor, self.up @ turn
        )


@dataclass(frozen=True)
class Seat:
    """A rock in its scene's pose, with its support."""

    pose: _Pose
    ring: Array | None  # in-plane support polygon (k, 2), counter-clockwise, if it has an area
    frame: Array  # rows: axes of the plane and its normal, scene frame
    tolerance: float

    @classmethod
    def of(cls, rock: Rock, pedestal: Pedestal) -> Seat:
        """Seat of a rock on its points of contact with the plane."""
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
        left = [acceleration for _, acceleration in self.rests(gravity_m_s2, azimuth_deg)]
        return (left[0], left[-1]) if left else (0.0, 0.0)

    def rests(self, gravity_m_s2: float, azimuth_deg: float) -> Iterator[tuple[_Pose, float]]:
        """Stable poses on the path, each with the acceleration at which it becomes unstable."""
        gravity = self.frame @ np.array([0.0, 0.0, -gravity_m_s2])
        push = -self.frame @ horizontal_unit_vector(azimuth_deg)
        rest, acceleration = self._seated(gravity), 0.0
        while rest is not None:
            pose, ring = rest
            acceleration = _leaves(ring, pose.com, gravity, push, acceleration)
            yield pose, acceleration
            if not np.isfinite(acceleration):
                return
            past = _PAST_THE_EDGE * (acceleration + gravity_m_s2)
            while _holds(ring, pose.com, gravity + (acceleration + past) * push):  # an edge along the push
                past *= 2.0
            rest = self._fallen(pose, ring, gravity + (acceleration + past) * push)

    def fallen(self, gravity: Array) -> _Pose | None:
        """Stable pose under gravity alone; None if the rock topples."""
        seated = self._seated(gravity)
        return None if seated is None else seated[0]

    def _seated(self, gravity: Array) -> tuple[_Pose, Array] | None:
        if self.ring is not None and _holds(self.ring, self.pose.com, gravity):
            return self.pose, self.ring
        return self._fallen(self.pose, self.ring, gravity)

    def _fallen(self, pose: _Pose, ring: Array | None, weight: Array) -> tuple[_Pose, Array] | None:
        """Next stable pose under a constant effective gravity, and its support; None if the rock topples first."""
        support = _touching(pose, self.tolerance) if ring is None else ring
        least_height = (1.0 - TOPPLED_FALL) * self.pose.com[2]
        least_up = np.cos(np.deg2rad(TOPPLED_TILT_DEG))
        if weight[2] >= 0:
            return None
        while pose.up @ self.pose.up >= least_up and pose.com[2] >= least_height:
            if len(support) > 2 and _holds(support, pose.com, weight):
                return pose, support
            projected_com = pose.com[:2] - weight[:2] * pose.com[2] / weight[2]
            pivot, outward, on_vertex = _nearest(support, projected_com)
            reach = (pose.points[:, :2] - pivot) @ outward
            free = np.hypot(reach, pose.points[:, 2]) > self.tolerance
            # A touching point behind the pivot is at an angle of pi and rises: it cannot be the next contact.
            angle = np.arctan2(np.maximum(pose.points[:, 2], 0.0), reach)
            landing = float(angle[free].min(initial=np.pi))
            step = min(landing, max(landing / 4, _VERTEX_STEP_RAD)) if on_vertex else landing
            pose = pose.rolled(pivot, outward, step)
            support = _touching(pose, self.tolerance)
        return None


def _touching(pose: _Pose, tolerance: float) -> Array:
    """Support (k, 2): a counter-clockwise polygon, or the one or two ends of the contact."""
    points = pose.points[pose.points[:, 2] <= pose.points[:, 2].min() + tolerance, :2]
    if len(points) < 3:
        return points
    order = planar_hull(points, tolerance)
    if order is not None:
        return points[order]
    along = points @ np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][0]
    return points[[along.argmin(), along.argmax()]]


def _edge_moments(ring: Array, com: Array, force: Array) -> Array:
    """Stabilising moments (k,) of a force on the centre of mass about each edge of a polygon.

    Two-dimensional form of `support.moment_arms`, because general products took half the time of a path.
    """
    edge, away = _edges(ring), com[:2] - ring
    twice_area = away[:, 0] * edge[:, 1] - away[:, 1] * edge[:, 0]
    moment = com[2] * (edge[:, 0] * force[1] - edge[:, 1] * force[0]) + twice_area * force[2]
    return moment / np.sqrt(edge[:, 0] ** 2 + edge[:, 1] ** 2)


def _edges(ring: Array) -> Array:
    return np.concatenate((ring[1:], ring[:1])) - ring


def _holds(ring: Array, com: Array, weight: Array) -> bool:
    rounding = -_ROUNDING * com[2] * np.linalg.norm(weight)
    return len(ring) > 2 and bool((_edge_moments(ring, com, weight) >= rounding).all()) and weight[2] < 0


def _leaves(ring: Array, com: Array, gravity: Array, push: Array, least: float) -> float:
    """Smallest acceleration, at least `least`, at which the moment about an edge vanishes."""
    hold, change = _edge_moments(ring, com, gravity), _edge_moments(ring, com, push)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        root = np.where(change < 0, -hold / change, np.inf)
    return max(float(root.min()), least)


def _nearest(support: Array, projected_com: Array) -> tuple[Array, Array, bool]:
    """Nearest point of a support to a point outside, unit vector outward, whether it is a vertex."""
    if len(support) > 1:
        edge = _edges(support)
        squared = (edge * edge).sum(axis=1)  # 0 between two places that coincide
        share = ((projected_com - support) * edge).sum(axis=1) / np.where(squared > 0.0, squared, 1.0)
        point = support + np.clip(share, 0.0, 1.0)[:, None] * edge
        away = projected_com - point
        if len(support) > 2:  # exclude edges with the point on the inner side
            left = edge[:, 0] * (projected_com - support)[:, 1] - edge[:, 1] * (projected_com - support)[:, 0]
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
    away = projected_com - vertex
    length = np.linalg.norm(away)
    return vertex, away / length if length > 0 else np.array([1.0, 0.0]), True
