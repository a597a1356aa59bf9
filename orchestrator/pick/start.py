"""From the options of `toppling scan --pick` to a page that can be opened."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

from toppling.models.errors import InputError
from toppling.models.folder import refuse_existing
from toppling.models.scan.hints_file import OF_READING, CloudHints
from toppling.models.scan.inspection import inspection_of
from toppling.models.scan.placement import Placement
from toppling.models.scan.read import read_clouds
from toppling.models.scan.survey import Survey
from toppling.orchestrator.pick.said import Said
from toppling.orchestrator.pick.server import PickServer
from toppling.orchestrator.pick.session import Picking, Placed
from toppling.orchestrator.public.making import Scanned, written
from toppling.orchestrator.public.scan_files import hints_said, of_base, placed_by, placed_cloud

OF_THE_PAGE = ("units", "up", "length")
"""What the page itself says of the files; the rest stays as the command was told."""


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
    known = inspection_of(given["contact"], **of_base(given))
    said = Said.of({
        "units": given["units"],
        "up": given["up"],
        "length": given["length"] and [list(each) for each in given["length"][:2]] + [given["length"][2]],
        "near": given["near"] and list(given["near"]),
        "plane": given["plane"] and list(given["plane"]),
        "point": [list(each) for each in given["point"]],
        "touch": known.touching_m.tolist(),
        "daylight": known.open_m.tolist(),
        "pull": [list(each) for each in known.pulls],
        "base": known.base, "touch_only": known.touch_only,
    })  # fmt: skip
    said.hint()
    surveyed = cast(CloudHints, {name: given[name] for name in OF_READING if name not in OF_THE_PAGE})
    mine = False

    def write(survey: Survey, said: Said) -> None:
        nonlocal mine
        notes = written(
            survey, out, hints_said({**said.hints(), **surveyed}, said.inspection()), replaces=mine
        )
        mine = True
        saved(Scanned(survey.scene, out, notes))

    def read(said: Said) -> Placed:
        hints = cast(CloudHints, {**said.hints(), **surveyed})
        return Placed(placed_cloud(files, hints), placed_by(hints)[0])

    try:
        placed = read(said)
    except InputError:
        # A model that lies on its side, or in another unit, is shown as it is, so that the page can place it.
        as_it_is = Placement(says_up=True, says_scale=True)
        placed = Placed(read_clouds(files, None, as_it_is), as_it_is, refused=True)
    return PickServer(Picking(placed, read, given["bootstrap"], write, str(out), said), port)
