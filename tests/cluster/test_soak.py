"""Faults of all kinds at random moments, in processes that are all real; the tally is printed.

`TOPPLING_SOAK_FAULTS` faults are injected (300 unless told), within `TOPPLING_SOAK_S` seconds.
"""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from contextlib import ExitStack, suppress
from pathlib import Path

import psutil
import pytest
from answers import answers_of, differences, sorted_answers
from conftest import FAULTS_VARIABLE
from hosts import HUB_ADDRESS, Hosts, can_be_made
from soaked_client import FATAL_RENAME_VARIABLE

from models import Scene
from models.motions.ensemble import Ensemble
from orchestrator.campaign import Campaign
from orchestrator.plan import plan
from workers.job import Assets, run_job

FAULTS = int(os.environ.get("TOPPLING_SOAK_FAULTS", "300"))
LIMIT_S = float(os.environ.get("TOPPLING_SOAK_S", "1500"))
SEED = 20260611
SCHEDULER = f"tcp://{HUB_ADDRESS}:8786"
PROGRAM = str(Path(__file__).with_name("soaked_client.py"))
DASK = str(Path(sys.executable).with_name("dask"))
QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
RUN_BYTES = 6_000_000
"""Of the disk that fills up: the run's folder a few times over."""

STRIKES_BEFORE_THE_END = 4
"""Strikes that a session lives through before one may end it; otherwise none would get far."""

ENDS_THE_CLIENT = {
    "client killed", "client killed before renaming", "Ctrl-C", "SIGTERM", "scheduler killed", "disk full",
}  # fmt: skip
WORKER_SIGNALS = {
    "worker killed": signal.SIGKILL,
    "worker segfaults": signal.SIGSEGV,
    "worker aborts": signal.SIGABRT,
    "worker frozen": signal.SIGSTOP,
}


class Cluster:
    """A scheduler and workers on hosts of their own."""

    def __init__(self, hosts, scratch):
        self.hosts, self.scratch = hosts, scratch
        self.scheduler, self.workers = None, {}

    def mend(self):
        """Start whatever of it does not run, and plug every cable in."""
        for host in self.hosts.workers:
            self.hosts.cable(host, plugged=True)
        if self.scheduler is None or self.scheduler.poll() is not None:
            command = [DASK, "scheduler", "--host", SCHEDULER, "--no-dashboard"]
            self.scheduler = subprocess.Popen(self.hosts.on(self.hosts.hub, command), **QUIET)
        for host in self.hosts.workers:
            if host not in self.workers or self.workers[host].poll() is not None:
                command = [
                    DASK,
                    "worker",
                    SCHEDULER,
                    "--nthreads",
                    "1",
                    "--no-dashboard",
                    "--local-directory",
                ]
                command = self.hosts.on(host, [*command, str(self.scratch)])
                self.workers[host] = subprocess.Popen(command, **QUIET)

    def close(self):
        for process in (*self.workers.values(), self.scheduler):
            if process is not None and process.poll() is None:
                process.kill()


