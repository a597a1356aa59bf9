"""Cost of a job against the bare loop of Bullet over the same world, rate on one and two workers, memory of a worker.

    .venv/bin/python benchmarks/speed.py

Ratios of times taken in turns in one run: on a busy machine only these mean anything.
"""

import multiprocessing
import resource
import statistics
import time

import numpy as np
import pybullet

from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.workers.contact import REACH_DEG, contact_of
from toppling.workers.presets import settings_of
from toppling.workers.seating import settled
from toppling.workers.shake import shake
from toppling.workers.stepping import engine_for
from toppling.workers.way import STILL

ROUNDS = 7
SCENES = {
    "block": Scene.block(0.2, 0.2, 0.6, friction=0.8),
    "14 m block": Scene.block(3.0, 2.5, 7.0, friction=0.8),
}


def record(seed: int, peak_m_s2: float, seconds: float = 20.0) -> Motion:
    """Shaped noise: a second to rise, the rest to fade."""
    random = np.random.default_rng(seed)
    time_s = np.arange(int(seconds / 0.01)) * 0.01
    shape = np.minimum(time_s, 1.0) * np.exp(-np.maximum(time_s - 8.0, 0.0) / 4.0)
    smooth = np.apply_along_axis(np.convolve, 0, random.normal(size=(len(time_s), 3)), np.hanning(25), "same")
    values = smooth * shape[:, None]
    return Motion(peak_m_s2 * values / np.linalg.norm(values[:, :2], axis=1).max(), 0.01)


def bare_loop(scene: Scene, motion: Motion, steps: int) -> float:
    """Seconds for setGravity and stepSimulation alone, over the same world and the same pulls."""
    contact = contact_of(settled(scene))
    settings = settings_of("standard")
    step_s = settings.time_step_s(contact.half_diagonal_m, scene.gravity_m_s2)
    impulse = scene.gravity_m_s2 * step_s
    engine = engine_for(
        contact, REACH_DEG[0], scene.contact, impulse, impulse * step_s, 0.0, settings.solver, 0
    )
    engine.set_state((tuple(contact.com_m), tuple(contact.start_quaternion_xyzw)), STILL, STILL)
    pulls = np.array([0.0, 0.0, -scene.gravity_m_s2]) - motion.mean_between(np.arange(steps + 1) * step_s)
    pulls = pulls.tolist()
    client = engine._client
    pybullet.setPhysicsEngineParameter(fixedTimeStep=step_s, physicsClientId=client)
    began = time.perf_counter()
    for x, y, z in pulls:
        pybullet.setGravity(x, y, z, client)
        pybullet.stepSimulation(client)
    return time.perf_counter() - began


def against_the_bare_loop() -> None:
    """Per step: a job without shortcuts over the bare loop; per job: what the shortcuts save."""
    for name, scene in SCENES.items():
        peak = 0.8 * scene.gravity_m_s2 / 3
        ratios, saved, landings = [], [], []
        for seed in range(ROUNDS):
            motion = record(seed, 1.6 * peak)
            whole = shake(scene, motion, shortcuts=False)
            bare_s = bare_loop(scene, motion, whole.steps)
            ratios.append(whole.wall_s / bare_s)
            saved.append(shake(scene, motion).wall_s / whole.wall_s)
            landings.append(whole.steps)
        print(
            f"{name}: job / bare loop {statistics.median(ratios):.2f} "
            f"({min(ratios):.2f} to {max(ratios):.2f}); with shortcuts {statistics.median(saved):.2f} of that; "
            f"{statistics.median(landings):.0f} steps"
        )


def jobs(count: int, seed: int) -> float:
    """Seconds for a number of jobs."""
    scene = SCENES["block"]
    began = time.perf_counter()
    for k in range(count):
        shake(scene, record(seed + k % 20, 2.0 + k % 5))
    return time.perf_counter() - began


def rates() -> None:
    """Jobs a second of two processes over one."""
    context = multiprocessing.get_context("spawn")
    ratios = []
    with context.Pool(2) as pool:
        pool.starmap(jobs, [(2, 0), (2, 0)])  # imports
        for _ in range(3):
            began = time.perf_counter()
            pool.apply(jobs, (20, 0))
            alone = time.perf_counter() - began
            began = time.perf_counter()
            pool.starmap(jobs, [(20, 0), (20, 0)])
            ratios.append(2 * alone / (time.perf_counter() - began))
    print(f"two workers / one: {statistics.median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})")


def memory() -> None:
    """Peak memory of a process after 200 and after 2,000 jobs."""
    scene = SCENES["block"]
    motion = record(0, 5.0, seconds=3.0)
    kept = {}
    for k in range(1, 2001):
        shake(scene.with_friction(0.6 + 0.1 * (k % 4)), motion)
        if k in (200, 2000):
            kept[k] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"peak memory: {kept[200]:.0f} MB after 200 jobs, {kept[2000]:.0f} MB after 2,000")


if __name__ == "__main__":
    against_the_bare_loop()
    rates()
    memory()
