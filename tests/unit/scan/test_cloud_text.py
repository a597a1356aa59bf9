"""Clouds in text: which columns are east, north and up in whatever dialect, and what is refused as nobody can tell."""

import numpy as np
import pytest
from cloud_samples import read
from hypothesis import given, settings
from hypothesis import strategies as st
from refusals import refused

from toppling.models.errors import InputError

SHIFT_M = np.array([331000.0, 3777000.0, 470.0])
POINTS_M = (np.random.default_rng(5).uniform(0.0, 12.0, (1500, 3)) + SHIFT_M).round(3)
NUMBER = np.arange(1500.0)[:, None]
ROWS = np.hstack([POINTS_M, NUMBER])


def body(rows=POINTS_M, sign=",", form="{:.3f}"):
    return "".join(sign.join(map(form.format, row)) + "\n" for row in rows)


def written(path, header="", rows=POINTS_M, sign=","):
    path.write_text((header and f"{header}\n") + body(rows, sign))
    return path


@pytest.mark.parametrize(
    ("header", "columns"),
    [
        ("Northing,Easting,Elevation", (1, 0, 2)), ("Easting,Northing,Altitude (m)", (0, 1, 2)),
        ("id,x,y,z", (3, 0, 1, 2)), ("OBJECTID,POINT_X,POINT_Y,POINT_Z", (3, 0, 1, 2)),
        ("//Intensity,X,Y,Z", (3, 0, 1, 2)), ("//X,Y,Z,R,G,B", (0, 1, 2, 3, 3, 3)),
        ("X,Y,Z,Intensity\nm,m,m,-", (0, 1, 2, 3)), ("up,point,n,x_m", (2, 3, 1, 0)), ("N,E,H", (1, 0, 2)),
        ("Y (North),X (East),Z (Up)", (1, 0, 2)), ("N (m GDA94),E (m GDA94),Height (m a.s.l.)", (1, 0, 2)),
        ("y_utm,x_utm,z_utm,intensity (dB)", (1, 0, 2, 3)), ("y,x,z,x_local", (1, 0, 2, 3)),
        ("# scanned from the north, at noon", (0, 1, 2)), ("1500\nx,y,z", (0, 1, 2)), ("\ufeffy,x,z", (1, 0, 2)),
        *((header, (1, 0, 2)) for header in ("Y [m] X [m] Z [m]", "Y\tX\tZ", "Y (m), X (m), Z (m)", "Y;X;Z")),
    ],
)  # fmt: skip
@pytest.mark.parametrize("sign", [",", " "])
def test_columns_are_taken_by_the_names_of_the_header(tmp_path, header, columns, sign):
    path = written(tmp_path / "cloud.txt", header, ROWS[:, columns], sign)
    np.testing.assert_allclose(read(path), POINTS_M, atol=1e-3)


NAMED, OTHER_UNIT = "cloud.columns_unknown", "coordinates.unit_not_metres"


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        ("Latitude,Longitude,Ellipsoidal height", "coordinates.in_degrees"),
        ("lat,lon,height,id", "coordinates.in_degrees"),
        *((header, NAMED) for header in (
            "intensity,r,g,b", "x,y,intensity,time", "id,no,x,y,z", "first,second,third",
            "Rechtswert,Hochwert,Kote", "X (Northing),Y (Easting),Z", "normal_x,normal_y,normal_z",
            "azimuth_deg,range_m,elevation_deg", "first,second,third\n# exported at noon by car",
            "x_local,y_local,z_local,x_utm,y_utm,z_utm",
        )),
        *((header, OTHER_UNIT) for header in (
            "X (ft),Y (ft),Z (ft)", "x_ft,y_ft,z_ft", "X[mm],Y[mm],Z[mm]", "x [m],y [m],z [ft]", "X (cm) Y (cm) Z (cm)",
            "Easting (US survey feet),Northing (US survey feet),Elevation (US survey feet)", "x in,y in,z in",
            "# x_ft,y_ft,z_ft\n# exported at noon by car", "x,y,z\nmm,mm,mm", "x (10^-3 m),y (10^-3 m),z (10^-3 m)",
        )),
    ],
)  # fmt: skip
def test_a_header_that_names_no_place_in_metres_is_refused(tmp_path, header, expected):
    columns = {2: 3, 3: 4, 4: 4, 5: 6}.get(header.split("\n")[0].count(","), 3)
    path = written(tmp_path / "cloud.csv", header, np.hstack([ROWS, POINTS_M])[:, :columns])
    with refused(expected) as error:
        read(path)
    assert "cloud.csv" in error.value.where


@pytest.mark.parametrize(
    ("rows", "expected", "header"),
    [
        (np.hstack([NUMBER % 500, POINTS_M[:, (1, 0, 2)]]), "cloud.columns_out_of_order", "id,y,x,z"),
        (POINTS_M[:, (1, 0, 2)], "cloud.columns_out_of_order", "y,x,z"),
        *((np.hstack([numbers, POINTS_M]), "cloud.columns_out_of_order", "id,x,y,z") for numbers in (
            NUMBER + 5001, 17.5 + 0.01 * NUMBER)),
    ],
    ids=["easting as height", "northing first", "numbers", "times"],
)  # fmt: skip
def test_columns_that_are_no_place_are_refused_unless_the_header_names_them(tmp_path, rows, expected, header):
    path = written(tmp_path / "cloud.xyz", "", rows, " ")
    with refused(expected) as error:
        read(path)
    assert header in error.value.remedy
    np.testing.assert_allclose(read(written(path, header.replace(",", " "), rows, " ")), POINTS_M, atol=1e-3)


