"""What a record's band leaves out is drawn above it, and nothing else of the motion changes."""

import numpy as np
import pytest
from refusals import refused
from scipy.signal import butter, sosfiltfilt

from toppling.models.motions.intensity import velocity_m_s
from toppling.models.motions.motion import Motion
from toppling.models.motions.record import with_motion_above

CORNER_HZ = 25.0


def banded(step_s: float = 0.0025) -> Motion:
    """Twenty seconds of noise below 25 Hz, along x and z, silent in its first half and at its end."""
    count = round(20.0 / step_s)
    noise = np.random.default_rng(5).normal(size=(count, 3)) * [1.0, 0.0, 0.5]
    noise[: count // 2] = noise[-count // 10 :] = 0.0
    sections = butter(6, min(0.8 * CORNER_HZ, 0.4 / step_s), fs=1.0 / step_s, output="sos")
    return Motion(sosfiltfilt(sections, noise, axis=0), step_s)


def above(motion: Motion, share: float, seed: int = 1) -> Motion:
    return with_motion_above(motion, CORNER_HZ, share, np.random.default_rng(seed))


def rms_between(motion: Motion, low_hz: float, high_hz: float) -> np.ndarray:
    spectrum = np.abs(np.fft.rfft(motion.acceleration_m_s2, axis=0)) ** 2
    frequency_hz = np.fft.rfftfreq(len(motion.acceleration_m_s2), motion.time_step_s)
    inside = (frequency_hz >= low_hz) & (frequency_hz < high_hz)
    return np.sqrt(2.0 * spectrum[inside].sum(axis=0)) / len(motion.acceleration_m_s2)


@pytest.mark.parametrize("share", [0.2, 0.6])
def test_the_octave_above_is_as_strong_as_asked_and_the_ones_below_stay(share):
    motion = banded()
    drawn = above(motion, share)
    below = rms_between(motion, 0.5 * CORNER_HZ, CORNER_HZ)
    # Butterworth's flanks: a few per cent lie outside of the octave.
    assert rms_between(drawn, CORNER_HZ, 2 * CORNER_HZ)[[0, 2]] == pytest.approx(
        share * below[[0, 2]], rel=0.1
    )
    kept = rms_between(drawn, 0.0, 0.6 * CORNER_HZ)
    assert kept == pytest.approx(rms_between(motion, 0.0, 0.6 * CORNER_HZ), rel=0.01)


def test_a_component_or_time_without_motion_gets_none():
    drawn = above(banded(), 0.6).acceleration_m_s2
    assert np.array_equal(drawn[:, 1], np.zeros(len(drawn)))
    early = len(drawn) // 2 - round(2.0 / 0.0025)
    assert np.abs(drawn[:early]).max() < 1e-3 * np.abs(drawn).max()


def test_what_is_added_carries_the_ground_nowhere():
    motion = banded()
    drawn = above(motion, 0.6)
    added_m_s = velocity_m_s(drawn)[-1] - velocity_m_s(motion)[-1]
    assert np.abs(added_m_s).max() < 1e-3 * np.abs(velocity_m_s(motion)).max()


def test_one_seed_draws_one_motion_and_another_seed_another():
    motion = banded()
    assert np.array_equal(above(motion, 0.5).acceleration_m_s2, above(motion, 0.5).acceleration_m_s2)
    assert not np.array_equal(above(motion, 0.5).acceleration_m_s2, above(motion, 0.5, 2).acceleration_m_s2)
    assert above(motion, 0.0) is motion


def test_a_coarse_record_is_sampled_finely_enough_for_what_is_added():
    drawn = above(banded(step_s=0.01), 0.5)
    assert drawn.time_step_s * 2 * CORNER_HZ <= 0.25
    assert drawn.duration_s == pytest.approx(banded(step_s=0.01).duration_s, abs=0.01)


def test_a_record_that_tells_nothing_below_the_corner_is_refused():
    with refused("motion.step_too_coarse", "25 Hz"):
        above(Motion(np.zeros((100, 3)), 0.05), 0.5)
