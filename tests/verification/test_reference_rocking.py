"""The exact references themselves: printed values of two independent integrators, energy, and each other."""

import numpy as np
import pytest
from engine_cases import least
from reference import closed_forms as exact
from reference.rocking import Ground, PlaneBody, overturns, rock

G = 9.81
SLENDER = (0.2, 0.6)


def alpha_p(b, h):
    return np.arctan2(b, h), exact.rocking_frequency(b, h)


@pytest.mark.parametrize(
    ("b", "h", "share", "printed"),
    [
        (0.2, 0.6, 0.1, 0.137963), (0.2, 0.6, 0.5, 0.387295), (0.2, 0.6, 0.9, 0.878271),
        (0.3, 1.5, 0.5, 0.601184),
    ],
)  # fmt: skip
def test_free_rocking_lands_at_the_printed_time(b, h, share, printed):
    alpha, p = alpha_p(b, h)
    closed = exact.free_rocking_time_s(alpha, p, share)
    assert closed == pytest.approx(printed, abs=6e-7)  # half of the last printed digit
    swung = rock(PlaneBody.rectangle(b, h), Ground.still(), 2.0, angle_rad=share * alpha)
    assert swung.impacts_s[0] == pytest.approx(closed, rel=1e-9)


@pytest.mark.parametrize("alpha_deg", [2, 10, 25, 45])
@pytest.mark.parametrize("half_diagonal", [0.05, 10.0])
@pytest.mark.parametrize("share", [0.05, 0.5, 0.999])
def test_the_integrator_meets_the_elliptic_integral_over_the_grid(alpha_deg, half_diagonal, share):
    alpha = np.deg2rad(alpha_deg)
    b, h = half_diagonal * np.sin(alpha), half_diagonal * np.cos(alpha)
    p = exact.rocking_frequency(b, h)
    for sign in (1, -1):
        swung = rock(PlaneBody.rectangle(b, h), Ground.still(), 10 / p, angle_rad=sign * share * alpha)
        assert swung.impacts_s[0] == pytest.approx(exact.free_rocking_time_s(alpha, p, share), rel=1e-8)


@pytest.mark.parametrize(
    ("b", "h", "printed"),
    [
        (0.2, 0.6, [0.467995, 0.306388, 0.209667, 0.146450, 0.103481]),
        (0.3, 1.5, [0.652697, 0.532122, 0.446612, 0.380465, 0.327135]),
    ],
)
def test_peaks_after_impacts_are_the_printed_peaks(b, h, printed):
    alpha, _ = alpha_p(b, h)
    peak, peaks = 0.9 * alpha, []
    for _ in range(5):
        peak = exact.next_peak(alpha, exact.impact_ratio(b, h), peak)
        peaks.append(peak / alpha)
    assert peaks == pytest.approx(printed, abs=6e-7)
    swung = rock(PlaneBody.rectangle(b, h), Ground.still(), 8.0, angle_rad=0.9 * alpha)
    between = np.linspace(swung.impacts_s[0], swung.impacts_s[5], 40001)
    angle = np.abs(swung.angle_at(between))
    for number in range(5):
        held = (between >= swung.impacts_s[number]) & (between <= swung.impacts_s[number + 1])
        assert angle[held].max() / alpha == pytest.approx(printed[number], abs=2e-6)


@pytest.mark.parametrize("alpha_deg", [2, 15, 30, 45])
def test_energy_is_conserved_between_impacts_and_lost_at_them_by_the_ratio(alpha_deg):
    alpha = np.deg2rad(alpha_deg)
    b, h = np.sin(alpha), np.cos(alpha)
    body, p = PlaneBody.rectangle(b, h), exact.rocking_frequency(b, h)
    swung = rock(body, Ground.still(), 3 / p, angle_rad=0.8 * alpha)
    for start, end, solution in swung.pieces:
        angle, rate = solution(np.linspace(start, end, 50))
        energy = 0.5 * rate**2 + p**2 * (np.cos(alpha - np.abs(angle)) - np.cos(alpha))
        assert np.ptp(energy) < 1e-9 * p**2 * alpha**2
    # The rate on landing equals the rate on leaving: each landing is the ratio times the one before.
    landings = np.abs(swung.rates_before_rad_s)
    assert landings[1:] / landings[:-1] == pytest.approx(
        np.full(len(landings) - 1, exact.impact_ratio(b, h)), rel=1e-8
    )


def test_an_asymmetrical_body_conserves_the_angular_momentum_about_the_landing_corner():
    body = PlaneBody(right_m=0.3, left_m=0.15, height_m=0.8, inertia_per_mass_m2=0.2)
    for landing, near, far in ((1, 0.3, 0.15), (-1, 0.15, 0.3)):
        # Velocity of the centre of mass turning about the far corner at rate 1, moment about the near one.
        velocity = np.array([0.8, -landing * far])
        arm = np.array([-landing * near, 0.8])
        before = 0.2 + (arm[1] * velocity[0] - arm[0] * velocity[1] * 1.0)
        assert body.impact_ratio(landing) == pytest.approx(before / (0.2 + near**2 + 0.64), rel=1e-12)
    mirror = PlaneBody(0.15, 0.3, 0.8, 0.2)
    push = Ground.sine(3.0, 0.8)
    pull = Ground.sine(-3.0, 0.8)
    time = np.linspace(0, 2, 50)
    assert rock(body, push, 2.0).angle_at(time) == pytest.approx(
        -rock(mirror, pull, 2.0).angle_at(time), abs=1e-9
    )


