"""The command line. A room is imported only when its verb is called, so that `toppling query` needs no Open3D."""

import importlib
import sys
from pathlib import Path

import click

from models.errors import InputError

VERBS = {
    "scan": "orchestrator.verbs.scan:scan",
    "scene": "orchestrator.verbs.scene:scene",
    "records": "orchestrator.verbs.records:records",
    "plan": "orchestrator.verbs.plan:plan",
    "run": "orchestrator.verbs.run:run",
    "status": "orchestrator.verbs.status:status",
    "query": "orchestrator.verbs.query:query",
    "fragility": "orchestrator.verbs.fragility:fragility",
    "constrain": "orchestrator.verbs.constrain:constrain",
    "check": "orchestrator.verbs.check:check",
    "pulse": "orchestrator.verbs.pulse:pulse",
    "replay": "orchestrator.verbs.replay:replay",
    "report": "orchestrator.verbs.report:report",
    "accuracy": "orchestrator.verbs.accuracy:accuracy",
    "demo": "orchestrator.verbs.demo:demo",
}


class LazyGroup(click.Group):
    """A group whose commands are imported when they are asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002  (click's signature)
        """Verbs in the order of a campaign."""
        return list(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Import the verb's module."""
        if cmd_name not in VERBS:
            return None
        module, _, name = VERBS[cmd_name].partition(":")
        return getattr(importlib.import_module(module), name)


@click.group(
    cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110}
)
@click.version_option(package_name="toppling")
def cli() -> None:
    """Say how strong a shaking topples this rock, and with what probability.

    \b
    toppling scan station1.laz station2.laz --out scenes/rock
    toppling records import records/ --out ensembles/quakes
    toppling run campaign.toml --out runs/first --workers 2
    toppling fragility runs/first
    """  # noqa: D301  (\b keeps click from rewrapping the example)


def main() -> None:
    """Entry point of the command `toppling`; exit 0 done, 1 failed, 2 wrong usage, 3 finished with failed jobs."""
    try:
        cli.main(prog_name="toppling", standalone_mode=False)
    except click.exceptions.Exit as stop:
        sys.exit(stop.exit_code)
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except click.Abort:
        click.echo("stopped", err=True)
        sys.exit(130)
    except (InputError, FileExistsError, FileNotFoundError) as error:
        click.echo(f"toppling: {error}", err=True)
        sys.exit(1)
    except OSError as error:
        where = f"{Path(error.filename)}: " if error.filename else ""
        click.echo(f"toppling: {where}{error.strerror}", err=True)
        sys.exit(1)
