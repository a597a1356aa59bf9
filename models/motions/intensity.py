"""Intensity of a motion: peaks, spectra, energy, durations, of the horizontal vector and of its components.

Horizontal measures are those of the vector (x, y), so that turning a motion leaves them as they are: peaks
are the largest length of the vector, Arias intensity and the energy integral use its squared length, spectral
accelerations are the largest length of the two oscillators' response (RotD100 of Boore 2010, Bull. Seism.
Soc. Am. 100, 1830-1835).
"""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import scipy  # loads its signal processing where it is used: 38 MB that few workers need
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull, QhullError

from toppling.models.frames import azimuth_deg
from toppling.models.motions.measures import STANDARD_G_M_S2
from toppling.models.motions.motion import Motion

_DAMPING = 0.05
"""Share of the critical."""
SPECTRUM_PERIODS_S = (0.05, 0.1, 0.2, 0.3, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0, 7.5)
"""Periods at which a catalogue keeps the RotD50 spectrum."""
_SAMPLES_A_PERIOD = 40
"""Number of times a period at which a response is evaluated, which keeps its peak within 0.3 %."""
_FINEST = 16
"""Maximum number of these times in a time step of the record, in which the ground is a straight line."""
_DISTINCT_DIRECTION_DEG = 22.5
"""Half of the study's direction bin: directions farther apart than this are distinct."""


def velocity_m_s(motion: Motion) -> NDArray[np.float64]:
    """Ground velocity (n, 3) at the samples, from rest: exact where acceleration is linear between them."""
    a, step = motion.acceleration_m_s2, motion.time_step_s
    velocity = np.zeros_like(a)
    np.cumsum(0.5 * step * (a[1:] + a[:-1]), axis=0, out=velocity[1:])
    return velocity


def displacement_m(motion: Motion) -> NDArray[np.float64]:
    """Ground displacement (n, 3) at the samples, from rest: exact where acceleration is linear between."""
    a, step = motion.acceleration_m_s2, motion.time_step_s
    displacement = np.zeros_like(a)
    increment = step * velocity_m_s(motion)[:-1] + step**2 / 6 * (2 * a[:-1] + a[1:])
    np.cumsum(increment, axis=0, out=displacement[1:])
    return displacement


def oscillator_response_m_s2(
    acceleration: ArrayLike, time_step_s: float, period_s: float
) -> NDArray[np.float64]:
    """Pseudo-acceleration of a damped oscillator on a shaking base: omega squared times its displacement.

    The discretisation is exact for a base acceleration that is linear between samples (SciPy's first-order
    hold, the method of Nigam and Jennings 1969), from rest.

    acceleration: (n,), acceleration of the base, m/s2.
    Returns array: as `acceleration`.
    """
    numerator, denominator = _oscillator(time_step_s, period_s)
    return scipy.signal.lfilter(numerator, denominator, np.asarray(acceleration, float), axis=0)


