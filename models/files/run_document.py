"""What `run.json` must say: a run may come from a stranger, and everything in it is read by somebody."""

from pathlib import Path
from typing import Any

from toppling.models.files.documents import TEXT, Kind, between, check_shape, whole

_MOST_JOBS = 1_000_000_000
_OBJECT = Kind("an object", lambda value: isinstance(value, dict))
_ENGINE = Kind(
    "an object of name, title, authors and reference, as texts",
    lambda value: (
        isinstance(value, dict)
        and all(isinstance(value.get(key), str) for key in ("name", "title", "authors", "reference"))
    ),
)
_REQUIRED = {
    "jobs": whole(0, _MOST_JOBS),
    "sessions": [_OBJECT],
}
_SETTLING = Kind(
    "an object with a sentence, or null",
    lambda value: (
        value is None or (isinstance(value, dict) and isinstance(value.get("sentence"), str | None))
    ),
)
_SCENE = {
    "rock": TEXT,
    "scene_id": TEXT,
    "ensemble_id": TEXT,
    "ensemble": TEXT,
    "site": TEXT,
    "longitude": between(-180.0, 180.0).or_null(),
    "latitude": between(-90.0, 90.0).or_null(),
    "age": TEXT.or_null(),
    "problem": TEXT.or_null(),
    "jobs": whole(0, _MOST_JOBS),
    "settling": _SETTLING,
}
_READ = {
    "scenes?": [_SCENE],
    "left_out?": [{"rock": TEXT, "why": TEXT}],
    "plan_id?": TEXT,
    "rock?": TEXT,
    "versions?": _OBJECT,
    "engine?": _ENGINE,
    "scene_id?": TEXT,
    "ensemble_id?": TEXT,
    "files?": Kind(
        "an object of digests by file name",
        lambda value: (
            isinstance(value, dict) and all(isinstance(text, str | None) for text in value.values())
        ),
    ),
    "settling?": _SETTLING,
}


def check_run_document(
    document: dict[str, Any], path: Path, *, whole_document: bool = True
) -> dict[str, Any]:
    """Content of a `run.json`, if what is read of it is of its kind.

    whole_document: whether all must be there that goes on with a run; else what is there must be of its kind.
    Raises InputError at the first value that is missing or mistyped, by its name.
    """
    required = _REQUIRED if whole_document else {f"{key}?": shape for key, shape in _REQUIRED.items()}
    check_shape(document, {**required, **_READ}, path)
    return document
