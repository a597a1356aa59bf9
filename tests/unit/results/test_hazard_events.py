"""Event sets: read as OpenQuake, CyberShake and others write them, and rocks under them."""

import math

import numpy as np
import pytest
from scipy.stats import norm

from toppling.models.errors import InputError
from toppling.models.motions.measures import STANDARD_G_M_S2 as G
from toppling.results.analysis.lognormal import Lognormal
from toppling.results.hazard.ages import exposure, joint_ages, parse_age, parse_since
from toppling.results.hazard.events import EventBranch, EventSet, EventSite, Standing
from toppling.results.hazard.readers import read_hazard
from toppling.results.hazard.readers.event_sets import is_event_set, read_events
from toppling.results.hazard.survival import any_topples, draws_of, survivals
from toppling.results.hazard.update import Update, leave_one_out, models_table

ROCK = Standing("rock", Lognormal("pga_m_s2", 0.5 * G, 0.3))


def write_calculation(
    folder, header="#,\"generated_by='OpenQuake engine 3.26.2', checksum=7\"\n", times=None
):
    """Two branches of weights 0.75 and 0.25, three events at two sites, 2 sets of 50 years each."""
    times = "investigation_time=50.0, ses_per_logic_tree_path=2" if times is None else times
    (folder / "gmf-data_1.csv").write_text(
        header + "event_id,gmv_PGA,gmv_PGV,custom_site_id\n0,0.5,10,aa\n0,0.1,2,bb\n1,0.8,30,aa\n2,0.2,5,bb\n"
    )
    (folder / "events_1.csv").write_text(
        header + "event_id,rup_id,rlz_id,year,ses_id\n0,0,0,3,1\n1,1,0,9,1\n2,2,1,7,2\n"
    )
    (folder / "ruptures_1.csv").write_text(
        header.replace("checksum=7", f"checksum=7, {times}")
        + "rup_id,multiplicity,mag\n0,1,6\n1,1,7\n2,1,6\n"
    )
    (folder / "realizations_1.csv").write_text(
        header + "rlz_id,branch_path,weight\n0,A~AA,0.75\n1,A~BB,0.25\n"
    )
    (folder / "sitemesh_1.csv").write_text(header + "custom_site_id,lon,lat\naa,1.0,2.0\nbb,1.5,2.0\n")
    return folder


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


def test_mean_fields_beside_the_fields_are_no_second_set(tmp_path):
    """`avg_gmf`, which engine 3.25 exports beside `gmf-data`, has sites and no events."""
    write_calculation(tmp_path)
    alone = read_events(tmp_path)
    mean = tmp_path / "avg_gmf_1.csv"
    mean.write_text("custom_site_id,lon,lat,gmv_PGA,gsd_PGA\naa,1.0,2.0,.05,2.1\n")
    together = read_events(tmp_path)
    for one, other in zip(alone.branches, together.branches, strict=True):
        assert one.motions["pga_m_s2"].tolist() == other.motions["pga_m_s2"].tolist()
    assert not is_event_set(mean)


def test_a_missing_row_of_a_field_is_no_motion(tmp_path):
    first, second = read_events(write_calculation(tmp_path)).branches
    assert first.motions["pga_m_s2"] == pytest.approx(np.array([[0.5, 0.1], [0.8, 0.0]]) * G)
    assert second.motions["pgv_m_s"] == pytest.approx(np.array([[0.0, 0.05]]))


@pytest.mark.parametrize(
    ("name", "sign", "head"), [("a.csv", ",", "# mine\n# more\n"), ("a.csv", ";", ""), ("a.tsv", "\t", "")]
)
def test_a_table_of_events_may_be_parted_by_other_signs_below_remarks(tmp_path, name, sign, head):
    lines = "event_id,PGA,annual_rate\n0,0.2,1e-3\n1,0.1,2e-3\n".replace(",", sign)
    (tmp_path / name).write_text(head + lines)
    assert is_event_set(tmp_path / name)
    (branch,) = read_events(tmp_path / name).branches
    assert branch.motions["pga_m_s2"][:, 0] / G == pytest.approx([0.2, 0.1])
    assert branch.rate.tolist() == [1e-3, 2e-3]


@pytest.mark.parametrize("rows", ["", "0,0.2,-1e-3\n", "0,0.2,abc\n"])
def test_a_table_without_events_or_with_rates_that_are_none_is_refused(tmp_path, rows):
    (tmp_path / "a.csv").write_text("event_id,PGA,annual_rate\n" + rows)
    with pytest.raises(InputError, match=r"holds no event|has rates that are negative"):
        read_events(tmp_path / "a.csv")


