"""`toppling scan`: from point clouds and meshes to a scene."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from toppling.models.errors import InputError
from toppling.models.lengths import METRES
from toppling.models.scan.hints_file import KEYS, KINDS, OF_CLOUDS, RIVALS, read_hints
from toppling.orchestrator.terminal import bar
from toppling.orchestrator.verbs import shared_options as shared
from toppling.orchestrator.verbs.shared_options import browsing_options, option, served

if TYPE_CHECKING:
    from toppling.models.scene import Scene
    from toppling.orchestrator.public.making import Scanned


def _place(_: click.Context, parameter: click.Parameter, words: tuple[str, ...]) -> list[tuple[float, ...]]:
    return [_coordinates(word, f"--{parameter.name}") for word in words]


class _FileOrLines(click.Path):
    """Path of a file, or its content as a list from hints.toml."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Read a value."""
        return value if isinstance(value, list) else super().convert(value, param, ctx)


_FILE_OR_LINES = _FileOrLines(path_type=Path)


def _outlined(
    _: click.Context, __: click.Parameter, given: Path | list[str] | None
) -> Path | list[tuple[float, ...]] | None:
    return [_coordinates(word, "--outline") for word in given] if isinstance(given, list) else given


def _apart(
    _: click.Context, __: click.Parameter, given: tuple[str, str, float] | None
) -> tuple[Any, Any, float] | None:
    return given and (_coordinates(given[0], "--length"), _coordinates(given[1], "--length"), given[2])


def _hinted(context: click.Context, _: click.Parameter, file: Path | None) -> None:
    if file is not None:
        context.default_map = read_hints(file)


def _without_rivals(given: dict[str, Any]) -> dict[str, Any]:
    """Options without the hints of a file that options of the command line replace."""
    source = click.get_current_context().get_parameter_source
    typed = {name for name in KEYS if source(name) is click.core.ParameterSource.COMMANDLINE}
    beaten = {name for group in RIVALS if typed & set(group) for name in set(group) - typed}
    return given | {name: () if name == "point" else None for name in beaten}


