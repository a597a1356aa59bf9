"""Text files: which columns are east, north and up, and what is refused because nobody can tell."""

import numpy as np
import pytest

from models import InputError
from models.scan import virtual
from models.scan.read import read_clouds


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


@pytest.mark.parametrize(
    "header", ["lat,lon,height,id", "intensity,r,g,b", "x,y,intensity,time", "id,no,x,y,z"]
)
def test_a_header_that_names_no_place_is_refused(tmp_path, points, header):
    path = written(tmp_path / "cloud.csv", header, np.hstack([points, NUMBER]))
    with pytest.raises(InputError, match="the header names its columns") as error:
        read_clouds([path])
    assert "cloud.csv" in error.value.where


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


def test_counts_between_the_scans_of_a_pts_file_are_no_points(tmp_path, points):
    scans = [
        f"{len(each)}\n" + "\n".join(" ".join(f"{c:.3f}" for c in row) + " -12 90 90 90" for row in each)
        for each in np.split(points, [500, 900])
    ]
    path = tmp_path / "cloud.pts"
    path.write_text("\n".join(scans))
    np.testing.assert_allclose(read(path), points, atol=1e-3)
