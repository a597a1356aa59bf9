"""Clouds of other people's programs: structure by name, what came back from nowhere, commas, encodings, steps."""

import laspy
import numpy as np
import open3d as o3d
import pye57
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from pye57 import libe57
from scipy.spatial.transform import Rotation

from toppling.models.errors import InputError
from toppling.models.files.mesh_files import write_ply
from toppling.models.scan.plausible import coordinate_steps, marked_unmeasured, step_note, steps_of_mesh
from toppling.models.scan.read import read_clouds

POINTS_M = np.random.default_rng(5).uniform(0.0, 12.0, (1500, 3)) + np.array([331000.0, 3777000.0, 470.0])
TURN = Rotation.from_euler("zyx", [130.0, 20.0, -35.0], degrees=True)
SHIFT_M = np.array([331000.0, 3777000.0, 470.0])


def read(path, unit=None):
    cloud = read_clouds([path], unit)
    return cloud.points_m + cloud.origin_m


def cartesian(points):
    return {f"cartesian{axis}": points[:, "XYZ".index(axis)] for axis in "ZXY"}


def spherical(points):
    far = np.linalg.norm(points, axis=1)
    return {
        "sphericalRange": far,
        "sphericalAzimuth": np.arctan2(points[:, 1], points[:, 0]),
        "sphericalElevation": np.arcsin(points[:, 2] / far),
    }


def spherical_beside_invalid(points):
    """As of a scanner whose export has filled the spherical coordinates alone; the library takes no wider states."""
    state = np.full(len(points), 2, np.int8)
    return {**cartesian(points + 1.0), "cartesianInvalidState": state, **spherical(points)}


def spherical_beside_nan(points):
    return {**cartesian(np.full_like(points, np.nan)), **spherical(points)}


def e57(
    path,
    scans,
    *,
    rotation="wxyz",
    translation="xyz",
    scale=0.0,
    words="",
    description="",
    columns_of=cartesian,
):
    """Scans (points, turn, shift) with the children of their poses in the given order; a scale makes them integers."""
    with pye57.E57(str(path), mode="w") as file:
        image = file.image_file
        if words:
            file.root["coordinateMetadata"]  # written empty by the library
        for points, turn, shift in scans:
            node = libe57.StructureNode(image)
            node.set("guid", libe57.StringNode(image, "{g}"))
            if description:
                node.set("description", libe57.StringNode(image, description))
            pose = libe57.StructureNode(image)
            if rotation:
                of = dict(zip("xyzw", turn.as_quat(), strict=True))
                child = libe57.StructureNode(image)
                for name in rotation:
                    child.set(name, libe57.FloatNode(image, float(of[name])))
                pose.set("rotation", child)
            if translation:
                child = libe57.StructureNode(image)
                for name in translation:
                    child.set(name, libe57.FloatNode(image, float(shift["xyz".index(name)])))
                pose.set("translation", child)
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


@pytest.mark.parametrize("rotation", ["wxyz", "xyzw", "zwyx"])
@pytest.mark.parametrize("translation", ["xyz", "zxy"])
@pytest.mark.parametrize("scale", [0.0, 1e-5])
def test_the_order_of_the_children_of_an_e57_pose_is_the_writers(tmp_path, rotation, translation, scale):
    stations = [(TURN, SHIFT_M), (TURN.inv(), SHIFT_M + 3.0)]
    scans = [
        (own_frame(part, *pose), *pose) for part, pose in zip(np.split(POINTS_M, 2), stations, strict=True)
    ]
    path = e57(tmp_path / "cloud.e57", scans, rotation=rotation, translation=translation, scale=scale)
    np.testing.assert_allclose(read(path), POINTS_M, atol=1e-4)
    assert set(read_clouds([path]).station) == {0, 1}


@pytest.mark.parametrize("columns_of", [spherical_beside_invalid, spherical_beside_nan])
def test_where_no_cartesian_coordinates_of_an_e57_are_valid_its_spherical_ones_are_read(tmp_path, columns_of):
    scans = [(own_frame(POINTS_M, TURN, SHIFT_M), TURN, SHIFT_M)]
    path = e57(tmp_path / "cloud.e57", scans, columns_of=columns_of)
    np.testing.assert_allclose(read(path), POINTS_M, atol=1e-6)


