"""One shake: seat the rock, step it through a motion until the answer is certain, tell what happened."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from toppling.models.errors import InputError
from toppling.models.ground.creeping import settle
from toppling.models.ground.curved import tipped_over_m
from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.models.shapes import box
from toppling.workers.compile_once import ensure_compiled
from toppling.workers.engines import DEFAULT, engine_named, options_of
from toppling.workers.options import NumericalOptions
from toppling.workers.outcome import ShakeResult
from toppling.workers.problem import Problem
from toppling.workers.resolution import time_step_s
from toppling.workers.seating import settled
from toppling.workers.shaking import Shaking
from toppling.workers.start import State, checked_start


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
    """Compile what a shake needs for this machine, unless that was done: about half a minute, or nothing."""
    ensure_compiled(_use_everything)


def _use_everything() -> None:
    """Every compiled function has one signature, so that few shakes meet them all."""
    time_s = np.arange(0.0, 1.0, 0.005)
    pulse = 6.0 * np.sin(2.0 * np.pi * time_s)
    motion, groove = Motion(np.column_stack([pulse, 0.2 * pulse, 0.0 * pulse]), 0.005), _block_in_groove()
    for scene in (Scene.block(0.3, 0.3, 1.0), groove):
        shake(scene, motion, "fast")
    body = groove.grounded
    settle(body.clockless(body.resting_pose, 0.01, body.curved), body.load_m_s2(), 1, np.inf)
    along, _, up = body.scene_from_support
    tipped_over_m(body.curved, body.resting_pose, up, along, 1.0, 1.0, 1.0)  # no dome, but compiled
    groove.quasi_static_toppling_m_s2([0.0])


def _block_in_groove() -> Scene:
    block = box(0.1, 0.1, 0.3).moved(np.eye(3), (0.0, 0.0, 0.31))
    groove = [[-1, -1, 0.1], [0, -1, 0], [1, -1, 0.1], [-1, 1, 0.1], [0, 1, 0], [1, 1, 0.1]]
    walls = np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]])
    rock = block.vertices_m, block.faces
    return Scene.from_mesh(rock, pedestal=(np.array(groove, float), walls), friction=0.8)
