"""What a campaign asks to be stated, from the keys `precision` and `target` of its file."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from toppling.models.errors import InputError
from toppling.models.files.documents import is_number, shown
from toppling.models.motions.measures import LEVEL_MEASURES
from toppling.models.spelling import did_you_mean

_FINEST, _COARSEST = 0.005, 0.5
_SHARES = ("median", "p05", "p95")
_KEYS = ("of", "measure", "at", "hazard")
_EXPECTED = (
    f"{', '.join(map(repr, _SHARES))}, or a table with keys of {', '.join(_KEYS)}: "
    '{ of = "p05", measure = "pgv_m_s" }, { measure = "pgv_m_s", at = 1.2 } (a probability) or '
    '{ hazard = "curve.csv" } (a failure rate)'
)


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


def read_precision(value: Any, where: str) -> float:
    """Half of the interval of 95 % that is asked for.

    Raises InputError if it is no share.
    """
    if not is_number(value) or not _FINEST <= value <= _COARSEST:
        remedy = "5 % is 0.05"
        if is_number(value) and _FINEST <= value / 100.0 <= _COARSEST:
            remedy = f"did you mean {value / 100.0:g}, {value:g} %?"
        raise InputError(
            shown(value), where=where, expected=f"a share from {_FINEST:g} to {_COARSEST:g}", remedy=remedy
        )
    return float(value)


def read_target(value: Any, folder: Path, where: str) -> TargetSpec:
    """What is asked for, by a word or a table.

    Raises InputError if it is neither, or contradicts itself.
    """
    table: Mapping[str, Any] = {"of": value} if isinstance(value, str) else value
    if not isinstance(table, dict) or not table or not set(table) <= set(_KEYS):
        raise _wrong(shown(value), where)
    of, measure, at, hazard = (table.get(key) for key in _KEYS)
    if of is not None and of not in _SHARES:
        raise _wrong(shown(of), where, did_you_mean(str(of), _SHARES, "take 'median' if unsure"))
    if measure is not None and measure not in LEVEL_MEASURES:
        remedy = did_you_mean(str(measure), LEVEL_MEASURES, f"one of {', '.join(LEVEL_MEASURES)}")
        raise _wrong(f"the measure {shown(measure)}", where, remedy)
    if at is not None and (not is_number(at) or at <= 0 or measure is None):
        raise _wrong(f"at = {shown(at)}", where, "give a positive intensity, and the measure that it is of")
    if hazard is not None and not (isinstance(hazard, str) and hazard):
        raise _wrong(f"hazard = {shown(hazard)}", where, "give the path of a file of one hazard curve")
    if sum(one is not None for one in (of, at, hazard)) > 1:
        raise _wrong("more than one of 'of', 'at' and 'hazard'", where, "ask one question a run")
    return TargetSpec(
        of or _SHARES[0], measure, None if at is None else float(at), folder / hazard if hazard else None
    )


def _wrong(what: str, where: str, remedy: str = "correct it, or leave it out for the median") -> InputError:
    return InputError(what, where=where, expected=_EXPECTED, remedy=remedy)
