"""A campaign: what is shaken by what, how strongly and from where. Read from TOML, checked before use."""

import dataclasses
import hashlib
import json
import math
import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from toppling.models.contact import ContactProperties
from toppling.models.documents import is_number, read_toml, shown
from toppling.models.errors import InputError
from toppling.models.folder import local
from toppling.models.spelling import did_you_mean
from toppling.orchestrator.asked import Asked, read_precision, read_target
from toppling.workers.engines import DEFAULT, ENGINES
from toppling.workers.options import PRESETS
from toppling.workers.unmeasured import Unmeasured

AS_RECORDED = "recorded"
"""In place of levels: every record as strong as it is. In place of azimuths: every record as it was oriented."""

LARGEST_PGA_M_S2 = 100.0
"""Ten times gravity, twice the strongest ground acceleration recorded: more is a slip of units."""
MOST_ON_AN_AXIS = 50_000
"""Of levels, azimuths, coefficients or records; azimuths a hundredth of a degree apart are 36,000."""
MOST_REALISATIONS = 1_000_000
MOST_JOBS = 10_000_000
"""Beyond, the table of jobs leaves no memory for anything else: 2 GB, and 23 days at five jobs a second."""
LARGEST_DISPLACEMENT_M = 1000.0
HIGHEST_BAND_HZ = 1000.0


