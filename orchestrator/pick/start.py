"""From the options of `toppling scan --pick` to a page that can be opened."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

from toppling.models.folder import refuse_existing
from toppling.models.scan.hints_file import OF_READING, CloudHints
from toppling.models.scan.inspection import inspection_of
from toppling.models.scan.survey import Survey
from toppling.orchestrator.pick.said import Said
from toppling.orchestrator.pick.server import PickServer
from toppling.orchestrator.pick.session import Picking
from toppling.orchestrator.public.making import Scanned, written
from toppling.orchestrator.public.scan_files import hints_said, placed_cloud


def pick_server(
    files: tuple[Path, ...], out: Path, given: dict[str, Any], saved: Callable[[Scanned], None], port: int = 0
) -> PickServer:
    """Read clouds and make the server of their page.

    Parameters
    ----------
    files : tuple of path
    out : path
        Folder that the page's scene is saved to; must not exist.
    given : dict
        Other options of the scan, by name.
    saved : callable
        Called with each scene that is saved.
    port : int

    Raises
    ------
    InputError
        If a file cannot be read, or an option cannot be used.
    FileExistsError
        If the folder exists.
    """
    refuse_existing(out)
    known = inspection_of(given["contact"], given["pull"], given["touch"], given["daylight"])
    said = Said.of({
        "near": given["near"] and list(given["near"]),
        "plane": given["plane"] and list(given["plane"]),
        "point": [list(each) for each in given["point"]],
        "touch": known.touching_m.tolist(),
        "daylight": known.open_m.tolist(),
        "pull": [list(each) for each in known.pulls],
    })  # fmt: skip
    said.hint()
    of_cloud = cast(CloudHints, {name: given[name] for name in OF_READING})
    cloud = placed_cloud(files, of_cloud)
    mine = False

    def write(survey: Survey, said: Said) -> None:
        nonlocal mine
        hints = {**of_cloud, "near": said.near, "plane": said.plane, "point": said.of_the_split.point}
        notes = written(survey, out, hints_said(hints, said.inspection()), replaces=mine)
        mine = True
        saved(Scanned(survey.scene, out, notes))

    return PickServer(Picking(cloud, given["bootstrap"], write, str(out), said), port)
