"""What a job imposes is what the study says: level, direction, and intensity without integrating anew."""

import numpy as np
import pytest
from refusals import refused

from toppling.models.motions.intensity import displacement_m, measure
from toppling.models.motions.measures import SCALING_POWER
from toppling.models.motions.motion import Motion
from toppling.models.motions.record import Record, impose
from toppling.models.motions.synthetic import synthetic_ensemble


@pytest.fixture(scope="module")
def record():
    return synthetic_ensemble(1, seed=7)[0]


@pytest.mark.parametrize("azimuth_deg", [0.0, 45.0, 135.0, 292.5])
def test_the_largest_horizontal_vector_has_the_level(record, azimuth_deg):
    horizontal = impose(record, 4.0, azimuth_deg).motion.acceleration_m_s2[:, :2]
    assert np.hypot(*horizontal.T).max() == pytest.approx(4.0, rel=1e-12)


def test_the_stronger_recorded_component_points_to_the_azimuth():
    time_s = np.arange(400) * 0.01
    strong, weak = 3 * np.sin(7 * time_s), 1 * np.sin(11 * time_s + 1)
    # recorded along 30 and 120 degrees, the strong one along 120
    along_30, along_120 = np.deg2rad([30, 120])
    x = weak * np.cos(along_30) + strong * np.cos(along_120)
    y = weak * np.sin(along_30) + strong * np.sin(along_120)
    record = Record.of(
        "a", Motion(np.column_stack([x, y, 0 * x]), 0.01), component_azimuths_deg=(30.0, 120.0)
    )
    imposed = impose(record, record.intensity["pga_m_s2"], 270.0).motion.acceleration_m_s2
    assert np.allclose(imposed[:, 1], -strong, atol=1e-12)
    # what was 90 degrees clockwise of the strong component stays so
    assert np.allclose(imposed[:, 0], -weak, atol=1e-12)


def test_intensity_scales_and_turns_as_if_it_were_measured_anew(record):
    imposed = impose(record, 3.0, 200.0)
    anew = measure(imposed.motion, (200.0, 290.0))
    assert set(imposed.intensity) == {*SCALING_POWER, "ground_accelerates_toward_deg"}
    for name, value in imposed.intensity.items():
        assert value == pytest.approx(anew[name], rel=1e-9), name


def test_displacement_limit_holds_and_intensity_is_that_of_the_filtered_motion(record):
    free = impose(record, 15.0, 0.0)
    held = impose(record, 15.0, 0.0, peak_displacement_m=0.05)
    assert free.intensity["pgd_m"] > 0.05
    ground = displacement_m(held.motion)
    assert np.hypot(ground[:, 0], ground[:, 1]).max() <= 0.05 * (1 + 1e-9)
    anew = measure(held.motion, (0.0, 90.0))
    for name, value in held.intensity.items():
        assert value == pytest.approx(anew[name], rel=1e-6), name


def test_a_limit_that_is_not_reached_changes_nothing(record):
    free, held = impose(record, 1.0, 0.0), impose(record, 1.0, 0.0, peak_displacement_m=100.0)
    assert np.array_equal(free.motion.acceleration_m_s2, held.motion.acceleration_m_s2)


@pytest.mark.parametrize("level", [0.0, -1.0, np.nan])
def test_a_level_that_is_not_positive_is_refused(record, level):
    with refused("value.not_positive", "pga_m_s2"):
        impose(record, level, 0.0)
