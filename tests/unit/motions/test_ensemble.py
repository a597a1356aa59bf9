"""An ensemble comes back as it was written, one record at a time, and knows when it is not itself."""

import shutil
import subprocess
import sys

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from refusals import refused

from toppling.models.files.digest import write_table
from toppling.models.motions.ensemble import CATALOG, MOTIONS, Ensemble
from toppling.models.motions.measures import MEASURES
from toppling.models.motions.synthetic import synthetic_ensemble


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


def test_reading_records_leaves_pandas_and_its_memory_out(ensemble):
    program = (
        "import sys; from toppling.models.motions.ensemble import Ensemble; "
        f"e = Ensemble.load({str(ensemble.folder)!r}); e.motion(e.record_ids[0], pga_m_s2=2.0, azimuth_deg=0.0); "
        "print('pandas' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-P", "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_the_id_is_that_of_the_content_not_of_the_order_or_the_place(ensemble, made, tmp_path):
    assert Ensemble.write(tmp_path / "again", made).id == ensemble.id
    assert Ensemble.write(tmp_path / "less", made[:2]).id != ensemble.id


def test_two_records_of_one_id_are_refused_before_anything_is_written(made, tmp_path):
    with refused("ensemble.id_repeated"):
        Ensemble.write(tmp_path / "e", [made[0], made[0]])
    assert not (tmp_path / "e").exists()


def test_a_catalogue_of_other_motions_is_refused(ensemble, made, tmp_path):
    other = Ensemble.write(tmp_path / "other", made[:2])
    shutil.copy(ensemble.folder / CATALOG, other.folder / CATALOG)
    with refused("ensemble.files_foreign"):
        Ensemble.load(other.folder)


@pytest.mark.parametrize("column", [name for name, measure in MEASURES.items() if not measure.added_later])
def test_a_catalogue_without_a_measure_that_rows_have_is_refused(ensemble, tmp_path, column):
    shutil.copytree(ensemble.folder, tmp_path / "e")
    path = tmp_path / "e" / CATALOG
    write_table(pq.read_table(path).drop_columns([column]), path)
    with refused("ensemble.column_missing", column):
        Ensemble.load(tmp_path / "e")


def rewritten(ensemble, folder, name, column, change):
    """Copy of an ensemble with one column of a file changed, its metadata kept."""
    shutil.copytree(ensemble.folder, folder)
    table = pq.read_table(folder / name)
    changed = pa.array([change(value) for value in table.column(column).to_pylist()])
    index = table.schema.get_field_index(column)
    write_table(table.set_column(index, table.schema.field(column), changed), folder / name, rows_in_group=1)
    return Ensemble.load(folder)


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
    other = rewritten(ensemble, tmp_path / "other", name, column, change)
    with refused("ensemble.motion_foreign", what):
        other.record(other.record_ids[1])


def test_every_column_of_the_catalogue_says_what_it_means_and_its_unit(ensemble):
    for field in pq.read_table(ensemble.folder / CATALOG).schema:
        assert field.metadata[b"description"], field.name
        ending = field.name.rpartition("_")[2]
        assert bool(field.metadata[b"unit"]) == (ending in {"s", "s2", "m", "km", "deg"}), field.name
