"""Units of ground motion by their names: one closed list, whatever way the name is spelled."""

import re
import unicodedata
from dataclasses import dataclass
from typing import Literal

from toppling.models.files.given import LONGEST_NAME
from toppling.models.motions.measures import STANDARD_G_M_S2

Quantity = Literal["acceleration", "velocity", "displacement"]


@dataclass(frozen=True)
class Unit:
    """A unit of ground motion."""

    quantity: Quantity
    factor: float  # one of it in m/s2, m/s or m


_LENGTHS_M = {"m": 1.0, "cm": 0.01, "mm": 1e-3, "nm": 1e-9, "ft": 0.3048, "in": 0.0254}
UNITS_M_S2 = {f"{length}/s2": factor for length, factor in _LENGTHS_M.items()} | {
    "gal": 0.01,
    "g": STANDARD_G_M_S2,
}
"""Accelerations by their folded names."""
_UNITS: dict[str, Unit] = {
    **{name: Unit("acceleration", factor) for name, factor in UNITS_M_S2.items()},
    **{f"{length}/s": Unit("velocity", factor) for length, factor in _LENGTHS_M.items()},
    "kine": Unit("velocity", 0.01),
    **{length: Unit("displacement", factor) for length, factor in _LENGTHS_M.items()},
}
"""The closed list: a name that is not here after folding is no unit."""
UNITS_S = {
    "": 1.0, "s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3,
    "millisecond": 1e-3, "milliseconds": 1e-3, "us": 1e-6, "microsecond": 1e-6, "microseconds": 1e-6,
    "ns": 1e-9, "nanosecond": 1e-9, "nanoseconds": 1e-9,
    "min": 60.0, "minutes": 60.0, "h": 3600.0, "hours": 3600.0,
}  # fmt: skip
"""Units of time, in seconds."""
_FACTORS = (1e-15, 1e6)
"""Range of one count in a unit: the least is below that of any digitiser."""
_FACTOR = re.compile(r"([-+]?(?:\d{1,30}\.?\d{0,30}|\.\d{1,30})(?:[Ee][-+]?\d{1,3})?)\s+(\S.*)$", re.ASCII)
_PER_COUNT = re.compile(r"\s*(?:\bper|/)\s*counts?$", re.IGNORECASE)
_DESCRIBED = re.compile(r"\s+-\s+[A-Za-z].*$", re.DOTALL)
"""A description behind a name: 'M/S**2 - Acceleration in Meters Per Second Per Second'."""
_WORDS = (
    (r"metres|meters|metre|meter", "m"),
    (r"centim", "cm"),
    (r"millim", "mm"),
    (r"nanom", "nm"),
    (r"inches|inch", "in"),
    (r"feet|foot", "ft"),
    (r"squared|square", "2"),
    (r"seconds|second|secs|sec", "s"),
    (r"gals", "gal"),
    (r"kines", "kine"),
    (r"fractionofg", "g"),
    (r"gravity|g's|gn", "g"),
)
"""Words for units and powers, in the order in which they are replaced."""
_SPELLINGS = (
    (r"\*\*|\^", ""),
    (r"per", "/"),
    (r"/s\*s$", "/s2"),
    (r"[*.\u00b7]?s-2$", "/s2"),
    (r"[*.\u00b7]?s-1$", "/s"),
    (r"/s/s$|/ss$", "/s2"),
    (r"/s1$", "/s"),
)
"""Ways to write a power of the second, after blanks and words."""


def _folded(name: str) -> str:
    """Name of a unit without case, blanks, and the ways to write a power: 'M/S**2 ', 'm s-2', 'm/s²' are 'm/s2'."""
    text = unicodedata.normalize("NFKC", _DESCRIBED.sub("", name.strip()[:LONGEST_NAME]))
    # The last is the square of DOS' code pages, read in those of Windows.
    text = text.replace("\u2215", "/").replace("\u2212", "-").lower().replace("ý", "2")
    text = re.sub(r"\s+", "", text).strip("\"'[]{},;:.")
    text = text.replace("(", "").replace(")", "")
    for pattern, word in (*_WORDS, *_SPELLINGS):
        text = re.sub(pattern, word, text)
    return text


def unit_of(name: str) -> Unit | None:
    """Unit that a name stands for; None if it is not in the closed list."""
    return _UNITS.get(_folded(name))


def acceleration_m_s2(name: str) -> float | None:
    """Unit of acceleration in m/s2; None if the name is that of none."""
    return UNITS_M_S2.get(_folded(name))


def counted_unit(text: str) -> Unit | None:
    """Unit of a name, or of a factor and a name ('4.7e-06 m/s2', a count); None if not known.

    Examples
    --------
    >>> counted_unit("4.7e-06 m/s2/count"), counted_unit("furlongs")
    (Unit(quantity='acceleration', factor=4.7e-06), None)
    >>> counted_unit("100 gal")
    Unit(quantity='acceleration', factor=1.0)
    """
    name = _PER_COUNT.sub("", text.strip()[:LONGEST_NAME])
    match = _FACTOR.match(name)
    factor, name = (float(match[1]), match[2]) if match else (1.0, name)
    if (unit := unit_of(name)) is None or not _FACTORS[0] <= factor <= _FACTORS[1]:
        return None
    return Unit(unit.quantity, factor * unit.factor)


def known_names() -> str:
    """Names of accelerations, as an error lists them."""
    return ", ".join(UNITS_M_S2)
