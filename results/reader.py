"""Reading a run, also while it is in progress: its completeness first; pyarrow, pandas, and SQL over its rows."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow as pa
import pyarrow.compute as pc

from toppling.models.caching import Described
from toppling.models.errors import InputError
from toppling.models.files.digest import read_table
from toppling.models.files.documents import read_toml
from toppling.models.files.schemas import BASES, read_scene_document
from toppling.models.files.stores import at_hand
from toppling.models.motions.measures import CATALOG, meaning
from toppling.results.run_integrity import (
    CAMPAIGN_FILE,
    SCENES,
    SITES_FILE,
    check_audits,
    check_files,
    run_document,
)
from toppling.results.schema import SCHEMA, describe, described_table
from toppling.results.store import PathLike, newest_rows, read_steady, result_files
from toppling.results.weights import Weights, weighted_rows, weights_of

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow.dataset as ds


@dataclass(frozen=True)
class Completeness:
    """Numbers of planned, done and stored jobs of a run."""

    planned: int
    done: int  # jobs with a row of any status
    stored: int = 0  # rows stored according to `run.json`

    @property
    def left(self) -> int:
        """Number of jobs that have not run."""
        return max(self.planned - self.done, 0)

    @property
    def remark(self) -> str:
        """Remark on an unfinished run; empty for a finished one.

        Examples
        --------
        >>> Completeness(4320, 1602).remark
        '2,718 of 4,320 jobs have not run'
        >>> Completeness(4320, 0, stored=4320).remark
        '4,320 of 4,320 jobs have no row here, and 4,320 were stored: the folder was not copied whole'
        """
        if not self.left:
            return ""
        jobs = f"{self.left:,} of {self.planned:,} jobs {'has' if self.left == 1 else 'have'}"
        if self.stored <= self.done:
            return f"{jobs} not run"
        return f"{jobs} no row here, and {self.stored:,} were stored: the folder was not copied whole"


def rows_stored(document: Mapping[str, Any]) -> int:
    """Largest number of rows that a session of a run had stored when it ended, from `run.json`."""
    counts = [session.get("done") for session in document.get("sessions", ())]
    return max((count for count in counts if type(count) is int), default=0)


_RUN_COLUMN = pa.field("run", pa.string(), metadata={"description": "name of the run's folder"})

_SITE_COLUMNS = (
    ("rock", "", "name of the rock"),
    ("site", "", "name of its site"),
    ("longitude", "deg", "degrees east (WGS 84)"),
    ("latitude", "deg", "degrees north (WGS 84)"),
    ("age", "a", "years that the rock has stood, as its campaign states them"),
)


class Run(Described):
    """Folder of a run, read anew by each method, so that a run in progress shows its current state.

    Parameters
    ----------
    path : path
        Folder written by `toppling run`, or its address in an object store.

    Raises
    ------
    InputError
        If the folder is not a run, or contains files of another run.
    """

    def __init__(self, path: PathLike) -> None:
        self.path = at_hand(path)
        self.root = atlas_of(self.path) or self.path
        if self.root == self.path:
            self.provenance()
        check_files(self.root)
        check_audits(self.root)

    def _facts(self) -> dict[str, object]:
        rocks, jobs = [rock.rock for rock in self.rocks] or [self.rock], "unreadable"
        with contextlib.suppress(InputError):  # printing does not fail
            done = self.completeness()
            jobs = f"{done.done:,} of {done.planned:,}"
        return {"name": self.name, "rock": ", ".join(rocks), "jobs": jobs}

    @property
    def rocks(self) -> tuple[Run, ...]:
        """Runs of the single rocks of an atlas; empty for a run of one rock."""
        if self.root != self.path:
            return ()
        return tuple(Run(self.path / SCENES / rock["rock"]) for rock in self.provenance().get("scenes", ()))

    @property
    def entry(self) -> dict[str, Any]:
        """Entry of a rock of an atlas in `run.json`; empty for a run of one rock."""
        if self.root == self.path:
            return {}
        return next(rock for rock in self.provenance()["scenes"] if rock["rock"] == self.path.name)

    @property
    def scene_folder(self) -> Path:
        """Folder of the rock's scene."""
        return self.path / "scene"

    @property
    def ensemble_folder(self) -> Path:
        """Folder of the rock's records."""
        return self.root / self.entry.get("ensemble", "ensemble")

    @property
    def name(self) -> str:
        """Name of the folder, which identifies the run in queries over several."""
        return self.path.resolve().name

    @property
    def rock(self) -> str:
        """Name of the rock."""
        return self.path.name if self.root != self.path else str(self.provenance()["rock"])

    def unmeasured(self) -> dict[str, Any]:
        """Distributions that realisations draw besides base and centre of mass (the campaign's key `unmeasured`)."""
        path = self.root / CAMPAIGN_FILE
        return dict(read_toml(path).get("unmeasured", {})) if path.exists() else {}

    def table(self) -> pa.Table:
        """All rows with the schema `results.schema.SCHEMA`, one per job."""
        table = read_steady([self.root], lambda: newest_rows(result_files(self.root)))
        return table if self.root == self.path else table.filter(self._own)

    @property
    def _own(self) -> pc.Expression:
        """Filter for the rows of one rock of an atlas."""
        return pc.field("scene_id") == self.entry["scene_id"]

    def dataset(self) -> ds.Dataset:
        """Rows as a pyarrow dataset, read lazily unless a job has several rows.

        While a run is in progress its files may be merged before they are read; `table` reads immediately.
        """
        import pyarrow.dataset as ds  # with pandas

        files = result_files(self.root)
        if self.root != self.path:
            return ds.dataset(self.table())
        if not files:
            return ds.dataset(SCHEMA.empty_table())
        checked = ds.ParquetFragmentScanOptions(page_checksum_verification=True)
        parquet = ds.ParquetFileFormat(default_fragment_scan_options=checked)
        lazy = ds.dataset([str(path) for path in files], schema=SCHEMA, format=parquet)
        if len(files) <= 1:
            return lazy
        ids = pa.concat_tables([read_table(path, columns=["job_id"]) for path in files]).column("job_id")
        repeated = len(ids.unique()) < len(ids)
        return ds.dataset(self.table()) if repeated else lazy

    def frame(self, where: str | None = None, *, trusted: bool = False) -> pd.DataFrame:
        """Rows as a pandas frame, all or those that satisfy an SQL condition; `toppled` is a nullable boolean.

        Parameters
        ----------
        where : str or None
            One SQL expression over the columns of `results`; subqueries may use `motions` and `scene`.
        trusted : bool
            Whether it may read files too.

        Raises
        ------
        InputError
            If the condition is not a single SQL expression, or names an unknown column.
        """
        if not where:
            return as_frame(self.table())
        from toppling.results.queries import rows_where

        return as_frame(rows_where(self, where, trusted))

    def single(self) -> Run:
        """Run itself, if it is of a single rock; InputError otherwise."""
        if rocks := self.rocks:
            raise InputError(
                "run.several_rocks",
                f"is a run of {len(rocks)} rocks: {', '.join(rock.rock for rock in rocks)}",
                where=str(self.path),
                expected="one rock",
                remedy=f"choose one: {rocks[0].path}",
            )
        return self

    def jobs(self, where: str | None = None, *, trusted: bool = False) -> pd.DataFrame:
        """Weighted rows, all or those that satisfy an SQL condition (`frame`); InputError if none has an answer."""
        rows = self.weighted(self.frame(where, trusted=trusted))
        if not rows["toppled"].notna().any():
            raise InputError(
                "run.no_answers",
                f"{len(rows)} jobs, none with an answer",
                where=str(self.path),
                expected="finished jobs",
                remedy="loosen --where" if where else "'toppling status RUN' shows how far the run is",
            )
        return rows

    def planned(self) -> int:
        """Number of planned jobs."""
        return int((self.entry or self.provenance())["jobs"])

    def completeness(self) -> Completeness:
        """Numbers of planned and done jobs."""
        ids = ["job_id", "attempt", "scene_id"]
        rows = read_steady([self.root], lambda: newest_rows(result_files(self.root), ids))
        done = rows if self.root == self.path else rows.filter(self._own)
        stored = rows_stored(self.provenance()) if self.root == self.path else 0
        return Completeness(self.planned(), len(done), stored)

    def weighted(self, frame: pd.DataFrame, weights: Weights | None = None) -> pd.DataFrame:
        """Add the column `record_weight` to rows of a run whose records or bases have different weights.

        Records have the weights of 'toppling records select --deaggregation', 1 on average over those in use. Bases
        have the weights of the run (`results.weights`), also in the column `base_weight`. With equal weights the frame
        is returned unchanged.

        Parameters
        ----------
        weights : Weights or None
            Weights of the bases to use instead of the run's.

        Raises
        ------
        InputError
            If the run's weights of its bases are missing or damaged.
        """
        weights = weights or self.weights()
        frame = self._by_records(frame)
        return frame if weights is None else weighted_rows(frame, weights)

    def weights(self) -> Weights | None:
        """Weights of the bases; None where the campaign requests none.

        Raises
        ------
        InputError
            If they are missing or damaged.
        """
        return weights_of(self.path)

    def bases(self) -> pa.Table | None:
        """Table of the weight of each base under each contact; None where all are equal."""
        weights = self.weights()
        return None if weights is None else weights.table()

    def _by_records(self, frame: pd.DataFrame) -> pd.DataFrame:
        import pandas as pd

        if self.rocks:
            of_rocks = dict(list(frame.groupby("rock")))
            parts = [rock._by_records(of_rocks[rock.rock]) for rock in self.rocks if rock.rock in of_rocks]
            return pd.concat(parts).sort_index() if parts else frame
        motions = self.motions()
        if motions is None or "weight" not in motions.column_names:
            return frame
        weights = dict(zip(*(motions[name].to_pylist() for name in ("record_id", "weight")), strict=True))
        used = [weights[name] for name in frame["record_id"].unique() if name in weights]
        if len(set(used)) < 2:
            return frame
        return frame.assign(record_weight=frame["record_id"].map(weights) * (len(used) / sum(used)))

    def sql(self, query: str, *, trusted: bool = False) -> pa.Table:
        """Answer a DuckDB query over the tables `results`, `motions` and `scene`; see :func:`ask`.

        Raises
        ------
        InputError
            If DuckDB refuses the query.
        """
        from toppling.results.queries import ask

        return ask([self], query, trusted=trusted)

    def motions(self) -> pa.Table | None:
        """Catalogue of the run's records, one row per record; None where the run has no ensemble.

        In an atlas, `rock` names the rock that a record belongs to; null for the common records.
        """
        check_files(self.root)
        if self.rocks:
            own = {rock.entry["ensemble"]: rock.rock for rock in self.rocks}
            tables = []
            for folder, rock in own.items():
                table = read_table(self.path / folder / CATALOG)
                owner = pa.repeat(pa.scalar(rock if SCENES in folder else None, pa.string()), len(table))
                tables.append(table.append_column("rock", owner))
            return pa.concat_tables(tables, promote_options="default")
        path = self.ensemble_folder / CATALOG
        return read_table(path) if path.exists() else None

    def scene(self) -> pa.Table | None:
        """Row describing the scene, or a row per rock of an atlas with its site; None without a scene."""
        check_files(self.root)
        if self.rocks:
            return pa.concat_tables(table for rock in self.rocks if (table := rock.scene()) is not None)
        scene = self._scene_document()
        return _scene_table(scene, self.entry) if scene else None

    def _scene_document(self) -> dict[str, Any]:
        """Content of `scene.json`; empty without a scene."""
        path = self.scene_folder / "scene.json"
        return read_scene_document(path) if path.exists() else {}

    def scene_report(self) -> dict[str, Any]:
        """Report of the scan of the run's scene; empty without one."""
        return dict(self._scene_document().get("report") or {})

    def on_single_base(self, jobs: pd.DataFrame) -> bool:
        """Whether given jobs are all on the same base of a rock with drawn bases."""
        return (self.scene_folder / BASES).exists() and jobs["realisation"].nunique() == 1

    def scene_id(self) -> str:
        """Hash of the rock's scene."""
        return str((self.entry or self.provenance())["scene_id"])

    def rock_m(self) -> tuple[float, ...] | None:
        """Centre of mass in metres of the coordinate system of the rock's scan; None where there is no scene."""
        if not (scene := self._scene_document()):
            return None
        return tuple(map(sum, zip(scene["origin_m"], scene["rock"]["com_m"], strict=True)))

    def quasi_static(self) -> pd.DataFrame | None:
        """Least constant ground acceleration (`value`, m/s2) that topples, by `ground_accelerates_toward_deg`.

        Without slip; beside it `slides_m_s2`, at which the rock slides before, missing where it does not. Of drawn
        bases it is the median, and `low_m_s2` to `high_m_s2` holds the share `level` of them.
        """
        table = None if self.rocks else self.scene()
        return (
            None
            if table is None
            else pa.Table.from_struct_array(
                table["quasi_static_toppling"].combine_chunks().flatten()
            ).to_pandas()
        )

    def provenance(self) -> dict[str, Any]:
        """Content of `run.json`, the provenance of the run."""
        return run_document(self.root)

    def describe(self) -> list[dict[str, str]]:
        """Unit and description of every column of every table."""
        rows = [{"table": "results", **describe(_RUN_COLUMN)}]
        tables = (
            ("results", SCHEMA), ("motions", self.motions()), ("scene", self.scene()), ("bases", self.bases())
        )  # fmt: skip
        for name, table in tables:
            schema = table.schema if isinstance(table, pa.Table) else table
            row_of = _as_recorded if name == "motions" else describe
            rows += [{"table": name, **row_of(field)} for field in schema or ()]
        return rows


