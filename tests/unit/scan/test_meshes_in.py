"""Meshes of photogrammetry, in any unit and attitude, are read as the clouds that they are of."""

import numpy as np
import pytest
import trimesh
from refusals import refused

from toppling.models.errors import InputError
from toppling.models.scan import meshes
from toppling.models.scan.placement import of_user, placement_of
from toppling.models.scan.read import read_clouds

FORMATS = ("obj", "ply", "stl", "glb", "off")


@pytest.fixture(autouse=True)
def few_points(monkeypatch):
    monkeypatch.setattr(meshes, "FEWEST", 20_000)


def pieces():
    """Ground of 8 by 6 m, and a block of .7 by .9 by 1.6 m on it, metres, z up, neither closed."""
    ground = trimesh.creation.box([8.0, 6.0, 1.0])
    ground.update_faces(ground.face_normals[:, 2] > 0.9)
    ground.apply_translation([0.0, 0.0, -0.5])
    block = trimesh.creation.box([0.7, 0.9, 1.6])
    block.update_faces(block.face_normals[:, 2] > -0.9)
    block.apply_translation([1.0, -0.5, 0.8])
    return ground.subdivide(), block.subdivide()


def site():
    return trimesh.util.concatenate(pieces())


def exported(path, mesh=None, scale=1.0, turn=None):
    mesh = (mesh or site()).copy()
    vertices = mesh.vertices * scale
    mesh.vertices = vertices if turn is None else vertices @ np.asarray(turn, float).T
    mesh.export(path)
    return path


Y_UP = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]


def bounds(cloud):
    points = cloud.points_m + cloud.origin_m
    return np.array([points.min(axis=0), points.max(axis=0)])


METRES = np.array([[-4.0, -3.0, 0.0], [4.0, 3.0, 1.6]])


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_mesh_is_read_in_every_format_unit_and_attitude(tmp_path, suffix):
    path = exported(tmp_path / f"site.{suffix}", scale=1000.0, turn=Y_UP)
    cloud = read_clouds([path], "mm", placement_of(up="y"))
    np.testing.assert_allclose(bounds(cloud), METRES, atol=0.05)  # within a few centimetres of the edges
    assert 0.9 * 20_000 < len(cloud.points_m) <= 20_000  # less the ground below the block
    assert not cloud.station.any()


def test_gltf_is_y_up_unless_stated_otherwise(tmp_path):
    upright = exported(tmp_path / "a.glb", turn=Y_UP)
    np.testing.assert_allclose(bounds(read_clouds([upright])), METRES, atol=0.05)
    np.testing.assert_allclose(bounds(read_clouds([upright], None, placement_of(up="y"))), METRES, atol=0.05)
    wrong = exported(tmp_path / "b.glb")
    with refused("mesh.frame_unstated"):
        read_clouds([wrong])
    np.testing.assert_allclose(bounds(read_clouds([wrong], None, placement_of(up="z"))), METRES, atol=0.05)


@pytest.mark.parametrize(("scale", "turn"), [(1000.0, None), (0.01, None), (1000.0, Y_UP)])
def test_a_size_that_no_rock_has_asks_for_a_unit_or_a_length_and_an_attitude_for_the_upward_axis(
    tmp_path, scale, turn
):
    with pytest.raises(InputError) as error:
        read_clouds([exported(tmp_path / "site.ply", scale=scale, turn=turn)])
    assert ("--units" if scale > 1.0 else "--length") in error.value.remedy
    assert ("--up" in error.value.remedy.partition(";")[0]) == (turn is not None)


@pytest.mark.parametrize("axis", ["x", "y", "-x", "-y", "-z"])
def test_an_open_mesh_shows_which_axis_is_up(tmp_path, axis):
    path = exported(tmp_path / "site.ply", turn=placement_of(up=axis).turn.T)
    with refused("mesh.frame_unstated", axis):
        read_clouds([path])
    np.testing.assert_allclose(bounds(read_clouds([path], None, placement_of(up=axis)))[1, 2], 1.6, atol=0.05)


def test_a_tilted_mesh_is_reported_with_the_direction_that_sets_it_upright(tmp_path):
    turn = trimesh.transformations.rotation_matrix(np.deg2rad(60.0), [1.0, 1.0, 0.0])[:3, :3]
    path = exported(tmp_path / "site.ply", turn=turn)
    with refused("mesh.frame_unstated", "60") as error:
        read_clouds([path])
    direction = error.value.remedy.split("--up ")[1].split(";")[0]
    placed = bounds(read_clouds([path], None, placement_of(up=direction)))
    assert np.ptp(placed[:, 2]) == pytest.approx(1.6, abs=0.1)


