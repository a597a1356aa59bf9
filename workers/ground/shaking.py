"""One shake of a rock on ground that is no plane."""

from __future__ import annotations

import math
from bisect import bisect_left
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from toppling.models.compiled import Array
from toppling.models.ground.body import RESTING_SHARE, GroundedBody
from toppling.models.ground.contacts import CONTACT, MOST
from toppling.models.ground.equilibrium import held
from toppling.models.ground.excitation import excitation
from toppling.models.ground.rolling import NO_ROLLING
from toppling.models.ground.stepping import Grounded, work_room
from toppling.models.relief import height_below
from toppling.models.statics import TOPPLED_FALL
from toppling.workers import quaternion as quat
from toppling.workers.contact.contact_points import LARGEST_OPEN_TILT_DEG
from toppling.workers.engines.protocol import Engine, GroundSteps
from toppling.workers.ground.extent import left_ground
from toppling.workers.ground.rest import TOUCHING_SHARE, energy_j_kg, holds, least_overturning_j_kg, let_down
from toppling.workers.ground.stepping import GroundWatch, steps_at_once
from toppling.workers.observation import travel_m
from toppling.workers.outcome import ShakeResult, result_of
from toppling.workers.problem import Problem
from toppling.workers.start import given_state

_STEEP = 0.5
"""Upward part of a contact's normal: less, and what is touched stands beside the rock, not below it."""

_LOOKS_AFTER, _HOLDS_AFTER = 10.0, 4.0
"""Of sqrt(R / g): between two looks at the energy that is left after the motion; at whether a rest lasts through it."""

_ROOM = 4096
"""Poses that the trajectory's arrays have room for at first."""


def shake_on_ground(problem: Problem, engine: Engine, *, trajectory: bool) -> ShakeResult:
    """Shake a rock whose contacts have normals of their own; keywords as of :func:`toppling.workers.shake`."""
    shaking = GroundShaking(problem, engine.ground_steps(problem))
    ended_by = shaking.run()
    result = shaking.result(ended_by, trajectory=trajectory)
    left = left_ground(problem.scene, result, *shaking.time_and_pose(), on_plane=False)
    return result if left is None else shaking.result("left_ground", trajectory=trajectory)


class _Displaced(NamedTuple):
    turned_deg: float
    slip_m: float


