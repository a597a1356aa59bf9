"""Files of hazard are read as their programs wrote them, and what they do not say is asked for."""

import json
import math

import numpy as np
import pytest
from hazard_samples import (
    NSHMP_RATES,
    PLACES,
    logic_tree,
    nshmp_curves,
    nshmp_output,
    openquake_curves,
    realisations,
    service_answer,
)
from refusals import refused

from toppling.models.motions.measures import STANDARD_G_M_S2 as G
from toppling.results.hazard.places import distance_km
from toppling.results.hazard.readers import Hints, read_hazard
from toppling.results.hazard.readers.assembly import chosen_tree
from toppling.results.hazard.tree import level_choices


def read_tree(path, measure=None, site=None, **hints):
    trees = read_hazard(path, hints=Hints(site, measure, **hints))
    return chosen_tree(trees, measure or trees[0].measure, site, str(path))


def read_curve(path, site=None, **hints):
    return read_tree(path, site=site, **hints).curves[0]


def written(folder, text, name="curve.csv", encoding="utf-8"):
    (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode(encoding))
    return folder / name


OQ = "#,,\"generated_by='OpenQuake engine 3.26.2', kind='mean', investigation_time=50.0\"\n"
STATED = "generated_by='OpenQuake engine 3.26.2', kind='mean', investigation_time=50.0, imt='PGA'"
POES = (0.39346934, 0.048770575)
"""Over fifty years, of 0.01 and 0.001 a year."""
OPENSHA = (
    "Name: curve 1\nNum Points: 2\nInfo: IMR Param List: \nIMR = Boore\nSite Param List: \nLongitude = -118.1; "
    "Latitude = 34.2\nIMT Param List: \nIMT = PGA\nTimeSpan Param List: \nDuration = 50.0\n\nX, Y Data:"
)


def openquake_text(comment, sign=",", decimal="."):
    values = sign.join(("-118.1", "34.2", "0", *map(str, POES))).replace(".", decimal)
    return f"{comment}\nlon{sign}lat{sign}depth{sign}poe-0.1000000{sign}poe-0.2000000\n{values}\n"


def two_rows(text, rates=(1e-2, 1e-3)):
    return f"{text}\n0.1\t{rates[0]}\n0.2\t{rates[1]}\n"


SAME = {
    "commas": "PGA (g),annual_rate\n0.1,0.01\n0.2,0.001\n",
    "tabs, the rate first, falling levels": "annual_rate\tPGA (g)\n0.001\t0.2\n0.01\t0.1\n",
    "remarks and other columns": (
        "\ufeff# of mine\n# at the rock\nsite,PGA (g),annual_rate,note\nA,0.1,0.01,\nA,0.2,0.001,last\n"
    ),
    "decimal commas": "pga_g;annual_rate\n0,1;1,0E-2\n0,2;1,0E-3\n",
    "UTF-16": "PGA [g]\tAnnual Rate\r\n0.1\t0.01\r\n0.2\t0.001\r\n".encode("utf-16"),
    "cp1252": "PGA (cm/s²),annual_rate\n98.0665,0.01\n196.133,0.001\n".encode("cp1252"),
    "a level of zero": "PGA (g),annual_rate\n0,0.1\n0.1,0.01\n0.2,0.001\n",
    "never exceeded": 'PGA (g),return_period\n0.1,"100"\n0.2,"1,000"\n3,inf\n',
    "OpenQuake with semicolons": openquake_text("#" + 8 * ";" + f'"{STATED}"', ";", ","),
    "OpenSHA": two_rows(OPENSHA, POES),
    "OpenSHA's labels": two_rows(
        "Num Points: 2\nX-Axis Label: PGA (g)\nY-Axis Label: Probability of Exceedance in 50 years", POES
    ),
    **{
        f"the web service, new: {new}": json.dumps(service_answer(new, "Annual Frequency of Exceedence"))
        for new in (False, True)
    },
}
"""A hazard curve as programs and people save it."""


