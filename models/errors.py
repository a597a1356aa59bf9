"""The one error that a user's data can cause, in one shape: code, what, where, what was expected, what to do."""

import math
from collections.abc import Callable
from functools import partial

_LONGEST = 1500
"""Characters of what is wrong, and of where."""


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
        """What is wrong, with its code."""
        return f"{self.what} [{self.code}]"

    def __reduce__(self) -> tuple:
        # Those of files need their names alone.
        kind = UsageError if isinstance(self, UsageError) else InputError
        return partial(kind, where=self.where, expected=self.expected, remedy=self.remedy), (
            self.code,
            self.what,
        )


class UsageError(InputError):
    """What was asked does not go together or is no value of its kind; exit code 2 on the command line."""


def refusals(expected: str, remedy: str) -> Callable[[str, str, object], InputError]:
    """Errors of one kind of data, which differ in code, what is wrong and where (in this order)."""
    return lambda code, what, where: InputError(
        code, what, where=str(where), expected=expected, remedy=remedy
    )


def check_positive(where: str, expected: str, remedy: str, **values: float) -> None:
    """Refuse a value, named as its argument is, that is not a finite number above 0."""
    for name, value in values.items():
        if not 0.0 < value < math.inf:
            raise InputError(
                "value.not_positive", f"{name} is {value}", where=where, expected=expected, remedy=remedy
            )


def _shortened(text: str) -> str:
    """Text with its middle left out where a file's own words in it have no end."""
    half = _LONGEST // 2
    return text if len(text) <= _LONGEST else f"{text[:half]} ... {text[-half:]}"
