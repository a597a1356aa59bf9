"""`toppling watch`: a run in progress, in a browser."""

import os
import sys
import webbrowser
from pathlib import Path

import click

from toppling.orchestrator.verbs.options import run_argument


@click.command()
@run_argument
@click.option(
    "--port", type=click.IntRange(0, 65535), default=0, show_default=True, help="0 for any free port."
)
@click.option(
    "--open/--no-open", "opens", default=None, help="Open a browser. Default: if there is a screen."
)
def watch(run: Path, port: int, opens: bool | None) -> None:
    """Show RUN in a browser while it runs: progress, failures and the map as it fills.

    The page also shows the rate, the time left and the latest topplings, which a click replays. It only
    reads the run, so it may be started and ended (Ctrl-C) at any time. It listens on this machine only, at an address
    that contains a secret. From another machine forward the port: ssh -L PORT:127.0.0.1:PORT HOST.

    \b
    toppling watch runs/first
    """
    from toppling.orchestrator.interrupt import end_of_stop
    from toppling.orchestrator.watch import new_place, watching

    with new_place() as folder, watching(run, Path(folder), port) as server:
        click.echo(f"{run}: {server.address}  (Ctrl-C ends)")
        screen = sys.platform == "darwin" or bool(
            os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
        )
        if screen if opens is None else opens:
            webbrowser.open(server.address)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            end_of_stop()
            click.echo("ended; a run in progress continues", err=True)
        finally:
            server.replays.end()
