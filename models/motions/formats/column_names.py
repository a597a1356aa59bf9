"""Names of plain columns: which is the time, which are components, and in which units."""

import re
from dataclasses import dataclass
from typing import NoReturn

from toppling.models.motions.formats.column_cells import UNITS_S
from toppling.models.motions.formats.component import bearing
from toppling.models.motions.formats.record_text import RecordText
from toppling.models.motions.formats.units import unit_of

_BRACKETS = re.compile(r"[(\[]([^)\]]*)[)\]]")
_ENDING = re.compile(
    r"(.*?[^\W_])_((?:[cm]?m_s\^?2)|gal|g|ms|us|ns|s|sec|seconds|milliseconds)$", re.IGNORECASE
)
"""A unit at the end of a name, as this program's own columns have it: time_s, ns_m_s2."""
_LONGEST = 200
"""Characters of a cell of a header that are looked at."""
_TIME = re.compile(
    r"(?:t|(?:(?:date|unix|epoch|elapsed|utc|gps)[ _-]?)?time(?:s|stamp)?|epoch|zeit|tiempo|temps|tempo|zaman|"
    r"时间|時間|時刻|s|m?secs?|(?:milli)?seconds?)(?![a-z])",
    re.IGNORECASE,
)
_NUMBERS = {
    "", "no", "nr", "n", "i", "id", "idx", "index", "row", "sample", "samples", "point", "points", "#", "count"
}  # fmt: skip
"""Names of a column that counts rows."""
_DATES = ("date", "datum", "fecha", "data")
_ACCELERATION = re.compile(
    r"a(?:cc(?:el(?:eration|erations)?)?)?|aceleraci[oó]n|beschleunigung|acc[eé]l[eé]ration|amplitude|samples?|data|values?",
    re.IGNORECASE,
)
_DERIVED = re.compile(
    r"v(?:el(?:ocity)?)?|d(?:isp(?:lacement)?)?|velocidad|desplazamiento|"
    r"(?:gyr|mag)\w*|temp(?:erature)?|battery|vector(?: sum)?|srss|(?:absolute|abs|total|resultant)(?:[ _]acc\w*)?",
    re.IGNORECASE,
)
"""What is worked out from accelerations, or is of other sensors beside them."""
_OTHER_UNIT = re.compile(r"(?:rad|deg|°)/s|dps|°?[cf]|[hk]?pa|[uµμ]t|m?v|volts?|%", re.IGNORECASE)
_QUOTIENT = re.compile(r"(.+?)\s+/\s+(.+)")
"""A quantity over its unit: a_E / m s^-2."""
_BEFORE_UNIT = re.compile(r"(\S+(?: \S+)??)\s+(?:in\s+)?(\S*/\S+)")
"""A quantity before its unit, without brackets: NS cm/s/s."""
_FILLING = {
    "ACC", "ACCEL", "ACCELERATION", "A", "COMP", "COMPONENT", "CHANNEL", "CHAN", "CH", "DIR", "DIRECTION", "LINEAR",
    "BESCHLEUNIGUNG", "ACELERACION", "ACELERACIÓN", "ACCÉLÉRATION", "ACCELERAZIONE",
}  # fmt: skip
"""Words of a component's name that say nothing of its direction."""
_WORDS = {
    "NORTHSOUTH": "NS", "EASTWEST": "EW", "UPDOWN": "UD", "NORTE": "N", "ESTE": "E", "NORD": "N", "EST": "E",
    "OST": "E", "SUR": "S", "OESTE": "W", "AX": "X", "AY": "Y", "AZ": "Z", "LONGITUDINAL": "L", "LONG": "L",
    "TRANSVERSE": "T", "TRANSVERSAL": "T", "TRAN": "T", "LON": "L", "VERTIKAL": "UP", "RADIAL": "H1", "R": "H1",
    "NORTESUR": "NS", "ESTEOESTE": "EW", "OSTWEST": "EW", "NORDSÜD": "NS", "NORDSUD": "NS",
    "ESTOUEST": "EW", "VERTICALE": "UP", "东西": "EW", "南北": "NS", "東西": "EW",
    "竖向": "UD", "竖直": "UD", "垂直": "UD", "上下": "UD",
}  # fmt: skip
"""Words and letters that people write for directions, beside those that every format knows."""
_GLUED = re.compile(r"ACC(?:EL|ELERATION)?(?=(?:[XYZENUV123]|EW|NS|UD)$)")
"""Before a direction without anything between: AccX."""
_CHANNEL_CODE = re.compile(r"[A-Z][GHLN][ENZ123]")
"""SEED's: of a band, an accelerometer or seismometer, and a direction or number."""
_HORIZONTALS = {"H1", "H2", "L", "T", "X", "Y"}
"""Names of horizontals that say nothing of their bearing."""


