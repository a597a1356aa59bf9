"""Campaigns: rocks, records, levels, azimuths and contacts of an ensemble of jobs, read from TOML and validated."""

import dataclasses
import hashlib
import json
import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from toppling.models.errors import InputError
from toppling.models.files.documents import is_number, read_toml, shown
from toppling.models.files.folder import local
from toppling.models.files.schemas import MOST_JOBS
from toppling.models.frames import azimuth_of
from toppling.models.motions.measures import LEVEL_MEASURES
from toppling.models.pedestal import ContactProperties
from toppling.orchestrator.keys import Key, Place, axis, distinct, number, pair, path, read_keys, texts, word
from toppling.orchestrator.site_table import Site, ensemble_folder, joined, read_sites, scenes_matching
from toppling.results.run_integrity import LEAST_JOBS, SITES_FILE
from toppling.workers.engines import DEFAULT, ENGINES
from toppling.workers.options import PRESETS
from toppling.workers.unmeasured import Unmeasured

_AS_RECORDED = "recorded"
"""Value of the levels for unscaled records, and of the azimuths for records in their original orientation."""

LARGEST_PGA_M_S2 = 100.0
"""Maximum level, m/s²: twice the strongest recorded ground acceleration; more indicates wrong units."""
_FINEST = 0.005
"""Minimum of `precision`, a half width relative to the target."""
_COARSEST = 0.5
"""Maximum of `precision`."""
_QUANTILES = ("median", "p05", "p95")
_TARGET_KEYS = (
    Key("of", word(_QUANTILES), f"{', '.join(map(repr, _QUANTILES))}", "share that topples", None, "the median"),
    Key("measure", word(LEVEL_MEASURES), f"one of {', '.join(LEVEL_MEASURES)}", "of the intensity", None, "the best"),
    Key("at", number(lambda size: size > 0), "a positive intensity, with its measure", "whose probability is asked for",
        None, "the share"),
    Key("hazard", path, "the path of a file of one hazard curve", "whose failure rate is asked for", None, "the share"),
)  # fmt: skip
"""Keys of `target`."""


@dataclass(frozen=True)
class TargetSpec:
    """Specification of the quantity that a run is to estimate."""

    of: str = _QUANTILES[0]  # median, p05, p95: intensity with that toppling probability
    measure: str | None = None  # column of the results; None for the best predictor
    at: float | None = None  # intensity whose toppling probability is the target instead
    hazard: Path | None = None  # file of the hazard curve whose failure rate is the target instead

    def content(self, hazard: str | None = None) -> dict[str, Any]:
        """Table for a campaign's file, with the hazard's path as given."""
        of = self.of if self.at is None and self.hazard is None else None
        table: dict[str, Any] = {"of": of, "measure": self.measure, "at": self.at}
        return {**table, "hazard": hazard or (str(self.hazard) if self.hazard else None)}


def _precision(value: Any, place: Place) -> float:
    """Read the requested half width of the 95 % interval; InputError if out of range."""
    if not is_number(value) or not _FINEST <= value <= _COARSEST:
        percent = is_number(value) and _FINEST <= value / 100.0 <= _COARSEST
        raise place.unusable(
            value, remedy=f"did you mean {value / 100.0:g}, {value:g} %?" if percent else "5 % is 0.05"
        )
    return float(value)


def _target(value: Any, place: Place) -> TargetSpec:
    """Read a target, a word or a table; InputError if it is neither, or inconsistent."""
    table = {"of": value} if isinstance(value, str) else value
    if not isinstance(table, dict) or not table:
        raise place.unusable(value)
    read = read_keys(_TARGET_KEYS, table, place.where, place.folder, joint=".")
    if read["at"] is not None and read["measure"] is None:
        raise place.wrong(
            "campaign.keys_incomplete",
            f"at = {shown(table['at'])}",
            remedy="give the measure that it is of too",
        )
    if sum(read[name] is not None for name in ("of", "at", "hazard")) > 1:
        raise place.wrong(
            "campaign.keys_exclude_each_other",
            "more than one of 'of', 'at' and 'hazard'",
            remedy="ask one question a run",
        )
    return TargetSpec(**read | {"of": read["of"] or _QUANTILES[0]})


