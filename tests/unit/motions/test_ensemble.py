"""An ensemble comes back as it was written, one record at a time, and knows when it is not itself."""

import pickle
import shutil

import numpy as np
import pyarrow.parquet as pq
import pytest

from models import InputError
from models.motions.ensemble import CATALOG, MOTIONS, Ensemble
from models.motions.synthetic import synthetic_ensemble


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


def test_one_row_group_a_record(ensemble):
    assert pq.ParquetFile(ensemble.folder / MOTIONS).num_row_groups == 3


def test_the_id_is_that_of_the_content_not_of_the_order_or_the_place(ensemble, made, tmp_path):
    assert Ensemble.write(tmp_path / "again", made).id == ensemble.id
    assert Ensemble.write(tmp_path / "less", made[:2]).id != ensemble.id


def test_it_can_be_sent_to_another_process(ensemble):
    assert pickle.loads(pickle.dumps(ensemble)).id == ensemble.id


def test_nothing_hidden_is_left_behind(ensemble):
    assert sorted(p.name for p in ensemble.folder.iterdir()) == [CATALOG, MOTIONS]


def test_two_records_of_one_id_are_refused_before_anything_is_written(made, tmp_path):
    with pytest.raises(InputError, match="occur twice"):
        Ensemble.write(tmp_path / "e", [made[0], made[0]])
    assert not (tmp_path / "e").exists()


def test_a_catalogue_of_other_motions_is_refused(ensemble, made, tmp_path):
    other = Ensemble.write(tmp_path / "other", made[:2])
    shutil.copy(ensemble.folder / CATALOG, other.folder / CATALOG)
    with pytest.raises(InputError, match="do not belong together"):
        Ensemble.load(other.folder)


def test_a_folder_without_an_ensemble_and_an_unknown_record_are_refused(ensemble, tmp_path):
    with pytest.raises(InputError, match=r"no catalog\.parquet"):
        Ensemble.load(tmp_path)
    with pytest.raises(InputError, match="no record 'R9'"):
        ensemble.record("R9")


def test_an_ensemble_of_another_version_is_refused(made, tmp_path, monkeypatch):
    with monkeypatch.context() as other:
        other.setattr("models.motions.ensemble.SCHEMA_VERSION", "0")
        Ensemble.write(tmp_path / "old", made[:1])
    with pytest.raises(InputError, match="of version 0"):
        Ensemble.load(tmp_path / "old")


def test_every_column_of_the_catalogue_says_what_it_means_and_its_unit(ensemble):
    for field in pq.read_table(ensemble.folder / CATALOG).schema:
        assert field.metadata[b"description"], field.name
        ending = field.name.rpartition("_")[2]
        assert bool(field.metadata[b"unit"]) == (ending in {"s", "s2", "m", "km", "deg"}), field.name
