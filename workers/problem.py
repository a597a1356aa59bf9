"""Problem of a shake: a rock, a motion, where it starts, and how finely it is resolved."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import fft
from scipy.spatial import ConvexHull

from toppling.models.caching import cached
from toppling.models.compiled import Flags
from toppling.models.errors import InputError
from toppling.models.ground.body import GROUND_REACH, RESTING_SHARE
from toppling.models.ground.equilibrium import STILL
from toppling.models.ground.points import ContactModel, contact_of
from toppling.models.motions.motion import Motion
from toppling.models.relief import height_below
from toppling.models.scene import Scene
from toppling.workers.options import NumericalOptions
from toppling.workers.start import Array, State, given_state, start_of

_AZIMUTH_STEP_DEG = 10.0

_END_WITHIN_HEIGHTS = 0.5
"""A mesh that ends so near beside the rock ends with the ground."""

_LOOKED_AT = 1024
"""Samples of the motion at a time."""


@dataclass(frozen=True, eq=False)
class Problem:
    """A shake as every integrator takes it.

    start: where and how fast the rock starts; None where it rests as the scene has it.
    shortcuts: whether time in which nothing can move is skipped, and the shake ends as soon as its answer is certain.
    """

    scene: Scene
    motion: Motion
    options: NumericalOptions
    time_step_s: float
    start: State | None
    shortcuts: bool

    @cached_property
    def contact(self) -> ContactModel:
        """The scene's."""
        return contact_of(self.scene)

    @cached_property
    def initial(self) -> tuple[Array, Array]:
        """Pose (7,) and velocity (6,) at time 0, support frame.

        Raises InputError if the start is given too deep inside the ground.
        """
        if self.scene.ground.is_plane:
            return start_of(self.contact, self.start)
        if self.start is not None:
            return given_state(self.contact, self.start)
        return self.scene.grounded.resting_pose, np.zeros(6)

    @cached_property
    def farthest_m(self) -> float:
        """From the centre of mass to what of the rock is farthest from it."""
        rock, base = self.scene.rock, self.scene.rounded_base
        places = rock.hull_vertices_m if base is None or not base.rolls else base.patches.vertices_m
        farthest_m = float(np.linalg.norm(places - rock.com_m, axis=1).max())
        return max(farthest_m, float(np.linalg.norm(self.contact.points_body_m, axis=1).max()))

    @cached_property
    def stood_m(self) -> float:
        """Height of the centre of mass over the ground at the start, along the plumb line."""
        contact, pose = self.contact, self.initial[0]
        up = contact.scene_from_support[2]
        if self.scene.ground.is_plane:
            return float(contact.com_m[2] / up[2])
        near = self.scene.grounded.contacts(pose, RESTING_SHARE * contact.half_diagonal_m)
        return float(-(near["arm_m"].mean(axis=0) @ up)) if len(near) else 0.0

    def height_over_ground_m(self, pose: Array) -> float:
        """Height of the centre of mass over the pedestal's surface in a pose (7,), along the plumb line; NaN off it."""
        contact, pedestal = self.contact, self.scene.pedestal
        assert pedestal.vertices_m is not None
        assert pedestal.faces is not None
        com = contact.scene_from_support @ pose[:3] + contact.origin_m
        return float(
            com[2] - height_below(com[None, :2], pedestal.vertices_m, pedestal.faces, highest=True)[0]
        )

    def is_beyond_scan(self, pose: Array) -> bool:
        """Whether the rock is where no ground is known: plumb over where the scan ends, or beyond what is looked at.

        A mesh that goes on for more of the rock's height beside it ends with the scan: a scanned pedestal keeps .6 of
        it.
        """
        contact = self.contact
        moved_m = math.hypot(pose[0] - contact.com_m[0], pose[1] - contact.com_m[1])
        if moved_m > GROUND_REACH * contact.half_diagonal_m - self.farthest_m:
            return True
        com = (contact.scene_from_support @ pose[:3] + contact.origin_m)[:2]
        lines, is_near = _ends_of_pedestal(self.scene)
        beyond = lines[:, :2] @ com + lines[:, 2] > 0.0
        return bool(beyond.any() and not (beyond & is_near).any())

    @property
    def rest_speed_m_s(self) -> float:
        """A rock whose points are slower rests."""
        return self.options.rest_speed * self.speed_m_s

    @property
    def speed_m_s(self) -> float:
        """sqrt(g R), which speeds are shares of."""
        return math.sqrt(self.scene.gravity_m_s2 * self.contact.half_diagonal_m)

    @property
    def unit_s(self) -> float:
        """sqrt(R / g), which times are shares of."""
        return math.sqrt(self.contact.half_diagonal_m / self.scene.gravity_m_s2)

    @cached_property
    def speed_limit_m_s(self) -> float:
        """A speed that the motion, the start and a fall of ten R more together cannot give."""
        motion, half_diagonal_m = self.motion, self.contact.half_diagonal_m
        given_m_s = float(np.linalg.norm(motion.acceleration_m_s2, axis=1).sum() * motion.time_step_s)
        fall_m = 10.0 * half_diagonal_m
        if self.start is not None:
            pose, velocity = self.initial
            fall_m += max(float(pose[2]), 0.0)
            given_m_s += float(np.linalg.norm(velocity[:3]))
            given_m_s += float(np.linalg.norm(velocity[3:])) * half_diagonal_m
        return 2.0 * (given_m_s + float(np.sqrt(2.0 * self.scene.gravity_m_s2 * fall_m)))

    @cached_property
    def weak_from_s(self) -> float:
        """Time from which the motion is weak, s: much stronger it would neither tip nor drag the rock.

        What tips it is the least constant acceleration of any azimuth that, slowly applied, topples
        (:mod:`models.statics`): of any, since a rock that has turned has its weakest side elsewhere.
        """
        motion = self.motion
        for end in range(len(motion.acceleration_m_s2), 0, -_LOOKED_AT):  # mostly found near the end
            begin = max(end - _LOOKED_AT, 0)
            strong = np.flatnonzero(~self._is_weak(motion.acceleration_m_s2[begin:end]))
            if len(strong):
                return float((begin + strong[-1] + 1) * motion.time_step_s)
        return 0.0

    def _is_weak(self, acceleration_m_s2: Array) -> Flags:
        """Whether samples (n, 3) of the motion are weak (n,)."""
        scene = self.scene
        stronger = acceleration_m_s2 / self.options.termination.weak_share
        downward = scene.gravity_m_s2 + stronger[:, 2]
        holds = np.hypot(stronger[:, 0], stronger[:, 1]) < downward * _tipping_ratio(scene)
        force = (np.array([0.0, 0.0, -scene.gravity_m_s2]) - stronger) @ self.contact.scene_from_support
        grips = np.hypot(force[:, 0], force[:, 1]) < -scene.contact.friction_kinetic * force[:, 2]
        return np.asarray(holds & grips)


