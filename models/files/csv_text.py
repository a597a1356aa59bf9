"""Text in tables for spreadsheets: what a spreadsheet would take for a formula stays text."""

from typing import Any

_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""With which a cell begins that a spreadsheet calculates, or that hides one that does."""


def plain(value: Any) -> Any:
    """A cell's value; text that a spreadsheet would calculate gets an apostrophe, numbers stay.

    Examples
    --------
    >>> [plain(cell) for cell in ("=HYPERLINK(A1)", "-1.5", "St. Gallen", -2)]
    ["'=HYPERLINK(A1)", '-1.5', 'St. Gallen', -2]
    """
    if not isinstance(value, str) or not value.startswith(_FORMULA):
        return value
    try:
        float(value)
    except ValueError:
        return f"'{value}"
    return value


def plain_frame(frame: Any) -> Any:
    """A pandas frame with plain cells, names of its columns and of its rows included."""
    cells = frame.copy()
    for index, kind in enumerate(frame.dtypes):
        if kind.kind == "O":  # of texts and categories too; numbers, times and truths have kinds of their own
            column = frame.iloc[:, index]
            texts = type(column)(
                [plain(value) for value in column], column.index, dtype=object
            )  # whole numbers stay
            cells.isetitem(index, texts)
    return cells.rename(columns=plain, index=plain)
