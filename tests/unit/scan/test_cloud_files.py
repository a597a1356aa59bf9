"""Clouds in files of scanners: poses by name, what came back from nowhere, steps, units and coordinate systems."""

import numpy as np
import open3d as o3d
import pye57
import pytest
from cloud_samples import las, ply, ptx, read
from pye57 import libe57
from pyproj import CRS
from refusals import refused
from scipy.spatial.transform import Rotation

from toppling.models.lengths import US_FOOT_M, size_note
from toppling.models.scan.plausible import step_note
from toppling.models.scan.read import read_clouds

SHIFT_M = np.array([331000.0, 3777000.0, 470.0])
POINTS_M = np.random.default_rng(5).uniform(0.0, 12.0, (1500, 3)) + SHIFT_M
TURN = Rotation.from_euler("zyx", [130.0, 20.0, -35.0], degrees=True)
STILL = Rotation.identity(), np.zeros(3)


@pytest.mark.parametrize("suffix", [".ply", ".xyz", ".las", ".laz", ".pts", ".csv"])
def test_every_format_keeps_survey_coordinates_to_a_tenth_of_a_millimetre(tmp_path, suffix):
    path = tmp_path / f"cloud{suffix}"
    if suffix in (".las", ".laz", ".ply"):
        (ply if suffix == ".ply" else las)(path, POINTS_M)
    else:
        head = {".pts": "1500", ".csv": "x,y,z"}.get(suffix, "")
        np.savetxt(path, POINTS_M, "%.5f", "," if suffix == ".csv" else " ", header=head, comments="")
    np.testing.assert_allclose(read(path), POINTS_M, rtol=0.0, atol=1e-4)


@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize("version", ["1.2", "1.4"])
def test_points_that_the_user_deleted_or_classed_as_noise_are_not_read(tmp_path, suffix, version):
    count, points = np.arange(3000), np.vstack([POINTS_M, POINTS_M + 5.0])
    path = las(
        tmp_path / f"cloud{suffix}",
        points,
        version=version,
        withheld=count % 4 == 0,
        point_source_id=7 + (count >= 700),
        classification=np.select([count % 8 == 1, count % 8 == 3], [7, 18], 2),
    )
    kept = (count % 4 == 2) | (count % 8 > 4) & (count % 4 != 0)
    cloud = read_clouds([path, path])
    first = int(kept.sum())
    assert cloud.files == ((path.name, first), (path.name, first))
    np.testing.assert_allclose(cloud.points_m[:first] + cloud.origin_m, points[kept], atol=1e-4)
    assert cloud.station.tolist() == [*(count[kept] >= 700), *(2 + (count[kept] >= 700))]
    assert cloud.sources[0].left_out == len(count) - first
    assert f"{len(count) - first} points are withheld or classed as noise" in cloud.sources[0].note


def cartesian(points):
    return {f"cartesian{axis}": points[:, "XYZ".index(axis)] for axis in "ZXY"}


def spherical(points):
    far = np.linalg.norm(points, axis=1)
    return {
        "sphericalRange": far,
        "sphericalAzimuth": np.arctan2(points[:, 1], points[:, 0]),
        "sphericalElevation": np.arcsin(points[:, 2] / far),
    }


def invalid_where(bad):
    """Cartesian coordinates, those of some rows flagged; the library takes no wider states."""
    return lambda points: {**cartesian(points), "cartesianInvalidState": (2 * bad(points)).astype(np.int8)}


def all_of(points):
    return np.ones(len(points), bool)


def spherical_beside_invalid(points):
    """As of a scanner whose export has filled the spherical coordinates alone."""
    return {**invalid_where(all_of)(points + 1.0), **spherical(points)}


def spherical_beside_nan(points):
    return {**cartesian(np.full_like(points, np.nan)), **spherical(points)}


