"""Idealised motions: pulses whose integrals are known in closed form, along any azimuth."""

import numpy as np
from numpy.typing import NDArray

from toppling.models.frames import horizontal_unit_vector
from toppling.models.motions.motion import Motion

_TIME_STEP_S = 0.005


def full_sine(
    pga_m_s2: float, period_s: float, azimuth_deg: float = 0.0, time_step_s: float = _TIME_STEP_S
) -> Motion:
    """A full cycle of a sine of acceleration: a one-sided pulse of velocity, PGV = PGA x period / pi."""
    time = _times(period_s, time_step_s)
    return _along(pga_m_s2 * np.sin(2 * np.pi * time / period_s), azimuth_deg, time[1])


def ricker(
    pga_m_s2: float, period_s: float, azimuth_deg: float = 0.0, time_step_s: float = _TIME_STEP_S
) -> Motion:
    """Symmetric Ricker wavelet of acceleration (Ricker 1943), centred in a record of 3 periods.

    a = PGA (1 - 2 u^2) exp(-u^2), u = pi (t - t0) / period.
    """
    time = _times(3 * period_s, time_step_s)
    u = np.pi * (time / period_s - 1.5)
    return _along(pga_m_s2 * (1 - 2 * u**2) * np.exp(-(u**2)), azimuth_deg, time[1])


def _times(duration_s: float, time_step_s: float) -> NDArray[np.float64]:
    """Sample times that end on the duration, with the nearest step that divides it."""
    return np.linspace(0.0, duration_s, max(round(duration_s / time_step_s), 2) + 1)


def _along(acceleration: NDArray[np.float64], azimuth_deg: float, step: float) -> Motion:
    return Motion(acceleration[:, None] * horizontal_unit_vector(azimuth_deg), float(step))
