"""Lines of plain columns: remarks, quotes, and commas that part numbers or are within them."""

import re
from itertools import pairwise

from toppling.models.motions.formats.column_times import as_seconds

COMMENT = ("#", "%", "!", "//", ";")
_COMMA_NUMBER = re.compile(r"[-+]?(?:\d+,?\d*|,\d+)(?:[EeDd][-+]?\d+)?$")
SEPARATORS = ";\t,"
"""What stands between numbers, beside blanks; of names the first of these that a line has."""
_AS_BLANKS = str.maketrans(dict.fromkeys(SEPARATORS, " "))
_NOT_COMMA = SEPARATORS.replace(",", "")
_BETWEEN = re.compile(rf",(?=[\s{_NOT_COMMA}]|$)")
"""A comma with a blank behind it, which stands between two numbers whatever other commas do."""


def is_decimal_comma(lines: list[str]) -> bool:
    """Whether commas in lines of numbers are decimal points: where something else stands between the numbers.

    One comma a line may be either: it stands between two columns if what is before it goes on as times do.
    """
    bare = [_BETWEEN.sub(" ", line.strip(f" {SEPARATORS}")) for line in lines if is_body(line)]
    rows = [re.split(rf"[\s{_NOT_COMMA}]+", line) for line in bare]
    numbers = [number for row in rows for number in row]
    if not any("," in number for number in numbers) or not all(map(_COMMA_NUMBER.match, numbers)):
        return False
    if all(len(row) > 1 for row in rows):
        return True
    before = [int(row[0].partition(",")[0] or 0) for row in rows]
    return any(b <= a for a, b in pairwise(before))


def plain_line(line: str) -> str:
    """Line without quotes, a time of day as seconds."""
    return as_seconds(unquoted(line))


def unquoted(line: str) -> str:
    """Line without quotes."""
    return line.replace('"', "")


def is_body(line: str) -> bool:
    """Whether a line is neither blank nor a remark."""
    return bool(line.strip()) and not line.lstrip().startswith(COMMENT)


def separated(line: str, decimal_comma: bool) -> str:
    """Line with a blank between its numbers, and their decimals behind a point."""
    if decimal_comma:
        line = _BETWEEN.sub(" ", line).replace(",", ".")
    return line.translate(_AS_BLANKS)


def cells_of(line: str, decimal_comma: bool) -> list[str]:
    """Numbers, or words, of a line."""
    return separated(line, decimal_comma).split()
