"""Time step of a shake: that of the preset, or a shorter one where a fast motion makes the rock slip."""

from __future__ import annotations

import numpy as np
from scipy import fft

from toppling.models.errors import InputError
from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.workers.options import NumericalOptions

_LONGEST_STEP_SHARE = 1 / 16
"""Steps longer than this share of sqrt(R / g) do not resolve a rocking rock."""

_FAST_HZ = (15.0, 50.0)
"""Steps follow motions faster than the first, and none faster than the second."""

_FAST_SHARE = 0.25
"""Of a motion's energy: so much lies above its highest energetic frequency."""

_STEPS_PER_PERIOD = 12.0
"""Forces are averaged over a step: with n of them in a period, slip is short by some 300 / n^2 per cent."""


def time_step_s(scene: Scene, motion: Motion, options: NumericalOptions, asked_s: float | None) -> float:
    """The step that is asked for, or that of the options and the motion.

    Raises InputError if the one asked for does not resolve a rock of this size.
    """
    half_diagonal_m, gravity_m_s2 = scene.rock.half_diagonal_m, scene.gravity_m_s2
    if asked_s is None:
        step_s = options.time_step_s(half_diagonal_m, gravity_m_s2)
        shortest_s = 1.0 / (_STEPS_PER_PERIOD * _FAST_HZ[1])
        if step_s <= shortest_s or not _slips(scene, motion):
            return step_s
        fast_hz = _energetic_frequency_hz(motion)
        return (
            min(step_s, max(1.0 / (_STEPS_PER_PERIOD * fast_hz), shortest_s))
            if fast_hz > _FAST_HZ[0]
            else step_s
        )
    longest_s = _LONGEST_STEP_SHARE * np.sqrt(half_diagonal_m / gravity_m_s2)
    if not 0.0 < asked_s <= longest_s:
        raise InputError(
            "shake.step_out_of_range",
            f"time_step is {asked_s} s",
            where="shake",
            expected=f"a positive number up to {longest_s:.4g} s for a rock of this size",
            remedy="leave it out: the preset chooses one",
        )
    return float(asked_s)


def _energetic_frequency_hz(motion: Motion) -> float:
    """Frequency above which a quarter of the energy of a motion's acceleration lies, of all components."""
    count = fft.next_fast_len(len(motion.acceleration_m_s2), real=True)
    energy = np.square(np.abs(fft.rfft(motion.acceleration_m_s2, count, axis=0))).sum(axis=1)
    below = np.cumsum(energy)
    return float(np.searchsorted(below, (1.0 - _FAST_SHARE) * below[-1]) / (count * motion.time_step_s))


def _slips(scene: Scene, motion: Motion) -> bool:
    """Whether a rock at rest on a plane slips under some sample; of one on another surface that is not asked."""
    if not scene.ground.is_plane:
        return True
    force = np.array([0.0, 0.0, -scene.gravity_m_s2]) - motion.acceleration_m_s2
    down = -force @ scene.pedestal.normal
    along = np.sqrt(np.maximum((force * force).sum(axis=1) - down * down, 0.0))
    return bool((along > scene.contact.friction_static * down).any())
