"""Pedestals of more than one plane, seen beside a rock: their facets and curves are carried under its hidden base."""

import math
from dataclasses import replace
from itertools import product

import manifold3d
import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from toppling.models.hidden_base.statics import tips_on_surface
from toppling.models.pedestal import Pedestal
from toppling.models.rock import Rock
from toppling.models.scan import virtual
from toppling.models.scan.close import body_over
from toppling.models.scan.crevice import grid_triangles
from toppling.models.scan.ground import faceted, pedestal_surface
from toppling.models.scan.interface import Interface, Sheet
from toppling.models.scan.segment import ROCK, cut_over, segment
from toppling.models.scan.survey import save_survey, survey
from toppling.models.scene import Scene

HEIGHT_M, BASE_M = 1.5, 0.7


def ledges(left_deg, right_deg, reach_m=0.8):
    """Two facets that meet in x = 0, rising outward by so many degrees over a reach."""
    left, right = (math.tan(math.radians(angle_deg)) for angle_deg in (left_deg, right_deg))
    return lambda x, y: np.where(x < 0.0, left * np.minimum(-x, reach_m), right * np.minimum(x, reach_m))


def dome(radius_m):
    return lambda x, y: np.sqrt(radius_m**2 - np.minimum(x**2 + y**2, 0.6 * radius_m**2)) - radius_m


def ground_of(height_at, reach_m, cells=200):
    """Square pedestal whose height over x, y is given; x = 0 and y = 0 are lines of its mesh."""
    along = np.linspace(-reach_m, reach_m, cells + 1)
    x, y = np.meshgrid(along, along, indexing="ij")
    return np.column_stack([x.ravel(), y.ravel(), height_at(x, y).ravel()]), grid_triangles(x.shape)


def laid_on(rock, height_at):
    """A rock whose base follows a surface; what bends its base fades over its lower half."""
    vertices, faces = rock
    fades = 1.0 - np.minimum(vertices[:, 2] / (0.5 * vertices[:, 2].max()), 1.0)
    bent = fades * height_at(vertices[:, 0], vertices[:, 1])
    return vertices + np.column_stack([np.zeros((len(vertices), 2)), bent]), faces


def truth_on(height_at, seed=3):
    rock = laid_on(virtual.boulder(HEIGHT_M, 1.0, BASE_M, seed, bumps=0.02), height_at)
    ground = ground_of(height_at, 2.5 * HEIGHT_M)
    return virtual.Truth(
        Rock.from_triangles(*rock), Pedestal(np.zeros(3), np.array([0.0, 0.0, 1.0]), *ground)
    )


def on_four_feet(height_at):
    """A block of .4 x .4 x 1.2 m on feet of 8 cm at its corners, whose soles lie in the surface."""
    block = manifold3d.Manifold.cube([0.4, 0.4, 1.04]).translate([-0.2, -0.2, 0.16])
    for x, y in product((-0.2, 0.12), repeat=2):
        block += manifold3d.Manifold.cube([0.08, 0.08, 1.5]).translate([x, y, -1.0])
    along = np.linspace(-3.0, 3.0, 61)
    x, y = np.meshgrid(along, along, indexing="ij")
    over = body_over(x, y, height_at(x, y), 5.0)
    raised = block.translate([0.0, 0.0, float(height_at(np.array([-0.2, 0.2]), np.zeros(2)).mean())])
    mesh = (raised ^ over).refine_to_length(0.04).to_mesh64()
    rock = Rock.from_triangles(np.array(mesh.vert_properties[:, :3]), np.array(mesh.tri_verts, np.int64))
    ground = ground_of(height_at, 3.0)
    return virtual.Truth(rock, Pedestal(np.zeros(3), np.array([0.0, 0.0, 1.0]), *ground))


def cloud_on(height_at, seed=1, resolution_per_height=0.009):
    stations = virtual.scan_around(truth_on(height_at), seed, resolution_per_height=resolution_per_height)
    return virtual.cloud_of(stations, virtual.DEMO_ORIGIN_M)[0]


def surface(points_m):
    parts = segment(points_m, virtual.DEMO_ORIGIN_M)
    rock = parts.surfel_label == ROCK
    return pedestal_surface(parts.surfels, rock, float(np.ptp(parts.surfels.points_m[rock, 2])))


def below_the_base(height_at):
    random = np.random.default_rng(0)
    x, y = random.uniform(-0.25, 0.25, (2, 400))
    return np.column_stack([x, y, height_at(x, y)])


