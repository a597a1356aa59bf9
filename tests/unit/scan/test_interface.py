"""The plane through what was seen of a pedestal, and the interface as users know it: what surveys make of it."""

import dataclasses

import numpy as np
import pytest
from patches import level
from refusals import refused

from toppling.models.frames import plane_normal, rotation_between
from toppling.models.scan import virtual
from toppling.models.scan.interface import fit_interface
from toppling.models.scan.interface_hint import InterfaceHint
from toppling.models.scan.read import Cloud
from toppling.models.scan.register import check_fit, register
from toppling.models.scan.segment import PEDESTAL, ROCK
from toppling.models.scan.surfels import Surfels
from toppling.models.scan.survey import survey
from toppling.models.statics import support_polygon_m


def test_a_drawn_pedestal_that_is_exactly_a_plane_has_it():
    normal = plane_normal(6.0, 250.0)
    turn = rotation_between((0.0, 0.0, 1.0), normal)
    ground = level(1.0, 0.02)
    away_m = np.hypot(*ground[:, :2].T)
    ground = ground[(away_m > 0.5) & (away_m < 0.6)]
    rad = np.arange(0.0, 2.0 * np.pi, 0.02)
    side = np.vstack(
        [0.5 * np.column_stack([np.cos(rad), np.sin(rad), np.full(len(rad), z)]) for z in (0.02, 0.06, 0.1)]
    )
    points = np.vstack([ground, side]) @ turn.T + [0.3, 0.2, 0.4]
    patches = Surfels(points, np.broadcast_to(normal, points.shape), np.zeros(len(points)), 0.02)
    assert fit_interface(patches, np.arange(len(points)) >= len(ground)).normal == pytest.approx(
        normal, abs=1e-9
    )


SLOPE_DEG, DOWNHILL_DEG = 6.0, 250.0


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


@pytest.mark.thorough
@pytest.mark.usefixtures("few_draws")
@pytest.mark.parametrize("kind", ["plane", "outline"])  # points that enclose nothing are taken as a plane is
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


CORNERS = [[0.0, 0.0, 5.0], [4.0, 0.0, 5.1], [4.0, 3.0, 5.3], [0.0, 3.0, 5.2]]


ROWS = "".join(",".join(map(str, corner)) + "\n" for corner in CORNERS)
COMMAS = ROWS.replace(",", ";").replace(".", ",")
SWAPPED = "".join(f"{north},{east},{up}\n" for east, north, up in CORNERS)


@pytest.mark.parametrize(
    "content",
    [
        ROWS.encode("utf-8-sig"), f"x,y,z\n{ROWS}".encode("utf-8-sig"), f"northing,easting,z\n{SWAPPED}".encode(),
        f"Y_local (m),X_local (m),Z_local (m)\n{SWAPPED}".encode(),
        f"the contact, as picked at noon\n{ROWS}".encode(), COMMAS.encode("utf-16"),
    ],
)  # fmt: skip
def test_an_outline_is_the_same_however_it_is_written(tmp_path, content):
    (tmp_path / "outline.csv").write_bytes(content)
    np.testing.assert_allclose(InterfaceHint.outline(tmp_path / "outline.csv").anchors_m, CORNERS)


def outline_of(path, header):
    path.write_text(f"{header}\n{ROWS}")
    return InterfaceHint.outline(path)


@pytest.mark.parametrize(
    ("hint", "what"),
    [
        (lambda _: InterfaceHint.plane((0, 0, 0), 80.0, 0.0), "interface.slope_out_of_range"),
        (lambda _: InterfaceHint.points([[0, 0, 0], [1, 0, 0]]), "interface.too_few_places"),
        (lambda _: InterfaceHint.points([[0, 0, 0], [1, 0, 0], [2, 0, 0]]), "interface.places_on_a_line"),
        (lambda path: outline_of(path, "first,second,third"), "cloud.columns_unknown"),
        (lambda path: outline_of(path, "x_ft,y_ft,z_ft"), "coordinates.unit_not_metres"),
    ],
)
def test_a_hint_that_names_no_interface_is_refused(tmp_path, hint, what):
    with refused(what):
        hint(tmp_path / "outline.csv")


def test_a_word_about_another_place_is_refused(stump):
    _, cloud, _ = stump
    with refused("hint.outside_cloud"):
        survey(cloud, hint=InterfaceHint.plane((0.0, 0.0, 0.0), 5.0, 0.0))


def test_stations_with_relative_shifts_are_realigned(stump):
    _, cloud, _ = stump
    shift = np.random.default_rng(8).normal(0.0, 0.008, (int(cloud.station.max()) + 1, 3))
    shift -= shift.mean(axis=0)
    apart = Cloud(cloud.points_m + shift[cloud.station], cloud.origin_m, cloud.station, cloud.files)
    back, out = register(apart)
    check_fit(back, out)
    assert out["applied"]
    assert out["residual_m"] < 0.5 * out["residual_before_m"]
    left = np.linalg.norm(back.points_m - cloud.points_m, axis=1)
    # Shifts of 8 mm along each axis; what is left is below the range noise of 0.8 mm three times over.
    assert np.median(left) < 0.0025
