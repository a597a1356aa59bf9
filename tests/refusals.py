"""What a test asserts of an error that a user's data cause: its code and the values that it names; and damage."""

from contextlib import contextmanager

import pytest

from toppling.models.errors import InputError


@contextmanager
def refused(code, *named, kind=InputError):
    """Expect an error of this code that names each of some values, wherever in its message they stand."""
    with pytest.raises(kind) as caught:
        yield caught
    states(str(caught.value), code, *named)
    assert caught.value.code == code


def states(output, code, *named):
    assert f"[{code}]" in output, output
    for name in named:
        assert str(name) in output, (name, output)


def left_out(outcome, code, *named):
    """Assert that an import left something out, all of it for this reason, naming each of some values."""
    assert outcome.refusals
    for refusal in outcome.refusals:
        states(str(refusal.reason), code, *named)


def flip(path, at=None):
    """Flip one bit of a file, in its middle unless told at which byte."""
    content = bytearray(path.read_bytes())
    content[len(content) // 2 if at is None else at] ^= 1
    path.write_bytes(content)
