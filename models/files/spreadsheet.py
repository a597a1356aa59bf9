"""Tables that a spreadsheet saved again: other signs between cells, decimal commas, commas between thousands."""

import csv
import io
import re
from collections.abc import Sequence

_COMMA_NUMBER = re.compile(r"[-+]?\d+(,\d+)+(\.\d+)?(e[-+]?\d+)?", re.IGNORECASE)
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?")
_BETWEEN = re.compile(r"(?<=\d),(?=\d)")


def plain_table(lines: Sequence[str]) -> list[str]:
    """Lines of a table with commas between cells and decimal points, whatever program saved it; others as they are.

    Commas between digits are decimal, unless each of them may part thousands.

    Examples
    --------
    >>> plain_table(["PGA (g);annual_rate", "0,1;1,5E-03"])
    ['PGA (g),annual_rate', '0.1,1.5E-03']
    >>> plain_table(["PGA (g),return_period", '0.1,"2,475"'])
    ['PGA (g),return_period', '0.1,2475']
    """
    sign = _sign(lines)
    if sign == "," and not any('"' in line for line in lines):
        return list(lines)
    bare = [_unquoted(line, sign) for line in lines]
    table = [_cells(line, sign) for line in bare]
    commas = [cell.strip() for row in table for cell in row if _COMMA_NUMBER.fullmatch(cell.strip())]
    if sign == "," and not commas:
        return bare
    instead = "" if all(map(_THOUSANDS.fullmatch, commas)) else "."
    return [
        _joined(row if row[:1] == ["#"] else [_BETWEEN.sub(instead, cell) for cell in row]) for row in table
    ]


def _sign(lines: Sequence[str]) -> str:
    """Sign that most lines have, comments left out; where decimal commas stand beside another sign, that one."""
    table = [line for line in lines if not line.lstrip('" ').startswith(("#", "%", "//"))]
    return max("\t;,", key=lambda sign: sum(sign in line for line in table))


def _cells(line: str, sign: str) -> list[str]:
    try:
        return next(csv.reader([line], delimiter=sign), [])
    except csv.Error:  # which the reader of the table tells of
        return [line]


def _unquoted(line: str, sign: str) -> str:
    """A comment without the quotes around all of it; another line as it is."""
    text = line.rstrip(sign + " ")
    return text[1:-1].replace('""', '"') if text.startswith('"#') and text.endswith('"') else line


def _joined(cells: Sequence[str]) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="").writerow(cells)
    return out.getvalue()
