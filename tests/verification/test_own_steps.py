"""Steps that the program takes itself are the engine's steps: it repeats all of them over varied jobs."""

import dataclasses

import numpy as np
import pytest
import trimesh

from toppling.models.contact import ContactProperties
from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.models.shapes import box, cylinder
from toppling.workers.engines import DEFAULT, engine_named
from toppling.workers.engines.protocol import StepCheckError
from toppling.workers.options import PRESETS
from toppling.workers.problem import Problem
from toppling.workers.shake import shake
from toppling.workers.termination import unwatched

G = 9.81


def noise(random, peak_m_s2, seconds=5.0, rate_hz=100.0):
    """Band-limited noise with a smooth beginning and end."""
    time = np.arange(int(seconds * rate_hz)) / rate_hz
    motion = np.zeros((len(time), 3))
    for axis in range(3):
        for _ in range(8):
            motion[:, axis] += np.sin(
                2 * np.pi * random.uniform(0.5, 4.0) * time + random.uniform(0, 2 * np.pi)
            )
    motion *= np.sin(np.pi * time / time[-1])[:, None] ** 2
    return Motion(motion * peak_m_s2 * (1.0, 0.8, 0.4) / np.abs(motion).max(), 1.0 / rate_hz)


def boulder(random, rough_m):
    """A many-cornered rock on an uneven base."""
    angle = np.linspace(0.0, 2.0 * np.pi, 14, endpoint=False)
    rings = [
        np.column_stack([r * np.cos(angle + t), r * np.sin(angle + t), np.full(14, z)])
        for r, t, z in ((0.25, 0.0, 0.0), (0.4, 0.2, 0.5), (0.2, 0.1, 1.1))
    ]
    rings[0][:, 2] += random.uniform(0.0, rough_m, 14)
    mesh = trimesh.convex.convex_hull(np.vstack(rings))
    return mesh.vertices, mesh.faces


def job(number):
    """A scene, a motion and a preset, all drawn."""
    random = np.random.default_rng([43, number])
    shape = number % 5
    if shape == 0:
        solid = box(0.2, random.uniform(0.15, 0.4), 0.6)
        mesh = solid.vertices_m, solid.faces
    elif shape == 1:
        solid = cylinder(0.25, 0.6, sides=int(random.integers(3, 30)))
        mesh = solid.vertices_m, solid.faces
    else:
        mesh = boulder(random, (0.0, 1e-4, 3e-3)[shape - 2])
    static = float(random.choice([0.3, 0.5, 0.7, 1.0]))
    kinetic = static * float(random.choice([1.0, 1.0, 0.8]))
    slope_deg = float(random.choice([0.0, 0.0, 4.0, 9.0]))
    scene = Scene.from_mesh(mesh, slope_deg=slope_deg, slope_azimuth_deg=float(random.uniform(0, 360)))
    scene = scene.with_contact(ContactProperties(static, kinetic, float(random.choice([0.0, 0.0, 0.3]))))
    return scene, noise(random, G * random.uniform(0.3, 1.4)), str(random.choice(["draft", "fast"]))


def repeated(number):
    """A job's result as it is, and with every own step repeated by the engine."""
    scene, motion, preset = job(number)
    checked = dataclasses.replace(PRESETS[preset], checked_steps=1.0)
    return shake(scene, motion, preset, trajectory=True), shake(scene, motion, checked, trajectory=True)


def agree(numbers):
    for number in numbers:
        result, checked = repeated(number)
        np.testing.assert_array_equal(result.trajectory.position_m, checked.trajectory.position_m)
        assert (result.steps, result.ended_by) == (checked.steps, checked.ended_by)
        assert result.engine_steps <= checked.engine_steps == checked.steps


@pytest.mark.thorough
def test_the_engine_repeats_every_own_step_of_varied_jobs_to_rounding():
    agree(range(20))


@pytest.mark.slow
def test_the_engine_repeats_every_own_step_of_300_varied_jobs_to_rounding():
    agree(range(20, 320))


@pytest.mark.thorough
def test_looks_that_no_rule_calls_for_are_left_out_without_a_trace(monkeypatch):
    jobs = [job(number) for number in range(320, 340)]
    few = [shake(*each, trajectory=True) for each in jobs]
    monkeypatch.setattr("toppling.workers.shake.watch_of", unwatched)
    for each, result in zip(jobs, few, strict=True):
        looked = shake(*each, trajectory=True)
        np.testing.assert_array_equal(result.trajectory.position_m, looked.trajectory.position_m)
        rows = [
            dataclasses.asdict(dataclasses.replace(one, trajectory=None, wall_s=0.0))
            for one in (result, looked)
        ]
        assert rows[0] == rows[1]


def test_a_step_that_the_engine_takes_otherwise_is_an_error_of_the_job():
    scene, motion, preset = Scene.block(0.2, 0.25, 0.6), noise(np.random.default_rng(3), G), "fast"
    options = dataclasses.replace(PRESETS[preset], checked_steps=1.0)
    step_s = options.time_step_s(scene.rock.half_diagonal_m, G)
    integrator = engine_named(DEFAULT).integrator(Problem(scene, motion, options, step_s, None, False))
    integrator.advance(1)
    integrator._worlds.records["inertia_m2"] *= (1.0, 1.2, 1.0)  # the engine's rock is another one
    with pytest.raises(StepCheckError, match="preset 'standard'"):
        integrator.advance(100_000)


def test_an_attitude_whose_quaternion_has_a_zero_is_told_from_no_other():
    prism = cylinder(0.2, 0.6, sides=29)
    scene = Scene.from_mesh((prism.vertices_m, prism.faces), friction=10.0)
    pulse = 4.5 * np.sin(
        np.pi * np.arange(60) / 59.0
    )  # along an edge of its base: w stays 0 but for rounding
    motion = Motion(np.column_stack([pulse, 0.0 * pulse, 0.0 * pulse]), 0.01)
    assert shake(scene, motion, dataclasses.replace(PRESETS["fast"], checked_steps=1.0)).steps > 50


@pytest.mark.parametrize("preset", PRESETS)
def test_rows_count_the_steps_of_both_kinds(preset):
    scene = Scene.block(0.2, 0.25, 0.6, friction=5.0)  # nothing slips
    result = shake(scene, noise(np.random.default_rng(3), 0.6 * G), preset)
    assert result.steps > 300
    if PRESETS[preset].own_steps:
        assert result.engine_steps < 0.05 * result.steps
    else:
        assert result.engine_steps == result.steps