@pytest.mark.parametrize("text", SAME.values(), ids=SAME)
def test_a_curve_is_the_same_however_it_was_saved(tmp_path, text):
    name = {"{": "curve.json", "<": "curve.xml"}.get(str(text)[0], "curve.txt")
    for path in (written(tmp_path, text, name), tmp_path):
        curve = read_tree(path, "pga_m_s2", (-118.1, 34.2) if name == "curve.xml" else None).curves[0]
        assert curve.measure == "pga_m_s2"
        assert curve.intensity == pytest.approx([0.980665, 1.96133])
        assert curve.annual_rate == pytest.approx([1e-2, 1e-3])
        assert curve.site in (None, (-118.1, 34.2))


@pytest.mark.parametrize(
    ("header", "intensity", "rate"),
    [
        ("PGA (m/s2),annual_rate", 1.0, 0.1), ("PGV (cm/s),annual_rate", 0.01, 0.1), ("pgv_m_s,annual_rate", 1.0, 0.1),
        ("PGA (gal),annual_rate", 0.01, 0.1), ("pga_cm_s2,annual_rate", 0.01, 0.1),
        ("SA(1.0) (g),probability_50_years", G, -math.log(0.9) / 50),
        ("SA0P2 [g],probability_1_year", G, -math.log(0.9)),
        ("PGA (g),probability_50_years (%)", G, -math.log(0.999) / 50),
    ],
)  # fmt: skip
def test_two_columns_state_their_unit_and_their_time(tmp_path, header, intensity, rate):
    curve = read_curve(written(tmp_path, f"{header}\n1,0.1\n2,0.01\n"))
    assert curve.intensity[0] == pytest.approx(intensity)
    assert curve.annual_rate[0] == pytest.approx(rate)


UNSTATED = {
    "OpenSHA without its measure": (
        two_rows("Num Points: 2\nInfo: Duration = 50.0", POES), "hazard.measure_missing", {"measure": "pga_m_s2"}
    ),
    "OpenQuake without its first line": (openquake_text("").lstrip(), "hazard.time_missing", {"years": 50.0}),
    "OpenQuake without its time": (openquake_text("#,,,\"imt='PGA'\""), "hazard.time_missing", {"years": 50.0}),
    "OpenQuake without its measure": (
        openquake_text('#,,,"investigation_time=50.0"'), "hazard.measure_missing", {"measure": "pga_m_s2"}
    ),
    "a map of OpenSHA": (
        f"Index,Latitude,Longitude,0.1,0.2\n0,34.2,-118.1,{POES[0]},{POES[1]}\n", "hazard.time_missing",
        {"years": 50.0},
    ),
    "old types and quotes": (
        '# source_model_tree_path=b1, gsim_tree_path=b1, investigation_time=50.0, imt="PGA"\n'
        f"lon:float32,lat:float32,depth:float32,poe-0.1:float32,poe-0.2:float32\n10,45,0,{POES[0]},{POES[1]}\n", "", {}
    ),
}  # fmt: skip
"""What lacks its measure or its time is refused until a user says it; a code of nothing lacks neither."""


@pytest.mark.parametrize(("text", "code", "hints"), UNSTATED.values(), ids=UNSTATED)
def test_what_a_file_lacks_is_asked_for(text, code, hints, tmp_path):
    # By its name alone a file may tell its measure.
    path = written(tmp_path, text, "hazard_curve-mean-PGA_6.csv" if "years" in hints else "curve.csv")
    if code:
        with refused(code):
            read_hazard(path)
    curve = read_curve(path, **hints)
    assert curve.intensity == pytest.approx([0.1 * G, 0.2 * G])
    assert curve.annual_rate == pytest.approx([1e-2, 1e-3])


@pytest.mark.parametrize(
    ("text", "years"),
    [
        ("PGA (g),probability_50_years", 475.0), ("PGA (g),annual_rate", 50.0),
        ("PGA (g),probability_1_year", 0.0),
    ],
)  # fmt: skip
def test_a_user_who_contradicts_a_file_is_reported(tmp_path, text, years):
    path = written(tmp_path, f"{text}\n0.1,1e-2\n0.3,1e-4\n")
    assert read_curve(path).annual_rate[0] <= 1.01e-2
    with refused("hazard.values_contradicted"):
        read_tree(path, years=years)


