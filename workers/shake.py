"""One shake: seat the rock, step it through a motion, know when the answer is certain, report."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from toppling.models.errors import InputError
from toppling.models.frames import azimuth_deg
from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.models.statics import (
    TOPPLED_FALL,
    TOPPLED_TILT_DEG,
    holds_still,
    polygon,
)
from toppling.workers import quaternion as quat
from toppling.workers.certainty import (
    REST_CERTAIN_SHARE,
    WEAK_TILT_DEG,
    WEAK_YAW_DEG,
    least_overturning_j_kg,
    lying_com_m,
    potential_j_kg,
    turn_rad,
    weak_from_s,
)
from toppling.workers.contact import LARGEST_OPEN_TILT_DEG, ContactModel, Pose, contact_of
from toppling.workers.engine import slip_m_s
from toppling.workers.presets import Settings, settings_of
from toppling.workers.quaternion import to_body
from toppling.workers.seating import TOUCHING_SHARE, friction_that_stops, settled
from toppling.workers.start import State, checked_start, start_of
from toppling.workers.stepping import IMPACT_STEP, Stepper, forget_worlds
from toppling.workers.way import travel_m

Array = NDArray[np.float64]

BLOCK = 64
"""Steps between two looks at whether the answer is certain."""

PLANE = np.array([0.0, 0.0, 1.0])
"""Normal of the interface in the support frame."""

CALMED_AFTER_MOTION = 60.0
"""Time after the motion, over sqrt(R / g), until which a rock is given to come near rest; from then on it is enough
that its energy cannot overturn it."""

CAP_AFTER_MOTION = 300.0
"""The same until which that must be so, or its fate is undecided: rocks that roll round their rims took up to 175.
Longer shakes of a base of hundreds of feet would come near the time after which a worker counts as hung."""

MOVED_SHARE = 0.01
"""A rock that slid by more than this share of R, or turned by more than MOVED_DEG, has moved."""

MOVED_DEG = 1.0

NEGLIGIBLE_WAY_SHARE = 1e-3
"""Of R: the centre of mass comes to its balance over a foot on a way that is longer by far."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The rock's way relative to the pedestal.

    Parameters
    ----------
    time_s : (n,) array
    position_m : (n, 3) array
        Centre of mass, scene frame.
    quaternion_xyzw : (n, 4) array
        Turn to the present pose, scene axes: from that in which the rock was seated, or, where its start was given,
        from that of the scene.
    """

    time_s: Array
    position_m: Array
    quaternion_xyzw: Array


@dataclass(frozen=True, eq=False)
class ShakeResult:
    """What happened, and what it cost.

    Parameters
    ----------
    status : str
        'ok', 'undecided' (not at rest within the cap) or 'diverged' (a state that no energy in the motion explains).
    outcome : str or None
        'stands', 'moved' or 'toppled'; None unless status is ok.
    toppled : bool or None
    topple_time_s, topple_azimuth_deg : float or None
        When the rock crossed its point of no return, and where its centre of mass was then, seen from its start; at the
        end, where it started past that point.
    max_tilt_deg, residual_tilt_deg, residual_yaw_deg : float
        Largest and last angle between the interface's normal and where the rock has carried it, since it was seated,
        or, where its start was given, from its pose in the scene; last turn about it, since the start.
    slip_m : float
        Way along the interface of the material point that was the centroid of the first contact, at the end.
    penetration_m : float
        Deepest that a contact point sank below the surface; a start inside the ground counts once it is raised.
    ended_by : str
        The rule that ended the shake.
    steps, simulated_s, skipped_s, wall_s
        Engine steps, time stepped through, time skipped with the rock at rest or its answer certain, and the cost.
    time_step_s : float
    trajectory : Trajectory or None
    """

    status: str
    outcome: str | None
    toppled: bool | None
    topple_time_s: float | None
    topple_azimuth_deg: float | None
    max_tilt_deg: float
    residual_tilt_deg: float
    residual_yaw_deg: float
    slip_m: float
    penetration_m: float
    ended_by: str
    steps: int
    simulated_s: float
    skipped_s: float
    wall_s: float
    time_step_s: float
    trajectory: Trajectory | None = field(repr=False, default=None)


def shake(
    scene: Scene,
    motion: Motion,
    preset: str | Settings = "standard",
    *,
    trajectory: bool = False,
    time_step: float | None = None,
    shortcuts: bool = True,
    initial: State | Mapping[str, Any] | None = None,
) -> ShakeResult:
    """Shake a rock with a ground motion and say whether it topples.

    Parameters
    ----------
    scene : Scene
    motion : Motion
        Acceleration of the ground. After it the ground stays at rest until the answer is certain.
    preset : str or Settings
        'fast', 'standard' or 'reference', or settings of one's own.
    trajectory : bool
        Keep the rock's way.
    time_step : float, optional
        Seconds; replaces the preset's. Divided as the preset's is while the rock has hardly lifted.
    shortcuts : bool
        Skip the time in which nothing can move, and end as soon as the answer is certain.
    initial : State or mapping of its fields, optional
        Where and how fast the rock starts; inside the ground by more than 1e-4 R, it is raised along the interface's
        normal to where it touches. Without it the rock is seated and settled first.

    Returns
    -------
    ShakeResult

    Raises
    ------
    InputError
        If a setting is out of range, the rock does not stand by itself where the scene puts it, or it starts deep
        inside the ground or in no finite state.
    """
    began = time.perf_counter()
    start_from = None if initial is None else checked_start(initial)
    if start_from is None:
        scene = settled(scene)
    contact = contact_of(scene)
    settings = preset if isinstance(preset, Settings) else settings_of(preset)
    step_s = settings.time_step_s(contact.half_diagonal_m, scene.gravity_m_s2)
    if time_step is not None:
        step_s = _checked_step(time_step, contact.half_diagonal_m, scene.gravity_m_s2)
    run = _Run(scene, contact, motion, step_s, settings, start_from, shortcuts)
    status, ended_by = run.to_the_end()
    return run.report(status, ended_by, began, trajectory)


class _Run:
    """A shake under way: the stepper and what is looked at between blocks of steps."""

    def __init__(
        self,
        scene: Scene,
        contact: ContactModel,
        motion: Motion,
        step_s: float,
        settings: Settings,
        start: State | None,
        shortcuts: bool,
    ) -> None:
        self.scene, self.contact, self.motion = scene, contact, motion
        self.step_s, self.shortcuts = step_s, shortcuts
        turn = contact.scene_from_support
        self.gravity = np.array([0.0, 0.0, -scene.gravity_m_s2]) @ turn
        self.pulls_m_s2 = np.vstack([self.gravity - motion.acceleration_m_s2 @ turn, self.gravity])
        """At the motion's samples, and after the last of them."""
        self.ends = _ends_of_pedestal(scene)
        self.skipped_s = self.left_s = 0.0
        self.rests = start is None
        """Whether the rock has rested, held by its feet, for the last block."""
        self.deepest_m = 0.0
        speed_m_s = float(np.sqrt(scene.gravity_m_s2 * contact.half_diagonal_m))
        self.rest_speed = settings.rest_speed * speed_m_s
        pose, velocity, spin = start_of(contact, start)
        self.speed_limit_m_s = _speed_limit(scene, contact, motion, start, pose)
        self.start_pose = pose
        self.stepper = Stepper(
            contact,
            scene.contact,
            self.gravity,
            lambda times: motion.velocity_at(times) @ turn,
            step_s,
            settings.parts_when_low,
            settings.resolved_landing * speed_m_s,
            settings.solver,
            pose,
            velocity,
            spin,
        )

    def to_the_end(self) -> tuple[str, str]:
        """Step until the answer is certain; returns status and the rule that ended it."""
        unit_s = np.sqrt(self.contact.half_diagonal_m / self.scene.gravity_m_s2)
        calmed_s, cap_s = (
            self.motion.duration_s + n * unit_s for n in (CALMED_AFTER_MOTION, CAP_AFTER_MOTION)
        )
        seen = 0
        if self.shortcuts and self.rests and self._rests_for_good():
            return "ok", "never_moved"
        while True:
            self.stepper.advance(BLOCK)
            position, quaternion = self._poses(seen)
            if not np.isfinite(position).all() or self._speed(seen) > self.speed_limit_m_s:
                forget_worlds()
                return "diverged", "speed_limit"
            if _fallen(self.contact, position).any():
                return "ok", "fallen"
            if self.contact.tilts_deg(quaternion).max() > LARGEST_OPEN_TILT_DEG:
                return "ok", "tilted"
            if self._slid_off(position[-1], quaternion[-1]):
                return "ok", "slid_off"
            at_rest = self._at_rest(seen)
            self._stay(seen, at_rest)
            if self.stepper.time_s > self.motion.duration_s:
                if at_rest and self._holds(self.gravity[None], self.stepper.way.last)[0]:
                    return "ok", "rest"
                if self.shortcuts and self._too_little_energy() and self._shows_its_rest():
                    return "ok", "rest_certain"
                if self.stepper.time_s > calmed_s and self._cannot_overturn():
                    return "ok", "rest_certain"
                if self.stepper.time_s > cap_s:
                    return "undecided", "time_cap"
            elif self.shortcuts and ((self.rests and self._rests_for_good()) or self._calms_down()):
                return "ok", "rest_certain"
            seen = self.stepper.way.last

    def _slid_off(self, position: Array, quaternion: Array) -> bool:
        """Whether the rock has slid so far that even lying it would tip over the end of its pedestal."""
        return self._beyond_end(position) and self._beyond_end(
            lying_com_m(self.contact, position, quaternion)
        )

    def _beyond_end(self, com_m: Array) -> bool:
        x, y = _plumb_m(self.contact, com_m)
        return bool((self.ends @ [x, y, 1.0]).max(initial=-1.0) > 0.0)

    def _stay(self, since: int, at_rest: bool) -> None:
        """Take back what the solver let a rock creep since a pose in which it rested, if its feet can hold it there.

        In the block in which it comes to rest it stays where it is: only what follows is known to be creep.
        """
        way, step, rested = self.stepper.way, self.motion.time_step_s, self.rests
        meanwhile = self.pulls_m_s2[
            int(way.times_s[since] / step) : math.ceil(self.stepper.time_s / step) + 1
        ]
        if len(meanwhile) == 0:  # the motion was over before
            meanwhile = self.gravity[None]
        stays = self._drift_m_s(since) < self.rest_speed if rested else at_rest
        self.rests = stays and bool(self._holds(meanwhile, since if rested else way.last).all())
        if rested and self.rests:
            self.deepest_m = max(self.deepest_m, self._penetration_m(*self._poses(since)))
            way.back_to(since)
            self.stepper.rest_until(self.stepper.grid)

    def _rests_for_good(self) -> bool:
        """Skip to the last block before equilibrium becomes impossible; true if it stays possible to the end.

        The pulls that friction and the support can hold form a convex cone, and the motion is linear between its
        samples: a rock at rest stays so up to the last sample of those that all lie in the cone. Blocks are skipped
        whole, so that what comes after is to the bit what it is without the skip.
        """
        first = int(self.stepper.time_s / self.motion.time_step_s)
        pulls = self.pulls_m_s2[first:]
        soon = int(BLOCK * self.step_s / self.motion.time_step_s) + 1
        if not self._holds(pulls[:soon], self.stepper.way.last).all():  # spares a look at the whole record
            return False
        held = self._holds(pulls, self.stepper.way.last)
        if held.all():
            self.left_s = max(self.motion.duration_s - self.stepper.time_s, 0.0)
            return True
        until_s = (first + max(int(np.argmin(held)) - 1, 0)) * self.motion.time_step_s
        blocks = (int(until_s / self.step_s) - self.stepper.grid) // BLOCK
        if blocks > 0:
            self.skipped_s += blocks * BLOCK * self.step_s
            self.stepper.rest_until(self.stepper.grid + blocks * BLOCK)
        return False

    def _calms_down(self) -> bool:
        """Whether all that is left of the motion is weak, so is the rocking, and the rock is displaced anyway."""
        if self.stepper.time_s <= self._weak_from_s or not self._too_little_energy():
            return False
        position, quaternion = self._poses(self.stepper.way.last)
        near = (
            self.contact.tilts_deg(quaternion)[0] < WEAK_TILT_DEG
            and _yaw_deg(quaternion[0], self.contact.start_quaternion_xyzw) < WEAK_YAW_DEG
        )
        calm = bool(near and self._is_displaced(position[0], quaternion[0]))
        if calm:
            self.left_s = self.motion.duration_s - self.stepper.time_s
        return calm

    def _shows_its_rest(self) -> bool:
        """Whether a rock that will not topple counts now as at rest: one that rocks tilted may come to stand."""
        position, quaternion = self._poses(self.stepper.way.last)
        tilted = self.contact.tilts_deg(quaternion)[0] > MOVED_DEG
        return not tilted or self._is_displaced(position[0], quaternion[0])

    @cached_property
    def _weak_from_s(self) -> float:
        return weak_from_s(self.scene, self.motion)

    def _is_displaced(self, position: Array, quaternion: Array) -> bool:
        """Whether the rock has slid or turned about the normal so far that it counts as moved, however it rocks."""
        slid = self._slip(position, quaternion) > MOVED_SHARE * self.contact.half_diagonal_m
        return slid or self._yaw(quaternion) > MOVED_DEG

    def _too_little_energy(self) -> bool:
        """Whether the rock rocks with far less energy than overturns it, and does not slide."""
        attitude = np.array(self.stepper.way.poses[-1][1])
        turn_deg = float(np.rad2deg(turn_rad(attitude, self.contact.start_quaternion_xyzw)))
        # Past its balance all of a rock's energies are below that of lying: no share of them holds it.
        energy = max(self._energy(), 0.0)
        return energy < REST_CERTAIN_SHARE * self._barrier(turn_deg) and not self._slides()

    def _cannot_overturn(self) -> bool:
        """Whether the rock's energy overturns it in no turn that it may roll to, and no slope keeps it sliding."""
        slip_ends = self.scene.contact.friction_kinetic >= friction_that_stops(self.scene)
        return self._energy() < self._barrier(None) and (slip_ends or not self._slides())

    def _barrier(self, turn_deg: float | None) -> float:
        """Energy that overturns the rock from its latest tilt, per mass."""
        tilt_deg = self.stepper.way.largest_tilt_deg(self.stepper.way.last)
        return least_overturning_j_kg(self.scene, tilt_deg, turn_deg)

    def _holds(self, pulls_m_s2: Array, index: int) -> NDArray[np.bool_]:
        """Whether the feet that touch in a pose can hold the rock under each pull, support frame."""
        com, attitude = (np.array(part) for part in self.stepper.way.poses[index])
        feet = com + self.contact.points_body_m @ quat.matrix(attitude).T
        touching = feet[feet[:, 2] <= TOUCHING_SHARE * self.contact.half_diagonal_m]
        corners = polygon(touching, PLANE, TOUCHING_SHARE * self.contact.half_diagonal_m)
        return holds_still(corners, com, PLANE, self.scene.contact.friction_static, pulls_m_s2)

    def report(self, status: str, ended_by: str, began: float, keep: bool) -> ShakeResult:
        """Measure the whole way."""
        position, quaternion = self._poses(0)
        tilt = self.contact.tilts_deg(quaternion)
        fallen = ended_by in ("fallen", "tilted", "slid_off")
        toppled = (fallen or bool(tilt[-1] > TOPPLED_TILT_DEG)) if status == "ok" else None
        crossing = self._point_of_no_return(ended_by, position, tilt) if toppled else None
        moved = (position - self.start_pose[0]) @ self.contact.scene_from_support.T
        slip, yaw = self._slip(position[-1], quaternion[-1]), self._yaw(quaternion[-1])
        outcome = None
        if status == "ok":
            displaced = self._is_displaced(position[-1], quaternion[-1]) or tilt[-1] > MOVED_DEG
            outcome = "toppled" if toppled else "moved" if displaced else "stands"
        return ShakeResult(
            status=status,
            outcome=outcome,
            toppled=toppled,
            topple_time_s=None if crossing is None else self.stepper.way.times_s[crossing],
            topple_azimuth_deg=None if crossing is None else self._fell_toward_deg(moved, crossing),
            max_tilt_deg=float(np.nanmax(tilt)),
            residual_tilt_deg=float(tilt[-1]),
            residual_yaw_deg=yaw,
            slip_m=slip,
            penetration_m=max(self.deepest_m, self._penetration_m(position, quaternion)),
            ended_by=ended_by,
            steps=self.stepper.steps,
            simulated_s=self.stepper.time_s - self.skipped_s,
            skipped_s=self.skipped_s + self.left_s,
            wall_s=time.perf_counter() - began,
            time_step_s=self.step_s,
            trajectory=_trajectory(self.contact, self.stepper.way.times_s, position, quaternion)
            if keep
            else None,
        )

    def _point_of_no_return(self, ended_by: str, position: Array, tilt: Array) -> int:
        """Index of the pose in which the final fall began, or the end of the pedestal was passed.

        That in which the centre of mass was last highest, along the plumb line, but not of a later rise: between two
        looks a rock that fell lands on its next face, and one that came to rest on another face is rocked there by the
        rest of the motion.
        """
        if ended_by == "slid_off":
            return len(position) - 1
        if ended_by in ("fallen", "tilted"):
            still = int(np.argmax(_fallen(self.contact, position) | (tilt > LARGEST_OPEN_TILT_DEG))) - 1
        else:  # at rest on another face
            still = int(np.flatnonzero(tilt <= TOPPLED_TILT_DEG).max(initial=0))
        return _last_top(position @ self.contact.scene_from_support[2], max(still, 0))

    def _fell_toward_deg(self, moved_m: Array, crossing: int) -> float:
        """Azimuth of the centre of mass's way (n, 3), scene frame, up to the crossing.

        A rock that starts past its balance has not moved by then but for rounding: it falls toward where it ends.
        """
        way_m = float(np.hypot(*moved_m[crossing, :2]))
        seen = crossing if way_m > NEGLIGIBLE_WAY_SHARE * self.contact.half_diagonal_m else -1
        return azimuth_deg(moved_m[seen])

    def _penetration_m(self, position: Array, quaternion: Array) -> float:
        return max(-float(self.stepper.gaps_m(position, quaternion).min()), 0.0)

    def _poses(self, since: int) -> tuple[Array, Array]:
        position, quaternion = zip(*self.stepper.way.poses[since:], strict=True)
        return np.array(position), np.array(quaternion)

    def _yaw(self, quaternion: Array) -> float:
        return _yaw_deg(quaternion, np.array(self.start_pose[1]))

    def _slip(self, position: Array, quaternion: Array) -> float:
        """Way of the material point at the centroid of the first contact, along the interface."""
        start, turned_from = self.start_pose
        gaps = self.contact.gaps_m(np.array([start]), np.array([turned_from]))[0]
        touching = gaps <= gaps.min() + 1e-4 * self.contact.half_diagonal_m
        point = self.contact.points_body_m[touching].mean(axis=0)
        now = position + quat.matrix(quaternion) @ point
        then = np.array(start) + quat.matrix(np.array(turned_from)) @ point
        return float(np.hypot(*(now - then)[:2]))

    def _speed(self, since: int) -> float:
        """Largest speed of the centre of mass since a pose, m/s.

        A step to a touch may begin with a part of next to no time, in which the feet are set to their height: parts
        count as no shorter than an impact's step.
        """
        position = np.array([pose[0] for pose in self.stepper.way.poses[since:]])
        durations = np.diff(self.stepper.way.times_s[since:])
        ways = np.linalg.norm(np.diff(position, axis=0), axis=1)
        return float((ways / np.maximum(durations, IMPACT_STEP * self.step_s)).max(initial=0.0))

    def _at_rest(self, since: int) -> bool:
        """Whether no point of the rock has moved faster than the speed of rest since a pose, nor does now."""
        velocity, spin = self.stepper.way.velocities(self.stepper.way.last)
        speed = np.linalg.norm(velocity) + np.linalg.norm(spin) * self.contact.half_diagonal_m
        return max(self._drift_m_s(since), float(speed)) < self.rest_speed

    def _drift_m_s(self, since: int) -> float:
        """Mean speed since a pose of the point that moved most."""
        way = self.stepper.way
        drift_m = travel_m(way.poses[since], way.poses[-1], self.contact.half_diagonal_m)
        return float(drift_m / (way.times_s[-1] - way.times_s[since]))

    def _slides(self) -> bool:
        """Whether the lowest foot moves along the interface: its way is not over yet."""
        velocity, spin = self.stepper.way.velocities(self.stepper.way.last)
        arms = self.contact.points_body_m @ quat.matrix(np.array(self.stepper.way.poses[-1][1])).T
        return slip_m_s(velocity, spin, arms[arms[:, 2].argmin()].tolist()) > self.rest_speed

    def _energy(self) -> float:
        """Kinetic energy, and potential energy above that of the rock lying where it is, per mass."""
        velocity, spin = self.stepper.way.velocities(self.stepper.way.last)
        position, quaternion = self.stepper.way.poses[-1]
        squared = np.array(to_body(spin, quaternion)) ** 2
        kinetic = 0.5 * (np.dot(velocity, velocity) + float(self.contact.principal_inertia_m2 @ squared))
        return kinetic + potential_j_kg(self.scene, np.array(position), np.array(quaternion))