def test_a_table_that_states_a_measure_twice_is_refused(tmp_path):
    (tmp_path / "a.csv").write_text("event_id,PGA,PGA (g),annual_rate\n0,0.2,0.3,1e-3\n")
    with pytest.raises(InputError, match="in two columns"):
        read_events(tmp_path / "a.csv")


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


def test_a_site_name_that_the_engine_cut_finds_its_place(tmp_path):
    write_calculation(tmp_path)
    for name in ("gmf-data_1.csv", "sitemesh_1.csv"):
        text = (tmp_path / name).read_text()
        (tmp_path / name).write_text(text.replace("aa", "balanced" + ("-rock" if "mesh" in name else "")))
    events = read_events(tmp_path)
    assert events.sites[0] == EventSite("balanced-rock", (1.0, 2.0))
    assert events.branches[0].motions["pga_m_s2"][0, 0] == pytest.approx(0.5 * G)


def test_files_of_another_calculation_are_told_apart_by_their_checksum(tmp_path):
    write_calculation(tmp_path)
    for path in list(tmp_path.glob("*.csv")):
        text = path.read_text().replace("checksum=7", "checksum=8")
        (tmp_path / path.name.replace("_1", "_2")).write_text(text)
    assert len(read_events(tmp_path / "gmf-data_2.csv").branches) == 2
    with pytest.raises(InputError, match="2 event sets"):
        read_events(tmp_path)


def test_a_scenario_states_no_rate_and_asks_for_one(tmp_path):
    write_calculation(tmp_path, times="")
    events = (tmp_path / "events_1.csv").read_text()
    for year in (",3,", ",9,", ",7,"):
        events = events.replace(year, ",0,")
    (tmp_path / "events_1.csv").write_text(events)
    with pytest.raises(InputError, match="--event-rate"):
        read_events(tmp_path)
    assert read_events(tmp_path, event_rate=1e-3).branches[0].rate.tolist() == [5e-4, 5e-4]


def test_a_catalogue_whose_time_no_file_states_asks_for_it(tmp_path):
    write_calculation(tmp_path)
    (tmp_path / "ruptures_1.csv").unlink()
    with pytest.raises(InputError, match="--catalogue-years"):
        read_events(tmp_path)
    assert read_events(tmp_path, catalogue_years=100).branches[0].rate.tolist() == [0.01, 0.01]


@pytest.mark.parametrize(
    ("name", "old", "new", "what"),
    [
        ("gmf-data_1.csv", "0,0.5,", "0,-0.5,", "motion of -0.5"),
        ("gmf-data_1.csv", "0,0.5,", "0,,", "motion of nan"),
        ("gmf-data_1.csv", "0,0.5,", "0,abc,", "motion of nan"),
        (
            "realizations_1.csv",
            "A~AA,0.75\n1,A~BB,0.25",
            "A~AA,1.25\n1,A~BB,-0.25",
            "the least of them -0.25",
        ),
        ("realizations_1.csv", "0.75", "abc", "cannot be read"),
        ("gmf-data_1.csv", "1,0.8,30,aa", "0,0.8,30,aa", "twice"),
        ("gmf-data_1.csv", "1,0.8", "9,0.8", "event 9"),
        ("gmf-data_1.csv", ",bb\n1", ",cc\n1", "site cc"),
        ("realizations_1.csv", "0.75", "0.85", "sum to 1.1"),
        ("realizations_1.csv", "1,A~BB,0.25\n", "", "lacks the branch 1"),
        ("gmf-data_1.csv", "gmv_PGA,gmv_PGV", "gmv_FOO,gmv_BAR", "no measure"),
    ],
)
def test_events_that_contradict_each_other_are_refused_by_what_is_wrong(tmp_path, name, old, new, what):
    path = write_calculation(tmp_path) / name
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=what):
        read_events(tmp_path)


def test_a_plain_table_of_events_states_rates_and_measures(tmp_path):
    table = tmp_path / "events.csv"
    table.write_text(
        "event_id,site_id,annual_rate,PGA,pgv_m_s\n1,a,1e-3,0.5,0.2\n1,b,1e-3,0.1,0.1\n2,a,1e-4,1,1\n"
    )
    events = read_events(table)
    (branch,) = events.branches
    assert branch.rate.tolist() == [1e-3, 1e-4]
    assert branch.motions["pga_m_s2"] == pytest.approx(np.array([[0.5, 0.1], [1.0, 0.0]]) * G)


