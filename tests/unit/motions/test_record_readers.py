"""Readers give back what was written, in any encoding and spelling, and refuses contradictions and lost rows."""

import gzip
import re
from pathlib import Path

import numpy as np
import obspy
import pytest
from motion_samples import COUNT, STEP_S, WRITERS, edited, imported, only, sac, shaking
from refusals import left_out, refused, states

from toppling.models.motions.formats import read_file
from toppling.models.motions.formats.component import bearing
from toppling.models.motions.importing import ImportOptions, import_records
from toppling.models.motions.metadata import read_table
from toppling.models.motions.quality import warnings_of

# what each format's printing rounds off, m/s2: half of its last digit
ROUNDING = {
    "pairs_v1": 5e-4, "geonet_v2a": 5e-5, "geonet_v1a": 5e-5, "cwb": 5e-6, "smc": 5e-5, "miniseed": 3e-6,
    "knet": 2e-6,
}  # fmt: skip
RAW = {"csmip_v1", "pairs_v1", "bhrc", "cosmos_v1", "geonet_v1a", "unam", "cwb", "knet", "miniseed", "sac"}


@pytest.mark.parametrize("name", WRITERS)
def test_a_motion_comes_back_from_every_format_as_it_was_written(name, tmp_path):
    a = shaking()
    WRITERS[name](tmp_path, a)
    record = only(imported(tmp_path))
    motion = record.motion
    assert motion.time_step_s == pytest.approx(STEP_S, rel=1e-9)
    assert len(motion.acceleration_m_s2) == COUNT
    expected = a
    if name == "bhrc":  # written along 352 and 82 degrees
        turn = np.deg2rad([90 - 352, 90 - 82])
        expected = a.copy()
        expected[:, :2] = a[:, :2] @ np.column_stack([np.cos(turn), np.sin(turn)]).T
    assert np.abs(motion.acceleration_m_s2 - expected).max() <= 1.5 * ROUNDING.get(name, 1e-5) + 1e-5
    assert record.north_known is (name != "pairs_v1")
    (record,) = imported(tmp_path, process=None).records
    assert any("high-pass" in step for step in record.history) is (name in RAW)
    assert (record.quality == "corrected") is (name not in RAW)


@pytest.mark.parametrize("name", WRITERS)
def test_a_truncated_file_is_refused_and_named(name, tmp_path):
    victim = next(path for path in WRITERS[name](tmp_path, shaking()) if path.suffix != ".xml")
    content = victim.read_bytes()
    victim.write_bytes(content[: int(0.7 * len(content))])
    outcome = imported(tmp_path)
    assert not outcome.records
    assert any(str(victim) in refusal.reason.where for refusal in outcome.refusals)


SAME = [
    ("cosmos_v2", "Format= (6F13.6)", "format =( 6f13.6)"),
    ("cosmos_v2", "End-of-data for Chan", "  End of data, channel"),
    ("cosmos_v2", "Sta Chan  1:", "Sta Cha:  1:"),
    ("cosmos_v2", "units=cm/sec2(04)", "units = cm/sec/sec (04)"),
    ("cosmos_v2", '\n|<SCNL>', '\n | <SCNL>'),
    ("cosmos_v1", "units=g.     (02)", "units=G (02)"),
    ("csmip_v2", ", in cm/sec2. (8f10.5)", ".  (UNITS: CM/SEC/SEC)"),
    ("esm", "UNITS: cm/s^2", "Units: CM/S**2"),
    ("esm", "SAMPLING_INTERVAL_S: 0.010000", "SAMPLING_INTERVAL_S: 0,01"),
    ("cosmos_v2", "90 deg", "HNE"),
    ("csmip_v1", "360 DEG", "N-S"),
    ("esm", "USER20:\nUSER21:\n", ""),
    ("unam", "Gal (cm/s/s)", "GALS"),
    ("unam", "V N00E N90E\n", "V N00E N90E\n\n"),
    ("peer", "PEER NGA STRONG MOTION DATABASE RECORD\n", ""),
    ("peer", "\nACCELERATION", "\nFILTER HP=0.1 LP=20\nACCELERATION"),
    ("peer", "NPTS=    400, DT=   .0100 SEC,", "DT= 1.000D-02 SEC, NPTS=400"),
    ("peer", "NPTS=    400, DT=   .0100 SEC,", "   400   .0100"),
    ("peer", "DT=   .0100 SEC", "DT=   10.0 MSEC"),
    ("bhrc", "DURATION =  4.000", "DURATION =  3.990"),
    ("cwb", "gal. DCoffset(corr)", "cm/s/s"),
    ("geonet_v2a", "Component N28W", "component N 28 W  Longitudinal Axis"),
    ("peer", "NPTS=    400, DT=   .0100 SEC,", "  400 .0100 NPTS, DT"),
    ("peer", "TIME SERIES", "TIME HISTORY"),
    ("knet", "(gal)/", "(GAL)/"),
    ("geonet_v1a", "in units of 1.00 mm/s/s", "in units of 0.10 gal"),
    ("unam", "/M=7.1", "/Ms=7.3/Mw=7.1"),
]  # fmt: skip
"""Agencies' headers written otherwise: other cases, blanks and marks are the same record."""


