"""Ages of rocks: read as they are stated, several rocks together, and fragility that came late."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from refusals import refused

from toppling.models.errors import InputError
from toppling.results.hazard.ages import LESS_FRAGILE, Since, exposure, joint_ages, parse_age, parse_since

RATE = 1e-4


@pytest.mark.parametrize(
    ("text", "meant"),
    [("20 ka", "20000"), ("12.5ka", "12500"), ("20000 years", "20000"), ("15..30 ka", "15000..30000"),
     ("20±3 ka", "20000+-3000"), ("20 ± 3 ka", "20000+-3000"), ("20000 +/- 3000 yr", "20000+-3000"),
     ("20*/1.2 ka", "20000*/1.2"), ("15.000 ka", "15000"), ("2e4", "20000")],
)  # fmt: skip
def test_ages_may_be_in_thousands_of_years(text, meant):
    assert parse_age(text) == pytest.approx(parse_age(meant))


def test_distributions_have_their_moments():
    assert parse_age("20000").tolist() == [20000.0]
    normal, lognormal, cut = map(parse_age, ("20000+-3000", "20000*/1.2", "1000+-2000"))
    assert (normal.mean(), normal.std()) == (pytest.approx(20000, rel=1e-3), pytest.approx(3000, rel=0.01))
    assert np.median(lognormal) == pytest.approx(20000, rel=1e-3)
    assert np.log(lognormal).std() == pytest.approx(math.log(1.2), rel=0.01)
    # Mean of a normal variable cut at zero: mu + sigma phi(a) / (1 - Phi(a)), a = -mu / sigma.
    assert (cut > 0).all()
    assert cut.mean() == pytest.approx(1000 + 2000 * 0.5092, rel=5e-3)


@pytest.mark.parametrize(
    "text",
    ["old", "-5", "0..10x", "1+-", "8000+-0", "8000+--300", "15-30,000", "15000 14C yr BP", "AD 1872", ">15 ka",
     "15 ka (2σ)", "15±2 ka (3σ)", "500 a - 15 ka", "15-30 ka", "~15 ka", "15,000", "15.000", "15.000..30.000", "1.500",
     "15 ka ± 2 ka", "13.2 cal ka BP", "0.1 Ma", "20000*/0.9", "30000..15000", "nan", "inf", "1..inf", "20000+-nan",
     "8000:1.5", "4.6e9", "1e12", "4.5e9+-1e9"],
)  # fmt: skip
def test_an_age_that_is_no_number_of_years_is_refused(text):
    with refused("age.unreadable"):
        parse_age(text)


@given(
    st.floats(0.05, 500.0), st.floats(0.002, 1.0), st.sampled_from(["{} ± {} {}", "{}+-{}{}", "{} +/- {} {}"])
)
def test_an_uncertainty_in_years_behind_an_age_in_thousands_is_refused_not_multiplied(age, share, form):
    assert parse_age(form.format(f"{age:.4f}", f"{share * age:.4f}", "ka")).mean() < 1000.0 * age * 1.5
    for text in (form.format(f"{1000 * age:.1f}", f"{share * age / 10:.5f}", "ka"),
                 form.format(f"{age:.4f}", f"{max(1000 * share, 4.0) * age:.1f}", "ka")):  # fmt: skip
        with refused("age.unreadable"):
            parse_age(text)


@pytest.mark.parametrize(
    "content",
    [*(text.encode() for text in (
        "years,weight\n1500,1\n3000,3\n", "\ufeffyears,weight\n1500,1\n3000,3\n", "years\n1500\n3000\n3000\n3000\n",
        "ka,weight\n1.5,1\n3,3\n", "years,probability\n1500,.1\n3000,.3\n",
        "Age (ka);Weight\n1,5;1\n3,0;3\n", "# of a model\nage_ka\tweight\n1.5\t1\n3\t3\n",
        "Age [yr],weight\n1500,1\n3000,3\n", 'years,weight\n"1,500",1\n"3,000",3\n',
        "years;weight\n1.500;0,25\n3.000;0,75\n",
    )), "Age (ka),weight\r\n1.5,1\r\n3,3\r\n".encode("utf-16")],
)  # fmt: skip
def test_draws_of_an_age_are_read_whatever_their_signs_and_the_spelling_of_their_header(content, tmp_path):
    (tmp_path / "ages.csv").write_bytes(content)
    assert parse_age(str(tmp_path / "ages.csv")).mean() == pytest.approx((1500 + 3 * 3000) / 4)


@pytest.mark.parametrize(
    "text",
    ["", "years\n", "years,weight\n1000,-1\n3000,3\n", "years,weight\n1000,0\n", "years,weight\n1000\n3000,3\n",
     "a,b,c\n1,2,3\n", "years\nold\n", f"years\n{'1' * 140_000}\n", "1000\n3000\n", "\ufeff1000\n3000\n",
     "1000,1\n3000,3\n", "year\n1850\n", "Year,weight\n1850,1\n", "year CE\n1850\n", "years\n15.000\n30.000\n",
     "age\n1000\n", "cm\n1000\n", "depth,weight\n1000,1000\n", "years,sigma\n1000,1000\n"],
)  # fmt: skip
def test_a_file_that_states_no_ages_in_a_unit_is_refused(tmp_path, text):
    """Years of a calendar are none, nor numbers that may be decimals or thousands with a dot."""
    (tmp_path / "ages.csv").write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as error:
        parse_age(str(tmp_path / "ages.csv"))
    assert error.value.code.startswith(("age.", "table."))
    assert error.value.where.startswith(str(tmp_path / "ages.csv"))


def test_survival_over_a_normal_age_is_its_moment_generating_function():
    result = exposure(joint_ages([parse_age("20000+-3000")])).survival([RATE])
    assert result == pytest.approx(math.exp(-20000 * RATE + (3000 * RATE) ** 2 / 2), rel=5e-4)


def test_rocks_of_a_common_date_stand_equally_long_in_every_draw_and_need_a_single_age():
    together = joint_ages([parse_age("15000..30000")] * 3, common_date=True)
    assert (together == together[:, :1]).all()
    with refused("age.dates_contradicted"):
        joint_ages([parse_age("1000"), parse_age("2000")], common_date=True)


def test_a_common_relative_error_correlates_ages_by_its_fraction_of_their_variance():
    ages = joint_ages([parse_age("20000+-2000"), parse_age("20000+-2000")], common_error=0.1)
    # Each varies by 0.1 of its own and by 0.1 in common.
    assert np.corrcoef(ages.T)[0, 1] == pytest.approx(0.5, abs=0.08)
    assert ages.mean(axis=0) == pytest.approx([20000, 20000], rel=1e-3)


@pytest.mark.parametrize(
    ("age", "since", "at_risk"),
    [
        ("20000", "8000", 8000),  # it was buried before
        ("20000", "8000:1.5", 8000 + 12000 / 10),  # it was less fragile before, and toppled a tenth as often
        ("5000", "8000", 5000),  # of a date before the rock stood nothing follows
    ],
)
def test_a_rock_counts_with_its_own_rate_before_and_after_it_became_fragile(age, since, at_risk):
    late = exposure(joint_ages([parse_age(age)]), [parse_since(since)])
    rates = np.where(late.states[:, 0] == LESS_FRAGILE, RATE / 10, RATE)
    assert late.survival(rates) == pytest.approx(math.exp(-at_risk * RATE))


@pytest.mark.parametrize("text", ["8000:0.5", "8000:1", "8000:x", ":2"])
def test_an_erosion_factor_is_above_unity_and_dated(text):
    with pytest.raises(InputError) as error:
        parse_since(text)
    assert error.value.code in ("age.factor_unusable", "age.unreadable")


@settings(max_examples=30)
@given(
    st.lists(st.tuples(st.floats(1, 1e5), st.one_of(st.none(), st.floats(1, 1e5))), min_size=1, max_size=4)
)
def test_every_rock_stands_as_it_is_for_the_lesser_of_its_age_and_its_date_of_fragility(rocks):
    ages = np.array([[age for age, _ in rocks]])
    since = [None if date is None else Since(np.array([date])) for _, date in rocks]
    result = exposure(ages, since)
    lasting = (result.states > 0).T.astype(float) @ result.years[:, 0]
    expected = [age if date is None else min(age, date) for age, date in rocks]
    assert lasting == pytest.approx(expected, rel=1e-9)
