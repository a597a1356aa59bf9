"""Errors caused by a user's data, with code, problem, location, expectation and remedy."""

import math
from collections.abc import Callable
from functools import partial

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