@pytest.mark.parametrize(("rotation", "translation"), [("", "xyz"), ("wxyz", ""), ("", "")])
def test_a_pose_may_lack_a_part(tmp_path, rotation, translation):
    turn = TURN if rotation else Rotation.identity()
    shift = SHIFT_M if translation else np.zeros(3)
    path = e57(
        tmp_path / "cloud.e57",
        [(own_frame(POINTS_M, turn, shift), turn, shift)],
        rotation=rotation,
        translation=translation,
    )
    np.testing.assert_allclose(read(path), POINTS_M, atol=1e-6)


def test_a_pose_that_lacks_a_number_is_refused(tmp_path):
    path = e57(tmp_path / "cloud.e57", [(POINTS_M, TURN, SHIFT_M)], rotation="xyz")
    with pytest.raises(InputError, match="rotation of a scan's pose has no w"):
        read_clouds([path])


def test_a_scan_without_points_takes_nothing_from_the_others(tmp_path):
    scans = [(np.empty((0, 3)), TURN, SHIFT_M), (own_frame(POINTS_M, TURN, SHIFT_M), TURN, SHIFT_M)]
    path = e57(tmp_path / "cloud.e57", [*scans, scans[0]])
    np.testing.assert_allclose(read(path), POINTS_M, atol=1e-6)
    assert set(read_clouds([path]).station) == {0}


def test_beams_without_a_return_do_not_stand_at_their_scanner(tmp_path):
    """The scanner's own frame has 0, 0, 0 where no beam came back: in the survey's frame that is the tripod."""
    seen = own_frame(POINTS_M, TURN, SHIFT_M)
    path = e57(tmp_path / "cloud.e57", [(np.vstack([np.zeros((40, 3)), seen]), TURN, SHIFT_M)])
    (source,) = read_clouds([path]).sources
    np.testing.assert_allclose(read(path), POINTS_M, atol=1e-6)
    assert source.left_out == 40
    assert "40 points lie at 0, 0, 0 of their scanner" in source.note


def ptx(path, scans, last_column=(0, 0, 0, 1)):
    """Scans as their points (n, 3) in a scanner's own frame, its rotation and place; with intensities."""
    text = []
    for points, turn, shift in scans:
        pose = np.column_stack([np.vstack([turn.as_matrix().T, shift]), last_column])
        axes = turn.as_matrix().T
        text += [
            str(len(points)),
            "1",
            *(" ".join(map(repr, map(float, row))) for row in (shift, *axes, *pose)),
        ]
        text += [" ".join(f"{value:.9f}" for value in row) + " 0.5" for row in points]
    path.write_text("\n".join(text) + "\n")
    return path


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


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("columns\n1\n", "is none of a scan"),
        ("3\n1\n0 0 0\n1 0 0\n", "is none of a scan"),
        ("999999999\n9\n" + "0 0 0\n" * 4 + "1 0 0 0\n" * 4, "more than the file can hold"),
        ("2\n1\n" + "0 0 0\n" * 4 + "1 0 0 0\n0 1 0 0\n0 0 1 0\n5 5 5 1\n1 2 3 .5\n" + "\n" * 40, "1 of the 2"),
        ("1\n1\n" + "0 0 0\n" * 4 + "1 0 0 5\n0 1 0 5\n0 0 1 5\n0 0 0 1\n1 2 3 .5\n", "in its fourth row"),
        ("1\n1\n" + "0 0 0\n" * 4 + "2 0 0 0\n0 2 0 0\n0 0 2 0\n0 0 0 1\n1 2 3 .5\n", "turn and shift alone"),
    ],
)  # fmt: skip
def test_a_ptx_that_is_damaged_or_scaled_is_refused_by_what_is_wrong(tmp_path, content, said):
    path = tmp_path / "cloud.ptx"
    path.write_text(content)
    with pytest.raises(InputError, match=said):
        read_clouds([path])


def all_invalid(points):
    return {**cartesian(points), "cartesianInvalidState": np.full(len(points), 2, np.int8)}


def test_an_e57_of_points_that_are_all_flagged_invalid_says_so(tmp_path):
    path = e57(tmp_path / "cloud.e57", [(POINTS_M, TURN, SHIFT_M)], columns_of=all_invalid)
    with pytest.raises(InputError, match=f"0 points, and {len(POINTS_M)} that are flagged invalid") as error:
        read(path)
    assert "so that they do not count as points that are flagged invalid" in error.value.remedy


def test_how_many_points_of_an_e57_are_flagged_invalid_is_told(tmp_path):
    def some_invalid(points):
        state = (np.arange(len(points)) % 10 == 0) * 2
        return {**cartesian(points), "cartesianInvalidState": state.astype(np.int8)}

    path = e57(tmp_path / "cloud.e57", [(POINTS_M, TURN, SHIFT_M)], columns_of=some_invalid)
    (source,) = read_clouds([path]).sources
    assert source.left_out == len(POINTS_M[::10])
    assert "are flagged invalid and were left out" in source.note


