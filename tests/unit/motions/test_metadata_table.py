"""A metadata table is used, or it is said what of it is not; it does not contradict the files' own headers."""

import pytest
from motion_samples import WRITERS, imported, shaking, tabled
from refusals import left_out, refused, states

from toppling.models.motions.metadata import read_table

ENTRIES = {
    "no azimuth, corner, magnitude or distance": ("h1,h2,v\na,b,c", {}),
    **{
        f"unknown is {unknown!r}": (f"h1,h2,mag,dist_km\na,b,{unknown},{unknown}", {})
        for unknown in ("-999", "-999.0", "NA", "n/a", "?", "nan", "")
    },
    **{
        names: (f"h1,h2,{names}\na,b,6.9,12.5", {"magnitude": 6.9, "distance_km": 12.5})
        for names in ("Mag (Mw),Dist (km)", "Mw,Rrup [km]", "magnitude,epicentral distance (km)")
    },
    "a remark among the rows": ("h1,h2,mag\n# of the first network\na,b,6.9", {"magnitude": 6.9}),
    "an end of line between quotes": ('h1,h2,event\na,b,"Kobe\nJapan"', {"event": "Kobe\nJapan"}),
    **{
        azimuths: (f"h1,h2,h1_azimuth,h2_azimuth\na,b,{azimuths}", {"h1_azimuth_deg": 90.0, "h2_azimuth_deg": 0.0})
        for azimuths in ("90,0", "N90E,north", "E,NS")
    },
    "PEER's search results": (
        " PEER Ground Motion Database\n Search ID:, 1\n\n\n -- Summary of Metadata of Selected Records -- \n"
        " Result ID, Earthquake Name, Year, Station Name, Magnitude, Rjb (km), Rrup (km), Horizontal-1 Acc. Filename,"
        " Horizontal-2 Acc. Filename, Vertical Acc. Filename\n"
        ' 1, "Kobe, Japan", 1995, "KJMA", 6.9, .9, 1.0,  a,  b,  c\n\nThese records are unscaled\n',
        {"event": "Kobe, Japan", "station": "KJMA", "magnitude": 6.9, "distance_km": 1.0, "names": ("a", "b", "c")},
    ),
    "capitals and blanks": ("H1, H2, Units\na, b, gal", {"unit_m_s2": 0.01}),
}  # fmt: skip
"""Tables of one row, and what it states: all else is unknown."""
UNKNOWN = {
    "h1_azimuth_deg": None, "h2_azimuth_deg": None, "corner_hz": None, "magnitude": None, "distance_km": None,
}  # fmt: skip

REFUSED = {
    **{
        f"{column} {cell}": (f"h1,h2,v,{column}\na,b,c,{cell}", "metadata.value_unreadable", name, "table.csv:2")
        for column, name, cell in (
            ("h1_azimuth", "h1_azimuth", "400"), ("h2_azimuth", "h2_azimuth", "-1000"),
            ("corner_hz", "corner_hz", "-0.1"),
            ("mag", "magnitude", '"1,234"'), ("mag", "magnitude", "69"),
            ("mag", "magnitude", "six"), ("dist_km", "distance_km", "1e5"), ("dist_km", "distance_km", "-3"),
        )
    },
    "a zero": ("h1,h2,v\na,b,c\na\0,b,c", "file.holds_zeros", "table.csv:3"),
    "no row": ("h1,h2,v", "metadata.no_row", "table.csv"),
    "a furlong": ("h1,h2,v,unit\na,b,c,furlong", "record.unit_unknown", "'furlong'", "table.csv:2"),
    "no file": ("h1,h2,v\n,b,c", "metadata.file_missing", "h1", "table.csv:2"),
    "processing": ("h1,h2,v,processing\na,b,c,Vol.2", "metadata.processing_unknown", "'Vol.2'", "table.csv:2"),
}  # fmt: skip
"""Tables that are refused: the code, and what is named."""


def written(folder, text):
    (folder / "table.csv").write_text(text + "\n", encoding="utf-8")
    return folder / "table.csv"


@pytest.mark.parametrize(("text", "stated"), ENTRIES.values(), ids=ENTRIES)
def test_a_row_states_what_its_cells_contain_and_nothing_else(text, stated, tmp_path):
    (entry,) = read_table(written(tmp_path, text))
    assert {name: getattr(entry, name) for name in UNKNOWN | stated} == UNKNOWN | stated


@pytest.mark.parametrize(("text", "code", "named"), [(t, c, n) for t, c, *n in REFUSED.values()], ids=REFUSED)
def test_what_no_record_has_is_refused_with_its_line(text, code, named, tmp_path):
    with refused(code, *named):
        read_table(written(tmp_path, text))


def with_rows(folder, *rows):
    written(folder, "\n".join(["rec_id,h1,h2,v", *rows]))
    return imported(folder)


def with_columns(folder, names, values):
    tabled(WRITERS["peer"](folder, shaking()), **{names: values})
    return imported(folder)


@pytest.mark.parametrize("name", ["in/x090.AT2", "x" * 300, "é" * 200, "/".join(["x" * 200] * 20)])
def test_a_table_none_of_whose_rows_names_a_file_is_refused_with_the_path_it_looks_for(tmp_path, name):
    WRITERS["peer"](tmp_path, shaking())
    with refused("metadata.no_file_given", "2 rows", f"{tmp_path}/{name[:200]}", "table.csv:2", "its path"):
        with_rows(tmp_path, f"A,{name},in/x000.AT2,in/xUP.AT2", "B,in/y090.AT2,in/y000.AT2,in/yUP.AT2")


@pytest.mark.parametrize("adjacent", ["", "in\\"])
def test_rows_that_name_no_file_given_are_counted_and_paths_of_windows_are_those_of_the_files(
    adjacent, tmp_path
):
    folder = tmp_path / adjacent.rstrip("\\")
    folder.mkdir(exist_ok=True)
    names = ",".join(adjacent + path.name for path in WRITERS["peer"](folder, shaking()))
    outcome = with_rows(tmp_path, f"A,{names}", "B,x,y,z", "C,x,y,z")
    assert [record.record_id for record in outcome.records] == ["A"]
    assert outcome.unused_rows == 2


@pytest.mark.parametrize(
    ("order", "label", "named"),
    [((2, 1, 0), "UP", "column h1"), ((0, 2, 1), "UP", "column h2"), ((2, 1, 0), "L", "column v")],
)
def test_a_row_that_contradicts_the_headers_direction_is_refused(order, label, named, tmp_path):
    paths = WRITERS["peer"](tmp_path, shaking())
    paths[2].write_text(paths[2].read_text().replace("Station, UP", f"Station, {label}"))
    outcome = with_rows(tmp_path, ",".join(("A", *(paths[place].name for place in order))))
    assert not outcome.records
    states(str(outcome.refusals[0].reason), "metadata.direction_contradicted", named, "table.csv:2")


@pytest.mark.parametrize(
    ("names", "right", "wrong", "code", "named"),
    [
        ("dt", "0.01", "0.1", "record.step_contradicted", ("0.1 s", "0.01 s", "table.csv:2")),
        ("unit", "g", "cm/s2", "record.unit_contradicted", ("0.01 m/s2", "9.80665 m/s2")),
    ],
)
def test_a_row_that_contradicts_its_file_is_refused_with_its_row(names, right, wrong, code, named, tmp_path):
    left_out(with_columns(tmp_path, names, wrong), code, *named)
    assert len(with_columns(tmp_path, names, right).records) == 1
