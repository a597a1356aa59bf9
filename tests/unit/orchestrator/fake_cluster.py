"""A cluster in no process but this one: batches are done in order, and faults strike where a test says."""

from collections import Counter, deque
from dataclasses import dataclass, field

import pyarrow as pa

from toppling.orchestrator.context import Answer
from toppling.orchestrator.delivery import NotDeliveredError
from toppling.results.schema import SCHEMA


@dataclass
class FakeCluster:
    """Workers that do `jobs_at_once` jobs of a batch, unless a fault is due.

    table: rows of all jobs of the plan.
    faults: called with a job's id and how often it has been begun; names what happens to its worker or row:
    "died", "left", "undelivered", "unfit", "cancelled", "lost" (the scheduler), "lie", "error" or None.
    """

    table: pa.Table
    faults: object = lambda job, begun: None
    workers: int = 2
    jobs_at_once: int = 5
    now_s: float = 0.0
    full_hosts: bool = False
    waiting: deque = field(default_factory=deque)
    begun: Counter = field(default_factory=Counter)
    keys: set = field(default_factory=set)
    requests: list = field(default_factory=list)

    def __post_init__(self):
        self.places = {job: place for place, job in enumerate(self.table["job_id"].to_pylist())}

    def monotonic(self):
        """The time, which passes only while answers are waited for."""
        return self.now_s

    def submit(self, task, calls):
        assert not self.keys & calls.keys(), "a key returns"
        self.keys |= calls.keys()
        self.waiting.extend(calls.items())

    def answers(self, timeout_s):
        self.now_s += timeout_s
        if not self.waiting:
            return []
        key, (_, _, jobs, _) = self.waiting.popleft()
        return [self._do(key, jobs["job_id"].to_pylist())]

    def _do(self, key, ids):
        for number, job in enumerate(ids[: self.jobs_at_once]):
            self.begun[job] += 1
            fault = self.faults(job, self.begun[job])
            if fault == "lost":
                self.waiting.clear()
                raise ConnectionError("the connection is lost")
            if fault == "lie":
                rows = self._rows(ids[: number + 1]).to_pylist()
                rows[-1]["pgv_m_s"] = 0.5
                return Answer(key, "rows", pa.Table.from_pylist(rows, schema=SCHEMA))
            if fault == "undelivered":
                return Answer(key, fault, NotDeliveredError("host", "worker 0"), "worker 0")
            if fault:
                return Answer(key, fault, RuntimeError(fault), "worker 0")
        return Answer(key, "rows", self._rows(ids[: self.jobs_at_once]))

    def _rows(self, ids):
        return self.table.take([self.places[job] for job in ids])

    def look(self, work_left_s, at_hand):
        """Do nothing, where `DaskCluster` replaces workers."""

    def threads(self):
        return self.workers

    def dismiss(self, worker):
        self.requests.append(("dismiss", worker))
        self.workers -= 1

    def deliver(self, lacking, run_keys):
        self.requests.append(("deliver", lacking.host))
        return "the disk is full" if self.full_hosts else ""

    def rejoin(self, run_keys, error):
        self.requests.append(("rejoin", str(error)))

    def cancel(self):
        self.requests.append(("cancel", len(self.waiting)))
        self.waiting.clear()
