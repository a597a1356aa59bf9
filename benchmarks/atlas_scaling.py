"""100 rocks by 1,000 seismograms by 5 levels, played on many workers against measured costs: what binds, and where.

    .venv/bin/python benchmarks/atlas_scaling.py                        # half a million jobs of 0.1 s on 16 to 1,000
    .venv/bin/python benchmarks/atlas_scaling.py --seconds-per-job 0.02 --ready-s 0.3
    .venv/bin/python benchmarks/atlas_scaling.py --client-us 300        # as if the client took so long for a job

Client and scheduler are servers with one core each: batches wait for them. What the client needs for a job (make its
specification, send it, check its row, store it) is measured first, in this process; what a task costs the scheduler is
from scaling.py. A worker makes a rock ready whenever it gets a batch of a rock that it does not hold.
"""

import argparse
import heapq
import pickle
import tempfile
import time
from collections import deque
from pathlib import Path

import numpy as np
from scaling import SEED, inputs, pretended_row

from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.orchestrator.dispatch import JOBS_IN_BATCH, Batch, Dispatch
from toppling.orchestrator.execution import RunProgress, budget_s, checked, room_for
from toppling.orchestrator.order import taking_turns
from toppling.orchestrator.plan import plan
from toppling.orchestrator.task import ROCKS_KEPT
from toppling.results.store import write_part

ROCKS, RECORDS, LEVELS = 100, 1000, 5
WORKERS = (16, 64, 256, 512, 1000)
TASK_S = 1.8e-3
"""Of the scheduler, for one task (scaling.py, pretended)."""
HEARTBEAT_S, HEARTBEATS_A_SECOND = 0.8e-3, 0.17
"""Of the scheduler, for each; a second and worker, where there are many."""
TIMED_JOBS = 20_000


def client_s() -> float:
    """Processor time of the client for a job: specification, message, row, check, count, store."""
    with tempfile.TemporaryDirectory() as name:
        campaign = inputs(Path(name), 140, 8)
        planned = plan(campaign, Scene.load(campaign.scene), Ensemble.load(campaign.ensemble))
        rows = planned.pending(set())[:TIMED_JOBS]
        answers = [pretended_row(planned.spec(int(row))) for row in rows]
        sent = [pickle.dumps(answers[at : at + 60]) for at in range(0, len(rows), 60)]
        progress, unstored = RunProgress(len(rows), 0), []
        (Path(name) / "run").mkdir()
        began = time.process_time()
        for at, message in zip(range(0, len(rows), 60), sent, strict=True):
            specs = [planned.spec(int(row)) for row in rows[at : at + 60]]
            pickle.dumps(specs)
            found = checked([planned.spec(int(row)) for row in rows[at : at + 60]], pickle.loads(message))
            progress.count(found)
            unstored += [{**row, "rock": None, "attempt": 1} for row in found]
        write_part(Path(name) / "run", unstored)
        return (time.process_time() - began) / len(rows)


def played(
    cost_s: np.ndarray, scene: np.ndarray, workers: int, ready_s: float, per_job_s: float
) -> dict[str, float]:
    """Play a run against a clock; what it took, and the share that each part was busy."""
    orders = [np.flatnonzero(scene == number) for number in range(scene.max() + 1)]
    dispatch = Dispatch(taking_turns(orders), cost_s, scene=scene)
    budget, room = budget_s(workers, rocks=2), JOBS_IN_BATCH
    heartbeats = 1.0 / (1.0 - HEARTBEAT_S * HEARTBEATS_A_SECOND * workers)
    task_s = TASK_S * heartbeats
    ready: deque[tuple[float, Batch]] = deque()
    held: list[deque[int]] = [deque(maxlen=ROCKS_KEPT) for _ in range(workers)]
    free = [(0.0, worker) for worker in range(workers)]
    client = scheduler = client_busy = scheduler_busy = making_ready = 0.0
    ended, flying, tasks = np.zeros(workers), 0, 0
    while True:
        while flying + len(ready) < 2 * workers + 2 and (batch := dispatch.next_batch(workers, room)):
            client = max(client, free[0][0]) + 0.5 * per_job_s * len(batch.jobs)
            client_busy += 0.5 * per_job_s * len(batch.jobs)
            ready.append((client, batch))
        if not ready:
            break
        available, batch = ready.popleft()
        now, worker = heapq.heappop(free)
        scheduler = max(scheduler, now, available) + task_s
        scheduler_busy += task_s
        rock = int(scene[batch.jobs[0]])
        preparing = 0.0 if rock in held[worker] else ready_s
        if preparing:
            held[worker].append(rock)
        spent = np.cumsum(cost_s[list(batch.jobs)])
        done = min(int(np.searchsorted(spent, budget)) + 1, len(spent))
        ended[worker] = scheduler + preparing + spent[done - 1]
        making_ready += preparing
        dispatch.came_back(batch, done)
        room = room_for([{"wall_s": cost} for cost in cost_s[list(batch.jobs[:done])]], budget)
        client, client_busy = client + 0.5 * per_job_s * done, client_busy + 0.5 * per_job_s * done
        tasks += 1
        heapq.heappush(free, (ended[worker], worker))
    took, work = float(max(ended.max(), client)), float(cost_s.sum())
    return {
        "workers": workers, "minutes": took / 60, "share_of_ideal": work / workers / took,
        "client_busy": client_busy / took, "scheduler_busy": scheduler_busy / took,
        "making_ready": making_ready / (took * workers), "idle_at_end": float(1 - ended.mean() / took),
        "jobs_a_second": len(cost_s) / took, "tasks_a_second": tasks / took,
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds-per-job", type=float, default=0.1)
    parser.add_argument("--ready-s", type=float, default=0.32, help="to load a rock and let it settle")
    parser.add_argument("--client-us", type=float, help="of the client for a job; measured unless given")
    given = parser.parse_args()
    per_job_s = given.client_us * 1e-6 if given.client_us else client_s()
    print(f"client: {1e6 * per_job_s:.0f} us a job, {1 / per_job_s:,.0f} jobs a second")
    scene = np.repeat(np.arange(ROCKS), RECORDS * LEVELS)
    cost = np.random.default_rng(SEED).lognormal(0.0, 0.8, len(scene))
    cost *= given.seconds_per_job / cost.mean()
    for workers in WORKERS:
        told = played(cost, scene, workers, given.ready_s, per_job_s)
        print("  " + "  ".join(f"{name} {value:,.3g}" for name, value in told.items()), flush=True)


if __name__ == "__main__":
    main()
