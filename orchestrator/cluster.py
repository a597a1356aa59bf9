"""Where the jobs run: workers on this machine, or a scheduler that exists."""

import contextlib
import logging
from collections.abc import Iterator
from pathlib import Path

import dask
from distributed import Client, LocalCluster

log = logging.getLogger(__name__)


def load_defaults() -> None:
    """Put the project's Dask settings below the user's files and DASK_* variables."""
    dask.config.update_defaults(*dask.config.collect_yaml([str(Path(__file__).with_name("dask.yaml"))]))


@contextlib.contextmanager
def local(workers: int) -> Iterator[Client]:
    """Start worker processes with one thread each, bound to the loopback interface."""
    load_defaults()
    with (
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.ERROR,
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client
