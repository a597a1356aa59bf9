"""The numbers behind the maps, against small tables counted by hand, and without the jobs beyond nature."""

import math

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from refusals import refused
from scipy.special import ndtr
from seeded import row, rows
from small_campaigns import run_in

from toppling.models.files.digest import write_table
from toppling.models.motions.quality import is_beyond
from toppling.orchestrator.public.reporting import Fragility
from toppling.results.analysis.fits import answered
from toppling.results.analysis.fragility import (
    PLANES,
    DirectionCells,
    by_contact,
    cells,
    direction_bin_deg,
    planes_of,
    trials,
    unplaced,
    wilson,
)
from toppling.results.analysis.lognormal import Lognormal, fit
from toppling.results.analysis.unphysical import unphysical_of


@pytest.fixture
def hand_made(tmp_path):
    """Level 2: three records with pulses of 0.10 to 0.15 s, one of 0.20 to 0.25 s; level 4: no answer."""
    jobs = [
        row("a", record_id="A", level_pga_m_s2=2.0, pgv_pga_s=0.10, pgv_m_s=0.20, toppled=False),
        row("b", record_id="B", level_pga_m_s2=2.0, pgv_pga_s=0.12, pgv_m_s=0.24, toppled=True),
        row("c", record_id="C", level_pga_m_s2=2.0, pgv_pga_s=0.14, pgv_m_s=0.28, toppled=True),
        row("d", record_id="D", level_pga_m_s2=2.0, pgv_pga_s=0.24, pgv_m_s=0.48, toppled=True),
        row("e", record_id="D", level_pga_m_s2=4.0, pgv_pga_s=0.24, pgv_m_s=0.96, status="undecided"),
    ]
    angles = [0.0, 22.4, -22.5, 337.4, 22.5]
    toward = [job | {"ground_accelerates_toward_deg": angle} for job, angle in zip(jobs, angles, strict=True)]
    return run_in(tmp_path, toward).frame()


def test_cells_count_what_is_there_and_no_more(hand_made):
    table = cells(hand_made, PLANES["pga_pgv_pga"])
    seen = table[["pgv_pga_s_low", "level_pga_m_s2", "jobs", "no_answer", "records", "toppled"]]
    expected = [[0.10, 2.0, 3, 0, 3, 2], [0.20, 2.0, 1, 0, 1, 1], [0.20, 4.0, 0, 1, 0, 0]]
    np.testing.assert_allclose(seen.to_numpy(float), expected)
    np.testing.assert_allclose(table["probability"], [2 / 3, 1.0, np.nan])
    np.testing.assert_allclose(table[["level_pga_m_s2_low", "level_pga_m_s2_high"]], [[1, 3], [1, 3], [3, 5]])
    assert table["thin"].all()


def test_wilson_intervals_agree_with_the_closed_form():
    # Wilson (1927): 2 of 3 at z = 1.959964 gives (0.2077, 0.9385); 0 of 10 gives (0, z2 / (n + z2)).
    low, high = wilson(pd.Series([2 / 3, 0.0, np.nan]), pd.Series([3, 10, 0]))
    z2 = 1.959964**2
    np.testing.assert_allclose(low, [0.20766, 0.0, np.nan], atol=1e-5)
    np.testing.assert_allclose(high, [0.93851, z2 / (10 + z2), np.nan], atol=1e-5)


@pytest.mark.parametrize("of_event", [0.0, 0.5])
def test_intervals_of_cells_hold_the_truth_however_records_of_an_earthquake_correlate(of_event):
    random, levels, held = np.random.default_rng(4), np.array([-0.3, 0.0, 0.4]), []
    for _ in range(150):
        event = np.repeat(np.arange(12), 1 + random.geometric(0.3, 12))
        threshold = np.sqrt(0.7 * of_event) * random.normal(size=12)[event]
        threshold += np.sqrt(0.7 - 0.7 * of_event) * random.normal(size=len(event))
        of_jobs = threshold[:, None, None] + np.sqrt(0.3) * random.normal(size=(len(event), 3, 1))
        unit, _, cell = np.indices((len(event), 3, 3)).reshape(3, -1)
        jobs = pd.DataFrame({"independent": event[unit], "cell": cell, "weight": 1.0})
        jobs["toppled"] = (levels > of_jobs).ravel().astype(float)
        low, high = wilson(jobs.groupby("cell")["toppled"].mean(), trials(jobs, ["cell"]))
        held.append((low <= ndtr(levels)) & (ndtr(levels) <= high))
    assert 0.9 < np.mean(held) < 0.98


