"""Laws of a rock's mass properties, and meshes that are none of a rock."""

import warnings

import numpy as np
import pytest
import trimesh
from refusals import refused
from virtual_rocks import ellipsoid

from toppling.models.files.mesh_files import write_ply
from toppling.models.rock import Rock
from toppling.models.scene import Scene
from toppling.models.shapes import box

UTM_M = np.array([431_234.0, 3_777_345.0, 480.25])
ROCK = ellipsoid((0.6, 0.5, 0.9), 3)


def test_mass_properties_do_not_depend_on_where_the_mesh_lies():
    far = Rock.from_triangles(ROCK.vertices_m + UTM_M, ROCK.faces)
    assert far.volume_m3 == pytest.approx(ROCK.volume_m3, rel=1e-8)
    # Vertices near 3.8e6 m are kept to 2e-10 m.
    np.testing.assert_allclose(far.com_m - UTM_M, ROCK.com_m, atol=1e-8)
    np.testing.assert_allclose(far.inertia_per_mass_m2, ROCK.inertia_per_mass_m2, atol=1e-8)
    np.testing.assert_array_equal(far.vertices_m, ROCK.vertices_m + UTM_M)


def test_a_sliver_of_three_vertices_in_line_keeps_the_mesh_closed():
    whole = box(0.25, 0.5, 0.75)
    first, second, third = whole.faces[0]
    middle = len(whole.vertices_m)
    vertices = np.vstack([whole.vertices_m, whole.vertices_m[[first, second]].mean(axis=0)])
    adjacent = [(first, middle, third), (middle, second, third), (first, second, middle)]
    split = Rock.from_triangles(vertices, np.vstack([whole.faces[1:], adjacent]))
    assert len(split.faces) == len(whole.faces) + 2
    assert split.volume_m3 == pytest.approx(whole.volume_m3, rel=1e-12)
    np.testing.assert_allclose(split.inertia_per_mass_m2, whole.inertia_per_mass_m2, atol=1e-12)


def test_a_mesh_in_survey_coordinates_becomes_a_scene_with_an_origin_that_is_read_back(tmp_path):
    local, far = (Scene.from_mesh((ROCK.vertices_m + shift, ROCK.faces)) for shift in (0.0, UTM_M))
    np.testing.assert_allclose(
        far.rock.vertices_m + far.origin_m, ROCK.vertices_m + UTM_M, rtol=0.0, atol=1e-8
    )
    assert np.abs(far.rock.vertices_m).max() < 3.0
    assert local.origin_m.tolist() == [0.0, 0.0, 0.0]
    again = Scene.load(far.save(tmp_path / "scene"))
    np.testing.assert_array_equal(again.origin_m, far.origin_m)
    assert again.id == far.id


@pytest.mark.parametrize(("scale", "height"), [(1000.0, "1800 m"), (0.01, "0.018 m")])
def test_a_mesh_that_is_not_in_metres_is_refused(scale, height):
    with refused("rock.height_out_of_range", height, "millimetres"):
        Scene.from_mesh((ROCK.vertices_m * scale, ROCK.faces))


def test_survey_coordinates_in_single_precision_are_refused_and_local_coordinates_are_not():
    Scene.from_mesh((ROCK.vertices_m.astype(np.float32), ROCK.faces))
    with refused("coordinates.too_coarse", "0.25 m"):
        Scene.from_mesh(((ROCK.vertices_m + UTM_M).astype(np.float32), ROCK.faces))


def test_a_pedestal_of_loose_triangles_equals_the_pedestal_with_merged_vertices():
    rock = box(0.2, 0.2, 0.6).moved(np.eye(3), (0.0, 0.0, 0.62))
    corners = np.array([[-2.0, -2, 0], [2, -2, 0], [2, 2, 0.05], [-2, 2, 0]])
    loose = corners[[0, 1, 2, 0, 2, 3]], np.arange(6).reshape(2, 3)
    of_rock, shared = (rock.vertices_m, rock.faces), (corners, np.array([[0, 1, 2], [0, 2, 3]]))
    assert Scene.from_mesh(of_rock, pedestal=loose).id == Scene.from_mesh(of_rock, pedestal=shared).id
    with refused("mesh.not_oriented"):
        Scene.from_mesh(of_rock, pedestal=(corners, np.array([[0, 1, 2], [0, 3, 2]])))


