"""Connecting to a scheduler that somebody else has started, and workers that others start."""

import re
import threading
from pathlib import Path

import dask
import pytest
from refusals import refused

from toppling.orchestrator.cluster import existing, job_script, local

ROOT = Path(__file__).parents[3]


def test_an_address_that_asks_for_tls_is_refused_without_certificates_and_nothing_is_left_open():
    before = set(threading.enumerate())
    with refused("cluster.unreachable"):
        existing("tls://127.0.0.1:1", None, None).__enter__()
    # A client that is still open would wait for its loop for a minute when the program ends.
    assert set(threading.enumerate()) <= before


@pytest.mark.parametrize("asked", [(10_000, None), (1, 10_000)])
def test_more_workers_than_a_machine_has_room_for_are_refused_before_one_starts(asked):
    before = set(threading.enumerate())
    with refused("cluster.too_many_workers"):
        local(*asked)
    assert set(threading.enumerate()) <= before


CLOSED = "--no-dashboard --dashboard-address 127.0.0.1:0"
"""With the first alone a worker still answers at a port of all interfaces."""


@pytest.mark.parametrize("file", ["docker-compose.yml", "docs/guide/cluster.md"])
def test_workers_are_told_to_be_started_with_their_pages_closed(file):
    text = (ROOT / file).read_text("utf-8").replace("$closed", CLOSED)
    commands = [line for line in text.splitlines() if re.search("dask worker (tcp|tls|--)", line)]
    assert commands
    assert [line for line in commands if CLOSED not in line] == []


def test_workers_of_batch_jobs_have_their_pages_closed_and_what_the_configuration_adds(monkeypatch, tmp_path):
    pytest.importorskip("dask_jobqueue")
    monkeypatch.chdir(tmp_path)
    with dask.config.set(
        {"jobqueue.slurm.memory": "2GB", "jobqueue.slurm.worker-extra-args": ["--lifetime", "55m"]}
    ):
        script = job_script("slurm")
    assert f"{CLOSED} --lifetime 55m" in script
