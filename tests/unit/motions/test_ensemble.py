"""An ensemble comes back as it was written and knows if it is not itself; synthetic ones are what a scenario says."""

import shutil

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from refusals import refused

from toppling.models.files.digest import write_table
from toppling.models.motions.ensemble import CATALOG, MOTIONS, Ensemble
from toppling.models.motions.intensity import measure, velocity_m_s
from toppling.models.motions.measures import MEASURES
from toppling.models.motions.synthetic import (
    BOORE_1997,
    Scenario,
    acceleration_spectrum_m_s,
    median_arias_duration_s,
    median_spectrum_m_s2,
    synthetic_ensemble,
    synthetic_motion,
    velocity_pulse_m_s,
)


@pytest.fixture(scope="module")
def made():
    return synthetic_ensemble(3, seed=1)


@pytest.fixture(scope="module")
def ensemble(made, tmp_path_factory):
    return Ensemble.write(tmp_path_factory.mktemp("ensemble") / "e", reversed(made))


def test_records_come_back_bit_for_bit(ensemble, made):
    assert ensemble.record_ids == [r.record_id for r in made]
    for record in made:
        read = ensemble.record(record.record_id)
        assert np.array_equal(read.motion.acceleration_m_s2, record.motion.acceleration_m_s2)
        assert read.motion.time_step_s == record.motion.time_step_s
        assert dict(read.intensity) == dict(record.intensity)
        assert (read.sha, read.history, read.magnitude) == (record.sha, record.history, record.magnitude)
        assert ensemble.sha(record.record_id) == record.sha


def test_the_id_is_that_of_the_content_not_of_the_order_or_the_place(ensemble, made, tmp_path):
    assert Ensemble.write(tmp_path / "again", made).id == ensemble.id
    assert Ensemble.write(tmp_path / "less", made[:2]).id != ensemble.id


def test_two_records_of_the_same_id_are_refused_before_anything_is_written(made, tmp_path):
    with refused("ensemble.id_repeated"):
        Ensemble.write(tmp_path / "e", [made[0], made[0]])
    assert not (tmp_path / "e").exists()


def test_a_catalogue_of_other_motions_is_refused(ensemble, made, tmp_path):
    other = Ensemble.write(tmp_path / "other", made[:2])
    shutil.copy(ensemble.folder / CATALOG, other.folder / CATALOG)
    with refused("ensemble.files_foreign"):
        Ensemble.load(other.folder)


@pytest.mark.parametrize("column", list(MEASURES))
def test_a_catalogue_without_a_measure_that_rows_have_is_refused(ensemble, tmp_path, column):
    shutil.copytree(ensemble.folder, tmp_path / "e")
    path = tmp_path / "e" / CATALOG
    write_table(pq.read_table(path).drop_columns([column]), path)
    with refused("ensemble.column_missing", column):
        Ensemble.load(tmp_path / "e")


@pytest.mark.parametrize(
    ("name", "column", "change", "what"),
    [
        (MOTIONS, "acceleration_x_m_s2", lambda values: [2 * v for v in values], "hash"),
        (MOTIONS, "acceleration_z_m_s2", lambda values: [*values[:-1], values[-1] + 1e-12], "hash"),
        (MOTIONS, "time_step_s", lambda step: step / 2, "hash"),
        (CATALOG, "strong_azimuth_deg", lambda azimuth: azimuth + 90, "hash"),
        (CATALOG, "pga_m_s2", lambda pga: 1.01 * pga, "PGA"),
    ],
)
def test_a_motion_that_is_not_the_catalogues_is_refused(ensemble, tmp_path, name, column, change, what):
    path = shutil.copytree(ensemble.folder, tmp_path / "other") / name
    table = pq.read_table(path)
    changed = pa.array([change(value) for value in table.column(column).to_pylist()])
    index = table.schema.get_field_index(column)
    write_table(table.set_column(index, table.schema.field(column), changed), path, rows_in_group=1)
    other = Ensemble.load(path.parent)
    with refused("ensemble.motion_foreign", what):
        other.record(other.record_ids[1])