def test_points_lie_on_the_mesh_and_cover_its_area_and_its_detail():
    mesh = site()
    points, _ = meshes.points_on(mesh.vertices, mesh.faces)
    off = np.abs(points - [1.0, -0.5, 0.8]) / [0.35, 0.45, 0.8]
    on_block = np.isclose(off.max(axis=1), 1.0)
    assert (on_block | np.isclose(points[:, 2], 0.0)).all()
    top = (points[:, 2] > 1.6 - 1e-9).mean()
    area = 0.63 / mesh.area
    triangles = (mesh.triangles[:, :, 2].min(axis=1) > 1.5).mean()
    assert top == pytest.approx(0.5 * area + 0.5 * triangles, rel=0.05)


def test_what_nobody_can_have_seen_is_left_out_and_nothing_else(tmp_path):
    ground, _ = pieces()
    block = trimesh.creation.box([0.7, 0.9, 1.6])
    block.apply_translation([1.0, -0.5, 0.8])
    table = trimesh.creation.box([1.0, 1.0, 0.2])  # hangs .5 m over the ground, which is seen below it
    table.apply_translation([-2.0, 1.0, 0.6])
    whole = trimesh.util.concatenate([ground, block.subdivide(), table.subdivide()])
    cloud = read_clouds([exported(tmp_path / "site.ply", whole)])
    points = cloud.points_m + cloud.origin_m
    low = np.abs(points[:, 2]) < 1e-6

    def inside(corner, other):
        return ((points[:, :2] > corner) & (points[:, :2] < other)).all(axis=1)

    assert not (low & inside([0.65, -0.95], [1.35, -0.05])).any()
    below = low & inside([-2.5, 0.5], [-1.5, 1.5])
    assert below.sum() == pytest.approx(low.sum() / (8 * 6 - 0.63), rel=0.3)  # a square metre of the ground
    assert (np.abs(points[:, 2] - 0.5) < 1e-6).any()  # and the table's underside


def test_a_mesh_is_known_by_the_edges_that_it_has_at_a_place(tmp_path):
    ground, block = pieces()
    cloud = read_clouds(
        [exported(tmp_path / "site.ply", trimesh.util.concatenate([ground, block.subdivide()]))]
    )
    around = np.array([[0.6, -1.0, 0.05], [1.4, 0.0, 1.65]]) - cloud.origin_m
    assert cloud.edge_m(*around) == pytest.approx(np.median(block.subdivide().edges_unique_length), rel=0.05)


def turned_over(path):
    marks = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [1.0, 2.0, 0.0]])
    np.savetxt(path.with_suffix(".csv"), np.hstack([marks, marks[:, [1, 0, 2]]]), delimiter=",")
    read_clouds([exported(path.with_suffix(".ply"))], None, placement_of(gcp=path.with_suffix(".csv")))


def gltf(*swapped):
    """A reader of a box in glTF, of which some words are swapped."""

    def read(path):
        text = trimesh.exchange.gltf.export_gltf(trimesh.Scene(trimesh.creation.box()), embed_buffers=True)
        content = text["model.gltf"].decode()
        assert all(old in content for old, _ in swapped)
        for old, new in swapped:
            content = content.replace(old, new)
        path.with_suffix(".gltf").write_text(content)
        assert len(meshes.mesh_as_in_file(path.with_suffix(".gltf"))[1]) == 12

    return read


def obj(text):
    def read(path):
        path.with_suffix(".obj").write_text(text)
        return meshes.mesh_as_in_file(path.with_suffix(".obj"))

    return read


COUNTED = "v 0 0 0\nv 1 0 0\nv 10 0 1\nv 0 1 0\nvt 0 0\nf 1 2 3\n"


@pytest.mark.parametrize(
    ("read", "code"),
    [
        (turned_over, "mesh.faces_downward"),
        (gltf(('"scene":', '"extensionsRequired": ["KHR_draco_mesh_compression"], "scene":')), "mesh.variant_unknown"),
        (gltf(('"type":"VEC3"', '"normalized": true, "type":"VEC3"')), "mesh.variant_unknown"),
        *((obj(f"{COUNTED}{face}\n"), "mesh.index_out_of_range")
          for face in ("f 0 1 2", "f 1/1 0/0 2/2", "f 1 2 0", "f -1 -2 -3", "f 1//-1 2 3")),
        (lambda _: of_user("EPSG:4326"), "coordinates.in_degrees"),
        (lambda _: of_user("EPSG:1"), "coordinates.crs_unknown"),
        (lambda _: of_user("Utah"), "coordinates.crs_unknown"),
    ],
)  # fmt: skip
def test_a_mesh_that_cannot_be_read_as_it_is_meant_is_refused(tmp_path, read, code):
    with refused(code):
        read(tmp_path / "model")


def test_the_users_coordinate_system_wins_and_is_recorded(tmp_path):
    path = exported(tmp_path / "site.ply")
    (source,) = read_clouds([path], None, None, of_user("EPSG:2229")).sources  # US survey feet
    assert source.epsg == 2229
    assert source.metres_per_unit == pytest.approx((0.3048006, 0.3048006))
    assert source.to_json()["coordinate_system"].startswith("NAD83 / California zone 5")