def e57(path, scans, rotation="wxyz", translation="xyz", scale=0.0, description="", columns_of=cartesian):
    """Scans (points, turn, shift) with the children of their poses in the given order; a scale makes them integers."""
    with pye57.E57(str(path), mode="w") as file:
        image = file.image_file

        def structure(**numbers):
            node = libe57.StructureNode(image)
            for name, value in numbers.items():
                node.set(name, libe57.FloatNode(image, float(value)))
            return node

        for points, turn, shift in scans:
            node, pose = structure(), structure()
            node.set("guid", libe57.StringNode(image, "{g}"))
            if description:
                node.set("description", libe57.StringNode(image, description))
            quaternion = dict(zip("xyzw", turn.as_quat(), strict=True))
            place = dict(zip("xyz", shift, strict=True))
            if rotation:
                pose.set("rotation", structure(**{name: quaternion[name] for name in rotation}))
            if translation:
                pose.set("translation", structure(**{name: place[name] for name in translation}))
            if rotation or translation:
                node.set("pose", pose)
            prototype = libe57.StructureNode(image)
            columns = {name: np.ascontiguousarray(column) for name, column in columns_of(points).items()}
            for name, column in columns.items():
                if column.dtype.kind == "i":
                    value = libe57.IntegerNode(image, 0, 0, 2)
                elif scale:
                    value = libe57.ScaledIntegerNode(image, 0, -(2**31), 2**31 - 1, scale, 0.0)
                else:
                    value = libe57.FloatNode(image, 0.0, libe57.E57_DOUBLE, -1e9, 1e9)
                prototype.set(name, value)
            vector = libe57.CompressedVectorNode(image, prototype, libe57.VectorNode(image, True))
            node.set("points", vector)
            file.data3d.append(node)
            if not len(points):
                continue
            buffers = libe57.VectorSourceDestBuffer()
            for name, column in columns.items():
                buffers.append(libe57.SourceDestBuffer(image, name, column, len(column), True, True))
            writer = vector.writer(buffers)
            writer.write(len(points))
            writer.close()
    return path


def own_frame(points, turn, shift):
    return turn.inv().apply(points - shift)


SCAN = own_frame(POINTS_M, TURN, SHIFT_M), TURN, SHIFT_M
EMPTY = np.empty((0, 3)), TURN, SHIFT_M
HALVES = [
    (own_frame(part, *pose), *pose)
    for part, pose in zip(np.split(POINTS_M, 2), [(TURN, SHIFT_M), (TURN.inv(), SHIFT_M + 3.0)], strict=True)
]


@pytest.mark.parametrize(
    ("scans", "how", "stations"),
    [
        *((HALVES, {"rotation": r, "translation": t, "scale": s}, 2)
          for r in ("wxyz", "xyzw", "zwyx") for t in ("xyz", "zxy") for s in (0.0, 1e-5)),
        *(([SCAN], {"columns_of": of}, 1) for of in (spherical_beside_invalid, spherical_beside_nan)),
        ([(POINTS_M - SHIFT_M, STILL[0], SHIFT_M)], {"rotation": ""}, 1),
        ([(own_frame(POINTS_M, TURN, STILL[1]), TURN, STILL[1])], {"translation": ""}, 1),
        ([(POINTS_M, *STILL)], {"rotation": "", "translation": ""}, 1),
        ([EMPTY, SCAN, EMPTY], {}, 1),
    ],
)  # fmt: skip
def test_stations_of_an_e57_file_keep_survey_coordinates_however_their_poses_are_written(
    tmp_path, scans, how, stations
):
    path = e57(tmp_path / "cloud.e57", scans, **how)
    np.testing.assert_allclose(read(path), POINTS_M, rtol=0.0, atol=1e-4 if how.get("scale") else 1e-6)
    assert set(read_clouds([path]).station) == set(range(stations))


def singles(path, points):
    """As of a writer that stores points in single precision, as scanners do in the station's own frame."""
    file = pye57.E57(str(path), mode="w")
    file.write_scan_raw(
        {f"cartesian{axis}": points[:, k].copy() for k, axis in enumerate("XYZ")},
        rotation=np.array([1.0, 0.0, 0.0, 0.0]), translation=np.zeros(3),
    )  # fmt: skip
    file.close()
    return path


@pytest.mark.parametrize(
    ("write", "how", "told"),
    [
        (e57, {"rotation": "xyz"}, "cloud.pose_incomplete"),
        (e57, {"columns_of": invalid_where(all_of)}, "cloud.too_few_points"),
        (e57, {"description": "units: US survey feet"}, "coordinates.unit_not_metres"),
        (lambda path, scans: singles(path, scans[0][0]), {}, "coordinates.too_coarse"),
    ],
)
def test_an_e57_file_that_does_not_say_where_its_points_are_is_refused(tmp_path, write, how, told):
    path = write(tmp_path / "cloud.e57", [(POINTS_M, *STILL)], **how)
    with refused(told):
        read(path)
    if "description" in how:
        np.testing.assert_allclose(read(path, "m"), POINTS_M, atol=1e-6)


def tenth(points):
    return np.arange(len(points)) % 10 == 0