def value_at(tree, level, unit, years):
    """Probability over some years that the file states at a level."""
    curve = tree.curves[0]
    place = int(np.argmin(np.abs(curve.levels - level * unit)))
    assert curve.levels[place] == pytest.approx(level * unit, rel=1e-6)
    return -math.expm1(-curve.rates[place] * years)


@pytest.mark.parametrize(
    ("imt", "measure", "unit", "kind", "years", "site"),
    [
        ("PGA", "pga_m_s2", G, "mean", 50.0, PLACES[1]), ("PGV", "pgv_m_s", 0.01, "rlz-035", 1.0, "second"),
        ("SA(1.0)", "sa_1s_m_s2", G, "mean", 1.0, PLACES[1]),
    ],
)  # fmt: skip
def test_openquakes_files_give_the_probabilities_that_they_print(
    tmp_path, imt, measure, unit, kind, years, site
):
    rows = [("first", PLACES[0], (0.5, 0.3, 0.1)), ("second", PLACES[1], (0.4, 8.2e-2, 1.5e-3))]
    path = openquake_curves(tmp_path / f"curve-{kind}.csv", kind, imt, (0.05, 0.1224745, 0.3), rows, years)
    assert value_at(read_tree(path, measure, site), 0.1224745, unit, years) == pytest.approx(8.2e-2, rel=1e-6)
    with refused("site.several", "2"):
        read_curve(path)


def test_certain_and_impossible_exceedance_have_no_rate(tmp_path):
    rows = [("a", PLACES[0], (1.0, 0.5, 0.1, 0.0))]
    curve = read_curve(openquake_curves(tmp_path / "c.csv", "mean", "PGV", (10, 100, 300, 900), rows))
    assert curve.intensity == pytest.approx([1.0, 3.0])
    assert curve.annual_rate == pytest.approx(-np.log([0.5, 0.9]) / 50.0)


def openquake(path, *sites):
    """Hazard of sites, the k-th with rates of 10^-k at the first level."""
    rows = [
        (f"site {k}", site, -np.expm1(-(10.0**-k) / np.array([1.0, 9.0]))) for k, site in enumerate(sites, 1)
    ]
    return openquake_curves(path, "mean", "PGV", (10, 100), rows, 1.0)


@pytest.mark.parametrize("site", [(-118.0, 34.1), (242.0, 34.1)])
def test_a_longitude_is_the_same_place_east_and_west_of_greenwich(tmp_path, site):
    path = openquake(tmp_path / "hazard.csv", (-118.1, 34.2), (100.0, 34.1))
    curve = read_curve(path, site=site)
    assert curve.site == (-118.1, 34.2)
    assert curve.annual_rate[0] == pytest.approx(0.1)


def test_the_nearest_site_is_the_nearest_on_the_ground_and_not_in_degrees(tmp_path):
    # Near the pole two degrees of longitude are shorter than a tenth of latitude, and the date line divides nothing.
    path = openquake(tmp_path / "hazard.csv", (-179.0, 89.0), (179.0, 89.1))
    assert read_curve(path, site=(179.0, 89.0)).site == (-179.0, 89.0)
    assert distance_km(-179.0, 89.0, (179.0, 89.0)) == pytest.approx(
        6371 * math.radians(2) * math.cos(math.radians(89)), rel=1e-3
    )


@pytest.mark.parametrize("site", [(-118.1, 35.0), (-117.0, 34.2), (61.9, 34.2), (34.2, 61.9)])
def test_a_site_out_of_reach_is_refused_by_its_place_and_distance_even_if_it_is_the_only_site(tmp_path, site):
    path = openquake(tmp_path / "hazard.csv", (-118.1, 34.2))
    away = f"{distance_km(-118.1, 34.2, site):.0f} km away"
    with refused("site.too_far", away):
        read_curve(path, site=site)


@pytest.mark.parametrize("site", [(34.2, -118.1), (-118.1, 90.1), (361.0, 34.2), (-118.1, math.nan)])
def test_what_is_no_place_on_earth_is_no_site_of_a_user_or_a_file(tmp_path, site):
    path = openquake(tmp_path / "hazard.csv", (-118.1, 34.2), (-100.0, 40.0))
    with refused("site.out_of_range"):
        read_curve(path, site=site)
    path.write_text("lat,lon,0.1,0.2\n-118.1,34.2,1e-2,1e-3\n")
    with refused("site.out_of_range", "118.1"):
        read_curve(path, measure="pga_m_s2", years=0.0)