class Storm:
    """Carries runs out while it strikes at everything that takes part in them."""

    def __init__(self, campaign_file, cluster, disk, faults, job_ids):
        self.random = random.Random(SEED)
        self.tally = Counter()
        self.campaign_file, self.cluster, self.disk, self.faults = campaign_file, cluster, disk, faults
        self.job_ids = job_ids
        self.session = set()
        self.client = self.run = None
        self.calm_at = time.monotonic() + LIMIT_S

    @property
    def over(self):
        return self.tally.total() >= FAULTS or time.monotonic() > self.calm_at

    def carry_out(self, run):
        """Start the command again and again until the run is complete."""
        self.run, complete = run, False
        kinds = ["segfault"] * 7 + ["hang"]
        culprits = self.random.sample(self.job_ids, len(kinds))
        told = {job: {"kind": kind, "times": 1} for job, kind in zip(culprits, kinds, strict=True)}
        self.faults.set(every={"kind": "wait", "seconds": 0.04}, **told)
        while not complete:
            complete = self._session()
        struck = [job for job in culprits if self.faults.path.with_name(f"faults.json.{job}").exists()]
        self.tally.update(f"job {told[job]['kind']}s" for job in struck)

    def _session(self):
        self.session, self.strikes, environment = set(), 0, dict(os.environ)
        if self.cluster and self.random.random() < 0.6:
            self.cluster.mend()
            where, host = ["--scheduler", SCHEDULER], self.cluster.hosts.hub
        else:
            where, host = ["--workers", "2"], None
        if not self.over and self.random.random() < 0.25:
            environment[FATAL_RENAME_VARIABLE] = str(self.random.randint(1, 3))
            self.session.add("client killed before renaming")
        command = [sys.executable, PROGRAM, "run", str(self.campaign_file), "--out", str(self.run), *where]
        command += ["--job-limit", "3", "--tries", "9"]
        if host:
            command = self.cluster.hosts.on(host, command)
        with (self.disk / "stderr").open("w+") as told:
            self.client = subprocess.Popen(
                command, stdout=subprocess.DEVNULL, stderr=told, env=environment, start_new_session=True
            )
            self._strike_until_it_ends(outside=host is not None)
            told.seek(0)
            return self._judge(told.read())

    def _strike_until_it_ends(self, *, outside):
        pause, end = self.random.uniform(1, 5), time.monotonic() + 240
        stored = self.random.random() < 0.7 and len(self._parts())
        while True:
            try:
                self.client.wait(pause)
            except subprocess.TimeoutExpired:
                assert time.monotonic() < end, f"a run hangs after {self.tally}"
                if stored is not False and len(self._parts()) <= stored:
                    pause = 0.3  # most sessions get to work before they are struck
                    continue
                stored, pause = False, self.random.uniform(0.2, 1.5)
                if not self.over:
                    self._strike(outside)
                elif outside:
                    self.cluster.mend()
                continue
            return

    def _judge(self, told):
        code = self.client.returncode
        if code == -signal.SIGKILL and "client killed before renaming" in self.session:
            self.tally["client killed before renaming"] += "client killed" not in self.session
        if code != 0:
            assert self.session & ENDS_THE_CLIENT, f"exit {code} without a fault that may end it:\n{told}"
            assert code in (1, 130, -signal.SIGKILL, -signal.SIGTERM, -signal.SIGINT), told
        (self.disk / "ballast").unlink(missing_ok=True)
        return code == 0

    def _strike(self, outside):
        kinds = [*WORKER_SIGNALS, *["worker killed"] * 5, "torn part", "foreign file", "Ctrl-C", "SIGTERM"]
        kinds += ["client killed", "disk full"]
        if outside:
            kinds += [
                "worker leaves",
                "host of a worker lost",
                "network cut",
                "network cut",
                "scheduler killed",
            ]
        kind = self.random.choice(kinds)
        if WORKER_SIGNALS.get(kind):
            struck = self._worker_process(kind, outside)
        else:
            struck = getattr(self, f"_{kind.lower().replace(' ', '_').replace('-', '_')}")()
        if struck:
            self.session.add(kind)
            self.tally[kind] += 1
        if outside and self.random.random() < 0.5 and "scheduler killed" not in self.session:
            self.cluster.mend()  # workers come (back) while the run goes on

    def _worker_process(self, kind, outside):
        parents = self.cluster.workers.values() if outside else [self.client]
        processes = [each for parent in parents for each in children(parent.pid)]
        if not processes:
            return False
        self.random.choice(processes).send_signal(WORKER_SIGNALS[kind])
        return True

    def _torn_part(self):
        parts = self._parts()
        if not parts:
            return False
        part = self.random.choice(parts)
        os.truncate(part, self.random.randrange(max(part.stat().st_size, 1)))
        return True

    def _parts(self):
        return sorted((self.run / "parts").glob("part-*-*"))

    def _foreign_file(self):
        if not (self.run / "parts").exists():
            return False
        name = self.random.choice(["notes.txt", "part-foreign.parquet", "part-0.parquet"])
        content = self.random.choice([b"not Parquet", (self.run / "jobs.parquet").read_bytes()])
        try:
            (self.run / "parts" / name).write_bytes(content)
        except OSError:  # the disk is full
            return False
        return True

    def _ctrl_c(self):
        os.killpg(self.client.pid, signal.SIGINT)
        return True

    def _sigterm(self):
        self.client.terminate()
        return True

    def _client_killed(self):
        self.client.kill()
        return True

    def _disk_full(self):
        if not os.path.ismount(self.disk) or not self.run.exists():
            return False
        with (self.disk / "ballast").open("wb", buffering=0) as ballast:
            try:
                while True:
                    ballast.write(b"\0" * 4096)
            except OSError:
                return True

    def _worker_leaves(self):
        return self._end_host_process(signal.SIGTERM)

    def _host_of_a_worker_lost(self):
        return self._end_host_process(signal.SIGKILL)

    def _end_host_process(self, number):
        alive = [process for process in self.cluster.workers.values() if process.poll() is None]
        if not alive:
            return False
        victim = self.random.choice(alive)
        own = children(victim.pid) if number == signal.SIGKILL else []
        victim.send_signal(number)
        for process in own:
            process.kill()
        return True

    def _network_cut(self):
        self.cluster.hosts.cable(self.random.choice(self.cluster.hosts.workers), plugged=False)
        return True  # until the cluster is mended: less or more than the scheduler waits

    def _scheduler_killed(self):
        self.cluster.scheduler.kill()
        self.cluster.scheduler.wait()
        return True


