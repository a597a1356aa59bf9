"""The documentation's site builds and asks no other host; README states no smaller errors than were found."""

import os
import re
import subprocess
import sys
from itertools import takewhile
from pathlib import Path

import pytest

import toppling

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_the_site_builds_without_a_warning_and_documents_every_name_at_the_door(tmp_path):
    subprocess.run(["make", "--silent", "packages"], cwd=ROOT, check=True)
    build = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", tmp_path / "site"]
    environment = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(build, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    pages = {path.name: path.read_text() for path in (tmp_path / "site").rglob("*.html")}
    for name in set(toppling.__all__):
        assert re.search(rf'id="toppling\.[\w.]*\.{name}"', pages["reference.html"]), name
    loaded = {
        host
        for page in pages.values()
        for host in re.findall(r'<(?:script|link|img)[^>]*(?:src|href)="https?://([^/"]+)', page)
    }
    assert loaded == set()


def test_every_page_of_the_documentation_is_in_the_site():
    listed = (ROOT / "mkdocs.yml").read_text()
    for page in (ROOT / "docs").rglob("*.md"):
        assert str(page.relative_to(ROOT / "docs")) in listed, page


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
        place = next(place for place, entry in enumerate(rows[0]) if entry.strip().startswith(name))
        cells += [row[place] for row in rows[2:]]
    found = [re.search(r"-?[\d.]+", cell) for cell in cells]
    return [abs(float(entry.group())) for entry in found if entry and any(map(str.isdigit, entry.group()))]


def stated(words):
    return float(re.search(words, README).group(1))


def test_thresholds_are_as_near_the_exact_thresholds_as_the_readme_states():
    (row,) = re.findall(r"^\| overturning threshold \|(.*)$", (REPORTS / "accuracy.md").read_text(), re.M)
    found = [float(cell.strip().split()[0]) for cell in row.split("|")[:3]]
    assert max(found) <= stated(r"are met within ([\d.]+) %")


def test_scans_are_as_accurate_as_the_readme_states():
    assert max(column("scan.md", "volume")) <= stated(r"volume within ([\d.]+) %")
    assert max(column("scan.md", "centre of mass")) <= stated(r"centre of mass within ([\d.]+) %")
