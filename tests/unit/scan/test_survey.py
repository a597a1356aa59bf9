"""Virtual scans with known truth: what a survey must find, and what it must refuse."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from virtual_rocks import stump_on_a_slope

from toppling.models.errors import InputError
from toppling.models.files.digest import read_json, write_json
from toppling.models.frames import slope_of_normal
from toppling.models.pedestal import Pedestal
from toppling.models.scan import virtual
from toppling.models.scan.interface_hint import InterfaceHint
from toppling.models.scan.read import read_clouds
from toppling.models.scan.segment import NEITHER, PEDESTAL, ROCK
from toppling.models.scan.survey import save_survey, survey
from toppling.models.scene import Scene
from toppling.models.statics import quasi_static_toppling_m_s2
from toppling.results.drawing.scene_figures import draw_scene

RESOLUTION = 0.02
"""Point spacing in rock heights: coarse, to be quick."""


@pytest.fixture(scope="module")
def stump(few_draws):
    """A stump on a slope: truth, cloud, the truth's labels, and what the survey made of it."""
    truth = stump_on_a_slope()
    cloud, label = virtual.cloud_of(
        virtual.scan_around(truth, seed=1, stations=5, resolution_per_height=RESOLUTION),
        virtual.DEMO_ORIGIN_M,
    )
    return truth, cloud, label, survey(cloud, bootstrap=3)


def test_nearly_every_point_gets_its_true_label(stump):
    _, _, label, found = stump
    # Mixed pixels between rock and pedestal belong to neither surface: 0.5 % of the rock's points.
    assert (found.label[label == ROCK] == ROCK).mean() > 0.985
    assert (found.label[label == PEDESTAL] == PEDESTAL).mean() > 0.99
    assert (found.label[label == NEITHER] == NEITHER).mean() > 0.9


def test_mass_properties_are_those_of_the_true_body(stump):
    truth, _, _, found = stump
    rock, true = found.scene.rock, truth.rock
    # The project's targets for a scan.
    assert rock.volume_m3 == pytest.approx(true.volume_m3, rel=0.01)
    np.testing.assert_allclose(rock.com_m, true.com_m, atol=0.005 * true.height_m)
    np.testing.assert_allclose(
        np.linalg.eigvalsh(rock.inertia_per_mass_m2), np.linalg.eigvalsh(true.inertia_per_mass_m2), rtol=0.02
    )


def test_the_stated_spread_covers_the_true_error(stump):
    truth, _, _, found = stump
    rock, true, spread = found.scene.rock, truth.rock, found.scene.report["uncertainty"]
    assert spread["closed"] == 3
    # Half samples alone say 0.01 %: the bias that they share is stated as a floor.
    assert min(spread["com_std_m"]) >= spread["bias"]["com_per_height"] * 0.99 * true.height_m
    # Three standard deviations: one true shape in four hundred may lie outside, and this one is seeded.
    assert (np.abs(rock.com_m - true.com_m) < 3 * np.array(spread["com_std_m"])).all()
    assert abs(rock.volume_m3 - true.volume_m3) < 3 * spread["volume_std_m3"]


def test_interface_slopes_as_the_true_one(stump):
    truth, _, _, found = stump
    slope, downhill = slope_of_normal(truth.pedestal.normal)
    assert found.scene.pedestal.slope_deg == pytest.approx(slope, abs=0.3)
    assert found.scene.pedestal.downhill_azimuth_deg == pytest.approx(downhill, abs=5.0)


def test_quasi_static_toppling_is_that_of_the_true_body(stump):
    truth, _, _, found = stump
    azimuths = np.arange(0.0, 360.0, 30.0)
    true_plane = Pedestal(truth.pedestal.point_m, truth.pedestal.normal)
    true = quasi_static_toppling_m_s2(truth.rock, true_plane, 9.81, azimuths)
    seen = quasi_static_toppling_m_s2(found.scene.rock, found.scene.pedestal, 9.81, azimuths)
    # The contact's rim is known to half a point spacing, 0.01 heights of an arm of 0.25 heights, twice.
    np.testing.assert_allclose(np.array(seen)[:, 1], np.array(true)[:, 1], rtol=0.10)


