"""Where the jobs run: workers on this machine, a scheduler that exists, or a batch system."""

import contextlib
import importlib
import logging
import os
import shlex
import signal
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import dask
from dask.utils import parse_bytes
from distributed import Client, LocalCluster, performance_report
from distributed.security import Security

from toppling.models.errors import InputError, UsageError
from toppling.orchestrator.cluster_supervisor import let_resize
from toppling.orchestrator.interrupt import Uninterrupted, kept_from_children
from toppling.orchestrator.leaving import BACK_WITHIN_S
from toppling.orchestrator.processor import KERNEL_VARIABLES
from toppling.orchestrator.safe_path import VARIABLE, safe_for_children, without_working_folder
from toppling.workers.compile_once import compile_apart

log = logging.getLogger(__name__)

QUEUES = {
    "slurm": "SLURMCluster",
    "pbs": "PBSCluster",
    "sge": "SGECluster",
    "lsf": "LSFCluster",
    "htcondor": "HTCondorCluster",
}
_LEAST_MEMORY_BYTES = 800_000_000
"""Of a worker process: half of it is the libraries', and the rest its worlds and records."""

_MOST_PER_CORE, _MOST_ALWAYS = 4, 16
"""Local workers: a core is busy with one."""
_CONNECT_TIMEOUT_S = 30
_SILENT = {f"distributed.{role}.http.routes": ["distributed.http.health"] for role in ("scheduler", "worker")}
"""Dask's pages ask for no key: they would show the session's work to every account of the host."""

_ENCRYPTED = ("tls", "wss")
"""Kinds of addresses at which only holders of a key are let in."""

_SETTINGS = Path(__file__).with_name("dask.yaml")


def load_defaults() -> None:
    """Put the project's Dask settings below the user's files and DASK_* variables."""
    for settings in dask.config.collect_yaml([str(_SETTINGS)]):
        # As if for the first time: what is a default already, Dask takes for the user's own after a refresh.
        dask.config.defaults[:] = [known for known in dask.config.defaults if known != settings]
        dask.config.update_defaults(settings)
    # Every fault that these report is reported by the run. Some loggers below them have a level of their own.
    silent = ("distributed", "tornado", "bokeh", "asyncio")
    below = [
        name
        for name in logging.root.manager.loggerDict
        if name.startswith(tuple(f"{one}." for one in silent))
    ]
    for name in (*silent, *below):
        logging.getLogger(name).setLevel(logging.CRITICAL)


def local(workers: int, most: int | None = None) -> contextlib.AbstractContextManager[Client]:
    """Start worker processes with one thread each, bound to the loopback interface and to this session.

    Loopback is shared with every account of the host, so that scheduler and workers accept only who holds the session's
    key, which never leaves the memory of these processes; what they write is in a folder of this account alone.

    workers: to begin with.
    most: as many as there may be where there is work for them; None for no more.
    Raises UsageError if they would be so many that they only crowd each other out.
    """
    cores, most = os.cpu_count() or 1, max(workers, most or 0)
    bound = max(_MOST_PER_CORE * cores, _MOST_ALWAYS)
    if most > bound:  # at once, before anything is written
        raise UsageError(
"cluster.too_many_workers",
            f"{most} local workers, and this machine has {cores} cores",
            where="workers", expected=f"at most {bound} processes here: more only take memory from each other",
            remedy=f"give {cores}, or more hosts by a scheduler or a batch system (--scheduler, --queue)"
        )  # fmt: skip
    return _local_client(workers, most)


@contextlib.contextmanager
def _local_client(workers: int, most: int) -> Iterator[Client]:
    safe_for_children()
    compile_apart()
    load_defaults()
    with Uninterrupted(_local_session()) as (cluster, client):
        cluster.scale(workers)  # not at once: the cluster would fail with a worker that dies while it starts
        let_resize(cluster, workers, most)
        yield client


@contextlib.contextmanager
def _local_session() -> Iterator[tuple[LocalCluster, Client]]:
    with (
        without_working_folder(),
        # After this time Dask would drop a worker whose successor happens to be starting, and start no other.
        dask.config.set({"distributed.deploy.lost-worker-timeout": "1000 days", **_SILENT}),
        tempfile.TemporaryDirectory(prefix="toppling-session-", ignore_cleanup_errors=True) as scratch,
        _local_cluster(scratch) as cluster,
        Client(cluster) as client,
    ):
        try:
            yield cluster, client
        finally:
            client.sync(_end_workers, cluster)


def _local_cluster(scratch: str) -> LocalCluster:
    with kept_from_children():
        return LocalCluster(
            n_workers=0,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            security=_session_security(),
            dashboard_address="127.0.0.1:0",
            scheduler_kwargs={"dashboard": False},
            local_directory=scratch,
            silence_logs=False,  # it would silence the root logger too, and with it the run's own warnings
        )


