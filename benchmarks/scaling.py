"""How far a run scales: memory of a million jobs, cost of handing out and storing, a thousand pretended workers.

    .venv/bin/python benchmarks/scaling.py                        # all, some minutes
    .venv/bin/python benchmarks/scaling.py --seconds-per-job 0.5  # for an engine or a scene of another cost
    .venv/bin/python benchmarks/scaling.py --run runs/first       # with the costs of a real run's jobs

The workers that are pretended are Dask's own, with its scheduler and messages; only the engine is replaced by sleep.
They share this process and one core with scheduler and client, so what they show is a lower limit.
"""

import argparse
import heapq
import multiprocessing
import resource
import tempfile
import time
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path

import dask
import numpy as np
from distributed import Client, LocalCluster
from numpy.typing import NDArray

from models import Scene
from models.motions.ensemble import Ensemble
from models.motions.idealised import ricker
from models.motions.record import Record
from orchestrator.campaign import Campaign
from orchestrator.cluster import load_defaults
from orchestrator.dispatch import Dispatch
from orchestrator.folder import prepare
from orchestrator.plan import Plan, plan
from orchestrator.run import BATCH_BUDGET_S, Execution, Tally
from orchestrator.task import Order, Row, lost_row, versions
from results.store import compact, finished_ids, write_part
from workers.job import JobSpec

LEVELS, AZIMUTHS, RECORDS = 19, 8, 140
STUDY = LEVELS * AZIMUTHS * RECORDS
WORKERS = (1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1000)
SEED = 1
QUIET = {
    "distributed.admin.system-monitor.interval": "60s",
    "distributed.worker.profile.enabled": False,
    "distributed.scheduler.active-memory-manager.start": False,
}
"""What each worker does beside its work; on hosts of their own it costs nobody else anything."""


def inputs(folder: Path, records: int, azimuths: int) -> Campaign:
    """Write a campaign of so many records and azimuths at 19 levels."""
    Scene.block(0.15, 0.2, 0.6).save(folder / "scene")
    pulses = [Record.of(f"R{n:04d}", ricker(2.0, 0.5 + 2.0 * n / records, 0.01)) for n in range(records)]
    Ensemble.write(folder / "ensemble", pulses)
    (folder / "campaign.toml").write_text(
        'scene = "scene"\nensemble = "ensemble"\npga_m_s2 = { start = 1, stop = 19, step = 1 }\nfriction = [0.9]\n'
        f"azimuth_deg = {[round(360 * n / azimuths, 6) for n in range(azimuths)]}\n"
    )
    return Campaign.read(folder / "campaign.toml")


def planned_in(folder: Path, records: int, azimuths: int) -> Plan:
    """Plan that campaign."""
    campaign = inputs(folder, records, azimuths)
    return plan(campaign, Scene.load(campaign.scene), Ensemble.load(campaign.ensemble))


def apart(work: Callable[..., dict[str, float]], *arguments: object) -> dict[str, float]:
    """Call in a process of its own, whose greatest memory is the work's."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(work, arguments)


def million() -> dict[str, float]:
    """Plan, track, store and compact 1,000,160 jobs without a cluster."""
    with tempfile.TemporaryDirectory() as name:
        folder, began = Path(name), time.perf_counter()
        planned = planned_in(folder, RECORDS, 376)
        told = {"jobs": len(planned), "plan_s": time.perf_counter() - began, "plan_mb": peak_mb()}
        run = folder / "run"
        prepare(run, planned, {})
        dispatch, tally = Dispatch(planned.pending(set()), planned.record_of), Tally(len(planned), 0)
        began, unstored = time.perf_counter(), []
        while batch := dispatch.next_batch(1000):
            rows = [pretended_row(planned.spec(job)) for job in batch.jobs]
            tally.count(rows)
            unstored += rows
            if len(unstored) > 20_000:
                write_part(run, unstored)
                unstored = []
        write_part(run, unstored)
        told |= {"jobs_a_second": len(planned) / (time.perf_counter() - began), "track_mb": peak_mb()}
        began = time.perf_counter()
        finished_ids(run, planned.ids)
        told |= {"resume_s": time.perf_counter() - began, "resume_mb": peak_mb()}
        began = time.perf_counter()
        compact(run)
        return told | {"compact_s": time.perf_counter() - began, "compact_mb": peak_mb()}


def peak_mb() -> float:
    """Greatest memory of this process so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def pretended_row(spec: JobSpec, wall_s: float = 0.0) -> Row:
    """Row that a job could have; every column is filled, as a real one's."""
    row = lost_row(spec, "ok", "")
    measures = (
        "pga_m_s2",
        "pgv_m_s",
        "pgd_m",
        "arias_m_s",
        "cav_m_s",
        "max_tilt_deg",
        "slip_m",
        "penetration_m",
    )
    return {
        **row, **dict.fromkeys(measures, spec.pga_m_s2 + 0.1), "toppled": spec.pga_m_s2 > 9, "attempt": 1,
        "outcome": "stands", "wall_s": wall_s, "worker": "host:1", "finished_at": datetime.now(UTC),
    }  # fmt: skip