def off_m(interface, places_m):
    return np.abs(interface.over(places_m)[:, 2])


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("left", "right", "truth_on"),
    [
        (15, 15, truth_on), (0, 30, truth_on), (-30, -30, truth_on), (30, 30, on_four_feet), (0, -30, on_four_feet),
    ],
)  # fmt: skip
def test_facets_are_recovered_within_a_degree_and_three_millimetres(left, right, truth_on):
    height_at = ledges(left, right)
    stations = virtual.scan_around(truth_on(height_at), 1, stations=4, resolution_per_height=0.014)
    interface = surface(virtual.cloud_of(stations, virtual.DEMO_ORIGIN_M)[0].points_m)
    assert off_m(interface, below_the_base(height_at)).max() < 0.003
    slopes = (interface.normals(interface.flat(below_the_base(height_at))) @ interface.axes.T)[:, :2]
    on_left = below_the_base(height_at)[:, 0] < -0.03  # a node or more from the crease
    on_right = below_the_base(height_at)[:, 0] > 0.03
    found = [math.degrees(math.asin(slopes[on, 0].mean())) for on in (on_left, on_right)]
    assert found == pytest.approx([left, -right], abs=1.0)


@pytest.mark.thorough
@pytest.mark.parametrize("radius_m", [2.0, 3.0])  # of 3 m it stays within .01 of the height of a plane
def test_dome_is_recovered_within_a_centimetre(radius_m):
    height_at = dome(radius_m)
    interface = surface(cloud_on(height_at, resolution_per_height=0.012).points_m)
    assert interface.sheet.how == "curve"
    assert off_m(interface, below_the_base(height_at)).max() < 0.01


@pytest.mark.thorough
def test_a_leg_that_was_cut_off_is_rejoined_once_its_surface_is_known():
    stations = virtual.scan_around(on_four_feet(ledges(30, 30)), 1, resolution_per_height=0.009)
    points = virtual.cloud_of(stations, virtual.DEMO_ORIGIN_M)[0].points_m
    parts = segment(points, virtual.DEMO_ORIGIN_M)
    rock = parts.surfel_label == ROCK
    interface = pedestal_surface(parts.surfels, rock, float(np.ptp(parts.surfels.points_m[rock, 2])))
    again = cut_over(points, parts, interface)
    places = again.surfels.points_m[again.surfel_label == ROCK]
    feet = places[(places[:, 2] < 0.24) & (np.abs(places[:, :2]) > 0.1).all(axis=1)]
    quadrants = np.unique(np.sign(feet[:, :2]), axis=0, return_counts=True)[1]
    assert len(quadrants) == 4
    assert quadrants.min() > 80
    changed = np.flatnonzero(again.label != parts.label)
    assert (interface.over(points[changed])[:, 2] > 0.0).all()  # the ground stays what it was


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_facets_are_the_planes_through_all_of_their_noisy_patches(seed):
    random, height_at = np.random.default_rng(seed), ledges(10, 20)
    turn, away_m = random.uniform(0.0, 2.0 * np.pi, 3000), random.uniform(0.45, 0.8, 3000)
    x, y = away_m * np.cos(turn), away_m * np.sin(turn)
    slope = np.where(x < 0.0, -math.tan(math.radians(10)), math.tan(math.radians(20)))
    normals = np.column_stack([-slope, np.zeros(3000), np.ones(3000)]) / np.hypot(slope, 1.0)[:, None]
    sheet = faceted(
        np.column_stack([x, y, height_at(x, y) + random.normal(0.0, 0.006, 3000)]), normals, HEIGHT_M
    )
    places = below_the_base(height_at)
    assert np.abs(sheet.at(places) - places[:, 2]).max() < 0.0015  # a single fit is off by up to its noise


@pytest.mark.thorough
def test_facet_with_a_tenth_of_the_points_retains_its_weight():
    height_at = ledges(0, 15)
    points = cloud_on(height_at).points_m
    few = (points[:, 0] < 0.0) | (np.arange(len(points)) % 10 == 0)
    interface = surface(points[few])
    assert off_m(interface, below_the_base(height_at)).max() < 0.01
    assert interface.roughness_m > 0.01  # a description: the plane through both, and how far they leave it


@pytest.mark.thorough
def test_flat_pedestal_stays_a_plane():
    assert surface(cloud_on(lambda x, y: 0.05 * x, resolution_per_height=0.012).points_m) is None


