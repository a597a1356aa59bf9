"""What makes a run refuse to go on: other code that decides answers."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

import toppling.models
from toppling.orchestrator import code_identity
from toppling.orchestrator.code_identity import SOURCES, code

LOADED = """
import json, sys
import toppling.models.motions.ensemble, toppling.models.scene, toppling.workers.job
from toppling.workers import engines
for engine in engines.ENGINES.values():
    __import__(engine.module)
print(json.dumps([module.__file__ for name, module in sys.modules.items() if name.startswith("toppling.")]))
"""
"""What a shake loads."""


@pytest.mark.parametrize("name", ["workers/shake.py", "models/motions/ensemble.py"])
def test_whatever_can_change_an_answer_is_seen(name, monkeypatch):
    before = code.__wrapped__()
    monkeypatch.setitem(SOURCES, name, SOURCES[name] + b"x = 1")
    assert code.__wrapped__() != before


def test_a_file_that_is_edited_later_is_not_what_this_process_has_loaded(monkeypatch):
    before = code.__wrapped__()
    monkeypatch.setattr(Path, "read_bytes", lambda path: b"x = 1")
    assert code.__wrapped__() == before


def test_every_module_that_a_shake_loads_is_part_of_the_identity_of_the_code():
    """The options of a scan aside, whose names the reader of scenes knows."""
    loaded = json.loads(
        subprocess.run([sys.executable, "-c", LOADED], check=True, capture_output=True).stdout
    )
    root = Path(toppling.models.__path__[0]).resolve().parent
    missing = {Path(one).resolve().relative_to(root).as_posix() for one in loaded} - SOURCES.keys()
    assert {name for name in missing if not name.endswith("__init__.py")} <= {"models/scan/hints_file.py"}


def test_a_run_goes_on_when_only_what_makes_scenes_or_reads_records_has_changed():
    assert not [
        name for name in code_identity.SOURCES if name.startswith(("models/scan/", "models/motions/formats/"))
    ]
