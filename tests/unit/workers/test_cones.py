"""Impulses of contacts: Signorini's and Coulomb's laws, whatever the normals."""

import math

import numpy as np
import pytest
from scipy.optimize import linprog

from toppling.models.compiled import compiled
from toppling.models.ground.cones import solve_cones
from toppling.models.ground.contacts import CONTACT, Touching, solver_room
from toppling.models.ground.equilibrium import are_held, held_up_to_m_s2, wrenches

ENOUGH_M_S = 1e-9


MOST_CONTACTS = 12


@compiled
def solve_all(contacts, number, friction, inverse_inertia, velocity, room):
    """Solve many problems; how many of them have an answer."""
    solved = 0
    for i in range(len(number)):
        limits = friction[i, 0], friction[i, 1]
        at = Touching(contacts[i], number[i], limits, inverse_inertia[i], velocity[i], ENOUGH_M_S, room)
        solved += solve_cones(at)
    return solved


def solve(contacts, friction, inverse_inertia, velocity, room):
    many = (
        contacts[None],
        np.array([len(contacts)]),
        np.array([friction]),
        inverse_inertia[None],
        velocity[None],
    )
    return solve_all(*many, room) == 1


def random_impacts(random, count):
    """Bodies that strike ground: contacts anywhere around them, below them on a plane, in a groove and on a ridge."""
    shape = count, MOST_CONTACTS
    half_m = random.uniform(0.1, 1.0, (count, 3))
    moments = (half_m[:, [1, 0, 0]] ** 2 + half_m[:, [2, 2, 1]] ** 2) / 3.0
    axes = np.linalg.qr(random.normal(size=(count, 3, 3)))[0]
    inertia = axes @ (moments[:, :, None] * axes.transpose(0, 2, 1))
    arms = random.uniform(-0.8, 0.8, (*shape, 3)) * np.linalg.norm(half_m, axis=1)[:, None, None]
    around, slope = random.normal(size=(*shape, 3)), random.uniform(-1.0, 1.0, count)
    slope[::4] = 0.0
    across = np.sign(arms[:, :, 0])
    facets = np.stack(
        [-across * np.sin(slope)[:, None], 0.0 * across, np.cos(slope)[:, None] + 0.0 * across], axis=2
    )
    anywhere = (np.arange(count) % 4 == 1)[:, None, None]
    arms[:, :, 2] = np.where(
        anywhere[:, :, 0], arms[:, :, 2], np.abs(arms[:, :, 0]) * np.tan(slope)[:, None] - half_m[:, 2:]
    )
    contacts = np.zeros(shape, CONTACT)
    normals = np.where(anywhere, around, facets)
    contacts["arm_m"], contacts["normal"] = arms, normals / np.linalg.norm(normals, axis=-1, keepdims=True)
    static = random.uniform(0.0, 3.0, count)
    kinetic = np.where(random.random(count) < 0.5, static, static * random.random(count))
    return {
        "contacts": contacts, "number": random.integers(1, MOST_CONTACTS + 1, count),
        "friction": np.column_stack([static, kinetic]), "inverse_inertia": np.linalg.inv(inertia),
        "velocity": random.normal(size=(count, 6)),
    }, inertia  # fmt: skip


def energies(velocity, inertia):
    turning = np.einsum("ni,nij,nj->n", velocity[:, 3:], inertia, velocity[:, 3:])
    return 0.5 * ((velocity[:, :3] ** 2).sum(axis=1) + turning)


def residuals_m_s(contacts, friction, velocity):
    """By how much each contact misses Signorini's law, and Coulomb's as sticking or, if less, as slipping."""
    normal, impulse = contacts["normal"], contacts["impulse"]
    moves = velocity[:, None, :3] + np.cross(velocity[:, None, 3:], contacts["arm_m"])
    pressed, parts = (impulse * normal).sum(axis=2), (moves * normal).sum(axis=2)
    rubbed, slips = impulse - pressed[..., None] * normal, moves - parts[..., None] * normal
    static, kinetic = friction[:, :1], friction[:, 1:]
    rubs, slip = np.linalg.norm(rubbed, axis=2), np.linalg.norm(slips, axis=2)
    sticking = np.maximum(slip, rubs - static * pressed)
    toward = rubbed - slips
    size = np.maximum(np.linalg.norm(toward, axis=2), 1e-300)
    limit = kinetic * pressed
    sliding = np.linalg.norm(rubbed - (limit / size)[..., None] * toward, axis=2)
    sliding = np.maximum(sliding, limit - size)
    coulomb = np.where(pressed > 0.0, np.minimum(sticking, sliding), rubs)
    return np.maximum(np.abs(np.minimum(pressed, parts - contacts["floor_m_s"])), coulomb)


