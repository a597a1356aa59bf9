"""Weights of bases, by how often the rock stood on each what it is known to have stood."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from seeded import row, rows
from test_spread import run as spread_rows

from toppling.models.errors import InputError
from toppling.orchestrator.cli import cli
from toppling.results.fits import answered
from toppling.results.fragility import PLANES, cells, effective_records
from toppling.results.regression import fit
from toppling.results.resampling import bootstrap
from toppling.results.run import open_run
from toppling.results.spread import spreads
from toppling.results.stood import FILE, FOLDER, Motion, Stood, told_of, unweighed, weighed, weights_of
from toppling.results.store import write_part

QUAKE = Motion("quake", "a" * 64, ("quake.AT2",), azimuths_known=True)
CONTACT = (1.0, 1.0, 0.0)


def stood(*weights, motion=QUAKE):
    each = np.array(weights, float)
    return Stood((motion,), 8, {CONTACT: each / each.mean()})


def shakes(stands, record="quake"):
    """Rows of shakes: of each base a list of whether the rock stood, or None."""
    table = [
        row(
            f"{record}-{base}-{number}", record_id=record, base=base, toppled=None if one is None else not one
        )
        for base, answers in enumerate(stands)
        for number, one in enumerate(answers)
    ]
    return pd.DataFrame(table).astype({"toppled": "boolean"})


def on_bases(count=2, **how):
    """Rows of a campaign, each on one of some bases in turn."""
    frame = pd.DataFrame(rows(**how)).astype({"toppled": "boolean"})
    return frame.assign(base=pd.array(np.arange(len(frame)) % count, "Int64"))


def test_a_weight_is_the_jeffreys_mean_of_standing_over_its_mean():
    weights = weights_of(shakes([[True] * 3 + [False], [False] * 4]), 2)[CONTACT]
    chance = np.array([3.5 / 5.0, 0.5 / 5.0])
    assert weights == pytest.approx(chance / chance.mean())


def test_over_motions_chances_are_multiplied_and_no_weight_becomes_0():
    one, many = shakes([[True] * 8, [False] * 8]), []
    for number in range(400):
        many.append(one.assign(record_id=f"quake {number}"))
    twice = weights_of(pd.concat(many[:2]), 2)[CONTACT]
    assert twice[0] / twice[1] == pytest.approx(17.0**2)
    assert (weights_of(pd.concat(many), 2)[CONTACT] > 0.0).all()


def test_a_base_without_an_answer_is_told_nothing_and_a_motion_without_any_is_refused():
    weights = weights_of(shakes([[True] * 4, [None] * 4, [True] * 4]), 3)[CONTACT]
    assert weights == pytest.approx([1.0, 1.0, 1.0])
    failed = shakes([[None] * 2]).assign(message="InputError: mujoco knows no such pedestal")
    with pytest.raises(InputError, match=r"none of 2 shakes with quake has an answer.*no such pedestal"):
        weights_of(failed, 1)


def test_weights_that_are_equal_leave_the_rows_as_they_are():
    frame = on_bases()
    assert weighed(frame, stood(1.0, 1.0)) is frame


def test_a_base_of_weight_2_counts_as_if_its_jobs_were_there_twice_in_cells_and_fits():
    frame = on_bases(records=12, levels=range(1, 16, 2))
    heavy = weighed(frame, stood(2.0, 1.0))
    copies = pd.concat([frame, frame[frame["base"] == 0]], ignore_index=True)
    plane = PLANES["pga_pgv"]
    assert cells(heavy, plane)["probability"].to_numpy() == pytest.approx(
        cells(copies, plane)["probability"].to_numpy()
    )
    ours, theirs = (fit(answered(one), ["pgv_m_s"]) for one in (heavy, copies))
    assert ours.coefficients == pytest.approx(theirs.coefficients, rel=1e-6)


def test_jobs_of_one_record_and_measure_on_unlike_bases_count_each_by_its_weight():
    frame = on_bases(records=12, levels=range(1, 16, 2), azimuths=(0.0,))
    twins = pd.concat(
        [frame.assign(base=0), frame.assign(base=1, toppled=~frame["toppled"])], ignore_index=True
    )
    nearly_one = weighed(twins, stood(1e9, 1.0))
    assert fit(answered(nearly_one), ["pgv_m_s"]).coefficients == pytest.approx(
        fit(answered(frame), ["pgv_m_s"]).coefficients, rel=1e-4
    )


def test_weights_within_records_leave_the_number_of_records_as_it_is():
    frame = weighed(on_bases(records=10), stood(1.9, 0.1)).assign(pool=0)
    effective = effective_records(frame.assign(weight=frame["record_weight"]), ["pool"])
    assert effective.iloc[0] == pytest.approx(10.0)


def test_the_nominal_scene_has_the_mean_weight():
    frame = on_bases()
    frame.loc[:9, "base"] = pd.NA
    found = weighed(frame, stood(1.5, 0.5))
    assert (found.loc[:9, "base_weight"] == 1.0).all()
    assert sorted(found["base_weight"].unique()) == pytest.approx([0.5, 1.0, 1.5])


def test_weights_of_bases_and_of_records_are_multiplied_and_come_apart_again():
    frame = on_bases(records=4)
    by_record = frame.assign(
        record_weight=frame["record_id"].map({f"R{n:03d}": 0.4 * (n + 1) for n in range(4)})
    )
    both = weighed(by_record, stood(1.5, 0.5))
    expected = by_record["record_weight"] * np.where(frame["base"] == 0, 1.5, 0.5)
    assert both["record_weight"].to_numpy() == pytest.approx(expected.to_numpy())
    assert unweighed(both)["record_weight"].to_numpy() == pytest.approx(by_record["record_weight"].to_numpy())
    assert "record_weight" not in unweighed(weighed(frame, stood(1.5, 0.5)))


def test_the_spread_counts_a_base_by_its_weight():
    frame = spread_rows(base=0.15)
    even = spreads(frame)
    odd = frame["base"] % 2 == 1
    halved = spreads(frame.assign(base_weight=np.where(odd, 1e-9, 2.0)))
    alone = spreads(frame[~odd])
    for column in ("probability", "records", "base", "left"):
        assert halved[column].to_numpy() == pytest.approx(alone[column].to_numpy(), rel=1e-5, abs=1e-6)
    pd.testing.assert_frame_equal(even, spreads(frame.assign(base_weight=3.0)))


def test_one_contact_does_not_lend_another_its_weights():
    frame = pd.concat([on_bases(), on_bases(friction=0.5)], ignore_index=True)
    other = (0.5, 0.5, 0.0)
    both = Stood((QUAKE,), 8, {CONTACT: np.array([1.5, 0.5]), other: np.array([0.5, 1.5])})
    found = weighed(frame, both)
    rough = found["friction_static"] == 1.0
    assert set(found[rough & (found["base"] == 0)]["base_weight"]) == {1.5}
    assert set(found[~rough & (found["base"] == 0)]["base_weight"]) == {0.5}
    with pytest.raises(InputError, match=r"no weights of the bases under friction 0\.5"):
        weighed(frame, stood(1.5, 0.5))


def test_weights_come_back_from_disk_and_a_flipped_bit_is_told(tmp_path):
    written = replace(stood(1.7, 0.3), shakes=8)
    written.write(tmp_path / FILE)
    read = Stood.read(tmp_path / FILE)
    assert read.motions == written.motions
    assert (read.weights[CONTACT] == written.weights[CONTACT]).all()
    content = bytearray((tmp_path / FILE).read_bytes())
    content[content.index(b"1.7") + 2] ^= 1
    (tmp_path / FILE).write_bytes(content)
    with pytest.raises(InputError, match="is damaged"):
        Stood.read(tmp_path / FILE)
    (tmp_path / FILE).write_text(json.dumps({"schema_version": 1, "contacts": [], "motions": []}))
    with pytest.raises(InputError, match="carries no digest"):
        Stood.read(tmp_path / FILE)


def test_a_motion_that_the_run_counts_is_not_counted_again():
    with pytest.raises(InputError, match="the run counts quake already"):
        stood(1.5, 0.5).refuse_twins([QUAKE])
    other = replace(QUAKE, sha="b" * 64)
    stood(1.5, 0.5).refuse_twins([other])
    joined = stood(1.5, 0.5).joined(stood(1.5, 0.5, motion=other))
    assert joined.weights[CONTACT] == pytest.approx([1.8, 0.2])


@pytest.fixture
def weighted_run(tmp_path):
    """Folder of a run on two bases: on base 1 the rock topples at once."""
    jobs = rows(records=24)
    for number, job in enumerate(jobs):
        job["base"] = number % 2
        if number % 2:
            job |= {"toppled": True, "outcome": "toppled", "topple_azimuth_deg": 90.0}
    (tmp_path / "run").mkdir()
    write_part(tmp_path / "run", jobs)
    (tmp_path / "run" / FOLDER).mkdir()
    return tmp_path / "run"


def test_every_reader_of_shares_refuses_weights_that_are_missing_or_damaged(weighted_run):
    verbs = (
        ["constrain", str(weighted_run)],
        ["fragility", str(weighted_run)],
        ["report", str(weighted_run)],
    )
    for verb in verbs:
        error = CliRunner().invoke(cli, verb).exception
        assert isinstance(error, InputError), verb
        assert "is not there" in str(error)
    path = weighted_run / FOLDER / FILE
    stood(17.0, 1.0).write(path)
    content = bytearray(path.read_bytes())
    content[-20] ^= 1
    path.write_bytes(content)
    for verb in (*verbs, ["query", str(weighted_run), "select 1"]):
        error = CliRunner().invoke(cli, verb).exception
        assert isinstance(error, InputError), verb
        assert "is damaged" in str(error)


def test_constraint_map_query_and_page_of_a_run_agree_on_its_weights(weighted_run):
    stood(17.0, 1.0).write(weighted_run / FOLDER / FILE)
    run = open_run(weighted_run)
    jobs = run.weighted(run.frame())
    told = json.loads(CliRunner().invoke(cli, ["constrain", str(weighted_run), "--json"]).stdout)
    fitted = fit(answered(jobs), ["pgv_m_s"])
    assert told["rocks"][0]["median"] == pytest.approx(fitted.lognormal.median)
    (base,) = told["stood"]
    assert base["effective_bases"] == pytest.approx(18.0**2 / (17.0**2 + 1.0))
    assert base["weights"] == pytest.approx({"0": 17.0 / 9.0, "1": 1.0 / 9.0})
    assert base["median_shift_percent"] > 5.0  # without what it stood, the weak base counts as much
    query = (
        "select level_pga_m_s2 l, sum(weight * toppled::int) / sum(weight) p from results join bases "
        "using (base, friction_static, friction_kinetic, restitution) group by all order by all"
    )
    asked = run.sql(query).to_pandas().set_index("l")["p"]
    for level, there in jobs.groupby("level_pga_m_s2"):
        share = (there["record_weight"] * there["toppled"]).sum() / there["record_weight"].sum()
        assert asked[level] == pytest.approx(share)
    words = CliRunner().invoke(cli, ["constrain", str(weighted_run)]).stdout
    assert "say as much as 1.1 equal ones; the heaviest has 94 % of the weight" in words
    assert told_of(run.stood(), jobs)["contacts"][0]["bases"] == 2


def test_bootstrap_samples_are_of_the_weighted_fit(weighted_run):
    stood(1e6, 1.0).write(weighted_run / FOLDER / FILE)
    run = open_run(weighted_run)
    jobs = answered(run.weighted(run.frame()))
    fitted = fit(jobs, ["pgv_m_s"])
    drawn = bootstrap(jobs, fitted, samples=40)
    medians = np.exp(-drawn.coefficients[:, 0] / drawn.coefficients[:, 1])
    assert medians.min() < fitted.lognormal.median < medians.max()


def test_stood_is_refused_for_a_file_of_curves(tmp_path):
    (tmp_path / "curve.json").write_text("{}")
    done = CliRunner().invoke(cli, ["constrain", str(tmp_path / "curve.json"), "--stood", str(tmp_path)])
    assert done.exit_code == 2
    assert "--stood applies to jobs of runs" in done.output