@dataclass(frozen=True)
class Column:
    """Name of a column, and its unit: what stands in brackets behind it, or at its end."""

    name: str
    unit: str


@dataclass(frozen=True)
class Roles:
    """Which columns are what, by their places from 0."""

    time: int | None
    components: dict[int, str]  # place and label, '' for an acceleration without a direction
    left_out: tuple[str, ...] = ()  # names of columns of velocity or displacement


def column_of(part: str) -> Column:
    """Name and unit of a cell of a header."""
    part = part[:_LONGEST]
    match = _BRACKETS.search(part)
    name, unit = _BRACKETS.sub("", part).strip(" \"'_:."), match[1].strip() if match else ""
    if not unit and (found := _QUOTIENT.fullmatch(name)) and is_unit(found[2]):
        return Column(found[1], found[2])
    if not unit and (found := _BEFORE_UNIT.fullmatch(name)) and unit_of(found[2]):
        return Column(found[1], found[2])
    if not unit and (ending := _ENDING.fullmatch(name)):
        timed = ending[2].lower() in UNITS_S
        if not timed or _TIME.match(ending[1]):  # Acc_NS is no acceleration in nanoseconds
            return Column(ending[1], ending[2].replace("_", "/"))
    if not unit and unit_of(name) and not bearing(name) and label_of(name) == "" and not _TIME.match(name):
        return Column("acceleration", name)
    return Column(name, unit)


def without_date(columns: list[Column]) -> list[Column]:
    """Columns of which a date and a time of day beside it are one, as their numbers are."""
    dated = len(columns) > 1 and columns[0].name.lower() in _DATES and names_time(columns[1])
    return columns[1:] if dated else columns


def counts_rows(each: Column) -> bool:
    """Whether a column's name is that of numbers of rows."""
    return each.name.lower() in _NUMBERS and not each.unit


def names_time(each: Column) -> bool:
    """Whether a column's name is one of the time."""
    return _TIME.match(each.name) is not None


def is_unit(word: str) -> bool:
    """Whether a cell below a name is the unit of its column."""
    bare = word.strip("()[]- ")
    return not bare or bare.lower() in UNITS_S or unit_of(bare) is not None


def roles_of(columns: list[Column]) -> Roles | None:
    """Roles of columns by their names; None where one is not understood, as it might be a component.

    Rows may be counted in the first column, then the time may stand, then components in any order; or acceleration
    alone, with velocity and displacement behind it.
    """
    first = int(counts_rows(columns[0]) and len(columns) > 1)
    time = first if len(columns) > first + 1 and names_time(columns[first]) else None
    labels: dict[int, str] = {}
    others: dict[int, str] = {}
    for place in range(first if time is None else first + 1, len(columns)):
        each = columns[place]
        unit, label = unit_of(each.unit) if each.unit else None, label_of(each.name)
        foreign = unit is None and _OTHER_UNIT.fullmatch(each.unit) is not None
        if (
            foreign
            or (unit and unit.quantity != "acceleration")
            or (not label and _DERIVED.fullmatch(each.name))
        ):
            others[place] = label
        elif label or _ACCELERATION.fullmatch(each.name):
            labels[place] = label
        else:
            return None
    if not labels and all(others.values()):
        labels, others = others, {}  # of velocity alone, which is refused by its unit
    alone = list(labels.values()) == [""]
    if not labels or (not alone and ("" in labels.values() or len(set(labels.values())) < len(labels))):
        return None
    return Roles(time, labels, tuple(columns[place].name for place in others))


def refuse_names(file: RecordText, at: int, columns: list[Column], width: int) -> NoReturn:
    """Refuse names that are not understood: in the order of a file without names, they might be other components."""
    other = "delete this line if they are the time, h1, h2 and v" if width == 4 else "leave other columns out"
    names = ", ".join(repr(each.name) for each in columns)
    what = (
        f"the names of {width} columns are"
        if width == len(columns)
        else f"rows of {width} numbers stand below"
    )
    expected = "the time, then components by direction (NS, E, 090, UP, HNZ ...) or as h1, h2, v"
    file.refuse("record.columns_unknown", at, f"{what} {names}", expected, f"name them so, or {other}")


def label_of(name: str) -> str:
    """Label of a component's name, '' if it is none: a direction, a channel's code or number, or a horizontal."""
    bare = _GLUED.sub("", name.upper().strip())
    if known := _known_label(bare):
        return known
    words = [word for word in re.split(r"[\W_]+", bare) if word and word not in _FILLING]
    return _known_label("".join(words)) if words else ""


def _known_label(bare: str) -> str:
    bare = _WORDS.get(bare, bare)
    if bearing(bare) is not None or bare in _HORIZONTALS or re.fullmatch("[1-9]", bare):
        return bare.lower()
    return bare[-1].lower() if _CHANNEL_CODE.fullmatch(bare) else ""