@pytest.mark.parametrize(("header", "said"), [("PGA", "names no unit"), ("PGA (cm/s2)", None)])
def test_motions_without_a_unit_that_are_in_gal_are_refused(tmp_path, header, said):
    """Under 'PGA' alone 200 cm/s2 would be 200 g, and every event would topple every rock."""
    path = tmp_path / "events.csv"
    rows = "".join(f"{n},{1e-3},{100 + n}\n" for n in range(20))
    path.write_text(f"event_id,annual_rate,{header}\n{rows}")
    if said is None:
        assert read_events(path).branches[0].motions["pga_m_s2"].max() == pytest.approx(1.19)
        return
    with pytest.raises(InputError, match=said):
        read_events(path)


@pytest.mark.parametrize(
    "content",
    [
        "event_id;annual_rate;PGA (g)\n1;1E-03;0,5\n2;0,0002;0,25\n",
        "Event_ID,Annual_Rate,PGA (g)\n1,1E-03,0.5\n2,0.0002,0.25\n",
        "event_id\tannual_rate\tPGA (g)\n1\t1E-03\t0.5\n2\t0.0002\t0.25\n",
    ],
)
def test_events_are_the_same_however_a_spreadsheet_writes_them(content, tmp_path):
    path = tmp_path / "events.csv"
    path.write_text(content)
    assert is_event_set(path)
    (branch,) = read_events(path).branches
    np.testing.assert_allclose(branch.rate, [1e-3, 2e-4])
    np.testing.assert_allclose(branch.motions["pga_m_s2"][:, 0], [0.5 * G, 0.25 * G])


def test_motions_of_which_a_tenth_exceed_3_g_are_in_m_s2_and_others_are_told(tmp_path):
    path = tmp_path / "events.csv"
    rows = "".join(f"{n},1e-3,{{}}\n" for n in range(20))
    path.write_text("event_id,annual_rate,PGA\n" + rows.replace("{}", "4.2"))
    with pytest.raises(InputError, match=r"PGA \(m/s2\)"):
        read_events(path)
    path.write_text("event_id,annual_rate,PGA\n" + rows.replace("{}", "0.42"))
    assert any("taken to be in g: 0.42 g" in note for note in read_events(path).notes)


@pytest.mark.parametrize("header", ["event_id,return_period,PGA (g)", "event_id,annual_rate,ln PGA (g)"])
def test_events_without_rates_or_measures_are_no_curve(header, tmp_path):
    path = tmp_path / "events.csv"
    path.write_text(f"{header}\n1,1000,0.5\n2,2000,0.7\n")
    with pytest.raises(InputError, match="is of events") as refused:
        read_hazard(path)
    assert "annual_rate and measures" in refused.value.remedy


def test_a_hazard_curve_is_no_set_of_events(tmp_path):
    curve = tmp_path / "curve.csv"
    curve.write_text("PGA,annual_rate\n0.1,1e-3\n0.2,1e-4\n")
    assert not is_event_set(curve)
    assert is_event_set(write_calculation(tmp_path))


def test_openquakes_event_set_gives_its_branches_rates_of_toppling_and_of_exceedance(tmp_path):
    events = read_events(write_calculation(tmp_path))
    rates = [any_topples([ROCK], branch.motions)[0] @ branch.rate for branch in events.branches]
    # Motions of 0.5 and 0.8 g in 100 years of the first branch, at the rock's median and above it.
    assert rates == pytest.approx([0.01 * (0.5 + norm.cdf(math.log(1.6) / 0.3)), 0.0])
    exceeded = [branch.rate @ (branch.motions["pgv_m_s"][:, 0] > 0.2) for branch in events.branches]
    assert exceeded == pytest.approx([0.01, 0.0])  # 30 cm/s once
    assert events.prior == pytest.approx([0.75, 0.25])


def test_fields_of_the_oldest_layout_are_one_branch_of_a_scenario(tmp_path):
    (tmp_path / "gmf-data.csv").write_text("eid,sid,gmv_PGA\n0,0,0.0129\n0,1,0.2\n1,0,0.3\n1,1,0.4\n")
    (tmp_path / "sitemesh.csv").write_text("site_id,lon,lat\n0,-118.6,31.9\n1,-118.5,32.0\n")
    events = read_events(tmp_path, event_rate=1e-3)
    (branch,) = events.branches
    assert branch.motions["pga_m_s2"] / G == pytest.approx(np.array([[0.0129, 0.2], [0.3, 0.4]]))
    assert branch.rate.tolist() == [5e-4, 5e-4]
    assert events.sites[0].place == (-118.6, 31.9)