@dataclass(frozen=True)
class Campaign:
    """The axes of an ensemble of jobs; a job is one point of their product.

    Parameters
    ----------
    scene, ensemble : Path
        Folders of the scene and of the ensemble.
    pga_m_s2 : tuple of float
        Levels that every record is scaled to, m/s2; none where each is left as strong as it was recorded.
    azimuth_deg : tuple of float
        Azimuths that every record is turned to, degrees counter-clockwise from x; none where each is left as it was
        recorded.
    friction : tuple of (float, float)
        Static and kinetic coefficients.
    restitution : tuple of float
    realisations : int
        Jobs per point, from realisation 0, the nominal scene, on.
    first_realisation : int
        Where they begin instead, so that a campaign adds to another.
    preset : str
        Settings of the engine: draft, fast, standard or reference.
    engine : str
        One of :data:`toppling.workers.engines.ENGINES`.
    records : tuple of str or None
        Record ids; None for the whole ensemble.
    peak_displacement_m : float or None
        Largest ground displacement to impose; None to leave the records' own.
    audit : int or None
        Jobs that are done again once the run is complete, to state its own error; None for as many as cost less than
        a tenth of the run.
    unmeasured : Unmeasured or None
        What realisations draw besides base, centre of mass and some per cent of friction.
    stood : tuple of Path
        Recorded motions that the rock is known to have stood, as files or folders of ensembles: draws of its base weigh
        as much as they let it stand them (`orchestrator.stood`).
    precision : float or None
        Half of the interval of 95 % of the target, at which the run ends; None for all jobs.
    target : Asked or None
        What is asked for; None for the intensity of the best measure at which half topple.
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
    target: Asked | None = None

    @property
    def as_recorded(self) -> bool:
        """Whether records are imposed unscaled."""
        return not self.pga_m_s2

    def with_precision(self, precision: float) -> "Campaign":
        """The same campaign, to end once its target is known so well.

        Raises
        ------
        InputError
            If the precision is no share, or there are no levels.
        """
        where = "--precision"
        told = _asked({"precision": precision}, Path(), {"pga_m_s2": self.pga_m_s2}, lambda _: where)
        return dataclasses.replace(self, **told)

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
            raise _error(
                source, "no such file", "a campaign file", "'toppling init SCENE ENSEMBLE' writes one"
            ) from None
        return cls.of(content, source.parent, where=str(source))

    @classmethod
    def of(cls, content: Mapping[str, Any], folder: Path, where: str = "campaign") -> "Campaign":
        """Check the content of a campaign file that lies in `folder`.

        Raises
        ------
        InputError
            As :meth:`read`.
        """
        content = _without_levels(content, f"{where}: levels")
        known = {field.name: field for field in dataclasses.fields(cls)}
        for key in content:
            if key not in known:
                raise _error(
                    where,
                    f"unknown key {shown(key)}",
                    f"keys: {', '.join(known)}",
                    did_you_mean(key, known, "correct or remove it"),
                )
        missing = [
            name
            for name in ("scene", "ensemble", "pga_m_s2", "azimuth_deg", "friction")
            if name not in content
        ]
        if missing:
            raise _error(where, f"missing {', '.join(missing)}", "a value for each", "add them to the file")

        def place(key: str) -> str:
            return f"{where}: {key}"

        def folder_of(key: str) -> Path:
            if not isinstance(content[key], str) or not content[key]:
                raise _error(place(key), shown(content[key]), "the path of a folder", "give it as a string")
            return folder / local(content[key])

        values: dict[str, Any] = {"scene": folder_of("scene"), "ensemble": folder_of("ensemble")}
        values["pga_m_s2"] = ()
        if content["pga_m_s2"] != AS_RECORDED:
            values["pga_m_s2"] = _axis(
                content["pga_m_s2"],
                place("pga_m_s2"),
                lambda pga: 0 < pga <= LARGEST_PGA_M_S2,
                f"accelerations above 0 and up to {LARGEST_PGA_M_S2:g} m/s2, or {AS_RECORDED!r} for no scaling",
            )
        values["azimuth_deg"] = ()
        if content["azimuth_deg"] != AS_RECORDED:
            values["azimuth_deg"] = _axis(
                content["azimuth_deg"],
                place("azimuth_deg"),
                lambda azimuth: 0 <= azimuth < 360,
                "azimuths from 0 to below 360 degrees, counter-clockwise from x (east), "
                f"or {AS_RECORDED!r} for no turning",
            )
        values["restitution"] = _axis(
            content.get("restitution", [0.0]),
            place("restitution"),
            lambda value: 0 <= value <= 1,
            "numbers 0 to 1",
        )
        values["friction"] = _friction(content["friction"], place("friction"))
        realisations = content.get("realisations", 1)
        if (
            not isinstance(realisations, int)
            or isinstance(realisations, bool)
            or not 1 <= realisations <= MOST_REALISATIONS
        ):
            raise _error(
                place("realisations"),
                shown(realisations),
                f"a whole number from 1 to {MOST_REALISATIONS}",
                "1 is the nominal scene",
            )
        values["realisations"] = realisations
        first = content.get("first_realisation", 0)
        if not isinstance(first, int) or isinstance(first, bool) or first < 0:
            raise _error(
                place("first_realisation"),
                f"{first!r}",
                "a whole number from 0",
                "leave it out for the nominal scene",
            )
        values["first_realisation"] = first
        preset = content.get("preset", "standard")
        if not isinstance(preset, str) or preset not in PRESETS:
            raise _error(
                place("preset"),
                shown(preset),
                f"one of {', '.join(PRESETS)}",
                did_you_mean(preset, PRESETS, "take 'standard' if unsure"),
            )
        values["preset"] = preset
        values["unmeasured"] = _unmeasured(content.get("unmeasured"), place("unmeasured"))
        values["engine"] = _engine(content.get("engine", DEFAULT), values, place("engine"))
        if (records := content.get("records")) is not None:
            if (
                not isinstance(records, list)
                or not records
                or not all(isinstance(name, str) for name in records)
            ):
                raise _error(
                    place("records"), shown(records), "a list of record ids", "leave it out to take all"
                )
            values["records"] = tuple(_distinct(records, place("records")))
        if (peak := content.get("peak_displacement_m")) is not None:
            if not is_number(peak) or not 0 < peak <= LARGEST_DISPLACEMENT_M:
                raise _error(
                    place("peak_displacement_m"),
                    shown(peak),
                    f"metres above 0 and up to {LARGEST_DISPLACEMENT_M:g}",
                    "leave it out for none",
                )
            values["peak_displacement_m"] = float(peak)
        if (audit := content.get("audit")) is not None:
            if not isinstance(audit, int) or isinstance(audit, bool) or audit < 0:
                raise _error(
                    place("audit"),
                    f"{audit!r}",
                    "a whole number of jobs, 0 for none",
                    "leave it out for as many as cost less than a tenth of the run",
                )
            values["audit"] = audit
        values["stood"] = _stood(content.get("stood", []), folder, place("stood"))
        values |= _asked(content, folder, values, place)
        return cls(**values)

    def check_jobs(self, records: int) -> None:
        """Refuse more jobs than a table can hold, before any is made.

        Raises
        ------
        InputError
            If there are more than `MOST_JOBS` with so many records.
        """
        axes = {
            "records": records, "levels": max(len(self.pga_m_s2), 1), "azimuths": max(len(self.azimuth_deg), 1),
            "frictions": len(self.friction), "restitutions": len(self.restitution),
            "realisations": self.realisations,
        }  # fmt: skip
        jobs = math.prod(axes.values())
        if jobs > MOST_JOBS:
            told = " x ".join(f"{count} {name}" for name, count in axes.items())
            raise _error(
                "campaign", f"{jobs:.3g} jobs = {told}", f"at most {MOST_JOBS} jobs", "leave some of them out"
            )

    def to_toml(self, scene: str, ensemble: str, stood: Iterable[str] = (), hazard: str | None = None) -> str:
        """Write the campaign as TOML with the folders given and every value written out."""
        content = {
            field.name: getattr(self, field.name)
            for field in dataclasses.fields(self)
            if getattr(self, field.name) not in (None, ())
        }
        content |= {"scene": scene, "ensemble": ensemble, "pga_m_s2": self.pga_m_s2 or AS_RECORDED}
        content["azimuth_deg"] = self.azimuth_deg or AS_RECORDED
        if self.stood:
            content["stood"] = list(stood)
        if self.unmeasured is not None:
            content["unmeasured"] = dataclasses.asdict(self.unmeasured)
        if self.target is not None:
            content["target"] = self.target.content(hazard)
        return "".join(f"{key} = {_toml(value)}\n" for key, value in content.items())


def hash_of(texts: Iterable[str]) -> str:
    """Short hash of a sequence of texts, which depends on their order."""
    digest = hashlib.sha256()
    for text in texts:
        digest.update(text.encode())
        digest.update(b"\n")
    return digest.hexdigest()[:20]


def _without_levels(content: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Content without a key that campaigns had, and that those of their runs state."""
    kept = {**content}
    if (levels := kept.pop("levels", "all")) != "all":
        raise _error(
            where,
            f"{shown(levels)}: levels are no longer chosen within each record",
            "no key levels",
            "remove it; precision = 0.05 ends a run as soon as its statement is that sure",
        )
    return kept


