"""The page as a self-contained document: numbered figures and tables, headings with anchors."""

import base64
import html
import re
from collections.abc import Callable, Iterable
from importlib.resources import files

import pandas as pd
from matplotlib.figure import Figure

from toppling.results.drawing.style import FULL_WIDTH_IN, HALF_WIDTH_IN, png_bytes

_SCREEN_PX_PER_IN = 132
"""At this scale a page-wide figure fills the page, and its letters match the surrounding text."""


_LEAST_BROKEN = 12
"""Length of a cell in letters; shorter text breaks only at blanks."""

_BREAKS = re.compile(
    r"(?<=[_/.])(?=[^\s\d])|(?<=[0-9a-f]{8})(?=[0-9a-f]{4})|(?<=[^\s_/.]{20})(?=[^\s_/.]{3})"
)
"""Places within a word where a line may break: within an id too, which is wider than a column on a narrow screen."""

_MOST_BESIDE = 4
"""Columns that stand beside each other also on a narrow screen."""


class Document:
    """Counts the figures and tables of a page as they are written.

    remark: stands above each figure, as that of an unfinished run.
    """

    def __init__(self, remark: str = "") -> None:
        self.remark = remark
        self.figures = 0
        self.tables = 0

    def figure(self, draw: Callable[[float], Figure], caption: str, width_in: float = FULL_WIDTH_IN) -> str:
        """A numbered figure.

        draw: from a width in inches to the figure: asked for the page's, and for that of a narrow screen too.
        caption: stands alone: says what is seen without the text around it.
        width_in: of the figure on a page.
        """
        wide = png_bytes(draw(width_in), self.remark)
        narrow = png_bytes(draw(HALF_WIDTH_IN), self.remark) if width_in > HALF_WIDTH_IN else None
        return self.picture(wide, caption, narrow, width_in)

    def picture(
        self, png: bytes, caption: str, narrow: bytes | None = None, width_in: float = FULL_WIDTH_IN
    ) -> str:
        """A numbered figure from the content of PNG files: of a page's width and, where given, of a narrow screen's."""
        self.figures += 1
        source = ""
        if narrow is not None:
            source = f'<source media="screen and (max-width: 640px)" srcset="{_data(narrow)}">'
        image = f'<img alt="{safe(caption)}" style="width: {round(_SCREEN_PX_PER_IN * width_in)}px" src="{_data(png)}">'
        return (
            f'<figure id="figure-{self.figures}"><picture>{source}{image}</picture>'
            f"<figcaption><b>Figure {self.figures}.</b> {safe(caption)}</figcaption></figure>"
        )

    def image(self, png: bytes, words: str) -> str:
        """A picture without a number."""
        return f'<img alt="{safe(words)}" src="{_data(png)}">'

    def table(self, frame: pd.DataFrame, caption: str) -> str:
        """A numbered table; on a narrow screen the cells of a wide row are stacked."""
        self.tables += 1
        names = [str(name) for name in frame.columns]
        head = "".join(f"<th>{safe(name)}</th>" for name in names)
        rows = "".join(f"<tr>{_cells(names, row)}</tr>" for row in frame.itertuples(index=False))
        kind = ' class="stacks"' if len(names) > _MOST_BESIDE else ""
        return (
            f"<table{kind}><caption><b>Table {self.tables}.</b> {safe(caption)}</caption>"
            f"<thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
        )


def page(title: str, first: str, sections: Iterable[tuple[str, str]]) -> str:
    """Assemble a page: first screen, contents, sections."""
    known = list(sections)
    contents = "".join(f'<li><a href="#{_anchor(name)}">{safe(name)}</a></li>' for name, _ in known)
    body = "\n".join(f'<h2 id="{_anchor(name)}">{safe(name)}</h2>\n{content}' for name, content in known)
    look = files("toppling.results.drawing.report").joinpath("report.css").read_text(encoding="utf-8")
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{safe(title)}</title><style>{look}</style></head>\n"
        f"<body>\n{first}\n<nav><ol>{contents}</ol></nav>\n{body}\n</body></html>\n"
    )


def heading(text: str, level: int) -> str:
    """A heading below a section's."""
    return f"<h{level}>{safe(text)}</h{level}>" if text else ""


def paragraph(text: str) -> str:
    """A paragraph of plain text."""
    return f"<p>{safe(text)}</p>"


def sentence(text: str) -> str:
    """A paragraph of one sentence, given without its capital and its full stop."""
    return paragraph(f"{text[0].upper()}{text[1:]}.")


def pair(*figures: str) -> str:
    """Figures side by side, two per row."""
    return f'<div class="pair">{"".join(figures)}</div>'


def safe(text: object) -> str:
    """Text escaped for HTML."""
    return html.escape(str(text))


def _cell_text(value: object) -> str:
    """A value as a table prints it; nothing where there is none."""
    if value is None or value is pd.NA or value != value:
        return ""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _cells(names: list[str], row: Iterable[object]) -> str:
    cells = []
    for name, value in zip(names, row, strict=True):
        kind = "" if _cell_text(value) else ' class="empty"'
        if isinstance(value, int | float) and not isinstance(value, bool) and _cell_text(value):
            kind = ' class="number"'
        cells.append(f'<td{kind} data-label="{safe(name)}">{_breakable(_cell_text(value))}</td>')
    return "".join(cells)


def _breakable(text: str) -> str:
    """Text that may break after an underscore, slash or point, and within very long words."""
    if len(text) < _LEAST_BROKEN:
        return safe(text)
    return "<wbr>".join(map(safe, _BREAKS.split(text)))


def _data(png: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(png).decode()}"


def _anchor(name: str) -> str:
    return name.lower().replace(" ", "-")
