"""A rock that rolls on a rounded base: periods, energy, and when it topples, against closed forms."""

import math

import numpy as np
import pytest
from engine_cases import periods_s, topples_at_m_s2
from reference.bodies import revolved, round_cap

from toppling import Motion, Scene, shake

G = 9.81
STILL = Motion(np.zeros((2400, 3)), 0.005)


def tilted(scene, radius_m, tilt_deg, way_deg):
    """The start of a rock that stands tilted on a spherical base, its top toward an azimuth."""
    tilt, azimuth_rad = math.radians(tilt_deg), math.radians(way_deg)
    toward = np.array([math.cos(azimuth_rad), math.sin(azimuth_rad), 0.0])
    up = math.cos(tilt) * np.array([0.0, 0.0, 1.0]) + math.sin(tilt) * toward
    axis = np.array([-toward[1], toward[0], 0.0])
    height = radius_m - scene.rock.com_m[2]
    place = scene.rock.com_m * (1.0, 1.0, 0.0) + np.array([0.0, 0.0, radius_m]) - height * up
    return {"position_m": place, "quaternion_xyzw": [*(math.sin(0.5 * tilt) * axis), math.cos(0.5 * tilt)]}


def swings_deg(trajectory, way_deg):
    """Tilt toward an azimuth, with its sign."""
    path, q = math.radians(way_deg), np.asarray(trajectory.quaternion_xyzw)
    x, y, z, w = q.T
    up = 2.0 * np.column_stack([x * z + y * w, y * z - x * w])
    return np.degrees(np.arcsin(up @ [math.cos(path), math.sin(path)]))


@pytest.mark.parametrize("edge_m", [0.08, 0.04, 0.02])
@pytest.mark.parametrize("way_deg", [0.0, 25.0])
def test_a_cap_rocks_with_the_period_of_a_rolling_sphere_and_loses_no_energy(edge_m, way_deg):
    """T = 2 pi sqrt((I + (rho - d)^2) / (g d)) for small swings, I per mass, d from the centre of mass to the sphere's
    centre; at 2 degrees the swing's size changes it by less than .1 %."""
    scene = Scene.from_mesh(round_cap(edge_m), friction=0.8)
    d = 0.65 - scene.rock.com_m[2]
    exact_s = 2.0 * math.pi * math.sqrt((scene.rock.inertia_per_mass_m2[0, 0] + (0.65 - d) ** 2) / (G * d))
    start = tilted(scene, 0.65, 2.0, way_deg)
    found = shake(scene, STILL, "fast", initial=start, trajectory=True, shortcuts=False)
    time_s, swing = found.trajectory.time_s, swings_deg(found.trajectory, way_deg)
    assert periods_s(time_s, swing)[:3] == pytest.approx(exact_s, rel=0.005)
    last = swing[time_s > time_s[-1] - exact_s]
    assert np.abs(last).max() == pytest.approx(2.0, rel=0.01)


@pytest.mark.parametrize(
    "base", [{"edge_m": 0.04}, {"edge_m": 0.08, "radius_m": 0.4, "half_width_m": 0.25, "height_m": 0.5}]
)
def test_a_slowly_growing_acceleration_topples_a_cap_at_the_static_limit(base):
    scene = Scene.from_mesh(round_cap(**base), friction=0.8)
    ((_, threshold),) = scene.quasi_static_toppling_m_s2([0.0])
    knots_s, levels_m_s2 = [0.0, 20.0, 60.0], threshold * np.array([0.0, 0.95, 1.05])
    assert topples_at_m_s2(scene, 0.0, knots_s, levels_m_s2) == pytest.approx(threshold, rel=0.02)
    assert topples_at_m_s2(scene, 0.0, knots_s, 0.95 / 1.05 * levels_m_s2) is None


@pytest.mark.thorough
def test_a_flat_base_with_a_rounded_border_stands_still_and_rocks_over_its_border():
    angles = np.radians([0, 15, 30, 45, 60])
    border = [(0.3 + 0.05 * math.sin(t), 0.05 - 0.05 * math.cos(t)) for t in angles]
    scene = Scene.from_mesh(revolved([*border, (0.36, 1.4)], 48), friction=0.8)
    assert scene.rounded_base is not None
    least = min(a for _, a in scene.quasi_static_toppling_m_s2([0.0, 90.0]))
    time_s = np.arange(0.0, 6.0, 0.005)
    pulse = np.where(time_s < 0.6, np.sin(2.0 * np.pi * time_s / 0.6), 0.0)
    for share, outcomes in ((0.9, {"stands"}), (1.4, {"stands", "moved"}), (8.0, {"toppled"})):
        motion = Motion(np.column_stack([share * least * pulse, 0.0 * pulse, 0.0 * pulse]), 0.005)
        shaken = shake(scene, motion, "fast")
        assert shaken.outcome in outcomes, share
        assert (shaken.max_tilt_deg > 0.01) == (share > 1.0)
