"""Heights of surfaces below places, exact for triangles of any size; feet against the clearance that they stand for."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from reference.bodies import height_field
from scipy.spatial import ConvexHull

from toppling.models.pedestal import Pedestal
from toppling.models.relief import contact_feet_m, height_below
from toppling.models.rock import Rock
from toppling.models.shapes import box
from toppling.models.statics import quasi_static_toppling_m_s2, support_polygon_m

G = 9.81
UP = np.array([0.0, 0.0, 1.0])


def lattice(cells, height):
    return height_field(lambda x, _: np.full(len(x), height), np.linspace(0.0, 1.0, cells))


@given(st.integers(2, 25), st.floats(0.001, 0.999), st.floats(0.001, 0.999))
def test_two_large_triangles_below_many_small_ones_are_found(cells, u, v):
    small, small_faces = lattice(cells, 1.0)
    large, large_faces = lattice(2, 0.0)
    large[:, 2] = 0.2 * large[:, 0]
    vertices, faces = np.vstack([small, large]), np.vstack([small_faces, large_faces + len(small)])
    places = np.array([[u, v]])
    # Differences of coordinates of size 1, in double precision.
    assert abs(height_below(places, vertices, faces, highest=False)[0] - 0.2 * u) < 1e-12
    assert abs(height_below(places, vertices, faces, highest=True)[0] - 1.0) < 1e-12


@pytest.mark.parametrize("turn_deg", [0.0, 30.0, 45.0])
def test_long_strips_have_the_heights_of_the_surface_that_they_make_up(turn_deg):
    """Triangles that cross the whole surface: the circle around it holds all places, and it covers few."""
    across = np.linspace(-1.0, 1.0, 201)
    vertices = np.array([[x, y, x**2] for x in across for y in (-1.0, 1.0)])
    first = 2 * np.arange(200)[:, None]
    faces = np.concatenate([first + np.array(corners) for corners in ([0, 2, 3], [0, 3, 1])])
    turn = np.radians(turn_deg)
    axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    places = np.stack(np.meshgrid(np.linspace(-0.7, 0.7, 90), np.linspace(-0.7, 0.7, 90)), -1).reshape(-1, 2)
    known = np.interp(places[:, 0], across, across**2)
    vertices[:, :2] = vertices[:, :2] @ axes
    found = height_below(places @ axes, vertices, faces, highest=True)
    np.testing.assert_allclose(found, known, atol=1e-12)


def strips(profile, along):
    """A level pedestal's triangles: a profile (k, 2) of x and z, drawn out over places along y."""
    profile, k, n = np.asarray(profile, float), len(profile), len(along)
    vertices = np.column_stack([np.repeat(profile, n, axis=0), np.tile(along, k)])[:, [0, 2, 1]]
    number = np.arange(k * n).reshape(k, n)
    a, b, c, d = (
        grid.ravel() for grid in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:])
    )
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return Pedestal(np.zeros(3), UP, vertices, faces)


BLOCK = box(0.2, 0.2, 0.6).moved(np.eye(3), (0.0, 0.0, 0.6))
"""It stands on z = 0."""


def toppling_m_s2(pedestal, azimuths_deg):
    return [value for _, value in quasi_static_toppling_m_s2(BLOCK, pedestal, G, azimuths_deg)]


@pytest.mark.parametrize(
    "along", [[-1.0, 1.0], [-3000.0, 4000.0], *(np.arange(-1.03, 1, d) for d in (0.5, 0.15, 0.05))]
)
def test_rails_support_a_block_where_its_edges_cross_them_however_far_apart_their_vertices(along):
    rails = strips(
        [(-1, -0.1), (-0.15, -0.1), (-0.1, 0), (-0.05, -0.1), (0.05, -0.1), (0.1, 0), (0.15, -0.1)], along
    )
    np.testing.assert_allclose(toppling_m_s2(rails, [0.0, 90.0]), [G * 0.1 / 0.6, G * 0.2 / 0.6], rtol=1e-9)


@pytest.mark.parametrize("wall", [[], *([(0.05 + lean, -2), (1, -2)] for lean in (-0.03, 0.0, 0.01))])
def test_a_face_that_overhangs_a_cliff_topples_over_its_edge_with_a_meshed_wall_or_none(wall):
    cliff = strips([(-1, 0), (0.05, 0), *wall], [-1.0, 1.0])
    assert np.ptp(support_polygon_m(BLOCK, cliff), axis=0) == pytest.approx([0.25, 0.4, 0.0])
    np.testing.assert_allclose(toppling_m_s2(cliff, [180.0, 0.0]), [G * 0.05 / 0.6, G * 0.2 / 0.6], rtol=1e-9)


def rough(seed, fold):
    """A rough rock over rough ground; with a fold of more than half its cells the ground has overhangs."""
    rng = np.random.default_rng(seed)
    ball = trimesh.creation.icosphere(1)
    vertices = ball.vertices * (1.0 + 0.3 * rng.uniform(-1, 1, (len(ball.vertices), 1)))
    rock = Rock.from_triangles(vertices * [0.4, 0.3, 0.6] + [0.5, 0.5, 1.5], ball.faces)
    ground, faces = lattice(6, 0.0)
    return rock, ground + rng.uniform(-1, 1, ground.shape) * [fold * 0.2, fold * 0.2, 0.3], faces


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.2, 0.9]))
@settings(max_examples=30)
def test_no_clearance_lies_below_the_contacts_hull_and_no_contact_below_the_clearance(seed, fold):
    rock, ground, faces = rough(seed, fold)
    feet = contact_feet_m(rock, Pedestal(np.zeros(3), UP, ground, faces))
    places = np.vstack([np.random.default_rng(seed).uniform(0.0, 1.0, (4000, 2)), feet[:, :2]])
    above = height_below(places, rock.vertices_m, rock.faces, highest=False)
    clearance = np.column_stack([places, above - height_below(places, ground, faces, highest=True)])
    assert (feet[:, 2] - clearance[4000:, 2] > -1e-9).all()
    below = ConvexHull(feet).equations
    below = below[below[:, 2] < -1e-6]  # what looks down
    seen = clearance[np.isfinite(clearance[:, 2])]
    # Both sides of it are differences of coordinates of size 1.
    assert (seen @ below[:, :3].T + below[:, 3]).max() < 1e-9


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.2, 0.9]))
@settings(max_examples=10)
def test_splitting_the_pedestals_triangles_leaves_the_feets_hull_as_it_is(seed, fold):
    rock, ground, faces = rough(seed, fold)
    finer = trimesh.remesh.subdivide(*trimesh.remesh.subdivide(ground, faces))
    first, other = (
        ConvexHull(contact_feet_m(rock, Pedestal(np.zeros(3), UP, *mesh)))
        for mesh in ((ground, faces), finer)
    )
    for hull, feet in ((first, other.points), (other, first.points)):
        below = hull.equations[hull.equations[:, 2] < -1e-6]
        assert (feet @ below[:, :3].T + below[:, 3]).max() < 1e-9
