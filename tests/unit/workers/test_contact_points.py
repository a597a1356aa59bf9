"""Contact points: which of a body's points can touch, from which tilt on, and how an uneven pedestal enters them."""

import numpy as np
import pytest
import trimesh
from refusals import refused

from toppling.models.ground.points import contact_of
from toppling.models.pedestal import Pedestal
from toppling.models.relief import contact_feet_m, height_below
from toppling.models.scene import Scene
from toppling.models.shapes import box, cylinder
from toppling.workers.seating import settled

UP = np.array([0.0, 0.0, 1.0])


def square(half, z=0.0, right=None):
    """A level pedestal, cut off at x = right."""
    right = half if right is None else right
    vertices = np.array([[-half, -half, z], [right, -half, z], [right, half, z], [-half, half, z]], float)
    return Pedestal(np.array([0.0, 0.0, z]), UP, vertices, np.array([[0, 1, 2], [0, 2, 3]]))


def test_a_block_touches_with_its_four_lower_corners_from_no_tilt_on():
    contact = contact_of(Scene.block(0.2, 0.3, 0.6))
    assert (contact.onset_deg < 1.0).sum() == 4
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


def test_a_level_surface_gives_the_feet_of_the_plane():
    rock = box(0.2, 0.2, 0.6).moved(np.eye(3), (0.0, 0.0, 0.6))
    plane = contact_feet_m(rock, Pedestal(np.zeros(3), UP))
    surface = contact_feet_m(rock, square(2.0))
    lowest = {tuple(p) for p in np.round(surface[surface[:, 2] < 1e-9], 9)}
    assert lowest == {tuple(p) for p in np.round(plane[plane[:, 2] < 1e-9], 9)}


def test_the_feet_under_an_overhang_lie_on_the_pedestals_edge():
    rock = box(0.2, 0.2, 0.6).moved(np.eye(3), (0.0, 0.0, 0.6))
    feet = contact_feet_m(rock, square(2.0, right=0.1))
    lowest = feet[feet[:, 2] < 1e-9]
    assert {tuple(p) for p in np.round(lowest[:, :2], 9)} == {
        (-0.2, -0.2),
        (-0.2, 0.2),
        (0.1, -0.2),
        (0.1, 0.2),
    }


def test_a_rock_on_three_bumps_rests_on_three_feet():
    rock = box(0.3, 0.3, 0.4).moved(np.eye(3), (0.0, 0.0, 0.41))
    axis = np.linspace(-1.0, 1.0, 81)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    bumps = [(0.2, 0.0), (-0.1, 0.17), (-0.1, -0.18)]
    z = sum(0.01 * np.exp(-((x - a) ** 2 + (y - b) ** 2) / 0.05**2) for a, b in bumps)
    n = len(axis)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.vstack(
        [
            np.column_stack([corner, corner + n, corner + 1]),
            np.column_stack([corner + 1, corner + n, corner + n + 1]),
        ]
    )
    ground = Pedestal(np.zeros(3), UP, np.column_stack([x.ravel(), y.ravel(), z.ravel()]), faces)
    scene = settled(Scene(rock, ground))
    feet = contact_feet_m(scene.rock, ground)
    touching = feet[feet[:, 2] < 1e-5]
    assert len(touching) == 3
    # Each foot is a vertex of the grid (spacing 0.025) on or next to a bump's top.
    for a, b in bumps:
        assert np.hypot(touching[:, 0] - a, touching[:, 1] - b).min() < 0.03


def test_the_highest_layer_is_the_ground_and_none_is_no_ground():
    vertices = np.array([[0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 1], [2, 0, 2], [0, 2, 1]], float)
    faces = np.array([[0, 1, 2], [3, 4, 5]])
    height = height_below(np.array([[0.5, 0.5], [1.5, 1.5]]), vertices, faces, highest=True)
    assert height[0] == pytest.approx(1.25)
    assert np.isnan(height[1])


def test_a_pedestal_that_is_not_under_the_rock_is_refused():
    rock = box(0.2, 0.2, 0.6).moved(np.eye(3), (10.0, 0.0, 0.6))
    with refused("pedestal.not_below_rock"):
        contact_feet_m(rock, square(2.0))