@pytest.mark.parametrize(("name", "old", "new"), SAME)
def test_a_header_written_otherwise_is_the_same_record(name, old, new, tmp_path):
    for folder, changes in (("as it is", []), ("otherwise", [(old, new)])):
        (tmp_path / folder).mkdir()
        edited(tmp_path / folder, name, *changes)
    expected, found = (only(imported(tmp_path / folder)) for folder in ("as it is", "otherwise"))
    assert (found.sha, found.magnitude) == (expected.sha, expected.magnitude)


def test_cwbs_positive_senses_are_those_that_its_sequence_states(tmp_path):
    (path,) = edited(tmp_path, "cwb", ("U(+); N(+); E(+)", "U(-); N(+); E(-)"))
    found = {part.label: part.acceleration_m_s2 for part in read_file(path)}
    for sign, series, letter in zip((-1, 1, -1), shaking().T, "ENU", strict=True):
        np.testing.assert_allclose(found[letter], sign * series, atol=1e-4)


def lost(first, last):
    return lambda text: "".join(
        (lines := text.splitlines(keepends=True))[:first] + (lines[last:] if last else [])
    )


def line(number, change):
    """With one line changed; lines are counted from zero."""

    def changed(text):
        lines = text.splitlines()
        lines[number] = change(lines[number])
        return "\n".join(lines) + "\n"

    return changed


def nan(number, place):
    """With NaN for a number of a line, as wide."""

    def change(text):
        word = text.split()[place]
        return text.replace(word, "NaN".rjust(len(word)), 1)

    return line(number, change)


def rows_behind_the_end(text):
    numbers = [row for row in text.splitlines() if row.strip() and not re.search("[A-Za-z/]", row)]
    return text + "\n".join(numbers[-3:]) + "\n"


