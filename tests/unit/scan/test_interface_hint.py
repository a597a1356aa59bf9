"""The interface as the user knows it, and stations that do not quite fit: what the survey makes of them."""

import dataclasses

import numpy as np
import pytest
from click.testing import CliRunner

from toppling.models.errors import InputError
from toppling.models.scan import virtual
from toppling.models.scan.interface_hint import InterfaceHint
from toppling.models.scan.read import Cloud
from toppling.models.scan.register import register
from toppling.models.scan.segment import PEDESTAL, ROCK
from toppling.models.scan.survey import survey
from toppling.models.statics import support_polygon_m
from toppling.orchestrator.verbs.scan import scan
from toppling.results.drawing.scene_figures import numbers_of

SLOPE_DEG, DOWNHILL_DEG = 6.0, 250.0


@pytest.fixture(scope="module")
def stump():
    truth = virtual.on_slope(
        virtual.boulder(2.0, 1.3, 1.0, 3, bumps=0.02, sides=64),
        virtual.ground(5.0, 0.7, 3, bumps_m=0.1),
        SLOPE_DEG,
        DOWNHILL_DEG,
    )
    stations = virtual.scan_around(truth, seed=1, stations=4, resolution_per_height=0.02)
    return truth, *virtual.cloud_of(stations, virtual.DEMO_ORIGIN_M)


