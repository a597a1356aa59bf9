"""The command says what the rocks reject, from a run, a file of curves or a set of events."""

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from hazard_samples import event_set, openquake_curves, realisations
from scipy.stats import norm
from seeded import THETA_M_S, rows
from small_campaigns import run_in

from toppling.models.motions.measures import STANDARD_G_M_S2 as G
from toppling.orchestrator.cli import cli
from toppling.results.analysis.exchange import write_curves
from toppling.results.analysis.lognormal import Basis, Lognormal
from toppling.results.drawing.run_figures import write_fits
from toppling.results.drawing.sentences import answer, percent
from toppling.results.hazard.readers import read_hazard
from toppling.results.reader import open_run


@pytest.fixture
def hazards(tmp_path):
    for name, rate in (("low", 1e-5), ("high", 1e-2)):
        lines = [f"{x},{rate * x**-2}" for x in (0.01, 0.1, 1, 10, 100)]
        (tmp_path / f"{name}.csv").write_text("\n".join(["pgv_m_s,annual_rate", *lines]))
    return [str(tmp_path / f"{name}.csv") for name in ("low", "high")]


@pytest.fixture
def curves(tmp_path):
    return str(write_curves(tmp_path / "rock.json", [Lognormal("pgv_m_s", 1.2, 0.4)]))


def constrain(*arguments):
    return CliRunner().invoke(cli, ["constrain", *map(str, arguments)])


def statement_of(*arguments):
    done = constrain(*arguments, "--json")
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def test_a_run_but_no_file_states_how_far_other_records_would_move_its_bound(tmp_path, curves):
    run_in(tmp_path, rows(records=30, azimuths=(0.0,)))
    statement = statement_of(str(tmp_path))
    assert statement["unexceeded_low"] < statement["unexceeded"] < statement["unexceeded_high"]
    # At a confidence of one half the bound is the median; 570 jobs give it to about 4 %.
    assert statement_of(str(tmp_path), "--confidence", "0.5")["unexceeded"] == pytest.approx(
        THETA_M_S, rel=0.12
    )
    assert statement_of(curves)["unexceeded_low"] is None


def test_a_contact_is_chosen_among_several_with_the_data_of_its_own_run(tmp_path, curves):
    rough = rows(records=8, azimuths=(0.0,), friction=0.8)
    for name, jobs in (("one", rough), ("both", rough + rows(records=8, azimuths=(0.0,), friction=0.5))):
        run_in(tmp_path / name / "run", jobs)
    assert constrain(str(tmp_path / "both" / "run")).exception.code == "run.several_contacts"
    none = constrain(str(tmp_path / "both" / "run"), "--where", "friction_static = 9")
    assert none.exception.code == "run.no_job_left"
    chosen = ("--where", "friction_static = 0.8", "--json")
    document, alone = (
        json.loads(constrain(str(tmp_path / name / "run"), *options).stdout)
        for name, options in (("both", chosen), ("one", ("--json",)))
    )
    for statement, jobs in ((document, 2 * len(rough)), (alone, len(rough))):
        assert statement["rocks"][0].pop("jobs_planned") == statement["rocks"][0].pop("jobs_done") == jobs
    assert document == alone
    assert document["unexceeded_low"] is not None
    assert constrain(curves, *chosen).exit_code == 2