def _axis(value: Any, where: str, fits: Callable[[float], bool], expected: str) -> tuple[float, ...]:
    """Numbers of a list, or of a table {start, stop, step} that includes its stop."""
    if isinstance(value, dict):
        if set(value) != {"start", "stop", "step"} or not all(is_number(part) for part in value.values()):
            raise _error(
                where, shown(value), "{ start = ..., stop = ..., step = ... } in numbers", "or give a list"
            )
        start, stop, step = value["start"], value["stop"], value["step"]
        if not (step > 0 and stop >= start):
            written = (
                f"{{ start = {min(start, stop):g}, stop = {max(start, stop):g}, step = {abs(step) or 1:g} }}"
            )
            raise _error(
                where,
                f"the range from {start:g} to {stop:g} in steps of {step:g} holds no number",
                "step above 0, stop not below start",
                f"did you mean {written}?",
            )
        # Half a thousandth of a step lets 0.1 + 0.1 + 0.1 reach a stop of 0.3; rounding gives 0.3 back.
        many = (float(stop) - float(start)) / step
        if not many < MOST_ON_AN_AXIS:
            raise _error(
                where,
                f"{shown(value)} holds {many:.3g} numbers",
                f"at most {MOST_ON_AN_AXIS}",
                "take a larger step",
            )
        count = int(many + 5e-4) + 1
        value = [round(start + index * step, 12) for index in range(count)]
    if not isinstance(value, list) or not value:
        raise _error(
            where, shown(value), f"a list of {expected}", "at least one value is needed to have a job"
        )
    for number in value:
        if not is_number(number) or not fits(number):
            raise _error(where, shown(number), expected, "correct the value; mind the unit in the key's name")
    return tuple(float(number) for number in _distinct(value, where))


def _friction(value: Any, where: str) -> tuple[tuple[float, float], ...]:
    if not isinstance(value, list) or not value:
        raise _error(where, shown(value), "a list of coefficients", "at least one is needed, such as [0.8]")
    pairs = []
    for entry in value:
        pair = entry if isinstance(entry, list) else [entry, entry]
        if len(pair) != 2 or not all(is_number(number) for number in pair):
            raise _error(where, shown(entry), "a number, or [static, kinetic]", "correct the entry")
        if pair[1] > pair[0]:
            what, expected = (
                f"{shown(entry)}: kinetic friction above static",
                "[static, kinetic], the larger first",
            )
            raise _error(where, what, expected, f"did you mean [{pair[1]:g}, {pair[0]:g}]?")
        try:
            ContactProperties(*map(float, pair))
        except InputError as error:
            raise _error(where, f"{shown(entry)}: {error.what}", error.expected, error.remedy) from None
        pairs.append((float(pair[0]), float(pair[1])))
    return tuple(_distinct(pairs, where))


def _toml(value: Any) -> str:
    """A value in TOML: JSON's strings, numbers, truths and arrays are TOML's too, its tables are not."""
    if isinstance(value, dict):
        pairs = (f"{key} = {_toml(each)}" for key, each in value.items() if each is not None)
        return f"{{ {', '.join(pairs)} }}"
    return json.dumps(value, ensure_ascii=False)


