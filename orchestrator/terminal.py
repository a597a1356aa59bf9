"""Terminal output: plain text of what files and names hold, and progress.

Escape sequences and control characters, which are removed, could move the cursor, hide lines, change the window's
title, or make the terminal send input. Progress is a bar; in a log one line after ten seconds, and one per minute.
"""

from __future__ import annotations

import io
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TextIO

from toppling.models.files.stores import by_address

if TYPE_CHECKING:
    from toppling.orchestrator.context import ProgressCallback, RunProgress

_CONTROL = re.compile(
    r"\x1b\[[0-?]*[ -/]*[@-~]|\x9b[0-?]*[ -/]*[@-~]"  # control sequences: colours, cursor positions
    r"|(?:\x1b[]PX^_]|[\x90\x98\x9d-\x9f])[^\x07\x1b\x9c\n]*(?:\x07|\x1b\\|\x9c)"  # a string, such as a title
    r"|\x1b[ -/]*[0-~]"
    r"|\r(?!\n)|[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]"
)
"""Pattern of ECMA-48 escape sequences, control strings, and single control characters."""


def plain_text(text: str) -> str:
    """Remove escape sequences, and control characters other than tabs and line ends.

    Examples
    --------
    >>> plain_text("\\x1b]0;title\\x07a \\x1b[31mred\\x1b[0m\\tname\\x9b2J\\x08\\n")
    'a red\\tname\\n'
    """
    return _CONTROL.sub("", text)


_HELD: list[TextIO] = []
"""Wrapped streams, kept alive for log handlers: a collected wrapper would close the terminal's stream."""


class _Plain(io.TextIOWrapper):
    """Stream of plain text with addresses of stores; progress bars, which move the cursor, use its `terminal`."""

    terminal: TextIO

    def write(self, text: str) -> int:
        super().write(by_address(plain_text(text)))
        return len(text)


@contextmanager
def plain_streams() -> Iterator[None]:
    """Filter all output, logs and warnings within the block."""
    before = {name: getattr(sys, name) for name in ("stdout", "stderr")}
    for name, stream in before.items():
        if isinstance(stream, io.TextIOWrapper):
            plain = _Plain(
                stream.buffer, stream.encoding, stream.errors, line_buffering=stream.line_buffering
            )
            plain.terminal = stream
            setattr(sys, name, plain)
            _HELD.append(plain)
    try:
        yield
    finally:
        after = [getattr(sys, name) for name in before]
        for name, stream in before.items():
            setattr(sys, name, stream)
        for plain in after:
            plain.flush()


def _terminal_of(stream: Any) -> Any:
    """Underlying terminal of a filtered stream; any other stream unchanged."""
    return getattr(stream, "terminal", stream)


_FIRST_LINE_S = 10.0
"""Time before the first line in a log, s."""
_LINE_EVERY_S = 60.0
"""Interval between lines, s."""


@dataclass
class Advance:
    """Counter of the finished parts of a piece of work, called after each part."""

    what: str
    total: float | None
    done: float = 0.0
    before: float = 0.0  # of the finished parts those of an earlier session
    doing: str = ""
    began: float = field(default_factory=time.monotonic)
    show: Callable[[Advance], object] = lambda _: None

    def __call__(self, parts: float = 1, doing: str = "", *, total: float | None = None) -> None:
        """Add finished parts, and set the name of the next one."""
        self.done += parts
        self.doing = doing or self.doing
        self.total = self.total if total is None else total
        self.show(self)

    @property
    def left(self) -> str:
        """Time left at the mean pace; empty where it is not known."""
        new = self.done - self.before
        if not self.total or new <= 0 or self.done >= self.total:
            return ""
        return f"{duration((time.monotonic() - self.began) * (self.total - self.done) / new)} left"

    @property
    def line(self) -> str:
        """Progress in one line."""
        counted = f"{int(self.done):,}"  # parts of parts are not done
        of = f"{counted} of {int(self.total):,}" if self.total is not None else counted if self.done else ""
        shown = [
            f"{self.what}: {of}" if of else self.what,
            self.doing,
            duration(time.monotonic() - self.began),
            self.left,
        ]
        return "  ".join(filter(None, shown))


@contextmanager
def bar(
    what: str,
    total: float | None = None,
    *,
    first_line_s: float = _FIRST_LINE_S,
    line_every_s: float = _LINE_EVERY_S,
) -> Iterator[Advance]:
    """Show progress on stderr, as a bar on a terminal or as lines in a log, one more for each new activity.

    what: label before the numbers.
    total: number of parts of the work; None if unknown.
    first_line_s: time before the first line in a log, s; shorter work logs nothing.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    console = Console(file=_terminal_of(sys.stderr))
    advance = Advance(what, total)
    if console.is_terminal:
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[left]}"),
        )
        with Progress(*columns, console=console, transient=True) as shown:
            task = shown.add_task(what, total=total, left="")
            advance.show = lambda state: shown.update(
                task,
                completed=state.done,
                total=state.total,
                description=plain_text(f"{state.what} {state.doing}".rstrip()),
                left=state.left,
            )
            yield advance
        return
    ended, named = threading.Event(), [what]

    def print_line() -> None:
        console.print(plain_text(advance.line), soft_wrap=True, markup=False, highlight=False)

    def print_lines() -> None:
        wait_s = first_line_s
        while not ended.wait(wait_s):
            wait_s = line_every_s
            print_line()

    def show(state: Advance) -> None:
        if state.what != named[-1]:
            named.append(state.what)
            print_line()

    advance.show = show
    printer = threading.Thread(target=print_lines, name="progress", daemon=True)
    printer.start()
    try:
        yield advance
    finally:
        ended.set()
        printer.join()


@contextmanager
def watcher() -> Iterator[ProgressCallback]:
    """Show the progress of a run on stderr, as a bar on a terminal or as lines in a log."""
    with bar("shaking") as advance:

        def watch(run: RunProgress) -> None:
            advance.what, advance.total, advance.doing = run.what, run.total, pace_and_counts(run)
            advance.done, advance.before, advance.began = run.before + run.done, run.before, run.began
            advance.show(advance)

        yield watch


def pace_and_counts(progress: RunProgress) -> str:
    """Rate, toppled and failed jobs of a session in one line; empty before its first job."""
    if not progress.done:
        return ""
    since = f"of {progress.done} now " if progress.before else ""
    return f"{pace(progress.rate)}  {since}{progress.toppled} toppled  {progress.failed} failed"


def pace(rate_per_s: float) -> str:
    """Format a rate of jobs per second, or per minute or hour if it is low.

    Examples
    --------
    >>> pace(12.34), pace(0.24)
    ('12.3/s', '14.4/min')
    """
    for rate, unit in ((rate_per_s, "s"), (60.0 * rate_per_s, "min")):
        if rate >= 1.0:
            return f"{rate:.{1 if rate < 1000.0 else 0}f}/{unit}"
    return f"{3600.0 * rate_per_s:.1f}/h"


def duration(seconds: float) -> str:
    """Format a duration in seconds, minutes or hours.

    Examples
    --------
    >>> duration(75), duration(3700)
    ('1 min 15 s', '1 h 01 min')
    """
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
