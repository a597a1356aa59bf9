"""How far a run scales: memory of a million jobs, cost of handing out and storing, a thousand pretended workers.

    .venv/bin/python benchmarks/scaling.py                              # all, a quarter of an hour
    .venv/bin/python benchmarks/scaling.py pretended --pretend 1000 10  # a thousand workers, jobs of ten seconds
    .venv/bin/python benchmarks/scaling.py study --seconds-per-job 0.5  # for an engine or a scene of another cost
    .venv/bin/python benchmarks/scaling.py study --run runs/first       # with the costs of a real run's jobs
    .venv/bin/python benchmarks/scaling.py atlas --client-us 300        # as if the client took so long for a job

The workers that are pretended are Dask's own, hundreds in a process; scheduler and client have processes of their own,
messages go over TCP, and only the engine is replaced by sleep. All share this machine's cores, so the rates are
lower limits; the cores that scheduler and client used say how far each would go on a core of its own.

The study and the atlas (100 rocks by 1,000 seismograms by 5 levels) are played against a clock. In the atlas client and
scheduler are servers with one core each, for which batches wait, and a worker makes a rock ready whenever it gets a
batch of a rock that it does not hold. What the client needs for a job (make its specification, send it, check its row,
store it) is measured first, in this process; a task's cost to the scheduler is that of pretended runs.
"""

import argparse
import asyncio
import contextlib
import heapq
import math
import multiprocessing
import pickle
import resource
import tempfile
import threading
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from functools import cache
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import dask
import numpy as np
import psutil
import pyarrow as pa
import pyarrow.parquet as pq
from distributed import Client, Scheduler, Worker
from numpy.typing import NDArray

from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.motion import Motion
from toppling.models.motions.record import Record
from toppling.models.scene import Scene
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.cluster import load_defaults
from toppling.orchestrator.context import RunProgress, Work
from toppling.orchestrator.dispatch import FIRST_JOBS, Batch, Dispatch
from toppling.orchestrator.execution import Asked, Execution, budget_s, room_for
from toppling.orchestrator.plan import Plan, balanced_order, plan_of, taking_turns
from toppling.orchestrator.run_folder import prepare
from toppling.orchestrator.task import ROCKS_CACHED, RunKey, versions
from toppling.results.schema import SCHEMA
from toppling.results.store import compact, finished_ids, write_part

LEVELS, AZIMUTHS, RECORDS = 19, 8, 140
STUDY = LEVELS * AZIMUTHS * RECORDS
WORKERS = (1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1000)
SEED = 1
CREWS = 4
"""Processes that the pretended workers share; each has one event loop, which some hundred workers do not fill."""

START_S = 600.0
TASKS_AT_ONCE = 5000
"""Tasks of the run whose jobs take no time: what scheduler and client can do at most."""

PRETENDED = ((1, 0.1), (10, 0.1), (100, 0.1), (300, 1.0), (1000, 1.0), (1000, 10.0), (100, 0.0))
"""Workers and seconds a job; 0 for answers at once."""

ATLAS, ATLAS_WORKERS = (100, 1000, 5), (16, 64, 256, 512, 1000)
"""Rocks, records and levels."""

TASK_S, HEARTBEAT_S, HEARTBEATS_A_SECOND = 1.8e-3, 0.8e-3, 0.17
"""Cost to the scheduler of a task and of a heartbeat; heartbeats of many workers."""

READY_S = 0.32
"""To load a rock and let it settle."""

TIMED_JOBS = 20_000

READING = threading.Lock()

QUIET = {
    "distributed.admin.tick.interval": "60s",  # else 50 times a second: a core for 500 workers
    "distributed.admin.tick.limit": "1h",
    "distributed.admin.system-monitor.interval": "60s",
    "distributed.worker.profile.enabled": False,
    "distributed.scheduler.active-memory-manager.start": False,
}
"""What each worker does beside its work; on hosts of their own it costs nobody else anything."""


def pulse(period_s: float) -> Motion:
    """Sine of acceleration along x, 2 m/s2."""
    time_s = np.arange(0.0, period_s, 0.01)
    return Motion(np.outer(2.0 * np.sin(2.0 * np.pi * time_s / period_s), [1.0, 0.0, 0.0]), 0.01)


