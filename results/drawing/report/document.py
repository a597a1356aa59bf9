"""Blocks of a page, which its template draws: plain text for a paragraph, or a kind with what it holds."""

from collections.abc import Callable, Sequence
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from toppling.results.drawing.style import FULL_WIDTH_IN, HALF_WIDTH_IN, png_bytes

Block = str | dict[str, Any]
Section = tuple[str, Sequence[Block]]
"""Title and blocks."""


class Document:
    """Counts the figures and tables of a page as they are made.

    remark: stands above each figure, as that of an unfinished run.
    """

    def __init__(self, remark: str = "") -> None:
        self.remark = remark
        self.figures = 0
        self.tables = 0

    def figure(self, draw: Callable[[float], Figure], caption: str, width_in: float = FULL_WIDTH_IN) -> Block:
        """A numbered figure.

        draw: from a width in inches to the figure: asked for the page's, and for that of a narrow screen too.
        caption: stands alone: says what is seen without the text around it.
        width_in: of the figure on a page.
        """
        wide = png_bytes(draw(width_in), self.remark)
        narrow = png_bytes(draw(HALF_WIDTH_IN), self.remark) if width_in > HALF_WIDTH_IN else None
        self.figures += 1
        return block("figure", number=self.figures, png=wide, narrow=narrow, caption=caption,
            width_in=width_in)  # fmt: skip

    def table(self, frame: pd.DataFrame, caption: str) -> Block:
        """A numbered table."""
        self.tables += 1
        names = [str(name) for name in frame.columns]
        rows = [
            [_cell(*pair) for pair in zip(names, row, strict=True)] for row in frame.itertuples(index=False)
        ]
        return block("table", number=self.tables, names=names, rows=rows, caption=caption)


def block(kind: str, **values: Any) -> Block:
    """A block of one of the kinds of `templates/blocks.html`."""
    return {"kind": kind, **values}


def sentence(text: str) -> str:
    """A sentence, given without its capital and its full stop."""
    return f"{text[0].upper()}{text[1:]}."


def _cell(name: str, value: object) -> tuple[str, str, str]:
    """Name of the column, kind and text of a cell; empty where there is no value."""
    if value is None or value is pd.NA or value != value:
        return name, "empty", ""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    text = f"{value:.4g}" if isinstance(value, float) else str(value)
    return name, "number" if is_number else "" if text else "empty", text
