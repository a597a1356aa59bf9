"""What CONTRIBUTING says of adding things, done once each in a copy of the house."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MOST_FILES = 3

FORMAT = '''
"""A format of one line."""
import numpy as np
from toppling.models.motions.formats.component import Component, code_direction

NAME = "one line"

def recognises(head):
    return head.startswith("ONE LINE")

def read(file):
    samples = np.array(" ".join(file.lines).split()[2:], float)
    return [Component(samples, 0.01, code_direction("h1"), file.path, 1, NAME, label="h1")]
'''
HAZARD = '''
"""Levels in one line, rates in the next."""
from toppling.results.hazard.readers.stated import Statement

def matches(file):
    return file.text.startswith("LEVELS OF PGA")

def read(file):
    levels, rates = ([file.number(2, cell) for cell in line.split()] for line in file.lines[1:3])
    return [Statement(file.curve("pga_m_s2", levels, rates, 0.0))]
'''
FIGURE = '''
"""A figure."""
from matplotlib.figure import Figure
from toppling.results.drawing.style import style

def step_figure(table):
    with style():
        figure = Figure()
        figure.add_subplot().plot(table["steps"])
    return figure
'''
VERB = '''
"""`toppling hello`."""
import click

@click.command()
def hello():
    """Say hello."""
    click.echo("hello")
'''
ENGINE = '''
"""What the registry says of an engine."""
from dataclasses import replace
from toppling.workers.engines.bullet.description import BULLET

OTHER = replace(BULLET, name="other", title="Other")
'''
ADDED = {
    "CSV dialect": {"models/files/table.py": ('_SIGNS, _REMARKS = ";\\t,"', '_SIGNS, _REMARKS = ";\\t,|"')},
    "record format": {
        "models/motions/formats/one_line.py": FORMAT,
        "models/motions/formats/reading.py": (
            ("import columns,", "import columns, one_line,"), ("= (peer,", "= (one_line, peer,"),
        ),
    },
    "hazard file": {
        "results/hazard/readers/two_lines.py": HAZARD,
        "results/hazard/readers/__init__.py": (
            ("    text_columns,\n)", "    text_columns,\n    two_lines,\n)"), ('"text": (', '"text": (two_lines, '),
        ),
    },
    "intensity measure": {
        "models/motions/measures.py": (
            '    "directionality": Measure(',
            '    "rms_m_s2": Measure("root mean square", 1, "RMS", True, added_later=True),\n'
            '    "directionality": Measure(',
        ),
        "models/motions/intensity.py": (
            '        "directionality":',
            '        "rms_m_s2": float(np.sqrt(np.mean(length**2))),\n        "directionality":',
        ),
    },
    "column": {
        "workers/outcome.py": (
            ("    ended_by: str\n    steps", "    ended_by: str\n    rise_m: float\n    steps"),
            ("        ended_by=ended_by,\n", "        ended_by=ended_by,\n        rise_m=float(np.ptp(pose[:, 2])),\n"),
        ),
        "results/schema.py": (
            ('        ("ended_by",', '        ("rise_m", _REAL, _MAY, _SIZE, "m", "rise"),\n        ("ended_by",'),
            ('("rock", "engine_steps",', '("rock", "rise_m", "engine_steps",'),
        ),
    },
    "cost column": {
        "workers/outcome.py": ("    time_step_s: float\n", "    time_step_s: float\n    cpu_s: float = 0.0\n"),
        "workers/shake.py": (
            "result, wall_s=time.perf_counter() - began)",
            "result, wall_s=time.perf_counter() - began, cpu_s=time.process_time())",
        ),
        "results/schema.py": (
            ('        ("wall_s",', '        ("cpu_s", _REAL, _MAY, _SIZE, "s", "processor time"),\n        ("wall_s",'),
            ('"cpu", "kernels"),', '"cpu", "kernels", "cpu_s"),'),
        ),
    },
    "figure": {"results/drawing/step.py": FIGURE},
    "verb": {
        "orchestrator/verbs/hello.py": VERB,
        "orchestrator/cli.py": (
            ('"Prepare": (', '"Prepare": ("hello", '),
        ),
    },
    "engine": {
        "workers/engines/other.py": ENGINE,
        "workers/engines/__init__.py": (
            ("(BULLET, MUJOCO)", "(BULLET, MUJOCO, OTHER)"),
            ("import MUJOCO\n", "import MUJOCO\nfrom toppling.workers.engines.other import OTHER\n"),
        ),
    },
}  # fmt: skip
"""What a newcomer writes, by file: a new one whole, or replacements in one that there is."""

PROOF = """
import json
from pathlib import Path