def _friction(given: Any, place: Place) -> tuple[tuple[float, float], ...]:
    given = [given] if is_number(given) else given
    if not isinstance(given, list) or not given:
        raise place.unusable(given, remedy="at least one is needed, such as [0.8]")
    pairs = []
    for entry in given:
        both = entry if isinstance(entry, list) else [entry, entry]
        if len(both) != 2 or not all(is_number(value) for value in both):
            raise place.unusable(entry, "a number, or [static, kinetic]", "correct the entry")
        if both[1] > both[0]:
            what, sound = f"{shown(entry)}: kinetic friction above static", f"[{both[1]:g}, {both[0]:g}]"
            raise place.wrong(
                "campaign.friction_order",
                what,
                "[static, kinetic], the larger first",
                f"did you mean {sound}?",
            )
        try:
            ContactProperties(*map(float, both))
        except InputError as error:
            other = {"what": f"{shown(entry)}: {error.what}", "where": place.where}
            raise InputError(**vars(error) | other) from None
        pairs.append((float(both[0]), float(both[1])))
    return tuple(distinct(pairs, place))


def _unmeasured(given: Any, place: Place) -> Unmeasured:
    if not isinstance(given, dict):
        raise place.unusable(given)
    if ("band_hz" in given) != ("above_band" in given):
        raise place.wrong(
            "campaign.keys_incomplete",
            "one of band_hz and above_band",
            "both or neither",
            "such as 25.0 and [0.0, 0.6]",
        )
    return Unmeasured(**read_keys(_DRAWN, given, place.where, place.folder, joint="."))


def _files(given: Any, place: Place) -> tuple[Path, ...]:
    return tuple(place.folder / local(name) for name in (texts(given, place) if given != [] else ()))


def _azimuths(given: Any, place: Place) -> tuple[float, ...]:
    """Read azimuths, some of which may be bearings such as "N40E"."""
    try:
        if isinstance(given, list):
            given = [azimuth_of(value) if isinstance(value, str) else value for value in given]
    except InputError as error:
        raise place.wrong("campaign.value_unusable", error.what) from None
    return axis(lambda azimuth: 0 <= azimuth < 360, _AS_RECORDED)(given, place)


def _count(least: int, most: int = 2**31 - 1) -> Any:
    return number(lambda count: least <= count <= most, int)


# fmt: off
_DRAWN = (
    Key("friction", pair(math.inf), "[low, high], from 0", "static and kinetic friction", None),
    Key("restitution", pair(1.0), "[low, high], 0 to 1", "restitution", None),
    Key("yaw_deg", number(lambda yaw: 0 <= yaw <= 180), "0 to 180 degrees", "turn of the motion, either way", 0.0),
    Key("either_sense", number(lambda _: True, bool), "true or false", "reverse the motion in half of them", False),
    Key("band_hz", number(lambda band: band > 0), "above 0 Hz", "where the records' band ends", None),
    Key("above_band", pair(2.0), "[low, high], 0 to 2", "motion above it over that in the octave below", None),
)
"""Keys of `unmeasured`."""

