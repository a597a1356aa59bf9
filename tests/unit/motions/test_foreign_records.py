"""Files of other people's programs: the right number, or a refusal that names the cause."""

from pathlib import Path

import numpy as np
import pytest

from toppling.models.motions.formats import read_file
from toppling.models.motions.importing import ImportOptions, import_records, record_files
from toppling.models.motions.metadata import read_table

FOREIGN = Path(__file__).resolve().parents[4] / "shared" / "data" / "foreign"
pytestmark = pytest.mark.skipif(not FOREIGN.is_dir(), reason="../shared/data/foreign is not here")
PGA_M_S2, STEP_S, SAMPLES = 2.67264, 0.005, 8000


def folder(number: int) -> Path:
    (found,) = FOREIGN.glob(f"{number:02d}-*")
    return found


def imported(number: int):
    here = folder(number)
    table = here / "table.csv"
    files = [file for file in record_files([here]) if file != table]
    return import_records(files, read_table(table) if table.exists() else [], ImportOptions(process=False))


def components(number: int):
    return [component for file in record_files([folder(number)]) for component in read_file(file)]


@pytest.mark.parametrize("number", [20, 28, 29, 31, 32, 33, 35])
def test_the_made_record_has_its_peak_step_and_samples(number):
    outcome = imported(number)
    assert [str(refusal.reason) for refusal in outcome.refusals] == []
    (record,) = outcome.records
    assert record.intensity["pga_m_s2"] == pytest.approx(PGA_M_S2, abs=1e-5)
    assert record.motion.time_step_s == STEP_S
    assert len(record.motion.acceleration_m_s2) == SAMPLES
    assert record.north_known


def test_counts_of_cosmos_with_a_blank_before_the_formats_sign():
    first, *_ = components(2)
    assert np.abs(first.acceleration_m_s2).max() == pytest.approx(6.403, abs=5e-4)


def test_a_channel_of_cosmos_may_end_as_one_of_csmip():
    (component,) = components(3)
    assert component.time_step_s == 0.01
    assert np.abs(component.acceleration_m_s2).max() == pytest.approx(1.61962, abs=5e-6)
    assert component.direction == 340.0


def test_columns_of_csmip_are_found_by_their_lines():
    found = components(4)
    assert [component.direction for component in found] == [90.0, "up", 0.0]
    assert {component.time_step_s for component in found} == {0.02}
    peaks = [component.acceleration_m_s2[np.abs(component.acceleration_m_s2).argmax()] for component in found]
    assert peaks == pytest.approx([-2.67957, -0.94805, -2.56231])


def test_channel_codes_are_directions_of_peer_nga_east():
    found = {component.label: component for component in components(6)}
    assert {component.event for component in found.values()} == {"ComalTX11-10-20"}
    assert {component.station for component in found.values()} == {"CCM"}
    assert [found[label].direction for label in ("BH100", "BH200", "BHZ00")] == [None, None, "up"]
    assert len(imported(6).records) == 1


def test_rows_beyond_those_counted_are_left_out_and_told():
    found = components(7)
    assert [len(component.acceleration_m_s2) for component in found] == [17_500] * 3
    assert all("17502 samples where the header counts 17500" in component.warnings[0] for component in found)


@pytest.mark.parametrize(
    ("number", "cause"),
    [
        (9, "no stages of the response of XL.BBB..HHE, a sensor of velocity"),
        (
            25,
            "the StationXML has XX.ROCK.10.HNE from 2020-01-01 to today, and the record is of 2019-07-06T03:19:53",
        ),
    ],
)
def test_a_response_that_is_not_there_is_refused_with_what_is(number, cause):
    outcome = imported(number)
    assert not outcome.records
    assert cause in outcome.refusals[0].reason.what
