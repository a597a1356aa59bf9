"""From clouds to a scene, and from a scene and seismograms to verdicts."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import pandas as pd

from toppling.models.errors import InputError
from toppling.models.files.folder import refuse_existing
from toppling.models.scan.hints_file import Hints
from toppling.models.scene import Scene
from toppling.orchestrator.public import REALISATIONS, unseen
from toppling.orchestrator.studies.seismograms import Verdict, judged, neighbouring_factors, read_seismograms

if TYPE_CHECKING:
    from toppling.models.scan.survey import Survey


@dataclass(frozen=True, eq=False)
class Scanned:
    """A rock on its pedestal, made from clouds.

    Parameters
    ----------
    scene : Scene
    folder : Path
        The scene's, with pictures of it.
    notes : list of str
        What has to be known before one relies on it.
    """

    scene: Scene
    folder: Path
    notes: list[str]


def scan(
    files: Sequence[str | Path],
    out: str | Path,
    *,
    contact: str | Path | None = None,
    bootstrap: int = REALISATIONS,
    advance: Callable[..., None] = unseen,
    **hints: Unpack[Hints],
) -> Scanned:
    """Turn laser scans or photogrammetry into a rock on its pedestal, as `toppling scan` does, in a new folder.

    Parameters
    ----------
    files : sequence of path
        Stations of one survey, or pieces of one model.
    out : path
        The scene's folder, which must not exist.
    contact : path, optional
        File of places that touch, or where light passes.
    bootstrap : int
        Half samples for the uncertainty.
    advance : callable
        Called with (1, what) at each stage.
    **hints
        `units`, `up`, `length`, `gcp`, `crs`, `rock`, `pedestal`, `near`, `plane`, `point`, `outline`, `touch`,
        `daylight`, `pull`, `base`, `touch_only`, as the options of `toppling scan`: lengths in metres, angles in
        degrees, survey coordinates.

    Raises
    ------
    InputError
        If the folder exists, a file cannot be read, or no rock is found in the clouds.
    """
    from toppling.models.hidden_base.inspection import inspection_of
    from toppling.models.scan.interface_hint import hint_of
    from toppling.models.scan.survey import survey
    from toppling.orchestrator.public import scan_files

    scan_files.check_hints(hints)
    clouds, folder, looked = tuple(map(Path, files)), Path(out), _path(contact)
    refuse_existing(folder)
    inspection = inspection_of(looked, **scan_files.of_base(hints))
    hint = hint_of(hints.get("plane"), list(hints.get("point", ())), hints.get("outline"))
    stage = partial(advance, 1)

    advance(0, "reading")
    cloud = scan_files.placed_cloud(clouds, hints)
    meshes = scan_files.brought_apart(clouds, hints, cloud)
    make = partial(survey, cloud, stage, hints.get("near"), hint, bootstrap, inspection)
    try:
        result = make() if meshes is None else meshes.surveyed(make, hinted=not inspection.says_nothing)
    except InputError as error:
        raise _in_files(error, [name for name, _ in cloud.files], looked) from None
    advance(1, "letting the rock stand")
    said = scan_files.hints_said(hints, inspection)
    return Scanned(result.scene, folder, written(result, folder, said, advance))


def written(
    result: "Survey",
    folder: Path,
    said: dict[str, Any],
    advance: Callable[..., None] = unseen,
    replaces: bool = False,
) -> list[str]:
    """Write what a scan became, with its pictures and the hints that it was given; what is said of it."""
    from toppling.models.scan.hints_file import HINTS, write_hints
    from toppling.models.scan.measure import invention_warning
    from toppling.models.scan.survey import save_survey
    from toppling.orchestrator.public.scan_files import pictured

    draw, notes = pictured(result.scene)
    advance(1, "writing")

    def also(folder: Path) -> None:
        write_hints(folder / HINTS, said)
        draw(folder)

    if result.worked_out is not None:
        result = replace(result, worked_out=replace(result.worked_out, said=said))
    save_survey(result, folder, also, replaces)
    warning = invention_warning(result.scene)
    return [*notes, *result.notes, *([warning] if warning else [])]


def _path(given: str | Path | None) -> Path | None:
    return None if given is None else Path(given)


def _in_files(error: InputError, files: list[str], contact: Path | None) -> InputError:
    """Name the files in an error that concerns all of them."""
    of_contact = contact is not None and error.where.startswith(f"{contact}, ")
    if of_contact or error.where in files:
        return error
    names = ", ".join(files[:3]) + (" ..." if len(files) > 3 else "")
    return InputError(
        error.what, where=f"{names}: {error.where}", expected=error.expected, remedy=error.remedy
    )


@dataclass(frozen=True)
class Checked:
    """What seismograms do to a rock.

    Parameters
    ----------
    verdicts : list of Verdict
        One a seismogram.
    remarks : list of str
        What was left out or processed, and why.
    notes : list of (str, str)
        What is odd in a seismogram: its name and the oddity.
    """

    verdicts: list[Verdict]
    remarks: list[str] = field(default_factory=list)
    notes: list[tuple[str, str]] = field(default_factory=list)

    def frame(self) -> pd.DataFrame:
        """One row a seismogram."""
        return pd.DataFrame([asdict(one) for one in self.verdicts])


def check(
    scene: Scene | str | Path,
    seismograms: Sequence[str | Path],
    *,
    friction: float | None = None,
    metadata: str | Path | None = None,
    missing_vertical: bool = False,
    largest: float = 1.25,
    neighbours: int = 5,
    preset: str = "standard",
    advance: Callable[..., None] = unseen,
) -> Checked:
    """Test whether seismograms, unscaled and in their own directions, topple a rock, as `toppling check` does.

    Parameters
    ----------
    scene : Scene or path
    seismograms : sequence of path
        Files, folders of files, or folders of ensembles.
    friction : float or None
        The scene's own unless given.
    metadata : path or None
        Table of what the files do not state, as for 'records import'.
    missing_vertical : bool
        Allow seismograms without a vertical component.
    largest : float
        Each is also shaken from 1/N to N times as strong, N being this factor.
    neighbours : int
        So many weaker and as many stronger ones; 0 for none.
    preset : str
        How finely each shake is resolved.
    advance : callable
        Called after each shake.

    Raises
    ------
    InputError
        If the scene or a table cannot be read, or no file gives a seismogram.
    """
    rock = scene if isinstance(scene, Scene) else Scene.load(Path(scene))
    if friction is not None:
        rock = rock.with_friction(friction)
    read = read_seismograms(tuple(map(Path, seismograms)), _path(metadata), missing_vertical)
    factors = neighbouring_factors(largest, neighbours)
    advance(0, total=len(read.found) * len(factors))
    verdicts = [judged(rock, record, factors, preset, advance) for record in read.records()]
    return Checked(verdicts, read.remarks, read.notes)
