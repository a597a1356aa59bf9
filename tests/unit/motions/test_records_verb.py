"""`toppling records` as it is typed."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from motion_samples import WRITERS, shaking, tabled

from toppling.models.motions.ensemble import Ensemble
from toppling.orchestrator.cli import cli


def run(*arguments, expect=0):
    result = CliRunner().invoke(cli, ["records", *map(str, arguments)])
    if expect == 0:
        assert result.exception is None, result.output
    return result


def given(tmp_path, name):
    """A folder of files of a format."""
    folder = tmp_path / "in"
    folder.mkdir()
    WRITERS[name](folder, shaking())
    return folder


def test_import_reads_what_it_can_and_ends_with_what_it_left_out(tmp_path):
    folder = given(tmp_path, "peer")
    (folder / "broken.AT2").write_text("PEER NGA STRONG MOTION DATABASE RECORD\nx\n")
    result = run("import", folder, "--out", tmp_path / "out")
    assert "1 record from 4 files" in result.output
    assert "broken.AT2" in result.output
    ensemble = Ensemble.load(tmp_path / "out")
    (row,) = ensemble.catalog.to_pylist()
    assert row["event"] == "Testquake"
    assert len(row["files"]) == 3
    wanted = (
        "record_id event station magnitude distance_km time_step_s pga_m_s2 ground_accelerates_toward_deg"
    )
    assert set(wanted.split()) <= set(row)


def test_import_takes_what_files_do_not_say_from_the_table_and_hints_at_one(tmp_path):
    folder = given(tmp_path, "columns")
    with_table = run("import", folder, "--out", tmp_path / "a", "--metadata", folder / "table.csv", "--json")
    assert json.loads(with_table.stdout)["records"] == ["A"]
    without = run("import", folder, "--out", tmp_path / "b", expect=1)
    assert without.exception.code == "record.none_found"
    assert "looks like a metadata table" in without.output
    assert not (tmp_path / "b").exists()


def test_import_replaces_an_ensemble_only_when_told(tmp_path):
    folder = given(tmp_path, "esm")
    run("import", folder, "--out", tmp_path / "out")
    again = run("import", folder, "--out", tmp_path / "out", expect=1)
    assert again.exception.code == "ensemble.exists"
    run("import", folder, "--out", tmp_path / "out", "--replace")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made") / "ensemble"
    result = run("synthesise", "--count", "6", "--seed", "3", "--out", folder)
    assert "target" in result.output
    return folder


def test_select_makes_a_smaller_ensemble_of_the_same_records(made, tmp_path):
    rows = Ensemble.load(made).catalog.to_pylist()
    far = max(row["distance_km"] for row in rows)
    run("select", made, "--out", tmp_path / "near", "--distance", "0", str(far - 0.1))
    near = Ensemble.load(tmp_path / "near")
    assert len(near.record_ids) == 5
    assert all(near.sha(name) == Ensemble.load(made).sha(name) for name in near.record_ids)


def test_a_selection_of_a_weighted_ensemble_keeps_its_weights(made, tmp_path):
    rows = Ensemble.load(made).catalog.to_pylist()
    table = tmp_path / "deaggregation.csv"
    head = "magnitude_low,magnitude_high,distance_low_km,distance_high_km,contribution"
    middle = sorted(row["magnitude"] for row in rows)[3]
    table.write_text(f"{head}\n0,{middle},0,999,1\n{middle},9,0,999,9\n")
    run("select", made, "--out", tmp_path / "weighted", "--deaggregation", table)
    run("select", tmp_path / "weighted", "--out", tmp_path / "near", "--distance", "0", "999")
    weighted, near = (Ensemble.load(tmp_path / name) for name in ("weighted", "near"))
    assert len(set(weighted.catalog["weight"].to_pylist())) == 2
    assert near.catalog["weight"] == weighted.catalog["weight"]


def test_import_resamples_when_told_and_keeps_what_both_steps_can_hold(tmp_path):
    folder = given(tmp_path, "peer")
    run("import", folder, "--out", tmp_path / "own")
    run("import", folder, "--out", tmp_path / "finer", "--time-step", 0.0025)
    own, finer = (Ensemble.load(tmp_path / name) for name in ("own", "finer"))
    (name,) = own.record_ids
    assert finer.record(name).motion.time_step_s == 0.0025
    assert any("resampled" in step for step in finer.record(name).history)
    assert not any("resampled" in step for step in own.record(name).history)
    # Velocity has little above a hundred hertz: a finer step shows the same peak.
    assert finer.record(name).intensity["pgv_m_s"] == pytest.approx(
        own.record(name).intensity["pgv_m_s"], rel=0.01
    )


@pytest.mark.parametrize(("peaks", "records"), [("2,4,1", 1), ("2,40,1", 0), ("2,,1", 0)])
def test_peaks_of_the_table_scale_counts_of_one_instrument_and_no_others(tmp_path, peaks, records):
    time = np.arange(2000) * 0.01
    shape = np.sin(2 * np.pi * time) * np.exp(-((time - 10) ** 2))
    # Counts with an offset; the sensitivity is 1000 counts per m/s2.
    counts = [1000 * peak * shape / np.abs(shape).max() + 7 for peak in (2.0, 4.0, 1.0)]
    np.savetxt(tmp_path / "rec.txt", np.column_stack([time, *counts]), fmt="%.6f")
    tabled([tmp_path / "rec.txt"] * 3, **{"pga_h1,pga_h2,pga_v": peaks})
    options = ("--out", tmp_path / "out", "--metadata", tmp_path / "table.csv")
    result = run("import", tmp_path / "rec.txt", *options, expect=None)
    if records:
        record = Ensemble.load(tmp_path / "out").record("A")
        intensity = record.intensity
        assert intensity["pga_h1_m_s2"] == pytest.approx(2.0, rel=0.01)
        assert intensity["pga_h2_m_s2"] == pytest.approx(4.0, rel=0.01)
        (told,) = [step for step in record.history if "counts per m/s2" in step]
        assert float(told.partition(" counts per")[0].split()[-1]) == pytest.approx(1000.0, rel=0.01)
    else:
        assert result.exception.code == "record.none_found"
