"""Text files: which columns are east, north and up, and what is refused because nobody can tell."""

import contextlib
import time

import numpy as np
import pytest

from toppling.models.errors import InputError
from toppling.models.scan import virtual
from toppling.models.scan.read import read_clouds
from toppling.models.scan.text import read_text


@pytest.fixture(scope="module")
def points():
    return np.round(np.random.default_rng(4).uniform(0, 10, (1200, 3)) + virtual.DEMO_ORIGIN_M, 3)


def written(path, header, rows, delimiter=","):
    np.savetxt(path, rows, fmt="%.3f", delimiter=delimiter, header=header, comments="")
    return path


def read(path):
    cloud = read_clouds([path])
    return cloud.points_m + cloud.origin_m


NUMBER = np.arange(1200.0)[:, None]


@pytest.mark.parametrize(
    ("header", "columns"),
    [
        ("Northing,Easting,Elevation", (1, 0, 2)),
        ("id,x,y,z", (3, 0, 1, 2)),
        ("//Intensity,X,Y,Z", (3, 0, 1, 2)),
        ("//X,Y,Z,R,G,B", (0, 1, 2, 3, 3, 3)),
        ('"N [m]","E [m]","Height [m]"', (1, 0, 2)),
        ("N,E,Height\n[m],[m],[m]", (1, 0, 2)),
        ("X,Y,Z,Intensity\nm,m,m,-", (0, 1, 2, 3)),
        ("up,point,n,x_m", (2, 3, 1, 0)),
        ("# Station 3 after the rain\n# y,x,z", (1, 0, 2)),
        ("# scanned from the north, at noon", (0, 1, 2)),
        ("1200\nx,y,z", (0, 1, 2)),
    ],
)
def test_columns_are_taken_by_the_names_of_the_header(tmp_path, points, header, columns):
    rows = np.hstack([points, NUMBER])[:, columns]
    np.testing.assert_allclose(read(written(tmp_path / "cloud.csv", header, rows)), points, atol=1e-3)


def test_names_may_be_parted_by_blanks(tmp_path, points):
    path = written(tmp_path / "cloud.txt", "y x z id", np.hstack([points, NUMBER])[:, (1, 0, 2, 3)], " ")
    np.testing.assert_allclose(read(path), points, atol=1e-3)


def test_a_header_that_names_latitude_and_longitude_says_degrees(tmp_path, points):
    path = written(tmp_path / "cloud.csv", "Latitude,Longitude,Ellipsoidal height", points)
    with pytest.raises(InputError, match="in degrees"):
        read(path)


@pytest.mark.parametrize(
    "header", ["lat,lon,height,id", "intensity,r,g,b", "x,y,intensity,time", "id,no,x,y,z"]
)
def test_a_header_that_names_no_place_is_refused(tmp_path, points, header):
    path = written(tmp_path / "cloud.csv", header, np.hstack([points, NUMBER]))
    with pytest.raises(InputError, match="the header names its columns") as error:
        read_clouds([path])
    assert "cloud.csv" in error.value.where


def test_an_easting_where_the_height_should_be_is_refused(tmp_path, points):
    numbered = np.hstack([NUMBER % 500, points[:, (1, 0, 2)]])  # numbers that begin anew are no count
    with pytest.raises(InputError, match=r"third column, about .*, is no height") as error:
        read_clouds([written(tmp_path / "cloud.csv", "", numbered)])
    assert "id,y,x,z" in error.value.remedy


def test_a_height_of_850_m_in_millimetres_is_read_where_the_unit_is_given(tmp_path):
    path = tmp_path / "cloud.xyz"
    low = np.array([0.0, 0.0, 850000.0])
    np.savetxt(path, np.random.default_rng(1).uniform(low, low + 900.0, (50, 3)))
    assert read_text(path, unit_given=True)[0][:, 2].min() >= 850000.0


def test_rows_of_a_grid_are_no_points(tmp_path):
    with pytest.raises(InputError, match="grid of heights"):
        read_clouds([written(tmp_path / "dem.asc", "ncols 50\nnrows 1200", np.zeros((1200, 50)), " ")])


def test_northing_before_easting_without_a_header_is_refused(tmp_path, points):
    with pytest.raises(InputError, match="looks like a northing") as error:
        read_clouds([written(tmp_path / "cloud.xyz", "", points[:, (1, 0, 2)], " ")])
    assert "y,x,z" in error.value.remedy
    # The remedy helps, also where the columns are in order after all.
    np.testing.assert_allclose(
        read(written(tmp_path / "in_order.xyz", "x y z", points[:, (1, 0, 2)], " ")),
        points[:, (1, 0, 2)],
        atol=1e-3,
    )


@pytest.mark.parametrize("numbers", [NUMBER, NUMBER + 1, NUMBER + 5001, 17.5 + 0.01 * NUMBER])
def test_numbers_or_times_of_points_are_not_taken_for_a_coordinate(tmp_path, points, numbers):
    rows = np.hstack([numbers, points])
    body = "\n".join("{:.12g},{:.3f},{:.3f},{:.3f}".format(*row) for row in rows)
    path = tmp_path / "cloud.csv"
    path.write_text(body)
    with pytest.raises(InputError, match="numbers or times the points") as error:
        read_clouds([path])
    assert "id,x,y,z" in error.value.remedy
    path.write_text(f"id,x,y,z\n{body}")
    np.testing.assert_allclose(read(path), points, atol=1e-3)


