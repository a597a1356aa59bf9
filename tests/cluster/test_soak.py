"""Faults of all kinds at random moments, in processes that are all real; the tally is printed.

`TOPPLING_SOAK_FAULTS` faults are injected (300 unless told), within `TOPPLING_SOAK_S` seconds, each kind at least
`LEAST` times. Most wait for work that was stored since the last one, the others strike in a burst. Kinds that only root
can inject are said to be skipped without it. Where else each kind is tested, on its own:

    worker killed, aborts, segfaults    test_two_workers: killed, crash the engine, crash once, die before their start
    job segfaults, job hangs, frozen    test_two_workers: crashes the engine, crashes once, that hangs is replaced
    without the run, another version    test_two_workers: refused before any job; test_command: that joins later
    scheduler killed                    test_command: losing it loses no row
    client killed, before renaming      test_command: killed between writing and renaming
    Ctrl-C, SIGTERM                     test_command: stopping it keeps the rows
    disk full                           test_two_workers: a part that cannot be written
    torn part, flipped part, foreign    test_two_workers: torn and foreign, lost while the run goes on, of another run
    own file flipped                    test_damage: a flipped bit of any file, damaged files do not go on
    network cut, host of a worker lost  test_compose: whatever befalls them
    worker leaves, worker joins         here only
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
from conftest import FAULTS_VARIABLE, OTHER_CODE_VARIABLE
from hosts import HUB_ADDRESS, Hosts, can_be_made
from soaked_client import FATAL_RENAME_VARIABLE

from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.plan import plan
from toppling.results.run_integrity import NEEDED
from toppling.workers.job import Assets, run_job

FAULTS = int(os.environ.get("TOPPLING_SOAK_FAULTS", "300"))
LIMIT_S = float(os.environ.get("TOPPLING_SOAK_S", "1500"))
LEAST = max(1, FAULTS // 150)
SEED = 20260611
SCHEDULER = f"tcp://{HUB_ADDRESS}:8786"
PROGRAM = str(Path(__file__).with_name("soaked_client.py"))
DASK = str(Path(sys.executable).with_name("dask"))
QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
RUN_BYTES = 6_000_000
"""Of the disk that fills up: the run's folder a few times over."""

STRIKES_IN_A_SESSION = (6, 16)
"""Fewest and most strikes before the one that ends a session: its start costs as much as several of them."""

HANGS_S = 240.0
"""No session goes on for so long after its last strike."""

PATIENCE_S = 15.0
"""The longest wait for work between two strikes: nothing gets done while every worker is away."""

BURSTS = 0.4
"""Share of strikes that do not wait for work, but hit what still recovers from the last one."""

ENDS_THE_CLIENT = ["client killed", "Ctrl-C", "SIGTERM", "disk full"]
ENDS_THE_CLIENT_OF_A_CLUSTER = [*ENDS_THE_CLIENT, "scheduler killed", "scheduler killed"]
MAY_END_THE_CLIENT = {
    *ENDS_THE_CLIENT_OF_A_CLUSTER, "client killed before renaming",
    "worker without the run joins", "worker of another version joins",
}  # fmt: skip
WORKER_SIGNALS = {
    "worker killed": signal.SIGKILL,
    "worker segfaults": signal.SIGSEGV,
    "worker aborts": signal.SIGABRT,
    "worker frozen": signal.SIGSTOP,
}
STRIKES = [
    *WORKER_SIGNALS, *["worker killed"] * 3, "torn part", "flipped part", "flipped part", "foreign file",
]  # fmt: skip
STRIKES_ON_A_CLUSTER = [
    *STRIKES, "worker leaves", "host of a worker lost", "network cut", "network cut",
    "worker without the run joins", "worker of another version joins",
]  # fmt: skip
OTHERS = ["client killed before renaming", "own file flipped", "job segfaults", "job hangs"]
KINDS = {*STRIKES, *ENDS_THE_CLIENT, *OTHERS}
NEED_HOSTS = {*STRIKES_ON_A_CLUSTER, *ENDS_THE_CLIENT_OF_A_CLUSTER} - KINDS
"""Kinds for which there have to be hosts on cables of their own, which only root can make."""
NEED_A_DISK = {"disk full", "worker without the run joins"}
"""Kinds for which a file system has to be mounted, which only root can do."""