def test_a_velocity_step_overturns_at_the_closed_form():
    body, pulse = PlaneBody.rectangle(*SLENDER), 1e-5
    found = least(lambda v: overturns(body, Ground.constant(v / pulse, pulse)), 0.97, 0.973, 6)
    # The pulse acts for 10 us instead of none: the angle gained in it is of the order of 1e-5 of alpha.
    assert found == pytest.approx(exact.overturning_velocity_step_m_s(*SLENDER), rel=1e-4)


@pytest.mark.parametrize("alpha_deg", [2, 20, 45])
@pytest.mark.parametrize("ratio", [1.05, 1.5, 4.0])
def test_the_integrator_overturns_at_the_closed_duration_over_the_grid(alpha_deg, ratio):
    alpha = np.deg2rad(alpha_deg)
    b, h = 2.0 * np.sin(alpha), 2.0 * np.cos(alpha)
    closed = exact.overturning_duration_s(alpha, exact.rocking_frequency(b, h), ratio)
    body = PlaneBody.rectangle(b, h)
    for share, expected in ((1 - 1e-6, 0), (1 + 1e-6, 1)):
        assert overturns(body, Ground.constant(-ratio * G * np.tan(alpha), share * closed)) == expected


@pytest.mark.parametrize(
    ("period", "printed"),
    [(0.5, (1.7183, 4.3704, 4.8030)), (0.75, (1.3030, 2.8119, 2.9207)), (1.0, (1.2111, 2.1486, 2.1873))],
)
def test_a_full_sine_overturns_in_the_printed_windows(period, printed):
    body, scale = PlaneBody.rectangle(*SLENDER), G * SLENDER[0] / SLENDER[1]
    fate = {a: overturns(body, Ground.sine(a * scale, period)) for e in printed for a in (e - 1e-4, e + 1e-4)}
    safe_one, over_one, over_two, safe_two, safe_three, over_three = fate.values()
    assert (safe_one, safe_two, safe_three) == (0, 0, 0)
    assert over_one == over_two == -over_three != 0  # the first branch falls after an impact, the other way


def test_linear_samples_approach_the_smooth_motion_to_second_order():
    body, time = PlaneBody.rectangle(*SLENDER), np.array([0.4, 0.6, 0.9])
    smooth = rock(body, Ground.sine(5.0, 0.5), 1.0).angle_at(time)
    errors = []
    for step in (0.01, 0.005):
        samples = np.arange(0, 0.5 + step / 2, step)
        swung = rock(body, Ground.samples(step, 5.0 * np.sin(4 * np.pi * samples)), 1.0)
        errors.append(np.abs(swung.angle_at(time) - smooth).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.2)


def test_a_vertical_acceleration_acts_as_gravity():
    body, horizontal = PlaneBody.rectangle(*SLENDER), np.array([-4.0, -4.0])
    lifted = rock(body, Ground.samples(0.15, horizontal, [2.0, 2.0]), 0.15)
    heavier = rock(body, Ground.samples(0.15, horizontal), 0.15, gravity_m_s2=G + 2.0)
    assert lifted.angle_at([0.15]) == pytest.approx(heavier.angle_at([0.15]), rel=1e-9)
    assert rock(body, Ground.samples(0.15, horizontal, [3.0, 3.0]), 0.15).pieces == []  # 4 < 12.81 / 3 holds


def test_a_body_that_cannot_land_on_its_other_corner_is_refused():
    with pytest.raises(ValueError, match="impact ratio"):
        rock(PlaneBody.rectangle(np.tan(np.deg2rad(56)), 1.0), Ground.still(), 1.0, angle_rad=0.1)


@pytest.mark.parametrize(
    ("found", "printed"),
    [
        (exact.overturning_velocity_step_m_s(*SLENDER), "0.971274"),
        *(
            (exact.overturning_duration_s(*alpha_p(*SLENDER), ratio), printed)
            for ratio, printed in ((1.5, "0.322118"), (2.0, "0.203970"))
        ),
        *(
            (exact.rock_friction_boundary(3, level_g), printed)
            for level_g, printed in ((0.4, "0.349754"), (0.8, "0.438914"), (2.0, "0.636364"))
        ),
        *(
            (exact.landing_boundary(3, mu), printed)
            for mu, printed in ((0.4, "1.62069"), (0.6, "0.575758"), (1.0, "0.142857"))
        ),
        (exact.slip_of_pulse_m(0.6, 0.0, 1.2, 0.1), "0.058860"),
        (exact.slip_of_pulse_m(0.6, np.deg2rad(5), 1.2, 0.1), "0.0903691"),
        (exact.wobble_rate_rad_s(0.2, 0.6, np.deg2rad(10)), "6.675663"),
        (exact.wobble_rate_rad_s(0.2, 0.0, np.deg2rad(10)), "33.61355"),
    ],
)
def test_closed_forms_have_the_printed_values(found, printed):
    half_of_the_last_digit = 0.6 * 10.0 ** -len(printed.partition(".")[2])
    assert found == pytest.approx(float(printed), abs=half_of_the_last_digit)
