"""Hazard as it comes: files and folders of OpenQuake, nshmp-haz and CyberShake, and two columns, found by content."""

from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

from toppling.models.errors import InputError
from toppling.models.files.given import HEAD_BYTES, bytes_given, open_given, other_kind, text_of
from toppling.results.hazard.readers import nshmp, openquake_curves, opensha, text_columns
from toppling.results.hazard.readers.assembly import (
    HEAD_LINES,
    HazardFile,
    Hints,
    Realisations,
    Stated,
    combined,
    refuse,
    refused,
    trees_of,
)
from toppling.results.hazard.tree import HazardTree

__all__ = ["Hints", "assembly", "event_sets", "read_hazard"]

_MOST_FILES = 20_000
"""Maximum number of files in a folder."""

_DIALECTS: dict[str, tuple[ModuleType, ...]] = {
    "json": (nshmp,),
    "text": (opensha, openquake_curves, nshmp, text_columns),
}
"""Modules by the kind of file, in the order in which they are asked `matches(file)`; `read(file)` states what is
in one. The last of a kind says what is wrong with a file that nobody recognises."""

_SUFFIXES = {".csv", ".txt", ".json", ".dat", ".tsv", ""}
_EXPORT = "export its curves as text: oq export hcurves --export-type csv"


def read_hazard(
    paths: Path | Sequence[Path], weights: Sequence[float] | None = None, hints: Hints | None = None
) -> list[HazardTree]:
    """Read trees of hazard, one for each intensity measure and site.

    paths: a file, a folder with the output of one calculation, or several. Several files of one calculation of
    OpenQuake (its realizations.csv among them) are its tree; otherwise each path is a branch, or a part of the tree
    with branches of its own.
    weights: of several paths, summing to 1; equal if not given.
    hints: what the user says, where files do not, and the only site that is read.
    Raises InputError if a path is absent or holds no hazard; states neither unit nor time; or paths do not go together.
    """
    hints = hints or Hints()
    given = [paths] if isinstance(paths, Path) else list(paths)
    stated = [_stated(path, hints) for path in given]
    alone = len(given) == 1
    if alone or (weights is None and _of_same_tree(given, stated)):
        where = str(given[0]) if alone else "--hazard"
        return trees_of([statement for found in stated for statement in found], where)
    parts = [trees_of(found, str(path)) for path, found in zip(given, stated, strict=True)]
    return combined(parts, [str(path) for path in given], weights)


def _of_same_tree(paths: Sequence[Path], stated: Sequence[list[Stated]]) -> bool:
    """Whether paths are the files of one calculation's tree, as realisations' weights or fractiles among them show."""
    if any(path.is_dir() for path in paths):
        return False
    found = [statements for files in stated for statements in files]
    return any(
        isinstance(statements, Realisations)
        or any(curve.kind in ("fractile", "part") for curve in statements)
        for statements in found
    )


def _stated(path: Path, hints: Hints) -> list[Stated]:
    """Statements of a file, or of the files of a folder that state hazard."""
    if not path.is_dir():
        return [_read(path, hints)]
    found = []
    files = sorted(inner for inner in path.rglob("*") if inner.suffix in _SUFFIXES and inner.is_file())
    if len(files) > _MOST_FILES:
        refuse("hazard.too_many_files", path, f"holds {len(files):,} files",
            "give the folder of one calculation")  # fmt: skip
    others = []
    for inner in files:
        if any(part.startswith(".") for part in inner.relative_to(path).parts):
            continue
        if (file := _beginning(inner)) is None:
            continue
        if other := _other_output(file):
            others.append((file, other))
        elif any(dialect.matches(file) for dialect in _DIALECTS[file.kind]):
            found.append(_read(inner, hints))
    if not found:
        for file, other in others:
            file.refuse("hazard.other_output", *other)
        for datastore in path.glob("*.hdf5"):
            refuse("file.binary", datastore, "is HDF5, as OpenQuake's datastore is", _EXPORT)
        refuse("hazard.no_file", path, f"holds no file of hazard among {len(files)} of text",
            "give the folder with the curves")  # fmt: skip
    return found


def _text(path: Path) -> str:
    content = bytes_given(path, refused)
    if other := other_kind(content[:HEAD_BYTES]):
        remedy = _EXPORT if content.startswith(b"\x89HDF") else other[1]
        refuse("file.binary", path, f"is {other[0]}", remedy)
    if (text := text_of(content)) is None:
        refuse("file.not_text", path, "is no text")
    if text.lstrip().startswith("<"):
        refuse("hazard.other_output", path, "is XML, as OpenQuake's NRML is, or a web page", _EXPORT)
    return text


def _beginning(path: Path) -> HazardFile | None:
    """First lines of a file of a folder, where it is text; all of JSON, whose keys may stand anywhere."""
    try:
        with open_given(path, refused) as head:
            text = text_of(b"".join(head.readline(1_000_000) for _ in range(HEAD_LINES)))
        if text is None or text.startswith("\n") or "\0" in text:
            return None
        file = HazardFile(path, _text(path) if path.suffix in (".json", ".geojson") else text)
        return file if file.kind != "text" or file.table else None
    except InputError:
        return None


def _other_output(file: HazardFile) -> tuple[str, str] | None:
    """Kind of a program's table without curves, and what to give instead; None for curves."""
    if file.kind != "text":
        return None
    return openquake_curves.other_output(file) or nshmp.other_output(file)


def _read(path: Path, hints: Hints) -> Stated:
    file = HazardFile(path, _text(path), hints)
    if not file.text.strip():
        refuse("file.empty", path, "is empty")
    dialects = _DIALECTS[file.kind]
    try:
        dialect = next((known for known in dialects if known.matches(file)), dialects[-1])
        if other := _other_output(file):
            file.refuse("hazard.other_output", *other)
        return dialect.read(file)
    except InputError:
        raise
    except (ValueError, LookupError, ArithmeticError, StopIteration) as error:
        refuse("file.unreadable", path, f"cannot be read ({error})")
