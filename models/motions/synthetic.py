"""Synthetic records by the stochastic method: windowed noise shaped to published source, path and site.

Boore (2003, Pure Appl. Geophys. 160, 635-676) gives the method, Atkinson and Silva (2000, Bull. Seism. Soc.
Am. 90, 255-274) the two-corner source, effective distance and path for California, Boore and Joyner (1997,
Bull. Seism. Soc. Am. 87, 327-341) the amplification of generic rock, Siddiqqi and Atkinson (2002, Bull.
Seism. Soc. Am. 92, 877-884) the ratio of horizontal to vertical spectra, Mavroeidis and Papageorgiou (2003,
Bull. Seism. Soc. Am. 93, 1099-1131) the near-fault velocity pulse and the way to add it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from toppling.models.motions.measures import STANDARD_G_M_S2
from toppling.models.motions.motion import Motion
from toppling.models.motions.processing import CORNERS_HZ, end_at_rest, high_pass
from toppling.models.motions.record import Record

_TIME_STEP_S = 0.01
_DENSITY_KG_M3 = 2800.0
"""Density at the source (Atkinson and Silva 2000)."""
_SHEAR_VELOCITY_M_S = 3500.0
"""Shear-wave velocity at the source (Atkinson and Silva 2000)."""
_RADIATION = 0.55
"""Mean radiation pattern of shear waves (Boore 2003)."""
_FREE_SURFACE = 2.0
"""Amplification by the free surface."""
_PARTITION = 1 / np.sqrt(2)
_CROSSOVER_KM = 40.0
"""Distance beyond which waves spread as 1 / sqrt(R) instead of 1 / R."""
_QUALITY_AT_1_HZ = 180.0
"""Quality factor Q of the path at 1 Hz."""
_QUALITY_EXPONENT = 0.45
"""Power of the frequency with which Q grows."""
_MEDIAN_KAPPA_S = 0.035
"""Median kappa of Californian rock, s."""
_WINDOW_PEAK_FRACTION = 0.2
"""Fraction of the window's length before its peak."""
_WINDOW_END_FRACTION = 0.05
"""Fraction of the peak that the window has at its end."""
_WINDOW_LENGTH = 2.0
"""Length of the window in durations of the shaking."""
_ROCK_AMPLIFICATION = (
    (0.01, 0.09, 0.16, 0.51, 0.84, 1.25, 2.26, 3.17, 6.05, 16.6, 61.2),
    (1.00, 1.10, 1.18, 1.42, 1.58, 1.74, 2.06, 2.25, 2.58, 3.13, 4.00),
)
"""Frequencies (Hz) and factors of generic rock, 620 m/s over the upper 30 m."""
_PATH_DURATION = (0.0, 7.0, 45.0, 125.0, 175.0), (0.0, 2.4, 8.4, 10.9, 17.4)
"""Distances (km) and what the path adds to the duration (s) in active crust."""
_CALIBRATION = 1.2
"""Factor on the spectra: the path's durations exceed those with which the source was calibrated, and longer
shaking of one spectrum peaks lower. It brings PGA and response spectra to the empirical medians
(`against_targets`)."""
_PULSE_DISTANCE_KM = (5.0, 15.0)
_MEDIAN_PULSE_VELOCITY_M_S = 0.9
"""Median amplitude of its velocity."""


@dataclass(frozen=True)
class Scenario:
    """Earthquake and site of a synthetic record."""

    # Moment magnitude and distance to the rupture.
    magnitude: float
    distance_km: float
    kappa_s: float = _MEDIAN_KAPPA_S  # near-surface attenuation
    # Factors on the median spectrum and on the median duration.
    amplitude: float = 1.0
    duration: float = 1.0
    pulse: bool = False  # whether a near-fault velocity pulse is added