def words(truth, tmp_path):
    corners = support_polygon_m(truth.rock, dataclasses.replace(truth.pedestal, vertices_m=None, faces=None))
    corners = corners + virtual.DEMO_ORIGIN_M
    path = tmp_path / "outline.csv"
    path.write_text("x,y,z\n" + "\n".join(",".join(map(repr, row)) for row in corners.tolist()))
    return {
        "plane": InterfaceHint.plane(corners.mean(axis=0), SLOPE_DEG, DOWNHILL_DEG),
        "points": InterfaceHint.points(corners[:: len(corners) // 3]),
        "outline": InterfaceHint.outline(path),
    }


def test_plane_points_and_outline_name_the_same_interface(stump, tmp_path):
    plane, points, outline = words(stump[0], tmp_path).values()
    for hint in (points, outline):
        np.testing.assert_allclose(hint.interface.normal, plane.interface.normal, atol=1e-9)
        assert hint.interface.flat(plane.interface.point_m)[2] == pytest.approx(0.0, abs=1e-6)
    assert [hint.encloses for hint in (plane, points, outline)] == [False, False, True]


# Points that enclose nothing are taken as a plane is.
@pytest.mark.thorough
@pytest.mark.usefixtures("few_draws")
@pytest.mark.parametrize("kind", ["plane", pytest.param("points", marks=pytest.mark.slow), "outline"])
def test_a_true_word_gives_the_true_rock(stump, tmp_path, kind):
    truth, cloud, label = stump
    # As one station: that stations are brought together is another matter, and costs as much as the split.
    cloud = dataclasses.replace(cloud, station=np.zeros_like(cloud.station), files=(("all", len(label)),))
    found = survey(cloud, hint=words(truth, tmp_path)[kind])
    assert found.scene.pedestal.slope_deg == pytest.approx(SLOPE_DEG, abs=1e-3)
    assert found.scene.report["interface"]["given_by"] == kind
    assert "hint" not in found.scene.report.get("not_free", {})
    assert (found.label[label == ROCK] == ROCK).mean() > 0.98
    assert (found.label[label == PEDESTAL] == PEDESTAL).mean() > 0.98
    # A coarse scan, 2 % of the height: half again the project's target for a fine one.
    assert found.scene.rock.volume_m3 == pytest.approx(truth.rock.volume_m3, rel=0.015)


@pytest.mark.slow
def test_a_given_interface_has_no_spread_and_the_report_says_so(stump, tmp_path):
    truth, cloud, _ = stump
    found = survey(cloud, hint=words(truth, tmp_path)["plane"], bootstrap=3).scene
    spread = found.report["uncertainty"]
    assert spread["closed"] == 3
    assert "interface_normal_std_deg" not in spread
    assert "the error of the interface that is given is not in them" in spread["method"]
    assert not any("°" in line and "±" in line for line in numbers_of(found))


CORNERS = [[0.0, 0.0, 5.0], [4.0, 0.0, 5.1], [4.0, 3.0, 5.3], [0.0, 3.0, 5.2]]


def outlined(path, header, columns, encoding="utf-8"):
    rows = [",".join(str(corner[column]) for column in columns) for corner in CORNERS]
    path.write_text("\n".join([*([header] if header else []), *rows]), encoding=encoding)
    return InterfaceHint.outline(path)


@pytest.mark.parametrize(
    ("header", "columns"),
    [
        ("northing,easting,z", (1, 0, 2)),
        ("Z_local (m),X_local (m),Y_local (m)", (2, 0, 1)),
        ("the contact, as picked at noon", (0, 1, 2)),
    ],
)
def test_an_outlines_columns_are_taken_by_the_names_of_the_header(tmp_path, header, columns):
    np.testing.assert_array_equal(outlined(tmp_path / "outline.csv", header, columns).anchors_m, CORNERS)


@pytest.mark.parametrize(("sign", "encoding"), [(";", "utf-16"), ("\t", "utf-8"), (" ", "cp1252")])
def test_an_outline_with_decimal_commas_is_read_in_any_encoding(tmp_path, sign, encoding):
    rows = [sign.join(f"{one:.3f}".replace(".", ",") for one in corner) for corner in CORNERS]
    (tmp_path / "outline.csv").write_text("\n".join(rows), encoding=encoding)
    np.testing.assert_allclose(InterfaceHint.outline(tmp_path / "outline.csv").anchors_m, CORNERS, atol=6e-4)


@pytest.mark.parametrize("header", ["", "x,y,z"])
def test_a_byte_order_mark_costs_an_outline_no_vertex(tmp_path, header):
    hint = outlined(tmp_path / "outline.csv", header, (0, 1, 2), "utf-8-sig")
    np.testing.assert_array_equal(hint.anchors_m, CORNERS)


@pytest.mark.parametrize(
    ("header", "what"), [("first,second,third", "names its columns"), ("x_ft,y_ft,z_ft", "another unit")]
)
def test_an_outline_whose_header_is_not_understood_is_refused(tmp_path, header, what):
    with pytest.raises(InputError, match=what) as error:
        outlined(tmp_path / "outline.csv", header, (0, 1, 2))
    assert "outline.csv" in error.value.where


@pytest.mark.parametrize(
    ("hint", "what"),
    [
        (lambda: InterfaceHint.plane((0, 0, 0), 80.0, 0.0), "slope is 80"),
        (lambda: InterfaceHint.points([[0, 0, 0], [1, 0, 0]]), "2 points"),
        (lambda: InterfaceHint.points([[0, 0, 0], [1, 0, 0], [2, 0, 0]]), "one line"),
    ],
)
def test_a_hint_that_names_no_interface_is_refused(hint, what):
    with pytest.raises(InputError, match=what):
        hint()


def test_a_word_about_another_place_is_refused(stump):
    _, cloud, _ = stump
    with pytest.raises(InputError, match="outside the cloud"):
        survey(cloud, hint=InterfaceHint.plane((0.0, 0.0, 0.0), 5.0, 0.0))


def test_two_words_at_once_are_refused_and_nothing_is_written(tmp_path):
    out = tmp_path / "scene"
    arguments = ["cloud.laz", "--out", str(out), "--outline", "a.csv", "--plane", "0", "0", "0", "5", "0"]
    with pytest.raises(InputError, match="given together"):
        CliRunner().invoke(scan, arguments, catch_exceptions=False)
    assert not out.exists()


@pytest.mark.parametrize("realisations", ["1", "2", "-1"])
def test_resamplings_too_few_for_a_spread_are_wrong_usage(tmp_path, realisations):
    out = tmp_path / "scene"
    done = CliRunner().invoke(scan, ["cloud.laz", "--out", str(out), "--bootstrap", realisations])
    assert done.exit_code == 2
    assert "--bootstrap" in done.output


def test_stations_shifted_against_each_other_are_brought_back(stump):
    _, cloud, _ = stump
    shift = np.random.default_rng(8).normal(0.0, 0.008, (int(cloud.station.max()) + 1, 3))
    shift -= shift.mean(axis=0)
    apart = Cloud(cloud.points_m + shift[cloud.station], cloud.origin_m, cloud.station, cloud.files)
    back, told = register(apart)
    assert told["applied"]
    assert told["residual_m"] < 0.5 * told["residual_before_m"]
    left = np.linalg.norm(back.points_m - cloud.points_m, axis=1)
    # Shifts of 8 mm along each axis; what is left is below the range noise of 0.8 mm three times over.
    assert np.median(left) < 0.0025
