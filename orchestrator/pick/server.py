"""Server of the page of `toppling scan --pick`, made from the command's options: its files, the cloud, and hints."""

import json
import struct
import threading
from collections.abc import Callable
from http import HTTPStatus
from importlib.resources import files
from pathlib import Path
from typing import Any, cast

import numpy as np

from toppling.models.errors import InputError
from toppling.models.files.documents import NUMBER, check_shape
from toppling.models.files.folder import refuse_existing
from toppling.models.frames import azimuth_of
from toppling.models.hidden_base.inspection import inspection_of
from toppling.models.scan.hints_file import OF_READING, CloudHints
from toppling.models.scan.interface_hint import hint_of
from toppling.models.scan.placement import Placement
from toppling.models.scan.read import read_clouds
from toppling.models.scan.survey import CachedScan, Survey
from toppling.models.scene import Scene
from toppling.orchestrator.loopback import HTML, TEXT, Answers, Loopback
from toppling.orchestrator.pick.picking import Answer, Picking, Placed
from toppling.orchestrator.pick.user_hints import UserHints, numbers
from toppling.orchestrator.public import making

LARGEST_BODY = 1 << 18
"""Largest request, bytes: hints of a thousand places take a fifth."""
_LONGEST_STAGE_S = 60.0
"""Maximum time to wait for the computation's current stage when closing, s."""
_POLL_S = 20.0
"""Maximum time before a request for a new state is answered, s."""
_SCRIPT, _STYLE, _BYTES, _JSON = "text/javascript", "text/css", "application/octet-stream", "application/json"
FILES = {
    "": ("pick/page.html", HTML),
    "pick.css": ("pick/pick.css", _STYLE),
    "pick.js": ("pick/pick.js", _SCRIPT),
    "handles.js": ("pick/handles.js", _SCRIPT),
    "stage.js": ("pick/stage.js", _SCRIPT),
    "plot.js": ("pick/plot.js", _SCRIPT),
    "bearings.js": ("pick/bearings.js", _SCRIPT),
    "three.js": ("vendor/three.min.js", _SCRIPT),
}
"""Served files, by path of the request: name in `results/drawing`, and content type."""
_POLICY = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; base-uri 'none'"


class PickServer(Loopback):
    """Server for one scan; port 0 for any free port."""

    def __init__(self, picking: Picking, port: int = 0) -> None:
        self.picking = picking
        room = files("toppling.results.drawing")
        self.files = {name: (room.joinpath(path).read_bytes(), kind) for name, (path, kind) in FILES.items()}
        super().__init__(_Answers, port)
        self._worker = threading.Thread(target=picking.work, daemon=True)
        self._worker.start()

    def end(self) -> None:
        """Stop the server and the computation, from any thread."""
        self.picking.end()
        threading.Thread(target=self.shutdown, daemon=True).start()

    def server_close(self) -> None:
        """Close after the computation has stopped: native code must not run while the interpreter exits."""
        self.picking.end()
        super().server_close()
        self._worker.join(_LONGEST_STAGE_S)


class _Answers(Answers):
    """Handler of GET requests for displayed data, and POST requests with JSON."""

    server: PickServer

    def do_GET(self) -> None:  # noqa: N802  (the library's name)
        """Answer with a file of the page, the state once it has changed, or the points to draw."""
        asked, picking = self.asked(), self.server.picking
        kind, _, number = (asked or "").partition("/")
        if asked is None:
            self.refuse()
        elif asked in self.server.files:
            body, of_kind = self.server.files[asked]
            self.send(body, of_kind, _POLICY)
        elif kind == "state" and number.isascii() and number.isdigit() and len(number) < 10:
            picking.wait(int(number), _POLL_S)
            self._send_json(picking.state())
        elif kind == "cloud" and number == str(picking.view.number):
            self.send(picking.view.content, _BYTES)
        else:
            self.refuse()

    def do_POST(self) -> None:  # noqa: N802  (the library's name)
        """Set hints, resolve a click, save, or end."""
        asked = self.asked()
        if asked not in ("hints", "pick", "detail", "azimuth", "save", "end"):
            self.refuse()
            return
        try:
            content = self._content()
            if asked == "detail":
                check_shape(content, {"at_m": numbers(3), "reach_m": NUMBER}, "the page")
                spacing, points = self.server.picking.detail(np.array(content["at_m"]), content["reach_m"])
                self.send(struct.pack("<f", spacing) + points, _BYTES)
            else:
                self._send_json(self._done(asked, content))
        except InputError as error:
            self.send(str(error).encode(), TEXT, status=HTTPStatus.BAD_REQUEST)

    def _done(self, asked: str, content: Any) -> dict[str, Any]:
        picking = self.server.picking
        if asked == "hints":
            picking.set_hints(UserHints.of(content))
        elif asked == "pick":
            check_shape(content, {"at_m": numbers(3), "eye_m": numbers(3)}, "the page")
            return picking.pick(np.array(content["at_m"]), np.array(content["eye_m"]))
        elif asked == "azimuth":
            return {"azimuth_deg": azimuth_of(content) % 360.0}
        elif asked == "save":
            picking.save()
        else:
            self.server.end()
        return {}

    def _content(self) -> Any:
        """JSON of the request."""
        length = self.headers.get("Content-Length", "")
        if self.headers.get("Content-Type") != _JSON or not (length.isascii() and length.isdigit()):
            raise _refused("is no JSON of a stated length")
        if len(length) > 9 or int(length) > LARGEST_BODY:
            self.close_connection = True
            raise _refused(f"is longer than {LARGEST_BODY} bytes")
        try:
            return json.loads(self.rfile.read(int(length)))
        except (ValueError, RecursionError) as error:
            raise _refused(f"is no JSON ({type(error).__name__})") from None

    def _send_json(self, content: dict[str, Any]) -> None:
        self.send(json.dumps(content, allow_nan=False).encode(), _JSON)


def _refused(what: str) -> InputError:
    return InputError(
        "pick.request_unreadable",
        what,
        where="what the page sent",
        expected="a request of its own",
        remedy="load the page again",
    )


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
    before = CachedScan.read(scene)
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
        assert survey.cached is not None
        made = making.written_again(scene, out, survey.scene, survey.cached, replaces=mine)
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