def synthetic_ensemble(
    count: int, seed: int, pulse_share: float = 0.15, advance: Callable[[], None] = lambda: None
) -> list[Record]:
    """Make records of earthquakes of M 6 to 8 at 5 to 100 km, a stated share of them with a near-fault pulse.

    Magnitudes are uniform, distances uniform in their logarithm. kappa, amplitude and duration scatter
    lognormally about the published medians (standard deviations 0.4, 0.5 and 0.35 of the natural logarithm).

    count, seed: the same seed gives the same records; a longer ensemble starts with the shorter one's scenarios.
    pulse_share: share of the records, spread evenly through the ensemble, that have a pulse; these lie within 15 km.
    advance: called once a record.
    Returns records: `S0001` and on, x and y the recorded components.
    """
    records = []
    for index in range(count):
        rng = np.random.default_rng([seed, index])
        pulse = int((index + 1) * pulse_share) > int(index * pulse_share)
        near, far = _PULSE_DISTANCE_KM if pulse else (5.0, 100.0)
        scenario = Scenario(
            magnitude=float(rng.uniform(6.0, 8.0)),
            distance_km=float(np.exp(rng.uniform(np.log(near), np.log(far)))),
            kappa_s=float(_MEDIAN_KAPPA_S * np.exp(0.4 * rng.standard_normal())),
            amplitude=float(np.exp(0.5 * rng.standard_normal())),
            duration=float(np.exp(0.35 * rng.standard_normal())),
            pulse=pulse,
        )
        motion, history = synthetic_motion(scenario, rng)
        advance()
        records.append(
            Record.of(
                f"S{index + 1:04d}",
                motion,
                event=f"synthetic {seed}-{index + 1:04d}",
                station="rock",
                magnitude=round(scenario.magnitude, 2),
                distance_km=round(scenario.distance_km, 1),
                component_azimuths_deg=(0.0, 90.0),
                history=(f"stochastic method (Boore 2003), seed {seed}, number {index + 1}", *history),
            )
        )
    return records


def synthetic_motion(scenario: Scenario, rng: np.random.Generator) -> tuple[Motion, tuple[str, ...]]:
    """Three components of one scenario: independent noise under one window, the vertical's spectrum its own."""
    duration = scenario.duration * _median_duration_s(scenario.magnitude, scenario.distance_km)
    window = _saragoni_hart_window(duration)
    lead = round(2.0 / _TIME_STEP_S)
    samples = lead + len(window) + round(5.0 / _TIME_STEP_S)
    frequency = np.fft.rfftfreq(samples, _TIME_STEP_S).astype(float)
    horizontal = scenario.amplitude * acceleration_spectrum_m_s(frequency, scenario)
    vertical = horizontal / _horizontal_to_vertical(frequency)
    noise = np.zeros((3, samples))
    noise[:, lead : lead + len(window)] = rng.standard_normal((3, len(window))) * window
    shape = np.fft.rfft(noise, axis=1)
    shape /= np.sqrt(np.mean(np.abs(shape) ** 2, axis=1, keepdims=True))
    spectra = shape * np.stack([horizontal, horizontal, vertical]) / _TIME_STEP_S
    history = [f"M {scenario.magnitude:.2f}, R {scenario.distance_km:.1f} km, kappa {scenario.kappa_s:.3f} s"]
    if scenario.pulse:
        history.append(_add_pulse(spectra, samples, scenario, rng))
    motion = Motion(np.fft.irfft(spectra, samples, axis=1).T, _TIME_STEP_S)
    history.append(f"acausal Butterworth high-pass at {CORNERS_HZ[0]:g} Hz, brought to rest")
    return end_at_rest(high_pass(motion, CORNERS_HZ[0])), tuple(history)


def _corner_frequencies_hz(magnitude: float) -> tuple[float, float, float]:
    """Two corner frequencies and the weight of the upper one (Atkinson and Silva 2000)."""
    lower, upper = 10 ** (2.181 - 0.496 * magnitude), 10 ** (2.41 - 0.408 * magnitude)
    return lower, upper, 10 ** (0.605 - 0.255 * magnitude)


def _effective_distance_km(magnitude: float, distance_km: float) -> float:
    """Distance of a point that radiates as the finite fault does (Atkinson and Silva 2000)."""
    return float(np.hypot(distance_km, 10 ** (-0.05 + 0.15 * magnitude)))


def _median_duration_s(magnitude: float, distance_km: float) -> float:
    """Duration of source, half the lower corner's period, and path (Boore and Thompson 2014)."""
    path = np.interp(_effective_distance_km(magnitude, distance_km), *_PATH_DURATION)
    return float(0.5 / _corner_frequencies_hz(magnitude)[0] + path)


