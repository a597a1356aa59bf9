"""A rock on a rim of many points that nearly all touch: shaking below its toppling acceleration does not throw it."""

import numpy as np
import pytest
import trimesh

from toppling import Motion, Scene, shake

DURATION_S, SAMPLE_S = 12.0, 0.01


def drum(seed: int) -> Scene:
    """A drum 3 m high on an oval rim of 1 m, whose 60 points lie within a few tenths of a millimetre of one plane."""
    random = np.random.default_rng(seed)
    angle = np.sort(random.uniform(0.0, 2.0 * np.pi, 60))
    radius_m = 1.0 + 0.15 * np.cos(2.0 * angle) + 0.05 * random.normal(size=60)
    height_m = 0.002 * (radius_m - 1.0) ** 2 + 1e-4 * random.normal(size=60)
    rim_m = np.column_stack([radius_m * np.cos(angle), radius_m * np.sin(angle), height_m])
    hull = trimesh.convex.convex_hull(np.vstack([rim_m, rim_m * [0.9, 0.9, 0.0] + [0.0, 0.0, 3.0]]))
    return Scene.from_mesh((hull.vertices, hull.faces), 1.0)


def strong_motion(seed: int, pga_m_s2: float) -> Motion:
    """Horizontal shaking of 0.3 to 6 Hz that swells and fades."""
    random = np.random.default_rng(seed)
    time_s = np.arange(0.0, DURATION_S, SAMPLE_S)
    acceleration = np.zeros((len(time_s), 3))
    for frequency_hz in random.uniform(0.3, 6.0, 25):
        for axis in range(2):
            wave = np.sin(2.0 * np.pi * (frequency_hz * time_s + random.uniform()))
            acceleration[:, axis] += random.normal() * wave
    acceleration *= (np.minimum(time_s, DURATION_S - time_s) / 3.0).clip(0.0, 1.0)[:, None]
    return Motion(acceleration * (pga_m_s2 / np.linalg.norm(acceleration, axis=1).max()), SAMPLE_S)


@pytest.mark.parametrize("preset", ["fast", "standard"])
@pytest.mark.parametrize(("seed", "pga_m_s2"), [(22, 4.0), (15, 5.5), (16, 5.5), (33, 5.5)])
def test_no_landing_throws_a_rock_that_the_ground_cannot_topple(seed, pga_m_s2, preset):
    # It rocks on its rim's unevenness: some tenths of a millimetre over 2 m are a few hundredths of a degree.
    result = shake(drum(seed), strong_motion(100 + seed, pga_m_s2), preset)
    assert result.status == "ok"
    assert result.max_tilt_deg < 0.1
