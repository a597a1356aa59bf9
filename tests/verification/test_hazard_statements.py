"""Statements about hazard hold as often as they say: synthetic sites whose truth is known, 500 and more.

Each site has a hazard, rocks, ages and a history of earthquakes that are all drawn; the rocks that chance leaves
standing are judged as a user's would be. A share of 500 has a standard error of 1 % at 95 %.
"""

import math

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm

from toppling.results.analysis.lognormal import Lognormal, ends, fit
from toppling.results.analysis.resampling import bootstrap
from toppling.results.hazard.ages import exposure, joint_ages
from toppling.results.hazard.events import EventBranch, EventSet, EventSite, Standing
from toppling.results.hazard.survival import draws_of, survivals, toppling_rate
from toppling.results.hazard.tree import HazardCurve, branch_weights, weighted_fractile

SITES = 500
BRANCHES = 201
EXPONENT = 2.5
AGES = 100

LEVELS = norm.ppf((np.arange(BRANCHES) + 0.5) / BRANCHES)


def hazard(factor=1.0):
    """A power law that is steeper from 3 m/s on, with motions a factor stronger."""
    x = np.geomspace(0.15, 50, 30)
    rate = 6e-5 * x**-EXPONENT / (1 + (x / 3) ** 1.5)
    return HazardCurve("site", "pgv_m_s", factor * x, rate)


def survival(annual_rate, years):
    """Probability that a rock which topples at a rate stands for some years, the mean of likely ages."""
    return float(np.exp(-annual_rate * np.atleast_1d(years)).mean())


def history_spares(random, curve, rock, years):
    """Whether a rock stands after a drawn history: every earthquake above the curve's first point, one by one."""
    count = random.poisson(curve.annual_rate[0] * years)
    rates = random.uniform(0, 1, count) * curve.annual_rate[0]
    falling = -np.log(curve.annual_rate)
    motions = np.exp(np.interp(-np.log(rates), falling, np.log(curve.intensity)))
    return not (random.random(count) < rock.probability(motions)).any()


def a_site(random):
    """A rock, its uncertain age, and its true age."""
    rock = Lognormal("pgv_m_s", random.uniform(0.6, 2.0), random.uniform(0.15, 0.5))
    middle = random.uniform(8_000, 30_000)
    ages = middle * np.exp(0.3 * norm.ppf((np.arange(AGES) + 0.5) / AGES))
    return rock, ages, middle * math.exp(0.3 * random.standard_normal())


def covered(values, weights, truth):
    low, high = (weighted_fractile(values[:, None], weights, q)[0] for q in (0.025, 0.975))
    return low <= truth <= high


@pytest.mark.thorough
def test_updated_rates_hold_the_truth_in_95_of_100_standing_sites():
    """The hazard's rates are uncertain by a factor; the rock's survival narrows them."""
    random = np.random.default_rng(1)
    curve, prior = hazard(), np.full(BRANCHES, 1 / BRANCHES)
    factors = np.exp(0.8 * LEVELS)
    inside = []
    while len(inside) < SITES:
        rock, ages, years = a_site(random)
        truth = math.exp(0.8 * random.standard_normal())
        if not history_spares(random, curve, rock, truth * years):  # as many events as a rate that is higher
            continue
        rate = toppling_rate([rock], curve)
        weights = branch_weights(prior, [survival(factor * rate, ages) for factor in factors])
        inside.append(covered(factors, weights, truth))
    assert 0.93 <= np.mean(inside) <= 0.97


@pytest.mark.slow
def test_updated_motions_hold_the_truth_in_95_of_100_standing_sites():
    """The hazard's motions are uncertain by a factor, as ground-motion models make them: each branch integrated."""
    random = np.random.default_rng(2)
    branches = [hazard(math.exp(0.5 * level)) for level in LEVELS[::5]]
    prior = np.full(len(branches), 1 / len(branches))
    at_a_level = np.array([branch.rate(1.0) for branch in branches])
    inside = []
    while len(inside) < SITES:
        rock, ages, years = a_site(random)
        truth = hazard(math.exp(0.5 * random.standard_normal()))
        if not history_spares(random, truth, rock, years):
            continue
        weights = branch_weights(
            prior, [survival(toppling_rate([rock], branch), ages) for branch in branches]
        )
        inside.append(covered(at_a_level, weights, truth.rate(1.0)))
    assert 0.93 <= np.mean(inside) <= 0.97


def test_a_true_hazard_is_rejected_by_at_most_five_of_a_hundred_rocks():
    """A branch is rejected where survival is below 5 %: a rock that stands under the truth is then a rare one."""
    random = np.random.default_rng(4)
    rejected = standing = 0
    for _ in range(2000):
        rock, _, years = a_site(random)
        curve = hazard(random.uniform(0.5, 4.0))
        stands = history_spares(random, curve, rock, years)
        standing += stands
        rejected += stands and survival(toppling_rate([rock], curve), years) < 0.05
    assert standing > 200
    assert rejected / 2000 < 0.05


