"""Arguments and options common to several commands: files, clusters, hazard; and serving of pages to a browser."""

import ast
import dataclasses
import math
import os
import re
import sys
import tempfile
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import cache, reduce
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from toppling.models.errors import InputError
from toppling.models.files.table import is_numeral
from toppling.models.frames import azimuth_of, degrees_of
from toppling.orchestrator.cli import SuggestingChoice
from toppling.orchestrator.interrupt import end_of_stop
from toppling.results.hazard.places import SITE_REACH_KM
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


def of(function: str, *names: str, parameter: str = "", **given: Any) -> _Decorator:
    """Option for a parameter of a function or dataclass, with the default and description of that parameter.

    function: `module.name` in `orchestrator`; its module, which imports much, is read and not imported.
    names: names for click; the last is also that of the parameter unless `parameter` is given.
    """
    name = parameter or names[-1].strip("-").replace("-", "_")
    text, defaults = _declared(function)
    listed = text.partition("Parameters\n----------\n")[2].partition("\n\n")[0]
    entries = re.findall(r"^(\w[\w, ]*)(?: : .*)?\n((?: +.*\n?)+)", listed, re.MULTILINE)
    (words,) = (words for known, words in entries if name in known.split(", "))
    found: dict[str, Any] = {"help": " ".join(words.replace("`", "").split())}
    default = given["default"] if "default" in given else ast.literal_eval(defaults[name])
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


@cache
def _declared(function: str) -> tuple[str, dict[str, ast.expr]]:
    """Docstring of a function or dataclass, and the defaults of its parameters."""
    module, _, own = function.rpartition(".")
    path = Path(__file__).parents[1] / f"{module.replace('.', '/')}.py"
    kinds = ast.ClassDef | ast.FunctionDef
    (found,) = (
        node for node in ast.parse(path.read_bytes()).body if isinstance(node, kinds) and node.name == own
    )
    text = ast.get_docstring(found) or ""
    if isinstance(found, ast.ClassDef):
        fields = [node for node in found.body if isinstance(node, ast.AnnAssign)]
        return text, {ast.unparse(field.target): field.value for field in fields if field.value}
    given = found.args
    pairs = [*zip(given.args[::-1], given.defaults[::-1], strict=False)]
    pairs += [(name, value) for name, value in zip(given.kwonlyargs, given.kw_defaults, strict=True) if value]
    return text, {name.arg: value for name, value in pairs}


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
preset_option = option("--preset", type=SuggestingChoice(list(PRESETS)), default="standard")


def json_option(text: str = "Print JSON.") -> _Decorator:
    """Option `--json` with a help text."""
    return option("--json", "as_json", is_flag=True, help=text)


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
    from toppling.orchestrator.task import COMPILING, is_compiled, shake_a_block, warn_of_no_cache
    from toppling.orchestrator.terminal import bar
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


QUEUES = ("slurm", "pbs", "sge", "lsf", "htcondor", "oar", "moab")
_GATEWAY = "gateway://"


class _Span(int):
    """Maximum number of workers, with `low` as the initial number."""

    low: int

    def __str__(self) -> str:
        return f"{int(self)}" if self.low == self else f"{self.low}..{int(self)}"


class _SpanType(click.ParamType):
    """`N`, or `LOW..HIGH`."""

    name = "N or LOW..HIGH"

    def convert(self, value: Any, parameter: click.Parameter | None, context: click.Context | None) -> _Span:
        """Read a value of the command line."""
        if isinstance(value, _Span):
            return value
        low, dots, high = str(value).partition("..")
        if not low.isdecimal() or (dots and not high.isdecimal()):
            self.fail(f"{value!r} is neither a number nor LOW..HIGH, such as 2..8", parameter, context)
        span = _Span(high or low)
        span.low = int(low)
        if not 1 <= span.low <= span:
            self.fail(f"{value!r}: at least 1, and the first not above the second", parameter, context)
        return span