def test_a_mesh_with_a_part_turned_inside_out_is_refused():
    """A square prism with a long thin wing that crosses itself, and counts as less than nothing out there."""
    ring = np.array(
        [(-1, -1), (1, -1), (1, -0.001), (100, 0.03), (100, -0.03), (1, 0.001), (1, 1), (-1, 1)], float
    )
    number = np.arange(len(ring))
    after = np.roll(number, -1)
    cap = np.column_stack([np.zeros(6, int), number[1:-1], number[2:]])
    sides = [np.column_stack([number, after, after + 8]), np.column_stack([number, after + 8, number + 8])]
    vertices = np.vstack([np.column_stack([ring, np.full(8, z)]) for z in (0.0, 2.0)])
    with refused("mesh.moment_unusable"):
        Rock.from_triangles(vertices, np.concatenate([cap[:, ::-1], cap + 8, *sides]))


@pytest.mark.parametrize("azimuth_deg", [np.nan, np.inf])
def test_a_slope_toward_nowhere_is_refused(azimuth_deg):
    with refused("azimuth.unreadable", azimuth_deg):
        Scene.from_mesh((ROCK.vertices_m, ROCK.faces), slope_deg=5.0, slope_azimuth_deg=azimuth_deg)


@pytest.mark.parametrize(
    ("scale", "shift_m", "expected"),
    [
        (1.0, (127.0, -1.7, 3.0), "2 by 2 by 0 m lies +127 m east, -1.7 m north and +2.4 m up"),
        (1.0, (0.0, 0.0, -0.5), "-1.1 m up"),
        (1000.0, (50.0, 80.0, -900.0), "2e+03 by 2e+03 by 0 m lies +50 m east"),
        (1.0, (4e5, 4e6, 0.0), "+4e+05 m east, +4e+06 m north"),
    ],
)
def test_a_pedestal_that_is_elsewhere_is_refused_with_where_it_lies(scale, shift_m, expected):
    rock = box(0.2, 0.2, 0.6).moved(np.eye(3), (0.0, 0.0, 0.6))
    corners = scale * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) + shift_m
    with refused("rock.apart_from_pedestal", expected, "0.0663 m", "0.4 by 0.4 by 1.2 m"):
        Scene.from_mesh((rock.vertices_m, rock.faces), pedestal=(corners, np.array([[0, 1, 2], [0, 2, 3]])))


def test_a_mesh_is_a_rock_in_metres_by_the_unit_that_somebody_states(tmp_path):
    ply = tmp_path / "rock.ply"
    write_ply(ply, 100.0 * ROCK.vertices_m, ROCK.faces)
    ply.write_bytes(ply.read_bytes().replace(b"\nelement", b"\ncomment units: cm\nelement", 1))
    known = trimesh.Trimesh(100.0 * ROCK.vertices_m, ROCK.faces, process=False)
    known.units = "centimeters"
    with warnings.catch_warnings(action="error"):
        scenes = [Scene.from_mesh((100.0 * ROCK.vertices_m, ROCK.faces), units="cm")]
        scenes += [Scene.from_mesh(ply, units="cm"), Scene.from_mesh(known)]
    with refused("coordinates.unit_not_metres", "cm"):
        Scene.from_mesh(ply)
    for scene in scenes:
        assert scene.rock.height_m == pytest.approx(ROCK.height_m, rel=1e-6)
    ground = (1000.0 * np.array([[-2, -2, -0.6], [2, -2, -0.6], [0, 2, -0.6]]), np.array([[0, 1, 2]]))
    block = box(0.2, 0.2, 0.6)
    on_ground = Scene.from_mesh((1000.0 * block.vertices_m, block.faces), pedestal=ground, units="mm")
    ((_, least),) = on_ground.quasi_static_toppling_m_s2([0.0])
    assert least == pytest.approx(9.81 / 3.0)
    with refused("units.unknown", "cubits"):
        Scene.from_mesh(known, units="cubits")


def test_a_rock_larger_than_any_is_doubted_where_nothing_states_its_unit():
    as_metres = (50.0 * ROCK.vertices_m, ROCK.faces)
    with pytest.warns(UserWarning, match=r"90 m high.*centimetres \(0.9 m\).*say so by units"):
        assert Scene.from_mesh(as_metres).rock.height_m == pytest.approx(90.0)
    with warnings.catch_warnings(action="error"):
        Scene.from_mesh(as_metres, units="m")
        Scene.from_mesh((ROCK.vertices_m, ROCK.faces))
