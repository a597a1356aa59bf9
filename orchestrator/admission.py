"""Checks that workers have the client's versions and can load a run's scenes and ensembles."""

import errno
import logging
import socket
import ssl
import time
from collections.abc import Callable, Iterable
from concurrent.futures import CancelledError
from contextlib import suppress
from pathlib import Path
from typing import Any

from distributed import Client

from toppling.models.errors import InputError
from toppling.orchestrator.cluster_supervisor import ClusterSupervisor
from toppling.orchestrator.code_identity import unlike
from toppling.orchestrator.compiling import COMPILING
from toppling.orchestrator.context import RunError
from toppling.orchestrator.delivery import NotDeliveredError, StorageError, send
from toppling.orchestrator.leaving import let_leave_in_order
from toppling.orchestrator.task import RunKey, check, must_compile

log = logging.getLogger(__name__)

LOST = "the connection to the scheduler is lost"
BACK_WITHIN_S = 120.0
"""Time within which a lost external scheduler may be restarted, s."""

_UNREACHABLE = (errno.EHOSTUNREACH, errno.ENETUNREACH, errno.ENETDOWN, errno.EHOSTDOWN, errno.EADDRNOTAVAIL)
_LOOK_S, _WAIT_S = 0.1, 1.0
"""Interval between attempts at a check, and timeout of a wait for the first worker, s."""


def may_be_lost(error: BaseException) -> bool:
    """Whether an error may be due to a lost connection, rather than to files or limits of this machine."""
    if not isinstance(error, OSError):
        return isinstance(error, CancelledError)
    of_network = isinstance(error, ConnectionError | TimeoutError | socket.gaierror | ssl.SSLError)
    return of_network or error.errno is None or error.errno in _UNREACHABLE  # Dask's own have no number


def make_ready(client: Client, *run_keys: RunKey, tell: Callable[[str], object] = lambda _: None) -> None:
    """Prepare a cluster for the jobs of runs: :func:`check_workers`, and workers that shut down gracefully.

    A lost external scheduler is awaited at its address.

    Raises InputError, RunError as `check_workers`; RunError also if the scheduler is lost.
    """
    end = None
    while client.status in ("running", "connecting"):
        try:
            if client.status == "running":
                # First, because it reports workers that cannot load the plugin for graceful shutdown.
                check_workers(client, *run_keys, tell=tell)
                return let_leave_in_order(client)
        except OSError as error:
            if not may_be_lost(error):
                raise
            # A worker that leaves during the check also raises; the client then keeps running.
            log.debug("%s", error)
        if client.cluster is not None and client.status != "running":  # our own scheduler is not restarted
            raise RunError(LOST)
        if end is None:
            end = time.monotonic() + BACK_WITHIN_S
            log.warning("%s: waiting %g s for it to come back", LOST, BACK_WITHIN_S)
        if time.monotonic() > end:
            break
        time.sleep(_LOOK_S)
    raise RunError(f"{LOST}, and none came back within {BACK_WITHIN_S:g} s")


def check_workers(client: Client, *run_keys: RunKey, tell: Callable[[str], object] = lambda _: None) -> None:
    """Let every worker load the assets of the first run key; hosts that lack assets of any key receive them.

    tell: receives the activity if workers must compile first.
    Raises InputError if a worker has other versions, or no access to the run's scene and ensemble.
    Raises RunError if the workers of a local cluster repeatedly die at their start.
    """
    _wait_for_a_worker(client)
    if True in client.run(must_compile, on_error="return").values():
        tell(COMPILING)
    answers = client.run(check, run_keys[0], on_error="return")
    lacking = {
        worker: NotDeliveredError(answer.host, worker)
        for worker, answer in answers.items()
        if isinstance(answer, NotDeliveredError)
    }
    if lacking:
        problem = deliver(client, lacking.values(), run_keys)
        answers |= client.run(check, run_keys[0], on_error="return", workers=list(lacking))
        answers |= {worker: StorageError(problem) for worker in lacking if problem and worker in answers}
    # A worker that is dying or joining (OSError) is checked by its first task. One without this program cannot
    # deserialise the request, which Dask reports.
    unfit = [
        found for found in answers.values() if isinstance(found, Exception) and not isinstance(found, OSError)
    ]
    if reasons := sorted(set(map(str, unfit))):
        raise InputError(
            "cluster.workers_unfit",
            f"{len(reasons)} of {len(answers)} workers are unfit for this run: " + "; ".join(reasons[:5]),
            where="cluster",
            expected="the client's versions, and a folder in which each host can keep what it is sent",
            remedy="install the same toppling everywhere; name a folder that workers can write with TOPPLING_CACHE",
        )
    if remark := unlike([answer for answer in answers.values() if isinstance(answer, str)]):
        log.warning("%s", remark)


def deliver(client: Client, lacking: Iterable[NotDeliveredError], run_keys: Iterable[RunKey]) -> str:
    """Send the scenes and ensembles of run keys to hosts that lack them; returns why a host cannot store them.

    Raises RunError if they are missing in the run's folder.
    """
    places: dict[str, Path] = {}
    for key in run_keys:
        places[key.scene_id] = Path(key.folder) / key.scene_place
        places[key.ensemble_id] = Path(key.folder) / key.ensemble_place
    if missing := [str(place) for place in places.values() if not place.is_dir()]:
        raise RunError(f"{missing[0]} is gone: was the run's folder removed or renamed?")

    def call(worker: str, function: Callable[..., Any], *given: Any) -> None:
        with suppress(OSError, ValueError, KeyError):  # the worker has left: another will ask
            client.run(function, *given, workers=[worker])

    try:
        send(call, lacking, places)
    except StorageError as error:
        return str(error)
    return ""


def _wait_for_a_worker(client: Client) -> None:
    """Wait for the first worker, without limit where an external system starts it."""
    supervisor = ClusterSupervisor(client)
    while not client.nthreads():
        with suppress(TimeoutError):
            client.wait_for_workers(1, timeout=_WAIT_S)
            return
        supervisor.look(0.0, 0)
