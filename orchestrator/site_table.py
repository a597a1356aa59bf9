"""Table of the rocks of an atlas and their sites, named by a campaign or `toppling check`."""

import csv
import io
import re
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from toppling.models.errors import InputError, refusals
from toppling.models.files import documents
from toppling.models.files.folder import rock_name
from toppling.models.files.table import Table, is_numeral, plain
from toppling.models.motions.ensemble import CATALOG, Ensemble
from toppling.models.motions.record import Record
from toppling.orchestrator.keys import Key, Place, number, path, read_keys
from toppling.results.hazard.ages import parse_age

_SCENE_FILE = "scene.json"
_NAME = re.compile(r"[^\W_][\w .+\-'\u2019(),&#]{0,99}")
_NUMBERS = ("longitude", "latitude", "friction")
"""Columns of numbers."""


def _name(given: Any, place: Place) -> str:
    if not isinstance(given, str) or not _NAME.fullmatch(given) or given.endswith((".", " ")):
        raise place.unusable(given)
    return given


def _age(given: Any, place: Place) -> str:
    text = f"{given:g}" if documents.is_number(given) else given
    if not isinstance(text, str):
        raise place.unusable(given)
    try:
        parse_age(text, files=False)  # one would not go with the table
    except InputError as error:  # which does not know the row
        raise place.unusable(given, error.expected) from None
    return text


def _longitude(given: Any, place: Place) -> float:
    """Read a longitude from -180 to 360, and return degrees east from -180 to 180."""
    if not documents.is_number(given) or not -180 <= given <= 360:
        raise place.unusable(given)
    return float(given) - (360.0 if given > 180 else 0.0)


def _latitude(given: Any, place: Place) -> float:
    if not documents.is_number(given) or not -90 <= given <= 90:
        swapped = documents.is_number(given) and -180 <= given <= 360
        raise place.unusable(given, remedy="exchange longitude and latitude" if swapped else place.remedy)
    return float(given)


SITE_KEYS = (
    Key("scene", path, "a folder, relative to the table", "the rock on its pedestal"),
    Key("rock", _name, "letters, digits, blanks, .-_+'(),&#", "name of the rock", "", "the scene's folder"),
    Key("site", _name, "letters, digits, blanks, .-_+'(),&#", "name of the site", "", "the rock's name"),
    Key("longitude", _longitude, "degrees east (WGS 84)", "where it stands", None),
    Key("latitude", _latitude, "degrees north (WGS 84)", "where it stands", None),
    Key("ensemble", path, "a folder, relative to the table", "its own records", None, "the campaign's"),
    Key("seismograms", path, "what 'records import' reads, relative to the table", "its own records; of a path that "
        "several rows name each takes those whose station is its site", None, "the campaign's"),
    Key("age", _age, "years: 20000, 15..30 ka, 20000+-3000", "how long the rock has stood", None, "not known"),
    Key("friction", number(lambda value: 0 < value <= 10), "above 0 and up to 10", "of the rock on its pedestal", None,
        "the campaign's"),
)  # fmt: skip
"""Columns of a table of rocks."""


@dataclass(frozen=True)
class Site:
    """A rock and its site; fields are the columns of :data:`SITE_KEYS`."""

    scene: Path
    rock: str
    site: str = ""
    longitude: float | None = None
    latitude: float | None = None
    ensemble: Path | None = None
    seismograms: Path | None = None
    age: str | None = None
    friction: float | None = None


_no_rocks = refusals(expected="a table of rocks (CSV)", remedy="correct the path, or save the table as CSV")


def read_sites(given: Path) -> tuple[Site, ...]:
    """Rocks of a table.

    Raises InputError if a column is unknown, a value out of its range, a rock named twice, or a location incomplete.
    """
    sites = tuple(
        _site(row, f"{given}, rock {count + 1}", given.parent) for count, row in enumerate(_rows(given))
    )
    return _distinct_rocks(sites, str(given))


def _rows(given: Path) -> Iterator[dict[str, Any]]:
    table = Table.read(given, _no_rocks)
    names = [name.casefold() for name in table.names]
    if "scene" not in names:
        header = documents.shown(", ".join(names))
        raise Place(str(given)).wrong(
            "rocks.no_scene_column",
            f"no column 'scene' in its first line, {header}",
            "a header such as scene,site,age",
            "put it above the rocks",
        )
    if twice := [name for name, count in Counter(names).items() if count > 1]:
        raise Place(str(given)).wrong(
            "rocks.column_repeated",
            f"the column {documents.shown(twice[0])} twice",
            "each column once",
            "remove one",
        )
    for _, row in table.whole_rows(_no_rocks):
        cells = {name: cell for name, cell in zip(names, row, strict=True) if cell}
        yield {
            name: float(cell) if name in _NUMBERS and is_numeral(cell) else cell
            for name, cell in cells.items()
        }


def _site(row: Mapping[str, Any], where: str, folder: Path) -> Site:
    read = read_keys(SITE_KEYS, row, where, folder)
    if (read["longitude"] is None) != (read["latitude"] is None):
        raise Place(where).wrong(
            "rocks.place_incomplete", "one of longitude and latitude", "both or neither", "add the other"
        )
    if read["ensemble"] and read["seismograms"]:
        raise Place(where).wrong(
            "rocks.records_given_twice", "an ensemble and seismograms", "one of them", "remove one"
        )
    for name in ("ensemble", "seismograms"):
        if read[name] and not read[name].exists():
            remedy = "correct the path, which begins at the table's folder"
            raise Place(f"{where}: {name}").wrong(
                "file.absent", f"{read[name]}: there is no such file or folder", "records", remedy
            )
    read["scene"] = _scene_folder(read["scene"])
    read["rock"] = read["rock"] or rock_name(read["scene"])
    return Site(**read | {"site": read["site"] or read["rock"]})


