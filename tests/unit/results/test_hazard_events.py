"""Event sets: read as OpenQuake, CyberShake and others write them, and rocks under them."""

import math
import re

import numpy as np
import pandas as pd
import pytest
from hazard_samples import event_set
from refusals import refused
from scipy.stats import norm

from toppling.models.motions.measures import STANDARD_G_M_S2 as G
from toppling.results.analysis.lognormal import Lognormal
from toppling.results.drawing.hazard_figures import events_figure
from toppling.results.hazard.ages import exposure, joint_ages, parse_age
from toppling.results.hazard.events import EventBranch, EventSet, EventSite, Standing
from toppling.results.hazard.readers import read_hazard
from toppling.results.hazard.readers.event_sets import is_event_set, read_events
from toppling.results.hazard.survival import any_topples, draws_of, survivals
from toppling.results.hazard.update import Update, leave_one_out, models_table

ROCK = Standing("rock", Lognormal("pga_m_s2", 0.5 * G, 0.3))


def write_calculation(folder, **stated):
    """Two branches of weights 0.75 and 0.25, three events at two sites, 2 sets of 50 years each."""
    stated = stated or {"investigation_time": 50.0, "ses_per_logic_tree_path": 2}
    fields = [
        "event_id,gmv_PGA,gmv_PGV,custom_site_id", "0,0.5,10,aa", "0,0.1,2,bb", "1,0.8,30,aa", "2,0.2,5,bb",
    ]  # fmt: skip
    catalogue = ["0,0,0,3,1", "1,1,0,9,1", "2,2,1,7,2"]
    sites = {"aa": (1.0, 2.0), "bb": (1.5, 2.0)}
    return event_set(folder, fields, catalogue, {"A~AA": 0.75, "A~BB": 0.25}, sites, **stated)


def a_set(*branches, sites=2):
    return EventSet(tuple(EventSite(str(number)) for number in range(sites)), branches, "made here")


def survival(rocks, branch, stood):
    return survivals(rocks, a_set(branch), stood)[0]


def a_branch(seed, name="branch", events=60, rate=1e-3, strength=3.0, sites=2, weight=1.0):
    pga = strength * np.random.default_rng(seed).lognormal(0, 0.8, (events, sites))
    return EventBranch(name, np.full(events, rate), {"pga_m_s2": pga}, weight, name)


def test_an_event_has_the_rate_of_its_branchs_own_time(tmp_path):
    events = read_events(write_calculation(tmp_path))
    assert events.years == 100.0
    assert [branch.rate.tolist() for branch in events.branches] == [[0.01, 0.01], [0.01]]
    assert [branch.model for branch in events.branches] == ["AA", "BB"]
    assert events.sites == (EventSite("aa", (1.0, 2.0)), EventSite("bb", (1.5, 2.0)))
    assert is_event_set(tmp_path)
    # One set of events lasts the investigation time.
    assert read_events(write_calculation(tmp_path, investigation_time=30.0)).years == 30.0


def test_a_missing_row_of_a_field_is_no_motion(tmp_path):
    first, second = read_events(write_calculation(tmp_path)).branches
    assert first.motions["pga_m_s2"] == pytest.approx(np.array([[0.5, 0.1], [0.8, 0.0]]) * G)
    assert second.motions["pgv_m_s"] == pytest.approx(np.array([[0.0, 0.05]]))


def test_a_table_may_have_several_sites(tmp_path):
    path = tmp_path / "events.csv"
    path.write_text(
        "event_id,site_id,annual_rate,PGA (g),pgv_m_s\n1,a,1e-3,0.5,0.2\n1,b,1e-3,0.1,0.1\n2,a,1e-4,1,1\n"
    )
    events = read_events(path)
    (branch,) = events.branches
    assert branch.rate.tolist() == [1e-3, 1e-4]
    assert branch.motions["pga_m_s2"] == pytest.approx(np.array([[0.5, 0.1], [1.0, 0.0]]) * G)