def acceleration_spectrum_m_s(frequency_hz: NDArray[np.float64], scenario: Scenario) -> NDArray[np.float64]:
    """Median Fourier amplitude of one horizontal component's acceleration, m/s (Boore 2003)."""
    lower, upper, weight = _corner_frequencies_hz(scenario.magnitude)
    moment_n_m = 10 ** (1.5 * scenario.magnitude + 9.05)
    stiffness = 4 * np.pi * _DENSITY_KG_M3 * _SHEAR_VELOCITY_M_S**3
    constant = _RADIATION * _FREE_SURFACE * _PARTITION / (stiffness * 1000)
    f = frequency_hz
    source = moment_n_m * ((1 - weight) / (1 + (f / lower) ** 2) + weight / (1 + (f / upper) ** 2))
    distance = _effective_distance_km(scenario.magnitude, scenario.distance_km)
    spreading = 1.0 / min(distance, _CROSSOVER_KM) * np.sqrt(min(1.0, _CROSSOVER_KM / distance))
    quality = _QUALITY_AT_1_HZ * np.maximum(f, 1e-9) ** _QUALITY_EXPONENT
    path = spreading * np.exp(-np.pi * f * distance * 1000 / (quality * _SHEAR_VELOCITY_M_S))
    amplification = np.interp(
        np.log(np.maximum(f, 1e-3)), np.log(_ROCK_AMPLIFICATION[0]), _ROCK_AMPLIFICATION[1]
    )
    site = amplification * np.exp(-np.pi * scenario.kappa_s * f)
    return _CALIBRATION * constant * source * path * site * (2 * np.pi * f) ** 2


def _horizontal_to_vertical(frequency_hz: NDArray[np.float64]) -> NDArray[np.float64]:
    """Horizontal over vertical Fourier amplitude on rock (Siddiqqi and Atkinson 2002), held past 0.5-10."""
    return 10 ** (0.0519 + 0.117 * np.log10(np.clip(frequency_hz, 0.5, 10.0)))


def _saragoni_hart_window(duration_s: float) -> NDArray[np.float64]:
    """Exponential window of Saragoni and Hart (1974) as in Boore (2003), twice as long as the duration."""
    peak = _WINDOW_PEAK_FRACTION
    b = -peak * np.log(_WINDOW_END_FRACTION) / (1 + peak * (np.log(peak) - 1))
    share = np.linspace(0.0, 1.0, round(_WINDOW_LENGTH * duration_s / _TIME_STEP_S) + 1)
    return (np.e / peak) ** b * share**b * np.exp(-b / peak * share)


def velocity_pulse_m_s(
    time_s: NDArray[np.float64], velocity_m_s: float, period_s: float, cycles: float, phase_rad: float
) -> NDArray[np.float64]:
    """Near-fault pulse of velocity centred on time 0 (Mavroeidis and Papageorgiou 2003, equation 3).

    v = A/2 [1 + cos(2 pi t / (gamma Tp))] cos(2 pi t / Tp + nu) while abs(t) <= gamma Tp / 2.
    """
    envelope = 0.5 * (1 + np.cos(2 * np.pi * time_s / (cycles * period_s)))
    inside = np.abs(time_s) <= cycles * period_s / 2
    return np.where(inside, velocity_m_s * envelope * np.cos(2 * np.pi * time_s / period_s + phase_rad), 0.0)


def _add_pulse(
    spectra: NDArray[np.complex128], samples: int, scenario: Scenario, rng: np.random.Generator
) -> str:
    """Put a pulse into the first component as Mavroeidis and Papageorgiou do, and say what was put.

    The pulse's Fourier amplitude is taken off the noise's, with the noise's phase, and the pulse is added at
    the time of the noise's largest velocity.
    """
    period = 10 ** (-2.9 + 0.5 * scenario.magnitude) * np.exp(0.3 * rng.standard_normal())
    velocity = _MEDIAN_PULSE_VELOCITY_M_S * np.exp(0.3 * rng.standard_normal())
    cycles, phase = rng.uniform(1.2, 2.5), rng.uniform(0, 2 * np.pi)
    noise = np.fft.irfft(spectra[0], samples)
    speed = np.abs(np.cumsum(noise - noise.mean()))
    time: NDArray[np.float64] = (np.arange(samples, dtype=np.float64) - speed.argmax()) * _TIME_STEP_S
    reach = cycles * period / 2  # kept inside of the record
    time += max(0.0, reach - time[-1]) - max(0.0, reach + time[0])
    pulse = np.gradient(velocity_pulse_m_s(time, velocity, period, cycles, phase), _TIME_STEP_S)
    pulse_spectrum = np.fft.rfft(pulse)
    rest = np.abs(np.abs(spectra[0]) - np.abs(pulse_spectrum))
    spectra[0] = rest * np.exp(1j * np.angle(spectra[0])) + pulse_spectrum
    return f"near-fault pulse along x: {velocity:.2f} m/s, period {period:.2f} s, {cycles:.2f} cycles"


