"""Tables of shake-table tests and the table's motions."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from toppling.models.errors import InputError
from toppling.models.motions.shaketable import read_experiment


def plain_folder(folder, outcomes, motions):
    rows = "\n".join(f"{number},{'quake'},{value},1" for number, value in outcomes.items())
    (folder / "tests.csv").write_text(f"test_no,ground_motion,sp9_overturned,dem_sp9_soft\n{rows}\n")
    table = {
        "test_no": list(motions),
        "dt_s": [0.01] * len(motions),
        "acc_m_s2": [list(map(float, each)) for each in motions.values()],
    }
    pq.write_table(pa.table(table), folder / "motions.parquet")


def test_tests_with_motion_and_outcome_are_read_and_the_others_counted(tmp_path):
    plain_folder(tmp_path, {7: 1, 3: 0, 5: "", 9: 0}, {3: [0, 1, 0], 7: [0, 2, 0], 5: [0, 3, 0]})
    read = read_experiment(tmp_path, "sp9_overturned")
    assert [(test.test_no, test.overturned) for test in read.tests] == [(3, False), (7, True)]
    assert read.without_motion == 1
    assert read.tests[0].predicted == {"dem_sp9_soft": True}
    np.testing.assert_array_equal(read.motions[1].acceleration_m_s2[:, 0], [0.0, 2.0, 0.0])


def test_an_outcome_that_is_no_column_is_refused_with_the_columns_there_are(tmp_path):
    plain_folder(tmp_path, {3: 0}, {3: [0, 1, 0]})
    with pytest.raises(InputError, match="sp9_overturned"):
        read_experiment(tmp_path, "sp1_overturned")


def test_files_as_they_were_published_are_refused_with_what_converts_them(tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "Test004.txt").write_text("Time\n")
    with pytest.raises(InputError, match="convert_shaketable"):
        read_experiment(tmp_path, "sp1_overturned")