class Cluster:
    """A scheduler and workers on hosts of their own."""

    def __init__(self, hosts, scratch, disk):
        self.hosts, self.scratch, self.disk = hosts, scratch, disk
        self.scheduler, self.workers, self.unfit = None, {}, []

    def mend(self):
        """Start whatever of it does not run, and plug every cable in; tells how many workers were started."""
        for host in self.hosts.workers:
            self.hosts.cable(host, plugged=True)
        if self.scheduler is None or self.scheduler.poll() is not None:
            command = [DASK, "scheduler", "--host", SCHEDULER, "--no-dashboard"]
            self.scheduler = subprocess.Popen(self.hosts.on(self.hosts.hub, command), **QUIET)
        away = [host for host in self.hosts.workers if host not in self.alive()]
        self.workers |= {host: self._worker(host) for host in away}
        return len(away)

    def alive(self):
        """Worker processes by host."""
        return {host: process for host, process in self.workers.items() if process.poll() is None}

    def join_without_the_run(self, host):
        """A worker joins on whose host the run's disk is not mounted."""
        self.unfit.append(self._worker(host, "sh", "-c", 'umount --lazy "$0" && exec "$@"', str(self.disk)))

    def join_of_another_version(self, host):
        """A worker joins whose code is another."""
        self.unfit.append(self._worker(host, "env", f"{OTHER_CODE_VARIABLE}=other"))

    def dismiss_the_unfit(self):
        """End the unfit workers that no run has sent away."""
        for process in self.unfit:
            end_with_children(process)
        self.unfit = []

    def _worker(self, host, *around):
        command = [DASK, "worker", SCHEDULER, "--nthreads", "1", "--no-dashboard"]
        command = [*around, *command, "--local-directory", str(self.scratch)]
        return subprocess.Popen(self.hosts.on(host, command), **QUIET)

    def close(self):
        self.dismiss_the_unfit()
        for process in (*self.workers.values(), self.scheduler):
            if process is not None and process.poll() is None:
                end_with_children(process)


def end_with_children(process):
    """Kill a process and whatever it has started."""
    with suppress(psutil.NoSuchProcess):
        for each in [*psutil.Process(process.pid).children(recursive=True), process]:
            with suppress(psutil.NoSuchProcess):
                each.kill()
    process.wait()


