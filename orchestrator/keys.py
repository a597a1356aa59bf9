"""Keys of a file that a person writes, each declared once: its name, what it may be, its default, its meaning.

Reading, refusals, the template of `toppling init` and the list in the documentation come from the declaration.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from toppling.models.errors import InputError
from toppling.models.files.documents import is_number, shown
from toppling.models.files.folder import local, named_beside
from toppling.models.spelling import did_you_mean

_MOST_ON_AN_AXIS = 50_000
"""Of levels, azimuths, coefficients or records; azimuths a hundredth of a degree apart are 36,000."""

REQUIRED: Any = type("Required", (), {"__repr__": lambda _: "REQUIRED"})()


@dataclass(frozen=True)
class Place:
    """Where a value stands (file and key), the folder that its paths start from, what is expected, and what to do."""

    where: str
    folder: Path = Path()
    expected: str = ""
    remedy: str = ""

    def wrong(self, code: str, what: str, expected: str = "", remedy: str = "") -> InputError:
        """The refusal of what stands there."""
        return InputError(
            code, what, where=self.where, expected=expected or self.expected, remedy=remedy or self.remedy
        )


_Reader = Callable[[Any, Place], Any]


@dataclass(frozen=True)
class Key:
    """One key."""

    name: str  # with its unit at the end
    read: _Reader  # value of what a file says, or an `InputError`
    values: str  # what it may be, with the unit
    help: str  # what it means
    default: Any = REQUIRED  # `REQUIRED` if there is none
    otherwise: str = "none"  # what the default means
    example: str = ""  # a value in TOML
    page: str = ""  # of the documentation that says more

    def place(self, where: str, folder: Path) -> Place:
        """Where it stands in a file."""
        remedy = "correct the value; mind the unit in the key's name"
        if self.default is not REQUIRED:
            remedy = f"leave it out for {self.otherwise}"
        return Place(f"{where}{self.name}", folder, self.values, remedy)

    @property
    def line(self) -> str:
        """Line of a file, commented out."""
        return f"# {self.name} = {self.example}  # {self.help}; left out: {self.otherwise}"


def read_keys(
    keys: Sequence[Key],
    content: Mapping[str, Any],
    where: str,
    folder: Path,
    joint: str = ": ",
    instead: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """Values of all keys, defaults where the content has none.

    instead: what to do where a key that people expect is none.
    Raises InputError if a key is unknown or missing, or a value is out of its range.
    """
    known = {key.name: key for key in keys}
    content = {name: one for name, one in content.items() if one is not None or name not in known}
    if unknown := [name for name in content if name not in known]:
        remedy = (instead or {}).get(unknown[0]) or did_you_mean(unknown[0], known, "correct or remove it")
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
    """Reader of a number (or, by `kind`, of a whole number or a truth value) that fits."""

    def read(given: Any, place: Place) -> Any:
        right = is_number(given) if kind is float else type(given) is kind
        if not right or not fits(given):
            text = str(given).strip().removesuffix(".0")
            meant = kind is int and type(given) in (str, float) and text.isascii() and text.isdigit()
            raise place.wrong(
                "campaign.value_unusable", shown(given), remedy=f"did you mean {text}?" if meant else ""
            )
        return kind(given)

    return read


def word(known: Iterable[str]) -> _Reader:
    """Reader of one of some words."""

    def read(given: Any, place: Place) -> str:
        if not isinstance(given, str) or given not in known:
            raise place.wrong(
                "campaign.value_unusable", shown(given), remedy=did_you_mean(given, known, place.remedy)
            )
        return given

    return read


def path(given: Any, place: Place) -> Path:
    """Read a path, relative to the file."""
    if not isinstance(given, str) or not given:
        raise place.wrong("campaign.value_unusable", shown(given), remedy="give the path as a string")
    return named_beside(place.folder, str(local(given)))


def texts(given: Any, place: Place) -> tuple[str, ...]:
    """Read a list of texts, each once."""
    if not isinstance(given, list) or not given or not all(isinstance(one, str) and one for one in given):
        raise place.wrong("campaign.value_unusable", shown(given))
    return tuple(distinct(given, place))


def pair(highest: float) -> _Reader:
    """Reader of two numbers from 0, the lower first."""

    def read(given: Any, place: Place) -> tuple[float, float]:
        two = isinstance(given, list) and len(given) == 2 and all(map(is_number, given))
        if not two or not 0.0 <= given[0] <= given[1] <= highest:
            raise place.wrong("campaign.value_unusable", shown(given))
        return float(given[0]), float(given[1])

    return read


def axis(fits: Callable[[float], bool], instead: str | None = None) -> _Reader:
    """Reader of the numbers of a list, or of a table {start, stop, step} that includes its stop; a word for none."""

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
        if strange := [one for one in numbers if not is_number(one) or not fits(one)]:
            raise place.wrong("campaign.value_unusable", shown(strange[0]))
        return tuple(float(one) for one in distinct(numbers, place))

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
    # Half a thousandth of a step lets 0.1 + 0.1 + 0.1 reach a stop of 0.3; rounding gives 0.3 back.
    many = (float(stop) - float(start)) / step
    if not many < _MOST_ON_AN_AXIS:
        what = f"{shown(given)} holds {many:.3g} numbers"
        raise place.wrong("campaign.list_too_long", what, f"at most {_MOST_ON_AN_AXIS}", "take a larger step")
    return [round(start + index * step, 12) for index in range(int(many + 5e-4) + 1)]


def distinct(values: list, place: Place) -> list:
    """The values, if each is there once, and not too many are."""
    if len(values) > _MOST_ON_AN_AXIS:
        raise place.wrong(
            "campaign.list_too_long", f"{len(values)} values", f"at most {_MOST_ON_AN_AXIS}", "leave some out"
        )
    if repeated := [shown(one) for one, count in Counter(values).items() if count > 1]:
        what = f"{', '.join(sorted(repeated)[:10])} given twice"
        raise place.wrong("campaign.value_repeated", what, "every value once", "remove the repetition")
    return values