@pytest.mark.parametrize(
    ("points", "columns_of", "kept", "said"),
    [
        (SCAN[0], invalid_where(tenth), ~tenth(POINTS_M), "150 points are flagged invalid and were left out"),
        # The scanner's own frame has 0, 0, 0 where no beam came back: in the survey's frame that is the tripod.
        (np.vstack([np.zeros((40, 3)), SCAN[0]]), cartesian, all_of(POINTS_M), "40 points lie at 0, 0, 0 of their"),
    ],
)  # fmt: skip
def test_what_a_scanner_did_not_measure_is_left_out_and_counted(tmp_path, points, columns_of, kept, said):
    path = e57(tmp_path / "cloud.e57", [(points, TURN, SHIFT_M)], columns_of=columns_of)
    np.testing.assert_allclose(read(path), POINTS_M[kept], atol=1e-6)
    (source,) = read_clouds([path]).sources
    assert source.left_out == len(points) - kept.sum()
    assert said in source.note


def test_scans_of_a_ptx_are_stations_in_the_surveys_frame(tmp_path):
    other = Rotation.from_euler("z", -40.0, degrees=True), SHIFT_M + 5.0
    scans = [
        (np.vstack([np.zeros((7, 3)), own_frame(POINTS_M[:900], TURN, SHIFT_M)]), TURN, SHIFT_M),
        (np.zeros((3, 3)), *other),
        (own_frame(POINTS_M[900:], *other), *other),
    ]
    path = ptx(tmp_path / "cloud.ptx", scans)
    np.testing.assert_allclose(read(path), POINTS_M, atol=1e-6)
    cloud = read_clouds([path])
    assert np.bincount(cloud.station).tolist() == [900, 600]
    assert cloud.sources[0].left_out == 10


@pytest.mark.parametrize("mark", [-9999.0, -32768.0, 1e30, -3.4e38])
@pytest.mark.parametrize("axes", [slice(0, 3), slice(2, 3)])
def test_what_stands_for_not_measured_is_left_out_and_counted(tmp_path, mark, axes):
    local = (POINTS_M - SHIFT_M).astype(np.float32).astype(float)
    points = local.copy()
    points[::5, axes] = mark
    np.savetxt(tmp_path / "cloud.xyz", points, fmt="%.9g")
    cloud = read_clouds([tmp_path / "cloud.xyz"])
    np.testing.assert_allclose(cloud.points_m + cloud.origin_m, np.delete(local, slice(0, None, 5), 0))
    assert "300 points are marked as not measured" in cloud.sources[0].note
    assert cloud.sources[0].step_m < 1e-5  # that of single precision is no wider for the mark's size


@pytest.mark.parametrize("name", ["cloud.pcd", "cloud.ply", "ascii.pcd", "cloud.xyz"])
def test_points_that_are_not_finite_are_left_out_and_counted(tmp_path, name):
    points = POINTS_M.copy()
    points[::5], points[1, 2] = np.nan, np.inf
    kept = np.isfinite(points).all(axis=1)
    if name.endswith(".xyz"):
        np.savetxt(tmp_path / name, points, fmt="%.6f")
    else:
        organised = o3d.t.geometry.PointCloud(points)
        o3d.t.io.write_point_cloud(str(tmp_path / name), organised, write_ascii=name.startswith("ascii"))
    cloud = read_clouds([tmp_path / name])
    np.testing.assert_allclose(cloud.points_m + cloud.origin_m, points[kept], atol=1e-3)
    assert (cloud.sources[0].left_out, cloud.files[0][1]) == ((~kept).sum(), kept.sum())
    assert f"{(~kept).sum()} points are not finite" in cloud.sources[0].note


@pytest.mark.parametrize("step", [0.0005, 0.002, 0.01, 0.1])
def test_steps_are_seen_in_whatever_format_and_through_a_pose_that_turns(tmp_path, step):
    points = (POINTS_M / step).round() * step
    turned = (SCAN[0] / step).round() * step
    np.savetxt(tmp_path / "cloud.xyz", points, fmt="%.6f")
    paths = [
        las(tmp_path / "cloud.las", points, step / 10.0),  # a fine scale brings back nothing
        tmp_path / "cloud.xyz",
        e57(tmp_path / "cloud.e57", [(points - SHIFT_M, *STILL)], scale=step, translation="", rotation=""),
        e57(tmp_path / "turned.e57", [(turned, TURN, SHIFT_M)], scale=step),
    ]
    for path in paths:
        assert read_clouds([path]).coarsest.step_m == pytest.approx(step, rel=1e-3), path.name


def test_steps_are_fine_then_told_then_refused():
    assert step_note(0.001, 1.5) == ""
    assert "1/500 of the rock's height" in step_note(0.002, 1.0)
    # g r / z of a block .4 m wide and 1 m high: a half step less of r is 1 mm, of z .5 m
    assert f"by {0.001 / 0.5:.1g} g;" in step_note(0.002, 1.0)
    with refused("coordinates.too_coarse", "0.02"):
        step_note(0.02, 1.0)