KEYS = (
    Key("scene", path, "a folder, relative to the file", "the rock on its pedestal"),
    Key("scenes", texts, "a list of folders, with wildcards, relative to the file",
        "instead of scene: many rocks", (), page="guide/atlas.md"),
    Key("sites", lambda given, place: read_sites(path(given, place)), "a CSV file, relative to the file",
        "instead of scene, or with scenes: a table of rocks", (), page="guide/atlas.md"),
    Key("ensemble", path, "a folder, relative to the file", "the records"),
    Key("pga_m_s2", axis(lambda pga: 0 < pga <= LARGEST_PGA_M_S2, _AS_RECORDED),
        f"above 0, up to {LARGEST_PGA_M_S2:g}; a list, or {{ start, stop, step }} with the stop included; or "
        f'"{_AS_RECORDED}", each record as strong as it is',
        "levels that the PGA (of the horizontal vector) of each record is scaled to, m/s2"),
    Key("azimuth_deg", _azimuths,
        '0 to below 360, or bearings such as "N40E"; a list or a table as above; or '
        f'"{_AS_RECORDED}", each record\'s components as they pointed',
        "azimuths that the stronger horizontal component is turned to, degrees counter-clockwise from east"),
    Key("friction", _friction, "a list of numbers, or of [static, kinetic]",
        "coefficients of friction, of rock on rock 0.6 to 1.0"),
    Key("restitution", axis(lambda value: 0 <= value <= 1), "a list of numbers, 0 to 1",
        "coefficients of restitution", (0.0,), "[0.0]", "[0.0]"),
    Key("realisations", _count(1, MOST_JOBS), f"a whole number from 1 to {MOST_JOBS}",
        "over which the jobs of each record are spread: one is the scene as it is, others draw base and friction", 1,
        "1", "25"),
    Key("first_realisation", _count(0), "a whole number from 0",
        "number of the first realisation, to add to another campaign", 0, "0, the scene as it is", "1"),
    Key("unmeasured", _unmeasured, f"a table with keys of {', '.join(key.name for key in _DRAWN)}",
        "what realisations draw besides", None, "none", "{ friction = [0.5, 1.0], yaw_deg = 5.0 }",
        "conventions.md#realisations"),
    Key("preset", word(PRESETS), f"one of {', '.join(PRESETS)}", "how finely each shake is resolved", "standard",
        "'standard'", '"fast"'),
    Key("engine", word(ENGINES), f"one of {', '.join(ENGINES)}",
        "physics engine", DEFAULT, repr(DEFAULT), f'"{[*ENGINES][-1]}"'),
    Key("records", texts, "a list of record ids",
        "some of the ensemble's records", None, "all", '["..."]'),
    Key("audit", number(lambda jobs: jobs == 0 or jobs >= LEAST_JOBS, int),
        f"a whole number of jobs, at least {LEAST_JOBS}, or 0 for none", "jobs that are repeated once all are done",
        None, "as many as cost less than a tenth of the run", "100", "audit.md"),
    Key("stood", _files, "a list of files of records (components together), or folders of "
        "ensembles, relative to the file",
        "recorded motions that the rock survived, by which draws of its base are weighted", (),
        "none", '["quake.AT2"]', "guide/standing.md"),
    Key("precision", _precision, "0.005 to 0.5",
        "half of the 95 % interval at which the run ends", None, "all jobs", "0.05", "precision.md"),
    Key("target", _target, '"median", "p05", "p95" or a table', "what the run is to state", None,
        "the shaking at which half topple", '"p05"', "precision.md"),
    Key("peak_displacement_m", number(lambda size: size > 0), "metres above 0",
        "largest horizontal displacement of the ground, to which motions are high-passed (corners up to 5 Hz, else "
        "the job fails)", None, "none", "1.0"),
)
"""Keys of a campaign file."""
# fmt: on


