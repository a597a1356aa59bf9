"""A rock on a surface in MuJoCo: both as convex pieces, each contact along the normal that the engine finds."""

from __future__ import annotations

from typing import Any

import numpy as np

from toppling.models.errors import InputError
from toppling.models.ground.kind import FLAT_SHARE
from toppling.models.ground.stepping import Grounded
from toppling.models.kept import kept
from toppling.models.scene import Scene
from toppling.workers.engines.mujoco.free_body import Stepper, forces_in, forces_m_s2, hull, touch, world
from toppling.workers.engines.mujoco.pieces import ground_pieces, hollow_m, rock_pieces
from toppling.workers.engines.protocol import GroundSteps
from toppling.workers.ground.stepping import GroundWatch
from toppling.workers.problem import Problem

_MOST_PIECES = {"rock": 100, "ground": 3000}
"""Of what is to be collided: more take minutes to prepare, and seconds a step."""


def ground_steps(problem: Problem) -> GroundSteps:
    """What steps a rock on a surface.

    Raises
    ------
    InputError
        If the rock or its ground is not of convex pieces, or of too many.
    """
    scene, step_s = problem.scene, problem.time_step_s
    stepper = Stepper(*_world(scene, step_s))
    gravity_m_s2 = scene.grounded.load_m_s2()
    forces = forces_m_s2(problem.motion, step_s, gravity_m_s2, problem.contact.scene_from_support)

    def take_steps(sim: Grounded, steps: int, watch: GroundWatch) -> int:  # a look after each block
        last, grid = sim.counts[1], sim.counts[2]
        new = slice(last + 1, last + steps + 1)
        sim.pose[new], sim.velocity[new] = stepper.states(
            sim.pose[last], sim.velocity[last], forces_in(forces, gravity_m_s2, grid, steps)
        )
        sim.time_s[new] = (grid + 1 + np.arange(steps)) * step_s
        sim.counts[[1, 2, 3, 5]] += steps
        near = scene.grounded.contacts(sim.pose[sim.counts[1]], FLAT_SHARE * scene.grounded.size_m)
        watch.deepest_m[0] = max(watch.deepest_m[0], -near["gap_m"].min(initial=0.0))
        return int(last)

    return take_steps


@kept
def _world(scene: Scene, step_s: float) -> tuple[Any, Any]:
    """A scene as MuJoCo's model and data: support frame, body axes."""
    import mujoco

    grounded = scene.grounded
    spec, body = world(step_s, grounded.pose[:3], grounded.inertia_m2)
    flat_m = FLAT_SHARE * scene.rock.height_m
    hollow = hollow_m(grounded.rock, 0.01 * flat_m)
    if hollow <= flat_m:
        rock = [grounded.rock.vertices_m]
    else:
        wedges = rock_pieces(grounded.rock)
        if wedges is None or len(wedges) > _MOST_PIECES["rock"]:
            raise _too_hollow(hollow / scene.rock.height_m, wedges)
        rock = wedges
    ground = ground_pieces(grounded.ground, 2.0 * grounded.size_m)
    if len(ground) > _MOST_PIECES["ground"]:
        raise InputError("engine.too_many_pieces",
            f"the pedestal's surface is of {len(ground)} convex pieces", where="engine mujoco",
            expected=f"at most {_MOST_PIECES['ground']} near the rock",
            remedy="leave the engine out, or give a surface of fewer triangles")  # fmt: skip
    for where, pieces in ((body, rock), (spec.worldbody, ground)):
        for number, points in enumerate(pieces):
            name = f"{'rock' if where is body else 'ground'} {number}"
            touch(where.add_geom(**hull(spec, name, points)), step_s, scene.contact.friction_static)
    model = spec.compile()
    return model, mujoco.MjData(model)


def _too_hollow(share: float, wedges: list[Any] | None) -> InputError:
    what = "no point sees all of it" if wedges is None else f"it is of {len(wedges)} convex pieces"
    return InputError(
        "engine.rock_hollow",
        f"the rock is hollow by {share:.2g} of its height, and {what}",
        where="engine mujoco",
        expected=f"a convex rock, or one of at most {_MOST_PIECES['rock']} convex pieces that meet in a point",
        remedy="leave the engine out: the default knows any closed mesh",
    )
