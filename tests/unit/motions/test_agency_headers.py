"""Agencies' headers are read without pedantry: other cases, blanks and marks are the same record."""

import pytest
from motion_samples import STEP_S, WRITERS, imported, only, shaking
from refusals import left_out, refused

from toppling.models.motions.formats import read_file

SAME = [
    ("cosmos_v2", "Format= (10I8)", "Format = (10I8)"),
    ("cosmos_v2", "Format= (6F13.6)", "format =( 6f13.6)"),
    ("cosmos_v2", "End-of-data for Chan", "/& --- End of data for channel"),
    ("cosmos_v2", "End-of-data for Chan", "  End of data, channel"),
    ("cosmos_v2", "Sta Chan  1:", "Sta Cha:  1:"),
    ("cosmos_v2", "Sta Chan  1:", "Sta Chan   ?:"),
    ("cosmos_v2", "units=cm/sec2(04)", "units = cm/sec/sec (04)"),
    ("cosmos_v2", '\n|<SCNL>', '\n | <SCNL>'),
    ("cosmos_v1", "units=g.     (02)", "units=G (02)"),
    ("csmip_v2", ", in cm/sec2. (8f10.5)", ".  (UNITS: CM/SEC/SEC)"),
    ("csmip_v2", ", in cm/sec2. (8f10.5)", ", in GAL"),
    ("csmip_v1", "(UNITS: G)", "(UNITS: g) (8F9.6)"),
    ("esm", "DATA_TYPE: ACCELERATION", "data_type: Acceleration "),
    ("esm", "UNITS: cm/s^2", "Units: CM/S**2"),
    ("esm", "UNITS: cm/s^2", "UNITS: Gal"),
    ("esm", "EVENT_NAME: TEST", "Event_Name : TEST"),
    ("esm", "SAMPLING_INTERVAL_S: 0.010000", "SAMPLING_INTERVAL_S: 0,01"),
    ("esm", "USER20:\nUSER21:\n", ""),
    ("unam", "Gal (cm/s/s)", "cm/s/s"),
    ("unam", "Gal (cm/s/s)", "GALS"),
    ("unam", "DATOS DE ACELERACION:", "DATOS DE ACELERACION"),
    ("unam", "ARCHIVO ESTANDAR DE ACELERACION", "Archivo Estandar de Aceleracion"),
    ("unam", "V N00E N90E\n", "V N00E N90E\n\n"),
    ("peer", "IN UNITS OF G", "IN UNITS OF G. FILTER POINTS: HP=0.1 Hz LP=20.0 Hz"),
    ("peer", "PEER NGA STRONG MOTION DATABASE RECORD", "PEER NGA-SUB RECORD"),
    ("peer", "PEER NGA STRONG MOTION DATABASE RECORD\n", ""),
    ("peer", "PEER NGA STRONG MOTION DATABASE RECORD", "\nPEER NGA STRONG MOTION DATABASE RECORD"),
    ("peer", "\nACCELERATION", "\nFILTER HP=0.1 LP=20\nACCELERATION"),
    ("peer", "NPTS=    400, DT=   .0100 SEC,", "NPTS: 400, DT: 0.01"),
    ("peer", "NPTS=    400, DT=   .0100 SEC,", "DT= 1.000D-02 SEC, NPTS=400"),
    ("peer", "NPTS=    400, DT=   .0100 SEC,", "NPTS= 400, DT= ,0100 SEC"),
    ("peer", "NPTS=    400, DT=   .0100 SEC,", "   400   .0100"),
    ("peer", "NPTS=    400, DT=   .0100 SEC,", "NPTS= 400, DT= .01\n"),
    ("knet", "(gal)/", "(GAL)/"),
    ("geonet_v1a", "in units of 1.00 mm/s/s", "in units of 0.10 gal"),
]  # fmt: skip


def replaced(folder, old: str, new: str) -> None:
    changed = 0
    for path in folder.iterdir():
        text = path.read_text()
        changed += text.count(old)
        path.write_text(text.replace(old, new))
    assert changed


@pytest.mark.parametrize(("name", "old", "new"), SAME)
def test_a_header_written_otherwise_is_the_same_record(name, old, new, tmp_path):
    WRITERS[name](tmp_path, shaking())
    (expected,) = imported(tmp_path).records
    replaced(tmp_path, old, new)
    record = only(imported(tmp_path))
    assert record.sha == expected.sha


