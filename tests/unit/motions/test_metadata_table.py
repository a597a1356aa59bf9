"""A metadata table is used, or it is said what of it is not; it does not contradict the files' own headers."""

import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from motion_samples import WRITERS, shaking
from refusals import left_out, refused, tells

from toppling.models.motions.importing import import_records, record_files
from toppling.models.motions.metadata import looks_like_table, read_table


def with_rows(folder: Path, *rows: str):
    (folder / "table.csv").write_text("\n".join(["rec_id,h1,h2,v", *rows]) + "\n")
    return import_records(record_files([folder]), read_table(folder / "table.csv"))


def test_a_table_none_of_whose_rows_names_a_file_is_refused_with_the_path_it_looks_for(tmp_path):
    WRITERS["peer"](tmp_path, shaking())
    looked_for = tmp_path / "in" / "x090.AT2"
    with refused(
        "metadata.no_file_given", "2 rows", looked_for, f"{tmp_path / 'table.csv'}:2", "correct the paths"
    ):
        with_rows(tmp_path, "A,in/x090.AT2,in/x000.AT2,in/xUP.AT2", "B,in/y090.AT2,in/y000.AT2,in/yUP.AT2")


def test_a_table_of_files_that_are_there_but_not_given_is_refused_with_the_remedy_to_give_them(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        WRITERS["peer"](tmp_path / name, shaking())
    names = [f"a/{path.name}" for path in sorted((tmp_path / "a").iterdir())]
    (tmp_path / "table.csv").write_text("h1,h2,v\n" + ",".join(names) + "\n")
    with refused("metadata.no_file_given", "1 rows", "give this file"):
        import_records(record_files([tmp_path / "b"]), read_table(tmp_path / "table.csv"))


def test_rows_that_name_no_file_given_are_counted(tmp_path):
    east, north, up = (path.name for path in WRITERS["peer"](tmp_path, shaking()))
    outcome = with_rows(tmp_path, f"A,{east},{north},{up}", "B,x,y,z", "C,x,y,z")
    assert [record.record_id for record in outcome.records] == ["A"]
    assert outcome.unused_rows == 2


def test_paths_of_windows_are_those_of_the_files_that_are_there(tmp_path):
    (tmp_path / "in").mkdir()
    east, north, up = (path.name for path in WRITERS["peer"](tmp_path / "in", shaking()))
    outcome = with_rows(tmp_path, f"A,in\\{east},in\\{north},in\\{up}")
    assert [record.record_id for record in outcome.records] == ["A"]


def test_a_table_without_rows_is_refused(tmp_path):
    WRITERS["peer"](tmp_path, shaking())
    with refused("metadata.no_row", tmp_path / "table.csv"):
        with_rows(tmp_path)


@pytest.mark.parametrize(("order", "column"), [((2, 1, 0), "h1"), ((0, 2, 1), "h2")])
def test_a_row_that_contradicts_the_headers_direction_is_refused(order, column, tmp_path):
    paths = WRITERS["peer"](tmp_path, shaking())
    outcome = with_rows(tmp_path, ",".join(("A", *(paths[place].name for place in order))))
    assert not outcome.records
    tells(str(outcome.refusals[0].reason), "metadata.direction_contradicted", column, "table.csv:2")


def test_a_horizontal_as_vertical_is_refused(tmp_path):
    paths = WRITERS["peer"](tmp_path, shaking())
    unlabelled = paths[2].read_text().replace("Station, UP", "Station, L")
    paths[2].write_text(unlabelled)
    outcome = with_rows(tmp_path, f"A,{paths[2].name},{paths[1].name},{paths[0].name}")
    assert not outcome.records
    tells(str(outcome.refusals[0].reason), "metadata.direction_contradicted", "column v", "90 degrees")


@pytest.mark.parametrize("delimiter", [";", "\t"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_a_table_of_a_spreadsheet_with_decimal_commas_is_read(delimiter, encoding, tmp_path):
    rows = [
        ["h1", "h2", "v", "unit", "mag", "dt", "event"],
        ["a, east", "b", "c", "0,5 gal", "6,5", "0,005", "Michoac\u00e1n, 1985"],
    ]
    content = "\r\n".join(delimiter.join(row) for row in rows) + "\r\n\x1a\x1a"
    (tmp_path / "table.csv").write_bytes(content.encode(encoding))
    (entry,) = read_table(tmp_path / "table.csv")
    assert (entry.magnitude, entry.time_step_s, entry.unit_m_s2) == (6.5, 0.005, pytest.approx(0.005))
    assert (entry.files[0].name, entry.event) == ("a, east", "Michoac\u00e1n, 1985")
    assert looks_like_table(tmp_path / "table.csv")


@given(
    st.sampled_from(["h1_azimuth", "h2_azimuth", "corner_hz", "mag", "dist_km"]),
    st.sampled_from(["-999", "-9999.0", "-12345", "unknown", "n/a", "-"]),
)
def test_what_flat_files_have_for_unknown_is_no_azimuth_corner_magnitude_or_distance(
    tmp_path_factory, column, cell
):
    table = tmp_path_factory.mktemp("flat") / "table.csv"
    table.write_text(f"h1,h2,v,{column}\na,b,c,{cell}\n")
    (entry,) = read_table(table)
    assert {
        entry.h1_azimuth_deg,
        entry.h2_azimuth_deg,
        entry.corner_hz,
        entry.magnitude,
        entry.distance_km,
    } == {None}


@pytest.mark.parametrize(
    ("column", "cell"), [("h1_azimuth", "400"), ("h2_azimuth", "-1000"), ("corner_hz", "-0.1")]
)
def test_a_number_that_is_no_azimuth_or_corner_is_refused(tmp_path, column, cell):
    (tmp_path / "table.csv").write_text(f"h1,h2,v,{column}\na,b,c,{cell}\n")
    with refused("metadata.value_unreadable", column, cell):
        read_table(tmp_path / "table.csv")


@pytest.mark.parametrize("number", ['"1,234"', '"6,5"'])
def test_a_comma_in_a_number_of_a_table_with_commas_is_refused(number, tmp_path):
    (tmp_path / "table.csv").write_text(f"h1,h2,v,mag\na,b,c,{number}\n")
    with refused("metadata.value_unreadable", "magnitude"):
        read_table(tmp_path / "table.csv")


def test_a_zero_byte_within_a_table_is_refused_with_its_line(tmp_path):
    (tmp_path / "table.csv").write_bytes(b"h1,h2,v\na,b,c\na\0,b,c\n")
    with refused("file.holds_zeros", "table.csv:3"):
        read_table(tmp_path / "table.csv")


@pytest.mark.parametrize("name", ["x" * 300, "é" * 200, "/".join(["x" * 200] * 20)])
def test_a_file_name_that_no_file_system_has_is_refused_with_its_line(name, tmp_path):
    (tmp_path / "table.csv").write_text(f"h1,h2,v\na,{name},c\n", encoding="utf-8")
    with refused("metadata.path_too_long", "table.csv:2", "h2"):
        read_table(tmp_path / "table.csv")


def test_a_time_step_of_the_row_that_contradicts_the_file_is_refused_with_its_row(tmp_path):
    WRITERS["columns"](tmp_path, shaking())
    table = tmp_path / "table.csv"
    header, row = table.read_text().splitlines()
    for step_s, read in ((0.01, True), (0.1, False)):
        table.write_text(f"{header},dt\n{row},{step_s:g}\n")
        outcome = import_records(record_files([tmp_path]), read_table(table))
        assert bool(outcome.records) is read
    tells(str(outcome.refusals[0].reason), "record.step_contradicted", "0.1 s", "0.01 s", f"{table}:2")


def test_azimuths_of_the_table_may_be_compass_letters(tmp_path):
    WRITERS["columns"](tmp_path, shaking())
    table = tmp_path / "table.csv"
    header, row = table.read_text().splitlines()
    found = []
    for first, second in (("90", "0"), ("E", "NS"), ("N90E", "north")):
        table.write_text(f"{header},h1_azimuth,h2_azimuth\n{row},{first},{second}\n")
        found.append(import_records(record_files([tmp_path]), read_table(table)).records[0].sha)
    assert len(set(found)) == 1


def test_names_of_the_tables_columns_are_read_in_any_case(tmp_path):
    WRITERS["one_column"](tmp_path, shaking())
    table = tmp_path / "table.csv"
    (expected,) = import_records(record_files([tmp_path]), read_table(table)).records
    header, row = table.read_text().splitlines()
    table.write_text(f"{header.upper().replace('UNIT', 'Units').replace(',', ', ')}\n{row}\n")
    assert table not in record_files([tmp_path])
    (record,) = import_records(record_files([tmp_path]), read_table(table)).records
    assert record.sha == expected.sha


def with_columns(folder: Path, names: str, values: str):
    """One record with more columns in its row."""
    east, north, up = (path.name for path in WRITERS["peer"](folder, shaking()))
    (folder / "table.csv").write_text(f"rec_id,h1,h2,v,{names}\nA,{east},{north},{up},{values}\n")
    return import_records(record_files([folder]), read_table(folder / "table.csv"))


@pytest.mark.parametrize("unknown", ["-999", "-999.0", "NA", "n/a", "?", "nan", ""])
def test_what_nobody_knows_is_no_magnitude_and_no_distance(unknown, tmp_path):
    (record,) = with_columns(tmp_path, "mag,dist_km", f"{unknown},{unknown}").records
    assert record.magnitude is None
    assert record.distance_km is None


def test_magnitude_and_distance_may_have_their_words(tmp_path):
    (record,) = with_columns(tmp_path, "mag,dist_km", "Mw 6.9,12.5 km").records
    assert (record.magnitude, record.distance_km) == (6.9, 12.5)


@pytest.mark.parametrize("value", ["69,10", "6.9,1e5", "6.9,-3"])
def test_no_earthquake_and_no_place_on_the_globe_is_refused(value, tmp_path):
    with refused("metadata.value_unreadable"):
        with_columns(tmp_path, "mag,dist_km", value)


@pytest.mark.parametrize(("second", "told"), [("0", False), ("8", False), ("45", True), ("180", False)])
def test_horizontals_that_are_not_across_each_other_are_told(second, told, tmp_path):
    outcome = with_columns(tmp_path, "h1_azimuth,h2_azimuth", f"90,{second}")
    assert any("45 degrees apart, not 90" in text for _, text in outcome.warnings) == told


def test_a_unit_of_the_table_that_contradicts_an_agencys_header_is_refused(tmp_path):
    left_out(with_columns(tmp_path, "unit", "cm/s2"), "record.unit_contradicted", "0.01 m/s2", "9.80665 m/s2")
    assert len(with_columns(tmp_path, "unit", "g").records) == 1


@pytest.mark.parametrize(
    "names", ["Mag (Mw),Dist (km)", "Mw,Rrup [km]", "magnitude,epicentral distance (km)"]
)
def test_magnitude_and_distance_may_be_named_with_their_units(names, tmp_path):
    (record,) = with_columns(tmp_path, names, "6.9,12.5").records
    assert (record.magnitude, record.distance_km) == (6.9, 12.5)


def test_a_remark_among_the_rows_is_no_record(tmp_path):
    with_columns(tmp_path, "mag", "6.9")
    table = tmp_path / "table.csv"
    head, row = table.read_text().splitlines()
    table.write_text(f"{head}\n# of the first network\n{row}\n")
    assert len(read_table(table)) == 1


def test_a_cell_between_quotes_keeps_its_ends_of_lines(tmp_path):
    (tmp_path / "table.csv").write_text('h1,h2,event\na,b,"Kobe\nJapan"\n')
    assert [entry.event for entry in read_table(tmp_path / "table.csv")] == ["Kobe\nJapan"]


def test_blanks_without_end_in_a_magnitude_are_looked_at_once(tmp_path):
    """By the square of their number, minutes."""
    (tmp_path / "table.csv").write_text(f"h1,h2,mag\na,b,6{' ' * 100_000}x\n")
    start = time.process_time()
    with refused("metadata.value_unreadable", "mag"):
        read_table(tmp_path / "table.csv")
    assert time.process_time() - start < 5


def test_a_folder_without_a_record_says_what_it_holds(tmp_path):
    (tmp_path / "a.parquet").write_bytes(b"PAR1")
    (tmp_path / "b.parquet").write_bytes(b"PAR1")
    with refused("record.none_found", "2 of .parquet"):
        record_files([tmp_path])
