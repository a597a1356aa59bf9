"""One shake of a rock on ground that is no plane."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from toppling.models.compiled import Array
from toppling.models.ground.body import PAIRS, RESTING_SHARE
from toppling.models.ground.contacts import CONTACT, MOST, no_pairs
from toppling.models.ground.equilibrium import held, is_held, wrenches
from toppling.models.ground.excitation import excitation
from toppling.models.ground.stepping import Grounded
from toppling.models.relief import height_below
from toppling.models.statics import TOPPLED_FALL
from toppling.workers import quaternion as quat
from toppling.workers.contact.candidates import LARGEST_OPEN_TILT_DEG
from toppling.workers.engines.protocol import Engine, GroundSteps
from toppling.workers.outcome import ShakeResult, result_of
from toppling.workers.problem import Problem
from toppling.workers.start import given_state

TOUCHING_SHARE = 1e-3
"""Of R: contacts of a rock that has come to rest are so near; one that creeps to rest ends with less than touching."""

STEEP = 0.5
"""Upward part of a contact's normal: less, and what is touched stands beside the rock, not below it."""

ROOM = 4096
"""Poses that the trajectory's arrays have room for at first."""


def shake_on_ground(problem: Problem, engine: Engine, *, trajectory: bool) -> ShakeResult:
    """Shake a rock whose contacts have normals of their own; keywords as of :func:`toppling.workers.shake`."""
    shaking = GroundShaking(problem, engine.ground_steps(problem))
    ended_by = shaking.run()
    return shaking.result(ended_by, trajectory=trajectory)


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
            pairs=no_pairs(PAIRS),
            contacts=np.zeros(MOST, CONTACT),
            trial=np.zeros(MOST, CONTACT),
            counts=np.zeros(6, np.int64),
            inertia_m2=body.inertia_m2,
            size_m=body.size_m,
            farthest_m=body.farthest_m,
            friction=(properties.friction_static, properties.friction_kinetic),
            restitution=properties.restitution,
            resolved_m_s=problem.options.resolved_impact * problem.speed_m_s,
            gravity_m_s2=body.load_m_s2(),
            excitation=excitation(acceleration, motion.time_step_s),
            sample_s=motion.time_step_s,
            step_s=problem.time_step_s,
            time_s=np.zeros(ROOM),
            pose=np.zeros((ROOM, 7)),
            velocity=np.zeros((ROOM, 6)),
        )
        self.sim.pose[0], self.sim.velocity[0] = pose, start
        self.skipped_s, self._deepest_m = 0.0, 0.0
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

    def run(self) -> str:
        """Step until the answer is certain; what ended it."""
        problem = self.problem
        if problem.start is None and problem.shortcuts and self._skip_rest():
            return "never_moved"
        block = problem.options.termination.block
        while True:
            since = self.last
            self._make_room(block)
            self._take_steps(self.sim, block)
            if ended_by := self._ended_by(since):
                return ended_by

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
            self.sim.time_s[1] = self.skipped_s = steps * self.sim.step_s
        return False

    def _ended_by(self, since: int) -> str | None:
        """What ends the shake, looking at the steps since a pose."""
        problem, sim = self.problem, self.sim
        poses, velocity = sim.pose[since : self.last + 1], sim.velocity[self.last]
        speed = float(np.linalg.norm(velocity[:3]))
        self._deepest_m = max(
            self._deepest_m, -float(sim.contacts["gap_m"][: sim.counts[0]].min(initial=0.0))
        )
        if not (np.isfinite(poses).all() and speed <= problem.speed_limit_m_s):
            return "speed_limit"
        tilts = problem.contact.tilts_deg(poses[:, 3:])
        if tilts.max() > LARGEST_OPEN_TILT_DEG:
            return "tilted"
        if self._has_fallen(poses[-1]):
            return "fallen"
        over_s = self.time_s - problem.motion.duration_s
        if over_s > 0.0:
            spin = float(np.linalg.norm(velocity[3:])) * self.body.size_m
            way = float(np.linalg.norm(poses[-1, :3] - poses[0, :3]))
            turned = 2.0 * float(np.linalg.norm(quat.product(poses[-1, 3:], quat.inverse(poses[0, 3:]))[:3]))
            lasted_s = sim.time_s[self.last] - sim.time_s[since]
            drift = (way + turned * self.body.size_m) / lasted_s
            if max(speed + spin, drift) < problem.rest_speed_m_s:
                return "rest"
            if over_s > problem.options.termination.cap_after * problem.unit_s:
                return "time_cap"
        return None

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
        if ended_by != "rest":
            return False
        last, start = self.sim.pose[self.last], self.sim.pose[0]
        return not self._held_from_below(last) and self._held_from_below(start)

    def _held_from_below(self, pose: Array) -> bool:
        """Whether the contacts below a rock at rest hold it: not steep, and not high above the lowest one."""
        near = self.body.contacts(pose, TOUCHING_SHARE * self.body.size_m)
        up = self.body.scene_from_support[2]
        over_m = near["place_m"] @ up
        low = over_m < over_m.min(initial=np.inf) + TOPPLED_FALL * self._stood_m
        below = near[low & (near["normal"] @ up > STEEP)]
        columns = wrenches(below["arm_m"], below["normal"], self.body.friction[0])
        return is_held(columns, self.body.load_m_s2(), self.body.size_m)

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
        sim, problem, last = self.sim, self.problem, self.last
        pose = sim.pose[: last + 1]
        arm = quat.matrix(pose[-1, 3:]) @ self._first_body
        slip_m = float(np.linalg.norm((pose[-1, :3] + arm - self._first_place)[:2]))
        turned = math.degrees(quat.yaw_between(pose[0], pose[-1]))
        never = ended_by == "never_moved"
        turned_deg = abs((turned + 180.0) % 360.0 - 180.0)
        return result_of(
            ended_by,
            _Displaced(turned_deg, slip_m),
            problem,
            sim.time_s[: last + 1],
            pose,
            trajectory=trajectory,
            lodged=self._lodged(ended_by),
            penetration_m=self._deepest_m,
            steps=int(sim.counts[3]),
            engine_steps=int(sim.counts[5]),
            simulated_s=self.time_s - self.skipped_s,
            skipped_s=problem.motion.duration_s if never else self.skipped_s,
            wall_s=0.0,
            time_step_s=sim.step_s,
        )