@pytest.mark.filterwarnings("error")  # which a user would read in front of the refusal
@pytest.mark.parametrize(
    ("name", "write", "told"),
    [
        ("absent.laz", None, "file.absent"),
        ("scans", lambda path: path.mkdir(), "file.is_folder"),
        ("cloud.doc", lambda path: path.write_bytes(b"x"), "cloud.format_unknown"),
        *((name, lambda path: path.write_bytes(b""), "file.unreadable") for name in ("empty.laz", "empty.e57")),
        ("torn.laz", lambda path: path.write_bytes(b"LASF" + bytes(200)), "file.unreadable"),
        ("noise.laz", lambda path: path.write_bytes(b"not a laz file at all"), "file.unreadable"),
        ("empty.ply", lambda path: path.write_bytes(b""), "ply.header_unreadable"),
        ("bare.ply", lambda path: ply(path, np.zeros(5000), axes=["intensity"]), "cloud.no_coordinates"),
        # 3,777,000 lies between 2^21 and 2^22: neighbouring single-precision numbers differ by 2^-2.
        ("single.ply", lambda path: ply(path, POINTS_M, kind="float"), "coordinates.too_coarse"),
        ("single.e57", lambda path: singles(path, POINTS_M), "coordinates.too_coarse"),
        ("returns.ply", lambda path: ply(path, np.vstack([POINTS_M, np.zeros((70, 3))])), "cloud.empty_returns"),
        ("place.ply", lambda path: ply(path, np.zeros((2000, 3))), "cloud.one_place"),
    ],
)  # fmt: skip
def test_a_file_that_is_no_cloud_is_refused_by_name(tmp_path, name, write, told):
    path = tmp_path / name
    if write is not None:
        write(path)
    with refused(told) as error:
        read_clouds([path])
    assert name in error.value.where


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("columns\n1\n", "cloud.header_unreadable"),
        ("3\n1\n0 0 0\n1 0 0\n", "cloud.header_unreadable"),
        ("999999999\n9\n" + "0 0 0\n" * 4 + "1 0 0 0\n" * 4, "file.truncated"),
        ("2\n1\n" + "0 0 0\n" * 4 + "1 0 0 0\n0 1 0 0\n0 0 1 0\n5 5 5 1\n1 2 3 .5\n" + "\n" * 40, "file.truncated"),
        ("1\n1\n" + "0 0 0\n" * 4 + "1 0 0 5\n0 1 0 5\n0 0 1 5\n0 0 0 1\n1 2 3 .5\n", "cloud.pose_unusable"),
        ("1\n1\n" + "0 0 0\n" * 4 + "2 0 0 0\n0 2 0 0\n0 0 2 0\n0 0 0 1\n1 2 3 .5\n", "cloud.pose_unusable"),
    ],
)  # fmt: skip
def test_a_ptx_that_is_damaged_or_scaled_is_refused_by_what_is_wrong(tmp_path, content, said):
    (tmp_path / "cloud.ptx").write_text(content)
    with refused(said):
        read(tmp_path / "cloud.ptx")


FOOT_PLANE, METRE_PLANE, DEGREES = 2229, 32611, 4326
NAVD88_M, NAVD88_US_FT = 5703, 6360


def scaled(path, metres_per_unit=(1.0, 1.0), **system):
    """A LAS file whose numbers are POINTS_M in units of so many metres, across and upward."""
    across, up = metres_per_unit
    return las(path, POINTS_M / (across, across, up), **system)


def wkt_of(plane, vertical=None, version="WKT2_2019"):
    crs = CRS.from_epsg(plane)
    if vertical is not None:
        crs = CRS.from_user_input(f"EPSG:{plane}+{vertical}")
    return crs.to_wkt(version)


@pytest.mark.parametrize("version", ["WKT1_GDAL", "WKT2_2019"])
@pytest.mark.parametrize("las_version", ["1.2", "1.4"])
@pytest.mark.parametrize(
    ("plane", "vertical", "metres_per_unit"),
    [
        (FOOT_PLANE, NAVD88_US_FT, (US_FOOT_M, US_FOOT_M)),
        (FOOT_PLANE, NAVD88_M, (US_FOOT_M, 1.0)),
        (FOOT_PLANE, None, (US_FOOT_M, US_FOOT_M)),
        (2222, None, (0.3048, 0.3048)),  # Arizona: international feet
        (METRE_PLANE, NAVD88_US_FT, (1.0, US_FOOT_M)),
        (METRE_PLANE, NAVD88_M, (1.0, 1.0)),
    ],
)
def test_units_of_a_coordinate_system_in_words_are_read(
    tmp_path, version, las_version, plane, vertical, metres_per_unit
):
    path = scaled(
        tmp_path / "cloud.las", metres_per_unit, wkt=wkt_of(plane, vertical, version), version=las_version
    )
    np.testing.assert_allclose(read(path), POINTS_M, atol=1e-4)