@pytest.mark.parametrize(
    ("read", "text", "code"),
    [
        (read_events, "event_id,PGA (g),annual_rate\n", "events.empty"),
        (read_events, "event_id,PGA (g),annual_rate\n0,0.2,-1e-3\n", "events.rates_unusable"),
        (read_events, "event_id,PGA (g),annual_rate\n0,0.2,abc\n", "events.rates_unusable"),
        (read_events, "event_id,pga_m_s2,PGA (g),annual_rate\n0,0.2,0.3,1e-3\n", "events.measure_repeated"),
        (read_events, "event_id,annual_rate,PGA\n0,1e-3,0.5\n", "events.unit_missing"),
        (read_events, "event_id,rlz_id,annual_rate,PGA (g)\n0,0,1e-3,0.5\n", "events.branch_in_table"),
        (read_hazard, "event_id,return_period,PGA (g)\n1,1000,0.5\n2,2000,0.7\n", "hazard.is_of_events"),
        (read_hazard, "event_id,annual_rate,ln PGA (g)\n1,1000,0.5\n2,2000,0.7\n", "hazard.is_of_events"),
    ],
)
def test_a_table_without_rates_or_motions_of_events_is_refused(tmp_path, read, text, code):
    (tmp_path / "events.csv").write_text(text)
    with refused(code):
        read(tmp_path / "events.csv")


@pytest.mark.parametrize(
    ("event", "site", "branch"), [("eid", "sid", "rlzi"), ("event_id", "site_id", "rlz_id")]
)
def test_fields_of_earlier_versions_state_their_branch_themselves(tmp_path, event, site, branch):
    (tmp_path / "gmf-data.csv").write_text(f"{branch},{site},{event},gmv_PGA\n0,0,0,0.5\n1,0,0,0.7\n")
    (tmp_path / "realizations.csv").write_text("ordinal,branch_path,weight\n0,b1,0.5\n1,b2,0.5\n")
    (tmp_path / "sitemesh.csv").write_text("site_id,lon,lat\n0,1,2\n")
    events = read_events(tmp_path, catalogue_years=200)
    assert [branch.motions["pga_m_s2"][0, 0] / G for branch in events.branches] == pytest.approx([0.5, 0.7])
    assert events.branches[0].rate.tolist() == [0.005]


def test_files_of_another_calculation_are_distinguished_by_their_checksum(tmp_path):
    write_calculation(tmp_path)
    for path in list(tmp_path.glob("*.csv")):
        text = path.read_text().replace("checksum=7", "checksum=8")
        (tmp_path / path.name.replace("_1", "_2")).write_text(text)
    assert len(read_events(tmp_path / "gmf-data_2.csv").branches) == 2
    with refused("events.none_or_several", "2"):
        read_events(tmp_path)


@pytest.mark.parametrize(("want", "rate"), [({"event_rate": 1e-3}, 5e-4), ({"catalogue_years": 100}, 0.01)])
def test_a_scenario_and_a_catalogue_whose_time_no_file_states_ask_for_their_rate(tmp_path, want, rate):
    write_calculation(tmp_path, **({"unit": "g"} if "event_rate" in want else {}))
    if "event_rate" in want:  # every event is of the year 0
        events = (tmp_path / "events_1.csv").read_text()
        (tmp_path / "events_1.csv").write_text(re.sub(",[379],", ",0,", events))
    else:
        (tmp_path / "ruptures_1.csv").unlink()
    with refused("events.rate_missing"):
        read_events(tmp_path)
    assert read_events(tmp_path, **want).branches[0].rate.tolist() == [rate, rate]


