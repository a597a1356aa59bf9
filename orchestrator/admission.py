"""Which workers may take part in a run: those that load its assets with the versions of the client."""

import logging
import time
from contextlib import suppress
from pathlib import Path

from distributed import Client, LocalCluster

from toppling.models.errors import InputError
from toppling.orchestrator.context import RunError
from toppling.orchestrator.delivery import offer
from toppling.orchestrator.processor import unlike
from toppling.orchestrator.task import Order, check
from toppling.orchestrator.upkeep import Upkeep

log = logging.getLogger(__name__)

NOBODY = "every worker has died and none comes back"
REPLACE_AFTER_S = 10.0
"""Dask has this long to bring back a worker that died: several times what a start takes on a busy machine."""

NOBODY_AFTER_S = 90.0
"""A local run without any worker for this long ends instead of waiting for ever."""


def check_workers(client: Client, *orders: Order) -> None:
    """Offer the assets of orders to workers that see no folder, and let every one present load those of the first.

    Raises
    ------
    InputError
        If one cannot, because of another version or because it has no way to the run's scene and ensemble.
    RunError
        If the workers of a local cluster die whenever they start.
    """
    _wait_for_a_worker(client)
    shared = {}
    for one in orders:
        shared[one.scene_id] = Path(one.folder) / one.scene_place
        shared[one.ensemble_id] = Path(one.folder) / one.ensemble_place
    if not isinstance(client.cluster, LocalCluster):
        offer(client, {name: place for name, place in shared.items() if place.is_dir()})
    answers = client.run(check, orders[0], on_error="return")
    # Of a worker that just dies or just comes (OSError), its first task will tell. One that lacks the program cannot
    # even read what it is asked, and Dask says so.
    unfit = (
        answer
        for answer in answers.values()
        if isinstance(answer, Exception) and not isinstance(answer, OSError)
    )
    reasons = sorted({str(answer) for answer in unfit})
    if reasons:
        raise InputError(
            f"{len(reasons)} of {len(answers)} workers are unfit for this run: " + "; ".join(reasons[:5]),
            where="cluster",
            expected="the client's versions, and a folder in which each host can keep what it is sent",
            remedy="install the same toppling everywhere; name a folder that workers can write with TOPPLING_CACHE",
        )
    if remark := unlike([answer for answer in answers.values() if isinstance(answer, str)]):
        log.warning("%s", remark)


def _wait_for_a_worker(client: Client) -> None:
    """Wait for the first: for ever where somebody else starts it, such as a batch system."""
    began, told, upkeep = time.monotonic(), False, Upkeep(client)
    while not client.nthreads():
        with suppress(TimeoutError):
            client.wait_for_workers(1, timeout=REPLACE_AFTER_S)
            return
        if not told:
            log.warning("no worker has come yet: waiting")
            told = True
        if upkeep.gone():
            if time.monotonic() - began > NOBODY_AFTER_S:
                raise RunError(NOBODY)
            upkeep.replace()
