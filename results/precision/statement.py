"""Statement of a sequential run: a file of its folder, rewritten after every round."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from toppling.models.errors import InputError
from toppling.models.files.digest import read_json, write_json
from toppling.results.analysis.lognormal import parts_words
from toppling.results.precision import STATEMENT_FILE
from toppling.results.precision.design import Rounds
from toppling.results.run_integrity import check_plan_id
from toppling.results.schema import SHORT_NAMES

_SCHEMA_VERSION = 1
"""Version of the statement's format."""


def statement_of(rounds: Rounds, answered: int, records: int, contact: Mapping[str, float]) -> dict[str, Any]:
    """Statement from the rounds of one contact so far.

    rounds: rounds with a verdict.
    answered, records: numbers of jobs with an answer and of their records.
    contact: columns of the results and their values.
    Returns dict: contact, target, measure, value, low, high, precision and asked (relative, but absolute for a
    probability), beta, jobs, records, rounds, ended, reason, departure (of the answers from the curve, or None), words,
    and sentence, which adds what remains to be done.
    """
    verdict = rounds.verdict
    assert verdict is not None
    content: dict[str, Any] = {
        "contact": dict(contact), "target": rounds.target.name, "at": rounds.target.intensity,
        "measure": verdict.measure, "asked": rounds.precision, "jobs": rounds.judged, "answered": answered,
        "records": records, "rounds": list(rounds.sizes), "ended": verdict.ended, "reason": verdict.reason,
        "jobs_needed": verdict.jobs_needed,
    }  # fmt: skip
    found, curve = verdict.estimate, verdict.curve
    if found is None or curve is None:
        sentence = f"nothing can be stated yet: {verdict.reason or 'too few answers'}"
        return {**content, "value": None, "sentence": sentence}
    words = rounds.target.words(verdict.measure, found.value, found.low, found.high)
    if found.base:
        words += f" ({parts_words({'records': found.precision, 'base': found.base})})"
    words += f", from {rounds.judged} jobs with {records} records"
    if verdict.departure is not None:
        words += f"; {verdict.departure.words}"
    sentence = words
    if verdict.reason:
        sentence += f"; not within {100 * rounds.precision:.3g} %: {verdict.reason}"
    elif not verdict.ended:
        sentence += f"; about {verdict.jobs_needed} jobs are needed for {100 * rounds.precision:.3g} %"
    return {
        **content, "value": found.value, "low": found.low, "high": found.high, "precision": found.precision,
        "base": found.base,
        "median": curve.median, "beta": curve.beta, "words": words, "sentence": sentence,
        "departure": verdict.departure and asdict(verdict.departure),
    }  # fmt: skip


def write_statements(run: Path, statements: Sequence[Mapping[str, Any]], plan_id: str) -> None:
    """Write the statements of a run, one per contact."""
    content = {"schema_version": _SCHEMA_VERSION, "plan_id": plan_id, "statements": list(statements)}
    write_json(run / STATEMENT_FILE, content)


def statements_of(run: Path) -> list[dict[str, Any]]:
    """Read the statements of a run; empty for a run without a target.

    Raises InputError if the file is damaged, or of another run.
    """
    path = run / STATEMENT_FILE
    if not path.exists():
        return []
    content = read_json(path, required=True)
    if not isinstance(content, dict) or content.get("schema_version") != _SCHEMA_VERSION:
        raise InputError(
            "document.schema_version",
            "is of another layout",
            where=str(path),
            expected=f"schema version {_SCHEMA_VERSION}",
            remedy="remove it and go on with the run: it is written again",
        )
    check_plan_id(run, path, content.get("plan_id"))
    return list(content["statements"])


def sentences(statements: Sequence[Mapping[str, Any]]) -> list[str]:
    """Summary for a reader: one sentence per contact."""
    texts = [statement["sentence"] for statement in statements]
    if len(texts) > 1:
        under = "with friction {friction_static:g} and restitution {restitution:g} "
        texts = [under.format(**statement["contact"]) + statement["sentence"] for statement in statements]
    names = tuple(SHORT_NAMES.values())
    return [text if text.startswith(names) else text[0].upper() + text[1:] for text in texts]