def _unmeasured(value: Any, where: str) -> Unmeasured | None:
    if value is None:
        return None
    expected = (
        "{ friction = [low, high], restitution = [low, high], yaw_deg = number, either_sense = true or false, "
        "band_hz = number, above_band = [low, high] }, each as wanted"
    )
    known = {field.name for field in dataclasses.fields(Unmeasured)}
    if not isinstance(value, dict) or not set(value) <= known:
        raise _error(where, f"{value!r}", expected, "correct or remove it")
    drawn = dict(value)
    for key, highest in (("friction", math.inf), ("restitution", 1.0), ("above_band", 2.0)):
        if key not in drawn:
            continue
        pair = drawn[key]
        if not isinstance(pair, list) or len(pair) != 2 or not all(map(is_number, pair)):
            raise _error(f"{where}.{key}", f"{pair!r}", "[low, high]", "give two numbers")
        if not 0.0 <= pair[0] <= pair[1] <= highest:
            raise _error(f"{where}.{key}", f"{pair!r}", f"0 to {highest:g}, the lower first", "correct it")
        drawn[key] = (float(pair[0]), float(pair[1]))
    yaw_deg = drawn.get("yaw_deg", 0.0)
    if not is_number(yaw_deg) or not 0.0 <= yaw_deg <= 180.0:
        raise _error(f"{where}.yaw_deg", f"{yaw_deg!r}", "0 to 180 degrees", "correct it")
    drawn["yaw_deg"] = float(yaw_deg)
    if not isinstance(drawn.get("either_sense", False), bool):
        raise _error(f"{where}.either_sense", f"{drawn['either_sense']!r}", "true or false", "correct it")
    if ("band_hz" in drawn) != ("above_band" in drawn):
        raise _error(where, "one of band_hz and above_band", "both or neither", "such as 25.0 and [0.0, 0.6]")
    if "band_hz" in drawn:
        if not is_number(drawn["band_hz"]) or not 0.0 < drawn["band_hz"] <= HIGHEST_BAND_HZ:
            what, expected = f"{drawn['band_hz']!r}", f"up to {HIGHEST_BAND_HZ:g} Hz"
            raise _error(f"{where}.band_hz", what, expected, "correct it")
        drawn["band_hz"] = float(drawn["band_hz"])
    return Unmeasured(**drawn)


def _stood(value: Any, folder: Path, where: str) -> tuple[Path, ...]:
    if not isinstance(value, list) or not all(isinstance(name, str) and name for name in value):
        raise _error(
            where,
            shown(value),
            "a list of files of records, or folders of ensembles",
            'such as ["quake.AT2"]',
        )
    return tuple(folder / local(name) for name in _distinct(value, where))


def _engine(name: Any, values: Mapping[str, Any], where: str) -> str:
    if name not in ENGINES:
        remedy = did_you_mean(name, ENGINES, f"leave it out for {DEFAULT!r}")
        raise _error(where, f"{name!r}", f"one of {', '.join(ENGINES)}", remedy)
    engine, drawn = ENGINES[name], values["unmeasured"]
    rebounds = list(values["restitution"])
    if drawn is not None and drawn.restitution is not None:
        rebounds.append(drawn.restitution[1])
    if not engine.models(values["friction"], rebounds):
        what = f"{name} knows neither restitution nor a kinetic friction of its own"
        raise _error(
            where, what, "restitution [0] and one coefficient an entry of friction", f"take {DEFAULT!r}"
        )
    return str(name)


def _asked(
    content: Mapping[str, Any], folder: Path, values: Mapping[str, Any], place: Callable[[str], str]
) -> dict[str, Any]:
    """Values of `precision` and `target`."""
    if content.get("precision") is None:
        if "target" in content:
            raise _error(
                place("target"), "a target without a precision", "both", "add precision = 0.05, or remove it"
            )
        return {}
    if not values["pga_m_s2"]:
        raise _error(
            place("precision"), "no levels to choose among", "levels in pga_m_s2", "leave precision out"
        )
    told: dict[str, Any] = {"precision": read_precision(content["precision"], place("precision"))}
    if (target := content.get("target")) is None:
        return told
    return {**told, "target": read_target(target, folder, place("target"))}


def _distinct(values: list, where: str) -> list:
    if len(values) > MOST_ON_AN_AXIS:
        raise _error(where, f"{len(values)} values", f"at most {MOST_ON_AN_AXIS}", "leave some out")
    repeated = [shown(value) for value, count in Counter(values).items() if count > 1]
    if repeated:
        told = ", ".join(sorted(repeated)[:10])
        raise _error(where, f"{told} given twice", "every value once", "remove the repetition")
    return values


def _error(where: object, what: str, expected: str, remedy: str) -> InputError:
    return InputError(what, where=str(where), expected=expected, remedy=remedy)