def test_every_column_of_the_catalogue_states_its_meaning_and_unit(ensemble):
    for field in pq.read_table(ensemble.folder / CATALOG).schema:
        assert field.metadata[b"description"], field.name
        ending = field.name.rpartition("_")[2]
        assert bool(field.metadata[b"unit"]) == (ending in {"s", "s2", "m", "km", "deg"}), field.name


def test_the_same_seed_gives_the_same_records_and_a_longer_ensemble_starts_with_them():
    few, more, other = synthetic_ensemble(2, 5), synthetic_ensemble(3, 5), synthetic_ensemble(2, 6)
    assert [r.sha for r in few] == [r.sha for r in more[:2]]
    assert few[0].sha != other[0].sha


def test_the_stated_fraction_has_a_near_fault_pulse_within_15_km():
    records = synthetic_ensemble(20, 3, pulse_share=0.25)
    with_pulse = [r for r in records if any("pulse" in step for step in r.history)]
    assert len(with_pulse) == 5
    assert all(r.distance_km <= 15 for r in with_pulse)
    assert all(6 <= r.magnitude <= 8 and 5 <= r.distance_km <= 100 for r in records)


def test_the_mean_power_spectrum_is_the_scenarios():
    scenario = Scenario(magnitude=7.0, distance_km=20.0)
    spectra = []
    for seed in range(40):
        motion, _ = synthetic_motion(scenario, np.random.default_rng(seed))
        series = motion.acceleration_m_s2[:, :2].T
        spectra.append(np.abs(np.fft.rfft(series, axis=1)) * motion.time_step_s)
    frequency = np.fft.rfftfreq(len(motion.acceleration_m_s2), motion.time_step_s)
    mean = np.sqrt(np.mean(np.concatenate(spectra) ** 2, axis=0))
    for low, high in ((0.5, 1), (1, 3), (3, 10), (10, 20)):
        band = (frequency >= low) & (frequency < high)
        ratio = np.sqrt(
            np.mean(mean[band] ** 2) / np.mean(acceleration_spectrum_m_s(frequency, scenario)[band] ** 2)
        )
        # 80 series of some 15 independent frequencies or more: the mean power scatters by 3 %
        assert ratio == pytest.approx(1.0, abs=0.06)


def test_the_ground_ends_at_rest():
    for record in synthetic_ensemble(4, 11):
        assert np.abs(velocity_m_s(record.motion)[-1]).max() < 1e-9


def test_pulse_has_its_amplitude_period_and_length():
    time_s = np.linspace(-5, 5, 4001)
    pulse = velocity_pulse_m_s(time_s, 1.2, 2.0, 2.0, 0.0)
    assert pulse.max() == pytest.approx(1.2)
    assert np.all(pulse[np.abs(time_s) > 2.0] == 0)
    zero = time_s[(time_s > 0)][np.argmax(pulse[time_s > 0] < 0)]
    assert zero == pytest.approx(0.5, abs=0.01)  # a quarter of the period after the centre


def test_durations_and_spectra_are_near_the_published_medians():
    rows = []
    for index in range(30):
        rng = np.random.default_rng(index)
        magnitude, distance_km = 6 + 1.5 * (index % 6) / 5, 10.0 * 6 ** (index / 30)
        motion, _ = synthetic_motion(Scenario(magnitude, distance_km), rng)
        measures = measure(motion)
        row = [measures["duration_arias_s"] / median_arias_duration_s(magnitude, distance_km)]
        row += [measures[name] / median_spectrum_m_s2(name, magnitude, distance_km) for name in BOORE_1997]
        rows.append(row)
    ratios = np.median(rows, axis=0)
    # two published models of one median differ by a fifth or so, most at 2 s
    assert ratios == pytest.approx(np.ones(5), rel=0.3)


@pytest.mark.slow
def test_140_records_span_the_ratios_of_pgv_to_pga_that_toppling_asks_for():
    low, high = np.percentile([r.intensity["pgv_pga_s"] for r in synthetic_ensemble(140, 1)], [5, 95])
    assert low == pytest.approx(0.04, rel=0.25)
    assert high == pytest.approx(0.25, rel=0.25)
