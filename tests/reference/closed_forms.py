"""Closed forms of rocking, sliding and wobbling bodies; SI units, angles in radians."""

import numpy as np
from scipy.integrate import quad
from scipy.special import ellipkinc, ellipkm1

GRAVITY_M_S2 = 9.81


def rocking_frequency(half_width: float, half_height: float) -> float:
    """Rocking frequency p = sqrt(3 g / 4 R) of a solid rectangle, rad/s (Housner 1963)."""
    return float(np.sqrt(0.75 * GRAVITY_M_S2 / np.hypot(half_width, half_height)))


def impact_ratio(half_width: float, half_height: float) -> float:
    """Angular velocity after an impact over that before, 1 - (3/2) sin^2 alpha (Housner 1963)."""
    return 1.0 - 1.5 * np.sin(np.arctan2(half_width, half_height)) ** 2


def free_rocking_time_s(alpha: float, frequency: float, share: float) -> float:
    """Time from release at rest at `share` of alpha to the first impact.

    With x = sin((alpha - theta)/2) the energy integral is (1/p) int dx / sqrt((x^2 - k^2)(1 - x^2)) from
    k = sin(alpha (1 - share)/2) to sin(alpha/2): elliptic integrals of the first kind.
    """
    least, most = np.sin(0.5 * alpha * (1.0 - share)), np.sin(0.5 * alpha)
    modulus = 1.0 - least**2
    amplitude = np.arcsin(np.sqrt((1.0 - most**2) / modulus))
    return float((ellipkm1(least**2) - ellipkinc(amplitude, modulus)) / frequency)


def next_peak(alpha: float, ratio: float, peak: float) -> float:
    """Peak angle after the impact that follows a peak, of a symmetrical body whose impacts keep `ratio`."""
    remaining = ratio**2 * (np.cos(alpha - peak) - np.cos(alpha))
    return float(alpha - np.arccos(np.cos(alpha) + remaining))


def overturning_velocity_step_m_s(half_width: float, half_height: float) -> float:
    """Least step of the base's velocity that overturns a rectangle.

    V = sqrt((8/3) g R (1 - cos alpha)) / cos alpha.
    The step gives angular momentum m V h about the corner; the energy must lift the centre of mass over it.
    """
    half_diagonal, alpha = np.hypot(half_width, half_height), np.arctan2(half_width, half_height)
    return float(np.sqrt(8.0 / 3.0 * GRAVITY_M_S2 * half_diagonal * (1 - np.cos(alpha))) / np.cos(alpha))


def overturning_duration_s(alpha: float, frequency: float, acceleration_ratio: float) -> float:
    """Least time for which a constant acceleration A g tan(alpha), A > 1, must act to overturn.

    During the push theta'^2 / 2 = p^2 (W(0) - W(theta)), W = cos(alpha - theta) + A tan(alpha) sin(alpha -
    theta); at its end the energy must be that of the upright equilibrium, A tan(alpha) sin(alpha - theta_1) =
    W(0) - 1.
    """
    push = acceleration_ratio * np.tan(alpha)
    start = np.cos(alpha) + push * np.sin(alpha)
    end = alpha - np.arcsin((start - 1.0) / push)

    def slowness(root: float) -> float:
        angle = root * root
        # W(0) - W(theta) without cancellation: sums of sines of half angles.
        gained = (
            2.0 * np.sin(0.5 * angle) * (push * np.cos(alpha - 0.5 * angle) - np.sin(alpha - 0.5 * angle))
        )
        return float(2.0 * root / (frequency * np.sqrt(2.0 * gained)))

    return float(quad(slowness, 0.0, np.sqrt(end), epsabs=0.0, epsrel=1e-12)[0])


def rock_friction_boundary(slenderness: float, acceleration_g: float) -> float:
    """Least friction at which a block at rest rocks without slip under A g, A > 1/k, k = h/b.

    [A (4 + k^2) + 3 k] / [1 + 4 k^2 + 3 k A] (Shenton 1996).
    """
    k, a = slenderness, acceleration_g
    return (a * (4 + k * k) + 3 * k) / (1 + 4 * k * k + 3 * k * a)


def landing_boundary(slenderness: float, friction: float) -> float:
    """|uy/ux| between rock and rock-slide of a translating block that lands flat.

    Veeraraghavan (2015), equation 2.31; k = h/b.
    """
    k, mu = slenderness, friction
    return (4 + k * k - 3 * mu * k) / (mu * (1 + 4 * k * k) - 3 * k)


def slip_of_pulse_m(friction: float, slope: float, acceleration_g: float, duration_s: float) -> float:
    """Slip downhill under a rectangular pulse of uphill horizontal ground acceleration, until rest.

    Gained: g [(A cos + sin) - mu (cos - A sin)]; lost afterwards: g (mu cos - sin), beta < atan(mu) (Newmark
    1965).
    """
    sine, cosine = np.sin(slope), np.cos(slope)
    gained = GRAVITY_M_S2 * ((acceleration_g * cosine + sine) - friction * (cosine - acceleration_g * sine))
    lost = GRAVITY_M_S2 * (friction * cosine - sine)
    return float(0.5 * gained * duration_s**2 * (1.0 + gained / lost)) if gained > 0 else 0.0


def wobble_rate_rad_s(radius: float, half_height: float, tilt: float) -> float:
    """Rate of precession of a solid cylinder that wobbles steadily on its rim, centre of mass at rest."""
    sine, cosine = np.sin(tilt), np.cos(tilt)
    about_axis, across = radius**2 / 2, radius**2 / 4 + half_height**2 / 3
    moment = GRAVITY_M_S2 * (radius * cosine - half_height * sine)
    return float(np.sqrt(moment / (sine * (across * cosine - about_axis * half_height / radius * sine))))