def _session_security() -> Security | None:
    """Key and certificate of this session, in memory; None, which is told, where they cannot be made."""
    try:
        return Security.temporary()
    except ImportError:
        log.warning(
            "cryptography is not installed: other accounts of this host can run code as you in this session. "
            "Install it with 'pip install cryptography'"
        )
        return None


async def _end_workers(cluster: LocalCluster) -> None:
    """Kill the worker processes: none holds anything, and one that hangs would hold up the end, or a Ctrl-C."""
    for nanny in cluster.workers.values():
        nanny.close_gracefully()  # starts no other in its place
        if nanny.is_alive():
            with contextlib.suppress(ProcessLookupError):  # it has died at this moment
                os.kill(nanny.pid, signal.SIGKILL)


@contextlib.contextmanager
def reported(cluster: contextlib.AbstractContextManager[Client], report: Path | None) -> Iterator[Client]:
    """Use a cluster, and write Dask's performance report of that time to a file if one is named."""
    report_too = performance_report(str(report)) if report else contextlib.nullcontext()
    with cluster as client, client.as_current(), report_too:
        yield client


class _ClosedIfNotStarted(Client):
    """A client that Dask leaves open after some errors would keep the program from its end, for a minute."""

    def start(self, **kwargs: Any) -> None:
        try:
            super().start(**kwargs)
        except BaseException:
            self.close()
            raise


@contextlib.contextmanager
def existing(address: str | None, scheduler_file: Path | None, tls: Security | None) -> Iterator[Client]:
    """Connect to a scheduler that somebody else has started.

    address: such as `tcp://host:8786`; without it and a file, the configuration's `scheduler-address`.
    scheduler_file: written by `dask scheduler --scheduler-file`.
    tls: certificates; None for the configuration's.
    Raises InputError if nothing answers there, or it refuses the connection.
    """
    load_defaults()
    where = address or (str(scheduler_file) if scheduler_file else dask.config.get("scheduler-address", ""))
    if scheduler_file is not None and not scheduler_file.is_file():
        raise _unreachable(where, "no such file")
    options: dict[str, Any] = {"security": tls} if tls else {}
    try:
        client = _ClosedIfNotStarted(
            address, scheduler_file=str(scheduler_file) if scheduler_file else None,
            timeout=_CONNECT_TIMEOUT_S, set_as_default=False, **options,
        )  # fmt: skip
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        what = str(error).splitlines()[0]
        if "ssl_context" in what:  # an argument deep inside Dask
            what = "the address asks for TLS, and no certificates are given"
        raise _unreachable(where, what) from None
    client._timeout = BACK_WITHIN_S  # for a scheduler that is started again
    with Uninterrupted(client):
        with contextlib.suppress(OSError):  # who asks for workers next will tell
            _check_scheduler(client)
        _warn_of_open_door(str(client.scheduler_info()["address"]))
        yield client


@contextlib.contextmanager
def queue(kind: str, jobs: int, secrets: Path, most: int | None = None) -> Iterator[Client]:
    """Have a batch system start workers, as ~/.config/dask/jobqueue.yaml says.

    Scheduler and workers accept only who holds the session's key. Batch jobs have to find it: it lies in files of
    mode 600 as long as the session goes on. Where the configuration has certificates, these are used instead.

    kind: one of `QUEUES`.
    jobs: batch jobs to submit to begin with.
    secrets: folder for the key, which all hosts see.
    most: batch jobs that there may be where there is work for them; None for no more.
    """
    with Uninterrupted(_queue_session(kind, secrets)) as (cluster, client):
        cluster.scale(jobs=jobs)
        let_resize(cluster, jobs, most or jobs)
        yield client


@contextlib.contextmanager
def _queue_session(kind: str, secrets: Path) -> Iterator[tuple[Any, Client]]:
    with _queue_cluster(kind, secrets) as cluster, Client(cluster) as client:
        yield cluster, client


def job_script(kind: str) -> str:
    """Tell what would be submitted to a batch system; the key's files are named as if in a folder of this moment."""
    with (
        tempfile.TemporaryDirectory(prefix="toppling-") as folder,
        _queue_cluster(kind, Path(folder)) as cluster,
    ):
        return cluster.job_script()


def tls_security(ca: Path, certificate: Path, key: Path) -> Security:
    """Certificates of a cluster across hosts; without them nobody is let in, in either direction.

    Raises InputError if a file is absent.
    """
    for path in (ca, certificate, key):
        if not path.is_file():
            raise InputError(
                "file.absent",
                "no such file",
                where=str(path),
                expected="the cluster's authority, and a certificate and key that it signed (PEM)",
                remedy="see docs/faults.md, 'Who is let in', for the three openssl commands that make them",
            )
    return Security(
        tls_ca_file=str(ca),
        tls_client_cert=str(certificate),
        tls_client_key=str(key),
        require_encryption=True,
    )