class Pretend:
    """A worker's task that sleeps as long as the jobs would take."""

    def __init__(self, seconds_per_job: float) -> None:
        self.seconds_per_job = seconds_per_job

    def __call__(self, order: Order, specs: Sequence[JobSpec], budget_s: float) -> list[Row]:  # noqa: ARG002
        """Do what fits into the budget, as the true task does."""
        count = min(len(specs), max(1, int(np.ceil(budget_s / self.seconds_per_job))))
        time.sleep(count * self.seconds_per_job)
        return [pretended_row(spec, self.seconds_per_job) for spec in specs[:count]]


def pretended_run(workers: int, seconds_per_job: float, seconds: float) -> dict[str, float]:
    """Run as many jobs as so many workers can do in so many seconds, and tell how much longer it took."""
    load_defaults()
    dask.config.set(QUIET)
    jobs = int(workers * seconds / seconds_per_job)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        planned = planned_in(folder, 40, max(1, round(jobs / 40 / LEVELS)))
        run = folder / "run"
        prepare(run, planned, {})
        order = Order(str(run), planned.scene_id, planned.ensemble_id, versions())
        with (
            LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=False,
                dashboard_address=None,
                memory_limit=0,
            ) as cluster,
            Client(cluster.scheduler_address) as client,
        ):
            client.wait_for_workers(workers, timeout=300)
            tally = Tally(len(planned), 0)
            cpu, began = time.process_time(), time.perf_counter()
            Execution(planned, set(), client, run, order, unseen, tally, task=Pretend(seconds_per_job))()
            took, cpu = time.perf_counter() - began, time.process_time() - cpu
    ideal = len(planned) * seconds_per_job / workers
    return {
        "workers": workers, "jobs": len(planned), "ideal_s": ideal, "took_s": took,
        "efficiency": ideal / took, "jobs_a_second": len(planned) / took, "cpu_s": cpu,
    }  # fmt: skip


def unseen(tally: Tally) -> None:
    """Watch nothing."""


def played(cost_s: NDArray[np.float64], record_of: NDArray[np.integer], workers: int) -> tuple[float, float]:
    """Play the dispatch of jobs in plan order against a clock: time, and the share that workers idle at the end."""
    dispatch = Dispatch(np.arange(len(cost_s)), record_of)
    free = [(0.0, worker) for worker in range(workers)]
    ended = np.zeros(workers)
    while dispatch.waiting:
        now, worker = heapq.heappop(free)
        batch = dispatch.next_batch(workers)
        if batch is None:
            break
        spent = np.cumsum(cost_s[list(batch.jobs)])
        done = min(int(np.searchsorted(spent, BATCH_BUDGET_S)) + 1, len(spent))
        dispatch.came_back(batch, done)
        ended[worker] = now + spent[done - 1]
        heapq.heappush(free, (ended[worker], worker))
    return float(ended.max()), float(1 - ended.mean() / ended.max())


def study_costs(seconds_per_job: float, run: Path | None) -> tuple[NDArray[np.float64], NDArray[np.integer]]:
    """Cost of every job of the study, in plan order: of a real run if given, else spread as one spread."""
    record_of = np.repeat(np.arange(RECORDS), LEVELS * AZIMUTHS)
    random = np.random.default_rng(SEED)
    if run is not None:
        from results import open_run

        wall_s = open_run(run).table()["wall_s"].drop_null().to_numpy()
        drawn = np.sort(random.choice(wall_s, RECORDS))[::-1]
        spread = random.choice(wall_s / wall_s.mean(), STUDY)
        return np.repeat(drawn, LEVELS * AZIMUTHS) * spread, record_of
    # Longest record first, a factor of ten between the longest and the shortest; jobs of one record spread as e**N.
    length = np.repeat(np.geomspace(3.0, 0.3, RECORDS), LEVELS * AZIMUTHS)
    cost = length * random.lognormal(0.0, 0.8, STUDY)
    return cost * seconds_per_job / cost.mean(), record_of


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds-per-job", type=float, default=0.1)
    parser.add_argument("--run", type=Path, help="take the costs of jobs from this run")
    parser.add_argument("--workers", type=int, nargs="*", default=[1, 10, 100, 300, 1000])
    parser.add_argument("--seconds", type=float, default=20.0, help="length of each pretended run")
    given = parser.parse_args()
    print("a million jobs, planned, handed out, counted and stored in one process")
    print("  " + "  ".join(f"{name} {value:,.0f}" for name, value in apart(million).items()))
    print(f"pretended workers, {given.seconds_per_job} s a job")
    for workers in given.workers:
        told = apart(pretended_run, workers, given.seconds_per_job, given.seconds)
        print("  " + "  ".join(f"{name} {value:,.3g}" for name, value in told.items()), flush=True)
    cost, record_of = study_costs(given.seconds_per_job, given.run)
    print(f"the study's {STUDY} jobs, {cost.mean():.3f} s each on average, {cost.max():.1f} s at most")
    for workers in WORKERS:
        took, idle = played(cost, record_of, workers)
        print(f"  {workers:5d} workers  {took / 60:9.2f} min  idle at the end {100 * idle:.1f} %")


if __name__ == "__main__":
    main()