def test_a_contact_that_hardly_moves_on_a_rock_that_rolls_fast_has_an_answer():
    """Its velocity is the difference of larger ones, known no better than these are rounded."""
    random = np.random.default_rng(68)
    impacts, _ = random_impacts(random, 2_000)
    contacts, velocity = impacts["contacts"][:, :1].copy(), impacts["velocity"]
    velocity[:, :3] = 1e-7 * random.normal(size=(2_000, 3)) - np.cross(
        velocity[:, 3:], contacts["arm_m"][:, 0]
    )
    number = np.ones(2_000, np.int64)
    of = impacts["friction"], impacts["inverse_inertia"], velocity
    assert solve_all(contacts, number, *of, solver_room(MOST_CONTACTS)) == 2_000
    assert residuals_m_s(contacts, impacts["friction"], velocity).max() < 2.0 * ENOUGH_M_S


@pytest.mark.parametrize("count", [2_000, pytest.param(100_000, marks=pytest.mark.thorough)])
def test_of_random_impacts_all_have_an_answer_that_obeys_the_cones_and_adds_no_energy(count):
    impacts, inertia = random_impacts(np.random.default_rng(67), count)
    before = impacts["velocity"].copy()
    assert solve_all(**impacts, room=solver_room(MOST_CONTACTS)) == count
    contacts, velocity = impacts["contacts"], impacts["velocity"]
    given = np.where(np.arange(MOST_CONTACTS) < impacts["number"][:, None], 1.0, 0.0)
    off_m_s = given * residuals_m_s(contacts, impacts["friction"], velocity)
    speed_m_s = np.linalg.norm(before, axis=1)
    assert (off_m_s.max(axis=1) / speed_m_s).max() < 1e-8
    for restitution in (0.0, 0.3, 0.5):
        after = velocity + restitution * (velocity - before)
        assert (energies(after, inertia) <= (1.0 + 1e-9) * energies(before, inertia)).all()
    moments = np.cross(contacts["arm_m"], contacts["impulse"])
    spun = np.einsum("nij,nkj->ni", impacts["inverse_inertia"], moments)
    np.testing.assert_allclose(velocity[:, :3] - before[:, :3], contacts["impulse"].sum(axis=1), atol=1e-9)
    np.testing.assert_allclose(velocity[:, 3:] - before[:, 3:], spun, atol=1e-7)


def test_a_contact_whose_friction_jams_gets_the_impulse_that_stops_it():
    """Friction against an assumed slip would stop it with no end of an impulse: (158, -90, -88) was once its answer."""
    mobility = np.array([[2.6424, 2.4656, 2.2759], [2.4656, 8.7866, -0.8373], [2.2759, -0.8373, 8.5837]])
    coupling = mobility - np.eye(3)
    arm = np.linalg.svd(coupling)[2][2]
    x, y, z = arm
    turned = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    inverse = turned @ coupling @ turned.T + 5.0 * np.outer(arm, arm)
    free = np.array([-0.4166, -1.0735, 0.1787])
    for start in ([0.790, -0.617, -0.518], [0.0, 0.0, 0.0]):
        contacts, velocity = np.zeros(1, CONTACT), np.append(free, np.zeros(3))
        contacts["arm_m"], contacts["normal"], contacts["impulse"] = arm, [1.0, 0.0, 0.0], start
        assert solve(contacts, (0.8, 0.8), inverse, velocity, solver_room(1))
        off_m_s = residuals_m_s(contacts[None], np.array([[0.8, 0.8]]), velocity[None])
        assert off_m_s.max() < 1e-8
        assert np.linalg.norm(contacts["impulse"]) < 0.5


def test_walls_that_close_on_a_rock_from_both_sides_have_no_answer():
    contacts = np.zeros(2, CONTACT)
    contacts["arm_m"] = [[-0.2, 0.0, 0.0], [0.2, 0.0, 0.0]]
    contacts["normal"] = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]
    contacts["floor_m_s"] = 0.1
    assert not solve(contacts, (0.8, 0.8), np.eye(3), np.zeros(6), solver_room(2))


