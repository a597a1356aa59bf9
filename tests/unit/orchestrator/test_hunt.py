"""The hunt for the level that topples: what it looks at, that its shares are unbiased, that it goes on as it began."""

import numpy as np
import pandas as pd
import pytest

from toppling.orchestrator import hunt as hunting
from toppling.orchestrator.hunt import Bracket, Hunt, Ladder, chances, search
from toppling.results.fragility import PLANES, cells
from toppling.results.hunted import SKIPPED, estimated, shaken

LEVELS, AZIMUTHS = 19, 4


def ladders(records, salt=0):
    """Groups of ladders, as a plan of so many records has them."""
    groups, row = [], 0
    for record in range(records):
        group = []
        for azimuth in range(AZIMUTHS):
            rows = tuple(range(row, row + LEVELS))
            group.append(Ladder(rows, tuple(f"{salt}-{record}-{azimuth}-{level}" for level in range(LEVELS))))
            row += LEVELS
        groups.append(group)
    return groups


def answers_of(records, seed):
    """Toppling that is not monotone: beyond its threshold a record now and then leaves the rock standing."""
    random = np.random.default_rng(seed)
    threshold = np.repeat(random.uniform(2, 17, records), AZIMUTHS) + random.normal(
        0, 1.0, records * AZIMUTHS
    )
    level = np.arange(1, LEVELS + 1)
    away = np.abs(level - threshold[:, None])
    reversed_ = random.random(away.shape) < 0.25 * np.exp(-away / 2.0)
    return ((level > threshold[:, None]) ^ reversed_).ravel()


def carried_out(groups, toppled, stop_after=None):
    """Hunt to the end, or for some rounds: answers by id, marks of the audits."""
    ids = [job_id for group in groups for ladder in group for job_id in ladder.ids]
    hunt, known, marks = Hunt(groups), {}, {}
    while stop_after is None or stop_after > 0:
        rows, audits = hunt.next_rows(known)
        if not rows:
            break
        known |= {ids[row]: bool(toppled[row]) for row in rows}
        marks |= audits
        stop_after = None if stop_after is None else stop_after - 1
    return hunt, known, marks


def frame_of(groups, toppled, hunt, known, marks):
    """Rows of results as the run would hold them."""
    ids = [job_id for group in groups for ladder in group for job_id in ladder.ids]
    left = {ids[choice.row]: choice for choice in hunt.skipped(known)}
    rows = []
    for number, job_id in enumerate(ids):
        choice = left.get(job_id) or marks.get(job_id)
        rows.append({
            "job_id": job_id, "record_id": job_id.split("-")[1], "level_pga_m_s2": float(number % LEVELS + 1),
            "pgv_m_s": 0.1 * (number % LEVELS + 1), "status": SKIPPED if job_id in left else "ok",
            "toppled": None if job_id in left else bool(toppled[number]),
            "choice_probability": choice.probability if choice else np.nan,
            "expected_toppled": choice.expected if choice else None,
        })  # fmt: skip
    return pd.DataFrame(rows).astype({"toppled": "boolean", "expected_toppled": "boolean"})


@pytest.mark.parametrize("threshold", range(LEVELS + 1))
@pytest.mark.parametrize("start", [0, 9, 18])
def test_a_monotone_ladder_is_bracketed_wherever_the_search_begins(threshold, start):
    answers = [None] * LEVELS
    for _ in range(LEVELS):
        found = search(answers, start)
        if isinstance(found, Bracket):
            break
        assert answers[found] is None  # no level is shaken twice
        answers[found] = found >= threshold
    assert found == Bracket(threshold - 1, threshold)
    assert sum(answer is not None for answer in answers) <= 10


def test_levels_near_the_bracket_are_audited_more_often_and_none_never():
    chance = chances(Bracket(8, 9), LEVELS)
    assert (np.diff(chance[:8]) >= 0).all()
    assert (np.diff(chance[10:]) <= 0).all()
    assert chance.min() > 0


def test_every_share_is_unbiased_although_toppling_is_not_monotone():
    """Over draws of the audits the estimates' mean is the truth: of all jobs, of each level, and by weights alone."""
    toppled = answers_of(6, seed=1)
    of_levels, weighted = [], []
    for salt in range(60):
        groups = ladders(6, salt)
        frame = frame_of(groups, toppled, *carried_out(groups, toppled))
        rows, some = estimated(frame), shaken(frame)
        of_levels.append(rows.groupby("level_pga_m_s2")["toppled_estimate"].mean().to_numpy())
        weighted.append((some["record_weight"] * some["toppled"].astype(float)).sum() / len(rows))
    truth, of_levels = toppled.reshape(-1, LEVELS).mean(axis=0), np.array(of_levels)

    def is_unbiased(values, true):
        error = np.std(values, axis=0) / np.sqrt(len(values))
        return (np.abs(np.mean(values, axis=0) - true) < 4 * error + 1e-12).all()

    assert is_unbiased(of_levels, truth)
    assert is_unbiased(of_levels.mean(axis=1), toppled.mean())
    assert is_unbiased(np.array(weighted), toppled.mean())


def test_the_maps_of_a_hunt_are_means_of_its_estimates():
    toppled = answers_of(12, seed=2)
    groups = ladders(12)
    rows = estimated(frame_of(groups, toppled, *carried_out(groups, toppled)))
    table = cells(rows.assign(scene_id="s"), PLANES["pga_pgv"])
    means = rows.groupby("level_pga_m_s2")["toppled_estimate"].mean().clip(0, 1)
    np.testing.assert_allclose(table["probability"], means)
    assert (table["jobs"] == 12 * AZIMUTHS).all()


def test_an_interrupted_hunt_does_the_same_jobs_in_the_end():
    toppled, groups = answers_of(10, seed=3), ladders(10)
    _, whole, marks = carried_out(groups, toppled)
    ids = [job_id for group in groups for ladder in group for job_id in ladder.ids]
    _, some, some_marks = carried_out(groups, toppled, stop_after=3)
    half = dict(list(some.items())[: len(some) // 2])  # of a round that was cut, some rows are stored
    hunt = Hunt(groups)
    while (step := hunt.next_rows(half))[0]:
        half |= {ids[row]: bool(toppled[row]) for row in step[0]}
        some_marks |= step[1]
    assert half == whole
    assert some_marks == marks


def test_a_hunt_shakes_half_of_the_levels_at_most(monkeypatch):
    toppled, groups = answers_of(20, seed=4), ladders(20)
    _, known, _ = carried_out(groups, toppled)
    assert len(known) < 0.5 * len(toppled)
    monkeypatch.setattr(hunting, "AUDIT_BELOW", (0.0,))
    monkeypatch.setattr(hunting, "AUDIT_ABOVE", (0.0,))
    _, known, _ = carried_out(groups, toppled)
    assert len(known) < 0.27 * len(toppled)
