"""Shake-table tests as the experiment was published, written as `toppling validate` reads them.

    .venv/bin/python benchmarks/convert_shaketable.py FOLDER OUT

FOLDER holds `TestNNN.txt`, a workbook of results and one of ground motions, in any subfolder; OUT gets `tests.csv` and
`motions.parquet`.

A text file holds pairs of columns, time (s) and amplitude, of four channels at 800 Hz: acceleration of the table (g), a
second accelerometer (g), displacement of the actuator (counts, the other way round) and one more displacement. Below
some hertz the accelerometer drifts and the displacement is exact, above it is the other way round, so the two are
fused by complementary filters. The constants were found by comparison with fused motions of the same experiment.
"""

import csv
import lzma
import math
import re
import sys
import warnings
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.signal import butter, sosfiltfilt

from toppling.models.arrays import Array
from toppling.models.errors import InputError, refusals
from toppling.models.files.documents import check_size
from toppling.models.files.folder import new_folder
from toppling.models.frames import STANDARD_GRAVITY_M_S2
from toppling.models.motions.shaketable import BAND_HZ, MOTIONS, TESTS

METRES_A_COUNT = -1.524e-5
"""0.6 thousandths of an inch, opposite to the accelerometer's positive direction."""
_CROSSOVER_HZ, _CROSSOVER_ORDER = 4.0, 2
_BAND_ORDER = 3
_KEPT_EVERY = 2
"""Samples, of those filtered to the band."""
ACCELERATION, _DISPLACEMENT = 1, 5
"""Columns of the text file."""
_LEAST_SAMPLES = 100
_MOST_TESTS = 1_000_000
_LARGEST_SHEET_BYTES = 50_000_000
_NO_WORKBOOK = (
    zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, OSError, LookupError, ValueError, RuntimeError,
    OverflowError, RecursionError, ElementTree.ParseError,
)  # fmt: skip
"""What the libraries raise at one that is damaged, encrypted, packed in another way, or has cells of no text."""


_no_experiment = refusals(
    expected="the experiment's own files: TestNNN.txt of four channels, workbooks of results and of records",
    remedy="give the folder that was published",
)


def convert(folder: Path, out: Path) -> None:
    """Write the table of tests and their motions into a new folder.

    Raises InputError if no workbook holds results, or a file of a test does not hold four channels.
    """
    tests, motions = raw_tests(folder), raw_motions(folder)
    with new_folder(out) as hidden:
        with (hidden / TESTS).open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(tests[0]))
            writer.writeheader()
            writer.writerows(tests)
        table = {
            "test_no": list(motions),
            "dt_s": [step_s for _, step_s in motions.values()],
            "acc_m_s2": [along.tolist() for along, _ in motions.values()],
        }
        pq.write_table(pa.table(table), hidden / MOTIONS)


def raw_motions(folder: Path) -> dict[int, tuple[Array, float]]:
    """Acceleration of the table (m/s2) and its time step (s) by the numbers of the tests."""
    found = {}
    for path in sorted(folder.rglob("Test*.txt")):
        named = re.fullmatch(r"Test[ _]*0*(\d+)", path.stem)
        if named:
            found[int(named[1])] = _raw_motion(path)
    return found


def _raw_motion(path: Path) -> tuple[Array, float]:
    """Acceleration of the table in one test (m/s2), and its time step (s)."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of an empty file, which is told below
            columns = np.loadtxt(path, skiprows=1, usecols=(0, ACCELERATION, _DISPLACEMENT), ndmin=2)
    except (ValueError, IndexError, OSError, UnicodeDecodeError) as error:
        short = re.search(r"at row (\d+) with", str(error))
        what = f"line {int(short[1]) + 1} is cut off" if short else f"cannot be read ({error})"
        raise _no_experiment(what, path) from None
    if len(columns) < _LEAST_SAMPLES:
        raise _no_experiment(f"{len(columns)} samples, fewer than {_LEAST_SAMPLES}", path)
    time_s = columns[:, 0]
    step_s = round(float((time_s[-1] - time_s[0]) / (len(columns) - 1)), 6)
    even_s = time_s[0] + step_s * np.arange(len(columns))
    # Times are printed with six digits.
    if not np.isfinite(columns).all() or np.abs(time_s - even_s).max() > 0.5 * step_s:
        raise _no_experiment("values that are no numbers, or samples not at equal times", path)
    along = fused_m_s2(columns[:, 1] * STANDARD_GRAVITY_M_S2, columns[:, 2] * METRES_A_COUNT, step_s)
    return along[::_KEPT_EVERY], _KEPT_EVERY * step_s


def fused_m_s2(acceleration_m_s2: Array, displacement_m: Array, time_step_s: float) -> Array:
    """Acceleration of the table: that of its displacement at low frequencies, the accelerometer's above."""
    low = _low_passed(displacement_m, _CROSSOVER_HZ, _CROSSOVER_ORDER, time_step_s)
    from_displacement = np.gradient(np.gradient(low, time_step_s), time_step_s)
    measured = acceleration_m_s2 - _low_passed(
        acceleration_m_s2, _CROSSOVER_HZ, _CROSSOVER_ORDER, time_step_s
    )
    return _low_passed(from_displacement + measured, BAND_HZ, _BAND_ORDER, time_step_s)