class Storm:
    """Carries runs out while it strikes at everything that takes part in them."""

    def __init__(self, campaign_file, cluster, disk, faults, job_ids):
        self.random = random.Random(SEED)
        self.progress = Counter()
        self.campaign_file, self.cluster, self.disk, self.faults = campaign_file, cluster, disk, faults
        self.job_ids = job_ids
        self.course = campaign_file.with_name("course.txt")  # for whom it went wrong
        self.session = set()
        self.sessions = self.joined = 0
        self.client = self.run = None
        self.calm_at = time.monotonic() + LIMIT_S

    @property
    def possible(self):
        """Kinds of faults that can be injected here."""
        kinds = KINDS | (NEED_HOSTS if self.cluster else set())
        return kinds if os.path.ismount(self.disk) else kinds - NEED_A_DISK

    @property
    def lacking(self):
        """Kinds that have struck too seldom."""
        return {kind for kind in self.possible if self.progress[kind] < LEAST}

    @property
    def over(self):
        # Jobs' own faults are counted once a run is complete.
        done = self.progress.total() >= FAULTS and self.lacking <= {"job segfaults", "job hangs"}
        return done or time.monotonic() > self.calm_at

    def carry_out(self, run):
        """Start the command again and again until the run is complete."""
        self.run, complete = run, False
        kinds = ["segfault"] * 10 + ["hang"] * 2
        culprits = self.random.sample(self.job_ids, len(kinds))
        told = {job: {"kind": kind, "times": 1} for job, kind in zip(culprits, kinds, strict=True)}
        self.faults.set(every={"kind": "wait", "seconds": 0.04}, **told)
        while not complete:
            if (run / "run.json").exists() and self.random.random() < 0.3:
                self._refused_with_a_flipped_bit()
            complete = self._session()
        struck = [job for job in culprits if self.faults.path.with_name(f"faults.json.{job}").exists()]
        self.progress.update(f"job {told[job]['kind']}s" for job in struck)

    def _refused_with_a_flipped_bit(self):
        """What the run was begun with is not believed once it has changed; then it is put back as from a copy."""
        path = self.run / self.random.choice(["run.json", *NEEDED])
        content = path.read_bytes()
        self._flip(path)
        command = [
            sys.executable,
            PROGRAM,
            "run",
            str(self.campaign_file),
            "--out",
            str(self.run),
            "--workers",
            "1",
        ]
        done = subprocess.run(command, capture_output=True, text=True, timeout=HANGS_S)
        assert (done.returncode, path.name in done.stderr) == (1, True), f"{path.name}: {done.stderr}"
        path.write_bytes(content)
        self.progress["own file flipped"] += 1
        self._note(f"{path.name} flipped")

    def _flip(self, path):
        content = bytearray(path.read_bytes())
        bit = self.random.randrange(8 * len(content))
        content[bit // 8] ^= 1 << bit % 8
        with path.open("r+b") as file:
            file.write(content)

    def _session(self):
        self.session, environment = set(), dict(os.environ)
        self.sessions += 1
        self._note("session begins")
        if self.cluster and self.random.random() < 0.6:
            self.cluster.mend()
            where, host = ["--scheduler", SCHEDULER], self.cluster.hosts.hub
        else:
            where, host = ["--workers", "2"], None
        often = 0.5 if "client killed before renaming" in self.lacking else 0.2
        if not self.over and self.random.random() < often:
            environment[FATAL_RENAME_VARIABLE] = str(self.random.randint(1, 8))
            self.session.add("client killed before renaming")
        command = [sys.executable, PROGRAM, "run", str(self.campaign_file), "--out", str(self.run), *where]
        command += ["--job-limit", "3", "--tries", "9"]
        if host:
            command = self.cluster.hosts.on(host, command)
        with (self.disk / "stderr").open("w+") as told:
            self.client = subprocess.Popen(
                command, stdout=subprocess.DEVNULL, stderr=told, env=environment, start_new_session=True
            )
            try:
                self._strike_until_it_ends(outside=host is not None)
            finally:
                if self.client.poll() is None:
                    end_with_children(self.client)
            told.seek(0)
            return self._judge(told.read())

    def _strike_until_it_ends(self, *, outside):
        left = self.random.randint(*STRIKES_IN_A_SESSION)
        waits, stored, since = self.random.random() < 0.7, self._parts(), time.monotonic()
        pause = 0.2 if waits else self.random.uniform(1, 5)
        while self._goes_on(pause):
            now, pause = time.monotonic(), 0.2
            assert now - since < HANGS_S, f"a run hangs after {self.session} and {self.progress}"
            if self.over:
                self.joined += self.cluster.mend() if outside else 0
            elif not waits or self._parts() != stored or now - since > PATIENCE_S:
                self._strike(outside, last=left <= 0)
                waits = left <= 0 or self.random.random() > BURSTS
                pause = 0.2 if waits else self.random.uniform(0.05, 0.6)
                left, stored, since = left - 1, self._parts(), now

    def _note(self, event):
        stored = len(self._parts())
        with self.course.open("a") as course:
            course.write(f"{time.monotonic():.1f} {self.progress.total()} faults, {stored} parts: {event}\n")

    def _goes_on(self, seconds):
        try:
            self.client.wait(seconds)
        except subprocess.TimeoutExpired:
            return True
        return False

    def _judge(self, told):
        code = self.client.returncode
        self._note(f"session ends with {code}")
        if code == -signal.SIGKILL and "client killed before renaming" in self.session:
            self.progress["client killed before renaming"] += "client killed" not in self.session
        if code != 0:
            assert self.session & MAY_END_THE_CLIENT, f"exit {code} without a fault that may end it:\n{told}"
            assert code in (1, 130, -signal.SIGKILL, -signal.SIGTERM, -signal.SIGINT), told
        (self.disk / "ballast").unlink(missing_ok=True)
        if self.cluster:
            self.cluster.dismiss_the_unfit()
        return code == 0

    def _strike(self, outside, *, last):
        if last:
            kinds = ENDS_THE_CLIENT_OF_A_CLUSTER if outside else ENDS_THE_CLIENT
        else:
            kinds = STRIKES_ON_A_CLUSTER if outside else STRIKES
        kind = self.random.choice([kind for kind in kinds if kind in self.lacking] or kinds)
        if kind in WORKER_SIGNALS:
            struck = self._worker_process(kind, outside)
        else:
            struck = getattr(self, f"_{kind.lower().replace(' ', '_').replace('-', '_')}")()
        if struck:
            self.session.add(kind)
            self.progress[kind] += 1
        self._note(f"{kind}{'' if struck else ': nothing to strike'}")
        if outside and self.random.random() < 0.5 and "scheduler killed" not in self.session:
            self.joined += self.cluster.mend()  # workers come (back) while the run goes on
            self._note("cluster mended")

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

    def _flipped_part(self):
        parts = self._parts()
        if not parts:
            return False
        try:
            self._flip(self.random.choice(parts))
        except (FileNotFoundError, ValueError):  # merged meanwhile, or torn to nothing before
            return False
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
        alive = list(self.cluster.alive().values())
        if not alive:
            return False
        victim = self.random.choice(alive)
        if number == signal.SIGKILL:
            end_with_children(victim)
        else:
            victim.send_signal(number)
        return True

    def _worker_without_the_run_joins(self):
        if not os.path.ismount(self.disk):
            return False
        self.cluster.join_without_the_run(self.random.choice(self.cluster.hosts.workers))
        return True

    def _worker_of_another_version_joins(self):
        self.cluster.join_of_another_version(self.random.choice(self.cluster.hosts.workers))
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
            cluster = Cluster(stack.enter_context(Hosts(3)), tmp_path, disk)
            stack.callback(cluster.close)
        storm = Storm(campaign_file, cluster, disk, faults, job_ids)
        while not storm.over:
            run = disk / f"run{runs}"
            storm.carry_out(run)
            assert differences(answers_of(run), undisturbed) == []
            shutil.rmtree(run)
            runs += 1
    with capsys.disabled():
        told = json.dumps(dict(sorted(storm.progress.items())))
        seconds = time.monotonic() - began
        print(  # noqa: T201
            f"\nsoak: {storm.progress.total()} faults in {storm.sessions} sessions of {runs} runs, {seconds:.0f} s, "
            f"{storm.joined} workers came back by joining, rows the same: {told}"
        )
        if skipped := (KINDS | NEED_HOSTS) - storm.possible:
            print(f"soak: skipped, as they need root: {', '.join(sorted(skipped))}")  # noqa: T201
    assert not storm.lacking, f"struck less than {LEAST} times: {storm.lacking}"
    assert storm.progress.total() >= FAULTS, "too slow a machine: raise TOPPLING_SOAK_S"
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
