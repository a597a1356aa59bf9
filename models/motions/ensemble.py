"""Ensemble of records: a folder with `catalog.parquet` and `motions.parquet`, one row (group) a record."""

import math
import threading
from collections.abc import Iterable, Mapping
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from toppling.models.errors import InputError, refusals
from toppling.models.files import digest
from toppling.models.files.digest import check_bounds, read_table, table_writer, write_table
from toppling.models.files.folder import instead, local, new_file
from toppling.models.frames import azimuth_of
from toppling.models.motions.imposing import impose
from toppling.models.motions.measures import CATALOG, MEASURES, MOTIONS, ensemble_id, meaning
from toppling.models.motions.motion import Motion
from toppling.models.motions.place import Place
from toppling.models.motions.record import Record, motion_sha

SCHEMA_VERSION = "2"
RECORDS_IN_MEMORY = 64
"""Number of records in a block of jobs (`orchestrator.order`); few records are larger than half a megabyte."""

_MOTION_SCHEMA = pa.schema(
    [
        ("record_id", pa.string()),
        ("time_step_s", pa.float64()),
        ("acceleration_x_m_s2", pa.list_(pa.float64())),
        ("acceleration_y_m_s2", pa.list_(pa.float64())),
        ("acceleration_z_m_s2", pa.list_(pa.float64())),
    ]
)
_IDENTITY = [
    ("record_id", pa.string()),
    ("event", pa.string()),
    ("station", pa.string()),
    ("magnitude", pa.float64()),
    ("distance_km", pa.float64()),
    ("time_step_s", pa.float64()),
    ("duration_s", pa.float64()),
    ("samples", pa.int64()),
    ("north_known", pa.bool_()),
    ("components", pa.int64()),
    ("quality", pa.string()),
    ("weight", pa.float64()),
]
_PLACE = [("sensor_depth_m", pa.float64()), ("structure", pa.string())]
"""Columns of the sensor's place; earlier catalogues lack both, and are of the free field."""
_ORIGIN = [("history", pa.list_(pa.string())), ("files", pa.list_(pa.string())), ("sha", pa.string())]
_MAY_BE_UNKNOWN = ("magnitude", "distance_km")
_OF_RECORD = (
    "record_id", "event", "station", "magnitude", "distance_km", "north_known", "components", "quality", "weight",
    "sha",
)  # fmt: skip
"""Columns that are fields of a record."""

_ensemble_error = refusals(
    expected="a folder with catalog.parquet and motions.parquet",
    remedy="make one with 'toppling records import FILES --out FOLDER'",
)


