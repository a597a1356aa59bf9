"""The axes of friction: what Bullet's rows converge to along them is against the slip."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from toppling.models.scene import Scene
from toppling.workers.contact.contact_points import contact_of
from toppling.workers.contact.friction import best_axes_rad, point_mobilities

ALLOWED_RAD = 1e-3
SCENE = Scene.block(0.2, 0.45, 0.6)
CONTACT = contact_of(SCENE)
SPEEDS = st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3)
TURNS = st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3)


def leans_rad(axes_rad, feet, turn, velocity, spin):
    """Angle from each foot's slip to the direction in which rows along these axes think that it goes."""
    along = np.array([[np.cos(axes_rad), np.sin(axes_rad), 0.0], [-np.sin(axes_rad), np.cos(axes_rad), 0.0]])
    inertia = turn @ np.diag(CONTACT.principal_inertia_m2) @ turn.T
    leans = []
    for arm in CONTACT.centres_body_m[feet] @ turn.T:
        answer = [np.cross(np.linalg.solve(inertia, np.cross(arm, axis)), arm) + axis for axis in along]
        mobility = np.einsum("ij,ij->i", along, answer)
        slip = along @ (velocity + np.cross(spin, arm))
        thought = slip / mobility
        turned = np.cross([*slip, 0.0], [*thought, 0.0])[2]
        leans.append(np.arcsin(np.clip(turned / np.linalg.norm(slip) / np.linalg.norm(thought), -1.0, 1.0)))
    return np.array(leans)


def axes_for(points, turn, velocity, spin, slips_from_m_s=0.0, present_rad=0.0):
    pose = np.array([0.0, 0.0, 0.6, *Rotation.from_matrix(turn).as_quat()])
    unlike, slip = point_mobilities(
        np.ascontiguousarray(CONTACT.centres_body_m),
        np.ascontiguousarray(CONTACT.mobilities_m2),
        np.array(points, np.int64),
        pose,
        np.array([*velocity, *spin], float),
        float(slips_from_m_s),
    )
    return best_axes_rad(unlike, slip, float(present_rad), ALLOWED_RAD)


@given(turn=TURNS, velocity=SPEEDS, spin=SPEEDS, foot=st.integers(0, len(CONTACT.centres_body_m) - 1))
def test_the_friction_of_one_foot_is_against_its_slip_in_any_pose(turn, velocity, spin, foot):
    turn = Rotation.from_rotvec(turn).as_matrix()
    slip = np.array(velocity) + np.cross(spin, turn @ CONTACT.centres_body_m[foot])
    if np.hypot(*slip[:2]) < 1e-3:
        return
    (lean,) = leans_rad(axes_for([foot], turn, velocity, spin), [foot], turn, velocity, spin)
    assert abs(lean) < 3.0 * ALLOWED_RAD


@given(turn=st.floats(-np.pi, np.pi), toward=st.floats(-np.pi, np.pi))
def test_the_friction_of_all_feet_is_against_a_slip_that_they_share(turn, toward):
    turn, feet = Rotation.from_euler("z", turn).as_matrix(), [0, 1, 2, 3]
    velocity, spin = (np.cos(toward), np.sin(toward), 0.0), (0.0, 0.0, 0.0)
    leans = leans_rad(axes_for(feet, turn, velocity, spin), feet, turn, velocity, spin)
    assert np.sqrt(np.mean(leans**2)) < 3.0 * ALLOWED_RAD


def test_a_foot_at_rest_gets_axes_that_suit_a_slip_in_any_direction():
    turn, still = Rotation.from_euler("zy", [0.3, 0.2]).as_matrix(), (0.0, 0.0, 0.0)
    axes_rad = axes_for([2], turn, still, still, slips_from_m_s=1e-3)
    for toward in np.linspace(0.0, np.pi, 7):
        (lean,) = leans_rad(axes_rad, [2], turn, (np.cos(toward), np.sin(toward), 0.0), still)
        assert abs(lean) < 3.0 * ALLOWED_RAD


@pytest.mark.parametrize("feet", [[], [0, 1, 2, 3]])
def test_axes_that_serve_are_kept(feet):
    still = (0.0, 0.0, 0.0)
    assert (
        axes_for(feet, np.eye(3) @ CONTACT.support_from_body, (0.0, 1.0, 0.0), still, present_rad=0.0) == 0.0
    )
