"""Names and units of intensity measures in hazard files, and the results' columns that they are."""

import re

from toppling.models.motions.measures import OPENQUAKE, STANDARD_G_M_S2

_SA = re.compile(r"SA ?(?:\(?(\d+(?:\.\d+)?) ?S?\)?|(\d+)P(\d+))")
_SA_COLUMN = re.compile(r"sa_(\d+(?:\.\d+)?)s_m_s2")
UNSCALED = ("arias_m_s", "cav_m_s")
"""Measures of both horizontal components: no ratio of components applies to them."""

LONGEST_NAME = 200
"""Characters; a longer text names no column, and is not searched for one."""

_UNITS = {
    "g": ("m/s2", STANDARD_G_M_S2), "%g": ("m/s2", 0.01 * STANDARD_G_M_S2), "mg": ("m/s2", 0.001 * STANDARD_G_M_S2),
    "m/s2": ("m/s2", 1.0),
    "cm/s2": ("m/s2", 0.01), "gal": ("m/s2", 0.01), "m/s": ("m/s", 1.0), "cm/s": ("m/s", 0.01),
    "mm/s": ("m/s", 0.001), "m": ("m", 1.0), "cm": ("m", 0.01),
}  # fmt: skip
"""SI unit of each unit, and how many of them it is."""


def _unit(text: str) -> str:
    """A unit as `_UNITS` spells it: cm/s^2, cm/sec2, cm/s/s, cm/s² and cm_s2 are one."""
    plain = re.sub(r"[\s^*]", "", text.lower()).replace("²", "2").replace("sec", "s").replace("_s", "/s")
    return plain.replace("/s/s", "/s2")


def is_spectral(column: str) -> bool:
    """Whether a column is a spectral acceleration, at any period: sa_3s_m_s2."""
    return _SA_COLUMN.fullmatch(column) is not None


def period_s(column: str) -> float:
    """Period of a column of spectral acceleration."""
    return float(column.removeprefix("sa_").removesuffix("s_m_s2"))


def sa_column(period_s: float) -> str:
    """Column of the spectral acceleration at a period in seconds."""
    return f"sa_{period_s:g}s_m_s2"


def measure_of(imt: str) -> tuple[str, float] | None:
    """Column of a measure as OpenQuake (SA(0.2)) or nshmp-haz (SA0P2) name it, and what its unit is in SI.

    Both state accelerations in g and velocity in cm/s. None for a measure that no column is.
    """
    imt = imt.strip().upper()
    for column, (name, per_si) in OPENQUAKE.items():
        if imt == name:
            return column, 1.0 / per_si
    if found := _SA.fullmatch(imt):
        period = found[1] or f"{found[2]}.{found[3]}"
        return sa_column(float(period)), STANDARD_G_M_S2
    return None


def imt_of(column: str) -> tuple[str, float]:
    """OpenQuake's name of a column, and the factor from SI to its unit."""
    if column in OPENQUAKE:
        return OPENQUAKE[column]
    if found := _SA_COLUMN.fullmatch(column):
        return f"SA({float(found[1])})", 1.0 / STANDARD_G_M_S2
    raise ValueError(f"{column} has no name in OpenQuake")


def measure_with_unit(text: str) -> tuple[str, float] | None:
    """Column and SI factor of a header's words: pga_m_s2, PGA, SA(0.2), PGA (g), PGV [m/s], pgv_cm_s, pga_g."""
    text = text.strip()
    if len(text) > LONGEST_NAME:
        return None
    if text in OPENQUAKE or _SA_COLUMN.fullmatch(text):
        return text, 1.0
    if bare := measure_of(text):
        return bare
    stated = re.fullmatch(r"(?P<name>.+?)\s*[(\[](?P<unit>[^()\[\]]+)[)\]]", text) or re.fullmatch(
        r"(?P<name>[A-Za-z]+(?:\([\d.]+\))?)_(?P<unit>g|gal|cm_s2|m_s2|cm_s|m_s|cm|m)", text
    )
    known = stated and measure_of(stated["name"])
    if not (stated and known):
        return None
    unit = _UNITS.get(_unit(stated["unit"]))
    own = "m/s2" if known[0].endswith("_m_s2") else "m/s" if known[0].endswith("_m_s") else "m"
    return (known[0], unit[1]) if unit and unit[0] == own and known[0] != "cav_m_s" else None
