"""One shake: seat the rock, step it through a motion until the answer is certain, tell what happened."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
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
from toppling.workers.outcome import ShakeResult, outcome_of, trajectory_of
from toppling.workers.problem import Problem
from toppling.workers.rest import Rest
from toppling.workers.seating import settled
from toppling.workers.start import State, checked_start
from toppling.workers.termination import ENDS, FALLS, Context, Verdict, verdict, weak_from_s

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
        'fast', 'standard' or 'reference', or options of one's own.
    trajectory : bool
        Keep the rock's poses.
    time_step : float, optional
        Seconds; replaces the preset's. Divided as the preset's is while the rock has hardly lifted.
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
    start = None if initial is None else checked_start(initial)
    pool = pool or process_pool()
    if start is None:
        scene = settled(scene, pool)
    options = preset if isinstance(preset, NumericalOptions) else options_of(preset, engine)
    half_diagonal_m, gravity_m_s2 = scene.rock.half_diagonal_m, scene.gravity_m_s2
    step_s = options.time_step_s(half_diagonal_m, gravity_m_s2)
    if time_step is not None:
        step_s = _checked_step(time_step, half_diagonal_m, gravity_m_s2)
    problem = Problem.of(scene, motion, options, step_s, start, shortcuts)
    shaking = Shaking.of(problem, INTEGRATORS[engine], pool)
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


@dataclass(frozen=True, eq=False)
class Shaking:
    """A shake under way.

    Parameters
    ----------
    integrator : Integrator
    body : Body
    rest : Rest
    context : Context
    """

    integrator: Integrator
    body: Body
    rest: Rest
    context: Context

    @classmethod
    def of(cls, problem: Problem, integrates: type[Integrator], pool: EnginePool) -> Shaking:
        """At its start; a scene without a start of its own is seated."""
        integrator = integrates(problem, pool)
        weak_share = problem.options.termination.weak_share
        return cls(
            integrator=integrator,
            body=Body.of(problem.scene, problem.contact, integrator.sim.pose[0].copy()),
            rest=Rest(problem, integrator),
            context=Context(
                problem=problem,
                weak_from_s=weak_from_s(problem.scene, problem.motion, weak_share),
                speed_limit_m_s=_speed_limit_m_s(problem),
            ),
        )

    def run(self) -> tuple[Verdict, Observation]:
        """Step until the answer is certain; the verdict, and what was seen last."""
        integrator, rest, context = self.integrator, self.rest, self.context
        since, seen = 0, self._seen(0)
        if context.problem.shortcuts and rest.rests and rest.lasts():
            return Verdict("ok", "never_moved"), seen
        while True:
            integrator.advance(context.options.block)
            seen = self._seen(since)
            said = verdict(FALLS, seen, context)
            if said is not None:
                return said, seen
            if rest.keep(seen, since):
                seen = self._seen(integrator.last)
            over = seen.time_s > context.motion_s
            if over and rest.came_to_rest and rest.is_held():
                return Verdict("ok", "rest"), seen
            if not over and context.problem.shortcuts and rest.rests and rest.lasts():
                return Verdict("ok", "rest_certain"), seen
            said = verdict(ENDS, seen, context)
            if said is not None:
                return said, seen
            since = integrator.last

    def result(self, said: Verdict, seen: Observation, *, trajectory: bool) -> ShakeResult:
        """Tell what happened; a state that is not finite has spoilt the worlds."""
        integrator, contact, skipped_s = self.integrator, self.context.problem.contact, self.rest.skipped_s
        if said.status == "diverged":
            integrator.pool.forget()
        times, poses = integrator.time_and_pose()
        certain = said.ended_by in ("never_moved", "rest_certain")
        left_s = max(self.context.motion_s - seen.time_s, 0.0) if certain else 0.0
        return ShakeResult(
            **outcome_of(said, seen, self.context, times, poses),  # type: ignore[arg-type]
            penetration_m=integrator.penetration_m(),
            steps=integrator.steps,
            simulated_s=integrator.time_s - skipped_s,
            skipped_s=skipped_s + left_s,
            wall_s=0.0,
            time_step_s=integrator.sim.step_s,
            trajectory=trajectory_of(contact, times, poses) if trajectory else None,
        )

    def _seen(self, since: int) -> Observation:
        shortest_s = self.integrator.sim.impact.engine_step * self.integrator.sim.step_s
        return observe(self.integrator.sim, self.body, since, shortest_s)


def _speed_limit_m_s(problem: Problem) -> float:
    """A speed that the motion, the start and a fall of ten R more together cannot give."""
    motion, half_diagonal_m = problem.motion, problem.contact.half_diagonal_m
    given_m_s = float(np.linalg.norm(motion.acceleration_m_s2, axis=1).sum() * motion.time_step_s)
    fall_m = 10.0 * half_diagonal_m
    if not problem.rests:
        fall_m += max(problem.pose[0][2], 0.0)
        given_m_s += float(np.linalg.norm(problem.velocity_m_s))
        given_m_s += float(np.linalg.norm(problem.angular_velocity_rad_s)) * half_diagonal_m
    return 2.0 * (given_m_s + float(np.sqrt(2.0 * problem.scene.gravity_m_s2 * fall_m)))


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
