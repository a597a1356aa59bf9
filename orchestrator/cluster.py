"""Clusters for jobs: local workers, an existing scheduler, a Dask Gateway, or a batch system."""

import contextlib
import logging
import os
import shlex
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import dask
from distributed import Client, Status
from distributed.security import Security

from toppling.models.errors import InputError, UsageError, optional_module
from toppling.orchestrator.dask_cluster import BACK_WITHIN_S, CLOSED, let_resize
from toppling.orchestrator.interrupt import signals_blocked, uninterrupted
from toppling.orchestrator.local_workers import LocalWorkers
from toppling.orchestrator.processes import VARIABLE, safe_for_children
from toppling.orchestrator.run_folder import KEY_FOLDERS
from toppling.orchestrator.session_key import write_key
from toppling.orchestrator.task import KERNEL_VARIABLES, warn_of_no_cache
from toppling.workers.compile_once import compile_apart

log = logging.getLogger(__name__)

_MOST_PER_CORE = 4
"""Maximum number of local workers per core; one worker occupies a core."""
_MOST_ALWAYS = 16
"""Number of local workers that every machine allows."""
_SILENT = {f"distributed.{role}.http.routes": ["distributed.http.health"] for role in ("scheduler", "worker")}
"""Settings that disable Dask's dashboards, which have no authentication and are open to every account of the host."""

_ENCRYPTED = ("tls", "wss")
"""Schemes of addresses that require a key."""

_SETTINGS = Path(__file__).with_name("dask.yaml")


def load_defaults() -> None:
    """Load the project's Dask settings with lower priority than the user's files and DASK_* variables."""
    for settings in dask.config.collect_yaml([str(_SETTINGS)]):
        # Remove our defaults first: after a refresh Dask would treat existing defaults as the user's.
        dask.config.defaults[:] = [known for known in dask.config.defaults if known != settings]
        dask.config.update_defaults(settings)
    # The run reports all faults that these loggers would. Some child loggers set their own level.
    silent = ("distributed", "tornado", "bokeh", "asyncio")
    for name in (*silent, *logging.root.manager.loggerDict):
        if name.partition(".")[0] in silent:
            logging.getLogger(name).setLevel(logging.CRITICAL)


def local(workers: int, most: int | None = None) -> contextlib.AbstractContextManager[Client]:
    """Start worker processes with one thread each, protected by a key of this session.

    workers: initial number.
    most: maximum number while there is work for them; None for the initial number.
    Raises UsageError if there would be too many for this machine.
    """
    cores, most = os.cpu_count() or 1, max(workers, most or 0)
    bound = max(_MOST_PER_CORE * cores, _MOST_ALWAYS)
    if most > bound:  # before anything is written
        raise UsageError(
            "cluster.too_many_workers",
            f"{most} local workers, and this machine has {cores} cores",
            where="workers",
            expected=f"at most {bound} processes here: more only take memory from each other",
            remedy=f"give {cores}, or more hosts by a scheduler or a batch system (--scheduler, --queue)",
        )
    return _local_client(workers, most)


@contextlib.contextmanager
def _local_client(workers: int, most: int) -> Iterator[Client]:
    safe_for_children()
    compile_apart()
    warn_of_no_cache()
    load_defaults()
    with uninterrupted(_local_session(most)) as client:
        let_resize(client.cluster, workers, most)
        yield client


@contextlib.contextmanager
def _local_session(most: int) -> Iterator[Client]:
    with (
        # After this timeout Dask would drop a worker whose replacement is still starting.
        dask.config.set({"distributed.deploy.lost-worker-timeout": "1000 days", **_SILENT}),
        tempfile.TemporaryDirectory(prefix="toppling-session-", ignore_cleanup_errors=True) as scratch,
    ):
        with signals_blocked():
            cluster = LocalWorkers(scratch, Security.temporary(), most)
        with cluster, Client(cluster) as client:
            yield client


