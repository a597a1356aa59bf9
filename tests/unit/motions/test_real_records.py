"""The 140 records of the development data against the catalogue that comes with them."""

import csv
import dataclasses
import re
from pathlib import Path

import pytest

from toppling.models.motions.formats import read_file
from toppling.models.motions.importing import import_records, record_files
from toppling.models.motions.metadata import read_table

RECORDS = Path(__file__).resolve().parents[4] / "shared" / "data" / "records"
pytestmark = pytest.mark.skipif(not RECORDS.is_dir(), reason="../shared/data/records is not here")
PEAKS = {
    "pga_m_s2": "pga_hvec",
    "pga_h1_m_s2": "pga_h1",
    "pga_h2_m_s2": "pga_h2",
    "pga_vertical_m_s2": "pga_v",
    "pgv_m_s": "pgv_hvec",
}


def rows():
    with (RECORDS / "catalog.csv").open(encoding="utf-8") as file:
        return {row["rec_id"]: row for row in csv.DictReader(file)}


def compared(folders):
    files = record_files([RECORDS / folder for folder in folders])
    outcome = import_records(files, read_table(RECORDS / "catalog.csv"))
    table = rows()
    for record in outcome.records:
        row = table[record.record_id]
        assert record.magnitude == float(row["mag"])
        if row["processing"] == "corrected":
            for ours, theirs in PEAKS.items():
                assert record.intensity[ours] == pytest.approx(float(row[theirs]), rel=0.02), (
                    record.record_id,
                    ours,
                )
        else:  # processed: only that it is the same shaking
            assert record.intensity["pga_m_s2"] == pytest.approx(float(row["pga_hvec"]), rel=0.1), (
                record.record_id
            )
    return outcome


def test_formats_other_than_peer_have_the_catalogues_peaks():
    folders = ["csmip", "geer_acc", "geonet_v2a", "knet", "renadic_v1", "smc", "unam", "usc", "bhrc_v1"]
    outcome = compared(folders)
    assert len(outcome.records) == 31
    assert not outcome.refusals


@pytest.mark.slow
def test_every_peer_record_has_the_catalogues_peaks():
    outcome = compared(["peer_at2"])
    assert len(outcome.records) == 98
    assert not outcome.refusals


@pytest.mark.parametrize(
    ("file", "event"),
    [
        ("csmip/LA116TH.RAW", "NORTHRIDGE EARTHQUAKE, JANUARY 17, 1994 04:31 PST"),
        ("csmip/CITOW2.RAW", "Fri Jul 5, 2019 20:19:31.0 PDT"),
        ("csmip/ce89486SampleInput.v2", "Tue Dec 20, 2022 02:34:01.0 PST"),
        ("usc/017m30lw.s0a", "NORTHRIDGE EARTHQUAKE, JAN 17, 1994 -1230 GMT"),
        ("renadic_v1/stgocentro1002271.v1", "MAULE 2010"),
        ("bhrc_v1/5520-1.V1", "2012/08/11 12:23:16"),
        ("smc/0111a.smc", "Loma Prieta, CA, 1989-10-18 0004"),
        ("unam/PZPU1709.191", "2017/09/19 18:14:40"),
    ],
)
def test_headers_name_the_event_and_its_origin(file, event):
    assert {component.event for component in read_file(RECORDS / file)} == {event}


def test_counts_are_scaled_to_the_peaks_that_the_table_states_or_by_their_response():
    outcome = compared(["miniseed"])
    assert len(outcome.records) == 11
    assert not outcome.refusals
    # Accelerometers of one network and make: some 213,800 counts per m/s2, whatever the shaking.
    for record in outcome.records:
        (told,) = [step for step in record.history if "counts per m/s2" in step]
        assert float(re.search(r"([0-9.e+]+) counts", told).group(1)) == pytest.approx(213_800, rel=0.08)


def test_counts_without_peaks_and_response_are_refused():
    table = [
        dataclasses.replace(entry, peaks_m_s2=(None, None, None))
        for entry in read_table(RECORDS / "catalog.csv")
    ]
    outcome = import_records(record_files(sorted((RECORDS / "miniseed").glob("*.mseed"))), table)
    assert not outcome.records
    assert len(outcome.refusals) == 11
    assert all("unit" in refusal.reason.what for refusal in outcome.refusals)


def test_each_format_sample_is_read_or_says_what_is_missing():
    outcome = import_records(record_files([RECORDS / "format_samples"]))
    assert {record.record_id for record in outcome.records} == {
        "20161113_110259_WTMC_20",
        "CE23837",
        "CICLC",
        "HI.ARS1..HN",
    }
    # the others are single components of a station, read but no record
    assert all("channels" in refusal.reason.what for refusal in outcome.refusals)
    assert len(outcome.refusals) == 4
