"""Toppling probabilities per cell of the maps and by azimuth, and their comparison under two frictions."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import ndtri

from toppling.models.arrays import Array
from toppling.models.frames import compass_deg
from toppling.results.analysis import DIRECTION_BINS, FEW
from toppling.results.analysis.lognormal import earthquakes

CONTACT_COLUMNS = ("scene_id", "engine", "preset", "friction_static", "friction_kinetic", "restitution")
"""Columns of scene, engine and contact: jobs that differ in any of them are never pooled."""

FRICTION = ["friction_static", "friction_kinetic"]

_NEAR_FACTOR = 1.25
"""Factor within which drawn frictions are described as "about" the stated one; beyond it, as a range."""

_CONTACT_WORDS = (
    ("restitution", "restitution "),
    ("engine", ""),
    ("preset", "preset "),
    ("scene_id", "scene "),
)
"""Columns that describe a contact in addition to its friction, where they differ, with the prefix of their values."""


@dataclass(frozen=True)
class Axis:
    """Axis of a map: a column of the results and its bins."""

    column: str
    # Printed label and unit.
    label: str
    unit: str
    # Width of a bin, starting at zero; None for one bin per distinct value (the levels of a campaign).
    width: float | None = None
    below: float | None = None  # upper end of the axis: jobs at or above it are left out


@dataclass(frozen=True)
class Plane:
    """Plane of a map."""

    name: str  # stem of the file names
    x: Axis
    y: Axis
    by_direction: bool = False  # whether the plane is also drawn by direction of the shaking


LEVEL = Axis("level_pga_m_s2", "PGA", "m/s²")
PGV = Axis("pgv_m_s", "PGV", "m/s", 0.25)
PULSE = Axis("pgv_pga_s", "PGV/PGA", "s", 0.05)
DURATION = Axis("duration_energy_s", "duration", "s", 5.0)

PLANES = {
    plane.name: plane
    for plane in (
        Plane("pga_pgv_pga", PULSE, LEVEL, by_direction=True),
        Plane("pga_pgv", LEVEL, PGV, by_direction=True),
        Plane("pgv_duration", replace(DURATION, below=30.0), replace(PGV, below=3.0)),
        Plane("pga_duration", DURATION, LEVEL),
    )
}
"""The planes of Veeraraghavan, Hudnut and Krishnan's figures 6, 9, 10a and 10b."""

FEW_BEYOND = 0.02
"""Largest fraction of jobs that the default bounds may leave off a map; otherwise the map has no bounds."""
_MOST_LEVELS = 40
"""Maximum number of distinct levels of PGA with a bin each; more (unscaled records) are binned by 1 m/s²."""


def planes_of(frame: pd.DataFrame) -> dict[str, Plane]:
    """Planes by name, with bins wide enough for the records.

    Those whose bounds would exclude more than `FEW_BEYOND` of the jobs are unbounded.
    """
    of_levels = replace(LEVEL, width=1.0 if frame[LEVEL.column].nunique() > _MOST_LEVELS else None)
    planes = {
        name: replace(
            plane, x=of_levels if plane.x == LEVEL else plane.x, y=of_levels if plane.y == LEVEL else plane.y
        )
        for name, plane in PLANES.items()
    }
    for name, plane in planes.items():
        if beyond(frame, plane) > FEW_BEYOND * len(frame):
            planes[name] = replace(plane, x=replace(plane.x, below=None), y=replace(plane.y, below=None))
    return {name: _coarse_enough(frame, plane) for name, plane in planes.items()}


def _coarse_enough(frame: pd.DataFrame, plane: Plane) -> Plane:
    """A plane with bins doubled, on the axis that helps more, until half of the jobs lie in cells that are not thin."""
    coarse = plane
    while _sure_fraction(frame, coarse) < 0.5:
        x, y = _doubled(coarse.x, frame), _doubled(coarse.y, frame)
        wider = [other for other in (replace(coarse, x=x), replace(coarse, y=y)) if other != coarse]
        if not wider:
            return plane
        coarse = max(wider, key=lambda other: _sure_fraction(frame, other))
    return coarse


