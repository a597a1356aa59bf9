"""A ground motion: three components of acceleration at equal time steps."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from toppling.models.errors import InputError

_SHORTEST_STEP_S = 1e-9
"""Shortest time step of any motion."""
_LONGEST_S = 1e6
"""Longest duration of any motion."""
_LARGEST_M_S2 = 1e6
"""Largest acceleration of any motion; squares and integrals of what is within these stay far from overflow."""


@dataclass(frozen=True, eq=False, init=False)
class Motion:
    """Acceleration of the ground, linear between samples.

    Parameters
    ----------
    acceleration_m_s2 : (n, 3) array
        Ground acceleration along x, y, z of the scene.
    time_step_s : float
        Seconds between samples; the first sample is at time 0.

    Raises
    ------
    InputError
        If the shape is not (n, 3) with n >= 2, a value is not finite, or the time step is not positive.
    """

    acceleration_m_s2: NDArray[np.float64]
    time_step_s: float

    def __init__(self, acceleration_m_s2: ArrayLike, time_step_s: float) -> None:
        values = np.array(acceleration_m_s2, dtype=float)
        if values.ndim != 2 or values.shape[1] != 3 or len(values) < 2:
            what = f"acceleration has shape {values.shape}"
            raise _motion_error("motion.shape_unusable", what, "(n, 3) with n >= 2: x, y, z in columns")
        if not np.isfinite(values).all():
            row = int(np.argwhere(~np.isfinite(values))[0, 0])
            what = f"acceleration at sample {row} is {values[row]}"
            raise _motion_error("motion.not_finite", what, "finite numbers")
        if not (np.isfinite(time_step_s) and time_step_s > 0):
            what = f"the time step is {time_step_s}"
            raise _motion_error("motion.step_unusable", what, "a positive number of seconds")
        if not _SHORTEST_STEP_S <= time_step_s <= _LONGEST_S / len(values):
            raise _motion_error(
                "motion.duration_out_of_range",
                f"{len(values)} samples at a time step of {time_step_s:g} s",
                f"steps of at least {_SHORTEST_STEP_S:g} s, and a motion of at most {_LONGEST_S:g} s",
            )
        if (most := np.abs(values).max()) > _LARGEST_M_S2:
            what = f"the acceleration reaches {most:g} m/s2"
            raise _motion_error("motion.too_strong", what, f"at most {_LARGEST_M_S2:g} m/s2")
        values.setflags(write=False)
        object.__setattr__(self, "acceleration_m_s2", values)
        object.__setattr__(self, "time_step_s", float(time_step_s))

    @property
    def duration_s(self) -> float:
        """Time of the last sample."""
        return (len(self.acceleration_m_s2) - 1) * self.time_step_s

    @property
    def time_s(self) -> NDArray[np.float64]:
        """Times of the samples, (n,)."""
        return np.arange(len(self.acceleration_m_s2), dtype=np.float64) * self.time_step_s

    @cached_property
    def _velocity_m_s(self) -> NDArray[np.float64]:
        """Ground velocity at the samples, (n, 3)."""
        velocity = np.zeros_like(self.acceleration_m_s2)
        means = 0.5 * (self.acceleration_m_s2[1:] + self.acceleration_m_s2[:-1])
        np.cumsum(self.time_step_s * means, axis=0, out=velocity[1:])
        return velocity

    def velocity_at(self, time_s: ArrayLike) -> NDArray[np.float64]:
        """Ground velocity at any times, m/s: the exact integral of the piecewise linear acceleration.

        Zero before the record; after it the acceleration is zero, so the last velocity is kept.

        Parameters
        ----------
        time_s : (k,) array

        Returns
        -------
        (k, 3) array
        """
        acceleration, step, at_sample = self.acceleration_m_s2, self.time_step_s, self._velocity_m_s
        time = np.clip(np.asarray(time_s, float), 0.0, self.duration_s)
        index = np.minimum((time / step).astype(np.int64), len(acceleration) - 2)
        since = (time - index * step)[:, None]
        slope = (acceleration[index + 1] - acceleration[index]) / step
        return at_sample[index] + since * (acceleration[index] + 0.5 * since * slope)

    def mean_between(self, time_s: ArrayLike) -> NDArray[np.float64]:
        """Mean acceleration (k, 3) over each interval of k + 1 increasing times, m/s2; zero outside of the record."""
        time = np.asarray(time_s, float)
        return np.diff(self.velocity_at(time), axis=0) / np.diff(time)[:, None]


def _motion_error(code: str, what: str, expected: str) -> InputError:
    remedy = "check the units and columns, and fill or cut gaps first"
    return InputError(code, what, where="Motion", expected=expected, remedy=remedy)
