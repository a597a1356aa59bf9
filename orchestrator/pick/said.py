"""What a page says of a scan, by the names of `hints.toml`: checked value by value, as it may come from anywhere."""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from toppling.models.documents import shown
from toppling.models.errors import refusals
from toppling.models.scan.inspection import Inspection, inspection_of
from toppling.models.scan.interface_hint import InterfaceHint, hint_of

MOST_PLACES = 1000
"""Of a kind."""
FEWEST_POINTS = 3
"""Points that make an interface; fewer are a beginning."""

Place = tuple[float, ...]

_unusable = refusals(
    expected="hints by name, each a list of numbers (near, plane) or a list of such lists (point, touch, daylight, "
    "pull)",
    remedy="load the page again",
)


@dataclass(frozen=True)
class Said:
    """Hints on a scan, survey coordinates in metres, angles in degrees.

    Parameters
    ----------
    near, plane : tuple of float, optional
    point, touch, daylight, pull : tuple of tuple of float
        As the options of `toppling scan`.
    """

    near: Place | None = None
    plane: Place | None = None
    point: tuple[Place, ...] = ()
    touch: tuple[Place, ...] = ()
    daylight: tuple[Place, ...] = ()
    pull: tuple[Place, ...] = ()

    @classmethod
    def of(cls, content: Any) -> "Said":
        """Hints from a page's JSON.

        Raises
        ------
        InputError
            If a name is none of a hint, or a value is no list of finite numbers of its length.
        """
        if not isinstance(content, Mapping):
            raise _unusable(f"{shown(content)} is no table of hints", "the page")
        values: dict[str, Any] = {}
        for name, value in content.items():
            if name in ONE and value is not None:
                values[name] = _numbers(value, ONE[name], name)
            elif name in MANY:
                if not isinstance(value, list) or len(value) > MOST_PLACES:
                    raise _unusable(f"{name} is {shown(value)}", "the page")
                values[name] = tuple(_numbers(each, MANY[name], name) for each in value)
            elif name not in ONE:
                raise _unusable(f"{shown(name)} is no hint", "the page")
        return cls(**values)

    @property
    def of_the_split(self) -> "Said":
        """What changes the rock and its interface, and not the base alone."""
        points = self.point if len(self.point) >= FEWEST_POINTS else ()
        return Said(self.near, self.plane, points)

    def hint(self) -> InterfaceHint | None:
        """The interface that is meant; none yet while points are too few."""
        return hint_of(self.plane, self.of_the_split.point)

    def inspection(self) -> Inspection:
        """What is known of the base."""
        return inspection_of(None, [(pull[0], pull[1]) for pull in self.pull], self.touch, self.daylight)

    def to_json(self) -> dict[str, Any]:
        """Values by name."""
        return dataclasses.asdict(self)


ONE = {"near": 2, "plane": 5}
MANY = {"point": 3, "touch": 3, "daylight": 3, "pull": 2}
"""Numbers in each, by name."""


def _numbers(value: Any, count: int, name: str) -> Place:
    good = isinstance(value, list) and len(value) == count
    if not good or not all(type(each) in (int, float) and math.isfinite(each) for each in value):
        raise _unusable(f"{name} is {shown(value)}", "the page")
    return tuple(float(each) for each in value)