def test_base_rests_exactly_on_the_interface_and_nothing_lies_below_it(stump):
    scene = stump[3].scene
    gap = (scene.rock.vertices_m - scene.pedestal.point_m) @ scene.pedestal.normal
    assert gap.min() > -1e-9 * scene.rock.height_m
    assert (np.abs(gap) < 1e-9 * scene.rock.height_m).sum() > 20


def test_a_saved_scene_is_read_back_with_its_labels_and_survey_origin(stump, tmp_path):
    _, cloud, _, found = stump
    folder = save_survey(
        found, tmp_path / "scene", lambda staging: draw_scene(found.scene, staging / "scene.png")
    )
    again = Scene.load(folder)
    assert again.id == found.scene.id
    np.testing.assert_array_equal(again.origin_m, virtual.DEMO_ORIGIN_M)
    assert len(np.load(folder / "labels.npz")["label"]) == len(cloud.points_m)
    assert (folder / "scene.png").stat().st_size > 10_000


def test_a_scene_whose_content_has_another_id_tells_of_changes_and_of_other_versions(tmp_path):
    folder = Scene.block(0.2, 0.3, 0.6).save(tmp_path / "scene")
    write_json(folder / "scene.json", read_json(folder / "scene.json") | {"id": "0" * 20})
    with pytest.raises(
        InputError, match="a file was changed, or a program of another version wrote the scene"
    ):
        Scene.load(folder)


@pytest.mark.parametrize(
    "lost", ["id", "pedestal", "interface", "contact", "gravity_m_s2", "origin_m", "report"]
)
def test_a_scene_that_is_not_whole_is_refused(lost, tmp_path):
    folder = Scene.block(0.2, 0.3, 0.6).save(tmp_path / "scene")
    described = read_json(folder / "scene.json")
    for other in ({}, {lost: None}, {lost: [1]}):
        left = {key: value for key, value in described.items() if key != lost} | other
        write_json(folder / "scene.json", left)
        with pytest.raises(InputError):
            Scene.load(folder)


@pytest.mark.slow
def test_the_same_cloud_gives_the_same_scene(stump):
    _, cloud, _, found = stump
    assert survey(cloud, bootstrap=3).scene.id == found.scene.id


@pytest.fixture(scope="module")
def twins():
    truth = virtual.two_rocks_side_by_side(seed=2)
    stations = virtual.scan_around(truth, seed=2, resolution_per_height=0.015, clutter=False)
    return truth, virtual.cloud_of(stations, np.zeros(3))[0]


@pytest.mark.slow  # test_bad_input.py has the law, of the split alone
def test_of_two_like_rocks_none_is_taken_silently(twins):
    with pytest.raises(InputError, match="2 things of like size") as error:
        survey(twins[1])
    assert "--near" in error.value.remedy


@pytest.mark.slow
def test_of_two_rocks_the_named_one_is_taken(twins):
    truth, cloud = twins
    found = survey(cloud, near_m=tuple(truth.rock.com_m[:2]))
    assert found.scene.rock.volume_m3 == pytest.approx(truth.rock.volume_m3, rel=0.03)


@pytest.mark.slow
def test_of_two_rocks_on_a_given_plane_the_named_one_is_taken(twins):
    truth, cloud = twins
    pedestal = truth.pedestal
    plane = InterfaceHint.plane(pedestal.point_m, pedestal.slope_deg, pedestal.downhill_azimuth_deg)
    found = survey(cloud, near_m=(2.0, 0.0), hint=plane)
    # The other rock's axis is 2 m from the plane's point; half a rock's width is enough to tell them apart.
    assert np.hypot(*(found.scene.rock.com_m[:2] + found.scene.origin_m[:2] - [2.0, 0.0])) < 0.5