def planned_in(folder: Path, records: int, azimuths: int) -> Plan:
    """Plan a campaign of so many records and azimuths at 19 levels, written into a folder."""
    Scene.block(0.15, 0.2, 0.6).save(folder / "scene")
    pulses = [Record.of(f"R{n:04d}", pulse(0.5 + 2.0 * n / records)) for n in range(records)]
    Ensemble.write(folder / "ensemble", pulses)
    (folder / "campaign.toml").write_text(
        'scene = "scene"\nensemble = "ensemble"\npga_m_s2 = { start = 1, stop = 19, step = 1 }\nfriction = [0.9]\n'
        f"azimuth_deg = {[round(360 * n / azimuths, 6) for n in range(azimuths)]}\n"
    )
    return plan_of(Campaign.read(folder / "campaign.toml"))


def million() -> dict[str, float]:
    """Plan, track, store and compact 1,000,160 jobs without a cluster."""
    with tempfile.TemporaryDirectory() as name:
        folder, began = Path(name), time.perf_counter()
        planned = planned_in(folder, RECORDS, 376)
        result = {"jobs": len(planned), "plan_s": time.perf_counter() - began, "plan_mb": peak_mb()}
        run = folder / "run"
        prepare(run, planned, {})
        pending = planned.pending(set())
        dispatch = Dispatch(pending, planned.columns["duration_s"])
        progress, asked = RunProgress(len(planned), 0), Asked(planned, folder)
        began, count = time.perf_counter(), 0
        unstored: list[pa.Table] = []
        while batch := dispatch.next_batch(1, room=10_000):
            rows = pretended_rows(asked, np.array(batch.jobs))
            progress.count(rows)
            unstored, count = [*unstored, rows], count + len(rows)
            if count > 20_000:
                write_part(run, pa.concat_tables(unstored))
                unstored, count = [], 0
        write_part(run, pa.concat_tables(unstored))
        result |= {"jobs_a_second": len(planned) / (time.perf_counter() - began), "track_mb": peak_mb()}
        began = time.perf_counter()
        finished_ids(run, planned.ids)
        result |= {"resume_s": time.perf_counter() - began, "resume_mb": peak_mb()}
        began = time.perf_counter()
        compact(run)
        return result | {"compact_s": time.perf_counter() - began, "compact_mb": peak_mb()}


def peak_mb() -> float:
    """Greatest memory of this process so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def pretended_rows(asked: Asked, jobs: NDArray[np.int64], wall_s: float = 0.0) -> pa.Table:
    """Rows that jobs could have; every column is filled, as a real one's."""
    known = asked.expected(jobs)
    toppled, count = known["level_pga_m_s2"] > 9, len(jobs)
    numbers = (
        "max_tilt_deg",
        "residual_tilt_deg",
        "residual_yaw_deg",
        "slip_m",
        "penetration_m",
        "simulated_s",
    )
    fallen = {
        name: np.where(toppled, value, np.nan)
        for name, value in (
            ("topple_time_s", 1.0),
            ("falls_toward_deg", 2.0),
            ("falls_toward_bearing_deg", 88.0),
        )
    }
    columns = known | fallen | dict.fromkeys(numbers, known["level_pga_m_s2"] + 0.1) | {
        "toppled": toppled, "outcome": np.where(toppled, "toppled", "stands"),
        **{name: [value] * count for name, value in {
            "status": "ok", "ended_by": "rest", "steps": 1000, "time_step_s": 0.001, "wall_s": wall_s,
            "worker": "host:1", "finished_at": datetime.now(UTC),
        }.items()},
    }  # fmt: skip
    arrays = [
        pa.array(columns[field.name], field.type, from_pandas=True)
        if field.name in columns
        else pa.nulls(count, field.type)
        for field in SCHEMA
    ]
    return pa.Table.from_arrays(arrays, schema=SCHEMA)


