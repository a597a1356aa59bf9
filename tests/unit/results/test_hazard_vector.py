"""Two measures at once: the joint rate of two curves, against closed forms and a known set of earthquakes."""

import math

import numpy as np
import pytest
from refusals import refused
from scipy.stats import norm

from toppling.results.analysis.lognormal import Lognormal, Surface
from toppling.results.hazard.events import SCATTERS, Standing, joint_rate
from toppling.results.hazard.survival import any_topples, topples
from toppling.results.hazard.tree import HazardCurve

PGA, PGV = "pga_m_s2", "pgv_m_s"
RHO = 0.733
SCATTER = 0.65 * math.sqrt(1 - RHO**2)
SURFACES = [Surface((PGA, PGV), value) for value in ((1.0, 1.2, 2.5), (0.0, 0.5, 3.0), (-3.0, 3.0, 1.0))]


def of_earthquakes(rate, mean_pga, sigma_pga, mean_pgv, sigma_pgv):
    x, y = np.geomspace(0.02, 40, 40), np.geomspace(0.002, 8, 40)
    above = [
        (rate * norm.sf((np.log(levels)[:, None] - mean) / sigma)).sum(axis=1)
        for levels, mean, sigma in ((x, mean_pga, sigma_pga), (y, mean_pgv, sigma_pgv))
    ]
    return HazardCurve("pga", PGA, x, above[0]), HazardCurve("pgv", PGV, y, above[1])


def exact_rate(surface, rate, mean_pga, sigma_pga, mean_pgv, sigma_pgv, correlation=RHO):
    """A probit of two normal variables is a probit of their sum."""
    a, b, c = surface.coefficients
    spread = (b * sigma_pga) ** 2 + (c * sigma_pgv) ** 2 + 2 * b * c * correlation * sigma_pga * sigma_pgv
    return float((rate * norm.cdf((a + b * mean_pga + c * mean_pgv) / np.sqrt(1 + spread))).sum())


def rate_of(fragility, joint):
    events, _ = joint
    return any_topples([Standing("rock", fragility)], events.motions)[0] @ events.rate


def seismicity():
    """Magnitudes 5 to 7.5 by Gutenberg and Richter at 2 to 80 km, with motions that grow and fade as models' do."""
    magnitude, distance = (
        grid.ravel() for grid in np.meshgrid(np.arange(5.05, 7.6, 0.1), [2, 5, 10, 20, 40, 80.0])
    )
    rate = 0.05 * 10 ** -(magnitude - 5.05) * distance / distance.max()
    near = np.log(np.hypot(distance, 5.0))
    mean_pga = 1.6 + 0.6 * (magnitude - 6) - 1.2 * near + 2.0
    mean_pgv = -1.7 + 1.1 * (magnitude - 6) - 1.1 * near + 1.6
    return rate, mean_pga, np.full(len(rate), 0.6), mean_pgv, np.full(len(rate), 0.65)


@pytest.mark.parametrize("surface", SURFACES)
def test_two_power_laws_have_their_closed_form(surface):
    k, j, s = 2.5, 3.0, SCATTER
    x, y = np.geomspace(1e-3, 1e3, 30), np.geomspace(1e-4, 1e2, 30)
    pga, pgv = HazardCurve("pga", PGA, x, 1e-3 * x**-k), HazardCurve("pgv", PGV, y, 1e-5 * y**-j)
    a, b, c = surface.coefficients
    # ln PGV = ln y(x) - j s^2 / 2 + s epsilon, where y(x) is exceeded as often as x.
    total = math.sqrt(1 + (c * s) ** 2)
    intercept, slope = (a + c * (math.log(1e-2) / j - j * s**2 / 2)) / total, (b + c * k / j) / total
    exact = 1e-3 * math.exp(-intercept / slope) ** -k * math.exp((k / slope) ** 2 / 2)
    assert rate_of(surface, joint_rate(pga, pgv, s)) == pytest.approx(exact, rel=2e-3)


