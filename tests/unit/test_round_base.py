"""Rounded bases stand for smooth surfaces: their patches lie on them, and rocks rest and topple as on these."""

import math

import numpy as np
import pytest
import trimesh
from reference.bodies import revolved, round_cap
from scipy.spatial.transform import Rotation

from toppling.models.rock import Rock
from toppling.models.rounded_base import RoundedBase, refined, rounded_base_of
from toppling.models.scene import Scene
from toppling.models.shapes import box, cylinder
from toppling.models.smooth_mesh import SmoothMesh

G = 9.81
UP = np.array([0.0, 0.0, 1.0])


def smooth_cap_m_s2(rock, radius_m=0.65, half_width_m=0.3):
    """Largest g X / Z of a rolling cap up to its rim: X = d sin t, Z = rho - d cos t, d the centre's height over the
    centre of mass."""
    d = radius_m - rock.com_m[2]
    t = np.linspace(0.0, min(math.asin(half_width_m / radius_m), math.pi / 4), 2001)
    return (G * d * np.sin(t) / (radius_m - d * np.cos(t))).max()


def least(scene, azimuths_deg=(0.0, 17.0, 120.0, 200.0)):
    return [a for _, a in scene.quasi_static_toppling_m_s2(azimuths_deg)]


@pytest.mark.parametrize("edge_m", [0.08, 0.04])
def test_middles_of_a_caps_edges_lie_on_its_sphere(edge_m):
    mesh = SmoothMesh.of(Rock.from_triangles(*round_cap(edge_m)))
    middles, cut, crease = mesh.middles()
    on_cap = middles[cut & ~crease]
    on_cap = on_cap[on_cap[:, 2] < 0.95 * (0.65 - math.sqrt(0.65**2 - 0.3**2))]
    assert len(on_cap) > 20
    assert np.abs(np.linalg.norm(on_cap - 0.65 * UP, axis=1) - 0.65).max() < 1e-9


@pytest.mark.parametrize(
    ("edge_m", "sphere"),
    [(0.08, ()), (0.03, ()), (0.01, ()), *((edge_m, (0.3, 0.2999, 0.42)) for edge_m in (0.08, 0.02))],
)
def test_a_cap_and_a_nearly_neutral_hemisphere_topple_as_smooth_bodies_whatever_their_edges(edge_m, sphere):
    scene = Scene.from_mesh(round_cap(edge_m, *sphere))
    exact = smooth_cap_m_s2(scene.rock, *sphere[:2])
    assert least(scene) == pytest.approx([exact] * 4, rel=0.01)
    assert exact < 0.13 * G if sphere else scene.rounded_base.change < 0.02


def egg(half_m, stretched, fineness):
    ball = trimesh.creation.icosphere(subdivisions=fineness)
    vertices = ball.vertices * half_m
    vertices[vertices[:, 2] > 0.0, 2] *= stretched
    return vertices, ball.faces


def smooth_egg_m_s2(half_width_m, half_height_m, com_m):
    """Largest g X / Z of an ellipse that rolls, from its support function sqrt((a sin t)^2 + (c cos t)^2)."""
    t = np.linspace(0.0, math.pi / 4, 2001)
    x, z = half_width_m**2 * np.sin(t), -(half_height_m**2) * np.cos(t)
    reach = np.hypot(half_width_m * np.sin(t), half_height_m * np.cos(t))
    x, z = x / reach, z / reach - com_m
    return (G * (x * np.cos(t) + z * np.sin(t)) / (x * np.sin(t) - z * np.cos(t))).max()


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("half_m", "stretched", "fineness"),
    [((0.3, 0.3, 0.2), 2.0, 3), ((0.5, 0.35, 0.25), 3.0, 3), ((0.4, 0.3, 0.3), 0.9, 3)],
)
def test_an_ellipsoid_topples_along_its_axes_as_a_smooth_ellipsoid(half_m, stretched, fineness):
    scene = Scene.from_mesh(egg(half_m, stretched, fineness))
    com_m = scene.rock.com_m[2] - scene.rock.vertices_m[:, 2].min() - half_m[2]
    exact = [smooth_egg_m_s2(half_m[k], half_m[2], com_m) for k in (0, 1, 0, 1)]
    assert least(scene, (0.0, 90.0, 180.0, 270.0)) == pytest.approx(exact, rel=0.015)


def test_an_ellipsoid_that_is_pushed_obliquely_topples_across_its_weak_axis():
    across, *oblique = least(Scene.from_mesh(egg((0.5, 0.35, 0.25), 3.0, 3)), (90.0, 30.0, 60.0))
    assert oblique == pytest.approx(across / np.sin(np.radians([30.0, 60.0])), rel=0.02)