def test_a_folder_of_openquake_is_a_tree_by_measure_and_site_with_its_weights_and_fractiles(tmp_path):
    trees = read_hazard(logic_tree(tmp_path))
    assert sorted((tree.measure, len(tree.branches), tree.site_name) for tree in trees) == [
        (measure, branches, site)
        for measure, branches in (("pga_m_s2", 4), ("pgv_m_s", 4), ("sa_1s_m_s2", 1))
        for site in ("a", "b")
    ]
    tree = chosen_tree(trees, "pga_m_s2", PLACES[0], "here")
    assert [(branch.path, branch.weight) for branch in tree.branches] == [
        ("AAA~AA", 0.1), ("AAA~AB", 0.2), ("AAB~AA", 0.3), ("AAB~AB", 0.4),
    ]  # fmt: skip
    assert sorted(tree.fractiles) == [0.05, 0.16, 0.5, 0.84, 0.95]


def test_nshmps_output_is_read_with_its_contributions_which_add_up(tmp_path):
    tree = read_tree(nshmp_output(tmp_path / "out", "ANNUAL_RATE"), "pga_m_s2", "Site One")
    total, parts = tree.curves[0], {part.name: part.rates for part in tree.parts}
    assert total.levels == pytest.approx([0.01 * G, 0.05 * G, 0.2 * G])
    assert total.rates == pytest.approx(NSHMP_RATES["curves"])
    assert parts["gmm ASK_14"] == pytest.approx(NSHMP_RATES["gmm/ASK_14"])
    assert parts["gmm ASK_14"] + parts["gmm BSSA_14"] == pytest.approx(total.rates)
    assert parts["source FAULT"] == pytest.approx(total.rates)


def test_nshmps_probabilities_are_distinguished_from_rates_by_the_configuration_or_the_user(tmp_path):
    table = nshmp_curves(tmp_path / "Case.csv", NSHMP_RATES["curves"])
    with refused("hazard.measure_missing"):
        read_hazard(table)
    with refused("hazard.time_missing"):
        read_hazard(table, hints=Hints(measure="pga_m_s2"))
    result = read_tree(table, "pga_m_s2", "Site One", years=1.0)
    stated = read_tree(nshmp_output(tmp_path / "poisson", "POISSON_PROBABILITY"), "pga_m_s2", "Site One")
    for tree in (result, stated):
        assert value_at(tree, 0.05, G, 1.0) == pytest.approx(0.04)
    rates = read_tree(nshmp_output(tmp_path / "rates", "ANNUAL_RATE"), "pga_m_s2", "Site One").curves[0]
    assert rates.annual_rate[1] == pytest.approx(0.04)


OPENSHA_TREE = """\
Site Name,Branch Index,Branch Weight,Fault Model,Scaling,GMM,0.1,0.2
Hill,0,0.7,FM_3.1,A,ASK,0.02,0.002
Hill,1,0.3,FM_3.2,A,ASK,0.04,0.004
Quarry,0,0.7,FM_3.1,A,ASK,0.01,0.001
Quarry,1,0.3,FM_3.2,A,ASK,0.03,0.003
"""


@pytest.mark.parametrize(
    ("file", "measure", "unit"), [("Hill_sa_1.0.csv", "sa_1s_m_s2", G), ("all_pgv.csv", "pgv_m_s", 0.01)]
)
def test_openshas_logic_tree_has_the_weights_and_levels_of_its_branches(tmp_path, file, measure, unit):
    path = written(tmp_path, OPENSHA_TREE, file)
    with refused("hazard.time_missing"):
        read_hazard(path)
    tree = read_tree(path, measure, "Quarry", years=1.0)
    assert tree.weights.tolist() == [0.7, 0.3]
    assert value_at(tree, 0.2, unit, 1.0) == pytest.approx(0.001)
    assert level_choices([branch.path for branch in tree.branches]) == {"Fault Model": ["FM_3.1", "FM_3.2"]}
    rows = [row.split(",") for row in OPENSHA_TREE.splitlines()[:3]]
    bare = written(tmp_path, "\n".join(",".join(row[1:3] + row[6:]) for row in rows), file)
    assert read_tree(bare, measure, years=1.0).weights.tolist() == [0.7, 0.3]


