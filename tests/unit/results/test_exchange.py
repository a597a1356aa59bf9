"""Curves come back from every format as they went out."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from refusals import refused
from scipy.stats import lognorm

from toppling.models.errors import InputError
from toppling.models.motions.measures import OPENQUAKE
from toppling.results.analysis.exchange import moments, of_moments, read_curves, read_surface, write_curves
from toppling.results.analysis.lognormal import Basis, Lognormal, Resampled, Surface

CURVES = st.builds(
    Lognormal, st.sampled_from([*sorted(OPENQUAKE), "sa_0.2s_m_s2", "sa_3s_m_s2"]), median=st.floats(1e-3, 1e3),
    beta=st.floats(0.01, 2.0),
)  # fmt: skip

NRML = (
    '<nrml xmlns="http://openquake.org/xmlns/nrml/0.5"><fragilityModel id="f" assetCategory="a" lossCategory="b">'
    "{}</fragilityModel></nrml>"
)
FUNCTION = (
    '<fragilityFunction id="r" format="continuous" shape="logncdf"><imls imt="PGV"/>{}</fragilityFunction>'
)
PARAMS = '<params ls="toppled" mean="120" stddev="40"/>'


@pytest.mark.parametrize("suffix", [".xml", ".csv", ".json"])
@settings(max_examples=20)
@given(curve=CURVES)
def test_a_curve_survives_the_round_trip(tmp_path_factory, suffix, curve):
    path = write_curves(tmp_path_factory.mktemp("curves") / f"fragility{suffix}", [curve])
    again = read_curves(path)[curve.measure]
    # NRML goes through moments: a beta of 0.01 is a difference of 1e-4 between two squares, 1e-11 in doubles.
    assert again.median == pytest.approx(curve.median, rel=1e-12)
    assert again.beta == pytest.approx(curve.beta, rel=1e-9)


BOTH = ("pga_m_s2", "pgv_m_s")


@pytest.mark.parametrize("suffix", [".csv", ".json"])
def test_a_surface_survives_the_round_trip_with_its_samples_next_to_curves(tmp_path, suffix):
    drawn = Resampled(np.array([[-0.1, 1.5, 2.5], [-0.2, -0.3, 3.0]]), np.array([True, False, True]))
    whole = Surface(BOTH, (-0.25, 1 / 3, 2.0), Basis("5c3a", 570, 212, 30, 4, 18.5, 4320, 1602), drawn)
    path = write_curves(tmp_path / f"c{suffix}", [Lognormal("pgv_m_s", 1.2, 0.4)], surfaces=[whole])
    again = read_surface(path, BOTH)
    assert again == whole
    assert again.resampled.coefficients == pytest.approx(drawn.coefficients)
    assert again.resampled.fitted.tolist() == [True, False, True]
    assert list(read_curves(path)) == ["pgv_m_s"]


@pytest.mark.parametrize("suffix", [".xml", ".csv", ".json"])
@pytest.mark.parametrize("run", [(), (4320, 1602), (None, 570)], ids=["unknown", "unfinished", "of no plan"])
def test_what_a_curve_rests_on_goes_with_it_and_a_file_may_lack_it(tmp_path, suffix, run):
    basis = Basis("5c3a", 570, 212, 30, 4, 2.75, *run)
    known = Lognormal("pgv_m_s", 1.2, 0.4, basis, median_interval=(1.05, 1.4))
    bare = Lognormal("pga_m_s2", 3.0, 0.3)
    path = write_curves(tmp_path / f"curves{suffix}", [known, bare])
    again = read_curves(path)
    unfinished = "2,718 of 4,320 jobs have not run" if run == (4320, 1602) else ""
    assert (again["pgv_m_s"].basis.unfinished or "") == unfinished
    assert (f"UNFINISHED RUN: {unfinished}" in path.read_text()) == (suffix == ".xml" and bool(unfinished))
    assert {name: (curve.basis, curve.median_interval) for name, curve in again.items()} == {
        "pgv_m_s": (basis, (1.05, 1.4)), "pga_m_s2": (None, None),
    }  # fmt: skip


@given(curve=CURVES)
def test_moments_are_those_of_the_lognormal_variable(curve):
    mean, deviation = moments(curve)
    assert mean == pytest.approx(lognorm(curve.beta, scale=curve.median).mean())
    assert deviation == pytest.approx(lognorm(curve.beta, scale=curve.median).std())
    assert of_moments(curve.measure, mean, deviation).median == pytest.approx(curve.median)


def test_nrml_leaves_out_what_openquake_has_no_name_for_and_refuses_nothing_but(tmp_path):
    pulse = Lognormal("pgv_pga_s", 0.2, 0.3)
    write_curves(tmp_path / "two.xml", [pulse, Lognormal("pga_m_s2", 3.0, 0.3)])
    assert list(read_curves(tmp_path / "two.xml")) == ["pga_m_s2"]
    with refused("fragility.measure_not_in_format"):
        write_curves(tmp_path / "none.xml", [pulse])
    assert not (tmp_path / "none.xml").exists()


CURVE = {"measure": "pgv_m_s", "median": 1.2, "beta": 0.4}


def lacking(name):
    row = {key: value for key, value in CURVE.items() if key != name}
    return ("a.csv", f"{','.join(row)}\n{','.join(map(str, row.values()))}\n"), (
        "a.json",
        json.dumps({"curves": [row]}),
    )


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.xml", "<nrml"),
        ("a.json", "{}"),
        ("a.json", '{"curves": []}'),
        ("a.json", '{"curves": [{"measure": "pga_m_s2", "median": -1, "beta": 0.4}]}'),
        ("a.csv", "measure,median\npga_m_s2,x\n"),
        ("a.txt", ""),
        *(value for name in CURVE for value in lacking(name)),
        ("a.csv", "measure,median,beta\nPGA,0.4,0.5\n"),  # in a unit that nobody names
        (
            "a.csv",
            "rock,measure,median,beta\nweak,pgv_m_s,0.5,0.3\nstrong,pgv_m_s,3.0,0.3\n",
        ),  # none is chosen
        ("a.xml", NRML.format(FUNCTION.format(PARAMS) * 2)),
        ("a.xml", NRML.format(FUNCTION.format(PARAMS * 2))),
        ("results.parquet", ""),
        ("absent.json", None),
    ],
)
def test_a_file_without_exactly_one_curve_per_measure_is_refused_by_name(tmp_path, name, text):
    (tmp_path / "run.json").write_text("{}")
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(InputError) as error:
        read_curves(tmp_path / name)
    assert name in error.value.where


@pytest.mark.parametrize("numbers", ["1,2,", "1,2,nan", "1,two,3"])
def test_a_surface_without_three_numbers_is_refused(tmp_path, numbers):
    path = tmp_path / "c.csv"
    path.write_text(f"measure,coefficient_0,coefficient_1,coefficient_2\npga_m_s2+pgv_m_s,{numbers}\n")
    with pytest.raises(InputError):
        read_surface(path, BOTH)