def test_copies_of_a_record_do_not_narrow_the_interval(hand_made):
    plane = PLANES["pga_pgv_pga"]
    copies = [hand_made.assign(job_id=hand_made["job_id"] + str(turn)) for turn in range(8)]
    once, often = cells(hand_made, plane), cells(pd.concat(copies), plane)
    assert (often["jobs"] == 8 * once["jobs"]).all()
    pd.testing.assert_series_equal(often["wilson_high"], once["wilson_high"])


@given(st.floats(-720, 720), st.integers(1, 36))
def test_a_direction_is_within_half_a_bin_of_its_centre(azimuth, bins):
    centre = float(direction_bin_deg([azimuth], bins)[0])
    off = (azimuth - centre + 180.0) % 360.0 - 180.0
    assert abs(off) <= 180.0 / bins + 1e-9
    assert 0.0 <= centre < 360.0


@settings(max_examples=25, phases=(Phase.explicit, Phase.reuse, Phase.generate))
@given(st.lists(st.tuples(st.floats(0, 3), st.floats(0, 40)), min_size=1, max_size=30))
def test_every_job_within_the_limits_lies_in_exactly_one_cell_that_contains_it(values):
    frame = pd.DataFrame(values, columns=["pgv_m_s", "duration_energy_s"])
    frame["record_id"] = [str(number) for number in range(len(frame))]
    frame["toppled"] = pd.array([True] * len(frame), "boolean")
    table = cells(frame, PLANES["pgv_duration"])
    inside = frame[(frame["pgv_m_s"] < 3) & (frame["duration_energy_s"] < 30)]
    assert table["jobs"].sum() == len(inside)
    for _, cell in table.iterrows():
        # Edges are multiples of the width; a value within 1e-9 of one may lie on either side.
        pgv = inside["pgv_m_s"].between(cell["pgv_m_s_low"] - 1e-9, cell["pgv_m_s_high"] + 1e-9)
        duration = inside["duration_energy_s"].between(
            cell["duration_energy_s_low"] - 1e-9, cell["duration_energy_s_high"] + 1e-9
        )
        assert (pgv & duration).sum() >= cell["jobs"]


def test_contacts_are_never_pooled():
    frame = pd.concat([as_frame_of(rows(records=2, levels=(1,), friction=mu)) for mu in (0.6, 1.0)])
    assert {name: len(jobs) for name, jobs in by_contact(frame).items()} == {
        "friction-0.6": 4,
        "friction-1": 4,
    }
    assert list(by_contact(frame[frame["friction_static"] == 1.0])) == [""]


def as_frame_of(jobs):
    return pd.DataFrame(jobs).astype({"toppled": "boolean"})


def test_every_job_is_in_a_cell_or_counted_as_unplaced(hand_made):
    lost = [row("f", status="crashed", toppled=None), row("g", status="failed", toppled=None)]
    crashed = pd.concat([hand_made, as_frame_of(lost)], ignore_index=True)
    for plane in (PLANES["pga_pgv_pga"], PLANES["pga_pgv"]):
        table = cells(crashed, plane)
        assert table["jobs"].sum() + table["no_answer"].sum() + unplaced(crashed, plane) == len(crashed)
        split = DirectionCells.of(crashed, plane).table
        missing = unplaced(crashed, plane, by_direction=True)
        assert split["jobs"].sum() + split["no_answer"].sum() + missing == len(crashed)


@pytest.mark.parametrize("records", [4, 12, 200])
def test_bins_are_as_wide_as_the_records_need_and_as_the_studys_where_none_or_all_suffice(records):
    frame = as_frame_of(rows(records=records, azimuths=(0.0,)))
    plane, own = planes_of(frame)["pga_pgv"], PLANES["pga_pgv"]
    table = cells(frame, plane)
    sure = table.loc[~table["thin"], "jobs"].sum() / table["jobs"].sum()
    assert (sure >= 0.5) == (records >= 10)
    assert (plane.y.width > own.y.width) == (records == 12)


def weighted(frame, weights):
    return frame.assign(record_weight=frame["record_id"].map(weights))


def test_a_record_of_whole_weight_counts_as_that_many_copies_in_cells_and_in_fits():
    frame = answered(pd.DataFrame(rows(records=12, levels=range(1, 16, 2), azimuths=(0.0,))))
    whole = {name: 1 + number % 3 for number, name in enumerate(sorted(frame["record_id"].unique()))}
    copies = pd.concat(
        [frame[frame["record_id"].map(whole) > copy].assign(copy=copy) for copy in range(3)],
        ignore_index=True,
    )
    once, often = (cells(f, PLANES["pga_pgv"]) for f in (weighted(frame, whole), copies))
    assert once["probability"].to_numpy() == pytest.approx(often["probability"].to_numpy())
    assert (once["records"] == often["records"]).all()  # copies are no new records
    heavy, copied = fit(weighted(frame, whole), ["pgv_m_s"]), fit(copies, ["pgv_m_s"])
    assert heavy.coefficients == pytest.approx(copied.coefficients, rel=1e-6)


