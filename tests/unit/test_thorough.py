"""Thorough tests run again exactly when a file on which they depend has changed."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / ".ci" / "thorough.py"
TREE = {
    "requirements.lock": "",
    "pyproject.toml": "",
    "orchestrator/door/__init__.py": '_HOMES = {"Low": "toppling.models.low"}\n',
    "models/low.py": "",
    "models/high.py": "from toppling.models.low import Low\n",
    "results/apart.py": "",
    "tests/conftest.py": "",
    "tests/helper.py": "from toppling.results import apart\n",
    "tests/test_high.py": "import toppling.models.high\n@pytest.mark.thorough\n",
    "tests/test_door.py": "from toppling import Low\n@pytest.mark.thorough\n",
    "tests/test_helped.py": "import helper\n@pytest.mark.thorough\n",
    "tests/test_whole.py": "import subprocess\n@pytest.mark.thorough\n",
    "tests/test_fast.py": "",
}
EVERY = {"high", "door", "helped", "whole"}


@pytest.fixture
def tree(tmp_path):
    for name, text in TREE.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text.replace("@pytest.mark.thorough", "'pytest.mark.thorough'"))
    (tmp_path / ".ci").mkdir()
    shutil.copy(SCRIPT, tmp_path / ".ci")
    code = (
        "import json, sys; sys.path.insert(0, '.'); import thorough; print(json.dumps(thorough.unproven()))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path / ".ci", capture_output=True, text=True, check=True
    )
    (tmp_path / ".ci" / "passed.json").write_text(done.stdout)
    assert {name.removeprefix("tests/test_") for name in json.loads(done.stdout)} == {
        f"{entry}.py" for entry in EVERY
    }
    return tmp_path


def listed(tree):
    done = subprocess.run(
        [sys.executable, tree / ".ci" / "thorough.py", "list"], capture_output=True, text=True, check=True
    )
    return {Path(line).stem.removeprefix("test_") for line in done.stdout.split()}


@pytest.mark.parametrize(
    ("changed", "run_again"),
    [
        ("models/low.py", {"high", "door", "whole"}), ("models/high.py", {"high", "whole"}),
        ("results/apart.py", {"helped", "whole"}), ("tests/helper.py", {"helped"}),
        ("tests/test_high.py", {"high"}), ("tests/test_fast.py", set()), ("tests/conftest.py", EVERY),
        ("requirements.lock", EVERY),
    ],
)  # fmt: skip
def test_what_depends_on_a_changed_file_runs_again_and_nothing_else(tree, changed, run_again):
    assert listed(tree) == set()
    with (tree / changed).open("a") as file:
        file.write("\n# changed\n")
    assert listed(tree) == run_again