class Ensemble:
    """Records on disk, read one at a time when they are asked for.

    Parameters
    ----------
    folder : Path
        As written by :meth:`write`.
    catalog : pyarrow.Table
        One row a record: identity, intensity measures with units in the names, history, files, hash.
    """

    def __init__(self, folder: Path, catalog: pa.Table) -> None:
        self.folder = folder
        self.catalog = catalog
        self._row = {name: index for index, name in enumerate(self.record_ids)}
        self._motions: pq.ParquetFile | None = None
        self._lock = threading.Lock()
        self.record = lru_cache(RECORDS_IN_MEMORY)(self._sound)

    @classmethod
    def load(cls, folder: str | Path) -> "Ensemble":
        """Open an ensemble; its motions stay on disk.

        Raises
        ------
        InputError
            If the folder holds no ensemble, or its two files do not belong together.
        """
        path = local(folder)
        for name in (CATALOG, MOTIONS):
            if not (path / name).is_file():
                raise _ensemble_error("ensemble.absent", f"there is no {name}{instead(path)}", path)
        try:
            catalog = read_table(path / CATALOG)
            digest.check(path / MOTIONS)
            check_bounds(path / MOTIONS)
            motions = pq.ParquetFile(path / MOTIONS, page_checksum_verification=True)
        except (pa.ArrowException, OSError) as error:
            what = f"not readable as Parquet ({error})"
            raise _ensemble_error("ensemble.unreadable", what, path) from error
        marks = [dict(schema.metadata or {}) for schema in (catalog.schema, motions.schema_arrow)]
        ids = {mark.get(b"toppling_ensemble") for mark in marks}
        if None in ids or len(ids) != 1:
            what = "catalogue and motions do not belong together"
            raise _ensemble_error("ensemble.files_foreign", what, path)
        version = marks[0].get(b"version", b"").decode()
        if version != SCHEMA_VERSION:
            what = f"it is of version {version}, this program reads {SCHEMA_VERSION}"
            raise _ensemble_error("document.schema_version", what, path)
        _check_catalog(catalog, path)
        ensemble = cls(path, catalog)
        ensemble._motions = motions
        return ensemble

    @classmethod
    def write(cls, folder: str | Path, records: Iterable[Record]) -> "Ensemble":
        """Write records by their ids, under hidden names until they are whole, and open the ensemble.

        Raises
        ------
        InputError
            If there is no record, or two have the same id.
        """
        path = Path(folder)
        ordered = sorted(records, key=lambda record: record.record_id)
        names = [record.record_id for record in ordered]
        if not names:
            raise _ensemble_error("ensemble.empty", "there is no record to write", path)
        if len(set(names)) != len(names):
            twice = sorted({name for name in names if names.count(name) > 1})
            raise _ensemble_error("ensemble.id_repeated", f"record ids occur twice: {', '.join(twice)}", path)
        mark = {
            "toppling_ensemble": ensemble_id((r.record_id, r.sha) for r in ordered),
            "version": SCHEMA_VERSION,
        }
        schema = _MOTION_SCHEMA.with_metadata(mark)
        with new_file(path / CATALOG) as catalog, new_file(path / MOTIONS) as motions:
            with table_writer(motions, schema, use_dictionary=False) as writer:
                for record in ordered:
                    a, step_s = record.motion.acceleration_m_s2, record.motion.time_step_s
                    series = [pa.array([values], type=pa.list_(pa.float64())) for values in a.T]
                    arrays = [pa.array([record.record_id]), pa.array([step_s]), *series]
                    writer.write_table(pa.Table.from_arrays(arrays, schema=_MOTION_SCHEMA))
            write_table(_catalog(ordered).replace_schema_metadata(mark), catalog)
        return cls.load(path)

    def motion(
        self,
        record_id: str,
        *,
        pga_m_s2: float,
        azimuth_deg: float | str,
        peak_displacement_m: float | None = None,
    ) -> Motion:
        """A record as a job imposes it: scaled and turned, as by :func:`models.motions.impose.impose`.

        Raises
        ------
        InputError
            If there is no such record, or a number is not positive.
        """
        return impose(self.record(record_id), pga_m_s2, azimuth_of(azimuth_deg), peak_displacement_m).motion

    @property
    def record_ids(self) -> list[str]:
        """Ids in the catalogue's order."""
        return self.catalog.column("record_id").to_pylist()

    @cached_property
    def id(self) -> str:
        """Hash of the ids and hashes of all records."""
        return ensemble_id((name, self.sha(name)) for name in self.record_ids)

    def sha(self, record_id: str) -> str:
        """Hash of one record's motion, from the catalogue."""
        return self.catalog.column("sha")[self._index(record_id)].as_py()

    def _index(self, record_id: str) -> int:
        if record_id not in self._row:
            raise InputError(
                "ensemble.record_unknown",
                f"no record {record_id!r}",
                where=str(self.folder),
                expected=f"one of {len(self._row)} ids such as {next(iter(self._row))!r}",
                remedy="see the ids with 'toppling records show'",
            )
        return self._row[record_id]

    def _sound(self, record_id: str) -> Record:
        """Record of an id, if its motion can be read."""
        try:
            return self._read(record_id)
        except InputError:
            raise
        except (pa.ArrowException, OSError, ValueError, TypeError, LookupError) as error:
            what = f"the motion of {record_id!r} cannot be read ({str(error).splitlines()[0][:200]})"
            raise _ensemble_error("ensemble.unreadable", what, self.folder) from error

    def _read(self, record_id: str) -> Record:
        """Record of an id, its motion read from its own row group (the last few stay in memory)."""
        index = self._index(record_id)
        with self._lock:  # a ParquetFile is one file handle
            if self._motions is None:
                self._motions = pq.ParquetFile(self.folder / MOTIONS, page_checksum_verification=True)
            row = self._motions.read_row_group(index)
        if row.column("record_id")[0].as_py() != record_id:
            what = f"row group {index} is not record {record_id!r}"
            raise _ensemble_error("ensemble.motion_foreign", what, self.folder)
        chunks = [row.column(f"acceleration_{axis}_m_s2").combine_chunks().flatten() for axis in "xyz"]
        columns = [np.from_dlpack(chunk) for chunk in chunks]  # `to_numpy` imports pandas: 45 MB of a worker
        motion = Motion(np.column_stack(columns), row.column("time_step_s")[0].as_py())
        entry: dict[str, Any] = self.catalog.slice(index, 1).to_pylist()[0]
        _refuse_other_motion(motion, entry, self.folder)
        known = {name for name, _ in (*_IDENTITY, *_PLACE, *_ORIGIN)}
        return Record(
            motion=motion,
            intensity={name: value for name, value in entry.items() if name not in known},
            history=tuple(entry["history"]),
            files=tuple(entry["files"]),
            place=Place(entry.get("sensor_depth_m") or 0.0, entry.get("structure") or ""),
            **{name: entry[name] for name in _OF_RECORD},
        )

    def __reduce__(self) -> tuple:
        return Ensemble.load, (self.folder,)