_TARGET_PGV_PGA_S = (0.04, 0.25)
"""5th and 95th percentile of PGV/PGA that an ensemble for toppling should span."""
BOORE_1997: Mapping[str, tuple[float, ...]] = {
    "pga_rotd50_m_s2": (-0.242, 0.527, 0.0, -0.778, -0.371, 1396.0, 5.57),
    "sa_rotd50_0.2s_m_s2": (1.089, 0.711, -0.207, -0.924, -0.292, 2118.0, 7.02),
    "sa_rotd50_1s_m_s2": (-1.080, 1.036, -0.032, -0.798, -0.698, 1406.0, 2.90),
    "sa_rotd50_2s_m_s2": (-1.743, 1.085, -0.085, -0.812, -0.655, 1795.0, 5.85),
}
"""b1, b2, b3, b5, bV, VA, h of Boore, Joyner and Fumal (1997, Seism. Res. Lett. 68, 128-153), any fault."""
_ROCK_VELOCITY_M_S = 620.0
"""Shear-wave velocity of the upper 30 m of generic rock (Boore and Joyner 1997)."""


def median_spectrum_m_s2(measure: str, magnitude: float, distance_km: float) -> float:
    """Median of a measure on generic rock (Boore, Joyner and Fumal 1997; up to M 7.5 and 80 km)."""
    b1, b2, b3, b5, slope, reference, depth = BOORE_1997[measure]
    distance = np.hypot(distance_km, depth)
    shift = magnitude - 6
    ln_g = b1 + b2 * shift + b3 * shift**2 + b5 * np.log(distance)
    return float(STANDARD_G_M_S2 * np.exp(ln_g + slope * np.log(_ROCK_VELOCITY_M_S / reference)))


def median_arias_duration_s(magnitude: float, distance_km: float) -> float:
    """Median 5 to 95 % Arias duration on rock by an empirical equation (Abrahamson and Silva 1996, PEER)."""
    stress_drop = np.exp(5.204 + 0.851 * (magnitude - 6))
    source = (stress_drop / 10 ** (1.5 * magnitude + 16.05)) ** (-1 / 3) / (4.9e6 * 3.2)
    return float(np.exp(0.845) * (source + 0.063 * max(distance_km - 10, 0.0)))


def against_targets(records: Sequence[Record]) -> list[str]:
    """Lines that say what an ensemble of synthetic records is and what it should be by published equations.

    Spectra and durations are compared as the median ratio over the records without a pulse, within the
    equations' range.
    """
    ratio = np.percentile([r.intensity["pgv_pga_s"] for r in records], [5, 95])
    lines = [
        f"{'PGV/PGA, 5th and 95th percentile':<44}{ratio[0]:.3f} and {ratio[1]:.3f} s"
        f"   target {_TARGET_PGV_PGA_S[0]} and {_TARGET_PGV_PGA_S[1]} s"
    ]
    plain = [
        (r.magnitude, r.distance_km, r.intensity)
        for r in records
        if r.magnitude is not None
        and r.magnitude <= 7.5
        and r.distance_km is not None
        and r.distance_km <= 80
        if not any("near-fault pulse" in step for step in r.history)
    ]
    if not plain:
        return lines
    duration = np.median([i["duration_arias_s"] / median_arias_duration_s(m, d) for m, d, i in plain])
    lines.append(f"{'5-95 % duration over Abrahamson-Silva 1996':<44}{duration:.2f}   target 1")
    for name in BOORE_1997:
        share = np.median([i[name] / median_spectrum_m_s2(name, m, d) for m, d, i in plain])
        lines.append(f"{name + ' over Boore et al. 1997':<44}{share:.2f}   target 1")
    return lines
