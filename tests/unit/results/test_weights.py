"""Weights of bases by what the rock stood: found, read, written, and counted by."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from reference.idealised import ricker
from refusals import refused
from seeded import row, rows
from small_campaigns import run_in

from toppling.models.hidden_base.unseen_base import BaseDraw, UnseenBase, draw_of
from toppling.models.motions.record import Record
from toppling.models.scene import Scene
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.cli import cli
from toppling.orchestrator.recorded import SHAKES, Recorded
from toppling.orchestrator.studies import conditioning
from toppling.orchestrator.studies.conditioning import by_evidence, joined, weights_by_contact
from toppling.results.analysis.fits import answered
from toppling.results.analysis.lognormal import fit
from toppling.results.reader import open_run
from toppling.results.weights import WEIGHTS_FILE, Weights, unweighted_rows, weighted_rows

CONTACT = (1.0, 1.0, 0.0)


def weights_of(*weights):
    entry = np.array(weights, float)
    return Weights({CONTACT: entry / entry.mean()}, "the rock stood quake", evidence={"shakes": 8})


def on_bases(count=2, **how):
    frame = pd.DataFrame(rows(**how)).astype({"toppled": "boolean"})
    return frame.assign(base=pd.array(np.arange(len(frame)) % count, "Int64"))


@pytest.mark.parametrize("azimuths_deg", [(0.0, 90.0), None])
def test_every_base_is_shaken_equally_often_and_from_all_sides_where_orientations_are_unknown(
    azimuths_deg, tmp_path, monkeypatch
):
    feet = [
        np.array([[x, y, 0.0] for x in (-w, w) for y in (-0.2, 0.2)]) for w in np.linspace(0.06, 0.15, 16)
    ]
    bases = UnseenBase(0.05, tuple(BaseDraw(v) for v in feet))
    replace(Scene.block(0.15, 0.2, 0.6), unseen=bases).save(tmp_path / "scene")
    given = [
        Record.of(f"P{n}", ricker(2.0, 1.0 + n, 0.01), component_azimuths_deg=azimuths_deg) for n in range(2)
    ]
    recorded = Recorded(tuple(given), ("P0", "P1"))
    recorded.write(tmp_path / "stood")
    campaign = Campaign.of(
        {"scene": "scene", "ensemble": "none", "pga_m_s2": [2.0], "azimuth_deg": [0.0], "friction": [0.9]},
        tmp_path,
    )
    shaken = {}

    def shake(planned, folder):
        jobs = planned.jobs.to_pandas()
        base = [draw_of(number, len(feet)) for number in jobs["realisation"]]
        shaken[folder] = jobs.rename(columns={"pga_m_s2": "level_pga_m_s2"}).assign(base=base, toppled=False)

    monkeypatch.setattr(
        conditioning, "open_run", lambda folder: SimpleNamespace(frame=lambda: shaken[folder])
    )
    conditioning.weigh(campaign, recorded, tmp_path / "stood", shake)
    jobs = pd.concat(shaken.values())
    assert not jobs["job_id"].duplicated().any()
    for _, of_base in jobs.groupby(["record_id", "base"]):
        assert len(of_base) == SHAKES
        assert of_base["azimuth_deg"].nunique() == (1 if azimuths_deg else SHAKES)
    assert jobs.groupby("record_id")["base"].nunique().tolist() == [len(feet)] * 2


def test_jobs_of_a_record_on_unlike_bases_count_by_their_weights():
    frame = on_bases(records=12, levels=range(1, 16, 2), azimuths=(0.0,))
    twins = pd.concat(
        [frame.assign(base=0), frame.assign(base=1, toppled=~frame["toppled"])], ignore_index=True
    )
    nearly_one = weighted_rows(twins, weights_of(1e9, 1.0))
    assert fit(answered(nearly_one), ["pgv_m_s"]).coefficients == pytest.approx(
        fit(answered(frame), ["pgv_m_s"]).coefficients, rel=1e-4
    )


def test_weights_of_bases_and_of_records_are_multiplied_and_come_apart_again():
    frame = on_bases(records=4)
    by_record = frame.assign(
        record_weight=frame["record_id"].map({f"R{n:03d}": 0.4 * (n + 1) for n in range(4)})
    )
    both = weighted_rows(by_record, weights_of(1.5, 0.5))
    expected = by_record["record_weight"] * np.where(frame["base"] == 0, 1.5, 0.5)
    assert both["record_weight"].to_numpy() == pytest.approx(expected.to_numpy())
    assert unweighted_rows(both)["record_weight"].to_numpy() == pytest.approx(
        by_record["record_weight"].to_numpy()
    )
    assert "record_weight" not in unweighted_rows(weighted_rows(frame, weights_of(1.5, 0.5)))


def test_weights_of_a_contact_do_not_apply_to_another():
    frame = pd.concat([on_bases(), on_bases(friction=0.5)], ignore_index=True)
    other = (0.5, 0.5, 0.0)
    both = Weights({CONTACT: np.array([1.5, 0.5]), other: np.array([0.5, 1.5])}, "the rock stood quake")
    found = weighted_rows(frame, both)
    rough = found["friction_static"] == 1.0
    assert set(found[rough & (found["base"] == 0)]["base_weight"]) == {1.5}
    assert set(found[~rough & (found["base"] == 0)]["base_weight"]) == {0.5}
    with refused("run.contact_without_weights", "0.5"):
        weighted_rows(frame, weights_of(1.5, 0.5))


def test_weights_come_back_from_disk_and_those_without_digest_are_refused(tmp_path):
    written = replace(weights_of(1.7, 0.3), method="the probability", remarks=("a remark",))
    run_in(tmp_path, [])
    written.write(tmp_path, "plan")
    read = Weights.read(tmp_path)
    assert (read.by_contact[CONTACT] == written.by_contact[CONTACT]).all()
    assert vars(replace(read, by_contact={})) == vars(replace(written, by_contact={}))
    pq.write_table(written.table(), tmp_path / WEIGHTS_FILE)
    with refused("file.damaged"):
        Weights.read(tmp_path)


def test_weights_that_are_none_are_refused(tmp_path):
    run_in(tmp_path, [])
    weights_of(1.0, -1e-3).write(tmp_path, "plan")
    with refused("run.weights_unreadable"):
        Weights.read(tmp_path)
    replace(weights_of(1.0), by_contact={}).write(tmp_path, "plan")
    with refused("run.weights_unreadable"):
        Weights.read(tmp_path)


@pytest.fixture
def weighted_run(tmp_path):
    """Folder of a run on two bases: on base 1 the rock topples at once."""
    jobs = rows(records=24)
    for number, job in enumerate(jobs):
        job["base"] = number % 2
        if number % 2:
            job |= {"toppled": True, "outcome": "toppled", "falls_toward_deg": 90.0}
    run_in(tmp_path / "run", jobs)
    (tmp_path / "run" / "stood").mkdir()
    return tmp_path / "run"


def test_every_reader_of_fractions_refuses_missing_weights(weighted_run):
    for verb in ("constrain", "fragility", "report"):
        error = CliRunner().invoke(cli, [verb, str(weighted_run)]).exception
        assert error.code == "run.weights_absent", verb


def test_constraint_map_query_and_page_of_a_run_agree_on_its_weights(weighted_run):
    weights_of(17.0, 1.0).write(weighted_run, "plan")
    run = open_run(weighted_run)
    jobs = run.weighted(run.frame())
    read = json.loads(CliRunner().invoke(cli, ["constrain", str(weighted_run), "--json"]).stdout)
    fitted = fit(answered(jobs), ["pgv_m_s"])
    assert read["rocks"][0]["median"] == pytest.approx(fitted.lognormal.median)
    (base,) = read["stood"]
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
    assert run.weights().summary(jobs)["contacts"][0]["bases"] == 2


QUAKE, OTHER = (Record.of(name, ricker(1.0, 1.0, along)) for name, along in (("quake", 0.0), ("other", 90.0)))


def weights_by(*records):
    evidence = {
        "records": [r.record_id for r in records], "shas": [r.sha for r in records],
        "azimuths_unknown": ["other"] if OTHER in records else [], "shakes": 8,
    }  # fmt: skip
    return by_evidence({CONTACT: np.array([1.5, 0.5])}, evidence)


def shakes(stands, record="quake"):
    table = [
        row(
            f"{record}-{base}-{number}", record_id=record, base=base, toppled=None if out is None else not out
        )
        for base, answers in enumerate(stands)
        for number, out in enumerate(answers)
    ]
    return pd.DataFrame(table).astype({"toppled": "boolean"})


def test_a_weight_is_the_jeffreys_mean_of_standing_over_its_mean():
    weights = weights_by_contact(shakes([[True] * 3 + [False], [False] * 4]), 2)[CONTACT]
    chance = np.array([3.5 / 5.0, 0.5 / 5.0])
    assert weights == pytest.approx(chance / chance.mean())


def test_over_motions_chances_are_multiplied_and_no_weight_becomes_0():
    first, many = shakes([[True] * 8, [False] * 8]), []
    for number in range(400):
        many.append(first.assign(record_id=f"quake {number}"))
    twice = weights_by_contact(pd.concat(many[:2]), 2)[CONTACT]
    assert twice[0] / twice[1] == pytest.approx(17.0**2)
    assert (weights_by_contact(pd.concat(many), 2)[CONTACT] > 0.0).all()


def test_a_base_without_an_answer_weighs_as_before_and_a_motion_without_any_is_refused():
    weights = weights_by_contact(shakes([[True] * 4, [None] * 4, [True] * 4]), 3)[CONTACT]
    assert weights == pytest.approx([1.0, 1.0, 1.0])
    failed = shakes([[None] * 2]).assign(message="InputError: mujoco knows no such pedestal")
    with refused("stood.no_answer", "2"):
        weights_by_contact(failed, 1)


def test_weights_by_two_motions_are_multiplied_and_name_both():
    both = joined(weights_by(QUAKE), weights_by(OTHER))
    assert both.by_contact[CONTACT] == pytest.approx([1.8, 0.2])
    assert both.reason == "the rock stood quake and other"
    assert both.remarks == ("Where the components of other pointed is not known: it shook from all sides",)
    assert both.evidence["shakes"] == 8
