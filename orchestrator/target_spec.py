"""What a campaign asks to be stated, from the keys `precision` and `target` of its file."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from toppling.models.files.documents import is_number, shown
from toppling.models.motions.measures import LEVEL_MEASURES
from toppling.orchestrator.keys import Key, Place, number, path, read_keys, word

_FINEST, _COARSEST = 0.005, 0.5
_SHARES = ("median", "p05", "p95")
_KEYS = (
    Key("of", word(_SHARES), f"{', '.join(map(repr, _SHARES))}", "share that topples", None, "the median"),
    Key("measure", word(LEVEL_MEASURES), f"one of {', '.join(LEVEL_MEASURES)}", "of the intensity", None, "the best"),
    Key("at", number(lambda one: one > 0), "a positive intensity, with its measure", "whose probability is asked for",
        None, "the share"),
    Key("hazard", path, "the path of a file of one hazard curve", "whose failure rate is asked for", None, "the share"),
)  # fmt: skip
"""Keys of `target`."""


@dataclass(frozen=True)
class TargetSpec:
    """A number that a run is to state."""

    of: str = _SHARES[0]  # median, p05, p95: the intensity at which so many topple
    measure: str | None = None  # column of the results; None for whichever predicts best
    at: float | None = None  # intensity at which the probability is asked for instead
    hazard: Path | None = None  # file of the hazard curve under which the failure rate is asked for instead

    def content(self, hazard: str | None = None) -> dict[str, Any]:
        """The table of a campaign's file, with the hazard's path as given."""
        of = self.of if self.at is None and self.hazard is None else None
        table: dict[str, Any] = {"of": of, "measure": self.measure, "at": self.at}
        return {**table, "hazard": hazard or (str(self.hazard) if self.hazard else None)}


def read_precision(value: Any, place: Place) -> float:
    """Half of the interval of 95 % that is asked for.

    Raises InputError if it is no share.
    """
    if not is_number(value) or not _FINEST <= value <= _COARSEST:
        percent = is_number(value) and _FINEST <= value / 100.0 <= _COARSEST
        raise place.wrong(
            shown(value), remedy=f"did you mean {value / 100.0:g}, {value:g} %?" if percent else "5 % is 0.05"
        )
    return float(value)


def read_target(value: Any, place: Place) -> TargetSpec:
    """What is asked for, by a word or a table.

    Raises InputError if it is neither, or contradicts itself.
    """
    table = {"of": value} if isinstance(value, str) else value
    if not isinstance(table, dict) or not table:
        raise place.wrong(shown(value))
    read = read_keys(_KEYS, table, place.where, place.folder, joint=".")
    if read["at"] is not None and read["measure"] is None:
        raise place.wrong(f"at = {shown(table['at'])}", remedy="give the measure that it is of too")
    if sum(read[name] is not None for name in ("of", "at", "hazard")) > 1:
        raise place.wrong("more than one of 'of', 'at' and 'hazard'", remedy="ask one question a run")
    return TargetSpec(**read | {"of": read["of"] or _SHARES[0]})