def raw_tests(folder: Path) -> list[dict[str, Any]]:
    """Rows of the workbook of results, with the ground motions of the workbook of records where it lies beside it.

    Columns are renamed: `spN_overturned` is the outcome of specimen N, `dem_spN_...` a numerical prediction of it.

    Raises InputError if no workbook holds results.
    """
    results: list[dict[str, Any]] = []
    motions: dict[int, str] = {}
    for path in sorted(folder.rglob("*.xlsx")):
        rows = [row for row in sheet(path) if row]
        titled = next(
            (k for k, row in enumerate(rows) if str(row.get("A", "")).strip().startswith("Test N")), None
        )
        if titled is None:
            continue
        titles = {letter: str(title).strip() for letter, title in rows[titled].items()}
        numbered = [row for row in rows[titled + 1 :] if _is_number(row.get("A"))]
        if any("Experimental Results" in title for title in titles.values()):
            names = {letter: _column(title) for letter, title in titles.items()}
            results = [
                {names[letter]: row.get(letter) for letter in names} | {"test_no": int(row["A"])}
                for row in numbered
            ]
        motion = next((letter for letter, title in titles.items() if title == "Ground Motion"), None)
        if motion:
            motions |= {int(row["A"]): _record_name(str(row.get(motion, ""))) for row in numbered}
    if not results:
        raise _no_experiment(
            "no workbook (xlsx) with 'Test Number' and 'Experimental Results ...' in its first row", folder
        )
    return [row | {"ground_motion": motions.get(row["test_no"], "")} for row in results]


def sheet(path: Path) -> Iterator[Mapping[str, Any]]:
    """Rows of a workbook's first sheet, each a mapping from the column's letter to a number or a text."""
    check_size(path, _LARGEST_SHEET_BYTES, "a workbook")
    try:
        with zipfile.ZipFile(path) as book:
            shared = []
            if "xl/sharedStrings.xml" in book.namelist():
                strings = _parsed(book, "xl/sharedStrings.xml", path)
                shared = ["".join(text.itertext()) for text in strings if text.tag.endswith("}si")]
            root = _parsed(book, "xl/worksheets/sheet1.xml", path)
        rows = [
            {re.sub(r"\d", "", cell.get("r", "")): _value(cell, shared) for cell in row}
            for row in root.iter()
            if row.tag.endswith("}row")
        ]
    except InputError:
        raise
    except _NO_WORKBOOK as error:
        reason = str(error) or type(error).__name__
        raise _no_experiment(f"is no workbook, or a damaged one ({reason})", path) from None
    yield from rows


def _parsed(book: zipfile.ZipFile, name: str, path: Path) -> ElementTree.Element:
    if book.getinfo(name).file_size > _LARGEST_SHEET_BYTES:
        raise _no_experiment(f"{name} is too large", path)
    with book.open(name) as part:  # what the archive says of the size may be wrong
        content = part.read(_LARGEST_SHEET_BYTES + 1)
    if len(content) > _LARGEST_SHEET_BYTES:
        raise _no_experiment(f"{name} is too large", path)
    text = content.decode("utf-8-sig")  # another encoding would hide what is looked for
    if "<!DOCTYPE" in text or "<!ENTITY" in text:  # entities can grow without bound
        raise _no_experiment("its XML declares entities", path)
    return ElementTree.fromstring(text.encode())


def _value(cell: ElementTree.Element, shared: list[str]) -> float | str | None:
    text = "".join(part for child in cell if child.tag.endswith(("}v", "}is")) for part in child.itertext())
    if cell.get("t") == "s":
        return shared[int(text)]
    if cell.get("t") in ("inlineStr", "str"):
        return text
    try:
        return float(text)
    except ValueError:
        return None


def _is_number(value: object) -> bool:
    """Whether a cell holds the number of a test."""
    return isinstance(value, float) and math.isfinite(value) and abs(value) < _MOST_TESTS


def _column(title: str) -> str:
    """Short name of a column of the workbook of results."""
    if title.startswith("Test N"):
        return "test_no"
    specimen = re.search(r"Specimen (\d+)", title)
    if specimen is None:
        return title
    if "Experimental" in title:
        return f"sp{specimen[1]}_overturned"
    words = re.findall(r"([A-Za-z]+)=([\d.]+)", title)
    return "_".join([f"dem_sp{specimen[1]}", *(f"{name.lower()}{value}" for name, value in words)])


def _record_name(text: str) -> str:
    return re.sub(r"\.(xlsx|AT2|txt)$", "", text.strip().strip("'").strip(), flags=re.IGNORECASE).strip()


def _low_passed(values: Array, corner_hz: float, order: int, time_step_s: float) -> Array:
    """Butterworth's filter forward and backward, without delay."""
    return np.asarray(sosfiltfilt(butter(order, corner_hz, fs=1.0 / time_step_s, output="sos"), values))


if __name__ == "__main__":
    try:
        convert(Path(sys.argv[1]), Path(sys.argv[2]))
    except IndexError:
        sys.exit(__doc__)
    except (InputError, FileExistsError) as refused:
        sys.exit(str(refused))
