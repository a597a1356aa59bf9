"""Nothing of the working folder is executed or obeyed, by no process that is started."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

MODULE = """\
import os
with open({mark!r}, "a") as file:
    file.write(__name__ + "\\n")
"""
IMPORTED = """\
import sys
import toppling.orchestrator.task, toppling.models.files.given, distributed.nanny, distributed.cli.dask_worker
import multiprocessing.spawn, multiprocessing.resource_tracker, distributed.diskutils, distributed.security
print("\\n".join(sorted({name.partition(".")[0] for name in sys.modules})))
"""
COMMAND = Path(sys.executable).with_name("toppling")
DISOBEYED = {
    ".numba_config.yaml": "disable_jit: 1\nopt: 0\ndeveloper_mode: 1\n",
    "matplotlibrc": "text.usetex: True\nfigure.dpi: 3\n",
    "dask.yaml": "distributed:\n  worker:\n    preload: [evil]\n",
}


def module_names():
    """Top-level names of the standard library and of all that a worker imports, the program's own aside."""
    completed = subprocess.run(
        [sys.executable, "-P", "-c", IMPORTED], capture_output=True, text=True, check=True
    ).stdout
    names = sys.stdlib_module_names | set(completed.split())
    return sorted(name for name in names if name.isidentifier() and name not in ("toppling", "__main__"))


@pytest.fixture
def hostile(inputs, tmp_path):
    """A campaign's folder with a module of every name beside it, and the file that shows which were executed."""
    folder, mark = tmp_path / "work", tmp_path / "executed"
    shutil.copytree(inputs, folder)
    names = module_names()
    assert len(names) > 300
    assert {"signal", "random", "pickle", "numpy", "numba", "distributed", "yaml"} <= set(names)
    for name in {*names, "evil", "pybullet"}:
        (folder / f"{name}.py").write_text(MODULE.format(mark=str(mark)))
    for name, text in DISOBEYED.items():
        (folder / name).write_text(text)
    return folder, mark


def call(folder, *words, **environment):
    environment = {
        name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"
    } | environment
    return subprocess.run(
        [COMMAND, *words], cwd=folder, env=environment, capture_output=True, text=True, timeout=1700
    )


def executed(mark):
    return mark.read_text().split() if mark.exists() else []


def test_the_trap_works_on_a_python_that_is_started_carelessly(hostile):
    folder, mark = hostile
    careless = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    subprocess.run(
        [sys.executable, "-c", "import colorsys"], cwd=folder, env=careless, check=False, capture_output=True
    )
    assert "colorsys" in executed(mark)


@pytest.mark.timeout(1800)  # what compiles waits for other work on the machine
@pytest.mark.parametrize(
    "compiled",
    [pytest.param(True, marks=pytest.mark.thorough), pytest.param(False, marks=pytest.mark.slow)],
    ids=["compiled", "not yet"],
)
def test_no_module_of_the_working_folder_is_executed_by_a_run(compiled, hostile, tmp_path):
    folder, mark = hostile
    cache = {} if compiled else {"TOPPLING_CACHE": str(tmp_path / "cache")}
    done = call(folder, "run", "campaign.toml", "--out", "run", "--workers", "2", **cache)
    assert done.returncode == 0, done.stderr
    assert compiled or "compiling" in done.stderr
    assert executed(mark) == []
    assert "72" in call(folder, "query", "run", "select count(*) n from results where status = 'ok'").stdout
    assert executed(mark) == []


@pytest.mark.thorough
def test_reading_strangers_files_executes_nothing_next_to_them(hostile):
    folder, mark = hostile
    (folder / "records").mkdir()
    (folder / "records" / "quake.mseed").write_bytes(b"no miniSEED")
    (folder / "cloud.laz").write_bytes(b"LASF of no kind")
    for words in (
        ["records", "import", "records", "--out", "ensemble2"],
        ["scan", "cloud.laz", "--out", "rock"],
        ["scene", "show", "scene", "--out", "page"],
        ["status", "run"],
    ):
        call(folder, *words)
        assert executed(mark) == [], words
