"""Progress display: a bar on a terminal; in a log one line after ten seconds, and one per minute."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from toppling.orchestrator.terminal import plain_text, terminal_of

if TYPE_CHECKING:
    from toppling.orchestrator.context import ProgressCallback, RunProgress

_FIRST_LINE_S, _LINE_EVERY_S = 10.0, 60.0
"""Time before the first line in a log, and interval between lines, s."""

_Item = TypeVar("_Item")


@dataclass
class Advance:
    """Counter of the finished parts of a piece of work, called after each part."""

    total: float | None
    done: float = 0.0
    doing: str = ""
    began: float = field(default_factory=time.monotonic)
    show: Callable[[Advance], object] = lambda _: None

    def __call__(self, parts: float = 1, doing: str = "", *, total: float | None = None) -> None:
        """Add finished parts, and set the name of the next one."""
        self.done += parts
        self.doing = doing or self.doing
        self.total = self.total if total is None else total
        self.show(self)

    def line(self, what: str) -> str:
        """Progress in one line."""
        counted = f"{self.done:g}" if self.done else ""  # indivisible work has no count
        of = counted if self.total is None else f"{self.done:g} of {self.total:g}"
        elapsed_s = time.monotonic() - self.began
        parts = [f"{what}: {of}" if of else what, *([self.doing] if self.doing else []), duration(elapsed_s)]
        if self.total and 0 < self.done < self.total:
            parts.append(f"{duration(elapsed_s * (self.total / self.done - 1.0))} left")
        return "  ".join(parts)


@contextmanager
def bar(
    what: str,
    total: float | None = None,
    *,
    first_line_s: float = _FIRST_LINE_S,
    line_every_s: float = _LINE_EVERY_S,
) -> Iterator[Advance]:
    """Show progress on stderr, as a bar on a terminal or as lines in a log.

    what: label before the numbers.
    total: number of parts of the work; None if unknown.
    first_line_s: time before the first line in a log, s; shorter work logs nothing.
    """
    console = Console(file=terminal_of(sys.stderr))
    advance = Advance(total)
    ended = threading.Event()
    if console.is_terminal:
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        with Progress(*columns, console=console, transient=True) as shown:
            task = shown.add_task(what, total=total)
            advance.show = lambda state: shown.update(
                task,
                completed=state.done,
                total=state.total,
                description=plain_text(f"{what} {state.doing}".rstrip()),
            )
            yield advance
        return

    def speak() -> None:
        wait_s = first_line_s
        while not ended.wait(wait_s):
            wait_s = line_every_s
            console.print(plain_text(advance.line(what)), soft_wrap=True, markup=False, highlight=False)

    speaker = threading.Thread(target=speak, name="progress", daemon=True)
    speaker.start()
    try:
        yield advance
    finally:
        ended.set()
        speaker.join()


def each(items: Iterable[_Item], what: str, total: float | None = None) -> Iterator[_Item]:
    """Iterate over items and show the progress."""
    with bar(what, total) as advance:
        for item in items:
            yield item
            advance()


@contextmanager
def watcher() -> Iterator[ProgressCallback]:
    """Show the progress of a run on stderr, as a bar on a terminal or as lines in a log."""
    console = Console(file=terminal_of(sys.stderr))
    if not console.is_terminal:
        yield _lines(console)
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TextColumn("{task.fields[pace]}"), console=console) as shown:
        task = shown.add_task("shaking", total=None, pace="starting workers")

        def watch(run: RunProgress) -> None:
            pace = pace_and_counts(run)
            shown.update(
                task, total=run.total, completed=run.before + run.done, description=run.what, pace=pace
            )

        yield watch


def _lines(console: Console) -> ProgressCallback:
    last, ended, shown, what = time.monotonic(), "", False, ""

    def watch(progress: RunProgress) -> None:
        nonlocal last, ended, shown, what
        complete = progress.before + progress.done == progress.total and progress.what != ended
        begins = progress.what not in ("shaking", what)
        # The first line waits until the remaining time can be estimated.
        wait_s = _LINE_EVERY_S if shown or not progress.done else _FIRST_LINE_S
        if begins or complete or time.monotonic() - last >= wait_s:
            last, shown = time.monotonic(), True
            ended, what = progress.what if complete else ended, progress.what
            named = "" if what == "shaking" else f"{what}: "
            done = f"{progress.before + progress.done}/{progress.total} jobs"
            console.print(f"{named}{done}  {pace_and_counts(progress)}".rstrip(), soft_wrap=True)

    return watch


def pace_and_counts(progress: RunProgress) -> str:
    """Rate, time left, toppled and failed jobs of a session in one line; empty before its first job."""
    if not progress.done:
        return ""
    since = f"of {progress.done} now " if progress.before else ""
    parts = [pace(progress.rate), f"{since}{progress.toppled} toppled", f"{progress.failed} failed"]
    if progress.left_s is not None and progress.before + progress.done < progress.total:
        parts.insert(1, f"{duration(progress.left_s)} left")
    return "  ".join(parts)


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