@pytest.mark.parametrize(
    ("name", "old", "new", "code", "named"),
    [
        ("cosmos_v2", "units=cm/sec2(04)", "units=g (04)", "record.unit_contradicted", "'g'"),
        ("cosmos_v2", "units=cm/sec2(04)", "units=cm/sec(05)", "record.unit_unknown", "'cm/sec'"),
        ("csmip_v2", "in cm/sec2.", "in cm/sec. ", "record.header_unreadable", "cm/sec."),
        ("esm", "DATA_TYPE: ACCELERATION", "DATA_TYPE: Velocity", "record.not_acceleration", "Velocity"),
        ("esm", "UNITS: cm/s^2", "UNITS: cm/s", "record.unit_unknown", "'cm/s'"),
        ("unam", "Gal (cm/s/s)", "Pa", "record.unit_unknown", "'Pa'"),
        (
            "geonet_v1a",
            "in units of 1.00 mm/s/s",
            "in units of 1.00 mm/s",
            "record.unit_unknown",
            "'1.00 mm/s'",
        ),
        ("peer", "IN UNITS OF G", "IN UNITS OF CM", "record.not_acceleration", "IN UNITS OF CM"),
        ("knet", "(gal)/", "(g)/", "record.unit_unknown", "gal"),
    ],
)
def test_a_header_of_another_quantity_or_unit_is_refused_by_its_name(name, old, new, code, named, tmp_path):
    WRITERS[name](tmp_path, shaking())
    replaced(tmp_path, old, new)
    outcome = imported(tmp_path)
    assert not outcome.records
    left_out(outcome, code, named)


@pytest.mark.parametrize(
    ("label", "direction"),
    [("BHZ00", "up"), ("HHZ.10", "up"), ("HNZ--", "up"), ("EHZ", "up"), ("BHE00", 90.0), ("HNN10", 0.0),
     ("BH100", None), ("HN200", None), ("045", 45.0), ("UP", "up")],
)  # fmt: skip
def test_labels_of_peer_may_be_channel_codes_and_locations(label, direction, tmp_path):
    path = WRITERS["peer"](tmp_path, shaking())[0]
    path.write_text(
        path.read_text().replace("Testquake, 1/2/2003, Station, 090", f"Q11-10-20, 10/20/2011, CCM, {label}")
    )
    (component,) = read_file(path)
    assert (component.event, component.station, component.direction) == ("Q11-10-20", "CCM", direction)


def test_horizontals_that_peer_only_numbers_are_one_record_with_their_vertical(tmp_path):
    codes = {"090": "BH100", "000": "BH200", "UP": "BHZ00"}
    for path, (label, code) in zip(WRITERS["peer"](tmp_path, shaking()), codes.items(), strict=True):
        text = path.read_text().replace(
            f"Testquake, 1/2/2003, Station, {label}", f"Q, 10/20/2011, CCM, {code}"
        )
        path.write_text(text)
        path.rename(tmp_path / f"RSN9_Q_XX.CCM.{code[:3]}.00.AT2")
    (record,) = imported(tmp_path).records
    assert record.station == "CCM"
    assert not record.north_known


ORIGIN = "TESTQUAKE\nJANUARY 17, 1994 04:31 PST\n14403"


@pytest.mark.parametrize(
    ("name", "old", "new", "event"),
    [
        ("csmip_v1", ORIGIN, ORIGIN, "TESTQUAKE, JANUARY 17, 1994 04:31 PST"),
        ("csmip_v1", ORIGIN, "Rcrd of Fri Mar 5, 2021 20:19:31.0 PDT\nRAW\n14403", "Fri Mar 5, 2021 20:19:31.0 PDT"),
        ("csmip_v2", "Rcrd of Tue Dec 20, 2022", "Rcrd of Tue Dec 20, 2022 02:34 PST", "Tue Dec 20, 2022 02:34 PST"),
        ("pairs_v1", "TESTQUAKE\nJANUARY 17, 1994 04:31 PST", "FARQUAKE 2010\n", "FARQUAKE 2010"),
        ("bhrc", "Origin Time : 2012/08/11   12:23:16", "Origin Time : 2013/09/12   1:02:03", "2013/09/12 1:02:03"),
        ("smc", "     1989  10  18    0004 Testquake, CA", "     1990  11  19    0105 Q, CA", "Q, CA, 1990-11-19 0105"),
        ("unam", "2017/09/19", "2018/10/20", "2018/10/20 18:14:40"),
        ("cosmos_v2", "Record of Testquake", "Rcrd of Farquake", "Farquake of Tue Aug 28, 2018"),
    ],
)  # fmt: skip
def test_headers_name_the_event_and_its_origin(name, old, new, event, tmp_path):
    WRITERS[name](tmp_path, shaking())
    replaced(tmp_path, old, new)
    assert {part.event for path in tmp_path.iterdir() for part in read_file(path)} == {event}