def test_a_catalogue_of_one_set_of_events_lasts_the_investigation_time(tmp_path):
    assert read_events(write_calculation(tmp_path, times="investigation_time=30.0")).years == 30.0


def test_a_cybershake_rupture_shares_its_probability_over_its_variations(tmp_path):
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


def test_one_event_topples_with_its_fragility():
    one = EventBranch("one", np.array([1e-3]), {"pga_m_s2": np.array([[0.5 * G]])})
    assert any_topples([ROCK], one.motions)[0] @ one.rate == pytest.approx(0.5e-3)
    told = survival([ROCK], one, exposure(joint_ages([parse_age("2000")])))
    assert told == pytest.approx(math.exp(-1.0))


def test_rocks_that_feel_the_same_events_survive_more_often_than_independent_ones():
    branch, once = a_branch(0), exposure(joint_ages([parse_age("20")]))
    both = exposure(joint_ages([parse_age("20")] * 2))
    twin = Standing("twin", ROCK.fragility)
    alone = survival([ROCK], branch, once)
    assert alone**2 < survival([ROCK, twin], branch, both) < alone


def test_survival_is_the_share_of_simulated_histories_in_which_all_rocks_stand():
    """Brute force: Poisson events over each rock's own age, each toppling each rock by chance."""
    branch = a_branch(1, events=12, rate=2e-3, strength=4.0)
    rocks = [
        Standing("old", Lognormal("pga_m_s2", 9.0, 0.4), 0),
        Standing("young", Lognormal("pga_m_s2", 6.0, 0.4), 1),
    ]
    years = np.array([300.0, 120.0])
    told = survival(rocks, branch, exposure(years[None, :]))
    random = np.random.default_rng(2)
    histories, standing = 20_000, 0
    shares = np.array(
        [rock.fragility.probability(branch.motions["pga_m_s2"][:, rock.site]) for rock in rocks]
    )
    for _ in range(histories):
        count = random.poisson(branch.rate.sum() * years.max())
        which = random.integers(0, 12, count)
        ago = random.uniform(0, years.max(), count)
        fell = (random.random((2, count)) < shares[:, which]) & (ago < years[:, None])
        standing += not fell.any()
    share = standing / histories
    assert told == pytest.approx(share, abs=3 * math.sqrt(share * (1 - share) / histories))


def test_a_rock_that_was_stouter_topples_less_often_before():
    branch = a_branch(4)
    plain = exposure(joint_ages([parse_age("50")]))
    since = parse_since("20:1.5")
    late = exposure(joint_ages([parse_age("50")]), [since])
    rock = Standing("rock", ROCK.fragility, since=since)
    young = exposure(joint_ages([parse_age("20")]))
    assert survival([ROCK], branch, plain) < survival([rock], branch, late) < survival([ROCK], branch, young)


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
    """One level of motion: the rate is a count over a time, with the relative spread 1 / sqrt(count)."""
    pga = np.full((400, 1), 0.5 * G)
    branches = [EventBranch("many", np.full(400, 1e-4), {"pga_m_s2": pga}) for _ in range(10)]
    once = exposure(joint_ages([parse_age("50")]))
    drawn = draws_of([ROCK], a_set(*branches), once, 0.05).topplings[:, :-1] / 50
    assert drawn.mean() == pytest.approx(0.02, rel=0.01)
    assert drawn.std() / drawn.mean() == pytest.approx(1 / math.sqrt(400), rel=0.1)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "latin-1"])
def test_a_table_of_events_says_the_same_in_any_encoding(encoding, tmp_path):
    rows = "".join(f"{at},{1e-3 / (at + 1)},0.{at + 1},Sévérac\n" for at in range(8))
    plain, other = tmp_path / "plain.csv", tmp_path / "other.csv"
    plain.write_text(f"event_id,annual_rate,PGA,fault\n{rows}".replace("é", "e"))
    other.write_bytes(f"event_id,annual_rate,PGA,fault\n{rows}".encode(encoding))
    assert is_event_set(other)
    found, expected = (read_events(path).branches[0] for path in (other, plain))
    np.testing.assert_array_equal(found.rate, expected.rate)
    np.testing.assert_array_equal(found.motions["pga_m_s2"], expected.motions["pga_m_s2"])
