"""`hints.toml`: what the user said of a scan, by the names of options, so that it can be repeated."""

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from toppling.models.errors import refusals
from toppling.models.folder import new_file
from toppling.models.spelling import did_you_mean

HINTS = "hints.toml"
MOST_BYTES = 1 << 20
KEYS = ("units", "crs", "near", "plane", "point", "touch", "daylight", "pull")
"""Options that say something of the scan, the interface or the base."""

_unusable = refusals(
    expected=f"a TOML file with some of the keys {', '.join(KEYS)}",
    remedy="take the hints.toml that a scan has written beside its scene.json as a pattern",
)


def read_hints(path: Path) -> dict[str, Any]:
    """Values by option, as the file has them.

    Raises
    ------
    InputError
        If the file is absent, large, no TOML, or has another key.
    """
    try:
        if path.stat().st_size > MOST_BYTES:
            raise _unusable("is larger than 1 MB", path)
        said = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise _unusable(f"cannot be read ({error})", path) from None
    for key in said:
        if key not in KEYS:
            raise _unusable(f"'{key}' is no hint; {did_you_mean(key, KEYS, 'see the list')}", path)
    return said


def hints_text(said: Mapping[str, Any]) -> str:
    """The file's content: TOML's strings, numbers and arrays of these are those of JSON.

    Examples
    --------
    >>> print(hints_text({"near": (1.5, 2.0), "units": None, "point": ()}), end="")
    # Repeat the scan: toppling scan FILES --hints hints.toml --out FOLDER
    near = [1.5, 2.0]
    """
    lines = ["# Repeat the scan: toppling scan FILES --hints hints.toml --out FOLDER"]
    lines += [f"{key} = {json.dumps(said[key])}" for key in KEYS if said.get(key)]
    return "\n".join(lines) + "\n"


def write_hints(path: Path, said: Mapping[str, Any]) -> None:
    """Write what was said, complete or not at all."""
    with new_file(path) as staging:
        staging.write_text(hints_text(said), encoding="utf-8")
