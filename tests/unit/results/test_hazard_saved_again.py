"""One hazard curve as other programs and people save it: it is read as the same curve, or what is assumed is told."""

import json
import math
import re

import numpy as np
import pytest

from toppling.models.errors import InputError
from toppling.models.motions.measures import STANDARD_G_M_S2
from toppling.results.hazard.readers import Hints, read_hazard

LEVELS_G = [0.05, 0.1, 0.2, 0.5, 1.0, 2.0]
RATES = [1e-2, 4e-3, 1e-3, 1e-4, 1e-5, 1e-6]
POES = [-math.expm1(-50.0 * rate) for rate in RATES]
STATED = "generated_by='OpenQuake engine 3.26.2', kind='mean', investigation_time=50.0, imt='PGA'"


def comma(value: float) -> str:
    return f"{value:.6g}".replace(".", ",")


def table(header: str, x: list[float], y: list[float], row: str = "{:.8g},{:.8g}") -> str:
    return "\n".join([header, *(row.format(*point) for point in zip(x, y, strict=True))])


def openquake(comment: str, sign: str = ",", comma: bool = False) -> str:
    levels = sign.join(f"poe-{level:.7f}" for level in LEVELS_G)
    values = sign.join(f"{poe:.6E}" for poe in POES)
    site = sign.join(("-118.1", "34.2", "0"))
    body = f"{site}{sign}{values}"
    body = body.replace(".", ",") if comma else body
    return f"{comment}\nlon{sign}lat{sign}depth{sign}{levels}\n{body}\n"


def points_json(**around: object) -> str:
    return json.dumps({"imt": "PGA", "unit": "g", **around})


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
    "natural logarithms": table("ln PGA (g),annual_rate", [math.log(x) for x in LEVELS_G], RATES),
    "decimal logarithms": table(
        "log10(PGA) [g],log10(annual_rate)",
        [math.log10(x) for x in LEVELS_G],
        [math.log10(x) for x in RATES],
    ),
    "a mean beside fractiles": table("PGA (g),AFE mean,AFE 16th", LEVELS_G, RATES, "{:g},{:g},0"),
    "lists": points_json(iml=LEVELS_G, annual_rate=RATES),
    "lists of return periods": points_json(imls=LEVELS_G, return_period=[-50 / math.log1p(-poe) for poe in POES]),
    "a year before the word": table("PGA (g),50-yr PoE", LEVELS_G, POES),
    "a remark with equals": "# imt=PGA; unit=g; investigationtime=50\n"
    + table("iml;poe", LEVELS_G, POES, "{:g};{:.8g}"),
    "lists of probabilities": points_json(investigation_time=50, imls=LEVELS_G, poes=POES),
    "records": json.dumps(
        [{"imt": "PGA", "level": x, "annual_rate": y} for x, y in zip(LEVELS_G, RATES, strict=True)]
    ),
    "GeoJSON": json.dumps(
        {
            "type": "FeatureCollection",
            "features": [
                {
                    "type": "Feature",
                    "geometry": {"type": "Point", "coordinates": [-118.1, 34.2, 0]},
                    "properties": {"imt": "PGA", "levels": LEVELS_G, "annual_rate": RATES},
                }
            ],
        }
    ),
    "OpenSHA": table(OPENSHA, LEVELS_G, POES, "{:g}\t{:.8E}"),
    "Markdown": table("Text.\n\n| PGA (g) | annual_rate |\n|---|---:|", LEVELS_G, RATES, "| {:.6g} | {:.6g} |"),
    "a terminal's table": table(" pga_g | afoe\n-------+-----", LEVELS_G, RATES, " {:.6g} | {:.6g} ") + "\n(6 rows)",
    "HTML": table("<h1>Hazard</h1><table><tr><th>PGA&nbsp;(cm/s<sup>2</sup>)</th><th>annual rate</th></tr>",
                  [100 * STANDARD_G_M_S2 * level for level in LEVELS_G], [1e6 * rate for rate in RATES],
                  "<tr><td>{:g}</td>\n<td>{:g}&times;10<sup>&minus;6</sup></td></tr>") + "</table>",
    "LaTeX": table("\\begin{tabular}{@{}lr@{}}\n\\toprule\nPGA ($g$) & \\textbf{annual rate}\\\\\\midrule",
                   LEVELS_G, [1e6 * rate for rate in RATES],
                   "{:g} & ${:g} \\times 10^{{-6}}$ \\\\") + "\n\\hline\n\\end{tabular}\n",
    "powers of ten alone": table("PGA (g);annual rate\n0.05;10⁻²\n0.1;0.4·10^-2\n0.2;10^-3", LEVELS_G[3:], RATES[3:],
                                 "{:g};{:g}"),
    "reStructuredText": table("======= =====\nPGA (g) AFoE\n======= =====", LEVELS_G, RATES, "{:<7g} {:g}")
    + "\n======= =====\n",
    "apostrophes": table("PGA (g);return period", LEVELS_G, [1 / r for r in RATES], "{:g};{:,.0f}").replace(",", "'"),
    "blanks in thousands": table("PGA (g);RP (yr)", LEVELS_G, [1 / r for r in RATES], "{:g};{:,.0f}").replace(",", " "),
    "one over": table("PGA (g),annual_rate", LEVELS_G, [1 / r for r in RATES], "{:g},1/{:g}"),
    "one in": table("PGA (g),return period", LEVELS_G, [1 / r for r in RATES], "{:g},1 in {:g} years"),
    "a bound above": table("PGA (g),return_period", LEVELS_G, [1 / r for r in RATES]) + "\n3,>1000000",
    "a bound below": table("PGA (g),annual_rate\n0.01,>0.05", LEVELS_G, RATES) + "\n3,<1e-6\n4,NaN\n5,",
    "as pandas writes JSON": json.dumps({name: {str(n): value for n, value in enumerate(values)}
                                         for name, values in (("PGA (g)", LEVELS_G), ("annual_rate", RATES))}),
    "a JSON a line": "\n".join(json.dumps({"PGA (g)": x, "annual_rate": y})
                               for x, y in zip(LEVELS_G, RATES, strict=True)),
    "units in cells": table("PGA,annual rate", [100 * level for level in LEVELS_G], RATES, "{:g} %g,{:g} /yr"),
    "per cent in cells": table("PGA (g),poe_50", LEVELS_G, [100 * poe for poe in POES], "{:g},{:.8g} %"),
    "per cent first": table("% in 50 years,PGA (g)", [100 * poe for poe in POES], LEVELS_G),
    "a slash for in": table("PGA (g),%/50 yr", LEVELS_G, [100 * poe for poe in POES]),
    "never exceeded": table("PGA (g),return_period", [*LEVELS_G, 3], [*(1 / r for r in RATES), math.inf]),
    "powers of ten": table("PGA (g);rate (a⁻¹)", LEVELS_G, [1e6 * rate for rate in RATES], "{:g};{:g}×10⁻⁶"),
    "lambda": table("PGA (g),λ(a)", LEVELS_G, RATES),
    "as an Italian code": table("TR [anni];ag [g]", [1 / r for r in RATES], LEVELS_G, "{:g};{:g}"),
    "a rate and its return period": "PGA (m/s2),PGA (g),rate p.a.,ARI (yr)\n"
    + "\n".join(f"{9.80665 * x:.7g},{x},{y},{1 / y:.3g}" for x, y in zip(LEVELS_G, RATES, strict=True)),
    "OpenSHA's labels": table(
        "Num Points: 6\nX-Axis Label: PGA (g)\nY-Axis Label: Probability of Exceedance in 50 years",
        LEVELS_G,
        POES,
        "{:g} {:.8E}",
    ),
    "OpenSHA as rates": table(OPENSHA + " Annualized Rates", LEVELS_G, RATES, "{:g} {:.8E}"),
}  # fmt: skip


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