def test_equal_weights_change_nothing_and_unequal_weights_widen_the_interval():
    frame = pd.DataFrame(rows(records=20, levels=range(1, 16, 2), azimuths=(0.0,)))
    plain = cells(frame, PLANES["pga_duration"])
    names = sorted(frame["record_id"].unique())
    even = cells(weighted(frame, dict.fromkeys(names, 2.5)), PLANES["pga_duration"])
    pd.testing.assert_frame_equal(plain, even)
    # With one toppling share for all, weights leave the share alone and only shrink the number of records.
    standing = frame.assign(toppled=pd.array([False] * len(frame), "boolean"))
    uneven = cells(
        weighted(standing, {name: 1.0 + 9.0 * (k % 2) for k, name in enumerate(names)}),
        PLANES["pga_duration"],
    )
    level = cells(standing, PLANES["pga_duration"])
    assert (uneven["wilson_high"] >= level["wilson_high"] - 1e-12).all()
    assert (uneven["wilson_high"] > level["wilson_high"] + 1e-3).any()


def test_a_run_takes_the_weights_of_its_ensemble(tmp_path):
    jobs = rows(records=3, levels=(2, 4), azimuths=(0.0,))
    run = run_in(tmp_path / "equal", jobs)
    assert "record_weight" not in run.weighted(run.frame())
    names = ["R000", "R001", "R002", "unused"]
    for weights, want in (([1.0, 1.0, 1.0, 1.0], None), ([0.1, 0.2, 0.3, 0.4], {0.5, 1.0, 1.5})):
        folder = tmp_path / f"{weights[0]}"
        (folder / "ensemble").mkdir(parents=True)
        catalogue = pa.table({"record_id": names, "weight": weights})
        write_table(catalogue, folder / "ensemble" / "catalog.parquet")
        run = run_in(folder, jobs)
        frame = run.weighted(run.frame())
        found = set(frame["record_weight"].round(12)) if "record_weight" in frame else None
        assert found == want


@pytest.fixture
def run(tmp_path):
    jobs = [r | {"pgd_m": r["pgv_m_s"] / 3.0} for r in rows(records=20, levels=range(2, 20, 2))]
    return run_in(tmp_path, jobs)


def test_counts_and_changes_are_those_of_the_rows(run):
    table, known = unphysical_of(run), answered(run.frame())
    beyond = known["pgv_m_s"] > 3.0
    assert (table.jobs, table.of_jobs) == (beyond.sum(), len(known))
    assert (table.toppled, table.of_toppled) == (known["toppled"][beyond].sum(), known["toppled"].sum())
    assert table.share == pytest.approx(known["toppled"].mean())
    assert table.share_without == pytest.approx(known["toppled"][~beyond].mean())
    without = fit(known[~beyond].reset_index(drop=True), ["pga_m_s2"]).lognormal
    assert table.median_pga_without_m_s2 == pytest.approx(without.median)
    assert table.median_pga_m_s2 == pytest.approx(fit(known, ["pga_m_s2"]).lognormal.median)


def test_a_run_within_observed_motions_has_no_remark(run):
    frame = run.frame()
    assert unphysical_of(run, frame[frame["pgv_m_s"] < 3.0]) is None


def test_no_median_is_reported_of_rocks_together_nor_beyond_what_was_shaken(run):
    frame = run.frame()
    two = pd.concat([frame, frame.assign(scene_id="another")])
    assert unphysical_of(run, two).median_pga_m_s2 is None
    standing = frame[(frame["level_pga_m_s2"] < 5) | (frame["pgv_m_s"] > 3.0)]
    out = unphysical_of(run, standing.assign(toppled=standing["toppled"] & (standing.index % 7 == 0)))
    assert out.median_pga_m_s2 is None
    assert "median" not in out.sentence


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
    out, known = unphysical_of(run, weighted), pd.DataFrame(answered(weighted))
    expected = (known["toppled"] * known["record_weight"]).sum() / known["record_weight"].sum()
    assert out.share == pytest.approx(expected)


@pytest.mark.parametrize("known", [(), ("pga_m_s2", "sa_1s_m_s2")])
def test_a_curve_that_the_answers_do_not_bear_is_refused_by_the_measures_that_they_do(known, tmp_path):
    run, curves = run_in(tmp_path, []), {"0.8": {name: Lognormal(name, 4.0, 0.3) for name in known}}
    drawn = Fragility(run, tmp_path, [], pd.DataFrame(), None, {}, curves=curves)
    with refused("fragility.no_curve", tmp_path, "pgv_m_s", *known or ["none"]):
        drawn.curve("pgv_m_s", "0.8")
