"""A shake: seat the rock, step it through a motion until a rule says that the answer is certain, tell what happened."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from toppling.models.caching import cached
from toppling.models.compiled import Array
from toppling.models.errors import InputError
from toppling.models.ground.plane import (
    FLAT_SHARE,
    NO_POINTS,
    PlanePoints,
    flat_part_of,
    not_listed,
    plane_points,
)
from toppling.models.ground.points import contact_of
from toppling.models.ground.rigid import excitation
from toppling.models.ground.rolling import NO_ROLLING, RollingSurface, rolling_surface
from toppling.models.ground.stepping import settle, unmoved
from toppling.models.motions.motion import Motion
from toppling.models.pedestal import LARGEST_OPEN_TILT_DEG
from toppling.models.scene import Scene
from toppling.models.shapes import box
from toppling.models.statics import STEEP, TOPPLED_FALL
from toppling.workers.compile_once import ensure_compiled
from toppling.workers.engines import DEFAULT, engine_named, options_of
from toppling.workers.engines.protocol import Steps
from toppling.workers.options import NumericalOptions
from toppling.workers.outcome import ShakeResult, result_of
from toppling.workers.problem import Problem, time_step_s
from toppling.workers.seating import seated, settled
from toppling.workers.standing import TOUCHING_SHARE, let_down
from toppling.workers.start import State, checked_start
from toppling.workers.stepping import Watch, steps_at_once, take_steps
from toppling.workers.termination import Body, Observation, Seen, fallen_below_m, first_met, observe

_LOOKS_AFTER = 10.0
"""Time over sqrt(R / g) between two checks of the energy of a rock that is off its plane."""

_ROOM = 4096
"""Poses that the trajectory's arrays have room for at first."""


