"""Intensity measures against closed forms, and against eqsig."""

import eqsig
import eqsig.im
import numpy as np
import pytest
from reference.idealised import full_sine

from toppling.models.motions.intensity import (
    arias_m_s,
    directionality,
    measure,
    oscillator_response_m_s2,
    rotated_peaks,
    significant_duration_s,
    spectral_acceleration_m_s2,
)
from toppling.models.motions.motion import Motion
from toppling.models.motions.synthetic import synthetic_ensemble

STEP_S = 0.005


def test_energy_duration_of_a_single_pulse_of_velocity():
    # v = V (1 - cos(2 pi t / T)); share of its square: x - 2 sin(2 pi x) / 3 pi + sin(4 pi x) / 12 pi
    period = 2.0
    x = np.linspace(0, 1, 20001)
    share = x - 2 * np.sin(2 * np.pi * x) / (3 * np.pi) + np.sin(4 * np.pi * x) / (12 * np.pi)
    exact = period * (np.interp(0.95, share, x) - np.interp(0.05, share, x))
    assert measure(full_sine(1.0, period))["duration_energy_s"] == pytest.approx(exact, rel=1e-4)


def test_a_stiff_oscillator_follows_the_ground_and_a_soft_oscillator_stays_behind():
    motion = synthetic_ensemble(1, 2)[0].motion
    spectrum = spectral_acceleration_m_s2(motion, (0.001, 1000.0))
    measures = measure(motion)
    assert spectrum["rotd100"][0] == pytest.approx(measures["pga_m_s2"], rel=1e-3)
    assert spectrum["rotd100"][1] / (2 * np.pi / 1000) ** 2 == pytest.approx(measures["pgd_m"], rel=0.02)


def test_the_spectrum_of_a_short_period_is_that_of_the_ground_between_the_samples():
    coarse = Motion(np.random.default_rng(5).normal(size=(300, 3)), 0.02)  # noise, with all that it can hold
    period_s = 3.3 * coarse.time_step_s
    time = np.linspace(0.0, coarse.duration_s, 64 * (len(coarse.acceleration_m_s2) - 1) + 1)
    ground = np.column_stack([np.interp(time, coarse.time_s, axis) for axis in coarse.acceleration_m_s2.T])
    response = oscillator_response_m_s2(ground[:, :2], coarse.time_step_s / 64, period_s)
    out = spectral_acceleration_m_s2(coarse, [period_s])
    assert out["rotd100"][0] == pytest.approx(np.hypot(*response.T).max(), rel=3e-3)
    assert out["x"][0] == pytest.approx(np.abs(response[:, 0]).max(), rel=3e-3)


def test_rotd_of_collinear_motion_is_the_cosine():
    pga, azimuth = 3.0, np.deg2rad(20)
    waves = pga * np.sin(2 * np.pi * np.arange(20_001) * STEP_S / 0.5)
    horizontal = np.outer(waves, [np.cos(azimuth), np.sin(azimuth)])
    peaks = rotated_peaks(horizontal)
    assert peaks == pytest.approx(
        np.abs(pga * np.cos(np.deg2rad(np.arange(180)) - azimuth)), rel=1e-9, abs=1e-9
    )
    assert np.median(peaks) == pytest.approx(pga / np.sqrt(2), rel=0.01)  # whole degrees


def test_rotd_by_the_hull_is_rotd_by_every_sample():
    horizontal = np.random.default_rng(3).normal(size=(3000, 2))
    angle = np.deg2rad(np.arange(180))
    every = np.abs(horizontal @ np.stack([np.cos(angle), np.sin(angle)])).max(axis=0)
    assert rotated_peaks(horizontal) == pytest.approx(every, rel=1e-12)


@pytest.mark.parametrize(("apart_deg", "share"), [(22.0, 0.0), (23.0, 0.9), (180.0, 0.9)])
def test_directionality_counts_only_distinct_directions(apart_deg, share):
    angle = np.deg2rad(apart_deg)
    horizontal = np.array([[2.0, 0.0], [1.8 * np.cos(angle), 1.8 * np.sin(angle)], [0.0, 0.0]])
    assert directionality(horizontal) == pytest.approx(share)


def test_turning_a_motion_turns_the_azimuth_of_its_peak_and_no_vector_measure():
    motion = synthetic_ensemble(1, 4)[0].motion
    turn = np.deg2rad(50)
    matrix = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    before = measure(motion, (0.0, 90.0))
    after = measure(Motion(motion.acceleration_m_s2 @ matrix.T, motion.time_step_s), (50.0, 140.0))
    for name, value in before.items():
        if name.endswith(("azimuth_deg", "toward_deg")):
            assert (after[name] - value) % 360 == pytest.approx(50.0)
        elif "rotd" not in name:
            assert after[name] == pytest.approx(value, rel=1e-9), name
        else:  # whole degrees from another start: cos(0.5 deg)
            assert after[name] == pytest.approx(value, rel=1e-3), name


@pytest.mark.parametrize(("step_s", "first_m_s2", "seed"), [(0.005, 0.0, 1), (0.01, 0.2, 2)])
def test_measures_agree_with_eqsig_on_noise_that_may_begin_amidst_the_shaking(step_s, first_m_s2, seed):
    """An agency's record may begin late; two integrations make the noise's velocity and displacement."""
    rng, time = np.random.default_rng(seed), np.arange(6000) * step_s
    tones = rng.uniform(0.3, 12.0, 60)
    waves = np.sin(2 * np.pi * tones[:, None] * time + rng.uniform(0, 2 * np.pi, (60, 1))).sum(axis=0)
    envelope = (time / time[1500]) ** 2 * np.exp(2 - 2 * time / time[1500])
    acceleration = 0.3 * envelope * waves
    acceleration += first_m_s2 * np.exp(-((time / 2.0) ** 2)) * np.cos(2 * np.pi * time)
    signal = eqsig.AccSignal(acceleration, step_s)
    periods = np.array([0.1, 0.3, 1.0, 2.0])
    ours = np.array([np.abs(oscillator_response_m_s2(acceleration, step_s, p)).max() for p in periods])
    theirs = eqsig.sdof.pseudo_response_spectra(acceleration, step_s, periods, 0.05)[2]
    # eqsig writes 2 pi with eight digits, and begins at rest: half a step of the first sample is an impulse
    impulse_m_s = 0.5 * abs(acceleration[0]) * step_s
    assert (np.abs(ours - theirs) <= 1e-6 * theirs + 2 * np.pi / periods * impulse_m_s).all()
    assert arias_m_s(acceleration, step_s) == pytest.approx(
        eqsig.im.calc_arias_intensity(signal)[-1], rel=2e-3
    )  # its g is 9.81
    motion = Motion(np.column_stack([acceleration, 0 * acceleration, 0 * acceleration]), step_s)
    measures = measure(motion)
    assert measures["cav_m_s"] == pytest.approx(eqsig.im.calc_cav(signal)[-1], rel=2e-3)
    assert measures["pgv_m_s"] == pytest.approx(np.abs(signal.velocity).max(), rel=1e-3)
    start, end = eqsig.im.calc_sig_dur_vals(acceleration, step_s, se=True)
    assert significant_duration_s(acceleration**2, step_s) == pytest.approx(end - start, abs=2 * step_s)
