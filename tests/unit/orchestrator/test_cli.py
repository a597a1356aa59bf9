"""The table of verbs, which is listed without importing any of them."""

import errno
import re
import shlex
import subprocess
import sys
from importlib import import_module
from pkgutil import iter_modules

import click
import pytest
from click.testing import CliRunner

from toppling.orchestrator import cli as command
from toppling.orchestrator import verbs
from toppling.orchestrator.cli import VERBS, cli, first_line, main
from toppling.orchestrator.verbs import run as run_verb


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_is_there_and_begins_its_help_as_the_list_does(verb):
    command = cli.get_command(click.Context(cli), verb)
    assert command.name == verb
    assert command.help.splitlines()[0] == first_line(verb)
    assert f"toppling {verb}" in command.help or isinstance(command, click.Group), "an example is missing"


def test_the_list_of_verbs_imports_none():
    program = (
        "import sys; from toppling.orchestrator.cli import cli; cli(['--help'], standalone_mode=False); "
        "assert not [name for name in sys.modules if name.startswith('toppling.orchestrator.verbs.')]"
    )
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert all(line in " ".join(told.split()) for line in map(first_line, VERBS))


def test_verbs_are_imported_without_docstrings_and_then_have_no_words():
    program = "import sys; from toppling.orchestrator.cli import cli; cli(['check', '--help'], prog_name='toppling')"
    told = subprocess.run([sys.executable, "-OO", "-c", program], capture_output=True, text=True, check=True)
    assert "--neighbours" in told.stdout
    assert "weaker" not in told.stdout


def test_the_help_of_a_verb_imports_no_cluster():
    program = (
        "import sys; from toppling.orchestrator.cli import cli\n"
        "try: cli(['scan', '--help'], prog_name='toppling')\n"
        "finally: assert 'distributed' not in sys.modules"
    )
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert told.startswith("Usage: toppling scan")


@pytest.mark.parametrize(
    ("statuses", "told"),
    [("crashed,ok", "'ok' is none of"), ("diverged", "crashed, timeout, failed"), ("", "'' is none of")],
)
def test_only_what_something_transient_may_have_caused_is_done_again(statuses, told, tmp_path):
    done = CliRunner().invoke(cli, ["run", "c.toml", "--out", str(tmp_path / "run"), "--again", statuses])
    assert done.exit_code == 2
    assert told in done.output


def test_an_unknown_verb_is_wrong_usage():
    assert CliRunner().invoke(cli, ["shake"]).exit_code == 2


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (OSError("Corrupt data page"), "toppling: Corrupt data page"),
        (
            OSError(errno.ENOSPC, "full", "quakes/motions.parquet", None, "run/motions.parquet"),
            "disk of run/motions",
        ),
        (
            OSError(errno.EROFS, "Read-only file system", "/runs/a/.report.html.17.tmp"),
            "toppling: /runs/a/report.html: Read-only file system: write to another place with --out",
        ),
        (
            ValueError("A dask config file at '/etc/dask/x.yaml' is malformed"),
            "correct the file, or move it away",
        ),
    ],
)
def test_what_the_system_or_its_settings_lack_is_told_without_a_traceback(error, told, monkeypatch, capsys):
    def fails(**_: str) -> None:
        raise error

    monkeypatch.setattr(cli, "main", fails)
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 1
    assert told in capsys.readouterr().err


CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f]")
ESCAPES = "\x1b]0;owned\x07\x1b[31m\x9b2J\x1bc\x08\x00"


@pytest.mark.parametrize("verb", ["status", "fragility"])
def test_no_escape_sequence_of_a_name_reaches_the_terminal(verb, tmp_path):
    program = "import sys; from toppling.orchestrator.cli import main; main()"
    name = f"a{ESCAPES[:-1]}b"
    done = subprocess.run(
        [sys.executable, "-c", program, verb, name], cwd=tmp_path, capture_output=True, check=False
    )
    told = (done.stdout + done.stderr).decode()
    assert done.returncode != 0
    assert CONTROL.search(told) is None
    assert "ab" in told


