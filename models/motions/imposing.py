"""A record as a job imposes it: scaled, turned, within a displacement, and with motion above its band."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy

from toppling.models.arrays import Array
from toppling.models.errors import InputError, check_positive
from toppling.models.motions.intensity import displacement_m, measure
from toppling.models.motions.measures import SCALING_POWER
from toppling.models.motions.motion import Motion
from toppling.models.motions.processing import end_at_rest, high_pass, resample
from toppling.models.motions.record import Record

_LIMITING_CORNERS_HZ = np.geomspace(0.01, 5.0, 64)
"""High-pass corners that are tried, lowest first, to hold a peak displacement."""


@dataclass(frozen=True, eq=False)
class Imposed:
    """A motion on the way to the rock and how strong it is."""

    motion: Motion  # scene frame
    intensity: Mapping[str, float]  # units in the names; the columns of the results' group `imposed`


def impose(
    record: Record, pga_m_s2: float, azimuth_deg: float, peak_displacement_m: float | None = None
) -> Imposed:
    """Scale a record to a horizontal vector PGA and turn its strong horizontal component to an azimuth.

    As in the study: all three components are scaled alike, so that the largest horizontal acceleration vector has the
    length `pga_m_s2`, and turned about z, so that the positive axis of the stronger recorded component (by component
    PGA) points to `azimuth_deg`. The azimuth of the vector PGA itself is in the intensity.

    pga_m_s2: largest length of the horizontal acceleration vector.
    azimuth_deg: degrees counter-clockwise from x.
    peak_displacement_m: largest horizontal displacement that a shaking table can follow. A motion beyond it is
    high-passed after scaling (acausal Butterworth, a corner that suffices), which takes some of its PGA too: the
    intensity is that of the motion as imposed.
    Raises InputError if `pga_m_s2` or `peak_displacement_m` is not positive, or no high-pass holds the displacement.
    """
    asked = {"pga_m_s2": pga_m_s2}
    if peak_displacement_m is not None:
        asked["peak_displacement_m"] = peak_displacement_m
    check_positive("impose", "a positive number", "state the level in m/s2 and m", **asked)
    scale = pga_m_s2 / record.intensity["pga_m_s2"]
    motion, intensity = record.motion, record.intensity
    if peak_displacement_m is not None and scale * intensity["pgd_m"] > peak_displacement_m:
        motion, intensity = _within_displacement(record, peak_displacement_m / scale)
    turn_deg = azimuth_deg - record.intensity["strong_azimuth_deg"]
    return Imposed(_scaled_and_turned(motion, scale, turn_deg), _scaled_intensity(intensity, scale, turn_deg))


def _scaled_intensity(intensity: Mapping[str, float], scale: float, turn_deg: float) -> dict[str, float]:
    """Measures of a motion that is scaled and turned, from those of the motion."""
    measures = {name: float(intensity[name] * scale**power) for name, power in SCALING_POWER.items()}
    toward_deg = intensity["ground_accelerates_toward_deg"] + turn_deg
    measures["ground_accelerates_toward_deg"] = toward_deg % 360.0
    return measures


def _scaled_and_turned(motion: Motion, scale: float, turn_deg: float) -> Motion:
    angle = np.deg2rad(turn_deg)
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = scale * np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return Motion(motion.acceleration_m_s2 @ turn.T, motion.time_step_s)


@lru_cache(maxsize=64)
def _within_displacement(record: Record, limit_m: float) -> tuple[Motion, Mapping[str, float]]:
    """High-passed motion of the unscaled record, within `limit_m` of displacement, and its intensity."""
    low, high = -1, len(_LIMITING_CORNERS_HZ) - 1
    held, reached = _held(record.motion, float(_LIMITING_CORNERS_HZ[high]))
    if reached > limit_m:
        corner = _LIMITING_CORNERS_HZ[-1]
        raise InputError(
            "motion.displacement_too_large",
            f"even a high-pass at {corner:g} Hz leaves {reached:.3g} m at the unscaled record",
            where=f"record {record.record_id}",
            expected=f"a displacement that a high-pass can hold within {limit_m:.3g} m (unscaled)",
            remedy="raise peak_displacement_m or lower the PGA levels",
        )
    while high - low > 1:  # a higher corner leaves less displacement
        middle = (low + high) // 2
        motion, peak = _held(record.motion, float(_LIMITING_CORNERS_HZ[middle]))
        if peak <= limit_m:
            held, high = motion, middle
        else:
            low = middle
    strong = record.intensity["strong_azimuth_deg"]
    return held, measure(held, (strong, strong + 90.0))


def _held(motion: Motion, corner_hz: float) -> tuple[Motion, float]:
    """High-passed motion and its peak horizontal displacement, m."""
    filtered = end_at_rest(high_pass(motion, corner_hz))
    ground = displacement_m(filtered)
    return filtered, float(np.hypot(ground[:, 0], ground[:, 1]).max())


_ORDER = 3
"""Order of the band-pass of an octave before its two passes."""
_ENVELOPE_S = 0.5
"""Window over which the octave below the corner is averaged for the envelope of the octave above."""
_SAMPLES_A_PERIOD = 4
"""Least number of samples in a period of the highest frequency that is added."""


def with_motion_above(motion: Motion, corner_hz: float, share: float, random: np.random.Generator) -> Motion:
    """A motion with noise in the octave above its band.

    Each component gets Gaussian noise between `corner_hz` and twice that, in time as strong as the component itself is
    in the octave below.

    motion: Of whose content nothing is known above `corner_hz`.
    share: Root mean square of the noise over that of the component in the octave below.
    Returns Motion: Sampled finely enough for the noise; the given one where `share` is 0.
    Raises InputError if the motion is sampled too coarsely to hold the octave below the corner.
    """
    if share == 0.0:
        return motion
    check_step(motion.time_step_s, corner_hz)
    finer = int(np.ceil(2.0 * corner_hz * _SAMPLES_A_PERIOD * motion.time_step_s - 1e-9))
    fine = resample(motion, motion.time_step_s / max(finer, 1))
    acceleration_m_s2 = fine.acceleration_m_s2
    below = _octave(acceleration_m_s2, 0.5 * corner_hz, fine.time_step_s)
    window = max(round(_ENVELOPE_S / fine.time_step_s), 1)
    power = scipy.ndimage.uniform_filter1d(below**2, window, axis=0)
    strength = np.sqrt(np.maximum(power, 0.0))  # running sums leave zero by their rounding
    noise = _octave(strength * random.normal(size=strength.shape), corner_hz, fine.time_step_s)
    size = np.sqrt((noise**2).mean(axis=0))
    wanted = share * np.sqrt((below**2).mean(axis=0))
    factor = np.divide(wanted, size, out=np.zeros(3), where=size > 0.0)
    return Motion(acceleration_m_s2 + factor * noise, fine.time_step_s)


def check_step(time_step_s: float, corner_hz: float, where: str = "motion above the band") -> None:
    """Raise InputError if a motion is sampled too coarsely to hold the octave below a corner."""
    nyquist_hz = 0.5 / time_step_s
    if corner_hz > nyquist_hz:
        raise InputError(
            "motion.step_too_coarse",
            f"a time step of {time_step_s:g} s holds nothing below {corner_hz:g} Hz",
            where=where,
            expected=f"a corner of at most {nyquist_hz:g} Hz",
            remedy="give a smaller band_hz, or finer records",
        )


def _octave(values: Array, from_hz: float, time_step_s: float) -> Array:
    """Part of a motion between a frequency and its double, without a shift in time."""
    band_hz = [from_hz, 2.0 * from_hz]
    sections = scipy.signal.butter(_ORDER, band_hz, "bandpass", fs=1.0 / time_step_s, output="sos")
    return scipy.signal.sosfiltfilt(sections, values, axis=0, padtype="constant")
