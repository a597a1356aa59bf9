"""Execution of batches of jobs by a Dask client: submission, results, delivery of assets, cancellation."""

import asyncio
import queue
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from typing import Any

from distributed import Client, Future, KilledWorker

from toppling.orchestrator import admission
from toppling.orchestrator.cluster_supervisor import ClusterSupervisor
from toppling.orchestrator.context import Answer, RunError
from toppling.orchestrator.delivery import NotDeliveredError
from toppling.orchestrator.interrupt import held_back
from toppling.orchestrator.leaving import announced_exit
from toppling.orchestrator.task import RunKey, UnfitWorkerError, is_compiling

_ANSWER_S = 5.0
"""Time that a worker has to say whether it compiles, s."""


class DaskCluster(ClusterSupervisor):
    """Workers of a client's scheduler, started by this program or externally."""

    def __init__(self, client: Client) -> None:
        super().__init__(client)
        self._futures: dict[str, Future] = {}
        self._answers: queue.SimpleQueue[Answer] = queue.SimpleQueue()

    def submit(self, task: Callable[..., Any], calls: Mapping[str, Sequence[Any]]) -> None:
        """Submit calls of a task with their arguments, by keys that were never used before."""
        # In one graph, so that Dask treats them as one group, named by a key's first word.
        futures = self._client.map(
            task, *zip(*calls.values(), strict=True), key=[("shake", key) for key in calls], pure=False
        )
        loop = self._client.loop
        assert loop is not None  # as long as the client is open
        for key, future in zip(calls, futures, strict=True):
            self._futures[key] = future
            loop.add_callback(self._follow, key, future)

    async def _follow(self, key: str, future: Future) -> None:
        try:
            answer = Answer(key, "rows", await self._client.gather(future, asynchronous=True))
        except (asyncio.CancelledError, CancelledError) as error:
            answer = Answer(key, "cancelled", error)
        except Exception as error:
            answer = Answer(key, "error", error)
        self._answers.put(answer)

    def answers(self, timeout_s: float) -> list[Answer]:
        """Available results, after waiting for the first; OSError or CancelledError if the scheduler is lost."""
        found: list[Answer] = []
        with suppress(queue.Empty):
            found.append(self._answers.get(timeout=timeout_s))
            while True:
                found.append(self._answers.get_nowait())
        if self._client.status != "running":
            raise ConnectionError(admission.LOST)
        return [known for answer in found if (known := self._known(answer))]

    def _known(self, answer: Answer) -> Answer | None:
        """Classify the result of a batch; None for a batch that was forgotten."""
        future = self._futures.pop(answer.key, None)
        if future is None:
            return None
        future.release()
        error = answer.value
        if answer.kind == "cancelled":
            if self._client.cluster is None:
                raise CancelledError  # Dask cancels all futures when the scheduler is lost
            return answer
        if answer.kind == "error" and isinstance(error, KilledWorker):
            address = error.last_worker.address
            left = announced_exit(self._client, address)
            return Answer(answer.key, "left" if left else "died", error, address)
        if isinstance(error, NotDeliveredError | UnfitWorkerError):
            kind = "undelivered" if isinstance(error, NotDeliveredError) else "unfit"
            return Answer(answer.key, kind, error, error.worker or "")
        return answer

    def threads(self) -> int:
        """Number of threads of all workers."""
        return sum(self._client.nthreads().values())

    def processing(self) -> set[tuple[str, str]]:
        """Pairs of a worker and a key that it is processing."""
        at_hand = self._client.processing().items()
        return {(worker, str(key[-1])) for worker, keys in at_hand for key in keys if isinstance(key, tuple)}

    def compiling(self, workers: Sequence[str]) -> set[str]:
        """Those of some workers that compile at the moment; a worker that hangs does not answer."""
        asked = self._client.run(is_compiling, workers=list(workers), on_error="return", asynchronous=True)
        with suppress(TimeoutError, OSError, KeyError, ValueError):  # of workers that are gone
            answers = self._client.sync(asyncio.wait_for, asked, _ANSWER_S)
            return {worker for worker, answer in answers.items() if answer is True}
        return set()

    def dismiss(self, worker: str) -> None:
        """Remove a worker from the cluster."""
        self._client.retire_workers([worker], close_workers=True)

    def deliver(self, lacking: NotDeliveredError, run_keys: Sequence[RunKey]) -> str:
        """Send a host the assets of runs; returns why it cannot store them."""
        return admission.deliver(self._client, [lacking], run_keys)

    def rejoin(self, run_keys: Sequence[RunKey], error: BaseException) -> None:
        """Wait for a restarted scheduler, after all submitted work was lost; RunError if there is none."""
        if self._client.cluster is not None:  # a scheduler in this process is not restarted
            raise RunError(admission.LOST) from error
        self._futures.clear()
        admission.make_ready(self._client, *run_keys)

    def cancel(self) -> None:
        """Cancel all submitted work."""
        with held_back():
            if self._futures and self._client.status == "running":
                with suppress(OSError):
                    self._client.cancel(list(self._futures.values()), force=True)
            self._futures.clear()
