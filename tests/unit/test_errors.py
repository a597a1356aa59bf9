"""Every error has a code that states what is wrong, and the documentation lists all of them."""

import ast
import copy
import pickle
import re
import sys
from collections import defaultdict
from pathlib import Path

import pytest
from refusals import refused

from toppling.models.errors import InputError, UsageError, check_positive
from toppling.models.files.given import AbsentError, open_given

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "benchmarks"))
import error_codes  # noqa: E402

OF_SEVERAL_ROOMS = {
    "document": "schema_version unreadable", "engine": "contact_unknown", "ensemble": "empty record_unknown",
    "file": "absent empty not_regular not_text unreadable", "fragility": "none",
    "hazard": "measure_other several_curves weight_unusable weights_incomplete",
    "hint": "place_unreadable unknown", "measure": "unknown", "metadata": "no_file_given",
    "package": "not_installed",
    "placement": "given_twice", "record": "given_twice none_found", "rock": "does_not_stand",
    "run": "no_answers", "site": "several", "table": "unreadable",
}  # fmt: skip
"""Codes of one failing that is found in two rooms. Whoever adds one has seen that the two are the same."""


def test_the_table_of_codes_in_the_docs_is_that_of_the_source():
    assert error_codes.table() in (ROOT / "docs" / "errors.md").read_text("utf-8")


def test_codes_are_a_topic_and_a_reason_in_small_letters_and_short():
    codes = {code for _, code, _, _ in error_codes.raised()}
    assert [code for code in codes if not error_codes.CODE.fullmatch(code) or len(code) > 40] == []


def test_every_error_that_is_made_has_a_code():
    for path in (path for room in error_codes.ROOMS for path in (ROOT / room).rglob("*.py")):
        for call in ast.walk(ast.parse(path.read_text("utf-8"))):
            made = isinstance(call, ast.Call) and getattr(call.func, "id", "") in ("InputError", "UsageError")
            if made and call.args:
                codes = re.findall(r"'(.*?)'", code := ast.unparse(call.args[0]))
                assert code.endswith("code") or all(map(error_codes.CODE.fullmatch, codes)), (
                    path,
                    call.lineno,
                )


def test_no_two_rooms_use_a_code_by_chance():
    rooms = defaultdict(set)
    for room, code, _, _ in error_codes.raised():
        rooms[code].add(room)
    known = {f"{topic}.{reason}" for topic, reasons in OF_SEVERAL_ROOMS.items() for reason in reasons.split()}
    assert {code for code, several in rooms.items() if len(several) > 1} == known


@pytest.mark.parametrize("kind", [InputError, UsageError])
@pytest.mark.parametrize("again", [copy.copy, lambda error: pickle.loads(pickle.dumps(error))])
def test_an_error_retains_its_code_and_kind_between_processes_and_ends_its_first_line_with_it(kind, again):
    made = again(kind("record.gap", "a gap of 3 s", where="a.dat", expected="none", remedy="cut it"))
    assert (type(made), made.code) == (kind, "record.gap")
    assert str(made).splitlines() == [
        "a.dat: a gap of 3 s [record.gap]",
        "  expected: none",
        "  remedy:   cut it",
    ]


def test_a_file_that_is_not_there_has_the_code_of_that_whatever_would_read_it(tmp_path):
    with refused("file.absent", tmp_path / "none", kind=AbsentError):
        open_given(
            tmp_path / "none",
            lambda code, what, where: InputError(code, what, where=str(where), expected="", remedy=""),
        )


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_what_is_not_above_zero_and_finite_is_refused_by_its_name(value):
    with refused("value.not_positive", "gravity", value):
        check_positive("scene", "a positive number", "9.81", gravity=value)