SAYS = f"""
import click, logging
from pathlib import Path
from toppling.models.errors import InputError
from toppling.orchestrator import cli
from toppling.orchestrator.journal import journal

def fails(**_):
    with journal(Path()):
        logging.getLogger("toppling.orchestrator").warning({ESCAPES!r} + "warned")
    logging.getLogger("elsewhere").warning({ESCAPES!r} + "also")
    click.echo({ESCAPES!r} + "said")
    raise InputError({ESCAPES!r} + "wrong", where="here", expected="sense", remedy="none")

cli.cli.main = fails
cli.main()
"""


def test_no_escape_sequence_of_a_file_reaches_terminal_or_log(tmp_path):
    done = subprocess.run([sys.executable, "-c", SAYS], cwd=tmp_path, capture_output=True, check=False)
    assert done.stdout == b"said\n"
    assert done.stderr.splitlines()[:2] == [b"also", b"toppling: here: wrong"]
    log = (tmp_path / "run.log").read_text()
    assert "warned" in log
    assert CONTROL.search(log) is None


def test_the_command_to_go_on_with_is_read_as_the_one_that_was_given():
    command = run_verb.run
    words = ["campaign.toml", "--out", "runs/a b"]
    samples = {
        "INTEGER RANGE": "3",
        "FLOAT RANGE": "30.0",
        "FILE": "some file",
        "TEXT": "text",
        "choice": "slurm",
    }
    for option in command.params:
        if isinstance(option, click.Option) and option.name not in (*run_verb.OF_ONE_CALL, "folder"):
            kind = (
                option.type.name
                if isinstance(option.type, click.Choice)
                else option.make_metavar(click.Context(command))
            )
            value = next((samples[name] for name in samples if name.lower() in kind.lower()), "1")
            words += [option.opts[0]] if option.is_flag else [option.opts[0], value]
    given = command.make_context("run", list(words))
    told = shlex.split(run_verb.command_to_go_on(given))
    assert told[:2] == ["toppling", "run"]
    assert command.make_context("run", told[2:]).params == given.params
    assert given.params["no_estimate"] is True


@pytest.mark.parametrize("value", [True, False])
def test_a_flag_of_two_names_goes_on_by_the_one_that_was_given(value):
    option = click.Option(["--open/--no-open"])
    assert run_verb.as_given(option, value) == ["--open" if value else "--no-open"]


def test_an_option_that_is_given_often_goes_on_as_often():
    assert run_verb.as_given(click.Option(["--stood"], multiple=True), ("a", "b")) == [
        "--stood",
        "a",
        "--stood",
        "b",
    ]
    assert run_verb.as_given(click.Option(["--site"], nargs=2), (1.5, 2.0)) == ["--site", "1.5", "2.0"]


def test_the_help_lists_every_verb_in_one_group():
    modules = {name: import_module(f"{verbs.__name__}.{name}") for _, name, _ in iter_modules(verbs.__path__)}
    commands = [name for name, module in modules.items() if isinstance(vars(module).get(name), click.Command)]
    assert sorted(VERBS) == sorted(commands)


@pytest.mark.parametrize("given", ["0", "4..2", "2..", "..3", "many", "2...5", "-1"])
def test_workers_are_a_number_or_a_span(given):
    done = CliRunner().invoke(cli, ["run", "campaign.toml", "--out", "run", "--workers", given])
    assert done.exit_code == 2
    assert "--workers" in done.output


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        ImportError("/lib/_duckdb.so: failed to map segment from shared object"),
        ImportError("libarrow.so: cannot allocate memory in static TLS block"),
        OSError("Could not find/load shared object file 'libllvmlite.so'\nfrom resource location"),
    ],
    ids=["while it works", "DuckDB", "Arrow", "Numba"],
)
def test_what_does_not_fit_into_memory_is_one_line(error, monkeypatch, capsys):
    def refuse(**_):
        raise error

    monkeypatch.setattr(command.cli, "main", refuse)
    with pytest.raises(SystemExit) as end:
        command.call()
    told = capsys.readouterr().err
    assert end.value.code == 1
    assert told.startswith("toppling: too little memory is left: ")
    assert told.count("\n") == 1


def test_a_module_that_is_missing_is_no_lack_of_memory(monkeypatch):
    def refuse(**_):
        raise ModuleNotFoundError("No module named 'duckdb'")

    monkeypatch.setattr(command.cli, "main", refuse)
    with pytest.raises(ModuleNotFoundError):
        command.call()