def _sure_fraction(frame: pd.DataFrame, plane: Plane) -> float:
    table = cells(frame, plane)
    return float(table.loc[~table["thin"], "jobs"].sum() / max(table["jobs"].sum(), 1))


def _doubled(axis: Axis, frame: pd.DataFrame) -> Axis:
    """An axis with bins of twice the width, if it has more than one bin."""
    if axis.width is None or not frame[axis.column].max() >= axis.width:
        return axis
    return replace(axis, width=2.0 * axis.width)


def direction_bin_deg(azimuth_deg: Iterable[float], bins: int = DIRECTION_BINS) -> Array:
    """Centre of the direction bin of each azimuth; the first bin is centred on azimuth 0.

    azimuth_deg: (n,), degrees counter-clockwise from x.
    bins: number of equal bins around the circle.
    """
    width = 360.0 / bins
    azimuth = np.asarray(azimuth_deg, dtype=float)
    return np.floor((azimuth + width / 2) / width) % bins * 360.0 / bins  # as every k * 360 / bins to the bit


def cells(frame: pd.DataFrame, plane: Plane) -> pd.DataFrame:
    """Toppling probability in each cell of a plane that holds a job.

    frame: rows of results, all of one contact (`by_contact`).
    Returns DataFrame: one row per cell: low and high value on both axes (and the level, where there are levels), jobs
    with an answer, no_answer, records, toppled, probability, wilson_low and wilson_high (95 %), thin.
    """
    jobs = frame.loc[_below(frame, plane.x) & _below(frame, plane.y)]
    x, y = _edges(jobs[plane.x.column], plane.x), _edges(jobs[plane.y.column], plane.y)
    binned = pd.DataFrame(
        {
            "x": _index(jobs[plane.x.column], x),
            "y": _index(jobs[plane.y.column], y),
            "record_id": jobs["record_id"],
            "independent": earthquakes(jobs),
            "answered": jobs["toppled"].notna(),
            "toppled": jobs["toppled"].fillna(False).astype(bool),
            "weight": jobs.get("record_weight", 1.0),
        }
    )
    binned["answered_weight"] = binned["weight"] * binned["answered"]
    binned["toppled_weight"] = binned["weight"] * binned["toppled"]
    grouped = binned.groupby(["x", "y"])
    counts = grouped.agg(all_jobs=("answered", "size"), jobs=("answered", "sum"), toppled=("toppled", "sum"))
    counts["records"] = binned[binned["answered"]].groupby(["x", "y"])["record_id"].nunique()
    counts = counts.fillna({"records": 0}).astype(int)
    counts[_WEIGHTS] = grouped[_WEIGHTS].sum()
    counts["trials"] = trials(binned[binned["answered"]], ["x", "y"])
    counts = counts.fillna({"trials": 0.0}).reset_index()
    table = pd.DataFrame(
        {
            **_bounds(plane.x, jobs[plane.x.column], x, counts["x"]),
            **_bounds(plane.y, jobs[plane.y.column], y, counts["y"]),
            "jobs": counts["jobs"],
            "no_answer": counts["all_jobs"] - counts["jobs"],
            "records": counts["records"],
            "toppled": counts["toppled"],
        }
    )
    probability = (
        (counts["toppled_weight"] / counts["answered_weight"]).where(table["jobs"] > 0).clip(0.0, 1.0)
    )
    table["probability"] = probability
    table["wilson_low"], table["wilson_high"] = wilson(probability, counts["trials"])
    table["thin"] = counts[["trials", "records"]].min(axis=1) < FEW
    return table


def unplaced(frame: pd.DataFrame, plane: Plane, *, by_direction: bool = False) -> int:
    """Number of jobs in no cell of a plane (or of a plane by direction) because a measure of motion is unknown."""
    needed = [plane.x.column, plane.y.column, *(["ground_accelerates_toward_deg"] if by_direction else [])]
    return int(frame[needed].isna().any(axis=1).sum())


def beyond(frame: pd.DataFrame, plane: Plane) -> int:
    """Number of jobs with known measures at or above the upper end of an axis of a plane."""
    inside = _below(frame, plane.x) & _below(frame, plane.y)
    return len(frame) - int(inside.sum()) - unplaced(frame, plane)


