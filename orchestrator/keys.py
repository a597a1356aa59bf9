"""Declarations of the keys of user-written files: name, allowed values, default and meaning.

Parsing, error messages, the template of `toppling init` and the documentation's list are derived from them.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from toppling.models.errors import InputError, did_you_mean
from toppling.models.files.documents import is_number, shown
from toppling.models.files.folder import local, path_named_in
from toppling.models.files.schemas import MOST_JOBS

REQUIRED: Any = type("Required", (), {"__repr__": lambda _: "REQUIRED"})()


@dataclass(frozen=True)
class Place:
    """Location of a value (file and key), base folder of its paths, expected values and remedy."""

    where: str
    folder: Path = Path()
    expected: str = ""
    remedy: str = ""

    def wrong(self, code: str, what: str, expected: str = "", remedy: str = "") -> InputError:
        """Error for the value at this place."""
        return InputError(
            code, what, where=self.where, expected=expected or self.expected, remedy=remedy or self.remedy
        )

    def unusable(self, given: Any, expected: str = "", remedy: str = "") -> InputError:
        """Error for a value of another kind, or out of its range."""
        return self.wrong("campaign.value_unusable", shown(given), expected, remedy)


_Reader = Callable[[Any, Place], Any]


@dataclass(frozen=True)
class Key:
    """Declaration of a key."""

    name: str  # with the unit as suffix
    read: _Reader  # parses and validates a value, or raises an `InputError`
    values: str  # description of the allowed values, with the unit
    help: str  # meaning
    default: Any = REQUIRED  # `REQUIRED` if there is none
    otherwise: str = "none"  # description of the default
    example: str = ""  # a value in TOML
    page: str = ""  # page of the documentation with details

    def place(self, where: str, folder: Path) -> Place:
        """Place of the key in a file."""
        remedy = "correct the value; mind the unit in the key's name"
        if self.default is not REQUIRED:
            remedy = f"leave it out for {self.otherwise}"
        return Place(f"{where}{self.name}", folder, self.values, remedy)

    @property
    def line(self) -> str:
        """Commented line for a template file."""
        return f"# {self.name} = {self.example}  # {self.help}; left out: {self.otherwise}"


def read_keys(
    keys: Sequence[Key], content: Mapping[str, Any], where: str, folder: Path, joint: str = ": "
) -> dict[str, Any]:
    """Read the values of all keys, with defaults for keys that the content lacks.

    Raises InputError if a key is unknown or missing, or a value is out of its range.
    """
    known = {key.name: key for key in keys}
    content = {name: value for name, value in content.items() if value is not None or name not in known}
    if unknown := [name for name in content if name not in known]:
        remedy = did_you_mean(unknown[0], known, "correct or remove it")
        raise Place(where).wrong(
            "campaign.key_unknown", f"unknown key {shown(unknown[0])}", f"keys: {', '.join(known)}", remedy
        )
    if missing := [key.name for key in keys if key.default is REQUIRED and key.name not in content]:
        raise Place(where).wrong(
            "campaign.key_missing",
            f"missing {', '.join(missing)}",
            "a value for each",
            "add them to the file",
        )
    return {
        key.name: key.read(content[key.name], key.place(f"{where}{joint}", folder))
        if key.name in content
        else key.default
        for key in keys
    }


def number(fits: Callable[[Any], bool], kind: type = float) -> _Reader:
    """Reader of a number (or, by `kind`, of an integer or a boolean) that satisfies a condition."""

    def read(given: Any, place: Place) -> Any:
        right = is_number(given) if kind is float else type(given) is kind
        if not right or not fits(given):
            text = str(given).strip().removesuffix(".0")
            meant = kind is int and type(given) in (str, float) and text.isascii() and text.isdigit()
            raise place.unusable(given, remedy=f"did you mean {text}?" if meant else "")
        return kind(given)

    return read


def word(known: Iterable[str]) -> _Reader:
    """Reader of one of several words."""

    def read(given: Any, place: Place) -> str:
        if not isinstance(given, str) or given not in known:
            raise place.unusable(given, remedy=did_you_mean(given, known, place.remedy))
        return given

    return read


def path(given: Any, place: Place) -> Path:
    """Read a path, relative to the file."""
    if not isinstance(given, str) or not given:
        raise place.unusable(given, remedy="give the path as a string")
    return path_named_in(place.folder, str(local(given)))


def texts(given: Any, place: Place) -> tuple[str, ...]:
    """Read a list of distinct texts."""
    if not isinstance(given, list) or not given or not all(isinstance(text, str) and text for text in given):
        raise place.unusable(given)
    return tuple(distinct(given, place))


def pair(highest: float) -> _Reader:
    """Reader of two ascending numbers between 0 and `highest`."""

    def read(given: Any, place: Place) -> tuple[float, float]:
        two = isinstance(given, list) and len(given) == 2 and all(map(is_number, given))
        if not two or not 0.0 <= given[0] <= given[1] <= highest:
            raise place.unusable(given)
        return float(given[0]), float(given[1])

    return read


def axis(fits: Callable[[float], bool], instead: str | None = None) -> _Reader:
    """Reader of numbers from a list or a table {start, stop, step}, stop included; the word `instead` gives none."""

    def read(given: Any, place: Place) -> tuple[float, ...]:
        if instead is not None and given == instead:
            return ()
        numbers = (
            _of_range(given, place) if isinstance(given, dict) else [given] if is_number(given) else given
        )
        if not isinstance(numbers, list) or not numbers:
            raise place.wrong(
                "campaign.list_empty", shown(numbers), remedy="at least one value is needed to have a job"
            )
        if strange := [number for number in numbers if not is_number(number) or not fits(number)]:
            raise place.unusable(strange[0])
        return tuple(float(number) for number in distinct(numbers, place))

    return read


def _of_range(given: Mapping[str, Any], place: Place) -> list[float]:
    if set(given) != {"start", "stop", "step"} or not all(map(is_number, given.values())):
        raise place.wrong(
            "campaign.range_unreadable",
            shown(given),
            "{ start = ..., stop = ..., step = ... } in numbers",
            "or give a list",
        )
    start, stop, step = given["start"], given["stop"], given["step"]
    if not (step > 0 and stop >= start):
        sound = f"{{ start = {min(start, stop):g}, stop = {max(start, stop):g}, step = {abs(step) or 1:g} }}"
        what = f"the range from {start:g} to {stop:g} in steps of {step:g} holds no number"
        raise place.wrong(
            "campaign.range_empty", what, "step above 0, stop not below start", f"did you mean {sound}?"
        )
    # A tolerance of 5e-4 steps lets 0.1 + 0.1 + 0.1 reach a stop of 0.3; rounding restores 0.3.
    many = (float(stop) - float(start)) / step
    if not many < MOST_JOBS:
        what = f"{shown(given)} holds {many:.3g} numbers"
        raise place.wrong("campaign.list_too_long", what, f"at most {MOST_JOBS}", "take a larger step")
    return [round(start + index * step, 12) for index in range(int(many + 5e-4) + 1)]


def distinct(values: list, place: Place) -> list:
    """Check that values are distinct and not too many, and return them."""
    if len(values) > MOST_JOBS:
        raise place.wrong(
            "campaign.list_too_long", f"{len(values)} values", f"at most {MOST_JOBS}", "leave some out"
        )
    if repeated := [shown(value) for value, count in Counter(values).items() if count > 1]:
        what = f"{', '.join(sorted(repeated)[:10])} given twice"
        raise place.wrong("campaign.value_repeated", what, "every value once", "remove the repetition")
    return values