@pytest.mark.parametrize(
    ("name", "old", "new", "what"),
    [
        ("gmf-data_1.csv", "0,0.5,", "0,-0.5,", "events.motion_negative"),
        ("gmf-data_1.csv", "0,0.5,", "0,,", "events.motion_negative"),
        ("gmf-data_1.csv", "0,0.5,", "0,abc,", "events.motion_negative"),
        ("realizations_1.csv", "A~AA,0.75\n1,A~BB,0.25", "A~AA,1.25\n1,A~BB,-0.25", "hazard.weights_sum"),
        ("realizations_1.csv", "0.75", "abc", "file.unreadable"),
        ("gmf-data_1.csv", "1,0.8,30,aa", "0,0.8,30,aa", "events.given_twice"),
        ("gmf-data_1.csv", "1,0.8", "9,0.8", "events.event_unknown"),
        ("gmf-data_1.csv", ",bb\n1", ",cc\n1", "site.unknown"),
        ("realizations_1.csv", "0.75", "0.85", "hazard.weights_sum"),
        ("realizations_1.csv", "1,A~BB,0.25\n", "", "events.branch_unknown"),
        ("gmf-data_1.csv", "gmv_PGA,gmv_PGV", "gmv_FOO,gmv_BAR", "events.no_measure"),
    ],
)  # fmt: skip
def test_contradictory_events_are_refused_with_the_contradiction(tmp_path, name, old, new, what):
    path = write_calculation(tmp_path) / name
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with refused(what):
        read_events(tmp_path)


def test_fields_without_the_file_that_states_their_branches_are_refused(tmp_path):
    (write_calculation(tmp_path) / "events_1.csv").unlink()
    with refused("events.branch_missing"):
        read_events(tmp_path)


def test_openquakes_event_set_gives_its_branches_rates_of_toppling_and_of_exceedance(tmp_path):
    events = read_events(write_calculation(tmp_path))
    rates = [any_topples([ROCK], branch.motions)[0] @ branch.rate for branch in events.branches]
    # Motions of 0.5 and 0.8 g in 100 years of the first branch, at the rock's median and above it.
    assert rates == pytest.approx([0.01 * (0.5 + norm.cdf(math.log(1.6) / 0.3)), 0.0])
    exceeded = [branch.rate @ (branch.motions["pgv_m_s"][:, 0] > 0.2) for branch in events.branches]
    assert exceeded == pytest.approx([0.01, 0.0])  # 30 cm/s once
    assert events.prior == pytest.approx([0.75, 0.25])


def test_a_cybershake_ruptures_probability_is_divided_over_its_variations(tmp_path):
    head = "Site_Name,Source_ID,Rupture_ID,Rupture_Variation_ID,Rupture_Probability,Period,Component,IM_Value,Units"
    rows = [
        f'"USC",{rupture},{variation},{p},2.0,"RotD50",{value},"cm per sec squared"'
        for rupture, variation, p, value in (
            ("12,0", 0, 7e-3, 11.5),
            ("12,0", 3, 7e-3, 14.5),
            ("14,1", 2, 1e-3, 99.0),
        )
    ]
    (tmp_path / "IMs.csv").write_text("\n".join([head, *rows]))
    (tmp_path / "counts.csv").write_text("Source_ID,Rupture_ID,Num_Rup_Vars\n12,0,5\n14,1,1\n")
    events = read_events(tmp_path)
    (branch,) = events.branches
    order = np.argsort(branch.motions["sa_2s_m_s2"][:, 0])
    assert branch.motions["sa_2s_m_s2"][order, 0] == pytest.approx([0.115, 0.145, 0.99])
    assert branch.rate[order] == pytest.approx([-math.log1p(-7e-3) / 5] * 2 + [-math.log1p(-1e-3)])
    assert any("3 variations" in note for note in events.notes)


def test_survival_is_that_of_poisson_events_over_every_rocks_own_age():
    """Both rocks stand for 120 years, the old one alone for 180 more; each is toppled by chance of its own."""
    branch = a_branch(1, events=12, rate=2e-3, strength=4.0)
    rocks = [
        Standing("old", Lognormal("pga_m_s2", 9.0, 0.4), 0),
        Standing("young", Lognormal("pga_m_s2", 6.0, 0.4), 1),
    ]
    old, young = (rock.fragility.probability(branch.motions["pga_m_s2"][:, rock.site]) for rock in rocks)
    exponent = branch.rate @ (120.0 * (1 - (1 - old) * (1 - young)) + 180.0 * old)
    out = survival(rocks, branch, exposure(np.array([[300.0, 120.0]])))
    assert out == pytest.approx(math.exp(-exponent))