@pytest.mark.usefixtures("empty_figures")
def test_branches_are_retained_or_rejected_and_weighted_anew(tmp_path, curves, hazards):
    folder = tmp_path / "out"
    weighted = ["--hazard", f"{hazards[0]}=0.25", "--hazard", f"{hazards[1]}=0.75"]
    done = constrain(curves, "--age", "10000", *weighted, "--json", "--out", str(folder))
    low, high = json.loads(done.stdout)["branches"]
    # Closed form of a power law of exponent 2: lambda(median) exp(2 beta^2).
    assert low["toppling_rate"] == pytest.approx(1e-5 / 1.44 * math.exp(0.32), rel=1e-4)
    assert (low["verdict"], high["verdict"]) == ("consistent", "inconsistent")
    assert (low["prior_weight"], high["prior_weight"]) == (0.25, 0.75)
    assert low["posterior_weight"] == pytest.approx(1.0)
    assert {path.name for path in folder.iterdir()} == {
        "branches.csv", "updated.csv", "changes.csv", "constraint.png", "constraint.svg", "constraint.json",
        "constraint.html", "hazard.png", "hazard.svg",
    }  # fmt: skip
    filed = json.loads((folder / "constraint.json").read_text())
    assert filed == json.loads(done.stdout)
    assert pd.DataFrame(filed["rates"])["inconsistent_annual_rate"].is_monotonic_decreasing
    texts = [(folder / f"constraint.{kind}").read_text() for kind in ("json", "html")]
    assert str(tmp_path) not in "".join(texts)


def test_a_rock_that_is_given_twice_is_refused(tmp_path, curves):
    def rock(name, scene_id):
        basis = Basis(scene_id, 570, 212, 30, 0, 2.75)
        return str(write_curves(tmp_path / name, [Lognormal("pgv_m_s", 1.5, 0.3, basis)]))

    first, again, other = rock("a.json", "5c3a"), rock("b.csv", "5c3a"), rock("c.json", "77e0")
    assert constrain(first, other, curves).exit_code == 0
    twice = constrain(first, other, again).exception
    assert (twice.code, twice.where) == ("rock.given_twice", again)
    assert constrain(curves, curves).exception.code == "rock.given_twice"


def test_a_verdict_that_hangs_on_what_the_curve_leaves_out_is_undecided(tmp_path, curves):
    for name, low in (("whole", 0.01), ("late", 0.8)):
        lines = [f"{x},{1.5e-3 * x**-3}" for x in (low, 1, 10, 100)]
        (tmp_path / f"{name}.csv").write_text("\n".join(["pgv_m_s,annual_rate", *lines]))
    asked = [["--hazard", str(tmp_path / f"{name}.csv")] for name in ("whole", "late")]
    statement = statement_of(curves, "--age", "2000", *asked[0], *asked[1])
    whole, late = statement["branches"]
    counts = [statement["decided"][f"branches_{verdict}"] for verdict in ("inconsistent", "undecided")]
    assert (whole["verdict"], late["verdict"], counts) == ("inconsistent", "undecided", [1, 1])
    first, *others = constrain(curves, "--age", "2000", *asked[1]).stdout.splitlines()
    assert first.count("undecided") == first.count("give a curve that extends further") == 1
    assert not any(", consistent" in line or line.endswith("as it is.") for line in others)
    # The late curve is the whole one without its low end: the same power law goes on below it.
    assert late["survival_least"] == pytest.approx(whole["survival"], rel=1e-4)
    assert late["unstated_below"] > 0.1
    assert whole["unstated_below"] < 1e-4


@pytest.mark.parametrize(("asked", "all_of_them"), [([1], True), ([1, 1], True), ([0, 1], False)])
def test_the_verdict_comes_first_and_nothing_is_updated_where_all_is_rejected(
    tmp_path, curves, hazards, asked, all_of_them
):
    branches = [argument for number in asked for argument in ("--hazard", hazards[number])]
    statement = statement_of(curves, "--age", "10000", *branches)
    assert all(branch["verdict"] == "inconsistent" for branch in statement["branches"]) == all_of_them
    names = {
        "branches": "posterior_weight",
        "updated": "rate_posterior_mean",
        "changes": "level_posterior_mean",
    }
    for table, column in names.items():
        assert all(row[column] is None for row in statement[table]) == all_of_them
    stated = constrain(curves, "--age", "10000", *branches, "--out", str(tmp_path / "made")).stdout
    assert "inconsistent" in stated.partition("\n")[0]
    page = (tmp_path / "made" / "constraint.html").read_text()
    assert ("after (coloured)" in page) == ("posterior weight" in page) == (not all_of_them)


