"""The shake-table protocol: levels, what is shaken, when it ends, and that it goes on where it was stopped."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.idealised import full_sine
from toppling.models.motions.record import Record
from toppling.models.scene import Scene
from toppling.orchestrator.cli import cli
from toppling.orchestrator.studies import ramp as ramps
from toppling.orchestrator.studies.ramp import (
    Ramp,
    _climb,
    carry_out,
    chosen_waveforms,
    summary,
    weakest_azimuth_deg,
)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """A block that slender waveforms topple: three sine pulses."""
    folder = tmp_path_factory.mktemp("ramp")
    Scene.block(0.1, 0.2, 0.6).save(folder / "scene")
    pulses = [Record.of(f"T{n}", full_sine(1.0, 0.3 * n)) for n in (1, 2, 3)]
    Ensemble.write(folder / "waveforms", pulses)
    return folder


def test_the_protocols_levels_are_those_of_the_shaking_table():
    levels = Ramp(0.0, end_m_s2=2.0).levels_m_s2()
    np.testing.assert_allclose(levels, [0.981, 1.226, 1.471, 1.716, 1.961])


def test_a_block_is_shaken_across_its_narrow_side():
    assert weakest_azimuth_deg(Scene.block(0.1, 0.2, 0.6)) in (0.0, 180.0)
    assert weakest_azimuth_deg(Scene.block(0.2, 0.1, 0.6)) in (90.0, 270.0)


def test_a_climb_ends_with_the_first_toppling_and_holds_the_tables_displacement(inputs):
    scene, record = Scene.load(inputs / "scene"), Ensemble.load(inputs / "waveforms").record("T3")
    rows = _climb(scene, record, Ramp(0.0, preset="fast", peak_displacement_m=0.05))
    assert [row["toppled"] for row in rows] == [False] * (len(rows) - 1) + [True]
    assert all(row["pgd_m"] <= 0.05 + 1e-9 for row in rows)
    told = summary(pd.DataFrame(rows)).iloc[0]
    assert told["toppling_pga_m_s2"] == rows[-1]["pga_m_s2"]
    assert told["pgv_pga_s"] == pytest.approx(np.mean([row["pgv_pga_s"] for row in rows]))
    # Below the acceleration that lifts it, nothing topples.
    assert told["toppling_pga_m_s2"] > 9.81 * 0.1 / 0.6


def test_one_component_shakes_alone(inputs):
    record = Ensemble.load(inputs / "waveforms").record("T1")
    motion = ramps._uniaxial(record).motion
    assert np.abs(motion.acceleration_m_s2[:, 1:]).max() == 0.0
    assert np.abs(motion.acceleration_m_s2[:, 0]).max() == pytest.approx(record.intensity["pga_m_s2"])


def test_waveforms_are_spread_over_the_pulse(inputs):
    ensemble = Ensemble.load(inputs / "waveforms")
    assert chosen_waveforms(ensemble) == ["T1", "T2", "T3"]
    assert chosen_waveforms(ensemble, 2) == ["T1", "T3"]


def test_what_is_done_is_not_done_again(inputs, tmp_path, monkeypatch):
    protocol = Ramp(0.0, preset="fast", end_m_s2=1.5)
    where = inputs / "scene", inputs / "waveforms", ["T1", "T2"], protocol, tmp_path
    with ThreadPoolExecutor(1) as pool:
        first = carry_out(*where, pool)
        monkeypatch.setattr(ramps, "_climb", lambda *_: pytest.fail("done already"))
        assert carry_out(*where, pool).equals(first)


def test_the_verb_writes_table_and_figure(inputs, tmp_path):
    options = ["--preset", "fast", "--step", "0.5", "--workers", "1", "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(cli, ["ramp", str(inputs / "scene"), str(inputs / "waveforms"), *options])
    assert result.exit_code == 0, result.output
    table = pd.read_csv(tmp_path / "out" / "ramp.csv")
    assert table["toppling_pga_m_s2"].notna().sum() >= 2
    assert (tmp_path / "out" / "ramp.png").exists()


def test_unknown_waveforms_are_named(inputs, tmp_path):
    result = CliRunner().invoke(
        cli,
        ["ramp", str(inputs / "scene"), str(inputs / "waveforms"), "--records", "X9", "--out", str(tmp_path)],
    )
    assert result.exit_code != 0
    assert "X9" in str(result.exception)
