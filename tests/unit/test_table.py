"""A table says the same whatever program saved it; one that would fill the memory is refused before it is read."""

from pathlib import Path

import pyarrow as pa
import pytest
from refusals import refused

from toppling.models.files.digest import read_table, write_table
from toppling.models.files.documents import MOST_VALUES, read_json
from toppling.models.files.table import Table, plain_frame

ROWS = [["site", "PGA (g)", "years"], ["a, b", "0.5", "2475"], ["c", "1.25", "10000"]]


def of(text):
    return Table.of(text.splitlines(), Path("table.csv"))


@pytest.mark.parametrize(
    "text",
    [
        'site,PGA (g),years\n"a, b",0.5,2475\nc,1.25,10000\n',
        'site,PGA (g),years\n"a, b",0.5,"2,475"\n# left out\nc,1.25,"10,000"\n',
        "# of mine\n\nsite;PGA (g);years\na, b;0,5;2.475\n;;\nc;1,25;10.000\n",
        "sep=;\nsite;PGA (g);years\na, b;0.5;2,475\nc;1.25;10,000\n",
        "site\tPGA (g)\tyears\na, b\t0,5\t2475\nc\t1,25\t10000\n",
    ],
)
def test_cells_are_the_same_however_they_are_saved(text):
    assert [row for _, row in of(text).rows] == ROWS


@pytest.mark.parametrize(
    ("text", "cells"),
    [
        ("x\ty\n1,500\t2,750\n", ["1,500", "2,750"]),
        ("x;y\n1,500;2,750\n", ["1,500", "2,750"]),
        ("x,y\n0.5,\"0,5\"\n", ["0.5", "0,5"]),
        ("0,5 1,25\n0,5 1,25\n", ["0.5", "1.25"]),
        ("name,unit\nr1,2.txt,0\n", ["r1", "2.txt", "0"]),
        ("file;unit\nr1,2.txt;0,5 gal\n", ["r1,2.txt", "0.5 gal"]),
        ("years\n1500\n", ["1500"]),
        ("Age (ka)\n15\n", ["15"]),
        ("#,mag\n1,6\n", ["1", "6"]),
    ],
)  # fmt: skip
def test_a_comma_is_decimal_between_thousands_or_left_as_the_table_shows(text, cells):
    assert of(text).rows[1][1] == cells


@pytest.mark.parametrize("line", ["1,500;2,750", "1,500\t2,750", "1,500 2,750", '"1,500","2,750"'])
def test_three_decimals_of_coordinates_are_no_thousands(line):
    table = Table.of([line] * 2, Path(), coordinates=True)
    assert table.rows[1][1] == ["1.500", "2.750"]


def repeated_text():
    return pa.DictionaryArray.from_arrays(pa.array([0] * 9_000, pa.int32()), ["y" * 900_000])


BOMBS = {
    "zstd": lambda: ["x" * 100_000_000],
    "rows": lambda: pa.nulls(50_000_000, pa.int8()).fill_null(1),
    "a list": lambda: pa.array([[0.0] * 20_000_000], pa.list_(pa.float64())),
    "repeated text": repeated_text,
    "repeated text in lists": lambda: pa.ListArray.from_arrays(
        pa.array([0, 9_000], pa.int32()), repeated_text()
    ),
}


@pytest.mark.parametrize("bomb", BOMBS.values(), ids=BOMBS)
def test_a_small_file_that_would_fill_the_memory_is_refused(tmp_path, bomb):
    path = tmp_path / "catalog.parquet"
    # Without the schema of Arrow the file says "text", as one of another program.
    write_table(pa.table({"event": bomb()}), path, store_schema=False)
    assert path.stat().st_size < 600_000
    before = pa.total_allocated_bytes()
    with refused("table.too_large", "catalog.parquet"):
        read_table(path)
    assert pa.total_allocated_bytes() - before < 50_000_000


def test_tables_as_the_program_writes_them_are_read(tmp_path):
    ids = [f"{number:024x}" for number in range(300_000)]
    table = pa.table({"job_id": ids, "preset": ["fast"] * len(ids), "level": [2.0] * len(ids)})
    write_table(table, tmp_path / "jobs.parquet", 20_000)
    assert read_table(tmp_path / "jobs.parquet").equals(table)


def test_json_of_too_many_values_is_refused_before_it_is_parsed(tmp_path):
    path = tmp_path / "scene.json"
    path.write_text('{"a": [' + "[]," * (MOST_VALUES // 2) + "[]]}")
    with refused("document.too_many_values"):
        read_json(path)


def test_no_cell_of_an_exported_table_is_a_formula():
    import pandas as pd

    cells = ["=1+1", "+cmd|' /C calc'!A0", "-2+3", "@SUM(A1)", "\t=1", "plain", "-1.5", None, 3]
    frame = pd.DataFrame({"=name": cells, "number": range(9), "kind": pd.Categorical(["=a", "b", "c"] * 3)})
    text = plain_frame(frame).to_csv(index=False)
    lines = [line for line in text.splitlines() if line]
    assert lines[0] == "'=name,number,kind"
    assert lines[1] == "'=1+1,0,'=a"
    assert lines[7] == "-1.5,6,'=a"
    assert not any(line.startswith(("=", "+", "@", "\t")) for line in lines)
    assert "-2+3" not in [line.split(",")[0] for line in lines]
