"""A real Slurm of one node on loopback, with folders, ports and a key of its own."""

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import time

PATIENCE_S = 60.0

CONFIGURATION = """\
ClusterName=alone
SlurmctldHost={host}(127.0.0.1)
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
SlurmdParameters=config_overrides
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=sched_interval=1,bf_interval=1
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} RealMemory=16000
PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""


def can_be_started():
    return os.geteuid() == 0 and all(map(shutil.which, ("slurmctld", "slurmd", "munged")))


def free_ports(count):
    with contextlib.ExitStack() as open_ones:
        found = [open_ones.enter_context(socket.socket()) for _ in range(count)]
        for one in found:
            one.bind(("127.0.0.1", 0))
        return [one.getsockname()[1] for one in found]


class Slurm:
    """The daemons, as long as they are in use, and a user's commands."""

    def __init__(self, folder, cpus):
        self.folder, self.host = folder, socket.gethostname()
        for name in ("state", "spool"):
            (folder / name).mkdir()
        (folder / "munge.key").write_bytes(os.urandom(1024))
        (folder / "munge.key").chmod(0o400)
        places = {"host": self.host, "folder": folder, "ports": free_ports(2), "cpus": cpus}
        (folder / "slurm.conf").write_text(CONFIGURATION.format(**places))
        self.environment = {"SLURM_CONF": str(folder / "slurm.conf")}
        self.processes = []

    def _start(self, *command):
        with (self.folder / f"{command[0]}.out").open("w") as out:
            process = subprocess.Popen(
                command, env=os.environ | self.environment, stdout=out, stderr=out, start_new_session=True
            )
        self.processes.append(process)

    def __enter__(self):
        files = [f"--{name}-file={self.folder}/munged.{name}" for name in ("pid", "log", "seed")]
        socket_and_key = [f"--socket={self.folder}/munge.socket", f"--key-file={self.folder}/munge.key"]
        self._start("munged", "--foreground", "--force", *socket_and_key, *files)
        self._start("slurmctld", "-D")
        self._start("slurmd", "-D", "-N", self.host)
        self.until(lambda: self.node() == "idle")
        return self

    def __exit__(self, *exception):
        with contextlib.suppress(subprocess.CalledProcessError):
            self.cancel(*self.jobs())
            self.until(lambda: not self.jobs())
        for process in reversed(self.processes):
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(PATIENCE_S)
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)

    def ask(self, *command):
        """Output of one of Slurm's commands, in lines."""
        done = subprocess.run(
            command, env=os.environ | self.environment, capture_output=True, text=True, check=True
        )
        return done.stdout.split()

    def node(self):
        """State of the only node; empty as long as nobody answers."""
        with contextlib.suppress(subprocess.CalledProcessError):
            return self.ask("sinfo", "--noheader", "--format=%T")[0]
        return ""

    def jobs(self, *states):
        """Ids of the batch jobs in some states; of all that have not ended unless states are named."""
        chosen = [f"--states={','.join(states)}"] if states else []
        return self.ask("squeue", "--noheader", "--format=%A", *chosen)

    def cancel(self, *jobs):
        if jobs:
            self.ask("scancel", *jobs)

    def drain(self):
        self.ask("scontrol", "update", f"nodename={self.host}", "state=drain", "reason=test")

    def resume(self):
        self.ask("scontrol", "update", f"nodename={self.host}", "state=resume")

    def until(self, holds):
        """Wait until something holds."""
        end = time.monotonic() + PATIENCE_S
        while not holds():
            assert time.monotonic() < end, "Slurm did not come so far; see the logs in its folder"
            time.sleep(0.1)
