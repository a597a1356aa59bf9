"""One shake: seat the rock, step it through a motion until the answer is certain, tell what happened."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import trimesh

from toppling.models.compiled import ROLLING, SURFACE
from toppling.models.errors import InputError
from toppling.models.ground.creeping import settle
from toppling.models.ground.curved import tipped_over_m
from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.models.shapes import box
from toppling.workers.compile_once import ensure_compiled
from toppling.workers.contact.resting_contact import Rest
from toppling.workers.engines import DEFAULT, ENGINES, Integrator, Pool, engine_named, options_of
from toppling.workers.ground.extent import FALLS_AWAY, left_ground
from toppling.workers.ground.rolling import rolled_back
from toppling.workers.ground.shaking import shake_on_ground
from toppling.workers.observation import Body, Observation, observe
from toppling.workers.options import NumericalOptions
from toppling.workers.outcome import ShakeResult, result_of
from toppling.workers.problem import Problem
from toppling.workers.resolution import time_step_s
from toppling.workers.seating import settled
from toppling.workers.start import State, checked_start
from toppling.workers.termination import ENDS, FALLS, first_met, watch_of


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
    pool: Pool | None = None,
) -> ShakeResult:
    """Shake a rock with a ground motion and say whether it topples.

    Parameters
    ----------
    scene : Scene
    motion : Motion
        Acceleration of the ground. After it the ground stays at rest until the answer is certain.
    preset : str or NumericalOptions
        'draft', 'fast', 'standard' or 'reference', or options of one's own.
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
    pool : EnginePool, optional
        Worlds of the default engine to shake in; those of the process unless given.

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
    _compile_for(scene)
    began = time.perf_counter()
    pool = pool or ENGINES[DEFAULT].process_pool()
    options, start = options_of(preset, engine), None if initial is None else checked_start(initial)
    if start is None:
        scene = settled(scene, pool)
    step_s = time_step_s(scene, motion, options, time_step)
    result = _answer(
        Problem(scene, motion, options, step_s, start, shortcuts), engine, pool, trajectory=trajectory
    )
    return replace(result, wall_s=time.perf_counter() - began)


def _answer(problem: Problem, engine: str, pool: Pool, *, trajectory: bool) -> ShakeResult:
    """Shake on a plane with an engine, on another surface with the program's own steps.

    A rock that slides to where its ground falls away from the plane is shaken anew on its surface.
    """
    scene = problem.scene
    if not scene.ground.is_plane:
        return shake_on_ground(problem, engine_named(engine), trajectory=trajectory)
    shaking = Shaking(problem, engine_named(engine).integrator(problem, pool))
    ended_by, seen = shaking.run()
    if ended_by == "speed_limit":  # a state that is not finite has spoilt the worlds
        pool.forget()
    result = shaking.result(ended_by, seen, trajectory=trajectory)
    left = left_ground(scene, result, *shaking.integrator.history.time_and_pose(), on_plane=True)
    if left == FALLS_AWAY and scene.is_drawn_over_plane:
        left = None  # such a base does not fit the mesh: `slid_off` says when it is past a rim
    if left == FALLS_AWAY and scene.grounded.rests_nearby:
        _compile_surfaces()
        return shake_on_ground(problem, engine_named(engine), trajectory=trajectory)
    return result if left is None else shaking.result("left_ground", seen, trajectory=trajectory)


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
    """Compile what a shake needs for this machine, unless that was done: about half a minute, or nothing."""
    ensure_compiled(_small_shake)


def _compile_for(scene: Scene) -> None:
    """Compile what shakes of a scene need."""
    compile_once()
    if not scene.ground.is_plane:
        _compile_surfaces()
    elif scene.rolling_body is not None:
        _compile_rolling()


def compile_everything() -> None:
    """Compile what shakes on planes and on other surfaces need: for an image that ships compiled code."""
    compile_once()
    _compile_surfaces()
    _compile_rolling()


def _compile_surfaces() -> None:
    """As :func:`compile_once`, for shakes on surfaces."""
    ensure_compiled(_use_surfaces, SURFACE)


def _compile_rolling() -> None:
    """As :func:`compile_once`, for shakes of rocks with rounded bases."""
    ensure_compiled(lambda: _small_shake(_egg()), ROLLING)


