"""What an audit states of a run: estimates that hold the truth as often as they say, from a sample that is one."""

import json
import math
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
import statsmodels.api as sm
from seeded import row
from small_campaigns import run_in

from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.studies import audit as audits
from toppling.orchestrator.studies.audit import affordable
from toppling.results.analysis.audit_statistics import JOB_COLUMNS, Audit, audits_json, audits_of, compare
from toppling.results.reader import open_run
from toppling.results.store import write_part

SAMPLE, CAMPAIGNS = 200, 200


def population(seed, records=50, shift=0.04, alike=0.93, levels=14, azimuths=2):
    """Jobs of a campaign, with answers of a preset and of a finer one whose median is higher by a share."""
    random = np.random.default_rng(seed)
    pga = np.tile(np.repeat(np.arange(1.0, levels + 1), azimuths), records)
    count = len(pga)
    of_record = np.repeat(random.normal(0.0, 0.35, records), levels * azimuths)
    chance = random.normal(size=count)
    other = alike * chance + math.sqrt(1.0 - alike**2) * random.normal(size=count)
    ours = np.log(pga / 7.0) + of_record + 0.25 * chance > 0
    theirs = np.log(pga / (7.0 * (1.0 + shift))) + of_record + 0.25 * other > 0
    jobs = pd.DataFrame({
        "job_id": [f"{number:024x}" for number in random.permutation(count)],
        "record_id": np.repeat([f"R{number:03d}" for number in range(records)], levels * azimuths),
        "level_pga_m_s2": pga, "pga_m_s2": pga, "azimuth_deg": np.tile(np.arange(azimuths) * 90.0, records * levels),
        "friction_static": 1.0, "friction_kinetic": 1.0, "restitution": 0.0, "realisation": 0,
        "scene_id": "scene", "preset": "fast", "engine": "pybullet", "max_tilt_deg": 1.0,
    })  # fmt: skip
    return jobs.assign(toppled=pd.array(ours, "boolean")), jobs.assign(toppled=pd.array(theirs, "boolean"))


def first(jobs):
    return jobs.sort_values("job_id").head(SAMPLE)


def true_shift_percent(jobs, again):
    medians = [median(part) for part in (jobs, again)]
    return 100.0 * (medians[0] / medians[1] - 1.0)


def median(jobs):
    counts = jobs.astype({"toppled": float}).groupby("pga_m_s2")["toppled"].agg(["sum", "size"])
    design = sm.add_constant(np.log(counts.index.to_numpy()))
    answers = np.column_stack([counts["sum"], counts["size"] - counts["sum"]])
    intercept, slope = sm.GLM(answers, design, sm.families.Binomial(sm.families.links.Probit())).fit().params
    return math.exp(-intercept / slope)


