"""The table of verbs, which is listed without importing any of them."""

import subprocess
import sys

import click
import pytest
from click.testing import CliRunner

from toppling.orchestrator.cli import VERBS, cli, main


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_is_there_and_begins_its_help_as_the_list_does(verb):
    command = cli.get_command(click.Context(cli), verb)
    assert command.name == verb
    assert command.help.splitlines()[0] == VERBS[verb]
    assert f"toppling {verb}" in command.help or isinstance(command, click.Group), "an example is missing"


def test_the_list_of_verbs_imports_none():
    program = (
        "import sys; from toppling.orchestrator.cli import cli; cli(['--help'], standalone_mode=False); "
        "assert not [name for name in sys.modules if name.startswith('toppling.orchestrator.verbs.')]"
    )
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert all(line in " ".join(told.split()) for line in VERBS.values())


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


def test_an_error_of_the_system_without_a_number_is_told_in_its_own_words(monkeypatch, capsys):
    def fails(**_: str) -> None:
        raise OSError("Corrupt data page")

    monkeypatch.setattr(cli, "main", fails)
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 1
    assert "toppling: Corrupt data page" in capsys.readouterr().err