@lru_cache(maxsize=256)
def _oscillator(time_step_s: float, period_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Coefficients of the recursion from the base's acceleration to the oscillator's pseudo-acceleration."""
    omega = 2 * np.pi / period_s
    continuous = [-(omega**2)], [1.0, 2 * _DAMPING * omega, omega**2]
    numerator, denominator, _ = scipy.signal.cont2discrete(continuous, time_step_s, method="foh")
    return numerator.ravel(), denominator


def rotated_peaks(horizontal: ArrayLike) -> NDArray[np.float64]:
    """Largest absolute value of a horizontal pair along every whole degree from 0 to 179 (Boore 2010).

    horizontal: (n, 2).
    Returns (180,) array: its median is RotD50, its maximum RotD100.
    """
    points = np.asarray(horizontal, float)
    angles = np.deg2rad(np.arange(0.0, 180.0, 22.5))
    coarse = np.abs(points @ np.stack([np.cos(angles), np.sin(angles)])).argmax(axis=0)
    least = _rotated(points[coarse]).min()  # no peak is smaller: nearer points reach none
    outer = points[np.hypot(points[:, 0], points[:, 1]) >= least]
    if len(outer) > 2000:  # nearly along one line
        try:
            outer = outer[ConvexHull(outer).vertices]
        except QhullError:  # exactly along one line: its ends are extreme in x or in y
            outer = outer[[*outer.argmin(axis=0), *outer.argmax(axis=0)]]
    return _rotated(outer)


def _rotated(points: NDArray[np.float64]) -> NDArray[np.float64]:
    angle = np.deg2rad(np.arange(180))
    return np.abs(points[:, :1] * np.cos(angle) + points[:, 1:] * np.sin(angle)).max(axis=0)


def spectral_acceleration_m_s2(motion: Motion, periods_s: Sequence[float]) -> dict[str, NDArray[np.float64]]:
    """Response spectra (pseudo-acceleration) of a motion's horizontal pair.

    Returns dict: `x`, `y` (the components), `rotd50`, `rotd100`, each as long as `periods_s`.
    """
    rows = []
    for period in periods_s:
        finer = min(math.ceil(_SAMPLES_A_PERIOD * motion.time_step_s / period), _FINEST)
        ground = _between_samples(motion.acceleration_m_s2[:, :2], finer)
        response = oscillator_response_m_s2(ground, motion.time_step_s / finer, period)
        rotated = rotated_peaks(response)
        rows.append((rotated[0], rotated[90], np.median(rotated), np.hypot(*response.T).max()))
    return dict(zip(("x", "y", "rotd50", "rotd100"), np.array(rows).T, strict=True))


def _between_samples(history: NDArray[np.float64], finer: int) -> NDArray[np.float64]:
    """History (n, k) with `finer` - 1 more samples between any two, on the straight line."""
    if finer == 1:
        return history
    share = (np.arange(finer) / finer)[:, None]
    filled = history[:-1, None] + share * (history[1:] - history[:-1])[:, None]
    return np.vstack([filled.reshape(-1, history.shape[1]), history[-1:]])


def arias_m_s(acceleration: NDArray[np.float64], time_step_s: float) -> float:
    """Arias intensity, pi/2g times the integral of squared acceleration (Arias 1970), summed over columns."""
    squared = (acceleration**2).reshape(len(acceleration), -1).sum(axis=1)
    return float(np.pi / (2 * STANDARD_G_M_S2) * np.trapezoid(squared, dx=time_step_s))


def significant_duration_s(squared: NDArray[np.float64], time_step_s: float) -> float:
    """Time from 5 to 95 % of the integral of a squared history (n,)."""
    build_up = np.zeros(len(squared))
    np.cumsum(0.5 * (squared[1:] + squared[:-1]), out=build_up[1:])
    if build_up[-1] == 0:
        return 0.0
    start, end = np.interp([0.05, 0.95], build_up / build_up[-1], np.arange(len(squared)))
    return float((end - start) * time_step_s)


def directionality(horizontal: NDArray[np.float64]) -> float:
    """Share of the vector PGA that is reached more than 22.5 degrees away from the PGA's direction, 0 to 1.

    The study counts a record above 0.9 as one without strong directionality.
    """
    length = np.hypot(*horizontal.T)
    peak = int(length.argmax())
    if length[peak] == 0:
        return 0.0
    cosine = horizontal @ horizontal[peak] / (length[peak] * np.where(length > 0, length, 1.0))
    elsewhere = length[cosine < np.cos(np.deg2rad(_DISTINCT_DIRECTION_DEG))]
    return float(elsewhere.max(initial=0.0) / length[peak])


def _along_components(
    history: NDArray[np.float64], component_azimuths_deg: tuple[float, float]
) -> NDArray[np.float64]:
    """Projections (n, 2) of a history (n, 3) on the two recorded horizontal components."""
    angle = np.deg2rad(component_azimuths_deg)
    return history[:, :2] @ np.stack([np.cos(angle), np.sin(angle)])


def measure(motion: Motion, component_azimuths_deg: tuple[float, float] = (0.0, 90.0)) -> dict[str, float]:
    """Every intensity measure that a catalogue keeps.

    component_azimuths_deg: azimuths of the two recorded horizontal components, degrees counter-clockwise from x;
    the stronger one carries the study's energy duration (5 to 95 % of the integral of its squared velocity,
    Anderson 2004).
    Returns dict: by name, units in the names. Those of `models.motions.measures.MEASURES` are what an imposed
    motion has.
    """
    a, step = motion.acceleration_m_s2, motion.time_step_s
    velocity, displacement = velocity_m_s(motion), displacement_m(motion)
    length = np.hypot(a[:, 0], a[:, 1])
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    peak, peak_speed = float(length.max()), float(speed.max())
    component_pga = np.abs(_along_components(a, component_azimuths_deg)).max(axis=0).tolist()
    component_velocity = _along_components(velocity, component_azimuths_deg)
    component_pgv = np.abs(component_velocity).max(axis=0).tolist()
    strong = int(np.argmax(component_pga))
    vector = spectral_acceleration_m_s2(motion, SPECTRUM_PERIODS_S)
    sa = dict(zip(SPECTRUM_PERIODS_S, vector["rotd100"], strict=True))
    rotated_pga, rotated_pgv = rotated_peaks(a[:, :2]), rotated_peaks(velocity[:, :2])
    result = {
        "pga_m_s2": peak,
        "pgv_m_s": peak_speed,
        "ground_accelerates_toward_deg": azimuth_deg(a[length.argmax()]),
        "pgv_pga_s": peak_speed / peak if peak else 0.0,
        "pgd_m": float(np.hypot(displacement[:, 0], displacement[:, 1]).max()),
        "pga_vertical_m_s2": float(np.abs(a[:, 2]).max()),
        "arias_m_s": arias_m_s(a[:, :2], step),
        "cav_m_s": float(np.trapezoid(length, dx=step)),
        "duration_energy_s": significant_duration_s(component_velocity[:, strong] ** 2, step),
        "duration_arias_s": significant_duration_s(length**2, step),
        "sa_1s_m_s2": float(sa[1.0]),
        "sa_2s_m_s2": float(sa[2.0]),
        "directionality": directionality(a[:, :2]),
        "strong_azimuth_deg": float(component_azimuths_deg[strong] % 360),
        "duration_energy_vector_s": significant_duration_s(speed**2, step),
        "pga_h1_m_s2": component_pga[0],
        "pga_h2_m_s2": component_pga[1],
        "pgv_h1_m_s": component_pgv[0],
        "pgv_h2_m_s": component_pgv[1],
        "pgv_vertical_m_s": float(np.abs(velocity[:, 2]).max()),
        "pga_rotd50_m_s2": float(np.median(rotated_pga)),
        "pga_rotd100_m_s2": float(rotated_pga.max()),
        "pgv_rotd50_m_s": float(np.median(rotated_pgv)),
        "pgv_rotd100_m_s": float(rotated_pgv.max()),
    }
    for period, value in zip(SPECTRUM_PERIODS_S, vector["rotd50"], strict=True):
        result[f"sa_rotd50_{period:g}s_m_s2"] = float(value)
    return result
