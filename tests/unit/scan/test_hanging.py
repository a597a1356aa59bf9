"""Parts of a rock that hang below its seat, beyond an edge of the pedestal: they weigh, and touch nothing there."""

import manifold3d
import numpy as np
import pytest
from patches import LEVEL, face

from toppling.models.relief import contact_feet_m
from toppling.models.scan import virtual
from toppling.models.scan.hanging import hanging
from toppling.models.scan.interface import up_to_edge
from toppling.models.scan.surfels import Surfels
from toppling.models.scan.survey import save_survey, survey
from toppling.models.scan.worked_out import WorkedOut
from toppling.models.statics import polygon, tipping_m_s2

VOXEL_M, EDGE_M = 0.012, 0.3


def block_over_a_cliff(lean_deg, hangs_m=0.2, inward=False):
    """Patches of a block 1.2 m high, a part of which hangs beyond x = EDGE_M, where a cliff's face leans out or in."""
    run = np.tan(np.radians(lean_deg))
    rock = [
        *(face([0.6, 0, 0], [0, 0, 1.2], [-0.4, y, 0.0], [0, np.sign(y), 0]) for y in (-0.3, 0.3)),
        face([0, 0.6, 0], [0, 0, 1.2], [-0.4, -0.3, 0.0], [-1, 0, 0]),
        face([0, 0.6, 0], [0, 0, 1.2 + hangs_m], [0.6, -0.3, -hangs_m], [1, 0, 0]),
        face([1.0, 0, 0], [0, 0.6, 0], [-0.4, -0.3, 1.2], [0, 0, 1]),
    ]
    top = [
        *(face([0.8, 0, 0], [0, 0.7, 0], [EDGE_M - 0.8, y, 0.0], [0, 0, 1]) for y in (-1.0, 0.3)),
        face([0.1, 0, 0], [0, 0.6, 0], [-0.5, -0.3, 0.0], [0, 0, 1]),
    ]
    way = -1.0 if inward else 1.0
    cliff = [face([0, 0.7, 0], [run, 0, -1], [EDGE_M, y, 0.0], [way, 0, way * run]) for y in (-1.0, 0.3)]
    parts = [*rock, *top, *cliff]
    points, normals = (np.vstack([part[k] for part in parts]) for k in (0, 1))
    noise = np.random.default_rng(3).normal(scale=0.0005, size=points.shape)
    is_rock = np.arange(len(points)) < sum(len(part[0]) for part in rock)
    return Surfels(points + noise, normals, np.zeros(len(points)), VOXEL_M), is_rock


@pytest.mark.parametrize("lean_deg", [0.0, 15.0, -15.0])
@pytest.mark.parametrize("inward", [False, True])
def test_the_edge_below_a_rock_is_where_the_faces_beside_it_meet_the_seat(lean_deg, inward):
    """The line goes straight on below the rock, whichever way the normals of a hidden face were turned."""
    surfels, rock = block_over_a_cliff(lean_deg, inward=inward)
    hangs, seat = hanging(surfels, rock, 1.4, LEVEL)
    below = np.stack(np.meshgrid(np.linspace(-0.4, 0.6, 11), np.linspace(-0.3, 0.3, 7)), axis=-1)
    np.testing.assert_allclose(seat.edge.outside_m(below), below[..., 0] - EDGE_M, atol=0.01)
    assert (surfels.points_m[hangs, 0] > EDGE_M).all()


def test_a_rock_that_hangs_nowhere_has_no_edge():
    surfels, rock = block_over_a_cliff(0.0, hangs_m=0.01)
    assert hanging(surfels, rock, 1.2, LEVEL) is None


def area_m2(vertices, faces):
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()


def test_a_mesh_cut_at_an_edge_is_parted_without_loss():
    surface, faces = virtual.ground(2.0, 0.5, 3, bumps_m=0.2, cells=30)
    outside = surface @ np.array([0.8, 0.6, 0.0]) - 0.37
    parts = [up_to_edge(surface, faces, sign * outside) for sign in (1.0, -1.0)]
    assert sum(area_m2(*part) for part in parts) == pytest.approx(area_m2(surface, faces), rel=1e-12)
    for sign, (vertices, _) in zip((1.0, -1.0), parts, strict=True):
        assert (sign * (vertices @ np.array([0.8, 0.6, 0.0]) - 0.37)).max() == pytest.approx(0.0, abs=1e-12)


def over_an_edge(body, edge_m, drop_m):
    """A body that a pedestal with an edge at x = edge_m has been taken out of, but for a gap of 2 cm at its face."""
    beside = manifold3d.Manifold.cube([5.0, 10.0, 5.0]).translate([edge_m + 0.02 - 5.0, -5.0, -5.0])
    mesh = (body - beside).to_mesh64()
    rock = np.array(mesh.vert_properties[:, :3]), np.array(mesh.tri_verts, np.int64)
    ground = virtual.ground(5.0, 0.6, 4, cliff_m=edge_m, drop_m=drop_m, bumps_m=0.05, cells=120)
    return virtual.on_slope(rock, ground, 0.0, 0.0), edge_m


def solid(mesh):
    return manifold3d.Manifold(manifold3d.Mesh64(np.asarray(mesh[0], float), mesh[1].astype(np.uint64)))


