"""Pages from the templates beside this module, which escape whatever they are given."""

import base64
import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.colors import to_hex

from toppling.results.drawing.style import COLOURS, THIN_ALPHA

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
    made.filters |= {"breakable": _breakable, "data": _data, "anchor": _anchor}
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


def _anchor(name: str) -> str:
    return name.lower().replace(" ", "-")
