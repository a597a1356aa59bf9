"""What README states of the program's errors is not less than what the benchmarks found."""

import re
from itertools import takewhile
from pathlib import Path

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
REPORTS = ROOT / "benchmarks" / "reports"


def column(page, name):
    """Numbers of one column of all tables of a report that have it, by the beginning of the column's name."""
    text = (REPORTS / page).read_text()
    heads = list(re.finditer(rf"^\|.*\| {name}.*$", text, re.M))
    assert heads, f"{page} has no table with a column '{name}'"
    cells = []
    for head in heads:
        lines = text[head.start() :].splitlines()
        rows = [line.strip("|").split("|") for line in takewhile(lambda line: line.startswith("|"), lines)]
        place = next(place for place, told in enumerate(rows[0]) if told.strip().startswith(name))
        cells += [row[place] for row in rows[2:]]
    found = [re.search(r"-?[\d.]+", cell) for cell in cells]
    return [abs(float(one.group())) for one in found if one and any(map(str.isdigit, one.group()))]


def stated(words):
    return float(re.search(words, README).group(1))


def test_thresholds_are_as_near_the_exact_ones_as_readme_says():
    (row,) = re.findall(r"^\| overturning threshold \|(.*)$", (REPORTS / "accuracy.md").read_text(), re.M)
    found = [float(cell.strip().split()[0]) for cell in row.split("|")[:3]]
    assert max(found) <= stated(r"are met within ([\d.]+) %")


def test_scans_are_as_right_as_readme_says():
    assert max(column("scan.md", "volume")) <= stated(r"volume within ([\d.]+) %")
    assert max(column("scan.md", "centre of mass")) <= stated(r"centre of mass within ([\d.]+) %")
