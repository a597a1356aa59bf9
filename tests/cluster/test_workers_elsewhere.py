"""Workers that this machine does not start as its own: a host without the program, batch jobs that end."""

import os
import subprocess
import sys

from distributed import Client, LocalCluster
from refusals import refused

from toppling.orchestrator.admission import make_ready
from toppling.orchestrator.leaving import leaving_in_order
from toppling.orchestrator.task import RunKey, versions

PATIENCE_S = 60.0

BLOCKING = """\
import sys

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "toppling":
            raise ModuleNotFoundError(f"No module named {name!r}")

sys.meta_path.insert(0, Absent())
"""


def test_a_worker_without_the_program_is_refused_before_any_job(tmp_path, planned, inputs):
    (tmp_path / "sitecustomize.py").write_text(BLOCKING)
    # Without the faults that other tests have workers load: they are part of the program.
    bare = {name: value for name, value in os.environ.items() if not name.startswith("DASK_")}
    with (
        LocalCluster(n_workers=0, host="127.0.0.1", dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        # -c, or the folder of the program itself would come before the one that hides it.
        start = (
            "import runpy, sys; sys.argv[0] = 'dask-worker'; runpy.run_module('distributed.cli.dask_worker', "
        )
        worker = subprocess.Popen(
            [
                *(sys.executable, "-c", start + "run_name='__main__')"),
                *(cluster.scheduler_address, "--nthreads", "1", "--no-dashboard", "--no-nanny"),
            ],
            env={**bare, "PYTHONPATH": str(tmp_path)},
            cwd=tmp_path,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            client.wait_for_workers(1, timeout=PATIENCE_S)
            run_key = RunKey(str(inputs), planned.scene_id, planned.ensemble_id, versions())
            with (
                refused("cluster.workers_unfit", "No module named"),
                leaving_in_order(client),
            ):  # as a run does
                make_ready(client, run_key)
        finally:
            worker.terminate()
            worker.wait(PATIENCE_S)
