"""The debugging recipe of CONTRIBUTING: the compiled code also runs as plain Python, and gives the same answer."""

import json
import os
import subprocess
import sys

import pytest

SHAKE = """
import dataclasses, json
import numpy as np
from toppling import Motion, Scene, shake
from toppling.workers.options import PRESETS

time_s = np.arange(0, 1.2, 0.01)
pulse = np.column_stack([5.0 * np.sin(2 * np.pi * time_s / 1.2), 0.8 * np.cos(7 * time_s), 0 * time_s])
options = dataclasses.replace(PRESETS["fast"], checked_steps=0.1)
result = shake(Scene.block(0.3, 0.3, 1.0), Motion(pulse, 0.01), options)
print(json.dumps([result.outcome, result.steps, result.engine_steps, result.topple_time_s, result.slip_m]))
"""


def answer(**environment):
    found = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", SHAKE], env={**os.environ, **environment}, capture_output=True,
        text=True, timeout=100, check=False,
    )  # fmt: skip
    assert found.returncode == 0, found.stderr
    assert "pybullet" not in found.stderr.casefold()
    return json.loads(found.stdout)  # the engine writes nothing to the terminal


@pytest.mark.thorough
def test_a_shake_with_its_engine_gives_the_same_answer_compiled_and_not(tmp_path):
    compiled = answer()
    uncompiled = answer(NUMBA_DISABLE_JIT="1", TOPPLING_CACHE=str(tmp_path))
    assert compiled[0] == "toppled"
    assert compiled[2] > 0  # steps of the engine are among them
    assert uncompiled[:3] == compiled[:3]
    # Compilers may fuse a multiplication and an addition: rounding, which 650 steps of a fall magnify little.
    assert abs(uncompiled[3] - compiled[3]) < 1e-6
    assert abs(uncompiled[4] - compiled[4]) < 1e-6