def test_an_e57_whose_words_say_feet_is_refused_and_read_on_the_users_word(tmp_path):
    still = Rotation.identity(), np.zeros(3)
    path = e57(tmp_path / "cloud.e57", [(POINTS_M, *still)], description="units: US survey feet")
    with pytest.raises(InputError, match="said to be in another unit") as error:
        read_clouds([path])
    assert "--units" in error.value.remedy
    np.testing.assert_allclose(read(path, "m"), POINTS_M, atol=1e-6)


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


@given(st.integers(0, 1400), st.sampled_from([0.0, -9999.0, -32768.0]))
def test_a_cloud_about_a_number_that_may_stand_for_none_keeps_its_points(number, middle):
    points = POINTS_M - POINTS_M[number] + middle
    assert not marked_unmeasured(points).any()


def test_points_that_are_not_finite_are_left_out_and_counted(tmp_path):
    points = POINTS_M.copy()
    points[::5] = np.nan
    points[1, 2] = np.inf
    kept = np.isfinite(points).all(axis=1)
    organised = o3d.t.geometry.PointCloud(points)
    for name in ("cloud.pcd", "cloud.ply"):
        o3d.t.io.write_point_cloud(str(tmp_path / name), organised)
    o3d.t.io.write_point_cloud(str(tmp_path / "ascii.pcd"), organised, write_ascii=True)
    np.savetxt(tmp_path / "cloud.xyz", points, fmt="%.6f")
    for name in ("cloud.pcd", "cloud.ply", "ascii.pcd", "cloud.xyz"):
        cloud = read_clouds([tmp_path / name])
        np.testing.assert_allclose(cloud.points_m + cloud.origin_m, points[kept], atol=1e-3)
        assert (cloud.sources[0].left_out, cloud.files[0][1]) == ((~kept).sum(), kept.sum())
        assert f"{(~kept).sum()} points are not finite" in cloud.sources[0].note


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


def text(form, decimal, points=POINTS_M):
    return "".join(form.format(*(f"{c:.3f}".replace(".", decimal) for c in row)) for row in points)


@pytest.mark.parametrize("name", TEXTS)
@pytest.mark.parametrize("head", ["", "{header}"])
def test_decimal_commas_and_other_separators_are_read_where_nobody_can_mistake_them(tmp_path, name, head):
    form, decimal = TEXTS[name]
    body = text(form, decimal)
    if head:
        words = ["x", "y", "z", *(["intensity", "range"] if "17" in form else [])]
        mark = next((sign for sign in (";", "\t", ",") if sign in form), " ")
        body = mark.join(words) + form[-2 if form.endswith("\r\n") else -1 :] + body
    path = tmp_path / "cloud.txt"
    path.write_bytes(body.encode())
    np.testing.assert_allclose(read(path), POINTS_M, atol=1e-3)


def test_whole_numbers_among_decimal_commas_are_read(tmp_path):
    points = POINTS_M.round(1)
    points[::3] = points[::3].round()
    points[0] = points[0].round()
    rows = "\n".join(";".join(f"{c:g}".replace(".", ",") for c in row - SHIFT_M) for row in points)
    path = tmp_path / "cloud.csv"
    path.write_text(rows)
    np.testing.assert_allclose(read(path), points - SHIFT_M, atol=1e-3)


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (text("{},{},{}\n", ","), "commas part the numbers and stand before decimals"),
        ("".join(f"{x:,.3f};{y:,.3f};{z:,.3f}\n" for x, y, z in POINTS_M), "thousands parted"),
    ],
)
def test_commas_that_may_mean_either_are_named(tmp_path, content, what):
    path = tmp_path / "cloud.csv"
    path.write_text(content)
    with pytest.raises(InputError, match=what) as error:
        read_clouds([path])
    assert "semicolons" in error.value.remedy


@pytest.mark.parametrize("sign", [",", ";", "\t"])
def test_lines_of_empty_cells_as_spreadsheets_save_them_are_no_points(tmp_path, sign):
    path = tmp_path / "cloud.csv"
    rows = text(f"{{}}{sign}{{}}{sign}{{}}{sign}\n", ".").splitlines()
    empty = sign * 3
    path.write_text("\n".join([*rows[:700], empty, *rows[700:], empty, empty]))
    np.testing.assert_allclose(read(path), POINTS_M, atol=1e-3)