def toe():
    """A boulder of 2.3 m whose foot hangs 0.3 m below its seat."""
    body = solid(virtual.boulder(2.3, 1.5, 1.2, 4, bumps=0.02))
    return over_an_edge(body.translate([0.15, 0.0, -0.3]), 0.38, 3.0)


def belly():
    """An ellipsoid whose flank hangs 0.14 m below its seat."""
    rise = np.linspace(-0.5 * np.pi + 0.02, 0.5 * np.pi - 0.02, 65)
    vertices, faces = virtual.lathe(
        np.repeat(np.cos(rise)[:, None], 64, axis=1), np.sin(rise), np.zeros((65, 2)), 64
    )
    return over_an_edge(solid((vertices * [0.95, 0.75, 0.9], faces)).translate([0.25, 0.0, 0.75]), 0.35, 2.5)


def column():
    """An angular column with a leg that reaches 0.39 m down a ledge 0.45 m high."""
    up = manifold3d.Manifold.cube([1.0, 0.8, 1.6]).translate([-0.6, -0.4, 0.0])
    leg = manifold3d.Manifold.cube([0.3, 0.8, 1.4]).translate([0.11, -0.4, -0.39])
    return over_an_edge((up + leg).refine_to_length(0.05), 0.1, 0.45)


def scanned(truth, resolution_per_height):
    stations = virtual.scan_around(truth, 1, resolution_per_height=resolution_per_height, clutter=False)
    return survey(virtual.cloud_of(stations, virtual.DEMO_ORIGIN_M)[0])


def check_mass(rock, true, volume_share):
    assert rock.volume_m3 == pytest.approx(true.volume_m3, rel=volume_share)
    np.testing.assert_allclose(rock.com_m, true.com_m, atol=0.003 * true.height_m)
    moments = (np.linalg.eigvalsh(each.inertia_per_mass_m2) for each in (rock, true))
    np.testing.assert_allclose(*moments, rtol=0.015)


def tipping_of(truth, edge_m, azimuths_deg):
    """What the formula says for the outline of the base, which ends at the edge's line."""
    base = truth.rock.vertices_m[np.abs(truth.rock.vertices_m[:, 2]) < 1e-6]
    base[:, 0] = np.minimum(base[:, 0], edge_m)
    up = np.array([0.0, 0.0, 1.0])
    return [
        value for _, value in tipping_m_s2(polygon(base, up, 0.0), truth.rock.com_m, up, 9.81, azimuths_deg)
    ]


@pytest.mark.slow  # before those of few draws, which last to the end of the file: a stated interval takes all
@pytest.mark.parametrize("make", [toe, belly, column])
def test_a_rock_that_hangs_over_an_edge_topples_within_its_stated_interval(make):
    truth, edge_m = make()
    scene = scanned(truth, 0.01).scene
    check_mass(scene.rock, truth.rock, 0.005)
    rows = scene.report["unseen_base"]["toppling"]
    exact = tipping_of(truth, edge_m, [row["azimuth_deg"] for row in rows])
    within = [row["low_m_s2"] <= value <= row["high_m_s2"] for row, value in zip(rows, exact, strict=True)]
    assert np.mean(within) >= 0.75
    assert within[int(np.argmin(exact))]


@pytest.fixture(scope="module")
def scanned_toe(few_draws):
    return scanned(toe()[0], 0.025)


@pytest.mark.thorough
def test_what_hangs_is_part_of_the_closed_rock_and_reaches_no_lower_than_was_seen(scanned_toe):
    truth, _ = toe()
    rock = scanned_toe.scene.rock
    check_mass(rock, truth.rock, 0.01)
    assert rock.vertices_m[:, 2].min() == pytest.approx(truth.rock.vertices_m[:, 2].min(), abs=0.03)
    assert any("hangs beyond the pedestal's edge" in note for note in scanned_toe.notes)


@pytest.mark.thorough
def test_every_base_of_a_rock_that_hangs_touches_within_the_edge_and_tips_about_its_line(scanned_toe):
    truth, edge_m = toe()
    scene = scanned_toe.scene
    assert scene.ground.is_plane
    for number in range(0, len(scene.unseen), 3):
        base = scene.on_base(number)
        feet = contact_feet_m(base.rock, base.pedestal)
        assert feet[:, 0].max() < edge_m + 0.02
        assert ((feet - base.pedestal.point_m) @ base.pedestal.normal).min() > -1e-3
    rows = scene.report["unseen_base"]["toppling"]
    exact = tipping_of(truth, edge_m, [row["azimuth_deg"] for row in rows])
    within = [row["low_m_s2"] <= value <= row["high_m_s2"] for row, value in zip(rows, exact, strict=True)]
    assert np.mean(within) >= 0.75
    assert within[int(np.argmin(exact))]


@pytest.mark.thorough
def test_an_edge_is_kept_for_later_hints(scanned_toe, tmp_path):
    save_survey(scanned_toe, tmp_path / "scene")
    edge, again = (
        each.interface.edge for each in (scanned_toe.worked_out, WorkedOut.read(tmp_path / "scene"))
    )
    np.testing.assert_array_equal(again.lines, edge.lines)
    assert again.blur_m == edge.blur_m
