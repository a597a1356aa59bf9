"""Clouds in files of scanners are the same however they are written; what nobody measured is left out and counted."""

from functools import partial

import numpy as np
import open3d as o3d
import pye57
import pytest
from cloud_samples import las, ply, ptx, read
from pye57 import libe57
from pyproj import CRS
from refusals import refused
from scipy.spatial.transform import Rotation

from toppling.models.lengths import US_FOOT_M, too_large
from toppling.models.scan.plausible import step_note
from toppling.models.scan.read import read_clouds

SHIFT_M = np.array([331000.0, 3777000.0, 470.0])
POINTS_M = np.random.default_rng(5).uniform(0.0, 12.0, (1500, 3)) + SHIFT_M
LOCAL_M = (POINTS_M - SHIFT_M).astype(np.float32).astype(float)
TURN = Rotation.from_euler("zyx", [130.0, 20.0, -35.0], degrees=True)
STILL = Rotation.identity(), np.zeros(3)


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


def tenth(points):
    return np.arange(len(points)) % 10 == 0


def spherical_with_invalid(points):
    """File of a scanner whose export has filled the spherical coordinates alone."""
    return {**invalid_where(all_of)(points + 1.0), **spherical(points)}


def spherical_with_nan(points):
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


def singles(path, points):
    """File of a writer that stores points in single precision, as scanners do in the station's own frame."""
    file = pye57.E57(str(path), mode="w")
    file.write_scan_raw(
        {f"cartesian{axis}": points[:, k].copy() for k, axis in enumerate("XYZ")},
        rotation=np.array([1.0, 0.0, 0.0, 0.0]), translation=np.zeros(3),
    )  # fmt: skip
    file.close()


def text(path, points=POINTS_M, sign=" ", head=""):
    np.savetxt(path, points, "%.12g", sign, header=head, comments="")


def tensor(path, points, **options):
    o3d.t.io.write_point_cloud(str(path), o3d.t.geometry.PointCloud(points), **options)


def ascii_ply(path, points=POINTS_M, end="\n", remark="", count=None, first=""):
    head = ["ply", "format ascii 1.0", f"comment {remark}", f"element vertex {count or len(points)}"]
    head += [*(f"property double {axis}" for axis in "xyz"), "end_header"]
    rows = [" ".join(map(repr, map(float, point))) for point in points]
    path.write_bytes((end.join([*head, first + rows[0], *rows[1:]]) + end).encode())


def own_frame(points, turn, shift):
    return turn.inv().apply(points - shift)


SCAN = own_frame(POINTS_M, TURN, SHIFT_M), TURN, SHIFT_M
EMPTY = np.empty((0, 3)), TURN, SHIFT_M
HALVES = [
    (own_frame(part, *pose), *pose)
    for part, pose in zip(np.split(POINTS_M, 2), [(TURN, SHIFT_M), (TURN.inv(), SHIFT_M + 3.0)], strict=True)
]
FOOT_PLANE, METRE_PLANE, DEGREES = 2229, 32611, 4326
NAVD88_M, NAVD88_US_FT = 5703, 6360


def wkt_of(plane, vertical=None, version="WKT2_2019"):
    return CRS.from_user_input(f"EPSG:{plane}" + (f"+{vertical}" if vertical else "")).to_wkt(version)


def scaled(metres_per_unit=(1.0, 1.0), **system):
    """A writer of LAS whose numbers are POINTS_M in units of so many metres, across and upward."""
    across, up = metres_per_unit
    return lambda path: las(path, POINTS_M / (across, across, up), **system)


