"""What makes a run refuse to go on: code that decides answers, not what is said about it."""

import ast
import gc
import json
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import toppling.models
from toppling.orchestrator import code_identity
from toppling.orchestrator.code_identity import code, parsed, without_words


def _decisive(source):
    """A module's syntax without comments, layout and strings that stand alone, as docstrings do."""
    tree = parsed(source)
    return without_words(tree, ast.walk(tree))


MODULE = b'''"""What it knows."""
import math

LIMIT = 0.5
"""Why so."""


class Law:
    """A law."""

    def value(self, x):
        """Of x."""
        return math.sin(x) * LIMIT  # bounded
'''


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"What it knows.", b"Other words."), (b"Why so.", b"For another reason."), (b"Of x.", b"Of the angle."),
        (b"# bounded", b"# and said otherwise"), (b"math.sin(x) * LIMIT", b"(math.sin(x)\n            * LIMIT)"),
        (b'        """Of x."""\n', b""),
    ],
)  # fmt: skip
def test_words_and_layout_decide_nothing(old, new):
    assert MODULE.replace(old, new) != MODULE
    assert _decisive(MODULE.replace(old, new)) == _decisive(MODULE)


@pytest.mark.parametrize(
    ("old", "new"),
    [(b"0.5", b"0.51"), (b"math.sin(x) * LIMIT", b"LIMIT * math.sin(x)"), (b"(self, x)", b"(self, x=1)")],
)
def test_whatever_can_change_an_answer_is_seen(old, new):
    assert _decisive(MODULE.replace(old, new)) != _decisive(MODULE)


@pytest.fixture
def few(tmp_path, monkeypatch):
    """A program of few modules, of which nothing is kept yet."""
    names = ("shake.py", "options.py")
    sources = {path: source for path, source in code_identity.SOURCES.items() if path.name in names}
    monkeypatch.setattr(code_identity, "SOURCES", sources)
    monkeypatch.setattr(code_identity, "FOLDER", tmp_path)
    return sources


def test_the_identity_of_the_code_is_quickly_told_where_none_is_kept(monkeypatch):
    monkeypatch.setattr(code_identity, "FOLDER", None)
    began = time.process_time()
    assert code.__wrapped__() == code()
    assert time.process_time() - began < 5.0


def test_code_that_was_read_once_is_not_read_again(few, monkeypatch):
    before = code.__wrapped__()
    monkeypatch.setattr(code_identity, "deciding", lambda: pytest.fail("read again"))
    assert code.__wrapped__() == before


@pytest.mark.parametrize("damage", [b"", b"0" * 16 + b" " + b"0" * 16, b"\xff"])
def test_a_kept_identity_that_is_damaged_is_made_anew(few, damage, tmp_path):
    before = code.__wrapped__()
    (kept,) = tmp_path.iterdir()
    kept.write_bytes(damage)
    assert code.__wrapped__() == before
    assert kept.read_bytes() != damage


def test_a_file_that_is_edited_later_is_not_what_this_process_has_loaded(few, monkeypatch):
    edited = next(path for path in few if path.name == "shake.py")
    before = code.__wrapped__()
    found = {path: path.read_bytes() for path in few}
    monkeypatch.setattr(Path, "read_bytes", lambda path: b"x = 1" if path == edited else found[path])
    monkeypatch.setattr(code_identity, "FOLDER", None)
    assert code.__wrapped__() == before
    monkeypatch.setitem(few, edited, b"x = 1")
    assert code.__wrapped__() != before


def test_threads_may_read_code_at_once_whatever_the_collection_of_garbage_calls():
    """A worker is asked whether it is fit while its tasks run, and Dask listens to the collection."""
    sources, interval = list(code_identity.SOURCES.values())[:40], sys.getswitchinterval()

    def takes_a_while(phase, info):
        sum(range(200))

    gc.callbacks.append(takes_a_while)
    sys.setswitchinterval(1e-5)
    try:
        with ThreadPoolExecutor(3) as threads:
            told = list(threads.map(_decisive, sources * 3))
    finally:
        sys.setswitchinterval(interval)
        gc.callbacks.remove(takes_a_while)
    assert told == [_decisive(source) for source in sources] * 3


LOADED = """
import json, sys
import toppling.models.motions.ensemble, toppling.models.scene, toppling.workers.job
from toppling.workers import engines
for engine in engines.ENGINES.values():
    __import__(engine.module)
print(json.dumps([module.__file__ for name, module in sys.modules.items() if name.startswith("toppling.")]))
"""


def test_every_module_that_a_shake_loads_is_part_of_the_identity_of_the_code():
    """The options of a scan aside, whose names the reader of scenes knows, and what comes with them."""
    loaded = json.loads(
        subprocess.run([sys.executable, "-c", LOADED], check=True, capture_output=True).stdout
    )
    missing = {Path(one).resolve() for one in loaded} - {path.resolve() for path in code_identity.deciding()}
    assert {path.name for path in missing if path.name != "__init__.py"} <= {
        "hints_file.py",
        "spelling.py",
        "matplotlib_alone.py",
    }


def test_no_module_that_only_scans_and_readers_of_records_use_is_part_of_it():
    """A run goes on when one of them has changed."""
    decides = {
        path.relative_to(Path(toppling.models.__path__[0]).parent).as_posix()
        for path in code_identity.deciding()
    }
    assert {"models/hidden_base/draws.py", "models/motions/ensemble.py", "workers/shake.py"} <= decides
    assert not decides & {
        f"models/hidden_base/{name}.py" for name in ("observed", "kinds", "underside", "standing")
    }
    assert not any(name.startswith(("models/scan/", "models/motions/formats/")) for name in decides)
