"""Where a command's jobs run: options shared by several commands, and the cluster that they select."""

import os
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import reduce
from pathlib import Path
from typing import Any, TypedDict, Unpack

import click

from toppling.orchestrator.cluster import QUEUES
from toppling.orchestrator.spelling import OneOf
from toppling.orchestrator.verbs.options import FILE, workers_option

_OPTIONS = (
    workers_option(),
    click.option(
        "--scheduler", help="Address of an existing scheduler. Default: DASK_SCHEDULER_ADDRESS, if set."
    ),
    click.option("--scheduler-file", type=FILE, help="File written by 'dask scheduler --scheduler-file'."),
    click.option(
        "--queue", "queue_kind", type=OneOf(list(QUEUES)), help="Batch system to request workers from."
    ),
    click.option(
        "--queue-jobs", type=click.IntRange(min=1), default=1, show_default=True, help="Batch jobs to submit."
    ),
    click.option("--tls-ca", type=FILE, help="Certificate of the cluster's authority (PEM)."),
    click.option("--tls-cert", type=FILE, help="Certificate of this client (PEM)."),
    click.option("--tls-key", type=FILE, help="Key of this client (PEM)."),
)


def cluster_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options that :func:`cluster_of` takes."""
    return reduce(lambda function, option: option(function), reversed(_OPTIONS), command)


class Where(TypedDict):
    """Values of the options."""

    workers: int | None
    queue_kind: str | None
    queue_jobs: int
    scheduler: str | None
    scheduler_file: Path | None
    tls_ca: Path | None
    tls_cert: Path | None
    tls_key: Path | None


def cluster_of(folder: Path, **where: Unpack[Where]) -> AbstractContextManager:
    """Cluster that the options select; nothing starts before it is entered.

    Raises
    ------
    UsageError
        If options exclude each other.
    """
    from toppling.orchestrator.cluster import existing, local, queue, tls_security

    workers, queue_kind = where["workers"], where["queue_kind"]
    scheduler, scheduler_file = where["scheduler"], where["scheduler_file"]
    given = {
        "--workers": workers, "--queue": queue_kind,
        "--scheduler": scheduler, "--scheduler-file": scheduler_file,
    }  # fmt: skip
    ways = [name for name, value in given.items() if value]
    if len(ways) > 1:
        msg = f"{' and '.join(ways)} exclude each other"
        raise click.UsageError(msg)
    joins = bool(scheduler or scheduler_file or (not ways and os.environ.get("DASK_SCHEDULER_ADDRESS")))
    tls = None
    files = where["tls_ca"], where["tls_cert"], where["tls_key"]
    if any(files):
        if not joins:
            msg = "--tls-ca, --tls-cert and --tls-key are for a running scheduler: give --scheduler or --scheduler-file"
            raise click.UsageError(msg)
        authority, certificate, key = files
        if authority is None or certificate is None or key is None:
            msg = "--tls-ca, --tls-cert and --tls-key must be given together"
            raise click.UsageError(msg)
        tls = tls_security(authority, certificate, key)
    if queue_kind:
        return queue(queue_kind, where["queue_jobs"], folder.absolute())
    if joins:
        return existing(scheduler, scheduler_file, tls)
    return local(workers or os.cpu_count() or 1)
