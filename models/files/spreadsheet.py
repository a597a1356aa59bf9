"""Tables that a spreadsheet saved again: other signs between cells, decimal commas, commas between thousands."""

import csv
import io
import re
from collections.abc import Sequence

_COMMA_NUMBER = re.compile(r"[-+]?\d+(,\d+)+(\.\d+)?(e[-+]?\d+)?", re.IGNORECASE)
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?")
_DOTTED = re.compile(r"[-+]?(?!0)\d{1,3}(\.\d{3})+")
_BETWEEN = re.compile(r"(?<=\d),(?=\d)")
_RULE = re.compile(r"[\s|+:]*(?:--|==)[\s|+:=-]*")
"""Of a table in Markdown and its like, below the names or between rows."""
_POWER = re.compile(r"(?<=\d)\s*[×·]\s*10\^?([-+]?\d+|[⁺⁻]?[⁰¹²³⁴-⁹]+)")
_MINUS = re.compile(r"[\u2212\u2013](?=[\d.])")
_RAISED = str.maketrans("⁺⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "+-0123456789")


def plain_table(lines: Sequence[str]) -> list[str]:
    """Lines of a table with commas between cells and decimal points, whatever program saved it; others as they are.

    Commas between digits are decimal, unless each of them may part thousands; beside decimal commas dots part
    thousands. Rules become blank lines.

    Examples
    --------
    >>> plain_table(["PGA (g);annual_rate", "0,1;1,5E-03"])
    ['PGA (g),annual_rate', '0.1,1.5E-03']
    >>> plain_table(["PGA (g),return_period", '0.1,"2,475"'])
    ['PGA (g),return_period', '0.1,2475']
    >>> plain_table(["| PGA (g) | annual_rate |", "|---|---|", "| 0.1 | 1.5×10⁻³ |"])
    ['PGA (g),annual_rate', '', '0.1,1.5e-3']
    """
    lines = [line if line.isascii() else _ascii_numbers(line) for line in lines]
    sign = _sign(lines)
    if sign == "," and not any('"' in line for line in lines):
        return lines
    bare = [_unquoted(line, sign) for line in lines]
    table = [_cells(line, sign) for line in bare]
    commas = [cell.strip() for row in table for cell in row if _COMMA_NUMBER.fullmatch(cell.strip())]
    if sign == "," and not commas:
        return bare
    decimal = not all(map(_THOUSANDS.fullmatch, commas))
    dotted = [cell for row in table for cell in row if re.fullmatch(r"[-+]?\d+\.[\d.]+", cell.strip())]
    parted = decimal and all(_DOTTED.fullmatch(cell.strip()) for cell in dotted)

    def cell_of(text: str) -> str:
        if parted and _DOTTED.fullmatch(text.strip()):
            return text.replace(".", "")
        return _BETWEEN.sub("." if decimal else "", text)

    return [_joined(row if row[:1] == ["#"] else [cell_of(cell) for cell in row]) for row in table]


def _ascii_numbers(line: str) -> str:
    """Line with powers of ten and signs of numbers as Python reads them."""
    line = _POWER.sub(lambda power: f"e{power[1].translate(_RAISED)}", line.replace("∞", "inf"))
    return _MINUS.sub("-", line)


def _sign(lines: Sequence[str]) -> str:
    """Sign that most lines have, comments left out; where decimal commas stand beside another sign, that one."""
    table = [line for line in lines if not line.lstrip('" ').startswith(("#", "%", "//"))]
    return max("\t|;,", key=lambda sign: sum(sign in line for line in table))


def _cells(line: str, sign: str) -> list[str]:
    if sign == "|":
        inside = line.strip().removeprefix("|").removesuffix("|")
        return [] if _RULE.fullmatch(line) else [cell.strip() for cell in inside.split("|")]
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