def test_exponents_of_fortran_are_read(tmp_path):
    path = tmp_path / "cloud.xyz"
    np.savetxt(path, POINTS_M, fmt="%.12E")
    path.write_text(path.read_text().replace("E", "D"))
    np.testing.assert_allclose(read(path), POINTS_M, atol=1e-5)


def test_a_line_that_is_not_whole_is_named(tmp_path):
    path = tmp_path / "cloud.xyz"
    whole = text("{} {} {}\n", ".")
    path.write_text(whole[:-15])
    with pytest.raises(InputError, match=r"1500th line of points .* truncated"):
        read_clouds([path])


def test_thousands_parted_by_commas_among_blanks_are_named(tmp_path):
    path = tmp_path / "cloud.xyz"
    path.write_text("".join(f"{x:,.3f} {y:,.3f} {z:.3f}\n" for x, y, z in POINTS_M))
    with pytest.raises(InputError, match="thousands parted, such as 3,77"):
        read_clouds([path])


@pytest.mark.parametrize(("counted", "told"), [(1505, True), (1495, True), (1500, False)])
def test_another_count_of_points_is_told(tmp_path, counted, told):
    path = tmp_path / "cloud.pts"
    path.write_text(f"{counted}\n" + text("{} {} {} 7\n", "."))
    (source,) = read_clouds([path]).sources
    assert (f"1500 points where the file counts {counted}" in source.note) == told


def test_a_cloud_of_whole_millimetres_with_colours_has_no_decimal_commas(tmp_path):
    whole = np.hstack([((POINTS_M - SHIFT_M) * 1000).round(), np.full((1500, 3), 128.0)])
    path = tmp_path / "cloud.csv"
    np.savetxt(path, whole, fmt="%d", delimiter=",")
    np.testing.assert_allclose(read(path, "mm"), POINTS_M - SHIFT_M, atol=1e-3)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "cp1252"])
def test_text_in_another_encoding_is_read(tmp_path, encoding):
    path = tmp_path / "cloud.txt"
    path.write_bytes(("# Höhe über Normal, ±2 mm\nx;y;z\n" + text("{};{};{}\r\n", ",")).encode(encoding))
    np.testing.assert_allclose(read(path), POINTS_M, atol=1e-3)


@pytest.mark.parametrize("content", [text("{} {} {}\n", ".").encode("utf-16"), b"1.#IND 1.#IND 1.#IND\n" * 99,
                                     text("{} {} {}\n", ".").encode() + b"1.#QNAN 0.0 0.0\n"])  # fmt: skip
def test_text_that_is_no_plain_numbers_is_refused(tmp_path, content):
    path = tmp_path / "cloud.txt"
    path.write_bytes(content)
    with pytest.raises(InputError):
        read_clouds([path])


@pytest.mark.parametrize("end", ["\x1a", "\r\n\x1a", "\0" * 512, "\n" + "\0" * 3])
@pytest.mark.parametrize("suffix", [".xyz", ".xyzrgb", ".pts", ".csv", ".dat"])
def test_an_end_of_file_character_and_zeros_at_the_end_are_dropped(tmp_path, end, suffix):
    form = "{},{},{}\n" if suffix == ".csv" else "{} {} {}\n"
    path = tmp_path / f"cloud{suffix}"
    path.write_bytes((text(form, ".").rstrip("\n") + end).encode())
    np.testing.assert_allclose(read(path), POINTS_M, atol=1e-3)


def test_zeros_amidst_the_points_are_damage(tmp_path):
    path = tmp_path / "cloud.xyz"
    rows = text("{} {} {}\n", ".").splitlines()
    path.write_text("\n".join([*rows[:1490], "\0" * 40, *rows[1490:]]))
    with pytest.raises(InputError, match="zeros or an end-of-file character"):
        read_clouds([path])


@pytest.mark.parametrize("step", [0.0005, 0.002, 0.01, 0.1])
def test_steps_are_seen_in_whatever_format(tmp_path, step):
    points = (POINTS_M / step).round() * step
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.offsets, header.scales = SHIFT_M, [step / 10.0] * 3  # a fine scale brings back nothing
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    las.write(tmp_path / "cloud.las")
    np.savetxt(tmp_path / "cloud.xyz", points, fmt="%.6f")
    still = Rotation.identity(), np.zeros(3)
    e57(tmp_path / "cloud.e57", [(points - SHIFT_M, *still)], scale=step, translation="", rotation="")
    for name in ("cloud.las", "cloud.xyz", "cloud.e57"):
        assert read_clouds([tmp_path / name]).coarsest.step_m == pytest.approx(step, rel=1e-3), name