def test_pairs_of_usc_are_known_by_their_station_and_the_counts_behind_its_lines_are_no_words(tmp_path):
    (path,) = WRITERS["pairs_v1"](tmp_path, shaking())
    replaced(tmp_path, "UNIVERSIDAD DE CHILE - RENADIC", "TESTQUAKE   JAN 17, 1994 -1230 GMT")
    replaced(tmp_path, "STATION NO. 14403", "STATION USC# 0016")
    replaced(tmp_path, ORIGIN[:-6], f"{'TESTQUAKE':72}21\n{'JAN 17, 1994 -1230 GMT':72}22")
    found = read_file(path)
    assert {(part.file_format, part.event) for part in found} == {
        ("USC V1", "TESTQUAKE, JAN 17, 1994 -1230 GMT")
    }
    assert {part.time_step_s for part in found} == {STEP_S}


def test_pairs_of_smc_are_refused_by_what_they_are(tmp_path):
    path = WRITERS["smc"](tmp_path, shaking())[0]
    lines = path.read_text().splitlines(keepends=True)
    lines[17] = lines[17][:15] + f"{1.7e38:15.7E}" + lines[17][30:]
    path.write_text("".join(lines))
    with refused("record.step_missing"):
        read_file(path)


def test_uneven_pairs_of_a_volume_1_are_interpolated_and_those_that_go_back_refused(tmp_path):
    path = WRITERS["pairs_v1"](tmp_path, shaking())[0]
    lines = path.read_text().splitlines(keepends=True)
    first = next(n for n, line in enumerate(lines) if n >= 27)
    late = lines.copy()
    for place in range(first, first + 40):  # every second pair of a line three milliseconds late
        pairs = [late[place][i : i + 14] for i in range(0, len(late[place].rstrip()), 14)]
        times = [f"{float(pair[:7]) + 3e-3 * (number % 2):7.3f}" for number, pair in enumerate(pairs)]
        late[place] = "".join(time + pair[7:14] for time, pair in zip(times, pairs, strict=True)) + "\n"
    path.write_text("".join(late))
    component = read_file(path)[0]
    assert component.time_step_s == 0.005
    assert any("uneven times" in note for note in component.notes)
    lines[first + 5], lines[first + 6] = lines[first + 6], lines[first + 5]
    path.write_text("".join(lines))
    with refused("record.step_uneven"):
        read_file(path)


@pytest.mark.parametrize(
    ("lost", "code"),
    [(range(100, 101), "record.step_uneven"), (range(150, 170), "record.count_contradicted")],
)
def test_a_row_that_cwbs_times_miss_is_refused(lost, code, tmp_path):
    (path,) = WRITERS["cwb"](tmp_path, shaking())
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(line for place, line in enumerate(lines) if place not in lost))
    with refused(code):
        read_file(path)


def test_samples_that_no_header_counts_are_read_and_told(tmp_path):
    for path in WRITERS["peer"](tmp_path, shaking()):
        path.write_text(path.read_text().replace("NPTS=    400, ", ""))
    outcome = imported(tmp_path)
    assert len(outcome.records) == 1
    assert "no NPTS" in outcome.warnings[0][1]


def test_numbers_of_full_columns_are_parted_before_their_signs(tmp_path):
    a = shaking()
    for width, folder in ((15, tmp_path / "apart"), (13, tmp_path / "glued")):
        folder.mkdir()
        for path in WRITERS["peer"](folder, a):
            lines = path.read_text().splitlines()
            numbers = " ".join(lines[4:]).split()
            rows = ["".join(f"{float(x):{width}.6E}" for x in numbers[i : i + 5]) for i in range(0, 400, 5)]
            path.write_text("\n".join([*lines[:4], *rows]) + "\n")
    assert "E-01-" in (tmp_path / "glued" / "RSN9_TEST_STA090.AT2").read_text()
    (apart,), (glued,) = (imported(tmp_path / name).records for name in ("apart", "glued"))
    assert apart.sha == glued.sha


@pytest.mark.parametrize(
    ("content", "what", "remedy"),
    [
        (b"PK\x03\x04" + b"\0" * 30 + b"[Content_Types].xml", "a spreadsheet", "CSV"),
        (b"PK\x03\x04" + b"\0" * 30 + b"RSN9.AT2", "a packed archive", "unpack"),
        (b"\x1f\x8b\x08" + bytes(range(200)), "a packed archive", "unpack"),
        (b"\x89HDF\r\n\x1a\n" + b"\0" * 100, "a file of arrays", "text"),
        (b"MATLAB 5.0 MAT-file" + b"\0" * 200, "a file of arrays", "text"),
        (b"<!DOCTYPE html>\n<html><body>Please log in</body></html>\n" * 9, "a web page", "fetch"),
        (b'{"dt": 0.005, "acceleration": [0.1, 0.2]}\n', "JSON", "text"),
    ],
)
def test_what_is_no_record_is_refused_by_what_it_is(content, what, remedy, tmp_path):
    path = tmp_path / "record.AT2"
    path.write_bytes(content)
    with refused("record.format_not_read", what, remedy):
        read_file(path)
