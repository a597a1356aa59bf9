"""Motions faster than a preset's step: slip of a large slab down a slope, beside Newmark's sliding block."""

import math

import numpy as np
import pytest

from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.models.shapes import box
from toppling.workers.options import PRESETS
from toppling.workers.problem import _energetic_frequency_hz
from toppling.workers.shaking import shake

SLOPE_DEG, FRICTION, G = 8.0, 0.4, 9.81


def slab(friction=FRICTION):
    rock = box(8.0, 8.0, 1.0)
    return Scene.from_mesh((rock.vertices_m, rock.faces), friction=friction, slope_deg=SLOPE_DEG)


def sine(frequency_hz, lasts_s=2.0):
    """A sine of .6 g along the fall of the slope, that begins and ends softly."""
    step_s = 1.0 / (40.0 * frequency_hz)
    time_s = np.arange(0.0, lasts_s + 0.5 * step_s, step_s)
    soft = np.minimum(1.0, np.minimum(time_s, lasts_s - time_s) / 0.2).clip(0.0)
    along = 0.6 * G * soft * np.sin(2.0 * np.pi * frequency_hz * time_s)
    return Motion(np.outer(along, [1.0, 0.0, 0.0]), step_s)


def newmarks_slip_m(motion, finer=20):
    """Slip down the slope of a block that sticks until friction is at its limit (Newmark 1965)."""
    step_s = motion.time_step_s / finer
    samples = np.arange(len(motion.acceleration_m_s2))
    fine = np.interp(np.arange(0.0, samples[-1], 1.0 / finer), samples, motion.acceleration_m_s2[:, 0])
    sine, cosine = math.sin(math.radians(SLOPE_DEG)), math.cos(math.radians(SLOPE_DEG))
    speed = slip_m = 0.0
    for ground in np.append(fine, np.zeros(int(1.0 / step_s))).tolist():
        driving, normal = G * sine - ground * cosine, G * cosine + ground * sine
        limit = FRICTION * normal
        if speed == 0.0 and abs(driving) <= limit:
            continue
        sense = math.copysign(1.0, speed if speed != 0.0 else driving)
        after = speed + step_s * (driving - sense * limit)
        after = 0.0 if speed * after < 0.0 else after
        slip_m += 0.5 * step_s * (speed + after)
        speed = after
    return slip_m


@pytest.mark.parametrize("preset", ["fast", "standard"])
@pytest.mark.parametrize("frequency_hz", [20.0, 40.0])
def test_a_fast_motion_slides_a_slab_by_newmarks_slip(preset, frequency_hz):
    motion = sine(frequency_hz)
    slip_m = shake(slab(), motion, preset).slip_m
    assert slip_m == pytest.approx(newmarks_slip_m(motion), rel=0.03)  # measured 1.4 to 1.5 % short


def test_a_motion_below_fifteen_hertz_or_without_sliding_leaves_the_step():
    given_s = PRESETS["fast"].time_step_s(slab().rock.half_diagonal_m, G)
    assert shake(slab(), sine(10.0), "fast").time_step_s == given_s
    assert shake(slab(friction=2.0), sine(20.0), "fast").time_step_s == given_s


def test_a_step_that_is_asked_for_is_taken_whatever_the_motion():
    assert shake(slab(), sine(20.0), "fast", time_step=0.016).time_step_s == 0.016


@pytest.mark.parametrize(("share", "highest_hz"), [(0.1, 5.0), (0.4, 30.0)])
def test_the_faster_of_two_sines_counts_from_a_quarter_of_the_energy_on(share, highest_hz):
    time_s = np.arange(0.0, 4.0, 0.002)
    slow, fast = (np.sin(2.0 * np.pi * frequency * time_s) for frequency in (5.0, 30.0))
    mixed = math.sqrt(1.0 - share) * slow + math.sqrt(share) * fast
    motion = Motion(np.outer(mixed, [0.0, 1.0, 0.0]), 0.002)
    assert _energetic_frequency_hz(motion) == pytest.approx(highest_hz, abs=0.5)
