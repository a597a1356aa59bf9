"""Recorded motions that a rock is known to have survived: reading, checks, and storage in a run."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from toppling.models.errors import InputError
from toppling.models.motions.ensemble import CATALOG, Ensemble
from toppling.models.motions.record import Record
from toppling.models.scene import Scene

FOLDER = "stood"
"""Subfolder of a run with the motions that its rock survived, and their shakes."""

SHAKES = 8
"""Number of shakes per drawn base and motion: a base on which the rock never stands then has 1/17 of the weight of one
on which it always does."""
AZIMUTHS_DEG = tuple(360.0 / SHAKES * number for number in range(SHAKES))
"""Azimuths that a motion with unknown orientation is rotated to, on each drawn base."""
ENSEMBLES = ("as_recorded", "from_all_sides")
"""Folders of the ensembles of motions with known and with unknown orientation."""


@dataclass(frozen=True)
class Recorded:
    """Motions that the rock is known to have survived."""

    records: tuple[Record, ...]
    paths: tuple[str, ...]  # paths as given, one per record

    @property
    def identity(self) -> tuple[str, ...]:
        """All that determines weights: number of shakes, hashes of motions, and whether azimuths are known."""
        return (f"stood {SHAKES}", *sorted(f"{record.sha} {record.north_known}" for record in self.records))

    def write(self, folder: Path) -> None:
        """Write the motions to a folder as two ensembles, with known and with unknown azimuths."""
        for name in ENSEMBLES:
            chosen = [record for record in self.records if record.north_known == (name == ENSEMBLES[0])]
            if chosen:
                (folder / name).mkdir(parents=True)
                Ensemble.write(folder / name / "ensemble", chosen)


def ensembles_in(folder: Path) -> list[Path]:
    """Folders of the ensembles written by `Recorded.write`."""
    return [
        folder / name / "ensemble" for name in ENSEMBLES if (folder / name / "ensemble" / CATALOG).exists()
    ]


def read_recorded(paths: Sequence[Path]) -> Recorded:
    """Read motions that a rock is known to have survived.

    paths: files of records (all components of a record), or folders of ensembles.
    Raises InputError if one cannot be read, contains no record, or is given twice.
    """
    found: list[tuple[Record, str]] = []
    files = [path for path in paths if not (path / CATALOG).is_file()]
    for path in paths:
        if path not in files:
            ensemble = Ensemble.load(path)
            found += [(ensemble.record(name), str(path)) for name in ensemble.record_ids]
    if files:
        found += [(record, ", ".join(record.files)) for record in _read_files(files)]
    _refuse_twins([record for record, _ in found])
    return Recorded(tuple(record for record, _ in found), tuple(path for _, path in found))


def check_weighable(scene: Scene, realisations: int, where: str) -> None:
    """Raise InputError if the scene has no drawn bases, or the campaign no realisations that use them.

    realisations: number of realisations of the campaign except the nominal scene (0).
    where: location named in messages.
    """
    if scene.unseen is None:
        raise InputError(
            "draws.missing",
            "the scene has no draws of its base, which survived shaking could weight",
            where=where,
            expected="a scene with bases.json",
            remedy="make it with 'toppling scan', or with models.hidden_base.rough_base.with_rough_base for a mesh",
        )
    if realisations < 1:
        raise InputError(
            "run.no_realisations",
            "there are no realisations: every job is on the nominal scene, and none on a draw of its base",
            where=where,
            expected=f"a campaign with realisations of up to {len(scene.unseen) + 1}, one a base and the nominal scene",
            remedy=f"set realisations = {len(scene.unseen) + 1} in the campaign, and run it with another --out",
        )


def _read_files(paths: Sequence[Path]) -> list[Record]:
    from toppling.models.motions.importing import import_records, record_files

    files = record_files(paths)
    read = import_records(files)
    for refusal in read.refusals:
        what = f"{refusal.subject}: {refusal.reason.what}"
        remedy = "import it with the options that it needs ('toppling records import'), and give the ensemble"
        raise InputError(**vars(refusal.reason) | {"what": what, "remedy": remedy})
    if not read.records:
        raise InputError(
            "record.none_found",
            "holds no record",
            where=", ".join(map(str, paths)),
            expected="files of a recorded motion, or an ensemble's folder",
            remedy="check the path; 'toppling records import --help' names the formats",
        )
    return read.records


def _refuse_twins(records: Sequence[Record]) -> None:
    for attribute, what in (("sha", "the same motion"), ("record_id", "of the same name")):
        seen: dict[str, Record] = {}
        for record in records:
            other = seen.setdefault(getattr(record, attribute), record)
            if other is not record:
                raise InputError(
                    "record.given_twice",
                    f"{record.record_id} and {other.record_id} are {what}",
                    where="motions that the rock stood",
                    expected="each motion once: a repeated one would count twice",
                    remedy="leave one of the two out"
                    if attribute == "sha"
                    else "import them into one ensemble ('toppling records import'), and give its folder",
                )