def test_the_few_loaded_contacts_of_many_that_touch_are_found():
    """A square slab that lands flat on a row of points: any share of the weight will do, and none may close."""
    contacts = np.zeros(40, CONTACT)
    along = np.linspace(-0.4, 0.4, 20)
    contacts["arm_m"][:, 0] = np.repeat([-0.3, 0.3], 20)
    contacts["arm_m"][:, 1], contacts["arm_m"][:, 2] = np.tile(along, 2), -0.2
    contacts["normal"][:, 2] = 1.0
    velocity = np.array([0.01, 0.0, -0.5, 0.1, 0.2, 0.0])
    assert solve(contacts, (0.8, 0.8), np.diag([6.0, 6.0, 4.0]), velocity, solver_room(40))
    assert np.abs(velocity).max() < 1e-6


def records(arms_m, normals):
    contacts = np.zeros(len(arms_m), CONTACT)
    contacts["arm_m"], contacts["normal"] = arms_m, normals
    return contacts


@pytest.mark.parametrize("contacts", [3, 4, 6, 30, 200])
def test_what_is_held_is_what_the_linear_programme_over_all_wrenches_holds_and_the_solver_holds_no_more(
    contacts,
):
    """Contacts below a body of 1.3 m, whose normals lean up to 50 degrees."""
    random = np.random.default_rng(contacts)
    weight, inertia_m2 = np.array([0.0, 0.0, -9.81]), np.diag([0.15, 0.15, 0.1])
    for _ in range(20 if contacts < 100 else 2):
        low, high = [-0.4, -0.4, -0.7], [0.4, 0.4, -0.5]
        arms, leans = random.uniform(low, high, (contacts, 3)), random.uniform(-1.0, 1.0, (contacts, 2))
        normals = np.column_stack([leans, np.ones(contacts)])
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        columns, direction = wrenches(arms, normals, 0.6), np.append(random.normal(size=2), 0.0)
        solved = linprog(
            np.append(np.zeros(columns.shape[1]), -1.0),
            A_eq=np.column_stack([columns, np.append(direction, np.zeros(3))]),
            b_eq=-np.append(weight, np.zeros(3)),
            bounds=[(0.0, None)] * columns.shape[1] + [(None, None)],
        )
        far = solved.x[-1] if solved.status == 0 else np.inf if solved.status == 3 else -np.inf
        near, beyond = (
            weight + np.outer([far - 1e-3, far + 1e-3], direction) if np.isfinite(far) else (weight, weight)
        )
        if contacts > 3 and np.isfinite(far):  # on three a single load may be all that is held
            assert are_held(columns, np.array([near, beyond]), 0.65).tolist() == [True, False]
        held = held_up_to_m_s2(records(arms, normals), 0.6, inertia_m2, weight, direction, (0.0, 300.0))
        # The pyramids miss at most half a per cent of the cones.
        assert held is None or held <= max(far, 0.0) * 1.02 + 0.05


def test_the_solver_holds_a_block_up_to_the_angle_of_friction_or_its_slenderness():
    """Also where two contacts whose line lies within both cones could hold any load by pressing on each other."""
    feet = np.array([[x, y, -0.6] for x in (-0.2, 0.2) for y in (-0.2, 0.2)])
    level, down, push = (
        np.tile([0.0, 0.0, 1.0], (4, 1)),
        np.array([0.0, 0.0, -9.81]),
        np.array([1.0, 0.0, 0.0]),
    )
    span, inertia_m2 = (0.0, 300.0), np.diag([0.133, 0.133, 0.027])
    groove = np.column_stack([-2.5 * feet[:, 0], np.zeros(4), np.full(4, math.cos(math.pi / 6))])
    for friction, normals, held in (
        (0.2, level, 0.2),
        (0.8, level, 1 / 3),
        (0.8, groove, 1 / 3),
        (3.0, groove, 1 / 3),
    ):
        found = held_up_to_m_s2(records(feet, normals), friction, inertia_m2, down, push, span)
        assert found == pytest.approx(9.81 * held, rel=1e-5)
    assert held_up_to_m_s2(records(feet[:2], level[:2]), 0.8, inertia_m2, down, push, span) is None
    assert held_up_to_m_s2(records(feet, level), 0.8, inertia_m2, down, push, (0.0, 3.0)) == np.inf
