"""Virtual scans with known truth: what a survey must find, and what it says of what no station saw."""

import dataclasses
import json

import numpy as np
import pytest
from matplotlib.path import Path as Polygon
from scipy.spatial import cKDTree
from virtual_rocks import drawing_few

from toppling.models.frames import slope_of_normal
from toppling.models.pedestal import Pedestal
from toppling.models.scan import virtual
from toppling.models.scan.close import ClosedRock
from toppling.models.scan.segment import NEITHER, PEDESTAL, ROCK
from toppling.models.scan.survey import save_survey, survey
from toppling.models.scan.uncertainty import cap_share, invention_warning, spread_of
from toppling.models.scene import Scene
from toppling.models.statics import quasi_static_toppling_m_s2
from toppling.results.drawing.scene_figures import draw_scene, scene_picture


def test_nearly_every_point_gets_its_true_label(stump, surveyed):
    label, found = stump[2], surveyed
    # Mixed pixels between rock and pedestal belong to neither surface: 0.5 % of the rock's points.
    assert (found.label[label == ROCK] == ROCK).mean() > 0.985
    assert (found.label[label == PEDESTAL] == PEDESTAL).mean() > 0.99
    assert (found.label[label == NEITHER] == NEITHER).mean() > 0.9


def test_mass_properties_are_those_of_the_true_body(stump, surveyed):
    truth, found = stump[0], surveyed
    rock, true = found.scene.rock, truth.rock
    # The project's targets for a scan.
    assert rock.volume_m3 == pytest.approx(true.volume_m3, rel=0.01)
    np.testing.assert_allclose(rock.com_m, true.com_m, atol=0.005 * true.height_m)
    np.testing.assert_allclose(
        np.linalg.eigvalsh(rock.inertia_per_mass_m2), np.linalg.eigvalsh(true.inertia_per_mass_m2), rtol=0.02
    )


def test_the_stated_spread_covers_the_true_error(stump, surveyed):
    truth, found = stump[0], surveyed
    rock, true, spread = found.scene.rock, truth.rock, found.scene.report["uncertainty"]
    # Three standard deviations: one true shape in four hundred may lie outside, and this one is seeded.
    assert (np.abs(rock.com_m - true.com_m) < 3 * np.array(spread["com_std_m"])).all()
    low_m3, _, high_m3 = found.scene.report["unseen_base"]["volume_m3"]
    assert low_m3 < true.volume_m3 < high_m3


def test_interface_slopes_as_the_true_interface(stump, surveyed):
    truth, found = stump[0], surveyed
    slope, downhill = slope_of_normal(truth.pedestal.normal)
    assert found.scene.pedestal.slope_deg == pytest.approx(slope, abs=0.3)
    assert found.scene.pedestal.downhill_azimuth_deg == pytest.approx(downhill, abs=5.0)


def test_quasi_static_toppling_of_the_true_body_lies_in_the_interval_at_every_azimuth(stump, surveyed):
    truth, stated = stump[0], surveyed.scene.report["unseen_base"]["toppling"]
    azimuths = [row["azimuth_deg"] for row in stated]
    true_plane = Pedestal(truth.pedestal.point_m, truth.pedestal.normal)
    true = [tips for _, tips in quasi_static_toppling_m_s2(truth.rock, true_plane, 9.81, azimuths)]
    low, high = (np.array([row[end] for row in stated]) for end in ("low_m_s2", "high_m_s2"))
    assert (low < true).all()
    assert (true < high).all()
    assert np.median((high - low) / true) < 0.6


def test_base_rests_exactly_on_the_interface_and_nothing_lies_below_it(stump, surveyed):
    scene = surveyed.scene
    gap = (scene.rock.vertices_m - scene.pedestal.point_m) @ scene.pedestal.normal
    assert gap.min() > -1e-9 * scene.rock.height_m
    assert (np.abs(gap) < 1e-9 * scene.rock.height_m).sum() > 20


def test_a_saved_scene_is_read_back_with_its_labels_and_survey_origin(stump, surveyed, tmp_path):
    cloud, found = stump[1], surveyed
    folder = save_survey(
        found, tmp_path / "scene", lambda staging: draw_scene(found.scene, staging / "scene.png")
    )
    again = Scene.load(folder)
    assert again.id == found.scene.id
    np.testing.assert_array_equal(again.origin_m, virtual.DEMO_ORIGIN_M)
    assert len(np.load(folder / "labels.npz")["label"]) == len(cloud.points_m)
    assert (folder / "scene.png").stat().st_size > 10_000
    all_contacts, *likelier = json.loads((folder / "contacts.geojson").read_text())["features"]
    assert [entry["properties"]["probability"] for entry in likelier] == [0.5, 0.95][: max(len(likelier), 1)]
    ring = np.array(all_contacts["geometry"]["coordinates"][0])
    assert (ring[0] == ring[-1]).all()
    assert Polygon(ring[:, :2]).contains_point((found.scene.rock.com_m + virtual.DEMO_ORIGIN_M)[:2])