@lru_cache(maxsize=8)
def _ends_of_pedestal(scene: Scene) -> Array:
    """Lines (n, 3) where a scanned pedestal ends: a x + b y + c > 0 beyond one, at places of :func:`_plumb_m`."""
    if scene.pedestal.vertices_m is None:
        return np.zeros((0, 3))
    contact = contact_of(scene)
    ground, rock = (
        _plumb_m(contact, (vertices_m - contact.origin_m) @ contact.scene_from_support)
        for vertices_m in (scene.pedestal.vertices_m, scene.rock.vertices_m)
    )
    lines = ConvexHull(ground).equations
    room_m = -(rock @ lines[:, :2].T + lines[:, 2]).max(axis=0)
    return np.asarray(lines[room_m < END_WITHIN_HEIGHTS * scene.rock.height_m])


END_WITHIN_HEIGHTS = 0.5
"""A mesh that goes on for more of the rock's height beside it ends with the scan and not with the ground: models/scan
keeps .6 of it."""


def _plumb_m(contact: ContactModel, places_m: Array) -> Array:
    """Where plumb lines through places (..., 3) of the support frame meet the interface plane, (..., 2)."""
    up = contact.scene_from_support[2]
    return np.asarray(places_m[..., :2] - places_m[..., 2:] * up[:2] / up[2])