@pytest.mark.parametrize("measure", [PGA, PGV])
def test_either_measure_alone_topples_as_its_own_curve(measure):
    from toppling.results.hazard.survival import toppling_rate as of_curve

    curves = dict(zip((PGA, PGV), of_earthquakes(*seismicity()), strict=True))
    joint = joint_rate(*curves.values(), SCATTER)
    rock = Lognormal(measure, 4.0 if measure == PGA else 0.4, 0.3)
    assert rate_of(rock, joint) == pytest.approx(of_curve([rock], curves[measure]), rel=0.02)


@pytest.mark.parametrize("surface", SURFACES)
def test_with_the_scatter_that_magnitudes_add_two_curves_give_the_joint_rate_to_a_hundredth(surface):
    """PGV given PGA varies with the magnitude too; two curves cannot tell by how much, a deaggregation can."""
    rate, mean_pga, sigma_pga, mean_pgv, sigma_pgv = quakes = seismicity()
    pga, pgv = of_earthquakes(*quakes)
    exact = exact_rate(surface, *quakes)
    x = np.interp(-math.log(exact), -np.log(pga.annual_rate), np.log(pga.intensity))
    share = rate * norm.pdf((x - mean_pga) / sigma_pga)
    given = mean_pgv + RHO * sigma_pgv / sigma_pga * (x - mean_pga)
    variance = np.average((given - np.average(given, weights=share)) ** 2, weights=share)
    scatter = math.sqrt(variance + 0.65**2 * (1 - RHO**2))
    joint = joint_rate(pga, pgv, scatter)
    assert rate_of(surface, joint) == pytest.approx(exact, rel=0.01)


def test_full_correlation_ties_the_measures_by_their_rates():
    quakes = seismicity()
    pga, pgv = of_earthquakes(*quakes)
    joint = joint_rate(pga, pgv, 0.0)
    x, y = (joint[0].motions[name][:, 0] for name in (PGA, PGV))
    middle = (x > 0.5) & (x < 5)
    assert pga.rate(x[middle]) == pytest.approx(pgv.rate(y[middle]), rel=0.02)


@pytest.mark.thorough
@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize("sigma", [0.58, 0.67])
@pytest.mark.parametrize("many", [True, False])
def test_the_true_joint_rate_lies_between_those_of_the_readings(surface, sigma, many):
    """Joint rates of an earthquake or of many, by models of small and large residuals."""
    rate, mean_pga, sigma_pga, mean_pgv, _ = (
        entry[slice(None) if many else slice(0, 1)] for entry in seismicity()
    )
    quakes = (rate, mean_pga, sigma_pga, mean_pgv, np.full(len(rate), sigma))
    curves = of_earthquakes(*quakes)
    exact = exact_rate(surface, *quakes)
    found = [rate_of(surface, joint_rate(*curves, scatter)) / exact for scatter in SCATTERS]
    assert min(found) < 1.03  # the readings are known to hold the truth to 3 %
    assert max(found) > 0.97


def test_two_curves_of_a_measure_and_an_invalid_scatter_are_refused():
    pga, pgv = of_earthquakes(*seismicity())
    with refused("hazard.measure_given_twice"):
        joint_rate(pga, pga, SCATTER)
    for scatter in (-0.1, 12.0, math.nan):
        with refused("hazard.scatter_unusable"):
            joint_rate(pga, pgv, scatter)


def test_a_surface_topples_at_no_motion_never_and_asks_for_what_it_is_over():
    motions = {PGA: np.array([0.0, 5.0]), PGV: np.array([0.0, 1.0])}
    assert topples(SURFACES[0], motions)[0] == 0.0
    with refused("hazard.measure_other"):
        topples(SURFACES[0], {PGA: np.array([1.0])})


def test_a_stouter_surface_takes_stronger_motions():
    surface = SURFACES[0]
    motions = {PGA: np.array([3.0]), PGV: np.array([0.4])}
    stronger = {name: 1.5 * values for name, values in motions.items()}
    assert surface.less_fragile(1.5).probability(stronger) == pytest.approx(surface.probability(motions))
