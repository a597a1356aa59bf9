"""What a rock's contact could be made of in Bullet: thresholds of a bare loop over each, against the exact integrator.

`benchmarks/front.py` puts the table into benchmarks/reports/accuracy.md.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path

import numpy as np
import pandas as pd
import pybullet

from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.workers.options import PRESETS
from toppling.workers.shake import shake

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from reference.rocking import Ground, PlaneBody, overturns

G = 9.81
BLOCKS = ((0.1, 0.6), (0.2, 0.6), (0.4, 0.6))
"""Half width and half height, m."""

PERIODS_S = (1.0, 1.5)
STEP_SHARES = (1 / 96, 1 / 128, 1 / 512)
FRICTION = 10.0
CLEAR_SHARE = 1e-3
"""Radius of the spheres that stand for corners, over R."""


def full_sine(amplitude_m_s2: float, period_s: float, samples: int = 400) -> Motion:
    """One sine along x."""
    phase = np.linspace(0.0, 2 * np.pi, samples + 1)
    return Motion(np.outer(amplitude_m_s2 * np.sin(phase), [1.0, 0.0, 0.0]), period_s / samples)


def least(low: float, high: float, topples: Callable[[float], bool]) -> float:
    """Least amplitude within 1e-4 that topples, from one that does not and one that does."""
    while high - low > 1e-4 * low:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if topples(middle) else (middle, high)
    return 0.5 * (low + high)


@cache
def exact_threshold_m_s2(half_width_m: float, half_height_m: float, period_s: float) -> float:
    """Least full sine that overturns a block that does not slip, by the event-driven integrator."""
    body, uplift = PlaneBody.rectangle(half_width_m, half_height_m), G * half_width_m / half_height_m
    grid = uplift * np.arange(1.02, 8.0, 0.02)
    first = next(a for a in grid if overturns(body, Ground.sine(a, period_s)))
    return least(first - 0.02 * uplift, first, lambda a: bool(overturns(body, Ground.sine(a, period_s))))


def threshold_errors(topples: Callable[[Scene, Motion], bool]) -> list[float]:
    """Relative errors of the least full sine that overturns, over blocks and periods, within 10 %."""
    errors = []
    for half_width_m, half_height_m in BLOCKS:
        scene = Scene.block(half_width_m, half_width_m, half_height_m, friction=FRICTION)
        for period_s in PERIODS_S:
            exact = exact_threshold_m_s2(half_width_m, half_height_m, period_s)

            def falls(a: float, scene: Scene = scene, period_s: float = period_s) -> bool:
                return topples(scene, full_sine(a, period_s))

            errors.append(least(0.9 * exact, 1.1 * exact, falls) / exact - 1.0)
    return errors


def box(half_m: np.ndarray, client: int) -> int:
    """Bullet's own box."""
    return int(
        pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half_m.tolist(), physicsClientId=client)
    )


def hull(half_m: np.ndarray, client: int) -> int:
    """Convex hull of the corners, as a mesh is loaded."""
    return int(
        pybullet.createCollisionShape(
            pybullet.GEOM_MESH, vertices=_corners(half_m).tolist(), physicsClientId=client
        )
    )


def corner_points(half_m: np.ndarray, client: int) -> int:
    """A small sphere at every corner."""
    radius = CLEAR_SHARE * float(np.linalg.norm(half_m))
    return int(
        pybullet.createCollisionShapeArray(
            shapeTypes=[pybullet.GEOM_SPHERE] * 8,
            radii=[radius] * 8,
            collisionFramePositions=(_corners(half_m) * (1.0 - radius / half_m * (0, 0, 1))).tolist(),
            physicsClientId=client,
        )
    )


def _corners(half_m: np.ndarray) -> np.ndarray:
    return half_m * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])


REPRESENTATIONS = {"box": box, "convex hull": hull, "corner points": corner_points}