@contextlib.contextmanager
def _queue_cluster(kind: str, secrets: Path) -> Iterator[Any]:
    with _new_queue_cluster(kind, secrets) as cluster:
        try:
            yield cluster
        finally:
            for name, file in vars(cluster).items():
                if name.startswith("_job_") and hasattr(file, "close"):
                    file.close()  # which removes it


def _new_queue_cluster(kind: str, secrets: Path) -> Any:
    load_defaults()
    has_certificates = dask.config.get("distributed.comm.require-encryption", None)
    security = None if has_certificates else _session_security()
    try:
        jobqueue = importlib.import_module("dask_jobqueue")
    except ImportError:
        raise InputError("package.not_installed", "dask-jobqueue is not installed", where=f"--queue {kind}",
            expected="the extra hpc", remedy="pip install 'toppling[hpc]'") from None  # fmt: skip
    try:
        # A process a core: the engine is one per process, and its threads would wait for each other.
        cores = dask.config.get(f"jobqueue.{kind}.cores") or 1
        _warn_of_little_memory(kind, cores)
        prologue = dask.config.get(f"jobqueue.{kind}.job-script-prologue", None) or []
        arguments = dask.config.get(f"jobqueue.{kind}.worker-extra-args", None) or []
        chosen = {VARIABLE: "1"} | {name: os.environ.get(name) for name in KERNEL_VARIABLES}
        exports = [f"export {name}={shlex.quote(value)}" for name, value in chosen.items() if value]
        with kept_from_children():  # what submits and takes back batch jobs
            return getattr(jobqueue, QUEUES[kind])(
                cores=cores,
                processes=cores,
                security=security,
                shared_temp_directory=str(secrets),
                job_script_prologue=[*prologue, *exports],
                # Dask's pages ask for no key.
                worker_extra_args=["--no-dashboard", "--dashboard-address", "127.0.0.1:0", *arguments],
                scheduler_options={
                    "dashboard_address": "127.0.0.1:0",
                    **dask.config.get(f"jobqueue.{kind}.scheduler-options", {}),
                },
            )
    except (ValueError, KeyError) as error:
        raise InputError(
            "cluster.queue_unconfigured",
            str(error).splitlines()[0],
            where=f"--queue {kind}",
            expected=f"cores, memory, walltime ... in ~/.config/dask/jobqueue.yaml under jobqueue: {kind}:",
            remedy="see https://jobqueue.dask.org/en/latest/configuration.html, and try --dry-run first",
        ) from None


def _warn_of_little_memory(kind: str, processes: int) -> None:
    given = dask.config.get(f"jobqueue.{kind}.memory", None)
    if given and parse_bytes(given) < processes * _LEAST_MEMORY_BYTES:
        log.warning(
            "memory: %s in jobqueue.yaml is less than %.1f GB for each of %d processes: they may be killed for lack "
            "of it",
            *(given, _LEAST_MEMORY_BYTES / 1e9, processes),
        )


def _warn_of_open_door(address: str) -> None:
    """Warn of a scheduler that lets in whoever reaches it, beyond this machine."""
    scheme, _, location = address.partition("://")
    host = location.rpartition(":")[0].strip("[]")
    if scheme in _ENCRYPTED or host == "localhost" or host.startswith("127.") or host == "::1":
        return
    log.warning(
        "%s asks nobody for a key: whoever reaches it on the network can run code as the user of its workers. Start it "
        "with certificates (docs/faults.md, 'Who is let in') and give tls://..., or bind it to 127.0.0.1",
        address,
    )


def _check_scheduler(client: Client) -> None:
    """Warn of settings that only where the scheduler starts can be set."""

    def settings(dask_scheduler: Any = None) -> tuple[float, int]:
        return dask_scheduler.WORKER_SATURATION, dask_scheduler.allowed_failures

    saturation, failures = client.run_on_scheduler(settings)
    if saturation != 1.0 or failures != 0:
        log.warning(
            "the scheduler runs with worker-saturation %g and allowed-failures %d instead of 1.0 and 0: "
            "a crash will cost more retries. Start it with DASK_CONFIG=%s",
            saturation,
            failures,
            _SETTINGS,
        )


def _unreachable(where: str, what: str) -> InputError:
    return InputError(
        "cluster.unreachable",
        what,
        where=f"scheduler {where}",
        expected="a Dask scheduler that answers there, with the same kind of security",
        remedy="check the address; start one with 'dask scheduler'; give --tls-* if it asks for certificates",
    )