SAME = [
    *((f"cloud{suffix}", write, 1e-4, 1) for suffix, write in {
        ".ply": partial(ply, points=POINTS_M), ".las": partial(las, points=POINTS_M), ".xyz": text,
        ".laz": partial(las, points=POINTS_M), ".pts": partial(text, head="1500"),
        ".csv": partial(text, sign=",", head="x,y,z"),
    }.items()),
    *(("cloud.ply", partial(ascii_ply, **how), 1e-12, 1) for how in (
        {}, {"end": "\r\n"}, {"end": "\r"}, {"remark": "y" * 5000})),
    *(("cloud.e57", partial(e57, scans=HALVES, rotation=r, translation=t, scale=s), 1e-4 if s else 1e-6, 2)
      for r in ("wxyz", "xyzw", "zwyx") for t in ("xyz", "zxy") for s in (0.0, 1e-5)),
    *(("cloud.e57", partial(e57, scans=scans, **how), 1e-6, 1) for scans, how in (
        ([SCAN], {"columns_of": spherical_with_invalid}), ([SCAN], {"columns_of": spherical_with_nan}),
        ([(POINTS_M - SHIFT_M, STILL[0], SHIFT_M)], {"rotation": ""}), ([EMPTY, SCAN, EMPTY], {}),
        ([(own_frame(POINTS_M, TURN, STILL[1]), TURN, STILL[1])], {"translation": ""}),
        ([(POINTS_M, *STILL)], {"rotation": "", "translation": ""}))),
    # coordinate systems in words
    *(("cloud.las", scaled(metres, wkt=wkt_of(plane, vertical, words), version=version), 1e-4, 1)
      for words in ("WKT1_GDAL", "WKT2_2019") for version in ("1.2", "1.4") for plane, vertical, metres in (
        (FOOT_PLANE, NAVD88_US_FT, (US_FOOT_M, US_FOOT_M)), (FOOT_PLANE, NAVD88_M, (US_FOOT_M, 1.0)),
        (FOOT_PLANE, None, (US_FOOT_M, US_FOOT_M)), (METRE_PLANE, NAVD88_US_FT, (1.0, US_FOOT_M)),
        (2222, None, (0.3048, 0.3048)),  # Arizona: international feet
        (METRE_PLANE, NAVD88_M, (1.0, 1.0)))),
    # and in GeoTIFF's keys
    *(("cloud.laz", scaled(metres, keys=keys, doubles=doubles), 1e-4, 1) for keys, doubles, metres in (
        ([(1024, 1), (3072, FOOT_PLANE)], (), (US_FOOT_M, US_FOOT_M)),
        ([(1024, 1), (3072, METRE_PLANE), (4099, 9003)], (), (1.0, US_FOOT_M)),
        ([(1024, 1), (3072, METRE_PLANE), (4096, NAVD88_US_FT)], (), (1.0, US_FOOT_M)),
        ([(1024, 1), (3072, 32767), (3076, 9002), (4099, 9001)], (), (0.3048, 1.0)),
        ([(1024, 1), (3072, 32767), (3076, 9002)], (), (0.3048, 0.3048)),
        ([(1024, 1), (3076, 32767), (3077, 0)], (0.9144,), (0.9144, 0.9144)),
        ([(3072, METRE_PLANE)], (), (1.0, 1.0)), ([(1025, 1)], (), (1.0, 1.0)))),
]  # fmt: skip
"""POINTS_M as files: the name, the writer, within how many metres, and from how many stations."""


@pytest.mark.parametrize(("name", "write", "within_m", "stations"), SAME)
def test_a_cloud_retains_its_coordinates_and_stations_however_it_is_written(
    tmp_path, name, write, within_m, stations
):
    write(tmp_path / name)
    np.testing.assert_allclose(read(tmp_path / name), POINTS_M, rtol=0.0, atol=within_m)
    assert set(read_clouds([tmp_path / name]).station) == set(range(stations))


def with_values(value, *places):
    points = LOCAL_M.copy()
    for place in places:
        points[place] = value
    return points


