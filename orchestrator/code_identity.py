"""Hash of the code that determines results, which also detects local changes between releases."""

import hashlib
from functools import cache
from pathlib import Path

import toppling.models
import toppling.workers

_ROOMS = tuple(Path(room.__path__[0]) for room in (toppling.models, toppling.workers))
_NOT_OF_SHAKES = ("scan", "motions/formats")
"""Folders of `models` that only make scenes and records, which have their own hashes."""

SOURCES = {
    f"{room.name}/{path.relative_to(room)}": path.read_bytes()
    for room in _ROOMS
    for path in room.rglob("*.py")
    if not any(path.is_relative_to(room / folder) for folder in _NOT_OF_SHAKES)
}
"""Sources at the start of this process: files edited later differ from the loaded code."""


@cache
def code() -> str:
    """Hash of all code that determines results."""
    digest = hashlib.blake2b(digest_size=8)
    for name, source in sorted(SOURCES.items()):
        digest.update(name.encode() + hashlib.blake2b(source).digest())
    return digest.hexdigest()
