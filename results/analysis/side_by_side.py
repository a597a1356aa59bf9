"""Comparison of several rocks: fragility over one measure, statics, location and directions of each; GeoJSON."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from toppling.models.arrays import Array
from toppling.models.errors import InputError
from toppling.models.frames import horizontal_unit_vector
from toppling.results.analysis.fits import answered, curve_over
from toppling.results.analysis.fragility import chief, contact_words, named, topple_rose, weakest
from toppling.results.analysis.lognormal import Lognormal
from toppling.results.analysis.resampling import SAMPLES
from toppling.results.reader import Run

ARROW_M = 100.0
"""Length on the map of an arrow that represents all topplings of a rock, m."""


@dataclass(frozen=True, eq=False)
class RockResults:
    """Results of one of several rocks."""

    run: Run
    # Name of the rock, and words for the contact (that of the highest friction) of all numbers.
    name: str
    contact: str
    jobs: pd.DataFrame  # weighted jobs of that contact
    # Fragility with its interval; None where topplings or survivals are too few.
    curve: Lognormal | None
    why_not: str  # reason why there is no curve
    # Longitude and latitude (WGS 84), from the atlas's table or else the scan's coordinate system.
    place: tuple[float, float] | None
    # Least constant ground acceleration that topples, a row of `Run.quasi_static`; None where there is none.
    least: "pd.Series[float] | None"

    @property
    def weakest_azimuth_deg(self) -> float | None:
        """Azimuth toward which that acceleration points, counter-clockwise from east."""
        return None if self.least is None else float(self.least["ground_accelerates_toward_deg"])

    @property
    def single_base(self) -> str:
        """Remark that all jobs are on one of the possible bases; empty otherwise."""
        known = answered(self.jobs)
        return (
            "on one of the bases that the scan allows"
            if len(known) and self.run.on_single_base(known)
            else ""
        )

    @property
    def row(self) -> dict[str, Any]:
        """Row of the table of rocks; None where a value is unknown."""
        known, curve = answered(self.jobs), self.curve
        interval = (curve.median_interval if curve else None) or (None, None)
        parts = curve.interval_parts if curve else {}
        weakest, entry = self.weakest_azimuth_deg, self.run.entry
        return {
            "rock": self.name,
            "site": entry.get("site"),
            "longitude": self.place[0] if self.place else None,
            "latitude": self.place[1] if self.place else None,
            "age": entry.get("age"),
            "measure": curve.measure if curve else None,
            "median": curve.median if curve else None,
            "median_low": interval[0],
            "median_high": interval[1],
            "median_records": parts.get("records"),
            "median_base": parts.get("base"),
            "beta": curve.beta if curve else None,
            "least_quasi_static_m_s2": None if self.least is None else float(self.least["value"]),
            **named("ground_accelerates_toward", weakest),
            **named("falls_toward", None if weakest is None else (weakest + 180.0) % 360.0),
            "contact": self.contact,
            "jobs": len(known),
            "toppled": int(known["toppled"].sum()),
            "records": int(known["record_id"].nunique()),
            "without_answer": len(self.jobs) - len(known),
            "remark": "; ".join(
                filter(None, (self.run.completeness().remark, self.single_base, self.why_not))
            )
            or None,
        }


@dataclass(frozen=True)
class CommonJobs:
    """Records and levels that the jobs of several rocks have in common."""

    records: tuple[str, ...]  # records of identical content that shook all rocks
    levels_m_s2: tuple[float, ...]  # levels that all rocks were shaken at
    of_records: int  # number of distinct records of all rocks

    @property
    def sentence(self) -> str:
        """Summary for a reader."""
        levels = ", ".join(f"{level:g}" for level in self.levels_m_s2) or "none"
        records = f"{len(self.records)} of {self.of_records} records"
        return f"The rocks share {records}, and as levels of PGA (m/s²) {levels}."


def compare_rocks(
    runs: Sequence[Run],
    measure: str,
    samples: int = SAMPLES,
    *,
    only_common: bool = False,
    advance: Callable[[], object] = lambda: None,
) -> tuple[list[RockResults], CommonJobs]:
    """Rocks with their fragilities over one measure, and the records and levels that they have in common.

    runs: runs of one rock each.
    measure: column of the results.
    samples: bootstrap samples of records.
    only_common: fit only jobs with common records at common levels.
    advance: called after each rock.
    Raises InputError with `only_common` if the rocks have nothing in common.
    """
    chosen = [_chief(run) for run in runs]
    common = _common_jobs([jobs for _, jobs in chosen], runs)
    if only_common and not (common.records and common.levels_m_s2):
        remedy = "leave --shared out, or compare rocks of one campaign"
        raise InputError(
            "atlas.nothing_shared",
            common.sentence,
            where="atlas",
            expected="records and levels in common",
            remedy=remedy,
        )
    found = []
    for run, (contact, jobs) in zip(runs, chosen, strict=True):
        used = jobs
        if only_common:
            used = jobs[
                jobs["record_id"].isin(common.records) & jobs["level_pga_m_s2"].isin(common.levels_m_s2)
            ]
        found.append(_rock_results(run, contact, used, measure, samples))
        advance()
    return found, common


def _chief(run: Run) -> tuple[str, pd.DataFrame]:
    """Words for the contact with the highest friction, and its weighted jobs."""
    frame = run.weighted(run.frame())
    if frame.empty:
        return "", frame
    jobs = chief(frame)
    return contact_words(jobs, frame), jobs


def _common_jobs(of_rocks: Sequence[pd.DataFrame], runs: Sequence[Run]) -> CommonJobs:
    known = [frame for frame in of_rocks if not frame.empty]
    contents = []
    for run, frame in zip(runs, of_rocks, strict=True):
        motions = run.motions()
        if frame.empty or motions is None:
            continue
        sha = dict(zip(motions["record_id"].to_pylist(), motions["sha"].to_pylist(), strict=True))
        contents.append({(name, sha.get(name, "")) for name in frame["record_id"].unique()})
    levels = [set(frame["level_pga_m_s2"].unique()) for frame in known]
    records: set[tuple[str, str]] = set.intersection(*contents) if contents else set()
    return CommonJobs(
        tuple(sorted(name for name, _ in records)),
        tuple(sorted(set.intersection(*levels))) if levels else (),
        len(set().union(*contents)),
    )


def _rock_results(run: Run, contact: str, jobs: pd.DataFrame, measure: str, samples: int) -> RockResults:
    known = answered(jobs) if len(jobs) else jobs
    curve: Lognormal | None = None
    why_not = (run.entry.get("problem") or "no job has an answer").splitlines()[0]
    if len(known):
        toppled = int(known["toppled"].sum())
        why_not = f"{toppled} of {len(known)} jobs toppled it"
        curve = curve_over(jobs, measure, samples, run.completeness())
        why_not = "" if curve else why_not
    found = _on_earth(run)
    place = None if found is None else (float(found[0, 0]), float(found[0, 1]))
    return RockResults(run, run.rock, contact, jobs, curve, why_not, place, weakest(run.quasi_static()))


def _on_earth(run: Run, offsets_m: ArrayLike = ((0.0, 0.0),)) -> Array | None:
    """Longitude and latitude (n, 2) of points near a rock; None where its location is unknown.

    run: run of the rock, located by its atlas or its scan's coordinate system.
    offsets_m: (n, 2), east and north of the rock's centre of mass, scene frame.
    """
    offsets = np.asarray(offsets_m, float)
    entry = run.entry
    if entry.get("longitude") is not None:
        from pyproj import Geod

        away = np.hypot(*offsets.T)
        bearing = np.rad2deg(np.arctan2(*offsets.T))
        longitude, latitude = (
            np.full(len(offsets), float(entry[name])) for name in ("longitude", "latitude")
        )
        longitude, latitude, _ = Geod(ellps="WGS84").fwd(longitude, latitude, bearing, away)
        return np.column_stack([longitude, latitude])
    codes = {file.get("epsg") for file in run.scene_report().get("files") or () if isinstance(file, dict)}
    rock = run.rock_m()
    if len(codes) != 1 or not isinstance(code := codes.pop(), int) or rock is None:
        return None
    from pyproj import CRS, Transformer
    from pyproj.exceptions import ProjError

    try:
        system = CRS.from_epsg(code)
        own = (np.array(rock[:2]) + offsets) / system.axis_info[0].unit_conversion_factor
        found = np.column_stack(Transformer.from_crs(system, 4326, always_xy=True).transform(*own.T))
    except ProjError:
        return None
    return found if np.isfinite(found).all() else None


def geojson(rocks: Sequence[RockResults]) -> dict[str, Any]:
    """GeoJSON (RFC 7946) of the rocks with a known location: points with the columns of their table."""
    features = []
    for rock in rocks:
        if rock.place is not None:
            properties = rock.row
            del properties["longitude"], properties["latitude"]
            features.append(_feature("Point", [rock.place], properties))
    return _collection(features)


def directions_geojson(rocks: Sequence[RockResults]) -> dict[str, Any]:
    """GeoJSON of lines from each located rock toward the azimuths that it toppled to.

    A line's `length_m` is `ARROW_M` times the fraction of topplings within half a petal of its azimuth.
    """
    found = []
    for rock in rocks:
        rose = topple_rose(rock.jobs) if rock.place is not None and len(rock.jobs) else None
        if rose is None:
            continue
        rose = rose[rose["toppled"] > 0]
        ends = _on_earth(
            rock.run,
            ARROW_M
            * rose["share_of_toppled"].to_numpy()[:, None]
            * horizontal_unit_vector(rose["falls_toward_deg"])[:, :2],
        )
        for row, end in zip(rose.to_dict("records"), ends if ends is not None else (), strict=False):
            properties = {
                "rock": rock.name,
                **row,
                "toppled": int(row["toppled"]),
                "length_m": ARROW_M * row["share_of_toppled"],
            }
            found.append(_feature("LineString", [rock.place, end], properties))
    return _collection(found)


def _feature(kind: str, places: Sequence[Any], properties: dict[str, Any]) -> dict[str, Any]:
    points = [[round(float(degrees), 7) for degrees in place] for place in places]
    coordinates = points[0] if kind == "Point" else points
    return {
        "type": "Feature",
        "geometry": {"type": kind, "coordinates": coordinates},
        "properties": properties,
    }


def _collection(features: list[dict[str, Any]]) -> dict[str, Any]:
    return {"type": "FeatureCollection", "features": features}