@pytest.mark.parametrize(
    ("site", "measure", "value"), [("USC", "sa_5s_m_s2", 0.004), ("s036", "sa_3s_m_s2", 0.006)]
)
def test_cybershakes_curves_state_site_and_period_in_their_names(tmp_path, site, measure, value):
    for number, (name, period) in enumerate((n, p) for n in ("USC", "s036") for p in (3, 5)):
        path = tmp_path / f"{name}_ERF36_Run930{number}_SA_{period}sec_RotD50_2022_12_21.txt"
        of_curve = {("USC", 5): 0.004, ("s036", 3): 0.006}.get((name, period), 0.002)
        path.write_text(
            f"# Curves: 1\n# Name: CS Run 930{number}\n1.0E-2\t0.05\n1.0E-1\t{of_curve}\n1.0\t0.0\n"
        )
    tree = read_tree(tmp_path, measure, site)
    assert value_at(tree, 0.1, G, 1.0) == pytest.approx(value)
    assert tree.curves[0].component == "RotD50"


def test_contributions_and_fractiles_are_no_branches(tmp_path):
    (tmp_path / "oq").mkdir()
    with refused("hazard.contribution_only"):
        read_hazard(nshmp_output(tmp_path / "nshmp", "ANNUAL_RATE") / "PGA/gmm/ASK_14/curves.csv")
    with refused("hazard.fractiles_only"):
        read_hazard(logic_tree(tmp_path / "oq") / "quantile_curve-0.95-PGA_6.csv")


def rlz(folder, number, poes=(0.5, 0.1, 0.01), site=(10.0, 45.0), checksum=7):
    kind = f"rlz-{number:03}"
    path = folder / f"hazard_curve-{kind}-PGA.csv"
    openquake_curves(path, kind, "PGA", (0.1, 0.2, 0.4), [("a", site, poes)], checksum=checksum)


@pytest.mark.parametrize(
    ("values", "curves", "stated"),
    [
        ((0.5, 0.4), [{}, {}], "hazard.weights_sum"),
        ((0.5, 0.5), [{}], "hazard.realisations_missing"),
        ((1.0,), [{}, {}], "hazard.weights_incomplete"),
        ((0.5, 0.5), [{}, {"site": (10.5, 45.0)}], "hazard.realisations_missing"),
        ((0.5, 0.5), [{}, {"checksum": 8}], "hazard.several_calculations"),
        ((0.5, 0.5), [{}, {"poes": (0.5, 1.1, 0.01)}], "hazard.probability_out_of_range"),
        ((0.5, 0.5), [{}, {"poes": (0.5, 0.1, 0.2)}], "hazard.rates_rise"),
        ((0.5, 0.5), [{}, {"poes": (0.5, math.nan, 0.2)}], "hazard.number_unreadable"),
        (None, [{}, {}], "hazard.weights_missing"),
    ],
)  # fmt: skip
def test_a_tree_that_is_not_whole_is_refused_by_what_it_lacks(tmp_path, values, curves, stated):
    for number, curve in enumerate(curves):
        rlz(tmp_path, number, **curve)
    if values:
        realisations(tmp_path, values)
    with refused(stated):
        read_hazard(tmp_path)


def test_sampled_trees_may_repeat_a_path_hold_branches_without_an_event_and_be_numbered_as_of_old(tmp_path):
    rlz(tmp_path, 0)
    rlz(tmp_path, 1, poes=(0.0, 0.0, 0.0))
    (tmp_path / "realizations.csv").write_text(
        "ordinal,branch_path,weight\n0,b11_b21~b1,0.5\n1,b11_b21~b1,0.5\n"
    )
    tree = read_tree(tmp_path)
    assert [len(curve.intensity) for curve in tree.curves] == [3, 0]
    assert {branch.path for branch in tree.branches} == {"b11_b21~b1"}


