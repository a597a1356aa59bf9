"""Which flat tops are an instrument's rail, and which are how a trace was digitised."""

from pathlib import Path

import numpy as np
import pytest
from motion_samples import STEP_S, WRITERS, G, shaking
from refusals import refused

from toppling.models.motions.formats.component import Component
from toppling.models.motions.importing import ImportOptions, import_records, record_files
from toppling.models.motions.quality import check_samples, warnings_of


def channel(acceleration_m_s2):
    return Component(np.asarray(acceleration_m_s2, float), STEP_S, 0.0, Path("quake.v1"), 28, "test")


def digitised(peak_m_s2, flat_m_s2, quantum_m_s2=0.0):
    """An analogue trace, straight between points 0.07 s apart: three are level, beyond is the other sign's peak."""
    points = shaking(600)[::7, 0]
    points *= peak_m_s2 / np.abs(points).max()
    points = points if points.min() == -peak_m_s2 else -points  # the peak is downward
    points = np.minimum(points, 0.8 * flat_m_s2)
    at = int(np.argmax(points))
    points[at - 1 : at + 2] = flat_m_s2
    a = np.interp(np.arange(7 * (len(points) - 1) + 1), 7 * np.arange(len(points)), points)
    return np.round(a / quantum_m_s2) * quantum_m_s2 if quantum_m_s2 else a


@pytest.mark.parametrize("quantum_m_s2", [0.0, 1e-4, 1e-3])
def test_a_flat_top_a_tenth_below_the_peak_of_the_other_sign_is_no_clipping(quantum_m_s2):
    a = digitised(0.196, 0.176, quantum_m_s2=quantum_m_s2)
    assert (a == a.max()).sum() >= 15
    check_samples(channel(a))


def test_tops_of_a_few_steps_of_the_digitiser_are_flat_without_clipping():
    """Twenty steps from zero to the peak: the top of every slow swing has equal samples."""
    steps = np.concatenate([np.arange(21), np.arange(20, -20, -1), np.arange(-20, 1)])
    a = 0.001 * G * np.repeat(steps, 6)
    assert (a == a.max()).sum() >= 10
    check_samples(channel(a))


@pytest.mark.parametrize(
    ("low", "high", "offset_m_s2"),
    [(-0.3, 0.3, 0.0), (-0.6, 0.6, 0.0), (-0.3, 0.3, 0.4), (-0.6, 0.6, 0.4), (-1.0, 0.55, 0.0)],
)
def test_tops_that_are_cut_at_a_rail_or_two_are_clipped_whatever_the_offset(low, high, offset_m_s2):
    a = shaking(600)[:, 0]
    a /= np.abs(a).max()
    with refused("record.clipped"):
        check_samples(channel(np.clip(a, low, high) + offset_m_s2))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_one_file_given_as_two_components_is_refused(sign, tmp_path):
    a = shaking()
    a[:, 1] = sign * a[:, 0]
    WRITERS["peer"](tmp_path, a)
    outcome = import_records(record_files([tmp_path]))
    assert outcome.refusals[0].reason.code == "record.same_samples"
    assert len(import_records(record_files([tmp_path]), options=ImportOptions(doubtful=True)).records) == 1


@pytest.mark.parametrize(("step_factor", "told"), [(0.1, True), (1.0, False), (10.0, True)])
def test_a_time_step_in_error_by_a_factor_of_ten_is_told_by_the_pulses_length(step_factor, told):
    a = 0.1 * shaking()
    pgv_m_s = np.abs(np.cumsum(a[:, 0]) * STEP_S).max()
    found = warnings_of({"pgv_pga_s": pgv_m_s * step_factor / np.abs(a[:, 0]).max()})
    assert [("time step" in text) for text in found] == [True] * told