def _check_catalog(catalog: pa.Table, folder: Path) -> None:
    """Refuse a catalogue without a column that is read, or with a gap or repetition where none can be."""
    measures = [(name, pa.float64()) for name in MEASURES]
    for name, kind in (*_IDENTITY, *_ORIGIN, ("strong_azimuth_deg", pa.float64()), *measures):
        at = catalog.schema.get_all_field_indices(name)
        if len(at) != 1 or catalog.schema.field(at[0]).type != kind:
            what = f"the catalogue has no one column {name!r} of {kind}"
            raise _ensemble_error("ensemble.column_missing", what, folder)
        if name not in _MAY_BE_UNKNOWN and catalog.column(at[0]).null_count:
            raise _ensemble_error("ensemble.column_gaps", f"the catalogue's column {name!r} has gaps", folder)
    if len(catalog.column("record_id").unique()) < len(catalog):
        raise _ensemble_error("ensemble.id_repeated", "the catalogue has a record id twice", folder)
    duration_s = np.array(catalog.column("duration_s").to_pylist(), float)  # `to_numpy` imports pandas
    if not (np.isfinite(duration_s) & (duration_s > 0)).all():
        raise _ensemble_error("ensemble.duration_unusable", "the catalogue's durations are no times", folder)


def _refuse_other_motion(motion: Motion, entry: Mapping[str, Any], folder: Path) -> None:
    """Refuse samples that are not those of the catalogue: by its hash, and by the PGA that scales them."""
    name, stated = entry["record_id"], entry["pga_m_s2"]
    if motion_sha(motion, entry["strong_azimuth_deg"]) != entry["sha"]:
        what = f"the motion of {name!r} does not have the hash in the catalogue"
        raise _ensemble_error("ensemble.motion_foreign", what, folder)
    pga = float(np.hypot(*motion.acceleration_m_s2[:, :2].T).max())
    if not math.isclose(stated, pga):  # two machines' roots may differ in their last digits
        what = f"the PGA of {name!r} is {pga:.6g} m/s2, {stated:.6g} in the catalogue"
        raise _ensemble_error("ensemble.motion_foreign", what, folder)


def _catalog(records: list[Record]) -> pa.Table:
    measures = list(records[0].intensity)
    rows: list[Mapping[str, Any]] = [
        {
            **{name: getattr(record, name) for name in _OF_RECORD},
            "sensor_depth_m": record.place.depth_m,
            "structure": record.place.structure,
            "time_step_s": record.motion.time_step_s,
            "duration_s": record.motion.duration_s,
            "samples": len(record.motion.acceleration_m_s2),
            **record.intensity,
            "history": list(record.history),
            "files": list(record.files),
        }
        for record in records
    ]
    columns = [*_IDENTITY, *_PLACE, *((name, pa.float64()) for name in measures), *_ORIGIN]
    fields = [pa.field(name, kind, metadata=meaning(name)) for name, kind in columns]
    return pa.Table.from_pylist(rows, schema=pa.schema(fields))
