"""What a page says of a scan, by the names of `hints.toml`: checked value by value, as it may come from anywhere."""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

from toppling.models.errors import refusals
from toppling.models.files.documents import shown
from toppling.models.hidden_base.inspection import Inspection, inspection_of
from toppling.models.lengths import METRES
from toppling.models.scan.hints_file import KINDS, Hints
from toppling.models.scan.interface_hint import InterfaceHint, hint_of
from toppling.models.scan.placement import upward

_MOST_PLACES = 1000
"""Of a kind."""
_FEWEST_POINTS = 3
"""Points that make an interface; fewer are a beginning."""

_Place = tuple[float, ...]

_unusable = refusals(
    expected="hints by the names of options: words (units, up), numbers (near, plane, length) or lists of numbers",
    remedy="load the page again",
)


@dataclass(frozen=True)
class UserHints:
    """Hints on a scan, survey coordinates in metres, angles in degrees.

    units, up, base: as the options of `toppling scan`; `up` may be three numbers, separated by commas.
    length: two places of the model, in its own coordinates, and the metres between them.
    point, outline, touch, daylight, pull: as the options of `toppling scan`.
    """

    units: str | None = None
    up: str | None = None
    length: tuple[_Place, _Place, float] | None = None
    near: _Place | None = None
    plane: _Place | None = None
    point: tuple[_Place, ...] = ()
    outline: tuple[_Place, ...] = ()
    touch: tuple[_Place, ...] = ()
    daylight: tuple[_Place, ...] = ()
    pull: tuple[_Place, ...] = ()
    base: str | None = None
    touch_only: bool = False

    @classmethod
    def of(cls, content: Any) -> "UserHints":
        """Hints from a page's JSON.

        Raises InputError if a name is none of a hint, or a value is no list of finite numbers of its length.
        """
        if not isinstance(content, Mapping):
            raise _unusable(f"{shown(content)} is no table of hints", "the page")
        values: dict[str, Any] = {}
        for name, value in content.items():
            if value is None and name in (*_ONE, *_WORDS, "length"):
                continue
            if name in _ONE:
                values[name] = _numbers(value, _ONE[name], name)
            elif name == "length":
                values[name] = _length(value)
            elif name == "touch_only" and isinstance(value, bool):
                values[name] = value
            elif name in _WORDS:
                values[name] = _word(value, _WORDS[name], name)
            elif name in _MANY:
                if not isinstance(value, list) or len(value) > _MOST_PLACES:
                    raise _unusable(f"{name} is {shown(value)}", "the page")
                values[name] = tuple(_numbers(each, _MANY[name], name) for each in value)
            else:
                raise _unusable(f"{shown(name)} is no hint", "the page")
        return cls(**values)

    @property
    def of_the_cloud(self) -> "UserHints":
        """What changes the coordinates of the cloud."""
        return UserHints(self.units, self.up, self.length)

    @property
    def of_the_split(self) -> "UserHints":
        """What changes the rock and its interface, and not the base alone."""
        points = self.point if len(self.point) >= _FEWEST_POINTS else ()
        return dataclasses.replace(
            self.of_the_cloud, near=self.near, plane=self.plane, point=points, outline=self.outline
        )

    def hints(self) -> Hints:
        """The same for those who read and write hints; points that make no interface yet are left out."""
        return cast(Hints, dataclasses.asdict(self) | {"point": self.of_the_split.point})

    def hint(self) -> InterfaceHint | None:
        """The interface that is meant; none yet while points are too few."""
        return hint_of(self.plane, self.of_the_split.point, self.outline)

    def inspection(self) -> Inspection:
        """What is known of the base."""
        pulls = [(pull[0], pull[1]) for pull in self.pull]
        return inspection_of(None, pulls, self.touch, self.daylight, self.base, self.touch_only)

    def to_json(self) -> dict[str, Any]:
        """Values by name."""
        return dataclasses.asdict(self)


_ONE = {"near": 2, "plane": 5}
_MANY = {"point": 3, "outline": 3, "touch": 3, "daylight": 3, "pull": 2}
"""Numbers in each, by name."""


_WORDS = {"units": tuple(METRES), "up": (), "base": KINDS}
"""What each word may be; of the upward axis its reader decides."""
_LONGEST_WORD = 100


def _word(value: Any, among: tuple[str, ...], name: str) -> str:
    if not isinstance(value, str) or len(value) > _LONGEST_WORD or (among and value not in among):
        raise _unusable(f"{name} is {shown(value)}", "the page")
    if name == "up":
        upward(value)
    return value


def _length(value: Any) -> tuple[_Place, _Place, float]:
    if not isinstance(value, list) or len(value) != 3:
        raise _unusable(f"length is {shown(value)}", "the page")
    start, end = (_numbers(each, 3, "length") for each in value[:2])
    return start, end, _numbers(value[2:], 1, "length")[0]


def _numbers(value: Any, count: int, name: str) -> _Place:
    good = isinstance(value, list) and len(value) == count
    if not good or not all(type(each) in (int, float) and math.isfinite(each) for each in value):
        raise _unusable(f"{name} is {shown(value)}", "the page")
    return tuple(float(each) for each in value)
