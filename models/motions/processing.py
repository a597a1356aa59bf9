"""Making an uncorrected record sound: demean, taper, high-pass, end at rest. Every step says what it did."""

from fractions import Fraction

import numpy as np
import scipy  # loads its signal processing where it is used: 38 MB that few workers need
from numpy.typing import NDArray

from toppling.models.errors import InputError
from toppling.models.motions.intensity import displacement_m, velocity_m_s
from toppling.models.motions.motion import Motion

_TAPER_FRACTION = 0.05
"""Fraction of the record that the cosine taper takes at each end."""
_HIGH_PASS_ORDER = 4
"""Order of the Butterworth filter after its two passes."""
_LOWEST_CORNER_HZ = 0.001
"""Lowest corner of a filter, Hz: a lower one would need hours of zeros around the record."""
CORNERS_HZ = (0.05, 0.07, 0.1, 0.14, 0.2)
"""Corners that the displacement check tries, lowest first: beyond the last, shaking of M 7 itself is lost."""
_QUIET_FRACTION = 0.1
"""Fraction of the record, at its end, in which the displacement is compared with its peak."""
_DRIFT_FRACTION = 0.25
"""Fraction of its peak within which a sound displacement stays there after the filter."""


DRIFTS = "highest tried; the displacement still drifts at the end"
"""How the history says that no corner passed the displacement check."""

_RETURNED_FRACTION = 0.5
"""Fraction of its peak below which the displacement at the end of an unfiltered record is sound.

Of 110 records that agencies corrected 99 do; of 30 uncorrected ones each reaches .99.
"""
_LEVEL_FRACTION = 0.05
"""Fraction of its peak by which a permanent displacement may still vary at the end."""
_PEAK_VELOCITY_S = 5.0
"""Largest plausible ratio of peak displacement to peak velocity, s; a drift that ends level by chance exceeds it."""


def high_pass(motion: Motion, corner_hz: float) -> Motion:
    """Acausal Butterworth high-pass: no phase shift, half the power at the corner for each of its two passes.

    Zeros are put before and after while it runs (1.5 order / corner seconds in all, Converse and Brady 1992),
    so that the filter's transients do not fold into the record.

    Raises InputError if the corner is not between zero and half the sampling rate.
    """
    nyquist_hz = 0.5 / motion.time_step_s
    if not _LOWEST_CORNER_HZ <= corner_hz < nyquist_hz:
        raise InputError(
            "motion.corner_out_of_range",
            f"a high-pass corner of {corner_hz:g} Hz",
            where="high-pass",
            expected=f"{_LOWEST_CORNER_HZ:g} Hz to below {nyquist_hz:g} Hz, half of the record's sampling rate",
            remedy="correct --corner, or corner_hz in the metadata table; 0.05 to 0.2 Hz is usual",
        )
    filtered, pad = _filtered(motion, corner_hz)
    return Motion(filtered[pad : pad + len(motion.acceleration_m_s2)], motion.time_step_s)


