"""One shake: seat the rock, step it through a motion until the answer is certain, tell what happened."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from toppling.models.errors import InputError
from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.workers.compiled import ensure_compiled
from toppling.workers.engine import EnginePool, process_pool
from toppling.workers.integrator import Integrator
from toppling.workers.mujoco_engine import MujocoIntegrator
from toppling.workers.observation import Body, Observation, observe
from toppling.workers.options import NumericalOptions, options_of
from toppling.workers.outcome import ShakeResult, result_of
from toppling.workers.problem import Problem
from toppling.workers.rest import Rest
from toppling.workers.seating import settled
from toppling.workers.start import State, checked_start
from toppling.workers.termination import ENDS, FALLS, first_met

INTEGRATORS = {"pybullet": Integrator, "mujoco": MujocoIntegrator}

LONGEST_STEP_SHARE = 1 / 16
"""Steps longer than this share of sqrt(R / g) do not resolve a rocking rock."""


def shake(
    scene: Scene,
    motion: Motion,
    preset: str | NumericalOptions = "standard",
    *,
    trajectory: bool = False,
    time_step: float | None = None,
    shortcuts: bool = True,
    initial: State | Mapping[str, Any] | None = None,
    engine: str = "pybullet",
    pool: EnginePool | None = None,
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
        'pybullet', or 'mujoco' where that extra is installed: cheaper, without restitution, with one friction.
    pool : EnginePool, optional
        Worlds to shake in; those of the process unless given.

    Returns
    -------
    ShakeResult

    Raises
    ------
    InputError
        If a setting is out of range, the rock does not stand by itself where the scene puts it, or it starts deep
        inside the ground or in no finite state.
    """
    compile_once()
    began = time.perf_counter()
    options, start = options_of(preset, engine), None if initial is None else checked_start(initial)
    pool = pool or process_pool()
    if start is None:
        scene = settled(scene, pool)
    half_diagonal_m, gravity_m_s2 = scene.rock.half_diagonal_m, scene.gravity_m_s2
    step_s = options.time_step_s(half_diagonal_m, gravity_m_s2)
    if time_step is not None:
        step_s = _checked_step(time_step, half_diagonal_m, gravity_m_s2)
    problem = Problem(scene, motion, options, step_s, start, shortcuts)
    shaking = Shaking(problem, INTEGRATORS[engine](problem, pool))
    result = shaking.result(*shaking.run(), trajectory=trajectory)
    return replace(result, wall_s=time.perf_counter() - began)


def compile_once() -> None:
    """Compile what a shake needs for this machine, unless that was done: about a minute, or nothing."""
    ensure_compiled(_small_shake)


def _small_shake() -> None:
    """Every compiled function has one signature, so that one shake meets them all."""
    time_s = np.arange(0.0, 1.0, 0.005)
    pulse = 6.0 * np.sin(2.0 * np.pi * time_s)
    motion = Motion(np.column_stack([pulse, 0.2 * pulse, 0.0 * pulse]), 0.005)
    shake(Scene.block(0.3, 0.3, 1.0), motion, "fast")


class Shaking:
    """A shake under way."""

    def __init__(self, problem: Problem, integrator: Integrator) -> None:
        self.problem, self.integrator = problem, integrator
        self._body = Body.of(problem)
        self._rest = Rest(problem, self.integrator)

    def run(self) -> tuple[str, Observation]:
        """Step until the answer is certain; the rule that says so, and what was seen last."""
        problem, integrator, rest = self.problem, self.integrator, self._rest
        since, seen = 0, self.seen()
        if problem.shortcuts and rest.rests and rest.lasts():
            return "never_moved", seen
        while True:
            integrator.advance(problem.options.termination.block)
            seen = self.seen(since)
            if ended_by := first_met(FALLS, seen, problem):
                return ended_by, seen
            if rest.keep(seen, since):
                seen = self.seen(integrator.last)
            over = seen.time_s > problem.motion.duration_s
            if over and rest.came_to_rest and rest.is_held():
                return "rest", seen
            if not over and problem.shortcuts and rest.rests and rest.lasts():
                return "rest_certain", seen
            if ended_by := first_met(ENDS, seen, problem):
                return ended_by, seen
            since = integrator.last

    def seen(self, since: int = 0) -> Observation:
        """Look at the steps since a pose."""
        return observe(self.integrator.sim, self._body, since)

    def result(self, ended_by: str, seen: Observation, *, trajectory: bool) -> ShakeResult:
        """Tell what happened; a state that is not finite has spoilt the worlds."""
        integrator, skipped_s = self.integrator, self._rest.skipped_s
        if ended_by == "speed_limit":
            integrator.pool.forget()
        certain = ended_by in ("never_moved", "rest_certain")
        left_s = max(self.problem.motion.duration_s - seen.time_s, 0.0) if certain else 0.0
        return result_of(
            ended_by,
            seen,
            self.problem,
            *integrator.time_and_pose(),
            trajectory=trajectory,
            penetration_m=integrator.penetration_m(),
            steps=integrator.steps,
            simulated_s=integrator.time_s - skipped_s,
            skipped_s=skipped_s + left_s,
            wall_s=0.0,
            time_step_s=integrator.sim.step_s,
        )


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
