"""Two earthquakes at one station are two records; what is given twice of one earthquake is one."""

from pathlib import Path

import obspy
import pytest
from motion_samples import WRITERS, edited, shaking
from refusals import left_out

from toppling.models.motions.importing import ImportOptions, import_records, record_files
from toppling.models.motions.metadata import read_table

NAMED_V2 = {"Rcrd of Tue Dec 20, 2022": "TESTQUAKE", "Preliminary": "DECEMBER 20, 2022 02:34 PST"}
ORIGINS = [
    ("bhrc", {}, {"2012/08/11   12:23:16": "2012/08/11   12:34:35"}),
    ("bhrc", {}, {"2012/08/11   12:23:16": "2012/08/12   12:23:16"}),
    ("csmip_v1", {}, {"JANUARY 17, 1994 04:31 PST": "JANUARY 17, 1994 04:32 PST"}),
    ("csmip_v2", {}, {"Tue Dec 20, 2022": "Sun Jan  1, 2023"}),
    ("csmip_v2", NAMED_V2, {"02:34 PST": "03:39 PST"}),
    ("csmip_v2", NAMED_V2, {"DECEMBER 20": "DECEMBER 21"}),
    ("pairs_v1", {}, {"JANUARY 17, 1994 04:31 PST": "JANUARY 17, 1994 04:32 PST"}),
    ("smc", {}, {"18    0004": "18    0041"}),
    ("smc", {}, {"18    0004": "19    0004"}),
    ("unam", {}, {"18:14:40": "19:14:40"}),
    ("unam", {}, {"2017/09/19": "2017/09/23"}),
]


def written(folder: Path, name: str, seed: int, *replacements: dict[str, str]) -> list[Path]:
    folder.mkdir()
    changes = [pair for each in replacements for pair in each.items()]
    return edited(folder, name, *changes, motion=shaking(seed=seed))


def imported(folder: Path, events: tuple[str, str] | None = None, unit: str = ""):
    """Import of two folders, with a table that names their events if these are given."""
    table = []
    if events:
        rows = ["event,unit,h1,h2,v"]
        for event, name in zip(events, "ab", strict=True):
            paths = [str(path.relative_to(folder)) for path in sorted((folder / name).iterdir())]
            rows.append(",".join((event, unit, *paths)))
        (folder / "table.csv").write_text("\n".join(rows) + "\n")
        table = read_table(folder / "table.csv")
    return import_records(record_files([folder / "a", folder / "b"]), table, ImportOptions(process=False))


@pytest.mark.parametrize(("name", "title", "other"), ORIGINS)
def test_two_earthquakes_of_other_date_or_time_at_one_station_are_both_imported(name, title, other, tmp_path):
    written(tmp_path / "a", name, 0, title)
    written(tmp_path / "b", name, 1, title, other)
    outcome = imported(tmp_path)
    assert [str(refusal.reason) for refusal in outcome.refusals] == []
    assert len(outcome.records) == 2


@pytest.mark.parametrize(("name", "title"), [(name, title) for name, title, _ in ORIGINS[::2]])
def test_files_of_one_earthquake_at_one_station_count_as_one_shaking(name, title, tmp_path):
    for folder, seed in (("a", 0), ("b", 1)):
        written(tmp_path / folder, name, seed, title)
    outcome = imported(tmp_path)
    assert len(outcome.records) == 1
    left_out(outcome, "record.given_twice")


def test_the_tables_events_tell_apart_records_whose_headers_do_not(tmp_path):
    for folder, seed in (("a", 0), ("b", 1)):
        written(tmp_path / folder, "smc", seed)
    assert len(imported(tmp_path, ("Mainshock", "Aftershock")).records) == 2
    assert len(imported(tmp_path, ("Mainshock", "Mainshock")).records) == 1


def test_headers_of_other_origin_tell_apart_records_that_the_table_gives_one_name(tmp_path):
    written(tmp_path / "a", "smc", 0)
    written(tmp_path / "b", "smc", 1, {"18    0004": "18    0041"})
    assert len(imported(tmp_path, ("Testquake", "Testquake")).records) == 2


@pytest.mark.parametrize(("hours_later", "records"), [(0, 1), (34, 2)])
def test_one_name_of_the_table_is_one_shaking_only_if_the_records_begin_together(
    hours_later, records, tmp_path
):
    for folder, seed in (("a", 0), ("b", 1)):
        (tmp_path / folder).mkdir()
        for path in WRITERS["miniseed"](tmp_path / folder, shaking(seed=seed), response=None):
            stream = obspy.read(str(path))
            stream[0].stats.starttime += 3600 * hours_later * seed
            stream.write(str(path), format="MSEED")
    outcome = imported(tmp_path, ("Testquake", "Testquake"), unit="5e-6 m/s2")
    assert len(outcome.records) == records
