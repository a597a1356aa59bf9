"""Command line. Modules are imported only when their command is called, so that `toppling query` needs no Open3D."""

import errno
import importlib
import os
import re
import sys
from pathlib import Path
from typing import Any

import click

from toppling.models.errors import InputError, UsageError, nearest
from toppling.models.files.folder import FULL, FullDiskError, local, room_left
from toppling.models.files.stores import at_hand, is_store, upload_changes
from toppling.orchestrator.interrupt import as_program, signals_as_stop
from toppling.orchestrator.terminal import plain_streams


class Verbs(click.Group):
    """Command group that suggests corrections of misspelt commands."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command named by the first word."""
        word = args[0]
        if self.get_command(ctx, word) is None and not word.startswith("-"):
            meant = nearest(word, self.list_commands(ctx))
            verbs = f"Did you mean '{meant}'?" if meant else f"Verbs: {', '.join(self.list_commands(ctx))}."
            ctx.fail(f"No such verb '{word}'. {verbs}")
        return super().resolve_command(ctx, args)


class SuggestingChoice(click.Choice):
    """Choice that suggests corrections of misspelt values."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Read a value."""
        try:
            return super().convert(value, param, ctx)
        except click.BadParameter as error:
            meant = nearest(str(value), self.choices)
            if meant is None:
                raise
            raise click.BadParameter(f"{error.message} Did you mean '{meant}'?", ctx, param) from None


_GROUPS = {
    "Prepare": ("scan", "scene", "records", "init", "plan"),
    "Run": ("run", "watch", "status", "audit", "demo"),
    "Read": ("query", "fragility", "atlas", "constrain", "magnitudes", "check", "replay", "report"),
}
"""Commands in the order of the help, by group: each has the name of its module in orchestrator/verbs."""

VERBS = tuple(verb for verbs in _GROUPS.values() for verb in verbs)


_ADDRESS = re.compile("([a-z][a-z0-9+.-]+)://", re.IGNORECASE)
_UNMAPPED = re.compile(
    "failed to map segment|cannot allocate memory|[Cc]ould not .*load shared object", re.IGNORECASE
)
"""Messages of the loader, and of numba's, for a library that does not fit into memory."""
_TOO_LITTLE = "too little memory is left: give it more, end other programs, or lift the limit (ulimit -v)"
_OF_OTHERS = ("gateway", "http", "https", "tcp", "tls", "ucx", "ws", "wss")
"""Schemes of addresses that are not folders: web pages, Dask schedulers, and clusters of a Dask Gateway."""


class _LazyGroup(Verbs):
    """A group whose commands are imported when they are called, not when they are listed."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002  (click's signature)
        """Names of the commands in the order of the help."""
        return list(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Import the command's module."""
        if cmd_name not in VERBS:
            return None
        return getattr(importlib.import_module(f"toppling.orchestrator.verbs.{cmd_name}"), cmd_name)

    def invoke(self, ctx: click.Context) -> Any:
        """Call the command; errors and Ctrl-C are handled by this program instead of by click."""
        try:
            return super().invoke(ctx)
        except UsageError as error:
            raise click.UsageError(str(error)) from None
        except click.exceptions.Exit:  # also a RuntimeError; raised at the end of --help
            raise
        except RuntimeError as error:
            from toppling.orchestrator.context import RunError

            if isinstance(error, RunError):
                raise click.ClickException(str(error)) from None
            raise
        except KeyboardInterrupt:
            raise click.Abort from None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """List the commands with the first lines of their help."""
        for title, verbs in _GROUPS.items():
            with formatter.section(title):
                formatter.write_dl([(verb, first_line(verb)) for verb in verbs], col_max=12)


def first_line(verb: str) -> str:
    """First line of a command's help, read without importing its module."""
    text = (Path(__file__).parent / "verbs" / f"{verb}.py").read_text(encoding="utf-8")
    _, _, called = text.partition(f"\ndef {verb}(")
    found = re.search(r'"""(.*?)(?:"""|\n)', called)
    return found[1] if found else ""


@click.group(
    cls=_LazyGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110}
)
@click.version_option(package_name="toppling")
def cli() -> None:
    """Find out how strong a shaking topples this rock, and with what probability.

    \b
    toppling scan station1.laz station2.laz --out scenes/rock
    toppling records import records/ --out ensembles/quakes
    toppling run campaign.toml --out runs/first --workers 2
    toppling fragility runs/first
    """


def main() -> None:
    """Entry point of the command `toppling` for other programs."""
    as_program(call)


def call() -> None:
    """Run the command line; exit code 0 done, 1 failed, 2 wrong usage, 3 finished with failed jobs."""
    with plain_streams():
        _call()


def _call() -> None:
    try:
        sys.argv[1:] = [_at_hand(word) for word in sys.argv[1:]]
        with signals_as_stop():
            try:
                cli.main(prog_name="toppling", standalone_mode=False)
            finally:
                upload_changes()
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except (InputError, FileExistsError, FileNotFoundError) as error:
        message = str(error)
    except ValueError as error:  # raised when Dask is imported
        if not str(error).startswith("A dask config file"):
            raise
        message = f"{error}\n  remedy: correct the file, or move it away"
    except (OSError, MemoryError, ImportError) as error:
        if isinstance(error, MemoryError) or _UNMAPPED.search(str(error)):
            why = str(error).partition("\n")[0]
            message = f"{_TOO_LITTLE}{f' ({why})' if why else ''}"
        elif isinstance(error, OSError):
            message = _os_error_message(error)
        else:
            raise
    else:
        return
    click.echo(f"toppling: {message}", err=True)
    sys.exit(1)


_ELSEWHERE = {
    errno.EROFS: ": write to another place with --out",
    errno.EACCES: ": ask its owner for access, or name another place",
}


def _os_error_message(error: OSError) -> str:
    """Message for an error of a disk, of permissions or of a limit, with a remedy."""
    note = "; ".join(["", *getattr(error, "__notes__", [])])
    written = error.filename2 or error.filename  # a copy names its source first
    if error.errno in FULL:
        of = f" of {_asked_for(written)}" if written else ""
        left = error.left if isinstance(error, FullDiskError) else room_left(written) if written else ""
        full = f"the disk{of} is full" + (f", with {left}" if left else "")
        return f"{full}: make room{note or ', then give the same command again; what is stored stays'}"
    where = f"{_asked_for(written)}: " if written else ""
    elsewhere = _ELSEWHERE.get(error.errno or 0)  # the same command would be refused again
    return f"{where}{error.strerror or error}{elsewhere or note}"  # Arrow's errors have a message only


def _asked_for(path: Any) -> Path:
    """Requested path of a file that is written under a temporary, hidden name."""
    return Path(re.sub(r"(?<=/)\.([^/]+)\.\d+\.tmp(?=/|$)", r"\1", os.fspath(path)))


def _at_hand(word: str) -> str:
    """Word of the command line, in which an address of an object store is replaced by its local copy."""
    option, equals, value = word.partition("=") if word.startswith("--") else ("", "", word)
    if is_store(value):
        location = at_hand(value)
        # Other paths are printed as addresses.
        click.echo(f"{value}: a copy is in {location.parent}", err=True)
        return f"{option}{equals}{location}"
    if (kind := _ADDRESS.match(value)) and kind[1].lower() not in _OF_OTHERS:
        return f"{option}{equals}{local(value)}"  # also for output: a command may create folders before files
    return word
