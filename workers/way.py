"""The rock's way: poses at unequal times, and the velocities and clearances that follow from them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from toppling.workers.contact import ContactModel, Pose
from toppling.workers.quaternion import to_body, turn_vector

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

STILL: Vector = (0.0, 0.0, 0.0)

SUNK_SHARE = 1e-4
"""A foot deeper than this share of R has sunk in. One that newly does was not seen coming: its step is taken again with
foresight. A rock that a caller starts with feet deeper is raised first; what is less the engine lets out gently."""

CLEARANCES_KEPT = 32
"""Of the latest poses that were asked for."""


class Way:
    """Where the rock has been, support frame.

    Single poses are handled in bare Python and their clearances kept: around a landing each is asked for several
    times, and what numpy costs for a call exceeds the work on the few points in reach.

    Parameters
    ----------
    contact : ContactModel
    pose, velocity_m_s, angular_velocity_rad_s
        State at time 0.
    """

    def __init__(
        self, contact: ContactModel, pose: Pose, velocity_m_s: Vector, angular_velocity_rad_s: Vector
    ) -> None:
        self._contact = contact
        self._normal_body = contact.support_from_body[2].tolist()
        self._given = velocity_m_s, angular_velocity_rad_s
        self.poses: list[Pose] = [pose]
        self.times_s: list[float] = [0.0]
        self.kicked_s: list[float] = [0.0]
        """Times up to which the pull is in the velocities of the steps that led to the poses."""
        self._lifted_m: dict[int, float] = {}
        self._gaps: dict[int, Array] = {}
        self._points = 0

    @property
    def last(self) -> int:
        """Index of the latest pose."""
        return len(self.poses) - 1

    def look_at(self, points: int) -> None:
        """Give clearances of this many of the rock's points from here on."""
        self._points = points
        self._gaps.clear()

    def append(self, pose: Pose, time_s: float, kicked_s: float) -> None:
        """Add a pose."""
        self.poses.append(pose)
        self.times_s.append(time_s)
        self.kicked_s.append(kicked_s)

    def stay(self, time_s: float) -> None:
        """Add the latest pose once more: until then the rock rests in it."""
        self._lifted_m.pop(self.last, None)
        self.append(self.poses[-1], time_s, time_s)

    def date(self, time_s: list[float], kicked_s: list[float]) -> None:
        """Give times to the latest poses, which the engine has added."""
        self.times_s += time_s
        self.kicked_s += kicked_s

    def end_at(self, time_s: float) -> None:
        """Take the latest pose as one of exactly this time, which sums of durations reach but for rounding."""
        self.times_s[-1] = time_s

    def back_to(self, index: int) -> None:
        """Forget what came after pose `index`."""
        for later in range(index + 1, len(self.poses)):
            self._lifted_m.pop(later, None)
            self._gaps.pop(later, None)
        del self.poses[index + 1 :], self.times_s[index + 1 :], self.kicked_s[index + 1 :]

    def largest_tilt_deg(self, index: int) -> float:
        """Largest angle, from pose `index` on, of the interface's normal carried along to where it was in the scene."""
        a, b, c = self._normal_body
        cosine = min(
            2 * ((x * z - y * w) * a + (y * z + x * w) * b) + (1 - 2 * (x * x + y * y)) * c
            for _, (x, y, z, w) in self.poses[index:]
        )
        return math.degrees(math.acos(min(max(cosine, -1.0), 1.0)))

    def tilt_deg(self, since: int, index: int) -> float:
        """Angle between the interface's normal and where the rock has carried it from pose `since` to pose `index`.

        Of a rock that has turned about the normal too it is more, by a twenty-fourth of that turn's square.
        """
        x, y, _ = turn_vector(self.poses[since][1], self.poses[index][1])
        return math.degrees(math.hypot(x, y))

    def lift(self, way_m: float) -> None:
        """Take the latest pose as higher by `way_m`; its step's velocity does not count that way."""
        self._lifted_m[self.last] = way_m

    def lifted_pose(self) -> Pose:
        """The latest pose, as high as it was lifted."""
        (x, y, z), attitude = self.poses[-1]
        return (x, y, z + self._lifted_m.get(self.last, 0.0)), attitude

    def velocities(self, index: int) -> tuple[Vector, Vector]:
        """Velocity (m/s) and angular velocity (rad/s) in the step that led to pose `index`, or at the start."""
        if index == 0:
            return self._given
        if self.poses[index] is self.poses[index - 1]:  # it stayed: to the bit, however long
            return STILL, STILL
        ((x0, y0, z0), turned_from), ((x, y, z), turned_to) = self.poses[index - 1], self.poses[index]
        rate = 1.0 / (self.times_s[index] - self.times_s[index - 1])
        z0 += self._lifted_m.get(index - 1, 0.0)
        a, b, c = turn_vector(turned_from, turned_to)
        return ((x - x0) * rate, (y - y0) * rate, (z - z0) * rate), (a * rate, b * rate, c * rate)

    def speed_1_s(self, index: int) -> float:
        """How fast points approach the plane at most, over R, in the step that led to pose `index`."""
        velocity, spin = self.velocities(index)
        return abs(velocity[2]) / self._contact.half_diagonal_m + math.hypot(*spin)

    def gaps_m(self, index: int) -> Array:
        """Clearances (points,) in pose `index`."""
        if index not in self._gaps:
            if len(self._gaps) == CLEARANCES_KEPT:
                self._gaps.clear()
            self._gaps[index] = self._contact.gaps_of_pose_m(self.poses[index], self._points)
        return self._gaps[index]

    def gaps_since_m(self, index: int) -> Array:
        """Clearances (poses, points) from pose `index` on."""
        flat = np.array([position + quaternion for position, quaternion in self.poses[index:]])
        return self._contact.gaps_m(flat[:, :3], flat[:, 3:], self._points)

    def closing_m_s(self, index: int) -> Array:
        """Mean speed (points,) at which points came down in the step that led to pose `index`."""
        duration = self.times_s[index] - self.times_s[index - 1]
        way = self.gaps_m(index - 1) - self.gaps_m(index)
        return (way + self._lifted_m.get(index - 1, 0.0)) / duration

    def closing_since_m_s(self, index: int, gaps_m: Array) -> Array:
        """The same (poses - 1, points) for all steps from pose `index` on, from its clearances."""
        lifted = [self._lifted_m.get(i, 0.0) for i in range(index, self.last)]
        fallen = gaps_m[:-1] - gaps_m[1:] + np.array(lifted)[:, None]
        return np.asarray(fallen / np.diff(self.times_s[index:])[:, None])

    def centripetal_m_s2(self, index: int) -> Array:
        """Acceleration (points,) of points toward their axis of rotation, spin x (spin x arm), along the normal."""
        x, y, z = self.velocities(index)[1]
        direction = to_body((z * x, z * y, -x * x - y * y), self.poses[index][1])
        return np.asarray(self._contact.centres_body_m[: self._points] @ np.array(direction))

    def lift_m(self, index: int, arcs_m: Array, aloft_m: float) -> float:
        """Way up that brings the lowest foot to its arc's height; 0 where it is more than `aloft_m` above that."""
        lift = -float((self.gaps_m(index) - arcs_m).min())
        return lift if -aloft_m < lift < SUNK_SHARE * self._contact.half_diagonal_m else 0.0


def travel_m(start: Pose, end: Pose, radius_m: float) -> float:
    """Way from pose to pose of the point that moved most of those within a radius, at most."""
    turn = np.linalg.norm(turn_vector(start[1], end[1]))
    return float(np.linalg.norm(np.array(end[0]) - start[0]) + turn * radius_m)
