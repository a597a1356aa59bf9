"""`toppling watch`: a run in progress, in a browser."""

from pathlib import Path

import click

from toppling.orchestrator.verbs.browsing import browsing_options, served
from toppling.orchestrator.verbs.options import run_argument


@click.command()
@run_argument
@browsing_options
def watch(run: Path, port: int, opens: bool | None) -> None:
    """Show RUN in a browser while it runs: progress, failures and the map as it fills.

    The page also shows the rate, the time left and the latest topplings, which a click replays. It only
    reads the run, so it may be started and ended (Ctrl-C) at any time. It listens on this machine only, at an address
    that contains a secret. From another machine forward the port: ssh -L PORT:127.0.0.1:PORT HOST.

    \b
    toppling watch runs/first
    """
    from toppling.orchestrator.watch import new_place, watching

    with new_place() as folder, watching(run, Path(folder), port) as server:
        try:
            served(server, str(run), opens, "ended; a run in progress continues")
        finally:
            server.replays.end()
