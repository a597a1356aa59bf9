"""Tables of several curves are the curves that their columns name, or are refused by what they do not say."""

import numpy as np
import pytest

from toppling.models.errors import InputError
from toppling.results.hazard.readers import Hints, read_hazard

G = 9.80665
LEVELS_G = np.array([0.1, 0.2, 0.5])
RATES = np.array([1e-2, 1e-3, 1e-4])
SITE = (-118.1, 34.2)


def written(folder, *lines):
    path = folder / "curves.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def rows(*columns):
    return [
        ",".join(f"{x:g}" if isinstance(x, float) else str(x) for x in row)
        for row in zip(*columns, strict=True)
    ]


def long(value, factor=1.0):
    """A row a level, of two sites and two measures."""
    return ["lon,lat,imt,level," + value] + [
        f"{lon},{lat},{imt},{level},{share * rate * factor}"
        for lon, lat, share in ((-118.1, 34.2, 1.0), (-117.0, 34.0, 0.5))
        for imt in ("PGA", "SA(1.0)")
        for level, rate in zip(LEVELS_G, RATES, strict=True)
    ]


@pytest.mark.parametrize(
    ("lines", "hints"),
    [
        (long("annual_rate"), Hints(SITE)),
        (long("rate_per_kyr", 1000.0), Hints(SITE)),
        (
            ["# annual rate of exceedance", "lat,lon,vs30,imt,agg,0.1,0.2,0.5",
             "34.2,-118.1,760,PGA,mean,1e-2,1e-3,1e-4", "34.2,-118.1,760,SA(1.0),mean,1e-2,1e-3,1e-4",
             "34,-117,760,PGA,mean,1,1,1"],
            Hints(SITE),
        ),
        (["level (g),PGA,SA(1.0)", "# levels", *(f"{row} # g" for row in rows(LEVELS_G, RATES, RATES))],
         Hints(years=0.0)),
        (["imt,agg,0.1,0.2,0.5", "PGA,mean,1e-2,1e-3,1e-4", "SA(1.0),mean,1e-2,1e-3,1e-4"], Hints(years=0.0)),
        (["level (g),PGA,SA(1.0)", *rows(LEVELS_G, RATES, RATES)], Hints(years=0.0)),
        (["Ground Motion (g),PGA (AFE),SA1P0 (AFE)", *rows(LEVELS_G, RATES, RATES)], Hints()),
        (["Hazard Curves", "Longitude,-118.1", "", "Ground Motion (g),0.1,0.2,0.5",
          "Peak Ground Acceleration (AFE),1e-2,1e-3,1e-4", "1.0 Second Spectral Acceleration (AFE),1e-2,1e-3,1e-4"],
         Hints()),
        (["IML (cm/s2),PGA (AFE),SA(1.0) (AFE)", *rows(LEVELS_G * G * 100, RATES, RATES)], Hints()),
    ],
)  # fmt: skip
def test_measures_and_sites_of_one_table_are_curves_of_their_own(tmp_path, lines, hints):
    trees = read_hazard(written(tmp_path, *lines), hints=hints)
    assert [tree.measure for tree in trees] == ["pga_m_s2", "sa_1s_m_s2"]
    for tree in trees:
        (curve,) = tree.curves
        assert curve.intensity == pytest.approx(LEVELS_G * G, rel=1e-5)
        assert curve.annual_rate == pytest.approx(RATES)


@pytest.mark.parametrize(
    "lines",
    [
        ["# annual rate of exceedance", "PGA (g),Mean,5%,95th", *rows(LEVELS_G, RATES, RATES / 2, RATES * 2)],
        ["# annual rate of exceedance", "PGA (g),mean,p05,p95", *rows(LEVELS_G, RATES, RATES / 2, RATES * 2)],
        ["imt,agg,level,annual_rate", *(f"PGA,{kind},{x},{share * y}" for x, y in zip(LEVELS_G, RATES, strict=True)
                                        for kind, share in (("mean", 1), ("0.05", 0.5), ("0.95", 2)))],
    ],
)  # fmt: skip
def test_fractiles_beside_a_mean_are_its_fractiles(tmp_path, lines):
    (tree,) = read_hazard(written(tmp_path, *lines))
    assert tree.curves[0].annual_rate == pytest.approx(RATES)
    assert tree.fractiles[0.05].annual_rate == pytest.approx(RATES / 2)
    assert tree.fractiles[0.95].annual_rate == pytest.approx(RATES * 2)


def test_probabilities_across_columns_are_over_the_years_that_the_title_says(tmp_path):
    path = written(tmp_path, "PoE in 50 years", "lon,lat,imt,0.1,0.2", "-118.1,34.2,PGA,0.1,0.01")
    (tree,) = read_hazard(path)
    assert tree.curves[0].annual_rate == pytest.approx(-np.log([0.9, 0.99]) / 50)


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (["level (g),PGA,SA(1.0)", *rows(LEVELS_G, RATES, RATES)], "does not say whether"),
        (["imt,level,annual_rate", *(f"MMI,{x},1e-3" for x in LEVELS_G)], "over 'MMI'"),
        (
            ["imt,level,annual_rate", *(f"PGA,{x},{y}" for x, y in zip(LEVELS_G * 980, RATES, strict=True))],
            "reach 490",
        ),
        (["imt,level,annual_rate", *(f"PGA,{x},1e-3" for x in (0.1, 0.1))], "twice"),
        (["level,annual_rate", *rows(LEVELS_G, RATES)], "over 'level'"),
    ],
)
def test_what_a_table_of_curves_does_not_say_is_asked_for(tmp_path, lines, said):
    with pytest.raises(InputError, match=said):
        read_hazard(written(tmp_path, *lines))


