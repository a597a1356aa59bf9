"""Pages that a command shows in a browser while it runs."""

import os
import sys
import webbrowser
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from toppling.orchestrator.interrupt import end_of_stop
from toppling.orchestrator.verbs.shared_options import option

if TYPE_CHECKING:
    from toppling.orchestrator.loopback import Loopback


def browsing_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add --port and --open to a command."""
    port = option("--port", type=click.IntRange(0, 65535), default=0, help="0 for any free port.")
    opens = option(
        "--open/--no-open", "opens", default=None, help="Open a browser. Default: if there is a screen."
    )
    return port(opens(command))


def served(server: "Loopback", name: str, opens: bool | None, ended: str) -> None:
    """Tell a page's address, open it where that is wanted, and answer until the user or the page ends it."""
    click.echo(f"{name}: {server.address}  (Ctrl-C ends)")
    screen = sys.platform == "darwin" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    if screen if opens is None else opens:
        webbrowser.open(server.address)
    try:
        server.serve_forever()
    except KeyboardInterrupt:
        end_of_stop()
        click.echo(ended, err=True)
