"""Where a command's jobs run: options shared by several commands, and the cluster that they select."""

import os
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import reduce
from pathlib import Path
from typing import Any

import click

from toppling.orchestrator.misspelt import OneOf
from toppling.orchestrator.verbs.shared_options import option

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
    option("--queue", "queue_kind", type=OneOf(list(QUEUES)), help="Batch system to request workers from."),
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


def _ways(where: dict[str, Any]) -> list[str]:
    """Given options that select a cluster."""
    names = {"workers": "--workers", "queue_kind": "--queue", "scheduler": "--scheduler"}
    return [option for name, option in names.items() if where[name]]


def local_workers(where: dict[str, Any]) -> int:
    """Initial number of local workers; 0 where jobs run elsewhere."""
    selected = _ways(where)
    if selected == ["--workers"]:
        return where["workers"].low
    return 0 if selected or os.environ.get("DASK_SCHEDULER_ADDRESS") else os.cpu_count() or 1


def cluster_of(folder: Path, **where: Any) -> AbstractContextManager:
    """Cluster selected by options, started when it is entered; UsageError if options exclude each other."""
    from toppling.orchestrator.cluster import existing, gateway, local, queue

    workers, queue_kind, scheduler = where["workers"], where["queue_kind"], where["scheduler"]
    if len(selected := _ways(where)) > 1:
        raise click.UsageError(f"{' and '.join(selected)} exclude each other")
    begin = local_workers(where)
    if queue_kind:
        jobs = where["queue_jobs"]
        return queue(queue_kind, jobs.low, folder.absolute(), jobs, of_batch_job(where))
    if scheduler and scheduler.startswith(_GATEWAY):
        return gateway(scheduler.removeprefix(_GATEWAY))
    return local(begin, most=workers) if begin else existing(scheduler)