@pytest.mark.parametrize("groove_deg", [20.0, 35.0])
def test_a_spheroid_along_a_groove_tips_about_the_line_through_both_of_its_contacts(groove_deg):
    """The contacts of a body of half lengths a along the groove and b across it do as one of an ellipse on a line."""
    vertices, faces = egg((1.3, 1.0, 1.0), 1.0, 4)
    rises, level = (
        np.tan(np.radians(groove_deg)),
        vertices[:, 2].mean() - 1.0 / np.cos(np.radians(groove_deg)),
    )
    places = [(x, y, level + abs(y) * rises) for x in (-9.0, 9.0) for y in (-6.0, 0.0, 6.0)]
    groove = np.array(places), np.array([[0, 3, 1], [1, 3, 4], [1, 4, 2], [2, 4, 5]])
    scene = Scene.from_mesh((vertices, faces), pedestal=groove, friction=2.0)
    oblique_deg = [0.0, 10.0, 20.0, 190.0]
    exact = G * (1.3 - 1.0 / 1.3) / 2.0 / np.abs(np.cos(np.radians(oblique_deg)))
    assert [limits.tips_m_s2 for limits in scene.statics(oblique_deg)] == pytest.approx(exact, rel=3e-3)


@pytest.mark.parametrize("sides", [12, 24, 48])
def test_a_lying_prism_retains_the_faces_that_it_rolls_over(sides):
    prism = cylinder(0.4, 0.5, sides).moved(Rotation.from_euler("x", 90, degrees=True).as_matrix())
    base = Scene.from_mesh((prism.vertices_m, prism.faces)).rounded_base
    assert base is None or not base.rolls


@pytest.mark.thorough
def test_a_rock_with_a_rounded_base_rests_where_its_centre_of_mass_is_lowest():
    vertices, faces = egg((0.3, 0.25, 0.2), 1.5, 3)
    leaning = Rotation.from_euler("xyz", [9.0, -6.0, 40.0], degrees=True)
    scene = Scene.from_mesh((leaning.apply(vertices), faces))
    rest = scene.grounded.rock_at_rest(scene.rock, scene.pedestal, "test")
    assert (rest.vertices_m[vertices[:, 2].argmax()] - rest.com_m)[:2] == pytest.approx([0.0, 0.0], abs=1e-4)


def test_a_rock_too_high_for_its_rounded_base_is_held_by_no_acceleration():
    assert least(Scene.from_mesh(round_cap(0.04, 0.4, 0.3, 1.2))) == [0.0] * 4


def test_a_slope_takes_as_much_from_a_rolling_rock_as_an_acceleration_gives():
    """Downhill and uphill of 3 degrees: the direction of g - a in the plane's frame is what counts."""
    scene = Scene.from_mesh(round_cap(0.04), slope_deg=3.0)
    rock = Rock.from_triangles(*round_cap(0.04))
    level = math.atan(smooth_cap_m_s2(rock) / G)
    expected = [G * math.tan(level + math.radians(3.0)), G * math.tan(level - math.radians(3.0))]
    assert least(scene, (0.0, 180.0)) == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("sides", [4, 6, 12, 48])
def test_a_flat_base_is_left_as_it_is(sides):
    rock = Rock.from_triangles(*revolved([(0.3, 0.0), (0.35, 0.1), (0.3, 1.0)], sides))
    block = box(0.2, 0.2, 0.6)
    for entry in (rock, block):
        assert rounded_base_of(entry) is None
        assert refined(entry) is entry


def test_a_rough_base_is_not_rounded():
    vertices, faces = egg((0.3, 0.3, 0.2), 2.0, 4)
    rough = vertices * np.random.default_rng(5).uniform(0.99, 1.01, (len(vertices), 1))
    assert rounded_base_of(Rock.from_triangles(rough, faces)) is None


@pytest.mark.thorough
def test_a_flat_base_with_a_rounded_border_topples_as_a_flat_base_of_that_width():
    """Rolling on over the border, its centre of mass falls from the start."""
    angles = np.radians([0, 15, 30, 45, 60])
    border = [(0.3 + 0.05 * math.sin(t), 0.05 - 0.05 * math.cos(t)) for t in angles]
    scene = Scene.from_mesh(revolved([*border, (0.36, 1.0)], 32))
    assert refined(scene.rock).vertices_m[:, 2].min() > -1e-9
    assert scene.rounded_base is not None
    assert least(scene) == pytest.approx([G * 0.3 / scene.rock.com_m[2]] * 4, rel=0.01)


@pytest.mark.thorough
def test_triangles_that_are_refined_topple_nearer_to_the_smooth_cap():
    coarse = Rock.from_triangles(*round_cap(0.08))
    both = [RoundedBase(value, rolls=False) for value in (coarse, refined(coarse))]
    assert both[0].is_coarse
    assert both[1].change < 0.4 * both[0].change


def test_a_fine_cap_is_unchanged_and_not_warned_of():
    ball = Rock.from_triangles(*round_cap(0.03, radius_m=3.0))
    assert refined(ball) is ball
    assert not RoundedBase(ball, rolls=False).is_coarse


def test_an_uneven_base_of_facets_between_its_outline_s_corners_is_not_rounded():
    angle = np.linspace(0.0, 2.0 * np.pi, 14, endpoint=False)
    random = np.random.default_rng(3)
    foot = np.column_stack([0.25 * np.cos(angle), 0.25 * np.sin(angle), random.uniform(0.0, 3e-3, 14)])
    top = foot * (1.4, 1.4, 0.0) + (0.0, 0.0, 0.8)
    hull = trimesh.convex.convex_hull(np.vstack([foot, top]))
    assert Scene.from_mesh((hull.vertices, hull.faces)).rounded_base is None
