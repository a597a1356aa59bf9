"""States of a rock in one shake, from its start on: the arrays of a :class:`Simulation`, and their growth."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from toppling.models.compiled import Array, compiled
from toppling.models.ground.excitation import excitation
from toppling.workers.contact.contact_points import REACH_DEG
from toppling.workers.contact.gaps import lowest_gap_m
from toppling.workers.contact.offset import set_normal_offset
from toppling.workers.problem import Problem
from toppling.workers.simulation import (
    CANDIDATE_ROWS,
    FIXED,
    FLAG_ROWS,
    NOT,
    STATE,
    WORK_ROWS,
    Simulation,
    X,
    Z,
    append,
    copy,
    forget_acceleration,
)

ROOM = 512
"""Poses that one step, cut at its impacts, may add."""


class StateHistory:
    """States of a rock in one shake, and what steps it."""

    def __init__(self, problem: Problem) -> None:
        contact, motion = problem.contact, problem.motion
        # Of sets with equally many points the one that serves the largest tilt.
        reach_deg = {contact.points_within(tilt): tilt for tilt in REACH_DEG}
        count = len(contact.points_body_m)
        self.sim = Simulation(
            state=np.zeros(1, STATE),
            fixed=_fixed(problem),
            **_track(4 * ROOM),
            candidates=_candidates(contact.points_body_m),
            flags=np.zeros((FLAG_ROWS, count), np.bool_),
            near=np.zeros(count, np.int64),
            chosen=np.zeros(3, np.int64),
            work=np.zeros((WORK_ROWS, 6)),
            set_tilt_deg=np.array(list(reach_deg.values())),
            set_points=np.array(list(reach_deg)),
            ground=excitation(motion.acceleration_m_s2 @ contact.scene_from_support, motion.time_step_s),
        )
        self._deepest_m = 0.0
        self.sim.pose[0], self.sim.velocity[0] = problem.initial
        state = self.sim.state
        state["world"], state["rests"], state["slips_after"] = -1, problem.start is None, -1.0
        state["draw"] = zlib.crc32(problem.motion.acceleration_m_s2.tobytes())

    @property
    def last(self) -> int:
        """Index of the latest pose."""
        return int(self.sim.state["last"][0])

    @property
    def time_s(self) -> float:
        """Time of the latest pose."""
        return float(self.sim.time_s[self.last])

    @property
    def grid(self) -> int:
        """Steps from time 0 to the latest pose."""
        return int(self.sim.state["grid"][0])

    @property
    def rests(self) -> bool:
        """Whether the rock rests in the latest pose."""
        return bool(self.sim.state["rests"][0])

    @property
    def steps(self) -> int:
        """Steps taken, repeated ones included."""
        return int(self.sim.state["steps"][0])

    @property
    def engine_steps(self) -> int:
        """Those of them that the engine took or checked."""
        return int(self.sim.state["engine_steps"][0])

    def time_and_pose(self) -> tuple[Array, Array]:
        """Times (n,) and poses (n, 7) so far."""
        return self.sim.time_s[: self.last + 1], self.sim.pose[: self.last + 1]

    def penetration_m(self) -> float:
        """Deepest that a contact point has been below the surface."""
        return max(self._deepest_m, -lowest_gap_m(self.sim, 0), 0.0)

    def rest_until(self, since: int, grid: int) -> None:
        """Let the rock rest in a pose up to a step; what comes then depends on that pose alone."""
        self.make_room_for(ROOM)
        if since < self.last:
            self._deepest_m = max(self._deepest_m, -lowest_gap_m(self.sim, since))
            self.sim.state["last"], self.sim.state["rests"] = since, 0
        rest_until(self.sim, grid)

    def make_room_for(self, poses: int) -> None:
        """Make sure that so many poses may be added."""
        if self.last + poses > len(self.sim.time_s):
            self.make_room()

    def make_room(self) -> None:
        """Take arrays of twice the length."""
        longer = _track(2 * len(self.sim.time_s))
        for name, array in longer.items():
            array[: self.last + 1] = getattr(self.sim, name)[: self.last + 1]
        self.sim = self.sim._replace(**longer)


@compiled
def rest_until(sim: Simulation, grid: int) -> None:
    """Let the rock rest where it is up to a step; what comes then depends on that pose alone."""
    state = sim.state[0]
    set_normal_offset(sim, 0.0)
    last = state.last
    moved = not (last > 0 and state.rests)
    if not moved:
        for k in range(7):
            moved = moved or sim.pose[last, k] != sim.pose[last - 1, k]
    if moved:
        last = append(sim, 0.0, 0.0)
        copy(sim.pose[last - 1], sim.pose[last])
    sim.time_s[last] = sim.velocity_time_s[last] = grid * sim.fixed[0].step_s
    for k in range(6):
        sim.velocity[last, k] = 0.0
    forget_acceleration(sim)
    state.grid, state.rests, state.placed = grid, 1, NOT


def _track(room: int) -> dict[str, Any]:
    """Empty arrays of a trajectory."""
    columns = {"time_s": (room,), "velocity_time_s": (room,), "pose": (room, 7), "velocity": (room, 6)}
    return {name: np.zeros(shape) for name, shape in columns.items()}


def _fixed(problem: Problem) -> NDArray[np.void]:
    """What does not change in a shake."""
    contact, options, scene = problem.contact, problem.options, problem.scene
    size_m, touch = contact.half_diagonal_m, options.contact
    fixed = np.zeros(1, FIXED)
    given = {
        **touch._asdict(),
        **options.impact._asdict(),
        "step_s": problem.time_step_s,
        "sample_s": problem.motion.time_step_s,
        "half_diagonal_m": size_m,
        "radius_m": contact.radius_m,
        "touching_m": touch.touching_share * size_m,
        "carrying_m": touch.carrying_share * size_m,
        "resting_m": touch.resting_share * size_m,
        "resolved_m_s": options.resolved_impact * problem.speed_m_s,
        "allowed_m_s": touch.allowed_speed * problem.speed_m_s,
        "friction_static": scene.contact.friction_static,
        "restitution": scene.contact.restitution,
        "two_frictions": scene.contact.friction_static != scene.contact.friction_kinetic,
        "checked_steps": options.checked_steps,
        "own_steps": options.own_steps,
        "skips_rest": problem.shortcuts,
        "inertia_m2": contact.principal_inertia_m2,
        "upright": contact.support_from_body[2],
        "gravity_m_s2": np.array([0.0, 0.0, -scene.gravity_m_s2]) @ contact.scene_from_support,
    }
    for name, value in given.items():
        fixed[name] = value
    return fixed


def _candidates(points_body_m: Array) -> Array:
    """Rows of the candidates, which all meet the plane z = 0."""
    rows = np.zeros((CANDIDATE_ROWS, len(points_body_m)))
    rows[X : Z + 1] = points_body_m.T
    return rows
