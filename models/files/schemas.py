"""Required content of `scene.json` and `run.json`, which strangers may have written."""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from toppling.models.errors import refusals
from toppling.models.files import digest
from toppling.models.files.digest import read_json
from toppling.models.files.documents import (
    FRACTION,
    LENGTH_M,
    NUMBER,
    TEXT,
    Kind,
    between,
    check_shape,
    choice,
    shown,
    whole,
)
from toppling.models.scan.hints_file import KINDS

MOST_JOBS = 10_000_000
"""Maximum number of jobs of a run: their table takes 2 GB, and they take 23 days at five jobs a second."""
_OBJECT = Kind("an object", lambda value: isinstance(value, dict))
_ENGINE = Kind(
    "an object of name, title, authors and reference, as texts",
    lambda value: (
        isinstance(value, dict)
        and all(isinstance(value.get(key), str) for key in ("name", "title", "authors", "reference"))
    ),
)
_VERSIONS = Kind(
    "an object of versions as texts, with toppling and physics",
    lambda value: (
        isinstance(value, dict) and all(isinstance(value.get(key), str) for key in ("toppling", "physics"))
    ),
)
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
    "jobs": whole(0, MOST_JOBS),
    "settling": _SETTLING,
}
_RUN = {
    "scenes?": [_SCENE],
    "left_out?": [{"rock": TEXT, "why": TEXT}],
    "jobs": whole(0, MOST_JOBS),
    "sessions": [_OBJECT],
    "plan_id": TEXT,
    "rock": TEXT,
    "created_at": TEXT,
    "versions": _VERSIONS,
    "engine": _ENGINE,
    "scene_id": TEXT,
    "ensemble_id": TEXT,
    "files": Kind(
        "an object of digests by file name",
        lambda value: (
            isinstance(value, dict) and all(isinstance(text, str | None) for text in value.values())
        ),
    ),
    "settling": _SETTLING,
}


def check_run_document(document: dict[str, Any], path: Path) -> dict[str, Any]:
    """Content of a `run.json`, if all that is read of it is there and of its kind.

    Raises InputError at the first value that is missing or mistyped, by its name.
    """
    check_shape(document, _RUN, path)
    return document


BASES = "bases.json"
"""File of a scene with the draws of its base."""
LABELS, SCAN_DATA = "labels.npz", "worked_out.npz"
"""Files of a scan in its scene's folder: the label of each point, and the data from which hints redraw the base."""
GEOMETRY = ("rock.ply", "pedestal.ply", BASES)

