"""The command judges rocks event by event: event sets, two measures at once, dates that rocks share."""

import json
import math
import shutil

import numpy as np
import pytest
from click.testing import CliRunner
from hazard_samples import event_set
from scipy.stats import norm
from seeded import rows

from toppling.models.motions.measures import STANDARD_G_M_S2 as G
from toppling.orchestrator.cli import cli
from toppling.results.analysis.exchange import write_curves
from toppling.results.analysis.lognormal import Lognormal
from toppling.results.drawing.run_figures import write_fits
from toppling.results.reader import open_run
from toppling.results.store import write_part

PGA = Lognormal("pga_m_s2", 0.5 * G, 0.3)


def constrain(*arguments):
    return CliRunner().invoke(cli, ["constrain", *map(str, arguments)])


def told_by(*arguments):
    done = constrain(*arguments, "--json")
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


@pytest.fixture
def rocks(tmp_path):
    return two_rocks(tmp_path)


def two_rocks(folder):
    names = ("first", "second")
    medians = (PGA.median, 0.8 * PGA.median)
    return [
        write_curves(folder / f"{name}.json", [Lognormal("pga_m_s2", median, 0.3)])
        for name, median in zip(names, medians, strict=True)
    ]


@pytest.fixture
def events(tmp_path):
    return two_branches(tmp_path)


def two_branches(place):
    """Two branches of 1000 years at two sites: the second branch's motions are twice the first's."""
    random = np.random.default_rng(0)
    fields = ["event_id,gmv_PGA,custom_site_id"]
    for event in range(60):
        for site in ("aa", "bb"):
            fields.append(f"{event},{0.12 * (1 + event % 2) * random.lognormal(0, 0.7):.5E},{site}")
    catalogue = [f"{event},{event},{event % 2},{1 + event},1" for event in range(60)]
    stated = {"investigation_time": 50.0, "ses_per_logic_tree_path": 20}
    sites = {"aa": (1.0, 2.0), "bb": (1.2, 2.0)}
    weights = {"A~weak": 0.4, "A~strong": 0.6}
    return event_set(place / "calculation", fields, catalogue, weights, sites, **stated)


def test_factors_of_rates_and_of_the_mean_follow_from_the_branches_rates(rocks, events):
    """Of one age A: k = -ln(.05) / (nu A), and the mean's nu is the weighted mean of the branches'."""
    told = told_by(rocks[0], "--hazard", events, "--site", "aa", "--age", "300")
    for row in told["branches"]:
        assert row["rate_factor"] == pytest.approx(-math.log(0.05) / (300 * row["toppling_rate"]))
        assert row["rate_factor_low"] < row["rate_factor"] < row["rate_factor_high"]
    mean = sum(row["prior_weight"] * row["toppling_rate"] for row in told["branches"])
    assert told["mean"]["survival"] == pytest.approx(math.exp(-300 * mean))
    assert told["mean"]["rate_factor"] == pytest.approx(-math.log(0.05) / (300 * mean))
    low, high = sorted(row["scale_factor"] for row in told["branches"])
    assert low < told["mean"]["scale_factor"] < high


def test_rocks_that_survive_under_no_branch_are_told_so_and_their_rates_keep_an_interval(rocks, events):
    given = (*rocks, "--hazard", events, "--site", "aa", "--age", "1000000")
    told = told_by(*given)
    assert [branch["survival"] for branch in told["branches"]] == pytest.approx([0.0, 0.0], abs=1e-300)
    for one in (told["mean"], *told["branches"]):
        assert 0.0 < one["rate_factor_low"] < one["rate_factor"] < one["rate_factor_high"]
    said = constrain(*given)
    assert said.exit_code == 0
    assert "survive under no ground-motion model" in said.stdout


def test_the_scale_factor_is_where_survival_falls_to_five_per_cent(rocks, events):
    """Motions as much stronger, by --ratio, leave 5 %."""
    asked = [rocks[0], "--hazard", events, "--site", "aa", "--age", "300"]
    factor = told_by(*asked)["branches"][0]["scale_factor"]
    assert told_by(*asked, "--ratio", factor)["branches"][0]["survival"] == pytest.approx(0.05, abs=1e-3)