def test_stations_that_show_different_places_are_refused(stump):
    _, cloud, _, _ = stump
    half = len(cloud.points_m) // 2
    apart = cloud.points_m.copy()
    apart[half:] += 1000.0
    files = (("here.laz", half), ("there.laz", len(apart) - half))
    with pytest.raises(InputError, match="does not overlap") as error:
        survey(dataclasses.replace(cloud, points_m=apart, files=files))
    assert error.value.where in ("here.laz", "there.laz")


def test_a_file_in_feet_is_told_by_its_size(stump):
    _, cloud, _, _ = stump
    half = len(cloud.points_m) // 2
    mixed = cloud.points_m.copy()
    mixed[half:] = mixed[half:] / 0.3048 + 500.0
    files = (("metres.laz", half), ("feet.laz", len(mixed) - half))
    with pytest.raises(InputError, match="other units"):
        survey(dataclasses.replace(cloud, points_m=mixed, files=files))


def test_the_demo_rock_is_the_studys():
    truth = virtual.echo_cliffs_like(0)
    assert truth.rock.height_m == pytest.approx(14.0, abs=0.3)
    plane = Pedestal(truth.pedestal.point_m, truth.pedestal.normal)
    table = quasi_static_toppling_m_s2(truth.rock, plane, 9.81, np.arange(0.0, 360.0, 15.0))
    assert all(2.0 <= value <= 4.0 for _, value in table)


def test_scanning_is_seeded():
    truth = virtual.echo_cliffs_like(0)
    first, again = (
        virtual.scan_around(truth, seed=5, stations=1, resolution_per_height=0.03)[0] for _ in range(2)
    )
    np.testing.assert_array_equal(first.points_m, again.points_m)


@pytest.mark.parametrize("suffix", [".ply", ".xyz", ".las", ".laz", ".pts", ".csv"])
def test_every_format_keeps_survey_coordinates_to_a_tenth_of_a_millimetre(tmp_path, suffix):
    survey_points = np.random.default_rng(4).uniform(0, 10, (2000, 3)) + virtual.DEMO_ORIGIN_M
    path = tmp_path / f"cloud{suffix}"
    _write(path, survey_points)
    cloud = read_clouds([path])
    np.testing.assert_allclose(cloud.points_m + cloud.origin_m, survey_points, rtol=0.0, atol=1e-4)


def _write_e57(path, points, position, turn=(1.0, 0.0, 0.0, 0.0)):
    """One scan: points in the scanner's frame, its position and its turn, a quaternion w, x, y, z."""
    import pye57

    file = pye57.E57(str(path), mode="w")
    file.write_scan_raw(
        dict(zip(("cartesianX", "cartesianY", "cartesianZ"), points.T.copy(), strict=True)),
        rotation=np.asarray(turn),
        translation=np.asarray(position),
    )
    file.close()


@pytest.mark.parametrize("turn_deg", [(0.0, 0.0, 0.0), (75.0, -20.0, 40.0)])
def test_stations_of_an_e57_file_keep_survey_coordinates_through_their_poses(tmp_path, turn_deg):
    # The writer stores points in single precision, as scanners do: in the station's frame, within 10 m of it, that
    # is a micrometre; the pose in double precision carries the survey coordinates.
    local = np.random.default_rng(4).uniform(-10, 10, (2000, 3))
    turn = Rotation.from_euler("zyx", turn_deg, degrees=True)
    path = tmp_path / "cloud.e57"
    _write_e57(path, local, virtual.DEMO_ORIGIN_M, np.roll(turn.as_quat(), 1))
    cloud = read_clouds([path])
    true = turn.apply(local) + virtual.DEMO_ORIGIN_M
    np.testing.assert_allclose(cloud.points_m + cloud.origin_m, true, rtol=0.0, atol=1e-5)


