"""What a record's band leaves out: motion in the octave above it, as strong as the octave below lets one expect."""

from __future__ import annotations

import numpy as np
import scipy

from toppling.models.arrays import Array
from toppling.models.errors import InputError
from toppling.models.motions.motion import Motion
from toppling.models.motions.processing import resample

_ORDER = 3
_ENVELOPE_S = 0.5
"""Window over which the octave below the corner is averaged for the envelope of the octave above."""
_HIGHEST_CORNER = 0.5
"""Largest corner, as a fraction of the sampling frequency: the octave below is then still resolved."""
_SAMPLES_A_PERIOD = 4
"""At least, at the highest frequency that is added."""


def with_motion_above(motion: Motion, corner_hz: float, share: float, random: np.random.Generator) -> Motion:
    """A motion with noise in the octave above its band.

    Each component gets Gaussian noise between `corner_hz` and twice that, in time as strong as the component itself is
    in the octave below.

    motion: Of whose content nothing is known above `corner_hz`.
    share: Root mean square of the noise over that of the component in the octave below.
    Returns Motion: Sampled finely enough for the noise; the given one where `share` is 0.
    Raises InputError if the motion is sampled too coarsely to tell of the octave below the corner.
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
    """Raise InputError if a motion is sampled too coarsely to tell of the octave below a corner."""
    if time_step_s * corner_hz > _HIGHEST_CORNER:
        raise InputError(
            "motion.step_too_coarse",
            f"a time step of {time_step_s:g} s tells nothing below {corner_hz:g} Hz",
            where=where,
            expected=f"a corner of at most {_HIGHEST_CORNER / time_step_s:g} Hz",
            remedy="give a smaller band_hz, or finer records",
        )


def _octave(values: Array, from_hz: float, time_step_s: float) -> Array:
    """What lies between a frequency and its double, without a shift in time."""
    sections = scipy.signal.butter(
        _ORDER, [from_hz, 2.0 * from_hz], "bandpass", fs=1.0 / time_step_s, output="sos"
    )
    return scipy.signal.sosfiltfilt(sections, values, axis=0, padtype="constant")