_WEIGHTS = ["weight", "answered_weight", "toppled_weight"]


def trials(jobs: pd.DataFrame, group: Sequence[str]) -> "pd.Series[float]":
    """Number of independent answers that the jobs of each group are worth, as Wilson's interval counts them.

    Kish's effective number of the groups' earthquakes, or records (`independent`), by the weights of their jobs, over
    the variance of their fractions as a share of that of single answers, which is common to all groups. In 300
    simulated sets of 5 to 40 earthquakes, of 1 to about 20 records each, intervals of 95 % held 94 to 96 %; with
    records for earthquakes 85 to 99 %.

    jobs: with `weight`, `toppled` and `independent`, all with an answer.
    """
    weight, keys = jobs["weight"], list(group)
    summed = jobs.assign(toppled=weight * jobs["toppled"], squares=weight**2)
    units = summed.groupby([*keys, "independent"])[["weight", "toppled", "squares"]].sum()
    total = units.groupby(keys)[["weight", "toppled"]].transform("sum")
    units["mass"] = units["weight"] ** 2
    units["scatter"] = (units["toppled"] - units["weight"] * total["toppled"] / total["weight"]) ** 2
    table = units.groupby(keys).sum()
    number, share = table["weight"] ** 2 / table["mass"], table["toppled"] / table["weight"]
    of_single = float((share * (1.0 - share) * (1.0 - 1.0 / number)).sum())
    scatter = float((table["scatter"] / table["mass"]).sum())
    common = min(scatter / of_single, 1.0) if of_single > 0 else 1.0
    return np.minimum(number / common, table["weight"] ** 2 / table["squares"])


def records_on(frame: pd.DataFrame, plane: Plane) -> int:
    """Number of distinct records of the answered jobs on a plane's map."""
    known = frame["toppled"].notna() & frame[[plane.x.column, plane.y.column]].notna().all(axis=1)
    return int(frame.loc[known & _below(frame, plane.x) & _below(frame, plane.y), "record_id"].nunique())


@dataclass(frozen=True, eq=False)
class DirectionCells:
    """Cells of a plane in each direction bin of the vector PGA."""

    table: pd.DataFrame  # `cells` of each bin, whose centre is `direction_deg`
    plane: Plane
    bins: int  # number of direction bins around the circle
    records: Mapping[float, int]  # number of distinct records (`records_on`) of each non-empty bin
    unplaced: int  # number of jobs in no cell

    @classmethod
    def of(cls, frame: pd.DataFrame, plane: Plane, bins: int = DIRECTION_BINS) -> "DirectionCells":
        """Count the jobs of a run."""
        known = frame[frame["ground_accelerates_toward_deg"].notna()]
        by_bin = dict(list(known.groupby(direction_bin_deg(known["ground_accelerates_toward_deg"], bins))))
        tables = [cells(jobs, plane).assign(direction_deg=centre) for centre, jobs in by_bin.items()]
        table = pd.concat(tables or [cells(known, plane).assign(direction_deg=np.nan)], ignore_index=True)
        table = table[["direction_deg", *table.columns.drop("direction_deg")]]
        records = {float(centre): records_on(jobs, plane) for centre, jobs in by_bin.items()}
        return cls(table, plane, bins, records, unplaced(frame, plane, by_direction=True))


def by_contact(frame: pd.DataFrame, columns: Sequence[str] = CONTACT_COLUMNS) -> dict[str, pd.DataFrame]:
    """Split rows by scene, engine, preset and contact; the key of each part names the columns that differ."""
    differing = [name for name in columns if frame[name].nunique() > 1]
    if set(FRICTION) & set(differing):  # static and kinetic friction are named together
        differing = [name for name in columns if name in differing or name in FRICTION]
    if not differing:
        return {"": frame}
    if "scene_id" in differing and _named(frame):
        differing[differing.index("scene_id")] = "rock"
    return {
        _contact_name(dict(zip(differing, key, strict=True))): jobs for key, jobs in frame.groupby(differing)
    }