@click.command()
@click.argument("files", nargs=-1, type=shared.PATH)
@option("--out", type=shared.PATH, help="Folder of the scene; must not exist.")
@option(
    "--units", type=click.Choice(list(METRES)),
    help="Unit of the coordinates, which overrides that stated in the files. Default: that of the files, or metres.",
)  # fmt: skip
@option(
    "--up", metavar="AXIS",
    help="What points upward in the files: x, y, z, -x, -y, -z or three numbers X,Y,Z. z unless given; in glTF y.",
)  # fmt: skip
@option(
    "--length", type=(str, str, float), callback=_apart, metavar="P Q METRES",
    help="A measured length for a model without scale: two of its places, X,Y,Z each, and the metres between them.",
)  # fmt: skip
@option(
    "--gcp", type=_FILE_OR_LINES, metavar="FILE",
    help="CSV of three or more ground control points: x,y,z in the model, then x,y,z as surveyed. They say scale, "
    "attitude and place.",
)  # fmt: skip
@option(
    "--crs", metavar="EPSG:CODE",
    help="Coordinate system of the survey, where the files state none; it wins over what they state.",
)  # fmt: skip
@option(
    "--rock", metavar="FILE|CLASS",
    help="The rock, where it was separated before: one of the files, a LAS class, or FIELD=VALUE of a PLY's scalar. "
    "All else is the pedestal, unless --pedestal names that.",
)  # fmt: skip
@option("--pedestal", metavar="FILE|CLASS", help="The pedestal, in the same ways.")
@option(
    "--near", type=float, nargs=2, metavar="X Y",
    help="Survey coordinates on your rock, where several rocks stand.",
)  # fmt: skip
@option(
    "--plane", type=(float, float, float, float, shared.AZIMUTH), metavar="X Y Z SLOPE AZIMUTH",
    help="The measured interface: one of its points, its slope and the azimuth of its dip, degrees from east to north "
    "or a bearing such as N40E.",
)  # fmt: skip
@option(
    "--point", multiple=True, callback=_place, metavar="X,Y,Z",
    help="A place where rock and pedestal meet, in survey coordinates; give three or more.",
)  # fmt: skip
@option(
    "--outline", type=_FILE_OR_LINES, callback=_outlined, metavar="FILE",
    help="CSV of the contact's outline: x,y,z of one vertex per line, in order, in survey coordinates.",
)  # fmt: skip
@option(
    "--contact", type=shared.PATH, metavar="FILE",
    help="CSV of places at the base: x,y,z,touch where rock and pedestal touch, x,y,z,daylight where light passes.",
)  # fmt: skip
@option("--touch", multiple=True, callback=_place, metavar="X,Y,Z", help="A place that touches.")
@option("--daylight", multiple=True, callback=_place, metavar="X,Y,Z", help="A place where light passes.")
@option(
    "--pull", type=(shared.AZIMUTH, float), multiple=True, metavar="AZIMUTH RATIO",
    help="A pull or tilt test: the azimuth of the pull, 0 to 360 degrees counter-clockwise from east or a bearing such "
    "as N40E, and the largest force that the rock bore, over its weight.",
)  # fmt: skip
@option(
    "--touch-only", is_flag=True,
    help="Rock and pedestal touch at the places that are given and nowhere else.",
)  # fmt: skip
@option(
    "--base", type=click.Choice(KINDS),
    help="Kind of the base: flat (dressed or split), rough, or rounded toward its outline. Weighed by what was seen "
    "unless given.",
)  # fmt: skip
@option(
    "--hints", type=shared.PATH, metavar="FILE", is_eager=True, expose_value=False, callback=_hinted,
    help="hints.toml of an earlier scan; options given beside it win.",
)  # fmt: skip
@option(
    "--again", type=shared.PATH, metavar="SCENE",
    help="Draw the base of a scanned scene again, with other hints on it (--contact to --base), in seconds.",
)  # fmt: skip
@option(
    "--pick", "picks", is_flag=True,
    help="Give hints by clicks on the cloud: opens a page that shows what comes of them and saves the scene.",
)  # fmt: skip
@browsing_options
@shared.json_option("Print the content of scene.json.")
def scan(
    files: tuple[Path, ...],
    again: Path | None,
    picks: bool,
    port: int,
    opens: bool | None,
    as_json: bool,
    **given: Any,
) -> None:
    """Turn laser scans or photogrammetry into a rock on its pedestal.

    FILES are stations of one survey (LAZ, LAS, PLY, PCD, XYZ, PTS, PTX, TXT, CSV, E57) or pieces of one mesh (OBJ, PLY,
    STL, GLB), z up, in the unit that they state, or in metres. What is not so is placed by --units, --up, --length or
    --gcp; all other options take coordinates as placed, in metres. Rock and pedestal are separated automatically; if
    you know better where they meet, use --plane, --point or --outline.

    No laser sees the base of the rock. The command draws bases that are consistent with the scan and on which the rock
    stands as scanned, and keeps them in the scene. --contact, --touch, --daylight, --pull, --base and --outline narrow
    them down. The scan stores its intermediate results, so that a later hint needs no clouds: --again draws the bases
    again, in place of the former ones or in the folder --out.

    --pick shows the cloud in a browser, where hints are clicks. The page is served to this machine only, at an address
    that holds a secret; --port and --open concern it. From another machine: ssh -L PORT:127.0.0.1:PORT HOST. With
    --again it opens at once on the stored results of the scan, for hints on the base.

    \b
    toppling scan station1.laz station2.laz --out scenes/rock
    toppling scan cloud.e57 --out scenes/rock --point 331250.1,3777309.2,480.3 \\
        --point 331251.0,3777310.4,480.2 --point 331249.4,3777310.8,480.4
    toppling scan cloud.e57 --out scenes/rock --contact looked.csv --pull 135 0.32
    toppling scan model.obj --out scenes/rock --up y --length 0.12,1.4,0.3 2.31,1.38,0.29 1.5
    toppling scan --again scenes/rock --pull N40E 0.21
    toppling scan cloud.e57 --out scenes/rock --pick
    toppling scan --again scenes/rock --pick
    """
    given = _without_rivals(given)
    _check_usage(files, again, given)
    if picks:
        _pick(files, again, given, as_json, port, opens)
        return
    if again is None:
        made = _from_clouds(files, given)
    else:
        from toppling.orchestrator.public.making import scan_again

        with bar("scan again", 3) as advance:
            made = scan_again(
                again, given["out"], contact=given["contact"], touch=given["touch"], daylight=given["daylight"],
                pull=given["pull"], base=given["base"], touch_only=given["touch_only"], advance=advance,
            )  # fmt: skip
    _print_result(made, as_json)


