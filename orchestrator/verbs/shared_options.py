"""Arguments and options common to several commands, and serving of pages to a browser."""

import dataclasses
import inspect
import os
import re
import sys
import tempfile
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from toppling.models.bearings import azimuth_of
from toppling.models.errors import InputError
from toppling.orchestrator.interrupt import end_of_stop
from toppling.orchestrator.misspelt import OneOf
from toppling.workers.options import PRESETS

if TYPE_CHECKING:
    from toppling.orchestrator.loopback import Loopback

PATH = click.Path(path_type=Path)
FILE = click.Path(path_type=Path, dir_okay=False)
FOLDER = click.Path(path_type=Path, file_okay=False)
ABOVE_0 = click.FloatRange(0, min_open=True)
EXISTING_FILE = click.Path(path_type=Path, dir_okay=False, exists=True)
EXISTING_FOLDER = click.Path(path_type=Path, file_okay=False, exists=True)


class _Azimuth(click.ParamType):
    """Azimuth in degrees counter-clockwise from east, or a compass bearing."""

    name = "azimuth"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Read a value."""
        try:
            return azimuth_of(str(value))
        except InputError as error:
            self.fail(f"{error.brief}; expected: {error.expected}.", param, ctx)


AZIMUTH = _Azimuth()

_Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]
_Noun = TypeVar("_Noun")


def option(*names: str, **given: Any) -> _Decorator:
    """Option of a command whose help shows its default."""
    return click.option(*names, **{"show_default": True, **given})


def of(function: Callable[..., Any], *names: str, parameter: str = "", **given: Any) -> _Decorator:
    """Option for a parameter of a function or dataclass, with the default and description of that parameter.

    names: names for click; the last is also that of the parameter unless `parameter` is given.
    """
    name = parameter or names[-1].strip("-").replace("-", "_")
    found: dict[str, Any] = {"help": _words_of(function, name)}
    default = inspect.signature(function).parameters[name].default
    if isinstance(default, bool):
        found["is_flag"] = True
    elif default == ():
        found["multiple"] = True
    elif default is not None:
        found["default"] = default
    return option(*names, **found | given)


def noun_of(noun: Callable[..., _Noun], asked: dict[str, Any], **more: Any) -> _Noun:
    """Instance of a dataclass from the options named as its fields, which are removed, and from further values."""
    names = [field.name for field in dataclasses.fields(noun) if field.name in asked]  # type: ignore[arg-type]
    return noun(**{name: asked.pop(name) for name in names}, **more)


def _words_of(function: Callable[..., Any], parameter: str) -> str | None:
    """Description of a parameter in a docstring; None without docstrings (Python's -OO)."""
    text = inspect.getdoc(function)
    if text is None or sys.flags.optimize > 1:  # a dataclass then has its signature as docstring
        return None
    listed = text.partition("Parameters\n----------\n")[2].partition("\n\n")[0]
    entries = re.findall(r"^(\w[\w, ]*)(?: : .*)?\n((?: +.*\n?)+)", listed, re.MULTILINE)
    (words,) = (words for names, words in entries if parameter in names.split(", "))
    return " ".join(words.replace("`", "").split())


run_argument = click.argument("run", type=PATH)
scene_argument = click.argument("scene", type=PATH)
ensemble_argument = click.argument("ensemble", type=PATH)

ensemble_out = option("--out", required=True, type=FOLDER, help="Folder of the ensemble.")
replace_option = option("--replace", is_flag=True, help="Replace an existing ensemble.")
trusted_option = option("--trusted", is_flag=True, help="Let --where read your files.")
corner_option = option("--corner", "corner_hz", type=ABOVE_0, help="High-pass corner in Hz.")
take_over_option = option(
    "--take-over", is_flag=True,
    help="Go on with a run in an object store although another process, which was killed, still holds it.",
)  # fmt: skip
preset_option = option("--preset", type=OneOf(list(PRESETS)), default="standard")


def json_option(text: str = "Print JSON.") -> _Decorator:
    """Option `--json` with a help text."""
    return option("--json", "as_json", is_flag=True, help=text)


def workers_option(text: str = "Local workers.") -> _Decorator:
    """Option `--workers` with a help text."""
    return option("--workers", type=click.IntRange(min=1), help=f"{text} Default: one per core.")


def samples_option(default: int) -> _Decorator:
    """Option `--samples`; the default is a parameter to avoid a slow import."""
    return option("--samples", type=click.IntRange(1), default=default, help="Bootstrap samples of records.")


def browsing_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add --port and --open to a command."""
    port = option("--port", type=click.IntRange(0, 65535), default=0, help="0 for any free port.")
    opens = option(
        "--open/--no-open", "opens", default=None, help="Open a browser. Default: if there is a screen."
    )
    return port(opens(command))


def served(server: "Loopback", name: str, opens: bool | None, ended: str) -> None:
    """Print a page's address, optionally open it, and serve it until the user or the page ends it."""
    click.echo(f"{name}: {server.address}  (Ctrl-C ends)")
    screen = sys.platform == "darwin" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    with _leading_to(server.address) as page:
        if screen if opens is None else opens:
            webbrowser.open(page)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            end_of_stop()
            click.echo(ended, err=True)


def compile_first() -> None:
    """Compile in another process, whose memory is then free; in this one where compiled code cannot be cached."""
    from toppling.orchestrator.compiling import COMPILING, is_compiled, shake_a_block, warn_of_no_cache
    from toppling.orchestrator.progress import bar
    from toppling.workers.compile_once import compile_apart

    warn_of_no_cache()
    with bar(COMPILING):
        compile_apart()
        if not is_compiled():
            shake_a_block()


@contextmanager
def _leading_to(address: str) -> Iterator[str]:
    """Address of a private file that redirects to a page: a browser's command line is visible to other accounts."""
    with tempfile.TemporaryDirectory(prefix="toppling-") as folder:
        page = Path(folder) / "page.html"
        page.touch(mode=0o600)
        page.write_text(f'<meta http-equiv="refresh" content="0; url={address}">\n', encoding="utf-8")
        yield page.as_uri()