TEXTS = {
    "semicolons": ("{};{};{}\n", ","),
    "semicolons and more": ("{};{};{};17;3,5\n", ","),
    "tabs": ("{}\t{}\t{}\n", ","),
    "blanks": ("{} {} {}\n", ","),
    "commas and blanks": ("{}, {}, {}\n", ","),
    "quoted": ('"{}","{}","{}"\n', ","),
    "points and semicolons": ("{};{};{}\n", "."),
    "points and tabs": ("{}\t{}\t{}\n", "."),
    "dos": ("{} {} {}\r\n", "."),
    "old mac": ("{} {} {}\r", "."),
}


def text(form, decimal=".", points=POINTS_M):
    return "".join(form.format(*(f"{c:.3f}".replace(".", decimal) for c in row)) for row in points)


BLANKS, COMMAS = text("{} {} {}\n"), text("{},{},{}\n")
PLAIN, LINES = BLANKS.encode(), BLANKS.splitlines()
CELLS = text("{},{},{},\n").splitlines()
SCANS = "\n".join(f"{len(value)}\n" + body(value, " ").replace("\n", " -12 90 90 90\n").strip()
                  for value in np.split(POINTS_M, [500, 900]))  # fmt: skip


@pytest.mark.parametrize(
    ("name", "content"),
    [
        *((f"cloud{suffix}", PLAIN.strip() + end) for end in (b"\x1a", b"\r\n\x1a", b"\0" * 512, b"\n" + b"\0" * 3)
          for suffix in (".xyz", ".xyzrgb", ".pts", ".dat")),
        *((f"cloud{suffix}", COMMAS.encode("utf-8-sig")) for suffix in (".csv", ".pts")),
        ("spreadsheet.csv", "\n".join([*CELLS[:700], ",,,", *CELLS[700:], ",,,", ",,,"]).encode()),
        *((f"thousands{sign.strip()}.xyz", body(POINTS_M, sign, "{:,.3f}").encode()) for sign in "; \t"),
        ("fortran.xyz", body(POINTS_M, " ", "{:.12E}").replace("E", "D").encode()),
        ("scans.pts", SCANS.encode()),
        ("cp1252.txt", ("# ±2 mm\nx;y;z\n" + text("{};{};{}\r\n", ",")).encode("cp1252")),
    ],
)  # fmt: skip
def test_what_programs_put_around_the_points_changes_none_of_them(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    np.testing.assert_allclose(read(tmp_path / name), POINTS_M, atol=1e-3)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "cloud.too_few_points"), (b"1 2 3\n4 5 6\n", "cloud.too_few_points"),
        (b"this,is,not\na,point,cloud\n", "cloud.too_few_points"), (b"1 2 nan\n" * 2000, "cloud.too_few_points"),
        (f"ncols 50\nnrows 1200\n{body(np.zeros((1200, 50)), ' ')}".encode(), "cloud.grid_of_heights"),
        (text("{},{},{}\n", ",").encode(), "cloud.numbers_ambiguous"),
        (PLAIN[:-15], "cloud.row_unreadable"),
        ("\n".join([*LINES[:1490], "\0" * 40, *LINES[1490:]]).encode(), "file.holds_zeros"),
        (body(POINTS_M.round(), " ", "{:.0f}").encode(), "coordinates.too_coarse"), (BLANKS.encode("utf-16"), ""),
        (b"1.#IND 1.#IND 1.#IND\n" * 99, ""), (PLAIN + b"1.#QNAN 0.0 0.0\n", ""),
    ],
)  # fmt: skip
def test_text_that_is_no_cloud_of_plain_numbers_is_refused(tmp_path, content, expected):
    path = tmp_path / "cloud.xyz"
    path.write_bytes(content)
    with pytest.raises(InputError) as error:
        read(path)
    assert error.value.code == expected or not expected


@settings(max_examples=30)
@given(
    st.lists(st.floats(-9e4, 9e4).map(lambda x: round(x, 3)), min_size=3, max_size=3),
    st.sampled_from([("{},{},{}\n", "."), *(entry for entry in TEXTS.values() if "17" not in entry[0])]),
)
def test_points_anywhere_come_back_from_their_text(tmp_path_factory, middle, dialect):
    """With a header, which leaves no doubt of which column is which."""
    form, decimal = dialect
    points = POINTS_M[:1000] - SHIFT_M + middle
    path = tmp_path_factory.mktemp("text") / "cloud.txt"
    path.write_bytes((form.format("x", "y", "z") + text(form, decimal, points)).encode())
    np.testing.assert_allclose(read(path, "m"), points, atol=1e-3)
