"""A scanned scene whose hidden base is drawn again, and what was said of a scan as it is kept."""

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from toppling.models.files.folder import new_folder, replaced_folder
from toppling.models.files.scene_document import LABELS, WORKED_OUT
from toppling.models.hidden_base.inspection import inspection_of
from toppling.models.scan.hints_file import HINTS, Place, write_hints
from toppling.orchestrator.public import unseen
from toppling.orchestrator.public.making import Scanned
from toppling.orchestrator.public.scan_files import hints_said, pictured

if TYPE_CHECKING:
    from toppling.models.scan.worked_out import WorkedOut
    from toppling.models.scene import Scene


def scan_again(
    scene: str | Path,
    out: str | Path | None = None,
    *,
    contact: str | Path | None = None,
    touch: Sequence[Place] = (),
    daylight: Sequence[Place] = (),
    pull: Sequence[tuple[float, float]] = (),
    base: str | None = None,
    touch_only: bool = False,
    advance: Callable[..., None] = unseen,
) -> Scanned:
    """Draw the base of a scanned scene again, with what its scan has worked out: no clouds are read.

    Parameters
    ----------
    scene : path
        Folder of a scene of :func:`scan`.
    out : path, optional
        A new folder for the result. Default: it takes the place of the scene.
    contact, touch, daylight, pull, base, touch_only
        As of :func:`scan`; those that are given replace the former ones of their kind.
    advance : callable
        Called with (1, what) at each stage.

    Raises
    ------
    InputError
        If the folder keeps nothing of a scan, a file in it is of another scene, or a hint contradicts what was seen;
        the scene is then left as it is.
    """
    from toppling.models.scan.worked_out import WorkedOut

    folder = Path(scene)
    advance(0, "reading")
    kept = WorkedOut.read(folder).with_hints(inspection_of(contact, pull, touch, daylight, base, touch_only))
    advance(1, "drawing the hidden base")
    drawn, kept = kept.scene()
    advance(1, "writing")
    return written_again(folder, None if out is None else Path(out), drawn, kept)


def written_again(
    scene: Path, out: Path | None, drawn: "Scene", kept: "WorkedOut", replaces: bool = False
) -> Scanned:
    """Write a scene whose base was drawn again in place of the former one, or into another folder.

    scene: folder of the former one.
    replaces: whether the other folder may be there already.
    """
    draw, notes = pictured(drawn)
    target = scene if out is None else out
    with (replaced_folder if replaces or out is None else new_folder)(target) as staging:
        kept.write(staging / WORKED_OUT)
        if (scene / LABELS).exists():
            shutil.copy2(scene / LABELS, staging)
        drawn.write_into(staging)
        write_hints(staging / HINTS, hints_said(kept.said, kept.inspection))
        draw(staging)
    return Scanned(drawn, target, notes)
