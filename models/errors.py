"""Errors caused by a user's data, with code, problem, place, expectation, remedy; suggestions for misspelt words."""

import importlib
import math
from collections.abc import Callable, Iterable
from difflib import get_close_matches
from functools import partial
from types import ModuleType

_LONGEST = 1500
"""Maximum number of characters of the problem, and of the location."""


class InputError(ValueError):
    """Data that cannot be used as given.

    The command line turns it into exit code 1 and prints its message; it is raised before anything is written.

    Parameters
    ----------
    code : str
        The kind of failing as ``topic.reason``; it stays when the sentences change. docs/errors.md lists all.
    what : str
        What is wrong, with the offending value.
    where : str
        File, line, key or argument it was found at.
    expected : str
        What would have been accepted.
    remedy : str
        What the user can do about it.
    """

    def __init__(self, code: str, what: str, *, where: str, expected: str, remedy: str) -> None:
        self.code = code
        self.what = _shortened(what)
        self.where = _shortened(where)
        self.expected = expected
        self.remedy = remedy
        super().__init__(f"{self.where}: {self.brief}\n  expected: {expected}\n  remedy:   {remedy}")

    @property
    def brief(self) -> str:
        """The problem with its code."""
        return f"{self.what} [{self.code}]"

    def __reduce__(self) -> tuple:
        # Subclasses cannot be reconstructed from these arguments.
        kind = UsageError if isinstance(self, UsageError) else InputError
        return partial(kind, where=self.where, expected=self.expected, remedy=self.remedy), (
            self.code,
            self.what,
        )


class UsageError(InputError):
    """Inconsistent or invalid options; exit code 2 on the command line."""


def refusals(expected: str, remedy: str) -> Callable[[str, str, object], InputError]:
    """Factory of errors with a common expectation and remedy, called with code, problem and location."""
    return lambda code, what, where: InputError(
        code, what, where=str(where), expected=expected, remedy=remedy
    )


def check_positive(where: str, expected: str, remedy: str, **values: float) -> None:
    """Raise InputError for a keyword argument that is not a finite number above 0."""
    for name, value in values.items():
        if not 0.0 < value < math.inf:
            raise InputError(
                "value.not_positive", f"{name} is {value}", where=where, expected=expected, remedy=remedy
            )


def _shortened(text: str) -> str:
    """Text without its middle part if it is too long, such as by quoting a file."""
    half = _LONGEST // 2
    return text if len(text) <= _LONGEST else f"{text[:half]} ... {text[-half:]}"


def counted(number: int, noun: str) -> str:
    """Format a number with a noun in singular or plural.

    Examples
    --------
    >>> counted(1, "record"), counted(12000, "record")
    ('1 record', '12,000 records')
    """
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def nearest(word: str, known: Iterable[str]) -> str | None:
    """Known word most similar to a word, ignoring case; None if none is similar.

    Examples
    --------
    >>> nearest("standart", ["fast", "standard", "reference"])
    'standard'
    >>> nearest("pga", ["scene", "pga_m_s2"])
    'pga_m_s2'
    """
    by_lower = {name.lower(): name for name in known}
    asked = word.lower()
    for name in by_lower:
        if asked and (name.startswith(asked) or asked.startswith(name)):
            return by_lower[name]
    found = get_close_matches(asked, by_lower, n=1, cutoff=0.6)
    return by_lower[found[0]] if found else None


def did_you_mean(word: object, known: Iterable[str], otherwise: str) -> str:
    """Suggest a correction of a misspelt word, or return `otherwise` if no known word is similar.

    Examples
    --------
    >>> did_you_mean("fsat", ["fast", "standard"], "take 'standard' if unsure")
    "did you mean 'fast'?"
    """
    found = nearest(word, known) if isinstance(word, str) else None
    return f"did you mean {found!r}?" if found else otherwise


def optional_module(name: str, where: str, install: str) -> ModuleType:
    """Import a module of an optional package; InputError if it is not installed.

    install: what `pip install` is to be given.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        raise InputError(
            "package.not_installed",
            f"{name.replace('_', '-')} is not installed",
            where=where,
            expected="this optional package",
            remedy=f"pip install {install}",
        ) from None
