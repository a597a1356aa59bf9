"""JSON, TOML and CSV of strangers: bounded before they are parsed, and their values shown in a line."""

import csv
import json
import math
import re
import reprlib
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from toppling.models.errors import InputError

_LARGEST_JSON_BYTES = 100_000_000
_CORRECT = "correct the file, or have it made anew"
_LARGEST_TOML_BYTES, _TOML = 2_000_000, "TOML: key = value, a line each"
LARGEST_CSV_BYTES = 100_000_000
_MOST_VALUES = 10_000_000
"""Of a JSON file, by its commas and brackets."""
_LONGEST_KEY = 50
"""Parts of a dotted key: the time that tomllib takes grows with their square."""
_KEY_PARTS = re.compile(
    r'"""(?:\\.|[^\\])*?"""|' r"'''.*?'''|" r'"(?:\\.|[^"\\\n])*"|' r"'[^'\n]*'|#[^\n]*|\.|[\w\t -]+|[^.]",
    re.DOTALL,
)
"""Texts, remarks, dots, words, and what stands between them."""
_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = 60
_SHORT.maxlong = 40


def shown(value: Any) -> str:
    """A value as an error names it: in one short line, whatever it is."""
    text = _SHORT.repr(value)
    return text if len(text) <= 100 else f"{text[:97]}..."


def listed(names: Sequence[str], most: int) -> str:
    """Names in a sentence, the first few of many.

    Examples
    --------
    >>> listed(["a", "b", "c"], 2)
    'a, b and 1 more'
    """
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def read_json(path: Path) -> dict[str, Any]:
    """Read the object that a JSON file holds.

    Raises InputError if it is too large, no JSON (which has no NaN), nested beyond use, or no object.
    Raises FileNotFoundError if there is none.
    """
    try:
        text = _text(path, _LARGEST_JSON_BYTES, "JSON")
        _check_values(text, path)
        content = json.loads(text, parse_constant=_no_constant)
    except InputError:
        raise
    except (ValueError, RecursionError) as error:
        what = f"cannot be read (no JSON: {_brief(error)})"
        raise _unreadable(path, what, "JSON, as it was written") from None
    if not isinstance(content, dict):
        raise _unreadable(path, f"is {shown(content)}, no object", "a JSON object, as it was written")
    return content


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file.

    Raises InputError if it is too large, no TOML, or nested beyond use.
    Raises FileNotFoundError if there is none.
    """
    try:
        text = _text(path, _LARGEST_TOML_BYTES, "TOML")
        if _longest_key(text) > _LONGEST_KEY:
            raise _unreadable(path, f"has a key of more than {_LONGEST_KEY} parts", _TOML)
        return tomllib.loads(text)
    except InputError:
        raise
    except (ValueError, RecursionError) as error:
        raise _unreadable(path, f"is not TOML ({_brief(error)})", _TOML, _toml_remedy(str(error))) from None


def _toml_remedy(error: str) -> str:
    """What most often is wrong where the parser says so."""
    if "hex value" in error or "escape" in error.lower() or "\\" in error:
        return "write paths with / or between single quotes: 'C:\\rocks'"
    if "Invalid value" in error:
        return "put text between quotes, and write decimal points"
    if "codec" in error:
        return "save it as text in UTF-8"
    if "overwrite" in error:
        return "state each key once"
    return _CORRECT


def csv_rows(lines: Any, where: object, delimiter: str = ",") -> Iterator[tuple[int, dict[str, str]]]:
    """Rows of a CSV table with a header, each with its line; what a short row lacks is empty.

    Raises InputError if the module csv cannot read it: a field of more than 131,072 characters is a quote that nobody
    closed.
    """
    reader = csv.DictReader(lines, restval="", delimiter=delimiter)
    try:
        for row in reader:
            yield reader.line_num, {key: value for key, value in row.items() if key is not None}
    except csv.Error as error:
        raise InputError(
            f"is no CSV ({error})",
            where=f"{where}:{reader.line_num}",
            expected="a CSV table with a header line",
            remedy="look for a quote that is not closed, or save the table as CSV again",
        ) from None


@dataclass(frozen=True)
class Kind:
    """What a value of a document must be."""

    name: str
    holds: Callable[[Any], bool]

    def or_null(self) -> "Kind":
        """The same, or null, which stands for what is not finite or not known."""
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
    return _unreadable(where, f"{place} is {'missing' if missing else shown(value)}", expected)


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


def one_of(*words: str) -> Kind:
    """One of some words."""
    return Kind(f"one of {', '.join(words)}", lambda value: isinstance(value, str) and value in words)


TEXT = Kind("a text", lambda value: isinstance(value, str))
LENGTH_M = between(-1e8, 1e8)
NUMBER = between(-1e12, 1e12)
SHARE = between(-0.001, 1.001)


def check_size(path: Path, most: int, kind: str) -> None:
    """Refuse a file that is larger than any of its kind, or is no file: a device has no end."""
    if path.exists() and not path.is_file():
        raise _unreadable(path, "is no file", kind)
    if path.exists() and (size := path.stat().st_size) > most:
        raise _unreadable(path, f"has {size / 1e6:.3g} MB", f"{kind} of at most {most / 1e6:.0f} MB")


def _text(path: Path, most: int, kind: str) -> str:
    check_size(path, most, kind)
    with path.open("rb") as file:
        if file.read(2) in (b"\xff\xfe", b"\xfe\xff"):
            raise _unreadable(path, "is text in UTF-16", f"{kind} in UTF-8")
    return path.read_text(encoding="utf-8-sig")


def _check_values(text: str, path: Path) -> None:
    """Refuse JSON whose values would take much more memory than its text: each takes some 60 bytes."""
    count = sum(text.count(mark) for mark in ",[{")
    if count > _MOST_VALUES:
        raise _unreadable(path, f"holds {count:,} values", f"JSON of at most {_MOST_VALUES:,} values")


def _longest_key(text: str) -> int:
    """Parts of the longest chain of words with dots between: a dotted key, or what looks like one."""
    longest = parts = 1
    for token in _KEY_PARTS.finditer(text):
        first = token[0][0]
        if first == ".":
            parts += 1
            longest = max(longest, parts)
        elif first not in "\"' \t-_" and not first.isalnum():
            parts = 1
    return longest


def _brief(error: Exception) -> str:
    return "nested too deep" if isinstance(error, RecursionError) else str(error)[:300]


def _no_constant(name: str) -> None:
    raise ValueError(f"{name} is no number of JSON")


def _unreadable(where: object, what: str, expected: str, remedy: str = _CORRECT) -> InputError:
    return InputError(what, where=str(where), expected=expected, remedy=remedy)


def finite(value: Any) -> Any:
    """The same content as JSON can say it: null for what is not finite, Python's numbers for NumPy's."""
    if isinstance(value, Mapping):
        return {key: finite(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [finite(each) for each in value]
    value = value.item() if hasattr(value, "item") else value
    return None if isinstance(value, float) and not math.isfinite(value) else value