class Pretend:
    """A worker's task that sleeps as long as the jobs would take, or gives the answer at once."""

    def __init__(self, asked: Asked, plan: Plan, seconds_per_job: float) -> None:
        self.path = asked.folder / "answers.parquet"
        pq.write_table(pretended_rows(asked, np.arange(len(plan)), seconds_per_job), self.path)
        self.seconds_per_job = seconds_per_job

    def __call__(self, _key: RunKey, _settings: Mapping[str, Any], jobs: pa.Table, budget: float) -> pa.Table:
        """Do what fits into the budget, as the true task does."""
        with READING:  # once in a process, not once in each of its workers' threads
            answers, places = answers_in(self.path)
        # With no time for a job one a task, as if it took the task's whole time.
        count = (
            min(len(jobs), max(1, math.ceil(budget / self.seconds_per_job))) if self.seconds_per_job else 1
        )
        time.sleep(count * self.seconds_per_job)
        taken = answers.take([places[job] for job in jobs["job_id"][:count].to_pylist()])
        return taken.combine_chunks().cast(SCHEMA)


@cache
def answers_in(path: Path) -> tuple[pa.Table, dict[str, int]]:
    """Rows of all jobs, and where each lies, once in a process."""
    answers = pq.read_table(path)
    return answers, {job: place for place, job in enumerate(answers["job_id"].to_pylist())}


def be_scheduler(expected: Connection) -> None:
    """Be a scheduler with the project's settings, and tell its address."""

    async def serve() -> None:
        async with Scheduler(host="127.0.0.1", port=0, dashboard=False) as scheduler:
            expected.send(scheduler.address)
            await scheduler.finished()

    load_defaults()
    asyncio.run(serve())


def be_workers(address: str, count: int) -> None:
    """Be so many workers of one thread each."""

    async def serve() -> None:
        workers = [
            Worker(address, host="127.0.0.1", nthreads=1, memory_limit=0, dashboard=False)
            for _ in range(count)
        ]
        for worker in workers:
            await worker
        await asyncio.gather(*(worker.finished() for worker in workers))

    load_defaults()
    dask.config.set(QUIET)
    asyncio.run(serve())


