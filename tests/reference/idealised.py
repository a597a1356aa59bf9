"""Idealised motions: pulses whose integrals are known in closed form, along any azimuth."""

import numpy as np
from numpy.typing import NDArray

from toppling.models.frames import horizontal_unit_vector
from toppling.models.motions.motion import Motion

_TIME_STEP_S = 0.005


def full_sine(
    pga_m_s2: float, period_s: float, azimuth_deg: float = 0.0, time_step_s: float = _TIME_STEP_S
) -> Motion:
    """One full cycle of a sine of acceleration: a one-sided pulse of velocity, PGV = PGA x period / pi."""
    time = _times(period_s, time_step_s)
    return _along(pga_m_s2 * np.sin(2 * np.pi * time / period_s), azimuth_deg, time[1])


def full_cosine(
    pga_m_s2: float, period_s: float, azimuth_deg: float = 0.0, time_step_s: float = _TIME_STEP_S
) -> Motion:
    """One full cycle of a cosine of acceleration: velocity goes both ways, PGV = PGA x period / (2 pi)."""
    time = _times(period_s, time_step_s)
    return _along(pga_m_s2 * np.cos(2 * np.pi * time / period_s), azimuth_deg, time[1])


def sawtooth_velocity(
    pgv_m_s: float = 5.0, period_s: float = 3.5, azimuth_deg: float = 0.0, time_step_s: float = _TIME_STEP_S
) -> Motion:
    """One cycle of a sawtooth of velocity (the study's figure 8): to +PGV, to -PGV, back to rest.

    Velocity is linear over a quarter, a half and a quarter of the period: acceleration is +-4 PGV / period.
    It changes sign over two time steps, and is that little larger that the velocity still reaches PGV.
    """
    time = _times(period_s, time_step_s)
    velocity = np.interp(time / period_s, [0, 0.25, 0.75, 1], [0, 1, -1, 0])
    acceleration = np.gradient(velocity, time[1])
    reached = np.abs(np.cumsum(0.5 * time[1] * (acceleration[1:] + acceleration[:-1]))).max()
    return _along(pgv_m_s / reached * acceleration, azimuth_deg, time[1])


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
