"""Channel as a file gives it, and the direction that its label names."""

import re
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from toppling.models.errors import InputError, refusals
from toppling.models.motions.place import FREE_FIELD, Place

UP, DOWN = "up", "down"
TIME_STEPS_S = (1e-5, 0.5)
"""Range of time steps of instruments that record shaking; one of 1 s is a count of rows."""
_DEGREES = re.compile(r"-?(?:\d+(?:\.\d*)?|\.\d+)", re.ASCII)
_DIRECTIONS: dict[str, float | str] = {
    word: direction
    for words, direction in (
        ("UP UD U V Z VERT VERTICAL VER VRT UPDOWN VERTICALUP VERTIKAL VERTICALE 竖向 竖直 垂直 上下", UP),
        ("DOWN DWN DN D", DOWN),
        ("N NS NORTH NORTHSOUTH NORTE NORD NORTESUR NORDSÜD NORDSUD 南北", 0.0),
        ("E EW EO EAST EASTWEST ESTE EST OST ESTEOESTE OSTWEST ESTOUEST 东西 東西", 90.0),
        ("S SOUTH SUR", 180.0), ("W WEST OESTE", 270.0),
    )
    for word in words.split()
}  # fmt: skip
_QUADRANT = re.compile(r"([NS])(\d+(?:\.\d*)?|\.\d+)([EW])", re.ASCII)
_BETWEEN = re.compile(r"(?<=\w)[\s_-]+(?=\w)")
"""Blanks and hyphens within a direction: N-S, N 28 W."""
_SEED = re.compile(r"[A-Z][GHLN]([ENZ123])(?:[._ ]?(?:\d\w|--))?")
"""SEED's code of a band, an accelerometer or seismometer, and a direction or number; perhaps a location behind."""


@dataclass(frozen=True, eq=False)
class Component:
    """Channel of acceleration."""

    acceleration_m_s2: NDArray[np.float64]  # (n,): in the file's own unit if `unit_known` is false
    time_step_s: float
    direction: float | str | None  # compass bearing of the positive axis in degrees, vertical, or unknown
    path: Path
    line: int  # line of the first sample, 0 in a binary file
    file_format: str
    corrected: bool | None = None  # whether the agency has filtered it; None if the file does not say
    unit_known: bool = True
    # One unit of the file, where it is a word in a header that the metadata table must not contradict.
    stated_unit_m_s2: float | None = None
    stated_peak_m_s2: float | None = None  # largest sample by the header, of either sign
    # As in the header.
    event: str = ""
    station: str = ""
    label: str = ""
    magnitude: float | None = None
    distance_km: float | None = None
    series: str = ""  # another name that distinguishes two records of one station
    place: Place = FREE_FIELD
    elevation_m: float | None = None  # of the sensor, where others of its station tell the depth by it
    start_s: float | None = None  # time of the first sample, seconds since 1970
    notes: tuple[str, ...] = field(default=())  # what the reader had to do
    # What the user should know of the file, though it could be read.
    warnings: tuple[str, ...] = field(default=())
    missing: int = 0  # samples that the header counts beyond those that there are
    # Why the unit is not known, where more can be said than that the file is silent.
    no_unit: InputError | None = None

    @property
    def where(self) -> str:
        """File and line, as an error names them."""
        return f"{self.path}:{self.line}" if self.line else str(self.path)

    def refuse(self, code: str, what: str, expected: str, remedy: str = "fetch the file again") -> NoReturn:
        """Refuse the channel."""
        refuse_file(code, self.where, what, expected, remedy)


no_record = refusals(expected="a record", remedy="fetch the file again, or cut the shaking out of a long one")
"""Refuses what is no file of a record."""


def refuse_file(
    code: str, where: object, what: str, expected: str = "a record", remedy: str = "fetch the file again"
) -> NoReturn:
    """Refuse a file of records, or a place in one."""
    raise InputError(code, what, where=str(where), expected=expected, remedy=remedy)


def check_time_step(value_s: float, where: str) -> float:
    """Time step of a record, if it is one.

    Raises InputError if it is shorter or longer than that of any instrument.
    """
    least, most = TIME_STEPS_S
    if not least <= value_s <= most:
        remedy = "correct the time step or its unit, or fetch the file again"
        refuse_file("record.step_out_of_range", where, f"the time step is {value_s:g} s",
            f"a time step of {least:g} to {most:g} s", remedy)  # fmt: skip
    return value_s