import numpy as np
import pandas as pd
from click.testing import CliRunner

from toppling import Motion, Scene, shake
from toppling.models.motions.formats import read_file
from toppling.models.motions.intensity import measure
from toppling.models.motions.measures import COMPARED
from toppling.orchestrator.campaign import KEYS
from toppling.orchestrator.cli import cli
from toppling.results.drawing.step import step_figure
from toppling.results.hazard.readers import read_hazard
from toppling.results.drawing.style import short_name
from toppling.results.schema import SCHEMA
from toppling.workers.engines import ENGINES
from toppling.workers.job import outcome_of

def written(name, text):
    Path(name).write_text(text)
    return Path(name)

rows = "".join(f"{i / 100}|{i}.5|2.5|3.5\\n" for i in range(20))
table = written("a.csv", "time [s]|N [m/s2]|E [m/s2]|Z [m/s2]\\n" + rows)
one = written("a.one", "ONE LINE 1 2 3 4")
two_lines = written("a.txt", "LEVELS OF PGA\\n1.0 3.0\\n0.01 0.001\\n")
row = outcome_of(shake(Scene.block(0.3, 0.3, 1.0), Motion(np.full((20, 3), 0.01), 0.01), "fast"))
measured = measure(Motion(np.full((100, 3), 0.5), 0.01))
toppling = lambda *words: CliRunner().invoke(cli, words).output
print(json.dumps({
    "CSV dialect": len(read_file(table)) == 3,
    "record format": read_file(one)[0].acceleration_m_s2.tolist() == [1.0, 2.0, 3.0, 4.0],
    "hazard file": read_hazard(two_lines)[0].branches[0].curve.annual_rate.tolist() == [1e-2, 1e-3],
    "intensity measure": all("rms_m_s2" in each for each in (measured, COMPARED, SCHEMA.names))
        and short_name("rms_m_s2") == "RMS",
    "column": row["rise_m"] >= 0.0 and "rise_m" in SCHEMA.names,
    "cost column": row["cpu_s"] > 0.0 and "cpu_s" in SCHEMA.names,
    "figure": len(step_figure(pd.DataFrame({"steps": [1, 2]})).axes) == 1,
    "verb": "hello" in toppling("--help") and toppling("hello") == "hello\\n",
    "engine": "other" in ENGINES and "other" in str(KEYS),
}))
"""


@pytest.fixture(scope="module")
def proven(tmp_path_factory):
    """Whether each addition works, in a copy of the house that has them all."""
    folder = tmp_path_factory.mktemp("house")
    house = folder / "toppling"
    shutil.copytree(ROOT / "orchestrator" / "door", house)
    for room in ("models", "workers", "orchestrator", "results"):
        shutil.copytree(ROOT / room, house / room, ignore=shutil.ignore_patterns("__pycache__"))
    for changes in ADDED.values():
        for name, change in changes.items():
            change_file(house / name, change)
    # Uncompiled: the copy's code would be compiled anew, half a minute for a shake that takes no step.
    uncompiled = {"NUMBA_DISABLE_JIT": "1", "TOPPLING_CACHE": str(folder)}
    environment = {**os.environ, **uncompiled, "PYTHONPATH": str(folder)}
    found = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", PROOF], cwd=folder, env=environment, capture_output=True, text=True,
        timeout=100, check=False,
    )  # fmt: skip
    assert found.returncode == 0, found.stderr
    return json.loads(found.stdout.splitlines()[-1])


def change_file(path, change):
    """Write a new file, or replace what one has once each."""
    if isinstance(change, str):
        assert not path.exists()
        path.write_text(change, "utf-8")
        return
    text = path.read_text("utf-8")
    for old, new in [change] if isinstance(change[0], str) else change:
        assert text.count(old) == 1, f"{path.name}: {old!r} stands {text.count(old)} times"
        text = text.replace(old, new)
    path.write_text(text, "utf-8")


@pytest.mark.thorough
@pytest.mark.parametrize("what", ADDED)
def test_what_a_newcomer_adds_works_and_touches_few_files(what, proven):
    assert proven[what]
    assert len(ADDED[what]) <= MOST_FILES
