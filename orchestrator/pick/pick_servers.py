"""Creation of the server for `toppling scan --pick` from the command's options."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

from toppling.models.errors import InputError
from toppling.models.files.folder import refuse_existing
from toppling.models.hidden_base.inspection import inspection_of
from toppling.models.scan.hints_file import OF_READING, CloudHints
from toppling.models.scan.interface_hint import hint_of
from toppling.models.scan.placement import Placement
from toppling.models.scan.read import read_clouds
from toppling.models.scan.survey import Survey
from toppling.models.scan.worked_out import WorkedOut
from toppling.models.scene import Scene
from toppling.orchestrator.pick.page import UserHints
from toppling.orchestrator.pick.picking import Answer, Picking, Placed
from toppling.orchestrator.pick.server import PickServer
from toppling.orchestrator.public import making

_OF_THE_PAGE = ("units", "up", "length")
"""Hints on files that the page can change; others keep the command's values."""


def pick_server(
    files: tuple[Path, ...],
    out: Path,
    given: dict[str, Any],
    saved: Callable[[making.Scanned], None],
    port: int = 0,
) -> PickServer:
    """Read clouds and create the server of their page.

    out: folder for the page's scene; must not exist.
    given: other options of the scan, by name.
    saved: called with each scene that is saved.
    Raises InputError if a file cannot be read, or an option cannot be used, FileExistsError if the folder exists.
    """
    refuse_existing(out)
    known = inspection_of(given["contact"], **making.of_base(given))
    hint = hint_of(outline=given["outline"])
    user_hints = UserHints.of({
        "units": given["units"],
        "up": given["up"],
        "length": given["length"] and [list(place) for place in given["length"][:2]] + [given["length"][2]],
        "near": given["near"] and list(given["near"]),
        "plane": given["plane"] and list(given["plane"]),
        "point": [list(point) for point in given["point"]],
        "outline": [] if hint is None else hint.anchors_m.tolist(),
        **making.hints_on_base(known),
    })  # fmt: skip
    user_hints.hint()
    surveyed = cast(CloudHints, {name: given[name] for name in OF_READING if name not in _OF_THE_PAGE})
    mine = False

    def write(survey: Survey, user_hints: UserHints) -> None:
        nonlocal mine
        notes = making.written(
            survey,
            out,
            making.stated_hints({**user_hints.hints(), **surveyed}, user_hints.inspection()),
            replaces=mine,
        )
        mine = True
        saved(making.Scanned(survey.scene, out, notes))

    def read(user_hints: UserHints) -> Placed:
        hints = cast(CloudHints, {**user_hints.hints(), **surveyed})
        return Placed(making.placed_cloud(files, hints)[0], making.placed_by(hints)[0])

    try:
        placed = read(user_hints)
    except InputError:
        # A model with another up axis or unit is shown unchanged, so that the page can place it.
        as_it_is = Placement(says_up=True, says_scale=True)
        placed = Placed(read_clouds(files, None, as_it_is), as_it_is, refused=True)
    return PickServer(Picking(placed, read, write, str(out), user_hints), port)


def again_server(
    scene: Path,
    out: Path | None,
    given: dict[str, Any],
    saved: Callable[[making.Scanned], None],
    port: int = 0,
) -> PickServer:
    """Create the server of a page for hints on the base, from the stored results of a scan.

    scene: folder of a scanned scene, which the page's scene replaces unless it has a new folder, `out`.
    given, saved, port: see :func:`pick_server`.
    Raises InputError if the folder contains no results of a scan, or an option is invalid; FileExistsError if `out`
    exists.
    """
    if out is not None:
        refuse_existing(out)
    before = WorkedOut.read(scene)
    looked = inspection_of(given["contact"], **making.of_base(given))
    stored = before.with_hints(looked)
    user_hints = UserHints.of(making.hints_on_base(stored.inspection))
    cloud, label = stored.cloud()
    # The folder's results belong to its hints, unless further hints are given.
    nothing_new = looked.says_nothing and not looked.touch_only
    survey = Survey(Scene.load(scene), label, (), before) if nothing_new else None
    mine = False

    def write(survey: Survey, _: UserHints) -> None:
        nonlocal mine
        assert survey.worked_out is not None
        made = making.written_again(scene, out, survey.scene, survey.worked_out, replaces=mine)
        mine = True
        saved(made)

    return PickServer(
        Picking(
            Placed(cloud, Placement()),
            lambda _: Placed(cloud, Placement()),
            write,
            str(out or scene),
            user_hints,
            Answer(user_hints, stored, label, (), survey),
        ),
        port,
    )