class Shaking:
    """A shake under way.

    Parameters
    ----------
    problem : Problem
    take_steps : Steps
        Of an engine.
    """

    def __init__(self, problem: Problem, take_steps: Steps) -> None:
        self.problem, self._take_steps = problem, take_steps
        contact, motion, properties = problem.contact, problem.motion, problem.scene.contact
        gravity = np.array([0.0, 0.0, -problem.scene.gravity_m_s2]) @ contact.scene_from_support
        over, size_m = not_listed(_plane_points(problem.scene)), contact.half_diagonal_m
        friction = properties.friction_static, properties.friction_kinetic
        sim = unmoved(over, problem.farthest_m, contact.principal_inertia_m2, size_m, friction)
        self.sim = sim._replace(
            rolling=_rolling(problem),
            restitution=properties.restitution,
            resolved_m_s=problem.options.resolved_impact * problem.speed_m_s,
            gravity_m_s2=gravity,
            excitation=excitation(motion.acceleration_m_s2 @ contact.scene_from_support, motion.time_step_s),
            sample_s=motion.time_step_s,
            step_s=problem.time_step_s,
            at_once=steps_at_once(problem),
            time_s=np.zeros(_ROOM),
            pose=np.zeros((_ROOM, 7)),
            velocity=np.zeros((_ROOM, 6)),
        )
        if not problem.scene.ground.is_plane:
            self._meet_meshes()
        self.sim.pose[0], self.sim.velocity[0] = problem.initial
        self._body = Body.of(problem)
        self._rest_s, self._deepest_m = np.full(3, -1.0), np.zeros(1)
        self._rest_s[0] = 0.0
        self._next_look_s = 0.0

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
        """Step until the answer is certain; the rule that says so."""
        problem, block = self.problem, self.problem.options.termination.block
        if problem.start is None and problem.shortcuts:
            take_steps(self.sim, block, self._watch()._replace(moves=False))
            if ended_by := first_met(self.seen(0)):
                return ended_by
        while True:
            self._make_room(block)
            since = self._take_steps(self.sim, block, self._watch())
            if since < 0:
                self._meet_meshes()
                continue
            seen = self.seen(since)
            if ended_by := first_met(seen):
                return ended_by
            self._next_look_s = self.time_s + (0.0 if seen.now.over_plane else _LOOKS_AFTER * problem.unit_s)

    def seen(self, since: int = 0) -> Seen:
        """State for the termination rules, after the steps since a pose."""
        sim, last = self.sim, self.last
        now: Observation = observe(sim, self._body, since)
        return Seen(
            now=now,
            pose=sim.pose[last],
            velocity=sim.velocity[last],
            agrees=sim.counts[4] == 0,
            moved=self.problem.start is not None or sim.counts[3] > 0,
            stands=bool(self._rest_s[1] == now.time_s),
            held_until_s=float(self._rest_s[2]),
            problem=self.problem,
        )

    def _watch(self) -> Watch:
        """Conditions of the next check of the rules."""
        problem, contact = self.problem, self.problem.contact
        up, upright = contact.scene_from_support[2], contact.support_from_body[2]
        over_s = problem.motion.duration_s
        may_calm = problem.shortcuts and len(self.sim.over.points) > 0 and not problem.scene.rolls
        first_s = min(over_s, problem.weak_from_s) if may_calm else over_s
        return Watch(
            up=(up[0], up[1], up[2]),
            upright=(upright[0], upright[1], upright[2]),
            fastest_m_s=problem.speed_limit_m_s,
            fallen_m=TOPPLED_FALL * problem.stood_m,
            lowest_m=fallen_below_m(problem),
            least_cosine=math.cos(math.radians(LARGEST_OPEN_TILT_DEG)),
            until_s=max(self._next_look_s, first_s),
            over_s=over_s,
            deepest_m=self._deepest_m,
            skips=problem.shortcuts,
            rest_s=self._rest_s,
            moves=True,
        )

    def _meet_meshes(self) -> None:
        """Let the rock's mesh and that of its ground answer where there is no plane."""
        body = self.problem.scene.grounded
        self.sim = self.sim._replace(
            rock=body.moving[0],
            ground=body.moving[1],
            facets=body.facets,
            lists=body.empty_lists(),
        )

    def _lodged(self, ended_by: str) -> bool:
        """Whether contacts beside its base hold the rock, without which it would move on, and did not at the start."""
        if ended_by not in ("rest", "rest_certain") or len(self.sim.rock.faces) == 0:
            return False
        start, last, body = self.sim.pose[0], self.sim.pose[self.last], self.problem.scene.grounded
        if ended_by == "rest_certain" and self._rest_s[1] != self.time_s:
            rest = let_down(body, last)
            last = last if rest is None else rest
        near, load = body.near_contacts(last, TOUCHING_SHARE * body.size_m), body.load_m_s2()
        if not body.hold(near, load[None])[0]:  # slow, and held by nothing: it still rocks
            return False
        return not self._base_holds(last) and self._base_holds(start)

    def _base_holds(self, pose: Array) -> bool:
        """Whether the contacts of its base alone hold a rock at rest.

        These are the lowest that are not steep, and those at parts of the rock that carried it at the start.
        """
        body, reach_m = self.problem.scene.grounded, TOPPLED_FALL * self.problem.stood_m
        near, on_rock_m = self._touching(pose)
        at_first, first_m = self._touching(self.sim.pose[0])
        up = body.scene_from_support[2]
        first_m = first_m[at_first["normal"] @ up > STEEP]
        flat, level_m = near["normal"] @ up > STEEP, near["place_m"] @ up
        base = flat & (level_m < level_m[flat].min(initial=np.inf) + reach_m)
        if len(first_m):
            base |= cKDTree(first_m).query(on_rock_m)[0] < reach_m
        return bool(body.hold(near[base], body.load_m_s2()[None])[0])

    def _touching(self, pose: Array) -> tuple[np.ndarray, Array]:
        """Contacts, and where (n, 3) on the rock as it stood at the start: from its centre, z up."""
        body = self.problem.scene.grounded
        near = body.near_contacts(pose, TOUCHING_SHARE * body.size_m)
        back = Rotation.from_quat(self.sim.pose[0, 3:]) * Rotation.from_quat(pose[3:]).inv()
        return near, back.apply(near["arm_m"]) @ body.scene_from_support.T

    def _make_room(self, steps: int) -> None:
        if self.last + steps + 2 < len(self.sim.time_s):
            return
        sim = self.sim
        self.sim = sim._replace(
            time_s=np.concatenate([sim.time_s, np.zeros_like(sim.time_s)]),
            pose=np.concatenate([sim.pose, np.zeros_like(sim.pose)]),
            velocity=np.concatenate([sim.velocity, np.zeros_like(sim.velocity)]),
        )

    def result(self, ended_by: str, *, trajectory: bool) -> ShakeResult:
        """Outcome of the shake."""
        sim, problem = self.sim, self.problem
        time_s, pose = self.time_and_pose()
        rolls = problem.scene.rolls and len(sim.rock.faces) == 0 and self._rest_s[1] != self.time_s
        if ended_by == "rest_certain" and rolls:
            rest = seated(problem.contact.start_pose, pose[-1])
            time_s, pose = np.append(time_s, time_s[-1]), np.vstack([pose, rest])
        certain = ended_by in ("never_moved", "rest_certain")
        left_s = max(problem.motion.duration_s - self.time_s, 0.0) if certain else 0.0
        skipped_s = float(self._rest_s[0])
        return result_of(
            ended_by,
            self.seen().now,
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


@cached
def _plane_points(scene: Scene) -> PlanePoints:
    """Points that touch the interface plane, as long as the ground is that plane where the rock is."""
    if not scene.ground.is_plane:
        return NO_POINTS
    contact = contact_of(scene)
    points, as_drawn = contact.points_body_m, scene.is_drawn_over_plane
    gaps = contact.gaps_m(contact.start_pose)
    is_base = (
        gaps <= gaps.min() + FLAT_SHARE * scene.rock.height_m if as_drawn else np.ones(len(points), bool)
    )
    places = contact.com_m + points @ contact.support_from_body.T
    part = flat_part_of(scene.pedestal, scene.rock, places[is_base, :2] if as_drawn else None)
    return plane_points(points, is_base, part, as_drawn=as_drawn)


def _rolling(problem: Problem) -> RollingSurface:
    """The smooth surface with which a rounded base touches its plane."""
    contact, base, com_m = problem.contact, problem.scene.rounded_base, problem.scene.rock.com_m
    if base is None or not base.rolls or not problem.scene.ground.is_plane:
        return NO_ROLLING
    return rolling_surface(base.patches, com_m, contact.scene_from_support @ contact.support_from_body)


def shake(
    scene: Scene,
    motion: Motion,
    preset: str | NumericalOptions = "standard",
    *,
    trajectory: bool = False,
    time_step: float | None = None,
    shortcuts: bool = True,
    initial: State | Mapping[str, Any] | None = None,
    engine: str = DEFAULT,
) -> ShakeResult:
    """Shake a rock with a ground motion and say whether it topples.

    Parameters
    ----------
    scene : Scene
    motion : Motion
        Acceleration of the ground. After it the ground stays at rest until the answer is certain.
    preset : str or NumericalOptions
        'fast', 'standard' or 'reference', or options of one's own.
    trajectory : bool
        Keep the rock's poses.
    time_step : float, optional
        Seconds; replaces the preset's.
    shortcuts : bool
        Skip the time in which nothing can move, and end as soon as the answer is certain.
    initial : State or mapping of its fields, optional
        Where and how fast the rock starts; inside the ground by more than 1e-4 R, it is raised along the interface's
        normal to where it touches. Without it the rock is seated and settled first.
    engine : str
        One of :data:`toppling.workers.engines.ENGINES`: the default does all, the others what their entries say.

    Returns
    -------
    ShakeResult

    Raises
    ------
    InputError
        If a setting is out of range, the rock does not stand by itself where the scene puts it, or it starts deep
        inside the ground or in no finite state.
    """
    _check_kinds(scene, motion)
    compile_once()
    began = time.perf_counter()
    options, start = options_of(preset, engine), None if initial is None else checked_start(initial)
    if start is None:
        scene = settled(scene)
    problem = Problem(
        scene, motion, options, time_step_s(scene, motion, options, time_step), start, shortcuts
    )
    shaking = Shaking(problem, engine_named(engine).steps(problem))
    result = shaking.result(shaking.run(), trajectory=trajectory)
    return replace(result, wall_s=time.perf_counter() - began)


def _check_kinds(scene: object, motion: object) -> None:
    for kind, given, remedy in (
        (Scene, scene, "make one with Scene.load, Scene.from_mesh or Scene.block"),
        (Motion, motion, "Motion(acceleration, time_step): (n, 3) in m/s2, and seconds"),
    ):
        if not isinstance(given, kind):
            name = kind.__name__
            what = f"{name.lower()} is a {type(given).__name__}"
            raise InputError("shake.kind_unusable", what, where="shake", expected=f"a {name}", remedy=remedy)


def compile_once() -> None:
    """Compile what a shake needs for this machine, unless that was done: about a minute, or nothing."""
    ensure_compiled(_use_everything)


def _use_everything() -> None:
    """Every compiled function has one signature, so that few shakes meet them all."""
    time_s = np.arange(0.0, 1.0, 0.005)
    pulse = 6.0 * np.sin(2.0 * np.pi * time_s)
    motion, groove = Motion(np.column_stack([pulse, 0.2 * pulse, 0.0 * pulse]), 0.005), _block_in_groove()
    for scene in (Scene.block(0.3, 0.3, 1.0), groove):
        shake(scene, motion, "fast")
    body = groove.grounded
    settle(body.clockless(body.resting_pose, 0.01), body.load_m_s2(), 1, np.inf)
    groove.quasi_static_toppling_m_s2([0.0])


def _block_in_groove() -> Scene:
    block = box(0.1, 0.1, 0.3).moved(np.eye(3), (0.0, 0.0, 0.31))
    groove = [[-1, -1, 0.1], [0, -1, 0], [1, -1, 0.1], [-1, 1, 0.1], [0, 1, 0], [1, 1, 0.1]]
    walls = np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]])
    rock = block.vertices_m, block.faces
    return Scene.from_mesh(rock, pedestal=(np.array(groove, float), walls), friction=0.8)
