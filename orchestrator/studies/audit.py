"""Audit of a run: a random sample of its jobs is repeated with the finest preset, and with other engines.

Rows of an audit are stored in separate subfolders of the run, never among its results (`analysis.audit_statistics`).
"""

import dataclasses
import fcntl
import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from toppling.models.errors import InputError
from toppling.models.files.digest import write_json
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.context import RunProgress, Work
from toppling.orchestrator.execution import Execution
from toppling.orchestrator.journal import log_event
from toppling.orchestrator.plan import Plan
from toppling.orchestrator.run_folder import place_in
from toppling.orchestrator.task import versions
from toppling.results import run_integrity, store
from toppling.workers.engines import DEFAULT, ENGINES
from toppling.workers.options import PRESETS

log = logging.getLogger(__name__)

_COST_FRACTION = 0.09
"""Cost of an audit as a fraction of the run's, below a tenth since the last repetitions may cost more than the others,
unless a number of jobs is requested."""

_FIRST_JOBS = 4
"""Number of jobs that each auditor repeats first, and doubles: their cost decides how many it can afford."""

_DRAWN_COLUMNS = ["job_id", "status", "wall_s", "finished_at"]


@dataclass(frozen=True)
class _Auditor:
    """Engine and preset that repeat jobs."""

    name: str  # name of its folder
    engine: str
    preset: str

    def fits(self, campaign: Campaign) -> bool:
        """Whether it is installed, differs from the run's engine and preset, and supports the campaign's options."""
        engine = ENGINES[self.engine]
        if engine.version is None or not engine.models(campaign.friction, campaign.restitution):
            return False
        if DEFAULT not in (self.engine, campaign.engine):
            return False
        return (campaign.engine, campaign.preset) != (self.engine, self.preset)

    def plan(self, planned: Plan, rows: NDArray[np.int64]) -> Plan:
        """Plan of some of a plan's jobs for this auditor."""
        campaign = dataclasses.replace(planned.campaign, engine=self.engine, preset=self.preset)
        part = dataclasses.replace(planned, campaign=campaign, jobs=planned.jobs.take(pa.array(rows)))
        return part.with_ids()


AUDITORS = (
    _Auditor(run_integrity.REFERENCE, DEFAULT, "reference"),
    *(_Auditor(name, name, "standard") for name in ENGINES if name != DEFAULT),
)


def _auditors(campaign: Campaign) -> list[_Auditor]:
    """Auditors that are installed and applicable to a run of this campaign."""
    return [auditor for auditor in AUDITORS if auditor.fits(campaign)]


def affordable(campaign: Campaign, rows: pa.Table, folder: Path) -> tuple[list[_Auditor], int]:
    """Auditors, and how many jobs each can repeat for a tenth of the run's cost; none that could repeat too few.

    A job's cost is its time on its worker, even without a step. A repetition costs what those by the same auditor did
    so far; before any, as much as a job of the run, and the reference more by the ratio of the steps.

    rows: answered jobs of the run (`drawn`) in `folder`.
    """
    able, wall_s = _auditors(campaign), _wall_s(rows)
    left_s, spent_s, cost_s = _COST_FRACTION * wall_s.sum(), {}, {}
    for auditor in able:
        repeated_s = _wall_s(_rows_in(folder / run_integrity.AUDIT_FOLDER / auditor.name))
        finer = PRESETS[campaign.preset].step_share / PRESETS[auditor.preset].step_share
        spent_s[auditor] = repeated_s.sum()
        cost_s[auditor] = repeated_s.mean() if len(repeated_s) else wall_s.mean() * max(finer, 1.0)
    for chosen in filter(None, (able, *([auditor] for auditor in able))):  # all, else first the reference
        left_out_s = sum(spent_s[auditor] for auditor in able if auditor not in chosen)
        count = int((left_s - left_out_s) / max(sum(cost_s[auditor] for auditor in chosen), 1e-9))
        if count >= run_integrity.LEAST_JOBS:
            return chosen, count
    return [], 0


def _wall_s(rows: pa.Table) -> NDArray[np.float64]:
    return pc.fill_null(rows["wall_s"], 0.0).to_numpy().astype(float)


def _rows_in(folder: Path) -> pa.Table:
    return store.read_steady([folder], lambda: store.newest_rows(store.result_files(folder), _DRAWN_COLUMNS))


def drawn(folder: Path) -> pa.Table:
    """Answered jobs of a run in the order in which they are drawn: that of their ids, which are hashes."""
    rows = _rows_in(folder)
    return rows.filter(pc.equal(rows["status"], "ok")).sort_by("job_id")