def tipped_in_truth_m_s2(height_at, azimuths_deg, truth_on=truth_on):
    """Moments about the edges of the true outline of the base, which lies in the surface."""
    rock = truth_on(height_at).rock
    on_surface = np.abs(rock.vertices_m[:, 2] - height_at(*rock.vertices_m[:, :2].T)) < 1e-7
    base = rock.vertices_m[on_surface] - rock.com_m
    ring = base[ConvexHull(base[:, :2]).vertices]
    moved = np.cross(ring, np.roll(ring, -1, axis=0) - ring)
    directions = np.radians(azimuths_deg)
    over = -moved[:, :1] * np.cos(directions) - moved[:, 1:2] * np.sin(directions)
    return np.where(over > 0.0, 9.81 * moved[:, 2:] / np.where(over > 0.0, over, 1.0), np.inf).min(axis=0)


@pytest.mark.thorough
@pytest.mark.parametrize("ends_deg", [(15, 15), (30, 30), (0, -30), (-30, -30)])
def test_a_base_that_fits_its_facets_tips_over_the_edges_of_its_outline(ends_deg):
    height_at, azimuths_deg = ledges(*ends_deg), np.arange(0.0, 360.0, 45.0)
    left, right = (math.tan(math.radians(end_deg)) for end_deg in ends_deg)
    how = "hollow" if sum(ends_deg) > 0 else "ridge"
    planes = np.array([[0.0, -left, 0.0], [0.0, right, 0.0]])
    sheet = Sheet(planes, how, np.zeros((0, 3)), np.zeros(2), 0.0, 0.025)
    interface = Interface(np.zeros(3), np.array([0.0, 0.0, 1.0]), np.eye(3), 0.0, sheet)
    rock = truth_on(height_at).rock
    low = interface.over(rock.vertices_m)
    low = low[low[:, 2] < 0.3 * rock.height_m]
    on_feet = replace(rock, feet_m=interface.scene(low))
    found = tips_on_surface(on_feet, on_feet.half_diagonal_m, low, interface, tuple(azimuths_deg))
    assert found == pytest.approx(tipped_in_truth_m_s2(height_at, azimuths_deg), rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("height_at", "settles_deg"),
    [
        pytest.param(ledges(15, 15), 0.0, id="V"),
        pytest.param(ledges(0, -30), 1.0, id="fall"),  # 4 of 24 draws, by .35 to .98 degrees
        pytest.param(ledges(-30, -30), 0.0, id="ridge"),
        pytest.param(dome(2.0), 0.0, id="dome"),
    ],
)
def test_scan_over_a_surface_holds_the_truth(height_at, settles_deg, tmp_path):
    result = survey(cloud_on(height_at))
    scene = result.scene
    assert not scene.ground.is_plane
    stated = scene.report["unseen_base"]["toppling"][::3]
    true = tipped_in_truth_m_s2(height_at, [entry["azimuth_deg"] for entry in stated])
    holds = [e["low_m_s2"] <= t <= e["high_m_s2"] for e, t in zip(stated, true, strict=True)]
    assert np.mean(holds) >= 0.75  # of eight azimuths of one rock
    least = [min(entry[name] for entry in stated) for name in ("low_m_s2", "high_m_s2")]
    assert least[0] <= true.min() <= least[1]
    again = Scene.load(save_survey(result, tmp_path / "rock"))
    assert again.id == scene.id
    for number in (0, 7):
        base = again.on_base(number)
        assert not base.ground.is_plane
        touching, resting = base.grounded.touching(base.grounded.pose), base.grounded.resting_pose
        assert base.grounded.stands(resting)
        settled = Rotation.from_quat(resting[3:]) * Rotation.from_quat(touching[3:]).inv()
        assert np.rad2deg(settled.magnitude()) <= settles_deg + 1e-6


@pytest.mark.slow
def test_scan_of_a_block_on_four_feet_in_a_groove_holds_the_truth():
    height_at = ledges(30, 30)
    truth = on_four_feet(height_at)
    stations = virtual.scan_around(truth, 1, resolution_per_height=0.009)
    scene = survey(virtual.cloud_of(stations, virtual.DEMO_ORIGIN_M)[0]).scene
    # No station sees the block's underside: at most half of the gap below it, .027 m3, is closed as rock.
    assert truth.rock.volume_m3 < scene.rock.volume_m3 < truth.rock.volume_m3 + 0.5 * 0.027
    stated = scene.report["unseen_base"]["toppling"]
    true = tipped_in_truth_m_s2(height_at, [entry["azimuth_deg"] for entry in stated], on_four_feet)
    holds = [entry["low_m_s2"] <= t <= entry["high_m_s2"] for entry, t in zip(stated, true, strict=True)]
    assert np.mean(holds) >= 0.85  # 21 of 24: what 90 % intervals are to hold of one rock
