"""A Dask client as the place where batches of jobs are done: handed out, answered, given back."""

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
from toppling.orchestrator.leaving import was_told_to_leave
from toppling.orchestrator.task import RunKey, UnfitWorkerError


class DaskCluster(ClusterSupervisor):
    """The workers of a client's scheduler, whoever started them."""

    def __init__(self, client: Client) -> None:
        super().__init__(client)
        self._absence = admission.Absence(client)
        self._futures: dict[str, Future] = {}
        self._answers: queue.SimpleQueue[Answer] = queue.SimpleQueue()

    def submit(self, task: Callable[..., Any], calls: Mapping[str, Sequence[Any]]) -> None:
        """Hand out calls of a task, each with its arguments, by keys that have never been used before."""
        # In one graph, or Dask would not take them for one group, which a key's first word names.
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
        """What has come back, the first of which is waited for; OSError or CancelledError: the scheduler is lost."""
        found: list[Answer] = []
        with suppress(queue.Empty):
            found.append(self._answers.get(timeout=timeout_s))
            while True:
                found.append(self._answers.get_nowait())
        if self._client.status != "running":
            raise ConnectionError(admission.LOST)
        return [known for one in found if (known := self._known(one))]

    def _known(self, answer: Answer) -> Answer | None:
        """An answer with its kind; None of a batch that has been forgotten."""
        future = self._futures.pop(answer.key, None)
        if future is None:
            return None
        future.release()
        error = answer.value
        if answer.kind == "cancelled":
            if self._client.cluster is None:
                raise CancelledError  # as Dask does with all when the scheduler is gone
            return answer
        if answer.kind == "error" and isinstance(error, KilledWorker):
            address = error.last_worker.address
            left = was_told_to_leave(self._client, address)
            return Answer(answer.key, "left" if left else "died", error, address)
        if isinstance(error, NotDeliveredError | UnfitWorkerError):
            kind = "undelivered" if isinstance(error, NotDeliveredError) else "unfit"
            return Answer(answer.key, kind, error, error.worker or "")
        return answer

    def threads(self) -> int:
        """Of all workers; that there have been none for long is told."""
        self._absence.look()
        return sum(self._client.nthreads().values())

    def processing(self) -> set[tuple[str, str]]:
        """Workers and the keys that each has at hand."""
        at_hand = self._client.processing().items()
        return {(worker, str(key[-1])) for worker, keys in at_hand for key in keys if isinstance(key, tuple)}

    def dismiss(self, worker: str) -> None:
        """Send a worker away."""
        self._client.retire_workers([worker], close_workers=True)

    def deliver(self, lacking: NotDeliveredError, run_keys: Sequence[RunKey]) -> str:
        """Send a host what the jobs of runs need; returns why it cannot keep it."""
        return admission.deliver(self._client, [lacking], run_keys)

    def rejoin(self, run_keys: Sequence[RunKey], error: BaseException) -> None:
        """Wait until there is a scheduler again, what was handed out being gone; RunError if there is none."""
        if self._client.cluster is not None:  # a scheduler in this process is not started again
            raise RunError(admission.LOST) from error
        self._futures.clear()
        admission.make_ready(self._client, *run_keys)

    def cancel(self) -> None:
        """Give up what is handed out."""
        with held_back():
            if self._futures and self._client.status == "running":
                with suppress(OSError):
                    self._client.cancel(list(self._futures.values()), force=True)
            self._futures.clear()