class _ClosedIfNotStarted(Client):
    """Client that is closed after a failed start; Dask leaves some open, which delays the exit by a minute."""

    def start(self, **kwargs: Any) -> None:
        try:
            super().start(**kwargs)
        except BaseException:
            self.close()
            raise


@contextlib.contextmanager
def existing(address: str | None) -> Iterator[Client]:
    """Connect to an existing scheduler, with the certificates that Dask's configuration names.

    address: such as `tcp://host:8786`, or the file of `dask scheduler --scheduler-file`; without it, the
    configuration's `scheduler-address`.
    Raises InputError if the scheduler does not answer, or refuses the connection.
    """
    load_defaults()
    where = address or dask.config.get("scheduler-address", "")
    by_file = address and "://" not in address and not address.rpartition(":")[2].isdigit()
    if by_file and not Path(where).is_file():
        raise _unreachable(where, "no such file")
    at = {"scheduler_file" if by_file else "address": address}
    try:
        _ClosedIfNotStarted(**at, set_as_default=False).close()
        # Unlike Dask's own, this timeout also gives a restarted scheduler time.
        client = _ClosedIfNotStarted(**at, timeout=BACK_WITHIN_S, set_as_default=False)
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        what = str(error).splitlines()[0]
        if "ssl_context" in what:  # an internal error of Dask
            what = "the address asks for TLS, and no certificates are given"
        raise _unreachable(where, what) from None
    with uninterrupted(client):
        _warn_of_open_door(str(client.scheduler_info()["address"]))
        yield client


@contextlib.contextmanager
def gateway(name: str) -> Iterator[Client]:
    """Connect to a cluster of the Dask Gateway in Dask's configuration.

    name: name of the cluster; empty for the only one that is running.
    Raises InputError if dask-gateway is not installed, or there is no such cluster.
    """
    dask_gateway = optional_module("dask_gateway", f"--scheduler gateway://{name}", "dask-gateway")
    load_defaults()
    with dask_gateway.Gateway() as there:
        running = [cluster.name for cluster in there.list_clusters()]
        if name not in running and (name or len(running) != 1):
            raise InputError(
                "cluster.gateway_name_unknown",
                f"there is no cluster {name!r}" if name else f"{len(running)} clusters are running",
                where=f"--scheduler gateway://{name}",
                expected=f"one of {', '.join(running) or 'your clusters, of which none is running'}",
                remedy="start one with dask_gateway.Gateway().new_cluster(), and give its name",
            )
        with there.connect(name or running[0]) as cluster, cluster.get_client() as client:
            yield client


@contextlib.contextmanager
def queue(
    kind: str, jobs: int, secrets: Path, most: int | None = None, asked: Mapping[str, Any] | None = None
) -> Iterator[Client]:
    """Start workers by a batch system, configured in ~/.config/dask/jobqueue.yaml.

    kind: batch system, such as slurm.
    jobs, most: initial number of batch jobs, and maximum while there is work for them.
    secrets: folder visible to all hosts, for the session's key.
    asked: walltime, queue, account, memory, which override the configuration.
    """
    with uninterrupted(_queue_session(kind, secrets, asked or {})) as (cluster, client):
        let_resize(cluster, jobs, most or jobs)
        try:
            client.sync(_submitted, cluster)
        except (RuntimeError, OSError) as error:
            for job in cluster.workers.values():  # otherwise Dask could not close the cluster
                job.status = Status.failed
            raise InputError(
                "cluster.job_not_submitted",
                " ".join(str(error).split()),
                where=f"--queue {kind}",
                expected="a batch system that takes the job",
                remedy=_remedy(error),
            ) from None
        yield client


async def _submitted(cluster: Any) -> None:
    await cluster
    for job in cluster.workers.values():  # a refused job is tried once more, and raises the reason
        await job


