"""The reference for coupled sliding and rocking, against event-driven rocking, closed forms, impact laws."""

from itertools import pairwise

import numpy as np
import pytest
from reference import closed_forms as exact
from reference.rocking import Ground, PlaneBody, rock
from reference.sliding_rocking import slide_and_rock

from toppling.models.pedestal import ContactProperties

G = 9.81
BODY = PlaneBody.rectangle(0.2, 0.6)
GRIP = ContactProperties(10.0, 10.0)


def level(acceleration):
    return lambda time: (-acceleration(time), -G)


def standing(_):
    return 0.0, -G


def leaning(body, angle):
    c, s = np.cos(angle), np.sin(angle)
    right = body.right_m
    return (right - right * c + body.height_m * s, right * s + body.height_m * c, angle)


@pytest.mark.thorough
def test_with_grip_it_is_event_driven_rocking_to_first_order():
    alpha = BODY.slenderness(1)
    time = np.array([0.3, 0.6, 0.9, 1.2])
    event = rock(BODY, Ground.still(), 1.3, angle_rad=0.6 * alpha).angle_at(time)
    steps = 2e-3 / 2.0 ** np.arange(5)
    errors = []
    for step in steps:
        stepped = slide_and_rock(BODY, GRIP, standing, 1.3, step, place=leaning(BODY, 0.6 * alpha))
        errors.append(np.abs(np.interp(time, stepped.time_s, stepped.place[:, 2]) - event).max() / alpha)
    # Events fall anywhere in a step, so no halving halves the error; a constant bounds it. Measured 1.4 to 5.3.
    assert (np.array(errors) < 7.0 * steps).all()


def test_a_forced_motion_with_grip_is_that_of_event_driven_rocking():
    push = Ground.sine(4.5, 0.6)
    time = np.linspace(0.1, 0.9, 9)
    event = rock(BODY, push, 1.0).angle_at(time)
    stepped = slide_and_rock(BODY, GRIP, level(lambda t: push.at(t)[0]), 1.0, 2e-4)
    assert np.interp(time, stepped.time_s, stepped.place[:, 2]) == pytest.approx(event, abs=8e-4)


@pytest.mark.parametrize(
    ("mu", "slope_deg", "push", "duration"), [(0.6, 0, 1.2, 0.1), (0.6, 5, 1.2, 0.1), (0.3, 12, 0.5, 0.3)]
)
def test_a_flat_block_slips_by_newmarks_closed_form(mu, slope_deg, push, duration):
    slope = np.deg2rad(slope_deg)
    flat = PlaneBody.rectangle(1.0, 0.1)

    def gravity(time):
        pushed = (
            push * G if time < duration else 0.0
        )  # uphill ground, so the block is driven downhill, along +x
        return pushed * np.cos(slope) + G * np.sin(slope), -G * np.cos(slope) + pushed * np.sin(slope)

    stepped = slide_and_rock(flat, ContactProperties(mu, mu), gravity, 3.0, 1e-3)
    assert stepped.place[-1, 0] == pytest.approx(exact.slip_of_pulse_m(mu, slope, push, duration), rel=2e-4)
    assert np.abs(stepped.place[:, 2]).max() < 1e-12


def test_static_friction_holds_until_its_own_limit_and_kinetic_friction_brakes():
    flat, contact = PlaneBody.rectangle(1.0, 0.1), ContactProperties(0.6, 0.3)
    held = slide_and_rock(flat, contact, lambda t: (0.59 * G, -G), 0.5, 1e-3)
    assert np.abs(held.place[:, 0]).max() < 1e-12
    slid = slide_and_rock(flat, contact, lambda t: (0.61 * G, -G), 0.5, 1e-3)
    assert slid.place[-1, 0] == pytest.approx(0.5 * 0.31 * G * 0.25, rel=1e-9)