OTHER = Rotation.from_euler("z", -40.0, degrees=True), SHIFT_M + 5.0
PTX = [
    (np.vstack([np.zeros((7, 3)), own_frame(POINTS_M[:900], TURN, SHIFT_M)]), TURN, SHIFT_M),
    (np.zeros((3, 3)), *OTHER), (own_frame(POINTS_M[900:], *OTHER), *OTHER),
]  # fmt: skip
HOLES = with_values(np.nan, slice(0, None, 5), (1, 2))
LEFT_OUT = [
    ("cloud.e57", partial(e57, scans=[SCAN], columns_of=invalid_where(tenth)), POINTS_M[~tenth(POINTS_M)], 150,
     "flagged invalid"),
    # The scanner's own frame has 0, 0, 0 where no beam came back: in the survey's frame that is the tripod.
    ("cloud.e57", partial(e57, scans=[(np.vstack([np.zeros((40, 3)), SCAN[0]]), TURN, SHIFT_M)]), POINTS_M, 40,
     "lie at 0, 0, 0"),
    ("cloud.ptx", partial(ptx, scans=PTX), POINTS_M, 10, "lie at 0, 0, 0"),
    *(("cloud.xyz", partial(text, points=with_values(mark, (slice(0, None, 5), axes))),
       np.delete(LOCAL_M, slice(0, None, 5), 0), 300, "marked as not measured")
      for mark in (-9999.0, -32768.0, 1e30, -3.4e38) for axes in (slice(0, 3), slice(2, 3))),
    *((name, write, HOLES[np.isfinite(HOLES).all(axis=1)], 301, "are not finite") for name, write in (
        ("cloud.xyz", partial(text, points=HOLES)), ("cloud.pcd", partial(tensor, points=HOLES)),
        ("cloud.ply", partial(tensor, points=HOLES)),
        ("cloud.pcd", partial(tensor, points=HOLES, write_ascii=True)))),
]  # fmt: skip
"""What was not measured: the writer, the points that were, how many were not, and what is said of them."""


@pytest.mark.parametrize(("name", "write", "want", "count", "stated"), LEFT_OUT)
def test_what_a_scanner_did_not_measure_is_left_out_and_counted(tmp_path, name, write, want, count, stated):
    write(tmp_path / name)
    cloud = read_clouds([tmp_path / name])
    np.testing.assert_allclose(cloud.points_m + cloud.origin_m, want, atol=1e-6)
    assert (cloud.sources[0].left_out, cloud.files[0][1]) == (count, len(want))
    assert f"{count} points " in cloud.sources[0].note
    assert stated in cloud.sources[0].note
    if name == "cloud.ptx":
        assert np.bincount(cloud.station).tolist() == [900, 600]
    if name == "cloud.xyz":  # the step of single precision is no wider for a mark's size
        assert cloud.sources[0].step_m < 1e-5


@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize("version", ["1.2", "1.4"])
def test_points_that_the_user_deleted_or_classed_as_noise_are_not_read(tmp_path, suffix, version):
    count, points = np.arange(3000), np.vstack([POINTS_M, POINTS_M + 5.0])
    path = las(
        tmp_path / f"cloud{suffix}", points, version=version, withheld=count % 4 == 0,
        point_source_id=7 + (count >= 700), classification=np.select([count % 8 == 1, count % 8 == 3], [7, 18], 2),
    )  # fmt: skip
    mask = (count % 4 == 2) | (count % 8 > 4) & (count % 4 != 0)
    cloud = read_clouds([path, path])
    first = int(mask.sum())
    assert cloud.files == ((path.name, first), (path.name, first))
    np.testing.assert_allclose(cloud.points_m[:first] + cloud.origin_m, points[mask], atol=1e-4)
    assert cloud.station.tolist() == [*(count[mask] >= 700), *(2 + (count[mask] >= 700))]
    assert cloud.sources[0].left_out == len(count) - first
    assert f"{len(count) - first} points are withheld or classed as noise" in cloud.sources[0].note


