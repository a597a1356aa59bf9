"""Laws of tipping without slip and of sliding, on planes and on contacts whose normals differ."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from toppling.models.pedestal import moment_arms
from toppling.models.pivots import tips_m_s2, turn_under
from toppling.models.scene import Scene
from toppling.models.shapes import box

G = 9.81
DOWN = np.array([0.0, 0.0, -G])


def push(azimuth_deg):
    return -np.array([math.cos(math.radians(azimuth_deg)), math.sin(math.radians(azimuth_deg)), 0.0])


@given(seed=st.integers(0, 10_000), azimuth_deg=st.floats(0.0, 360.0), slope_deg=st.floats(0.0, 20.0))
@settings(max_examples=60)
def test_on_a_plane_a_rock_tips_over_the_edges_of_its_polygon_whatever_lies_within(
    seed, azimuth_deg, slope_deg
):
    turn = Rotation.from_rotvec([math.radians(slope_deg), 0.0, 0.0]).as_matrix()
    places = np.random.default_rng(seed).uniform(-0.5, 0.5, (30, 2))
    places = np.vstack([places, [[0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5], [0.5, -0.5]]])
    arms = np.column_stack([places, np.full(len(places), -0.9)]) @ turn.T
    corners = arms[ConvexHull(places).vertices]
    edges = moment_arms(corners, np.zeros(3), turn[:, 2])
    holds, tips = edges @ DOWN, -edges @ push(azimuth_deg)
    least = (holds[tips > 0.0] / tips[tips > 0.0]).min()  # Anooshehpoor, Brune and Zeng (2004)
    found = tips_m_s2(arms, np.tile(turn[:, 2], (len(arms), 1)), 1.0, DOWN, push(azimuth_deg))
    assert found == pytest.approx(least, rel=1e-9)


FEET = np.array([[x, y, -0.8] for x in (-0.2, 0.2) for y in (-0.3, 0.3)])


def walls(slope_deg):
    """Normals of a groove along y on whose walls the feet stand."""
    lean = math.radians(slope_deg)
    return np.column_stack([-np.sign(FEET[:, 0]) * math.sin(lean), np.zeros(4), np.full(4, math.cos(lean))])


@pytest.mark.parametrize("slope_deg", [-40.0, 0.0, 5.0, 30.0, 60.0])
def test_contacts_on_two_facets_tip_about_their_own_places_though_half_spaces_would_hold_all(slope_deg):
    arms, normals = FEET, walls(slope_deg)
    for azimuth_deg, arm_m in ((0.0, 0.2), (180.0, 0.2), (90.0, 0.3)):
        assert tips_m_s2(arms, normals, 1.0, DOWN, push(azimuth_deg)) == pytest.approx(G * arm_m / 0.8)
        turn = turn_under(arms, normals, 1.0, DOWN + (G * arm_m / 0.8 + 0.1) * push(azimuth_deg))
        assert turn.axis @ np.cross([0.0, 0.0, 1.0], push(azimuth_deg)) == pytest.approx(1.0)


def test_a_slab_on_a_wall_is_taken_off_it_by_what_undoes_its_weight_and_never_tips_into_it():
    foot, edge = np.array([-0.1, 0.0, -0.5]), np.array([0.15, 0.0, 0.55])
    arms = np.array([value + np.array([0.0, y, 0.0]) for value in (foot, edge) for y in (-0.2, 0.2)])
    normals = np.array([[0.0, 0.0, 1.0]] * 2 + [[-1.0, 0.0, 0.0]] * 2)
    assert tips_m_s2(arms, normals, 1.0, DOWN, push(0.0)) == pytest.approx(G * 0.1 / 0.5)
    assert tips_m_s2(arms, normals, 1.0, DOWN, push(180.0)) == math.inf


@given(turned_deg=st.floats(0.0, 360.0), azimuth_deg=st.floats(0.0, 360.0), slope_deg=st.floats(-40.0, 40.0))
@settings(max_examples=60)
def test_contacts_that_are_turned_with_the_push_answer_the_same(turned_deg, azimuth_deg, slope_deg):
    turn = Rotation.from_rotvec([0.0, 0.0, math.radians(turned_deg)]).as_matrix()
    normals = walls(slope_deg)
    turned = tips_m_s2(FEET @ turn.T, normals @ turn.T, 1.0, DOWN, push(azimuth_deg + turned_deg))
    assert turned == pytest.approx(tips_m_s2(FEET, normals, 1.0, DOWN, push(azimuth_deg)), rel=1e-9)


@pytest.mark.parametrize("friction", [0.2, 0.3, 0.9])
@pytest.mark.parametrize("slope_deg", [0.0, 8.0])
def test_a_block_on_an_incline_slides_at_the_angle_of_friction_and_tips_at_its_slenderness(
    friction, slope_deg
):
    """Uphill and downhill: g tan(angle + slope), g tan(angle - slope), of friction and of the block alike."""
    rock = box(0.2, 0.3, 0.8).moved(np.eye(3), (0.0, 0.0, 0.8))
    scene = Scene.from_mesh((rock.vertices_m, rock.faces), friction=friction, slope_deg=slope_deg)
    slope = math.radians(slope_deg)
    (uphill, downhill) = scene.statics([0.0, 180.0])  # the ground's: downhill toward 0, the rock leans uphill
    for found, sign in ((uphill, 1.0), (downhill, -1.0)):
        tips, slides = (G * math.tan(math.atan(value) + sign * slope) for value in (0.25, friction))
        assert found.tips_m_s2 == pytest.approx(tips, rel=1e-6)
        assert found.slides_m_s2 == pytest.approx(slides if slides < tips else math.inf, rel=1e-9)
    assert scene.tips_m_s2([0.0]) == scene.quasi_static_toppling_m_s2([0.0]) == [(0.0, uphill.tips_m_s2)]