def test_counts_between_the_scans_of_a_pts_file_are_no_points(tmp_path, points):
    scans = [
        f"{len(each)}\n" + "\n".join(" ".join(f"{c:.3f}" for c in row) + " -12 90 90 90" for row in each)
        for each in np.split(points, [500, 900])
    ]
    path = tmp_path / "cloud.pts"
    path.write_text("\n".join(scans))
    np.testing.assert_allclose(read(path), points, atol=1e-3)


@pytest.mark.parametrize(
    ("header", "columns"),
    [
        ("OBJECTID,POINT_X,POINT_Y,POINT_Z", (3, 0, 1, 2)),
        ("Y_local,X_local,Z_local", (1, 0, 2)),
        ("Y coordinate,X coordinate,Z coordinate", (1, 0, 2)),
        ("Y (North),X (East),Z (Up)", (1, 0, 2)),
        ("N (m GDA94),E (m GDA94),Height (m a.s.l.)", (1, 0, 2)),
        ("Y_m,X_metres,height meters", (1, 0, 2)),
        ("N,E,H", (1, 0, 2)),
        ("Easting,Northing,Altitude (m)", (0, 1, 2)),
        ("Y in m,X in m,Z in m", (1, 0, 2)),
        ("y_utm,x_utm,z_utm,intensity (dB)", (1, 0, 2, 3)),
        ("y,x,z\n# exported at noon by car", (1, 0, 2)),
        ("y,x,z,x_local", (1, 0, 2, 3)),
        ("# scanned by N. E. Person and two others\n# y,x,z", (1, 0, 2)),
    ],
)
def test_names_of_coordinates_may_say_more_than_the_axis(tmp_path, points, header, columns):
    rows = np.hstack([points, NUMBER])[:, columns]
    np.testing.assert_allclose(read(written(tmp_path / "cloud.csv", header, rows)), points, atol=1e-3)


@pytest.mark.parametrize("header", ["Y [m] X [m] Z [m]", "Y\tX\tZ", "Y (m), X (m), Z (m)", "Y;X;Z"])
def test_names_may_be_parted_otherwise_than_the_numbers(tmp_path, points, header):
    path = written(tmp_path / "cloud.txt", header, points[:, (1, 0, 2)], " ")
    np.testing.assert_allclose(read(path), points, atol=1e-3)


@pytest.mark.parametrize(
    "header",
    [
        "first,second,third",
        "Rechtswert,Hochwert,Kote",
        "X (Northing),Y (Easting),Z",
        "normal_x,normal_y,normal_z",
        "azimuth_deg,range_m,elevation_deg",
        "first,second,third\n# exported at noon by car",
    ],
)
def test_a_header_with_a_name_for_each_column_is_no_remark(tmp_path, points, header):
    with pytest.raises(InputError, match="the header names its columns") as error:
        read_clouds([written(tmp_path / "cloud.csv", header, points)])
    assert "x, y and z, in metres" in error.value.remedy


def test_of_two_sets_of_coordinates_none_is_taken_silently(tmp_path, points):
    header = "x_local,y_local,z_local,x_utm,y_utm,z_utm"
    with pytest.raises(InputError, match="the header names its columns"):
        read_clouds([written(tmp_path / "cloud.csv", header, np.hstack([points, points + 5.0]))])


@pytest.mark.parametrize(
    "header",
    [
        "X (ft),Y (ft),Z (ft)",
        "x_ft,y_ft,z_ft",
        "X[mm],Y[mm],Z[mm]",
        "Easting (US survey feet),Northing (US survey feet),Elevation (US survey feet)",
        "x [m],y [m],z [ft]",
        "X (cm) Y (cm) Z (cm)",
        "x in,y in,z in",
        "# x_ft,y_ft,z_ft\n# exported at noon by car",
        "x,y,z\nmm,mm,mm",
        "x (10^-3 m),y (10^-3 m),z (10^-3 m)",
    ],
)
def test_a_header_that_states_another_unit_than_metres_is_refused(tmp_path, points, header):
    with pytest.raises(InputError, match="states another unit than metres") as error:
        read_clouds([written(tmp_path / "cloud.csv", header, points)])
    assert "convert the coordinates to metres" in error.value.remedy
    assert "cloud.csv" in error.value.where


def test_of_coordinates_in_feet_and_in_metres_those_in_metres_are_taken(tmp_path, points):
    path = written(tmp_path / "cloud.csv", "x_ft,y_ft,z_ft,x_m,y_m,z_m", np.hstack([points / 0.3048, points]))
    np.testing.assert_allclose(read(path), points, atol=1e-3)


@pytest.mark.parametrize("header", ["", "y,x,z\n"])
@pytest.mark.parametrize("suffix", [".csv", ".pts"])
def test_a_byte_order_mark_is_no_part_of_a_text_cloud(tmp_path, points, header, suffix):
    order = (1, 0, 2) if header else (0, 1, 2)
    rows = "\n".join(",".join(f"{c:.3f}" for c in row) for row in points[:, order])
    path = tmp_path / f"cloud{suffix}"
    path.write_text(header + rows, encoding="utf-8-sig")
    np.testing.assert_allclose(read(path), points, atol=1e-3)


@pytest.mark.parametrize("filler", [" ", "[", "( ", "x [", "x] "])
def test_a_header_of_any_length_is_soon_read_or_refused(tmp_path, points, filler):
    path = written(tmp_path / "cloud.csv", f"x{filler * 100_000}y,z", points)
    began_s = time.process_time()
    with contextlib.suppress(InputError):
        read_clouds([path])
    assert time.process_time() - began_s < 5.0  # minutes where the time grows by the length's square