_OPTIONS = (
    option(
        "--workers",
        type=_SpanType(),
        help="Local workers; LOW..HIGH starts more as long as there is work for them. Default: one per core.",
    ),
    option(
        "--scheduler",
        help="Address of an existing scheduler, its file (of 'dask scheduler --scheduler-file'), or gateway://NAME of "
        "a cluster of Dask Gateway. Default: DASK_SCHEDULER_ADDRESS, if set.",
    ),
    option(
        "--queue",
        "queue_kind",
        type=SuggestingChoice(list(QUEUES)),
        help="Batch system to request workers from.",
    ),
    option("--queue-jobs", type=_SpanType(), default="1", help="Batch jobs to submit; LOW..HIGH too."),
    option("--queue-name", "of_job_queue", help="Queue, or partition, of the batch system."),
    option("--queue-account", "of_job_account", help="Account that batch jobs are charged to."),
    option("--queue-walltime", "of_job_walltime", help="Time limit of a batch job, such as 02:00:00."),
    option("--queue-memory", "of_job_memory", help="Memory of a batch job, such as 8GB."),
)


def cluster_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options that :func:`cluster_of` takes."""
    return reduce(lambda function, option: option(function), reversed(_OPTIONS), command)


def of_batch_job(where: dict[str, Any]) -> dict[str, str | None]:
    """Options of a batch job under dask-jobqueue's names."""
    return {name: where[f"of_job_{name}"] for name in ("queue", "account", "walltime", "memory")}


def _selections(where: dict[str, Any]) -> list[str]:
    """Given options that select a cluster."""
    names = {"workers": "--workers", "queue_kind": "--queue", "scheduler": "--scheduler"}
    return [option for name, option in names.items() if where[name]]


def local_workers(where: dict[str, Any]) -> int:
    """Initial number of local workers; 0 where jobs run elsewhere."""
    selected = _selections(where)
    if selected == ["--workers"]:
        return where["workers"].low
    return 0 if selected or os.environ.get("DASK_SCHEDULER_ADDRESS") else os.cpu_count() or 1


def cluster_of(folder: Path, **where: Any) -> AbstractContextManager:
    """Cluster selected by options, started when it is entered; UsageError if options exclude each other."""
    from toppling.orchestrator.cluster import existing, gateway, local, queue

    workers, queue_kind, scheduler = where["workers"], where["queue_kind"], where["scheduler"]
    if len(selected := _selections(where)) > 1:
        raise click.UsageError(f"{' and '.join(selected)} exclude each other")
    begin = local_workers(where)
    if queue_kind:
        jobs = where["queue_jobs"]
        return queue(queue_kind, jobs.low, folder.absolute(), jobs, of_batch_job(where))
    if scheduler and scheduler.startswith(_GATEWAY):
        return gateway(scheduler.removeprefix(_GATEWAY))
    return local(begin, most=workers) if begin else existing(scheduler)


SITE_HELP = (
    f"Degrees, or a site's name: takes the nearest site of the hazard, within {SITE_REACH_KM:g} km; "
    "repeatable for a set of events, one for each rock."
)


class _Degrees(click.ParamType):
    """Degrees east or north, or with a compass letter."""

    name = "degrees"

    def __init__(self, axis: str) -> None:
        self.axis = axis

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Read a value."""
        degrees = degrees_of(str(value), self.axis)
        if degrees is None:
            self.fail(f"{value!r} is no {self.axis}, such as -118.1 or 118.1W.", param, ctx)
        return degrees


SITE = (_Degrees("longitude"), _Degrees("latitude"))
"""Type of a location, its longitude and latitude."""


class SiteCommand(click.Command):
    """Command whose --site accepts a location, or a name."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Give a name to the hidden option --site-name."""
        words = list(args)
        for place, (word, after) in enumerate(pairwise(args)):
            if word == "--site" and degrees_of(after, "longitude") is None:
                words[place] = "--site-name"
        return super().parse_args(ctx, words)


def _years_of(_context: click.Context, _parameter: click.Parameter, values: str | None) -> float | None:
    """Years of --values, 0 for rates, None if not given; UsageError if neither 'rate' nor a positive number."""
    if values is None:
        return None
    if values.lower() in ("rate", "rates"):
        return 0.0
    years = float(values) if is_numeral(values) else math.nan
    if not 0 < years < math.inf:
        raise click.UsageError(
            f"--values is {values!r}: give 'rate', or the years that probabilities are over"
        )
    return years


values_option = option(
    "--values", "years", metavar="rate|YEARS", callback=_years_of,
    help="What the hazard's values are, where its files do not say: annual rates (rate), or probabilities over so many "
    "years.",
)  # fmt: skip