@pytest.mark.parametrize(
    ("options", "what"),
    [
        ([], "has 2 sites"), (["--site", "nowhere"], "no site called"), (["--site", "50", "50"], "km away"),
        (["--site", "aa", "--measure", "pgv_m_s"], "no fragility over pgv_m_s"),
        (["--site", "aa", "--correlation", "0.5"], "--correlation applies"),
        (["--site", "aa", "--measure", "pga_m_s2+cav_m_s"], "not an intensity measure"),
        (["--site", "aa", "--measure", "pga_m_s2+pgv_m_s"], "independently"),
    ],
)  # fmt: skip
def test_events_that_do_not_answer_are_refused_and_nothing_is_written(rocks, events, tmp_path, options, what):
    out = tmp_path / "out"
    done = constrain(rocks[0], "--hazard", events, "--age", "300", *options, "--out", out)
    assert done.exit_code != 0
    assert what in f"{done.output} {done.exception}"
    assert not out.exists()


def test_two_measures_at_once_need_events_that_correlate_them_which_the_engines_fields_do_not(tmp_path):
    """A plain table's motions belong together; the engine draws PGA and PGV of one event independently."""
    rock, table = tmp_path / "rock.csv", tmp_path / "table.csv"
    rock.write_text(
        "measure,median,beta,coefficient_0,coefficient_1,coefficient_2\n"
        "pga_m_s2,7,.45,,,\npgv_m_s,.9,.45,,,\npga_m_s2+pgv_m_s,,,-2.8,1.6,2.2\n"
    )
    table.write_text("event_id,annual_rate,pga_m_s2,pgv_m_s\n1,1e-4,8,1\n2,1e-3,3,.3\n")
    asked = ["--age", "5000", "--measure", "pga_m_s2+pgv_m_s"]
    rates = norm.cdf(-2.8 + 1.6 * np.log([8, 3]) + 2.2 * np.log([1, 0.3])) @ [1e-4, 1e-3]
    (branch,) = told_by(rock, "--hazard", table, *asked)["branches"]
    assert branch["survival"] == pytest.approx(math.exp(-5000 * rates))
    fields = tmp_path / "gmf-data_1.csv"
    fields.write_text("event_id,gmv_PGA,gmv_PGV,custom_site_id\n0,.8,100,aa\n1,.3,30,aa\n")
    refused = constrain(rock, "--hazard", fields, "--catalogue-years", "1000", *asked)
    assert refused.exception.code == "events.residuals_independent"
    assert constrain(rock, "--hazard", fields, "--catalogue-years", "1000", *asked[:2]).exit_code == 0


def test_a_set_of_events_stands_alone_and_its_options_need_it(rocks, events, tmp_path):
    both = constrain(rocks[0], "--hazard", events, "--hazard", events, "--age", "300", "--site", "aa")
    assert both.exception.code == "events.given_with_others"
    curve = tmp_path / "curve.csv"
    curve.write_text("PGA,annual_rate\n0.05,1e-2\n0.5,1e-4\n2,1e-6\n")
    alone = constrain(rocks[0], "--hazard", curve, "--age", "300", "--event-rate", "0.1")
    assert "--event-rate applies" in alone.output
    twins = constrain(rocks[0], rocks[0], "--hazard", events, "--age", "300", "--site", "aa")
    assert twins.exception.code == "rock.given_twice"


@pytest.fixture
def curve(tmp_path):
    path = tmp_path / "curve.csv"
    lines = [f"{x},{2e-4 * (x / 5) ** -2.5}" for x in np.geomspace(0.5, 50, 12)]
    path.write_text("\n".join(["pga_m_s2,annual_rate", *lines]) + "\n")
    return path


def survival_of(*arguments):
    return told_by(*arguments)["branches"][0]["survival"]


def test_a_rock_once_stouter_lies_between_one_that_was_buried_and_one_that_was_not(rocks, curve):
    asked = [rocks[0], "--hazard", curve, "--age", "12000"]
    less_fragile = survival_of(*asked, "--fragile-since", "4000:1.5")
    assert survival_of(*asked) < less_fragile < survival_of(*asked, "--fragile-since", "4000")
    # A power law: motions that topple 1.5 times stronger are 1.5^2.5 times rarer.
    rate = told_by(*asked)["branches"][0]["toppling_rate"]
    assert less_fragile == pytest.approx(math.exp(-rate * (4000 + 8000 / 1.5**2.5)), rel=0.01)