class GroundShaking:
    """A shake under way."""

    def __init__(self, problem: Problem, take_steps: GroundSteps) -> None:
        self.problem, self._take_steps = problem, take_steps
        self.body = problem.scene.grounded
        motion, contact = problem.motion, problem.contact
        acceleration = motion.acceleration_m_s2 @ contact.scene_from_support
        body, properties = self.body, problem.scene.contact
        pose, start = body.resting_pose, np.zeros(6)
        if problem.start is not None:
            pose, start = given_state(contact, problem.start)
        self.sim = Grounded(
            rock=body.rock,
            ground=body.ground,
            rolling=NO_ROLLING,
            curved=body.curved,
            facets=body.facets,
            lists=body.empty_lists(),
            contacts=np.zeros(MOST, CONTACT),
            trial=np.zeros(MOST, CONTACT),
            counts=np.zeros(7, np.int64),
            inertia_m2=body.inertia_m2,
            size_m=body.size_m,
            friction=(properties.friction_static, properties.friction_kinetic),
            restitution=properties.restitution,
            resolved_m_s=problem.options.resolved_impact * problem.speed_m_s,
            gravity_m_s2=body.load_m_s2(),
            excitation=excitation(acceleration, motion.time_step_s),
            sample_s=motion.time_step_s,
            step_s=problem.time_step_s,
            at_once=steps_at_once(problem),
            time_s=np.zeros(_ROOM),
            pose=np.zeros((_ROOM, 7)),
            velocity=np.zeros((_ROOM, 6)),
            work=work_room(),
        )
        self.sim.pose[0], self.sim.velocity[0] = pose, start
        self._rest_s, self._deepest_m = np.zeros(3), np.zeros(1)
        self._next_look_s = 0.0
        self._stands_in: Array | None = None
        touching = body.contacts(pose, RESTING_SHARE * body.size_m)
        first = touching["arm_m"].mean(axis=0) if len(touching) else np.zeros(3)
        self._first_body = quat.matrix(pose[3:]).T @ first
        self._first_place = pose[:3] + first

    @property
    def last(self) -> int:
        """Index of the latest pose."""
        return int(self.sim.counts[1])

    @property
    def time_s(self) -> float:
        """Time of the latest pose."""
        return float(self.sim.time_s[self.last])

    def time_and_pose(self) -> tuple[Array, Array]:
        """Times (n,) and poses (n, 7) so far."""
        return self.sim.time_s[: self.last + 1], self.sim.pose[: self.last + 1]

    def run(self) -> str:
        """Step until the answer is certain, or a step has no impulses on which all contacts agree; what ended it."""
        problem = self.problem
        if problem.start is None and problem.shortcuts and self._skip_rest():
            return "never_moved"
        block = problem.options.termination.block
        while True:
            self._make_room(block)
            since = self._take_steps(self.sim, block, self._watch())
            if self.sim.counts[4] > 0:
                return "contacts_disagree"
            if ended_by := self._ended_by(since):
                return ended_by

    def _watch(self) -> GroundWatch:
        """What calls for the next look."""
        problem, up = self.problem, self.body.scene_from_support[2]
        upright, over_s = problem.contact.support_from_body[2], problem.motion.duration_s
        return GroundWatch(
            up=(up[0], up[1], up[2]),
            upright=(upright[0], upright[1], upright[2]),
            fastest_m_s=problem.speed_limit_m_s,
            fallen_m=TOPPLED_FALL * self._stood_m,
            least_cosine=math.cos(math.radians(LARGEST_OPEN_TILT_DEG)),
            drift_m_s=problem.rest_speed_m_s,
            look_at_s=min(self._next_look_s, over_s) if problem.shortcuts else over_s,
            until_s=max(self._next_look_s, over_s),
            deepest_m=self._deepest_m,
            skips=problem.shortcuts,
            rest_s=self._rest_s,
        )

    def _skip_rest(self) -> bool:
        """Skip to the last block before a sample that the contacts at rest cannot hold; whether they hold all."""
        problem = self.problem
        forces = np.vstack([self.body.load_m_s2() - self.sim.excitation[:, :3], self.body.load_m_s2()])
        free = np.flatnonzero(~held(self.body.held, forces @ self.body.scene_from_support.T))
        if len(free) == 0:
            return True
        steps = int(max(int(free[0]) - 1, 0) * self.sim.sample_s / self.sim.step_s)
        steps -= steps % problem.options.termination.block
        if steps > 0:
            self.sim.counts[1], self.sim.counts[2] = 1, steps
            self.sim.pose[1], self.sim.velocity[1] = self.sim.pose[0], 0.0
            self.sim.time_s[1] = self._rest_s[0] = steps * self.sim.step_s
        return False

    def _ended_by(self, since: int) -> str | None:
        """What ends the shake, looking at the steps since a pose."""
        problem, sim = self.problem, self.sim
        poses, velocity = sim.pose[since : self.last + 1], sim.velocity[self.last]
        speed = float(np.linalg.norm(velocity[:3]))
        if not (np.isfinite(poses).all() and speed <= problem.speed_limit_m_s):
            return "speed_limit"
        if problem.contact.tilts_deg(poses[:, 3:]).max() > LARGEST_OPEN_TILT_DEG:
            return "tilted"
        if self._has_fallen(poses[-1]):
            return "fallen"
        over_s = self.time_s - problem.motion.duration_s
        slow = max(speed + self._spin_m_s(velocity), self._drift_m_s(since)) < problem.rest_speed_m_s
        if over_s > 0.0 and slow:
            return "rest"
        if problem.shortcuts and self.time_s >= self._next_look_s:
            if over_s <= 0.0 and slow and self._is_held_to_the_end():
                return "rest_certain"
            if over_s > 0.0 and self._will_stand(over_s):
                return "rest_certain"
        if over_s > problem.options.termination.cap_after * problem.unit_s:
            return "time_cap"
        return None

    def _spin_m_s(self, velocity: Array) -> float:
        return float(np.linalg.norm(velocity[3:])) * self.body.size_m

    def _drift_m_s(self, since: int) -> float:
        """Mean speed from a pose to the latest one."""
        way = travel_m(self.sim.pose[since], self.sim.pose[self.last], self.body.size_m)
        return way / float(self.sim.time_s[self.last] - self.sim.time_s[since])

    def _is_held_to_the_end(self) -> bool:
        """Whether the contacts of a rock that rests hold all that is left of the motion."""
        self._next_look_s = self.time_s + _HOLDS_AFTER * self.problem.unit_s
        _, unmoved_at_s, until_s = self._rest_s
        if unmoved_at_s == self.time_s:
            return bool(until_s >= self.problem.motion.duration_s)
        first = int(self.time_s / self.sim.sample_s)
        gravity = self.body.load_m_s2()
        loads = np.vstack([gravity - self.sim.excitation[first:, :3], gravity])
        return holds(self.body, self.sim.pose[self.last], loads)

    def _will_stand(self, over_s: float) -> bool:
        """Whether a rock on ground at rest does not slide, and has too little energy to overturn where it would stand.

        At first that is a small share of what overturns it; once it has had time to come near rest, a larger one.
        """
        options, last = self.problem.options.termination, self.last
        pose, velocity = self.sim.pose[last], self.sim.velocity[last]
        self._next_look_s = self.time_s + _LOOKS_AFTER * self.problem.unit_s
        if not self._sliding_m_s() <= self.problem.rest_speed_m_s:
            return False
        rest = let_down(self.body, pose)
        if rest is None:
            return False
        calmed = over_s > options.calmed_after * self.problem.unit_s
        off_deg = math.degrees(2.0 * math.acos(min(abs(float(pose[3:] @ rest[3:])), 1.0)))
        if (
            not calmed and off_deg > options.moved_deg
        ):  # what is told of its last pose is to be true of its rest
            return False
        share = options.certain_share if calmed else options.calm_share
        energy = energy_j_kg(self.body, pose, velocity, rest)
        if not energy < share * least_overturning_j_kg(self.body, rest, energy / share):
            return False
        self._stands_in = rest
        return True

    def _sliding_m_s(self) -> float:
        """Speed along the ground of the rock's fastest contact that carries it; infinite where none does."""
        carrying, velocity = self.sim.contacts[: self.sim.counts[0]], self.sim.velocity[self.last]
        rate = velocity[:3] + np.cross(velocity[3:], carrying["arm_m"])
        rate -= (rate * carrying["normal"]).sum(axis=1)[:, None] * carrying["normal"]
        return float(np.linalg.norm(rate, axis=1).max()) if len(carrying) else math.inf

    @property
    def _stood_m(self) -> float:
        """Height of the centre of mass over its first contacts, along the plumb line."""
        return float((self.sim.pose[0, :3] - self._first_place) @ self.body.scene_from_support[2])

    def _has_fallen(self, pose: Array) -> bool:
        """Whether the centre of mass has lost a share of its height, and the ground below it is not as far down."""
        up, first = self.body.scene_from_support[2], self.sim.pose[0]
        stood_m = self._stood_m
        if float((first[:3] - pose[:3]) @ up) <= TOPPLED_FALL * stood_m:
            return False
        com = self.body.scene_from_support @ pose[:3]
        below = height_below(
            com[None, :2], self.body.ground_in_scene_m, self.body.ground.faces, highest=True
        )[0]
        return not np.isfinite(below) or com[2] - below < (1.0 - TOPPLED_FALL) * stood_m

    def _lodged(self, ended_by: str) -> bool:
        """Whether the rock rests only with the help of what stands beside it, and did not so at the start."""
        if ended_by not in ("rest", "rest_certain"):
            return False
        last = self.sim.pose[self.last] if self._stands_in is None else self._stands_in
        start = self.sim.pose[0]
        near, load = self.body.near_contacts(last, TOUCHING_SHARE * self.body.size_m), self.body.load_m_s2()
        if not self.body.hold(near, load[None])[0]:  # slow, and held by nothing: it still rocks
            return False
        return not self._held_from_below(last) and self._held_from_below(start)

    def _held_from_below(self, pose: Array) -> bool:
        """Whether a rock at rest is held by contacts below it and by parts of it that carried it at the start.

        Below are those that are not steep, and not far up a rock that lies against them.
        """
        near, on_rock_m = self._touching(pose)
        at_first, first_m = self._touching(self.sim.pose[0])
        up = self.body.scene_from_support[2]
        flat, flat_at_first = near["normal"] @ up > _STEEP, at_first["normal"] @ up > _STEEP
        if not flat.any() or not flat_at_first.any():
            return False
        at_first, first_m = at_first[flat_at_first], first_m[flat_at_first]
        load, reach_m = self.body.load_m_s2()[None], TOPPLED_FALL * self._stood_m
        again = cKDTree(first_m).query(on_rock_m)[0] < reach_m
        if self.body.hold(near[again], load)[0]:
            return True
        low = flat & (on_rock_m[:, 2] < _lowest_that_hold_m(self.body, at_first, first_m[:, 2]) + reach_m)
        return bool(self.body.hold(near[low | again], load)[0])

    def _touching(self, pose: Array) -> tuple[np.ndarray, Array]:
        """Contacts, and where (n, 3) on the rock as it stood at the start: from its centre, z up."""
        near = self.body.near_contacts(pose, TOUCHING_SHARE * self.body.size_m)
        turned = self.body.scene_from_support @ quat.matrix(self.sim.pose[0, 3:]) @ quat.matrix(pose[3:]).T
        return near, near["arm_m"] @ turned.T

    def _make_room(self, steps: int) -> None:
        if self.last + steps + 1 < len(self.sim.time_s):
            return
        sim = self.sim
        self.sim = sim._replace(
            time_s=np.concatenate([sim.time_s, np.zeros_like(sim.time_s)]),
            pose=np.concatenate([sim.pose, np.zeros_like(sim.pose)]),
            velocity=np.concatenate([sim.velocity, np.zeros_like(sim.velocity)]),
        )

    def result(self, ended_by: str, *, trajectory: bool) -> ShakeResult:
        """What happened."""
        sim, problem = self.sim, self.problem
        time_s, pose = self.time_and_pose()
        arm = quat.matrix(pose[-1, 3:]) @ self._first_body
        slip_m = float(np.linalg.norm((pose[-1, :3] + arm - self._first_place)[:2]))
        turned = math.degrees(quat.yaw_between(pose[0], pose[-1]))
        certain = ended_by in ("never_moved", "rest_certain")
        left_s = max(problem.motion.duration_s - self.time_s, 0.0) if certain else 0.0
        skipped_s = float(self._rest_s[0])
        turned_deg = abs((turned + 180.0) % 360.0 - 180.0)
        return result_of(
            ended_by,
            _Displaced(turned_deg, slip_m),
            problem,
            time_s,
            pose,
            trajectory=trajectory,
            lodged=self._lodged(ended_by),
            penetration_m=float(self._deepest_m[0]),
            steps=int(sim.counts[3]),
            engine_steps=int(sim.counts[5]),
            simulated_s=self.time_s - skipped_s,
            skipped_s=skipped_s + left_s,
            wall_s=0.0,
            time_step_s=sim.step_s,
        )


def _lowest_that_hold_m(body: GroundedBody, contacts: np.ndarray, height_m: Array) -> float:
    """Height of the highest of those contacts that alone, without any above them, hold a rock at rest."""
    levels_m = np.unique(height_m)
    enough = bisect_left(
        levels_m,
        True,
        key=lambda level_m: body.hold(contacts[height_m <= level_m], body.load_m_s2()[None])[0],
    )
    return float(levels_m[enough]) if enough < len(levels_m) else np.inf