@cached
def _ends_of_pedestal(scene: Scene) -> tuple[Array, Flags]:
    """Lines (n, 3) in plan where a pedestal's mesh ends, a x + b y + c > 0 beyond, and which are near the rock."""
    assert scene.pedestal.vertices_m is not None  # an endless plane ends nowhere
    lines = ConvexHull(scene.pedestal.vertices_m[:, :2]).equations
    room_m = -(scene.rock.vertices_m[:, :2] @ lines[:, :2].T + lines[:, 2]).max(axis=0)
    return lines, room_m < _END_WITHIN_HEIGHTS * scene.rock.height_m


@cached
def _tipping_ratio(scene: Scene) -> float:
    """Least constant horizontal acceleration that topples the rock, over gravity."""
    azimuths = np.arange(0.0, 360.0, _AZIMUTH_STEP_DEG).tolist()
    least = scene.quasi_static_toppling_m_s2(azimuths)
    return min(value for _, value in least) / scene.gravity_m_s2


_LONGEST_STEP_SHARE = 1 / 16
"""Steps longer than this share of sqrt(R / g) do not resolve a rocking rock."""

_SHORTEST_STEP_SHARE = 1e4 * STILL
"""In shorter ones a ten-thousandth of gravity moves a rock by less than what counts as at rest."""

_FAST_HZ = (15.0, 50.0)
"""Steps follow motions faster than the first, and none faster than the second."""

_FAST_SHARE = 0.25
"""Share of a motion's energy above its highest energetic frequency."""

_STEPS_PER_PERIOD = 12.0
"""Forces are averaged over a step: with n of them in a period, slip is short by some 300 / n^2 per cent."""


def time_step_s(scene: Scene, motion: Motion, options: NumericalOptions, asked_s: float | None) -> float:
    """The step that is asked for, or that of the options and the motion.

    Raises InputError if the one asked for does not resolve a rock of this size, or what moves it.
    """
    half_diagonal_m, gravity_m_s2 = scene.rock.half_diagonal_m, scene.gravity_m_s2
    if asked_s is None:
        step_s = options.time_step_s(half_diagonal_m, gravity_m_s2)
        shortest_s = 1.0 / (_STEPS_PER_PERIOD * _FAST_HZ[1])
        if step_s <= shortest_s or not _slips(scene, motion):
            return step_s
        fast_hz = _energetic_frequency_hz(motion)
        if fast_hz <= _FAST_HZ[0]:
            return step_s
        return min(step_s, max(1.0 / (_STEPS_PER_PERIOD * fast_hz), shortest_s))
    unit_s = np.sqrt(half_diagonal_m / gravity_m_s2)
    shortest_s, longest_s = _SHORTEST_STEP_SHARE * unit_s, _LONGEST_STEP_SHARE * unit_s
    if not shortest_s <= asked_s <= longest_s:
        raise InputError(
            "shake.step_out_of_range",
            f"time_step is {asked_s} s",
            where="shake",
            expected=f"a number from {shortest_s:.4g} to {longest_s:.4g} s for a rock of this size",
            remedy="leave it out: the preset chooses one",
        )
    return float(asked_s)


def _energetic_frequency_hz(motion: Motion) -> float:
    """Frequency above which a quarter of the energy of a motion's acceleration lies, of all components."""
    count = fft.next_fast_len(len(motion.acceleration_m_s2), real=True)
    energy = np.square(np.abs(fft.rfft(motion.acceleration_m_s2, count, axis=0))).sum(axis=1)
    below = np.cumsum(energy)
    return float(np.searchsorted(below, (1.0 - _FAST_SHARE) * below[-1]) / (count * motion.time_step_s))


def _slips(scene: Scene, motion: Motion) -> bool:
    """Whether a rock at rest on a plane slips under some sample; of one on another surface that is not asked."""
    if not scene.ground.is_plane:
        return True
    force = np.array([0.0, 0.0, -scene.gravity_m_s2]) - motion.acceleration_m_s2
    down = -force @ scene.pedestal.normal
    along = np.sqrt(np.maximum((force * force).sum(axis=1) - down * down, 0.0))
    return bool((along > scene.contact.friction_static * down).any())