@contextlib.contextmanager
def pretended_cluster(workers: int) -> Iterator[tuple[Client, dict[str, list[psutil.Process]]]]:
    """Scheduler and workers in processes of their own; yields a client, and whose processes are whose."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    scheduler = context.Process(target=be_scheduler, args=(there,), daemon=True)
    scheduler.start()
    address = here.recv()
    share, left = divmod(workers, min(workers, CREWS))
    counts = [share + (n < left) for n in range(min(workers, CREWS))]
    crews = [context.Process(target=be_workers, args=(address, count), daemon=True) for count in counts]
    for crew in crews:
        crew.start()
    try:
        with Client(address) as client:
            client.wait_for_workers(workers, timeout=START_S)
            crew_processes = [psutil.Process(crew.pid) for crew in crews]
            of_scheduler = [psutil.Process(scheduler.pid)]
            yield client, {"scheduler": of_scheduler, "client": [psutil.Process()], "workers": crew_processes}
    finally:
        for process in (*crews, scheduler):
            process.kill()
            process.join()


def cpu_s(processes: Sequence[psutil.Process]) -> float:
    """Time that processes have used so far."""
    return sum(sum(process.cpu_times()[:2]) for process in processes)


def pretended_run(workers: int, seconds_per_job: float, seconds: float) -> dict[str, float]:
    """Run as many jobs as so many workers can do in so many seconds, and tell how fast it went amidst the run."""
    load_defaults()
    per_worker = seconds / seconds_per_job if seconds_per_job else TASKS_AT_ONCE / workers
    with tempfile.TemporaryDirectory() as name, pretended_cluster(workers) as (client, processes):
        folder = Path(name)
        planned = planned_in(folder, 40, max(1, round(workers * per_worker / 40 / LEVELS)))
        run = folder / "run"
        prepare(run, planned, {})
        seen: list[tuple[float, int]] = []
        before, began = {who: cpu_s(theirs) for who, theirs in processes.items()}, time.perf_counter()
        pending = planned.pending(set())
        work = Work(
            planned, run, versions(), client,
            lambda progress: seen.append((time.perf_counter(), progress.done)), RunProgress(len(planned), 0),
        )  # fmt: skip
        execution = Execution(work, pending, Pretend(Asked(planned, run), planned, seconds_per_job))
        execution()
        took = time.perf_counter() - began
        used = {f"{who}_cores": (cpu_s(theirs) - before[who]) / took for who, theirs in processes.items()}
    rate = rate_amidst(seen)
    result = {"workers": workers, "s_a_job": seconds_per_job, "jobs": len(planned), "took_s": took}
    result |= {"jobs_a_second": rate, "tasks_a_second": execution.tasks / took}
    if seconds_per_job:
        result["share_of_ideal"] = rate * seconds_per_job / workers
    return result | used


def rate_amidst(seen: Sequence[tuple[float, int]]) -> float:
    """Jobs a second in the middle half of a run: neither the first batches nor the tail tell how far it scales."""
    moments, done = map(np.array, zip(*seen, strict=True))
    first, last = np.searchsorted(done, [done[-1] / 4, 3 * done[-1] / 4])
    return float((done[last] - done[first]) / max(moments[last] - moments[first], 1e-9))


def client_s() -> float:
    """Processor time of the client for a job: specification, message, row, check, count, store."""
    with tempfile.TemporaryDirectory() as name:
        planned = planned_in(Path(name), RECORDS, AZIMUTHS)
        rows = planned.pending(set())[:TIMED_JOBS]
        asked, size = Asked(planned, Path(name)), 100
        sent = [
            pickle.dumps(pretended_rows(asked, rows[at : at + size], 0.02))
            for at in range(0, len(rows), size)
        ]
        progress, unstored = RunProgress(len(rows), 0), []
        (Path(name) / "run").mkdir()
        began = time.process_time()
        for at, message in zip(range(0, len(rows), size), sent, strict=True):
            pickle.dumps(planned.batch(rows[at : at + size]))
            found, wrong = asked.checked(rows[at : at + size], pickle.loads(message))
            assert not wrong
            progress.count(found)
            unstored.append(found)
        write_part(Path(name) / "run", pa.concat_tables(unstored))
        return (time.process_time() - began) / len(rows)


def played(
    cost_s: NDArray[np.float64],
    workers: int,
    length: NDArray[np.float64],
    scene: NDArray[np.int64] | None = None,
    per_job_s: float = 0.0,
) -> dict[str, float]:
    """Play a run of jobs in that order against a clock; what it took, and the share that each part was busy.

    scene: of an atlas the rock of each job; scheduler and client then take time too.
    per_job_s: of the client.
    """
    rock = np.zeros(len(cost_s), np.int64) if scene is None else scene
    order = taking_turns([np.flatnonzero(rock == number) for number in range(rock.max() + 1)])
    dispatch, budget = Dispatch(order, length, scene=rock), budget_s(workers, rocks=rock.max() + 1)
    of_atlas, room = scene is not None, FIRST_JOBS
    task_s = of_atlas * TASK_S / (1.0 - HEARTBEAT_S * HEARTBEATS_A_SECOND * workers)
    ready: deque[tuple[float, Batch]] = deque()
    held: list[deque[int]] = [deque(maxlen=ROCKS_CACHED) for _ in range(workers)]
    free = [(0.0, worker) for worker in range(workers)]
    client = scheduler = making_ready = 0.0
    ended, tasks, handled = np.zeros(workers), 0, 0
    while True:
        # As many wait on the scheduler as work, and two more.
        while len(ready) < workers + 2 and (batch := dispatch.next_batch(workers, room)):
            client = max(client, free[0][0]) + 0.5 * per_job_s * len(batch.jobs)
            ready.append((client, batch))
            handled += len(batch.jobs)
        if not ready:
            break
        (available, batch), (now, worker) = ready.popleft(), heapq.heappop(free)
        scheduler = max(scheduler, now, available) + task_s if of_atlas else now
        first = int(rock[batch.jobs[0]])
        preparing = READY_S if of_atlas and first not in held[worker] else 0.0
        if preparing:
            held[worker].append(first)
        spent = np.cumsum(cost_s[list(batch.jobs)])
        done = min(int(np.searchsorted(spent, budget)) + 1, len(spent))
        ended[worker] = scheduler + preparing + spent[done - 1]
        dispatch.came_back(batch, done)
        room = room_for(done, spent[done - 1], budget)
        client, making_ready = client + 0.5 * per_job_s * done, making_ready + preparing
        tasks, handled = tasks + 1, handled + done
        heapq.heappush(free, (ended[worker], worker))
    took = float(max(ended.max(), client))
    return {
        "workers": workers, "minutes": took / 60, "share_of_ideal": cost_s.sum() / workers / took,
        "idle_at_end": 1 - ended.mean() / took, "client_busy": 0.5 * per_job_s * handled / took,
        "scheduler_busy": task_s * tasks / took, "making_ready": making_ready / (took * workers),
        "jobs_a_second": len(cost_s) / took, "tasks_a_second": tasks / took,
    }  # fmt: skip


def study_costs(seconds_per_job: float, run: Path | None) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Cost of every job of the study and length of its record, in the order they go out: of a real run if given."""
    record_of = np.repeat(np.arange(RECORDS), LEVELS * AZIMUTHS)
    level, azimuth = np.divmod(np.tile(np.arange(LEVELS * AZIMUTHS), RECORDS), AZIMUTHS)
    order = balanced_order(record_of, level, azimuth, np.zeros_like(level))
    random = np.random.default_rng(SEED)
    if run is not None:
        from toppling.results.reader import open_run

        wall_s = open_run(run).table()["wall_s"].drop_null().to_numpy()
        length = np.repeat(np.sort(random.choice(wall_s, RECORDS))[::-1], LEVELS * AZIMUTHS)
        spread = random.choice(wall_s / wall_s.mean(), STUDY)
        return (length * spread)[order], length[order]
    # Longest record first, a factor of ten between the longest and the shortest; jobs of one record spread as e**N.
    length = np.repeat(np.geomspace(3.0, 0.3, RECORDS), LEVELS * AZIMUTHS)
    cost = length * random.lognormal(0.0, 0.8, STUDY)
    return (cost * seconds_per_job / cost.mean())[order], length[order]


