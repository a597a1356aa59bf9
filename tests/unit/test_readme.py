"""What README states is what the benchmarks found."""

import re
from itertools import takewhile
from pathlib import Path

ROOT = Path(__file__).parents[2]


def table(text: str, head: str) -> list[str]:
    lines = text[text.index(f"| {head} |") :].splitlines()
    return list(takewhile(lambda line: line.startswith("|"), lines))


def test_the_table_of_exact_cases_is_that_of_the_benchmark():
    stated = table((ROOT / "README.md").read_text(), "case")
    assert stated == table((ROOT / "docs" / "accuracy.md").read_text(), "case")
    assert len(stated) > 10


def test_the_counts_of_flips_are_those_of_the_benchmark():
    stated = re.findall(
        r"\| ([\d,]+) \| [\d.]+ ± [\d.]+ % \((\d+), (\d+)\) \|", (ROOT / "README.md").read_text()
    )
    found = [row.split(" | ") for row in table((ROOT / "docs" / "sign_test.md").read_text(), "setting")[2:]]
    assert [(jobs.replace(",", ""), up, down) for jobs, up, down in stated] == [
        (jobs, up, down) for _, jobs, _, up, down, *_ in found
    ]
    assert len(found) == 5