def test_levels_without_a_measure_are_of_the_one_that_the_user_names(tmp_path):
    path = written(tmp_path, "Acceleration (g),annual_rate", *rows(LEVELS_G, RATES))
    (tree,) = read_hazard(path, hints=Hints(measure="sa_1s_m_s2"))
    assert (tree.measure, tree.curves[0].intensity[0]) == ("sa_1s_m_s2", pytest.approx(0.1 * G))


@pytest.mark.parametrize(
    "above",
    [
        ("Total hazard", "Site: Rock", "Spectral Period: PGA"),
        ("Hazard curve at lat 34, lon -118, PGA",),
        ("# of the site; imt=PGA; unit=g",),
        ("Table S2. Mean hazard, peak ground acceleration (5% damped)",),
    ],
)
@pytest.mark.parametrize(
    "name", ["Amplitude (g)", "Ground motion level (g)", "IML [g]", "Intensity Measure Level (g)"]
)
def test_levels_without_a_measure_are_of_the_one_that_the_text_above_names(tmp_path, above, name):
    path = written(tmp_path, *above, f"{name},Annual Frequency of Exceedance", *rows(LEVELS_G, RATES))
    (tree,) = read_hazard(path)
    assert tree.measure == "pga_m_s2"
    assert tree.curves[0].intensity == pytest.approx(LEVELS_G * G)


def test_of_two_measures_in_the_text_above_none_is_taken(tmp_path):
    path = written(tmp_path, "PGA and PGV at the rock", "Amplitude,annual rate", *rows(LEVELS_G, RATES))
    with pytest.raises(InputError, match="over 'Amplitude'"):
        read_hazard(path)


def test_levels_in_a_unit_of_something_else_than_their_measure_are_refused(tmp_path):
    path = written(
        tmp_path,
        "imt,level (cm/s),annual_rate",
        *(f"PGA,{x},{y}" for x, y in zip((10, 20), RATES, strict=False)),
    )
    with pytest.raises(InputError, match="states levels of pga_m_s2 in 'cm/s'"):
        read_hazard(path)


def test_a_header_may_stand_in_a_remark_below_a_title(tmp_path):
    path = written(tmp_path, "Hazard at the rock, PGA", "#amplitude (g),annual rate", *rows(LEVELS_G, RATES))
    (tree,) = read_hazard(path)
    assert tree.curves[0].annual_rate == pytest.approx(RATES)


def test_rates_of_a_header_are_no_probabilities_whatever_the_user_says(tmp_path):
    table = written(tmp_path, "level (g),PGA (AFE),SA1P0 (AFE)", *rows(LEVELS_G, RATES, RATES))
    with pytest.raises(
        InputError, match="states annual rates, and --values says probabilities over 50 years"
    ):
        read_hazard(table, hints=Hints(years=50.0))


def test_a_damaged_last_row_is_no_text_below_the_table(tmp_path):
    path = written(tmp_path, "PGA (g),annual_rate", *rows(LEVELS_G, RATES), "O.9,0.00001,")
    with pytest.raises(InputError, match="has 3 columns, the header 2"):
        read_hazard(path)


def test_a_latitude_beyond_the_pole_is_a_longitude(tmp_path):
    swapped = [line.replace("lon,lat", "lat,lon") for line in long("annual_rate")]
    with pytest.raises(InputError, match=r"the latitude is -118\.1"):
        read_hazard(written(tmp_path, *swapped))


def test_a_probability_of_exceedance_that_bears_its_years_is_over_these(tmp_path):
    (tmp_path / "curve.csv").write_text("PGA (g),PE50\n0.1,0.3\n0.2,0.1\n0.4,0.02\n")
    [tree] = read_hazard(tmp_path / "curve.csv")
    assert tree.years == 50.0


@pytest.mark.parametrize(
    "table",
    [
        "PGA (g),level\n0.62,DD-1\n0.34,DD-2\n0.12,DD-3\n",
        "imt,DD-1,DD-2,DD-3,DD-4\nPGA (g),0.62,0.34,0.12,0.08\n",
    ],
)
def test_levels_of_the_turkish_code_are_refused_with_their_return_periods(tmp_path, table):
    (tmp_path / "levels.csv").write_text(table)
    with pytest.raises(
        InputError, match="return_period 2475 for DD-1, 475 for DD-2, 72 for DD-3, 43 for DD-4"
    ):
        read_hazard(tmp_path / "levels.csv")


def test_the_return_periods_of_the_turkish_code_are_read(tmp_path):
    (tmp_path / "levels.csv").write_text("PGA (g),return_period\n0.08,43\n0.12,72\n0.34,475\n0.62,2475\n")
    [tree] = read_hazard(tmp_path / "levels.csv")
    assert tree.curves[0].annual_rate == pytest.approx([1 / 43, 1 / 72, 1 / 475, 1 / 2475])


def test_yaml_is_refused_by_its_name(tmp_path):
    (tmp_path / "curve.yaml").write_text("measure: PGA\nunit: g\nlevels: [0.1, 0.2]\nrates: [0.01, 0.001]\n")
    with pytest.raises(InputError, match="is YAML"):
        read_hazard(tmp_path / "curve.yaml")
