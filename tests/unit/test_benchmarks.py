"""What the benchmarks compare the program with is measured rightly."""

import sys
from pathlib import Path

import numpy as np
import pybullet
import pytest

from models import Motion, Scene
from workers import shake


@pytest.fixture
def representations(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    import representations

    yield representations
    del sys.modules["representations"]


def test_the_bare_loop_of_bullet_leaves_the_programs_own_worlds_alone(representations):
    scene = Scene.block(0.2, 0.2, 0.6, friction=1.0)
    shake(scene, Motion(np.zeros((2, 3)), 0.01), "fast", shortcuts=False)  # the first world is the program's
    bodies = pybullet.getNumBodies(0)
    topples = representations.bare_loop(representations.corner_points, 1 / 128)
    # A tenth below and above the least sine of 1 s that overturns it by the event-driven integrator, 3.96 m/s2.
    answers = [topples(scene, representations.full_sine(a, 1.0)) for a in (3.56, 4.36)]
    assert answers == [False, True]
    assert pybullet.getNumBodies(0) == bodies