def test_files_with_weights_are_branches_of_a_site(tmp_path):
    for name, site in (("a", (10.0, 45.0)), ("b", (10.0, 45.001)), ("c", (11.0, 45.0))):
        openquake(tmp_path / f"{name}.csv", site)
    (tree,) = read_hazard([tmp_path / "a.csv", tmp_path / "b.csv"], [0.7, 0.3])
    assert [(branch.name, branch.weight) for branch in tree.branches] == [("a", 0.7), ("b", 0.3)]
    with refused("site.several", "10", "11"):
        read_hazard([tmp_path / "a.csv", tmp_path / "c.csv"], [0.7, 0.3])
    with refused("hazard.weights_sum", "1.1"):
        read_hazard([tmp_path / "a.csv", tmp_path / "b.csv"], [0.7, 0.4])


def test_a_folder_skips_other_files_and_is_refused_if_it_has_no_hazard(tmp_path):
    (tmp_path / "notes.txt").write_text("nothing\n")
    (tmp_path / "job.json").write_text(json.dumps({"a": 1}))
    (tmp_path / "shapes.csv").write_text('id,outline\n1,"' + "9 " * 100_000)
    with refused("hazard.no_file", "3"):
        read_hazard(tmp_path)
    openquake(tmp_path / "mean.csv", (10.0, 45.0))
    assert len(read_hazard(tmp_path)) == 1


REFUSED = [
    ("file.empty", ""),
    ("file.binary", b"\x89HDF\r\n\x1a\n" + bytes(99)),
    ("hazard.time_missing", "pga_m_s2,rate\n1,1\n"),
    ("hazard.time_missing", "PGA (g),poe\n0.1,0.01\n0.2,0.001\n"),
    ("hazard.measure_missing", "# nothing\nlon,lat\n"),
    ("hazard.measure_missing", "PGV (m/s2),annual_rate\n0.1,0.01\n0.2,0.001\n"),
    ("hazard.measure_missing", "ln PGA (g),annual_rate\n-2,1e-2\n-1,1e-3\n"),
    ("hazard.rates_rise", "pga_m_s2,annual_rate\n1,0.1\n2,0.2\n"),
    ("hazard.number_unreadable", "pgv_m_s,annual_rate\n0.1,1e-2\n0.3,nan\n1,1e-4\n"),
    ("hazard.values_unknown", "PGA (g),annual rate per kyr\n0.1,0.1\n0.2,0.01\n"),
    ("hazard.values_unknown", "PGA (g),probability of non-exceedance in 50 years\n0.1,0.9\n0.2,0.8\n"),
    ("hazard.values_unknown", "PGA (g),ln rate\n0.1,0.9\n0.2,0.8\n"),
    ("hazard.rate_not_positive", "pgv_m_s,annual_rate\n0.1,1e-2\n0.3,-1e-3\n1,1e-4\n"),
    ("hazard.levels_not_rising", "PGA (g),annual_rate\n"),
    ("hazard.levels_not_rising", "PGA (g),annual_rate\n0.1,1.0\n0.3,0.1\n0.2,0.01\n"),
    ("hazard.no_header", "0.1,0.01\n0.2,0.001\n"),
    ("table.row_wrong_length", "PGA (g),annual_rate\n0.1,0.01,3\n0.2,0.001\n"),
    ("hazard.columns_unknown", "PGA (g),0.1,0.2\nannual_rate,1e-2,1e-3\n"),
    ("hazard.columns_unknown", "PGA (g),annual_rate,return_period\n0.1,1e-2,100\n0.2,1e-3,1000\n"),
    ("hazard.other_output", "<table><tr><th>PGA (g)<th>annual_rate<tr><td>0.1<td>1e-2</table>\n"),
    ("document.unreadable", '{"imt": "PGA", "levels": [0.1, 0.2], "annual_rate": [1e-2, 1e-3]}'),
    *(("hazard.unit_missing", f"{name},annual_rate\n0.1,1e-2\n0.2,1e-3\n") for name in ("PGA", "PGV", "SA(1.0)")),
    ("hazard.other_output", OQ + "imt,iml,poe,mag,dist,mean\nPGA,.2,.1,5.5,5,.04\n"),
    ("hazard.other_output", OQ + "lon,lat,PGA-0.1,PGA-0.02\n.5,-.5,.11,.19\n"),
    ("hazard.other_output", OQ + "lon,lat,0.100000~PGA,0.100000~SA(0.2)\n.5,-.5,.11,.2\n"),
    ("hazard.time_missing", json.dumps(service_answer(True, None))),
    ("hazard.not_rates", json.dumps(service_answer(False, "Probability of Exceedance"))),
    ("hazard.other_output", OQ + "event_id,gmv_PGA,custom_site_id\n1,.2,a\n"),
    ("hazard.other_output", '<?xml version="1.0"?>\n<nrml xmlns="http://openquake.org/xmlns/nrml/0.5"/>\n'),
]  # fmt: skip