def atlas_of(path: Path) -> Path | None:
    """Folder of the atlas that a rock's folder belongs to; None if it belongs to none."""
    scenes = path.absolute().parent
    whole = scenes.name == SCENES and all(
        (scenes.parent / name).exists() for name in (SITES_FILE, "run.json")
    )
    return scenes.parent if whole else None


def open_run(run: Run | PathLike) -> Run:
    """Open a run's folder for reading; a run is returned as it is.

    Raises
    ------
    InputError
        If the folder is not a run.
    """
    return run if isinstance(run, Run) else Run(run)


def as_frame(table: pa.Table) -> pd.DataFrame:
    """Pandas frame of rows; a column `toppled` becomes a nullable boolean."""
    frame = table.to_pandas()
    return frame.astype({"toppled": "boolean"}) if "toppled" in frame else frame


def _as_recorded(field: pa.Field) -> dict[str, str]:
    return describe(field) | {"group": "as recorded"} | meaning(field.name)


_STATICS = (
    "ground_accelerates_toward_deg", "falls_toward_deg", "value", "low_m_s2", "high_m_s2", "level", "slides_m_s2"
)  # fmt: skip


def _scene_table(document: dict[str, Any], site: dict[str, Any]) -> pa.Table:
    """Table of one row from a scene document and the rock's entry in a table of rocks."""
    rock, plane, contact = document["rock"], document["interface"], document["contact"]
    nominal = document["quasi_static_toppling_m_s2"]
    found = (document.get("report") or {}).get("unseen_base") or {}
    slides = {row["azimuth_deg"]: row.get("slides_m_s2") for row in nominal}
    statics = [
        (
            row["azimuth_deg"], (row["azimuth_deg"] + 180.0) % 360.0, row.get("median_m_s2", row.get("value")),
            row.get("low_m_s2"), row.get("high_m_s2"), found.get("level"), slides.get(row["azimuth_deg"]),
        )
        for row in found.get("toppling") or nominal
    ]  # fmt: skip
    least = min((row[2] for row in statics if row[2] is not None), default=None)
    static, kinetic, bounce = (
        contact[name] for name in ("friction_static", "friction_kinetic", "restitution")
    )
    # fmt: off
    columns: list[tuple[str, Any, str, str]] = [
        ("scene_id", document["id"], "", "hash of the scene's content"),
        *((name, site[name], unit, text) for name, unit, text in _SITE_COLUMNS if site),
        ("height_m", rock["height_m"], "m", "vertical extent of the rock"),
        ("volume_m3", rock["volume_m3"], "m3", "volume of the rock"),
        ("com_x_m", rock["com_m"][0], "m", "centre of mass, east"),
        ("com_y_m", rock["com_m"][1], "m", "centre of mass, north"),
        ("com_z_m", rock["com_m"][2], "m", "centre of mass, up"),
        ("slope_deg", plane["slope_deg"], "deg", "slope of the interface plane"),
        ("downhill_azimuth_deg", plane["downhill_azimuth_deg"], "deg", "azimuth toward which the plane falls"),
        ("gravity_m_s2", document["gravity_m_s2"], "m/s2", "gravity"),
        ("default_friction_static", static, "1", "static friction of the scene; a campaign states its own"),
        ("default_friction_kinetic", kinetic, "1", "kinetic friction of the scene; a campaign states its own"),
        ("default_restitution", bounce, "1", "restitution of the scene; a campaign takes what it states, or 0"),
        ("least_quasi_static_m_s2", least, "m/s2", "least constant ground acceleration that tips it"),
        ("quasi_static_toppling", statics, "deg, m/s2", "tipping and sliding acceleration by azimuth of the ground's"),
    ]
    # fmt: on
    by_azimuth = pa.list_(pa.struct([(name, pa.float64()) for name in _STATICS]))
    kinds = {
        "longitude": pa.float64(), "latitude": pa.float64(), "age": pa.string(), "quasi_static_toppling": by_azimuth
    }  # fmt: skip
    return described_table(
        ((name, pa.array([value], kinds.get(name)), unit, text) for name, value, unit, text in columns),
        group="scene",
    )
