"""How long a user waits: until a run's first row is stored, and for each answer about a run, beside a bare script.

    .venv/bin/python benchmarks/starts.py [NAME ...]    # first_row, status, query, report, import, replay, compile
    .venv/bin/python benchmarks/starts.py overhead [CAMPAIGN]    # a run's processor time over a process pool's

The bare script imports NumPy and writes one row with PyArrow. Of each the processor's time of all processes, and the
wall time, as ratios to the bare script's in the same run: on a machine that others use only the ratios mean anything.
"""

import multiprocessing
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pyarrow.parquet as pq

from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.motion import Motion
from toppling.models.motions.record import Record
from toppling.models.scene import Scene
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.plan import plan_of
from toppling.results.store import write_part
from toppling.workers.job import Assets, JobSpec, run_job

BARE = "import numpy, pyarrow as a, pyarrow.parquet as p; p.write_table(a.table({'x': numpy.ones(1)}), 'bare.parquet')"
COMPILE = "from toppling.workers.shaking import compile_once; compile_once()"
RECORDS, FILES = 24, 390
ASSETS: list[Assets] = []
CAMPAIGN = """\
scene = "scene"
ensemble = "ensemble"
pga_m_s2 = [2, 3, 4, 5, 6, 8]
azimuth_deg = [0, 90]
friction = [0.9]
preset = "fast"
audit = 0
"""
AIMS_S = {
    "first_row": 6.0,
    "status": 0.8,
    "query": 0.8,
    "report": 10.0,
    "import": 12.0,
    "replay": 8.0,
    "compile": 15.0,
}
"""Wall time on a machine of two cores that nobody else uses; of status and query the processor's time."""


def pulse(number: int) -> Motion:
    """Five seconds of a decaying wave."""
    time_s = np.arange(500) * 0.01
    wave = np.exp(-0.8 * time_s) * np.sin(2 * np.pi * (1.0 + 0.1 * number) * time_s)
    return Motion(np.column_stack([wave, 0.6 * wave, 0.0 * wave]), 0.01)


def make_inputs(folder: Path) -> None:
    """A block, records, the same as files of others, and a campaign of 288 jobs."""
    Scene.block(0.15, 0.2, 0.6).save(folder / "scene")
    records = [Record.of(f"P{entry}", pulse(entry), event=f"event {entry}") for entry in range(RECORDS)]
    Ensemble.write(folder / "ensemble", records)
    (folder / "campaign.toml").write_text(CAMPAIGN)
    (folder / "files").mkdir()
    for single in range(FILES):
        values = pulse(single % 40).acceleration_m_s2[:, 0] / 9.80665
        lines = "\n".join(
            "".join(f"{value:15.7E}" for value in values[at : at + 5]) for at in range(0, len(values), 5)
        )
        station, axis = divmod(single, 3)
        head = f"PEER NGA STRONG MOTION DATABASE RECORD\nEvent {station}, station {station}, {(0, 90, 'UP')[axis]}\n"
        head += f"ACCELERATION TIME SERIES IN UNITS OF G\nNPTS=  {len(values)}, DT=   .0100 SEC\n"
        name = f"RSN{station}_EVENT_STATION{('000', '090', '-UP')[axis]}.AT2"
        (folder / "files" / name).write_text(head + lines + "\n")


def command(*words: object) -> list[str]:
    """A command of the program."""
    return [sys.executable, "-P", "-m", "toppling", *map(str, words)]


def timed(words: list[str], folder: Path, **environment: str) -> tuple[float, float]:
    """Processor and wall time of a command that ends."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(words, cwd=folder, check=True, stdout=subprocess.DEVNULL, env=os.environ | environment)
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall


def first_row(folder: Path) -> tuple[float, float]:
    """Time of a run with two workers until its first row is stored; the run then continues to its end."""
    began = time.perf_counter()
    words = command("run", "campaign.toml", "--out", "run", "--workers", 2)
    with subprocess.Popen(words, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        while not any((folder / "run" / "parts").glob("*.parquet")) and process.poll() is None:
            time.sleep(0.02)
        wall, parent = time.perf_counter() - began, psutil.Process(process.pid)
        spent = sum(sum(entry.cpu_times()[:2]) for entry in [parent, *parent.children(recursive=True)])
    return spent, wall


def by_pool(campaign: str) -> None:
    """The jobs of a campaign through a process pool, their rows into one file."""
    planned = plan_of(Campaign.read(campaign))
    specs = [planned.spec(int(row)) for row in planned.order]
    assets = Assets(Scene.load(planned.campaign.scene), Ensemble.load(planned.campaign.ensemble))
    with multiprocessing.Pool(2, initializer=ASSETS.append, initargs=(assets,)) as pool:
        rows = pool.map(row_of, specs, chunksize=8)
    Path("pool/parts").mkdir(parents=True)
    write_part(Path("pool"), rows)


def row_of(spec: JobSpec) -> dict[str, Any]:
    """Row of a job, in a process of the pool."""
    return run_job(spec, ASSETS[0])


def overhead(campaign: Path, folder: Path) -> None:
    """Print the processor's time of all processes of a pool and of a run."""
    pool, _ = timed([sys.executable, __file__, "pool", str(campaign)], folder)
    spent, _ = timed(command("run", campaign, "--out", "compared", "--workers", 2), folder)
    print(f"pool {pool:.1f} s, run {spent:.1f} s: {spent / pool:.2f}")


def job_of(folder: Path) -> str:
    """Id of the first job of the run."""
    return str(pq.read_table(folder / "run" / "jobs.parquet")["job_id"][0])


def main(asked: list[str]) -> None:
    """Measure and print the table."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        make_inputs(folder)
        bare = [timed([sys.executable, "-c", BARE], folder) for _ in range(5)]
        cpu, wall = (float(np.median(value)) for value in zip(*bare, strict=True))
        print(f"bare script: {cpu:.2f} s of processor, {wall:.2f} s\n")
        print(f"{'':10}  processor  (ratio)    wall  (ratio)    aim")
        script = [sys.executable, "-P", "-c", COMPILE]
        measures = {
            "first_row": lambda: first_row(folder),
            "status": lambda: timed(command("status", "run"), folder),
            "query": lambda: timed(command("query", "run", "SELECT count(*) FROM results"), folder),
            "report": lambda: timed(command("report", "run", "--out", "report.html"), folder),
            "import": lambda: timed(command("records", "import", "files", "--out", "imported"), folder),
            "replay": lambda: timed(command("replay", "run", job_of(folder), "--out", "replay"), folder),
            "compile": lambda: timed(script, folder, TOPPLING_CACHE=str(folder / "cache")),
        }
        for name in (
            "first_row",
            *(name for name in measures if name != "first_row" and name in (asked or measures)),
        ):
            spent, took = measures[name]()
            ratios = f"({spent / cpu:5.1f}) {took:6.1f} s  ({took / wall:5.1f})"
            print(f"{name:10}  {spent:7.2f} s  {ratios} {AIMS_S[name]:4g} s", flush=True)


if __name__ == "__main__":
    if sys.argv[1:2] == ["pool"]:
        by_pool(sys.argv[2])
    elif sys.argv[1:2] == ["overhead"]:
        with tempfile.TemporaryDirectory() as scratch:
            make_inputs(Path(scratch))
            given = sys.argv[2] if sys.argv[2:] else f"{scratch}/campaign.toml"
            overhead(Path(given).absolute(), Path(scratch))
    else:
        main(sys.argv[1:])
