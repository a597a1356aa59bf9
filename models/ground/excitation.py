"""What a moving ground adds to the velocity of a rock that is seen from it."""

from __future__ import annotations

import numpy as np

from toppling.models.compiled import Array, Vector, inner


def excitation(acceleration_m_s2: Array, sample_s: float) -> Array:
    """Acceleration and velocity (samples, 6) of ground that starts at rest, from its acceleration (samples, 3).

    The velocity is the exact integral of an acceleration that is linear between samples.
    """
    velocity = np.zeros_like(acceleration_m_s2)
    means = 0.5 * (acceleration_m_s2[1:] + acceleration_m_s2[:-1])
    np.cumsum(sample_s * means, axis=0, out=velocity[1:])
    return np.hstack([acceleration_m_s2, velocity])


@inner
def velocity_increment_m_s(
    ground: Array, sample_s: float, gravity_m_s2: Array, since_s: float, until_s: float
) -> Vector:
    """What gravity less the ground's acceleration adds to a velocity between two times.

    Parameters
    ----------
    ground : (samples, 6) array
        As :func:`excitation` gives it; before it and after it the ground moves uniformly.
    sample_s : float
    gravity_m_s2 : (3,) array
        In the axes of the ground's motion.
    since_s, until_s : float
    """
    before, after = _velocity_m_s(ground, sample_s, since_s), _velocity_m_s(ground, sample_s, until_s)
    lasting_s = until_s - since_s
    return (
        gravity_m_s2[0] * lasting_s - (after[0] - before[0]),
        gravity_m_s2[1] * lasting_s - (after[1] - before[1]),
        gravity_m_s2[2] * lasting_s - (after[2] - before[2]),
    )


@inner
def _velocity_m_s(ground: Array, sample_s: float, time_s: float) -> Vector:
    time = min(max(time_s, 0.0), (len(ground) - 1) * sample_s)
    i = min(int(time / sample_s), len(ground) - 2)
    since = time - i * sample_s
    half = 0.5 * since * since / sample_s
    return (
        ground[i, 3] + since * ground[i, 0] + half * (ground[i + 1, 0] - ground[i, 0]),
        ground[i, 4] + since * ground[i, 1] + half * (ground[i + 1, 1] - ground[i, 1]),
        ground[i, 5] + since * ground[i, 2] + half * (ground[i + 1, 2] - ground[i, 2]),
    )