def _print_result(made: "Scanned", as_json: bool) -> None:
    """Print the summary of a scan and its notes."""
    click.echo(
        json.dumps(made.scene.to_json(), allow_nan=False) if as_json else summary(made.scene, made.folder)
    )
    for note in made.notes:
        click.echo(note, err=as_json)


def _pick(
    files: tuple[Path, ...],
    again: Path | None,
    given: dict[str, Any],
    as_json: bool,
    port: int,
    opens: bool | None,
) -> None:
    """Serve the page for picking hints until the user has finished."""
    from toppling.orchestrator.pick.server import again_server, pick_server

    click.echo("reading", err=True)
    saved: list[Scanned] = []
    if again is None:
        made, names = pick_server(files, given["out"], given, saved.append, port), files
    else:
        made, names = again_server(again, given["out"], given, saved.append, port), (again,)
    with made as server:
        served(server, ", ".join(file.name for file in names), opens, "ended")
    if not saved:
        raise click.ClickException("nothing was saved")
    _print_result(saved[-1], as_json)


def _check_usage(files: tuple[Path, ...], again: Path | None, given: dict[str, Any]) -> None:
    """Refuse inconsistent options."""
    if again is None:
        if not files and not (given["rock"] and given["pedestal"]):
            raise click.UsageError("Missing argument 'FILES...'.")
        if given["out"] is None:
            raise click.UsageError("Missing option '--out'.")
        return
    if files:
        raise click.UsageError("--again takes no FILES: it reads the stored results of the scene's scan.")
    for name in OF_CLOUDS:
        if given[name]:
            raise click.UsageError(f"--again draws the base only: --{name} needs a new scan of the clouds.")


def _from_clouds(files: tuple[Path, ...], given: dict[str, Any]) -> "Scanned":
    from toppling.models.scan.survey import STAGES
    from toppling.orchestrator.public.making import scan as scanned

    with bar("scan", STAGES + 3) as advance:
        return scanned(files, given.pop("out"), **given, advance=advance)


def summary(scene: "Scene", out: Path) -> str:
    """Line on the scanned rock and pedestal."""
    rock, pedestal = scene.rock, scene.pedestal
    east_m, north_m = rock.vertices_m[:, :2].max(axis=0) - rock.vertices_m[:, :2].min(axis=0)
    # Width and height together reveal different units of x, y and z.
    from toppling.models.frames import quadrant_of
    from toppling.models.hidden_base.intervals import volume_text

    return (
        f"{out}: rock of {volume_text(scene.report, rock.volume_m3)}, {east_m:.3g} by {north_m:.3g} m wide (x, y) and "
        f"{rock.height_m:.3g} m high, on a pedestal that dips "
        f"{pedestal.slope_deg:.2f}° toward {quadrant_of(pedestal.downhill_azimuth_deg)}; see {out / 'scene.png'}"
    )


def _coordinates(text: str, where: str) -> tuple[float, ...]:
    try:
        x, y, z = (float(word) for word in text.replace(",", " ").split())
    except ValueError:
        raise InputError(
            "hint.place_unreadable",
            f"'{text}' is not a place",
            where=where,
            expected="three numbers: x,y,z in survey coordinates",
            remedy=f"write it like {where} 331250.1,3777309.2,480.3",
        ) from None
    return x, y, z