def test_the_picture_names_its_lines_and_draws_the_stated_interval(surveyed):
    figure = scene_picture(surveyed.scene)
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    fractions = [100 * outline["probability"] for outline in surveyed.scene.report["interface"]["outlines"]]
    inside = [f"inside the contacts of {share:.0f} % of the bases" for share in fractions]
    assert texts[: 1 + len(fractions)] == ["around all possible contacts", *inside]
    lines = {line.get_label(): line for line in figure.axes[-1].lines}
    table = surveyed.scene.report["unseen_base"]["toppling"]
    medians = [entry["median_m_s2"] for entry in [*table, table[0]]]
    np.testing.assert_allclose(lines["topples: median of the bases"].get_ydata(), medians)
    assert "topples: 90 % of the bases" in texts


@pytest.mark.slow
def test_the_same_cloud_gives_the_same_scene(stump, surveyed):
    with drawing_few():
        assert survey(stump[1]).scene.id == surveyed.scene.id


@pytest.fixture(scope="module")
def twins():
    truth = virtual.two_rocks_side_by_side(seed=2)
    stations = virtual.scan_around(truth, seed=2, resolution_per_height=0.015, clutter=False)
    return truth, virtual.cloud_of(stations, np.zeros(3))[0]


@pytest.mark.slow
def test_the_named_rock_of_two_is_taken(twins):
    truth, cloud = twins
    found = survey(cloud, near_m=tuple(truth.rock.com_m[:2]))
    assert found.scene.rock.volume_m3 == pytest.approx(truth.rock.volume_m3, rel=0.03)


def test_the_demo_rock_is_the_studys_and_its_scan_is_seeded():
    truth = virtual.echo_cliffs_like(0)
    once, again = (
        virtual.scan_around(truth, seed=5, stations=1, resolution_per_height=0.03)[0] for _ in range(2)
    )
    np.testing.assert_array_equal(once.points_m, again.points_m)
    assert truth.rock.height_m == pytest.approx(14.0, abs=0.3)
    plane = Pedestal(truth.pedestal.point_m, truth.pedestal.normal)
    table = quasi_static_toppling_m_s2(truth.rock, plane, 9.81, np.arange(0.0, 360.0, 15.0))
    assert all(2.0 <= value <= 4.0 for _, value in table)


def spread(invented):
    rock = Scene.block(0.2, 0.3, 0.6).rock
    found = spread_of(ClosedRock(rock, 0.9 - invented, 0.1, invented, 0.0))
    return found["volume_std_m3"] / rock.volume_m3, found["com_std_m"][2] / rock.height_m


@pytest.mark.parametrize("height", [0.1, 0.5, 1.3, 2.0])
def test_a_cap_holds_its_geometric_fraction_of_the_ball(height):
    # Of a ball of radius 1, a cap of height h has the surface 2 pi h and the volume pi h^2 (3 - h) / 3.
    assert cap_share(height / 2.0) == pytest.approx(height**2 * (3.0 - height) / 4.0)


def test_floors_are_those_of_known_rocks_where_all_was_seen_and_the_caps_where_much_was_not():
    assert spread(0.0) == pytest.approx((0.003, 0.001))
    assert spread(0.41) == pytest.approx((0.367, 0.2 * 0.367), abs=0.001)


@pytest.fixture(scope="module")
def one_sided():
    """A leaning rock seen by three of six stations around it: truth, what the survey made of it, and the share of its
    surface, base included, near which no station saw a point.
    """
    truth = virtual.on_slope(
        virtual.boulder(2.5, 1.4, 0.9, 7, bumps=0.04, sides=64, lean_m=(0.15, 0.1)),
        virtual.ground(6.0, 0.7, 7, bumps_m=0.1, cells=80),
        8.0,
        120.0,
    )
    seen = virtual.scan_around(truth, 1, stations=6, resolution_per_height=0.02, clutter=False)[:3]
    found = survey(virtual.cloud_of(seen, np.zeros(3))[0])
    assert found.cached is not None
    points_m = np.vstack([station.points_m[station.label == ROCK] for station in seen])
    corners = truth.rock.vertices_m[truth.rock.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    away_m = cKDTree(points_m).query(corners.mean(axis=1))[0]
    unseen = away_m > 2.0 * found.cached.observed.surfels.voxel_m
    return truth, found.scene, float(area[unseen].sum() / area.sum())


@pytest.mark.slow
def test_the_spread_of_a_rock_seen_from_a_single_side_covers_its_error(one_sided):
    truth, found, unseen_share = one_sided
    rock, true, spread = found.rock, truth.rock, found.report["uncertainty"]
    surface = found.report["surface"]
    assert surface["seen_share"] == pytest.approx(1.0 - unseen_share, abs=0.05)
    # The error is a ninth of the volume: two standard deviations must hold it.
    assert 0.1 * true.volume_m3 < abs(rock.volume_m3 - true.volume_m3) < 2.0 * spread["volume_std_m3"]
    assert (np.abs(rock.com_m - true.com_m) < 2.0 * np.array(spread["com_std_m"])).all()


@pytest.mark.parametrize(
    ("invented", "crown_unseen", "expected"),
    [(0.41, 0.0, ("41%", "guesses")), (0.05, 0.93, ("93%", "crown")), (0.05, 0.0, ())],
)
def test_unseen_parts_of_a_rock_are_warned_of(invented, crown_unseen, expected):
    seen = {"seen_share": 0.85 - invented, "closed_share": 0.15, "invented_share": invented}
    report = {"surface": {**seen, "crown_unseen_share": crown_unseen}}
    text = invention_warning(dataclasses.replace(Scene.block(0.2, 0.3, 0.6), report=report))
    assert [part for part in expected if part not in text] == []
    assert bool(text) is bool(expected)