@pytest.mark.thorough
@pytest.mark.usefixtures("empty_figures")
def test_two_measures_at_once_are_judged_by_their_joint_rate(tmp_path):
    run = tmp_path / "run"
    run.mkdir()
    write_part(run, rows(records=24, azimuths=(0.0, 90.0)))
    for name, measure, strongest in (("a", "pga_m_s2", 8.0), ("v", "pgv_m_s", 1.0)):
        lines = [f"{x},{1e-4 * (x / strongest) ** -2.5}" for x in np.geomspace(0.05, 8, 14) * strongest]
        (tmp_path / f"{name}.csv").write_text("\n".join([f"{measure},annual_rate", *lines]) + "\n")
    folder = tmp_path / "both"
    folder.mkdir()
    for name in ("a", "v"):
        (tmp_path / f"{name}.csv").rename(folder / f"{name}.csv")
    asked = [run, "--hazard", folder, "--age", "5000"]
    told = told_by(*asked, "--measure", "pga_m_s2+pgv_m_s", "--correlation", "0.6")
    assert len(told["rocks"][0]["coefficients"]) == 3
    assert "a correlation of 0.6" in told["notes"][0]
    row = told["branches"][0]
    assert row["survival_low"] < row["survival"] < row["survival_high"]
    assert {one["measure"] for one in told["updated"]} == {"pga_m_s2", "pgv_m_s"}
    assert "joint rate" not in told["intervals_carry"]
    unstated = told_by(*asked, "--measure", "pga_m_s2+pgv_m_s")
    assert "joint rate" in unstated["intervals_carry"]
    known = told_by(*asked, "--measure", "pga_m_s2+pgv_m_s", "--correlation", "0.733")
    wide, stated = (one["branches"][0] for one in (unstated, known))
    assert wide["survival"] == pytest.approx(stated["survival"])
    assert wide["survival_high"] - wide["survival_low"] > stated["survival_high"] - stated["survival_low"]

    branches = [f"{folder}=0.5", "--hazard", f"{shutil.copytree(folder, tmp_path / 'again')}=0.5"]
    of_two = constrain(run, "--hazard", *branches, "--age", "5000", "--measure", "pga_m_s2+pgv_m_s")
    assert of_two.exit_code == 0, of_two.output
    assert "other scatters of the two measures" in of_two.output

    list(write_fits(open_run(run).frame(), tmp_path, "run"))
    assert (tmp_path / "fits" / "surface.png").exists()
    for suffix in (".csv", ".json"):
        asked[0] = tmp_path / "fits" / f"curves{suffix}"
        again = told_by(*asked, "--measure", "pga_m_s2+pgv_m_s", "--correlation", "0.6")["branches"][0]
        number = {name for name, value in row.items() if isinstance(value, float)}
        assert {name: again[name] for name in number} == pytest.approx(
            {name: row[name] for name in number}, rel=1e-4
        )
    twins = constrain(run, *asked, "--measure", "pga_m_s2+pgv_m_s")
    assert twins.exception.code == "rock.given_twice"


@pytest.mark.usefixtures("empty_figures")
def test_the_events_with_their_new_weights_are_read_back_as_a_tree(rocks, events, tmp_path):
    out, asked = tmp_path / "out", ["--age", "300", "--ratio", "1.2"]
    told_by(*rocks, "--hazard", events, *asked, "--site", "aa", "--site", "bb", "--out", out)
    shutil.unpack_archive(out / "openquake.zip", tmp_path / "two")
    assert (
        len((tmp_path / "two" / "hazard_curve-mean-PGA.csv").read_text().splitlines()) == 4
    )  # two of them sites
    told = told_by(rocks[0], "--hazard", events, *asked, "--site", "aa", "--out", out)
    shutil.unpack_archive(out / "openquake.zip", tmp_path / "one")
    again = told_by(rocks[0], "--hazard", tmp_path / "one", *asked)
    for row, before in zip(again["branches"], told["branches"], strict=True):
        assert row["prior_weight"] == pytest.approx(before["posterior_weight"], rel=1e-6)
    rates, found = (
        [
            row[name]
            for row, full in zip(one["updated"], told["updated"], strict=True)
            if full["rate_posterior_mean"]
        ]
        for one, name in ((told, "rate_posterior_mean"), (again, "rate_prior_mean"))
    )
    assert len(rates) > 10
    assert found == pytest.approx(rates, rel=0.05)


def test_a_spectral_acceleration_of_any_period_has_its_hazard(tmp_path):
    rock = write_curves(tmp_path / "rock.csv", [Lognormal("sa_3s_m_s2", 2.0, 0.3)])
    curve = tmp_path / "hazard.csv"
    curve.write_text("SA(3.0),annual_rate\n0.05,1e-2\n0.2,1e-3\n1,1e-5\n")
    fields = tmp_path / "fields.csv"
    fields.write_text("event_id,SA(3.0),annual_rate\n0,0.1,1e-3\n1,0.4,1e-4\n")
    for hazard in (curve, fields):
        for measure in ([], ["--measure", "sa_3s_m_s2"]):
            told = told_by(rock, "--hazard", hazard, "--age", "300", *measure)
            assert told["measure"] == "sa_3s_m_s2"