@pytest.mark.parametrize(
    ("keys", "doubles", "metres_per_unit"),
    [
        ([(1024, 1), (3072, FOOT_PLANE)], (), (US_FOOT_M, US_FOOT_M)),
        ([(1024, 1), (3072, METRE_PLANE), (4099, 9003)], (), (1.0, US_FOOT_M)),
        ([(1024, 1), (3072, METRE_PLANE), (4096, NAVD88_US_FT)], (), (1.0, US_FOOT_M)),
        ([(1024, 1), (3072, 32767), (3076, 9002), (4099, 9001)], (), (0.3048, 1.0)),
        ([(1024, 1), (3072, 32767), (3076, 9002)], (), (0.3048, 0.3048)),
        ([(1024, 1), (3076, 32767), (3077, 0)], (0.9144,), (0.9144, 0.9144)),
        ([(3072, METRE_PLANE)], (), (1.0, 1.0)),
        ([(1025, 1)], (), (1.0, 1.0)),
    ],
)
def test_units_of_geotiff_keys_are_read(tmp_path, keys, doubles, metres_per_unit):
    path = scaled(tmp_path / "cloud.laz", metres_per_unit, keys=keys, doubles=doubles)
    np.testing.assert_allclose(read(path), POINTS_M, atol=1e-4)


@pytest.mark.parametrize(
    ("system", "what"),
    [
        *((system, "coordinates.in_degrees") for system in (
            {"wkt": wkt_of(DEGREES)}, {"wkt": wkt_of(DEGREES, version="WKT1_GDAL")},
            {"keys": [(1024, 2), (2048, DEGREES)]}, {"keys": [(2048, DEGREES)]},
        )),
        ({"wkt": wkt_of(4978)}, "coordinates.geocentric"),
        ({"wkt": 'PROJCS["broken", UNIT["furlong"'}, "coordinates.crs_unknown"),
        ({"keys": [(1024, 1), (3072, 1)]}, "coordinates.crs_unknown"),
        ({"keys": [(1024, 1), (3076, 9102)]}, "coordinates.crs_unknown"),
    ],
)  # fmt: skip
def test_a_system_without_lengths_or_sense_is_refused_and_the_users_word_overrules_it(tmp_path, system, what):
    path = scaled(tmp_path / "cloud.las", **system)
    with refused(what) as error:
        read_clouds([path])
    assert "cloud.las" in error.value.where
    if what != "coordinates.in_degrees":
        np.testing.assert_allclose(read(path, "m"), POINTS_M, atol=1e-4)


@pytest.mark.parametrize(
    "comment",
    [
        "comment units: feet", "comment unit mm", "comment Units are in US Survey Feet", "obj_info units = centimeters",
        "comment coordinates in inches, z up", "comment all values given in millimeters", "comment measured in yards",
        "comment California zone 5, US survey feet", "comment units: cubits", "comment units: degrees",
        "comment units: feet\ncomment unit: m", "comment vertical units: feet", "comment EPSG:2229",
        f"comment crs {wkt_of(FOOT_PLANE, NAVD88_US_FT, 'WKT1_GDAL')}",
        f"comment {wkt_of(METRE_PLANE)}".replace("\n", " "),
    ],
)  # fmt: skip
def test_a_remark_that_states_another_unit_or_a_system_is_refused_until_the_user_says_the_unit(
    tmp_path, comment
):
    path = ply(tmp_path / "cloud.ply", POINTS_M / 0.3048, comment)
    with refused("coordinates.unit_not_metres"):
        read_clouds([path])
    np.testing.assert_allclose(read(path, "ft"), POINTS_M, atol=1e-4)


@pytest.mark.parametrize(
    ("height_m", "volume_m3", "told"),
    [(14.05, 583.0, 0), (46.1, 20586.0, 1), (4.28, 583.0, 1), (46.1, 583.0, 1), (20.0, 6000.0, 1)],
)
def test_sizes_that_no_known_rock_has_are_told(height_m, volume_m3, told):
    assert bool(size_note(height_m, volume_m3)) == told
