"""Ages are read as they are stated."""

import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from toppling.models.errors import InputError
from toppling.results.hazard.ages import parse_age


def test_ages_are_numbers_ranges_distributions_or_files(tmp_path):
    assert parse_age("20000").tolist() == [20000.0]
    assert parse_age("20000+-3000").mean() == pytest.approx(20000, rel=1e-3)
    assert parse_age("20000+-3000").std() == pytest.approx(3000, rel=0.01)
    table = tmp_path / "age.csv"
    table.write_text("years,weight\n1000,1\n3000,3\n")
    assert parse_age(str(table)).mean() == pytest.approx(2500)
    two = tmp_path / "two.csv"
    two.write_text("years\n1000\n3000\n")
    assert parse_age(str(two)).mean() == pytest.approx(2000)
    one = tmp_path / "one.csv"
    one.write_text("\ufeffyears,weight\n1000,2\n")
    assert set(parse_age(str(one))) == {1000.0}
    for nonsense in ("old", "-5", "0..10x", "1+-", "8000+-0", "8000+--300", "15-30,000"):
        with pytest.raises(InputError, match="no age"):
            parse_age(nonsense)


@pytest.mark.parametrize(
    ("text", "meant"),
    [("20 ka", "20000"), ("12.5ka", "12500"), ("20000 years", "20000"), ("15..30 ka", "15000..30000"),
     ("20±3 ka", "20000+-3000"), ("20 ± 3 ka", "20000+-3000"), ("20000 +/- 3000 yr", "20000+-3000"),
     ("20*/1.2 ka", "20000*/1.2"), ("15.000 ka", "15000"), ("2e4", "20000")],
)  # fmt: skip
def test_ages_may_be_in_thousands_of_years(text, meant):
    assert parse_age(text) == pytest.approx(parse_age(meant))


@pytest.mark.parametrize(
    "text",
    ["15000 14C yr BP", "AD 1872", ">15 ka", "15 ka (2σ)", "15±2 ka (3σ)", "500 a - 15 ka", "15-30 ka",
     "~15 ka", "15,000", "15.000", "15.000..30.000", "1.500", "15 ka ± 2 ka", "13.2 cal ka BP", "0.1 Ma"],
)  # fmt: skip
def test_an_age_that_is_more_than_a_number_of_years_is_refused(text):
    with pytest.raises(InputError, match="no age"):
        parse_age(text)


@given(
    st.floats(0.05, 500.0), st.floats(0.002, 1.0), st.sampled_from(["{} ± {} {}", "{}+-{}{}", "{} +/- {} {}"])
)
def test_an_uncertainty_in_years_behind_an_age_in_thousands_is_refused_not_multiplied(age, share, form):
    assert parse_age(form.format(f"{age:.4f}", f"{share * age:.4f}", "ka")).mean() < 1000.0 * age * 1.5
    for text in (form.format(f"{1000 * age:.1f}", f"{share * age / 10:.5f}", "ka"),
                 form.format(f"{age:.4f}", f"{max(1000 * share, 4.0) * age:.1f}", "ka")):  # fmt: skip
        with pytest.raises(InputError, match="no age"):
            parse_age(text)


@pytest.mark.parametrize("header", ["year", "Year,weight", "year CE"])
def test_years_of_a_calendar_are_no_ages(tmp_path, header):
    (tmp_path / "ages.csv").write_text(f"{header}\n1850{',1' * ('w' in header)}\n")
    with pytest.raises(InputError, match="is no header"):
        parse_age(str(tmp_path / "ages.csv"))


def test_a_file_of_ages_may_be_in_utf_16_and_name_its_unit_as_geologists_do(tmp_path):
    (tmp_path / "ages.csv").write_bytes("Age (ka),weight\r\n15,1\r\n30,1\r\n".encode("utf-16"))
    assert parse_age(str(tmp_path / "ages.csv")).mean() == pytest.approx(22500)


def test_a_file_of_ages_that_may_be_decimals_or_thousands_is_refused(tmp_path):
    (tmp_path / "ages.csv").write_text("years\n15.000\n30.000\n")
    with pytest.raises(InputError, match="may be decimals, or thousands with a dot"):
        parse_age(str(tmp_path / "ages.csv"))
    (tmp_path / "ages.csv").write_text("years\n15000.000\n950.500\n")
    assert parse_age(str(tmp_path / "ages.csv")).max() == 15000


@pytest.mark.parametrize("text", ["1000\n3000\n", "\ufeff1000\n3000\n", "1000,1\n3000,3\n"])
def test_ages_without_a_header_are_refused_by_the_header_that_is_expected(tmp_path, text):
    table = tmp_path / "age.csv"
    table.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="the header 'years' or 'years,weight'"):
        parse_age(str(table))


@pytest.mark.parametrize("text", ["", "years\n", "years,weight\n1000,-1\n3000,3\n", "years,weight\n1000,0\n",
                                  "years,weight\n1000\n3000,3\n", "a,b,c\n1,2,3\n", "years\nold\n",
                                  f"years\n{'1' * 140_000}\n"])  # fmt: skip
def test_a_file_that_holds_no_ages_is_refused(tmp_path, text):
    table = tmp_path / "age.csv"
    table.write_text(text)
    with pytest.raises(InputError, match="expected: ages"):
        parse_age(str(table))


@pytest.mark.parametrize(
    "text",
    ["ka,weight\n1.5,1\n3,3\n", "years,probability\n1500,.1\n3000,.3\n", "ka;Weight\n1.5;25\n3;75\n",
     "Age (ka);Weight\n1,5;1\n3,0;3\n", "# of a model\nage_ka\tweight\n1.5\t1\n3\t3\n",
     "Age [yr],weight\n1500,1\n3000,3\n", 'years,weight\n"1,500",1\n"3,000",3\n',
     "years;weight\n1.500;0,25\n3.000;0,75\n"],
)  # fmt: skip
def test_draws_of_an_age_are_read_whatever_their_signs_and_the_spelling_of_their_header(text, tmp_path):
    (tmp_path / "ages.csv").write_text(text)
    assert parse_age(str(tmp_path / "ages.csv")).mean() == pytest.approx((1500 + 3 * 3000) / 4)


def test_blanks_without_end_in_an_age_or_a_column_are_looked_at_once(tmp_path):
    """By the square of their number, minutes."""
    blanks = " " * 100_000
    (tmp_path / "ages.csv").write_text(f"years,weight{blanks}x\n15000,1\n")
    start = time.process_time()
    for text in (f"20{blanks}x", f"20{blanks}ka", str(tmp_path / "ages.csv")):
        with pytest.raises(InputError):
            parse_age(text)
    assert time.process_time() - start < 5