@pytest.mark.parametrize("acceleration_g", [0.4, 0.8, 2.0])
def test_the_corner_starts_to_slip_at_shentons_boundary(acceleration_g):
    boundary = exact.rock_friction_boundary(3.0, acceleration_g)
    for share, slips in ((1 - 1e-3, True), (1 + 1e-3, False)):
        contact = ContactProperties(boundary * share, boundary * share)
        start = slide_and_rock(BODY, contact, lambda t: (acceleration_g * G, -G), 3e-6, 1e-6)
        x, _, angle = start.place.T
        corner = x + BODY.right_m * np.cos(angle) - BODY.height_m * np.sin(angle) - BODY.right_m
        assert start.place[-1, 2] > 0
        assert (corner[-1] > 1e-6 * start.place[-1, 0]) == slips


@pytest.mark.parametrize("mu", [0.4, 0.6, 1.0])
def test_a_translating_block_lands_by_the_printed_boundary(mu):
    boundary = exact.landing_boundary(3.0, mu)
    for share, slips in ((1 - 1e-3, True), (1 + 1e-3, False)):
        landed = slide_and_rock(
            BODY, ContactProperties(mu, mu), standing, 1e-9, 1e-9, velocity=(1.0, -share * boundary, 0.0)
        )
        speed = landed.velocity[-1, 0] - BODY.height_m * landed.velocity[-1, 2]
        assert landed.velocity[-1, 2] > 0
        assert (speed > 1e-5) == slips


@pytest.mark.parametrize("alpha_deg", [5, 20, 45])
def test_an_impact_with_grip_has_housners_ratio(alpha_deg):
    body = PlaneBody.rectangle(np.sin(np.deg2rad(alpha_deg)), np.cos(np.deg2rad(alpha_deg)))
    before = -0.3 * np.array([body.height_m, body.right_m, 1.0])  # turning back about the right corner
    after = slide_and_rock(body, GRIP, standing, 1e-9, 1e-9, velocity=tuple(before)).velocity[-1]
    assert after[2] / before[2] == pytest.approx(exact.impact_ratio(body.right_m, body.height_m), rel=1e-6)


@pytest.mark.parametrize("e", [0.0, 0.3, 0.9])
def test_a_dropped_block_leaves_by_newtons_restitution(e):
    fallen = slide_and_rock(
        BODY, ContactProperties(0.5, 0.5, e), standing, 1e-6, 1e-6, velocity=(0.0, -2.0, 0.0)
    )
    assert fallen.velocity[-1] == pytest.approx([0, 2.0 * e, 0], abs=2e-5)


def test_energy_never_grows_without_work_done():
    # Without restitution: with it and friction Newton's law may create energy (Kane and Levinson 1985).
    rng = np.random.default_rng(2)
    for _ in range(5):
        body = PlaneBody(*rng.uniform(0.1, 0.4, 2), 0.6, 0.13)
        contact = ContactProperties(*sorted(rng.uniform(0.1, 1.0, 2), reverse=True))
        velocity = tuple(rng.normal(size=3))
        went = slide_and_rock(body, contact, standing, 0.4, 1e-3, place=(0, 0.7, 0.0), velocity=velocity)
        kinetic = 0.5 * (went.velocity**2) @ [1, 1, body.inertia_per_mass_m2]
        energy = kinetic + G * went.place[:, 1]
        # Impulses only take, free flight keeps; turning about a corner errs by the square of a step's angle.
        angle = 1e-3 * np.abs(went.velocity[:, 2]).max()
        assert np.diff(energy).max() < (1e-12 + angle**2) * energy.max()
        assert energy[-1] < energy[0]


@pytest.mark.thorough
def test_the_coupled_motion_converges():
    push = Ground.sine(6.0, 0.5)
    contact, time = ContactProperties(0.4, 0.35), np.array([0.2, 0.35, 0.5])
    answers = [
        np.stack([np.interp(time, m.time_s, m.place[:, i]) for i in (0, 2)])
        for m in (
            slide_and_rock(BODY, contact, level(lambda t: push.at(t)[0]), 0.5, h)
            for h in (8e-4, 4e-4, 2e-4, 1e-4, 5e-5)
        )
    ]
    change = [np.abs(b - a).max() for a, b in pairwise(answers)]
    assert change[3] < change[0] / 2**3  # first order; measured a sixtieth
    assert change[2] < 2e-4
