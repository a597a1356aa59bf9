"""What the benchmarks compare the program with is measured rightly."""

import sys
from importlib import import_module
from pathlib import Path

import pytest

from toppling.models.scene import Scene
from toppling.workers.shake import shake


@pytest.fixture
def benchmark_named(monkeypatch):
    folder = Path(__file__).parents[2] / "benchmarks"
    monkeypatch.syspath_prepend(str(folder))
    yield import_module
    for file in folder.glob("*.py"):
        sys.modules.pop(file.stem, None)


@pytest.fixture
def representations(benchmark_named):
    return benchmark_named("representations")


def test_the_bare_loop_of_bullet_leaves_the_programs_own_worlds_alone(representations):
    scene = Scene.block(0.2, 0.2, 0.6, friction=1.0)
    ours = representations.full_sine(3.3, 1.0)
    before = shake(scene, ours, "fast")
    topples = representations.bare_loop(representations.corner_points, 1 / 128)
    # A tenth below and above the least sine of 1 s that overturns it by the event-driven integrator, 3.96 m/s2.
    answers = [topples(scene, representations.full_sine(a, 1.0)) for a in (3.56, 4.36)]
    assert answers == [False, True]
    assert shake(scene, ours, "fast").max_tilt_deg == before.max_tilt_deg
