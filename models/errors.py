"""The one error that a user's data can cause, in one shape: what, where, what was expected, what to do."""


class InputError(ValueError):
    """Data that cannot be used as given.

    The command line turns it into exit code 1 and prints its message; it is raised before anything is written.

    Parameters
    ----------
    what : str
        What is wrong, with the offending value.
    where : str
        File, line, key or argument it was found at.
    expected : str
        What would have been accepted.
    remedy : str
        What the user can do about it.
    """

    def __init__(self, what: str, *, where: str, expected: str, remedy: str) -> None:
        self.what = what
        self.where = where
        self.expected = expected
        self.remedy = remedy
        super().__init__(f"{where}: {what}\n  expected: {expected}\n  remedy:   {remedy}")

    def __reduce__(self) -> tuple:
        return _rebuild, (self.what, self.where, self.expected, self.remedy)


def _rebuild(what: str, where: str, expected: str, remedy: str) -> InputError:
    return InputError(what, where=where, expected=expected, remedy=remedy)
