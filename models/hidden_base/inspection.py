"""Observations of the base by inspection: places that touch, places where daylight shows through, pull tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from toppling.models.arrays import Array
from toppling.models.errors import InputError, refusals
from toppling.models.files.table import Table, places_in
from toppling.models.scan.hints_file import FLAT, KINDS, outside_cloud

LEAST_PLACES = 3
"""Number of places that determine a plane: of an interface, or of contacts on which a rock stands."""
_TOUCHES, _OPEN = ("touch", "contact", "1"), ("daylight", "open", "gap", "0")


_unusable = refusals(
    expected="a place a line: x,y,z,touch or x,y,z,daylight, in survey coordinates and metres",
    remedy="give one line for each place at the base where rock and pedestal touch, or where light shows through",
)


def _no_places() -> Array:
    return np.zeros((0, 3))


@dataclass(frozen=True, eq=False)
class Inspection:
    """Knowledge of the base, in survey coordinates."""

    # (n, 3): places where rock and pedestal touch, and where daylight shows through between them.
    touching_m: Array = field(default_factory=_no_places)
    open_m: Array = field(default_factory=_no_places)
    # Azimuth toward which the rock was pulled, horizontally at the height of its centre of mass, degrees from
    # east to north, and the force over its weight that lifted it until it would have gone on by itself.
    pulls: tuple[tuple[float, float], ...] = ()
    base: str | None = None  # kind of the base, one of `hints_file.KINDS`
    touch_only: bool = False  # whether rock and pedestal touch at the places that touch and nowhere else
    file: str = "--contact"  # where the places are from
    lines: tuple[int, ...] = ()  # line of the file of each place, those that touch first

    @property
    def says_nothing(self) -> bool:
        """Whether it holds no knowledge."""
        return not (len(self.touching_m) or len(self.open_m) or self.pulls or self.base)

    @property
    def places_m(self) -> Array:
        """All places (n, 3), those that touch first."""
        return np.vstack([self.touching_m, self.open_m])

    def misplaced(self, code: str, number: int, what: str, expected: str, remedy: str) -> InputError:
        """Refusal of one of the places."""
        return InputError(code, what, where=self._where(number), expected=expected, remedy=remedy)

    def _where(self, number: int) -> str:
        return self.file + (f", line {self.lines[number]}" if self.lines else f", place {number + 1}")

    def check(self, low_m: Array, high_m: Array) -> None:
        """Refuse what contradicts itself, and a place that a cloud, of these bounds, does not show.

        Raises
        ------
        InputError
            If a place lies outside, or the rock is said to touch nowhere, or everywhere and at single places only.
        """
        if self.touch_only and len(self.touching_m) < LEAST_PLACES:
            raise InputError(
                "base.too_few_touches",
                f"{len(self.touching_m)} places are said to touch, and nothing else",
                where="--touch-only",
                expected=f"at least {LEAST_PLACES} places, around the line of the weight, on which the rock stands",
                remedy="give the others by --touch or --contact, or leave --touch-only out",
            )
        if self.touch_only and self.base == FLAT:
            raise InputError(
                "base.flat_touches_everywhere",
                "a flat base lies on its pedestal everywhere, and not at single places",
                where="--base and --touch-only",
                expected="one of them",
                remedy="leave --touch-only out, or say --base rough or --base rounded",
            )
        outside = ((self.places_m < low_m) | (self.places_m > high_m)).any(axis=1)
        if outside.any():
            number = int(outside.argmax())
            raise outside_cloud(self.places_m[number], low_m, high_m, self._where(number))

    def moved(self, shift_m: Array) -> Inspection:
        """Inspection in coordinates from which `shift_m` is taken away."""
        return replace(self, touching_m=self.touching_m - shift_m, open_m=self.open_m - shift_m)


def inspection_of(
    contact: str | Path | None = None,
    pulls: Sequence[Sequence[float]] = (),
    touching_m: Sequence[Sequence[float]] = (),
    open_m: Sequence[Sequence[float]] = (),
    base: str | None = None,
    touch_only: bool = False,
) -> Inspection:
    """Inspection from the command line's options.

    Parameters
    ----------
    contact : path, optional
        File with a place a line: x, y, z and `touch` or `daylight`; a line of column names may come first.
    pulls : sequence of (azimuth_deg, ratio)
    touching_m, open_m : sequences of (x, y, z)
        Further places, survey coordinates.
    base : str, optional
        Kind of the base.
    touch_only : bool
        Whether it touches nowhere else.

    Raises
    ------
    InputError
        If the file cannot be read, a ratio is none, or the base is of no kind.
    """
    if base is not None and base not in KINDS:
        raise InputError(
            "base.kind_unknown",
            f"'{base}' is no kind of base",
            where="--base",
            expected=f"one of {', '.join(KINDS)}",
            remedy="leave it out where you do not know: the scan then weighs all three by what it saw",
        )
    for azimuth, ratio in pulls:
        if not (0.0 <= azimuth < 360.0 and 0.0 < ratio < 3.0):
            raise InputError(
                "base.pull_unusable",
                f"{azimuth:g} {ratio:g} is no pull test",
                where="--pull",
                expected="the azimuth of the pull, from 0 to below 360 degrees counter-clockwise from east, and its "
                "force over the rock's weight, below 3",
                remedy="write it like --pull 135 0.32; of a tilt test the ratio is the tangent of the angle",
            )
    measured = tuple((float(azimuth), float(ratio)) for azimuth, ratio in pulls)
    touching, free = (np.array(places, float).reshape(-1, 3) for places in (touching_m, open_m))
    known = Inspection(touching, free, measured, base, touch_only, "--touch and --daylight")
    if contact is None:
        return known
    of_file = _places(Path(contact))
    return replace(
        known,
        touching_m=np.vstack([of_file.touching_m, touching]),
        open_m=np.vstack([of_file.open_m, free]),
        file=of_file.file,
        lines=() if len(known.places_m) else of_file.lines,
    )


def _places(path: Path) -> Inspection:
    found: dict[bool, list[list[float]]] = {True: [], False: []}
    at: dict[bool, list[int]] = {True: [], False: []}
    table = Table.read(path, _unusable, coordinates=True)
    for number, cells, place in places_in(table, slice(3), (4,), _unusable)[1]:
        if (kind := cells[3].lower()) not in _TOUCHES + _OPEN:
            raise _unusable("hint.place_unreadable", f"line {number} says {kind!r}", path)
        found[kind in _TOUCHES].append(place)
        at[kind in _TOUCHES].append(number)
    if not found[True] and not found[False]:
        raise _unusable("hint.no_places", "holds no places", path)
    touching, free = (np.array(found[kind]).reshape(-1, 3) for kind in (True, False))
    return Inspection(touching, free, file=str(path), lines=(*at[True], *at[False]))
