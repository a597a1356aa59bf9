"""Shake-table tests of a specimen: what the table did, whether the rock overturned, what others predicted.

A folder holds `tests.csv` (one row a test: `test_no`, a column of outcomes, and where known `ground_motion`) and
`motions.parquet` (`test_no`, `dt_s`, `acc_m_s2` along the table's axis).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from toppling.models.errors import InputError
from toppling.models.files.documents import LARGEST_CSV_BYTES, check_size, listed
from toppling.models.files.tables import check_bounds
from toppling.models.motions.motion import Motion
from toppling.models.motions.record import Record

TESTS, MOTIONS = "tests.csv", "motions.parquet"
BAND_HZ = 25.0
"""The motions' band; beyond it an accelerometer tells of the table's bearings rather than of its motion."""
_ALONG_X_DEG = (0.0, 90.0)
"""The table's axis is x: which way it points in the mesh's frame is the campaign's to say."""
_UNKNOWN_RECORD = "unknown record"
"""Tests whose record is not known count as one record: none of them may tell of another."""
_MOST_NAMED = 8
_END_S, _STILL_SHARE = 0.25, 0.15
"""A table has come to rest if its last motion (root mean square) is less than this share of the peak."""


@dataclass(frozen=True)
class Test:
    """One test of which the outcome is known."""

    test_no: int
    # The record that the table followed, at whatever amplitude: tests of one are not independent.
    ground_motion: str
    overturned: bool
    predicted: Mapping[str, bool]  # other people's predictions of this specimen by their names

    @property
    def record_id(self) -> str:
        """Its motion in the ensemble."""
        return f"test_{self.test_no:04d}"


@dataclass(frozen=True, eq=False)
class Experiment:
    """Tests with motion and outcome, by their numbers."""

    tests: tuple[Test, ...]
    motions: tuple[Motion, ...]  # as many; the table's motion along x
    without_motion: int  # tests with an outcome of which the table's motion is not known

    @property
    def warnings(self) -> list[str]:
        """What may be wrong with the files, in sentences."""
        messages = []
        unknown = [test.test_no for test in self.tests if test.ground_motion == _UNKNOWN_RECORD]
        if unknown:
            messages.append(
                f"which record the table followed is not known of {_named(unknown)}, which count as one record: "
                "give a column ground_motion in tests.csv"
            )
        pairs = zip(self.tests, self.motions, strict=True)
        moving = [test.test_no for test, motion in pairs if not _ends_at_rest(motion)]
        if moving:
            messages.append(f"the table still moves at the end of {_named(moving)}: is the file cut off?")
        return messages

    def records(self) -> Iterator[Record]:
        """The tests' motions, measured."""
        for test, motion in zip(self.tests, self.motions, strict=True):
            yield Record.of(
                test.record_id,
                motion,
                event=test.ground_motion,
                station="shaking table",
                component_azimuths_deg=_ALONG_X_DEG,
                quality="corrected",
            )


def read_experiment(folder: Path, outcome: str) -> Experiment:
    """Read a folder of tests.

    outcome: Column of 0 and 1, such as `sp1_overturned`; empty where the specimen was not on the table.
    Raises InputError if a file or a column is missing, or no test has both motion and outcome.
    """
    if not (folder / TESTS).exists() and any(folder.rglob("Test*.txt")):
        raise InputError(
            "holds an experiment as it was published",
            where=str(folder),
            expected=f"{TESTS} and {MOTIONS}",
            remedy=f"make them: python benchmarks/convert_shaketable.py {folder} NEW_FOLDER, from the sources",
        )
    rows, motions = _rows(folder / TESTS), _motions(folder / MOTIONS)
    for name in ("test_no", outcome):
        if not rows or name not in rows[0]:
            columns = ", ".join(rows[0]) if rows else "none"
            raise InputError(
                f"no column {name!r}",
                where=str(folder),
                expected=f"one of its columns: {columns}",
                remedy="name the specimen's outcomes with --outcome",
            )
    known = [_test(row, outcome) for row in rows if _is_known(row[outcome])]
    moved = sorted((test for test in known if test.test_no in motions), key=lambda test: test.test_no)
    if not moved:
        raise InputError(
            f"{len(known)} tests with an outcome, {len(motions)} with a motion, none with both",
            where=str(folder),
            expected="tests with both",
            remedy="check the test numbers, and that --outcome names the right specimen",
        )
    return Experiment(tuple(moved), tuple(motions[test.test_no] for test in moved), len(known) - len(moved))


def _rows(path: Path) -> list[dict[str, Any]]:
    check_size(path, LARGEST_CSV_BYTES, "CSV")
    try:
        return pyarrow.csv.read_csv(path).to_pylist()
    except (OSError, pa.ArrowException) as error:
        raise _unreadable(path, error, "a table of tests with a header, separated by commas") from None


def _motions(path: Path) -> dict[int, Motion]:
    try:
        check_bounds(path)
        rows: Iterable[Mapping[str, Any]] = pq.read_table(
            path, columns=["test_no", "dt_s", "acc_m_s2"]
        ).to_pylist()
    except (OSError, pa.ArrowException) as error:
        raise _unreadable(path, error, "Parquet with the columns test_no, dt_s and acc_m_s2") from None
    # A time step kept in single precision is that of the decimal it stands for.
    return {
        row["test_no"]: Motion(
            np.outer(np.asarray(row["acc_m_s2"], float), [1.0, 0.0, 0.0]), float(f"{row['dt_s']:.6g}")
        )
        for row in rows
    }


def _test(row: Mapping[str, Any], outcome: str) -> Test:
    number = int(row["test_no"])
    where = f"test {number}, {outcome}"
    specimen = outcome.split("_")[0]
    predicted = {
        name: value == 1
        for name, value in row.items()
        if name != outcome and specimen in name.split("_") and value in (0, 1)
    }
    if row[outcome] not in (0, 1):
        raise InputError(f"{row[outcome]!r}", where=where, expected="0 or 1", remedy="correct the table")
    return Test(number, str(row.get("ground_motion") or _UNKNOWN_RECORD), row[outcome] == 1, predicted)


def _named(test_numbers: list[int]) -> str:
    return f"test{'s' * (len(test_numbers) > 1)} {listed([str(one) for one in test_numbers], _MOST_NAMED)}"


def _ends_at_rest(motion: Motion) -> bool:
    along = motion.acceleration_m_s2[:, 0]
    last = along[-max(round(_END_S / motion.time_step_s), 1) :]
    return bool(np.sqrt((last**2).mean()) <= _STILL_SHARE * np.abs(along).max())


def _is_known(value: object) -> bool:
    return value not in (None, "") and value == value  # NaN is not itself


def _unreadable(path: Path, error: Exception, expected: str) -> InputError:
    return InputError(
        f"cannot be read ({error})" if path.exists() else "no such file",
        where=str(path),
        expected=expected,
        remedy="give the folder of the experiment; docs/validation.md describes its files",
    )