@pytest.mark.parametrize("step", [0.0005, 0.002, 0.01, 0.1])
def test_steps_are_seen_in_whatever_format_and_through_a_pose_that_turns(tmp_path, step):
    points, turned = ((v / step).round() * step for v in (POINTS_M, SCAN[0]))
    las(tmp_path / "cloud.las", points, step / 10.0)  # a fine scale brings back nothing
    text(tmp_path / "cloud.xyz", points)
    e57(tmp_path / "cloud.e57", [(points - SHIFT_M, *STILL)], scale=step, translation="", rotation="")
    e57(tmp_path / "turned.e57", [(turned, TURN, SHIFT_M)], scale=step)
    for path in tmp_path.iterdir():
        assert read_clouds([path]).coarsest.step_m == pytest.approx(step, rel=1e-3), path.name


def test_coarse_steps_are_accepted_then_warned_of_then_refused():
    assert step_note(0.001, 1.5) == ""
    assert "1/500 of the rock's height" in step_note(0.002, 1.0)
    # g r / z of a block .4 m wide and 1 m high: a half step less of r is 1 mm, of z .5 m
    assert f"by {0.001 / 0.5:.1g} g;" in step_note(0.002, 1.0)
    with refused("coordinates.too_coarse", "0.02"):
        step_note(0.02, 1.0)


def content(given):
    return lambda path: path.write_bytes(given if isinstance(given, bytes) else given.encode())


def with_count(at, version):
    """LAZ that counts four thousand million points or records of some kind."""

    def write(path):
        las(path, POINTS_M, version=version)
        bad = bytearray(path.read_bytes())
        bad[at : at + 4] = (2**32 - 1).to_bytes(4, "little")
        path.write_bytes(bad)

    return write


def cut_pcd(write_ascii):
    def write(path):
        tensor(path, POINTS_M, write_ascii=write_ascii)
        path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])

    return write