def print_atlas(seconds_per_job: float, client_us: float | None) -> None:
    per_job_s = client_us * 1e-6 if client_us else client_s()
    print(f"an atlas of {math.prod(ATLAS)} jobs; the client takes {1e6 * per_job_s:.0f} us for each")
    rock = np.repeat(np.arange(ATLAS[0]), math.prod(ATLAS[1:]))
    cost = np.random.default_rng(SEED).lognormal(0.0, 0.8, len(rock))
    cost *= seconds_per_job / cost.mean()
    for workers in ATLAS_WORKERS:
        print_row(played(cost, workers, cost, rock, per_job_s))


def print_row(expected: dict[str, float]) -> None:
    print("  " + "  ".join(f"{name} {value:,.3g}" for name, value in expected.items()), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parts = ("million", "pretended", "study", "atlas")
    parser.add_argument(
        "parts", nargs="*", choices=[*parts, parts], default=parts, metavar="|".join(parts),
        help="all if none is named",
    )  # fmt: skip
    parser.add_argument("--seconds-per-job", type=float, default=0.1, help="of study and atlas")
    parser.add_argument("--run", type=Path, help="take the costs of the study's jobs from this run")
    parser.add_argument(
        "--pretend", type=float, nargs=2, action="append", metavar=("WORKERS", "SECONDS_A_JOB"),
        help="a pretended run, 0 seconds for answers at once; several may be given",
    )  # fmt: skip
    parser.add_argument("--seconds", type=float, default=60.0, help="length of each pretended run")
    parser.add_argument("--client-us", type=float, help="of the client for a job; measured unless given")
    given = parser.parse_args()
    if "million" in given.parts:
        print("a million jobs, planned, handed out, counted and stored in one process")
        with multiprocessing.get_context("spawn").Pool(1) as pool:  # whose greatest memory is the work's
            print_row(pool.apply(million))
    if "pretended" in given.parts:
        print(f"pretended workers, for {given.seconds:g} s if nothing held them up")
        for workers, seconds_per_job in given.pretend or PRETENDED:
            print_row(pretended_run(int(workers), seconds_per_job, given.seconds))
    if "study" in given.parts:
        cost, length = study_costs(given.seconds_per_job, given.run)
        print(f"the study's {STUDY} jobs, {cost.mean():.3f} s each on average, {cost.max():.1f} s at most")
        for number in WORKERS:
            print_row(played(cost, number, length))
    if "atlas" in given.parts:
        print_atlas(given.seconds_per_job, given.client_us)


if __name__ == "__main__":
    import scaling  # by which workers know what they are to do

    scaling.main()
