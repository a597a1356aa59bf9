"""Making an uncorrected record sound: demean, taper, high-pass, end at rest. Every step says what it did."""

from fractions import Fraction

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, resample_poly, sosfiltfilt
from scipy.signal.windows import tukey

from models.errors import InputError
from models.motions.intensity import displacement_m, velocity_m_s
from models.motions.motion import Motion

TAPER_SHARE = 0.05
"""Share of the record that the cosine taper takes at each end."""
HIGH_PASS_ORDER = 4
"""Order of the Butterworth filter after its two passes."""
CORNERS_HZ = (0.03, 0.04, 0.05, 0.07, 0.1, 0.14, 0.2, 0.28, 0.4, 0.5)
"""Corners that the displacement check tries, lowest first."""
DRIFT_SHARE = 0.15
"""Largest share of the peak displacement at which the record may end."""


def high_pass(motion: Motion, corner_hz: float, order: int = HIGH_PASS_ORDER) -> Motion:
    """Acausal Butterworth high-pass: no phase shift, half the power at the corner for each of its two passes.

    Zeros are put before and after while it runs (1.5 order / corner seconds in all, Converse and Brady 1992), so that the filter's
    transients do not fold into the record.

    Parameters
    ----------
    motion : Motion
    corner_hz : float
    order : int
        Order after both passes, even.
    """
    sections = butter(order // 2, corner_hz, btype="highpass", fs=1 / motion.time_step_s, output="sos")
    pad = int(np.ceil(0.75 * order / corner_hz / motion.time_step_s))
    padded = np.pad(motion.acceleration_m_s2, ((pad, pad), (0, 0)))
    filtered = sosfiltfilt(sections, padded, axis=0, padtype=None)
    return Motion(filtered[pad : pad + len(motion.acceleration_m_s2)], motion.time_step_s)


def demean(motion: Motion, quiet_s: float = 0.0) -> Motion:
    """Take away the mean of the first `quiet_s` seconds, or of the whole record if that is shorter than 1 s."""
    count = int(quiet_s / motion.time_step_s)
    a = motion.acceleration_m_s2
    mean = a[:count].mean(axis=0) if quiet_s >= 1.0 else a.mean(axis=0)
    return Motion(a - mean, motion.time_step_s)


def taper(motion: Motion, share: float = TAPER_SHARE) -> Motion:
    """Cosine taper over a share of the record at each end."""
    window = tukey(len(motion.acceleration_m_s2), 2 * share)
    return Motion(motion.acceleration_m_s2 * window[:, None], motion.time_step_s)


def end_at_rest(motion: Motion) -> Motion:
    """Spread what is left of the end velocity over the record as a Hann window of opposite acceleration."""
    a, step = motion.acceleration_m_s2, motion.time_step_s
    window = np.hanning(len(a))
    weight = np.trapezoid(window, dx=step)
    if weight == 0:
        return motion
    return Motion(a - window[:, None] * velocity_m_s(motion)[-1] / weight, step)


def resample(motion: Motion, time_step_s: float) -> Motion:
    """Motion at another time step, low-passed below the lower of the two Nyquist frequencies (no aliasing).

    Raises
    ------
    InputError
        If the ratio of the steps is not a ratio of whole numbers up to 1000.
    """
    ratio = Fraction(motion.time_step_s / time_step_s).limit_denominator(1000)
    if ratio <= 0 or abs(float(ratio) * time_step_s / motion.time_step_s - 1) > 1e-6:
        raise InputError(
            f"a time step of {motion.time_step_s:g} s cannot be resampled to {time_step_s:g} s",
            where="resample",
            expected="time steps whose ratio is a ratio of small whole numbers",
            remedy="choose a step such as 0.005 or 0.01 s",
        )
    if ratio == 1:
        return motion
    values = resample_poly(motion.acceleration_m_s2, ratio.numerator, ratio.denominator, axis=0)
    return Motion(values, time_step_s)


def process(motion: Motion, corner_hz: float | None = None) -> tuple[Motion, tuple[str, ...]]:
    """Demean, taper, high-pass and bring to rest an uncorrected record.

    Parameters
    ----------
    motion : Motion
    corner_hz : float or None
        Corner of the high-pass; None chooses the lowest of `CORNERS_HZ` whose displacement ends near zero.

    Returns
    -------
    Motion, history
    """
    start = taper(demean(motion))
    history = ["mean removed", f"cosine taper of {TAPER_SHARE:.0%} at each end"]
    chosen = corner_hz or _corner_by_displacement(start)
    how = "as asked" if corner_hz else "lowest corner that passes the displacement check"
    end = end_at_rest(high_pass(start, chosen))
    history.append(f"acausal Butterworth high-pass at {chosen:g} Hz, order {HIGH_PASS_ORDER} ({how})")
    history.append("end velocity set to zero")
    return end, tuple(history)


def displacement_drift(motion: Motion) -> float:
    """Largest share, over the components, of its peak displacement that remains at the end of the record."""
    ground: NDArray[np.float64] = np.abs(displacement_m(motion))
    peak = ground.max(axis=0)
    return float((ground[-1] / np.where(peak > 0, peak, 1.0)).max())


def _corner_by_displacement(motion: Motion) -> float:
    """Lowest corner after which the displacement ends within `DRIFT_SHARE` of its peak; the highest if none does."""
    for corner in CORNERS_HZ:
        if displacement_drift(end_at_rest(high_pass(motion, corner))) <= DRIFT_SHARE:
            return corner
    return CORNERS_HZ[-1]