def chief(frame: pd.DataFrame) -> pd.DataFrame:
    """Rows of the contact with the highest friction."""
    return max(by_contact(frame).values(), key=lambda jobs: tuple(jobs[FRICTION].iloc[0]))


def _named(frame: pd.DataFrame) -> bool:
    return "rock" in frame and bool(frame["rock"].notna().all())


def contact_words(jobs: pd.DataFrame, among: pd.DataFrame) -> str:
    """Label of a contact in figures: its friction, and whatever else differs among all rows."""
    first = jobs.iloc[0]
    words = [_friction_drawn(jobs)]
    for column, word in _CONTACT_WORDS:
        if among[column].nunique() > 1:
            named = column == "scene_id" and _named(among)
            words.append(str(first["rock"]) if named else word + _plain(first[column]))
    return ", ".join(words)


def _friction_drawn(jobs: pd.DataFrame) -> str:
    """Friction of one contact, such as "μ = 0.8"; for drawn frictions "μ about 0.8" or a range."""
    static, kinetic = (float(jobs[name].iloc[0]) for name in FRICTION)
    factor = jobs["friction_factor"].dropna() if "friction_factor" in jobs else pd.Series(dtype=float)
    least, most = (1.0, 1.0) if factor.empty else (float(factor.min()), float(factor.max()))
    if most > _NEAR_FACTOR or least < 1.0 / _NEAR_FACTOR:
        return f"μ {static * least:.2g} to {static * most:.2g}"
    word = "=" if least == most == 1.0 else "about"
    return f"μ {word} {static:g}" + ("" if static == kinetic else f" ({kinetic:g} kinetic)")


def _contact_name(values: dict[str, object]) -> str:
    short = {"friction_static": "friction", "friction_kinetic": "kinetic", "scene_id": "scene"}
    named = dict(values)
    if named.get("friction_kinetic") == named.get("friction_static"):
        named.pop("friction_kinetic", None)
    return "_".join(f"{short.get(name, name)}-{_plain(value)}" for name, value in named.items())


def wilson(probability: pd.Series, trials: pd.Series) -> tuple[pd.Series, pd.Series]:
    """Wilson's 95 % interval of a proportion observed in some trials; null for no trials."""
    some = trials.where(trials > 0)
    spread = ndtri(0.975) ** 2 / some
    half = np.sqrt(spread * (probability * (1.0 - probability) + 0.25 * spread))
    middle = probability + 0.5 * spread
    return (middle - half) / (1.0 + spread), (middle + half) / (1.0 + spread)


def _below(frame: pd.DataFrame, axis: Axis) -> "pd.Series[bool]":
    return frame[axis.column] < (np.inf if axis.below is None else axis.below)


def _edges(values: pd.Series, axis: Axis) -> NDArray[np.floating]:
    if axis.width is not None:
        last = int(np.floor(values.max() / axis.width + 1e-9)) if len(values) else 0
        return np.arange(last + 2) * axis.width
    levels = np.unique(values)
    if len(levels) < 2:
        return np.array([level + half for level in levels for half in (-0.5, 0.5)])
    middle = (levels[1:] + levels[:-1]) / 2
    return np.concatenate([[2 * levels[0] - middle[0]], middle, [2 * levels[-1] - middle[-1]]])


def _index(values: pd.Series, edges: NDArray[np.floating]) -> NDArray[np.int64]:
    # A value on an edge belongs to the bin above it, regardless of rounding.
    return np.searchsorted(edges * (1 - 1e-12), values.to_numpy(float), side="right") - 1


def _bounds(axis: Axis, values: pd.Series, edges: NDArray[np.floating], index: pd.Series) -> dict[str, Array]:
    level = {axis.column: np.unique(values)[index]} if axis.width is None else {}
    return {**level, f"{axis.column}_low": edges[index], f"{axis.column}_high": edges[index + 1]}


def _plain(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)[:12]


_SURROUNDINGS = [name for name in CONTACT_COLUMNS if name not in FRICTION]
_JOB = [*_SURROUNDINGS, "record_id", "level_pga_m_s2", "azimuth_deg", "realisation"]

_Friction = tuple[float, float]
"""Static and kinetic coefficient."""