SCHEMA_VERSION = 1
"""Version of the layout of `scene.json`."""
_SPREAD = between(0.0, 1e8)
_AZIMUTH = between(-360.0, 360.0)
_PLACE = [LENGTH_M, 3]
_INTERVAL = {"azimuth_deg": _AZIMUTH, "low_m_s2": _SPREAD, "median_m_s2": _SPREAD, "high_m_s2": _SPREAD}
_REPORT = {
    "surface?": {
        "seen_share": FRACTION, "closed_share": FRACTION, "invented_share": FRACTION, "crown_unseen_share?": FRACTION,
    },
    "slenderness?": [{"azimuth_deg": _AZIMUTH, "alpha_deg": NUMBER.or_null()}],
    "registration?": {
        "residual_m?": _SPREAD.or_null(),
        "stations?": whole(0, 10_000_000),
        "of_stations?": [{"residual_m": _SPREAD.or_null()}],
    },
    "uncertainty?": {
        "com_std_m?": [_SPREAD, 3],
        "volume_std_m3?": _SPREAD.or_null(),
    },
    "unseen_base?": {
        "level": FRACTION,
        "contradiction?": TEXT,
        "draws?": whole(1, 1_000_000),
        "distinct?": whole(1, 1_000_000),
        "toppling?": [_INTERVAL],
        "lift_off?": [_INTERVAL],
        "kinds?": {f"{kind}?": {"weight": FRACTION, "draws": whole(0, 1_000_000)} for kind in KINDS},
        "contacts?": {"reach": [{"low_m": NUMBER, "high_m": NUMBER}], "count": [whole(0, 1_000_000), 3]},
        "com_m?": [[NUMBER, 3], 3],
        "volume_m3?": [between(0.0, 1e12), 3],
        "touches_at_gaps?": [{"place": whole(1, 1_000_000), "gap_m": _SPREAD}],
        "pulls_beyond?": [{"azimuth_deg": _AZIMUTH, "ratio": _SPREAD, "low": _SPREAD, "high": _SPREAD}],
        "next_observations?": [
            {"kind": choice("look", "pull"), "from_deg": _AZIMUTH, "to_deg": between(0.0, 720.0), "width": _SPREAD},
        ],
    },
}  # fmt: skip
_SHAPE: dict[str, Any] = {
    "id": TEXT,
    "origin_m": _PLACE,
    "gravity_m_s2": between(1e-3, 1e3),
    "rock": {
        "volume_m3": between(0.0, 1e12), "com_m": _PLACE, "inertia_per_mass_m2": [[NUMBER, 3], 3],
        "height_m": between(0.0, 1e8),
    },
    "pedestal": {"kind": choice("plane", "surface")},
    "interface": {
        "slope_deg": between(0.0, 180.0), "downhill_azimuth_deg": _AZIMUTH, "point_m": _PLACE,
        "normal": [between(-1.0, 1.0), 3], "given_by?": TEXT, "roughness_m?": _SPREAD.or_null(),
        "outline_m?": [_PLACE], "outlines?": [{"probability": FRACTION, "outline_m": [_PLACE]}],
        "edges_m?": [[_PLACE]], "carried?": TEXT, "beside?": TEXT,
    },
    "contact": {
        "friction_static": between(0.0, 1e6), "friction_kinetic": between(0.0, 1e6), "restitution": between(0.0, 1.0),
    },
    "quasi_static_toppling_m_s2": [
        {"azimuth_deg": _AZIMUTH, "value": NUMBER.or_null(), "slides_m_s2?": NUMBER.or_null()},
    ],
    "report": _REPORT,
    "files": {f"{name}?": TEXT for name in (*GEOMETRY, LABELS, SCAN_DATA)},
}  # fmt: skip


_unread = refusals(
    expected=f"a scene of schema version {SCHEMA_VERSION}, as it was written",
    remedy="make the scene anew with 'toppling scan' or Scene.save",
)
_foreign = refusals(
    expected="the files of one scene, as they were written into its folder",
    remedy="put the scene's own file back from where the folder was copied, or make the scene anew",
)


def digests_of_scene(folder: Path) -> dict[str, str | None]:
    """Digest of each file that was written into a scene's folder before its `scene.json`, which states them."""
    names = [name for name in (*GEOMETRY, LABELS, SCAN_DATA) if (folder / name).exists()]
    return {name: digest.stated(folder / name) for name in names}


def read_scene_document(path: Path) -> dict[str, Any]:
    """Read `scene.json` and check all that is read of it.

    Raises InputError if it is no JSON, of another schema version, or something in it is missing or mistyped: with its
    place.
    Raises FileNotFoundError if there is none.
    """
    document = read_json(path)
    if document.get("schema_version") != SCHEMA_VERSION:
        what = f"schema version {shown(document.get('schema_version'))}"
        raise _unread("document.schema_version", what, path)
    check_shape(document, _SHAPE, path)
    normal = document["interface"]["normal"]
    if not (abs(math.hypot(*normal) - 1.0) < 1e-6 and normal[2] > 0):
        raise _unread("scene.normal_unusable", f"interface.normal is {normal}, no unit vector upward", path)
    return document


def read_own(folder: Path, names: Iterable[str] = GEOMETRY) -> dict[str, Any]:
    """Read `scene.json` and verify files beside it: that they are whole, and those that it states.

    folder: of a scene.
    names: files to compare; those that are absent are no matter of this check.
    Raises InputError if one is damaged, or of another scene, by its name; or as :func:`read_scene_document`.
    Raises FileNotFoundError if there is no `scene.json`.
    """
    document = read_scene_document(folder / "scene.json")
    there = [name for name in names if (folder / name).exists()]
    for name in there:
        digest.check(folder / name)
    foreign = [name for name in there if document["files"].get(name) != digest.stated(folder / name)]
    if len(foreign) == 1:
        what = "is of another scene than the scene.json beside it"
        raise _foreign("scene.file_foreign", what, folder / foreign[0])
    if foreign:
        what = f"scene.json is of another scene than {', '.join(foreign)}"
        raise _foreign("scene.file_foreign", what, folder)
    return document
