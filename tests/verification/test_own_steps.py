"""The engine carries out the program's steps and finds the same contacts: all of them, over varied jobs."""

import dataclasses

import numpy as np
import pytest
import trimesh

from toppling.models.motions.motion import Motion
from toppling.models.pedestal import ContactProperties
from toppling.models.scene import Scene
from toppling.models.shapes import box, cylinder
from toppling.workers.engines import bullet
from toppling.workers.engines.protocol import StepCheckError
from toppling.workers.options import PRESETS
from toppling.workers.shaking import Shaking, shake

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
    return scene, noise(random, G * random.uniform(0.3, 1.4)), "fast"


def agree(numbers):
    """Jobs with the share of their steps that a preset has checked, and with all."""
    repeated = np.zeros(2)
    for number in numbers:
        scene, motion, preset = job(number)
        result = shake(scene, motion, preset, trajectory=True)
        all_of_them = dataclasses.replace(PRESETS[preset], checked_steps=1.0)
        checked = shake(scene, motion, all_of_them, trajectory=True)
        np.testing.assert_array_equal(result.trajectory.position_m, checked.trajectory.position_m)
        assert (result.steps, result.ended_by) == (checked.steps, checked.ended_by)
        repeated += result.engine_steps, checked.engine_steps
    assert 0.0 < repeated[0] < 0.03 * repeated[1]


@pytest.mark.thorough
def test_the_engine_repeats_every_step_of_varied_jobs_to_rounding():
    agree(range(20))


@pytest.mark.slow
def test_the_engine_repeats_every_step_of_300_varied_jobs_to_rounding():
    agree(range(20, 320))


@pytest.mark.thorough
def test_looks_that_no_rule_calls_for_are_left_out_without_a_trace(monkeypatch):
    jobs = [job(number) for number in range(320, 340)]
    few = [shake(*entry, trajectory=True) for entry in jobs]
    watch = Shaking._watch
    monkeypatch.setattr(Shaking, "_watch", lambda shaking: watch(shaking)._replace(until_s=-np.inf))
    for entry, result in zip(jobs, few, strict=True):
        looked = shake(*entry, trajectory=True)
        np.testing.assert_array_equal(result.trajectory.position_m, looked.trajectory.position_m)
        rows = [
            dataclasses.asdict(dataclasses.replace(value, trajectory=None, wall_s=0.0))
            for value in (result, looked)
        ]
        assert rows[0] == rows[1]


def checked_shake(monkeypatch, rock_shift_m=0.0, end_shift_m=0.0):
    """A shake whose engine has a rock that is shifted against ours, or takes it to other poses."""
    scene, motion = Scene.block(0.2, 0.25, 0.6), noise(np.random.default_rng(3), G)
    after_steps = bullet.after_steps

    def otherwise(model, start, end, step_s):
        if rock_shift_m:
            model = dataclasses.replace(model, points_body_m=model.points_body_m + rock_shift_m)
        return after_steps(model, start, end + end_shift_m * np.eye(7)[0], step_s)

    monkeypatch.setattr(bullet, "after_steps", otherwise)
    return shake(scene, motion, dataclasses.replace(PRESETS["fast"], checked_steps=1.0))


def test_a_step_that_the_engine_takes_otherwise_is_an_error_of_the_job(monkeypatch):
    assert checked_shake(monkeypatch).engine_steps > 100
    with pytest.raises(StepCheckError) as error:
        checked_shake(monkeypatch, end_shift_m=1e-8)
    assert error.value.allowed == bullet.ALLOWED


def test_a_gap_that_the_engine_finds_otherwise_is_an_error_of_the_job(monkeypatch):
    with pytest.raises(StepCheckError) as error:
        checked_shake(monkeypatch, rock_shift_m=1e-3)
    assert error.value.allowed == bullet.GAP_ALLOWED


def over_ridges():
    """A block over a mesh of two slopes, which has it stand in the groove between them."""
    x = np.array([-2.0, 0.0, 2.0])
    vertices = np.array([(a, b, 0.1 * abs(a)) for a in x for b in x])
    faces = np.array(
        [(k, k + 3, k + 1) for k in (0, 1, 3, 4)] + [(k + 1, k + 3, k + 4) for k in (0, 1, 3, 4)]
    )
    block = Scene.block(0.3, 0.25, 0.8).rock
    return Scene.from_mesh(
        (block.vertices_m + np.array([0.0, 0.0, 0.015 + 1e-6]), block.faces), pedestal=(vertices, faces)
    )


def test_the_engine_repeats_the_steps_on_a_coarse_mesh_and_finds_their_gaps(monkeypatch):
    result = shake(over_ridges(), noise(np.random.default_rng(3), 0.8 * G), "standard")
    assert result.engine_steps > 0.9 * result.steps > 500
    after_steps, body = bullet.after_steps, over_ridges().grounded
    lower = body.ground._replace(vertices_m=body.ground.vertices_m - np.array([0.0, 0.0, 1e-3]))
    moved = dataclasses.replace(body, ground=lower)
    monkeypatch.setattr(bullet, "after_steps", lambda _, *steps: after_steps(moved, *steps))
    with pytest.raises(StepCheckError) as error:
        shake(over_ridges(), noise(np.random.default_rng(3), 0.8 * G), "standard")
    assert error.value.allowed == bullet.GAP_ALLOWED


def test_an_attitude_whose_quaternion_has_a_zero_is_treated_as_any_other():
    prism = cylinder(0.2, 0.6, sides=29)
    scene = Scene.from_mesh((prism.vertices_m, prism.faces), friction=10.0)
    pulse = 4.5 * np.sin(
        np.pi * np.arange(60) / 59.0
    )  # along an edge of its base: w stays 0 but for rounding
    motion = Motion(np.column_stack([pulse, 0.0 * pulse, 0.0 * pulse]), 0.01)
    assert shake(scene, motion, dataclasses.replace(PRESETS["fast"], checked_steps=1.0)).steps > 50


@pytest.mark.parametrize("preset", PRESETS)
def test_rows_count_the_steps_of_the_engine(preset):
    scene = Scene.block(0.2, 0.25, 0.6, friction=5.0)
    result = shake(scene, noise(np.random.default_rng(3), 0.6 * G), preset)
    assert result.steps > 300
    assert (result.engine_steps < 0.05 * result.steps) is (PRESETS[preset].checked_steps < 1.0)