def friction_words(static: float, kinetic: float) -> str:
    """Format a pair of coefficients: 0.8 where they are equal, or 0.8 (0.6 kinetic)."""
    return f"{static:g}" if static == kinetic else f"{static:g} ({kinetic:g} kinetic)"


def frictions(frame: pd.DataFrame) -> list[_Friction]:
    """Distinct pairs of static and kinetic friction, ascending."""
    return sorted(frame[FRICTION].drop_duplicates().itertuples(index=False, name=None))


def by_surroundings(frame: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Rows of each scene, engine, preset and restitution with several frictions to compare."""
    parts = by_contact(frame, _SURROUNDINGS)
    return {name: jobs for name, jobs in parts.items() if len(frictions(jobs)) > 1}


def compare_frictions(frame: pd.DataFrame, plane: Plane) -> Iterator[tuple[str, pd.DataFrame, pd.DataFrame]]:
    """Compare each friction with the highest, for each of `by_surroundings`: yield its name, cells and jobs."""
    for name, jobs in by_surroundings(frame).items():
        reference = frictions(jobs)[-1]
        table, pairs = compare_cells(jobs, plane, reference), compare_jobs(jobs, reference)
        if len(table) and len(pairs):
            yield name, table, pairs


def compare_cells(frame: pd.DataFrame, plane: Plane, reference: _Friction) -> pd.DataFrame:
    """Toppling probability of each cell under each friction and under a reference friction.

    Only jobs that were answered under both are compared, so that differences are due to friction.

    frame: rows of results of one scene, preset and restitution (`by_surroundings`).
    reference: static and kinetic friction on the horizontal axis.
    Returns DataFrame: one row per friction and cell: friction_static, friction_kinetic, the cell's bounds, records,
    probability, wilson_low, wilson_high, thin; with the prefix `reference_` frictions and probabilities of the
    reference.
    """
    answered = frame[frame["toppled"].notna()]
    base = _under(answered, reference)
    tables = []
    for friction in frictions(answered):
        if friction == reference:
            continue
        jobs = _under(answered, friction)
        common = base[_JOB].merge(jobs[_JOB])
        ours, theirs = (cells(part.merge(common), plane) for part in (jobs, base))
        bounds = [name for name in ours.columns if name.endswith(("_low", "_high")) and "wilson" not in name]
        numbers = ["probability", "wilson_low", "wilson_high"]
        renamed = theirs[[*bounds, *numbers]].rename(columns={name: f"reference_{name}" for name in numbers})
        both = ours[[*bounds, "records", *numbers, "thin"]].merge(renamed, on=bounds)
        tables.append(both.assign(**_contact_named(friction, reference)))
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()


def compare_jobs(frame: pd.DataFrame, reference: _Friction) -> pd.DataFrame:
    """Pair each job with its equivalent under a reference friction, and count how the answers differ.

    Returns DataFrame: one row per friction: friction_static, friction_kinetic, those of the reference, numbers of pairs
    of which both, neither, only_this or only_reference toppled.
    """
    lines = []
    for friction, pairs in _paired_jobs(frame, reference).groupby(FRICTION):
        this, that = pairs["toppled"], pairs["toppled_reference"]
        lines.append({
            **_contact_named(friction, reference), "pairs": len(pairs),
            "both": int((this & that).sum()), "neither": int((~this & ~that).sum()),
            "only_this": int((this & ~that).sum()), "only_reference": int((~this & that).sum()),
        })  # fmt: skip
    return pd.DataFrame(lines)


def _paired_jobs(frame: pd.DataFrame, reference: _Friction) -> pd.DataFrame:
    """Jobs with an answer under both frictions: `toppled` and, under the reference, `toppled_reference`."""
    answered = frame[frame["toppled"].notna()].astype({"toppled": bool})
    is_reference = (answered[FRICTION].to_numpy() == reference).all(axis=1)
    base = answered.loc[is_reference, [*_JOB, "toppled"]]
    return answered[~is_reference].merge(base, on=_JOB, suffixes=("", "_reference"), validate="many_to_one")


def _under(frame: pd.DataFrame, friction: _Friction) -> pd.DataFrame:
    return frame[(frame[FRICTION].to_numpy() == friction).all(axis=1)]


def _contact_named(friction: _Friction, reference: _Friction) -> dict[str, float]:
    names = [*FRICTION, *(f"reference_{name}" for name in FRICTION)]
    return dict(zip(names, (*friction, *reference), strict=True))


_HALF_SECTOR_DEG = 17.5
"""Half width of the sector around the weakest direction in which topplings are counted, degrees: 35 degrees in all,
as Veeraraghavan, Hudnut and Krishnan count them around their rock's overhang."""


def least_sector(quasi_static: pd.DataFrame | None) -> tuple[float, float] | None:
    """Sector (35 degrees) around the azimuth that the least constant acceleration topples the rock toward.

    quasi_static: `Run.quasi_static`.
    None where no constant acceleration is known to topple the rock.
    """
    found = weakest(quasi_static)
    return None if found is None else _sector_around(float(found["ground_accelerates_toward_deg"]) + 180.0)


def _sector_around(azimuth_deg: float) -> tuple[float, float]:
    return (azimuth_deg - _HALF_SECTOR_DEG) % 360.0, (azimuth_deg + _HALF_SECTOR_DEG) % 360.0


def weakest(quasi_static: pd.DataFrame | None) -> "pd.Series[float] | None":
    """Row of the least constant ground acceleration that topples the rock; None if not known."""
    known = None if quasi_static is None else quasi_static.astype(float).dropna(subset=["value"])
    if known is None or not np.isfinite(known["value"]).any():
        return None
    return known.loc[known["value"].idxmin()]


def named(name: str, azimuth_deg: float | None) -> dict[str, float | None]:
    """Columns of an azimuth and its compass bearing, for `falls_toward` or `ground_accelerates_toward`."""
    bearing = None if azimuth_deg is None else float(compass_deg(azimuth_deg))
    return {f"{name}_deg": azimuth_deg, f"{name}_bearing_deg": bearing}


def topple_rose(frame: pd.DataFrame, petal_deg: float = 15.0) -> pd.DataFrame:
    """Count the toppled jobs by the azimuth they toppled toward.

    frame: rows of results.
    petal_deg: width of a petal; the first is centred on azimuth 0.
    Returns DataFrame: one row a petal: falls_toward_deg (its centre), falls_toward_bearing_deg, toppled,
    share_of_toppled.
    """
    petals = round(360.0 / petal_deg)
    azimuth = frame.loc[_toppled(frame), "falls_toward_deg"].dropna().to_numpy(float)
    index = np.floor((azimuth / 360.0 * petals) + 0.5).astype(int) % petals
    counts = np.bincount(index, minlength=petals)
    centre, share = np.arange(petals) * 360.0 / petals, counts / max(1, counts.sum())
    return pd.DataFrame({
        "falls_toward_deg": centre, "falls_toward_bearing_deg": compass_deg(centre), "toppled": counts,
        "share_of_toppled": share,
    })  # fmt: skip


def sector_fraction(frame: pd.DataFrame, low_deg: float, high_deg: float) -> dict[str, float]:
    """Fraction of jobs that topple toward a sector, counter-clockwise from `low_deg` to `high_deg`.

    Returns dict: low_deg, high_deg, jobs (with an answer), toppled, toppled_within, share_of_jobs, share_of_toppled.
    """
    width = (high_deg - low_deg) % 360.0 or (360.0 if high_deg != low_deg else 0.0)
    toppled = _toppled(frame)
    off = (frame["falls_toward_deg"].to_numpy(float) - low_deg) % 360.0
    within = int((toppled & (off <= width)).sum())
    jobs, all_toppled = int(frame["toppled"].notna().sum()), int(toppled.sum())
    return {
        "low_deg": low_deg,
        "high_deg": high_deg,
        "jobs": jobs,
        "toppled": all_toppled,
        "toppled_within": within,
        "share_of_jobs": within / jobs if jobs else np.nan,
        "share_of_toppled": within / all_toppled if all_toppled else np.nan,
    }


def _toppled(frame: pd.DataFrame) -> "pd.Series[bool]":
    return frame["toppled"].fillna(value=False).astype(bool)
