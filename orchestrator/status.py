"""State of a run, read only from its folder: during the run, after it, and from a copy."""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from toppling.models.errors import InputError
from toppling.models.files.documents import MOST_SHOWN
from toppling.models.files.stores import writer_of
from toppling.orchestrator.journal import last
from toppling.orchestrator.run_folder import ended, is_running
from toppling.results.precision import STATEMENT_FILE
from toppling.results.reader import Completeness, rows_stored
from toppling.results.run_integrity import AUDIT_FOLDER, LEAST_JOBS, run_document
from toppling.results.store import newest_rows, read_steady, result_files
from toppling.results.weights import CONTACT, WEIGHTS_FILE, Weights, are_due, sentences

_WINDOW = timedelta(minutes=1)
_COLUMNS = ["job_id", "record_id", "status", "toppled", "ended_by", "message", "attempt", "finished_at"]
_REMEDIES = {
    "left_ground": "the rock left the ground that is known: scan more of it",
    "contacts_disagree": "try another preset, and report it",
    "speed_limit": "try the preset reference",
    "time_cap": "count it as neither",
}
"""Remedy for jobs without an answer, by the rule that ended them: repeating such a job ends in the same rule."""


@dataclass(frozen=True)
class LevelCount:
    """Numbers of answered and of toppled jobs of a level."""

    level_m_s2: float
    jobs: int
    toppled: int

    @property
    def fraction(self) -> float:
        """Fraction toppled."""
        return self.toppled / self.jobs


def state_of(run: Path) -> dict[str, Any]:
    """Counts of a run's rows and failures, and its rate; InputError if the folder is not a run."""
    described = run_document(run)
    rows = read_steady([run], lambda: newest_rows(result_files(run), _COLUMNS))
    jobs, stored = described["jobs"], len(rows)
    running = is_running(run)
    sessions = described["sessions"] if running else [ended(session) for session in described["sessions"]]
    event = (last(run, "work began", "rows stored") if running else None) or {}
    status = {entry["values"]: entry["counts"] for entry in pc.value_counts(rows["status"]).to_pylist()}
    failures = _failures(rows.filter(pc.not_equal(rows["status"], "ok")))
    state: dict[str, Any] = {
        "state": "running" if running else "complete" if stored == jobs else "interrupted",
        "writer": writer_of(run) if running else "",
        "unfinished": Completeness(jobs, stored, 0 if running else rows_stored(described)).remark,
        "jobs": jobs, "stored": stored, "toppled": pc.sum(rows["toppled"]).as_py() or 0,
        "failed": stored - status.get("ok", 0), "status": status,
        "failures": failures[:MOST_SHOWN], "again": _again(failures), "rate_per_s": None, "left_s": None,
        "workers": event.get("workers"), "deaths": event.get("deaths"), "sessions": sessions,
    }  # fmt: skip
    state["audit"], state["audit_sentences"] = _audited(run)
    state["stood"], state["stood_sentences"] = _weighted(run)
    state["statements"], state["statement_sentences"] = _stated(run)
    if running and stored < jobs:
        state["rate_per_s"], state["left_s"] = _pace(rows, jobs)
    return state


def _audited(run: Path) -> tuple[dict[str, Any], list[str]]:
    """Results of a run's audits, as JSON and as sentences; statistics are imported only if there are any."""
    if not (run / AUDIT_FOLDER).is_dir():
        return {}, []
    from toppling.results.analysis.audit_statistics import audits_json, audits_of
    from toppling.results.reader import open_run

    audits = audits_of(open_run(run))
    few = (
        f"Fewer than {LEAST_JOBS} jobs were repeated: too few for an audit; 'toppling audit RUN' repeats more"
    )
    return audits_json(audits), [audit.sentence for audit in audits.values()] or [few]


def _stated(run: Path) -> tuple[list[dict[str, Any]], list[str]]:
    """Statements so far of a run with a target, as JSON and as sentences."""
    if not (run / STATEMENT_FILE).exists():
        return [], []
    from toppling.results.precision.design import sentences as sentences_of
    from toppling.results.precision.design import statements_of

    statements = statements_of(run)
    return statements, sentences_of(statements)


def _weighted(run: Path) -> tuple[dict[str, Any], list[str]]:
    """Summary of the weights of a run's bases, as JSON and as sentences."""
    if not (run / WEIGHTS_FILE).exists():
        return {}, ["The bases are not weighted yet"] if are_due(run) else []
    columns = ["job_id", *CONTACT, "base", "attempt"]
    rows = read_steady([run], lambda: newest_rows(result_files(run), columns)).to_pandas()
    summary = Weights.read(run).summary(rows)
    return summary, sentences(summary)


def level_counts(run: Path) -> list[LevelCount]:
    """Answered jobs and topplings of a run at each level."""
    columns = ["job_id", "level_pga_m_s2", "toppled", "attempt"]
    rows = read_steady([run], lambda: newest_rows(result_files(run), columns))
    answered = rows.filter(pc.is_valid(rows["toppled"]))
    grouped = answered.group_by("level_pga_m_s2", use_threads=False)
    table = grouped.aggregate([("toppled", "count"), ("toppled", "sum")]).to_pylist()
    return [LevelCount(row["level_pga_m_s2"], row["toppled_count"], row["toppled_sum"]) for row in table]


def _failures(rows: pa.Table) -> list[dict[str, Any]]:
    """Reasons of failures, the most frequent first, with the number of jobs and an example of each."""
    grouped = rows.group_by(["status", "ended_by", "message"], use_threads=False)
    reasons = grouped.aggregate([("job_id", "count"), ("job_id", "first"), ("record_id", "first")])
    reasons = reasons.sort_by([("job_id_count", "descending"), ("job_id_first", "ascending")])
    names = ["status", "ended_by", "message", "jobs", "job_id", "record_id"]
    found = reasons.rename_columns(names).to_pylist()
    for row in found:
        row["message"] = "; ".join(filter(None, (row["message"], _REMEDIES.get(row["ended_by"] or ""))))
    return found


def _again(failures: list[dict[str, Any]]) -> list[str]:
    """Statuses of jobs that may have an answer when they are done again: no rule and no refusal ended them."""
    ended = [row["ended_by"] or row["message"].startswith(f"{InputError.__name__}: ") for row in failures]
    return sorted({row["status"] for row, of_itself in zip(failures, ended, strict=True) if not of_itself})


def _pace(rows: pa.Table, jobs: int) -> tuple[float | None, float | None]:
    """Jobs per second in the last minute of stored rows, and the time left at that rate, s."""
    last = pc.max(rows["finished_at"]).as_py()
    if last is None or datetime.now(UTC) - last > 10 * _WINDOW:
        return None, None
    recent = rows.filter(pc.greater(rows["finished_at"], pa.scalar(last - _WINDOW, rows["finished_at"].type)))
    seconds = max((last - pc.min(recent["finished_at"]).as_py()).total_seconds(), 1.0)
    rate_per_s = len(recent) / seconds
    return rate_per_s, (jobs - len(rows)) / rate_per_s
