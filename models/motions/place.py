"""Where a sensor stands: on the ground's surface, below it, or in a structure; and the words in headers that say so."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from toppling.models.files.given import LONGEST_NAME
from toppling.models.lengths import METRES

_LEAST_DEPTH_M = 3.0
"""COSMOS (table 6) calls sensors in vaults less than this below the surface near-surface, deeper ones in tunnels."""


@dataclass(frozen=True)
class Place:
    """Place of a sensor as stated in its file; in the free field where the file states nothing else."""

    depth_m: float = 0.0  # below the ground's surface; 0 too where the file does not state it
    structure: str = ""  # where it stands, if not in the free field: on floor 12 of a building, in a borehole

    @property
    def free_field(self) -> bool:
        """Whether the record is the ground's motion."""
        return not self.structure and self.depth_m < _LEAST_DEPTH_M

    def __str__(self) -> str:
        if self.free_field:
            return "in the free field"
        return f"{self.depth_m:g} m below the surface" if self.depth_m else f"sensor {self.structure}"


FREE_FIELD = Place()
BOREHOLE = Place(0.0, "in a borehole, at a depth that its header does not state")


def at_depth(depth_m: float) -> Place:
    """Place of a sensor at a depth below the surface; above it, which only a structure is, where negative."""
    if not math.isfinite(depth_m):
        return FREE_FIELD
    above = depth_m <= -_LEAST_DEPTH_M
    return Place(0.0, f"{-depth_m:g} m above the ground") if above else Place(max(depth_m, 0.0))


_OF_SENSOR = re.compile(
    r"(?:^\W*(?:location|instrument|installation|(?=depth))(?=(?:depth)?\W*[:=])"
    r"|\b(?:sensor|instrument|transducer|channel)[ _]location|\b(?=(?:sensor|instrument|borehole)[ _]depth))\W*(.+)",
    re.IGNORECASE,
)
_DEPTH = re.compile(
    r"(?:(?:depth|down-?hole|bore-?hole|pozo)[^\d]{0,12}|\B-)(?P<after>\d+(?:\.\d+)?)"
    r" *(?P<unit>m|meters?|metres?|ft|feet)\b"
    r"|(?P<before>\d+(?:\.\d+)?)[ -]*(?P<of>m|meters?|metres?|ft|feet) +(?:deep|depth|below|down)",
    re.IGNORECASE,
)
_AT_GROUND = re.compile(
    r"\b(?:free[ -]?field|ff|(?:at|on) grade|ground|surface|1st fl\w*|first floor|floor 1|planta baja)\b",
    re.IGNORECASE,
)
_ORDINALS = (
    "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth", "eleventh", "twelfth",
)  # fmt: skip
_FLOOR = re.compile(
    rf"(?:(?P<number>\d+)(?:st|nd|rd|th)|(?P<word>{'|'.join(_ORDINALS)}))[ -](?:floor|flr?|level|stor(?:e?y))\b\.?"
    r"|\b(?:floor|flr?|level|piso|nivel) ?(?P<after>\d+)",
    re.IGNORECASE,
)
_STRUCTURES = (
    (r"(?:sub-?)?basement|bsmt|s[oó]tano", "in the basement of a building"),
    (r"roof(?:top)?|penthouse|azotea", "on the roof of a building"),
    (r"mezzanine|attic|atrium", "inside a building"),
    (r"(?<!ridge )crest|gallery", "on or in a dam"),
    (r"abut(?:ment)?", "on the abutment of a dam or bridge"),
    (r"(?:bridge )?deck|girder|bent|(?:bridge|top of) pier|pier \d+|pylon|pile ?cap|footing", "on a bridge"),
    (r"tunnel|adit", "in a tunnel"),
)
"""Words of a sensor's location, and where it stands then. A place at ground level is none of these: agencies count the
base of a building as a reference station (COSMOS, table 6, code 5)."""
_OF_NAMES = (
    r"(?:down-?hole|bore-?hole|pozo)(?:[ ,]*\d[\d.]* *(?:m|ft))?", "dam crest", "crest of",
    "(?:sub-?)?basement|bsmt|s[oó]tano", "roof|penthouse|azotea",
)  # fmt: skip
"""Words that state a sensor's location also at the end of a station's name."""
_NAME_END = re.compile(
    rf"(?:^|[\s,;(-])(?P<end>(?:{'|'.join(_OF_NAMES)})(?: (?:the )?dam)?|{_FLOOR.pattern})[\s).]*$",
    re.IGNORECASE,
)


def place_in_words(location: str) -> Place | None:
    """Place by the text of a sensor's location: basement, 12th floor, downhole 30 m, dam crest; None if it says none.

    A depth decides, then words for the ground's level, then those for structures.
    """
    location = location[:LONGEST_NAME]
    if found := _DEPTH.search(location):
        unit = (found["unit"] or found["of"]).lower()
        return Place(float(found["after"] or found["before"]) * METRES["ft" if unit[0] == "f" else "m"])
    if re.search(r"down-?hole|bore-?hole|\bpozo\b", location, re.IGNORECASE):
        return BOREHOLE
    if _AT_GROUND.search(location):
        return FREE_FIELD
    if found := _FLOOR.search(location):
        number = found["number"] or found["after"] or str(_ORDINALS.index(found["word"].lower()) + 2)
        return Place(0.0, f"on floor {int(number)} of a building") if int(number) > 1 else FREE_FIELD
    for words, structure in _STRUCTURES:
        if re.search(rf"\b(?:{words})\b", location, re.IGNORECASE):
            return Place(0.0, structure)
    return None


def place_in_name(station: str) -> Place:
    """Place by the end of a station's name (LACPW, 12th Fl); words inside a name are of streets and companies."""
    found = _NAME_END.search(station[-LONGEST_NAME:])
    return (found and place_in_words(found["end"])) or FREE_FIELD


def place_above(lines: Sequence[str]) -> Place:
    """Place by a line of text above samples that names the sensor's location or depth; others name the earthquake's."""
    searched = (_OF_SENSOR.search(line[:LONGEST_NAME]) for line in lines[:LONGEST_NAME])
    found = next(filter(None, searched), None)
    return (found and place_in_words(found[1])) or FREE_FIELD