def test_an_e57_file_with_doubles_keeps_survey_coordinates(tmp_path, monkeypatch):
    import pye57.e57

    # The writer knows only singles; the format, and the reader, doubles too.
    monkeypatch.setattr(pye57.e57.libe57, "E57_SINGLE", pye57.e57.libe57.E57_DOUBLE)
    points = np.random.default_rng(4).uniform(-10, 10, (2000, 3)) + virtual.DEMO_ORIGIN_M
    path = tmp_path / "cloud.e57"
    _write_e57(path, points, np.zeros(3))
    cloud = read_clouds([path])
    np.testing.assert_allclose(cloud.points_m + cloud.origin_m, points, rtol=0.0, atol=1e-9)


def test_an_e57_file_with_survey_coordinates_as_singles_is_refused(tmp_path):
    points = np.random.default_rng(4).uniform(-10, 10, (2000, 3)) + virtual.DEMO_ORIGIN_M
    path = tmp_path / "cloud.e57"
    _write_e57(path, points, np.zeros(3))
    with pytest.raises(InputError, match="single precision"):
        read_clouds([path])


def _write(path, points):
    if path.suffix in (".las", ".laz"):
        import laspy

        header = laspy.LasHeader(point_format=1, version="1.2")
        header.offsets, header.scales = np.floor(points.min(axis=0)), np.full(3, 1e-4)
        las = laspy.LasData(header)
        las.x, las.y, las.z = points.T
        las.write(path)
    elif path.suffix == ".ply":
        head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
        head += "".join(f"property double {axis}\n" for axis in "xyz") + "end_header\n"
        path.write_bytes(head.encode() + points.astype("<f8").tobytes())
    else:
        head = f"{len(points)}\n" if path.suffix == ".pts" else "x,y,z\n" if path.suffix == ".csv" else ""
        delimiter = "," if path.suffix == ".csv" else " "
        path.write_text(head + "\n".join(delimiter.join(f"{c:.5f}" for c in row) for row in points))


@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize(("point_format", "version"), [(1, "1.2"), (6, "1.4")])
def test_points_that_the_user_deleted_or_classed_as_noise_are_not_read(
    tmp_path, suffix, point_format, version
):
    import laspy

    count = np.arange(4000)
    points = np.random.default_rng(4).uniform(0, 10, (4000, 3))
    las = laspy.LasData(laspy.LasHeader(point_format=point_format, version=version))
    las.x, las.y, las.z = points.T
    las.withheld, las.point_source_id = count % 4 == 0, 7 + (count >= 2000)
    las.classification = np.select([count % 8 == 1, count % 8 == 3], [7, 18], 2)
    path = tmp_path / f"cloud{suffix}"
    las.write(path)
    kept = (count % 4 == 2) | (count % 8 > 4) & (count % 4 != 0)
    cloud = read_clouds([path, path])
    first = int(kept.sum())
    assert cloud.files == ((path.name, first), (path.name, first))
    np.testing.assert_allclose(cloud.points_m[:first] + cloud.origin_m, points[kept], atol=0.01)
    assert cloud.station.tolist() == [*(count[kept] >= 2000), *(2 + (count[kept] >= 2000))]
    assert cloud.sources[0].left_out == 4000 - first
    assert f"{4000 - first} points are withheld or classed as noise" in cloud.sources[0].note


@pytest.mark.filterwarnings("error")  # which a user would read in front of the refusal
@pytest.mark.parametrize(
    ("name", "content", "what"),
    [
        ("absent.laz", None, "no such file"),
        ("empty.ply", b"", "has no PLY header"),
        ("noise.laz", b"not a laz file at all", "cannot be read"),
        ("cloud.doc", b"x", "unknown format"),
        ("few.xyz", b"1 2 3\n4 5 6\n", "holds 2 points"),
        ("nan.xyz", b"1 2 nan\n" * 2000, "not finite"),
    ],
)
def test_a_bad_file_is_refused_by_name(tmp_path, name, content, what):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=what) as error:
        read_clouds([path])
    assert name in error.value.where