def audit(work: Work, count: int, auditors: Sequence[_Auditor] | None = None) -> list[RunProgress]:
    """Repeat a random sample of a run's jobs, or resume that; returns the progress of each auditor.

    count: number of jobs; a larger sample includes a smaller one.
    auditors: all that are applicable unless given.
    Raises InputError if another process audits this run, or no auditor is applicable.
    """
    planned, folder = work.planned, work.folder
    able = _auditors(planned.campaign) if auditors is None else auditors
    if not able:
        raise InputError(
            "audit.nothing_finer",
            "no installed engine or preset is finer than that of this run",
            where=str(folder),
            expected="a run with preset fast or standard, or a second engine",
            remedy="install one: "
            + " or ".join(
                f"pip install 'toppling[{engine.extra}]'" for engine in ENGINES.values() if engine.extra
            ),
        )
    progresses = []
    with _alone(folder) as home:
        rows = drawn(folder)
        chosen = _rows_of(planned, rows["job_id"][:count])
        latest = pc.max(rows["finished_at"]).as_py()
        for auditor in able:
            target = home / auditor.name
            run_integrity.check_audit(folder, target)
            (target / store.PARTS_FOLDER).mkdir(parents=True, exist_ok=True)
            until = latest.isoformat() if latest else None
            origin = {"plan_id": planned.id, "until": until, "of_jobs": len(rows)}
            write_json(target / run_integrity.DRAWN_FILE, origin)
            part = auditor.plan(planned, chosen)
            run_integrity.write_jobs(target, part.jobs, planned.id)
            pending = part.pending(store.finished_ids(target))
            what = f"auditing with {auditor.name}"
            progress = RunProgress(len(part), len(part) - len(pending), what, deaths=work.progress.deaths)
            log_event("audit began", by=auditor.name, jobs=len(part), done=progress.before)
            again = dataclasses.replace(work, planned=part, progress=progress, redo={}, store=target)
            Execution(again, pending)()
            work.progress.deaths = progress.deaths
            if store.result_files(target):
                store.compact(target)
            log_event("audit ended", by=auditor.name, **progress.summary())
            progresses.append(progress)
    return progresses


def check_versions(folder: Path) -> None:
    """Raise InputError if the run was made with another physics version, so that an audit would not be comparable."""
    there, here = run_integrity.run_document(folder)["versions"].get("physics"), dict(versions())["physics"]
    if there != here:
        raise InputError(
            "run.versions_differ",
            f"the run was made with physics version {there}, here is {here}",
            where=str(folder),
            expected="one version, so that answers differ by the settings alone",
            remedy="audit it with the environment that it was made with, or run the campaign again",
        )


def _rows_of(planned: Plan, ids: pa.ChunkedArray) -> NDArray[np.int64]:
    places = pc.index_in(ids, value_set=planned.jobs["job_id"].combine_chunks())
    return np.sort(places.drop_null().to_numpy())


@contextmanager
def _alone(folder: Path) -> Iterator[Path]:
    """Folder of a run's audits, locked against other processes."""
    home = place_in(folder, run_integrity.AUDIT_FOLDER)
    home.mkdir(exist_ok=True)
    with (home / ".lock").open("a") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                "run.locked",
                "another process audits this run",
                where=str(folder),
                expected="one at a time",
                remedy="wait for it",
            ) from None
        yield home


def audit_due(planned: Plan, folder: Path) -> int:
    """Number of jobs to audit, as the campaign requests, if some auditor has not finished them; else 0."""
    return _due(planned, folder)[1]


def _due(planned: Plan, folder: Path) -> tuple[list[_Auditor], int]:
    campaign, rows = planned.campaign, drawn(folder)
    if campaign.audit is None:
        able, count = affordable(campaign, rows, folder)
    else:
        able, count = _auditors(campaign), min(campaign.audit, len(rows))
    least = min(count, run_integrity.LEAST_JOBS) if campaign.audit is None else count
    chosen = _rows_of(planned, rows["job_id"][:count])
    for auditor in able if count else ():
        target = folder / run_integrity.AUDIT_FOLDER / auditor.name
        run_integrity.check_audit(folder, target)
        if len(auditor.plan(planned, chosen).ids & store.finished_ids(target)) < least:
            return able, count
    return [], 0


def audit_run(work: Work) -> None:
    """Audit a run as its campaign requests, or resume that."""
    campaign = work.planned.campaign
    able, count = _due(work.planned, work.folder)
    jobs = count if campaign.audit else _FIRST_JOBS
    while count:
        audit(work, min(jobs, count), able)
        if jobs >= count:
            return
        jobs *= 2
        able, count = affordable(campaign, drawn(work.folder), work.folder)
