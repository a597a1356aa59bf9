"""JSON, XML and TOML of strangers: bounded before they are parsed, and their values shown in a line."""

import json
import math
import re
import reprlib
import sys
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NoReturn
from xml.etree import ElementTree

from toppling.models.errors import InputError, refusals
from toppling.models.files.given import LARGEST_BYTES, Refuse, bytes_given

_CORRECT = "correct the file, or have it made anew"
_TOML = "TOML: key = value, a line each"
_LARGEST_TOML_BYTES = 2_000_000
"""Maximum size of a TOML file, which people write."""
MOST_VALUES = 10_000_000
"""Maximum number of values of a JSON or XML file, by its commas and brackets; one takes 60 bytes, 250 in XML."""
_DEEPEST = 100
"""Maximum depth of nested objects and lists, which recursive functions walk, and number of parts of a dotted key."""
MOST_NAMED = 6
"""Maximum number of names in a sentence."""
MOST_SHOWN = 10
"""Maximum number of rows of a list that a command prints or a page shows; files have all."""
_LONG_KEY = re.compile(
    rf"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{_DEEPEST}}}""", re.ASCII
)
_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = 60


def shown(value: Any) -> str:
    """A value as an error names it: in one short line, whatever it is."""
    text = _SHORT.repr(value)
    return text if len(text) <= 100 else f"{text[:97]}..."


def listed(names: Sequence[str], most: int = MOST_NAMED) -> str:
    """Names in a sentence, the first few of many.

    Examples
    --------
    >>> listed(["a", "b", "c"], 2)
    'a, b and 1 more'
    """
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


_FOLDERS = re.compile(r"""(?<![^\s"'(=])(?:/[^/\s"']+)+/(?=[^/\s"']+/[^/\s"']+)""")
"""Folders of an absolute path before the last one."""


def without_machine(document: dict[str, Any]) -> dict[str, Any]:
    """Document whose absolute paths begin at the last folder, for readers on other machines.

    Examples
    --------
    >>> without_machine({"file": "/home/me/hazard/tree/mean.csv", "unit": "m/s"})
    {'file': 'tree/mean.csv', 'unit': 'm/s'}
    """
    return json.loads(_FOLDERS.sub("", json.dumps(document)))


_no_json = refusals(expected="a JSON object, as it was written", remedy=_CORRECT)


def read_json(path: Path, refuse: Refuse = _no_json) -> dict[str, Any]:
    """Read the object that a JSON file holds.

    Raises InputError if it is no file, too large, no JSON (which has no NaN), nested beyond use, or no object.
    Raises AbsentError, a FileNotFoundError too, if there is none.
    """
    content = json_of(_text(path, refuse), path, refuse)
    if not isinstance(content, dict):
        raise refuse("document.no_object", f"is {shown(content)}, no object", path)
    return content


def json_of(text: str, where: object, refuse: Refuse = _no_json) -> Any:
    """Content of JSON; its depth, values and numbers are bounded.

    Raises InputError if it is no JSON, or beyond the bounds.
    """
    _check_values(text, ",[{", where, refuse)
    try:
        content = json.loads(
            text,
            parse_constant=partial(_no_number, text),
            parse_int=lambda found: (
                int(found) if len(found) <= sys.float_info.max_10_exp else _no_number(text, found)
            ),
            parse_float=lambda found: (
                value if math.isfinite(value := float(found)) else _no_number(text, found)
            ),
        )
    except (ValueError, RecursionError) as error:
        raise refuse("document.unreadable", f"cannot be read (no JSON: {_brief(error)})", where) from None
    if _is_deep(content):
        raise refuse("document.too_deep", f"is nested too deep: more than {_DEEPEST} levels", where)
    return content


def xml_of(text: str, where: object, refuse: Refuse, *, comments: bool = False) -> ElementTree.Element:
    """Root of an XML document without entities, of a bounded number of elements; with its comments, if asked for.

    Raises InputError if it is no whole document, or beyond the bounds.
    """
    if re.search(r"<!(?:DOCTYPE|ENTITY)", text):  # entities can grow without bound, and name other files
        raise refuse("document.has_entities", "defines entities", where)
    _check_values(text, "<", where, refuse)
    try:
        builder = ElementTree.TreeBuilder(insert_comments=comments)
        return ElementTree.fromstring(text, ElementTree.XMLParser(target=builder))
    except (ElementTree.ParseError, ValueError) as error:
        raise refuse("document.unreadable", f"is no whole XML document ({error})", where) from None


_no_toml = refusals(expected=_TOML, remedy=_CORRECT)


def read_toml(path: Path, refuse: Refuse = _no_toml) -> dict[str, Any]:
    """Read a TOML file.

    Raises InputError if it is no file, too large, no TOML, nested beyond use, or has a number that no double holds.
    Raises AbsentError, a FileNotFoundError too, if there is none.
    """
    text = _text(path, refuse, _LARGEST_TOML_BYTES)
    if _LONG_KEY.search(text):
        raise refuse("document.too_deep", f"has a key of more than {_DEEPEST} parts", path)
    try:
        content = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        what, remedy = f"is not TOML ({_brief(error)})", _toml_remedy(str(error))
        raise InputError(
            "document.unreadable", what, where=str(path), expected=_TOML, remedy=remedy
        ) from None
    if _is_deep(content):
        raise refuse("document.too_deep", f"is nested too deep: more than {_DEEPEST} levels", path)
    for key, value in content.items():
        for number in _values_in(value):
            if isinstance(number, int | float) and not (isinstance(number, bool) or is_number(number)):
                what = f"{shown(number)} is no number that a double holds"
                raise refuse("document.number_too_large", what, f"{path}: {key}")
    return content