@contextlib.contextmanager
def _queue_session(kind: str, secrets: Path, asked: Mapping[str, Any]) -> Iterator[tuple[Any, Client]]:
    with (
        tempfile.TemporaryDirectory(prefix=KEY_FOLDERS, dir=secrets, ignore_cleanup_errors=True) as folder,
        _queue_cluster(kind, folder, asked) as cluster,
        Client(cluster) as client,
    ):
        yield cluster, client


def job_script(kind: str, asked: Mapping[str, Any] | None = None) -> str:
    """Script that would be submitted to a batch system, with placeholder paths of the key's files."""
    with (
        tempfile.TemporaryDirectory(prefix="toppling-") as folder,
        _queue_cluster(kind, folder, asked or {}) as cluster,
    ):
        return cluster.job_script()


def _queue_cluster(kind: str, secrets: str, asked: Mapping[str, Any]) -> Any:
    load_defaults()
    configured = dask.config.get(f"jobqueue.{kind}", None) or {}
    has_certificates = dask.config.get("distributed.comm.require-encryption", None)
    jobqueue = optional_module("dask_jobqueue", f"--queue {kind}", "'toppling[hpc]'")
    # One process per core: the engine is single-threaded per process.
    cores = configured.get("cores") or 1
    names = {"account": "project"} if kind in ("sge", "lsf", "oar") else {}
    given = {names.get(name, name): value for name, value in asked.items() if value is not None}
    chosen = {VARIABLE: "1"} | {name: os.environ.get(name) for name in KERNEL_VARIABLES}
    exports = [f"export {name}={shlex.quote(value)}" for name, value in chosen.items() if value]
    prologue = [line for name in ("env-extra", "job-script-prologue") for line in configured.get(name) or []]
    if configured.get("env-extra"):  # else dask-jobqueue warns that it ignores these lines
        dask.config.set({f"jobqueue.{kind}.env-extra": None})
    try:
        with signals_blocked():  # shields the commands that submit and cancel batch jobs
            named = {name.lower(): name for name in vars(jobqueue)}
            return getattr(jobqueue, named[f"{kind}cluster"])(
                cores=cores,
                processes=cores,
                security=None if has_certificates else write_key(Path(secrets)),
                job_script_prologue=[*prologue, *exports],
                worker_extra_args=[*CLOSED.split(), *(configured.get("worker-extra-args") or [])],
                scheduler_options={"dashboard_address": "127.0.0.1:0"}
                | (configured.get("scheduler-options") or {}),
                **given,
            )
    except (ValueError, KeyError, RuntimeError, TypeError) as error:
        raise InputError(
            "cluster.queue_unconfigured",
            " ".join(str(error).split()),
            where=f"--queue {kind}",
            expected=f"cores, memory, walltime ... in ~/.config/dask/jobqueue.yaml under jobqueue: {kind}:",
            remedy=_remedy(error),
        ) from None


def _remedy(error: Exception) -> str:
    if "network interface" in str(error):
        return "name one of them for this host with scheduler-options: {interface: ...}"
    return "see https://jobqueue.dask.org/en/latest/configuration.html; --dry-run prints the job script"


def _warn_of_open_door(address: str) -> None:
    """Warn of a scheduler without authentication that is reachable from other machines."""
    scheme, _, location = address.partition("://")
    host = location.rpartition(":")[0].strip("[]")
    if scheme in _ENCRYPTED or host == "localhost" or host.startswith("127.") or host == "::1":
        return
    log.warning(
        "%s asks for no key: whoever reaches it on the network can run code as the user of its workers. Start it "
        "with certificates (docs/faults.md, 'Who is let in') and give tls://..., or bind it to 127.0.0.1",
        address,
    )


def _unreachable(where: str, what: str) -> InputError:
    return InputError(
        "cluster.unreachable",
        what,
        where=f"scheduler {where}",
        expected="a Dask scheduler that answers there, with the same kind of security",
        remedy="check the address; start one with 'dask scheduler'; if it asks for certificates see docs/faults.md",
    )