ORIGIN, UNIT = "0 0 0\n" * 4, "1 0 0 0\n" * 4
REFUSED = {
    "file.absent": [("absent.laz", lambda path: None)],
    "file.is_folder": [("scans", lambda path: path.mkdir())],
    "cloud.format_unknown": [("cloud.doc", content("x"))],
    "file.unreadable": [
        ("empty.laz", content("")), ("empty.e57", content("")), ("torn.laz", content(b"LASF" + bytes(200))),
        ("noise.laz", content("not a laz file at all")),
        ("digits.ply", partial(ascii_ply, first="1" * 5000 + " ")),
        ("wide.ply", partial(ascii_ply, first="1.0 " * 1500)),
    ],
    "ply.header_unreadable": [("empty.ply", content("")), ("many.ply", partial(ascii_ply, count=10**19))],
    "file.truncated": [
        *(("few.ply", partial(ascii_ply, count=n)) for n in (10**15, 4000)),
        ("cut.pcd", cut_pcd(write_ascii=False)), ("cut.pcd", cut_pcd(write_ascii=True)),
        *(("many.laz", with_count(*e)) for e in ((107, "1.2"), (100, "1.2"), (100, "1.4"), (243, "1.4"))),
        ("many.ptx", content(f"999999999\n9\n{ORIGIN}{UNIT}")),
        ("few.ptx", content(f"2\n1\n{ORIGIN}1 0 0 0\n0 1 0 0\n0 0 1 0\n5 5 5 1\n1 2 3 .5\n" + "\n" * 40)),
    ],
    "cloud.header_unreadable": [("words.ptx", content("columns\n1\n")), ("n.ptx", content("3\n1\n0 0 0\n1 0 0\n"))],
    "cloud.pose_unusable": [
        ("bent.ptx", content(f"1\n1\n{ORIGIN}1 0 0 5\n0 1 0 5\n0 0 1 5\n0 0 0 1\n1 2 3 .5\n")),
        ("scaled.ptx", content(f"1\n1\n{ORIGIN}2 0 0 0\n0 2 0 0\n0 0 2 0\n0 0 0 1\n1 2 3 .5\n")),
    ],
    "cloud.pose_incomplete": [("cloud.e57", partial(e57, scans=[(POINTS_M, *STILL)], rotation="xyz"))],
    "cloud.too_few_points": [("cloud.e57", partial(e57, scans=[(POINTS_M, *STILL)], columns_of=invalid_where(all_of)))],
    "cloud.no_coordinates": [("bare.ply", partial(ply, points=np.zeros(5000), axes=["intensity"]))],
    # 3,777,000 lies between 2^21 and 2^22: neighbouring single-precision numbers differ by 2^-2.
    "coordinates.too_coarse": [
        ("single.ply", partial(ply, points=POINTS_M, kind="float")),
        ("single.e57", partial(singles, points=POINTS_M)),
    ],
    "cloud.empty_returns": [("returns.ply", partial(ply, points=np.vstack([POINTS_M, np.zeros((70, 3))])))],
    "cloud.one_place": [("place.ply", partial(ply, points=np.zeros((2000, 3))))],
    "coordinates.in_degrees": [("cloud.las", scaled(**system)) for system in (
        {"wkt": wkt_of(DEGREES)}, {"wkt": wkt_of(DEGREES, version="WKT1_GDAL")}, {"keys": [(2048, DEGREES)]},
        {"keys": [(1024, 2), (2048, DEGREES)]})],
    # what follows is read once the user says the unit
    "coordinates.geocentric": [("cloud.las", scaled(wkt=wkt_of(4978)), "m")],
    "coordinates.crs_unknown": [("cloud.las", scaled(**system), "m") for system in (
        {"wkt": 'PROJCS["broken", UNIT["furlong"'}, {"keys": [(1024, 1), (3072, 1)]},
        {"keys": [(1024, 1), (3076, 9102)]})],
    "coordinates.unit_not_metres": [
        ("cloud.e57", partial(e57, scans=[(POINTS_M, *STILL)], description="units: US survey feet"), "m"),
        *(("cloud.ply", lambda path, remark=remark: ply(path, POINTS_M / 0.3048, remark), "ft") for remark in (
            "comment units: feet", "comment unit mm", "comment Units are in US Survey Feet",
            "obj_info units = centimeters", "comment coordinates in inches, z up",
            "comment all values given in millimeters", "comment measured in yards",
            "comment California zone 5, US survey feet", "comment units: cubits", "comment units: degrees",
            "comment units: feet\ncomment unit: m", "comment vertical units: feet", "comment EPSG:2229",
            f"comment crs {wkt_of(FOOT_PLANE, NAVD88_US_FT, 'WKT1_GDAL')}",
            f"comment {wkt_of(METRE_PLANE)}".replace("\n", " "))),
    ],
}  # fmt: skip
"""Files by the code of what is wrong, and the unit with which the user overrules it, where that is enough."""


@pytest.mark.filterwarnings("error")  # which a user would read in front of the refusal
@pytest.mark.parametrize(
    ("code", "name", "write", "unit"),
    [(code, name, write, *unit) if unit else (code, name, write, None)
     for code, files in REFUSED.items() for name, write, *unit in files],
)  # fmt: skip
def test_a_file_that_is_no_cloud_in_metres_is_refused_by_name(tmp_path, code, name, write, unit):
    write(tmp_path / name)
    with refused(code) as error:
        read_clouds([tmp_path / name])
    assert name in error.value.where
    if unit:
        np.testing.assert_allclose(read(tmp_path / name, unit), POINTS_M, atol=1e-4)


@pytest.mark.parametrize(
    ("height_m", "volume_m3", "want"),
    [(14.05, 583.0, 0), (46.1, 20586.0, 1), (46.1, 583.0, 1), (20.0, 6000.0, 1)],
)
def test_sizes_that_no_known_rock_has_are_warned_of(height_m, volume_m3, want):
    assert bool(too_large(height_m, volume_m3)) == want