def check_samples(
    values: NDArray[np.float64], of: str, where: str, largest: float = sys.float_info.max
) -> None:
    """Refuse samples of a channel of which one is not finite, or larger than any of a record."""
    wrong = np.flatnonzero(~(np.abs(values) <= largest))
    if len(wrong):
        what = f"sample {wrong[0]}{f' of {of}' if of else ''} is {values[wrong[0]]:g}"
        refuse_file("record.sample_out_of_range", where, what, "finite samples of a record")


def bearing(label: str) -> float | str | None:
    """Direction that a component's label names: compass bearing in degrees, "up", "down", or None.

    Understands bearings ("090", "N37.5E", "S 53 W", "270 Deg"), letters ("E", "N-S", "UD"), words ("UP", "DOWN") and
    channels' codes ("HNE"). A minus before a bearing counts it the other way ("-45" is "315"), before a letter or word
    turns it round.
    """
    text = label.upper().replace("DEGREES", "").replace("DEG", "").strip(" ,;:()_")
    text = text.removesuffix(".")
    text = text if _SEED.fullmatch(text) else _BETWEEN.sub("", text.rstrip(" ,;:()_"))
    if _DEGREES.fullmatch(text):
        return float(text) % 360 if abs(float(text)) <= 360 else None
    return _opposite(_named(text[1:])) if text.startswith("-") else _named(text)


def _named(text: str) -> float | str | None:
    if code := _SEED.fullmatch(text):
        return _DIRECTIONS.get(code[1])
    if text in _DIRECTIONS:
        return _DIRECTIONS[text]
    quadrant = _QUADRANT.fullmatch(text)
    if quadrant and float(quadrant[2]) <= 90.0:
        east = float(quadrant[2]) * (1.0 if quadrant[3] == "E" else -1.0)
        return (east if quadrant[1] == "N" else 180.0 - east) % 360.0
    return None


def _opposite(direction: float | str | None) -> float | str | None:
    if isinstance(direction, float):
        return (direction + 180.0) % 360.0
    return {UP: DOWN, DOWN: UP}.get(direction) if direction else None


def code_direction(code: str) -> float | str | None:
    """Direction that a channel's code or a file's suffix names: no bearing if it only numbers the channels.

    SEED's 2 and 3, and what a person calls 1 and 2, are two horizontals of unknown bearing; 0 is north.
    """
    return None if len(code) == 1 and code in "123456789" else bearing(code)


_FILLING = {
    "ACC", "ACCEL", "ACCELERATION", "A", "COMP", "COMPONENT", "CHANNEL", "CHAN", "CH", "DIR", "DIRECTION", "LINEAR",
    "BESCHLEUNIGUNG", "ACELERACION", "ACELERACIÓN", "ACCÉLÉRATION", "ACCELERAZIONE",
}  # fmt: skip
"""Words of a component's name that say nothing of its direction."""
_WORDS = {
    "AX": "X", "AY": "Y", "AZ": "Z", "LONGITUDINAL": "L", "LONG": "L", "LON": "L", "TRANSVERSE": "T",
    "TRANSVERSAL": "T", "TRAN": "T", "RADIAL": "H1", "R": "H1",
}  # fmt: skip
"""Words and letters that people write for axes of unknown bearing."""
_GLUED = re.compile(r"ACC(?:EL|ELERATION)?(?=(?:[XYZENUV123]|EW|NS|UD)$)")
"""Before a direction without anything between: AccX."""
_HORIZONTALS = {"H1", "H2", "L", "T", "X", "Y"}
"""Names of horizontals that say nothing of their bearing."""


def label_of(name: str) -> str:
    """Label of a component's name, '' if it is none: a direction, a channel's code or number, or a horizontal."""
    bare = _GLUED.sub("", name.upper().strip())
    if known := _known_label(bare):
        return known
    words = [word for word in re.split(r"[\W_]+", bare) if word and word not in _FILLING]
    return _known_label("".join(words)) if words else ""


def _known_label(bare: str) -> str:
    bare = _WORDS.get(bare, bare)
    if code := _SEED.fullmatch(bare):
        return code[1].lower()
    return bare.lower() if bearing(bare) is not None or bare in {*_HORIZONTALS, *"123456789"} else ""