@pytest.mark.parametrize(("confidence", "inconsistent"), [("0.5", True), ("0.95", False)])
def test_a_branch_is_rejected_at_the_confidence_that_is_asked_for(curves, hazards, confidence, inconsistent):
    age, asked = ["--age", "100000"], ["--hazard", hazards[0], "--confidence", confidence]
    branch = statement_of(curves, *age, *asked)["branches"][0]
    assert branch["survival"] == pytest.approx(math.exp(-1e5 * 1e-5 / 1.44 * math.exp(0.32)), rel=1e-3)
    assert (branch["verdict"] == "inconsistent") == inconsistent


def test_wrong_usage_and_wrong_data_are_distinguished(curves, hazards):
    ageless = constrain(curves, "--hazard", hazards[0])
    assert (ageless.exit_code, "[age.needed]" in ageless.output) == (2, True)
    assert constrain(curves, "--age", "1", "--age", "2").exit_code == 2
    nowhere = ["--hazard", hazards[0], "--site", "10", "45"]
    assert constrain(curves, "--age", "1", *nowhere).exit_code == 2
    for option in (
        ["--common-date"],
        ["--fragile-since", "4000"],
        ["--common-error", "0.1"],
        ["--stood", "."],
        ["--site", "10", "95"],
        ["--ratio", "1.2"],
    ):
        assert constrain(curves, *option).exit_code == 2
    assert constrain(curves, "--age", "1", "--hazard", f"{hazards[0]}=x").exit_code == 2
    wrong = constrain(curves, "--age", "1", "--hazard", hazards[0], "--measure", "pga_m_s2")
    assert wrong.exception.code == "hazard.measure_other"
    lacking = constrain(curves, "--measure", "pga_m_s2")
    assert lacking.exception.code == "fragility.none"


def openquake_tree(folder, weights=(0.4, 0.6), site=(10.0, 45.0)):
    """A tree of two branches over PGV, power laws of exponent 2 with ten times each other's rates."""
    folder.mkdir(exist_ok=True)
    levels = np.array([1, 3, 10, 30, 100, 300, 1000, 3000, 10000])
    for number, rate in enumerate((1e-5, 1e-4)):
        kind, poes = f"rlz-{number:03}", -np.expm1(-50 * rate * (levels / 100) ** -2.0)
        openquake_curves(folder / f"hazard_curve-{kind}-PGV.csv", kind, "PGV", levels, [("a", site, poes)])
    realisations(folder, weights)
    return str(folder)


def test_a_tree_is_updated_by_the_rocks_survival_with_factors_of_their_closed_form(tmp_path, curves):
    tree = openquake_tree(tmp_path / "tree")
    statement = statement_of(curves, "--age", "10000", "--hazard", tree)
    rates = [rate / 1.44 * math.exp(0.32) for rate in (1e-5, 1e-4)]
    alive = [math.exp(-1e4 * rate) for rate in rates]
    assert [branch["survival"] for branch in statement["branches"]] == pytest.approx(alive, rel=1e-3)
    weights = [weight * chance for weight, chance in zip((0.4, 0.6), alive, strict=True)]
    assert [branch["posterior_weight"] for branch in statement["branches"]] == pytest.approx(
        [weight / sum(weights) for weight in weights], rel=1e-3
    )
    # Motions s times as strong have s^2 times the rates of a power law of exponent 2.
    for branch, rate in zip(statement["branches"], rates, strict=True):
        allowed = -math.log(0.05) / (1e4 * rate)
        assert branch["rate_factor"] == pytest.approx(allowed, rel=1e-3)
        assert branch["scale_factor"] == pytest.approx(math.sqrt(allowed), rel=1e-3)
        assert branch["scale_factor_low"] is None  # neither records nor ages are known to vary
    row = statement["updated"][4]
    mean = sum(
        w / sum(weights) * -math.expm1(-50 * rate) for w, rate in zip(weights, (1e-5, 1e-4), strict=True)
    )
    assert row["level"] == pytest.approx(1.0)
    assert row["rate_posterior_mean"] == pytest.approx(-math.log1p(-mean) / 50, rel=1e-3)
    assert row["rate_posterior_mean"] < row["rate_prior_mean"]
    assert row["rate_posterior_p05"] <= row["rate_posterior_p95"]