@dataclass(frozen=True)
class Campaign:
    """Axes of an ensemble of jobs; a job is one point of their product.

    Its fields are the keys of a campaign file, whose meanings, ranges and defaults :data:`KEYS` declares: folders as
    `Path`, lists as tuples, friction as pairs of a static and a kinetic coefficient. Empty levels or azimuths stand for
    unscaled or unrotated records; None for keys left out. For many rocks `sites` lists them, `scene` is their common
    parent folder, and `ensemble` that of rocks without their own records.
    """

    scene: Path
    ensemble: Path
    pga_m_s2: tuple[float, ...]
    azimuth_deg: tuple[float, ...]
    friction: tuple[tuple[float, float], ...]
    restitution: tuple[float, ...] = (0.0,)
    realisations: int = 1
    first_realisation: int = 0
    preset: str = "standard"
    engine: str = DEFAULT
    records: tuple[str, ...] | None = None
    peak_displacement_m: float | None = None
    audit: int | None = None
    unmeasured: Unmeasured | None = None
    stood: tuple[Path, ...] = ()
    precision: float | None = None
    target: TargetSpec | None = None
    sites: tuple[Site, ...] = ()

    @property
    def settings(self) -> dict[str, Any]:
        """Fields that the specifications of all jobs have in common."""
        names = ("preset", "engine", "peak_displacement_m", "unmeasured")
        return {name: getattr(self, name) for name in names}

    def with_precision(self, precision: float) -> "Campaign":
        """Campaign that ends when its target has a given precision.

        Raises InputError if the precision is out of range, or there are no levels.
        """
        place = Place("--precision", expected="0.005 to 0.5")
        if self.sites:
            remedy = "give each rock a run of its own"
            raise place.wrong(
                "campaign.of_many_rocks", "a campaign of many rocks", "a campaign of one", remedy
            )
        changed = dataclasses.replace(self, precision=_precision(precision, place))
        _check_together(changed, *[place.where] * 3)
        return changed

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> "Campaign":
        """Read a TOML file; its folders are relative to the file.

        Raises
        ------
        InputError
            If the file is absent or not TOML, a key is unknown or missing, or a value is out of its range.
        """
        source = Path(path)
        try:
            content = read_toml(source)
        except FileNotFoundError:
            remedy = "'toppling init SCENE ENSEMBLE' writes one"
            raise Place(str(source)).wrong("file.absent", "no such file", "a campaign file", remedy) from None
        return cls.of(content, source.parent, where=str(source))

    @classmethod
    def of(cls, content: Mapping[str, Any], folder: Path, where: str = "campaign") -> "Campaign":
        """Check the content of a campaign file that lies in `folder`.

        Raises
        ------
        InputError
            As :meth:`read`.
        """
        if {"scenes", "sites"} & set(content):
            read = cls(**_of_many(content, folder, where))
        else:
            values = read_keys(KEYS, content, where, folder)
            del values["scenes"]
            read = cls(**values)
        _check_together(read, f"{where}: engine", f"{where}: precision", f"{where}: target")
        return read

    def of_site(self, site: Site) -> "Campaign":
        """Campaign of a single rock of an atlas."""
        ensemble = ensemble_folder(site, self.sites) or self.ensemble
        friction = self.friction if site.friction is None else ((site.friction, site.friction),)
        return dataclasses.replace(self, scene=site.scene, ensemble=ensemble, friction=friction, sites=())

    def check_jobs(self, records: int) -> None:
        """Refuse too many jobs for a given number of records, before the table is made."""
        axes = {
            "records": records, "levels": max(len(self.pga_m_s2), 1), "azimuths": max(len(self.azimuth_deg), 1),
            "frictions": len(self.friction), "restitutions": len(self.restitution),
        }  # fmt: skip
        # Each record has at least as many jobs of a contact as there are realisations.
        jobs = math.prod(axes.values()) * math.ceil(self.realisations / (axes["levels"] * axes["azimuths"]))
        if jobs > MOST_JOBS:
            product = " x ".join(f"{count} {name}" for name, count in axes.items())
            what = f"{jobs:.3g} jobs = {product}, of {self.realisations} realisations"
            raise Place("campaign").wrong(
                "campaign.too_many_jobs", what, f"at most {MOST_JOBS} jobs", "leave some of them out"
            )

    def to_toml(self, stood: Iterable[str] = (), hazard: str | None = None) -> str:
        """Campaign as TOML with all values explicit, as stored in a run's folder."""
        values = {key.name: getattr(self, key.name) for key in KEYS if key.name not in ("scenes", "sites")}
        content = {name: value for name, value in values.items() if value not in (None, ())}
        rocks = {"sites": SITES_FILE} if self.sites else {"scene": "scene"}
        axes = {"pga_m_s2": self.pga_m_s2 or _AS_RECORDED, "azimuth_deg": self.azimuth_deg or _AS_RECORDED}
        if self.sites:
            del content["scene"]
        content |= {**rocks, "ensemble": "ensemble", **axes}
        if self.stood:
            content["stood"] = list(stood)
        if self.unmeasured is not None:
            content["unmeasured"] = dataclasses.asdict(self.unmeasured)
        if self.target is not None:
            content["target"] = self.target.content(hazard)
        return "".join(f"{name} = {_toml(value)}\n" for name, value in content.items())


