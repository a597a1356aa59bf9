"""`hints.toml`: what the user said of a scan, by the names of options, so that it can be repeated."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypedDict

from toppling.models.errors import InputError, did_you_mean, refusals
from toppling.models.files.documents import read_toml
from toppling.models.files.folder import new_file
from toppling.models.frames import azimuth_of

HINTS = "hints.toml"
FLAT, ROUGH, ROUNDED = KINDS = ("flat", "rough", "rounded")
"""Kinds of bases: dressed or split, rough, and rounded toward their outline."""
Place = Sequence[float]


class ReadingHints(TypedDict, total=False):
    """Hints on the contents of files, by the names of options; `up`, `length`, `gcp` in the model's frame."""

    units: str | None
    up: str | Place | None
    length: tuple[Place, Place, float] | None
    gcp: str | Path | Sequence[str] | None
    crs: str | None
    rock: str | None
    pedestal: str | None


class CloudHints(ReadingHints, total=False):
    """Hints on files, rock and interface, survey coordinates, metres and degrees. Another one needs a new scan."""

    near: tuple[float, float] | None
    plane: tuple[float, ...] | None
    point: Sequence[Place]
    outline: str | Path | Sequence[Place] | None


class Hints(CloudHints, total=False):
    """Hints on files, rock, interface and the base."""

    touch: Sequence[Place]
    daylight: Sequence[Place]
    pull: Sequence[tuple[float, float]]
    base: str | None
    touch_only: bool


OF_READING = tuple(ReadingHints.__annotations__)
OF_CLOUDS = tuple(CloudHints.__annotations__)
KEYS = tuple(Hints.__annotations__)
_PLACES = ("point", "outline", "touch", "daylight")
RIVALS = (
    ("rock", "near"),
    ("pedestal", "near"),
    ("plane", "point", "outline"),
    ("units", "length", "gcp"),
    ("up", "gcp"),
)
"""Options of which one excludes the others."""


def outside_cloud(
    place_m: Iterable[float],
    low_m: Iterable[float],
    high_m: Iterable[float],
    where: str,
    asked: str = "places",
) -> InputError:
    """Refusal of a place of the user's that a cloud of these bounds does not show, survey coordinates.

    asked: what to give in its place.
    """
    place, low, high = (", ".join(f"{x:.2f}" for x in places) for places in (place_m, low_m, high_m))
    return InputError(
        "hint.outside_cloud",
        f"{place} lies outside the cloud",
        where=where,
        expected=f"survey coordinates from {low} to {high}",
        remedy=f"give {asked} in the coordinates of the clouds, in metres",
    )


_unusable = refusals(
    expected=f"a TOML file with some of the keys {', '.join(KEYS)}",
    remedy="take the hints.toml that a scan has written beside its scene.json as a pattern",
)


def read_hints(path: Path) -> dict[str, Any]:
    """Values by option, in the words of the command line.

    Raises InputError if the file is absent, large, no TOML, or has another key or form.
    """
    hints = read_toml(path, _unusable)
    for key in hints:
        if key not in KEYS:
            meant = did_you_mean(key, KEYS, "see the list")
            raise _unusable("hint.unknown", f"'{key}' is no hint; {meant}", path)
        try:
            hints[key] = plain(key, hints[key])
        except (TypeError, ValueError, LookupError):
            raise _unusable("hint.form_unknown", f"'{key}' has a value of another form", path) from None
    return hints


def hints_text(hints: Mapping[str, Any]) -> str:
    """The file's content: TOML's strings, numbers and arrays of these are those of JSON.

    Examples
    --------
    >>> print(hints_text({"near": (1.5, 2.0), "units": None, "point": [(1, 2, 3.5)]}), end="")
    # Repeat the scan: toppling scan FILES --hints hints.toml --out FOLDER
    near = [1.5, 2.0]
    point = ["1.0,2.0,3.5"]
    """
    lines = ["# Repeat the scan: toppling scan FILES --hints hints.toml --out FOLDER"]
    lines += [f"{key} = {json.dumps(plain(key, hints[key]))}" for key in KEYS if hints.get(key)]
    return "\n".join(lines) + "\n"


def write_hints(path: Path, hints: Mapping[str, Any]) -> None:
    """Write what was said, complete or not at all."""
    with new_file(path) as staging:
        staging.write_text(hints_text(hints), encoding="utf-8")


def plain(key: str, value: Any) -> Any:
    """A hint's value in the words of the command line, which JSON and TOML can hold."""
    if value is None or isinstance(value, str):
        return value
    if key in _PLACES:
        return [_as_text(place) for place in value]
    if key == "length":
        return [_as_text(value[0]), _as_text(value[1]), float(value[2])]
    if key == "pull":
        return [[azimuth_of(azimuth), float(ratio)] for azimuth, ratio in value]
    if key == "plane":
        return [*map(float, value[:-1]), azimuth_of(value[-1])]
    if key == "near":
        return [float(number) for number in value]
    return _as_text(value) if key == "up" else value


def _as_text(place: str | Place) -> str:
    return place if isinstance(place, str) else ",".join(repr(float(number)) for number in place)
