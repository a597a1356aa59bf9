"""Contact points: which of a body's points can touch, from which tilt on, and how an uneven pedestal enters them."""

import numpy as np
import pytest
import trimesh
from reference.bodies import height_field
from refusals import refused

from toppling.models.ground.points import contact_of
from toppling.models.pedestal import Pedestal
from toppling.models.relief import contact_feet_m
from toppling.models.scene import Scene
from toppling.models.shapes import box, cylinder
from toppling.workers.seating import settled

UP = np.array([0.0, 0.0, 1.0])


def test_a_block_touches_with_its_four_lower_corners_from_no_tilt_on():
    contact = contact_of(Scene.block(0.2, 0.3, 0.6))
    corners = contact.points_body_m @ contact.support_from_body.T
    np.testing.assert_allclose(np.sort(corners[:, 2]), [-0.6] * 4)
    assert set(map(tuple, np.round(np.abs(corners[:, :2]), 9))) == {(0.2, 0.3)}


def test_points_within_a_flat_face_do_not_touch():
    scene = Scene.block(0.2, 0.2, 0.6)
    mesh = scene.rock
    vertices, faces = trimesh.remesh.subdivide(mesh.vertices_m, mesh.faces)
    fine = Scene.from_mesh((vertices, faces))
    assert len(contact_of(fine).points_body_m) == 4


@pytest.mark.parametrize("sides", [16, 64])
def test_every_corner_of_a_cylinders_rim_touches(sides):
    rock = cylinder(0.2, 0.5, sides)
    contact = contact_of(Scene.from_mesh((rock.vertices_m, rock.faces)))
    assert len(contact.points_body_m) == sides


def test_a_rock_on_three_bumps_rests_on_three_contacts():
    rock = box(0.3, 0.3, 0.4).moved(np.eye(3), (0.0, 0.0, 0.41))
    bumps = [(0.2, 0.0), (-0.1, 0.17), (-0.1, -0.18)]

    def height_m(x, y):
        return sum(0.01 * np.exp(-((x - a) ** 2 + (y - b) ** 2) / 0.05**2) for a, b in bumps)

    ground = Pedestal(np.zeros(3), UP, *height_field(height_m, np.linspace(-1.0, 1.0, 81)))
    scene = settled(Scene(rock, ground))
    feet = contact_feet_m(scene.rock, ground)
    touching = feet[feet[:, 2] < 1e-5]
    assert len(touching) == 3
    # Each foot is a vertex of the grid (spacing 0.025) on or next to a bump's top.
    for a, b in bumps:
        assert np.hypot(touching[:, 0] - a, touching[:, 1] - b).min() < 0.03


def test_a_pedestal_that_is_not_under_the_rock_is_refused():
    rock = box(0.2, 0.2, 0.6).moved(np.eye(3), (10.0, 0.0, 0.6))
    triangle = np.array([[-2.0, -2.0, 0.0], [2.0, -2.0, 0.0], [0.0, 2.0, 0.0]])
    with refused("pedestal.not_below_rock"):
        contact_feet_m(rock, Pedestal(np.zeros(3), UP, triangle, np.array([[0, 1, 2]])))