def hash_of(texts: Iterable[str]) -> str:
    """Short hash of a sequence of texts; depends on their order."""
    digest = hashlib.sha256()
    for text in texts:
        digest.update(text.encode())
        digest.update(b"\n")
    return digest.hexdigest()[:20]


def _of_many(content: Mapping[str, Any], folder: Path, where: str) -> dict[str, Any]:
    """Read the values of a campaign of many rocks."""
    if alone := [name for name in ("scene", "precision", "target", "stood") if name in content]:
        what = f"{alone[0]} in a campaign of many rocks"
        raise Place(f"{where}: {alone[0]}").wrong(
            "campaign.key_not_of_many", what, "keys for all rocks", "remove it, or give it a run of its own"
        )
    keys = [dataclasses.replace(key, default=None) if key.name == "scene" else key for key in KEYS]
    own = {"ensemble": "."} if "ensemble" not in content else {}
    values = read_keys(keys, own | dict(content), where, folder)
    found = scenes_matching(values.pop("scenes"), Place(f"{where}: scenes", folder))
    sites = joined(values["sites"], found, where)
    if own and (
        lacking := [site.rock for site in sites if site.ensemble is None and site.seismograms is None]
    ):
        what = f"missing ensemble, which {shown(lacking[0])} has none of its own instead of"
        raise Place(where).wrong(
            "campaign.key_missing",
            what,
            "records for every rock",
            "add an ensemble to the file, or to the table",
        )
    around = Path(os.path.commonpath([site.scene.absolute().parent for site in sites]))
    return values | {"sites": sites, "scene": around}


def _check_together(read: Campaign, engine: str, precision: str, target: str) -> None:
    """Refuse inconsistent values; the other arguments are the places of their keys for messages."""
    drawn = read.unmeasured and read.unmeasured.restitution
    if not ENGINES[read.engine].models(read.friction, [*read.restitution, *(drawn or ())[1:]]):
        expected = "restitution [0] and one coefficient an entry of friction"
        what = f"{read.engine} knows neither restitution nor a kinetic friction of its own"
        raise Place(engine).wrong("engine.contact_unknown", what, expected, f"take {DEFAULT!r}")
    if read.precision is None and read.target is not None:
        remedy = "add precision = 0.05, or remove it"
        raise Place(target).wrong("campaign.keys_incomplete", "a target without a precision", "both", remedy)
    if read.precision is not None and not read.pga_m_s2:
        raise Place(precision).wrong(
            "campaign.no_levels_to_choose",
            "no levels to choose among",
            "levels in pga_m_s2",
            "leave precision out",
        )


def _toml(value: Any) -> str:
    """Format a value as TOML: strings, numbers, booleans and arrays as in JSON, tables in TOML's syntax."""
    if isinstance(value, dict):
        pairs = (f"{key} = {_toml(part)}" for key, part in value.items() if part is not None)
        return f"{{ {', '.join(pairs)} }}"
    return json.dumps(value, ensure_ascii=False)
