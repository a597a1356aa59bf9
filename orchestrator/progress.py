"""How far a run is: a bar on a terminal, one line a minute in a log."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from toppling.orchestrator.run import Tally, Watcher

LINE_EVERY_S = 60.0


@contextmanager
def watcher() -> Iterator[Watcher]:
    """Show a run on stderr, in the way that fits where stderr leads."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield _lines(console)
        return
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[told]}"),
        console=console,
    ) as bar:
        shown = bar.add_task("shaking", total=None, told="starting workers")

        def watch(tally: Tally) -> None:
            done = tally.before + tally.done
            bar.update(shown, description=tally.what, total=tally.total, completed=done, told=told(tally))

        yield watch


def _lines(console: Console) -> Watcher:
    last = time.monotonic()

    def watch(tally: Tally) -> None:
        nonlocal last
        complete = tally.before + tally.done == tally.total
        if complete or time.monotonic() - last >= LINE_EVERY_S:
            last = time.monotonic()
            what = "" if tally.what == "shaking" else f"{tally.what}: "
            done = f"{tally.before + tally.done}/{tally.total} jobs"
            console.print(f"{what}{done}  {told(tally)}", soft_wrap=True)

    return watch


def told(tally: Tally) -> str:
    """Rate, time left, toppled and failed jobs of a session in one line."""
    parts = [f"{tally.rate:.1f}/s", f"{tally.toppled} toppled", f"{tally.failed} failed"]
    if tally.left_s is not None and tally.before + tally.done < tally.total:
        parts.insert(1, f"{duration(tally.left_s)} left")
    return "  ".join(parts)


def duration(seconds: float) -> str:
    """Seconds as a person reads them."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