def test_the_model_under_which_all_rocks_stand_is_ranked_first():
    events = a_set(
        a_branch(5, "strong", strength=4.0, weight=0.7), a_branch(5, "weak", strength=1.0, weight=0.3)
    )
    rocks = [ROCK, Standing("other", ROCK.fragility, 1)]
    once = exposure(joint_ages([parse_age("50")] * 2))
    update = Update(rocks, events, once)
    ranked = update.branches
    assert ranked["survival"].tolist() == sorted(ranked["survival"])
    joint = ranked["prior_weight"] * ranked["survival"]
    assert ranked["posterior_weight"].tolist() == pytest.approx((joint / joint.sum()).tolist())
    models = models_table(update)
    assert models["model"][0] == "weak"
    assert models["prior_weight"] @ models["bayes_factor"] == pytest.approx(1.0)


@pytest.mark.thorough
def test_a_rate_of_exceedance_is_stated_where_ten_events_support_it():
    branches = [a_branch(n, str(n), events=50, rate=1 / 500, strength=0.3 * (1 + n % 3)) for n in range(10)]
    update = Update([ROCK], a_set(*branches), exposure(joint_ages([parse_age("50")])))
    (first,) = update.exceedances
    felt = np.sort(np.concatenate([branch.motions["pga_m_s2"][:, 0] for branch in branches]))[::-1]
    assert set(first.levels) <= set(felt)  # order statistics
    known = first.statistics(update.events.prior)
    mean, median = known.mean, known.fractiles[0.5]
    assert np.nanmin(median) == pytest.approx(10 / 500)  # a fractile is one branch's
    reached = np.array([(felt >= level).sum() for level in first.levels])
    np.testing.assert_allclose(mean[reached >= 10], reached[reached >= 10] / 5000)
    assert np.isnan(mean[reached < 10]).all()
    stated = update.changes["level_prior_mean"].notna()
    assert (stated == (update.changes["annual_rate"] >= 1 / 475)).all()


@pytest.mark.parametrize("rates", [(math.nan, math.nan), (0.0, 0.0), (1e-3, 1e-4)])
def test_a_site_of_which_no_rate_is_stated_has_no_panel(rates):
    share = {f"survival{end}": [0.9] for end in ("", "_low", "_high")}
    branches = pd.DataFrame({"name": ["b"], "prior_weight": [1.0], "posterior_weight": [1.0], **share})
    kinds = {
        f"rate_{time}_{kind}": rates for time in ("prior", "posterior") for kind in ("mean", "p05", "p95")
    }
    at = {"site": ["s", "s"], "measure": ["pgv_m_s", "pgv_m_s"], "level": [0.1, 0.2]}
    panels = len(events_figure(branches, pd.DataFrame({**at, **kinds}), 0.95).axes)
    assert panels == (1 if not rates[0] > 0 else 2)


def test_a_rock_left_out_is_predicted_by_the_branches_as_the_others_weigh_them():
    events = a_set(a_branch(6, "strong", strength=4.0), a_branch(6, "weak", strength=1.5))
    rocks = [ROCK, Standing("other", ROCK.fragility, 1)]
    once = exposure(joint_ages([parse_age("50")] * 2))
    table = leave_one_out(Update(rocks, events, once))
    left = table[table["left_out"] == "other"]
    alone = exposure(joint_ages([parse_age("50")]))
    survivals = np.array([survival([ROCK], branch, alone) for branch in events.branches])
    both = np.array([survival(rocks, branch, once) for branch in events.branches])
    assert left["survival_of_others"].tolist() == pytest.approx(survivals.tolist())
    assert left["survival_predicted"].iloc[0] == pytest.approx(both.sum() / survivals.sum())


def test_events_drawn_anew_vary_as_poisson_counts_do():
    """For a single level of motion the rate is a count over a time, with the relative spread 1 / sqrt(count)."""
    pga = np.full((400, 1), 0.5 * G)
    branches = [EventBranch("many", np.full(400, 1e-4), {"pga_m_s2": pga}) for _ in range(10)]
    once = exposure(joint_ages([parse_age("50")]))
    drawn = draws_of([ROCK], a_set(*branches), once, 0.05).topplings[:, :-1] / 50
    assert drawn.mean() == pytest.approx(0.02, rel=0.01)
    assert drawn.std() / drawn.mean() == pytest.approx(1 / math.sqrt(400), rel=0.1)
