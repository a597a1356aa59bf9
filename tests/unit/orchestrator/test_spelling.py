"""A misspelt word is answered with the one that was probably meant."""

import pytest
from click.testing import CliRunner

from toppling.models.errors import nearest
from toppling.orchestrator.cli import VERBS, cli


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


@pytest.mark.parametrize("verb", VERBS)
def test_each_verb_with_a_letter_left_out_is_found_again(verb):
    assert nearest(verb[:2] + verb[3:], VERBS) == verb
