"""A scanned scene whose hidden base is drawn anew, and what was said of a scan as it is kept."""

import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from toppling.models.folder import new_folder, replaced_folder
from toppling.models.scan.hints_file import HINTS, read_hints, write_hints
from toppling.models.scan.inspection import Inspection, inspection_of
from toppling.models.scene import Scene
from toppling.orchestrator.public import unseen
from toppling.orchestrator.public.making import Scanned

Places = Sequence[tuple[float, ...]]


def scan_again(
    scene: str | Path,
    out: str | Path | None = None,
    *,
    contact: str | Path | None = None,
    touching: Places = (),
    daylight: Places = (),
    pulls: Sequence[tuple[float, float]] = (),
    advance: Callable[..., None] = unseen,
) -> Scanned:
    """Draw the base of a scanned scene anew, with what its scan has worked out: no clouds are read.

    Parameters
    ----------
    scene : path
        Folder of a scene of :func:`scan`.
    out : path, optional
        A new folder for the result. Default: it takes the place of the scene.
    contact, touching, daylight, pulls
        As of :func:`scan`; those that are given replace the former ones of their kind.
    advance : callable
        Called with (1, what) at each stage.

    Raises
    ------
    InputError
        If the folder keeps nothing of a scan, or a hint contradicts what was seen; the scene is then left as it is.
    """
    from toppling.models.scan.worked_out import KEPT, WorkedOut

    folder = Path(scene)
    advance(0, "reading")
    kept = WorkedOut.read(folder).with_hints(inspection_of(contact, pulls, touching, daylight))
    advance(1, "drawing the hidden base")
    drawn, kept = kept.scene()
    advance(1, "writing")
    draw, notes = pictured(drawn)
    with replaced_folder(folder) if out is None else new_folder(Path(out)) as staging:
        drawn.write_into(staging)
        kept.write(staging / KEPT)
        shutil.copy2(folder / "labels.npz", staging)
        said = read_hints(folder / HINTS) if (folder / HINTS).exists() else {}
        write_hints(staging / HINTS, hints_said(said, kept.inspection))
        draw(staging)
    return Scanned(drawn, folder if out is None else Path(out), notes)


def hints_said(given: Mapping[str, Any], inspection: Inspection) -> dict[str, Any]:
    """What was said of a scan, as `hints.toml` has it."""
    said = {name: given.get(name) for name in ("units", "near", "plane")}
    said["point"] = [_as_text(each) for each in given.get("point") or ()]
    said["touch"] = [_as_text(each) for each in inspection.touching_m]
    said["daylight"] = [_as_text(each) for each in inspection.open_m]
    return said | {"pull": [list(each) for each in inspection.pulls]}


def _as_text(place: str | Sequence[float]) -> str:
    return place if isinstance(place, str) else ",".join(repr(float(each)) for each in place)


def pictured(scene: Scene) -> tuple[Callable[[Path], None], list[str]]:
    """What draws a scene's pictures into its folder, and what the user should know of its rest and base."""
    from toppling.models.intervals import base_sentences
    from toppling.orchestrator.settling_told import draw_settling, settling_notes
    from toppling.results.drawing.scene import draw_scene

    notes = settling_notes(scene) + base_sentences(scene.report)

    def draw(folder: Path) -> None:
        draw_scene(scene, folder / "scene.png", notes)
        draw_settling(scene, folder / "settling.png")

    return draw, [*notes]
