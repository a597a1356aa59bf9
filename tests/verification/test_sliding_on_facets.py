"""Rocks that slide on ground that is no plane: closed forms, and that no shake ends before the slide does."""

import math

import numpy as np
import pytest
from reference.closed_forms import slip_of_pulse_m
from scipy.spatial.transform import Rotation
from test_ground import STILL, G, as_surface, block, block_on, facets, pulse, stool_on
from test_rest_on_facets import burst

from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.models.shapes import box
from toppling.workers.shaking import shake


def slips_m(scene, motion, preset):
    """With shortcuts, and without."""
    ended, whole = (shake(scene, motion, preset, shortcuts=entry) for entry in (True, False))
    assert ended.outcome == whole.outcome
    return ended.slip_m, whole.slip_m


@pytest.mark.thorough
@pytest.mark.parametrize("preset", ["fast", "standard"])
@pytest.mark.parametrize(
    ("left", "right"), [(5, 5), (30, 30), (-5, -5), (-15, -15), (0, 15), (0, -15)], ids=str
)
def test_a_slide_that_outlasts_the_motion_is_followed_to_its_end(left, right, preset):
    for friction in (0.3, 0.4, 0.6):
        scene = stool_on(left, right, friction)
        for azimuth_deg in (0.0, 90.0, 200.0):
            ended, whole = slips_m(scene, pulse(0.8 * G, 0.25, azimuth_deg, after_s=0.01), preset)
            assert ended == pytest.approx(whole, rel=0.01, abs=1e-4)


@pytest.mark.thorough
@pytest.mark.parametrize(("half_width", "half_height"), [(0.4, 0.25), (0.2, 0.6)])
def test_a_motion_that_ends_in_full_swing_leaves_the_slip_of_the_whole_shake(half_width, half_height):
    for slopes_deg in ((15, 15), (-15, -15), (0, -15)):
        scene = block_on(*slopes_deg, 0.4, half_width, half_height)
        for seed in range(3):
            motion = Motion(burst(seed, peak_m_s2=9.0, lasting_s=1.5)[:100], 0.01)
            ended, whole = slips_m(scene, motion, "fast")
            assert ended == pytest.approx(whole, rel=0.01, abs=1e-4)


@pytest.mark.parametrize("slope_deg", [5, 15, 30, -5, -15])
def test_along_a_fold_friction_grows_as_the_facets_press_harder(slope_deg):
    """Both facets carry the weight over the cosine of their slope."""
    friction, level, lasting_s = 0.4, 0.8, 0.25
    scene = stool_on(slope_deg, slope_deg, friction)
    found_m = shake(scene, pulse(level * G, lasting_s, 90.0, after_s=0.01), "standard").slip_m
    grown = friction / math.cos(math.radians(slope_deg))
    assert found_m == pytest.approx(slip_of_pulse_m(grown, 0.0, level, lasting_s), rel=0.01)


@pytest.mark.parametrize("azimuth_deg", [0.0, 30.0, 90.0])
def test_on_a_level_surface_a_pulse_slides_a_block_by_newtons_law(azimuth_deg):
    level, friction, lasting_s = 1.2, 0.6, 0.1
    scene = block(facets(0, 0), friction, 0.4, 0.1)
    found_m = shake(
        as_surface(scene), pulse(level * G, lasting_s, azimuth_deg, after_s=0.01), "standard"
    ).slip_m
    assert found_m == pytest.approx(slip_of_pulse_m(friction, 0.0, level, lasting_s), rel=0.01)


def test_on_an_incline_a_pulse_uphill_slides_a_block_down_by_newtons_law():
    slope, level, friction, lasting_s = math.radians(5.0), 1.2, 0.6, 0.1
    turn = Rotation.from_euler("y", slope).as_matrix()
    ground, faces = facets(0, 0)
    slab = box(0.4, 0.4, 0.1).moved(turn, turn @ [0.0, 0.0, 0.1])
    tilted = ground @ turn.T, faces
    scene = Scene.from_mesh((slab.vertices_m, slab.faces), pedestal=tilted, friction=friction)
    found_m = shake(as_surface(scene), pulse(-level * G, lasting_s, after_s=0.01), "standard").slip_m
    assert found_m == pytest.approx(slip_of_pulse_m(friction, slope, level, lasting_s), rel=0.01)


def with_a_corner_between(vertices_m, faces, a, b):
    """A body with a further corner in the middle of an edge."""
    middle, split = len(vertices_m), []
    for face in faces.tolist():
        if {a, b} <= set(face):
            split += [[middle if corner == end else corner for corner in face] for end in (a, b)]
        else:
            split.append(face)
    return np.vstack([vertices_m, vertices_m[[a, b]].mean(axis=0)]), np.array(split)


def test_a_slip_does_not_depend_on_the_triangles_of_the_rock():
    slab = box(0.4, 0.3, 0.1).moved(np.eye(3), (0.0, 0.0, 0.1))
    mesh = slab.vertices_m, slab.faces
    a, b = np.flatnonzero((slab.vertices_m[:, 2] < 1e-9) & (slab.vertices_m[:, 0] > 0.0))
    finer = with_a_corner_between(*mesh, a, b)
    for corner in (a, b):
        finer = with_a_corner_between(*finer, corner, 8)
    spin = {"velocity_m_s": (1.0, 0.2, 0.0), "angular_velocity_rad_s": (0.0, 0.0, 3.0)}
    slips_m = [
        shake(
            as_surface(Scene.from_mesh(value, pedestal=facets(0, 0), friction=0.4)), STILL, initial=spin
        ).slip_m
        for value in (mesh, finer)
    ]
    assert slips_m[0] > 0.1
    assert slips_m[1] == pytest.approx(
        slips_m[0], rel=0.01
    )  # a turning slab shares its weight over more corners
