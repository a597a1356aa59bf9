"""The table of verbs, listed without importing any of them, and what is said of a misspelt word or a failure."""

import errno
import re
import subprocess
import sys
from importlib import import_module
from pkgutil import iter_modules

import click
import pytest
from click.testing import CliRunner

from toppling.orchestrator import cli as command
from toppling.orchestrator import verbs
from toppling.orchestrator.cli import VERBS, cli, first_line


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_is_there_and_begins_its_help_as_the_list_does(verb):
    command = cli.get_command(click.Context(cli), verb)
    assert command.name == verb
    assert command.help.splitlines()[0] == first_line(verb)
    assert f"toppling {verb}" in command.help or isinstance(command, click.Group), "an example is missing"


LISTS = """
import sys; from toppling.orchestrator.cli import cli
cli(["--help"], standalone_mode=False)
assert not [name for name in sys.modules if name.startswith("toppling.orchestrator.verbs.")]
"""


def test_the_list_of_verbs_imports_none():
    done = subprocess.run([sys.executable, "-c", LISTS], capture_output=True, text=True, check=True).stdout
    assert all(line in " ".join(done.split()) for line in map(first_line, VERBS))


RUN = ["run", "c.toml", "--out", "run"]


@pytest.mark.parametrize(
    "words",
    [
        ["shake"],
        *([*RUN, "--again", statuses] for statuses in ("crashed,ok", "diverged", "")),
        *([*RUN, "--workers", given] for given in ("0", "4..2", "2..", "..3", "many", "2...5", "-1")),
    ],
)
def test_wrong_usage_ends_with_code_2_and_names_the_option(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(cli, words)
    assert done.exit_code == 2
    assert words[-2 if len(words) > 1 else 0] in done.output
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("error", "want"),
    [
        (OSError("Corrupt data page"), "toppling: Corrupt data page"),
        *((error, "toppling: too little memory is left: ") for error in (
            MemoryError(), ImportError("/lib/_duckdb.so: failed to map segment from shared object"),
        )),
        (OSError(errno.ENOSPC, "full", "quakes/a.parquet", None, "run/a.parquet"), "disk of run/a"),
        (OSError(errno.EFBIG, "too large", "syn/a.parquet", None, "run/a.parquet"), ": run/a.parquet: too large"),
        (
            OSError(errno.EROFS, "Read-only file system", "/runs/a/.report.html.17.tmp"),
            "toppling: /runs/a/report.html: Read-only file system: write to another place with --out",
        ),
        (
            OSError(errno.EACCES, "Permission denied", "/runs/a/.lock"),
            "toppling: /runs/a/.lock: Permission denied: ask its owner for access, or name another place\n",
        ),
        (ValueError("A dask config file at '/etc/dask/x.yaml' is malformed"), "correct the file"),
    ],
)  # fmt: skip
def test_what_the_system_or_its_settings_lack_is_reported_without_a_traceback(
    error, want, monkeypatch, capsys
):
    def fails(**_: str) -> None:
        raise error

    monkeypatch.setattr(cli, "main", fails)
    with pytest.raises(SystemExit) as stop:
        command.call()
    assert stop.value.code == 1
    assert want in capsys.readouterr().err


@pytest.mark.parametrize("address", ["gateway://first", "gateway://", "tcp://node1:8786", "tls://node1:8786"])
def test_the_address_of_a_cluster_reaches_its_command_as_it_was_given(address, monkeypatch):
    words = ["toppling", "run", "campaign.toml", "--scheduler", address, f"--scheduler={address}"]
    monkeypatch.setattr(sys, "argv", [*words])
    monkeypatch.setattr(cli, "main", lambda **_: None)
    command.call()
    assert sys.argv == words


def test_a_defect_of_the_program_shows_its_traceback(monkeypatch):
    def fails(**_: str) -> None:
        raise ModuleNotFoundError("No module named 'duckdb'")

    monkeypatch.setattr(cli, "main", fails)
    with pytest.raises(ModuleNotFoundError):
        command.call()


CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f]")
ESCAPES = "\x1b]0;owned\x07\x1b[31m\x9b2J\x1bc\x08\x00"


PRINTS = f"""
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
    raise InputError("a.b", {ESCAPES!r} + "wrong", where="here", expected="sense", remedy="none")

cli.cli.main = fails
cli.main()
"""


def test_no_escape_sequence_of_a_file_reaches_terminal_or_log(tmp_path):
    done = subprocess.run([sys.executable, "-c", PRINTS], cwd=tmp_path, capture_output=True, check=False)
    assert done.stdout == b"said\n"
    assert done.stderr.splitlines()[:2] == [b"also", b"toppling: here: wrong [a.b]"]
    log = (tmp_path / "run.log").read_text()
    assert "warned" in log
    assert CONTROL.search(log) is None


def test_the_help_lists_every_verb_in_exactly_one_group():
    modules = {name: import_module(f"{verbs.__name__}.{name}") for _, name, _ in iter_modules(verbs.__path__)}
    commands = [name for name, module in modules.items() if isinstance(vars(module).get(name), click.Command)]
    assert sorted(VERBS) == sorted(commands)


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["fragilty", "runs/first"], "fragility"), (["Query", "runs/first"], "query"),
        (["records", "imprt"], "import"), (["scene", "exprot"], "export"),
        (["init", ".", ".", "--preset", "standart"], "standard"),
        (["records", "select", ".", "--out", "x", "--quality", "procesed"], "processed"),
    ],
)  # fmt: skip
def test_a_misspelt_verb_or_choice_is_answered_with_what_was_meant(words, meant):
    done = CliRunner().invoke(cli, words)
    assert done.exit_code == 2
    assert f"Did you mean '{meant}'?" in done.stderr