def _egg() -> Scene:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.3)
    lower = np.where(ball.vertices[:, 2:] > 0.0, 1.0, 0.6)
    return Scene.from_mesh((np.hstack([ball.vertices[:, :2], lower * ball.vertices[:, 2:]]), ball.faces))


def _use_surfaces() -> None:
    scene = _block_in_groove()
    _small_shake(scene)
    body = scene.grounded
    settle(body.clockless(body.resting_pose, 0.01, body.curved), body.load_m_s2(), 1, np.inf)
    along, _, up = body.scene_from_support
    tipped_over_m(body.curved, body.resting_pose, up, along, 1.0, 1.0, 1.0)  # no dome, but compiled


def _block_in_groove() -> Scene:
    block = box(0.1, 0.1, 0.3).moved(np.eye(3), (0.0, 0.0, 0.31))
    groove = [[-1, -1, 0.1], [0, -1, 0], [1, -1, 0.1], [-1, 1, 0.1], [0, 1, 0], [1, 1, 0.1]]
    walls = np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]])
    rock = block.vertices_m, block.faces
    return Scene.from_mesh(rock, pedestal=(np.array(groove, float), walls), friction=0.8)


def _small_shake(scene: Scene | None = None) -> None:
    """Every compiled function has one signature, so that one shake meets them all."""
    time_s = np.arange(0.0, 1.0, 0.005)
    pulse = 6.0 * np.sin(2.0 * np.pi * time_s)
    motion = Motion(np.column_stack([pulse, 0.2 * pulse, 0.0 * pulse]), 0.005)
    shake(scene or Scene.block(0.3, 0.3, 1.0), motion, "fast")


class Shaking:
    """A shake under way."""

    def __init__(self, problem: Problem, integrator: Integrator) -> None:
        self.problem, self.integrator = problem, integrator
        self._body = Body.of(problem)
        self._rest = Rest(problem, self.integrator)

    def run(self) -> tuple[str, Observation]:
        """Step until the answer is certain; the rule that says so, and what was seen last."""
        problem, integrator, rest = self.problem, self.integrator, self._rest
        watch, since, seen = watch_of(problem), 0, self.seen()
        if problem.shortcuts and rest.rests and rest.lasts():
            return "never_moved", seen
        while True:
            before, since = since, integrator.advance(problem.options.termination.block, watch)
            rest.rests = rest.rests and since == before  # else it has moved on
            seen = self.seen(since)
            if ended_by := first_met(FALLS, seen, problem):
                return ended_by, seen
            if rest.keep(seen, since):
                seen = self.seen(integrator.history.last)
            over = seen.time_s > problem.motion.duration_s
            if over and rest.came_to_rest and rest.is_held():
                return "rest", seen
            if not over and problem.shortcuts and rest.rests and rest.lasts():
                return "rest_certain", seen
            if ended_by := first_met(ENDS, seen, problem):
                return ended_by, seen
            since = integrator.history.last

    def seen(self, since: int = 0) -> Observation:
        """Look at the steps since a pose."""
        return observe(self.integrator.history.sim, self._body, since)

    def result(self, ended_by: str, seen: Observation, *, trajectory: bool) -> ShakeResult:
        """Tell what happened."""
        history, skipped_s = self.integrator.history, self._rest.skipped_s
        time_s, pose = history.time_and_pose()
        if ended_by == "rest_certain" and self.problem.rolls and not history.rests:
            rest = rolled_back(self.problem.contact.start_pose, pose[-1])
            time_s, pose = np.append(time_s, time_s[-1]), np.vstack([pose, rest])
        certain = ended_by in ("never_moved", "rest_certain")
        left_s = max(self.problem.motion.duration_s - seen.time_s, 0.0) if certain else 0.0
        return result_of(
            ended_by,
            seen,
            self.problem,
            time_s,
            pose,
            trajectory=trajectory,
            penetration_m=history.penetration_m(),
            steps=history.steps,
            engine_steps=history.engine_steps,
            simulated_s=history.time_s - skipped_s,
            skipped_s=skipped_s + left_s,
            wall_s=0.0,
            time_step_s=self.problem.time_step_s,
        )