def test_an_uncertain_age_reaches_factors_updated_mean_and_verdict(tmp_path, curves, hazards):
    tree = openquake_tree(tmp_path / "tree")
    statement = statement_of(curves, "--age", "5000..20000", "--hazard", tree)
    assert statement["intervals_carry"] == ["age"]
    branch = statement["branches"][0]
    exact = [math.sqrt(-math.log(0.05) / (age * 1e-5 / 1.44 * math.exp(0.32))) for age in (19625, 5375)]
    assert branch["scale_factor_low"] == pytest.approx(exact[0], rel=0.01)
    assert branch["scale_factor_high"] == pytest.approx(exact[1], rel=0.01)
    row = statement["updated"][4]
    assert row["rate_posterior_mean_low"] < row["rate_posterior_mean"] < row["rate_posterior_mean_high"]
    single = statement_of(curves, "--age", "5000..20000", "--hazard", hazards[0])
    ends = [percent(single["branches"][0][f"survival_{end}"]) for end in ("low", "high")]
    assert f"(95 %: {' to '.join(ends)})" in answer(single)[0]


@pytest.mark.usefixtures("empty_figures")
def test_the_hazard_written_back_is_a_tree_with_the_new_weights(tmp_path, curves):
    tree, folder = openquake_tree(tmp_path / "tree"), tmp_path / "out"
    asked = ["--age", "10000", "--json", "--ratio", "1.2"]
    document = json.loads(constrain(curves, *asked, "--hazard", tree, "--out", str(folder)).stdout)
    shutil.unpack_archive(folder / "openquake.zip", tmp_path / "openquake")
    (again,) = read_hazard(tmp_path / "openquake")
    assert len(list(folder.iterdir())) <= 12
    assert [branch.weight for branch in again.branches] == pytest.approx(
        [branch["posterior_weight"] for branch in document["branches"]], rel=1e-6
    )
    (first,) = read_hazard(Path(tree))
    for curve, other in zip(first.curves, again.curves, strict=True):
        np.testing.assert_allclose(curve.annual_rate, other.annual_rate, rtol=1e-5)
        np.testing.assert_allclose(curve.intensity, other.intensity, rtol=1e-6)
    page = (folder / "constraint.html").read_text()
    assert page.index("The 1e-4 PGV of the mean hazard falls from") < page.index("<nav>")


def test_several_rocks_have_a_common_fragility_with_the_spread_between_them(tmp_path, curves):
    other = str(write_curves(tmp_path / "other.json", [Lognormal("pgv_m_s", 1.5, 0.3)]))
    statement = statement_of(curves, other)["random_rock"]
    assert statement["median"] == pytest.approx(math.sqrt(1.2 * 1.5))
    between = math.log(1.5 / 1.2) / math.sqrt(2)
    assert statement["beta"] == pytest.approx(math.sqrt((0.4**2 + 0.3**2) / 2 + between**2))


@pytest.fixture
def rocks(tmp_path):
    return [
        write_curves(tmp_path / f"{name}.json", [Lognormal("pga_m_s2", median_g * G, 0.3)])
        for name, median_g in (("first", 0.5), ("second", 0.4))
    ]


@pytest.fixture
def events(tmp_path):
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
    return event_set(tmp_path / "calculation", fields, catalogue, weights, sites, **stated)


def test_factors_of_rates_and_of_the_mean_follow_from_the_branches_rates(rocks, events):
    """For a single age A: k = -ln(.05) / (nu A), and the mean's nu is the weighted mean of the branches'."""
    statement = statement_of(rocks[0], "--hazard", events, "--site", "aa", "--age", "300")
    for row in statement["branches"]:
        assert row["rate_factor"] == pytest.approx(-math.log(0.05) / (300 * row["toppling_rate"]))
        assert row["rate_factor_low"] < row["rate_factor"] < row["rate_factor_high"]
    mean = sum(row["prior_weight"] * row["toppling_rate"] for row in statement["branches"])
    assert statement["mean"]["survival"] == pytest.approx(math.exp(-300 * mean))
    assert statement["mean"]["rate_factor"] == pytest.approx(-math.log(0.05) / (300 * mean))
    low, high = sorted(row["scale_factor"] for row in statement["branches"])
    assert low < statement["mean"]["scale_factor"] < high


