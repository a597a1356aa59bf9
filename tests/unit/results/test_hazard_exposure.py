"""Ages of rocks: distributions, several rocks together, and fragility that came late."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from toppling.models.errors import InputError
from toppling.results.hazard.ages import STOUTER, Since, exposure, joint_ages, parse_age, parse_since

RATE = 1e-4


def test_a_lognormal_age_has_its_median_and_its_factor():
    years = parse_age("20000*/1.2")
    assert np.median(years) == pytest.approx(20000, rel=1e-3)
    assert np.log(years).std() == pytest.approx(math.log(1.2), rel=0.01)


def test_a_normal_age_that_reaches_zero_is_cut_there():
    years = parse_age("1000+-2000")
    # Mean of a normal variable cut at zero: mu + sigma phi(a) / (1 - Phi(a)), a = -mu / sigma.
    assert (years > 0).all()
    assert years.mean() == pytest.approx(1000 + 2000 * 0.5092, rel=5e-3)


def test_a_file_of_thousands_of_years_is_read_by_its_header(tmp_path):
    table = tmp_path / "age.csv"
    table.write_text("ka\n15\n25\n")
    assert set(parse_age(str(table))) == {15000.0, 25000.0}


@pytest.mark.parametrize("header", ["age", "cm", "depth,weight", "years,sigma"])
def test_a_file_whose_header_states_no_unit_of_age_is_refused(tmp_path, header):
    table = tmp_path / "age.csv"
    table.write_text(f"{header}\n" + ",".join(["1000"] * (1 + header.count(","))) + "\n")
    with pytest.raises(InputError, match="expected: ages"):
        parse_age(str(table))


@pytest.mark.parametrize(
    "text", ["20000*/0.9", "30000..15000", "nan", "inf", "1..inf", "20000+-nan", "8000:1.5"]
)
def test_words_that_are_no_age_are_refused(text):
    with pytest.raises(InputError, match="no age"):
        parse_age(text)


def test_survival_over_a_normal_age_is_its_moment_generating_function():
    told = exposure(joint_ages([parse_age("20000+-3000")])).survival([RATE])
    assert told == pytest.approx(math.exp(-20000 * RATE + (3000 * RATE) ** 2 / 2), rel=5e-4)


def test_rocks_of_one_date_stand_equally_long_in_every_draw():
    together = joint_ages([parse_age("15000..30000")] * 3, common_date=True)
    assert (together == together[:, :1]).all()


def test_one_common_date_rejects_less_than_independent_ones():
    """As the module's page says: independent dates of rocks that fell silent together overstate what they know."""
    ages = [parse_age("5000..35000")] * 2
    states = exposure(joint_ages(ages)).states
    # Two rocks that topple in different events: rates add.
    rates = RATE * np.sign(states).sum(axis=1)
    independent = exposure(joint_ages(ages)).survival(rates)
    common = exposure(joint_ages(ages, common_date=True)).survival([2 * RATE])
    assert independent < common


def test_rocks_of_one_date_need_one_age():
    with pytest.raises(InputError, match="different ages"):
        joint_ages([parse_age("1000"), parse_age("2000")], common_date=True)


def test_a_common_relative_error_correlates_ages_as_its_share_of_their_variance():
    ages = joint_ages([parse_age("20000+-2000"), parse_age("20000+-2000")], common_error=0.1)
    # Each varies by 0.1 of its own and by 0.1 in common.
    assert np.corrcoef(ages.T)[0, 1] == pytest.approx(0.5, abs=0.08)
    assert ages.mean(axis=0) == pytest.approx([20000, 20000], rel=1e-3)


def test_a_rock_that_was_buried_counts_from_when_it_was_bared():
    late = exposure(joint_ages([parse_age("20000")]), [parse_since("8000")])
    assert late.survival([RATE]) == pytest.approx(math.exp(-8000 * RATE))


def test_a_rock_that_was_stouter_counts_with_its_own_rate_before():
    late = exposure(joint_ages([parse_age("20000")]), [parse_since("8000:1.5")])
    rates = np.where(late.states[:, 0] == STOUTER, RATE / 10, RATE)
    assert late.survival(rates) == pytest.approx(math.exp(-8000 * RATE - 12000 * RATE / 10))


def test_a_date_of_fragility_before_the_rock_stood_changes_nothing():
    early = exposure(joint_ages([parse_age("5000")]), [parse_since("8000")])
    assert early.survival([RATE]) == pytest.approx(math.exp(-5000 * RATE))


@pytest.mark.parametrize("text", ["8000:0.5", "8000:1", "8000:x", ":2"])
def test_a_stouter_rock_has_a_factor_above_one_and_a_date(text):
    with pytest.raises(InputError, match="fragile-since"):
        parse_since(text)


@settings(max_examples=30)
@given(
    st.lists(st.tuples(st.floats(1, 1e5), st.one_of(st.none(), st.floats(1, 1e5))), min_size=1, max_size=4)
)
def test_every_rock_stands_as_it_is_for_the_lesser_of_its_age_and_its_date_of_fragility(rocks):
    ages = np.array([[age for age, _ in rocks]])
    since = [None if date is None else Since(np.array([date])) for _, date in rocks]
    told = exposure(ages, since)
    lasting = (told.states > 0).T.astype(float) @ told.years[:, 0]
    expected = [age if date is None else min(age, date) for age, date in rocks]
    assert lasting == pytest.approx(expected, rel=1e-9)
