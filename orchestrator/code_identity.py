"""Hash of the code that determines results, which also detects local changes between releases."""

import ast
import gc
import hashlib
import sys
import threading
from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from pathlib import Path

import toppling.models
import toppling.workers
from toppling.models.compiled import FOLDER
from toppling.models.errors import InputError
from toppling.models.files.digest import read_json, write_json

_MODELS, _WORKERS = Path(toppling.models.__path__[0]), Path(toppling.workers.__path__[0])

SOURCES = {path: path.read_bytes() for room in (_MODELS, _WORKERS) for path in room.rglob("*.py")}
"""Sources at the start of this process: files edited later differ from the loaded code."""

_OWN_SOURCE = Path(__file__).read_bytes()

_PARSER_LOCK = threading.Lock()


@cache
def code() -> str:
    """Hash of all code that determines results.

    Comments and docstrings are ignored, so that editing them does not prevent resuming a run.

    Parsing takes more than a second, at the start of every worker: its result is cached with the compiled code of the
    same sources.
    """
    cached = FOLDER / f"identity-{_bytes_read()}.json" if FOLDER else None
    if cached is not None:
        with suppress(OSError, InputError):
            return str(read_json(cached, required=True)["code"])
    found, digest = deciding(), hashlib.blake2b(digest_size=8)
    for path in sorted(found):
        digest.update(found[path].encode())
    if cached is not None:
        with suppress(OSError):
            write_json(cached, {"code": digest.hexdigest()})
    return digest.hexdigest()


def _bytes_read() -> str:
    """Hash of the bytes of all sources, of this module, and of the Python version that parses them."""
    digest = hashlib.blake2b(sys.version.encode() + _OWN_SOURCE, digest_size=8)
    for path, source in sorted(SOURCES.items()):
        digest.update(hashlib.blake2b(bytes(path.relative_to(_MODELS.parent)) + b"\0" + source).digest())
    return digest.hexdigest()


def deciding() -> dict[Path, str]:
    """Syntax of the modules that determine a shake: `workers`, and what they, scenes and ensembles import of `models`.

    The conversion of scans to scenes is excluded: it determines the scene, which has its own hash.
    """
    left = [path for path in SOURCES if path.is_relative_to(_WORKERS)]
    left += [_MODELS / "scene.py", _MODELS / "motions/ensemble.py"]
    found: dict[Path, str] = {}
    while left:
        path = left.pop()
        if path in found or path not in SOURCES or path.parent == _MODELS / "scan":
            continue
        tree = parsed(SOURCES[path])
        nodes = list(ast.walk(tree))
        for node in nodes:
            if isinstance(node, ast.ImportFrom) and str(node.module).startswith("toppling.models"):
                names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
                left += [_MODELS.joinpath(*str(name).split(".")[2:]).with_suffix(".py") for name in names]
        found[path] = without_words(tree, nodes)
    return found


def parsed(source: bytes) -> ast.Module:
    """Parse without thread switches: until Python 3.11.8, concurrent parsers corrupt each other's recursion depth.

    Threads can switch here only in callbacks of Dask's garbage collection.
    """
    with _PARSER_LOCK:
        collects = gc.isenabled()
        gc.disable()
        try:
            return ast.parse(source)
        finally:
            if collects:
                gc.enable()


def without_words(tree: ast.Module, nodes: Iterable[ast.AST]) -> str:
    """Syntax without comments, layout and stand-alone strings such as docstrings."""
    for node in nodes:
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [  # type: ignore[attr-defined]
                statement
                for statement in body
                if not (
                    isinstance(statement, ast.Expr)
                    and isinstance(getattr(statement.value, "value", None), str)
                )
            ]
    return ast.dump(tree)