def test_rocks_that_survive_under_no_branch_are_named_and_their_rates_have_an_interval(rocks, events):
    given = (*rocks, "--hazard", events, "--site", "aa", "--age", "1000000")
    statement = statement_of(*given)
    assert [branch["survival"] for branch in statement["branches"]] == pytest.approx([0.0, 0.0], abs=1e-300)
    for single in (statement["mean"], *statement["branches"]):
        assert 0.0 < single["rate_factor_low"] < single["rate_factor"] < single["rate_factor_high"]
    text = constrain(*given)
    assert text.exit_code == 0
    assert "survive under no ground-motion model" in text.stdout


def test_the_scale_factor_is_where_survival_falls_to_five_per_cent(rocks, events):
    """Motions as much stronger, by --ratio, leave 5 %."""
    asked = [rocks[0], "--hazard", events, "--site", "aa", "--age", "300"]
    factor = statement_of(*asked)["branches"][0]["scale_factor"]
    assert statement_of(*asked, "--ratio", factor)["branches"][0]["survival"] == pytest.approx(0.05, abs=1e-3)


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
    (branch,) = statement_of(rock, "--hazard", table, *asked)["branches"]
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
    curve.write_text("PGA (g),annual_rate\n0.05,1e-2\n0.5,1e-4\n2,1e-6\n")
    alone = constrain(rocks[0], "--hazard", curve, "--age", "300", "--event-rate", "0.1")
    assert "--event-rate applies" in alone.output


def test_a_rock_that_eroded_is_constrained_between_a_buried_rock_and_an_exposed_rock(curves, hazards):
    asked = [curves, "--hazard", hazards[0], "--age", "12000"]
    options = ([], ["--fragile-since", "4000:1.5"], ["--fragile-since", "4000"])
    bare, less_fragile, buried = (statement_of(*asked, *more)["branches"][0]["survival"] for more in options)
    assert bare < less_fragile < buried
    # A power law of exponent 2: motions that topple 1.5 times stronger are 1.5^2 times rarer.
    assert math.log(less_fragile) / math.log(bare) == pytest.approx((4000 + 8000 / 1.5**2) / 12000, rel=0.01)


@pytest.mark.thorough
@pytest.mark.usefixtures("empty_figures")
def test_two_measures_at_once_are_judged_by_their_joint_rate(tmp_path):
    run = tmp_path / "run"
    run_in(run, rows(records=24, azimuths=(0.0, 90.0)))
    for name, measure, strongest in (("a", "pga_m_s2", 8.0), ("v", "pgv_m_s", 1.0)):
        lines = [f"{x},{1e-4 * (x / strongest) ** -2.5}" for x in np.geomspace(0.05, 8, 14) * strongest]
        (tmp_path / f"{name}.csv").write_text("\n".join([f"{measure},annual_rate", *lines]) + "\n")
    folder = tmp_path / "both"
    folder.mkdir()
    for name in ("a", "v"):
        (tmp_path / f"{name}.csv").rename(folder / f"{name}.csv")
    asked = [run, "--hazard", folder, "--age", "5000"]
    statement = statement_of(*asked, "--measure", "pga_m_s2+pgv_m_s", "--correlation", "0.6")
    assert len(statement["rocks"][0]["coefficients"]) == 3
    row = statement["branches"][0]
    assert row["survival_low"] < row["survival"] < row["survival_high"]
    assert {entry["measure"] for entry in statement["updated"]} == {"pga_m_s2", "pgv_m_s"}
    assert "joint rate" not in statement["intervals_carry"]
    unstated = statement_of(*asked, "--measure", "pga_m_s2+pgv_m_s")
    assert "joint rate" in unstated["intervals_carry"]
    known = statement_of(*asked, "--measure", "pga_m_s2+pgv_m_s", "--correlation", "0.733")
    wide, stated = (entry["branches"][0] for entry in (unstated, known))
    assert wide["survival"] == pytest.approx(stated["survival"])
    assert wide["survival_high"] - wide["survival_low"] > stated["survival_high"] - stated["survival_low"]

    list(write_fits(open_run(run).frame(), tmp_path, "run"))
    for suffix in (".csv", ".json"):
        asked[0] = tmp_path / "fits" / f"curves{suffix}"
        again = statement_of(*asked, "--measure", "pga_m_s2+pgv_m_s", "--correlation", "0.6")["branches"][0]
        number = {name for name, value in row.items() if isinstance(value, float)}
        assert {name: again[name] for name in number} == pytest.approx(
            {name: row[name] for name in number}, rel=1e-4
        )