@contextmanager
def world(scene: Scene, shape_of: Callable[[np.ndarray, int], int]) -> Iterator[tuple[int, int]]:
    """Bullet's world of a block on a plane, 50 iterations, no damping; yields the client and the block.

    Every call names the client: in a process that has shaken, the default one is a world of the program's own.
    """
    client = pybullet.connect(pybullet.DIRECT)
    try:
        half_m = 0.5 * np.ptp(scene.rock.vertices_m, axis=0)
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=client)
        ground = pybullet.createMultiBody(0.0, plane, physicsClientId=client)
        block = pybullet.createMultiBody(
            1.0, shape_of(half_m, client), basePosition=scene.rock.com_m.tolist(), physicsClientId=client
        )
        pybullet.setPhysicsEngineParameter(contactSlop=0.0, numSolverIterations=50, physicsClientId=client)
        pybullet.changeDynamics(ground, -1, lateralFriction=FRICTION, restitution=0.0, physicsClientId=client)
        pybullet.changeDynamics(
            block, -1, localInertiaDiagonal=np.diag(scene.rock.inertia_per_mass_m2).tolist(),
            lateralFriction=1.0, linearDamping=0.0, angularDamping=0.0, restitution=0.0,
            activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING, physicsClientId=client,
        )  # fmt: skip
        yield client, block
    finally:
        pybullet.disconnect(client)


def bare_loop(
    shape_of: Callable[[np.ndarray, int], int], step_share: float
) -> Callable[[Scene, Motion], bool]:
    """Whether a block falls in a loop of setGravity and stepSimulation with a step of this share of sqrt(R / g)."""

    def topples(scene: Scene, motion: Motion) -> bool:
        step_s = step_share * float(np.sqrt(scene.rock.half_diagonal_m / G))
        times = np.arange(int((motion.duration_s + 4.0) / step_s) + 1) * step_s
        pulls = (np.array([0.0, 0.0, -G]) - motion.mean_between(times)).tolist()
        with world(scene, shape_of) as (client, block):
            pybullet.setTimeStep(step_s, client)
            for x, y, z in pulls:
                pybullet.setGravity(x, y, z, client)
                pybullet.stepSimulation(client)
            place, _ = pybullet.getBasePositionAndOrientation(block, client)
            return bool(place[2] < 0.8 * scene.rock.com_m[2])

    return topples


def compared() -> pd.DataFrame:
    """Mean and largest threshold errors of each representation at each step."""
    rows = []
    for name, shape_of in REPRESENTATIONS.items():
        for share in STEP_SHARES:
            errors = np.array(threshold_errors(bare_loop(shape_of, share)))
            rows.append(
                {
                    "representation": name,
                    "step": share,
                    "mean": errors.mean(),
                    "largest": np.abs(errors).max(),
                }
            )
    return pd.DataFrame(rows)


def _topples(preset: str, scene: Scene, motion: Motion) -> bool:
    return bool(shake(scene, motion, preset).toppled)


def table_of_representations() -> str:
    """The comparison as a section of a page, with the presets in its last rows."""
    lines = [
        "## Contact representations\n",
        "Error of the smallest full sine that overturns each of three blocks, in a bare Bullet loop with Bullet's own",
        "shapes and with the presets. Steps are in units of sqrt(R/g).\n",
        "| representation | step | mean error | largest |",
        "|---|---|---|---|",
    ]
    rows = [(row.representation, row.step, row.mean, row.largest) for row in compared().itertuples()]
    for name in ("draft", "fast", "standard"):
        errors = np.array(threshold_errors(partial(_topples, name)))
        rows.append(
            (f"points, preset `{name}`", PRESETS[name].step_share, errors.mean(), np.abs(errors).max())
        )
    lines += [
        f"| {name} | 1/{1 / step:.0f} | {100 * mean:+.3f} % | {100 * largest:.3f} % |"
        for name, step, mean, largest in rows
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    print(table_of_representations())
