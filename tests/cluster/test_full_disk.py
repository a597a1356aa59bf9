"""A disk that fills up ends a run with one sentence, and what was stored stays."""

import shlex
import subprocess
import sys

import pytest
from answers import answers_of
from conftest import can_mount

PATIENCE_S = 120.0


@pytest.mark.thorough
@pytest.mark.skipif(not can_mount(), reason="only root can mount a small disk")
def test_a_full_disk_is_reported_and_the_run_resumes_once_there_is_room(inputs, undisturbed, tmp_path):
    """It fills as the run begins, and then as the rows come."""
    disk = tmp_path / "disk"
    disk.mkdir()
    needed_kb = sum(4 * -(-path.stat().st_size // 4096) for path in inputs.rglob("*") if path.is_file())
    program = [sys.executable, "-P", "-c", "from toppling.orchestrator.cli import main; main()"]
    words = ["run", inputs / "campaign.toml", "--out", disk / "run", "--workers", "1"]
    command = " ".join(map(shlex.quote, [*program, *map(str, words)]))
    shell = (
        f"mount -t tmpfs -o size={needed_kb - 20}k none {disk} && {command}; echo ended with $?; "
        f"mount -o remount,size={needed_kb + 75}k {disk} && {command}; echo ended with $?; "
        f"mount -o remount,size=8m {disk} && {command} && cp -r {disk}/run {tmp_path}/kept"
    )
    done = subprocess.run(
        ["unshare", "--mount", "sh", "-c", shell],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.stdout.count("ended with 1") == 2, done.stderr
    result = [line for line in done.stderr.splitlines() if "is full" in line]
    assert [line.startswith("toppling: the disk") for line in result] == [True, True]
    assert "Traceback" not in done.stderr
    assert done.returncode == 0, done.stderr
    assert answers_of(tmp_path / "kept") == undisturbed
