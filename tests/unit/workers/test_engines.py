"""The seam of engines: names stand in the registry alone, and whatever is registered shakes."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from refusals import refused

from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.workers import engines
from toppling.workers.options import PRESETS
from toppling.workers.shaking import shake

ROOT = Path(__file__).parents[3]
PUSH = Motion(np.vstack([np.full((20, 3), (6.0, 0.0, 0.0)), np.zeros((2, 3))]), 0.02)


@pytest.mark.parametrize("name", engines.ENGINES)
def test_an_engines_name_stands_in_its_own_folder_alone(name):
    rooms = [ROOT / room for room in ("models", "workers", "orchestrator", "results")]
    home = ROOT / "workers" / "engines"
    pattern = re.compile(rf"\b{name}\b", re.IGNORECASE)
    elsewhere = [
        str(path.relative_to(ROOT))
        for room in rooms
        for path in room.rglob("*.py")
        if home not in path.parents and pattern.search(path.read_text())
    ]
    assert not elsewhere


@pytest.mark.parametrize("engine", engines.ENGINES.values(), ids=lambda value: value.name)
def test_every_registered_engine_shakes_and_states_its_citation(engine):
    if engine.version is None:
        pytest.skip(f"{engine.title} is not installed")
    result = shake(Scene.block(0.1, 0.1, 0.5), PUSH, "fast", engine=engine.name)
    assert result.toppled
    assert engine.citation.keys() == {"name", "title", "authors", "reference"}
    assert list(engine.presets) == list(PRESETS)


def test_an_engine_is_added_by_an_entry_and_its_module(monkeypatch):
    another = dataclasses.replace(engines.ENGINES[engines.DEFAULT], name="another", restitution=False)
    monkeypatch.setitem(engines.ENGINES, "another", another)
    scene = Scene.block(0.1, 0.1, 0.5)
    assert shake(scene, PUSH, engine="another").topple_time_s == shake(scene, PUSH).topple_time_s
    with refused("engine.contact_unknown", "restitution 0.5"):
        shake(Scene.block(0.1, 0.1, 0.5, restitution=0.5), PUSH, engine="another")


@pytest.mark.parametrize("imports", ["absent", "absent.part"])
def test_an_engine_that_is_not_installed_is_refused_with_its_extra(monkeypatch, imports):
    absent = dataclasses.replace(
        engines.ENGINES[engines.DEFAULT], name="absent", imports=imports, extra="absent"
    )
    monkeypatch.setitem(engines.ENGINES, "absent", absent)
    with refused("package.not_installed", "pip install 'toppling[absent]'"):
        shake(Scene.block(0.1, 0.1, 0.5), PUSH, engine="absent")
