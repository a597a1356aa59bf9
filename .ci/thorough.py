"""Run the thorough tests of what has changed since they last passed.

    python .ci/thorough.py run [PYTEST OPTIONS]    # run the files that differ from .ci/passed.json, and note them there
    python .ci/thorough.py run --all               # run all of them
    python .ci/thorough.py list                    # name the files that would run

A file of tests is known by the hash of itself, of the files beside it that are no tests, of the lock file, and of all
modules of the rooms that it imports, directly or through others. A test that starts the command, or a cluster, depends
on every module. .ci/passed.json is committed: a clone does not run again what has passed with the same content.
"""

import ast
import hashlib
import json
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
PASSED = ROOT / ".ci" / "passed.json"
ROOMS = ("models", "workers", "orchestrator", "results")
STARTS_ALL = re.compile(r"subprocess|CliRunner|_TOPPLING|TOPPLING\b|local\(|Client\(")
"""In a test: the program is run as a whole."""


def marked() -> list[Path]:
    """Files with thorough tests."""
    return sorted(p for p in (ROOT / "tests").rglob("test_*.py") if "mark.thorough" in p.read_text("utf-8"))


@cache
def _module(name: str) -> Path | None:
    """File of a module of the rooms."""
    parts = name.split(".")[1:]
    if not parts or parts[0] not in ROOMS:
        return None
    path = ROOT.joinpath(*parts)
    for found in (path.with_suffix(".py"), path / "__init__.py"):
        if found.exists():
            return found
    return None


@cache
def _homes() -> dict[str, str]:
    """Modules behind the names at the door, which imports them by name."""
    text = (ROOT / "orchestrator" / "door" / "__init__.py").read_text("utf-8")
    return dict(re.findall(r'"(\w+)": "(toppling[.\w]+)"', text))


@cache
def _helpers() -> dict[str, Path]:
    """Files of the tests that are no tests, by the names under which tests import them."""
    return {one.stem: one for one in (ROOT / "tests").rglob("*.py") if not one.name.startswith("test_")}


@cache
def _imports(path: Path) -> frozenset[Path]:
    """Modules of the rooms, and helpers of the tests, that a file imports or names in a text."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            names |= set(re.findall(r"toppling(?:\.\w+)+", node.value)) if "\n" not in node.value else set()
    names |= {home for name, home in _homes().items() if f"toppling.{name}" in names}
    helpers = {one for name in names for part in name.split(".") if (one := _helpers().get(part))}
    return frozenset({found for name in names if (found := _module(name))} | helpers)


def depends_on(test: Path) -> set[Path]:
    """All files on which the outcome of a file of tests may depend."""
    conftests = {
        one for folder in test.parents if (one := folder / "conftest.py").exists() and ROOT in folder.parents
    }
    found = {test, *conftests}
    if STARTS_ALL.search(test.read_text("utf-8")):
        found |= {
            one for room in ROOMS for one in (ROOT / room).rglob("*.*") if "__pycache__" not in one.parts
        }
    waiting = list(found)
    while waiting:
        new = _imports(one) - found if (one := waiting.pop()).suffix == ".py" else set()
        found |= new
        waiting += new
    return found | {ROOT / "requirements.lock", ROOT / "pyproject.toml"}


def digest_of(test: Path) -> str:
    """Hash of all on which a file of tests depends."""
    total = hashlib.sha256()
    for path in sorted(depends_on(test)):
        total.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes() + b"\0")
    return total.hexdigest()[:16]


def unproven(everything: bool = False) -> dict[str, str]:
    """Files to run, and their hashes."""
    passed = json.loads(PASSED.read_text("utf-8")) if PASSED.exists() else {}
    named = {str(one.relative_to(ROOT)): digest_of(one) for one in marked()}
    return {name: digest for name, digest in named.items() if everything or passed.get(name) != digest}


def main() -> int:
    command, *options = sys.argv[1:] or ["list"]
    waiting = unproven("--all" in options)
    if command == "list":
        print("\n".join(waiting))
        return 0
    print(
        f"thorough tests: {len(waiting)} of {len(marked())} files have changed since they passed", flush=True
    )
    options = [one for one in options if one != "--all"]
    clusters = [name for name in waiting if name.startswith("tests/cluster")]
    others = [name for name in waiting if name not in clusters]
    for files, processes in (
        (others, ["--numprocesses", "logical", "--dist", "worksteal"]),
        (clusters, ["--numprocesses", "2", "--dist", "loadfile"]),
    ):
        if files:
            done = subprocess.run(
                [sys.executable, "-m", "pytest", "-m", "thorough and not slow", *processes, *options, *files],
                cwd=ROOT,
                check=False,
            )
            if done.returncode:
                return done.returncode
    passed = json.loads(PASSED.read_text("utf-8")) if PASSED.exists() else {}
    known = {str(one.relative_to(ROOT)) for one in marked()}
    PASSED.write_text(
        json.dumps(
            {name: digest for name, digest in sorted((passed | waiting).items()) if name in known}, indent=1
        )
        + "\n",
        "utf-8",
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
