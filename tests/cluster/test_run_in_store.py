"""A run in an object store: carried out, killed, continued and read from machines that share no disk."""

import os
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from answers import answers_of
from waiting import wait_until

from toppling.models.compiled import FOLDER
from toppling.models.files.stores import Copy
from toppling.workers.shaking import compile_once

PATIENCE_S = 120.0
ADDRESS = "s3://bucket/runs/first"
TOPPLING = [sys.executable, "-P", "-c", "from toppling.orchestrator.cli import main; main()"]


@pytest.fixture
def machine(tmp_path):
    """Environment of another machine: a cache of its own, with the code compiled for this processor."""
    compile_once()

    def of(name):
        cache = tmp_path / name
        if FOLDER is not None and not cache.exists():
            shutil.copytree(FOLDER, cache / FOLDER.name)
        return os.environ | {"TOPPLING_CACHE": str(cache)}

    return of


def toppling(*words, env, refused=False):
    done = subprocess.run(
        [*TOPPLING, *map(str, words)],
        env=env,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == int(refused), done.stderr
    return done.stdout + done.stderr


@pytest.mark.thorough
def test_a_run_in_a_store_has_one_writer_and_resumes_after_a_takeover(
    bucket, machine, inputs, undisturbed, faults, tmp_path
):
    command = ["run", inputs / "campaign.toml", "--out", ADDRESS, "--workers", "2"]
    faults.set(every=2.0)
    first = subprocess.Popen(
        [*TOPPLING, *map(str, command)], env=machine("first"),
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip
    looked_at = Copy(ADDRESS, tmp_path / "look" / "run")

    def has_rows():
        assert first.poll() is None
        looked_at.pull()
        return any((looked_at.path / "parts").glob("part-*"))

    wait_until(has_rows, pause_s=0.5)
    result = toppling(*command, env=machine("second"), refused=True)
    owner = f"{socket.gethostname()}:{first.pid} since"
    assert f"{ADDRESS}: is written to by {owner}" in result
    assert f"{ADDRESS}: running" in toppling("status", ADDRESS, env=machine("second"))
    os.killpg(first.pid, signal.SIGKILL)
    first.wait()
    faults.clear()

    result = toppling("status", ADDRESS, env=machine("second"))
    assert "of 72" in result
    assert owner in result
    for name in ("first", "second"):
        result = toppling(*command, env=machine(name), refused=True)
        assert owner in result
        assert "--take-over" in result
    result = toppling(*command, "--take-over", env=machine("second"))
    assert f"{ADDRESS}: " in result
    assert f"toppling fragility {ADDRESS}" in result
    assert " 0 done before" not in result
    assert owner in result  # whose place is taken

    looked_at.pull()
    assert not list(Path(looked_at.path / "parts").glob("part-*"))
    assert answers_of(looked_at.path) == undisturbed
    counted = toppling("query", ADDRESS, "select count(*) from results", "--csv", env=machine("third"))
    assert "72" in counted