def _trajectory(
    contact: ContactModel, times_s: list[float], position: Array, quaternion: Array
) -> Trajectory:
    turn = contact.scene_from_support
    relative = quat.product(quaternion, quat.inverse(contact.start_quaternion_xyzw))
    in_scene = np.column_stack([relative[:, :3] @ turn.T, relative[:, 3]])
    return Trajectory(np.array(times_s), position @ turn.T + contact.origin_m, in_scene)


def _speed_limit(
    scene: Scene, contact: ContactModel, motion: Motion, start: State | None, pose: Pose
) -> float:
    """A speed that the motion, the start and a fall of ten R more together cannot give, m/s."""
    given = float(np.linalg.norm(motion.acceleration_m_s2, axis=1).sum() * motion.time_step_s)
    fall_m = 10.0 * contact.half_diagonal_m
    if start is not None:
        fall_m += max(pose[0][2], 0.0)
        given += float(np.linalg.norm(start.velocity_m_s))
        given += float(np.linalg.norm(start.angular_velocity_rad_s)) * contact.half_diagonal_m
    return 2.0 * (given + float(np.sqrt(2.0 * scene.gravity_m_s2 * fall_m)))


def _yaw_deg(quaternion: Array, since: Array) -> float:
    return abs(float(np.rad2deg(turn_rad(quaternion, since)) + 180.0) % 360.0 - 180.0)


def _fallen(contact: ContactModel, position: Array) -> NDArray[np.bool_]:
    """Whether the centre of mass (n, 3), support frame, has lost more of its height than a rock that stands may."""
    return position[:, 2] < (1.0 - TOPPLED_FALL) * contact.com_m[2]


def _last_top(height: Array, still: int) -> int:
    """Index of the last maximum up to index `still`, or of the one to which the height rises there."""
    rises = np.append(np.diff(height) > 0.0, False)
    if rises[still]:
        return still + int(np.argmin(rises[still:]))
    before = np.flatnonzero(rises[:still])
    return int(before[-1]) + 1 if len(before) else 0


def _checked_step(time_step: float, half_diagonal_m: float, gravity_m_s2: float) -> float:
    longest = LONGEST_STEP_SHARE * np.sqrt(half_diagonal_m / gravity_m_s2)
    if not 0.0 < time_step <= longest:
        raise InputError(
            f"time_step is {time_step} s",
            where="shake",
            expected=f"a positive number up to {longest:.4g} s for a rock of this size",
            remedy="leave it out: the preset chooses one",
        )
    return float(time_step)


LONGEST_STEP_SHARE = 1 / 16
"""Steps longer than this share of sqrt(R / g) do not resolve a rocking rock."""
