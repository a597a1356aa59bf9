"""Jobs beyond nature are counted, and what the run says without them is what a run without them says."""

import math

import pandas as pd
import pytest
from seeded import rows

from toppling.models.motions.quality import is_beyond
from toppling.results.analysis.fits import answered
from toppling.results.analysis.lognormal import fit
from toppling.results.analysis.unphysical import unphysical_of
from toppling.results.reader import open_run
from toppling.results.store import write_part


@pytest.fixture
def run(tmp_path):
    write_part(
        tmp_path, [one | {"pgd_m": one["pgv_m_s"] / 3.0} for one in rows(records=20, levels=range(2, 20, 2))]
    )
    return open_run(tmp_path)


def test_counts_and_changes_are_those_of_the_rows(run):
    told, known = unphysical_of(run), answered(run.frame())
    beyond = known["pgv_m_s"] > 3.0
    assert (told.jobs, told.of_jobs) == (beyond.sum(), len(known))
    assert (told.toppled, told.of_toppled) == (known["toppled"][beyond].sum(), known["toppled"].sum())
    assert told.share == pytest.approx(known["toppled"].mean())
    assert told.share_without == pytest.approx(known["toppled"][~beyond].mean())
    without = fit(known[~beyond].reset_index(drop=True), ["pga_m_s2"]).lognormal
    assert told.median_pga_without_m_s2 == pytest.approx(without.median)
    assert told.median_pga_m_s2 == pytest.approx(fit(known, ["pga_m_s2"]).lognormal.median)


def test_a_run_within_nature_has_nothing_to_tell(run):
    frame = run.frame()
    assert unphysical_of(run, frame[frame["pgv_m_s"] < 3.0]) is None


def test_no_median_is_told_of_rocks_together_nor_beyond_what_was_shaken(run):
    frame = run.frame()
    two = pd.concat([frame, frame.assign(scene_id="another")])
    assert unphysical_of(run, two).median_pga_m_s2 is None
    standing = frame[(frame["level_pga_m_s2"] < 5) | (frame["pgv_m_s"] > 3.0)]
    told = unphysical_of(run, standing.assign(toppled=standing["toppled"] & (standing.index % 7 == 0)))
    assert told.median_pga_m_s2 is None
    assert "median" not in told.sentence


@pytest.mark.parametrize(
    ("factor", "pgv_m_s", "pgd_m", "beyond"),
    [(42.0, 7.0, 1.0, True), (1.0, 0.1, 4.5, True), (101.0, 0.1, 0.1, True), (99.0, 2.9, 3.9, False),
     (math.nan, 1.0, 1.0, False), (math.nan, 3.5, math.nan, True)],
)  # fmt: skip
def test_what_is_not_known_is_not_beyond(factor, pgv_m_s, pgd_m, beyond):
    assert bool(is_beyond(factor, pgv_m_s, pgd_m)) is beyond


def test_weights_of_records_count(run):
    frame = run.frame()
    weighted = frame.assign(record_weight=1.0 + (frame["record_id"] == "R000"))
    told, known = unphysical_of(run, weighted), pd.DataFrame(answered(weighted))
    expected = (known["toppled"] * known["record_weight"]).sum() / known["record_weight"].sum()
    assert told.share == pytest.approx(expected)