def test_columns_that_contradict_each_other_are_refused(tmp_path):
    path = tmp_path / "curve.csv"
    rows = [f"{x},{y},{0.5 / y:.3g}" for x, y in zip(LEVELS_G, RATES, strict=True)]
    path.write_text("\n".join(["PGA (g),annual rate,return period (yr)", *rows]))
    with pytest.raises(InputError, match="several that say the same"):
        read_hazard(path)


def test_opensha_without_the_name_of_its_measure_is_refused_until_told(tmp_path):
    path = tmp_path / "curve.txt"
    path.write_text(table("Num Points: 6\nInfo: Duration = 50.0", LEVELS_G, POES, "{:g}\t{:.8E}"))
    with pytest.raises(InputError, match="--measure"):
        read_hazard(path)
    (tree,) = read_hazard(path, None, Hints(measure="pga_m_s2"))
    np.testing.assert_allclose(tree.curves[0].annual_rate, RATES, rtol=1e-4)


def test_a_lost_first_line_leaves_the_measure_of_the_name(tmp_path):
    path = tmp_path / "hazard_curve-mean-PGA_6.csv"
    path.write_text(openquake("").lstrip())
    with pytest.raises(InputError, match="--values 50"):
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
    with pytest.raises(InputError, match=r"once in 475 years") as refused:
        read_hazard(path)
    assert "PGA (m/s2)" in str(refused.value)


def test_json_that_does_not_say_what_its_values_are_is_refused_until_told(tmp_path):
    path = tmp_path / "curve.json"
    path.write_text(points_json(agg="mean", levels=LEVELS_G, values=RATES))
    with pytest.raises(InputError, match="--values rate"):
        read_hazard(path)
    (tree,) = read_hazard(path, None, Hints(years=0.0))
    np.testing.assert_allclose(tree.curves[0].annual_rate, RATES)


@pytest.mark.parametrize(
    ("header", "level", "rate"),
    [
        *(
            (f"PGA ({power} g),annual_rate", 100.0, 1.0)
            for power in ("10^-2", "10⁻²", "×10⁻²", "x10⁻²", "1e-2")
        ),
        *(
            (f"PGA (g),annual rate ({power})", 1.0, 1e3)
            for power in ("x10⁻³", "×10⁻³", "x10^-3", "x1000", "×1000")
        ),
        ("PGA (g),annual rate x 1000", 1.0, 1e3),
    ],
)
def test_a_power_of_ten_is_the_same_in_every_spelling(tmp_path, header, level, rate):
    path = tmp_path / "curve.csv"
    path.write_text(table(header, [level * x for x in LEVELS_G], [rate * y for y in RATES]), encoding="utf-8")
    (curve,) = read_hazard(path)[0].curves
    np.testing.assert_allclose(curve.levels, STANDARD_G_M_S2 * np.array(LEVELS_G), rtol=1e-6)
    np.testing.assert_allclose(curve.rates, RATES, rtol=1e-6)