def children(pid):
    """Worker processes below a nanny's."""
    try:
        below = psutil.Process(pid).children(recursive=True)
        return [each for each in below if any("spawn_main" in word for word in each.cmdline())]
    except psutil.NoSuchProcess:
        return []


@pytest.fixture
def disk(tmp_path):
    """A file system small enough to be filled, where that may be mounted."""
    place = tmp_path / "disk"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={RUN_BYTES}", "none", str(place)]
    mounted = shutil.which("mount") and subprocess.run(mount, capture_output=True).returncode == 0
    yield place
    if mounted:
        subprocess.run(["umount", "--lazy", str(place)], check=True)


@pytest.mark.slow
@pytest.mark.timeout(LIMIT_S + 600)
def test_random_faults_lose_no_row_and_change_none(inputs, tmp_path, disk, faults, monkeypatch, capsys):
    monkeypatch.setenv("DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL", "6s")
    monkeypatch.setenv("DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT", "5s")
    monkeypatch.setenv("DASK_CONFIG", str(Path(plan.__code__.co_filename).with_name("dask.yaml")))
    text = (inputs / "campaign.toml").read_text().replace("[0, 90, 200]", str([*range(0, 360, 30)]))
    text = text.replace('= "scene"', f'= "{inputs / "scene"}"')
    text = text.replace('= "ensemble"', f'= "{inputs / "ensemble"}"')
    campaign_file = tmp_path / "campaign.toml"
    campaign_file.write_text(text)
    campaign = Campaign.read(campaign_file)
    scene, ensemble = Scene.load(campaign.scene), Ensemble.load(campaign.ensemble)
    planned = plan(campaign, scene, ensemble)
    undisturbed = sorted_answers(
        [run_job(planned.spec(job), Assets(scene, ensemble)) for job in range(len(planned))]
    )
    job_ids = planned.jobs["job_id"].to_pylist()
    began, runs = time.monotonic(), 0
    with ExitStack() as stack:
        cluster = None
        if can_be_made():
            cluster = Cluster(stack.enter_context(Hosts(3)), tmp_path)
            stack.callback(cluster.close)
        storm = Storm(campaign_file, cluster, disk, faults, job_ids)
        while not storm.over:
            run = disk / f"run{runs}"
            storm.carry_out(run)
            assert differences(answers_of(run), undisturbed) == []
            shutil.rmtree(run)
            runs += 1
    with capsys.disabled():
        told = json.dumps(dict(sorted(storm.tally.items())))
        seconds = time.monotonic() - began
        print(f"\nsoak: {storm.tally.total()} faults in {runs} runs, {seconds:.0f} s, rows the same: {told}")  # noqa: T201
    assert storm.tally.total() >= FAULTS, "too slow a machine: raise TOPPLING_SOAK_S"
    end = time.monotonic() + 60
    while left := [process for process in psutil.process_iter() if of_this_test(process, faults.path)]:
        assert time.monotonic() < end, f"workers outlive the client that started them: {left}"
        for process in left:
            with suppress(psutil.NoSuchProcess):
                process.send_signal(signal.SIGCONT)  # the frozen cannot go
        time.sleep(0.5)


def of_this_test(process, path):
    try:
        return process.pid != os.getpid() and process.environ().get(FAULTS_VARIABLE) == str(path)
    except (psutil.NoSuchProcess, psutil.AccessDenied):
        return False