def truncated_number(text):
    return text[: text.rindex("E", 0, len(text) // 2) + 1]


def swapped(text):
    lines = text.splitlines(keepends=True)
    lines[32], lines[33] = lines[33], lines[32]
    return "".join(lines)


def counts_of_cosmos(gain):
    """Counts of a recorder of one volt a count and a sensor of one volt per g, before the gain."""

    def change(text):
        text = text.replace("units=g.     (02)", "units=counts(50)").replace(" g at ", " counts at ")
        lines = text.splitlines()
        for start in [i for i, entry in enumerate(lines) if "Real-header" in entry]:
            for number, value in ((22, 1e6), (42, 1.0), (47, gain)):
                at, place = start + 1 + (number - 1) // 6, 13 * ((number - 1) % 6)
                assert lines[at][place : place + 13] == f"{-999:13.6f}"
                lines[at] = f"{lines[at][:place]}{value:13.5f}{lines[at][place + 13 :]}"
        return "\n".join(lines) + "\n"

    return change


def peaks_in_other_units(pattern):
    """All peaks that a header states, as of samples in m/s2 that were printed in g."""

    def change(text):
        text, count = re.subn(pattern, lambda found: f"{found[1]}{float(found[2]) * 9.8:.3f}", text)
        assert count
        return text

    return change


STEP = "DT=   .0100"
REFUSED = {
    # another quantity or unit
    "COSMOS in cm/s": ("cosmos_v2", ("units=cm/sec2(04)", "units=cm/sec(05)"), "record.unit_unknown", "'cm/sec'"),
    "CSMIP in cm/s": ("csmip_v2", ("in cm/sec2.", "in cm/sec. "), "record.header_unreadable", "cm/sec."),
    "ESM of velocity": ("esm", (": ACCELERATION", ": Velocity"), "record.not_acceleration", "Velocity"),
    "GeoNet in mm/s": ("geonet_v1a", ("1.00 mm/s/s", "1.00 mm/s"), "record.unit_unknown", "'1.00 mm/s'"),
    "PEER in cm": ("peer", ("UNITS OF G", "UNITS OF CM"), "record.not_acceleration", "IN UNITS OF CM"),
    "K-NET in g": ("knet", ("(gal)/", "(g)/"), "record.unit_unknown", "gal"),
    **{
        f"COSMOS' gain {gain:g}": (
            "cosmos_v1", counts_of_cosmos(gain), "record.header_unreadable", "sensor gain (real header 47)", f"{gain:g}"
        )
        for gain in (0.0, -2.0)
    },
    # time steps and counts
    **{f"{s} s": ("peer", (STEP, f"DT= {s}"), "record.step_out_of_range") for s in ("1e308", "1e-300", "1e5")},
    "a step of 400 digits": ("peer", (STEP, f"DT= {'9' * 400}"), "record.header_unreadable"),
    "two steps": ("peer", lambda text: text.replace(".0100", ".0050", 1), "record.step_contradicted", "0.005 s"),
    "SMC of pairs": (
        "smc", line(17, lambda text: f"{text[:15]}{1.7e38:15.7E}{text[30:]}"), "record.step_missing"
    ),
    "pairs that go back": ("pairs_v1", swapped, "record.step_uneven"),
    "CWB lacks a row": ("cwb", lost(100, 101), "record.step_uneven"),
    "K-NET lacks its last five": ("knet", lost(-5, None), "record.count_contradicted", 360, 400),
    "a gap in times": ("columns", lost(100, 109), "record.step_uneven", "acc:101", "0.1 s"),
    **{
        f"{name} lasts {new}": (name, (old, new), "record.duration_contradicted")
        for name, old, new in (
            ("esm", "USER0:", "DURATION_S: 0.4"), ("esm", "USER0:", "DURATION_S: 40"),
            ("cosmos_v2", "   4 secs", "   8 secs"), ("csmip_v1", "SPACED AT .010", "SPACED AT .020"),
            ("geonet_v2a", "Number of points  400", "Number of points  400    Duration 8.00 sec"),
            ("unam", "MAGNITUD(ES) ", "DURACION DEL REGISTRO (s), C1-C6 : /8/8/8\nMAGNITUD(ES) "),
        )
    },
    "UNAM's channels of two lengths": ("unam", ("/400/400/400", "/400/400/300"), "record.channels_contradicted"),
    "CWB in mgal": ("cwb", ("  gal.", "  mgal."), "record.layout_unknown", "mgal"),
    # samples
    "PEER with NaN": ("peer", nan(41, 2), "record.number_unreadable", "AT2:42", "'NaN'"),
    **{
        f"NaN in line {n + 1}": ("columns", nan(n, 1), "record.number_unreadable", f"acc:{n + 1}", "'NaN'")
        for n in (1, 2, 149)
    },
    **{
        f"{name} ends in a number": (name, truncated_number, "record.number_unreadable", "truncated")
        for name in ("peer", "smc")
    },
    "PEER lacks three rows": ("peer", lost(40, 43), "record.count_contradicted", 385, 400),
    "PEER has a row twice": ("peer", line(44, lambda row: f"{row}\n{row}"), "record.count_contradicted", 405, 400),
    "rows behind the last channel": ("csmip_v2", rows_behind_the_end, "record.numbers_after_end", "3 lines"),
    "a line without end": ("peer", line(6, lambda text: text + " 1" * 100_000), "file.line_too_long", "AT2:7"),
    **{
        f"{name} with peaks of another unit": (name, peaks_in_other_units(pattern), "record.peak_contradicted")
        for name, pattern in (
            ("cosmos_v2", r"(Max = )(\S+)"), ("csmip_v1", r"(MAX  = +)(\S+)"), ("geonet_v2a", r"(peak   )(\S+)"),
            ("csmip_v2", r"(Peak acceleration = +)(\S+)"), ("knet", r"(Max\. Acc\. \(gal\)   )(\S+)"),
            ("cwb", r"(MAX\. \w: +|~ +)(\S+?)(?=[~\n])"),
        )
    },
}  # fmt: skip
"""Files of a format with one thing changed: the code, and what is named."""


@pytest.mark.parametrize(
    ("name", "change", "code", "named"),
    [(n, h, c, named) for n, h, c, *named in REFUSED.values()],
    ids=REFUSED,
)
def test_what_contradicts_itself_or_is_no_acceleration_is_refused_by_its_cause(
    name, change, code, named, tmp_path
):
    edited(tmp_path, name, change)
    outcome = imported(tmp_path)
    assert not outcome.records
    states("\n".join(str(refusal.reason) for refusal in outcome.refusals), code, *named)


@pytest.mark.parametrize(
    ("content", "code", "named"),
    [
        (b"PK\x03\x04" + b"\0" * 30 + b"[Content_Types].xml", "record.format_not_read", ("a spreadsheet", "CSV")),
        (b"PK\x03\x04" + b"\0" * 30 + b"RSN9.AT2", "record.format_not_read", ("a packed archive", "unpack")),
        (b"\x1f\x8b\x08" + bytes(range(200)), "record.format_not_read", ("a packed archive", "unpack")),
        (b"\x89HDF\r\n\x1a\n" + b"\0" * 100, "record.format_not_read", ("a file of arrays", "text")),
        (b"MATLAB 5.0 MAT-file" + b"\0" * 200, "record.format_not_read", ("a file of arrays", "text")),
        (b"<!DOCTYPE html>\n<html><body>Log in</body></html>\n", "record.format_not_read", ("a web page", "fetch")),
        (b'{"dt": 0.005, "acceleration": [0.1, 0.2]}\n', "record.format_not_read", ("JSON", "text")),
        (b"this is no record\n" * 20, "record.format_unknown", ()), (b"", "file.empty", ()),
    ],
)  # fmt: skip
def test_what_is_no_record_is_refused_by_what_it_is(content, code, named, tmp_path):
    path = tmp_path / "record.AT2"
    path.write_bytes(content)
    with refused(code, *named):
        read_file(path)


TITLES = {
    "Nowhere-02, 3/14/1999, Hill Street, 35": ("Nowhere-02", "Hill Street", 35.0),
    "Nowhere, 3/14/1999, Dam (left, top), 35": ("Nowhere", "Dam (left, top)", 35.0),
    "NOWHERE 03/14/79 15:09, HILL ST., 035 (XYZ STATION 12)": ("NOWHERE 03/14/79 15:09", "HILL ST.", 35.0),
    "a record of ours": ("a record of ours", "", None),
    **{
        f"Q11-10-20, 10/20/2011, CCM, {label}": ("Q11-10-20", "CCM", direction)
        for label, direction in (
            ("BHZ00", "up"), ("HHZ.10", "up"), ("HNZ--", "up"), ("EHZ", "up"), ("BHE00", 90.0), ("HNN10", 0.0),
            ("BH100", None), ("HN200", None), ("045", 45.0), ("UP", "up"),
        )
    },
}  # fmt: skip


@pytest.mark.parametrize("title", TITLES)
def test_the_titles_of_peer_are_event_station_and_direction(title, tmp_path):
    path = edited(tmp_path, "peer", line(1, lambda _: title))[0]
    (component,) = read_file(path)
    assert (component.event, component.station, component.direction) == TITLES[title]


ORIGIN = "TESTQUAKE\nJANUARY 17, 1994 04:31 PST\n14403"
DATE = "JANUARY 17, 1994 04:31 PST"
LATER, USUAL = "Fri Mar 5, 2021 20:19:31.0 PDT", "01/17/94, 12:30:55.4 GMT"
NOBODY = "01/01/1980 0:00:00 (GMT)     (ORIGIN: 01/01/1980 0:00:00 GMT)"
EVENTS = [
    ("csmip_v1", ORIGIN, ORIGIN, f"TESTQUAKE, {DATE}"),
    ("csmip_v1", ORIGIN, f"Rcrd of {LATER}\nRAW\n14403", LATER),
    # with a program's numbers
    ("csmip_v1", ORIGIN[:-6], f"{'TESTQUAKE':72}21\n{DATE:72}22", f"TESTQUAKE, {DATE}"),
    ("csmip_v1", DATE, f"{'':40}(ORIGIN(CIT): {USUAL})", f"TESTQUAKE, {USUAL}"),
    ("csmip_v2", "Dec 20, 2022", "Dec 20, 2022 02:34 PST", "Tue Dec 20, 2022 02:34 PST"),
    ("pairs_v1", ORIGIN[:-6], "FARQUAKE 2010\n", "FARQUAKE 2010"),
    ("pairs_v1", DATE, NOBODY, "TESTQUAKE"),
    ("bhrc", "2012/08/11   12:23:16", "2013/09/12   1:02:03", "2013/09/12 1:02:03"),
    ("smc", "1989  10  18    0004 Testquake, CA", "1990  11  19    0105 Q, CA", "Q, CA, 1990-11-19 0105"),
    ("unam", "2017/09/19", "2018/10/20", "2018/10/20 18:14:40"),
    ("cosmos_v2", "Record of Testquake", "Rcrd of Farquake", "Farquake of Tue Aug 28, 2018"),
]


@pytest.mark.parametrize(("name", "old", "new", "event"), EVENTS)
def test_headers_name_the_event_and_its_origin(name, old, new, event, tmp_path):
    found = [part for path in edited(tmp_path, name, (old, new)) for part in read_file(path)]
    assert {part.event for part in found} == {event}
    assert new != NOBODY or {part.series for part in found} == {""}


@pytest.mark.parametrize(("header", "gain"), [(1.0, 1.0), (4.0, 4.0), (-999.0, 1.0)])
def test_counts_of_cosmos_are_divided_by_the_sensors_gain_where_it_is_known(header, gain, tmp_path):
    edited(tmp_path, "cosmos_v1", counts_of_cosmos(header))
    record = only(imported(tmp_path))
    assert np.abs(record.motion.acceleration_m_s2 * gain - shaking()).max() < 2e-5
    assert any(f"gain {gain:g}" in step for step in record.history)


@pytest.mark.parametrize(
    ("label", "direction"),
    [
        ("090", 90.0), ("360 DEG", 0.0), ("N28W", 332.0), ("S62W", 242.0), ("N90E", 90.0), ("S10E", 170.0),
        ("UP", "up"), ("UD", "up"), ("DWN", "down"), ("EW", 90.0), ("NS", 0.0), ("N37.5E", 37.5),
        ("27.0", 27.0), ("090.0", 90.0), ("90.", 90.0), ("270 DEG.", 270.0), ("-90", 270.0), ("-45", 315.0),
        ("-0", 0.0), ("-UP", "down"), ("-Z", "down"), ("-E", 270.0), ("-N37E", 217.0), ("--", None),
        ("N 28 W", 332.0), ("E-W", 90.0), ("Vertical Up", "up"), ("HNE", 90.0), ("HN1", None), ("N45E;-", None),
        ("L", None), ("", None), ("400", None), ("-400", None), ("N120E", None),
    ],
)  # fmt: skip
def test_bearings_are_read_as_they_are_written(label, direction):
    assert bearing(label) == direction


TEXT = set(WRITERS) - {"miniseed", "sac"}
READ = {"peer", "csmip_v1", "esm", "columns", "knet"}
"""A format of every kind of reader is read in all spellings, all others in the two that change most."""
SPELLINGS = {
    "DOS": lambda content: content.replace(b"\n", b"\r\n"),
    "old Mac": lambda content: content.replace(b"\n", b"\r"),
    "sent as text twice": lambda content: content.replace(b"\n", b"\r\r\n"),
    "mark of UTF-8": lambda content: b"\xef\xbb\xbf" + content,
    "DOS' end of file": lambda content: content.replace(b"\n", b"\r\n") + b"\x1a" * 200,
    "block filled with zeros": lambda content: content + bytes(512 - len(content) % 512),
    "no end of the last line": lambda content: content.rstrip(b"\n"),
    "blank lines at the end": lambda content: content + b"\n  \n\n",
    "UTF-16 of Windows": lambda content: content.decode().encode("utf-16"),
    "UTF-16 of another order": lambda content: b"\xfe\xff" + content.decode().encode("utf-16-be"),
}


def double_precision(content):
    return re.sub(rb"(\d)E([+-]\d\d)", rb"\1D\2", content)


def decimal_commas(content):
    """Commas in the samples: behind the last line of words, or, where words end the file, behind the first header."""
    lines = content.decode().splitlines()
    worded = {number for number, line in enumerate(lines) if re.search("[A-DF-Za-df-z]", line)}
    first = max(worded) + 1 if max(worded) < len(lines) - 1 else 28
    samples = set(range(first, len(lines))) - worded
    return (
        "\n".join(line.replace(".", ",") if n in samples else line for n, line in enumerate(lines)).encode()
        + b"\n"
    )


@pytest.mark.parametrize(
    ("name", "change"),
    [
        *(
            pytest.param(name, change, id=f"{name}, {entry}")
            for name in sorted(READ)
            for entry, change in SPELLINGS.items()
        ),
        *(
            (name, SPELLINGS[value])
            for name in sorted(TEXT - READ)
            for value in ("DOS' end of file", "UTF-16 of Windows")
        ),
        *((name, double_precision) for name in ("peer", "bhrc", "smc")),
        *((name, decimal_commas) for name in ("esm", "unam", "csmip_v1", "peer", "cwb")),
    ],
)
def test_a_record_is_the_same_however_its_text_is_written(name, change, tmp_path):
    WRITERS[name](tmp_path, shaking(120))
    expected = only(imported(tmp_path))
    contents = {path: path.read_bytes() for path in tmp_path.iterdir() if path.name != "table.csv"}
    for path, content in contents.items():
        path.write_bytes(change(content))
    assert any(path.read_bytes() != content for path, content in contents.items())
    record = only(imported(tmp_path))
    assert (record.sha, record.event, record.station) == (expected.sha, expected.event, expected.station)


@pytest.mark.parametrize("between", [";", "  "])
@pytest.mark.parametrize("columns", [1, 4])
def test_decimal_commas_are_read_where_something_else_stands_between_numbers(columns, between, tmp_path):
    a = shaking(200)
    table = np.column_stack([np.arange(200) * STEP_S, a])[:, 4 - columns :]
    lines = [between.join(f"{v:.6f}".replace(".", ",") for v in row) for row in table]
    (tmp_path / "r.txt").write_text("\n".join(lines))
    assert np.abs(read_file(tmp_path / "r.txt")[-1].acceleration_m_s2 - a[:, 2]).max() < 1e-6


@pytest.mark.parametrize("columns", [1, 3])
def test_commas_between_and_within_numbers_are_refused_with_the_cause(columns, tmp_path):
    table = np.column_stack([np.arange(50) * STEP_S, shaking(50)[:, :columns]])
    lines = [",".join(f"{v:.4f}" for v in row).replace(".", ",") for row in table]
    (tmp_path / "r.csv").write_text("\n".join(lines))
    with refused("record.commas_ambiguous"):
        read_file(tmp_path / "r.csv")


@pytest.mark.parametrize("digits", [2, 3, 4, 6])
@pytest.mark.parametrize("step_s", [0.005, 0.01, 1 / 128, 0.02, 1 / 200])
def test_the_step_is_found_whatever_the_digits_of_the_times(step_s, digits, tmp_path):
    a = shaking(2000)[:, 0]
    lines = [f"{i * step_s:.{digits}f} {v:.6f}" for i, v in enumerate(a)]
    (tmp_path / "r.txt").write_text("\n".join(lines))
    (found,) = read_file(tmp_path / "r.txt")
    assert found.time_step_s == pytest.approx(step_s, rel=1e-9)


@pytest.mark.parametrize("off", [-3, 2])
@pytest.mark.parametrize(
    ("name", "spoken"),
    [
        ("peer", "NPTS= {:6d}"), ("cosmos_v2", "   {} acceleration pts"), ("esm", "NDATA: {}\n"),
        ("pairs_v1", "NO. OF POINTS =  {:5d}"),
    ],
)  # fmt: skip
def test_a_count_that_is_a_little_off_is_reported_and_the_rows_are_read(name, spoken, off, tmp_path):
    edited(tmp_path, name, (spoken.format(COUNT), spoken.format(COUNT + off)))
    outcome = imported(tmp_path)
    record = only(outcome)
    assert len(record.motion.acceleration_m_s2) == min(COUNT, COUNT + off)
    assert outcome.warnings
    assert any("where the header counts" in step for step in record.history)


def test_a_component_that_lacks_a_row_which_the_others_have_is_refused(tmp_path):
    path = WRITERS["peer"](tmp_path, shaking())[1]
    lines = path.read_text().splitlines()
    del lines[-1]
    path.write_text("\n".join(lines))
    (component,) = read_file(path)
    assert component.missing == 5
    left_out(imported(tmp_path), "record.count_contradicted", 395, 400)


def test_files_of_cosmos_begin_at_the_time_in_their_headers(tmp_path):
    (path,) = WRITERS["cosmos_v2"](tmp_path, a := shaking())
    for late, text in enumerate(re.split(r"(?<=acceleration\n)(?=Corr)", path.read_text())):
        when = "".join(f"{n:8d}" for n in (2018, 241, 8, 29, 2, 33))
        text = re.sub(
            r"((?:.*\n){17}.{72}) {4}-999(\n) {4}-999(?: {4}-999){4}", rf"\1{when[:8]}\2{when[8:]}", text,
            count=1,
        )  # fmt: skip
        text = re.sub(r"((?:.*\n){29}.{65}).{13}", rf"\g<1>{late * STEP_S:13.6f}", text, count=1)
        (tmp_path / f"{late}.V2C").write_text(text)
    path.unlink()
    found = only(imported(tmp_path)).motion.acceleration_m_s2
    for late, axis in enumerate((1, 2, 0)):
        np.testing.assert_allclose(found[:, axis], a[2 - late : COUNT - late, axis], atol=2e-5)


START = obspy.UTCDateTime(2020, 1, 1)
COUNTS = np.random.default_rng(3).integers(-1000, 1000, 1000).astype(np.int32)


def pieces(path, *parts: tuple[int, int, float], change=lambda data: data):
    """A file of pieces of one channel: first and last sample of each, and by which share of a sample it is late."""
    traces = []
    for place, (first, last, late) in enumerate(parts):
        data = COUNTS[first:last].copy()
        header = {"network": "XX", "station": "TST", "channel": "HNE", "delta": STEP_S}
        header["starttime"] = START + (first + late) * STEP_S
        traces.append(obspy.Trace(change(data) if place else data, header))
    obspy.Stream(traces).write(str(path), format="MSEED")
    return path


@pytest.mark.parametrize(
    "parts",
    [
        [(0, 600, 0), (400, 1000, 0)], [(0, 600, 0), (600, 1000, 0)], [(600, 1000, 0), (0, 600, 0)],
        [(0, 1000, 0), (200, 700, 0)], [(0, 1000, 0), (0, 1000, 0)],
        [(0, 300, 0), (200, 700, 0), (500, 1000, 0)], [(0, 600, 0), (600, 1000, 0.3)],
        [(0, 600, 0), (600, 1000, -0.4)],
    ],
)  # fmt: skip
def test_contiguous_pieces_of_a_channel_are_joined(parts, tmp_path):
    (found,) = read_file(pieces(tmp_path / "r.mseed", *parts))
    assert found.acceleration_m_s2.tolist() == COUNTS.tolist()
    overlap = sum(b - a for a, b, _ in parts) > 1000
    assert any("came twice" in text for text in found.warnings) is overlap


@pytest.mark.parametrize(
    ("parts", "change", "code", "named"),
    [
        ([(0, 600, 0), (400, 1000, 0)], lambda data: data + 1, "record.overlap", "2 s"),
        ([(0, 1000, 0), (500, 700, 0)], lambda data: data[::-1].copy(), "record.overlap", "2 s"),
        ([(0, 600, 0), (700, 1000, 0)], lambda data: data, "record.gap", "1 s"),
        ([(0, 600, 0), (601, 1000, 0)], lambda data: data, "record.gap", "0.01 s"),
    ],
)
def test_pieces_that_do_not_fit_are_refused_as_gap_or_overlap(parts, change, code, named, tmp_path):
    with refused(code, named):
        read_file(pieces(tmp_path / "r.mseed", *parts, change=change))


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(
    ("channels", "expected"),
    [
        ({"E": (90, 90), "N": (0, 90), "Z": (0, 0)}, 0),  # SAC's own: from the vertical
        ({"E": (90, 0), "N": (0, 0), "Z": (0, -90)}, 2),  # SEED's dip
        ({"E": (90, 0), "N": (0, 0), "Z": (0, 90)}, 3),
        ({"E": (0, 0), "N": (0, 0), "Z": (0, 0)}, 2),  # never set
    ],
)
def test_the_channels_code_decides_where_sacs_inclination_contradicts_it(channels, expected, order, tmp_path):
    for path in sac(tmp_path, shaking()):
        trace = obspy.read(str(path))[0]
        trace.stats.sac.cmpaz, trace.stats.sac.cmpinc = channels[trace.stats.channel[-1]]
        trace.write(str(path), format="SAC", byteorder=order)
    outcome = import_records(
        sorted(tmp_path.glob("*.sac")), read_table(tmp_path / "table.csv"), ImportOptions(process=False)
    )
    record = only(outcome)
    assert np.abs(record.motion.acceleration_m_s2 - shaking()).max() < 1e-6
    assert sum("the code decides" in text for _, text in outcome.warnings) == expected


def changed_sac(folder, change):
    path = sac(folder, shaking())[0]
    trace = obspy.read(str(path))[0]
    change(trace)
    trace.write(str(path), format="SAC")
    return path


@pytest.mark.parametrize(("idep", "quantity"), [(6, "displacement"), (7, "velocity"), (50, "volts")])
def test_sac_of_another_quantity_is_refused_by_its_name(idep, quantity, tmp_path):
    with refused("record.not_acceleration", idep, quantity):
        read_file(changed_sac(tmp_path, lambda trace: trace.stats.sac.update({"idep": idep})))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_samples_of_sac_that_are_not_finite_are_refused(bad, tmp_path):
    with refused("record.sample_out_of_range", "sample 17 of HNE", f"{bad:g}"):
        read_file(changed_sac(tmp_path, lambda trace: trace.data.put(17, bad)))


@pytest.mark.parametrize(
    ("pga", "pgv", "unit", "expected"),
    [
        (20.0, 2.0, None, ()), (36.0, 1.0, 9.80665, ("more than 3 g", "3.67 m/s2")),
        (267.0, 20.0, None, ("2.67 m/s2",)), (8.0, 4.5, None, ("more than 3 m/s",)),
        (1e9, 1e9, 1.0, ("1e+09 m/s2",)), (2e-4, 2e-5, None, ("0.0002 m/s2", "unit")),
    ],
)  # fmt: skip
def test_a_peak_beyond_nature_is_reported_with_the_unit_that_would_explain_it(pga, pgv, unit, expected):
    found = warnings_of({"pga_m_s2": pga, "pgv_m_s": pgv}, unit)
    assert bool(found) is bool(expected)
    assert all(text in found[0] for text in expected)


KINEMETRICS = Path(obspy.__file__).parent / "io" / "kinemetrics" / "tests" / "data"


def test_an_episensors_file_states_its_unit_and_its_vertical_channel(tmp_path):
    packed = KINEMETRICS / "STNA.20020722.044649.evt.gz"
    (tmp_path / "rec.evt").write_bytes(gzip.decompress(packed.read_bytes()))
    found = read_file(tmp_path / "rec.evt")
    assert [(entry.label, entry.direction) for entry in found] == [("X", None), ("Y", None), ("Z", "up")]
    by_obspy = obspy.read(str(tmp_path / "rec.evt"), apply_calib=True)
    for entry, trace in zip(found, by_obspy, strict=True):  # which takes g to be 9.81
        np.testing.assert_allclose(entry.acceleration_m_s2, trace.data * 9.80665 / 9.81, rtol=1e-9)