def _filtered(motion: Motion, corner_hz: float) -> tuple[NDArray[np.float64], int]:
    """Filter with zeros before and after; return the samples with them, and how many there are on a side."""
    order, rate_hz = _HIGH_PASS_ORDER, 1 / motion.time_step_s
    sections = scipy.signal.butter(order // 2, corner_hz, btype="highpass", fs=rate_hz, output="sos")
    pad = int(np.ceil(0.75 * order / corner_hz * rate_hz))
    padded = np.pad(motion.acceleration_m_s2, ((pad, pad), (0, 0)))
    return scipy.signal.sosfiltfilt(sections, padded, axis=0, padtype=None), pad


def taper(motion: Motion) -> Motion:
    """Cosine taper over a share of the record at each end."""
    window = scipy.signal.windows.tukey(len(motion.acceleration_m_s2), 2 * _TAPER_FRACTION)
    return Motion(motion.acceleration_m_s2 * window[:, None], motion.time_step_s)


def end_at_rest(motion: Motion) -> Motion:
    """Take a cubic off the displacement, so that the ground ends at rest where it began.

    The cubic begins with no displacement and no velocity and ends with the record's; its acceleration is a
    straight line, small against any shaking because the record is long.
    """
    a, step = motion.acceleration_m_s2, motion.time_step_s
    length = motion.duration_s
    velocity, displacement = velocity_m_s(motion)[-1], displacement_m(motion)[-1]
    start = (6 * displacement - 2 * velocity * length) / length**2
    slope = (6 * velocity * length - 12 * displacement) / length**3
    return Motion(a - start - slope * motion.time_s[:, None], step)


def resample(motion: Motion, time_step_s: float) -> Motion:
    """Motion at another time step, low-passed below the lower of the two Nyquist frequencies (no aliasing).

    Raises InputError if the ratio of the steps is not a ratio of whole numbers up to 1000.
    """
    ratio = Fraction(motion.time_step_s / time_step_s).limit_denominator(1000)
    if not 0 < ratio <= 1000 or abs(float(ratio) * time_step_s / motion.time_step_s - 1) > 1e-6:
        raise InputError(
            "motion.not_resampled",
            f"a time step of {motion.time_step_s:g} s cannot be resampled to {time_step_s:g} s",
            where="resample",
            expected="time steps whose ratio is a ratio of small whole numbers",
            remedy="choose a step such as 0.005 or 0.01 s",
        )
    if ratio == 1:
        return motion
    values = scipy.signal.resample_poly(motion.acceleration_m_s2, ratio.numerator, ratio.denominator, axis=0)
    return Motion(values, time_step_s)


def process(motion: Motion, corner_hz: float | None = None) -> tuple[Motion, tuple[str, ...]]:
    """Demean, taper, high-pass and bring to rest an uncorrected record.

    corner_hz: corner of the high-pass; None chooses the lowest of `CORNERS_HZ` whose displacement ends near zero.
    """
    centred = motion.acceleration_m_s2 - motion.acceleration_m_s2.mean(axis=0)
    start = taper(Motion(centred, motion.time_step_s))
    chosen, how = corner_hz, "as asked"
    if chosen is None:
        passing = (corner for corner in CORNERS_HZ if _displacement_drift(start, corner) <= _DRIFT_FRACTION)
        chosen, how = next(passing, None), "lowest that passes the displacement check"
    if chosen is None:
        chosen, how = CORNERS_HZ[-1], DRIFTS
    history = (
        "mean removed",
        f"cosine taper of {_TAPER_FRACTION:.0%} at each end",
        f"acausal Butterworth high-pass at {chosen:g} Hz, order {_HIGH_PASS_ORDER} ({how})",
        "cubic taken off the displacement, end velocity and displacement zero",
    )
    return end_at_rest(high_pass(start, chosen)), history


def _displacement_drift(motion: Motion, corner_hz: float) -> float:
    """Largest share of its peak displacement that a component reaches near its end after the filter."""
    filtered, pad = _filtered(motion, corner_hz)
    ground: NDArray[np.float64] = np.abs(displacement_m(Motion(filtered, motion.time_step_s)))
    samples = len(motion.acceleration_m_s2)
    end = ground[pad + round((1 - _QUIET_FRACTION) * samples) : pad + samples].max(axis=0)
    peak = ground.max(axis=0)
    return float((end / np.where(peak > 0, peak, 1.0)).max())


def drifts(motion: Motion) -> bool:
    """Whether a component's displacement neither returns nor stays where it is, as of an offset left in."""
    ground = displacement_m(motion)
    size: NDArray[np.float64] = np.abs(ground)
    start = int((1 - _QUIET_FRACTION) * len(ground))
    peak = size.max(axis=0)
    returns = size[start:].max(axis=0) <= _RETURNED_FRACTION * peak
    level = np.ptp(ground[start:], axis=0) <= _LEVEL_FRACTION * peak
    plausible = peak <= _PEAK_VELOCITY_S * np.abs(velocity_m_s(motion)).max(axis=0)
    return not (returns | level & plausible).all()
