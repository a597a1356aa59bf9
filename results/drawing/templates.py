"""Pages from the templates beside this module, which escape whatever they are given, and the blocks that they draw."""

import base64
import re
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from numbers import Integral, Real
from pathlib import Path
from typing import Any

import pandas as pd
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from toppling.results.drawing.style import COLOURS, FULL_WIDTH_IN, HALF_WIDTH_IN, THIN_ALPHA, png_bytes

_ROOM = Path(__file__).parent
_ASSETS = (_ROOM / "templates", _ROOM / "vendor")
_LEAST_BROKEN = 12
"""Length of a cell in letters; shorter text breaks only at blanks."""
_BREAKS = re.compile(
    r"(?<=[_/.])(?=[^\s\d])|(?<=[0-9a-f]{8})(?=[0-9a-f]{4})|(?<=[^\s_/.]{20})(?=[^\s_/.]{3})"
)
"""Places within a word where a line may break: within an id too, which is wider than a column on a narrow screen."""


def rendered(template: str, **values: Any) -> str:
    """Page of a template, with the text of its values escaped."""
    return _templates().get_template(template).render({"kind": "", **values})


@cache
def _templates() -> Environment:
    made = Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined,
        loader=FileSystemLoader(_ROOM / "templates"), keep_trailing_newline=True,
    )  # fmt: skip
    shades = [to_hex(COLOURS(step / 40)) for step in range(41)]
    made.globals |= {"asset": _asset, "colours": shades, "thin": THIN_ALPHA}
    made.filters |= {
        "breakable": _breakable,
        "data": _data,
        "anchor": lambda name: name.lower().replace(" ", "-"),
    }
    return made


def _asset(name: str) -> Markup:
    """Style or script that a page holds, as it is."""
    path = next(folder / name for folder in _ASSETS if (folder / name).exists())
    return Markup(path.read_text(encoding="utf-8"))


def _breakable(text: str) -> Markup:
    """Text that may break after an underscore, slash or point, and within very long words."""
    parts: Iterable[str] = [text] if len(text) < _LEAST_BROKEN else _BREAKS.split(text)
    return Markup("<wbr>").join(parts)


def _data(png: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(png).decode()}"


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
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    text = str(value) if not is_number else f"{value:,}" if isinstance(value, Integral) else f"{value:.4g}"
    return name, "number" if is_number else "" if text else "empty", text