@pytest.mark.usefixtures("empty_figures")
def test_the_events_with_their_new_weights_are_read_back_as_a_tree(rocks, events, tmp_path):
    out, asked = tmp_path / "out", ["--age", "300", "--ratio", "1.2"]
    statement_of(*rocks, "--hazard", events, *asked, "--site", "aa", "--site", "bb", "--out", out)
    shutil.unpack_archive(out / "openquake.zip", tmp_path / "two")
    assert (
        len((tmp_path / "two" / "hazard_curve-mean-PGA.csv").read_text().splitlines()) == 4
    )  # two of them sites
    statement = statement_of(rocks[0], "--hazard", events, *asked, "--site", "aa", "--out", out)
    shutil.unpack_archive(out / "openquake.zip", tmp_path / "one")
    again = statement_of(rocks[0], "--hazard", tmp_path / "one", *asked)
    for row, before in zip(again["branches"], statement["branches"], strict=True):
        assert row["prior_weight"] == pytest.approx(before["posterior_weight"], rel=1e-6)
    rates, found = (
        [
            row[name]
            for row, full in zip(entry["updated"], statement["updated"], strict=True)
            if full["rate_posterior_mean"]
        ]
        for entry, name in ((statement, "rate_posterior_mean"), (again, "rate_prior_mean"))
    )
    assert len(rates) > 10
    assert found == pytest.approx(rates, rel=0.05)


def test_a_spectral_acceleration_of_any_period_has_its_hazard(tmp_path):
    rock = write_curves(tmp_path / "rock.csv", [Lognormal("sa_3s_m_s2", 2.0, 0.3)])
    curve = tmp_path / "hazard.csv"
    curve.write_text("SA(3.0) (g),annual_rate\n0.05,1e-2\n0.2,1e-3\n1,1e-5\n")
    fields = tmp_path / "fields.csv"
    fields.write_text("event_id,SA(3.0) (g),annual_rate\n0,0.1,1e-3\n1,0.4,1e-4\n")
    for hazard in (curve, fields):
        for measure in ([], ["--measure", "sa_3s_m_s2"]):
            statement = statement_of(rock, "--hazard", hazard, "--age", "300", *measure)
            assert statement["measure"] == "sa_3s_m_s2"


@pytest.mark.parametrize(("other", "spread"), [("1.1e-5", True), ("1.0001e-5", False)])
def test_an_interval_over_branches_is_printed_where_its_ends_differ(tmp_path, other, spread):
    rock = write_curves(tmp_path / "rock.csv", [Lognormal("pga_m_s2", 2.0, 0.3)])
    for name, rate in (("a", "1e-5"), ("b", other)):
        (tmp_path / f"{name}.csv").write_text(f"PGA (g),annual_rate\n0.05,1e-2\n0.2,1e-3\n1,{rate}\n")
    branches = [part for name in "ab" for part in ("--hazard", f"{tmp_path / name}.csv=0.5")]
    text = constrain(rock, *branches, "--age", "300").stdout
    assert "of the mean hazard stays at" in text
    assert ("(5-95 %: " in text) == spread
