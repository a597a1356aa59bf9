"""The public door: what users import, from any folder, from the checkout and from a wheel."""

import os
import re
import subprocess
import sys
from inspect import isclass, isfunction
from pathlib import Path

import pytest
from refusals import refused
from small_campaigns import campaign_in

import toppling

ROOT = Path(__file__).parents[2]
OPENS = "from toppling import Ensemble, Motion, Scene, open_run, shake; print(shake.__module__)"
ROOMS = ("models", "orchestrator", "results", "workers")


@pytest.fixture
def folder(tmp_path):
    """A folder of a user's own that holds others named as the rooms are."""
    for room in ROOMS:
        (tmp_path / room).mkdir()
        (tmp_path / room / "__init__.py").write_text("")
    return tmp_path


def answer(program, folder, **environment):
    command = [sys.executable, "-c", program]
    completed = subprocess.check_output(command, cwd=folder, env=os.environ | environment, text=True)
    return completed.split()[-1]


def test_the_door_opens_next_to_folders_named_as_the_rooms(folder):
    assert answer(OPENS, folder) == "toppling.workers.shaking"


def test_what_has_no_such_base_or_no_file_is_refused_with_a_code(tmp_path):
    with refused("scene.base_absent", 1):
        toppling.Scene.block(half_width=0.2, half_depth=0.2, half_height=0.6, friction=0.8).on_base(1)
    with refused("scan.no_files"):
        toppling.scan([], tmp_path / "scene")


def test_a_plan_prints_its_number_of_jobs(tmp_path):
    planned = toppling.plan(campaign_in(tmp_path, pga_m_s2=[1, 2]))
    assert f"jobs: {len(planned.jobs)}, " in repr(planned)


def test_every_name_at_the_door_leads_somewhere():
    assert all(getattr(toppling, name).__module__ == home for name, home in toppling._HOMES.items())
    assert sorted(toppling.__all__) == sorted(toppling._HOMES)
    with pytest.raises(AttributeError, match="no attribute 'shakes'"):
        toppling.shakes  # noqa: B018  (looking it up is the test)


def test_the_reference_lists_the_names_at_the_door_and_what_its_functions_hand_back():
    listed = re.findall(r"^::: (\S+)$", (ROOT / "docs" / "reference.md").read_text("utf-8"), re.MULTILINE)
    at_door = {f"{home}.{name}" for name, home in toppling._HOMES.items()}
    functions = [single for name in toppling.__all__ if isfunction(single := getattr(toppling, name))]
    words = {
        getattr(sys.modules[function.__module__], word, None)
        for function in functions
        for word in re.findall(r"\w+", str(function.__annotations__["return"]))
    }
    handed_back = {f"{entry.__module__}.{entry.__name__}" for entry in words if isclass(entry)}
    assert sorted(listed) == sorted(at_door | {name for name in handed_back if name.startswith("toppling.")})


def test_what_is_imported_at_the_door_is_imported_when_it_is_used(folder):
    program = "import sys, toppling; print(len({'numpy', 'pybullet', 'pandas', 'dask'} & set(sys.modules)))"
    assert answer(program, folder) == "0"


@pytest.mark.thorough
def test_a_wheel_holds_the_program_and_nothing_else(unpacked):
    tops = {path.name for path in unpacked.iterdir() if path.suffix != ".dist-info"}
    assert tops == {"toppling"}
    inside = {str(path.relative_to(unpacked / "toppling")) for path in unpacked.rglob("toppling/**/*.*")}
    whole = {
        str(path.relative_to(ROOT))
        for room in ROOMS
        for path in (ROOT / room).rglob("*.*")
        if path.suffix in (".py", ".yaml", ".json", ".js", ".css", ".html", ".LICENSE")
        and path.parent.name != "door"
    }
    assert inside == whole | {"__init__.py", "__main__.py", "py.typed"}


@pytest.mark.thorough
def test_the_demo_runs_from_a_wheel(unpacked, tmp_path):
    program = "from toppling.orchestrator.cli import main; main()"
    command = [sys.executable, "-c", program, "demo", "--out", "demo", "--seconds", "1"]
    environment = os.environ | {"PYTHONPATH": str(unpacked), "PYTHONDONTWRITEBYTECODE": "1"}
    completed = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=500, check=False
    )
    assert completed.returncode == 0, completed.stderr[-2000:]
    assert (tmp_path / "demo" / "scene" / "hints.toml").exists()  # as `toppling scan` leaves it
    assert (tmp_path / "demo" / "run" / "results.parquet").exists()
    assert list((tmp_path / "demo" / "fragility").rglob("*.png"))