@pytest.mark.thorough
def test_on_200_resampled_campaigns_the_stated_interval_holds_the_true_shift_in_93_to_97_percent():
    random = np.random.default_rng(3)
    jobs, again = population(1)
    records = jobs["record_id"].unique()
    of_record = {name: part.index.to_numpy() for name, part in jobs.groupby("record_id")}
    held_median = held_share = 0
    for _ in range(CAMPAIGNS):
        # Records drawn anew make another campaign, with a true shift of its own.
        chosen = random.choice(records, len(records))
        rows = np.concatenate([of_record[name] for name in chosen])
        names = np.repeat([f"D{number:03d}" for number in range(len(chosen))], len(rows) // len(chosen))
        campaign, finer = (
            part.loc[rows].reset_index(drop=True).assign(record_id=names) for part in (jobs, again)
        )
        ids = [f"{number:024x}" for number in random.permutation(len(campaign))]
        audit = compare("reference", campaign.assign(job_id=ids), first(finer.assign(job_id=ids)))
        assert audit.jobs == SAMPLE
        held_median += audit.median_shift_percent.holds(true_shift_percent(campaign, finer))
        share = campaign["toppled"].mean() - finer["toppled"].mean()
        held_share += audit.share_shift.holds(share)
    assert 0.93 <= held_median / CAMPAIGNS <= 0.97
    assert 0.93 <= held_share / CAMPAIGNS <= 0.98


def test_an_audit_of_every_job_states_the_shift_itself():
    jobs, again = population(2, records=12)
    audit = compare("reference", jobs, again)
    assert audit.median_shift_percent.value == pytest.approx(true_shift_percent(jobs, again), rel=1e-6)
    assert audit.median_shift_percent.high - audit.median_shift_percent.low < 1e-9
    assert audit.share_shift.value == pytest.approx(jobs["toppled"].mean() - again["toppled"].mean())


@pytest.mark.parametrize("seed", range(4))
def test_answers_that_contradict_what_is_certain_shift_the_median_as_a_fit_of_them_does(seed):
    """Scoring with whole steps diverges here: the first leaves the range in which a probit has a slope."""
    random = np.random.default_rng(seed)
    pga = np.repeat(np.arange(1.0, 21.0), 40)
    jobs, _ = population(seed, records=len(pga) // 28 + 1)
    jobs = jobs[: len(pga)].assign(
        pga_m_s2=pga, level_pga_m_s2=pga, record_id=np.arange(len(pga)).astype(str)
    )
    ours = np.log(pga / 8.0) + 0.1 * random.normal(size=len(pga)) > 0
    theirs = np.where((pga < 3.0) & (random.random(len(pga)) < 0.5), True, ours)
    jobs, again = (jobs.assign(toppled=pd.array(value, "boolean")) for value in (ours, theirs))
    stated = compare("reference", jobs, again).median_shift_percent
    assert stated.value == pytest.approx(true_shift_percent(jobs, again), rel=1e-4)


def test_a_sample_with_gaps_in_the_order_of_the_hashes_counts_only_up_to_the_first():
    jobs, again = population(4, records=12)
    ordered = again.sort_values("job_id")
    gap = pd.concat([ordered.iloc[:150], ordered.iloc[151:400]])
    assert compare("reference", jobs, gap).jobs == 150


def test_no_flip_in_a_sample_leaves_an_interval_and_no_shift():
    jobs, _ = population(5, records=12)
    audit = compare("reference", jobs, first(jobs))
    assert audit.median_shift_percent.value == pytest.approx(0.0, abs=1e-6)
    assert audit.median_shift_percent.low < -0.1
    assert audit.share_shift.high > 0.001
    assert audit.agrees


def test_a_second_answer_of_always_toppled_is_reported_as_a_lean_to_standing():
    jobs, _ = population(6, records=12)
    again = jobs.assign(toppled=pd.array(jobs["toppled"] | (jobs["pga_m_s2"] > 5), "boolean"))
    audit = compare("mujoco", jobs, first(again))
    assert audit.flips_to_toppled == 0
    assert audit.flips_to_standing > 10
    assert audit.median_shift_percent.low > 0
    assert audit.share_shift.high < 0
    assert not audit.agrees


def saved(folder, jobs, again):
    """A run's folder with an audit by the reference and by another engine."""
    keep = [*JOB_COLUMNS, "toppled", "job_id", "pga_m_s2", "preset", "max_tilt_deg"]

    def as_rows(frame):
        return [row(**entry) for entry in frame[keep].astype({"toppled": object}).to_dict("records")]

    run_in(folder, as_rows(jobs))
    for name in ("reference", "mujoco"):
        (folder / "audit" / name).mkdir(parents=True)
        (folder / "audit" / name / "drawn.json").write_text('{"plan_id": "plan", "until": null}')
        write_part(folder / "audit" / name, as_rows(first(again).assign(preset=name)))


def test_audit_rows_never_mix_with_answers_and_the_json_names_both_engines(tmp_path):
    jobs, again = population(7, records=12)
    saved(tmp_path, jobs, again)
    run = open_run(tmp_path)
    assert set(run.frame()["preset"]) == {"fast"}
    assert len(run.frame()) == len(jobs)
    document = json.loads(json.dumps(audits_json(audits_of(run))))
    names = {
        "jobs", "median_shift_percent", "median_shift_low", "median_shift_high", "share_shift", "flips_to_toppled",
        "flips_to_standing",
    }  # fmt: skip
    assert names <= set(document)
    assert names <= set(document["engines"]["mujoco"])
    assert document["jobs"] == SAMPLE
    assert document["median_shift_low"] < document["median_shift_percent"] < document["median_shift_high"]


def test_rows_that_came_after_the_sample_was_drawn_are_not_what_it_stands_for(tmp_path):
    jobs, again = population(7, records=12)
    saved(tmp_path, jobs, again)
    (tmp_path / "audit" / "reference" / "drawn.json").write_text(
        '{"plan_id": "plan", "until": "2026-06-01T00:00:00+00:00"}'
    )
    late = pd.Timestamp("2026-07-01", tz="UTC")
    write_part(tmp_path, [row("-" * 24, record_id="R999", finished_at=late, pga_m_s2=9.0, toppled=True)])
    audit = audits_of(open_run(tmp_path))["reference"]
    assert isinstance(audit, Audit)
    assert (audit.jobs, audit.of_jobs) == (SAMPLE, len(jobs))


def test_an_audit_costs_at_most_a_tenth_of_the_run_though_its_first_repetitions_were_cheap(
    tmp_path, monkeypatch
):
    axes = {"pga_m_s2": [1], "azimuth_deg": [0], "friction": [0.8]}
    campaign = Campaign.of({"scene": "s", "ensemble": "e", **axes}, tmp_path)
    rows, home = pa.table({"wall_s": [1.0] * 5000}), tmp_path / "audit"
    able, _ = affordable(campaign, rows, tmp_path)
    cost_s = {auditor.name: [1.0] * 4 + [3.0] * 5000 for auditor in able}
    done = dict.fromkeys(cost_s, 0)

    def repeat(_, count, auditors):
        for name in (auditor.name for auditor in auditors):
            (home / name).mkdir(parents=True, exist_ok=True)
            jobs = range(done[name], max(count, done[name]))
            write_part(home / name, [row(f"{number:024x}", wall_s=cost_s[name][number]) for number in jobs])
            done[name] += len(jobs)

    monkeypatch.setattr(audits, "audit", repeat)
    monkeypatch.setattr(audits, "drawn", lambda _: rows)
    monkeypatch.setattr(audits, "_due", lambda *_: affordable(campaign, rows, tmp_path))
    audits.audit_run(SimpleNamespace(planned=SimpleNamespace(campaign=campaign), folder=tmp_path))
    assert min(done.values()) >= 40
    assert 400.0 < sum(sum(cost_s[name][:jobs]) for name, jobs in done.items()) < 500.0
    write_part(home / "reference", [row(f"{number:024x}", wall_s=90.0) for number in range(5000, 5010)])
    left, _ = affordable(campaign, rows, tmp_path)
    assert "reference" not in [auditor.name for auditor in left]
