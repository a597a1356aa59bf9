"""Which flat tops are an instrument's rail, and which are how a trace was digitised."""

import re
from pathlib import Path

import numpy as np
import pytest
from motion_samples import STEP_S, WRITERS, G, shaking
from refusals import refused

from toppling.models.motions.formats import read_file
from toppling.models.motions.formats.component import Component
from toppling.models.motions.importing import ImportOptions, import_records, record_files
from toppling.models.motions.quality import beyond_nature, check_samples


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


@pytest.mark.parametrize("offset_m_s2", [0.0, 0.4])
@pytest.mark.parametrize("share", [0.3, 0.6])
def test_tops_that_are_cut_at_both_rails_are_clipped_whatever_the_offset(share, offset_m_s2):
    a = shaking(600)[:, 0]
    rail = share * np.abs(a).max()
    with refused("record.clipped"):
        check_samples(channel(np.clip(a, -rail, rail) + offset_m_s2))


def test_one_rail_reached_again_and_again_is_clipped_though_the_other_sign_goes_farther():
    a = shaking(600)[:, 0]
    with refused("record.clipped"):
        check_samples(channel(np.minimum(a, 0.55 * np.abs(a).max())))


@pytest.mark.parametrize("factor", [0.1, 1.0, 10.0])
@pytest.mark.parametrize(
    ("writer", "key", "values"),
    [
        ("esm", "PGA_CM/S^2: ", "{:.4f}\n".format),
        ("unam", "ACEL. MAX.(Gal), C1-C6                 : ", "/{0:.4f}/{0:.4f}/{0:.4f}\n".format),
        ("knet", "Max. Acc. (gal)   ", "{:.3f}\n".format),
    ],
)
def test_samples_have_the_peak_that_their_own_header_states(writer, key, values, factor, tmp_path):
    a = np.repeat(shaking()[:, :1], 3, axis=1) * [1.0, 1.01, 1.02]
    for path in WRITERS[writer](tmp_path, a):
        text = path.read_text()
        if key in text:
            before, _, after = text.partition(key)
            text = before + after.partition("\n")[2]
            place = len(before)
        else:
            place = next(text.index(word) for word in ("USER0", "UNIDADES") if word in text)
        path.write_text(text[:place] + key + values(100 * factor * np.abs(a).max()) + text[place:])
    outcome = import_records(record_files([tmp_path]), options=ImportOptions(process=False))
    if factor == 1.0:
        assert len(outcome.records) == 1
    else:
        assert outcome.refusals[0].reason.code == "record.peak_contradicted"


@pytest.mark.parametrize(
    ("writer", "pattern"),
    [
        ("cosmos_v2", r"(Max = )(\S+)"), ("csmip_v1", r"(MAX  = +)(\S+)"),
        ("csmip_v2", r"(Peak acceleration = +)(\S+)"), ("geonet_v2a", r"(peak   )(\S+)"),
        ("cwb", r"(MAX\. \w: +|~ +)(\S+?)(?=[~\n])"),
    ],
)  # fmt: skip
def test_samples_in_g_under_the_peak_of_m_s2_are_refused_in_every_header(writer, pattern, tmp_path):
    for path in WRITERS[writer](tmp_path, shaking()):
        text, count = re.subn(
            pattern, lambda found: f"{found[1]}{float(found[2]) * 9.8:.3f}", path.read_text()
        )
        assert count
        path.write_text(text)
    outcome = import_records(record_files([tmp_path]), options=ImportOptions(process=False))
    assert outcome.refusals[0].reason.code == "record.peak_contradicted"


def test_smc_states_its_peak_among_the_numbers(tmp_path):
    for path in WRITERS["smc"](tmp_path, shaking()):
        (component,) = read_file(path)
        assert component.stated_peak_m_s2 == pytest.approx(
            np.abs(component.acceleration_m_s2).max(), rel=1e-3
        )


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
    found = beyond_nature(np.abs(a[:, 0]).max(), pgv_m_s * step_factor)
    assert [("time step" in text) for text in found] == [True] * told


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_duration_that_is_not_that_of_the_samples_is_refused(sign, tmp_path):
    for path in WRITERS["esm"](tmp_path, shaking()):
        path.write_text(path.read_text().replace("USER0:", f"DURATION_S: {4.0 * 10**sign:.3f}"))
    outcome = import_records(record_files([tmp_path]))
    assert outcome.refusals[0].reason.code == "record.duration_contradicted"
