"""One hazard curve as other programs and people save it: it is read as the same curve, or what is assumed is told."""

import math
import re

import numpy as np
import pytest
from refusals import refused

from toppling.models.motions.measures import STANDARD_G_M_S2
from toppling.results.hazard.readers import Hints, read_hazard

LEVELS_G = [0.05, 0.1, 0.2, 0.5, 1.0, 2.0]
RATES = [1e-2, 4e-3, 1e-3, 1e-4, 1e-5, 1e-6]
POES = [-math.expm1(-50.0 * rate) for rate in RATES]
STATED = "generated_by='OpenQuake engine 3.26.2', kind='mean', investigation_time=50.0, imt='PGA'"


def table(header: str, x: list[float], y: list[float], row: str = "{:.8g},{:.8g}") -> str:
    return "\n".join([header, *(row.format(*point) for point in zip(x, y, strict=True))])


def openquake(comment: str, sign: str = ",", comma: bool = False) -> str:
    levels = sign.join(f"poe-{level:.7f}" for level in LEVELS_G)
    values = sign.join(f"{poe:.6E}" for poe in POES)
    site = sign.join(("-118.1", "34.2", "0"))
    body = f"{site}{sign}{values}"
    body = body.replace(".", ",") if comma else body
    return f"{comment}\nlon{sign}lat{sign}depth{sign}{levels}\n{body}\n"


OPENSHA = (
    "Name: curve 1\nNum Points: 6\nInfo: IMR Param List: \nIMR = Boore\nSite Param List: \nLongitude = -118.1; "
    "Latitude = 34.2\nIMT Param List: \nIMT = PGA\nTimeSpan Param List: \nDuration = 50.0\n\nX, Y Data:"
)
SAME = {
    "semicolons and decimal commas": openquake("#" + 8 * ";" + f'"{STATED}"', ";", comma=True),
    "first line quoted": openquake('"#' + 8 * "," + STATED + '"'),
    "tabs": openquake("#" + 8 * "\t" + f'"{STATED}"', "\t"),
    "thousands": table("PGA (g),return_period", LEVELS_G, [1 / r for r in RATES], '{:.6g},"{:,.0f}"'),
    "thousands and tabs": table(
        "PGA (cm/s2)\treturn_period",
        [100 * STANDARD_G_M_S2 * level for level in LEVELS_G],
        [1 / r for r in RATES],
        "{:.5f}\t{:,.0f}",
    ),
    "never exceeded": table("PGA (g),return_period", [*LEVELS_G, 3], [*(1 / r for r in RATES), math.inf]),
    "OpenSHA": table(OPENSHA, LEVELS_G, POES, "{:g}\t{:.8E}"),
    "OpenSHA's labels": table(
        "Num Points: 6\nX-Axis Label: PGA (g)\nY-Axis Label: Probability of Exceedance in 50 years",
        LEVELS_G,
        POES,
        "{:g} {:.8E}",
    ),
    "OpenSHA as rates": table(OPENSHA + " Annualized Rates", LEVELS_G, RATES, "{:g} {:.8E}"),
}


@pytest.mark.parametrize("way", SAME)
def test_a_curve_is_the_same_however_it_was_saved(way, tmp_path):
    path = tmp_path / "curve.txt"
    path.write_text(SAME[way], encoding="utf-8")
    (tree,) = read_hazard(path)
    (curve,) = tree.curves
    assert curve.measure == "pga_m_s2"
    np.testing.assert_allclose(curve.intensity, np.multiply(LEVELS_G, STANDARD_G_M_S2), rtol=1e-4)
    np.testing.assert_allclose(curve.annual_rate, RATES, rtol=1e-4)
    if "-118" in SAME[way].replace(",", "."):
        assert curve.site == (-118.1, 34.2)


def test_opensha_without_the_name_of_its_measure_is_refused_until_told(tmp_path):
    path = tmp_path / "curve.txt"
    path.write_text(table("Num Points: 6\nInfo: Duration = 50.0", LEVELS_G, POES, "{:g}\t{:.8E}"))
    with refused("hazard.measure_missing"):
        read_hazard(path)
    (tree,) = read_hazard(path, None, Hints(measure="pga_m_s2"))
    np.testing.assert_allclose(tree.curves[0].annual_rate, RATES, rtol=1e-4)


def test_a_lost_first_line_leaves_the_measure_of_the_name(tmp_path):
    path = tmp_path / "hazard_curve-mean-PGA_6.csv"
    path.write_text(openquake("").lstrip())
    with refused("hazard.time_missing", "50"):
        read_hazard(path)
    (tree,) = read_hazard(path, None, Hints(years=50.0))
    np.testing.assert_allclose(tree.curves[0].annual_rate, RATES, rtol=1e-4)


@pytest.mark.parametrize("name", ["SA 5 Hz (g)", "5 Hz SA (g)", "PSA(5Hz) [g]", "T=0.2s Sa (g)", "SA(0.2)"])
def test_a_frequency_is_one_over_the_period(name, tmp_path):
    path = tmp_path / "curve.csv"
    path.write_text(table(f"{name},annual_rate", LEVELS_G, RATES))
    assert read_hazard(path)[0].measure == "sa_0.2s_m_s2"


def test_a_unit_that_only_the_name_implies_is_told_with_the_level_of_475_years(tmp_path):
    path = tmp_path / "curve.csv"
    path.write_text(table("PGA,annual_rate", [2.0 * level for level in LEVELS_G], RATES))
    told = read_hazard(path)[0].curves[0].assumed
    once_g = float(re.search(r"g: ([\d.]+) g once in 475 years", told)[1])
    assert once_g == pytest.approx(
        np.exp(np.interp(np.log(475), -np.log(RATES), np.log(LEVELS_G))) * 2, rel=0.01
    )
    path.write_text(table("PGA (g),annual_rate", LEVELS_G, RATES))
    assert not read_hazard(path)[0].curves[0].assumed


def test_no_ground_shakes_with_2_g_once_in_475_years(tmp_path):
    path = tmp_path / "curve.csv"
    path.write_text(table("PGA,annual_rate", [9.8 * x for x in LEVELS_G[:5]], [10 * r for r in RATES[:5]]))
    with refused("hazard.unit_missing", "475"):
        read_hazard(path)
