"""Names and units of intensity measures in hazard files, and the corresponding columns of the results."""

import re
from collections.abc import Iterator

from toppling.models.files.given import LONGEST_NAME
from toppling.models.motions.formats.units import Quantity, unit_of
from toppling.models.motions.measures import OPENQUAKE, STANDARD_G_M_S2

_NUMBER_S = r"(\d+(?:\.\d*)?|\.\d+)"
_SECONDS = r"(?:SECONDS?|SECS?|S)"
_SA = re.compile(rf"SA[ _]?\(?{_NUMBER_S} ?{_SECONDS}?\)?|SA(\d+)P(\d+)")
"""Pattern of a spectral acceleration at a period, in capitals."""
_SA_COLUMN = re.compile(r"sa_(\d+(?:\.\d+)?)s_m_s2")
UNSCALED = ("arias_m_s", "cav_m_s")
"""Measures that already combine both horizontal components, so that no ratio of components applies."""

_BEFORE_UNIT = re.compile(r"_|,\s*|\s+in\s+|\s+")
"""Separators between a measure and its unit without brackets."""


def is_spectral(column: str) -> bool:
    """Whether a column is a spectral acceleration at any period, such as sa_3s_m_s2."""
    return _SA_COLUMN.fullmatch(column) is not None


def period_s(column: str) -> float:
    """Period of a column of spectral acceleration."""
    return float(column.removeprefix("sa_").removesuffix("s_m_s2"))


def quantity_of(column: str) -> Quantity:
    """Physical quantity of a column of peaks or spectral ordinates, from its unit."""
    if column.endswith("_m_s2"):
        return "acceleration"
    return "velocity" if column.endswith("_m_s") else "displacement"


def measure_of(imt: str) -> tuple[str, float] | None:
    """Column of a measure named as in OpenQuake (SA(0.2)) or nshmp-haz (SA0P2), and its unit in SI.

    Both give accelerations in g and velocity in cm/s. None for a measure without a column.
    """
    imt = " ".join(imt.strip()[:LONGEST_NAME].upper().split())
    for column, (name, per_si) in OPENQUAKE.items():
        if imt == name:
            return column, 1.0 / per_si
    if found := _SA.fullmatch(imt):
        return f"sa_{float(found[1] or f'{found[2]}.{found[3]}'):g}s_m_s2", STANDARD_G_M_S2
    return None


def imt_of(column: str) -> tuple[str, float]:
    """OpenQuake's name of a column, and the factor from SI to OpenQuake's unit."""
    if column in OPENQUAKE:
        return OPENQUAKE[column]
    if found := _SA_COLUMN.fullmatch(column):
        return f"SA({float(found[1])})", 1.0 / STANDARD_G_M_S2
    raise ValueError(f"{column} has no name in OpenQuake")


def measure_with_unit(text: str) -> tuple[str, float] | None:
    """Column and SI factor of a header such as pga_m_s2, PGA, SA(0.2), PGA (g), PGV [m/s], pgv_cm_s, pga_g."""
    text = text.strip()
    if len(text) > LONGEST_NAME:
        return None
    if text in OPENQUAKE or _SA_COLUMN.fullmatch(text):
        return text, 1.0
    if bare := measure_of(text):
        return bare
    return next(filter(None, (_of_unit(*parts) for parts in _name_and_unit(text))), None)


def _name_and_unit(text: str) -> Iterator[tuple[str, str]]:
    """Possible splits of a header into a measure and its unit."""
    if bracketed := re.fullmatch(r"(.+?)\s*[(\[]([^()\[\]]+)[)\]]", text):
        yield bracketed[1], bracketed[2]
    for sign in _BEFORE_UNIT.finditer(text):
        yield text[: sign.start()], text[sign.end() :].replace("_", "/")


def _of_unit(name: str, unit_name: str) -> tuple[str, float] | None:
    """Column of a measure and SI factor of its unit; None if either is unknown or they are of different quantities."""
    known, unit = measure_of(name), unit_of(unit_name)
    if known is None or unit is None or known[0] == "cav_m_s":
        return None
    return (known[0], unit.factor) if unit.quantity == quantity_of(known[0]) else None
