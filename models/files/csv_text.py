"""Text in tables that are written: what is a number, and what a spreadsheet would take for a formula."""

from pathlib import Path
from typing import Any

from toppling.models.files.folder import new_file

_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""With which a cell begins that a spreadsheet calculates, or that hides one that does."""


def is_numeral(text: str) -> bool:
    """Whether a text is a number as Python writes it.

    Examples
    --------
    >>> [is_numeral(text) for text in ("-1.5e3", "", "1.5 m")]
    [True, False, False]
    """
    try:
        float(text)
    except ValueError:
        return False
    return True


def plain(value: Any) -> Any:
    """A cell's value; text that a spreadsheet would calculate gets an apostrophe, numbers stay.

    Examples
    --------
    >>> [plain(cell) for cell in ("=HYPERLINK(A1)", "-1.5", "St. Gallen", -2)]
    ["'=HYPERLINK(A1)", '-1.5', 'St. Gallen', -2]
    """
    if not isinstance(value, str) or not value.startswith(_FORMULA) or is_numeral(value):
        return value
    return f"'{value}"


def plain_frame(frame: Any) -> Any:
    """A pandas frame with plain cells, names of its columns and of its rows included."""
    cells = frame.copy()
    for index, kind in enumerate(frame.dtypes):
        if kind.kind == "O":  # of texts and categories too; numbers, times and truths have kinds of their own
            column = frame.iloc[:, index]
            texts = [plain(value) for value in column]  # whole numbers stay
            cells.isetitem(index, type(column)(texts, column.index, dtype=object))
    return cells.rename(columns=plain, index=plain)


def write_csv(frame: Any, target: Path, *, digits: int | None = 6, index: bool = False) -> Path:
    """Write a pandas frame with plain cells; the file appears complete or not at all."""
    with new_file(target) as hidden:
        plain_frame(frame).to_csv(hidden, index=index, float_format=digits and f"%.{digits}g")
    return target