@pytest.mark.thorough
def test_catalogues_of_enough_events_hold_the_true_survival_in_95_of_100():
    """Some thirty events bear the rate of each catalogue."""
    random = np.random.default_rng(5)
    rock = Standing("rock", Lognormal("pgv_m_s", 1.0, 0.3))
    once = exposure(joint_ages([np.array([1000.0])]))
    span, rate = 2000.0, 0.1
    nodes = (np.arange(20_000) + 0.5) / 20_000
    true = rate * rock.fragility.probability(np.exp(0.7 * norm.ppf(nodes) - 0.8)).mean()
    inside = []
    for _ in range(SITES):
        motions = np.exp(0.7 * random.standard_normal((random.poisson(rate * span), 1)) - 0.8)
        branch = EventBranch("drawn", np.full(len(motions), 1 / span), {"pgv_m_s": motions})
        # No scale factor has so small a chance: none is searched for.
        drawn = draws_of([rock], EventSet((EventSite("here"),), (branch,), ""), once, 1e-60)
        low, high = ends(np.exp(-drawn.topplings[:, 0]))
        inside.append(low <= math.exp(-1000 * true) <= high)
    assert 0.92 <= np.mean(inside) <= 0.97


def test_a_catalogue_of_few_events_is_right_on_average():
    random = np.random.default_rng(6)
    rock = Standing("rock", Lognormal("pgv_m_s", 1.0, 0.3))
    once = exposure(joint_ages([np.array([100.0])]))
    rates = []
    for _ in range(400):
        motions = np.exp(0.7 * random.standard_normal((random.poisson(10.0), 1)) - 0.8)
        branch = EventBranch("drawn", np.full(len(motions), 1 / 100.0), {"pgv_m_s": motions})
        rates.append(
            -math.log(survivals([rock], EventSet((EventSite("here"),), (branch,), ""), once)[0]) / 100.0
        )
    nodes = (np.arange(20_000) + 0.5) / 20_000
    true = 0.1 * rock.fragility.probability(np.exp(0.7 * norm.ppf(nodes) - 0.8)).mean()
    assert np.mean(rates) == pytest.approx(true, abs=3 * np.std(rates) / 20)


def some_jobs(random, rock, records=40):
    """Jobs of one rock: the threshold of a record varies by 0.9 of beta, that of its jobs by the rest."""
    record = np.repeat(np.arange(records), 6)
    intensity = rock.median * np.exp(np.tile(np.linspace(-1.2, 1.2, 6), records))
    intensity *= np.exp(0.05 * random.standard_normal(len(record)))
    own, common = random.standard_normal(len(record)), random.standard_normal(records)[record]
    threshold = rock.beta * (math.sqrt(0.8) * common + math.sqrt(0.2) * own)
    return pd.DataFrame({
        "record_id": [f"R{number:03d}" for number in record], "pgv_m_s": intensity,
        "toppled": np.log(intensity / rock.median) > threshold,
    })  # fmt: skip


def fragility_statements(site):
    """Whether the intervals of a fragility from few records hold its median, its beta, and the rate of toppling."""
    random = np.random.default_rng([7, site])
    rock = Lognormal("pgv_m_s", random.uniform(0.5, 2.0), random.uniform(0.3, 0.6))
    jobs = some_jobs(random, rock)
    resampled = bootstrap(jobs, fit(jobs, ["pgv_m_s"]), samples=200)
    curves = resampled.lognormals("pgv_m_s")

    def rate(curve):
        return (
            0.0
            if math.isinf(curve.median)
            else curve.median**-EXPONENT * math.exp((EXPONENT * curve.beta) ** 2 / 2)
        )

    result = np.array([[curve.median, curve.beta, rate(curve)] for curve in curves])
    low, high = ends(result)
    truth = np.array([rock.median, rock.beta, rate(rock)])
    return (low <= truth) & (truth <= high)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_intervals_over_records_hold_median_beta_and_rate_in_95_of_100_sites():
    """Twice as many sites as elsewhere: beta is held in 94.2 of 100, and a share of 500 is known to 1 only."""
    fractions = np.mean([fragility_statements(site) for site in range(2 * SITES)], axis=0)
    assert ((fractions >= 0.93) & (fractions <= 0.97)).all(), fractions


def test_intervals_over_records_hold_most_of_some_sites():
    """Fewer than 9 of 12 sites have a probability below one in five hundred at 95 %."""
    fractions = np.sum([fragility_statements(site) for site in range(12)], axis=0)
    assert (fractions >= 9).all(), fractions