def _scene_folder(folder: Path) -> Path:
    """The folder itself, or its subfolder `scene` if only that contains a scene."""
    inner = folder / "scene"
    return inner if not (folder / _SCENE_FILE).exists() and (inner / _SCENE_FILE).exists() else folder


def scenes_matching(patterns: Sequence[str], place: Place) -> list[Path]:
    """Folders of scenes that match paths with wildcards; InputError if one matches none."""
    found: dict[Path, None] = {}
    for pattern in patterns:
        root = Path(pattern).anchor
        base = Path(root) if root else place.folder
        matches = sorted(base.glob(str(Path(pattern).relative_to(root) if root else pattern)))
        scenes = [folder for match in matches if ((folder := _scene_folder(match)) / _SCENE_FILE).exists()]
        if not scenes:
            raise place.wrong(
                "rocks.no_scene",
                f"{documents.shown(pattern)} names no scene",
                "folders with a scene.json",
                "correct the path",
            )
        found |= dict.fromkeys(scenes)
    return list(found)


def joined(sites: Sequence[Site], scenes: Iterable[Path], where: str) -> tuple[Site, ...]:
    """Rocks of a table, and of further scenes that it does not list."""
    known = {site.scene.resolve() for site in sites}
    further = [
        Site(scene, rock_name(scene), rock_name(scene)) for scene in scenes if scene.resolve() not in known
    ]
    return _distinct_rocks((*sites, *further), where)


def _distinct_rocks(sites: tuple[Site, ...], where: str) -> tuple[Site, ...]:
    """Check that there are rocks with distinct names (ignoring case, as some file systems do), and return them."""
    if not sites:
        raise Place(where).wrong("rocks.empty", "holds no rock", "at least one", "add a row with a scene")
    counts = Counter(site.rock.casefold() for site in sites)
    if twice := [site for site in sites if counts[site.rock.casefold()] > 1]:
        scenes = " and ".join(str(site.scene) for site in twice[:2])
        remedy = "name them in a table's column 'rock', or give each scene once"
        raise Place(where).wrong(
            "rocks.name_repeated",
            f"the rock {twice[0].rock} twice ({scenes})",
            "a name for each rock",
            remedy,
        )
    return sites


def sites_text(sites: Iterable[Site]) -> str:
    """Table of rocks as CSV."""
    names = [key.name for key in SITE_KEYS]
    text = io.StringIO()
    writer = csv.DictWriter(text, names)
    writer.writeheader()
    for site in sites:
        writer.writerow(
            {name: plain(getattr(site, name)) for name in names if getattr(site, name) is not None}
        )
    return text.getvalue()


def ensemble_folder(site: Site, sites: Sequence[Site]) -> Path | None:
    """Folder of a rock's own ensemble, imported from its seismograms if necessary; None without own records.

    Raises InputError if none of the seismograms can be read, or none is of the rock's site.
    """
    if site.seismograms is None:
        return site.ensemble
    if (site.seismograms / CATALOG).is_file() and not _is_common(site, sites):
        return site.seismograms
    return _imported(site.seismograms, site.site if _is_common(site, sites) else None)


def _is_common(site: Site, sites: Sequence[Site]) -> bool:
    return sum(other.seismograms == site.seismograms for other in sites) > 1


_IMPORTED: list[tempfile.TemporaryDirectory] = []
"""Temporary folders, deleted at the end of the process."""


def temporary_ensemble(records: Sequence[Record]) -> Path:
    """Write records to an ensemble, which is deleted at the end of the process, and return its folder."""
    _IMPORTED.append(tempfile.TemporaryDirectory(prefix="toppling-"))
    folder = Path(_IMPORTED[-1].name)
    Ensemble.write(folder, records)
    return folder


@cache
def _imported(source: Path, station: str | None) -> Path:
    return temporary_ensemble(_of_station(_seismograms_in(source), station, source))


@lru_cache(maxsize=1)
def _seismograms_in(source: Path) -> tuple[Record, ...]:
    """Records of a file, a folder of files, or an ensemble; InputError if there are none."""
    from toppling.models.motions.importing import ImportOptions, import_records, record_files

    if (source / CATALOG).is_file():
        ensemble = Ensemble.load(source)
        return tuple(ensemble.record(name) for name in ensemble.record_ids)
    came = import_records(record_files([source]), [], ImportOptions())
    if not came.records:
        reasons = (
            "; ".join(f"{refusal.subject}: {refusal.reason}" for refusal in came.refusals[:3])
            or "no record file"
        )
        remedy = "import them with 'toppling records import' and name the ensemble"
        raise Place(str(source)).wrong(
            "rocks.no_seismograms", reasons, "seismograms of three components", remedy
        )
    return tuple(came.records)


def _of_station(records: Iterable[Record], station: str | None, source: Path) -> list[Record]:
    """Records of a station, or all if no station is given; InputError if there are none."""
    chosen = [
        record for record in records if station is None or record.station.casefold() == station.casefold()
    ]
    if not chosen:
        there = ", ".join(sorted({record.station or "(none)" for record in records})[:5])
        remedy = "name the station in the table's column 'site'"
        raise Place(str(source)).wrong(
            "rocks.no_record", f"no record of site {station}", f"one of its stations: {there}", remedy
        )
    return chosen
