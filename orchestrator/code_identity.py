"""Tells versions of the code that decides answers apart: releases do, but not what was changed by hand."""

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
"""As this process finds them when it begins: a file that is edited later is not what it has loaded."""

_OWN_SOURCE = Path(__file__).read_bytes()

_ONE_PARSES = threading.Lock()


@cache
def code() -> str:
    """Hash of the code of all that decides an answer.

    Comments and docstrings decide nothing, and their change must not strand the runs that go on.

    Reading syntax takes a second and more, which every worker would begin with: it is done once for these very bytes,
    and kept with the code compiled from them.
    """
    kept = FOLDER / f"identity-{_bytes_read()}.json" if FOLDER else None
    if kept is not None:
        with suppress(OSError, InputError):
            return str(read_json(kept, required=True)["code"])
    found, digest = deciding(), hashlib.blake2b(digest_size=8)
    for path in sorted(found):
        digest.update(found[path].encode())
    if kept is not None:
        with suppress(OSError):
            write_json(kept, {"code": digest.hexdigest()})
    return digest.hexdigest()


def _bytes_read() -> str:
    """Hash of all sources as they are, of this module and of the Python that reads their syntax."""
    digest = hashlib.blake2b(sys.version.encode() + _OWN_SOURCE, digest_size=8)
    for path, source in sorted(SOURCES.items()):
        digest.update(hashlib.blake2b(bytes(path.relative_to(_MODELS.parent)) + b"\0" + source).digest())
    return digest.hexdigest()


def deciding() -> dict[Path, str]:
    """Syntax of what a shake is made of: all of `workers`, and what they, scenes and ensembles import of `models`.

    How a scan becomes a scene decides the scene, not its shakes.
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
                names = [node.module, *(f"{node.module}.{one.name}" for one in node.names)]
                left += [_MODELS.joinpath(*str(name).split(".")[2:]).with_suffix(".py") for name in names]
        found[path] = without_words(tree, nodes)
    return found


def parsed(source: bytes) -> ast.Module:
    """Let no other thread run meanwhile: until Python 3.11.8, two that parse at once spoil each other's count of depth.

    They change places only in what Dask lets the collection of garbage call.
    """
    with _ONE_PARSES:
        collects = gc.isenabled()
        gc.disable()
        try:
            return ast.parse(source)
        finally:
            if collects:
                gc.enable()


def without_words(tree: ast.Module, nodes: Iterable[ast.AST]) -> str:
    """The syntax without comments, layout and strings that stand alone, as docstrings do."""
    for node in nodes:
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [  # type: ignore[attr-defined]
                one
                for one in body
                if not (isinstance(one, ast.Expr) and isinstance(getattr(one.value, "value", None), str))
            ]
    return ast.dump(tree)
