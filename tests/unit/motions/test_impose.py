"""What a job imposes is what the study says: level, direction, intensity, and what is drawn above a record's band."""

import numpy as np
import pytest
from refusals import refused
from scipy.signal import butter, sosfiltfilt

from toppling.models.motions.imposing import impose, with_motion_above
from toppling.models.motions.intensity import displacement_m, measure, velocity_m_s
from toppling.models.motions.measures import SCALING_POWER
from toppling.models.motions.motion import Motion
from toppling.models.motions.record import Record
from toppling.models.motions.synthetic import synthetic_ensemble


@pytest.fixture(scope="module")
def record():
    return synthetic_ensemble(1, seed=7)[0]


@pytest.mark.parametrize("azimuth_deg", [0.0, 45.0, 135.0, 292.5])
def test_the_largest_horizontal_vector_has_the_level(record, azimuth_deg):
    horizontal = impose(record, 4.0, azimuth_deg).motion.acceleration_m_s2[:, :2]
    assert np.hypot(*horizontal.T).max() == pytest.approx(4.0, rel=1e-12)


def test_the_stronger_recorded_component_points_to_the_azimuth():
    time_s = np.arange(400) * 0.01
    strong, weak = 3 * np.sin(7 * time_s), 1 * np.sin(11 * time_s + 1)
    # recorded along 30 and 120 degrees, the strong one along 120
    along_30, along_120 = np.deg2rad([30, 120])
    x = weak * np.cos(along_30) + strong * np.cos(along_120)
    y = weak * np.sin(along_30) + strong * np.sin(along_120)
    record = Record.of(
        "a", Motion(np.column_stack([x, y, 0 * x]), 0.01), component_azimuths_deg=(30.0, 120.0)
    )
    imposed = impose(record, record.intensity["pga_m_s2"], 270.0).motion.acceleration_m_s2
    assert np.allclose(imposed[:, 1], -strong, atol=1e-12)
    # what was 90 degrees clockwise of the strong component stays so
    assert np.allclose(imposed[:, 0], -weak, atol=1e-12)


def test_intensity_scales_and_turns_as_if_it_were_measured_anew(record):
    imposed = impose(record, 3.0, 200.0)
    anew = measure(imposed.motion, (200.0, 290.0))
    assert set(imposed.intensity) == {*SCALING_POWER, "ground_accelerates_toward_deg"}
    for name, value in imposed.intensity.items():
        assert value == pytest.approx(anew[name], rel=1e-9), name


def test_displacement_limit_holds_and_intensity_is_that_of_the_filtered_motion(record):
    free = impose(record, 15.0, 0.0)
    held = impose(record, 15.0, 0.0, peak_displacement_m=0.05)
    assert free.intensity["pgd_m"] > 0.05
    ground = displacement_m(held.motion)
    assert np.hypot(ground[:, 0], ground[:, 1]).max() <= 0.05 * (1 + 1e-9)
    anew = measure(held.motion, (0.0, 90.0))
    for name, value in held.intensity.items():
        assert value == pytest.approx(anew[name], rel=1e-6), name


@pytest.mark.parametrize("level", [0.0, -1.0, np.nan])
def test_a_level_that_is_not_positive_is_refused(record, level):
    with refused("value.not_positive", "pga_m_s2"):
        impose(record, level, 0.0)


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
def test_the_octave_above_is_as_strong_as_asked_and_lower_octaves_are_unchanged(share):
    motion = banded()
    drawn = above(motion, share)
    below = rms_between(motion, 0.5 * CORNER_HZ, CORNER_HZ)
    # Butterworth's flanks: a few per cent lie outside of the octave.
    assert rms_between(drawn, CORNER_HZ, 2 * CORNER_HZ)[[0, 2]] == pytest.approx(
        share * below[[0, 2]], rel=0.1
    )
    remaining = rms_between(drawn, 0.0, 0.6 * CORNER_HZ)
    assert remaining == pytest.approx(rms_between(motion, 0.0, 0.6 * CORNER_HZ), rel=0.01)


def test_a_component_or_time_without_motion_gets_none():
    drawn = above(banded(), 0.6).acceleration_m_s2
    assert np.array_equal(drawn[:, 1], np.zeros(len(drawn)))
    early = len(drawn) // 2 - round(2.0 / 0.0025)
    assert np.abs(drawn[:early]).max() < 1e-3 * np.abs(drawn).max()


def test_the_added_motion_leaves_no_displacement():
    motion = banded()
    drawn = above(motion, 0.6)
    added_m_s = velocity_m_s(drawn)[-1] - velocity_m_s(motion)[-1]
    assert np.abs(added_m_s).max() < 1e-3 * np.abs(velocity_m_s(motion)).max()


def test_equal_seeds_draw_equal_motions_and_different_seeds_different_motions():
    motion = banded()
    assert np.array_equal(above(motion, 0.5).acceleration_m_s2, above(motion, 0.5).acceleration_m_s2)
    assert not np.array_equal(above(motion, 0.5).acceleration_m_s2, above(motion, 0.5, 2).acceleration_m_s2)
    assert above(motion, 0.0) is motion


def test_a_coarse_record_is_sampled_finely_enough_for_what_is_added():
    drawn = above(banded(step_s=0.01), 0.5)
    assert drawn.time_step_s * 2 * CORNER_HZ <= 0.25
    assert drawn.duration_s == pytest.approx(banded(step_s=0.01).duration_s, abs=0.01)


def test_a_record_without_signal_below_the_corner_is_refused():
    with refused("motion.step_too_coarse", "25 Hz"):
        above(Motion(np.zeros((100, 3)), 0.05), 0.5)