def test_steps_show_through_a_pose_that_turns(tmp_path):
    points = (own_frame(POINTS_M, TURN, SHIFT_M) / 0.01).round() * 0.01
    path = e57(tmp_path / "cloud.e57", [(points, TURN, SHIFT_M)], scale=0.01)
    assert read_clouds([path]).coarsest.step_m == pytest.approx(0.01, rel=1e-3)


def test_continuous_coordinates_show_no_step():
    assert not coordinate_steps(np.random.default_rng(1).normal(size=(5000, 3))).any()


def test_the_edges_of_a_mesh_are_no_step_in_which_coordinates_are_stored():
    block = trimesh.creation.box((4.0, 4.0, 1.0))
    for _ in range(4):
        block = block.subdivide()
    assert steps_of_mesh(block.vertices, block.faces).max() < 1e-5
    ball = trimesh.creation.icosphere(5, 1.0)
    rounded = np.round(ball.vertices, 2)
    assert steps_of_mesh(rounded, ball.faces) == pytest.approx([0.01, 0.01, 0.01])


@pytest.mark.parametrize("upward", [1, 2])
def test_the_grid_of_a_terrain_model_is_no_step_in_which_coordinates_are_stored(upward):
    east_m, north_m = (axis.ravel() for axis in np.meshgrid(0.3 * np.arange(40), 0.25 * np.arange(60)))
    random = np.random.default_rng(5)
    taken = random.random(len(east_m)) < 0.8  # a terrain model has holes
    grid = np.column_stack([east_m, north_m, random.uniform(0.0, 2.0, len(east_m))])[taken]
    assert coordinate_steps(np.roll(grid, upward + 1, axis=1)).max() < 1e-5
    # Points of a wall share their nodes: they were rounded.
    rounded = np.vstack([grid, grid + np.array([0.0, 0.0, 0.7])])
    assert coordinate_steps(rounded) == pytest.approx([0.3, 0.25, 0.0])


def test_steps_are_fine_then_told_then_refused():
    assert step_note(0.001, 1.5) == ""
    assert "1/500 of the rock's height" in step_note(0.002, 1.0)
    # g r / z of a block .4 m wide and 1 m high: a half step less of r is 1 mm, of z .5 m
    assert f"by {0.001 / 0.5:.1g} g;" in step_note(0.002, 1.0)
    with pytest.raises(InputError, match=r"steps of 0\.02 m") as error:
        step_note(0.02, 1.0)
    assert "more decimals" in error.value.remedy


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_degrees_are_told_whichever_of_them_comes_first(tmp_path, order):
    metres = np.random.default_rng(2).uniform(0.0, 10.0, (1500, 3))
    degrees = np.column_stack([-118.9 + metres[:, 0] / 92_000, 34.1 + metres[:, 1] / 111_000])[:, order]
    np.savetxt(tmp_path / "cloud.xyz", np.column_stack([degrees, metres[:, 2] + 445.2]), fmt="%.9f")
    with pytest.raises(InputError, match="in degrees"):
        read(tmp_path / "cloud.xyz")


def test_whole_numbers_are_not_taken_for_single_precision(tmp_path):
    np.savetxt(tmp_path / "cloud.xyz", POINTS_M.round(), fmt="%.0f")
    with pytest.raises(InputError, match="whole numbers") as refused:
        read(tmp_path / "cloud.xyz")
    assert "smaller scale" in refused.value.remedy


def test_a_ply_may_name_its_axes_in_capitals(tmp_path):
    write_ply(tmp_path / "cloud.ply", POINTS_M, np.empty((0, 3), np.int64))
    whole = (tmp_path / "cloud.ply").read_bytes()
    for axis in "xyz":
        whole = whole.replace(f"double {axis}\n".encode(), f"double {axis.upper()}\n".encode())
    (tmp_path / "cloud.ply").write_bytes(whole)
    np.testing.assert_allclose(read(tmp_path / "cloud.ply"), POINTS_M)


def test_a_ply_without_coordinates_tells_what_it_has(tmp_path):
    head = (
        b"ply\nformat binary_little_endian 1.0\nelement vertex 5000\nproperty float intensity\nend_header\n"
    )
    (tmp_path / "cloud.ply").write_bytes(head + np.zeros(5000, "<f4").tobytes())
    with pytest.raises(InputError, match="its vertices have intensity, and not x, y and z"):
        read(tmp_path / "cloud.ply")