@pytest.mark.parametrize(("code", "text"), REFUSED)
def test_what_is_no_hazard_curve_or_does_not_state_what_it_is_of_is_refused(tmp_path, code, text):
    path = written(tmp_path, text, "curve.csv")
    with refused(code):
        read_hazard(path)
    for years in (0.0, 50.0) if code == "hazard.values_unknown" else ():  # whatever the user says
        with refused(code):
            read_hazard(path, hints=Hints(years=years))


@pytest.mark.parametrize(
    "text",
    [
        "name,lon,lat,4.25,4.35,4.45\nFresno,-119.75,36.75,3e-3,2e-3,1e-3\n",  # nshmp-haz, cumulative
        "lon,lat,5.0,5.5,6.0,6.5\n-119.75,36.75,0,3e-3,4e-3,1e-3\n",  # and incremental
        "mag,freq\n4.7,2e-2\n",  # OpenQuake's mfd.csv
        "Magnitude,annual_rate\n5,1e-2\n6,1e-3\n7,1e-4\n",
    ],
)
@pytest.mark.parametrize("measure", ["pga_m_s2", "pgv_m_s"])
def test_magnitudes_are_never_levels_of_motion(tmp_path, text, measure):
    (tmp_path / "total.csv").write_text(text)
    for path in (tmp_path / "total.csv", tmp_path):
        with refused("hazard.other_output") as error:
            read_hazard(path, hints=Hints(None, measure, 0.0))
        assert "--measure" not in error.value.remedy


def test_levels_of_motion_are_no_magnitudes(tmp_path):
    """Equal steps alone are none: below 1 g, or up to more than 10.5 cm/s, they are levels."""
    for levels, measure in (("0.1,0.2,0.3", "pga_m_s2"), ("5,10,15,20", "pgv_m_s"), ("1,2,5,10", "pgv_m_s")):
        values = ",".join(f"{10.0**-n}" for n in range(1, levels.count(",") + 2))
        (tmp_path / "total.csv").write_text(f"lon,lat,{levels}\n-119.75,36.75,{values}\n")
        assert len(read_hazard(tmp_path / "total.csv", hints=Hints(None, measure, 0.0))) == 1


@pytest.mark.parametrize("new", [False, True])
def test_answers_of_the_web_service_are_a_tree_per_measure_with_its_parts(tmp_path, new):
    path = written(tmp_path, json.dumps(service_answer(new, None)), "answer.json")
    trees = read_hazard(path, hints=Hints(years=0.0))
    assert [tree.measure for tree in trees] == ["pga_m_s2", "sa_0.2s_m_s2"]
    assert [part.name for tree in trees for part in tree.parts] == ["source Fault"] * 2


@pytest.mark.parametrize("asked", [None, "pga_m_s2"])
def test_a_file_without_a_measure_inside_is_over_the_measure_in_its_name(tmp_path, asked):
    path = tmp_path / "curves_pga.csv"
    path.write_text("Index,Latitude,Longitude,0.1,0.5\n0,34.1,-118.2,0.01,0.001\n")
    (tree,) = read_hazard(path, hints=Hints(measure=asked, years=0.0))
    assert tree.measure == "pga_m_s2"
    with refused("hazard.measures_differ", "pga_m_s2", "pgv_m_s"):
        read_hazard(path, hints=Hints(measure="pgv_m_s", years=0.0))
