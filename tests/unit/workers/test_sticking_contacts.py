"""Impulses of contacts that all stick: the laws of a clamp, whether they lie on a face, a line or at a point."""

import numpy as np
import pytest

from toppling.models.compiled import compiled
from toppling.models.ground.contacts import CONTACT, Touching, solver_room
from toppling.models.ground.sticking_contacts import stick_at_once

ENOUGH_M_S = 1e-9
INERTIA_M2 = np.array([[0.15, 0.02, 0.01], [0.02, 0.12, -0.01], [0.01, -0.01, 0.05]])

FACE = [[0.2, 0.2, -0.6], [-0.2, 0.2, -0.6], [-0.2, -0.2, -0.6], [0.2, -0.2, -0.6]]
GROUPS = {
    "a face": FACE,
    "three of a face": FACE[:3],
    "a line": FACE[:2],
    "three on a line": [*FACE[:2], [0.05, 0.2, -0.6]],
    "a point": FACE[:1],
    "two at a point": [FACE[0], FACE[0]],
}


@compiled
def stick(contacts, friction, inverse_inertia, velocity, room):
    at = Touching(contacts, len(contacts), friction, inverse_inertia, velocity, ENOUGH_M_S, room)
    return stick_at_once(at)


def group(places, seed=3):
    """Contacts that carry upward impulses with some friction, and a velocity that changes these little."""
    random = np.random.default_rng(seed)
    contacts = np.zeros(len(places), CONTACT)
    contacts["arm_m"], contacts["normal"] = places, [0.0, 0.0, 1.0]
    contacts["impulse"] = random.uniform([-0.05, -0.05, 0.9], [0.05, 0.05, 1.1], (len(places), 3))
    return contacts, random.normal(size=6) * 0.02


def solved(places, friction=0.8, **more):
    contacts, velocity = group(places)
    for name, values in more.items():
        contacts[name] = values
    before, start = contacts.copy(), velocity.copy()
    room, limits = solver_room(len(contacts)), (friction, friction)
    found = stick(contacts, limits, np.linalg.inv(INERTIA_M2), velocity, room)
    return found, before, start, contacts, velocity


def effect(contacts):
    """What impulses do to a velocity (6, 3 n)."""
    columns = []
    for arm in contacts["arm_m"]:
        x, y, z = arm
        moment = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        columns.append(np.vstack([np.eye(3), np.linalg.solve(INERTIA_M2, moment)]))
    return np.hstack(columns)


@pytest.mark.parametrize("places", GROUPS.values(), ids=GROUPS.keys())
def test_every_contact_comes_to_rest_by_the_least_change_of_impulses_which_accounts_for_the_motion(places):
    found, before, start, contacts, velocity = solved(places)
    assert found
    points = velocity[:3] + np.cross(velocity[3:], contacts["arm_m"])
    np.testing.assert_allclose(points, 0.0, atol=1e-14)
    given = (contacts["impulse"] - before["impulse"]).ravel()
    np.testing.assert_allclose(start + effect(contacts) @ given, velocity, atol=1e-13)
    least = np.linalg.pinv(effect(contacts), rcond=1e-9) @ (velocity - start)
    np.testing.assert_allclose(given, least, atol=1e-12)


def test_a_contact_moves_with_its_floor():
    floor_m_s = np.array([-0.01, -0.01, 0.0, 0.0])
    found, _, _, contacts, velocity = solved(FACE, floor_m_s=floor_m_s)
    assert found
    points = velocity[:3] + np.cross(velocity[3:], contacts["arm_m"])
    np.testing.assert_allclose(points[:, 2], floor_m_s, atol=1e-14)


def test_friction_that_no_motion_depends_on_goes_where_it_would_let_a_contact_slip():
    pulled = [[0.9, 0.0, 1.0], [-0.9, 0.0, 1.0]]
    found, _, _, contacts, velocity = solved(FACE[:2], friction=0.8, impulse=pulled)
    assert found
    assert (np.hypot(*contacts["impulse"][:, :2].T) < 0.2 * contacts["impulse"][:, 2]).all()
    np.testing.assert_allclose(velocity[:3] + np.cross(velocity[3:], contacts["arm_m"]), 0.0, atol=1e-14)


@pytest.mark.parametrize("more_places", [0, 12])
@pytest.mark.parametrize("uneven", [1, 4])
def test_a_load_within_the_base_is_distributed_without_tension_or_slip(more_places, uneven):
    random = np.random.default_rng(1)
    for _ in range(500):
        inner = np.column_stack([random.uniform(-0.2, 0.2, (more_places, 2)), np.full(more_places, -0.6)])
        contacts, _ = group(np.vstack([FACE, inner]))
        pressed, leans = random.uniform(size=len(contacts)) ** uneven, random.uniform(-0.2, 0.2, 2)
        held = np.column_stack([pressed * leans[0], pressed * leans[1], pressed])
        contacts["impulse"] = [0.0, 0.0, 1e-3]
        before = contacts["impulse"].copy()
        start = -effect(contacts) @ (held - before).ravel()
        velocity = start.copy()
        assert stick(contacts, (0.8, 0.8), np.linalg.inv(INERTIA_M2), velocity, solver_room(len(contacts)))
        impulse = contacts["impulse"]
        assert (np.hypot(*impulse[:, :2].T) <= 0.8 * impulse[:, 2] + 1e-12).all()
        np.testing.assert_allclose(velocity, 0.0, atol=1e-12)
        given = effect(contacts) @ (impulse - before).ravel()
        np.testing.assert_allclose(start + given, velocity, atol=1e-12)


@pytest.mark.parametrize(
    ("why", "more"),
    [
        ("one pulls however they share", {"impulse": [[0.0, 0.0, 0.001]] * 4}),
        ("all slip", {"friction": 0.001}),
        ("none carries", {"impulse": [[0.0, 0.0, 0.0]] * 4}),
        ("an open one closes", {"floor_m_s": [0.0] * 3 + [0.5], "impulse": [[0.0, 0.0, 1.0]] * 3 + [[0.0] * 3]}),
        ("the floors are none of a rigid rock", {"floor_m_s": [0.1, 0.0, 0.1, 0.0]}),
    ],
)  # fmt: skip
def test_nothing_changes_where(why, more):
    found, before, start, contacts, velocity = solved(FACE, **more)
    assert not found
    np.testing.assert_array_equal(contacts, before)
    np.testing.assert_array_equal(velocity, start)
