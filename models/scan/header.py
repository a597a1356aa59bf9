"""Headers of text files: which columns are east, north and up, and what is refused because nobody can tell."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from toppling.models.errors import InputError
from toppling.models.lengths import in_degrees

_AXES = {
    "x": ("x", "easting", "east", "e"),
    "y": ("y", "northing", "north", "n"),
    "z": ("z", "elevation", "elev", "height", "up", "altitude", "alt", "h"),
}
"""What headers call east, north and up, in lower case."""
_AXIS_OF = {word: axis for axis, words in _AXES.items() for word in words}
_KINDS = frozenset({"point", "coord", "coordinate", "local", "utm"})
"""Words beside an axis that tell one set of coordinates from another: POINT_X, X_local."""
_METRES = frozenset({"m", "metre", "metres", "meter", "meters"})
_OTHER_LENGTH = re.compile(
    r"(us|i)?s?(ft|foot|feet)(us)?|in|inch(es)?|yd|yards?|[mcdk]m|(milli|centi|deci|kilo)met(er|re)s?"
)
"""Words for units of length that are not metres."""
_OTHER_COLUMNS = frozenset(
    {"id", "point", "station", "time", "intensity", "reflectance", "red", "green", "blue", "r", "g", "b"}
    | {"nx", "ny", "nz", "latitude", "longitude", "lat", "lon", "range", "azimuth", "zenith", "theta", "phi"}
)
"""What headers call columns that are no coordinates of a survey."""

Columns = tuple[int, int, int]
"""Numbers of the columns of x, y and z."""


def named_columns(lines: Sequence[str], columns: int, where: str, unit_given: bool = False) -> Columns | None:
    """Columns of x, y, z by the lines before the first point, None if these are remarks or there are none.

    columns: how many numbers the first point's line has.
    where: the file, for errors.
    unit_given: the user says which unit the numbers are in, so that the header may state another than metres.
    Raises InputError if a header does not tell which columns are x, y and z, or says that they are not in metres.
    """
    titles = []
    for line in filter(str.strip, lines):
        units = [name.strip("()") for name in _names(line, columns)]
        lengths = [unit for unit in units if _is_length(unit)]
        if len(units) != columns or len(lengths) < 3 or not all(map(_is_length_or_none, units)):
            titles.append(line)
        elif not (unit_given or _METRES.issuperset(lengths)):
            raise _other_unit(lengths, where)
    for line in reversed(titles):
        names = _names(line, columns)
        found = _axes(names)
        if found is not None and (len(names) == columns or found == (0, 1, 2)):
            if not unit_given:
                _check_metres([names[column] for column in found], where)
            return found
        # Remarks may stand between a header and the points, so of such lines only the last must be understood.
        is_remark = line.lstrip().startswith(("#", "//"))
        if (line is titles[-1] or not is_remark) and _names_columns(names, columns):
            raise _not_understood(names, columns, where)
    return None


@dataclass(frozen=True)
class _Coordinate:
    """What a name says of a column of coordinates."""

    word: str
    kind: frozenset[str]
    metres: bool

    @classmethod
    def of(cls, name: str) -> "_Coordinate | None":
        """Read a name such as x, POINT_X, x_ft or X [m]; None if it is no coordinate's."""
        bare, _, bracket = name.partition("(")
        words, beside = set(re.findall(r"[^\s_-]+", bare)), set(re.findall(r"\w+", bracket))
        axes = words & _AXIS_OF.keys()
        if not axes or len({_AXIS_OF[word] for word in axes | (beside & _AXIS_OF.keys())}) > 1:
            return None  # X (northing) contradicts itself
        units = words - axes - _KINDS - _METRES - ({"in"} if words & _METRES else set())  # x in m
        if not all(map(_OTHER_LENGTH.fullmatch, units)):
            return None
        powers = not beside.isdisjoint({"10", "100", "1000"})  # 10^-3 m
        other = bool(units) or powers or (not beside & _METRES and any(map(_OTHER_LENGTH.fullmatch, beside)))
        return cls(min(axes), frozenset(words & _KINDS), not other)


def _axes(names: Sequence[str]) -> Columns | None:
    """Columns of x, y, z by their names: those in metres first, and x, y, z before others such as POINT_X.

    Where several sets of others are complete nobody can tell which one is meant, and none is taken.
    """
    every = [_Coordinate.of(name) for name in names]
    for read in ([each if each is not None and each.metres else None for each in every], every):
        kinds = {each.kind for each in read if each is not None}
        sets = {kind: found for kind in kinds if (found := _axes_of(kind, read)) is not None}
        if frozenset() in sets:
            return sets[frozenset()]
        if len(sets) == 1:
            return next(iter(sets.values()))
    return None


def _axes_of(kind: frozenset[str], read: Sequence[_Coordinate | None]) -> Columns | None:
    words = [each.word if each is not None and each.kind == kind else None for each in read]
    x, y, z = (next((words.index(word) for word in _AXES[axis] if word in words), None) for axis in _AXES)
    return None if x is None or y is None or z is None else (x, y, z)


def _names(line: str, columns: int) -> list[str]:
    """Names in a header, parted in the way that gives as many as there are columns, if there is one."""
    title = re.sub(r"[\"']", "", line).strip().lstrip("#/ ").lower()
    # Neither blanks nor open brackets are looked through twice: a line may be long.
    # What stands in a bracket becomes one word, so that it stays with its name: x (us ft) is x(us-ft).
    title = re.sub(
        r"(?<!\s)\s*[(\[]([^()\[\]]*)[)\]]",
        lambda bracket: "(" + "-".join(re.findall(r"\w+", bracket[1])) + ")",
        title,
    )
    for separator in (",", ";", "\t", None):
        names = [name.strip() for name in title.split(separator)]
        if len(names) == columns:
            return names
    return [name for name in re.split(r"[,;\s]+", title) if name]


def _names_columns(names: Sequence[str], columns: int) -> bool:
    """Whether a line is a header, though one that names no place, and no remark."""
    known = {
        name for name in names if name.partition("(")[0] in _OTHER_COLUMNS or _Coordinate.of(name) is not None
    }
    return len(names) == columns or len(known) >= 2


def _check_metres(names: Sequence[str], where: str) -> None:
    stated = [name for name in names if (read := _Coordinate.of(name)) is not None and not read.metres]
    if stated:
        raise _other_unit(stated, where)


def _is_length_or_none(word: str) -> bool:
    """Whether a cell of a line of units is one of length, or says that a column has none."""
    return _is_length(word) or not re.search("[a-z]", word)


def _is_length(word: str) -> bool:
    return word in _METRES or _OTHER_LENGTH.fullmatch(word) is not None


def _other_unit(stated: Sequence[str], where: str) -> InputError:
    return InputError(
        "coordinates.unit_not_metres",
        f"the header states another unit than metres: {', '.join(stated)}",
        where=where,
        expected="coordinates in metres",
        remedy="say which unit all three are in by --units, or convert the coordinates to metres, and name their "
        "columns x, y and z",
    )


def _not_understood(names: Sequence[str], columns: int, where: str) -> InputError:
    told = f"the header names its columns {', '.join(names)}"
    if {"lat", "lon"} <= {name[:3] for name in names}:
        return in_degrees(told, where)
    return InputError(
        "cloud.columns_unknown",
        told,
        where=where,
        expected="; ".join(f"{axis}: {' or '.join(words)}" for axis, words in _AXES.items())
        + f"; and as many names as columns ({columns})",
        remedy="name the columns of easting, northing and height x, y and z, in metres; if the line is a remark, "
        "delete it",
    )
