"""Pulses have the peaks that their formulae say."""

import numpy as np
import pytest
from reference import idealised

from toppling.models.motions.intensity import displacement_m, measure, velocity_m_s


def test_full_sine_leaves_the_ground_at_rest_and_displaced():
    motion = idealised.full_sine(3.0, 0.8, azimuth_deg=90.0)
    velocity, displacement = velocity_m_s(motion), displacement_m(motion)
    assert velocity[:, 1].max() == pytest.approx(
        3.0 * 0.8 / np.pi, rel=2e-4
    )  # chords of a sine: (2 pi h / T)^2 / 12
    assert velocity[-1] == pytest.approx([0, 0, 0], abs=1e-12)
    assert displacement[-1, 1] == pytest.approx(3.0 * 0.8**2 / (2 * np.pi), rel=1e-3)
    assert np.abs(motion.acceleration_m_s2[:, 0]).max() < 1e-12


def test_full_cosine_has_half_the_velocity_of_the_sine():
    measures = measure(idealised.full_cosine(3.0, 0.8))
    assert measures["pgv_m_s"] == pytest.approx(3.0 * 0.8 / (2 * np.pi), rel=1e-3)
    assert measures["pga_m_s2"] == 3.0


def test_the_studys_sawtooth_reaches_5_m_s_in_3_5_s_and_comes_to_rest():
    motion = idealised.sawtooth_velocity()
    velocity = velocity_m_s(motion)[:, 0]
    assert motion.duration_s == pytest.approx(3.5)
    assert velocity.max() == pytest.approx(5.0, rel=1e-9)
    assert velocity.min() == pytest.approx(-5.0, rel=1e-9)
    assert velocity[-1] == pytest.approx(0.0, abs=1e-9)
    assert measure(motion)["pga_m_s2"] == pytest.approx(4 * 5.0 / 3.5, rel=5e-3)  # corners rounded: 2 h / T


def test_ricker_carries_neither_momentum_nor_displacement():
    motion = idealised.ricker(4.0, 0.5)
    assert motion.acceleration_m_s2[:, 0].max() == pytest.approx(4.0)
    assert velocity_m_s(motion)[-1, 0] == pytest.approx(0.0, abs=1e-6)
    assert displacement_m(motion)[-1, 0] == pytest.approx(0.0, abs=1e-5)