def _toml_remedy(error: str) -> str:
    """Remedy for the most frequent mistake behind a parser's message."""
    if "hex value" in error or "escape" in error.lower() or "\\" in error:
        return "write paths with / or between single quotes: 'C:\\rocks'"
    if "Invalid value" in error:
        return "put text between quotes, and write decimal points"
    if "overwrite" in error:
        return "state each key once"
    return _CORRECT


@dataclass(frozen=True)
class Kind:
    """Kind of a value in a document."""

    name: str
    holds: Callable[[Any], bool]

    def or_null(self) -> "Kind":
        """Allow null besides this kind of value, for a value that is not finite or not known."""
        return Kind(f"{self.name} or null", lambda value: value is None or self.holds(value))


def check_shape(value: Any, shape: Any, where: object, place: str = "") -> None:
    """Compare a document with what is expected of it; keys that are not expected are left alone.

    shape: a dict has a shape for every key, one that ends in '?' may be missing; a list has the shape of all its
    items, and may have their number behind it.
    where: of the file.
    place: keys that lead to the value.
    Raises InputError: at the first value that is another, with its place.
    """
    if isinstance(shape, Kind):
        if not shape.holds(value):
            raise _mistyped(value, shape.name, where, place)
    elif isinstance(shape, dict):
        if not isinstance(value, dict):
            raise _mistyped(value, "an object", where, place)
        for key, inner in shape.items():
            name = key.removesuffix("?")
            if name in value:
                check_shape(value[name], inner, where, f"{place}.{name}" if place else name)
            elif name == key:
                raise _mistyped(None, "a value", where, f"{place}.{name}" if place else name, missing=True)
    else:
        if not isinstance(value, list) or (len(shape) > 1 and len(value) != shape[1]):
            raise _mistyped(value, f"a list{f' of {shape[1]}' if len(shape) > 1 else ''}", where, place)
        for index, item in enumerate(value):
            check_shape(item, shape[0], where, f"{place}[{index}]")


def _mistyped(value: Any, expected: str, where: object, place: str, *, missing: bool = False) -> InputError:
    code = "document.value_missing" if missing else "document.value_mistyped"
    what = f"{place} is {'missing' if missing else shown(value)}"
    return InputError(code, what, where=str(where), expected=expected, remedy=_CORRECT)


def is_number(value: Any) -> bool:
    """Whether a value is a finite number that a double can hold, and no truth value."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer of 400 digits
        return False


def between(low: float, high: float) -> Kind:
    """Number from low to high."""
    return Kind(f"a number from {low:g} to {high:g}", lambda value: is_number(value) and low <= value <= high)


def whole(low: int, high: int) -> Kind:
    """Whole number from low to high."""
    return Kind(
        f"a whole number from {low} to {high}",
        lambda value: isinstance(value, int) and not isinstance(value, bool) and low <= value <= high,
    )


def choice(*words: str) -> Kind:
    """Kind of a value that is among some words."""
    return Kind(f"one of {', '.join(words)}", lambda value: isinstance(value, str) and value in words)


TEXT = Kind("a text", lambda value: isinstance(value, str))
LENGTH_M = between(-1e8, 1e8)
NUMBER = between(-1e12, 1e12)
FRACTION = between(-0.001, 1.001)


def _text(path: Path, refuse: Refuse, most_bytes: int = LARGEST_BYTES) -> str:
    content = bytes_given(path, refuse, most_bytes)
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise refuse("file.not_utf8", "is text in UTF-16, not in UTF-8", path)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise refuse("file.not_utf8", f"is no text in UTF-8 ({error})", path) from None


def _check_values(text: str, marks: str, where: object, refuse: Refuse) -> None:
    """Refuse a document whose values would take much more memory than its text, before it is parsed."""
    count = sum(text.count(mark) for mark in marks)
    if count > MOST_VALUES:
        raise refuse("document.too_many_values", f"holds {count:,} values, more than {MOST_VALUES:,}", where)


def _is_deep(content: Any) -> bool:
    level = [content]
    for _ in range(_DEEPEST):
        level = [inner for outer in level for inner in _inside(outer) if isinstance(inner, dict | list)]
    return bool(level)


def _values_in(content: Any) -> Iterator[Any]:
    """All values of a document, those of its objects and lists too, without a call within a call."""
    waiting = [content]
    while waiting:
        value = waiting.pop()
        yield value
        waiting.extend(_inside(value))


def _inside(value: Any) -> Iterable[Any]:
    return value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()


def _brief(error: Exception) -> str:
    return "nested too deep" if isinstance(error, RecursionError) else str(error)[:300]


def _no_number(text: str, found: str) -> NoReturn:
    raise json.JSONDecodeError(f"{shown(found)} is no number that a double holds", text, text.find(found))


def finite(value: Any) -> Any:
    """Content in the types of JSON: null for what is not finite, Python's numbers for NumPy's."""
    if isinstance(value, Mapping):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    value = value.item() if hasattr(value, "item") else value
    return None if isinstance(value, float) and not math.isfinite(value) else value
