"""A table says the same whatever program of whatever country saved it, or keeps what nobody can tell."""

from pathlib import Path

import pytest
from refusals import refused

from toppling.models.files.table import Table

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


@pytest.mark.parametrize("sign", [";", "\t", " "])
def test_three_decimals_of_coordinates_are_no_thousands(sign):
    table = Table.of([sign.join(["1,500", "2,750"])] * 2, Path(), coordinates=True)
    assert table.rows[1][1] == ["1.500", "2.750"]


def test_a_quote_that_nobody_closes_is_refused_with_its_line():
    with refused("table.unreadable", "table.csv:2"):
        of('a,b\n"' + "9" * 200_000)
