"""Statics of rocks with contacts at several heights or along several normals, against slow ramps."""

import numpy as np
import pytest
from engine_cases import along
from scipy.spatial.transform import Rotation
from test_ground import legged, strips

from toppling.models.scene import Scene
from toppling.workers.shaking import shake

G = 9.81


def ramp(scene, azimuth_deg, low_m_s2, high_m_s2, duration_s=26.0, preset="fast"):
    """Accelerations at which a rock first moves, and at which it topples, under one that grows slowly between two."""
    time_s = np.arange(0.0, 30.0 + duration_s, 0.01)
    level = np.interp(time_s, [0.0, 30.0, 30.0 + duration_s], [0.0, low_m_s2, high_m_s2])
    shaken = shake(scene, along(azimuth_deg, level, 0.01), preset, trajectory=True)
    moved = np.abs(shaken.trajectory.position_m - shaken.trajectory.position_m[0]).max(axis=1)
    moved_s = shaken.trajectory.time_s[(moved > 1e-4 * scene.rock.half_diagonal_m).argmax()]
    return tuple(np.interp([moved_s, shaken.topple_time_s if shaken.toppled else np.nan], time_s, level))


def on_a_step(seed):
    """A block on four feet over a step, or over a ledge whose levels slope; often one foot is 2 cm short."""
    random, reach_m = np.random.default_rng(seed), 6.0
    edge_m, step_m = random.uniform(-0.1, 0.1), random.uniform(0.05, 0.3)
    low, high = np.tan(np.radians(random.uniform(-15.0, 15.0, 2))) * (seed % 2)
    ground = strips(
        [
            (-reach_m, low * (-reach_m - edge_m)), (edge_m, 0.0),
            (edge_m, step_m), (reach_m, step_m + high * (reach_m - edge_m)),
        ]
    )  # fmt: skip
    vertices, faces = legged(0.2, random.uniform(0.4, 0.7), 0.16)
    feet = np.isclose(vertices[:, 2], 0.0)
    vertices = Rotation.from_euler("z", random.uniform(0.0, 90.0), degrees=True).apply(vertices)
    over = vertices[:, 0] - edge_m
    vertices[:, 2] += np.where(feet, np.where(over < 0.0, low * over, step_m + high * over), step_m + 0.03)
    if random.uniform() < 0.5:
        vertices[np.flatnonzero(feet)[random.integers(4)], 2] += 0.02
    friction = float(random.choice([0.6, 0.7, 0.8]))
    return Scene.from_mesh((vertices, faces), pedestal=ground, friction=friction), random.uniform(0.0, 360.0)


@pytest.mark.parametrize(
    "seed", [0, 1, 2, *(pytest.param(seed, marks=pytest.mark.thorough) for seed in range(3, 16))]
)
def test_contacts_on_two_levels_hold_up_to_the_slow_ramp(seed):
    """What falls takes a second or two for it, in which the ramp grows by half a per cent."""
    scene, azimuth_deg = on_a_step(seed)
    ((_, tips, slides),) = scene.statics([azimuth_deg])
    if tips == 0.0:
        return
    least = min(tips, slides)
    moves, topples = ramp(scene, azimuth_deg, 0.95 * least, 1.06 * least)
    if slides < tips:
        assert slides == pytest.approx(moves, rel=0.005)
    else:
        assert tips == pytest.approx(topples / 1.008, rel=0.015)
