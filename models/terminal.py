"""Descriptor of standard error, to which C code writes past Python's `sys.stderr`."""

import os
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def standard_error_to(descriptor: int) -> Iterator[bool]:
    """Send what is written to standard error to another file; yields False where nobody opened standard error."""
    try:
        terminal = os.dup(2)
    except OSError:
        yield False
        return
    os.dup2(descriptor, 2)
    try:
        yield True
    finally:
        os.dup2(terminal, 2)
        os.close(terminal)
